"""Exceptions: each by a cause, each also the builtin one."""

import builtins
import errno
import inspect
import json
import os
import pickle
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import drystone
from conftest import ROOT, TOWN, grid
from drystone import errors
from drystone.files import judge

needs_posix = pytest.mark.skipif(os.name != "posix", reason="needs limits and error numbers of POSIX")
ROW = re.compile(r"^\| ((?:`\w+`(?:, )?)+) \|([^|]*)\| [^|]* \|$", re.MULTILINE)


def builtins_of(kind: type) -> set[type]:
    """Exceptions of Python that a class is, beside Exception."""
    return {base for base in kind.__mro__ if base.__module__ == "builtins"} - {Exception, BaseException, object}


def test_the_guide_says_which_builtin_exception_each_class_is():
    section = (ROOT / "docs" / "guide" / "python.md").read_text().split("## Exceptions")[1]
    shown = set()
    for names, also in ROW.findall(section):
        others = [getattr(errors, name, getattr(builtins, name, None)) for name in re.findall(r"\w+", also)]
        # Of a class with subclasses the first one holds for all of them.
        others = others[:1] if "…" in also else others
        for name in re.findall(r"\w+", names):
            kind = getattr(drystone, name)
            assert all(issubclass(kind, other) for other in others), name
            assert builtins_of(kind) == set().union(*map(builtins_of, others)), name
            shown.add(kind)
    every = {kind for _, kind in inspect.getmembers(errors, inspect.isclass) if issubclass(kind, drystone.DrystoneError)}
    assert shown == every


def exit_code(*arguments: object) -> int:
    """Exit code of the command line."""
    command = [sys.executable, "-m", "drystone", *map(str, arguments), "--quiet"]
    return subprocess.run(command, stderr=subprocess.DEVNULL).returncode


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
    assert isinstance(caught.value, ValueError)
    assert caught.value.exit_code == exit_code("simplify", source, "-o", tmp_path / "b.obj", "--ratio", 0.5) == 4


def test_an_input_that_is_missing(tmp_path):
    with pytest.raises(FileNotFoundError) as caught:
        drystone.inspect(tmp_path / "gone.obj")
    error = caught.value
    assert isinstance(error, drystone.InputError) and error.errno == errno.ENOENT
    assert error.filename == error.path == str(tmp_path / "gone.obj")


# Several clusters: what is lent to `hands` is their stage.
CLUSTERED = {"ratio": 0.5, "cluster_faces": 2000}


def fail(stage: str, count: int, is_stopped: Callable[[], bool]) -> None:
    raise RuntimeError("no machine is left")


def test_another_input_in_the_work_folder(tmp_path):
    source = tmp_path / "a.obj"
    source.write_bytes(TOWN.read_bytes())
    with pytest.raises(RuntimeError, match="no machine is left"):
        drystone.simplify(source, tmp_path / "b.obj", **CLUSTERED, hands=fail)
    source.write_bytes(TOWN.read_bytes() + b"v 0 0 0\n")
    with pytest.raises(drystone.ChangedError) as caught:
        drystone.simplify(source, tmp_path / "b.obj", **CLUSTERED)
    options = ["--ratio", 0.5, "--cluster-faces", 2000]
    assert exit_code("simplify", source, "-o", tmp_path / "b.obj", *options) == caught.value.exit_code == 5


class NoHandsError(Exception):
    pass


def test_a_folder_that_is_locked(tmp_path):
    options, other = {"ratio": 0.5, "cluster_faces": 2000}, []

    # The job waits for its hands.
    def call_again(stage, count, is_stopped):
        with pytest.raises(BlockingIOError) as caught:
            drystone.simplify(TOWN, tmp_path / "a.obj", **options)
        other.append(caught.value)
        raise NoHandsError

    with pytest.raises(NoHandsError):
        drystone.simplify(TOWN, tmp_path / "a.obj", **options, hands=call_again)
    (error,) = other
    assert isinstance(error, drystone.LockedError) and error.exit_code == 6
    assert os.path.basename(error.path) == "a.obj.work"


HOLDER = """
import sys, drystone
def hold(stage, count, is_stopped):
    print("held", flush=True)
    sys.stdin.read()
drystone.simplify(sys.argv[1], sys.argv[2], ratio=0.5, cluster_faces=2000, work=sys.argv[3], hands=hold)
"""


