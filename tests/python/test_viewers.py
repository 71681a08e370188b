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


def shown(folder, page, pictures, *distances):
    """What a viewer selects from each distance, and its pixels."""
    if shutil.which("node") is None or not (MODULES / "cesium").is_dir() or not Path(CHROMIUM).exists():
        pytest.skip("node, the viewers' packages or Chromium are absent (tools/test installs the packages where npm is)")
    command = ["node", VIEWERS / "view.mjs", folder, MODULES, page, pictures, *map(str, distances)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=180)
    assert done.returncode == 0, done.stderr
    pixels = [np.asarray(Image.open(pictures / f"{distance}.png").convert("RGB")).astype(int) for distance in distances]
    return list(zip(map(json.loads, done.stdout.splitlines()), pixels, strict=True))


TOWN = [objlib.FIXTURES / "town" / "town.obj", "--tile-faces", "1000", "--tile-side", "512", "--origin", "5.66,51.97,10"]
SMALL = ["--tile-faces", "500", "--tile-side", "256", "--origin", "5.66,51.97,10", "--quiet"]


@pytest.mark.parametrize("pyramid", [TOWN, [BLOCK]], indirect=True, ids=["town", "block"])
@pytest.mark.parametrize("page", ["three.html", "cesium.html"])
def test_a_viewer_selects_finer_tiles_the_nearer_it_is(pyramid, page, tmp_path):
    folder, report = pyramid
    found = {}
    for name, (selected, pixels) in zip(DISTANCES, shown(folder, page, tmp_path, *DISTANCES.values()), strict=True):
        found[name] = selected
        assert selected["errors"] == []
        surface = pixels[np.abs(pixels - BACKGROUND).sum(2) > 30]
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


@pytest.fixture(scope="module", params=["three.html", "cesium.html"])
def plain(drystone, small_town, tmp_path_factory, request):
    """A page, and what it shows of tiles that are stored plainly."""
    folder = tmp_path_factory.mktemp("plain")
    drystone("tile", small_town, "-o", folder / "tiles", *SMALL, "--compress", "none")
    return request.param, *shown(folder / "tiles", request.param, folder, 1.2)


@pytest.mark.parametrize("stored", STORED)
def test_a_viewer_shows_the_same_however_tiles_are_stored(drystone, plain, stored, small_town, tmp_path):
    options, most, share = STORED[stored]
    page, (plain_selection, plain_pixels) = plain
    made = drystone("tile", small_town, "-o", tmp_path / "tiles", *SMALL, *options, codes=(0, 2))
    if made.code == 2:
        assert "is built without" in made.stderr and "--features" in made.stderr
        pytest.skip(made.stderr.splitlines()[0])
    [(selection, pixels)] = shown(tmp_path / "tiles", page, tmp_path, 1.2)
    assert selection == plain_selection and selection["errors"] == [] and selection["tiles"] > 1
    assert (np.abs(pixels - plain_pixels).max(2) > most).mean() < share
