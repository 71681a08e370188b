"""A pyramid in two viewers that people use: what they select from far, middle and near, and what they show."""

import json
import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import objlib

VIEWERS = objlib.REPOSITORY / "tests" / "viewers"
MODULES = objlib.REPOSITORY / "target" / "node" / "node_modules"
CHROMIUM = os.environ.get("CHROMIUM", "/usr/bin/chromium")
BLOCK = objlib.REPOSITORY.parent / "shared" / "data" / "cc_cyanhabao" / "cc_cyanhabao.obj"
DISTANCES = {"far": 40, "middle": 1.8, "near": 0.7}
BACKGROUND = np.array([255, 0, 255])

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def pyramid(drystone, tmp_path_factory, request):
    folder = tmp_path_factory.mktemp("viewers") / "tiles"
    source, *options = request.param
    if not source.exists():
        pytest.skip(f"{source} is absent")
    done = drystone("tile", source, "-o", folder, *options, "--json", "--quiet")
    return folder, json.loads(done.stdout)


def shown(folder, page, distance, picture):
    if shutil.which("node") is None or not (MODULES / "cesium").is_dir() or not Path(CHROMIUM).exists():
        pytest.skip("node, the viewers' packages or Chromium are absent (tools/test installs the packages where npm is)")
    command = ["node", VIEWERS / "view.mjs", folder, MODULES, page, picture, str(distance)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=180)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


TOWN = [objlib.FIXTURES / "town" / "town.obj", "--tile-faces", "1000", "--tile-side", "512", "--origin", "5.66,51.97,10"]


@pytest.mark.parametrize("pyramid", [TOWN, [BLOCK]], indirect=True, ids=["town", "block"])
@pytest.mark.parametrize("page", ["three.html", "cesium.html"])
def test_a_viewer_selects_finer_tiles_the_nearer_it_is(pyramid, page, tmp_path):
    folder, report = pyramid
    found = {}
    for name, distance in DISTANCES.items():
        picture = tmp_path / f"{name}.png"
        found[name] = shown(folder, page, distance, picture)
        assert found[name]["errors"] == []
        pixels = np.asarray(Image.open(picture).convert("RGB")).reshape(-1, 3)
        surface = pixels[np.abs(pixels.astype(int) - BACKGROUND).sum(1) > 30]
        least = {"far": 20, "middle": 10_000, "near": 150_000}[name]
        assert len(surface) > least and surface.std() > 10, (name, len(surface))
    root = report["levels"][-1]
    assert (found["far"]["tiles"], found["far"]["triangles"]) == (1, root["faces"])
    assert found["middle"]["tiles"] > 1 and found["near"]["tiles"] > 1
    # Near, tiles beyond the picture are left out.
    assert found["near"]["triangles"] > found["middle"]["triangles"] / 4


# The other ways to store tiles: options, by how much a pixel may differ, and the share of those that may differ by more.
# Of two triangles at one depth, the first one is seen.
STORED = {"meshopt": (["--compress", "meshopt"], 8, 1e-3), "webp": (["--image", "webp:90"], 24, 0.02)}
STORED["ktx2"] = (["--image", "ktx2:90"], 48, 0.02)


@pytest.mark.parametrize("page", ["three.html", "cesium.html"])
@pytest.mark.parametrize("stored", STORED)
def test_a_viewer_shows_the_same_however_tiles_are_stored(drystone, page, stored, tmp_path):
    options, most, share = STORED[stored]
    pictures, found = [], []
    for name, more in [("plain", ["--compress", "none"]), ("other", options)]:
        made = drystone("tile", *TOWN, "-o", tmp_path / name, *more, "--quiet", codes=(0, 2))
        if made.code == 2:
            assert "is built without" in made.stderr and "--features" in made.stderr
            pytest.skip(made.stderr.splitlines()[0])
        picture = tmp_path / f"{name}.png"
        found.append(shown(tmp_path / name, page, 1.2, picture))
        pictures.append(np.asarray(Image.open(picture).convert("RGB")).astype(int))
    assert found[0] == found[1] and found[0]["errors"] == []
    assert (np.abs(pictures[0] - pictures[1]).max(2) > most).mean() < share
