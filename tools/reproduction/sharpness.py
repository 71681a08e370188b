"""Li, Jiang, Tang 2020: sharpness, texture and local optimisation."""

import json

import numpy as np

from . import limbs, meshes, oblique
from .pages import Page, about, gain, judged
from .runs import FOLDER, SHARED, call, over, run, timed

BASE = "qem-1997 placement=three guards=0"
SYSTEMS = [BASE, "qem-1997 placement=three", "qem-1997", "sharpness", "sharpness --optimize", "sharpness sigma=0", "sharpness texture=0"]
# Around, rings, share that is left; mean r, RMS (1e-2) and ms of QEM, of Liu Jun and of the paper.
FIGURES = {
    "pigeon": (60, 100, 0.2, [(0.5918, 0.0347, 187), (0.6123, 0.0812, 368), (0.6531, 0.0848, 391)]),
    "dog": (80, 120, 0.15, [(0.5932, 0.0893, 281), (0.6038, 0.2068, 326), (0.6234, 0.1926, 313)]),
    "fish": (90, 140, 0.15, [(0.4695, 0.0281, 375), (0.4867, 0.0693, 406), (0.5092, 0.0627, 438)]),
}

# Figures for the paper's pictures: a person of 4,019 triangles at 60 % and a zombie of 12,686 at 65 %.
EYES, TIE = ("eyes", 40, 52, 0.4), ("tie", 78, 83, 0.35)
NO_SIGMA, NO_TEXTURE = "sharpness sigma=0", "sharpness texture=0"


