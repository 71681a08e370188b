#!/usr/bin/env python3
"""promises.py NAME=IN.obj...: whether bounds are kept and targets are met, as a page of Markdown on stdout.

    tools/benchmarks/promises.py town=fixtures/town/town.obj --drystone target/release/drystone > docs/results/promises.md

For each mesh and each bound (a share of the diagonal of its box) it runs `simplify --max-error`, measures the largest
distance both ways with `compare`, and looks for the fewest faces that a `--ratio` run needs to stay within the same
distance. For each mesh and each ratio it compares the faces that were asked for with those that came out. The exit code
is 1 if a bound is broken, or a target neither met nor reported as missed. Standard library only.
"""
import argparse
import datetime
import json
import subprocess
import sys
import tempfile
from pathlib import Path

BOUNDS = [1e-5, 1e-4, 1e-3, 1e-2]
RATIOS = [0.5, 0.1, 0.02, 0.005, 1e-3, 1e-4, 1e-5]
MISSED = 3
# The search for a number of faces ends when two neighbours differ by less than this factor.
STEP = 1.05
STEP_FIRST = 1.4
# One collapse, or what a target may be missed by in parts of itself.
TOLERANCE = (2, 0.001)


class Mesh:
    """An input, and the runs on it."""

    def __init__(self, program, path, folder, samples):
        self.program, self.path, self.output, self.samples = program, path, Path(folder) / "out.obj", samples
        found = json.loads(subprocess.run([program, "inspect", path, "--json"], capture_output=True, check=True).stdout)
        self.faces = found["triangles"]
        self.diagonal = sum(length**2 for length in found["size"]) ** 0.5

    def simplify(self, *options):
        """Faces of the result and the exit code."""
        command = [self.program, "simplify", self.path, "-o", self.output, "--textures", "reference"]
        command += ["--force", "--resume", "never", "--quiet", *options]
        code = subprocess.run(command, capture_output=True).returncode
        if code not in (0, MISSED):
            return None, code
        with open(self.output, "rb") as lines:
            return sum(line.startswith(b"f ") for line in lines), code

    def largest(self):
        """Largest distance from the result to the input, and the other way."""
        command = [self.program, "compare", self.path, self.output, "--quiet", "--json", "--samples", str(self.samples)]
        found = subprocess.run(command, capture_output=True, check=True).stdout
        geometry = json.loads(found)["geometry"]
        return [geometry[way]["max"] for way in ("forward", "backward")]

    def fewest(self, distance, faces):
        """Fewest faces, near a number, at which a run to a number of faces keeps within a distance."""
        best, step, count, last = None, STEP_FIRST, float(faces), None
        while step >= STEP and count >= 1:
            if round(count) >= self.faces:
                kept = True
                got = self.faces
            else:
                got, _ = self.simplify("--faces", str(max(round(count), 1)))
                kept = got is not None and max(self.largest()) <= distance
            if kept:
                best = min(best or got, got)
            if last is not None and kept != last:
                step = step**0.5
            count, last = count / step if kept else count * step, kept
        return best


def bounds(mesh, name):
    """Rows of the first table, and whether every bound was kept."""
    rows, is_kept = [], True
    for share in BOUNDS:
        bound = share * mesh.diagonal
        faces, code = mesh.simplify("--max-error", repr(bound))
        if faces is None:
            rows.append(f"| {name} | {share:g} | | | exit {code} | | |")
            continue
        largest = mesh.largest()
        is_kept &= max(largest) <= bound
        fewest = mesh.fewest(max(largest), faces)
        ways = " | ".join(f"{distance / bound:.2f}" for distance in largest)
        rows.append(f"| {name} | {share:g} | {ways} | {faces} | {fewest} | {faces / fewest:.2f} |")
        print(rows[-1], file=sys.stderr)
    return rows, is_kept


def targets(mesh, name):
    """A row of the second table, and whether every target was met or reported as missed."""
    cells, is_met = [], True
    for ratio in RATIOS:
        wanted = max(round(mesh.faces * ratio), 1)
        faces, code = mesh.simplify("--ratio", repr(ratio))
        if faces is None:
            cells.append(f"exit {code}")
            continue
        allowed = max(TOLERANCE[0], TOLERANCE[1] * wanted)
        is_met &= faces >= wanted - allowed and (faces <= wanted + allowed or code == MISSED)
        cells.append(f"{faces} of {wanted}" if code == 0 else f"**{faces}** of {wanted}")
    print(name, *cells, file=sys.stderr)
    return f"| {name} | {' | '.join(cells)} |", is_met


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("meshes", nargs="+", metavar="NAME=IN.obj")
    parser.add_argument("--drystone", default="target/release/drystone", help="the program")
    parser.add_argument("--samples", type=int, default=50_000, help="points of a comparison (50,000)")
    arguments = parser.parse_args()
    program = Path(arguments.drystone).resolve()
    first, second, is_good = [], [], True
    for name, path in (mesh.split("=", 1) for mesh in arguments.meshes):
        with tempfile.TemporaryDirectory() as folder:
            mesh = Mesh(program, path, folder, arguments.samples)
            label = f"{name}, {mesh.faces} faces"
            row, is_met = targets(mesh, label)
            rows, is_kept = bounds(mesh, label)
        second.append(row)
        first += rows
        is_good &= is_met and is_kept
    version = subprocess.run([program, "--version"], capture_output=True, text=True, check=True).stdout.strip()
    version = version.split(" (")[0]  # a release is named by its version, not by a commit
    print(PAGE.format(version=version, date=datetime.date.today(), bounds="\n".join(first), targets="\n".join(second), samples=arguments.samples,
                      ratios=" | ".join(f"{ratio:g}" for ratio in RATIOS), lines=" --- |" * (len(RATIOS) + 1)))
    sys.exit(0 if is_good else 1)


PAGE = """# Bounds kept, targets met

Made by `tools/benchmarks/promises.py` with {version}, {date}; defaults
otherwise. The inputs are described in [benchmarks](benchmarks.md#inputs).

## `--max-error`

*Bound* is a share of the diagonal of the mesh's bounding box. *Result to input* and *input to
result* are the largest distances, as shares of the bound, measured by `drystone compare --samples
{samples}`; a bound is kept where both are at most 1. *Faces without a bound* is what a `--faces` run
needs to stay within the larger of the two distances. Such a run minimises the sum of squares and
proves nothing.

| Mesh | Bound | Result to input | Input to result | Faces | Faces without a bound | Quotient |
| --- | --- | --- | --- | --- | --- | --- |
{bounds}

## `--ratio`

Faces of the result, of those asked for. **Bold**: the target was missed; the run ends with exit code
3 and says why.

| Mesh | {ratios} |
|{lines}
{targets}"""

if __name__ == "__main__":
    main()
