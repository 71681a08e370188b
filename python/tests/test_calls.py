"""How a call behaves in a program: stops, progress, other threads, processes, memory."""

import contextlib
import hashlib
import io
import itertools
import logging
import multiprocessing
import os
import random
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import drystone
from conftest import MINIATURES, TOWN, grid

IS_LINUX = sys.platform == "linux"


@pytest.fixture(scope="module")
def large(tmp_path_factory) -> Path:
    """A mesh that takes some seconds."""
    path = tmp_path_factory.mktemp("large") / "grid.obj"
    vertices, faces = grid(500)
    with open(path, "w") as file:
        np.savetxt(file, vertices, fmt="v %.6f %.6f %.6f")
        np.savetxt(file, faces + 1, fmt="f %d %d %d")
    return path


def sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


CHILD = """
import signal, sys, threading, drystone
# A job in the background of a shell begins with SIGINT ignored.
signal.signal(signal.SIGINT, signal.default_int_handler)
print("begin", flush=True)
try:
    drystone.simplify(sys.argv[1], sys.argv[2], ratio=0.05, threads=2, cluster_faces=20_000)
except KeyboardInterrupt:
    print("stopped", threading.active_count(), flush=True)
    sys.exit(5)
print("done", flush=True)
"""


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_ctrl_c_stops_and_the_same_call_resumes(tmp_path, large):
    undisturbed = tmp_path / "undisturbed.obj"
    began = time.monotonic()
    drystone.simplify(large, undisturbed, ratio=0.05, threads=2, cluster_faces=20_000)
    took = time.monotonic() - began
    chance = random.Random(5)
    stops = 0
    for trial in range(4):
        output = tmp_path / f"{trial}.obj"
        for attempt in range(20):
            child = subprocess.Popen([sys.executable, "-c", CHILD, large, output], stdout=subprocess.PIPE, text=True)
            assert child.stdout.readline() == "begin\n"
            if attempt < 3:
                time.sleep(chance.uniform(0.1, 0.8) * took)
                child.send_signal(signal.SIGINT)
                asked = time.monotonic()
            said = child.stdout.read()
            if child.wait() == 5:
                stops += 1
                assert time.monotonic() - asked < 5 and said.startswith("stopped 1")
                if not output.exists():
                    continue
                # The signal came when the job had just ended.
            else:
                assert said == "done\n"
            break
        assert sha256(output) == sha256(undisturbed)
        assert not Path(f"{output}.work").exists()
    assert stops > 0


DEAF = """
import signal, sys, time, drystone
signal.signal(signal.SIGINT, signal.default_int_handler)
arguments = dict(input=sys.argv[1], output=sys.argv[2], ratio=0.3, cluster_faces=1000)

def hands(stage, count, is_stopped):
    print("begun", flush=True)
    time.sleep(60)

try:
    drystone.simplify(**arguments, hands=hands)
except KeyboardInterrupt:
    print("interrupted", flush=True)
while True:
    try:
        print("resumed", drystone.simplify(**arguments).resumed, flush=True)
        break
    except drystone.LockedError:
        time.sleep(0.1)
"""


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_a_second_ctrl_c_does_not_wait_for_the_job(tmp_path):
    # The job waits three seconds for a function that does not stop.
    child = subprocess.Popen([sys.executable, "-c", DEAF, TOWN, tmp_path / "a.obj"], stdout=subprocess.PIPE, text=True)
    assert child.stdout.readline() == "begun\n"
    child.send_signal(signal.SIGINT)
    asked = time.monotonic()
    time.sleep(0.8)
    child.send_signal(signal.SIGINT)
    assert child.stdout.readline() == "interrupted\n"
    assert 0.8 <= time.monotonic() - asked < 2.5
    assert child.stdout.read() == "resumed True\n" and child.wait() == 0
    drystone.simplify(TOWN, tmp_path / "b" / "a.obj", ratio=0.3, cluster_faces=1000)
    assert sha256(tmp_path / "a.obj") == sha256(tmp_path / "b" / "a.obj")


