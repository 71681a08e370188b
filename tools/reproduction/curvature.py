"""Quan et al. 2015: quadrics weighted by area and curvature."""

import numpy as np

from . import limbs, meshes
from .pages import Page
from .runs import FOLDER, SHARED, call, run

REMOVED = (0.2, 0.5, 0.8, 0.93)
AREA, CURVATURE = "curvature curvature=0", "curvature"
# Removal between which slopes are taken.
SLOPE = (0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8)


def write():
    page = Page("curvature", "Curvature and area", "Quan, Wu, Yang, Bai, Wang, Zhao, Wang, Wei, Hou: Improved QEM three-dimensional model simplification method. Patent CN105303614A, 2015/2016.")
    figures = {name: meshes.write_obj(FOLDER / f"{name}.obj", *make()) for name, make in limbs.FIGURES.items()}
    lathes = {"car": meshes.car(FOLDER / "car.obj"), "rotor": meshes.helicopter(FOLDER / "rotor.obj")}
    real = {path.stem: path for path in (SHARED / "repro" / "alligator.obj", SHARED / "repro" / "suzanne.obj", SHARED / "scans" / "igea.obj", SHARED / "scans" / "stanford-bunny.obj") if path.exists()}
    found = {name: Pair(mesh) for name, mesh in {**figures, **lathes, **real}.items()}
    claims(page, found, figures)
    page.head("Curvature over area")
    page.text("Errors by `curvature` ÷ errors by area alone (`curvature=0`), which differs in c alone; distances both ways. Slopes are those of a line through the errors from 20 to 80 % removed. *Figures* are generated: bodies with limbs, of evenly sized triangles; *lathes* are bodies of revolution with an antenna or blades.")
    rows = []
    for name, pair in found.items():
        kind = "figure" if name in figures else "lathe" if name in lathes else "model"
        rows.append([f"{kind}: {name}, {pair.triangles:,}", *(f"{pair.ratio(share, 0):.2f}" for share in REMOVED), f"{pair.slope(0):.2f}", *(f"{pair.ratio(share, 1):.2f}" for share in REMOVED), f"{pair.slope(1):.2f}"])
    page.table(["triangles", *(f"largest, {share:.0%}" for share in REMOVED), "slope", *(f"mean, {share:.0%}" for share in REMOVED), "slope"], rows)
    page.head("Beside our own metric")
    page.text("80 % removed: largest / mean distance in 1e-4 of the diagonal.")
    told = lambda result: " / ".join(f"{1e4 * result.distances()[k] / result.diagonal:.3g}" for k in (0, 1))
    page.table(["", "by area", "`curvature`", "`qem`"], [[name, *map(told, pair.at(0.8)), told(run(pair.mesh, "qem", 0.2))] for name, pair in found.items()])
    page.head("Thin parts")
    page.text("Vertices that are left on the antenna of the car (above 75 cm) and on the blades of the rotor (above 1.37 m): by area / by curvature.")
    page.table(["", *(f"{share:.0%} removed" for share in REMOVED)], [[name, *(f"{above(pair.at(share)[0], height)} / {above(pair.at(share)[1], height)}" for share in REMOVED)] for name, height in (("car", 0.75), ("rotor", 1.37)) for pair in [found[name]]])
    for name in [*figures, *lathes]:
        for share in SLOPE:
            for system, result in zip(("by area (curvature=0)", "curvature"), found[name].at(share)):
                page.note(f"{name}-max", system, 1 - share, result.distances()[0])
    for name in figures:
        page.plot(f"{name}-max", f"Generated {name}: largest distance", "triangles left, share", "largest distance", "Largest distance, both ways.")
    page.picture("figures", [result.path for name in figures for result in found[name].at(0.8)], "The figures with 20 % of their triangles: each by area alone, then by curvature and area.", "--tilt", "20", "--wire", size="300x300")
    page.picture("car", [result.path for result in found["car"].at(0.93)], "The car with 7 % of its triangles: by area alone, and by curvature and area.", "--tilt", "20", "--wire", size="480x360")
    page.save()


class Pair:
    """A mesh by area and by curvature."""

    def __init__(self, mesh):
        self.mesh = mesh
        self.triangles = self.at(0.5)[0].by_area["topology"]["before"]["faces"]

    def at(self, removed):
        return [run(self.mesh, system, round(1 - removed, 3)) for system in (AREA, CURVATURE)]

    def ratio(self, removed, column):
        area, curvature = (result.distances()[column] for result in self.at(removed))
        return curvature / area

    def slope(self, column):
        area, curvature = (np.polyfit(SLOPE, [self.at(share)[k].distances()[column] for share in SLOPE], 1)[0] for k in (0, 1))
        return curvature / area

    def popping(self):
        """Largest distance between one level and the next, by curvature ÷ by area."""
        def steps(k):
            levels = [self.at(share)[k].path for share in (0.2, 0.5, 0.8)]
            return [compare(*pair) for pair in zip(levels, levels[1:])]
        return [b / a for a, b in zip(steps(0), steps(1))]


def compare(fine, coarse):
    import json
    return json.loads(call("compare", fine, coarse, "--json", "-q", "--samples", "100000").stdout)["geometry"]["symmetric"]["max"]


def above(result, height):
    return sum(float(line.split()[3]) > height for line in result.path.open() if line.startswith("v "))


def claims(page, found, figures):
    each = lambda values: "; ".join(f"{name} {value:.2f}" for name, value in values.items())
    for share, limit, words in [(0.2, 1.25, "about equal"), (0.5, 1.0, "better"), (0.8, 0.8, "clearly better")]:
        ratios = {name: pair.ratio(share, 0) for name, pair in found.items()}
        page.claim(f"At {share:.0%} removed the Hausdorff distance is {words} (here: at most {limit} of the baseline's)", "embodiment, figs.", each(ratios), [value <= limit for value in ratios.values()])
    slopes = {name: pair.slope(0) for name, pair in found.items()}
    page.claim("The slope of the Hausdorff distance over the share removed is .25 of the baseline's: at least below it", "car", each(slopes), [value < 1 for value in slopes.values()])
    slopes = {name: pair.slope(1) for name, pair in found.items()}
    page.claim("The slope of the mean error is .42 of the baseline's: at least below it", "car", each(slopes), [value < 1 for value in slopes.values()])
    kept = [above(pair.at(share)[1], height) > above(pair.at(share)[0], height) for name, height in (("car", 0.75), ("rotor", 1.37)) for pair in [found[name]] for share in REMOVED]
    page.claim("Thin parts survive (antenna, rotor blades)", "car, helicopter", "more vertices are left on them, see below", kept)
    popping = {name: found[name].popping() for name in figures}
    page.claim("Levels of detail pop less", "advantages", "largest distance from one level to the next (20, 50, 80 % removed) ÷ baseline: " + "; ".join(f"{name} {' / '.join(f'{x:.2f}' for x in values)}" for name, values in popping.items()), [value < 1 for values in popping.values() for value in values])
    times = {name: pair.at(0.8)[1].cpu / pair.at(0.8)[0].cpu for name, pair in found.items()}
    page.claim("It takes longer than by area alone", "embodiment", "both compute the same here, but for c: " + each(times), [value > 1 for value in times.values()])
