"""Runs jobs on three pretend machines, and disturbs them.

    python3 tools/faults/machines.py target/release/drystone fixtures/town/town.obj
    python3 tools/faults/machines.py target/release/drystone city.obj --only cable suspended

Each machine has a network and a name of its own, and sees the shared folder as a network disk may show it: up to six
seconds late, with locks that do not reach the other machines. All jobs must give the bytes that one process gives.
Needs root, `bindfs` and `ip` (iproute2); the case `cable` also the Python package `distributed`. Linux.
"""

import argparse
import contextlib
import importlib.util
import os
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

MACHINES = 3
LATE_SECONDS = 6
# A job is divided into more clusters than its size asks for, so that there is something to lend.
OPTIONS = ["--ratio", "0.2", "--cluster-faces", "2000", "--threads", "1", "--memory", "256MiB", "--quiet"]
# Sizes of tiles likewise; what each command writes, and its options.
TILE_OPTIONS = ["--tile-faces", "1000", "--tile-side", "256", *OPTIONS[4:]]
RESULTS = {"simplify": ("out.obj", OPTIONS), "tile": ("tiles", TILE_OPTIONS)}
TASK_OPTIONS = "--threads 1 --memory 256MiB --quiet"
PATIENCE_SECONDS = 600
CUT_SECONDS = 40
BUSY, CHANGED, FULL = 6, 5, 7


def sh(line):
    subprocess.run(line, shell=True, check=True)


class Stand:
    """The machines. Folders: `base` is on a small disk of its own, and shown as `shared` on each machine."""

    def __init__(self, folder):
        self.folder = folder
        self.base, self.shared = folder / "base", folder / "shared"
        self.name = f"ds{os.getpid()}"

    def __enter__(self):
        with contextlib.ExitStack() as started:
            started.callback(self.take_down)
            for path in (self.base, self.shared):
                path.mkdir()
            sh(f"mount -t tmpfs -o size=2g tmpfs {shlex.quote(str(self.base))}")
            switch = f"ip -n {self.name}s"
            sh(f"ip netns add {self.name}s && {switch} link add br0 type bridge && {switch} link set br0 up")
            for machine in range(MACHINES):
                self.start(machine, switch)
            started.pop_all()
        return self

    def start(self, machine, switch):
        space, cable = f"{self.name}m{machine}", f"p{machine}"
        inside = f"ip -n {space}"
        sh(f"ip netns add {space} && {inside} link add e0 type veth peer name {cable} netns {self.name}s")
        sh(f"{inside} addr add {self.address(machine)}/24 dev e0")
        sh(f"{inside} link set lo up && {inside} link set e0 up")
        sh(f"{switch} link set {cable} master br0 && {switch} link set {cable} up")
        view = self.folder / f"view{machine}"
        view.mkdir()
        late = ",".join(f"{what}_timeout={LATE_SECONDS}" for what in ("attr", "entry", "negative", "ac_attr"))
        sh(f"bindfs -o {late} {shlex.quote(str(self.base))} {shlex.quote(str(view))}")

    def __exit__(self, *_):
        self.take_down()

    def take_down(self):
        for machine in range(MACHINES):
            self.quietly("fusermount3", "-uz", str(self.folder / f"view{machine}"))
            self.quietly("ip", "netns", "del", f"{self.name}m{machine}")
        self.quietly("ip", "netns", "del", f"{self.name}s")
        self.quietly("umount", "-l", str(self.base))

    @staticmethod
    def quietly(*command):
        subprocess.run(command, capture_output=True)

    @staticmethod
    def address(machine):
        return f"10.77.0.{machine + 1}"

    def on(self, machine, *command):
        """The command line that runs a command on a machine."""
        inside = 'hostname "$1"; mount --make-rprivate /; mount --bind "$2" "$3"; shift 3; exec "$@"'
        view = self.folder / f"view{machine}"
        space = ["ip", "netns", "exec", f"{self.name}m{machine}", "unshare", "-m", "-u"]
        return [*space, "sh", "-c", inside, "sh", f"machine{machine}", str(view), str(self.shared), *map(str, command)]

    def set_cable(self, machine, state):
        sh(f"ip -n {self.name}s link set p{machine} {state}")

    def clear(self):
        """Removes what jobs left."""
        for name in ("out", "job.work"):
            shutil.rmtree(self.base / name, ignore_errors=True)
        (self.base / "out").mkdir()
        # The machines forget what they saw.
        time.sleep(LATE_SECONDS + 1)


