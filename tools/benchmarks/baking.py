#!/usr/bin/env python3
"""baking.py NAME=IN.obj...: kept against baked textures, as a page of Markdown on stdout.

    python3 tools/benchmarks/baking.py block=block.obj --drystone target/release/drystone > docs/results/baking.md

For each mesh and ratio it simplifies with the textures kept, then with new ones, and measures each result with `drystone
compare`. What was measured is kept in target/benchmarks/baking under the hash of program, mesh and options: a run that
was stopped continues, and `--only-ratio` does a part, whose tables alone are printed. The page's pictures are those of
baking_picture.py. Needs numpy and pillow.
"""
import argparse
import datetime
import hashlib
import json
import subprocess
import tempfile
from pathlib import Path

from PIL import Image

import baking_picture
import measure

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "target" / "benchmarks" / "baking"
RATIOS = [0.1, 0.02, 0.005]
TEXELS = ["1", "0.25"]
IMAGES = ["png", "jpeg:90"]
MEMORY = "256MiB"
DONE, MISSED = 0, 3
# One collapse, or what a target may be missed by in parts of itself.
TOLERANCE = (2, 0.001)
HEAD = """# Textures, kept and baked

Made by `tools/benchmarks/baking.py` with {version}, {date}.
Each mesh is simplified with its textures kept, then with [new ones](../explain/baking.md);
`drystone compare` measures the results, all with `--memory {memory}`. The inputs are described in
[benchmarks](benchmarks.md#inputs). A row holds:

* *Textures*: kept, or `--texels` and `--image` of new ones;
* *Triangles* of the result; in brackets where the run stopped above its target;
* *Distance*: root mean square, both ways, in 1e-4 of the diagonal;
* *Colour*: root mean square difference, of 255: from the result to the original / from the original
  to the result;
* *Seams*: the same between the two sides of a seam of the result. The line above a table has it for
  the original: also there colours differ, where a wall meets a roof;
* *Outside*: share of the surface that shows what lies between the charts of the original; unknown
  where its images repeat. New images have charts of their own;
* *Images*: their number, megapixels, megabytes on the disk;
* *Charts*: their number, and the share of the new images that they cover;
* *Peak memory* in MiB.
"""
COLUMNS = ["Ratio", "Textures", "Triangles", "Distance", "Colour", "Seams", "Outside", "Images", "Charts", "Peak memory"]
PICTURES = """
## Pictures

Top row: the town of `fixtures/town`, 2 % of it with its textures kept, and with new ones. Bottom
row: the town again, and 0.5 % of it. Kept textures slide and stretch where a triangle covers more
than they show, and their seams hold the mesh. New textures show what is nearest on the original,
also the walls of a house that lost its height. Made by `tools/benchmarks/baking_picture.py`.

![The town, 2 % and 0.5 % of it, textures kept and baked](baking-town.png)

## Seams from afar

A viewer shows a mesh from afar with smaller copies of its images, in which texels of neighbouring
charts mix. Top row: the town with its images at 1/2, 1/4 and 1/8 of their width; bottom row: 2 % of
it, baked, with its images reduced alike. Each pixel is as wide as a texel of the smaller images and
is shown as a square of 2 × 2. There is no light, so that all contrast is that of the images.

![The town, and 2 % of it baked, with images of 1/2, 1/4 and 1/8 of their width](baking-sizes.png)

Root mean square difference of colours, of 255, between such drawings: over all pixels, and over
those within a pixel of a visible seam of the result. At 100 % of the triangles the images alone
differ; at 2 %, the shape as well.
"""


def variants():
    """Names and options of the runs at one ratio."""
    yield "kept", []
    for texels in TEXELS:
        for image in IMAGES:
            yield f"{texels}, {image}", ["--textures", "bake", "--texels", texels, "--image", image]


def images(result):
    """Number, pixels and bytes of the images beside a result."""
    files = [path for path in result.with_name(f"{result.stem}_textures").rglob("*") if path.is_file()]
    pixels = 0
    for path in files:
        with Image.open(path) as image:
            pixels += image.width * image.height
    return {"count": len(files), "pixels": pixels, "bytes": sum(path.stat().st_size for path in files)}


