#!/usr/bin/env python3
"""pyramids.py NAME=IN.obj... [--level NAME/LEVEL=FILE.obj...]: pyramids of tiles, as a page of Markdown on stdout.

    python3 tools/benchmarks/pyramids.py town=fixtures/town/town.obj block=block.obj --level block/d10=d10.obj \\
        --drystone target/release/drystone > docs/results/pyramids.md

Makes a pyramid of each mesh with `drystone tile` and reads it back with `drystone check`. A level that another program
made of one of the meshes is held against `drystone simplify` at its number of triangles: `drystone compare` measures
both. What was measured is kept in target/benchmarks/pyramids under the hash of program, meshes and options: a run that
was stopped continues. The picture is that of pyramid_picture.py. Needs numpy and pillow.
"""
import argparse
import datetime
import hashlib
import json
import os
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

import measure
import pyramid_picture

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests" / "python"))
import objlib

FOLDER = ROOT / "target" / "benchmarks" / "pyramids"
MEMORY = "256MiB"
# A mesh with fewer triangles is tiled three times.
REPEATED_BELOW, REPEATS = 600_000, 3
# The small town gets small tiles, as in docs/guide/tiles.md; the others those of the defaults.
TILES = {"town": pyramid_picture.TILES}
# `--texels` with which the new images have about as many pixels as those of the level.
TEXELS = {"block/d10": "0.6", "block/d9": "0.16", "block/d7": "0.038", "block/d6": "0.0064"}
IMAGE = "jpeg:90"
MAKERS = {"block": "ContextCapture", "estate": "Obj2Tiles"}
# What the program assumes of a mesh without images.
TEXELS_OF_FACE = 8
HEAD = """# Pyramids of tiles

Made by `tools/benchmarks/pyramids.py` with {version}, {date},
{machine}.
Each mesh becomes [a pyramid](../explain/pyramid.md) with `drystone tile --memory {memory}` and the
defaults, the town with `{tiles}`; `drystone check` reads it back. The
inputs are described in [benchmarks](benchmarks.md#inputs).

## Cost and check

* *Megatexels* of the images of level 0, which keep the texels of the input;
* *Input*, *Pyramid*: megabytes on the disk; of the input, OBJ and images;
* *Processor time*: microseconds for each triangle of the input, user and system, of the whole run;
* *Wall time* in seconds; *Peak memory* in MiB;
* *Border edges*: of tiles, along neighbours of the same level; *Unequal*: those that the neighbour
  does not have with the same bits;
* *Faults*: whatever else `drystone check` finds.

Times are medians of {repeats} runs for meshes of fewer than {below:,} triangles, and of one run
otherwise. The machine did other work meanwhile (load {load}): alone it is faster. Times grow with
the texels as well as with the triangles.
"""
COST = ["Mesh", "Triangles", "Megatexels", "Levels", "Tiles", "Input", "Pyramid", "Processor time", "Wall time", "Peak memory", "Border edges", "Unequal", "Faults"]
REPEATED = """
The images of town-1m repeat: a wall shows the same bricks again and again. Tiles do not repeat
images, so each place has texels of its own, and the pyramid is larger than the input.
"""
LEVELS_HEAD = """
## Levels

A table for each mesh, as `drystone tile` reports it; coarsest level first:

* *Mesh*: triangles of the level before it is cut; *In tiles*: with cuts and skirts, without those
  whose vertices coincide on the lattice; *Most*: of one tile;
* *Megatexels* of all images; *Fill*: share of them that charts cover;
* *Colour*: root mean square difference, of 255, to the mean of the input over a texel of the level;
* *Texel*: its length; *Deviation*: 99 % of the level and of the input lie closer to each other;
  *Geometric error*: the largest of a tile. All in units of the input;
* *Megabytes* of the tiles.

Two neighbouring levels can have the same mesh: a coarser one lies further from the input than both
allow, so that only the texels grow. Level 0 has the texels of the input, and its *Colour* is mostly
what JPEG loses; it lacks the triangles of the input that repeat a vertex. A mesh without images has
dashes; its texel is the length at which a triangle of mean area would cover {texels} of them.
"""
LEVELS = ["Level", "Tiles", "Mesh", "In tiles", "Most", "Megatexels", "Fill", "Colour", "Texel", "Deviation", "Geometric error", "Megabytes"]
OTHERS_HEAD = """
## Beside levels of other programs

The block and the estate came with coarser levels: those of the block by ContextCapture, which
textures each level from the photographs; those of the estate by Obj2Tiles. Below each is `drystone
simplify --faces N --textures bake --image {image}`, where N is the level's number of triangles.
`--texels` is chosen so that the images have about as many pixels, and is 1 for the estate.

* *Distance*: root mean square, both ways together, in 1e-4 of the diagonal; in brackets from the
  level to the original / from the original to the level;
* *Colour*: root mean square difference, of 255, from the level / from the original, to the mean of
  the original over a texel (`compare --texel`); the texel is that of the new images, for both rows;
* *Pinholes*: pixels in a million, in drawings from 16 sides, that show the background through the
  level and not through the original;
* *Megapixels* of the images; *Megabytes*: OBJ and images.

Photographs can differ from the original's images in exposure and blending: a part of the colour
difference of ContextCapture's levels need not be an error.
"""
OTHERS = ["Level", "By", "Triangles", "Distance", "Colour", "Pinholes", "Megapixels", "Megabytes"]
PICTURE = """
## At the switching distance

A viewer replaces a level by the next finer one where its geometric error takes more than 16 pixels.
Each column shows the town at that distance, without light: the coarser level above, the finer one
below. Each pixel is shown as a square of 2 × 2. Made by `tools/benchmarks/pyramid_picture.py`.

![Levels 3, 2 and 1 of the town above levels 2, 1 and 0](pyramids-town.png)

* *Difference*: root mean square, of 255, over pixels where both levels show the town;
* *Outline*: share of the pixels of the town that only one of them covers.
"""


