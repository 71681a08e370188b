"""How good a result is: by `drystone compare`, and by a referee if one is given.

Both in the same measures. Geometry: root mean square distance, both ways with equal weight, in 1e-4 of the diagonal of the
original. Colour: root mean square difference, of 255, between the picture at a point of the result and that at the closest
point of the original. Outside: share of the textured surface that shows what lies outside every chart of the original.
"""

import json
import shlex
import subprocess


def compared(binary, source, result, samples):
    """Geometry, colour and outside by `drystone compare`; None where there is no picture."""
    report = result.with_suffix(".compare.json")
    command = [binary, "compare", source, result, "--report", report, "--samples", str(samples)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    told = json.loads(report.read_text())
    report.unlink()
    geometry, texture = told["geometry"], told["texture"] or {}
    distance = 1e4 * geometry["symmetric"]["rms"] / geometry["diagonal"]
    return distance, texture.get("colour_rms"), texture.get("outside_fraction")


def refereed(command, source, result):
    """The same from the last line, JSON, that a command prints when called with both files and `--tex`."""
    printed = subprocess.run([*shlex.split(command), source, result, "--tex"], cwd=result.parent, capture_output=True, text=True)
    lines = printed.stdout.splitlines()
    if not lines or not lines[-1].startswith("{"):
        return None, None, None
    told = json.loads(lines[-1])
    texture = told.get("tex") or {}
    return told.get("sym_rms"), texture.get("col_rms"), texture.get("outside")
