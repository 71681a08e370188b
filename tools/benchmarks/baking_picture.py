#!/usr/bin/env python3
"""baking_picture.py FOLDER: pictures of a town with its textures kept and baked, and how far they differ, as a table on stdout.

    python3 tools/benchmarks/baking_picture.py docs/results --drystone target/release/drystone

baking-town.png: the town, and 2 % of it with textures kept and baked; below, the town again, and 0.5 %.
baking-sizes.png: the town, and below it 2 % of it, baked, with images of 1/2, 1/4 and 1/8 of their width, as a viewer shows
them from afar. A pixel is as wide as a texel of the smaller images; nothing is lit, so that all contrast is that of the
images. The table holds the differences of these drawings. Needs numpy and pillow.
"""
import json
import subprocess
import sys
import tempfile
from dataclasses import dataclass
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
RATIOS = [0.02, 0.005]
SIZES = [1, 2, 4, 8]
SIZES_SHOWN = [2, 4, 8]
# Pixels of a view; in the picture each is a square of ENLARGED × ENLARGED.
PIXELS, ENLARGED = (280, 210), 2
TURN, TILT = 30, 42
PALETTE = 192
TABLE = """| Images | 100 %, all pixels | 100 %, at seams | 2 %, all pixels | 2 %, at seams |
| --- | --- | --- | --- | --- |"""


class Runs:
    """Runs of the program on the town, in a folder."""

    def __init__(self, program, folder):
        self.program, self.folder = program, Path(folder)

    def simplify(self, ratio, textures):
        """Path of the result."""
        result = self.folder / f"{textures}-{ratio}.obj"
        run = measure.simplify(self.program, TOWN, result, ["--ratio", ratio, "--textures", textures])
        if not result.exists():
            raise SystemExit(f"{TOWN}: exit code {run['exit']}\n{run.get('stderr', '')}")
        return result


@dataclass
class Drawing:
    """Colours of all pixels, where a face is, and where a visible face has a seam within a pixel."""

    page: np.ndarray
    covered: np.ndarray
    at_seam: np.ndarray


class Scene:
    """A textured mesh as viewers show it: without light, with images of any size."""

    def __init__(self, path):
        self.mesh, self.pictures = objlib.read(path), render.load_textures(path)
        self.is_seam = seams(self.mesh)

    def draw(self, view, times):
        """With images of 1 / times of their width and height."""
        pictures = {name: smaller(picture, times) for name, picture in self.pictures.items()}
        face, weight = render.visible(self.mesh, view, *PIXELS)
        covered = face >= 0
        points = face[covered], weight[covered]
        page, at_seam = np.full((*face.shape, 3), render.BACKGROUND, float), np.zeros(face.shape, bool)
        page[covered] = render.colours(self.mesh, pictures, *points)
        gap = render.edge_gaps(self.mesh, view, *points)
        at_seam[covered] = (self.is_seam[points[0]] & (gap < 1)).any(axis=1)
        return Drawing(page, covered, at_seam)


def smaller(picture, times):
    """Means of squares of pixels: a level of a viewer's mipmap."""
    rows, columns = (max(1, side // times) for side in picture.shape[:2])
    return np.asarray(Image.fromarray(picture.astype(np.uint8)).resize((columns, rows), Image.BOX), float)


def seams(mesh):
    """For each face, whether the edge opposite to each corner is a seam: one side has other texture coordinates there."""
    corner = np.stack([mesh.face, mesh.face_uv], -1)
    ends = np.stack([corner[:, [1, 2, 0]], corner[:, [2, 0, 1]]], axis=2).reshape(-1, 2, 2)
    ends = np.take_along_axis(ends, ends[:, :, :1].argsort(axis=1), axis=1)
    sides, side = np.unique(ends.reshape(-1, 4), axis=0, return_inverse=True)
    _, edge, side_count = np.unique(sides[:, [0, 2]], axis=0, return_inverse=True, return_counts=True)
    return (side_count[edge] > 1)[side].reshape(-1, 3)


def view_of(mesh, texel):
    """The middle of a mesh, with pixels as wide as a texel."""
    middle = (mesh.position.min(axis=0) + mesh.position.max(axis=0)) / 2
    return render.View(mesh, *PIXELS, TURN, TILT, (*middle, render.FILLED * texel * min(PIXELS) / 2))


def difference(one, other, where):
    """Root mean square difference of colours, of 255, where both drawings show a face."""
    both = one.covered & other.covered & where
    return float(np.sqrt(((one.page - other.page)[both] ** 2).mean()))


def draw_town(runs, picture):
    """Kept and baked, side by side."""
    views = [view for ratio in RATIOS for view in (TOWN, runs.simplify(ratio, "link"), runs.simplify(ratio, "bake"))]
    style = ["--size", "480x370", "--columns", "3", "--palette", str(PALETTE)]
    subprocess.run([sys.executable, TOOLS / "render.py", *views, picture, *style], check=True)


def draw_sizes(runs):
    """For each size of the images: the town, all of its triangles baked, and the first ratio of them."""
    baked = [runs.simplify(ratio, "bake") for ratio in (1, RATIOS[0])]
    texel = json.loads(baked[0].with_suffix(".json").read_text())["bake"]["texel"]
    scenes = [Scene(path) for path in (TOWN, *baked)]
    views = {times: view_of(scenes[0].mesh, times * texel) for times in SIZES}
    return {times: [scene.draw(view, times) for scene in scenes] for times, view in views.items()}


def save(drawn, picture):
    """The town above, the fewest triangles below, a column for each size."""
    page = np.block([[[drawn[times][k].page] for times in SIZES_SHOWN] for k in (0, -1)])
    page = page.clip(0, 255).astype(np.uint8).repeat(ENLARGED, axis=0).repeat(ENLARGED, axis=1)
    render.few_colours(Image.fromarray(page), PALETTE).save(picture, optimize=True)


def rows(drawn):
    """Of the table: how far drawings of baked results are from those of the town."""
    for times, (town, *baked) in drawn.items():
        found = [difference(town, each, where) for each in baked for where in (True, each.at_seam)]
        yield f"| {'full size' if times == 1 else f'1/{times}'} | {' | '.join(f'{value:.1f}' for value in found)} |"


def make(program, out):
    """Writes both pictures into a folder; lines of the table."""
    with tempfile.TemporaryDirectory() as folder:
        runs = Runs(program, folder)
        draw_town(runs, out / "baking-town.png")
        drawn = draw_sizes(runs)
    save(drawn, out / "baking-sizes.png")
    return [TABLE, *rows(drawn)]


if __name__ == "__main__":
    measure.draw_from_arguments(__doc__, make)
