"""Jobs whose tasks are done by other processes: the same bytes, whichever of them are killed, and when.

DRYSTONE_TASK_KILLS sets how many runs are disturbed by kills.
"""

import os
import random
import shlex
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import objlib

KILLS = int(os.environ.get("DRYSTONE_TASK_KILLS", "6"))
SIDE = 160
OPTIONS = ["--ratio", "0.2", "--cluster-faces", "1000", "--threads", "1", "--memory", "128MiB", "--quiet"]


@pytest.fixture(scope="module")
def hills(tmp_path_factory):
    """A mesh of about 50,000 triangles."""
    height = lambda x, y: ((x * 37 + y * 61) % 97) / 97 + (x * y % 13) / 5
    lines = [f"v {x} {y} {height(x, y):.3f}\n" for y in range(SIDE) for x in range(SIDE)]
    for corner in (y * SIDE + x + 1 for y in range(SIDE - 1) for x in range(SIDE - 1)):
        above = corner + SIDE
        lines += [f"f {corner} {corner + 1} {above + 1}\n", f"f {corner} {above + 1} {above}\n"]
    path = tmp_path_factory.mktemp("hills") / "hills.obj"
    path.write_text("".join(lines))
    return path


@pytest.fixture(scope="module")
def expected(drystone, hills, tmp_path_factory):
    output = tmp_path_factory.mktemp("expected") / "out.obj"
    drystone("simplify", hills, "-o", output, *OPTIONS)
    return output.read_bytes()


def runner(drystone):
    """A task runner that does two tasks at a time."""
    task = f"{shlex.quote(drystone.binary)} task {{stage}} {{}} --threads 1 --memory 128MiB --quiet"
    return f"seq 0 {{last}} | xargs -P 2 -I {{}} {task}"


def command(drystone, hills, folder, *more):
    output = [str(hills), "-o", str(folder / "out.obj")]
    return [drystone.binary, "simplify", *output, *OPTIONS, "--task-runner", runner(drystone), "--tasks", "9", *more]


def run(*arguments):
    return subprocess.run(
        command(*arguments), stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=300
    )


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_other_processes_write_the_same_bytes(drystone, hills, expected, tmp_path):
    folder = tmp_path / "with a 'quote'"
    folder.mkdir()
    done = run(drystone, hills, folder)
    assert done.returncode == 0, done.stderr
    assert (folder / "out.obj").read_bytes() == expected and names(folder) == ["out.obj"]


def descendants(pid):
    """Ids of the processes below one, of drystone alone."""
    parents = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                name, rest = (entry / "stat").read_text().rsplit(")", 1)
            except (OSError, ValueError):
                continue
            parents[int(entry.name)] = (int(rest.split()[1]), name.split("(", 1)[1])
    below, found = {pid}, []
    while True:
        new = {child for child, (parent, _) in parents.items() if parent in below} - below
        if not new:
            return found
        found += [child for child in new if parents[child][1].startswith("drystone")]
        below |= new


def disturb(process, chance, seconds):
    """Kills the job, one of its tasks, or both, at a random time; returns what was killed."""
    time.sleep(chance.uniform(0, seconds))
    victims = descendants(process.pid)
    what = chance.choice(["job", "task", "both"])
    killed = []
    if what != "job" and victims:
        killed.append("task")
        kill(chance.choice(victims))
    if what != "task":
        killed.append("job")
        kill(process.pid)
    return killed


def kill(pid):
    try:
        os.kill(pid, signal.SIGKILL)
    except ProcessLookupError:
        pass


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="no /proc to find the tasks in")
def test_kills_at_any_time_cost_no_byte(drystone, hills, expected, tmp_path):
    chance = random.Random(7)
    began = time.monotonic()
    assert run(drystone, hills, tmp_path).returncode == 0
    seconds = time.monotonic() - began
    hit = {"job": 0, "task": 0}
    for number in range(KILLS):
        folder = tmp_path / str(number)
        folder.mkdir()
        for _ in range(2):
            process = subprocess.Popen(
                command(drystone, hills, folder, "--force"), stdin=subprocess.DEVNULL, stderr=subprocess.DEVNULL
            )
            for what in disturb(process, chance, seconds):
                hit[what] += 1
            process.wait(timeout=300)
        done = run(drystone, hills, folder, "--force")
        assert done.returncode == 0, done.stderr
        assert (folder / "out.obj").read_bytes() == expected, number
        # A task of a killed job may still run; it must end without a trace.
        deadline = time.monotonic() + 10
        while names(folder) != ["out.obj"] and time.monotonic() < deadline:
            time.sleep(0.1)
        assert names(folder) == ["out.obj"], number
    print(f"killed: {hit}")
    assert KILLS < 10 or min(hit.values()) > 0


@pytest.mark.skipif(sys.platform != "linux" or not shutil.which("cc"), reason="needs Linux and a C compiler")
def test_names_that_appear_late_are_waited_for(drystone, hills, expected, tmp_path):
    library, seconds = tmp_path / "calls.so", 1.5
    source = Path(__file__).resolve().parents[2] / "tools" / "faults" / "calls.c"
    subprocess.run(["cc", "-O2", "-shared", "-fPIC", "-o", library, source, "-ldl", "-lpthread"], check=True)
    # Only the coordinator sees names late.
    arguments = command(drystone, hills, tmp_path)
    place = arguments.index("--task-runner") + 1
    arguments[place] = arguments[place].replace("xargs", "env -u LD_PRELOAD xargs")
    late = {"LD_PRELOAD": str(library), "FAULT_ROOT": os.path.realpath(tmp_path), "FAULT_HIDE": str(seconds)}
    began = time.monotonic()
    done = subprocess.run(
        arguments, env=os.environ | late, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "out.obj").read_bytes() == expected
    assert time.monotonic() - began > seconds
    assert names(tmp_path) == ["calls.so", "out.obj"]


