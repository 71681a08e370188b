"""A job whose calls that change files are counted, recorded or go wrong: what at_calls.py and power_cuts.py share.

The counting is done by calls.c, which is compiled here and loaded into the program (Linux, and a C compiler, as Rust's
linker is).
"""

import hashlib
import os
import shlex
import shutil
import subprocess
import time
from dataclasses import dataclass
from pathlib import Path

OLDER = b"# an older result\n"


@dataclass(frozen=True)
class Call:
    """One call that changed files, as calls.c recorded it; calls that failed have numbers, too."""

    number: int
    operation: str
    path: str
    offset: int
    target: str
    written: bytes


def read_log(path):
    """All calls of a log, in the order in which the system saw them."""
    log, at, calls = path.read_bytes(), 0, []
    while at < len(log):
        end = log.index(b"\n", at)
        number, operation, name, offset, rest = log[at:end].decode().split("\t")
        length = int(rest) if operation == "write" else 0
        at = end + 1 + length
        calls.append(Call(int(number), operation, name, int(offset), "" if length else rest, log[end + 1 : at]))
    return calls


class Job:
    """A simplification below `folder`: work in work/, the result in out/, where an older one stands before it.

    With tasks, other processes do them, and the calls are those of the `coordinator` alone or of its `tasks` alone.
    """

    def __init__(self, folder, binary, mesh, tasks=None, options=()):
        self.folder = Path(os.path.realpath(folder))
        self.root = self.folder / "disk"
        self.out, self.result, self.work = self.root / "out", self.root / "out" / "result.obj", self.root / "work"
        self.log = self.folder / "log"
        self.library = self.folder / "calls.so"
        source = Path(__file__).with_name("calls.c")
        subprocess.run(["cc", "-O2", "-shared", "-fPIC", "-o", self.library, source, "-ldl", "-lpthread"], check=True)
        command = [Path(binary).resolve(), "simplify", Path(mesh).resolve(), "-o", self.result, "--work", self.work]
        command += ["--ratio", "0.1", "--cluster-faces", "2000", "--memory", "256MiB", "--threads", "2", "--force", "--quiet"]
        command += options
        self.tasks = tasks
        if tasks:
            task = shlex.join([str(Path(binary).resolve()), "task"]) + " {stage} N --threads 1 --memory 256MiB --quiet"
            line = f'seq 0 {{last}} | xargs -P {1 if tasks == "tasks" else 2} -I N env LD_PRELOAD="$TASK_PRELOAD" {task}'
            command += ["--task-runner", line, "--tasks", "4"]
        self.command = list(map(str, command))

    def empty(self):
        """Nothing is there."""
        # Tasks of a job that was killed may still be at work.
        for _ in range(100):
            shutil.rmtree(self.root, ignore_errors=True)
            if not self.root.exists():
                break
            time.sleep(0.1)
        self.root.mkdir()

    def fresh(self):
        """Nothing is there but the older result."""
        self.empty()
        self.out.mkdir()
        self.result.write_bytes(OLDER)

    def run(self, **settings):
        """Runs the program; with settings, under calls.c."""
        environment = dict(os.environ, TASK_PRELOAD="")
        if settings:
            loaded = "TASK_PRELOAD" if self.tasks == "tasks" else "LD_PRELOAD"
            environment |= {loaded: str(self.library), "FAULT_ROOT": str(self.root)} | settings
        streams = {"stdin": subprocess.DEVNULL, "stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE}
        return subprocess.run(self.command, env=environment, text=True, **streams)

    def record(self):
        """Every call of an undisturbed run."""
        self.fresh()
        self.run(FAULT_LOG=str(self.log)).check_returncode()
        return read_log(self.log)

    def digest(self):
        """Of all files of the result: their names and bytes."""
        files = sorted(path for path in self.out.rglob("*") if path.is_file())
        return [(str(path.relative_to(self.out)), hashlib.sha256(path.read_bytes()).hexdigest()) for path in files]

    def is_whole(self, expected):
        """Whether what bears the result's name is the older or the new one, whole."""
        found = hashlib.sha256(self.result.read_bytes()).hexdigest() if self.result.exists() else None
        return found in (hashlib.sha256(OLDER).hexdigest(), dict(expected)["result.obj"])


def spread(points, count):
    """So many of the points, evenly spread."""
    step = max(1, len(points) / max(1, count))
    return [points[int(i * step)] for i in range(min(len(points), count))]
