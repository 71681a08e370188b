"""Liu, Chen, Wang 2020: reconstruction by centroidal Voronoi cells before the collapse."""

import json

from . import limbs, meshes, shapes
from .pages import Page
from .runs import FOLDER, SHARED, call, run

QSLIM, CVD = "qem-1997 border=10", "qem-1997 border=10 --remesh=cvd"
REMOVED = (0.5, 0.75, 0.9, 0.95)
LEVELS = (0.75, 0.5, 0.25, 0.1)


def write():
    page = Page("reconstruction", "Reconstruction by centroidal Voronoi cells", "Liu, Chen, Wang: Edge collapse of UDSM based on centroidal Voronoi diagram reconstruction. Journal of Applied Optics 41(1), 2020.")
    pieces = [meshes.cut(FOLDER / f"{name}-{count}.obj", path, count) for name, count in (("cc_cyanhabao", 109936), ("odm_bocimi", 160834)) if (path := SHARED / name / f"{name}.obj").exists()]
    bunny = [path] if (path := SHARED / "scans" / "stanford-bunny.obj").exists() else []
    figure = meshes.write_obj(FOLDER / "quadruped.obj", *limbs.FIGURES["quadruped"]())
    with_kinds = meshes.town(FOLDER / "dalian", 109936)
    city = meshes.without_texture(with_kinds, FOLDER / "town.obj")
    all_meshes = [*pieces, *bunny, figure, city]
    page_tables(page, all_meshes)
    cells = cells_table(page, [*bunny, figure])
    flats(page, all_meshes)
    three = three_at_2000(with_kinds, city)
    picture(page, city, three)
    claims(page, all_meshes, cells, three)
    page.save()


def errors(result):
    return [1e4 * x / result.diagonal for x in result.distances()]


def faces_left(mesh, removed):
    return round((1 - removed) * run(mesh, QSLIM, 0.5).by_area["topology"]["before"]["faces"])


def page_tables(page, all_meshes):
    page.head("What the reconstruction makes")
    page.text("Before any collapse, with λ = 0, 1 and 2: triangles before and after, share of *free points* (centres that no cell of step 1 has, so that the queue places them), vertices for the area on flat ground ÷ off it. The last is of the mesh brought back to as many triangles as before. Flat is where no edge bends by more than 5°.")
    rows = []
    for mesh in all_meshes:
        area, on = shapes.flatness(mesh)
        row = [mesh.stem, f"{on * (1 - area) / (area * (1 - on)):.3f}"]
        for power in (0, 1, 2):
            result = run(mesh, f"{QSLIM} --remesh=cvd:{power}", 1.0)
            told = result.told["remesh"][0]
            area, on = shapes.flatness(result.path)
            free = max(told["wanted"] - told["cells"], 0) / told["wanted"]
            row.append(f"{told['faces_in']:,} → {told['faces_out']:,}, {free:.2f} free, {on * (1 - area) / (area * (1 - on)):.3f}")
        rows.append(row)
    page.table(["mesh", "density before", "λ = 0", "λ = 1", "λ = 2"], rows)
    sheet = meshes.half_flat(FOLDER / "half-flat.obj")
    page.picture("density", [sheet, run(sheet, f"{QSLIM} --remesh=cvd", 1.0).path], "A sheet of which one half is flat, before and after the reconstruction: as many vertices, most of them where it bends.", "--tilt", "60", "--wire", size="480x360")
    page.head("Simplified")
    page.text("QSlim is `qem-1997 border=10` here, for errors and seconds alike: optimal placement and planes that hold borders, without weights by area. Largest / mean / RMS distance in 1e-4 of the diagonal, both ways; seconds of the collapse, which is all that the paper counts, and of the reconstruction before it.")
    rows = []
    for mesh in all_meshes:
        for removed in REMOVED:
            target = faces_left(mesh, removed)
            plain, made = run(mesh, QSLIM, target), run(mesh, CVD, target)
            for name, result in (("QSlim", plain), ("reconstructed", made)):
                page.note(mesh.stem, name, 1 - removed, errors(result)[1])
            rows.append([mesh.stem, f"{removed:.0%}", *(" / ".join(f"{x:.3g}" for x in errors(result)) for result in (plain, made)), " / ".join(f"{a / b:.2f}" for a, b in zip(errors(made), errors(plain))), f"{plain.collapse_seconds:.2f} / {made.collapse_seconds:.2f}", f"{made.collapse_seconds / plain.collapse_seconds:.2f}", f"{made.remesh_seconds:.2f}"])
        page.plot(mesh.stem, f"{mesh.stem}: mean distance", "triangles left, share", "mean distance, 1e-4 of the diagonal", "Mean distance, both ways.")
    page.table(["mesh", "removed", "QSlim", "reconstructed", "÷ QSlim", "seconds", "÷ QSlim", "reconstruction, s"], rows)


