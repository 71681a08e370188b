"""Liu, Chen, Wang 2020: reconstruction by centroidal Voronoi cells before the collapse."""

import json

import numpy as np

from . import limbs, meshes, shapes
from .pages import Page, about, judged
from .runs import FOLDER, SHARED, call, over, run, timed

QSLIM, CVD = "qem-1997 border=10", "qem-1997 border=10 --remesh=cvd"
REMOVED = (0.5, 0.75, 0.9, 0.95)
TIMED = 0.9
LEVELS = (0.75, 0.5, 0.25, 0.1)
# Seconds at 90 %, of the paper: itself, QSlim, ACVD, CVD(2).
SECONDS = {"Dalian": (2.019, 1.731, 8.891, 12.265), "Pagoda": (3.088, 2.504, 3.423, 3.864), "bunny": (0.843, 0.827, 6.609, 7.363)}
# The paper's mesh that each of ours has the size, or the kind, of.
LIKE = {"cc_cyanhabao-109936": "Dalian", "odm_bocimi-160834": "Pagoda", "stanford-bunny": "bunny", "quadruped": "bunny", "town": "Dalian"}


def write():
    page = Page("reconstruction", "Reconstruction by centroidal Voronoi cells", "Liu, Chen, Wang: Edge collapse of UDSM based on centroidal Voronoi diagram reconstruction. Journal of Applied Optics 41(1), 2020.")
    pieces = [meshes.cut(FOLDER / f"{name}-{count}.obj", path, count) for name, count in (("cc_cyanhabao", 109936), ("odm_bocimi", 160834)) if (path := SHARED / name / f"{name}.obj").exists()]
    bunny = [path] if (path := SHARED / "scans" / "stanford-bunny.obj").exists() else []
    figure = meshes.write_obj(FOLDER / "quadruped.obj", *limbs.FIGURES["quadruped"]())
    with_kinds = meshes.town(FOLDER / "dalian", 109936)
    city = meshes.without_texture(with_kinds, FOLDER / "town.obj")
    all_meshes = [*pieces, *bunny, figure, city]
    spent = seconds(all_meshes)
    page_tables(page, all_meshes, spent)
    larger(page)
    plain = [meshes.without_texture(piece, FOLDER / f"{piece.stem}-plain.obj") for piece in pieces]
    cells, cell_seconds = cells_table(page, [*bunny, figure, city, *plain])
    flats(page, all_meshes)
    edges = meshes.outlines(with_kinds, FOLDER / "town-outlines.obj", "roof", "facade")
    three = three_at_2000(with_kinds, city)
    picture(page, city, three, edges)
    outlines = outline_table(page, city, edges)
    claims(page, all_meshes, spent, cells, cell_seconds, three, outlines, edges)
    page.save()


def made_vertices(told):
    """Vertices after the reconstruction: cells, vertices that hold still, centres of the queue, junctions, and those that found no way to their centre."""
    return sum(told[name] for name in ("cells", "held", "added", "junctions", "kept"))


def errors(result):
    return [1e4 * x / result.diagonal for x in result.distances()]


def faces_left(mesh, removed):
    return round((1 - removed) * run(mesh, QSLIM, 0.5).by_area["topology"]["before"]["faces"])


def seconds(all_meshes):
    """Times of QSlim and of the reconstruction at the share that the paper tells them of."""
    found = timed([(mesh, system, faces_left(mesh, TIMED)) for mesh in all_meshes for system in (QSLIM, CVD)], phases=True)
    return {mesh.stem: (found.pop(0), found.pop(0)) for mesh in all_meshes}


