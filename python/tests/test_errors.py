"""Exceptions: each by a cause, each also the builtin one."""

import errno
import os
import pickle
import resource
import subprocess
import sys

import numpy as np
import pytest

import drystone
from conftest import TOWN, grid
from drystone import errors

MESSAGES = [
    (dict(ratio=2), "`ratio: 2`"),
    (dict(ratio="x"), "`ratio`"),
    (dict(), "`ratio`, `face_count` or `max_error`"),
    (dict(ratio=0.1, face_count=3), "`face_count`"),
    (dict(ratio=0.1, metric="best"), "`metric`"),
    (dict(ratio=0.1, metric="qem", metric_options={"x": 1}), "`metric_options"),
    (dict(ratio=0.1, cluster_faces=3), "`cluster_faces"),
    (dict(ratio=0.1, threads=0), "`threads: 0`"),
    (dict(ratio=0.1, samples=3), "`samples"),
]


@pytest.mark.parametrize(("options", "words"), MESSAGES)
def test_a_wrong_option_is_named_as_the_keyword_that_it_is(tmp_path, options, words):
    with pytest.raises(drystone.UsageError) as caught:
        drystone.simplify(TOWN, tmp_path / "a.obj", **options)
    assert words in str(caught.value) and "--" not in str(caught.value)
    assert isinstance(caught.value, ValueError) and caught.value.exit_code == 2


def test_a_small_memory(tmp_path):
    with pytest.raises(drystone.BudgetError, match="128 MiB") as caught:
        drystone.simplify(TOWN, tmp_path / "a.obj", ratio=0.1, memory="1MiB")
    assert caught.value.needed == 128 << 20
    with pytest.raises(drystone.BudgetError) as caught:
        drystone.simplify(TOWN, tmp_path / "a.obj", ratio=0.1, memory="128MiB", cluster_faces=2_000_000)
    drystone.simplify(TOWN, tmp_path / "a.obj", ratio=0.1, memory=caught.value.needed, cluster_faces=2_000_000)
    assert issubclass(drystone.BudgetError, drystone.UsageError)


def test_an_input_that_is_faulty_names_its_line(tmp_path):
    source = tmp_path / "a.obj"
    source.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n")
    with pytest.raises(drystone.InputError) as caught:
        drystone.simplify(source, tmp_path / "b.obj", ratio=0.5)
    assert caught.value.path == str(source) and caught.value.line == 4 and caught.value.row is None
    assert isinstance(caught.value, ValueError) and caught.value.exit_code == 4


def test_an_input_that_is_missing(tmp_path):
    with pytest.raises(FileNotFoundError) as caught:
        drystone.inspect(tmp_path / "gone.obj")
    error = caught.value
    assert isinstance(error, drystone.InputError) and error.errno == errno.ENOENT
    assert error.filename == error.path == str(tmp_path / "gone.obj")


def test_another_input_in_the_work_folder(tmp_path):
    source = tmp_path / "a.obj"
    source.write_bytes(TOWN.read_bytes())

    def fail(event: drystone.Event) -> None:
        if event.phase == "simplify":
            raise RuntimeError

    with pytest.raises(RuntimeError):
        drystone.simplify(source, tmp_path / "b.obj", ratio=0.5, progress=fail)
    source.write_bytes(TOWN.read_bytes() + b"v 0 0 0\n")
    with pytest.raises(drystone.ChangedError) as caught:
        drystone.simplify(source, tmp_path / "b.obj", ratio=0.5)
    assert caught.value.exit_code == 5


def test_a_folder_that_is_locked(tmp_path):
    source, other = tmp_path / "source.obj", []
    vertices, faces = grid(300)
    with open(source, "w") as file:
        np.savetxt(file, vertices, fmt="v %.5f %.5f %.5f")
        np.savetxt(file, faces + 1, fmt="f %d %d %d")

    def call_again(event: drystone.Event) -> None:
        if event.phase == "scan" and not other:
            with pytest.raises(BlockingIOError) as caught:
                drystone.simplify(source, tmp_path / "a.obj", ratio=0.5)
            other.append(caught.value)

    drystone.simplify(source, tmp_path / "a.obj", ratio=0.5, progress=call_again)
    (error,) = other
    assert isinstance(error, drystone.LockedError) and error.exit_code == 6
    assert os.path.basename(error.path) == "a.obj.work"


