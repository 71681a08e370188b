#!/usr/bin/env python3
"""far_picture.py IN.obj OUT.png: what is left of a town at far targets, by drystone and by VTK.

    python3 tools/benchmarks/far_picture.py town.obj docs/results/far-3dbag.png --drystone target/release/drystone

First row: the input, and 2 % by drystone and by VTK; second row: the input again, and 0.5 %. The whole mesh is
simplified; drawn is the square of `--side` units that has the most triangles. Positions alone. Runs with the Python that has
the packages of tools/peers/requirements.txt.
"""
import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

TOOLS = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(TOOLS / "benchmarks"))
sys.path.insert(0, str(TOOLS.parent / "tests" / "python"))
import far_targets
import objlib

RATIOS = [0.02, 0.005]
PEER = "vtk"


def middles(mesh):
    """Middle of each face, seen from above."""
    return mesh.position[mesh.face][:, :, :2].mean(axis=1)


def densest(mesh, side):
    """Low corner of the square with the most faces."""
    low = mesh.position[:, :2].min(axis=0)
    cells, counts = np.unique(((middles(mesh) - low) // side).astype(int), axis=0, return_counts=True)
    return low + side * cells[counts.argmax()]


def cut(mesh, low, side, out):
    """Writes the faces whose middles lie in the square."""
    inside = ((middles(mesh) >= low) & (middles(mesh) < low + side)).all(axis=1)
    used, faces = np.unique(mesh.face[inside], return_inverse=True)
    with open(out, "w") as file:
        for x, y, z in mesh.position[used]:
            print("v", x, y, z, file=file)
        for a, b, c in faces.reshape(-1, 3) + 1:
            print("f", a, b, c, file=file)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("mesh", metavar="IN.obj")
    parser.add_argument("picture", metavar="OUT.png")
    parser.add_argument("--drystone", default="target/release/drystone")
    parser.add_argument("--side", type=float, default=400.0, help="of the square, in units of length (default: 400)")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        bench = far_targets.Bench(options.drystone, options.mesh, folder, 0)
        whole = objlib.read(bench.input)
        low = densest(whole, options.side)
        original = Path(folder) / "original.obj"
        cut(whole, low, options.side, original)
        views = []
        for ratio in RATIOS:
            views.append(original)
            for tool in ["drystone", PEER]:
                if not bench.run(tool, ratio):
                    sys.exit(f"{tool} at {ratio}: no result")
                views.append(Path(folder) / f"{tool}-{ratio}.obj")
                cut(objlib.read(bench.output), low, options.side, views[-1])
        style = ["--size", "520x400", "--columns", "3", "--palette", "64"]
        subprocess.run([sys.executable, TOOLS / "render.py", *views, options.picture, *style], check=True)


if __name__ == "__main__":
    main()