def test_a_token_stops_a_job_from_another_thread(tmp_path, large):
    stop = drystone.Stop()
    threading.Timer(0.3, stop.set).start()
    began = time.monotonic()
    with pytest.raises(drystone.StoppedError):
        drystone.simplify(large, tmp_path / "a.obj", ratio=0.05, stop=stop)
    assert time.monotonic() - began < 5 and stop.is_set()
    report = drystone.simplify(large, tmp_path / "a.obj", ratio=0.05)
    assert report.faces.output == report.faces.target


def test_a_token_that_is_set_before_stops_at_once():
    stop = drystone.Stop()
    stop.set()
    vertices, faces = grid(200)
    for call in (lambda: drystone.inspect(TOWN, stop=stop), lambda: drystone.simplify_mesh(vertices, faces, ratio=0.1, stop=stop)):
        with pytest.raises(drystone.StoppedError, match="^stopped$"):
            call()


def test_two_calls_in_one_work_folder_do_not_mix(tmp_path):
    vertices, faces = grid(150)
    uv = vertices[:, :2] / 150

    def job(number: int) -> object:
        image = np.full((64, 64, 3), 60 * number + 20, np.uint8)
        scaled = vertices * [1, 1, number + 1]
        try:
            mesh = drystone.simplify_mesh(scaled, faces, uv=uv, texture=image, textures="bake", ratio=0.1, work=tmp_path / "work")
        except (drystone.LockedError, drystone.ChangedError) as error:
            return error
        return mesh.vertices[:, 2].max() / vertices[:, 2].max(), int(np.median(mesh.textures[0]))

    done = 0
    for _ in range(3):
        with ThreadPoolExecutor(3) as pool:
            for number, found in enumerate(pool.map(job, range(3))):
                if isinstance(found, tuple):
                    done += 1
                    assert found[0] == pytest.approx(number + 1, rel=0.1) and abs(found[1] - 60 * number - 20) <= 2
    assert done >= 3


def test_events_come_in_order_and_reach_their_ends(tmp_path, large):
    events, threads = [], set()

    def listen(event: drystone.Event) -> None:
        events.append(event)
        threads.add(threading.get_ident())

    drystone.simplify(large, tmp_path / "a.obj", ratio=0.1, progress=listen)
    assert threads == {threading.get_ident()}
    phases = [event for event in events if event.message is None]
    for before, after in zip(phases, phases[1:]):
        is_same = after.phase == before.phase and after.done >= before.done and after.total == before.total
        assert is_same or (after.done == 0 and before.done >= before.total), (before, after)
    assert phases[0].phase == "scan" and {"simplify", "partition", "write"} <= {event.phase for event in phases}
    assert all(0 <= event.done and (event.total == 0 or event.done <= event.total) for event in events)
    assert any(event.message and "pass 1" in event.message for event in events)
    # A phase whose units are not known has an event at its end, too.
    groups = [(phase, list(group)) for phase, group in itertools.groupby(phases, lambda event: event.phase)]
    unknown = {phase: len(group) for phase, group in groups if group[0].total == 0}
    assert {"partition", "measure"} <= unknown.keys() and min(unknown.values()) >= 2, unknown


