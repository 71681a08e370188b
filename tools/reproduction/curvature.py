"""Quan et al. 2015: quadrics weighted by area and curvature."""

import json
from functools import cached_property

import numpy as np

from . import limbs, meshes, shapes
from .pages import WITHIN, Page, below
from .runs import FOLDER, SHARED, call, run

REMOVED = (0.2, 0.5, 0.8, 0.93)
# Slopes are those of a line through the errors at these shares.
SLOPE = (0.2, 0.5, 0.8)
AREA, CURVATURE = "curvature curvature=0", "curvature"
# Times that a mesh is turned about and its order shuffled: the largest distance depends on both.
SHUFFLES = 5
# Triangles of a piece of a scan or a city.
PIECE = 20000
# A model is flat-faced where most of its edges bend by less than this, in degrees.
FLAT = 0.5


def write():
    page = Page("curvature", "Curvature and area", "Quan, Wu, Yang, Bai, Wang, Zhao, Wang, Wei, Hou: Improved QEM three-dimensional model simplification method. Patent CN105303614A, 2015/2016.")
    figures = {name: Pair(name, *make()) for name, make in limbs.FIGURES.items()}
    sized = {f"{name}, sized": Pair(f"{name}-sized", *shapes.triangles_of(finer(name, len(figures[name].faces)))) for name in figures}
    lathes = {path.stem: Pair(path.stem, *shapes.triangles_of(path)) for path in (meshes.car(FOLDER / "car.obj"), meshes.helicopter(FOLDER / "rotor.obj"))}
    found = {**figures, **sized, **lathes, **models()}
    claims(page, found, figures, lathes)
    page.head("Curvature over area")
    page.text(f"Errors by `curvature` ÷ errors by area alone (`curvature=0`), which differs in c alone; distances both ways. Each figure is the median of {SHUFFLES} runs (3 of meshes above 15,000 triangles) on the mesh turned about and shuffled, since the largest distance depends on the order of equal costs; in brackets the least and the most. Slopes are those of a line through the errors at 20, 50 and 80 % removed.")
    page.text(f"Figures are generated bodies with limbs, of evenly sized triangles; *sized* ones have smaller triangles where they bend, made from a finer mesh by plain QEM. Car and rotor are bodies of revolution. Of the real models, suzanne, alligator, igea and the bunny are whole; statue, survey and city are pieces cut out of scans and of a set of city models. A model is *open* if it has borders, and *flat-faced* if most of its area lies where no edge bends by more than {FLAT}°.")
    kinds(page, found)
    told = lambda ratios: f"{short(np.median(ratios))} ({short(min(ratios))} to {short(max(ratios))})"
    page.table(["largest distance", *(f"{share:.0%} removed" for share in REMOVED), "slope"], [[f"{name}, {len(pair.faces):,} triangles, {pair.kind}", *(told(pair.ratios(share, 0)) for share in REMOVED), told(pair.slopes(0))] for name, pair in found.items()])
    page.table(["mean distance", *(f"{share:.0%} removed" for share in REMOVED), "slope"], [[name, *(told(pair.ratios(share, 1)) for share in REMOVED), told(pair.slopes(1))] for name, pair in found.items()])
    page.head("Beside our own metric")
    page.text("80 % removed: largest / mean distance in 1e-4 of the diagonal, of one run.")
    both = lambda result: " / ".join(f"{1e4 * result.distances()[k] / result.diagonal:.3g}" for k in (0, 1))
    page.table(["", "by area", "`curvature`", "`qem`"], [[name, *map(both, pair.at(0.8)), both(run(pair.paths[0], "qem", 0.2))] for name, pair in found.items()])
    page.head("Thin parts")
    page.text("Vertices that are left on the antenna of the car and on the blades of the rotor: by area / by curvature.")
    page.table(["", *(f"{share:.0%} removed" for share in REMOVED)], [[name, *(" / ".join(str(on_thin(path, result.path)) for result in (run(path, system, round(1 - share, 3)) for system in (AREA, CURVATURE))) for share in REMOVED)] for name in lathes for path in [FOLDER / f"{name}.obj"]])
    for name in figures:
        for share in REMOVED:
            for system, result in zip(("by area (curvature=0)", "curvature"), figures[name].at(share)):
                page.note(f"{name}-max", system, 1 - share, result.distances()[0])
        page.plot(f"{name}-max", f"Generated {name}: largest distance", "triangles left, share", "largest distance", "Largest distance, both ways, of one run.")
    straight = {name: meshes.write_obj(FOLDER / f"{name}.obj", pair.vertices, pair.faces) for name, pair in figures.items()}
    for name, mesh in straight.items():
        page.picture(name, [run(mesh, system, 0.2).path for system in (AREA, CURVATURE)], f"The {name} with 20 % of its triangles: by area alone, and by curvature and area.", "--tilt", "20", "--wire", size="420x420")
    page.picture("car", [run(FOLDER / "car.obj", system, 0.25).path for system in (AREA, CURVATURE)], "The car with 25 % of its triangles: by area alone, and by curvature and area.", "--tilt", "20", "--wire", size="480x360")
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
            found[name] = Pair(name, vertices, faces, shuffles=SHUFFLES if len(faces) < 15000 else 3)
    return found