def cells_table(page, all_meshes):
    page.head("Cells alone: CVD(2) and ACVD")
    page.text("As many cells as asked for and no collapse, with masses by curvature (CVD(2), `cvd:cells=N`) and with equal masses and centroids for centres (ACVD, `cvd:0,cells=N,centroidal=1`), beside the others at the same number of triangles. Largest / mean / RMS in 1e-4 of the diagonal; mean r; seconds with the reconstruction.")
    rows, found = [], {}
    for mesh in all_meshes:
        count = run(mesh, QSLIM, 0.5).by_area["topology"]["before"]["vertices"]
        for removed in (0.75, 0.9):
            cells = round((1 - removed) * count)
            systems = {"CVD(2)": run(mesh, f"qem --remesh=cvd:cells={cells}"), "ACVD": run(mesh, f"qem --remesh=cvd:0,cells={cells},centroidal=1")}
            faces = systems["CVD(2)"].faces
            systems = {"QSlim": run(mesh, QSLIM, faces), "reconstructed": run(mesh, CVD, faces), **systems}
            found[mesh.stem, removed] = systems
            for name, result in systems.items():
                rows.append([mesh.stem, f"{removed:.0%}", name, result.faces, " / ".join(f"{x:.3g}" for x in errors(result)), result.quality["regularity_mean"], result.remesh_seconds + result.collapse_seconds])
    page.table(["mesh", "removed", "system", "triangles", "largest / mean / RMS", "r", "seconds"], rows)
    return found


def flats(page, all_meshes):
    page.head("What a level changes on flats")
    page.text("Levels of 100, 75, 50, 25 and 10 % of the triangles, each made from the whole mesh: share of the area of flats whose triangles the next level does not have.")
    rows = [[mesh.stem, system, *(f"{x:.2f}" for x in lost_flats(mesh, options))] for mesh in all_meshes for system, options in (("QSlim", QSLIM), ("reconstructed", CVD))]
    page.table(["mesh", "system", "100 → 75 %", "75 → 50 %", "50 → 25 %", "25 → 10 %"], rows)


def lost_flats(mesh, options):
    first = mesh if options == QSLIM else run(mesh, CVD, 1.0).path
    levels = [first, *(run(mesh, options, share).path for share in LEVELS)]
    return [shapes.lost_flats(*pair) for pair in zip(levels, levels[1:])]


def on_kinds(with_kinds, result):
    """Mean distance from a city's buildings, and from its green, to a result, in 1e-4 of the diagonal."""
    distances = []
    for kind, materials in (("buildings", ("facade", "roof")), ("green", ("green",))):
        part = meshes.part_of(with_kinds, FOLDER / f"town-{kind}.obj", materials)
        told = json.loads(call("compare", part, result.path, "--json", "-q", "--samples", "100000").stdout)
        distances.append(1e4 * told["geometry"]["backward"]["mean"] / result.diagonal)
    return distances


def three_at_2000(with_kinds, city):
    """Each system's result, and its mean distances from buildings and from the green."""
    results = {"QSlim": run(city, QSLIM, 2000), "reconstructed": run(city, CVD, 2000), "CVD(2)": run(city, "qem --remesh=cvd:cells=1000")}
    return {name: (result, on_kinds(with_kinds, result)) for name, result in results.items()}


def picture(page, city, three):
    page.head("A city with 2,000 triangles")
    page.text(f"The generated town of {run(city, QSLIM, 0.5).by_area['topology']['before']['faces']:,} triangles (Dalian has 109,936), without materials and textures. Mean distance from the original in 1e-4 of the diagonal.")
    page.table(["", "triangles", "from buildings", "from the green"], [[name, result.faces, *kinds] for name, (result, kinds) in three.items()])
    page.picture("city", [city, *(result.path for result, _ in three.values())], "The town, and with 2,000 triangles: by QSlim, reconstructed before, and by cells alone.", "--turn", "30", size="420x320")


