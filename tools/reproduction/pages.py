"""A page for each paper: what it claims and what was found, tables, plots and pictures."""

import json
import subprocess
import sys
from pathlib import Path

import curves

from . import runs

TOOLS = Path(__file__).resolve().parents[1]
PAGES = Path("docs/results/papers")
CONFIRMED, PARTLY, REFUTED, UNTESTED = "confirmed", "in part", "refuted", "not testable"


# A figure reaches the paper's if it is not this many times worse.
WITHIN = 1.5
RULE = """\
* **The verdict** on a claim is computed from the figures beside it, by one rule for all pages. Each case (a mesh at a share removed)
  *reaches* the claim if it lies on the side of the baseline that the paper says and is at most 1.5 times worse than the paper's own
  figure; where the paper gives none, the side is all that is asked for. Gains of some per cent are compared as per cent, shares and
  counts as they are. *Confirmed*: all cases reach it. *Refuted*: fewer than half of them lie on the right side. *In part*: all else,
  with how many reach it and how many lie on the right side."""

SHORT_RULE = "A case (a mesh at a share removed) reaches a claim if it lies on the side of the baseline that the paper says and is at most 1.5 times worse than the paper's figure, where it gives one. Confirmed: all cases reach it; refuted: fewer than half lie on the right side; in part: all else ([the rule](README.md#what-is-compared-with-what))."


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
    """The page of one paper; nothing is written before `save`."""

    def __init__(self, name, title, source):
        self.name, self.title, self.source = name, title, source
        self.claims, self.lines, self.curves = [], [], {}

    def claim(self, words, where, here, cases):
        """A claim of the paper, where it stands, what was found, and of each case whether it lies on the right side and whether it reaches the paper's figure (or one truth value for both), or the reason why it cannot be tested."""
        if isinstance(cases, str):
            self.claims.append([words, where, UNTESTED, f"{here}; {cases}"])
            return
        cases = [case if isinstance(case, tuple) else (case, case) for case in cases]
        side, reached = (sum(bool(case[k]) for case in cases) for k in (0, 1))
        if reached == len(cases):
            verdict = CONFIRMED
        elif 2 * side < len(cases):
            verdict = REFUTED
        else:
            verdict = f"{PARTLY}: {reached} of {len(cases)}" + (f", {side} on the right side" if side != reached else "")
        self.claims.append([words, where, verdict, here])

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
        if self.claims:
            lines += ["", "## Claims", "", SHORT_RULE, "", *rows_of(["Claim", "In the paper", "Here", "Our figure"], self.claims)]
        (PAGES / f"{self.name}.md").write_text("\n".join(lines + self.lines) + "\n")
        counts = {verdict: sum(claim[2].startswith(verdict) for claim in self.claims) for verdict in (CONFIRMED, PARTLY, REFUTED, UNTESTED)}
        summary = runs.FOLDER / f"summary-{self.name}.json"
        summary.write_text(json.dumps({"title": self.title, "name": self.name, "counts": counts}))