def kinds(page, found):
    """What open and flat-faced models have in place of closed bent ones."""
    of_kind = lambda kind, value: np.median([np.median(value(pair)) for pair in found.values() if kind in pair.kind])
    rows = []
    for kind in dict.fromkeys(pair.kind for pair in found.values()):
        own = [pair for pair in found.values() if pair.kind == kind]
        middle = lambda value: short(np.median([np.median(value(pair)) for pair in own]))
        rows.append([kind, len(own), *(middle(lambda pair: pair.ratios(share, column)) for column in (0, 1) for share in REMOVED), *(middle(lambda pair: pair.slopes(column)) for column in (0, 1))])
    page.table(["median of", "meshes", *(f"{words}, {share:.0%}" for words in ("largest", "mean") for share in REMOVED), "slope, largest", "slope, mean"], rows)
    largest_at = lambda kind: " / ".join(short(of_kind(kind, lambda pair: pair.ratios(share, 0))) for share in REMOVED)
    page.text(f"Open and flat-faced models come out worse: at {', '.join(f'{share:.0%}' for share in REMOVED)} removed the median of the largest distances is {largest_at('open')} times the baseline's on open ones, {largest_at('closed')} on closed ones. Where a slope is below 1 on an open model, its error was larger at 20 % already. By area alone the flat-faced ones lose next to nothing until few triangles are left, so that ratios there are large and say little.")


def short(x):
    return f"{x:.2f}" if abs(x) < 100 else f"{x:,.0f}"


def finer(name, triangles):
    """A figure whose triangles are small where it bends: a mesh of four times as many, thinned."""
    mesh = meshes.write_obj(FOLDER / f"{name}-fine.obj", *limbs.FIGURES[name](2 * limbs.CELLS[name]))
    return run(mesh, "qem", triangles, repeats=1).path


class Pair:
    """A mesh by area and by curvature, turned about and shuffled several times."""

    def __init__(self, name, vertices, faces, shuffles=SHUFFLES):
        self.name, self.vertices, self.faces, self.shuffles = name, vertices, faces, shuffles

    @cached_property
    def kind(self):
        flat, area = shapes.flat_faces(self.vertices, self.faces, FLAT)
        is_open = self.at(REMOVED[0])[0].by_area["topology"]["before"]["boundary_edges"] > 0
        return ", ".join((["open"] if is_open else ["closed"]) + (["flat-faced"] if area[flat].sum() > 0.5 * area.sum() else []))

    @cached_property
    def paths(self):
        return [meshes.shuffled(FOLDER / f"{self.name}-{seed}.obj", self.vertices, self.faces, seed) for seed in range(self.shuffles)]

    def at(self, removed, shuffle=0):
        return [run(self.paths[shuffle], system, round(1 - removed, 3), repeats=1) for system in (AREA, CURVATURE)]

    def errors(self, removed, shuffle, column):
        return [result.distances()[column] for result in self.at(removed, shuffle)]

    def ratios(self, removed, column):
        return [curvature / area for area, curvature in (self.errors(removed, shuffle, column) for shuffle in range(self.shuffles))]

    def slopes(self, column):
        lines = [np.polyfit(SLOPE, [self.errors(share, shuffle, column) for share in SLOPE], 1)[0] for shuffle in range(self.shuffles)]
        return [curvature / area for area, curvature in lines]

    def popping(self):
        """Largest distance between one level and the next, by curvature ÷ by area."""
        levels = [self.at(share) for share in SLOPE]
        steps = [[largest(fine[k].path, coarse[k].path) for fine, coarse in zip(levels, levels[1:])] for k in (0, 1)]
        return [curvature / area for area, curvature in zip(*steps)]


