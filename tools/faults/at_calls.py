"""Lets a job's calls that change files go wrong, in any thread, one job for each call, and then lets it go on.

    python3 tools/faults/at_calls.py target/release/drystone fixtures/town/town.obj --points 100000
    python3 tools/faults/at_calls.py target/release/drystone fixtures/town/town.obj --tasks coordinator

A run counts the calls. Then each of them (or so many, evenly spread) goes wrong in every way, in a job of its own:

- kill, half: SIGKILL before the call is done, or when half of its bytes are written;
- full: the disk has no space for it, nor for any later call;
- error: an I/O error, once;
- interrupt, short: a signal came first, or only half of the bytes were written: the job ends as if nothing had been.

Under its own name the result must then be the older one or whole; a job that was not killed ends with the result or with
an error message and its exit code; and after the same command once more there are the bytes of an undisturbed run.

With `--tasks`, other processes do the job's tasks. Then the calls are those of the coordinator alone; or those of the tasks
alone, and each task meets the fault whenever it is tried, as on a machine that is broken.
"""

import argparse
import sys
import tempfile
from collections import Counter
from pathlib import Path

from calls import Job, spread

KINDS = ["kill", "half", "full", "error", "interrupt", "short"]
# Exit codes of an error that the system made: failed, no space, damaged.
CLEAN_ERRORS = {"full": [7], "error": [1, 8]}


def outcome(job, kind, ended, expected):
    """What became of a job: "killed", "error" or "result"; None if that is not how it should have ended."""
    if job.tasks == "tasks" and ended.returncode == 1 and "has no result after 3 tries" in ended.stderr:
        # Tasks that have no room to say why they failed.
        return {"kill": "killed", "half": "killed", "full": "error"}.get(kind)
    if ended.returncode == -9:
        return "killed" if kind in ("kill", "half") else None
    if ended.returncode == 0:
        return "result" if job.digest() == expected else None
    told = ended.stderr.startswith("error: ") and "panicked" not in ended.stderr
    return "error" if told and ended.returncode in CLEAN_ERRORS.get(kind, []) else None


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("binary", type=Path)
    parser.add_argument("mesh", type=Path)
    parser.add_argument("--points", type=int, default=400, help="calls that go wrong, at most, for each way")
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=KINDS, help="ways to go wrong")
    parser.add_argument("--tasks", choices=["coordinator", "tasks"], help="whose calls, if others do the job's tasks")
    arguments = parser.parse_args()
    faults = 0
    with tempfile.TemporaryDirectory() as scratch:
        job = Job(scratch, arguments.binary, arguments.mesh, arguments.tasks)
        count = max(call.number for call in job.record())
        expected = job.digest()
        # The tasks of a job make more or fewer calls.
        least = 0.5 if job.tasks == "tasks" else 0.9
        for kind in arguments.kinds:
            outcomes = Counter()
            for number in spread(range(1, count + 1), arguments.points):
                job.fresh()
                ended = job.run(FAULT_AT=str(number), FAULT_KIND=kind)
                whole, became = job.is_whole(expected), outcome(job, kind, ended, expected)
                again = job.run()
                outcomes[became] += 1
                if not whole or not became or again.returncode != 0 or job.digest() != expected:
                    faults += 1
                    print(f"{kind} at call {number}, whole {whole}: {ended.returncode} {ended.stderr.strip()[-200:]}")
                    print(f"    again: {again.returncode} {again.stderr.strip()[-200:]}")
            told = ", ".join(f"{times} {became}" for became, times in sorted(outcomes.items(), key=str))
            print(f"{kind}: {sum(outcomes.values())} of {count} calls: {told}", flush=True)
            if kind in ("kill", "half") and outcomes["killed"] < sum(outcomes.values()) * least:
                faults += 1
                print(f"{kind}: too few jobs were killed")
    print(f"{faults} faults")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
