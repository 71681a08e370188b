"""Wang, Zhang, Li, Chen, Li 2024: texture-safe simplification of oblique photogrammetry."""

import json

import numpy as np

from . import meshes, shapes
from .pages import TOOLS, Page, below, judged, shares
from .runs import FOLDER, SHARED, call, over, run, timed

TRIANGLES = 65569
REMOVED = (0.3, 0.5, 0.7, 0.9)
BASE = "qem-1997 guards=0"
SYSTEMS = [BASE, "qem-1997", "qem-1997 placement=three", "qem-1997 border=10", "sharpness", "oblique border=0", "oblique", "oblique border=0 placement=three", "oblique placement=three"]
OURS = "qem-attributes"
# The paper's method, and ours with planes that hold borders: the words above their claims, and what they are called in a row.
OWN, HELD = "oblique border=0", "oblique"
VARIANTS = {OWN: "the paper's version (`oblique border=0`)", HELD: "with planes that hold borders (`oblique`, our default)"}
TIMED = (BASE, "sharpness", OWN, HELD)
# Max / mean / RMS at each share removed; unit unknown.
PAPER = {
    "QEM": [(0.032906, 0.002522, 0.005297), (0.157804, 0.005766, 0.009507), (0.302414, 0.011128, 0.016710), (0.345950, 0.019415, 0.026590)],
    "L18": [(0.016921, 0.000137, 0.000238), (0.070873, 0.000432, 0.002126), (0.199960, 0.003477, 0.010271), (0.300024, 0.010317, 0.023770)],
    "W24": [(0.000521, 0.000130, 0.000175), (0.056694, 0.000353, 0.001989), (0.132251, 0.003459, 0.008636), (0.195303, 0.009222, 0.020845)],
}
SECONDS = {"QEM": (29.7, 32.0, 40.7, 46.6), "L18": (27.6, 34.9, 43.3, 47.0), "W24": (29.0, 31.9, 38.2, 42.2)}
# A system that leaves this many times the triangles of the baseline is compared with a longer run of it.
SAME = 1.02
HEAD = ["", *(f"{share:.0%} removed" for share in REMOVED)]
KINDS = {"green": ["green"], "façades and roofs": ["facade", "roof"], "street": ["street"]}