def largest(fine, coarse):
    return json.loads(call("compare", fine, coarse, "--json", "-q", "--samples", "100000").stdout)["geometry"]["symmetric"]["max"]


def on_thin(original, path):
    """Vertices on the antenna (above 75 cm) or on the blades (above 1.37 m)."""
    height = 0.75 if original.stem == "car" else 1.37
    return sum(float(line.split()[3]) > height for line in path.open() if line.startswith("v "))


def claims(page, found, figures, lathes):
    each = lambda values: "; ".join(f"{name} {short(value)}" for name, value in values.items())
    grades = {0.2: ("about equal", lambda x: x <= WITHIN), 0.5: ("better", lambda x: x < 1), 0.8: ("clearly better (here: at most 0.8 reaches it)", lambda x: (x < 1, x <= 0.8))}
    for share, (words, holds) in grades.items():
        ratios = {name: np.median(pair.ratios(share, 0)) for name, pair in found.items()}
        page.claim(f"At {share:.0%} removed the Hausdorff distance is {words}", "embodiment, figures", each(ratios), [holds(value) for value in ratios.values()])
    for column, paper, words in [(0, 0.25, "Hausdorff distance"), (1, 0.42, "mean error")]:
        slopes = {name: np.median(pair.slopes(column)) for name, pair in found.items()}
        page.claim(f"The {words} grows more slowly: its slope over the share removed is {paper} of the baseline's on the car", "embodiment, the car", each(slopes), [below(value, paper) for value in slopes.values()])
    kept = {name: [[on_thin(FOLDER / f"{name}.obj", run(FOLDER / f"{name}.obj", system, round(1 - share, 3)).path) for system in (AREA, CURVATURE)] for share in REMOVED] for name in lathes}
    page.claim("Thin parts survive (antenna, rotor blades)", "embodiment", "vertices left on them, by area → by curvature, at 20, 50, 80 and 93 % removed: " + "; ".join(f"{name} {', '.join(f'{a} → {b}' for a, b in counts)}" for name, counts in kept.items()), [by_curvature > by_area for counts in kept.values() for by_area, by_curvature in counts])
    popping = {name: pair.popping() for name, pair in figures.items()}
    page.claim("Levels of detail pop less", "advantages", "largest distance from one level to the next (20, 50, 80 % removed) ÷ baseline: " + "; ".join(f"{name} {' / '.join(f'{x:.2f}' for x in values)}" for name, values in popping.items()), [value < 1 for values in popping.values() for value in values])
    timed = {**{name: FOLDER / f"{name}.obj" for name in lathes}, **{name: found[name].paths[0] for name in found if name not in lathes}}
    times = {name: [run(mesh, system, 0.2).cpu for system in ("qem-1997", AREA, CURVATURE)] for name, mesh in timed.items()}
    page.claim("It takes longer than by area alone", "embodiment", "processor seconds at 80 % removed ÷ those of `qem-1997` (÷ those of `curvature=0`, which computes all that the metric does, so that it differs in c alone): " + "; ".join(f"{name} {c / a:.2f} ({c / b:.2f})" for name, (a, b, c) in times.items()), [c > a for a, _, c in times.values()])
