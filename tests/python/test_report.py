"""The report page in a browser without a screen: it draws itself, alone, without a word on the console."""

import html
import json
import re
import shutil
import subprocess

import pytest

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")

# Appended to a copy of the page: leaves, as text, what the browser made of it.
PROBE = """
<script>
addEventListener("load", () => {
  const found = {
    pictures: [...document.images].map(i => [i.alt, i.complete, i.naturalWidth, i.naturalHeight]),
    plots: [...document.querySelectorAll(".plot svg")].map(s => s.getBoundingClientRect().width),
    wide: document.documentElement.scrollWidth > document.documentElement.clientWidth,
    text: document.body.innerText,
  };
  const left = document.createElement("pre");
  left.id = "probe";
  left.textContent = JSON.stringify(found);
  document.body.append(left);
});
</script>
"""


@pytest.fixture(scope="session")
def browser():
    found = next((path for path in map(shutil.which, BROWSERS) if path), None)
    if found is None:
        pytest.skip(f"no browser: none of {', '.join(BROWSERS)} is installed (Debian: apt-get install chromium)")

    def look(page, folder, width=1280):
        copy = folder / f"probed_{width}.html"
        copy.write_text(page.read_text() + PROBE)
        done = subprocess.run(
            [
                found,
                "--headless=new",
                "--no-sandbox",
                "--disable-gpu",
                "--enable-logging=stderr",
                f"--user-data-dir={folder / 'profile'}",
                f"--window-size={width},1000",
                "--virtual-time-budget=20000",
                "--dump-dom",
                copy.as_uri(),
            ],
            capture_output=True,
            text=True,
            timeout=120,
        )
        probe = re.search(r'<pre id="probe">(.*?)</pre>', done.stdout, re.S)
        assert probe, done.stderr
        console = [line for line in done.stderr.splitlines() if "CONSOLE" in line]
        return json.loads(html.unescape(probe.group(1))), console

    return look


@pytest.fixture(scope="module")
def page(drystone, town_path, tmp_path_factory):
    folder = tmp_path_factory.mktemp("report")
    path = folder / "report.html"
    drystone.simplify(town_path, folder, "--ratio", 0.1, "--cluster-faces", 3000, "--report", path)
    return path


def test_page_loads_nothing_from_elsewhere(page):
    text = page.read_text()
    assert re.findall(r'(?:src|href)="(?!data:)[^"]*"', text) == []
    assert re.findall(r"url\((?!data:)|@import", text) == []
    addresses = set(re.findall(r"https?://[^\"' <)]+", text))
    assert addresses <= {"http://www.w3.org/2000/svg", "http://www.w3.org/1999/xlink"}


def test_browser_has_nothing_to_complain_about(page, browser, tmp_path):
    found, console = browser(page, tmp_path)
    assert console == []
    assert len(found["plots"]) >= 3 and min(found["plots"]) > 200
    for alt, complete, width, height in found["pictures"]:
        assert alt and complete and width > 0 and height > 0, alt


def test_narrow_screen_needs_no_sideways_scrolling(page, browser, tmp_path):
    found, _ = browser(page, tmp_path, width=500)
    assert not found["wide"]


def test_page_says_what_the_json_says(drystone, town_path, browser, tmp_path):
    page = tmp_path / "both.html"
    run = drystone.simplify(town_path, tmp_path, "--ratio", 0.1, "--report", page)
    found, _ = browser(page, tmp_path)
    text = found["text"].replace("\u202f", " ")
    for count in (run.report["faces"]["input"], run.report["faces"]["output"]):
        assert f"{count:,}".replace(",", " ") in text
    assert run.report["program"] in text


def test_hostile_names_are_text(drystone, town_path, browser, tmp_path):
    folder = tmp_path / "<img src=x onerror=alert(1)>"
    folder.mkdir()
    name = '"><script>console.error(1)</script>&amp;.obj'.replace("/", "_")
    page = tmp_path / "page.html"
    drystone.simplify(town_path, folder, "--ratio", 0.1, "--report", page, name=name)
    found, console = browser(page, tmp_path)
    assert console == []
    assert name in found["text"]


def test_another_extension_is_refused_before_anything_is_read(drystone, tmp_path):
    drystone("simplify", tmp_path / "none.obj", "-o", tmp_path / "out.obj", "--ratio", 0.1, "--report", "a.pdf", codes=(2,))
