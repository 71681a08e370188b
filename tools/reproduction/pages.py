"""A page for each paper: what it claims and what was found, tables, plots and pictures."""

import subprocess
import sys
from pathlib import Path

import curves

TOOLS = Path(__file__).resolve().parents[1]
PAGES = Path("docs/results/papers")
CONFIRMED, PARTLY, REFUTED, UNTESTED = "confirmed", "in part", "refuted", "not testable"


# A figure reaches the paper's if it is not this many times worse.
WITHIN = 1.5
# Runs of which the least and the most are left out when a figure is judged.
BAND = 4
RULE = """\
* **The verdict** on a claim is computed from the figures beside it, by one rule for all pages. Each case (a mesh at a share removed)
  *reaches* the claim if it lies on the side of the baseline that the paper says and is at most 1.5 times worse than the paper's own
  figure; where the paper gives none, the side is all that is asked for. Gains of some per cent are compared as per cent, shares and
  counts as they are. *Confirmed*: all cases reach it. *Refuted*: fewer than half of them lie, or may lie, on the right side.
  *In part*: all else, with how many reach it and how many lie on the right side.
* **Noise.** Times, and figures that depend on the order of equal costs, come from five runs: times from runs in shuffled order,
  the others from the same mesh with its vertices and triangles in five orders (three of meshes above 50,000 triangles). The figure
  is the median. A case of such figures is
  *within the noise* if the limit lies between its second least and its second largest run (of three runs: between its least and
  its largest); it counts as neither."""

SHORT_RULE = "A case (a mesh at a share removed) reaches a claim if it lies on the side of the baseline that the paper says and is at most 1.5 times worse than the paper's figure, where it gives one. Confirmed: all cases reach it; refuted: fewer than half lie on the right side; in part: all else ([the rule](README.md#what-is-compared-with-what))."
CLAIM = ["Claim", "In the paper", "Here", "Our figure"]


def inner(values):
    """The runs that count when a figure is judged."""
    return sorted(values)[1:-1] if len(values) >= BAND else values


def judged(judge, values):
    """What a rule says of the runs of one case, without the least and the most: whether it is on the right side, and whether it reaches the claim; `None` where they differ."""
    found = [judge(value) for value in inner(values)]
    found = [one if isinstance(one, tuple) else (one, one) for one in found]
    return tuple(bool(found[0][k]) if len({bool(one[k]) for one in found}) == 1 else None for k in (0, 1))


def verdict_on(cases):
    """Each case: whether it lies on the right side and whether it reaches the claim, or one truth value for both; `None` is within the noise."""
    cases = [case if isinstance(case, tuple) else (case, case) for case in cases]
    side, reached = (sum(case[k] is not None and bool(case[k]) for case in cases) for k in (0, 1))
    unsure = sum(None in case for case in cases)
    if reached == len(cases):
        return CONFIRMED
    if 2 * (side + sum(case[0] is None for case in cases)) < len(cases):
        return REFUTED
    more = [f"{side} on the right side"] * (side != reached) + [f"{unsure} within the noise"] * (unsure > 0)
    return ", ".join([f"{PARTLY}: {reached} of {len(cases)}", *more])


def below(ours, paper):
    """A ratio to the baseline that the paper has below 1, such as an error: whether it is on that side, and whether it reaches the paper's."""
    side = ours < max(1, paper)
    return side, side and ours <= WITHIN * paper


def about(ours, paper):
    """A ratio that should be the paper's, neither more nor less."""
    near = paper / WITHIN <= ours <= WITHIN * paper
    return near or (ours > 1) == (paper > 1), near


def gain(ours, paper):
    """A ratio a little above 1 that the paper has, too: what it is above 1 is compared."""
    return ours > 1, ours - 1 >= (paper - 1) / WITHIN


def cell(value):
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def rows_of(head, rows):
    lines = ["| " + " | ".join(head) + " |", "|" + " --- |" * len(head)]
    return lines + ["| " + " | ".join(map(cell, row)) + " |" for row in rows]


