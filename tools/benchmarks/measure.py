#!/usr/bin/env python3
"""measure.py NAME IN.obj --log FILE [--referee COMMAND] [--check] [--keep] -- OPTION...: one measured run of drystone.

    tools/benchmarks/measure.py town fixtures/town/town.obj --scratch out --log runs.jsonl --check -- --ratio 0.1

Runs `drystone simplify IN.obj OPTION...` in a folder of its own below --scratch and appends one line of JSON to --log:
name, options, load of the machine, numbers of the report, processor seconds, peak memory as the kernel counts it,
SHA-256 of the OBJ.  --check adds `drystone check` and tools/check_mesh.py, each against the input.  --referee adds the
last line that COMMAND prints, as JSON, when called with the input, the result and, if there are texcoords, `--tex`.
The result is deleted unless --keep.  Standard library only.
"""
import argparse
import hashlib
import json
import os
import platform
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

CHECKER = Path(__file__).resolve().parents[1] / "check_mesh.py"


def machine():
    """Processors, memory and system."""
    models = {line.partition(":")[2].strip() for line in open("/proc/cpuinfo") if line.startswith("model name")} if os.path.exists("/proc/cpuinfo") else set()
    model = " ".join("".join(models).split()) or platform.machine()
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    return f"{os.cpu_count()} processors ({model}), {memory:.0f} GiB of memory, {platform.system()}"


def run(command, **options):
    return subprocess.run([str(word) for word in command], capture_output=True, text=True, **options)


def sha256(path):
    with open(path, "rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def has_texcoords(path):
    with open(path, "rb") as stream:
        return any(line.startswith(b"vt") for line in stream)


def spend(command):
    """What a process takes: exit code, wall and processor seconds, peak bytes as the kernel counts them; what it printed, its errors.

    NOTE: the kernel's peak includes this script's own size at the fork, about 15 MB: a floor far below any run here.
    """
    with tempfile.TemporaryFile("w+") as printed, tempfile.TemporaryFile("w+") as errors:
        os.sync()  # what the last run wrote must not reach the disk at this run's expense
        began = time.monotonic()
        program = subprocess.Popen([str(word) for word in command], stdout=printed, stderr=errors)
        _, status, used = os.wait4(program.pid, 0)
        wall = time.monotonic() - began
        program.returncode = os.waitstatus_to_exitcode(status)
        texts = []
        for stream in (printed, errors):
            stream.seek(0)
            texts.append(stream.read())
    row = {
        "exit": program.returncode,
        "wall_seconds": wall,
        "cpu_seconds": used.ru_utime + used.ru_stime,
        "max_resident": used.ru_maxrss * 1024,
    }
    return row, *texts


def simplify(binary, source, result, options):
    """What one run takes, and its report if there is one. Textures are linked unless the options say otherwise."""
    report = result.with_suffix(".json")
    textures = [] if "--textures" in options else ["--textures", "link"]
    command = [binary, "simplify", source, "-o", result, "--force", "--quiet", *textures, "--report", report, *options]
    row, _, errors = spend(command)
    if errors:
        row["stderr"] = errors[-500:]
    if report.exists():
        told = json.loads(report.read_text())
        row |= {key: told[key] for key in ("status", "faces", "error", "seconds", "memory", "io", "passes", "repairs")}
    return row


def draw_from_arguments(doc, make):
    """Calls make(program, folder) with what the command line names, and prints the lines that it returns."""
    parser = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, metavar="FOLDER")
    parser.add_argument("--drystone", default="target/release/drystone")
    options = parser.parse_args()
    print(*make(options.drystone, options.folder), sep="\n")


def main():
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("name")
    arguments.add_argument("source", type=Path)
    arguments.add_argument("--binary", default="drystone")
    arguments.add_argument("--scratch", type=Path, default=Path("."))
    arguments.add_argument("--log", type=Path, required=True)
    arguments.add_argument("--referee", help="command that compares two OBJ files and prints JSON")
    arguments.add_argument("--check", action="store_true")
    arguments.add_argument("--keep", action="store_true")
    own, options = sys.argv[1:], []
    if "--" in own:
        cut = own.index("--")
        own, options = own[:cut], own[cut + 1 :]
    asked = arguments.parse_args(own)

    folder = (asked.scratch / asked.name).resolve()
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    source, result = asked.source.resolve(), folder / "out.obj"
    load = os.getloadavg()[0]
    row = {"name": asked.name, "input": source.name, "options": options, "load": load}
    row |= simplify(asked.binary, source, result, options)
    if result.exists():
        row["sha256"] = sha256(result)
        if asked.check:
            row["check"] = json.loads(run([asked.binary, "check", result, "--against", source, "--json"]).stdout or "null")
            row["check_mesh"] = json.loads(run([sys.executable, CHECKER, result, "--against", source, "--json"]).stdout or "null")
        if asked.referee:
            textured = ["--tex"] if has_texcoords(source) else []
            judged = run([*shlex.split(asked.referee), source, result, *textured], cwd=folder)
            lines = judged.stdout.splitlines()
            row["referee"] = json.loads(lines[-1]) if lines else {"failed": judged.stderr[-500:]}
    with open(asked.log, "a", encoding="utf-8") as log:
        log.write(json.dumps(row) + "\n")
    if not asked.keep:
        shutil.rmtree(folder)
    print(json.dumps({key: row.get(key) for key in ("name", "exit", "wall_seconds", "cpu_seconds", "faces")}))


if __name__ == "__main__":
    main()