def write():
    page = Page("oblique", "Oblique photogrammetry", "Wang, Zhang, Li, Chen, Li: Lightweight algorithm for preventing texture distortion in oblique photogrammetry model simplification. Foreign Electronic Measurement Technology 43(3), 2024.")
    surveys = surveys_of()
    town = meshes.town(FOLDER / "town", TRIANGLES)
    found = {mesh.stem: Runs(mesh) for mesh in [*surveys, town]}
    for system, of in VARIANTS.items():
        claims(page, found, system, of)
    questions(page, found)
    page.head("The paper's table, in its measure")
    page.text(f"The paper measures from the vertices of the result to the original (its section 3.3). What leaves vertices where they were has next to no error there, whatever becomes of the surface between them, and worn borders count nothing: the table shows placement more than anything else. The mean errors of the paper's rows come out in most cases (the first question above) where vertices go to the best of both ends and the middle, which is what the paper falls back to where its 5 × 5 systems are singular: the row L18 out of `sharpness` and of `qem-1997 placement=three` alike, the row W24 out of `oblique placement=three`. The two pieces of surveys have {TRIANGLES:,} triangles, as the paper's mesh, the generated town {found[town.stem].triangles:,}, since it is made of whole blocks.")
    page.table(["max / mean / RMS", *HEAD[1:]], [[name, *(" / ".join(f"{x:.6f}" for x in row) for row in rows)] for name, rows in PAPER.items()])
    page.table(["max / mean / RMS, ratio", *HEAD[1:]], [[f"{name} ÷ {base}", *(shares(row, other) for row, other in zip(PAPER[name], PAPER[base]))] for name, base in (("L18", "QEM"), ("W24", "QEM"), ("W24", "L18"))])
    borders(page, found)
    page.head("Equal counts")
    page.text(f"In the tables below, where a system misses its target (at 90 %, see [the counts](#triangles-that-are-left-and-time)), the first row is run to the triangles which that system left, and the ratio, marked ᵉ, is to that: all errors are compared at equal counts, to {SAME - 1:.0%}.")
    for way, title in [("vertices", "From the vertices of the result to the original"), ("forward", "From points of the result by area to the original"), ("symmetric", "Both ways, by area: worn borders count")]:
        page.head(title)
        for runs in found.values():
            page.text(f"{runs.label}; the first row in metres, the others as max / mean / RMS over it.")
            rows = [[name_of(BASE), *(" / ".join(f"{x:.4f}" for x in result.distances(way)) for result in runs.systems[BASE])]]
            rows += [[name_of(system), *(shares(runs.systems[system][at].distances(way), runs.base(system, at).distances(way)) + ("ᵉ" if runs.has_more(system, at) else "") for at in range(len(REMOVED)))] for system in runs.systems if system != BASE]
            page.table(HEAD, rows)
    page.head("Against L18 at equal counts")
    page.text("Both versions ÷ `sharpness`, max / mean / RMS. Where one of them misses its target, the other is run to the larger number of triangles.")
    page.table(["", "", "measure", *HEAD[1:]], [[mesh, f"`{system}`", words, *(shares(*(result.distances(way) for result in runs.with_l18(system, at))) for at in range(len(REMOVED)))] for mesh, runs in found.items() for system in VARIANTS for way, words in (("vertices", "at vertices of the result"), ("symmetric", "by area, both ways"))])
    texture(page, found)
    beside_default(page, found)
    page.head("Triangles that are left, and time")
    page.text("Where the rules of `oblique` keep too many corners of seams, its target is not met. Times are seconds of user time with reading and writing, medians of five runs in shuffled order, over those of the first row. The paper's own seconds, and over its QEM's:")
    page.table(HEAD, [[name, *(f"{x} ({x / base:.2f})" for x, base in zip(row, SECONDS["QEM"]))] for name, row in SECONDS.items()])
    for mesh, runs in found.items():
        page.text(f"{runs.label}; the first row in seconds:")
        told = lambda system, at: f", {np.median(runs.times[BASE][at]):.2f} s" if system == BASE else f", {np.median(over(runs.times[system][at], runs.times[BASE][at])):.2f}" if system in runs.times else ""
        page.table(HEAD, [[name_of(system), *(f"{result.faces:,} triangles{told(system, at)}" for at, result in enumerate(results))] for system, results in runs.systems.items()])
        for system, results in runs.systems.items():
            for result in results:
                page.note(mesh, system, result.faces / runs.triangles, result.distances()[2])
        page.plot(mesh, f"{mesh}: RMS distance", "triangles left, share", "RMS distance (m)", "Root mean square distance, both ways, by area.")
    ablations(page, surveys)
    for at, removed in enumerate(REMOVED):
        pictures = [found[town.stem].systems[system][at].path for system in (BASE, "sharpness", OWN, HELD)]
        page.picture(f"town-{removed:.0%}".rstrip("%"), pictures, f"The town, {removed:.0%} of its triangles removed: by `qem-1997 guards=0`, by `sharpness`, by `oblique border=0` and by `oblique`.", "--turn", "30", "--columns", "2", size="560x420")
    page.save()


def surveys_of():
    """Pieces of two surveys with as many triangles as the paper's mesh."""
    paths = {name: SHARED / name / f"{name}.obj" for name in ("cc_cyanhabao", "odm_bocimi")}
    return [meshes.cut(FOLDER / f"{name}-{TRIANGLES}.obj", path, TRIANGLES) for name, path in paths.items() if path.exists()]