def shares(found, base):
    """`a / b / c`: each figure over that of the base."""
    return " / ".join(f"{a / b:.2f}" if b else "-" for a, b in zip(found, base))


class Page:
    """The page of one paper; nothing is written before `save`. Its claims stand in one table or several, each under its own words."""

    def __init__(self, name, title, source):
        self.name, self.title, self.source = name, title, source
        self.claims, self.beside, self.lines, self.curves = {}, [], [], {}

    def claim(self, words, where, here, cases, of=""):
        """A claim of the paper, where it stands, what was found, and of each case what `verdict_on` takes, or the reason why it cannot be tested; `of` names its table."""
        verdict, here = (UNTESTED, f"{here}; {cases}") if isinstance(cases, str) else (verdict_on(cases), here)
        self.claims.setdefault(of, []).append([words, where, verdict, here])

    def question(self, words, here):
        """What is asked besides, of our own; it is no claim and not counted."""
        self.beside.append([words, here])

    def head(self, title):
        self.lines += ["", f"## {title}"]

    def text(self, words):
        self.lines += ["", words]

    def table(self, head, rows):
        self.lines += ["", *rows_of(head, rows)]

    def note(self, plot, system, x, y):
        """Keeps a point for a plot."""
        self.curves.setdefault(plot, {}).setdefault(system, []).append((x, y))

    def plot(self, name, title, across, up, caption):
        """Draws what was kept for a plot."""
        PAGES.mkdir(parents=True, exist_ok=True)
        curves.plot(PAGES / f"{self.name}-{name}.svg", title, across, up, self.curves[name])
        self.lines += ["", f"![{title}]({self.name}-{name}.svg)", "", caption]

    def picture(self, name, meshes, caption, *options, size="400x320"):
        """Draws meshes side by side."""
        PAGES.mkdir(parents=True, exist_ok=True)
        target = PAGES / f"{self.name}-{name}.png"
        drawing = [sys.executable, TOOLS / "render.py", *meshes, target, "--palette", "48", "--size", size, *options]
        subprocess.run(drawing, check=True)
        self.lines += ["", f"![{caption.split(':')[0]}]({target.name})", "", caption]

    def save(self):
        PAGES.mkdir(parents=True, exist_ok=True)
        lines = [f"# {self.title}", "", self.source, "", "Made by `python3 tools/reproduce.py`; [what is measured and how](README.md)."]
        for at, (of, rows) in enumerate(self.claims.items()):
            lines += ["", f"## Claims: {of}" if of else "## Claims", *(["", SHORT_RULE] if at == 0 else []), "", *rows_of(CLAIM, rows)]
        if self.beside:
            lines += ["", "Asked besides; these are no claims of the paper and are not counted:", "", *rows_of(["Question", "Our figure"], self.beside)]
        for old in PAGES.glob(f"{self.name}-*.*"):
            if f"({old.name})" not in "\n".join(self.lines):
                old.unlink()
        (PAGES / f"{self.name}.md").write_text("\n".join(lines + self.lines) + "\n")


def claims_of(path):
    """The title of a page, and of each of its tables of claims its words and how many claims have each verdict."""
    title, of, tables, row = "", "", {}, False
    for line in path.read_text().splitlines():
        title = title or line.removeprefix("# ")
        of = line.removeprefix("## Claims").removeprefix(": ") if line.startswith("## ") else of
        if line == rows_of(CLAIM, [])[0]:
            row = True
        elif not line.startswith("|"):
            row = False
        elif row and not line.startswith("| ---"):
            tables.setdefault(of, []).append(line.split(" | ")[2])
    verdicts = (CONFIRMED, PARTLY, REFUTED, UNTESTED)
    return title, {of: [sum(verdict.startswith(word) for verdict in found) for word in verdicts] for of, found in tables.items()}