def digest(*parts):
    return hashlib.sha256(json.dumps(parts).encode()).hexdigest()


def kept(key, make):
    """What was measured before under a key, or is measured now."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    file = FOLDER / f"{key}.json"
    if not file.exists():
        half = file.with_suffix(".half")
        half.write_text(json.dumps(make()))
        half.replace(file)
    return json.loads(file.read_text())


def stored(path):
    """Bytes of a mesh with its images, and the pixels of these."""
    files = [path.parent / name for name in sorted(set(objlib.textures(path)))]
    pixels = 0
    for file in files:
        with Image.open(file) as image:
            pixels += image.width * image.height
    return {"pixels": pixels, "bytes": sum(file.stat().st_size for file in [path, *files])}


def printed_json(*command):
    """What a command prints; it may have found faults."""
    return json.loads(subprocess.run([str(word) for word in command], stdout=subprocess.PIPE).stdout)


def tiled(program, path, options):
    """One pyramid: what the run took, its report, and what `check` finds."""
    with tempfile.TemporaryDirectory(dir=FOLDER) as folder:
        load, out = os.getloadavg()[0], Path(folder) / "tiles"
        command = [program, "tile", path, "-o", out, "--quiet", "--json", "--memory", MEMORY, *options]
        run, report, errors = measure.spend(command)
        if run["exit"]:
            raise SystemExit(f"{path}: exit code {run['exit']}\n{errors}")
        run["load"] = load
        return {"run": run, "report": json.loads(report), "check": printed_json(program, "check", out, "--json")}


class Pyramid:
    """The pyramid of a mesh, measured."""

    def __init__(self, program, name, path):
        self.name, options = name, TILES.get(name, [])
        key = [measure.sha256(program), measure.sha256(path), MEMORY, *options]
        found = [kept(digest("tile", *key, 0), lambda: tiled(program, path, options))]
        self.report, self.check = found[0]["report"], found[0]["check"]
        self.triangles = self.report["triangles"]
        if self.triangles < REPEATED_BELOW:
            found += [kept(digest("tile", *key, turn), lambda: tiled(program, path, options)) for turn in range(1, REPEATS)]
        self.runs = [each["run"] for each in found]
        self.input = stored(path)
        self.levels = self.report["levels"][::-1]
        self.has_images = self.input["pixels"] > 0

    def median(self, figure):
        return statistics.median(run[figure] for run in self.runs)

    def cost(self):
        """Cells of its row in the table of costs."""
        borders, unequal = (sum(level[key] for level in self.check["levels"]) for key in ("border_edges", "unequal_edges"))
        return [
            self.name,
            f"{self.triangles:,}",
            f"{self.levels[-1]['texels'] / 1e6:.1f}" if self.has_images else "–",
            len(self.levels),
            sum(level["tiles"] for level in self.levels),
            f"{self.input['bytes'] / 1e6:.1f}",
            f"{self.check['bytes'] / 1e6:.1f}",
            f"{1e6 * self.median('cpu_seconds') / self.triangles:.0f}",
            f"{self.median('wall_seconds'):.0f}",
            f"{self.median('max_resident') / 2**20:.0f}",
            f"{borders:,}",
            unequal,
            self.check["fault_count"],
        ]

    def rows(self):
        """Cells of the rows of its table of levels."""
        for level in self.levels:
            of_images = [f"{level['texels'] / 1e6:.2f}", f"{100 * level['fill']:.0f} %", f"{level['colour_rms']:.2f}"] if self.has_images else ["–"] * 3
            deviation = max(level["to_input_p99"], level["from_input_p99"])
            counts = [f"{level[key]:,}" for key in ("level", "tiles", "mesh_faces", "faces", "faces_max")]
            lengths = [f"{length:.4g}" for length in (level["texel"], deviation, level["geometric_error"])]
            yield [*counts, *of_images, *lengths, f"{level['bytes'] / 1e6:.2f}"]

    def note(self):
        """On tiles that have longer texels than their level."""
        reduced = sum(level["reduced"] for level in self.levels)
        plural = "tile has" if reduced == 1 else "tiles have"
        return f"\n{reduced} {plural} longer texels, to fit an image." if reduced else ""


def compared(program, original, result, texel):
    """Figures of `drystone compare`, with the colours of the original filtered to a texel."""
    return printed_json(program, "compare", original, result, "--quiet", "--json", "--memory", MEMORY, "--texel", texel)


def beside(program, original, level, texels):
    """A level that another program made, and what the program makes at its number of triangles."""
    with tempfile.TemporaryDirectory(dir=FOLDER) as folder:
        result = Path(folder) / "out.obj"
        faces = len(objlib.read(level).face)
        options = ["--faces", faces, "--textures", "bake", "--texels", texels, "--image", IMAGE, "--memory", MEMORY]
        run = measure.simplify(program, original, result, [str(option) for option in options])
        if run["exit"]:
            raise SystemExit(f"{original}: exit code {run['exit']}\n{run.get('stderr', '')}")
        texel = json.loads(result.with_suffix(".json").read_text())["bake"]["texel"]
        made = {"other": (level, faces), "own": (result, run["faces"]["output"])}
        return {
            by: {"faces": faces, "compared": compared(program, original, path, texel), "stored": stored(path)}
            for by, (path, faces) in made.items()
        }


def level_rows(name, found):
    """Cells of two rows: the level, and the program's."""
    maker = MAKERS.get(name.partition("/")[0], "other")
    for by, row in ((maker, found["other"]), ("drystone", found["own"])):
        geometry, texture = row["compared"]["geometry"], row["compared"]["texture"]
        both, forward, backward = (1e4 * geometry[way]["rms"] / geometry["diagonal"] for way in ("symmetric", "forward", "backward"))
        yield [
            name if by == maker else "",
            by,
            f"{row['faces']:,}",
            f"{both:.3f} ({forward:.2f} / {backward:.2f})",
            f"{texture['colour_rms']:.1f} / {texture['colour_backward_rms']:.1f}",
            f"{row['compared']['pinholes']['ppm']:.1f}",
            f"{row['stored']['pixels'] / 1e6:.2f}",
            f"{row['stored']['bytes'] / 1e6:.1f}",
        ]


