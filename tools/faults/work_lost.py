"""Kills a job at random moments and tells how much processor time each kill costs.

    python3 tools/faults/work_lost.py target/release/drystone city.obj --kills 40 -- --cluster-faces 20000
    python3 tools/faults/work_lost.py target/release/drystone large.obj --chain --kills 10 --undisturbed 1

An undisturbed run, repeated, gives the processor time of the work and the bytes of the result. Then each kill (SIGKILL)
gets a job of its own and strikes after a random share of that time; the same command goes on from there. Lost is what both runs
took together beyond the undisturbed one, as a share of it. With `--chain` there is one job that meets all kills on its way.
Options after `--` go to the program. Linux.
"""

import argparse
import hashlib
import os
import random
import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

POLL_SECONDS = 0.001


def processor_seconds(process):
    """Of all threads of a running process, from its processor clock."""
    return time.clock_gettime((~process.pid << 3) | 2)


def run(command, limit=None):
    """Seconds of processor time, and whether the process was killed on reaching the limit."""
    process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stderr=subprocess.PIPE)
    killed = False
    while limit is not None and not killed:
        try:
            killed = processor_seconds(process) >= limit
        except OSError:
            break  # it has ended
        if not killed:
            time.sleep(POLL_SECONDS)
    if killed:
        process.send_signal(signal.SIGKILL)
    words = process.stderr.read()
    _, status, usage = os.wait4(process.pid, 0)
    code = process.returncode = os.waitstatus_to_exitcode(status)
    if code not in (0, -signal.SIGKILL):
        sys.exit(f"exit code {code}: {words.decode(errors='replace').strip()[-400:]}")
    return usage.ru_utime + usage.ru_stime, code != 0


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("binary", type=Path)
    parser.add_argument("mesh", type=Path)
    parser.add_argument("--kills", type=int, default=40)
    parser.add_argument("--undisturbed", type=int, default=5, help="runs that are left alone (default 5)")
    parser.add_argument("--chain", action="store_true", help="all kills strike one job, one after the other")
    parser.add_argument("--seed", type=int, default=1, help="number that chooses the moments")
    own, options = sys.argv[1:], []
    if "--" in own:
        cut = own.index("--")
        own, options = own[:cut], own[cut + 1 :]
    arguments = parser.parse_args(own)
    moments = random.Random(arguments.seed)
    with tempfile.TemporaryDirectory() as scratch:
        out, work = Path(scratch, "out"), Path(scratch, "work")
        command = [arguments.binary.resolve(), "simplify", arguments.mesh.resolve(), "-o", out / "result.obj"]
        command = [*map(str, command), "--work", str(work), "--ratio", "0.1", "--memory", "512MiB", "--force", "--quiet", *options]

        def fresh():
            shutil.rmtree(out, ignore_errors=True)
            shutil.rmtree(work, ignore_errors=True)

        def digest():
            return hashlib.sha256((out / "result.obj").read_bytes()).hexdigest()

        calm = []
        for _ in range(arguments.undisturbed):
            fresh()
            calm.append(run(command)[0])
        expected, whole = digest(), statistics.median(calm)
        print(f"undisturbed: {whole:.2f} s of processor time ({min(calm):.2f} to {max(calm):.2f})", flush=True)
        lost, faults = [], 0
        if arguments.chain:
            fresh()
            spent, kills = 0, 0
            while kills < arguments.kills:
                seconds, killed = run(command, whole * (0.5 + moments.random()) / (arguments.kills + 1))
                spent += seconds
                if not killed:
                    break
                kills += 1
                print(f"killed after {seconds:.2f} s", flush=True)
            else:
                spent += run(command)[0]
            same = digest() == expected
            print(f"one job, {kills} kills: {spent:.2f} s in all, the bytes are {'the same' if same else 'OTHERS'}; "
                  f"lost per kill: {(spent / whole - 1) / max(1, kills):.1%}")
            return 0 if same and kills == arguments.kills else 1
        while len(lost) < arguments.kills:
            fresh()
            before, killed = run(command, moments.random() * whole)
            if not killed:
                continue
            after, _ = run(command)
            lost.append((before + after) / whole - 1)
            faults += digest() != expected
        lost.sort()
        shown = ", ".join(f"{name} {share:.1%}" for name, share in [
            ("median", statistics.median(lost)), ("mean", statistics.mean(lost)),
            ("nine of ten below", lost[len(lost) * 9 // 10]), ("most", lost[-1])])
        print(f"{len(lost)} kills, {faults} results differ; lost per kill: {shown}")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