def write():
    page = Page("sharpness", "Sharpness and local optimisation", "Li, Jiang, Tang: High-quality simplified algorithm of texture model for detailed features preserving. Application Research of Computers 37(1), 2020.")
    figures = {name: meshes.figure(FOLDER / f"{name}.obj", around, rings, len(name)) for name, (around, rings, _, _) in FIGURES.items()}
    found = {name: {system: run(mesh, system, FIGURES[name][2]) for system in SYSTEMS} for name, mesh in figures.items()}
    spent = timed([(mesh, system, FIGURES[name][2]) for name, mesh in figures.items() for system in SYSTEMS])
    seconds = {name: {system: spent.pop(0).user for system in SYSTEMS} for name in figures}
    limbed = {name: meshes.write_obj(FOLDER / f"{name}.obj", *make()) for name, make in limbs.FIGURES.items()}
    real = {path.stem: path for path in (SHARED / "scans" / "igea.obj", SHARED / "scans" / "stanford-bunny.obj") if path.exists()}
    painted = {name: (meshes.figure(FOLDER / f"{name}.obj", around, rings, len(name)), share) for name, around, rings, share in (EYES, TIE)}
    knife = meshes.person_with_knife(FOLDER / "knife.obj")
    surveys = oblique.surveys_of()
    claims(page, found, seconds, figures, limbed, painted, knife, surveys)
    page.head("The paper's table")
    page.text("Mean regularity r (1 is equilateral), RMS distance, milliseconds. Its QEM, the baseline of all ratios here, places vertices at the best of both ends and the middle, and checks nothing. Liu Jun's method, the middle column, is in no paper that we have and is not implemented.")
    page.table(["r / RMS (1e-2) / ms", "QEM", "Liu Jun", "the paper", "r ÷ QEM", "RMS ÷ QEM"], [[f"{name}, {1 - share:.0%} removed", *(f"{r} / {rms} / {ms}" for r, rms, ms in paper), f"{paper[2][0] / paper[0][0]:.3f}", f"{paper[2][1] / paper[0][1]:.2f}"] for name, (_, _, share, paper) in FIGURES.items()])
    page.head("Here")
    page.text("Generated figures with a texture: a belly, a neck, a head with a beak, and a seam down the back. RMS in 1e-4 of the diagonal, both ways; slivers have r below .5. User time with reading and writing, over QEM's: the median of five runs in shuffled order, the least and the most in brackets.")
    rows = []
    for name, systems in found.items():
        base = systems[BASE]
        for system, result in systems.items():
            rows.append([name, f"`{system}`", result.quality["regularity_mean"], f"{result.quality['regularity_mean'] / base.quality['regularity_mean']:.3f}", 1e4 * result.distances()[2] / result.diagonal, f"{result.distances()[2] / base.distances()[2]:.2f}", f"{result.quality['sliver_share']:.1%}", result.texture["colour_rms"], result.mirrored, spread(over(seconds[name][system], seconds[name][BASE]))])
    page.table(["figure", "system", "r", "÷ QEM", "RMS", "÷ QEM", "slivers", "colour RMS", "turned over", "time ÷ QEM"], rows)
    page.head("Figures with limbs, and models")
    page.text("80 % removed; largest / RMS distance in 1e-4 of the diagonal. On bodies with creases between large flat faces local optimisation moves vertices off the creases: the area-weighted σ of a vertex there may be below .3.")
    told = lambda result: " / ".join(f"{1e4 * result.distances()[k] / result.diagonal:.3g}" for k in (0, 2))
    rows = []
    for name, mesh in {**limbed, **real, "box with rounded edges": meshes.bevelled_box(FOLDER / "bevelled-box.obj")}.items():
        base, plain, smooth = (run(mesh, system, 0.2) for system in (BASE, "sharpness", "sharpness --optimize"))
        has_error = smooth.distances()[2] < 1e6 * base.distances()[2]
        times = [f"{smooth.distances()[k] / other.distances()[k]:.1f}" if has_error else "their error is none" for k, other in ((2, base), (2, plain), (0, plain))]
        rows.append([name, told(base), told(plain), told(smooth), *times, f"{smooth.quality['regularity_mean'] / plain.quality['regularity_mean']:.3f}"])
    page.table(["", "QEM", "`sharpness`", "`sharpness --optimize`", "its RMS ÷ QEM", "its RMS ÷ `sharpness`", "its largest ÷ `sharpness`", "its r ÷ `sharpness`"], rows)
    page.head("What local optimisation costs")
    page.text("`sharpness --optimize` ÷ `sharpness`, which it follows: RMS / largest distance / slivers / mean r. The more triangles are left, the more it costs, since it moves vertices off the surface by about as much whatever the error was before.")
    shares = (0.5, 0.3, 0.2, 0.1, 0.05)
    values = (lambda x: x.distances()[2], lambda x: x.distances()[0], lambda x: x.quality["sliver_share"], lambda x: x.quality["regularity_mean"])
    page.table(["", *(f"{1 - share:.0%} removed" for share in shares)], [[name, *(" / ".join(f"{value(run(mesh, 'sharpness --optimize', share)) / value(run(mesh, 'sharpness', share)):.2f}" for value in values) for share in shares)] for name, mesh in figures.items()])
    for share in (0.5, 0.3, 0.2, 0.1, 0.05):
        for system in (BASE, "sharpness", "sharpness --optimize"):
            result = run(figures["fish"], system, share)
            page.note("rms", system, share, 1e4 * result.distances()[2] / result.diagonal)
            page.note("slivers", system, share, result.quality["sliver_share"])
    page.plot("rms", "Generated fish: error", "triangles left, share", "RMS, 1e-4 of the diagonal", "Root mean square distance, both ways.")
    page.plot("slivers", "Generated fish: slivers", "triangles left, share", "share of triangles with r < 0.5", "Slivers by the number of triangles that are left.")
    page.picture("optimised", [found["pigeon"][system].path for system in (BASE, "sharpness", "sharpness --optimize")], "The pigeon with a fifth of its triangles: by QEM at the best of three places, by `sharpness` before local optimisation, and after it.", "--tilt", "10", "--wire", size="360x520")
    survey_table(page, surveys)
    details(page, painted, knife)
    page.save()


