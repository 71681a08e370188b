"""Jobs whose tasks a Python function has done: the same bytes, and every way in which that function can end."""

import signal
import subprocess
import sys
import textwrap
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from conftest import TOWN

import drystone

LIMITS = {"threads": 1, "memory": "128MiB"}
OPTIONS = {"ratio": 0.3, "cluster_faces": 1000}


def do_task(stage: str, index: int) -> int:
    command = [sys.executable, "-m", "drystone", "task", stage, str(index), "--threads", "1", "--memory", "128MiB"]
    return subprocess.run(command, stdin=subprocess.DEVNULL, stderr=subprocess.DEVNULL).returncode


class Hands:
    """Does tasks by two processes at a time, backwards; leaves out the first one of the first stage."""

    def __init__(self) -> None:
        self.stages: list[str] = []
        self.threads: set[str] = set()

    def __call__(self, stage, count, is_stopped):
        assert not is_stopped()
        self.threads.add(threading.current_thread().name)
        first = 0 if self.stages else 1
        self.stages.append(stage)
        with ThreadPoolExecutor(2) as pool:
            codes = list(pool.map(lambda index: do_task(stage, index), reversed(range(first, count))))
        return [code for code in codes if code not in (0, 9)] or first == 1


def files(folder):
    return {path.relative_to(folder): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_a_function_has_tasks_done_and_the_bytes_are_the_same(tmp_path):
    hands, events = Hands(), []
    drystone.simplify(TOWN, tmp_path / "alone" / "out.obj", **OPTIONS, **LIMITS)
    drystone.simplify(
        TOWN, tmp_path / "helped" / "out.obj", **OPTIONS, **LIMITS, hands=hands, tasks=5, progress=events.append
    )
    assert files(tmp_path / "alone") == files(tmp_path / "helped")
    assert len(hands.stages) > len(set(hands.stages)) > 0 and hands.threads == {"drystone hands"}
    assert any(event.phase == "simplify" and event.done > 0 for event in events)


def test_tiles_can_be_made_by_a_function(tmp_path):
    hands, options = Hands(), {"tile_faces": 2000, "tile_side": 512}
    drystone.tile(TOWN, tmp_path / "alone", **options, **LIMITS)
    drystone.tile(TOWN, tmp_path / "helped", **options, **LIMITS, hands=hands, tasks=3)
    assert files(tmp_path / "alone") == files(tmp_path / "helped") and hands.stages


def test_the_exception_of_the_function_comes_out_and_the_same_call_goes_on(tmp_path):
    output = tmp_path / "out.obj"

    def broken(stage, count, is_stopped):
        raise RuntimeError("no machine is left")

    with pytest.raises(RuntimeError, match="no machine is left"):
        drystone.simplify(TOWN, output, **OPTIONS, **LIMITS, hands=broken)
    assert drystone.simplify(TOWN, output, **OPTIONS, **LIMITS, hands=Hands()).resumed
    assert [path.name for path in tmp_path.iterdir() if path.suffix == ".work"] == []


def test_a_function_that_does_nothing_ends_the_job(tmp_path):
    calls = []

    def idle(stage, count, is_stopped):
        calls.append(count)
        return ["all of them"]

    with pytest.raises(drystone.TaskError, match="has no result after 2 tries") as caught:
        drystone.simplify(TOWN, tmp_path / "out.obj", **OPTIONS, **LIMITS, hands=idle, tasks=4, task_tries=2)
    assert calls == [4, 4] and caught.value.task == 0 and caught.value.exit_code == 1


def test_what_cannot_have_tasks_done_is_refused(tmp_path):
    with pytest.raises(TypeError, match="hands: expected a function, found str"):
        drystone.simplify(TOWN, tmp_path / "out.obj", **OPTIONS, hands="dask")
    with pytest.raises(drystone.UsageError, match="expected `task_runner` or `hands`, found both"):
        drystone.simplify(TOWN, tmp_path / "out.obj", **OPTIONS, hands=Hands(), task_runner="echo {stage}")


def test_a_stop_token_reaches_the_function(tmp_path):
    stop, seen = drystone.Stop(), []

    def patient(stage, count, is_stopped):
        stop.set()
        while not is_stopped():
            time.sleep(0.01)
        seen.append(stage)

    with pytest.raises(drystone.StoppedError):
        drystone.simplify(TOWN, tmp_path / "out.obj", **OPTIONS, **LIMITS, hands=patient, stop=stop)
    assert len(seen) == 1


def test_a_function_learns_that_another_process_took_the_job_over(tmp_path):
    seen = []

    def overtaken(stage, count, is_stopped):
        lease = Path(stage).parents[1] / "lease"
        theirs = lease.with_name("theirs")
        theirs.write_text("00000000000000aa 0000000000000001 another-machine 7")
        theirs.rename(lease)
        end = time.monotonic() + 60
        while not is_stopped() and time.monotonic() < end:
            time.sleep(0.01)
        seen.append(is_stopped())

    with pytest.raises(drystone.LockedError):
        drystone.simplify(TOWN, tmp_path / "out.obj", **OPTIONS, **LIMITS, hands=overtaken)
    for _ in range(100):
        if seen:
            break
        time.sleep(0.05)
    assert seen == [True]


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
@pytest.mark.parametrize("listens", [True, False])
def test_ctrl_c_ends_the_job_while_the_function_works(tmp_path, listens):
    script = textwrap.dedent(f"""
        import signal, time, drystone
        signal.signal(signal.SIGINT, signal.default_int_handler)

        def hands(stage, count, is_stopped):
            print("begun", flush=True)
            while not ({listens} and is_stopped()):
                time.sleep(0.01)

        try:
            drystone.simplify({str(TOWN)!r}, {str(tmp_path / "out.obj")!r}, ratio=0.3, cluster_faces=1000, hands=hands)
        except KeyboardInterrupt:
            print("interrupted", flush=True)
    """)
    child = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True)
    assert child.stdout.readline() == "begun\n"
    began = time.monotonic()
    child.send_signal(signal.SIGINT)
    assert child.wait(20) == 0 and child.stdout.read() == "interrupted\n"
    assert time.monotonic() - began < (3 if listens else 5)