class Job:
    """A job in the shared folder, whose coordinator is a machine."""

    def __init__(self, stand, program, mesh):
        self.stand, self.program, self.mesh = stand, program, mesh
        self.started = []
        # What is made: by `simplify` or by `tile`.
        self.verb = "simplify"
        inside = stand.base / "input"
        shutil.copytree(mesh.parent, inside)
        for verb, (name, options) in RESULTS.items():
            folder = stand.folder / f"expected-{verb}"
            folder.mkdir()
            alone = [program, verb, inside / mesh.name, "-o", folder / name, *options]
            subprocess.run(alone, check=True, stdout=subprocess.DEVNULL)

    def start(self, machine, *more):
        shared, (name, options) = self.stand.shared, RESULTS[self.verb]
        command = [self.program, self.verb, shared / "input" / self.mesh.name, "-o", shared / "out" / name]
        command += ["--work", shared / "job.work", *options, *more]
        streams = {"stdin": subprocess.DEVNULL, "stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE}
        process = subprocess.Popen(self.stand.on(machine, *command), text=True, **streams)
        self.started.append(process)
        return process

    def end_all(self):
        """Kills what a case that failed has left."""
        for process in self.started:
            if process.poll() is None:
                process.kill()
                process.communicate()
        self.started.clear()
        self.verb = "simplify"

    def by_tasks(self, machine, line):
        return self.start(machine, "--task-runner", line, "--tasks", "9")

    def has_expected_bytes(self):
        """Whether the result is that of one process, with nothing left beside it."""
        is_same = contents(self.stand.folder / f"expected-{self.verb}") == contents(self.stand.base / "out")
        return is_same and not (self.stand.base / "job.work").exists()


def contents(folder):
    """The bytes of all files below a folder, by name."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def ended(process):
    """Exit code and last words of a process."""
    _, words = process.communicate(timeout=PATIENCE_SECONDS)
    return process.returncode, words.strip()


def expect(code, found):
    if found[0] != code:
        raise AssertionError(f"expected exit code {code}, found {found[0]}: {found[1]}")


def until(holds, what):
    end = time.monotonic() + PATIENCE_SECONDS
    while not holds():
        if time.monotonic() > end:
            raise AssertionError(f"waited in vain until {what}")
        time.sleep(0.02)


class Cases:
    """What is tried; each case begins with an empty result folder."""

    def __init__(self, stand, program, mesh):
        self.stand, self.program = stand, program
        self.job = Job(stand, program, mesh)

    def runner(self, program=None, first="true"):
        """A runner that does each task on one of the machines; `first` runs before, and may end the task."""
        cases = []
        for machine in range(MACHINES):
            task = [program if machine == 2 and program else self.program, "task"]
            cases.append(f"{machine}) exec {shlex.join(self.stand.on(machine, *task))} \"$1\" \"$2\" {TASK_OPTIONS};;")
        script = self.stand.folder / "on-some-machine"
        choice = "\n".join([f"case $(($2 % {MACHINES})) in", *cases, "esac"])
        script.write_text(f'task() {{\n{choice}\n}}\n{first}\ntask "$@"\n')
        return f"seq 0 {{last}} | xargs -P {MACHINES} -I N sh {shlex.quote(str(script))} {{stage}} N"

    def slow_runner(self):
        """A runner that begins late with its first stage."""
        began = shlex.quote(str(Path(tempfile.mkdtemp(dir=self.stand.folder)) / "began"))
        return f"mkdir {began} 2>/dev/null && sleep 20; {self.runner()}"

    def well(self):
        expect(0, ended(self.job.by_tasks(0, self.runner())))

    def lost(self):
        """Every task is killed soon after it was begun for the first time."""
        folder = Path(tempfile.mkdtemp(dir=self.stand.folder))
        mark, killed = f"{shlex.quote(str(folder))}/$2", folder / "killed"
        note = f"[ $? = 137 ] && echo $2 >> {shlex.quote(str(killed))}"
        kill = f'task "$@" & sleep 0.0$2; kill -9 $!; wait $!; {note}; exit 1'
        first = f"mkdir {mark} 2>/dev/null && {{ {kill}; }}; rmdir {mark}"
        expect(0, ended(self.job.by_tasks(0, self.runner(first=first))))
        if not killed.exists():
            raise AssertionError("no task was killed")

    def tile(self):
        """Likewise, and a pyramid is made."""
        self.job.verb = "tile"
        self.lost()

    def build(self):
        """One machine has another build of the program."""
        other = self.stand.folder / "other"
        code = self.program.read_bytes()
        build = subprocess.run([self.program, "--version"], capture_output=True, text=True, check=True)
        # The date beside the build in `--version` is no part of it; the checksum of the sources is.
        words = b"sources " + build.stdout.split("sources ")[1].split(")")[0].encode()
        other.write_bytes(code.replace(words, words[:-1] + (b"0" if words[-1:] != b"0" else b"1")))
        other.chmod(0o755)
        found = ended(self.job.by_tasks(0, self.runner(program=other)))
        expect(CHANGED, found)
        if "this is drystone" not in found[1]:
            raise AssertionError(f"the message does not name the builds: {found[1]}")
        expect(0, ended(self.job.by_tasks(0, self.runner())))

    def full(self):
        """The shared disk is full, and has room again."""
        filler = self.stand.base / "filler"
        first = f'[ -e {shlex.quote(str(filler))} ] || head -c 4G /dev/zero > {shlex.quote(str(filler))} 2>/dev/null'
        found = ended(self.job.by_tasks(0, self.runner(first=first)))
        filler.unlink()
        expect(FULL, found)
        expect(0, ended(self.job.by_tasks(0, self.runner())))

    def second(self):
        """Another coordinator comes while the first one works."""
        first = self.job.by_tasks(0, self.slow_runner())
        until((self.stand.base / "job.work" / "lease").exists, "the first coordinator works")
        time.sleep(LATE_SECONDS)
        expect(BUSY, ended(self.job.start(1)))
        expect(0, ended(first))

    def suspended(self):
        """A coordinator is suspended; another one takes its job over, and is done before the first one wakes."""
        first = self.job.by_tasks(0, self.slow_runner())
        until((self.stand.base / "job.work" / "lease").exists, "the first coordinator works")
        time.sleep(LATE_SECONDS)
        # The process is the program itself: the commands before it were replaced by it.
        first.send_signal(signal.SIGSTOP)
        expect(0, ended(self.job.start(1)))
        first.send_signal(signal.SIGCONT)
        code, words = ended(first)
        if code not in (BUSY, CHANGED):
            raise AssertionError(f"the first coordinator ended with {code}: {words}")

    def cable(self):
        """Tasks by Dask; a machine is cut off for a while."""
        if importlib.util.find_spec("distributed") is None:
            print("NOTE: no Python package `distributed`: no cable was cut")
            return None
        dask = [sys.executable, "-m"]
        head = f"tcp://{self.stand.address(0)}:8786"
        os.environ["DASK_DISTRIBUTED__SCHEDULER__WORKER_TTL"] = "15s"
        os.environ["PATH"] = f"{self.program.parent}:{os.environ['PATH']}"
        if importlib.util.find_spec("drystone") is None:
            os.environ["PYTHONPATH"] = str(Path(__file__).resolve().parents[2] / "python")
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        with contextlib.ExitStack() as started:

            def begin(*command):
                process = subprocess.Popen(command, start_new_session=True, **quiet)
                started.callback(lambda: os.killpg(process.pid, signal.SIGKILL))

            begin(*self.stand.on(0, *dask, "distributed.cli.dask_scheduler"))
            time.sleep(3)
            for machine in range(MACHINES):
                begin(*self.stand.on(machine, *dask, "distributed.cli.dask_worker", head, "--nthreads", "1"))
            time.sleep(3)
            line = f"{sys.executable} -m drystone.dask {head} {{stage}} {{count}}"
            first = self.job.by_tasks(0, line)
            until((self.stand.base / "job.work").exists, "the job began")
            time.sleep(1)
            self.stand.set_cable(2, "down")
            if first.poll() is not None:
                raise AssertionError("the job ended before the cable was cut: take a larger mesh")
            time.sleep(CUT_SECONDS)
            self.stand.set_cable(2, "up")
            expect(0, ended(first))
        return True


NAMES = ["well", "lost", "tile", "build", "full", "second", "suspended", "cable"]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program", type=Path)
    parser.add_argument("mesh", type=Path)
    parser.add_argument("--only", nargs="+", choices=NAMES, default=NAMES, metavar="CASE", help=", ".join(NAMES))
    arguments = parser.parse_args()
    missing = [tool for tool in ("bindfs", "fusermount3", "ip", "unshare") if shutil.which(tool) is None]
    if os.geteuid() != 0 or missing:
        sys.exit(f"needs root and {', '.join(missing) or 'nothing else'}")
    faults = 0
    with tempfile.TemporaryDirectory() as folder, Stand(Path(folder)) as stand:
        cases = Cases(stand, arguments.program.resolve(), arguments.mesh.resolve())
        for name in arguments.only:
            stand.clear()
            began = time.monotonic()
            try:
                outcome = "left out" if getattr(cases, name)() is None and name == "cable" else "same bytes"
                if outcome == "same bytes" and not cases.job.has_expected_bytes():
                    outcome = "OTHER BYTES, or files left over"
                    faults += 1
            except (AssertionError, subprocess.TimeoutExpired) as error:
                outcome, faults = f"FAILED: {error}", faults + 1
            finally:
                cases.job.end_all()
            print(f"{name:10} {time.monotonic() - began:5.0f} s  {outcome}", flush=True)
    sys.exit(faults > 0)


if __name__ == "__main__":
    main()
