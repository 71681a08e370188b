"""Quan et al. 2015: quadrics weighted by area and curvature."""

import json
from functools import cached_property

import numpy as np

from . import limbs, meshes, shapes
from .pages import Page, about, below, inner, judged
from .runs import FOLDER, SHARED, call, over, run, timed

REMOVED = (0.2, 0.5, 0.8, 0.93)
# Slopes are those of a line through the errors at these shares.
SLOPE = (0.2, 0.5, 0.8)
AREA, CURVATURE = "curvature curvature=0", "curvature"
# Triangles of a piece of a scan or a city.
PIECE = 20000
# The patent's own kind first; its claims are judged for each kind.
LIMBS, CLOSED, OPEN, FLAT_FACED = "figures with limbs, the patent's kind", "other closed meshes", "open meshes", "flat-faced meshes"
# A model is flat-faced where most of its edges bend by less than this, in degrees.
FLAT = 0.5


def write():
    page = Page("curvature", "Curvature and area", "Quan, Wu, Yang, Bai, Wang, Zhao, Wang, Wei, Hou: Improved QEM three-dimensional model simplification method. Patent CN105303614A, 2015/2016.")
    figures = {name: Pair(name, *make(), LIMBS) for name, make in limbs.FIGURES.items()}
    sized = {f"{name}, sized": Pair(f"{name}-sized", *finer(name, len(figures[name].faces)), LIMBS) for name in figures}
    car = meshes.car(FOLDER / "car.obj", lambda fine, triangles: shapes.triangles_of(run(fine, "qem", triangles).path))
    own = {path.stem: Pair(path.stem, *shapes.triangles_of(path), kind) for path, kind in ((car, LIMBS), (meshes.stick(FOLDER / "stick.obj"), CLOSED), (meshes.rotor(FOLDER / "rotor.obj"), CLOSED))}
    found = {**figures, **sized, **own, **models()}
    found = {name: pair for kind in (LIMBS, CLOSED, OPEN, FLAT_FACED) for name, pair in found.items() if pair.kind == kind}
    thin = thin_parts(figures, own)
    claims(page, found, figures, thin)
    page.head("Curvature over area")
    page.text(f"Errors by `curvature` ÷ errors by area alone (`curvature=0`), which differs in c alone; distances both ways. Each figure is the median of {meshes.ORDERS} runs ({meshes.ORDERS_OF_LARGE} of meshes above {meshes.LARGE:,} triangles) on the mesh turned about and shuffled, since the largest distance depends on the order of equal costs; in brackets the least and the most. Slopes are those of a line through the errors at 20, 50 and 80 % removed.")
    page.text(f"Figures with limbs are generated; quadruped, person and helicopter are of evenly sized triangles, the *sized* ones and the car have smaller triangles where they bend, made from a finer mesh by plain QEM. The car has a body with a cabin, wheels, mirrors and an antenna of 90 cm by 1 cm, and as many triangles as the patent's. The stick is an ellipsoid with one, the rotor a body with four blades of 5 m by 30 cm by 2 cm. Of the real models, suzanne, alligator, igea and the bunny are whole; statue, survey and city are pieces cut out of scans and of a set of city models. Of those that are not figures, one is *flat-faced* if most of its area lies where no edge bends by more than {FLAT}°, else *open* if it has borders.")
    kinds(page, found)
    told = lambda ratios: f"{short(np.median(ratios))} ({short(min(ratios))} to {short(max(ratios))})"
    page.table(["largest distance", "kind", *(f"{share:.0%} removed" for share in REMOVED), "slope"], [[f"{name}, {len(pair.faces):,} triangles", pair.kind, *(told(pair.ratios(share, 0)) for share in REMOVED), told(pair.slopes(0))] for name, pair in found.items()])
    page.table(["mean distance", *(f"{share:.0%} removed" for share in REMOVED), "slope"], [[name, *(told(pair.ratios(share, 1)) for share in REMOVED), told(pair.slopes(1))] for name, pair in found.items()])
    page.head("Beside our own metric")
    page.text("80 % removed: largest / mean distance in 1e-4 of the diagonal, of one run.")
    both = lambda result: " / ".join(f"{1e4 * result.distances()[k] / result.diagonal:.3g}" for k in (0, 1))
    page.table(["", "by area", "`curvature`", "`qem`"], [[name, *map(both, pair.at(0.8)), both(run(pair.paths[0], "qem", 0.2))] for name, pair in found.items()])
    page.head("Thin parts")
    page.text("The antenna of the car, the stick, the blades of the rotor and of the helicopter: mean distance from points on the part to the result in 1e-4 of the diagonal, by area / by curvature, medians of five runs on the mesh in five orders; below, vertices that are left on the part in the first of them. Area and curvature are weights of their own: more vertices on a part need not mean that it is nearer.")
    page.table(["", *(f"{share:.0%} removed" for share in REMOVED)], [[name, *(f"{np.median(a):.3g} / {np.median(b):.3g}" for a, b in part.distances)] for name, part in thin.items()])
    page.table(["vertices", *(f"{share:.0%} removed" for share in REMOVED)], [[name, *(" / ".join(map(str, pair)) for pair in part.vertices)] for name, part in thin.items()])
    for name in figures:
        for share in REMOVED:
            for system, result in zip(("by area (curvature=0)", "curvature"), figures[name].at(share)):
                page.note(f"{name}-max", system, 1 - share, result.distances()[0])
        page.plot(f"{name}-max", f"Generated {name}: largest distance", "triangles left, share", "largest distance", "Largest distance, both ways, of one run.")
    straight = {name: meshes.write_obj(FOLDER / f"{name}.obj", pair.vertices, pair.faces) for name, pair in figures.items()}
    for name, mesh in straight.items():
        page.picture(name, [run(mesh, system, 0.2).path for system in (AREA, CURVATURE)], f"The {name} with 20 % of its triangles: by area alone, and by curvature and area.", "--tilt", "20", "--wire", size="420x420")
    page.picture("car", [run(car, system, 0.25).path for system in (AREA, CURVATURE)], "The car with 25 % of its triangles: by area alone, and by curvature and area.", "--tilt", "20", "--turn", "30", "--wire", size="480x360")
    page.picture("rotor", [run(FOLDER / "rotor.obj", system, 0.07).path for system in (AREA, CURVATURE)], "The rotor with 7 % of its triangles: by area alone, and by curvature and area.", "--tilt", "20", "--wire", size="480x360")
    page.save()