def test_each_thread_gets_the_events_of_its_own_call(tmp_path):
    vertices, faces = grid(60)
    calls = [
        lambda **options: drystone.simplify(TOWN, tmp_path / "a.obj", ratio=0.1, **options),
        lambda **options: drystone.simplify_mesh(vertices, faces, ratio=0.1, **options),
        lambda **options: drystone.inspect(TOWN, **options),
        lambda **options: drystone.plan(TOWN, ratio=0.1, **options),
        lambda **options: drystone.check(MINIATURES / "closed_sphere.obj", **options),
    ]

    def listen_in_this_thread(call) -> tuple[int, set[int], set[str]]:
        threads, phases = set(), set()

        def listen(event: drystone.Event) -> None:
            threads.add(threading.get_ident())
            phases.add(event.phase)

        call(progress=listen)
        return threading.get_ident(), threads, phases

    alone = [listen_in_this_thread(call)[2] for call in calls]
    (tmp_path / "a.obj").unlink()
    with ThreadPoolExecutor(len(calls)) as pool:
        found = list(pool.map(listen_in_this_thread, calls))
    assert len({own for own, _, _ in found} - {threading.get_ident()}) == len(calls)
    for (own, threads, phases), expected in zip(found, alone):
        assert threads == {own} and phases == expected


class Error(Exception):
    pass


def test_a_listener_that_raises_stops_the_job(tmp_path, large):
    def listen(event: drystone.Event) -> None:
        if event.phase == "simplify":
            raise Error("enough")

    with pytest.raises(Error, match="enough"):
        drystone.simplify(large, tmp_path / "a.obj", ratio=0.1, progress=listen)
    assert not (tmp_path / "a.obj").exists()
    report = drystone.simplify(large, tmp_path / "a.obj", ratio=0.1)
    assert report.resumed and abs(report.faces.output - 50_000) <= 2


def test_a_slow_listener_does_not_hold_the_job(tmp_path):
    calls = []

    def listen(event: drystone.Event) -> None:
        calls.append(event)
        if len(calls) == 1:
            time.sleep(2)

    began = time.monotonic()
    drystone.simplify(TOWN, tmp_path / "a.obj", ratio=0.1, progress=listen)
    assert 2 <= time.monotonic() - began < 4 and len(calls) > 5


def test_a_bar_of_tqdm(tmp_path, capsys):
    tqdm = pytest.importorskip("tqdm")
    for progress in (tqdm.tqdm, True):
        drystone.simplify(TOWN, tmp_path / "a.obj", ratio=0.1, progress=progress, force=True)
        shown = capsys.readouterr().err
        assert "scan: 100%" in shown and "write: 100%" in shown


class Terminal(io.StringIO):
    """A stream that says it is a terminal."""

    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize("seconds", [0.0, 1000.0])
def test_lines_on_a_terminal_without_tqdm(tmp_path, monkeypatch, seconds):
    events: list[drystone.Event] = []
    drystone.simplify(TOWN, tmp_path / "a.obj", ratio=0.1, progress=events.append)
    for name in ("tqdm", "tqdm.auto"):
        monkeypatch.setitem(sys.modules, name, None)
    monkeypatch.setattr("drystone.progress._SECONDS_BETWEEN_LINES", seconds)
    shown = {}
    for stream in (Terminal(), io.StringIO(), None):
        monkeypatch.setattr(sys, "stderr", stream)
        drystone.simplify(TOWN, tmp_path / "a.obj", ratio=0.1, progress=True, force=True)
        shown[type(stream)] = "" if stream is None else stream.getvalue()
    assert shown[io.StringIO] == ""
    lines = shown[Terminal].splitlines()
    messages = [event.message for event in events if event.message is not None]
    assert [line for line in lines if line in messages] == messages
    begun = [line.partition(":")[0] for line in lines if line not in messages]
    phases = [event.phase for event in events if event.message is None]
    # Events between the begin and the end of a phase depend on time.
    assert [phase for phase, _ in itertools.groupby(begun)] == [phase for phase, _ in itertools.groupby(phases)]
    assert f"scan: 0 of {TOWN.stat().st_size:,} B" in lines
    is_ended = f"scan: {TOWN.stat().st_size:,} of {TOWN.stat().st_size:,} B" in lines
    assert is_ended == (seconds == 0)


