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

    def claim(self, words, where, here, holds):
        """A claim of the paper, where it stands, what was found, and whether it holds: one truth value or several, or the reason why it cannot be tested."""
        if isinstance(holds, str):
            verdict, here = UNTESTED, holds
        else:
            holds = list(holds) if isinstance(holds, (list, tuple)) else [holds]
            count = sum(map(bool, holds))
            verdict = CONFIRMED if count == len(holds) else REFUTED if count == 0 else f"{PARTLY}: {count} of {len(holds)}"
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
            lines += ["", "## Claims", "", *rows_of(["Claim", "In the paper", "Here", "Our figure"], self.claims)]
        (PAGES / f"{self.name}.md").write_text("\n".join(lines + self.lines) + "\n")
        counts = {verdict: sum(claim[2].startswith(verdict) for claim in self.claims) for verdict in (CONFIRMED, PARTLY, REFUTED, UNTESTED)}
        summary = runs.FOLDER / f"summary-{self.name}.json"
        summary.write_text(json.dumps({"title": self.title, "name": self.name, "counts": counts}))