class Runs:
    """All systems on one mesh, at each share removed."""

    def __init__(self, mesh):
        self.mesh = mesh
        self.systems = {system: [self.to(system, round(1 - removed, 2)) for removed in REMOVED] for system in [*SYSTEMS, OURS]}
        self.triangles = self.systems[BASE][0].by_area["topology"]["before"]["faces"]
        self.border_edges = self.systems[BASE][0].by_area["topology"]["before"]["boundary_edges"]
        spent = timed([(mesh, system, round(1 - removed, 2), "--seams", "follow") for system in TIMED for removed in REMOVED])
        self.times = {system: [spent.pop(0).user for _ in REMOVED] for system in TIMED}
        self.label = f"{mesh.stem}, {self.triangles:,} triangles"

    def to(self, system, target):
        return run(self.mesh, system, target, "--seams", "follow")

    def has_more(self, system, at):
        """Whether a system missed its target, so that it has more triangles than the baseline."""
        return self.systems[system][at].faces > SAME * self.systems[BASE][at].faces

    def base(self, system, at):
        """The baseline with as many triangles as a system left."""
        return self.to(BASE, self.systems[system][at].faces) if self.has_more(system, at) else self.systems[BASE][at]

    def ratios(self, system, at, way="vertices"):
        return [a / b for a, b in zip(self.systems[system][at].distances(way), self.base(system, at).distances(way))]

    def with_l18(self, system, at):
        """A system and `sharpness` with as many triangles, as far as they can."""
        pair = {one: self.systems[one][at] for one in (system, "sharpness")}
        most = max(result.faces for result in pair.values())
        return [result if result.faces * SAME >= most else self.to(one, most) for one, result in pair.items()]


def name_of(system):
    return {BASE: "QEM as in the papers (`qem-1997 guards=0`)", OURS: "`qem-attributes`, ours"}.get(system, f"`{system}`")


def each(values, digits=2):
    return "; ".join(f"{mesh} {' / '.join(f'{x:.{digits}f}' for x in row)}" for mesh, row in values.items())


def claims(page, found, system, of):
    steps = range(len(REMOVED))
    claim = lambda *told: page.claim(*told, of=of)
    for column, measure in enumerate(("largest", "mean", "RMS")):
        paper = [row[column] / base[column] for row, base in zip(PAPER["W24"], PAPER["QEM"])]
        ours = {mesh: [runs.ratios(system, at)[column] for at in steps] for mesh, runs in found.items()}
        claim(f"At 30, 50, 70 and 90 % removed the {measure} error is {' / '.join(f'{x:.2f}' for x in paper)} of QEM's", "table 1", each(ours), [below(x, y) for row in ours.values() for x, y in zip(row, paper)])
    for column, measure in enumerate(("largest", "mean", "RMS")):
        paper = [row[column] / base[column] for row, base in zip(PAPER["W24"], PAPER["L18"])]
        pairs = {mesh: [[result.distances("vertices")[column] for result in runs.with_l18(system, at)] for at in steps] for mesh, runs in found.items()}
        ours = {mesh: [a / b for a, b in rows] for mesh, rows in pairs.items()}
        claim(f"The {measure} error is {' / '.join(f'{x:.2f}' for x in paper)} of L18's (`sharpness`)", "table 1", each(ours), [below(x, y) for row in ours.values() for x, y in zip(row, paper)])
    turned, of_base = ({mesh: [turned_over(result) for result in runs.systems[one]] for mesh, runs in found.items()} for one in (system, BASE))
    claim("No texture triangle turns over", "title, figs. 6 to 9", f"triangles that show the other side of the picture than all that lay there before: {each(turned, 0)}; QEM: {each(of_base, 0)}", [count == 0 for row in turned.values() for count in row])
    colours = {mesh: [runs.systems[system][at].texture["colour_rms"] / runs.base(system, at).texture["colour_rms"] for at in steps] for mesh, runs in found.items()}
    claim("The picture is distorted less than by QEM", "title, fig. 9", "RMS of colours ÷ QEM: " + each(colours), [x < 1 for row in colours.values() for x in row])
    edge = lambda result: result.by_area["geometry"]["border"]["rms"]
    borders = {mesh: [edge(runs.systems[system][at]) / edge(runs.base(system, at)) for at in steps] for mesh, runs in found.items()}
    claim("Borders hold where QEM tears them", "fig. 9", "RMS of the border's distance ÷ QEM: " + each(borders), [x < 1 for row in borders.values() for x in row])
    if system == OWN:
        torn = [result.border_edges < result.by_area["topology"]["before"]["boundary_edges"] for runs in found.values() for result in runs.systems["sharpness"][1:]]
        claim("L18 tears borders from 50 % on", "fig. 9", "`sharpness` keeps every border edge, as L18's own paper says; the two papers contradict each other", torn)
    for base, words in ((BASE, "QEM"), ("sharpness", "L18 (`sharpness`)")):
        paper = [a / b for a, b in zip(SECONDS["W24"], SECONDS["QEM" if base == BASE else "L18"])]
        times = {mesh: [over(*pair) for pair in zip(runs.times[system], runs.times[base])] for mesh, runs in found.items()}
        claim(f"It takes {' / '.join(f'{x:.2f}' for x in paper)} of the time of {words}", "table 1", each({mesh: map(np.median, row) for mesh, row in times.items()}), [judged(lambda x: below(x, y), one) for row in times.values() for one, y in zip(row, paper)])