def survey_table(page, surveys):
    if not surveys:
        return
    page.head("The texture factor on surveys")
    page.text(f"The two pieces of {oblique.TRIANGLES:,} triangles with their images: RMS of the difference of colours (of 255) / RMS distance in mm, both ways.")
    rows = [[mesh.stem, f"`{system}`", *(f"{result.texture['colour_rms']:.2f} / {1e3 * result.distances()[2]:.1f}{'' if result.faces <= 1.02 * round((1 - removed) * oblique.TRIANGLES) else f' ({result.faces:,} triangles)'}" for removed, result in zip(oblique.REMOVED, on_survey(mesh, system)))] for mesh in surveys for system in ("sharpness", NO_TEXTURE, "qem-1997 placement=three")]
    page.table(["", "", *oblique.HEAD[1:]], rows)


def on_survey(mesh, system):
    return [run(mesh, system, round(1 - removed, 2), "--seams", "follow") for removed in oblique.REMOVED]


def details(page, painted, knife):
    page.head("The paper's figures 7 and 8")
    count_of = lambda mesh, share: run(mesh, "sharpness", share).by_area["topology"]["before"]["faces"]
    counts = {**{name: count_of(mesh, share) for name, (mesh, share) in painted.items()}, "knife": count_of(knife, 0.4)}
    page.text(f"The paper shows a person of 4,019 triangles with 60 % removed (the knife in its hand goes without σ, the eyes deform without R) and a zombie of 12,686 with 65 % removed (the tie garbles without either). Here: a painted figure of {counts['eyes']:,} triangles with 60 % removed, one of {counts['tie']:,} with 65 % removed, and a person with a knife of {counts['knife']:,} triangles with 60 % removed and more.")
    views = {"eyes": "-0.08,0.35,2.1,0.5", "tie": "-0.06,0.35,1.62,0.4"}
    for name, (mesh, share) in painted.items():
        systems = ("sharpness", NO_TEXTURE, "sharpness sigma=0 texture=0", BASE)
        results = [run(mesh, system, share) for system in systems]
        page.table([f"{name}, {1 - share:.0%} removed", *(f"`{system}`" for system in systems)], [["colour RMS", *(result.texture["colour_rms"] for result in results)], ["RMS distance, 1e-4 of the diagonal", *(1e4 * result.distances()[2] / result.diagonal for result in results)]])
        page.picture(name, [mesh, *(result.path for result in results)], f"The {name}, {1 - share:.0%} of the triangles removed: before, by `sharpness`, without R, without R and σ, by QEM. By eye there is no difference.", "--turn", "189", "--tilt", "8", f"--near={views[name]}", size="330x330")
    shares = (0.4, 0.2, 0.1)
    page.text("The knife: vertices left on its blade / mean distance from the blade to the result in 1e-4 of the diagonal.")
    page.table(["", *(f"{1 - share:.0%} removed" for share in shares)], [[f"`{system}`", *(" / ".join(f"{x:.3g}" for x in on_knife(knife, run(knife, system, share))) for share in shares)] for system in ("sharpness", NO_SIGMA, BASE)])
    page.picture("knife", [knife, *(run(knife, system, share).path for share in (0.4, 0.1) for system in ("sharpness", NO_SIGMA))], "The knife: before, with 40 % of the triangles with and without σ, with 10 % with and without σ.", "--turn", "0", "--tilt", "20", "--near=0.25,0.6,0.97,0.25", "--wire", size="330x330")


def on_knife(knife, result):
    """Vertices that are left on the blade, and the mean distance from the blade to the result, in 1e-4 of the diagonal."""
    def measure():
        blade = meshes.blade(FOLDER / "blade.obj")
        told = json.loads(call("compare", blade, result.path, "--json", "-q", "--samples", "50000").stdout)["geometry"]
        return 1e4 * told["backward"]["mean"] / result.diagonal

    points = [[float(x) for x in line.split()[1:4]] for line in result.path.open() if line.startswith("v ")]
    return sum(x > 0.26 and abs(y - 0.58) < 0.05 and z > 0.9 for x, y, z in points), result.kept("blade", measure)


