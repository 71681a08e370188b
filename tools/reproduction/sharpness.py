"""Li, Jiang, Tang 2020: sharpness, texture and local optimisation."""

from . import limbs, meshes
from .pages import Page
from .runs import FOLDER, SHARED, run

BASE = "qem-1997 placement=three guards=0"
SYSTEMS = [BASE, "qem-1997 placement=three", "qem-1997", "sharpness", "sharpness --optimize", "sharpness sigma=0", "sharpness texture=0"]
# Around, rings, share that is left; mean r, RMS (1e-2) and ms of QEM, of Liu Jun and of the paper.
FIGURES = {
    "pigeon": (60, 100, 0.2, [(0.5918, 0.0347, 187), (0.6123, 0.0812, 368), (0.6531, 0.0848, 391)]),
    "dog": (80, 120, 0.15, [(0.5932, 0.0893, 281), (0.6038, 0.2068, 326), (0.6234, 0.1926, 313)]),
    "fish": (90, 140, 0.15, [(0.4695, 0.0281, 375), (0.4867, 0.0693, 406), (0.5092, 0.0627, 438)]),
}


def write():
    page = Page("sharpness", "Sharpness and local optimisation", "Li, Jiang, Tang: High-quality simplified algorithm of texture model for detailed features preserving. Application Research of Computers 37(1), 2020.")
    figures = {name: meshes.figure(FOLDER / f"{name}.obj", around, rings, len(name)) for name, (around, rings, _, _) in FIGURES.items()}
    found = {name: {system: run(mesh, system, FIGURES[name][2]) for system in SYSTEMS} for name, mesh in figures.items()}
    limbed = {name: meshes.write_obj(FOLDER / f"{name}.obj", *make()) for name, make in limbs.FIGURES.items()}
    real = {path.stem: path for path in (SHARED / "scans" / "igea.obj", SHARED / "scans" / "stanford-bunny.obj") if path.exists()}
    claims(page, found, figures, limbed)
    page.head("The paper's table")
    page.text("Mean regularity r (1 is equilateral), RMS distance, milliseconds. Its QEM, the baseline of all ratios here, places vertices at the best of both ends and the middle, and checks nothing. Liu Jun's method, the middle column, is in no paper that we have and is not implemented.")
    page.table(["r / RMS (1e-2) / ms", "QEM", "Liu Jun", "the paper", "r ÷ QEM", "RMS ÷ QEM"], [[f"{name}, {1 - share:.0%} removed", *(f"{r} / {rms} / {ms}" for r, rms, ms in paper), f"{paper[2][0] / paper[0][0]:.3f}", f"{paper[2][1] / paper[0][1]:.2f}"] for name, (_, _, share, paper) in FIGURES.items()])
    page.head("Here")
    page.text("Generated figures with a texture: a belly, a neck, a head with a beak, and a seam down the back. RMS in 1e-4 of the diagonal, both ways; slivers have r below .5.")
    rows = []
    for name, systems in found.items():
        base = systems[BASE]
        for system, result in systems.items():
            rows.append([name, f"`{system}`", result.quality["regularity_mean"], f"{result.quality['regularity_mean'] / base.quality['regularity_mean']:.3f}", 1e4 * result.distances()[2] / result.diagonal, f"{result.distances()[2] / base.distances()[2]:.2f}", f"{result.quality['sliver_share']:.1%}", result.texture["colour_rms"], result.mirrored, f"{result.cpu / base.cpu:.2f}"])
    page.table(["figure", "system", "r", "÷ QEM", "RMS", "÷ QEM", "slivers", "colour RMS", "turned over", "CPU ÷ QEM"], rows)
    page.head("Figures with limbs, and models")
    page.text("80 % removed; largest / RMS distance in 1e-4 of the diagonal. On bodies with creases between large flat faces local optimisation moves vertices off the creases: the area-weighted σ of a vertex there may be below .3.")
    told = lambda result: " / ".join(f"{1e4 * result.distances()[k] / result.diagonal:.3g}" for k in (0, 2))
    rows = []
    for name, mesh in {**limbed, **real, "box with rounded edges": meshes.bevelled_box(FOLDER / "bevelled-box.obj")}.items():
        base, plain, smooth = (run(mesh, system, 0.2) for system in (BASE, "sharpness", "sharpness --optimize"))
        times = smooth.distances()[2] / base.distances()[2]
        rows.append([name, told(base), told(plain), told(smooth), f"{times:.1f}" if times < 1e6 else "its error is none", f"{smooth.quality['regularity_mean'] / base.quality['regularity_mean']:.3f}"])
    page.table(["", "QEM", "`sharpness`", "`sharpness --optimize`", "its RMS ÷ QEM", "its r ÷ QEM"], rows)
    for share in (0.5, 0.3, 0.2, 0.1, 0.05):
        for system in (BASE, "sharpness", "sharpness --optimize"):
            result = run(figures["fish"], system, share)
            page.note("rms", system, share, 1e4 * result.distances()[2] / result.diagonal)
            page.note("slivers", system, share, result.quality["sliver_share"])
    page.plot("rms", "Generated fish: error", "triangles left, share", "RMS, 1e-4 of the diagonal", "Root mean square distance, both ways.")
    page.plot("slivers", "Generated fish: slivers", "triangles left, share", "share of triangles with r < 0.5", "Slivers by the number of triangles that are left.")
    page.picture("optimised", [found["pigeon"][system].path for system in (BASE, "sharpness", "sharpness --optimize")], "The pigeon with a fifth of its triangles: by QEM at the best of three places, by `sharpness` before local optimisation, and after it.", "--tilt", "10", "--wire", size="360x520")
    page.picture("person", [run(limbed["person"], system, 0.4).path for system in ("sharpness sigma=0", "sharpness")], "A person with 40 % of its triangles: without and with the sharpness σ.", "--tilt", "10", "--wire", size="360x520")
    page.save()


