"""The page above those of the papers: what is compared with what, and what holds for all of them."""

import datetime

import numpy as np

from . import limbs, meshes
from .pages import CONFIRMED, PAGES, PARTLY, REFUTED, RULE, UNTESTED, claims_of, rows_of
from .runs import FOLDER, SHARED, run, timed

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
* **One pass over one cluster**, one thread, unless said otherwise. Times are seconds of user time, medians of five runs in
  shuffled order, with reading and writing unless said otherwise.
"""


# Triangles of each mesh that is simplified one edge at a time.
HEAP = 20000


def write():
    lines = [LEAD.format(date=datetime.date.today()), *counts(), "", METHOD + RULE, "", *heap(), "", *clusters()]
    (PAGES / "README.md").write_text("\n".join(lines) + "\n")


def counts():
    """The table of claims, counted on the pages."""
    rows = []
    for name in ORDER:
        title, tables = claims_of(PAGES / f"{name}.md")
        rows += [[f"[{title}]({name}.md)" + (f": {of}" if of else ""), *found] for of, found in tables.items()]
    return rows_of(["Paper", *(f"claims {verdict}" for verdict in (CONFIRMED, PARTLY, REFUTED, UNTESTED))], rows)


def recount():
    """Writes the table of claims anew into the page, and leaves the rest of it."""
    lines = (PAGES / "README.md").read_text().splitlines()
    first = next(at for at, line in enumerate(lines) if line.startswith("| Paper |"))
    last = next(at for at in range(first, len(lines)) if not lines[at].startswith("|"))
    (PAGES / "README.md").write_text("\n".join([*lines[:first], *counts(), *lines[last:]]) + "\n")


def heap_meshes():
    """A town, a terrain and two figures, thinned to so many triangles by plain QEM."""
    town = meshes.town(FOLDER / "town30000", 30000)
    person = meshes.write_obj(FOLDER / "person-fine.obj", *limbs.person(2 * limbs.CELLS["person"]))
    fish = meshes.figure(FOLDER / "fish.obj", 90, 140, 4)
    found = {}
    for name, mesh in (("town", town), ("terrain", meshes.terrain(FOLDER / "terrain.obj")), ("person", person), ("fish", fish)):
        result = run(mesh, "qem-attributes" if name != "person" else "qem", HEAP)
        found[name] = meshes.beside_its_images(result.path, FOLDER / "heap" / f"{name}.obj")
    return found


def heap():
    """Rounds against a heap."""
    mesh = heap_meshes()
    cases = [("oblique", "town"), ("oblique border=0", "town"), ("qem-1997 border=10 --remesh=cvd", "person"), ("curvature", "person"), ("terrain", "terrain"), ("sharpness", "fish"), ("qem-1997", "person"), ("qem-attributes", "town")]
    runs = [(mesh[name], system + order, share) for system, name in cases for share in (0.3, 0.1) for order in ("", " --one-by-one")]
    times, rows, ratios = timed(runs), [], []
    for at in range(0, len(runs), 2):
        (path, system, share), rounds, one_by_one = runs[at], run(*runs[at]), run(*runs[at + 1])
        ratios.append([a / b for a, b in zip(rounds.distances(), one_by_one.distances())])
        ratio = " / ".join(f"{x:.3f}" for x in ratios[-1])
        rows.append([f"`{system}`", f"{path.stem}, {rounds.by_area['topology']['before']['faces']:,}", f"{1 - share:.0%}", ratio, " / ".join(f"{np.median(one.user):.2f}" for one in times[at : at + 2])])
    text = """\
## Rounds against a heap

The papers take one edge at a time from a heap and bring it up to date; here a round collapses up to a fifth of the triangles, each
vertex once, the cheapest first. `--one-by-one` makes a round of one collapse, which is the heap's order but not a heap: its time
grows with the square of the triangles, so the seconds below say nothing of a heap's. The meshes were thinned to 20,000 triangles by
our own metric.
"""
    between = lambda column: f"{min(row[column] for row in ratios):.2f} to {max(row[column] for row in ratios):.2f}"
    text += f"Rounds have {between(1)} times the mean distance, {between(2)} times the RMS and {between(0)} times the largest distance of that order."
    return [text, "", *rows_of(["System", "Mesh, triangles", "Removed", "largest / mean / RMS, rounds ÷ one by one", "user s, rounds / one by one"], rows)]


def clusters():
    """Many clusters against one."""
    mesh = SHARED / "cc_cyanhabao" / "cc_cyanhabao.obj"
    if not mesh.exists():
        return []
    systems = ("qem", "qem-attributes", "qem-1997", "oblique", "oblique border=0", "curvature", "terrain", "sharpness", "sharpness --optimize", "qem --remesh=cvd")
    ways = (("--cluster-faces", "1200000", "--memory", "12GiB"), ("--cluster-faces", "25000", "--memory", "256MiB"))
    rows = []
    for system in systems:
        one, many = (run(mesh, system, 0.25, *way, whole=False) for way in ways)
        rms = [result.distances()[2] for result in (one, many)]
        peak = many.told["memory"]["peak_resident"] / 2**20
        rows.append([f"`{system}`", *(f"{x:.5f}" for x in rms), f"{rms[1] / rms[0]:.3f}", f"{many.faces:,}", f"{peak:.0f}", "yes" if many.checked["is_whole"] else "no"])
    text = """\
## Many clusters against one

cc_cyanhabao, 519,691 triangles to 25 %, three passes: in one cluster, and in clusters of 25,000
under `--memory 256MiB`."""
    return [text, "", *rows_of(["System", "RMS (m), one", "many", "many ÷ one", "triangles", "peak MiB, many", "nothing new in `check`"], rows)]