def page_tables(page, all_meshes, spent):
    page.head("What the reconstruction makes")
    page.text("Before any collapse, with λ = 0, 1 and 2: vertices and triangles before and after, share of *free points* (centres that no cell of step 1 has, so that the queue places them), vertices for the area on flat ground ÷ off it. The last is of the mesh brought back to as many triangles as before. Flat is where no edge bends by more than 5°.")
    rows = []
    for mesh in all_meshes:
        area, on = shapes.flatness(mesh)
        row = [mesh.stem, f"{on * (1 - area) / (area * (1 - on)):.3f}"]
        for power in (0, 1, 2):
            result = run(mesh, f"{QSLIM} --remesh=cvd:{power}", 1.0)
            told = result.told["remesh"][0]
            area, on = shapes.flatness(result.path)
            free = max(told["wanted"] - told["cells"], 0) / told["wanted"]
            row.append(f"{told['wanted']:,} → {made_vertices(told):,} vertices, {told['faces_in']:,} → {told['faces_out']:,} triangles, {free:.2f} free, {on * (1 - area) / (area * (1 - on)):.3f}")
        rows.append(row)
    page.table(["mesh", "density before", "λ = 0", "λ = 1", "λ = 2"], rows)
    sheet = meshes.half_flat(FOLDER / "half-flat.obj")
    page.picture("density", [sheet, run(sheet, f"{QSLIM} --remesh=cvd", 1.0).path], "A sheet of which one half is flat, before and after the reconstruction: as many vertices, most of them where it bends.", "--tilt", "60", "--wire", size="480x360")
    page.head("Simplified")
    page.text(f"QSlim is `qem-1997 border=10` here, for errors and seconds alike: optimal placement and planes that hold borders, without weights by area. Largest / mean / RMS distance in 1e-4 of the diagonal, both ways; processor seconds of the collapse, which is all that the paper counts, and of the reconstruction before it, medians of five runs in shuffled order, at {TIMED:.0%}, where the paper has them.")
    rows = []
    for mesh in all_meshes:
        for removed in REMOVED:
            target = faces_left(mesh, removed)
            plain, made = run(mesh, QSLIM, target), run(mesh, CVD, target)
            for name, result in (("QSlim", plain), ("reconstructed", made)):
                for measure, error in zip(("max", "mean", "rms"), errors(result)):
                    page.note(f"{mesh.stem}-{measure}", name, 1 - removed, error)
            rows.append([mesh.stem, f"{removed:.0%}", *(" / ".join(f"{x:.3g}" for x in errors(result)) for result in (plain, made)), " / ".join(f"{a / b:.2f}" for a, b in zip(errors(made), errors(plain))), *(told_of(*spent[mesh.stem]) if removed == TIMED else ("", "", ""))])
        for measure, words in (("mean", "Mean"), ("max", "Largest"), ("rms", "Root mean square")):
            page.plot(f"{mesh.stem}-{measure}", f"{mesh.stem}: {words.lower()} distance", "triangles left, share", f"{words.lower()} distance, 1e-4 of the diagonal", f"{words} distance, both ways.")
    page.table(["mesh", "removed", "QSlim", "reconstructed", "÷ QSlim", "seconds", "÷ QSlim", "reconstruction, s"], rows)
    page.text("The paper's own seconds at 90 % removed, where the reconstruction counts as preparation and is left out (Dalian has 109,936 triangles, Pagoda 160,834, the bunny 69,451):")
    page.table(["", "the paper", "QSlim", "ACVD", "CVD(2)", "the paper ÷ QSlim"], [[name, *row, f"{row[0] / row[1]:.2f}"] for name, row in SECONDS.items()])


def larger(page):
    """What the reconstruction costs where it takes seconds."""
    whole = [path for path in (SHARED / "scans" / "igea.obj", SHARED / "cc_cyanhabao" / "cc_cyanhabao.obj") if path.exists()]
    if not whole:
        return
    shares = (0.1,)
    times = timed([(mesh, CVD, share) for mesh in whole for share in shares], phases=True)
    page.text("Where it takes seconds (igea has 268,686 triangles, the whole of cc_cyanhabao 519,691): processor seconds of the reconstruction and of the collapse after it, medians of five runs.")
    rows = []
    for mesh in whole:
        for share in shares:
            found = times.pop(0)
            rows.append([mesh.stem, f"{1 - share:.0%}", f"{np.median(found.remesh):.2f}", f"{np.median(found.collapse):.2f}", f"{np.median(over(found.remesh, found.collapse)):.2f}"])
    page.table(["mesh", "removed", "reconstruction", "collapse", "÷"], rows)


def told_of(plain, made):
    """Seconds of the collapse of both, their ratio, and seconds of the reconstruction."""
    a, b, c = (np.median(one) for one in (plain.collapse, made.collapse, made.remesh))
    return f"{a:.2f} / {b:.2f}", f"{np.median(over(made.collapse, plain.collapse)):.2f}", f"{c:.2f}"