def models():
    """Real models, and pieces of scans and of a city, as far as they are at hand."""
    whole = {path.stem: path for path in (SHARED / "repro" / "suzanne.obj", SHARED / "repro" / "alligator.obj", SHARED / "scans" / "igea.obj", SHARED / "scans" / "stanford-bunny.obj")}
    cut = {"statue": "cc_ahmetguner/cc_ahmetguner", "survey": "cc_cyanhabao/cc_cyanhabao", "city": "city_wageningen_3dbag/wageningen_3dbag"}
    pieces = {name: meshes.cut(FOLDER / f"{name}-piece.obj", path, PIECE, has_images=False) for name, stem in cut.items() if (path := SHARED / f"{stem}.obj").exists()}
    found = {}
    for name, path in {**whole, **pieces}.items():
        if path.exists():
            vertices, faces = shapes.triangles_of(path)
            found[name] = Pair(name, vertices, faces)
    return found


def kinds(page, found):
    """What each kind of mesh has."""
    rows = []
    for kind in dict.fromkeys(pair.kind for pair in found.values()):
        own = [pair for pair in found.values() if pair.kind == kind]
        middle = lambda value: short(np.median([np.median(value(pair)) for pair in own]))
        rows.append([kind, len(own), *(middle(lambda pair: pair.ratios(share, column)) for column in (0, 1) for share in REMOVED), *(middle(lambda pair: pair.slopes(column)) for column in (0, 1))])
    page.table(["median of", "meshes", *(f"{words}, {share:.0%}" for words in ("largest", "mean") for share in REMOVED), "slope, largest", "slope, mean"], rows)
    page.text("By area alone a flat-faced mesh loses next to nothing until few triangles are left, so that ratios there are large and say little. Where the error at 20 % is larger than the baseline's, a slope below 1 says that it began higher, not that it grows more slowly; such meshes are left out of the claims on slopes.")


