#!/usr/bin/env python3
"""machines.py NAME=IN.obj...: one job with its tasks in other processes, as tables of Markdown on stdout.

    python3 tools/benchmarks/machines.py city=city.obj

Runs each job on two threads; with two tasks at a time of one thread each, by xargs; and by the workers of a Dask cluster on
this machine, if `distributed` is installed. All results must have the same bytes. Several runs of each, in turn; the ratio
is that of the medians.
"""

import argparse
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import measure

ROOT = Path(__file__).resolve().parents[2]
PROGRAM = ROOT / "target" / "release" / "drystone"
LIMITS = ["--threads", "1", "--memory", "1GiB"]
JOBS = {
    "10 %": ["--ratio", "0.1"],
    "10 %, remeshed": ["--ratio", "0.1", "--remesh", "cvd"],
    "10 %, new textures": ["--ratio", "0.1", "--textures", "bake"],
}


def seconds_of(mesh, folder, options):
    """Seconds of a run, and the hash of its result."""
    output = folder / "out.obj"
    began = time.monotonic()
    command = [PROGRAM, "simplify", mesh, "-o", output, "--quiet", "--force", "--memory", "1GiB", *options]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return time.monotonic() - began, measure.sha256(output)


def ways(cluster):
    """How the tasks are done: name, and options."""
    tasks = " ".join(LIMITS)
    xargs = f"seq 0 {{last}} | xargs -P 2 -I N '{PROGRAM}' task {{stage}} N {tasks} --quiet"
    yield "one process, two threads", ["--threads", "2"]
    yield "two tasks at a time, by xargs", ["--threads", "2", "--task-runner", xargs, "--tasks", "16"]
    if cluster is not None:
        dask = f"'{sys.executable}' -m drystone.dask {cluster.scheduler_address} {{stage}} {{count}} {tasks}"
        dask += f" --program '{PROGRAM}'"
        yield "two workers of Dask", ["--threads", "2", "--task-runner", dask, "--tasks", "16"]


def start_cluster():
    try:
        from distributed import LocalCluster
    except ImportError:
        print("NOTE: no `distributed`: no row of Dask", file=sys.stderr)
        return None
    return LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("meshes", nargs="+", metavar="NAME=IN.obj")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--jobs", nargs="+", choices=JOBS, default=list(JOBS))
    given = parser.parse_args()
    cluster = start_cluster()
    print("| Mesh | Job | Who does the tasks | Seconds | Ratio |\n| --- | --- | --- | ---: | ---: |")
    for name, _, path in (word.partition("=") for word in given.meshes):
        for job in given.jobs:
            found = {}
            for _ in range(given.repeats):
                for way, options in ways(cluster):
                    with tempfile.TemporaryDirectory() as folder:
                        run = seconds_of(Path(path).resolve(), Path(folder), [*JOBS[job], *options])
                    found.setdefault(way, []).append(run)
            hashes = {digest for runs in found.values() for _, digest in runs}
            if len(hashes) != 1:
                raise SystemExit(f"{name}, {job}: the results differ")
            medians = {way: statistics.median(seconds for seconds, _ in runs) for way, runs in found.items()}
            alone = next(iter(medians.values()))
            for way, seconds in medians.items():
                print(f"| {name} | {job} | {way} | {seconds:.1f} | {seconds / alone:.2f} |", flush=True)
    if cluster is not None:
        cluster.close()


if __name__ == "__main__":
    main()