def questions(page, found):
    paper = [row[1] / base[1] for row, base in zip(PAPER["W24"], PAPER["QEM"])]
    for system in ("oblique border=0 placement=three", "oblique placement=three"):
        three = {mesh: [runs.ratios(system, at)[1] for at in range(len(REMOVED))] for mesh, runs in found.items()}
        cases = [below(x, y) for row in three.values() for x, y in zip(row, paper)]
        page.question(f"Does the mean error of the paper's table come out if vertices go to the best of both ends and the middle wherever they may (`{system}`)?", f"in {sum(reached for _, reached in cases)} of {len(cases)} cases ({sum(side for side, _ in cases)} below QEM's): {each(three)}")


def borders(page, found):
    page.head("Borders: the paper's version and ours")
    systems = (BASE, "qem-1997 border=10", OWN, "oblique border=0 placement=three", HELD)
    most = max(found.values(), key=lambda runs: runs.border_edges)
    page.text(f"The paper's rules let two border vertices merge at the least of their 5-D quadric, and nothing in it holds the border's line. On even ground that least is not unique: every point of the plane costs nothing, texture coordinates included, since they are linear there. The system is not quite singular in floating point, so the vertex lands anywhere up to two edge lengths away (our limit), in the plane but beyond the border, and these collapses come first, since they cost nothing. Where a mesh has many borders, as {most.mesh.stem} with {most.border_edges:,} border edges, flaps grow past them, with texture coordinates past the edge of their chart: at 30 % removed already, surface is added that shows none of the original's picture, and it is what the RMS of colours measures. On the other meshes the borders erode instead. `placement=three`, the paper's own way where a system is singular, makes no flaps. Nor do the planes through border edges that are our default.")
    page.text("Area of the result ÷ before / RMS distance of the border in metres / share of the surface that shows no chart.")
    for runs in found.values():
        page.text(f"{runs.label}:")
        page.table(HEAD, [[name_of(system), *(" / ".join([f"{area_of(result):.3f}", f"{result.by_area['geometry']['border']['rms']:.3f}", *([f"{result.texture['outside_fraction']:.2%}"] if result.texture["outside_fraction"] is not None else [])]) for result in runs.systems[system])] for system in systems])


def turned_over(result):
    if result.checked["counts"]["uv negative"] == [0, 0]:
        return 0
    return result.kept("turned", lambda: int(shapes.turned(result.original, result.path)))


def area_of(result):
    areas = result.by_area["geometry"]["area"]
    return areas["after"] / areas["before"]