def claims(page, all_meshes, cells, three):
    made = {mesh.stem: run(mesh, f"{QSLIM} --remesh=cvd:2", 1.0) for mesh in all_meshes}
    counts = {name: result.told["remesh"][0]["faces_out"] / result.told["remesh"][0]["faces_in"] for name, result in made.items()}
    page.claim("The reconstructed mesh has slightly more vertices than before (here: up to 10 %)", "4", "; ".join(f"{name} {x:.3f}" for name, x in counts.items()), [1 <= x < 1.1 for x in counts.values()])
    density = {}
    for mesh in all_meshes:
        (a0, on0), (a1, on1) = shapes.flatness(mesh), shapes.flatness(made[mesh.stem].path)
        density[mesh.stem] = on1 * (1 - a1) / (a1 * (1 - on1)) / (on0 * (1 - a0) / (a0 * (1 - on0)))
    page.claim("Flat ground then holds far fewer points than detail (here: fewer than before)", "figs. 1, 4", "density on flats ÷ off them, after ÷ before: " + "; ".join(f"{name} {x:.2f}" for name, x in density.items()), [x < 1 for x in density.values()])
    free = {}
    for mesh in all_meshes:
        told = [run(mesh, f"{QSLIM} --remesh=cvd:{power}", 1.0).told["remesh"][0] for power in (0, 1, 2)]
        free[mesh.stem] = [max(one["wanted"] - one["cells"], 0) / one["wanted"] for one in told]
    page.claim("Free points grow with λ", "fig. 2", "; ".join(f"{name} {' / '.join(f'{x:.2f}' for x in values)}" for name, values in free.items()), [a <= b <= c for a, b, c in free.values()])
    pairs = {(mesh.stem, removed): [run(mesh, system, faces_left(mesh, removed)) for system in (QSLIM, CVD)] for mesh in all_meshes for removed in REMOVED}
    page.claim("The collapse takes at most about 1.25 times as long as QSlim on the same mesh", "table 2", "; ".join(f"{mesh.stem} {' / '.join(f'{pairs[mesh.stem, r][1].collapse_seconds / pairs[mesh.stem, r][0].collapse_seconds:.2f}' for r in REMOVED)}" for mesh in all_meshes), [made.collapse_seconds <= 1.25 * plain.collapse_seconds for plain, made in pairs.values()])
    page.claim("QSlim has the least mean error", "fig. 3", "see the table", [errors(plain)[1] <= errors(made)[1] for plain, made in pairs.values()])
    near = [errors(made)[1] / errors(plain)[1] for (_, removed), (plain, made) in pairs.items() if removed >= 0.75]
    page.claim("The mean error is near QSlim's (here: within 1.3 times from 75 % on)", "fig. 3", f"{min(near):.2f} to {max(near):.2f} times", [x <= 1.3 for x in near])
    page.claim("CVD(2) and ACVD have a larger mean error than both", "fig. 3", "see the table", [errors(systems[name])[1] > max(errors(systems[other])[1] for other in ("reconstructed", "QSlim")) for systems in cells.values() for name in ("CVD(2)", "ACVD")])
    page.claim("CVD(2) and ACVD take longer than the collapse", "table 2", "see the table", [systems[name].remesh_seconds + systems[name].collapse_seconds > systems["reconstructed"].collapse_seconds for systems in cells.values() for name in ("CVD(2)", "ACVD")])
    lost = {mesh.stem: [lost_flats(mesh, system) for system in (QSLIM, CVD)] for mesh in all_meshes}
    page.claim("Flats stay nearly the same from one level to the next (here: half of their area at least)", "fig. 4", "see the table", [x < 0.5 for _, made in lost.values() for x in made])
    falls = [errors(run(mesh, CVD, faces_left(mesh, b)))[1] < errors(run(mesh, CVD, faces_left(mesh, a)))[1] for mesh in all_meshes for a, b in zip(REMOVED, REMOVED[1:])]
    page.claim("A coarser level sometimes has less error than a finer one", "fig. 3", f"{sum(falls)} of {len(falls)} steps", [any(falls)])
    kinds = {name: found for name, (_, found) in three.items()}
    page.claim("At 2,000 triangles roofs are better than QSlim's", "fig. 5", f"mean distance from buildings {kinds['reconstructed'][0]:.2f} against {kinds['QSlim'][0]:.2f}", [kinds["reconstructed"][0] < kinds["QSlim"][0]])
    page.claim("At 2,000 triangles gently uneven ground is not flattened as by CVD(2)", "fig. 5", f"mean distance from the green {kinds['reconstructed'][1]:.2f} against {kinds['CVD(2)'][1]:.2f}", [kinds["reconstructed"][1] < kinds["CVD(2)"][1]])