def claims(page, found, seconds, figures, limbed, painted, knife, surveys):
    ratio = lambda name, system, value: value(found[name][system]) / value(found[name][BASE])
    r, rms, slivers = (lambda x: x.quality["regularity_mean"]), (lambda x: x.distances()[2]), (lambda x: x.quality["sliver_share"])
    smooth, plain = ({name: {value: ratio(name, system, value) for value in (r, rms, slivers)} for name in found} for system in ("sharpness --optimize", "sharpness"))
    paper = {name: [ours / base for ours, base in zip(rows[2], rows[0])] for name, (_, _, _, rows) in FIGURES.items()}
    told = lambda values, by, digits=2: ", ".join(f"{name} {values[name][by]:.{digits}f}" for name in values)
    theirs = lambda column, digits=2: " / ".join(f"{row[column]:.{digits}f}" for row in paper.values())
    page.claim(f"Mean r is {theirs(0, 3)} of QEM's", "table 1", told(smooth, r, 3), [gain(smooth[name][r], paper[name][0]) for name in smooth])
    page.claim(f"The RMS distance is {theirs(1)} of QEM's", "table 1", told(smooth, rms), [about(smooth[name][rms], paper[name][1]) for name in smooth])
    page.claim("That comes from the local optimisation: without it the error is QEM's", "3", told(plain, rms), [about(plain[name][rms], 1) for name in plain])
    page.claim("Without local optimisation there are more slivers than with QEM", "fish", told(plain, slivers) + " of QEM's", [plain["fish"][slivers] > 1])
    times = {name: over(row["sharpness --optimize"], row[BASE]) for name, row in seconds.items()}
    page.claim(f"It takes {theirs(2)} of QEM's time", "table 1", ", ".join(f"{name} {spread(row)}" for name, row in times.items()), [judged(lambda x: about(x, paper[name][2]), row) for name, row in times.items()])
    sizes = {name: of_orders(mesh, 0.4, NO_SIGMA, lambda result: result.distances()[0]) for name, mesh in limbed.items()}
    blades = {f"{1 - share:.0%}": of_orders(knife, share, NO_SIGMA, lambda result: on_knife(knife, result)[1]) for share in (0.4, 0.2, 0.1)}
    told = lambda values: ", ".join(f"{name} {spread(row)}" for name, row in values.items())
    larger = lambda values: [judged(lambda x: x > 1, row) for row in values.values()]
    page.claim("Without σ small protruding parts go (a knife at 60 %)", "fig. 7", f"largest distance without σ ÷ with it at 60 %: {told(sizes)}; mean distance from a knife's blade: {told(blades)}", larger(sizes) + larger(blades))
    colour = lambda result: result.texture["colour_rms"]
    colours = {name: of_orders(mesh, share, NO_TEXTURE, colour) for name, mesh, share in [*((name, mesh, FIGURES[name][2]) for name, mesh in figures.items()), *((name, *one) for name, one in painted.items())]}
    for mesh in surveys:
        colours |= {f"{mesh.stem} {removed:.0%}": of_orders(mesh, round(1 - removed, 2), NO_TEXTURE, colour, "--seams", "follow") for removed in oblique.REMOVED}
    page.claim("Without R painted detail deforms (eyes at 60 %, a tie at 65 %)", "figs. 7, 8", f"RMS of colours without R ÷ with it; of the figures, eyes and tie are all that is painted: {told(colours)}", larger(colours))


def of_orders(mesh, share, without, value, *options):
    """A figure without a factor ÷ with it, of the mesh in each order."""
    return [value(run(path, without, share, *options)) / value(run(path, "sharpness", share, *options)) for path in meshes.orders(mesh)]


def spread(values):
    return f"{np.median(values):.2f} ({min(values):.2f} to {max(values):.2f})"