def cells_table(page, all_meshes):
    page.head("Cells alone: CVD(2) and ACVD")
    page.text(f"As many cells as asked for and no collapse, with masses by curvature (CVD(2), `cvd:cells=N`) and with equal masses and centroids for centres (ACVD, `cvd:0,cells=N,centroidal=1`), beside the others at the same number of triangles. Where borders and seams are many, all of their vertices stay, and more triangles are left than were asked for; the pieces of surveys are taken without their textures, as the paper's. Largest / mean / RMS in 1e-4 of the diagonal; mean r; processor seconds of the collapse, for CVD(2) and ACVD of the cells, which are all of their work, at {TIMED:.0%}, medians of five runs in shuffled order.")
    rows, found, cases = [], {}, []
    for mesh in all_meshes:
        count = run(mesh, QSLIM, 0.5).by_area["topology"]["before"]["vertices"]
        for removed in (0.75, 0.9):
            cells = round((1 - removed) * count)
            alone = {"CVD(2)": f"qem --remesh=cvd:cells={cells}", "ACVD": f"qem --remesh=cvd:0,cells={cells},centroidal=1"}
            faces = run(mesh, alone["CVD(2)"]).faces
            own = {"QSlim": (QSLIM, faces), "reconstructed": (CVD, faces), **{name: (system, None) for name, system in alone.items()}}
            found[mesh.stem, removed] = {name: run(mesh, *case) for name, case in own.items()}
            cases += [(mesh, *case) for name, case in own.items() if name != "QSlim" and removed == TIMED]
    times = timed(cases, phases=True)
    spent = {case: {name: seconds_of(name, times.pop(0)) for name in own if name != "QSlim"} for case, own in found.items() if case[1] == TIMED}
    for (mesh, removed), own in found.items():
        for name, result in own.items():
            rows.append([mesh, f"{removed:.0%}", name, result.faces, " / ".join(f"{x:.3g}" for x in errors(result)), result.quality["regularity_mean"], f"{np.median(spent[mesh, removed][name]):.2f}" if name in spent.get((mesh, removed), ()) else ""])
    page.table(["mesh", "removed", "system", "triangles", "largest / mean / RMS", "r", "seconds"], rows)
    return found, spent


def seconds_of(name, times):
    """Seconds as the paper counts them: its reconstruction is preparation, cells alone are all there is."""
    return times.cells if name in ("CVD(2)", "ACVD") else times.collapse


def from_outlines(edges, result):
    """Mean distance from points on the outlines of roofs to a result, in 1e-4 of the diagonal."""
    measure = lambda: json.loads(call("compare", result.path, edges, "--json", "-q", "--vertices").stdout)["geometry"]["forward"]["mean"]
    return 1e4 * result.kept("outlines", measure) / result.diagonal


def outline_table(page, city, edges):
    page.head("Building edges")
    page.text("Mean distance from points on the edges between roofs and façades of the generated town to the result, in 1e-4 of the diagonal; in brackets the mean distance of the whole. At 0 %, the mesh was reconstructed and brought back to as many triangles as before.")
    shares, found = (0.0, *REMOVED), {}
    for name, system in (("QSlim", QSLIM), ("reconstructed", CVD)):
        results = [run(city, system, faces_left(city, removed) if removed else 1.0) for removed in shares]
        found[name] = [from_outlines(edges, result) for result in results]
        found[f"{name}, whole"] = [errors(result)[1] for result in results]
    page.table(["", *(f"{removed:.0%} removed" for removed in shares)], [[name, *(f"{a:.3g} ({b:.3g})" for a, b in zip(found[name], found[f"{name}, whole"]))] for name in ("QSlim", "reconstructed")])
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
    count = results["CVD(2)"].faces
    results |= {"QSlim, as many as CVD(2)": run(city, QSLIM, count), "reconstructed, as many as CVD(2)": run(city, CVD, count)}
    return {name: (result, on_kinds(with_kinds, result)) for name, result in results.items()}


