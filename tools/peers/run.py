#!/usr/bin/env python3
"""Runs drystone and meshoptimizer end to end on the same OBJ files, interleaved, and tabulates time and memory.

    tools/peers/run.py city.obj --drystone target/release/drystone --write docs/benchmarks-peers.md

Builds the driver beside this file (needs Rust and a C++ compiler), runs every tool once a round, OBJ to OBJ, and takes
wall time, processor time (user and system) and peak resident memory of each process from wait4. The table holds
medians with smallest and largest in brackets; the ratios are taken within a round, against the first tool, so that a
busy spell weighs on both sides. Python 3.9 or newer, standard library only; Linux (peak memory is read as KiB).
"""

import argparse
import datetime
import json
import os
import pathlib
import re
import shutil
import statistics
import subprocess
import sys
import tempfile
import time

HERE = pathlib.Path(__file__).resolve().parent
BEGIN, END = "<!-- tables of tools/peers/run.py -->", "<!-- end of tables -->"


def build_driver():
    """Path of the release driver, built if need be."""
    command = ["cargo", "build", "--release", "--quiet", "--manifest-path", str(HERE / "Cargo.toml")]
    subprocess.run(command, check=True)
    target = pathlib.Path(os.environ.get("CARGO_TARGET_DIR", HERE / "target"))
    return target / "release" / "meshopt-obj"


def meshopt_version():
    lock = (HERE / "Cargo.lock").read_text()
    return re.search(r'name = "meshopt"\nversion = "([^"]+)"', lock).group(1)


def measure(command):
    """One run: seconds of wall and processor time, peak bytes, and what the program printed.

    NOTE: the kernel's peak includes this script's own size at the fork, about 15 MB: a floor far below any run here.
    """
    with tempfile.TemporaryFile() as printed:
        os.sync()  # the last run's output must not be written at this run's expense
        start = time.monotonic()
        process = subprocess.Popen(command, stdout=printed)
        _, status, usage = os.wait4(process.pid, 0)
        wall = time.monotonic() - start
        process.returncode = os.waitstatus_to_exitcode(status)
        printed.seek(0)
        text = printed.read().decode(errors="replace")
    if process.returncode != 0:
        sys.exit(f"{command[0]}: exit code {process.returncode}")
    return {"wall": wall, "cpu": usage.ru_utime + usage.ru_stime, "peak": usage.ru_maxrss * 1024, "printed": text}


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


def tools_for(obj, output, options, driver):
    """Name and command of each tool; the first is the one that ratios are against."""
    ratio = str(options.ratio)
    tools = {f"meshoptimizer {mode}": [str(driver), str(obj), str(output), "--ratio", ratio, "--mode", mode]
             for mode in options.modes}
    for memory in options.memory:
        tools[f"drystone, {memory}"] = [options.drystone, "simplify", str(obj), "-o", str(output), "--ratio", ratio,
                                        "--memory", memory, "--textures", "reference", "--force", "--quiet"]
    return tools


def compare(obj, options, driver, scratch):
    """A heading, a table and a table of ratios for one OBJ."""
    face_count = count_faces(obj)  # also brings the file into the page cache, for every tool alike
    output = scratch / "result.obj"
    tools = tools_for(obj, output, options, driver)
    runs = {name: [] for name in tools}
    faces, output_mib = {}, {}
    for number in range(options.runs):
        for name, command in tools.items():
            output.unlink(missing_ok=True)
            run = measure(command)
            runs[name].append(run)
            if number == 0:
                faces[name], output_mib[name] = count_faces(output), output.stat().st_size / 2**20
            print(f"{obj.parent.name}/{obj.name} {name}: wall {run['wall']:.2f} s, cpu {run['cpu']:.2f} s, "
                  f"peak {run['peak'] / 2**20:.0f} MiB", file=sys.stderr)

    lines = [f"### {obj.parent.name}/{obj.name}: {face_count:,} triangles, {obj.stat().st_size / 2**20:.0f} MiB, "
             f"to {options.ratio:g}, {options.runs} runs each", "",
             "| tool | processor s | wall s | µs of processor a triangle | peak MiB | bytes a triangle | "
             "triangles out | MiB out |", "| --- | --- | --- | --- | --- | --- | --- | --- |"]
    for name, of_tool in runs.items():
        cpu, wall, peak = ([run[key] for run in of_tool] for key in ("cpu", "wall", "peak"))
        lines.append(f"| {name} | {spread(cpu)} | {spread(wall)} | {statistics.median(cpu) / face_count * 1e6:.2f} | "
                     f"{spread([value / 2**20 for value in peak], '{:.0f}')} | "
                     f"{statistics.median(peak) / face_count:.0f} | {faces[name]:,} | {output_mib[name]:.0f} |")
    base = next(iter(runs))
    lines += ["", f"| ratio to {base}, round by round | processor | wall | peak |", "| --- | --- | --- | --- |"]
    for name in list(runs)[1:]:
        ratios = [spread([ours[key] / theirs[key] for ours, theirs in zip(runs[name], runs[base])])
                  for key in ("cpu", "wall", "peak")]
        lines.append(f"| {name} | {' | '.join(ratios)} |")
    steps = [json.loads(run["printed"]) for run in runs[base]]
    parts = ", ".join(f"{step} {spread([run[f'{step}_s'] for run in steps])}" for step in ("read", "simplify", "write"))
    return lines + ["", f"Wall seconds within {base}: {parts}.", ""]


def heading(options):
    ours = subprocess.run([options.drystone, "--version"], check=True, capture_output=True, text=True).stdout.strip()
    busy = " ".join(f"{load:.1f}" for load in os.getloadavg())
    return [f"{datetime.date.today()}, {os.cpu_count()} processors, load averages {busy} at the start; {ours}, "
            f"`meshopt` crate {meshopt_version()}.", ""]


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
    parser.add_argument("obj", nargs="+", type=pathlib.Path, help="triangle meshes to simplify")
    parser.add_argument("--drystone", required=True, help="release binary to measure")
    parser.add_argument("--ratio", type=float, default=0.1, help="share of the triangles to keep (default 0.1)")
    parser.add_argument("--runs", type=int, default=3, help="rounds (default 3)")
    parser.add_argument("--modes", nargs="+", default=["update", "uv"], choices=["update", "uv"],
                        help="ways of meshoptimizer (default both)")
    parser.add_argument("--memory", nargs="+", default=["1GiB"], help="budgets of drystone (default 1GiB)")
    parser.add_argument("--scratch", type=pathlib.Path, help="folder for results (default: the system's)")
    parser.add_argument("--write", type=pathlib.Path, help="Markdown file to put the tables into")
    options = parser.parse_args()
    if options.runs < 1:
        parser.error(f"--runs: expected 1 or more, found {options.runs}")
    missing = [str(obj) for obj in options.obj if not obj.is_file()]
    if missing:
        parser.error(f"no such file: {', '.join(missing)}")
    options.drystone = shutil.which(options.drystone) or parser.error(f"--drystone: no program {options.drystone}")

    driver = build_driver()
    lines = heading(options)
    with tempfile.TemporaryDirectory(dir=options.scratch) as scratch:
        for obj in options.obj:
            lines += compare(obj.resolve(), options, driver, pathlib.Path(scratch))
    write("\n".join(lines), options.write)


if __name__ == "__main__":
    main()
