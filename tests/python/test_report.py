"""The report page in a browser without a screen: it draws itself, alone, without a word on the console."""

import base64
import html
import io
import json
import re
import shutil
import struct
import subprocess
import zlib

import numpy as np
import pytest
from PIL import Image

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
    drystone.simplify(
        town_path, folder, "--ratio", 0.1, "--cluster-faces", 3000, "--measure", "--samples", 100_000, "--report", path
    )
    return path


@pytest.fixture(scope="module")
def comparison(drystone, town_path, tmp_path_factory):
    folder = tmp_path_factory.mktemp("comparison")
    result = drystone.simplify(town_path, folder, "--ratio", 0.1).output
    path = folder / "comparison.html"
    drystone("compare", town_path, result, "--samples", 100_000, "--report", path)
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
    assert len(found["plots"]) >= 5 and min(found["plots"]) > 200
    check_pictures(found, ["before", "after", "distance from the original", "pass"])


def test_comparison_is_a_page_of_its_own(comparison, browser, tmp_path):
    found, console = browser(comparison, tmp_path)
    assert console == []
    assert len(found["plots"]) == 1
    check_pictures(found, ["before", "after", "distance from the original"])


def check_pictures(found, kinds):
    for alt, complete, width, height in found["pictures"]:
        assert alt and complete and width > 0 and height > 0, alt
    for kind in kinds:
        assert sum(alt.startswith(kind) for alt, *_ in found["pictures"]) >= 3, kind


def decoded(page, alt):
    """A picture of the page as rows of pixels."""
    address = re.search(rf'<img src="data:image/(?:jpeg|png);base64,([^"]*)" alt="{re.escape(alt)}"', page.read_text())
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(address.group(1)))).convert("RGB"), float)


def test_pictures_show_the_town(page):
    before, after = (decoded(page, f"{when}, from above") for when in ("before", "after"))
    shown = np.abs(before - before[0, 0]).max(axis=2) > 30
    assert 0.2 < shown.mean() < 0.9
    assert before[shown].std(axis=0).min() > 10, "one colour all over"
    assert np.abs(before - after).mean() < 12, "the result looks like another town"


def test_pictures_do_not_depend_on_threads_or_memory(drystone, town_path, tmp_path):
    digests = set()
    for threads, memory in ((1, "128MiB"), (2, "1GiB")):
        folder = tmp_path / memory
        folder.mkdir()
        page = folder / "page.html"
        options = ("--cluster-faces", 3000, "--threads", threads, "--memory", memory, "--report", page)
        run = drystone.simplify(town_path, folder, "--ratio", 0.1, *options)
        pictures = re.findall(r'<img src="([^"]*)"', page.read_text())
        assert len(pictures) >= 10
        digests.add((run.output.read_bytes(), *pictures))
        assert run.report["memory"]["peak_resident"] <= run.report["memory"]["budget"]
    assert len(digests) == 1


def test_hostile_images_only_warn(drystone, town_path, tmp_path):
    source = tmp_path / "town"
    shutil.copytree(town_path.parent, source)
    (source / "facade.jpg").write_bytes(b"\xff\xd8\xff\xe0 no image")
    (source / "roof.jpg").unlink()
    # A header that claims 2 billion pixels.
    claim = struct.pack(">IIBBBBB", 65535, 32767, 8, 2, 0, 0, 0)
    chunk = struct.pack(">I", len(claim)) + b"IHDR" + claim + struct.pack(">I", zlib.crc32(b"IHDR" + claim))
    (source / "street.png").write_bytes(b"\x89PNG\r\n\x1a\n" + chunk)
    page = tmp_path / "page.html"
    run = drystone.simplify(source / "town.obj", tmp_path, "--ratio", 0.1, "--memory", "128MiB", "--report", page)
    assert run.report["repairs"]["unreadable_image"] >= 2
    assert run.report["repairs"]["missing_image"] >= 1
    assert run.report["memory"]["peak_resident"] <= 128 << 20
    assert decoded(page, "before, from above").shape == (640, 960, 3)


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


@pytest.mark.parametrize(
    ("options", "name", "words"),
    [
        (["--textures", "bake"], "a.obj", ["new texture", "1 image, of which charts cover", "without MTL and textures"]),
        (["--textures", "bake"], "b.glb", ["new texture", "with its images"]),
        (["--textures", "copy"], "c.obj", ["4 images copied, 1.05 of 1.05 megapixels"]),
        (["--textures", "link"], "d.obj", ["4 images", "linked, 1.05 of 1.05 megapixels"]),
        (["--textures", "reference"], "e.obj", ["none copied"]),
        ([], "f.glb", ["with its images", "of 4: none lost"]),
    ],
)
def test_page_says_how_textures_reach_the_result(drystone, town_path, tmp_path, options, name, words):
    page = tmp_path / "page.html"
    drystone.simplify(town_path, tmp_path, "--ratio", 0.1, "--threads", 1, "--report", page, *options, name=name)
    text = re.sub(r"<style>.*?</style>|<[^>]+>", " ", page.read_text(), flags=re.DOTALL).replace("\u202f", " ")
    for word in [*words, "1 thread "]:
        assert word in text
    assert ("copied" in text) == any("copied" in word for word in words)


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