def test_messages_and_warnings_go_to_the_log(tmp_path, caplog):
    source = tmp_path / "a.obj"
    source.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 1 1 2\nusemtl gone\nmtllib gone.mtl\nf 1 3 2\n")
    with caplog.at_level(logging.INFO, logger="drystone"):
        report = drystone.simplify(source, tmp_path / "b.obj", ratio=1.0)
    levels = {record.levelname: record.getMessage() for record in caplog.records}
    assert "pass 1" in " ".join(record.getMessage() for record in caplog.records)
    assert report.warnings and levels["WARNING"] in report.warnings


def _count_while(condition) -> int:
    count = 0
    while condition():
        count += 1
    return count


ELSEWHERE = """
import sys, drystone
drystone.simplify(sys.argv[1], sys.argv[2], ratio=0.05, threads=1, force=True, resume="never",
                  progress=lambda event: print(event.phase, flush=True))
"""


def _count_for(seconds: float) -> int:
    end = time.monotonic() + seconds
    return _count_while(lambda: time.monotonic() < end)


def _counts_beside_a_job(large: Path, output: Path) -> float:
    """What a thread counts beside a job of this process, as a share of what it counts beside a job of another one.

    Both jobs take as much of the machine; only that of this process could hold the lock of its interpreter.
    """
    command = [sys.executable, "-c", ELSEWHERE, large, output]
    other = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert other.stdout is not None and other.stdout.readline() == "scan\n"
    apart = _count_for(0.5)
    assert other.poll() is None
    other.kill()
    other.communicate()
    begun = threading.Event()
    listen = lambda event: begun.set()
    with ThreadPoolExecutor(1) as pool:
        options = dict(ratio=0.05, threads=1, force=True, resume="never", progress=listen)
        job = pool.submit(drystone.simplify, large, output, **options)
        assert begun.wait(30)
        beside = _count_for(0.5)
        assert not job.done()
        job.result()
    return beside / apart


@pytest.mark.skipif((os.cpu_count() or 1) < 2, reason="needs two processors")
def test_other_threads_run_meanwhile(tmp_path, large):
    # Other work on the machine disturbs a try, and hardly all of them.
    tries = (_counts_beside_a_job(large, tmp_path / "a.obj") for _ in range(5))
    shares = list(itertools.takewhile(lambda share: share < 0.8, tries))
    assert len(shares) < 5, shares


def test_two_jobs_at_once(tmp_path, large):
    def job(number: int) -> str:
        drystone.simplify(large, tmp_path / f"{number}.obj", ratio=0.05, threads=number + 1, memory="256MiB")
        return sha256(tmp_path / f"{number}.obj")

    with ThreadPoolExecutor(2) as pool:
        assert len(set(pool.map(job, [0, 1]))) == 1


def _threads() -> int:
    return len(os.listdir("/proc/self/task"))


def _wait_for_threads(most: int) -> None:
    """A thread that has ended takes a moment to go."""
    deadline = time.monotonic() + 5
    while _threads() > most and time.monotonic() < deadline:
        time.sleep(0.01)
    assert _threads() <= most


@pytest.mark.skipif(not IS_LINUX, reason="reads /proc")
def test_threads_are_those_of_the_call_and_none_stays(tmp_path, large):
    def most_threads(count: int) -> int:
        seen = []
        listen = lambda event: seen.append(_threads())
        drystone.simplify(large, tmp_path / f"{count}.obj", ratio=0.1, threads=count, progress=listen)
        return max(seen)

    before = _threads()
    one, six = most_threads(1), most_threads(6)
    assert six >= one + 4
    _wait_for_threads(before)


