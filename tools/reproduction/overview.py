"""The page above those of the papers: what is compared with what, and what holds for all of them."""

import datetime
import json
from pathlib import Path

from . import limbs, meshes
from .pages import CONFIRMED, PARTLY, REFUTED, RULE, UNTESTED, rows_of
from .runs import FOLDER, SHARED, run

ORDER = ["oblique", "reconstruction", "curvature", "terrain", "sharpness"]
LEAD = """\
# Five published systems, measured

drystone implements five published systems, each in one source file that opens with the paper, its
symbols and the departures from it. These pages measure them as their papers measured. The papers'
meshes are not public, so only ratios to a baseline can be compared. The meshes here are generated
with the papers' counts, or cut from real surveys where these are at hand.
[Choosing](../../guide/choosing.md) says what follows for a user.

Made by `python3 tools/reproduce.py`, {date}.
"""
METHOD = """\
## What is compared with what

* **QEM** in these papers is Garland and Heckbert's method of 1997: planes of equal weight, optimal placement, no planes
  that hold borders, no check of folds or texture. That is `qem-1997 guards=0`. The sharpness paper places at the best of both ends and the
  middle (`placement=three`), the patent weights by area (`curvature curvature=0`), the reconstruction's is QSlim, which holds borders
  (`qem-1997 border=10`).
* **Guards.** Without `guards=0` every metric here refuses to fold a face, to make a needle of it, and to turn over a texture
  triangle. So the plain `qem-1997` is better than the papers' QEM.
* **Distances** are exact distances from 200,000 points by area on each surface, both ways unless said otherwise. *At vertices*:
  from the vertices of the result to the original, which some papers take.
* **One pass over one cluster**, one thread, unless said otherwise. Times are processor seconds, the least of three runs, with
  reading and writing unless said otherwise.
"""


def write():
    summaries = {name: json.loads(path.read_text()) for name in ORDER if (path := FOLDER / f"summary-{name}.json").exists()}
    verdicts = (CONFIRMED, PARTLY, REFUTED, UNTESTED)
    rows = [[f"[{told['title']}]({name}.md)", *(told["counts"][verdict] for verdict in verdicts)] for name, told in summaries.items()]
    lines = [LEAD.format(date=datetime.date.today()), *rows_of(["Paper", *(f"claims {verdict}" for verdict in verdicts)], rows), "", METHOD + RULE, "", *heap(), "", *clusters()]
    Path("docs/results/papers/README.md").write_text("\n".join(lines) + "\n")


def heap():
    """Rounds against a heap."""
    town = meshes.town(FOLDER / "town20000", 20000)
    terrain, person = meshes.terrain(FOLDER / "terrain.obj"), meshes.write_obj(FOLDER / "person.obj", *limbs.FIGURES["person"]())
    fish = meshes.figure(FOLDER / "fish.obj", 90, 140, 4)
    cases = [("oblique", town), ("qem-1997 border=10 --remesh=cvd", person), ("curvature", person), ("terrain", terrain), ("sharpness", fish), ("qem-1997", person), ("qem-attributes", town)]
    rows, ratios, times = [], [], []
    for system, mesh in cases:
        for share in (0.3, 0.1):
            rounds, one_by_one = run(mesh, system, share), run(mesh, f"{system} --one-by-one", share)
            ratios.append([a / b for a, b in zip(rounds.distances(), one_by_one.distances())])
            times.append(rounds.cpu / one_by_one.cpu)
            ratio = " / ".join(f"{x:.3f}" for x in ratios[-1])
            rows.append([f"`{system}`", f"{mesh.stem}, {rounds.by_area['topology']['before']['faces']:,}", f"{1 - share:.0%}", ratio, f"{rounds.cpu:.2f} / {one_by_one.cpu:.2f}"])
    text = """\
## Rounds against a heap

The papers take one edge at a time from a heap and bring it up to date; here a round collapses up to a fifth of the triangles, each
vertex once, the cheapest first. `--one-by-one` makes a round of one collapse, which is the heap's order.
"""
    between = lambda column: f"{min(row[column] for row in ratios):.2f} to {max(row[column] for row in ratios):.2f}"
    text += f"Rounds have {between(1)} times the mean distance, {between(2)} times the RMS and {between(0)} times the largest distance of a heap, in {min(times):.2f} to {max(times):.2f} of its time."
    return [text, "", *rows_of(["System", "Mesh, triangles", "Removed", "largest / mean / RMS, rounds ÷ heap", "CPU s, rounds / heap"], rows)]


def clusters():
    """Many clusters against one."""
    mesh = SHARED / "cc_cyanhabao" / "cc_cyanhabao.obj"
    if not mesh.exists():
        return []
    rows = []
    for system in ("qem", "qem-attributes", "qem-1997", "oblique", "curvature", "terrain", "sharpness", "sharpness --optimize", "qem --remesh=cvd"):
        one = run(mesh, system, 0.25, "--cluster-faces", "1200000", "--memory", "12GiB", whole=False)
        many = run(mesh, system, 0.25, "--cluster-faces", "25000", "--memory", "256MiB", whole=False)
        rms = [result.distances()[2] for result in (one, many)]
        peak = many.told["memory"]["peak_resident"] / 2**20
        rows.append([f"`{system}`", *(f"{x:.5f}" for x in rms), f"{rms[1] / rms[0]:.3f}", f"{many.faces:,}", f"{peak:.0f}", f"{one.cpu:.1f} / {many.cpu:.1f}", "yes" if many.checked["is_whole"] else "no"])
    text = """\
## Many clusters against one

cc_cyanhabao, 519,691 triangles to 25 %, three passes: in one cluster, and in clusters of 25,000
under `--memory 256MiB`."""
    return [text, "", *rows_of(["System", "RMS (m), one", "many", "many ÷ one", "triangles", "peak MiB, many", "CPU s, one / many", "nothing new in `check`"], rows)]