def table(columns, rows):
    print(f"| {' | '.join(columns)} |\n|{' --- |' * len(columns)}")
    for row in rows:
        print(f"| {' | '.join(str(cell) for cell in row)} |")


def print_pyramids(options, version, pyramids):
    """The tables of costs and of levels."""
    loads = [run["load"] for pyramid in pyramids for run in pyramid.runs]
    load = f"{min(loads):.0f} to {max(loads):.0f}"
    print(HEAD.format(version=version, date=datetime.date.today(), machine=measure.machine(), memory=MEMORY, tiles=" ".join(pyramid_picture.TILES), repeats=REPEATS, below=REPEATED_BELOW, load=load))
    table(COST, [pyramid.cost() for pyramid in pyramids])
    if any(pyramid.name == "town-1m" for pyramid in pyramids):
        print(REPEATED, end="")
    print(LEVELS_HEAD.format(texels=TEXELS_OF_FACE), end="")
    for pyramid in pyramids:
        print(f"\n### {pyramid.name}\n")
        table(LEVELS, pyramid.rows())
        if pyramid.note():
            print(pyramid.note())


def print_levels(program, meshes, levels):
    """The table of levels of other programs."""
    rows = []
    for name, level in levels.items():
        original, texels = meshes[name.partition("/")[0]], TEXELS.get(name, "1")
        key = digest("level", measure.sha256(program), measure.sha256(original), measure.sha256(level), texels, IMAGE, MEMORY)
        rows += level_rows(name, kept(key, lambda: beside(program, original, level, texels)))
    print(OTHERS_HEAD.format(image=IMAGE))
    table(OTHERS, rows)


def named(words):
    """{name: path} of words such as NAME=FILE."""
    return {name: Path(path) for name, path in (word.split("=", 1) for word in words)}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("meshes", nargs="+", metavar="NAME=IN.obj")
    parser.add_argument("--level", action="append", default=[], metavar="NAME/LEVEL=FILE.obj", help="a level of the mesh NAME, made by another program")
    parser.add_argument("--drystone", default="target/release/drystone")
    parser.add_argument("--pictures", type=Path, default=ROOT / "docs" / "results", help="folder for them (docs/results)")
    options = parser.parse_args()
    meshes, levels = named(options.meshes), named(options.level)
    if orphans := [name for name in levels if name.partition("/")[0] not in meshes]:
        parser.error(f"the mesh is missing of {', '.join(orphans)}")
    version = subprocess.run([options.drystone, "--version"], capture_output=True, text=True, check=True).stdout
    version = version.partition(" (")[0].strip()  # a release is named by its version, not by a commit
    print_pyramids(options, version, [Pyramid(options.drystone, name, path) for name, path in meshes.items()])
    if levels:
        print_levels(options.drystone, meshes, levels)
    print(PICTURE, *pyramid_picture.make(options.drystone, options.pictures), sep="\n")


if __name__ == "__main__":
    main()