@pytest.mark.skipif(not IS_LINUX, reason="reads /proc")
def test_no_thread_stays_however_a_job_ends(tmp_path):
    vertices, faces = grid(40)
    (tmp_path / "faulty.obj").write_text("v 0 0 0\nf 1 2 3\n")
    stop = drystone.Stop()
    stop.set()

    def fail(*_: object) -> None:
        raise Error

    ends = [
        lambda: drystone.simplify_mesh(vertices, faces, ratio=0.1),
        lambda: drystone.simplify_mesh(vertices, faces, ratio=2),
        lambda: drystone.simplify_mesh(vertices, faces, ratio=0.1, progress=fail),
        lambda: drystone.simplify_mesh(vertices, faces, ratio=0.1, stop=stop),
        lambda: drystone.inspect(tmp_path / "faulty.obj"),
        lambda: drystone.check(MINIATURES / "closed_sphere.obj"),
        lambda: drystone.simplify(TOWN, tmp_path / "a.obj", ratio=0.5, cluster_faces=1000, resume="never", hands=fail),
    ]
    before = _threads()
    for _ in range(5):
        for end in ends:
            with contextlib.suppress(Error, drystone.DrystoneError):
                end()
        _wait_for_threads(before)


def _calls(folder: Path) -> list[object]:
    """Every call once; returns what does not depend on time."""
    output = folder / "a.obj"
    vertices, faces = grid(10)
    return [
        drystone.simplify(TOWN, output, ratio=0.1).faces.output,
        drystone.inspect(TOWN).triangles,
        drystone.check(output).after.faces,
        drystone.compare(TOWN, output, samples=1000).geometry.diagonal,
        drystone.plan(TOWN, ratio=0.1).target,
        len(drystone.tile(TOWN, folder / "tiles").levels),
        drystone.check(folder / "tiles", TOWN).fault_count,
        len(drystone.simplify_mesh(vertices, faces, ratio=0.5).faces),
    ]


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_child_that_was_forked_after_calls_can_call(tmp_path):
    (tmp_path / "parent").mkdir(), (tmp_path / "child").mkdir()
    expected = _calls(tmp_path / "parent")
    process = multiprocessing.get_context("fork").Process(target=_check_calls, args=(tmp_path / "child", expected))
    process.start()
    process.join(60)
    process.kill()
    assert process.exitcode == 0


def _check_calls(folder: Path, expected: list[object]) -> None:
    assert _calls(folder) == expected


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@pytest.mark.parametrize("of_arrays", [False, True])
def test_a_child_that_is_forked_during_a_call_gets_an_error(tmp_path, of_arrays):
    pids = []
    vertices, faces = grid(100)

    def listen(event: drystone.Event) -> None:
        if event.phase == "partition" and not pids:
            pids.append(os.fork())

    try:
        if of_arrays:
            report = drystone.simplify_mesh(vertices, faces, ratio=0.1, progress=listen).report
        else:
            report = drystone.simplify(TOWN, tmp_path / "a.obj", ratio=0.1, progress=listen)
    except drystone.DrystoneError as error:
        os._exit(7 if "forked" in str(error) else 8)
    except BaseException:
        os._exit(9)
    assert os.waitstatus_to_exitcode(os.waitpid(pids[0], 0)[1]) == 7
    assert abs(report.faces.output - report.faces.target) <= 2


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_child_that_is_forked_as_the_job_ends_gets_an_error_each_time():
    """The job's thread may hold a lock at that moment, which nobody in the child ever gives back."""
    vertices, faces = grid(100)
    for number in range(10):
        pids = []

        def listen(event: drystone.Event) -> None:
            if event.phase == "measure" and not pids:
                pids.append(os.fork())

        try:
            drystone.simplify_mesh(vertices, faces, ratio=0.1, progress=listen)
        except drystone.DrystoneError:
            os._exit(7)
        except BaseException:
            os._exit(9)
        deadline = time.monotonic() + 20
        while (ended := os.waitpid(pids[0], os.WNOHANG))[0] == 0 and time.monotonic() < deadline:
            time.sleep(0.001)
        if ended[0] == 0:
            os.kill(pids[0], signal.SIGKILL)
            os.waitpid(pids[0], 0)
            pytest.fail(f"child {number} hangs")
        assert os.waitstatus_to_exitcode(ended[1]) == 7