def short(x):
    return f"{x:.2f}" if abs(x) < 100 else f"{x:,.0f}"


def finer(name, triangles):
    """A figure whose triangles are small where it bends: a mesh of four times as many, thinned."""
    mesh = meshes.write_obj(FOLDER / f"{name}-fine.obj", *limbs.FIGURES[name](2 * limbs.CELLS[name]))
    return shapes.triangles_of(run(mesh, "qem", triangles).path)


class Pair:
    """A mesh by area and by curvature, turned about and shuffled several times."""

    def __init__(self, name, vertices, faces, kind=None):
        self.name, self.vertices, self.faces, self.given = name, vertices, faces, kind
        self.shuffles = meshes.ORDERS if len(faces) < meshes.LARGE else meshes.ORDERS_OF_LARGE

    @cached_property
    def kind(self):
        if self.given:
            return self.given
        flat, area = shapes.flat_faces(self.vertices, self.faces, FLAT)
        if area[flat].sum() > 0.5 * area.sum():
            return FLAT_FACED
        return OPEN if self.at(REMOVED[0])[0].by_area["topology"]["before"]["boundary_edges"] > 0 else CLOSED

    @cached_property
    def paths(self):
        return [meshes.shuffled(FOLDER / f"{self.name}-{seed}.obj", self.vertices, self.faces, seed) for seed in range(self.shuffles)]

    def at(self, removed, shuffle=0):
        return [run(self.paths[shuffle], system, round(1 - removed, 3)) for system in (AREA, CURVATURE)]

    def errors(self, removed, shuffle, column):
        return [result.distances()[column] for result in self.at(removed, shuffle)]

    def ratios(self, removed, column):
        return [curvature / area for area, curvature in (self.errors(removed, shuffle, column) for shuffle in range(self.shuffles))]

    def slopes(self, column):
        lines = [np.polyfit(SLOPE, [self.errors(share, shuffle, column) for share in SLOPE], 1)[0] for shuffle in range(self.shuffles)]
        return [curvature / area for area, curvature in lines]

    def popping(self):
        """Largest distance between one level and the next, by curvature ÷ by area: of each step the shuffles."""
        steps = []
        for fine, coarse in zip(SLOPE, SLOPE[1:]):
            pairs = [zip(self.at(fine, shuffle), self.at(coarse, shuffle)) for shuffle in range(self.shuffles)]
            steps.append([largest(*by_curvature) / largest(*by_area) for by_area, by_curvature in pairs])
        return steps


def largest(fine, coarse):
    told = lambda: json.loads(call("compare", fine.path, coarse.path, "--json", "-q", "--samples", "100000").stdout)["geometry"]["symmetric"]["max"]
    return coarse.kept(f"from-{fine.path.stem}", told)


def thin_parts(figures, own):
    """The antenna, the stick and the blades."""
    rod, triangles = meshes.antenna()
    antenna = meshes.write_obj(FOLDER / "car-antenna.obj", rod, triangles)
    is_antenna = lambda x, y, z: (z > 1.42) & (x < -0.7)
    is_stick = lambda x, y, z: z > 0.75
    is_blade = lambda x, y, z: z > 1.37
    is_wing = lambda x, y, z: (z > 0.92) & (np.hypot(x - 0.2, y) > 0.12) & ~((x < -0.7) & (abs(y) < 0.2))
    part = lambda name, pair, holds: meshes.part_where(FOLDER / f"{name}-thin.obj", pair.vertices, pair.faces, holds)
    straight = meshes.write_obj(FOLDER / "helicopter.obj", figures["helicopter"].vertices, figures["helicopter"].faces)
    return {
        "car, antenna": Thin(FOLDER / "car.obj", antenna, is_antenna),
        "stick": Thin(FOLDER / "stick.obj", part("stick", own["stick"], is_stick), is_stick),
        "rotor, blades": Thin(FOLDER / "rotor.obj", part("rotor", own["rotor"], is_blade), is_blade),
        "helicopter, blades": Thin(straight, part("helicopter", figures["helicopter"], is_wing), is_wing),
    }


