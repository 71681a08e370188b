"""Runs of the program on one mesh, and what `drystone compare` and `check` find about them.

Each run is one pass over one cluster by one thread, unless said otherwise, as the papers' programs work. What was measured
is kept beside the result under the hash of the program, the mesh and the options, so that a second run of the script only
runs what is new. Times are measured apart, by `timed`.
"""

import hashlib
import json
import os
import random
import re
import subprocess
import time
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np

PROGRAM = Path(os.environ.get("DRYSTONE", "target/release/drystone"))
FOLDER = Path("target/reproduce")
SHARED = Path(os.environ.get("DRYSTONE_SHARED", "../shared")) / "data"
SAMPLES = "200000"
ONE_CLUSTER = ["--passes", "1", "--cluster-faces", "10000000", "--memory", "8GiB"]
# Runs of which the median time counts, and orders of a mesh of which the median figure does.
REPEATS = 5


@lru_cache
def hash_of(path):
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()


def options_of(text):
    """Command line options from the words of a system's name: `sharpness sigma=0 --optimize`."""
    metric, *words = text.split()
    options = ["--metric", metric]
    for word in words:
        options += [word] if word.startswith("--") or "=" not in word else ["--metric-option", word]
    return options


class Result:
    """A simplified mesh with its measurements."""

    def __init__(self, original, path, told):
        self.original, self.path, self.told = original, path, told

    def kept(self, name, make):
        """What was measured before, or is measured now."""
        file = self.path.with_suffix(f".{name}.json")
        if not file.exists():
            half = file.with_suffix(".half")
            half.write_text(json.dumps(make()))
            half.replace(file)
        return json.loads(file.read_text())

    def compare(self, *more):
        done = call("compare", self.original, self.path, "--json", "-q", *more)
        return json.loads(done.stdout)

    @cached_property
    def by_area(self):
        return self.kept("by-area", lambda: self.compare("--samples", SAMPLES))

    @cached_property
    def at_vertices(self):
        """From the vertices of the result to the original: the measure of many papers."""
        return self.kept("at-vertices", lambda: self.compare("--vertices")["geometry"])["forward"]

    @cached_property
    def checked(self):
        def check():
            done = call("check", self.path, "--against", self.original, fine=(0, 1))
            found = re.findall(r"^(\S.*?) {2,}(\S+) +\(before: (\S+)\)", done.stdout, re.MULTILINE)
            return {"is_whole": done.returncode == 0, "counts": {name: [int(after), int(before)] for name, after, before in found}}

        return self.kept("checked", check)

    @property
    def diagonal(self):
        return self.by_area["geometry"]["diagonal"]

    def distances(self, way="symmetric"):
        """Largest, mean and root mean square distance: `symmetric`, `forward` (result to original) or `vertices` (the same, at its vertices)."""
        found = self.at_vertices if way == "vertices" else self.by_area["geometry"][way]
        return [found["max"], found["mean"], found["rms"]]

    @property
    def faces(self):
        return self.by_area["topology"]["after"]["faces"]

    @property
    def border_edges(self):
        return self.by_area["topology"]["after"]["boundary_edges"]

    @property
    def quality(self):
        return self.by_area["quality"]["after"]

    @property
    def texture(self):
        return self.by_area["texture"]

    @property
    def mirrored(self):
        """Texture triangles that run against most of their chart, beyond those of the original."""
        return self.more_than_before("folded texture triangles")

    @property
    def turned_over(self):
        """Texture triangles of negative area beyond those of the original."""
        return self.more_than_before("uv negative")

    def more_than_before(self, count):
        after, before = self.checked["counts"].get(count, [0, 0])
        return max(after - before, 0)


def call(*words, fine=(0,)):
    done = subprocess.run([str(PROGRAM), *map(str, words)], capture_output=True, text=True)
    if done.returncode not in fine:
        raise SystemExit(f"{words}: {done.returncode}\n{done.stderr}")
    return done


def words_of(system, target, options=(), whole=True):
    """A system's options and its target: a share of the triangles (a float) or so many (an int)."""
    share = [] if target is None else ["--faces", str(target)] if isinstance(target, int) else ["--ratio", str(target)]
    return [*options_of(system), *share, *(ONE_CLUSTER if whole else []), *map(str, options)]


