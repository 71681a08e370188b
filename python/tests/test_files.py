"""Calls on files: as the command line does them."""

import hashlib
import json
import subprocess
import sys
from pathlib import Path

import pytest

import drystone
from conftest import MINIATURES, TOWN

# What differs between two runs of the same job.
CHANGING = ("command", "began", "seconds", "memory", "io", "timeline", "threads", "input", "inputs", "output")


def run(*arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "drystone", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def hashes(output: Path) -> dict[str, str]:
    files = [path for path in output.parent.rglob("*") if path.is_file()]
    return {str(path.relative_to(output.parent)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


def stable(report: dict) -> dict:
    """A report without what differs from run to run."""
    kept = {key: value for key, value in report.items() if key not in CHANGING}
    kept["options"] = {k: v for k, v in report["options"].items() if k not in ("memory", "threads", "work", "force")}
    return kept


@pytest.mark.parametrize(
    ("flags", "options"),
    [
        (["--ratio", "0.2"], {"ratio": 0.2}),
        (["--ratio", "20%", "--threads", "1", "--memory", "128MiB"], {"ratio": "20%", "threads": 1, "memory": 128 << 20}),
        (["--faces", "3000", "--seams", "follow"], {"face_count": 3000, "seams": "follow"}),
        (["--max-error", "0.05", "--cluster-faces", "2000"], {"max_error": 0.05, "cluster_faces": 2000}),
        (["--ratio", "0.3", "--metric", "qem-1997", "--optimize"], {"ratio": 0.3, "metric": "qem-1997", "optimize": True}),
        (["--ratio", "0.3", "--metric", "qem", "--metric-option", "border=2"], {"ratio": 0.3, "metric": "qem", "metric_options": {"border": 2}}),
        (["--ratio", "0.05", "--textures", "bake", "--texels", "0.25"], {"ratio": 0.05, "textures": "bake", "texels": 0.25}),
    ],
)  # fmt: skip
def test_the_bytes_and_the_report_are_those_of_the_command_line(tmp_path, flags, options):
    outputs = [tmp_path / name / "town.obj" for name in ("command", "python")]
    done = run("simplify", TOWN, "-o", outputs[0], *flags, "--format", "json")
    assert done.returncode == 0, done.stderr
    report = drystone.simplify(TOWN, outputs[1], **options)
    assert hashes(outputs[0]) == hashes(outputs[1])
    assert stable(json.loads(done.stdout)) == stable(report.to_dict())
    assert report.status == "done"


def test_threads_and_memory_do_not_change_the_bytes(tmp_path):
    found = set()
    for threads, memory in [(1, "128MiB"), (2, "1GiB"), (5, None)]:
        output = tmp_path / f"{threads}" / "town.obj"
        drystone.simplify(TOWN, output, ratio=0.1, threads=threads, memory=memory, cluster_faces=2000)
        found.add(hashlib.sha256(output.read_bytes()).hexdigest())
    assert len(found) == 1


def test_each_result_has_the_json_of_its_command(tmp_path):
    output = tmp_path / "town.obj"
    drystone.simplify(TOWN, output, ratio=0.1, report=[tmp_path / "a.json", tmp_path / "a.html"], measure=True, samples=1000)
    written = json.loads((tmp_path / "a.json").read_text())
    assert drystone.Report.from_dict(written).to_dict() == written
    assert (tmp_path / "a.html").stat().st_size > 10_000
    calls = [
        (["inspect", TOWN], drystone.inspect(TOWN)),
        (["check", TOWN], drystone.check(TOWN)),
        (["check", output, "--against", TOWN], drystone.check(output, TOWN)),
        (["plan", TOWN, "--ratio", "0.1", "--textures", "bake"], drystone.plan(TOWN, ratio=0.1, textures="bake")),
        (["plan", TOWN, "--tile"], drystone.plan(TOWN, tile=True)),
        (["compare", TOWN, output, "--samples", "2000"], drystone.compare(TOWN, output, samples=2000)),
        (["status", f"{output}.work"], drystone.status(f"{output}.work")),
    ]
    for arguments, result in calls:
        done = run(*arguments, "--json")
        expected, found = json.loads(done.stdout), result.to_dict()
        assert not expected.get("peak_resident", 1) is None and found.get("peak_resident") is None
        for volatile in ("seconds", "peak_resident", "scratch"):
            assert (volatile in expected) == (volatile in found)
            expected.pop(volatile, None), found.pop(volatile, None)
        assert found == expected, arguments


def test_the_memory_of_this_process_is_not_that_of_a_call(tmp_path):
    output, page = tmp_path / "a.obj", tmp_path / "a.html"
    report = drystone.simplify(TOWN, output, ratio=0.1, report=page)
    assert report.memory.peak_resident is None and report.to_dict()["memory"]["peak_resident"] is None
    assert "peak memory" not in page.read_text() and "Highest memory" not in page.read_text()
    drystone.compare(TOWN, output, samples=1000, report=tmp_path / "b.html")
    assert "peak memory" not in (tmp_path / "b.html").read_text()
    assert drystone.tile(TOWN, tmp_path / "tiles").peak_resident is None
    done = run("simplify", TOWN, "-o", output, "--ratio", "0.1", "--report", page, "--format", "json", "--force")
    assert json.loads(done.stdout)["memory"]["peak_resident"] > 10 << 20
    assert "peak memory" in page.read_text() and "Highest memory" in page.read_text()


def test_tiles_are_those_of_the_command_line(tmp_path):
    done = run("tile", TOWN, "-o", tmp_path / "command", "--origin=5,50,20.5", "--json")
    report = drystone.tile(TOWN, tmp_path / "python", origin=(5, 50, 20.5))
    assert done.returncode == 0, done.stderr
    assert hashes(tmp_path / "command" / "x") == hashes(tmp_path / "python" / "x")
    assert [level.faces for level in report.levels] == [level["faces"] for level in json.loads(done.stdout)["levels"]]
    assert report.origin is not None and report.origin.latitude == 50
    check = drystone.check(tmp_path / "python")
    assert isinstance(check, drystone.TilesetCheck) and check.fault_count == 0


def test_a_kept_work_folder_has_a_status(tmp_path):
    drystone.simplify(TOWN, tmp_path / "a.obj", ratio=0.5, keep_work=True, work=tmp_path / "work")
    status = drystone.status(tmp_path / "work")
    assert isinstance(status, drystone.Status)
    assert status.written and not status.running and status.passes_done == 3 and status.pass_ is None
    assert not drystone.simplify(TOWN, tmp_path / "b.obj", ratio=0.5).resumed


@pytest.mark.parametrize("ending", ["obj", "ply", "drystone"])
def test_a_job_that_is_over_says_where_its_result_is(tmp_path, ending):
    drystone.simplify(TOWN, tmp_path / f"a.{ending}", ratio=0.5)
    status = drystone.status(tmp_path / f"a.{ending}.work")
    assert isinstance(status, drystone.Finished) and status.written and status.output == str(tmp_path / f"a.{ending}")


def test_several_inputs_and_patterns(tmp_path):
    names = ["closed_sphere.obj", "coloured_sphere.obj"]
    both = drystone.inspect([MINIATURES / name for name in names])
    assert both.files == 2
    folder = drystone.inspect(MINIATURES, exclude=["*_sphere.obj", "n*"])
    assert drystone.inspect(MINIATURES, exclude="*_sphere.obj").files == len(list(MINIATURES.glob("*.obj"))) - 2
    assert folder.files == len(list(MINIATURES.glob("*.obj"))) - 2 - len(list(MINIATURES.glob("n*.obj")))


def test_paths_of_every_kind(tmp_path):
    text = str(MINIATURES / "closed_sphere.obj")
    assert drystone.inspect(text) == drystone.inspect(Path(text)) == drystone.inspect(text.encode())


def test_a_path_through_a_link_leads_where_the_system_says(tmp_path):
    (tmp_path / "deep" / "folder").mkdir(parents=True)
    (tmp_path / "link").symlink_to(tmp_path / "deep" / "folder")
    (tmp_path / "deep" / "a.obj").write_bytes((MINIATURES / "closed_sphere.obj").read_bytes())
    assert drystone.inspect(tmp_path / "link" / ".." / "a.obj").files == 1


def test_a_plan_of_tiles_takes_what_their_images_take(tmp_path):
    for where in ("refer", "copy"):
        assert drystone.plan(MINIATURES / "closed_sphere.obj", tile=True, textures_outside=where).levels


def test_a_name_that_looks_like_an_option_is_a_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("--ratio=0.5.obj").write_bytes((MINIATURES / "closed_sphere.obj").read_bytes())
    assert drystone.simplify("--ratio=0.5.obj", "--force.obj", face_count=100).faces.output == 100
    assert Path("--force.obj").exists()


def test_unknown_keywords_are_refused():
    with pytest.raises(TypeError, match="simplify.. got an unexpected keyword argument 'colour'"):
        drystone.simplify(TOWN, "a.obj", ratio=0.1, colour=1)
    with pytest.raises(TypeError, match="'ratio'"):
        drystone.plan(TOWN, tile=True, ratio=0.5)


def test_numbers_may_be_of_any_kind(tmp_path):
    import numpy as np

    found = [
        drystone.simplify(TOWN, tmp_path / f"{number}.obj", face_count=count, optimize=switch).faces.target
        for number, (count, switch) in enumerate([(2000, False), (2e3, np.False_), (np.int16(2000), 0), ("2k", None)])
    ]
    assert found == [2000] * 4
    for options in ({"weld": False}, {"cluster_faces": True}, {"metric": object()}):
        with pytest.raises(TypeError, match=next(iter(options))):
            drystone.simplify(TOWN, tmp_path / "a.obj", ratio=0.5, **options)
    with pytest.raises(TypeError, match="progress"):
        drystone.inspect(TOWN, progress="yes")
    assert drystone.plan(TOWN, tile=True, tile_faces=5e3).levels


def test_dashes_in_paths_stay_in_messages(tmp_path):
    with pytest.raises(drystone.InputError) as caught:
        drystone.inspect(tmp_path / "a --max-error b--faces.obj")
    assert "a --max-error b--faces.obj" in str(caught.value)


def test_the_command_runs():
    assert run("--version").stdout.strip() == f"drystone {drystone.build}"
    assert drystone.build.startswith(drystone.__version__)
    assert run("inspect", "missing.obj").returncode == 4
    assert run("--frobnicate").returncode == 2
    assert "Usage: drystone simplify" in run("simplify", "--help").stdout
