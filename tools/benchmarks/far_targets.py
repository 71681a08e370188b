#!/usr/bin/env python3
"""far_targets.py NAME=IN.obj...: drystone and its peers at far targets, as a page of Markdown on stdout.

    python3 tools/benchmarks/far_targets.py block=block.obj --drystone target/release/drystone > docs/results/far-targets.md

Every tool gets the same mesh: positions alone, since most peers keep nothing else. The error is the root mean square of
the distances both ways, in 1e-4 of the diagonal of the mesh's box, and after it the pixels per million that one sees
through, both measured by `drystone compare`. A tool that stops more than 0.1 % above its target has its number of
triangles in brackets. The peers are installed beside tools/peers, in an environment of their own.
"""
import argparse
import datetime
import json
import subprocess
import sys
import tempfile
from decimal import Decimal
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "peers"))
from peers import install_packages

RATIOS = [0.1, 0.05, 0.02, 0.005, 0.001]
PEERS = ["vtk", "pymeshlab", "meshoptimizer", "meshoptimizer-permissive", "meshoptimizer-sloppy"]
HEAD = """# Far targets

Made by `tools/benchmarks/far_targets.py` with {version}, {date}.
Every tool gets the same mesh: positions alone, since most peers keep nothing else. A cell holds:

* the root mean square distance, both ways, in 1e-4 of the diagonal;
* after the point, pixels per million that show the background through the result
  ([`pinholes.ppm`](../reference/comparison.md#pinholes));
* in brackets, the number of triangles, where a tool stopped above its target.

The inputs are described in [benchmarks](benchmarks.md#inputs). `meshoptimizer-permissive` is its
`SimplifyPermissive` option, `meshoptimizer-sloppy` its `simplifySloppy`.
"""
PICTURES = """
## Pictures

`fixtures/town` with its texture: all of its 18,218 triangles, 363 (2 %) and 90 (0.5 %). Drawn by `tools/render.py`.

![The town, 2 % and 0.5 % of it](far-town.png)

Top row: a part of Wageningen, then 2 % of it by drystone and by VTK. Bottom row: the same with
0.5 %. A building has a few triangles left, or one. drystone keeps a triangle where a building was;
VTK lets most buildings vanish. Made by `tools/benchmarks/far_picture.py` from 3D BAG, © 3DBAG by
tudelft3d and 3DGI, CC BY 4.0.

![A part of Wageningen, 2 % and 0.5 % of it](far-3dbag.png)"""
SIMPLIFY = Path(__file__).parent.parent / "peers" / "simplify.py"


def bare(path, out):
    """Copies positions, relative to the first, and the position indices of faces; returns how many triangles they are.

    Most peers compute in single precision, which is too coarse for coordinates on a map.
    """
    triangles, first = 0, None
    with open(path, errors="replace") as lines, open(out, "w") as copy:
        for line in lines:
            words = line.split()
            if words[:1] == ["v"]:
                place = [Decimal(word) for word in words[1:4]]
                first = first or place
                print("v", *(x - x0 for x, x0 in zip(place, first)), file=copy)
            elif words[:1] == ["f"]:
                print("f", *(word.split("/")[0] for word in words[1:]), file=copy)
                triangles += len(words) - 3
    return triangles


class Bench:
    """One mesh in a folder of its own."""

    def __init__(self, program, python, path, folder, samples):
        self.program, self.python, self.samples = program, python, str(samples)
        self.input, self.output = Path(folder) / "input.obj", Path(folder) / "output.obj"
        self.faces = bare(path, self.input)

    def run(self, tool, ratio):
        """Simplifies; returns the triangles that are left, or none if the tool fails."""
        self.output.unlink(missing_ok=True)
        if tool == "drystone":
            command = [self.program, "simplify", self.input, "-o", self.output, "--ratio", str(ratio), "--force", "--quiet"]
        else:
            command = [self.python, SIMPLIFY, tool, self.input, self.output, "--ratio", str(ratio)]
        run = subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, errors="replace")
        if not self.output.exists():
            print(f"{tool} to {ratio}: no result\n{run.stderr[-500:]}", file=sys.stderr)
        return self.output.exists()

    def error(self):
        """Error of the result, pixels per million that one sees through, and its triangles."""
        command = [self.program, "compare", self.input, self.output, "--quiet", "--json", "--samples", self.samples]
        found = json.loads(subprocess.run(command, capture_output=True, check=True).stdout)
        geometry = found["geometry"]
        mean_sq = sum(geometry[way]["rms"] ** 2 for way in ("forward", "backward")) / 2
        error = 1e4 * mean_sq**0.5 / geometry["diagonal"]
        return error, found["pinholes"]["ppm"], found["topology"]["after"]["faces"]

    def cell(self, tool, ratio):
        if not self.run(tool, ratio):
            return "–"
        error, pinholes, left = self.error()
        target = max(1, round(ratio * self.faces))
        missed = left > target + max(2, 0.001 * target)
        return f"{error:.3g} · {pinholes:.0f}" + (f" ({left})" if missed else "")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("meshes", nargs="+", metavar="NAME=IN.obj")
    parser.add_argument("--drystone", default="target/release/drystone")
    parser.add_argument("--samples", type=int, default=200_000)
    options = parser.parse_args()
    version = subprocess.run([options.drystone, "--version"], capture_output=True, text=True, check=True).stdout.strip()
    version = version.split(" (")[0]  # a release is named by its version, not by a commit
    python = install_packages()
    print(HEAD.format(version=version, date=datetime.date.today()))
    print("| Mesh | Kept |", " | ".join(["drystone", *PEERS]), "|\n|" + " --- |" * (len(PEERS) + 3))
    for name, path in (mesh.split("=", 1) for mesh in options.meshes):
        with tempfile.TemporaryDirectory() as folder:
            bench = Bench(options.drystone, python, path, folder, options.samples)
            for ratio in RATIOS:
                cells = [bench.cell(tool, ratio) for tool in ["drystone", *PEERS]]
                target = max(1, round(ratio * bench.faces))
                print(f"| {name} | {100 * ratio:g} % ({target}) |", " | ".join(cells), "|", flush=True)
    print(PICTURES)


if __name__ == "__main__":
    main()
