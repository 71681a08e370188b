"""`drystone serve`: what it answers, what it refuses, and the page in a browser."""

import json
import os
import resource
import shutil
import signal
import socket
import subprocess
import time
import urllib.error
import urllib.request
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import objlib

MODULES = objlib.REPOSITORY / "target" / "node" / "node_modules"
CHROMIUM = os.environ.get("CHROMIUM", "/usr/bin/chromium")


@pytest.fixture(scope="module", params=["none", "meshopt"])
def served(drystone, tmp_path_factory, request):
    """The town as tiles, plain or compressed, and the address of the page."""
    folder = tmp_path_factory.mktemp("serve") / "tiles"
    town = objlib.FIXTURES / "town" / "town.obj"
    options = ["--tile-faces", "1000", "--tile-side", "512", "--compress", request.param]
    report = drystone("tile", town, "-o", folder, *options, "--json", "--quiet")
    (folder.parent / "secret.txt").write_text("secret")
    (folder / "link.glb").symlink_to(folder.parent / "secret.txt")
    server = subprocess.Popen([drystone.binary, "serve", folder, "--port", "0"], stdout=subprocess.PIPE, text=True)
    address = server.stdout.readline().strip()
    yield folder, address, json.loads(report.stdout)
    server.send_signal(signal.SIGINT)
    assert server.wait(10) == 0


def get(address, path, **options):
    with urllib.request.urlopen(urllib.request.Request(f"{address}{path}", **options), timeout=10) as answer:
        return answer.read(), answer.headers


def test_it_answers_with_the_page_and_the_files(served):
    folder, address, _ = served
    assert address.startswith("http://127.0.0.1:")
    page, headers = get(address, "")
    assert b"page.js" in page and headers["Content-Type"].startswith("text/html")
    assert b"WebGL" in get(address, "page.js")[0] and b"decode" in get(address, "meshopt.js")[0]
    for name in ["tileset.json", *(str(path.relative_to(folder)) for path in sorted(folder.glob("*/*.glb"))[:5])]:
        assert get(address, f"tiles/{name}")[0] == (folder / name).read_bytes()


def raw(address, text):
    host, port = address.removeprefix("http://").strip("/").split(":")
    with socket.create_connection((host, int(port)), timeout=10) as connection:
        connection.sendall(text.encode())
        connection.shutdown(socket.SHUT_WR)
        return b"".join(iter(lambda: connection.recv(4096), b"")).decode()


@pytest.mark.parametrize(
    "path", ["tiles/../secret.txt", "tiles/%2e%2e/secret.txt", "tiles//etc/passwd", "tiles/link.glb", "tiles/0", "x", "tiles/"]
)
def test_nothing_outside_of_the_folder_is_read(served, path):
    answer = raw(served[1], f"GET /{path} HTTP/1.1\r\nHost: localhost\r\n\r\n")
    assert answer.startswith("HTTP/1.1 404 ") and "secret\n" not in answer


def test_strangers_and_other_methods_are_refused(served):
    address = served[1]
    assert raw(address, "GET / HTTP/1.1\r\nHost: example.org\r\n\r\n").startswith("HTTP/1.1 403 ")
    assert raw(address, "PUT /tiles/a HTTP/1.1\r\nHost: localhost\r\n\r\n").startswith("HTTP/1.1 405 ")
    assert raw(address, "x" * 100_000).startswith("HTTP/1.1 400 ")
    with pytest.raises(urllib.error.HTTPError):
        get(address, "", data=b"a")
    port = int(address.strip("/").rsplit(":", 1)[1])
    own = subprocess.run(["hostname", "-I"], capture_output=True, text=True).stdout.split()
    for other in own:
        with pytest.raises(OSError):
            socket.create_connection((other, port), timeout=2)


def test_a_folder_without_tiles_and_a_taken_port_are_refused(drystone, served, tmp_path):
    assert "no tileset.json" in drystone("serve", tmp_path, codes=(2,)).stderr
    port = served[1].strip("/").rsplit(":", 1)[1]
    assert "choose another one" in drystone("serve", served[0], "--port", port, codes=(2,)).stderr


@pytest.mark.skipif(not hasattr(resource, "prlimit"), reason="limits of another process")
def test_it_goes_on_once_files_can_be_opened_again(drystone, served):
    command = [drystone.binary, "serve", served[0], "--port", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        address = server.stdout.readline().strip()
        limits = resource.prlimit(server.pid, resource.RLIMIT_NOFILE)
        resource.prlimit(server.pid, resource.RLIMIT_NOFILE, (3, limits[1]))
        time.sleep(0.5)
        assert server.poll() is None
        resource.prlimit(server.pid, resource.RLIMIT_NOFILE, limits)
        assert b"page.js" in get(address, "")[0]
        server.send_signal(signal.SIGINT)
        assert server.wait(10) == 0


SCRIPT = """
import { createRequire } from "node:module";
const [address, modules, chromium, picture] = process.argv.slice(2);
const browser = await createRequire(modules + "/x")("playwright-core").chromium.launch({
  executablePath: chromium, args: ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"] });
const page = await browser.newPage({ viewport: { width: 900, height: 600 } });
const errors = [], found = {};
page.on("console", message => message.type() === "error" && !message.location().url.endsWith("favicon.ico") && errors.push(message.text()));
page.on("pageerror", error => errors.push(error.message));
await page.goto(address + "?distance=0.6");
const calm = async () => {
  let before;
  for (let turn = 0; turn < 120; turn++) {
    await page.waitForTimeout(250);
    const now = await page.evaluate(() => window.shown);
    if (now?.tiles > 0 && now.busy === 0 && JSON.stringify(now) === JSON.stringify(before)) return now;
    before = now;
  }
};
found.error = await calm();
await page.screenshot({ path: picture + "-error.png" });
for (const level of [0, 2]) {
  await page.fill("#level", String(level));
  found[level] = await calm();
}
await page.check("#colours");
await page.check("#wires");
await calm();
await page.screenshot({ path: picture + "-wires.png" });
await browser.close();
console.log(JSON.stringify({ found, errors }));
"""


@pytest.mark.slow
def test_the_page_shows_the_tiles(served, tmp_path):
    if shutil.which("node") is None or not (MODULES / "playwright-core").is_dir() or not Path(CHROMIUM).exists():
        pytest.skip("node, playwright-core or Chromium are absent (tools/test installs the package where npm is)")
    folder, address, report = served
    (tmp_path / "page.mjs").write_text(SCRIPT)
    command = ["node", tmp_path / "page.mjs", address, MODULES, CHROMIUM, tmp_path / "picture"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=180)
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert told["errors"] == []
    for level in (0, 2):
        shown = told["found"][str(level)]
        assert (shown["tiles"], shown["triangles"]) == (report["levels"][level]["tiles"], report["levels"][level]["faces"])
    assert len(told["found"]["error"]["levels"]) > 1
    pictures = [np.asarray(Image.open(f"{tmp_path}/picture-{name}.png").convert("RGB")) for name in ("error", "wires")]
    assert all(picture[:, 300:].reshape(-1, 3).std(0).min() > 15 for picture in pictures)
    assert np.abs(pictures[0].astype(int) - pictures[1]).mean() > 5