class Bench:
    """One mesh, and what was measured on it."""

    def __init__(self, program, path):
        self.program, self.path = program, path
        self.identity = [measure.sha256(program), measure.sha256(path)]
        FOLDER.mkdir(parents=True, exist_ok=True)

    def measured(self, options):
        """What was measured before, or is measured now."""
        name = hashlib.sha256(json.dumps([*self.identity, *options]).encode()).hexdigest()
        file = FOLDER / f"{name}.json"
        if not file.exists():
            half = file.with_suffix(".half")
            half.write_text(json.dumps(self.measure(options)))
            half.replace(file)
        return json.loads(file.read_text())

    def measure(self, options):
        """Simplifies and compares."""
        with tempfile.TemporaryDirectory(dir=FOLDER) as folder:
            result = Path(folder) / "out.obj"
            run = measure.simplify(self.program, self.path, result, options)
            if run["exit"] not in (DONE, MISSED):
                raise SystemExit(f"{self.path}: exit code {run['exit']}\n{run.get('stderr', '')}")
            command = [self.program, "compare", self.path, result, "--quiet", "--json", "--memory", MEMORY]
            compared = json.loads(subprocess.run(command, capture_output=True, check=True).stdout)
            bake = json.loads(result.with_suffix(".json").read_text())["bake"]
            return {"run": run, "compared": compared, "bake": bake, "images": images(result)}


def shown(value, form):
    return "–" if value is None else form.format(value)


def cells(found):
    """Of a row, behind its name."""
    run, bake, stored = found["run"], found["bake"], found["images"]
    geometry, texture, topology = (found["compared"][part] for part in ("geometry", "texture", "topology"))
    left, target = run["faces"]["output"], run["faces"]["target"]
    missed = left > target + max(TOLERANCE[0], TOLERANCE[1] * target)
    return [
        f"({left:,})" if missed else f"{left:,}",
        f"{1e4 * geometry['symmetric']['rms'] / geometry['diagonal']:.3g}",
        f"{texture['colour_rms']:.1f} / {texture['colour_backward_rms']:.1f}",
        shown(texture["seams"]["after"]["colour_rms"], "{:.1f}"),
        shown(texture["outside_fraction"], "{:.1%}").replace("%", " %"),
        f"{stored['count']} · {stored['pixels'] / 1e6:.1f} · {stored['bytes'] / 1e6:.1f}",
        f"{topology['after']['charts']:,}" + (f" · {100 * bake['fill']:.0f} %" if bake else ""),
        f"{run['max_resident'] / 2**20:.0f}",
    ]


def table(bench, name, ratios):
    """Lines of a mesh's part of the page."""
    named = [(ratio, *variant) for ratio in ratios for variant in variants()]
    found = [bench.measured(["--ratio", str(ratio), "--memory", MEMORY, *options]) for ratio, _, options in named]
    faces, compared = found[0]["run"]["faces"]["input"], found[0]["compared"]
    charts, contrast = compared["topology"]["before"]["charts"], compared["texture"]["seams"]["before"]["colour_rms"]
    yield f"\n## {name}\n"
    yield f"{faces:,} triangles, {charts:,} charts; colours differ by {contrast:.1f} across seams.\n"
    yield f"| {' | '.join(COLUMNS)} |\n|{' --- |' * len(COLUMNS)}"
    for (ratio, variant, _), each in zip(named, found):
        yield f"| {100 * ratio:g} % | {variant} | {' | '.join(cells(each))} |"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("meshes", nargs="+", metavar="NAME=IN.obj")
    parser.add_argument("--drystone", default="target/release/drystone")
    parser.add_argument("--only-ratio", type=float, nargs="+", choices=RATIOS, metavar="RATIO", help="tables of these alone, without a page")
    parser.add_argument("--pictures", type=Path, default=ROOT / "docs" / "results", help="folder for them (docs/results)")
    options = parser.parse_args()
    version = subprocess.run([options.drystone, "--version"], capture_output=True, text=True, check=True).stdout.strip()
    version = version.split(" (")[0]  # a release is named by its version, not by a commit
    if not options.only_ratio:
        print(HEAD.format(version=version, date=datetime.date.today(), memory=MEMORY), end="")
    for name, path in (mesh.split("=", 1) for mesh in options.meshes):
        for lines in table(Bench(options.drystone, Path(path)), name, options.only_ratio or RATIOS):
            print(lines, flush=True)
    if not options.only_ratio:
        print(PICTURES, *baking_picture.make(options.drystone, options.pictures), sep="\n")


if __name__ == "__main__":
    main()