def picture(page, city, three, edges):
    page.head("A city with 2,000 triangles")
    page.text(f"The generated town of {run(city, QSLIM, 0.5).by_area['topology']['before']['faces']:,} triangles (Dalian has 109,936), without materials and pictures. Mean distance from the original in 1e-4 of the diagonal; outlines are the edges between roofs and façades. CVD(2) was asked for 1,000 cells, about 2,000 triangles, and leaves {three['CVD(2)'][0].faces:,}, since vertices of borders and those between more than two faces hold still; so the others stand there with as many, too.")
    page.table(["", "triangles", "from buildings", "from outlines of roofs", "from the green"], [[name, result.faces, kinds[0], from_outlines(edges, result), kinds[1]] for name, (result, kinds) in three.items()])
    pictures = [city, *(three[name][0].path for name in ("QSlim", "reconstructed", "CVD(2)"))]
    page.picture("city", pictures, f"The town, and with 2,000 triangles: by QSlim, reconstructed before, and by cells alone ({three['CVD(2)'][0].faces:,} triangles).", "--turn", "30", "--columns", "2", size="640x480")


def claims(page, all_meshes, spent, cells, cell_seconds, three, outlines, edges):
    each = lambda values, digits=2: "; ".join(f"{name} {' / '.join(f'{x:.{digits}f}' for x in row)}" for name, row in values.items())
    made = {mesh.stem: run(mesh, f"{QSLIM} --remesh=cvd:2", 1.0) for mesh in all_meshes}
    counts = {name: made_vertices(told) / told["wanted"] for name, result in made.items() for told in [result.told["remesh"][0]]}
    page.claim("The reconstructed mesh has slightly more vertices than before (here: more, and up to 10 % reaches it)", "4", "vertices ÷ before: " + "; ".join(f"{name} {x:.3f}" for name, x in counts.items()), [(x > 1, 1 < x <= 1.1) for x in counts.values()])
    density = {}
    for mesh in all_meshes:
        (a0, on0), (a1, on1) = shapes.flatness(mesh), shapes.flatness(made[mesh.stem].path)
        density[mesh.stem] = on1 * (1 - a1) / (a1 * (1 - on1)) / (on0 * (1 - a0) / (a0 * (1 - on0)))
    page.claim("Flat ground then holds far fewer points than detail (here: fewer than before, and half of them reaches it)", "figs. 1, 4", "density on flats ÷ off them, after ÷ before: " + "; ".join(f"{name} {x:.2f}" for name, x in density.items()), [(x < 1, x <= 0.5) for x in density.values()])
    free = {}
    for mesh in all_meshes:
        told = [run(mesh, f"{QSLIM} --remesh=cvd:{power}", 1.0).told["remesh"][0] for power in (0, 1, 2)]
        free[mesh.stem] = [max(one["wanted"] - one["cells"], 0) / one["wanted"] for one in told]
    page.claim("Free points grow with λ", "fig. 2", each(free), [a <= b for row in free.values() for a, b in zip(row, row[1:])])
    pairs = {(mesh.stem, removed): [run(mesh, system, faces_left(mesh, removed)) for system in (QSLIM, CVD)] for mesh in all_meshes for removed in REMOVED}
    mean = {mesh.stem: [errors(b)[1] / errors(a)[1] for removed in REMOVED for a, b in [pairs[mesh.stem, removed]]] for mesh in all_meshes}
    ratios = {name: over(made.collapse, plain.collapse) for name, (plain, made) in spent.items()}
    paper = {name: SECONDS[like][0] / SECONDS[like][1] for name, like in LIKE.items()}
    page.claim("The collapse takes 1.17 (Dalian), 1.23 (Pagoda), 1.02 (bunny) of QSlim's time", "table 2", "at 90 %: " + "; ".join(f"{name} {np.median(row):.2f} ({min(row):.2f} to {max(row):.2f})" for name, row in ratios.items()), [judged(lambda x: about(x, paper[name]), row) for name, row in ratios.items()])
    page.claim("QSlim has the least mean error", "fig. 3", "reconstructed ÷ QSlim at 50, 75, 90 and 95 %: " + each(mean), [x >= 1 for row in mean.values() for x in row])
    page.claim("The mean error is near QSlim's (here: from 75 % on, within 1.5 times)", "fig. 3", each({name: row[1:] for name, row in mean.items()}), [about(x, 1) for row in mean.values() for x in row[1:]])
    systems = ("CVD(2)", "ACVD")
    larger = {f"{mesh} {removed:.0%}": [errors(found[name])[1] / max(errors(found[other])[1] for other in ("reconstructed", "QSlim")) for name in systems] for (mesh, removed), found in cells.items()}
    page.claim("CVD(2) and ACVD have a larger mean error than both", "fig. 3", "CVD(2), ACVD ÷ the larger of both: " + each(larger), [x > 1 for row in larger.values() for x in row])
    longer = {f"{mesh} {removed:.0%}": [over(found[name], found["reconstructed"]) for name in systems] for (mesh, removed), found in cell_seconds.items()}
    page.claim("CVD(2) and ACVD take longer: 6.1 and 4.4 times as long (Dalian), 1.3 and 1.1 (Pagoda), 8.7 and 7.8 (bunny)", "table 2", "CVD(2), ACVD ÷ the collapse: " + each({name: map(np.median, row) for name, row in longer.items()}), [judged(lambda x: about(x, SECONDS[LIKE[mesh.removesuffix("-plain")]][at] / SECONDS[LIKE[mesh.removesuffix("-plain")]][0]), one) for mesh, removed in cell_seconds for one, at in zip(longer[f"{mesh} {removed:.0%}"], (3, 2))])
    lost = {mesh.stem: lost_flats(mesh, CVD) for mesh in all_meshes}
    of_qslim = {mesh.stem: lost_flats(mesh, QSLIM) for mesh in all_meshes}
    page.claim("Flats stay nearly the same from one level to the next (here: at most half of their area is lost)", "fig. 4", f"share of their area that is lost from level to level, the last two of four steps everywhere: {each(lost)}; from 100 to 75 % alone, against QSlim's: {'; '.join(f'{name} {row[0]:.2f} against {of_qslim[name][0]:.2f}' for name, row in lost.items())}", [x < 0.5 for row in lost.values() for x in row])
    falls = {mesh.stem: [errors(run(mesh, CVD, faces_left(mesh, b)))[1] / errors(run(mesh, CVD, faces_left(mesh, a)))[1] for a, b in zip(REMOVED, REMOVED[1:])] for mesh in all_meshes}
    page.claim("A coarser level sometimes has less error than a finer one", "fig. 3", "mean error ÷ that of the level before: " + each(falls), [any(x < 1 for row in falls.values() for x in row)])
    kinds = {name: (*found, from_outlines(edges, result)) for name, (result, found) in three.items()}
    page.claim("At 2,000 triangles the outlines of roofs are better than QSlim's", "fig. 5", f"mean distance from outlines {kinds['reconstructed'][2]:.2f} against {kinds['QSlim'][2]:.2f}, from buildings {kinds['reconstructed'][0]:.2f} against {kinds['QSlim'][0]:.2f}", [kinds["reconstructed"][at] < kinds["QSlim"][at] for at in (0, 2)])
    same = "reconstructed, as many as CVD(2)"
    page.claim("Gently uneven ground is not flattened as by CVD(2)", "fig. 5", f"mean distance from the green {kinds['reconstructed'][1]:.2f} with {three['reconstructed'][0].faces:,} triangles, {kinds[same][1]:.2f} with {three[same][0].faces:,}, against {kinds['CVD(2)'][1]:.2f} with {three['CVD(2)'][0].faces:,}", [kinds[name][1] < kinds["CVD(2)"][1] for name in ("reconstructed", same)])
    told = lambda row: " / ".join(f"{x:.3g}" for x in row)
    page.claim("Building edges are blunted by the reconstruction", "granted as a weakness", f"mean distance from the outlines of roofs after it and before any collapse, 1e-4 of the diagonal: {outlines['reconstructed'][0]:.3g} against {outlines['QSlim'][0]:.3g} of the mesh itself", [outlines["reconstructed"][0] > outlines["QSlim"][0]])
    page.question("Does the bluntness last once triangles are removed?", f"mean distance from the outlines at {', '.join(f'{x:.0%}' for x in REMOVED)} removed: {told(outlines['reconstructed'][1:])} against QSlim's {told(outlines['QSlim'][1:])}; with 2,000 triangles {kinds['reconstructed'][2]:.3g} against {kinds['QSlim'][2]:.3g}")