def beside_default(page, found):
    page.head("Where our default is not the least")
    page.text(f"Systems of these tables that have less than `{OURS}`, of those that meet the target; colours are the RMS of their difference.")
    measures = {"mean, both ways": lambda x: x.distances()[1], "RMS, both ways": lambda x: x.distances()[2], "largest, both ways": lambda x: x.distances()[0], "mean, from the result": lambda x: x.distances("forward")[1], "RMS, from the result": lambda x: x.distances("forward")[2], "mean, at vertices": lambda x: x.distances("vertices")[1], "colours": lambda x: x.texture["colour_rms"]}
    for runs in found.values():
        page.text(f"{runs.label}:")
        rows = []
        for words, value in measures.items():
            cells = []
            for at in range(len(REMOVED)):
                ours = runs.systems[OURS][at]
                less = [(value(results[at]), system) for system, results in runs.systems.items() if system != OURS and results[at].faces <= SAME * ours.faces and value(results[at]) < value(ours)]
                cells.append("; ".join(f"`{system}` {x / value(ours):.2f}" for x, system in sorted(less)) or "none")
            rows.append([words, *cells])
        page.table(HEAD, rows)


def found_negative(found):
    """Triangles of a survey that show their back before."""
    counts = [runs.systems[BASE][0].checked["counts"]["uv negative"][1] for name, runs in found.items() if "bocimi" in name]
    return counts[0] if counts else "some"


def texture(page, found):
    page.head("What becomes of the picture")
    page.text(f"RMS of the difference of colours (of 255), 95 % of the slide in metres and share of the surface that shows no chart (neither can be told of the town, whose pictures repeat), and texture triangles that are turned over: where the middle of one lies in the picture, all triangles of before show the other side. A difference of counts would not do: odm_bocimi-65569 has {found_negative(found)} triangles that show their back before any collapse, and most of these go. Every metric here refuses to turn a triangle over, but for the first row. What is counted in other rows is a triangle that showed its back from the start and grew, as those around it vanished, over a place where triangles show their front.")
    for runs in found.values():
        page.text(f"{runs.label}:")
        rows = []
        for system, results in runs.systems.items():
            cells = []
            for result in results:
                slide, outside = result.texture["slide_p95"], result.texture["outside_fraction"]
                told = f" / {slide:.2f} m / {outside:.2%}" if slide is not None else ""
                cells.append(f"{result.texture['colour_rms']:.2f}{told} / {turned_over(result) if system in (BASE, 'qem-1997', OWN, HELD) else '-'}")
            rows.append([name_of(system), *cells])
        page.table(HEAD, rows)


LEFT_OUT = ("", " lrs=0", " mean-area=0", " tex=0")
FACTORS = (*(system + left_out for system in VARIANTS for left_out in LEFT_OUT), "qem-1997", OURS)


