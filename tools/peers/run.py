#!/usr/bin/env python3
"""Runs drystone and its peers end to end on the same OBJ files, interleaved, and tabulates time, memory and quality.

    tools/peers/run.py city.obj --drystone target/release/drystone --write docs/results/peers.md

Installs the peers from the registries (peers.py), runs every tool once a round, OBJ to OBJ, and takes wall time,
processor time (user and system) and peak resident memory of each process from wait4. The tables hold medians with
smallest and largest in brackets; ratios are taken within a round, against the first tool, so that a busy spell weighs
on both sides. Quality is that of the first round's results. Python 3.11 or newer with venv; Cargo and a C++ compiler
for meshoptimizer; Linux (peak memory is read as KiB).
"""

import argparse
import datetime
import json
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

import quality
from peers import NAMES, Peers

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))
from measure import spend

BEGIN, END = "<!-- tables of tools/peers/run.py -->", "<!-- end of tables -->"
# Who takes longer in the first round is left out of the others.
SLOW_SECONDS = 600


def count_faces(obj):
    """Triangles of an OBJ that has nothing else: its lines that begin with 'f '."""
    count, tail = 0, b"\n"
    with open(obj, "rb") as file:
        while block := file.read(1 << 24):
            count += (tail + block).count(b"\nf ")
            tail = block[-2:]
    return count


def spread(values, form="{:.2f}"):
    middle, least, most = (form.format(value) for value in (statistics.median(values), min(values), max(values)))
    return f"{middle} ({least}-{most})"


def shown(value, form="{:.2f}"):
    return "–" if value is None else form.format(value)


def bring(file, place):
    """The same file at another place: a second name if the disk is the same, else a copy."""
    try:
        place.hardlink_to(file)
    except FileExistsError:
        pass
    except OSError:
        shutil.copyfile(file, place)


def commands(obj, folder, options, peers):
    """Result and command of each tool; the first is the one that ratios are against."""
    def result(name):
        place = folder / name.replace(", ", "-")
        place.mkdir(exist_ok=True)
        # Whoever writes no material library of its own, or names images as they were, finds them here.
        for file in obj.parent.iterdir():
            if file.suffix != ".obj" and file.is_file():
                bring(file, place / file.name)
        return place / "result.obj"

    calls = {}
    for name in peers.names:
        calls[name] = result(name), peers.command(name, obj, result(name), options.ratio)
    for memory in options.memory:
        output = result(f"drystone, {memory}")
        calls[f"drystone, {memory}"] = output, [
            options.drystone, "simplify", obj, "-o", output, "--ratio", options.ratio,
            "--memory", memory, "--textures", "reference", "--force", "--quiet"]
    return calls


class Tool:
    """What one tool did on one file."""

    def __init__(self, result, command):
        self.result, self.command = result, command
        self.runs, self.faces, self.mib, self.judged, self.fault = [], 0, 0.0, [], None

    def run(self):
        self.result.unlink(missing_ok=True)
        run, printed, _ = spend(self.command)
        run["printed"] = printed
        # drystone's code 3 says that a target was missed; the table shows by how much.
        if run["exit"] not in (0, 3) or not self.result.exists():
            self.fault = f"exit code {run['exit']}"
            return
        self.runs.append(run)
        if len(self.runs) == 1:
            self.faces, self.mib = count_faces(self.result), self.result.stat().st_size / 2**20

    def figures(self, key):
        return [run[key] for run in self.runs]

    def is_slow(self):
        return bool(self.runs) and self.runs[0]["wall_seconds"] > SLOW_SECONDS


def run_rounds(obj, tools, options):
    for number in range(options.runs):
        for name, tool in tools.items():
            if tool.fault or (number > 0 and tool.is_slow()):
                continue
            tool.run()
            if tool.fault:
                told = tool.fault
            else:
                last = tool.runs[-1]
                told = f"wall {last['wall_seconds']:.2f} s, cpu {last['cpu_seconds']:.2f} s, peak {last['max_resident'] / 2**20:.0f} MiB"
            print(f"{obj.parent.name}/{obj.name} {name}: {told}", file=sys.stderr)
            if number == 0 and not tool.fault and not options.no_quality:
                tool.judged.append(quality.compared(options.drystone, obj, tool.result, options.samples))
                if options.referee:
                    tool.judged.append(quality.refereed(options.referee, obj, tool.result))


def time_table(tools, face_count):
    lines = ["| tool | processor s | wall s | µs of processor a triangle | peak MiB | bytes a triangle | triangles out | "
             "MiB out |", "| --- | --- | --- | --- | --- | --- | --- | --- |"]
    for name, tool in tools.items():
        if not tool.runs:
            lines.append(f"| {name} | {tool.fault} | – | – | – | – | – | – |")
            continue
        cpu, wall, peak = (tool.figures(key) for key in ("cpu_seconds", "wall_seconds", "max_resident"))
        runs = "" if len(cpu) > 1 else ", one run"
        lines.append(f"| {name}{runs} | {spread(cpu)} | {spread(wall)} | {statistics.median(cpu) / face_count * 1e6:.2f} | "
                     f"{spread([value / 2**20 for value in peak], '{:.0f}')} | {statistics.median(peak) / face_count:.0f} | "
                     f"{tool.faces:,} | {tool.mib:.0f} |")
    return lines


