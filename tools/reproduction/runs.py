"""Runs of the program on one mesh, and what `drystone compare` and `check` find about them.

Each run is one pass over one cluster by one thread, unless said otherwise, as the papers' programs work. What was measured
is kept beside the result under the hash of the program, the mesh and the options, so that a second run of the script only
runs what is new.
"""

import hashlib
import json
import os
import re
import resource
import subprocess
from functools import cached_property, lru_cache
from pathlib import Path

PROGRAM = Path(os.environ.get("DRYSTONE", "target/release/drystone"))
FOLDER = Path("target/reproduce")
SHARED = Path(os.environ.get("DRYSTONE_SHARED", "../shared")) / "data"
SAMPLES = "200000"
ONE_CLUSTER = ["--passes", "1", "--cluster-faces", "10000000", "--memory", "8GiB"]
# A run is repeated, and the least of its times counts.
REPEATS = 3


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

    def __init__(self, original, path, told, seconds):
        self.original, self.path, self.told = original, path, told
        self.cpu, self.collapse_seconds, self.remesh_seconds = seconds["cpu"], seconds["collapse"], seconds["remesh"]

    def kept(self, name, make):
        """What was measured before, or is measured now."""
        file = self.path.with_suffix(f".{name}.json")
        if not file.exists():
            file.write_text(json.dumps(make()))
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


def run(mesh, system, target=None, *options, original=None, whole=True, repeats=REPEATS):
    """Simplifies a mesh by a system to a share of its triangles (a float) or to so many (an int)."""
    share = [] if target is None else ["--faces", str(target)] if isinstance(target, int) else ["--ratio", str(target)]
    words = [*options_of(system), *share, *(ONE_CLUSTER if whole else []), *map(str, options)]
    key = hashlib.sha256("\n".join([hash_of(PROGRAM), hash_of(mesh), str(original), *words]).encode()).hexdigest()[:16]
    result = FOLDER / "runs" / f"{mesh.stem}-{key}.obj"
    told, seconds = result.with_suffix(".run.json"), result.with_suffix(".cpu.json")
    if not seconds.exists():
        result.parent.mkdir(parents=True, exist_ok=True)
        command = ["simplify", mesh, "-o", result, *words, "--textures", "reference", "--force", "--threads", "1", "-q", "--report", told]
        spent = [times_of(command, told) for _ in range(repeats if whole else 1)]
        seconds.write_text(json.dumps({name: min(one[name] for one in spent) for name in spent[0]}))
    return Result(original or mesh, result, json.loads(told.read_text()), json.loads(seconds.read_text()))


def times_of(command, told):
    """Processor seconds of the whole process; seconds of the collapse, and of the reconstruction before it."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    call(*command, fine=(0, 3))
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    report = json.loads(told.read_text())
    remesh = sum(phase["end"] - phase["begin"] for phase in report["timeline"]["phases"] if phase["name"] in ("weigh", "remesh"))
    collapse = report["seconds"]["simplify"] + report["seconds"]["stitch"]
    return {"cpu": after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, "collapse": collapse, "remesh": remesh}