def ablations(page, surveys):
    """The committed town and two pieces of surveys by the whole metric and without each of its factors, at the paper's 80 %."""
    page.head("The factors one by one")
    page.text("80 % removed, as in the paper (its figures 6 to 8 have 65,569, 86,052 and 118,353 triangles): shares of the triangles that are left on each kind of surface, RMS of colours, share of slivers, RMS distance in 1e-4 of the diagonal. The committed town has 18,218 triangles and materials that say what they are; its colours are those of all surfaces and of façades alone, whose windows are painted. Of the two pieces, what shows more green than red and blue (2 G - R - B above 20) counts as green, of the rest what is steeper than 60° as walls.")
    town = TOOLS.parent / "fixtures" / "town" / "town.obj"
    kinds = {"town": (town, kinds_of), **{mesh.stem: (mesh, shapes.kinds_by_colour) for mesh in surveys}}
    page.text("Each figure is the median of runs on the mesh in five orders (of the pieces in three), the least and the most in brackets (of the last two rows one run); RMS of colours, slivers and distance are those of the first order.")
    left, colours = {}, {}
    for name, (mesh, kinds_in) in kinds.items():
        before, rows = kinds_in(mesh), []
        rows.append(["before", *(f"{share:.3f}" for share in before.values()), "", *([""] if name == "town" else []), "", ""])
        for system in FACTORS:
            results = [run(path, system, 0.2) if name == "town" else run(path, system, 0.2, "--seams", "follow") for path in meshes.orders(mesh)[: None if system.startswith("oblique") else 1]]
            found = [kept_kinds(result, kinds_in) for result in results]
            left[name, system] = {kind: [one[kind] for one in found] for kind in before}
            if system.startswith("oblique") and system.endswith((OWN, HELD, "tex=0")):
                colours[name, system] = [on_facades(town, result) if name == "town" else result.texture["colour_rms"] for result in results]
            first, facades = results[0], colours.get((name, system), [])
            rows.append([f"`{system}`", *(spread(shares) for shares in left[name, system].values()), first.texture["colour_rms"], *(([facades[0]] if facades else [""]) if name == "town" else []), first.quality["sliver_share"], 1e4 * first.distances()[2] / first.diagonal])
        page.text(f"{name}:")
        page.table(["", *before, "colour RMS", *(["on façades"] if name == "town" else []), "slivers", "RMS"], rows)
    shown = [run(town, HELD + left_out, 0.2).path for left_out in LEFT_OUT]
    page.picture("factors", shown, "The town with 20 % of its triangles: by the whole metric, without the fluctuation factor (`lrs=0`), without the mean area (`mean-area=0`), without the texture factor (`tex=0`).", "--turn", "30", "--wire", "--columns", "2", size="640x480")
    near = ",".join(f"{x:.2f}" for x in shapes.middle_of(town, "facade"))
    page.picture("windows", [town, run(town, "oblique", 0.2).path, run(town, "oblique tex=0", 0.2).path, run(town, BASE, 0.2).path], "Façades of the town from near: before, and with 20 % of the triangles by the whole metric, without the texture factor (`tex=0`), and by `qem-1997 guards=0`.", "--turn", "30", "--tilt", "25", f"--near={near},14", "--columns", "2", size="640x480")
    for system, of in VARIANTS.items():
        for words, where, left_out in [("Without LRS, vegetation keeps too many triangles", "fig. 6", " lrs=0"), ("Without the mean area, dense vegetation keeps too many", "fig. 7", " mean-area=0")]:
            change = {name: {kind: [100 * (a - b) for a, b in zip(left[name, system + left_out][kind], left[name, system][kind])] for kind in list(left[name, system])[:2]} for name in kinds}
            page.claim(words, where, "points in the green and on buildings or walls: " + "; ".join(f"{name} {', '.join(points(row) for row in rows.values())}" for name, rows in change.items()), [judged(lambda x: x > 0, rows["green"]) for rows in change.values()], of=of)
        pairs = {name: [a / b for a, b in zip(colours[name, system + " tex=0"], colours[name, system])] for name in kinds}
        page.claim("Without the texture factor, window frames distort", "fig. 8", "RMS of colours without it ÷ with it, on the town's façades and on the whole of the pieces: " + "; ".join(f"{name} {spread(row)}" for name, row in pairs.items()), [judged(lambda x: x > 1, row) for row in pairs.values()], of=of)


def spread(values):
    return f"{np.median(values):.3f}" + (f" ({min(values):.3f} to {max(values):.3f})" if len(values) > 1 else "")


def points(values):
    return f"{np.median(values):+.1f} ({min(values):+.1f} to {max(values):+.1f})"


def kept_kinds(result, kinds_in):
    return result.kept("kinds", lambda: {kind: float(share) for kind, share in kinds_in(result.path).items()})


def on_facades(town, result):
    """RMS of the difference of colours on the town's façades."""
    def measure():
        parts = [meshes.of_materials(path, {"facade"}) for path in (town, result.path)]
        return json.loads(call("compare", *parts, "--json", "-q", "--samples", "200000").stdout)["texture"]["colour_rms"]

    return result.kept("facades", measure)


def kinds_of(path):
    """Share of the triangles on each kind of surface."""
    counts, material = {}, None
    for line in path.open():
        word, _, rest = line.strip().partition(" ")
        if word == "usemtl":
            material = rest
        counts[material] = counts.get(material, 0) + (word == "f")
    whole = sum(counts.values())
    return {kind: sum(counts.get(name, 0) for name in names) / whole for kind, names in KINDS.items()}
