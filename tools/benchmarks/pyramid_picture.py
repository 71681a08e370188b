#!/usr/bin/env python3
"""pyramid_picture.py FOLDER: neighbouring levels of a town's pyramid where a viewer changes them; a table on stdout.

    python3 tools/benchmarks/pyramid_picture.py docs/results --drystone target/release/drystone

pyramids-town.png: a column for each level but the finest, at the distance at which its geometric error takes 16 pixels:
the level above, the next finer one below. Nothing is lit, so that all contrast is that of the images. The table holds the
differences of these drawings. Needs numpy and pillow.
"""
import io
import json
import struct
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image

import measure

TOOLS = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(TOOLS))
sys.path.insert(0, str(TOOLS.parent / "tests" / "python"))
import objlib
import render

TOWN = TOOLS.parent / "fixtures" / "town" / "town.obj"
TILES = ["--tile-faces", "2000", "--tile-side", "512"]
# What viewers allow a geometric error to take, unless they are told otherwise.
ERROR_PIXELS = 16
# Pixels of a view; in the picture each is a square of ENLARGED × ENLARGED.
PIXELS, ENLARGED = (280, 210), 2
TURN, TILT = 30, 42
PALETTE = 192
TABLE = """| Levels | Pixel, m | Difference | Outline |
| --- | --- | --- | --- |"""
HEADER_BYTES, CHUNK_HEADER_BYTES = 12, 8
DTYPES = {5122: np.int16, 5123: np.uint16, 5125: np.uint32}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3}


class Glb:
    """A tile: its JSON and the bytes behind it."""

    def __init__(self, path):
        data = path.read_bytes()
        size = struct.unpack_from("<I", data, HEADER_BYTES)[0]
        self.json = json.loads(data[HEADER_BYTES + CHUNK_HEADER_BYTES :][:size])
        self.binary = data[HEADER_BYTES + size + 2 * CHUNK_HEADER_BYTES :]

    def view(self, index):
        view = self.json["bufferViews"][index]
        return self.binary[view.get("byteOffset", 0) :][: view["byteLength"]], view.get("byteStride")

    def array(self, index):
        """Values of an accessor, a row each."""
        accessor = self.json["accessors"][index]
        data, stride = self.view(accessor["bufferView"])
        dtype, width = np.dtype(DTYPES[accessor["componentType"]]), WIDTHS[accessor["type"]]
        shape, strides = (accessor["count"], width), (stride or dtype.itemsize * width, dtype.itemsize)
        return np.ndarray(shape, dtype, data, accessor.get("byteOffset", 0), strides)

    def image(self):
        data, _ = self.view(self.json["images"][0]["bufferView"])
        return np.asarray(Image.open(io.BytesIO(data)).convert("RGB"), float)

    def position(self, index):
        """In the axes of the input: a tile's y axis points up."""
        node = self.json["nodes"][0]
        x, y, z = node["translation"]
        return self.array(index) * node["scale"] + (x, -z, y)


def read_level(folder, level):
    """The tiles of a level as one mesh with a material for each, and their images."""
    positions, texcoords, faces, materials, images, count = [], [], [], [], {}, 0
    for path in sorted(folder.glob(f"{level}/*.glb")):
        tile = Glb(path)
        part = tile.json["meshes"][0]["primitives"][0]
        positions.append(tile.position(part["attributes"]["POSITION"]))
        u, v = tile.array(part["attributes"]["TEXCOORD_0"]).T / np.iinfo(np.uint16).max
        texcoords.append(np.stack([u, 1 - v], axis=1))
        faces.append(tile.array(part["indices"]).reshape(-1, 3).astype(int) + count)
        materials += [path.stem] * len(faces[-1])
        images[path.stem] = tile.image()
        count += len(positions[-1])
    face = np.concatenate(faces)
    mesh = objlib.Mesh(np.concatenate(positions), None, np.concatenate(texcoords), np.zeros((0, 3)), face, face, np.full_like(face, -1), np.array(materials, dtype=object))
    return mesh, images


def draw(mesh, images, middle, pixel):
    """Colours of a view, and how much of each pixel the mesh covers."""
    times = render.SUPERSAMPLE
    width, height = (times * side for side in PIXELS)
    view = render.View(mesh, width, height, TURN, TILT, (*middle, render.FILLED * pixel * min(PIXELS) / 2))
    face, weight = render.visible(mesh, view, width, height)
    covered = face >= 0
    page = np.full((height, width, 3), render.BACKGROUND, float)
    page[covered] = render.colours(mesh, images, face[covered], weight[covered])
    return reduced(page, times), reduced(covered[..., None].astype(float), times)[..., 0]


def reduced(page, times):
    """Means of squares of pixels."""
    height, width, channels = page.shape
    return page.reshape(height // times, times, width // times, times, channels).mean(axis=(1, 3))


def draw_changes(folder, errors):
    """For each level but the finest, coarsest first: the level, the length of a pixel, and drawings of it and of the next."""
    finest, _ = read_level(folder, 0)
    middle = (finest.position.min(axis=0) + finest.position.max(axis=0)) / 2
    for level in range(len(errors) - 1, 0, -1):
        pixel = errors[level] / ERROR_PIXELS
        yield level, pixel, [draw(*read_level(folder, each), middle, pixel) for each in (level, level - 1)]


def save(changes, picture):
    """Coarser levels above, finer ones below."""
    page = np.block([[[drawn[k][0]] for _, _, drawn in changes] for k in (0, 1)])
    page = page.clip(0, 255).astype(np.uint8).repeat(ENLARGED, axis=0).repeat(ENLARGED, axis=1)
    render.few_colours(Image.fromarray(page), PALETTE).save(picture, optimize=True)


def row(level, pixel, drawn):
    """Of the table: how far two drawings are from each other."""
    (coarse, coarse_share), (fine, fine_share) = drawn
    both, either = (coarse_share == 1) & (fine_share == 1), np.maximum(coarse_share, fine_share)
    difference = np.sqrt(((coarse - fine)[both] ** 2).mean())
    outline = np.abs(coarse_share - fine_share).sum() / either.sum()
    return f"| {level} and {level - 1} | {pixel:.3f} | {difference:.1f} | {100 * outline:.1f} % |"


def make(program, out):
    """Writes the picture into a folder; lines of the table."""
    with tempfile.TemporaryDirectory() as folder:
        tiles = Path(folder) / "tiles"
        command = [program, "tile", TOWN, "-o", tiles, "--quiet", "--json", *TILES]
        report = json.loads(subprocess.run(command, stdout=subprocess.PIPE, check=True).stdout)
        changes = list(draw_changes(tiles, [level["geometric_error"] for level in report["levels"]]))
    save(changes, out / "pyramids-town.png")
    return [TABLE, *(row(*change) for change in changes)]


if __name__ == "__main__":
    measure.draw_from_arguments(__doc__, make)