def test_a_folder_that_another_process_holds(tmp_path):
    work, output = tmp_path / "work", tmp_path / "a.obj"
    command = [sys.executable, "-c", HOLDER, TOWN, output, work / "job"]
    holder = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert holder.stdout.readline() == "held\n"
    vertices, faces = grid(12)
    calls = [
        lambda: drystone.simplify(TOWN, output, ratio=0.5, work=work / "job"),
        lambda: drystone.simplify_mesh(vertices, faces, ratio=0.5, work=work),
    ]
    for call in calls:
        with pytest.raises(BlockingIOError, match="locked by another process") as caught:
            call()
        error = caught.value
        assert type(error) is drystone.LockedError and error.errno == errno.EWOULDBLOCK
        assert error.path == error.filename == str(work / "job")
    assert exit_code("simplify", TOWN, "-o", output, "--ratio", 0.5, "--work", work / "job") == error.exit_code
    holder.kill()
    holder.communicate()
    assert drystone.simplify(TOWN, output, ratio=0.5, cluster_faces=2000, work=work / "job").resumed


@pytest.mark.parametrize("name", ["manifest.bin", "journal.bin"])
def test_a_work_folder_that_is_damaged(tmp_path, name):
    work = tmp_path / "work"
    with pytest.raises(RuntimeError, match="no machine is left"):
        drystone.simplify(TOWN, tmp_path / "a.obj", **CLUSTERED, work=work, hands=fail)
    content = bytearray((work / name).read_bytes())
    content[len(content) // 2] ^= 255
    (work / name).write_bytes(content)
    with pytest.raises(drystone.DamagedError, match="damaged") as caught:
        drystone.simplify(TOWN, tmp_path / "a.obj", **CLUSTERED, work=work, resume="require")
    assert caught.value.path == str(work / name) and caught.value.path in str(caught.value)
    options = ["--ratio", 0.5, "--cluster-faces", 2000, "--work", work, "--resume", "require"]
    assert exit_code("simplify", TOWN, "-o", tmp_path / "a.obj", *options) == caught.value.exit_code == 8


PATHS = [
    (lambda folder: drystone.simplify(TOWN, folder / "file" / "a.obj", ratio=0.5), errno.EEXIST),
    (lambda folder: drystone.simplify_mesh(*grid(6), ratio=0.5, work=folder / "file"), errno.EEXIST),
    (lambda folder: drystone.simplify_mesh(*grid(6), ratio=0.5, work=folder / "file" / "below"), errno.ENOTDIR),
    (lambda folder: drystone.simplify_mesh(*grid(6), ratio=0.5, work=folder / ("a" * 300)), errno.ENAMETOOLONG),
]


@needs_posix
@pytest.mark.parametrize(("call", "number"), PATHS)
def test_a_path_that_cannot_be(tmp_path, call, number):
    (tmp_path / "file").write_text("")
    with pytest.raises(drystone.IoError) as caught:
        call(tmp_path)
    error = caught.value
    assert error.errno == number and isinstance(error, type(OSError(number, ""))) and error.exit_code == 1
    assert error.filename.startswith(str(tmp_path)) and error.filename in str(error)


# Nothing is denied to root: it becomes another user, for whom a folder in the temporary one is open.
DENIED = """
import os, sys, numpy as np, drystone
vertices, faces = np.load(sys.argv[1]), np.load(sys.argv[2])
drystone.simplify_mesh(vertices, faces, ratio=0.5)
os.chdir(sys.argv[3])
if os.geteuid() == 0:
    os.seteuid(65534)
calls = [
    lambda: drystone.simplify("town.obj", "shut/a.obj", ratio=0.5),
    lambda: drystone.simplify_mesh(vertices, faces, ratio=0.5, work="shut/work"),
    lambda: drystone.inspect("secret.obj"),
]
for call in calls:
    try:
        call()
    except PermissionError as error:
        is_named = isinstance(error, drystone.IoError) and error.filename in str(error)
        print(error.errno, os.path.relpath(error.filename), is_named)
"""


@pytest.mark.skipif(os.name != "posix", reason="users of POSIX")
def test_what_is_denied_is_a_permission_error(tmp_path):
    for name, array in zip("vf", grid(12)):
        np.save(tmp_path / f"{name}.npy", array)
    folder = Path(tempfile.mkdtemp())
    try:
        folder.chmod(0o755)
        (folder / "shut").mkdir()
        (folder / "shut").chmod(0o500)
        for name in ("town.obj", "secret.obj"):
            (folder / name).write_bytes(TOWN.read_bytes())
            (folder / name).chmod(0o444 if name == "town.obj" else 0)
        command = [sys.executable, "-c", DENIED, tmp_path / "v.npy", tmp_path / "f.npy", folder]
        done = subprocess.run(command, capture_output=True, text=True)
    finally:
        shutil.rmtree(folder)
    found = [line.split() for line in done.stdout.splitlines()]
    assert len(found) == 3, done.stderr
    assert all(number == str(errno.EACCES) and is_named == "True" for number, _, is_named in found)
    paths = [path for _, path, _ in found]
    assert paths[0].startswith("shut") and paths[1:] == ["shut/work", "secret.obj"]


LIMITED = """
import json, os, resource, signal, sys, tempfile, numpy as np, drystone
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
vertices, faces = np.load(sys.argv[1]), np.load(sys.argv[2])
texture = np.random.default_rng(1).integers(0, 256, (512, 512, 3), dtype=np.uint8)
baked = dict(uv=vertices[:, :2], texture=texture, textures="bake")
folder = tempfile.tempdir = sys.argv[4]
calls = [
    lambda: drystone.simplify(sys.argv[3], os.path.join(folder, "a.obj"), ratio=0.9, force=True),
    lambda: drystone.simplify_mesh(vertices, faces, ratio=0.9),
    lambda: drystone.simplify_mesh(vertices, faces, ratio=0.9, work=os.path.join(folder, "work")),
    lambda: drystone.simplify_mesh(vertices, faces, ratio=0.9, **baked),
]
for limit in (2_000, 100_000, 500_000, 1_500_000):
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))
    for number, call in enumerate(calls):
        before = set(os.listdir(folder))
        try:
            call()
        except drystone.IoError as error:
            is_named = os.path.dirname(error.filename).startswith(folder) and error.filename in str(error)
            print(json.dumps([number, error.errno, is_named, sorted(set(os.listdir(folder)) - before)]))
"""


@needs_posix
def test_a_file_that_grows_too_large_is_named(tmp_path):
    for name, array in zip("vf", grid(150)):
        np.save(tmp_path / f"{name}.npy", array)
    (tmp_path / "folder").mkdir()
    command = [sys.executable, "-c", LIMITED, tmp_path / "v.npy", tmp_path / "f.npy", TOWN, tmp_path / "folder"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    found = [json.loads(line) for line in done.stdout.splitlines()]
    assert {number for number, *_ in found} == {0, 1, 2, 3}
    for number, code, is_named, left in found:
        assert code == errno.EFBIG and is_named
        # What can be resumed stays.
        assert set(left) <= {0: {"a.obj.work"}, 2: {"work"}}.get(number, set()), left


FULL = """
import errno, os, subprocess, sys, tempfile, numpy as np, drystone
vertices, faces = np.load(sys.argv[1]), np.load(sys.argv[2])
disk = tempfile.tempdir = sys.argv[3]
work = os.path.join(disk, "work")

def mount(size, *options):
    subprocess.run(["mount", "-t", "tmpfs", "-o", ",".join([f"size={size}k", *options]), "none", disk], check=True)

def same(mesh):
    return np.array_equal(mesh.vertices, expected.vertices) and np.array_equal(mesh.faces, expected.faces)

expected = drystone.simplify_mesh(vertices, faces, ratio=0.5, work=os.path.join(sys.argv[4], "work"))
full = done = 0
for size in (100, 300, 350, 400, 700, 1000, 2000, 4000, 8000):
    mount(size)
    for folder in (None, work):
        try:
            assert same(drystone.simplify_mesh(vertices, faces, ratio=0.5, work=folder))
            done += 1
        except OSError as error:
            assert type(error) is drystone.NoSpaceError and error.errno == errno.ENOSPC and error.exit_code == 7
            assert error.filename.startswith(disk) and error.filename in str(error), error
            full += 1
            if folder is not None:
                mount(20_000, "remount")
                assert same(drystone.simplify_mesh(vertices, faces, ratio=0.5, work=folder))
        assert os.listdir(disk) == [], os.listdir(disk)
    subprocess.run(["umount", disk], check=True)
print(full, done)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="mounts of Linux")
def test_a_full_disk_is_named_and_the_same_call_resumes_once_there_is_space(tmp_path):
    (tmp_path / "disk").mkdir()
    alone = ["unshare", "--map-root-user", "--mount"]
    try:
        subprocess.run([*alone, "mount", "-t", "tmpfs", "none", tmp_path / "disk"], check=True, capture_output=True)
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("this user may not mount")
    for name, array in zip("vf", grid(80)):
        np.save(tmp_path / f"{name}.npy", array)
    arguments = [tmp_path / "v.npy", tmp_path / "f.npy", tmp_path / "disk", tmp_path]
    done = subprocess.run([*alone, sys.executable, "-c", FULL, *arguments], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    full, whole = map(int, done.stdout.split())
    assert full >= 4 and whole >= 4


def test_a_glb_that_its_format_cannot_hold():
    image_class = pytest.importorskip("PIL.Image")
    # Holes of a file are read fast where files are in memory.
    with tempfile.TemporaryDirectory(dir="/dev/shm" if os.path.isdir("/dev/shm") else None) as folder:
        source, output, image = (Path(folder, name) for name in ("a.obj", "b.glb", "a.png"))
        image_class.new("RGB", (8, 8)).save(image)
        os.truncate(image, (4 << 30) + 1)
        Path(folder, "a.mtl").write_text("newmtl a\nmap_Kd a.png\n")
        rows = ["mtllib a.mtl", "usemtl a", "v 0 0 0", "v 1 0 0", "v 0 1 0", "vt 0 0", "vt 1 0", "vt 0 1", "f 1/1 2/2 3/3"]
        source.write_text("\n".join(rows) + "\n")
        with pytest.raises(OverflowError, match="4 GiB") as caught:
            drystone.simplify(source, output, ratio=1.0)
        assert type(caught.value) is drystone.LimitError and caught.value.exit_code == 1 and not output.exists()


def test_a_target_that_is_missed(tmp_path):
    source, output = tmp_path / "a.obj", tmp_path / "b.obj"
    rows = ["v 0 0 0", "v 1 0 0", "v 0 1 0", "v 0 0 1", "v 0 -1 0", "f 1 2 3", "f 2 1 4", "f 1 2 5"]
    source.write_text("\n".join(rows) + "\n")
    options = dict(face_count=1, topology="keep", borders="lock")
    with pytest.warns(drystone.TargetMissed, match="^3 triangles are left; the target was 1$"):
        report = drystone.simplify(source, output, **options)
    with pytest.raises(drystone.TargetMissedError) as caught:
        drystone.simplify(source, output, **options, strict=True, force=True)
    assert caught.value.report.faces == report.faces and output.exists()
    flags = ["--faces", 1, "--topology", "keep", "--borders", "lock", "--force"]
    assert exit_code("simplify", source, "-o", output, *flags) == caught.value.exit_code == 3


def test_a_bound_that_is_broken(tmp_path):
    output = tmp_path / "a.obj"
    report = drystone.simplify(TOWN, output, max_error=0.1, measure=True, samples=1000)
    # The engine keeps its promise: the judge gets the figures of a smaller one.
    bound = report.comparison.geometry.symmetric.max / 2
    broken = replace(report, options=replace(report.options, max_error=bound))
    with pytest.raises(drystone.BoundBrokenError, match=f"^`max_error: {bound}` is broken: the distance from the ") as caught:
        judge(broken, 1, False)
    assert caught.value.report is broken and caught.value.exit_code == 1
    far = max(report.comparison.geometry.forward, report.comparison.geometry.backward, key=lambda way: way.max)
    assert f"{far.max:.6g}, at {far.worst[0].position[0]}" in str(caught.value)


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
    errors.from_native("stopped", "stopped", None, None),
    errors.from_native("task", "task 2 of 5 tasks has no result after 3 tries", None, 2, 7),
]
BUILTIN = [ValueError, ValueError, ValueError, FileNotFoundError, PermissionError, OSError, OSError, Exception]
BUILTIN += [BlockingIOError, Exception, OverflowError, *[Exception] * 5]


@pytest.mark.parametrize(("error", "builtin"), list(zip(EVERY, BUILTIN, strict=True)), ids=lambda e: type(e).__name__)
def test_errors_are_builtin_ones_and_travel_between_processes(error, builtin):
    assert isinstance(error, drystone.DrystoneError) and isinstance(error, builtin)
    copy = pickle.loads(pickle.dumps(error))
    assert type(copy) is type(error) and str(copy) == str(error) and copy.exit_code == error.exit_code
    for name in ("path", "line", "row", "errno", "filename", "needed", "task"):
        assert getattr(copy, name, None) == getattr(error, name, None)


def test_a_panic_has_the_exit_code_of_one():
    error = errors.from_native("internal", "index out of bounds", None, None)
    assert type(error) is drystone.DrystoneError and "please report it" in str(error)
    assert error.exit_code == 101 and drystone.DrystoneError.exit_code == 1


@needs_posix
def test_a_task_without_a_result_has_the_exit_code_of_its_runner(tmp_path):
    runner = "echo {stage} >&2; exit 3"
    with pytest.raises(drystone.TaskError, match="^task 0 of [0-9]+ tasks has no result after 1 try$") as caught:
        drystone.simplify(TOWN, tmp_path / "a.obj", **CLUSTERED, task_runner=runner, task_tries=1)
    assert caught.value.task == 0 and caught.value.exit_code == 3
    options = ["--ratio", 0.5, "--cluster-faces", 2000, "--task-runner", runner, "--task-tries", 1]
    assert exit_code("simplify", TOWN, "-o", tmp_path / "a.obj", *options) == 1


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