def claims(page, found, figures, limbed):
    ratio = lambda name, system, value: value(found[name][system]) / value(found[name][BASE])
    r, rms, slivers, cpu = (lambda x: x.quality["regularity_mean"]), (lambda x: x.distances()[2]), (lambda x: x.quality["sliver_share"]), (lambda x: x.cpu)
    smooth, plain = ({name: {value: ratio(name, system, value) for value in (r, rms, slivers, cpu)} for name in found} for system in ("sharpness --optimize", "sharpness"))
    told = lambda values, by: ", ".join(f"{name} {values[name][by]:.2f}" for name in values)
    page.claim("Mean r is 5 to 10 % above QEM's (within rounding: from 1.045 on)", "table 1", ", ".join(f"{name} {smooth[name][r]:.3f}" for name in smooth), [smooth[name][r] >= 1.045 for name in smooth])
    page.claim("The RMS distance is 2.2 to 2.4 times QEM's (here: 2 to 2.75)", "table 1", told(smooth, rms), [2 <= smooth[name][rms] <= 2.75 for name in smooth])
    page.claim("That comes from the local optimisation: without it the error is QEM's (here: within 15 %)", "3", told(plain, rms), [plain[name][rms] < 1.15 for name in plain])
    page.claim("Without local optimisation there are more slivers than with QEM", "fish", told(plain, slivers) + " of QEM's", [plain["fish"][slivers] > 1])
    page.claim("It takes 1.1 to 2.1 times as long", "table 1", told(smooth, cpu), [1.0 <= smooth[name][cpu] <= 2.1 for name in smooth])
    sizes = {name: [run(mesh, system, 0.4).distances()[0] for system in ("sharpness sigma=0", "sharpness")] for name, mesh in limbed.items()}
    page.claim("Without σ small protruding parts go (a knife at 60 %)", "fig. 7", "largest distance without σ ÷ with it: " + ", ".join(f"{name} {a / b:.2f}" for name, (a, b) in sizes.items()), [a > 1.1 * b for a, b in sizes.values()])
    colours = {name: [run(mesh, system, share).texture["colour_rms"] for system in ("sharpness texture=0", "sharpness")] for name, mesh in figures.items() for share in [FIGURES[name][2]]}
    page.claim("Without R painted detail deforms (eyes at 60 %, a tie at 65 %)", "figs. 7, 8", "RMS of colours without R ÷ with it, where the eyes and the tie are all that is painted: " + ", ".join(f"{name} {a / b:.2f}" for name, (a, b) in colours.items()), [a > 1.03 * b for a, b in colours.values()])
