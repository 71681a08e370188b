"""Stops calls of the Python package at random times, and tells how long each took to end.

    .venv/bin/python tools/faults/stops.py city.obj
    .venv/bin/python tools/faults/stops.py city.obj --only bake tile --seed 7

A job is called again after each stop until it is done; a call that does not resume is stopped later each time. Fails if a
call took longer than five seconds to end, or if a job gives other bytes than one that nobody stopped.
"""

import argparse
import random
import sys
import tempfile
import threading
import time
from pathlib import Path

import drystone

LIMIT_SECONDS = 5.0


class Stopper:
    """Stops a call after some seconds, and knows the phase that it was in."""

    def __init__(self, seconds):
        self.token, self.phase, self.stopped = drystone.Stop(), "", None
        self.timer = threading.Timer(seconds, self.stop)

    def stop(self):
        self.at = self.phase or "start"
        self.stopped = time.monotonic()
        self.token.set()

    def hear(self, event):
        self.phase = event.phase

    def seconds(self, call):
        """How long the call took to end once it was asked to; None if it was done before."""
        self.timer.start()
        try:
            call(stop=self.token, progress=self.hear)
        except drystone.StoppedError:
            return time.monotonic() - self.stopped
        finally:
            self.timer.cancel()
        return None


def campaign(call, delays, resumes):
    """The longest time that a stop took in each phase, and whether a job that resumes is done."""
    longest = {}
    for delay in delays:
        stopper = Stopper(delay)
        took = stopper.seconds(call)
        if took is not None:
            longest[stopper.at] = max(took, longest.get(stopper.at, 0.0))
        elif resumes:
            return longest, True
    return longest, False


def contents(folder):
    """The bytes of the files of a result, without its report, which has times."""
    files = (path for path in folder.rglob("*") if path.is_file() and path.suffix != ".html")
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


def jobs(mesh):
    """Jobs that resume, by name: each with the folder of its result."""
    return {
        "simplify": lambda out, **more: drystone.simplify(
            mesh, out / "a.obj", ratio=0.1, report=out / "a.html", **more
        ),
        "bake": lambda out, **more: drystone.simplify(mesh, out / "a.obj", ratio=0.1, textures="bake", **more),
        "tile": lambda out, **more: drystone.tile(mesh, out / "tiles", **more),
    }


def looks(mesh):
    """Calls that begin from the start each time, by name."""
    return {
        "check": lambda **more: drystone.check(mesh, **more),
        "inspect": lambda **more: drystone.inspect(mesh, **more),
        "compare": lambda **more: drystone.compare(mesh, mesh, **more),
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("mesh", type=Path)
    names = [*jobs(None), *looks(None)]
    parser.add_argument("--only", nargs="+", choices=names, default=names, metavar="CALL", help=", ".join(names))
    parser.add_argument("--stops", type=int, default=12, help="stops of each call, at most (default 12)")
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    chance, faults = random.Random(arguments.seed), 0

    def tell(name, longest, is_same=True):
        nonlocal faults
        is_late = any(seconds > LIMIT_SECONDS for seconds in longest.values())
        faults += is_late + (not is_same)
        told = ", ".join(f"{phase} {seconds:.1f} s" for phase, seconds in sorted(longest.items(), key=lambda x: -x[1]))
        print(f"{name:9} {told or 'not stopped'}{'' if is_same else '; OTHER BYTES'}", flush=True)

    with tempfile.TemporaryDirectory() as folder:
        for name, job in jobs(arguments.mesh).items():
            if name in arguments.only:
                alone, stopped = (Path(folder) / f"{name}-{what}" for what in ("alone", "stopped"))
                alone.mkdir()
                stopped.mkdir()
                began = time.monotonic()
                job(alone)
                whole = time.monotonic() - began
                delays = (chance.uniform(0, whole) for _ in range(arguments.stops))
                longest, is_done = campaign(lambda **more: job(stopped, **more), delays, resumes=True)
                if not is_done:
                    job(stopped)
                tell(name, longest, contents(alone) == contents(stopped))
        for name, look in looks(arguments.mesh).items():
            if name in arguments.only:
                began = time.monotonic()
                look()
                whole = time.monotonic() - began
                delays = (whole * (at + chance.random()) / arguments.stops for at in range(arguments.stops))
                tell(name, campaign(look, delays, resumes=False)[0])
    sys.exit(faults > 0)


if __name__ == "__main__":
    main()