def command_of(mesh, result, words, told):
    return ["simplify", mesh, "-o", result, *words, "--textures", "reference", "--force", "--threads", "1", "-q", "--report", told]


def key_of(*words):
    return hashlib.sha256("\n".join([hash_of(PROGRAM), *words]).encode()).hexdigest()[:16]


def run(mesh, system, target=None, *options, original=None, whole=True):
    """Simplifies a mesh by a system to a share of its triangles or to so many."""
    words = words_of(system, target, options, whole)
    result = FOLDER / "runs" / f"{mesh.stem}-{key_of(hash_of(mesh), str(original), *words)}.obj"
    told = result.with_suffix(".run.json")
    if not told.exists():
        result.parent.mkdir(parents=True, exist_ok=True)
        half = result.with_suffix(".half.json")
        call(*command_of(mesh, result, words, half), fine=(0, 3))
        half.replace(told)
    return Result(original or mesh, result, json.loads(told.read_text()))


def timed(cases, repeats=REPEATS, phases=False):
    """Seconds of processor time of some runs, each repeated, in shuffled order.

    A case is a mesh, a system, a target and further options. Of each: what `Times` has, a list of as many figures as repeats;
    those of phases only if asked for, since they cost some.
    """
    commands = [(mesh, words_of(system, target, options)) for mesh, system, target, *options in cases]
    key = key_of(str(phases), *(word for mesh, words in commands for word in (hash_of(mesh), *words)))
    (FOLDER / "times").mkdir(parents=True, exist_ok=True)
    found = [[] for _ in commands]
    for repeat in range(repeats):
        kept = FOLDER / "times" / f"{key}-{repeat}.json"
        if not kept.exists():
            spent = {}
            for at in random.Random(repeat).sample(range(len(commands)), len(commands)):
                mesh, words = commands[at]
                out = FOLDER / "times" / f"{os.getpid()}.obj"
                spent[at] = spend(command_of(mesh, out, words, out.with_suffix(".json")), out.with_suffix(".json"), phases)
            kept.write_text(json.dumps([spent[at] for at in range(len(commands))]))
        for one, own in zip(json.loads(kept.read_text()), found):
            own.append(one)
    return [Times(own) for own in found]


class Times:
    """Seconds of user time of the whole process in each repeat, and of processor time in two of its phases."""

    def __init__(self, repeats):
        self.user, self.collapse, self.remesh = ([one[name] for one in repeats] for name in ("user", "collapse", "remesh"))

    @property
    def cells(self):
        """Where cells are all the work, they are what takes the time."""
        return [a + b for a, b in zip(self.collapse, self.remesh)]


def over(found, base):
    """Of each repeat the ratio of two figures."""
    return [a / b if b else np.inf for a, b in zip(found, base)]


def spend(command, told, phases):
    """Runs the program; to know the processor time of a phase, reads that of its threads again and again, about every 4 ms of it."""
    began, at, spent, threads = time.monotonic(), [0.0], [0.0], {}
    program = subprocess.Popen([str(PROGRAM), *map(str, command)], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    while True:
        done, status, used = os.wait4(program.pid, os.WNOHANG if phases else 0)
        if done:
            break
        for thread in os.listdir(f"/proc/{program.pid}/task"):
            try:
                with open(f"/proc/{program.pid}/task/{thread}/schedstat") as file:
                    threads[thread] = int(file.read().split()[0]) / 1e9
            except (OSError, IndexError):
                pass
        at.append(time.monotonic() - began)
        spent.append(sum(threads.values()))
        time.sleep(min(0.004 * max(at[-1] / max(spent[-1], 1e-3), 1), 0.2))
    program.returncode = os.waitstatus_to_exitcode(status)
    if program.returncode not in (0, 3):
        raise SystemExit(f"{command}: {program.returncode}\n{program.stderr.read().decode()}")
    program.stderr.close()
    steps = json.loads(told.read_text())["timeline"]["phases"] if phases else []
    within = lambda *names: sum(float(np.diff(np.interp([step["begin"], step["end"]], at, spent))[0]) for step in steps if step["name"] in names)
    return {"user": used.ru_utime, "collapse": within("simplify", "stitch"), "remesh": within("weigh", "remesh")}