def test_a_work_folder_that_is_damaged(tmp_path):
    work = tmp_path / "work"

    def fail(event: drystone.Event) -> None:
        if event.phase == "stitch":
            raise RuntimeError

    with pytest.raises(RuntimeError):
        drystone.simplify(TOWN, tmp_path / "a.obj", ratio=0.5, work=work, progress=fail)
    for path in work.iterdir():
        if path.suffix in (".bin",):
            data = bytearray(path.read_bytes())
            data[len(data) // 2] ^= 255
            path.write_bytes(data)
    with pytest.raises(drystone.DrystoneError) as caught:
        drystone.simplify(TOWN, tmp_path / "a.obj", ratio=0.5, work=work, resume="require")
    assert caught.value.exit_code in (5, 8)


def test_a_file_of_the_system(tmp_path):
    (tmp_path / "folder").mkdir(mode=0o500)
    with pytest.raises(OSError) as caught:
        drystone.simplify(TOWN, "/proc/nowhere/a.obj", ratio=0.5)
    assert isinstance(caught.value, drystone.DrystoneError) and caught.value.errno is not None
    if os.geteuid() != 0:
        with pytest.raises(PermissionError) as denied:
            drystone.simplify(TOWN, tmp_path / "folder" / "a.obj", ratio=0.5)
        assert isinstance(denied.value, drystone.IoError)


FULL = """
import resource, signal, sys, drystone
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))
try:
    drystone.simplify(sys.argv[1], sys.argv[2], ratio=0.9)
except OSError as error:
    print(type(error).__name__, isinstance(error, drystone.IoError))
"""


@pytest.mark.skipif(not hasattr(resource, "RLIMIT_FSIZE"), reason="needs limits of POSIX")
def test_a_file_that_grows_too_large(tmp_path):
    command = [sys.executable, "-c", FULL, str(TOWN), str(tmp_path / "a.obj")]
    assert subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip() == "IoError True"


def test_a_bound_that_is_broken(tmp_path):
    report = drystone.simplify(TOWN, tmp_path / "a.obj", ratio=0.5)
    from drystone.files import judge

    with pytest.raises(drystone.BoundBrokenError) as caught:
        judge(report, 1, False)
    assert caught.value.report is report and caught.value.exit_code == 1


EVERY = [
    errors.from_native("usage", "`ratio`: no", None, None),
    errors.from_native("budget", "no", None, None),
    errors.from_native("input", "a.obj:3: no", b"/proc/self", 3),
    errors.from_native("input", "gone.obj: no", "/gone.obj", None),
    errors.from_native("io", "a: denied", "/a", errno.EACCES),
    errors.from_native("io", "a: odd", "/a", None),
    errors.from_native("no_space", "a: full", "/a", None),
    errors.from_native("changed", "changed", None, None),
    errors.from_native("locked", "/w: locked", "/w", None),
    errors.from_native("damaged", "/w/a: damaged", "/w/a", None),
    errors.from_native("limit", "too many", None, None),
    errors.from_native("internal", "index out of bounds", None, None),
    errors.TargetMissedError("missed", None),
    errors.BoundBrokenError("broken", None),
]
BUILTIN = [ValueError, ValueError, ValueError, FileNotFoundError, PermissionError, OSError, OSError, Exception]
BUILTIN += [BlockingIOError, Exception, OverflowError, Exception, Exception, Exception]


@pytest.mark.parametrize(("error", "builtin"), list(zip(EVERY, BUILTIN)), ids=lambda e: type(e).__name__)
def test_errors_are_builtin_ones_and_travel_between_processes(error, builtin):
    assert isinstance(error, drystone.DrystoneError) and isinstance(error, builtin)
    copy = pickle.loads(pickle.dumps(error))
    assert type(copy) is type(error) and str(copy) == str(error) and copy.exit_code == error.exit_code
    for name in ("path", "line", "row", "errno", "filename", "needed"):
        assert getattr(copy, name, None) == getattr(error, name, None)


def test_a_full_disk_has_the_error_number_of_the_system():
    error = errors.from_native("no_space", "a: full", "/a", None)
    assert error.errno == errno.ENOSPC and error.filename == "/a" and error.exit_code == 7


def test_a_report_travels_between_processes(tmp_path):
    report = drystone.simplify(TOWN, tmp_path / "a.obj", ratio=0.5)
    assert pickle.loads(pickle.dumps(report)) == report
    vertices, faces = grid(5)
    mesh = drystone.simplify_mesh(vertices, faces, ratio=0.5)
    assert pickle.loads(pickle.dumps(mesh)).report == mesh.report


def test_equal_records_have_equal_hashes(tmp_path):
    report = drystone.simplify(TOWN, tmp_path / "a.obj", ratio=0.5)
    inspection = drystone.inspect(TOWN)
    others = [drystone.plan(TOWN, ratio=0.5), drystone.check(TOWN), drystone.compare(TOWN, TOWN, samples=1000)]
    for record in [report, report.options, inspection, *others]:
        copy = type(record).from_dict(record.to_dict())
        assert {record: 1}[copy] == 1
    other = drystone.Inspection.from_dict(inspection.to_dict() | {"faults": {"none": 1}})
    assert other != inspection and len({other, inspection}) == 2