@pytest.mark.skipif(not hasattr(signal, "SIGSTOP"), reason="no SIGSTOP")
def test_a_task_that_ends_after_its_job_changes_nothing(drystone, hills, expected, tmp_path):
    folder, begin = tmp_path / "job", tmp_path / "begin"
    folder.mkdir()
    arguments = command(drystone, hills, folder)
    place = arguments.index("--task-runner") + 1
    arguments[place] = f"while [ ! -e {shlex.quote(str(begin))} ]; do sleep 0.05; done; {arguments[place]}"
    job = subprocess.Popen(arguments, stdin=subprocess.DEVNULL)
    while not (found := list(folder.glob("out.obj.work/stage-*/stage.bin"))) and job.poll() is None:
        time.sleep(0.01)
    (stage,) = found
    task = [drystone.binary, "task", str(stage), "0", "--threads", "1", "--memory", "128MiB", "--quiet"]
    late = subprocess.Popen(task, stdin=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    # Its first file has a name of its own, until it is done.
    while len(names(stage.parent)) == 1 and late.poll() is None:
        pass
    late.send_signal(signal.SIGSTOP)
    assert late.poll() is None and not list(stage.parent.glob("*.results")), "the task was done before it was stopped"
    begin.touch()
    assert job.wait(timeout=300) == 0
    before = [(path, path.stat().st_mtime_ns, path.stat().st_ino) for path in folder.iterdir()]
    late.send_signal(signal.SIGCONT)
    # It waits for its stage as for one that is seen late.
    assert late.wait(timeout=60) == 9
    assert before == [(path, path.stat().st_mtime_ns, path.stat().st_ino) for path in folder.iterdir()]
    assert names(folder) == ["out.obj"] and (folder / "out.obj").read_bytes() == expected


def test_a_pyramid_by_other_processes_has_the_same_bytes(drystone, tmp_path):
    town = objlib.FIXTURES / "town" / "town.obj"
    options = ["--tile-faces", "3000", "--tile-side", "1024", "--threads", "1", "--memory", "128MiB", "--quiet"]
    alone, helped, mark = tmp_path / "alone", tmp_path / "helped", tmp_path / "lent"
    drystone("tile", town, "-o", alone, *options)
    by_tasks = ["--tasks", "9", "--task-runner", f"echo {{count}} >> {shlex.quote(str(mark))}; {runner(drystone)}"]
    drystone("tile", town, "-o", helped, *options, *by_tasks)
    assert mark.read_text().split(), "no tile was made by a task"
    tiles = lambda folder: {path.relative_to(folder): path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    assert tiles(alone) == tiles(helped) and names(tmp_path) == ["alone", "helped", "lent"]


def test_a_stopped_job_ends_its_tasks_and_goes_on(drystone, hills, expected, tmp_path):
    process = subprocess.Popen(command(drystone, hills, tmp_path), stdin=subprocess.DEVNULL, stderr=subprocess.PIPE)
    while not list(tmp_path.glob("out.obj.work/stage-*/*.results")) and process.poll() is None:
        time.sleep(0.01)
    began = time.monotonic()
    process.send_signal(signal.SIGINT)
    words = process.communicate(timeout=60)[1].decode()
    assert process.returncode == 130 and time.monotonic() - began < 5, words
    assert "resume with" in words
    done = run(drystone, hills, tmp_path)
    assert done.returncode == 0 and (tmp_path / "out.obj").read_bytes() == expected, done.stderr


@pytest.mark.parametrize(
    "command, code, words",
    [
        ("true", 2, "expected a command with `{stage}`"),
        ("no-such-program {stage}", 2, "the shell cannot run it"),
        ("false {stage}", 1, "has no result after 2 tries"),
        ("echo {stage} {count} {last} >&2; exit 3", 1, "the task runner ended with exit code 3"),
    ],
)
def test_a_runner_that_does_nothing_is_told(drystone, hills, tmp_path, command, code, words):
    options = [option for option in OPTIONS if option != "--quiet"]
    job = [drystone.binary, "simplify", hills, "-o", tmp_path / "out.obj", *options, "--task-tries", "2"]
    done = subprocess.run([*job, "--task-runner", command], capture_output=True, text=True, timeout=300)
    assert done.returncode == code and words in done.stderr, done.stderr
    assert not (tmp_path / "out.obj").exists()


def test_a_task_says_what_is_wrong(drystone, hills, tmp_path):
    keep = f"cp -r {tmp_path}/out.obj.work {tmp_path}/copy; false {{stage}}"
    job = ["simplify", hills, "-o", tmp_path / "out.obj", *OPTIONS, "--task-runner", keep, "--task-tries", "1"]
    drystone(*job, codes=(1,))
    (stage,) = (tmp_path / "copy").glob("stage-*/stage.bin")
    assert "none numbered 1000" in drystone("task", stage, 1000, codes=(2,)).stderr
    assert "give an INDEX" in drystone("task", stage, codes=(2,)).stderr
    assert "nowhere/stage.bin: no such stage" in drystone("task", tmp_path / "nowhere/stage.bin", 0, codes=(9,)).stderr
    assert "task 0 is done" in drystone("task", stage, 0).stderr
    assert "task 0 was done before" in drystone("task", stage, 0).stderr
    damaged = bytearray(stage.read_bytes())
    damaged[len(damaged) // 2] ^= 1
    stage.write_bytes(damaged)
    assert "its checksum does not match" in drystone("task", stage, 1, codes=(8,)).stderr
    stage.write_bytes(b"not a stage")
    drystone("task", stage, 1, codes=(8,))