class Thin:
    """A thin part of a mesh, at each share removed by area and by curvature."""

    def __init__(self, mesh, part, holds):
        runs = [[[run(path, system, round(1 - share, 3)) for path in meshes.orders(mesh)] for system in (AREA, CURVATURE)] for share in REMOVED]
        self.distances = [[[self.distance(part, result) for result in results] for results in pair] for pair in runs]
        self.vertices = [[self.count(holds, results[0]) for results in pair] for pair in runs]

    def distance(self, part, result):
        """Mean distance from points on the part to a result, in 1e-4 of the diagonal."""
        told = lambda: json.loads(call("compare", part, result.path, "--json", "-q", "--samples", "20000").stdout)["geometry"]["backward"]["mean"]
        return 1e4 * result.kept("thin", told) / result.diagonal

    def count(self, holds, result):
        vertices, _ = shapes.triangles_of(result.path)
        return int(holds(*vertices.T).sum())


def claims(page, found, figures, thin):
    each = lambda values: "; ".join(f"{name} {short(np.median(value))}" for name, value in values.items())
    grades = {0.2: ("about equal", lambda x: about(x, 1)), 0.5: ("better", lambda x: x < 1), 0.8: ("clearly better (here: at most 0.8 reaches it)", lambda x: (x < 1, x <= 0.8))}
    timed_at = dict(zip(found, times_of(found)))
    for kind in dict.fromkeys(pair.kind for pair in found.values()):
        own = {name: pair for name, pair in found.items() if pair.kind == kind}
        for share, (words, holds) in grades.items():
            ratios = {name: pair.ratios(share, 0) for name, pair in own.items()}
            page.claim(f"At {share:.0%} removed the Hausdorff distance is {words}", "embodiment, figures", each(ratios), [judged(holds, value) for value in ratios.values()], of=kind)
        for column, paper, words in [(0, 0.25, "Hausdorff distance"), (1, 0.42, "mean error")]:
            level = {name: pair.slopes(column) for name, pair in own.items() if not all(x > 1 for x in inner(pair.ratios(SLOPE[0], column)))}
            told = f"of {len(level)} of {len(own)} whose error at 20 % is not clearly larger already: {each(level)}"
            page.claim(f"The {words} grows more slowly: its slope over the share removed is {paper} of the baseline's on the car", "embodiment, the car", told if level else "", [judged(lambda x: below(x, paper), value) for value in level.values()] if level else "the error at 20 % removed is larger already on all of them", of=kind)
        if kind == LIMBS:
            shown = {name: [f"{np.median(a):.3g} → {np.median(b):.3g}" for a, b in part.distances] for name, part in thin.items()}
            page.claim("Thin parts survive (antenna, rotor blades)", "embodiment", "mean distance from them in 1e-4 of the diagonal, by area → by curvature, at 20, 50, 80 and 93 % removed: " + "; ".join(f"{name} {', '.join(row)}" for name, row in shown.items()), [judged(lambda x: x < 1, over(b, a)) for part in thin.values() for a, b in part.distances], of=kind)
            popping = {name: pair.popping() for name, pair in figures.items()}
            page.claim("Levels of detail pop less", "advantages", "largest distance from one level to the next (20, 50, 80 % removed) ÷ baseline: " + "; ".join(f"{name} {' / '.join(f'{np.median(x):.2f}' for x in values)}" for name, values in popping.items()), [judged(lambda x: x < 1, value) for values in popping.values() for value in values], of=kind)
        seconds = {name: timed_at[name] for name in own}
        page.claim("It takes longer than by area alone", "embodiment", "user time at 80 % removed ÷ that of `qem-1997` (÷ that of `curvature=0`, which computes all that the metric does, so that it differs in c alone): " + "; ".join(f"{name} {np.median(over(c, a)):.2f} ({np.median(over(c, b)):.2f})" for name, (a, b, c) in seconds.items()), [judged(lambda x: x > 1, over(c, a)) for a, _, c in seconds.values()], of=kind)


def times_of(found):
    """User time of plain QEM, by area and by curvature."""
    spent = timed([(pair.paths[0], system, 0.2) for pair in found.values() for system in ("qem-1997", AREA, CURVATURE)])
    return [[spent[3 * at + k].user for k in range(3)] for at in range(len(found))]