def quality_table(tools, has_referee):
    judges = ["compare", "referee"][: 2 if has_referee else 1]
    heads = [f"{measure}, {judge}" for judge in judges for measure in ("geometry", "colour", "outside")]
    lines = ["", f"| tool | {' | '.join(heads)} |", f"| --- |{' --- |' * len(heads)}"]
    for name, tool in tools.items():
        if tool.judged:
            cells = [cell for distance, colour, outside in tool.judged
                     for cell in (shown(distance, "{:.3f}"), shown(colour), shown(outside and 100 * outside, "{:.2f} %"))]
            lines.append(f"| {name} | {' | '.join(cells)} |")
    return lines


def ratio_table(tools):
    base, first = next(iter(tools.items()))
    lines = ["", f"| ratio to {base}, round by round | processor | wall | peak |", "| --- | --- | --- | --- |"]
    for name, tool in list(tools.items())[1:]:
        if tool.runs and first.runs:
            ratios = [spread([ours / theirs for ours, theirs in zip(tool.figures(key), first.figures(key))])
                      for key in ("cpu_seconds", "wall_seconds", "max_resident")]
            lines.append(f"| {name} | {' | '.join(ratios)} |")
    return lines


def step_lines(tools):
    """Wall seconds of the steps, from the tools that tell them."""
    lines = ["", "Wall seconds within the tools (read, simplify, write): "]
    told = []
    for name, tool in tools.items():
        if tool.runs and tool.runs[0]["printed"].startswith("{"):
            steps = [json.loads(run["printed"]) for run in tool.runs]
            middle = [statistics.median(step[f"{part}_s"] for step in steps) for part in ("read", "simplify", "write")]
            told.append(f"{name} {', '.join(f'{seconds:.2f}' for seconds in middle)}")
    return [lines[0], lines[1] + "; ".join(told) + ".", ""] if told else [""]


def compare(obj, options, peers, scratch):
    """A heading and the tables for one OBJ."""
    face_count = count_faces(obj)  # also brings the file into the page cache, for every tool alike
    folder = Path(tempfile.mkdtemp(dir=scratch))
    tools = {name: Tool(*call) for name, call in commands(obj, folder, options, peers).items()}
    run_rounds(obj, tools, options)
    heading = [f"### {obj.parent.name}/{obj.name}: {face_count:,} triangles, {obj.stat().st_size / 2**20:.0f} MiB, "
               f"to {options.ratio:g}, {options.runs} rounds", ""]
    judged = [] if options.no_quality else quality_table(tools, options.referee)
    return heading + time_table(tools, face_count) + judged + ratio_table(tools) + step_lines(tools)


def title(options, peers):
    ours = subprocess.run([options.drystone, "--version"], check=True, capture_output=True, text=True).stdout
    ours = ours.partition(" (")[0].strip()  # a release is named by its version, not by a commit
    busy = " ".join(f"{load:.1f}" for load in os.getloadavg())
    versions = ", ".join([ours, *peers.versions()])
    return [f"{datetime.date.today()}, {os.cpu_count()} processors, load averages {busy} at the start; {versions}.", ""]


def write(text, path):
    """Puts the text between the two marks of the file, or on standard output without a file."""
    if path is None:
        print(text)
        return
    old = path.read_text() if path.exists() else f"{BEGIN}\n{END}\n"
    if BEGIN not in old or END not in old:
        sys.exit(f"{path}: expected the marks '{BEGIN}' and '{END}', found none")
    before, after = old.split(BEGIN)[0], old.split(END)[1]
    path.write_text(f"{before}{BEGIN}\n\n{text}\n{END}{after}")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("obj", nargs="+", type=Path, help="triangle meshes to simplify")
    parser.add_argument("--drystone", required=True, help="release binary to measure")
    parser.add_argument("--ratio", type=float, default=0.1, help="share of the triangles to keep (default 0.1)")
    parser.add_argument("--runs", type=int, default=3, help="rounds (default 3)")
    parser.add_argument("--tools", nargs="+", default=NAMES, choices=NAMES, metavar="NAME",
                        help=f"peers (default all): {', '.join(NAMES)}")
    parser.add_argument("--memory", nargs="+", default=["1GiB"], help="budgets of drystone (default 1GiB)")
    parser.add_argument("--samples", type=int, default=1_000_000, help="points of the comparison (default 1000000)")
    parser.add_argument("--referee", help="a second judge: a command that compares two OBJ files and prints JSON")
    parser.add_argument("--no-quality", action="store_true", help="times and memory alone")
    parser.add_argument("--scratch", type=Path, help="folder for results (default: the system's)")
    parser.add_argument("--write", type=Path, help="Markdown file to put the tables into")
    options = parser.parse_args()
    if options.runs < 1:
        parser.error(f"--runs: expected 1 or more, found {options.runs}")
    missing = [str(obj) for obj in options.obj if not obj.is_file()]
    if missing:
        parser.error(f"no such file: {', '.join(missing)}")
    options.drystone = shutil.which(options.drystone) or parser.error(f"--drystone: no program {options.drystone}")
    options.drystone = str(Path(options.drystone).resolve())

    peers = Peers(options.tools)
    lines = title(options, peers)
    if options.scratch:
        os.makedirs(options.scratch, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=options.scratch) as scratch:
        for obj in options.obj:
            lines += compare(obj.resolve(), options, peers, scratch)
    write("\n".join(lines), options.write)


if __name__ == "__main__":
    main()