def test_the_current_folder_may_change_meanwhile(tmp_path, monkeypatch):
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "town.obj").write_bytes(TOWN.read_bytes())
    monkeypatch.chdir(tmp_path)
    listen = lambda event: os.chdir(tmp_path / "elsewhere")
    report = drystone.simplify("town.obj", "out.obj", ratio=0.1, work="work", progress=listen)
    assert (tmp_path / "out.obj").exists() and report.faces.output == 1821


SUBINTERPRETER = """
try:
    import _interpreters
except ImportError:
    import _xxsubinterpreters as _interpreters
import sys, drystone
code = f"import sys; sys.path[:] = {sys.path!r}" + '''
try:
    import drystone
except ImportError as error:
    print(error, flush=True)
'''
_interpreters.run_string(_interpreters.create(), code)
"""


@pytest.mark.skipif(sys.version_info < (3, 12), reason="older ones do not ask a module")
def test_a_subinterpreter_is_refused_with_words():
    done = subprocess.run([sys.executable, "-c", SUBINTERPRETER], capture_output=True, text=True)
    assert "does not support loading in subinterpreters" in done.stdout, done.stderr


def _faces(ratio: float) -> int:
    vertices, faces = grid(20)
    return len(drystone.simplify_mesh(vertices, faces, ratio=ratio).faces)


@pytest.mark.parametrize("method", ["spawn", "forkserver"])
def test_processes_of_a_pool(method):
    if method not in multiprocessing.get_all_start_methods():
        pytest.skip(f"no {method} here")
    with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context(method)) as pool:
        for found, expected in zip(pool.map(_faces, [0.5, 0.25]), [400, 200]):
            assert abs(found - expected) <= 2


MEMORY = """
import resource, sys, drystone
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
drystone.simplify(sys.argv[1], sys.argv[2], ratio=0.1, memory="128MiB", threads=2, cluster_faces=20_000)
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 - before)
"""


@pytest.mark.skipif(not IS_LINUX, reason="units of Linux")
def test_a_job_takes_its_memory_beside_that_of_python(tmp_path, large):
    done = subprocess.run(
        [sys.executable, "-c", MEMORY, large, tmp_path / "a.obj"], capture_output=True, text=True, check=True
    )
    assert int(done.stdout) < 128 << 20


@pytest.mark.skipif(not IS_LINUX, reason="reads /proc")
def test_a_hundred_jobs_do_not_grow():
    def resident() -> int:
        return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")

    vertices, faces = grid(40)
    for _ in range(20):
        drystone.simplify_mesh(vertices, faces, ratio=0.1)
    before, threads = resident(), _threads()
    for _ in range(100):
        drystone.simplify_mesh(vertices, faces, ratio=0.1)
    assert resident() - before < 5 << 20
    _wait_for_threads(threads)


def test_a_job_of_arrays_in_a_work_folder_resumes(tmp_path):
    vertices, faces = grid(300)
    arguments = dict(vertices=vertices, faces=faces, ratio=0.1, cluster_faces=10_000)
    expected = drystone.simplify_mesh(**arguments)

    def stop(event: drystone.Event) -> None:
        if event.phase == "stitch":
            raise Error

    work = tmp_path / "work"
    with pytest.raises(Error):
        drystone.simplify_mesh(**arguments, work=work, progress=stop)
    status = drystone.status(work)
    assert isinstance(status, drystone.Status) and status.passes_done >= 1 and not status.written
    other = dict(arguments, vertices=vertices + 1)
    with pytest.raises(drystone.ChangedError, match="the arrays were others; start over") as caught:
        drystone.simplify_mesh(**other, work=work)
    assert ".drystone" not in str(caught.value)
    mesh = drystone.simplify_mesh(**arguments, work=work)
    assert mesh.report.resumed and not work.exists()
    assert np.array_equal(mesh.vertices, expected.vertices) and np.array_equal(mesh.faces, expected.faces)
