"""Li, Shi, Zhu 2018: terrain under several constraints."""

from . import meshes
from .pages import Page
from .runs import FOLDER, SHARED, run

TRIANGLES, BORDER_EDGES = 30868, 566
BASE, BEST_KEPT = "qem-1997 guards=0", "qem-1997 placement=three --borders=lock"
SYSTEMS = [BASE, "qem-1997", "qem-1997 border=10", "qem-1997 --borders=lock", BEST_KEPT, "terrain", "terrain border-weights=1", "terrain carry=0", "terrain raw=1", "terrain normal=0", "qem --borders=lock"]
# Faces: border edges, largest (m) and mean (m), of the original method and of the improved one.
PAPER = {
    24692: ((555, 566), (0.096, 0.051), (0.021, 0.013)),
    12338: ((251, 566), (0.913, 0.617), (0.210, 0.091)),
    6170: ((187, 566), (3.248, 1.783), (1.012, 0.483)),
    3084: ((124, 566), (5.328, 3.611), (2.093, 1.007)),
    1540: ((83, 566), (7.715, 4.322), (3.132, 1.909)),
    768: ((55, 566), (9.127, 6.315), (5.012, 2.368)),
}


def write():
    page = Page("terrain", "Terrain", "Li, Shi, Zhu: Simplification approach for 3D terrain with multi-constraints consideration. Geomatics and Information Science of Wuhan University 43(2), 2018.")
    mesh = meshes.terrain(FOLDER / "terrain.obj")
    found = {system: {faces: run(mesh, system, faces) for faces in PAPER} for system in SYSTEMS}
    claims(page, found)
    page.head("Its table on a generated terrain")
    page.text(f"A terrain of {TRIANGLES:,} triangles with {BORDER_EDGES} border edges, as in the paper, and a texture. Largest distance both ways and mean distance from the result to the original, in metres; border edges that are left.")
    rows = [["paper, original method", *(f"{most[0]} / {mean[0]} / {edges[0]}" for edges, most, mean in PAPER.values())], ["paper, improved", *(f"{most[1]} / {mean[1]} / {edges[1]}" for edges, most, mean in PAPER.values())]]
    rows += [[f"`{system}`", *(f"{result.distances()[0]:.3f} / {result.distances('forward')[1]:.3f} / {result.border_edges}" for result in results.values())] for system, results in found.items()]
    page.table(["largest / mean / border edges", *(f"{faces:,} triangles" for faces in PAPER)], rows)
    page.text("`border-weights=1` is the paper's own mechanism: a border corner that costs nothing is cut off all the same, since a weight times nothing is nothing; the lock, which is the default, is stronger. `carry=0` recomputes the quadrics around a new vertex, the other reading of the paper's step 5. `raw=1` takes metres, texture coordinates from 0 to 1 and unit normals as they are. The last row is our own metric with locked borders. The row with `placement=three` asks whether the paper's baseline did without optimal placement.")
    page.head("Texture")
    page.text("RMS of the difference of colours (of 255), and texture triangles that turned over.")
    page.table(["", *(f"{faces:,} triangles" for faces in PAPER)], [[f"`{system}`", *(f"{result.texture['colour_rms']:.2f} / {result.mirrored}" for result in found[system].values())] for system in (BASE, "qem-1997", "terrain", "terrain normal=0")])
    for system in (BASE, "qem-1997 --borders=lock", BEST_KEPT, "terrain"):
        for faces, result in found[system].items():
            page.note("mean", system, faces / TRIANGLES, result.distances("forward")[1])
            page.note("max", system, faces / TRIANGLES, result.distances()[0])
    page.plot("mean", "Generated terrain: mean", "triangles left, share", "mean distance (m)", "Mean distance from the result to the original.")
    page.plot("max", "Generated terrain: largest", "triangles left, share", "largest distance (m)", "Largest distance, both ways: what wears away at the border shows here.")
    page.picture("border", [found[system][3084].path for system in (BASE, "terrain")], "The terrain with a tenth of its triangles: by `qem-1997 guards=0`, whose border wears away, and by `terrain`, which keeps every edge of it.", "--turn", "60", "--tilt", "55", "--wire", size="560x380")
    survey(page)
    page.save()


def claims(page, found):
    ours = found["terrain"]
    page.claim(f"All {BORDER_EDGES} border edges are left at every level", "table 1", " / ".join(str(result.border_edges) for result in ours.values()), [result.border_edges == BORDER_EDGES for result in ours.values()])
    weights = [result.border_edges for result in found["terrain border-weights=1"].values()]
    page.claim("Weights of 1, general and border are what keeps them", "2.3", f"with `border-weights=1` {' / '.join(map(str, weights))} of {BORDER_EDGES}", [count == BORDER_EDGES for count in weights])
    most = [ours[faces].distances()[0] / found[BASE][faces].distances()[0] for faces in PAPER]
    page.claim("The largest error is .53 to .69 of the original method's", "table 1", " / ".join(f"{x:.2f}" for x in most), [x <= 0.69 for x in most])
    for base, words in [(BASE, "the original method's"), (BEST_KEPT, "a baseline's that keeps borders and places at the best of three")]:
        mean = [ours[faces].distances("forward")[1] / found[base][faces].distances("forward")[1] for faces in PAPER]
        page.claim(f"The mean error is .43 to .62 of {words}", "table 1", " / ".join(f"{x:.2f}" for x in mean), [x <= 0.62 for x in mean])
    low = [faces for faces in PAPER if faces < 20000]
    colours = [ours[faces].texture["colour_rms"] / found[BASE][faces].texture["colour_rms"] for faces in low]
    page.claim("Below 20,000 triangles the original method garbles the texture, and this one does not", "fig. 5", f"RMS of colours {' / '.join(f'{x:.2f}' for x in colours)} of it; {' / '.join(str(found[BASE][faces].mirrored) for faces in low)} triangles turned over by it, {max(ours[faces].mirrored for faces in low)} by this one", [x < 0.9 for x in colours])
    counted = [result.by_area["topology"]["after"]["vertices"] == (result.faces + result.border_edges + 2) // 2 for result in ours.values()]
    page.claim("(F + B + 2) / 2 vertices are left", "table 1", "counted at all six levels", counted)
    page.claim("Rendering takes 673 ms at the first level and 83 ms at the last", "table 1", "it measures their graphics card", "it measures their graphics card")


def survey(page):
    path = SHARED / "odm_bocimi" / "odm_bocimi.obj"
    if not path.exists():
        return
    mesh, rows = meshes.cut(FOLDER / "ground.obj", path, TRIANGLES, meshes.most_ground), []
    for system in (BASE, "qem-1997 --borders=lock", "terrain"):
        rows.append([f"`{system}`", *(f"{result.distances()[0]:.2f} / {result.distances('forward')[1]:.4f} / {result.border_edges}" for result in (run(mesh, system, faces) for faces in list(PAPER)[1:5]))])
    page.head("On a real survey")
    page.text("A piece of odm_bocimi with as many triangles, where most of the surface is no steeper than 45°.")
    page.table(["largest / mean / border edges", *(f"{faces:,} triangles" for faces in list(PAPER)[1:5])], rows)
