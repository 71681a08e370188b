"""What the guide, the docstrings and the types say holds."""

import doctest
import importlib
import inspect
import re
import contextlib
import io
import subprocess
import sys
import typing
from pathlib import Path

import pytest

import drystone
from conftest import ROOT
from drystone import options

GUIDE = ROOT / "docs" / "guide" / "python.md"
PACKAGE = ROOT / "python"
MODULES = ["", ".arrays", ".array_file", ".errors", ".files", ".options", ".progress", ".record", ".report"]


def blocks(text: str) -> list[tuple[str, str, str]]:
    """Indentation, language and code of each fenced block."""
    return re.findall(r"^( *)```(\w*)\n(.*?)^ *```$", text, re.MULTILINE | re.DOTALL)


def test_the_guide_runs_and_prints_what_it_shows(tmp_path, monkeypatch):
    pytest.importorskip("matplotlib").use("Agg")
    pytest.importorskip("trimesh")
    (tmp_path / "fixtures").symlink_to(ROOT / "fixtures")
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    printed, count = "", 0
    for indentation, language, code in blocks(GUIDE.read_text()):
        code = "\n".join(line.removeprefix(indentation) for line in code.splitlines()) + "\n"
        if language == "python":
            out = io.StringIO()
            with contextlib.redirect_stdout(out):
                exec(compile(code, str(GUIDE), "exec"), names)
            printed, count = out.getvalue(), count + 1
        elif language == "" and "venv" not in code:
            assert code == printed
    assert count >= 8 and (tmp_path / "hills.png").stat().st_size > 10_000
    assert (GUIDE.parent / "python-hills.png").exists()


def test_the_guide_names_everything_public():
    text = GUIDE.read_text()
    missing = [name for name in drystone.__all__ if f"{name}" not in text and name not in ("errors", "__version__", "build")]
    assert [name for name in missing if name not in ("Mesh",)] == []


@pytest.mark.parametrize("module", MODULES)
def test_examples_in_docstrings(module):
    assert doctest.testmod(importlib.import_module(f"drystone{module}")).failed == 0


def flags_of(command: str) -> set[str]:
    """Flags of a command, as keywords."""
    text = subprocess.run([sys.executable, "-m", "drystone", command, "--help"], capture_output=True, text=True).stdout
    return {flag.replace("-", "_") for flag in re.findall(r"^ +(?:-\w, )?--([a-z-]+)", text, re.MULTILINE)}


KEYWORDS = {"face_count": "faces", "metric_options": "metric_option"}
OF_TERMINALS = {"help", "version", "json", "quiet", "format", "output"}
OF_PYTHON = {"hands", "progress", "stop", "strict", "options", "input", "output", "tile"}


@pytest.mark.parametrize("name", ["simplify", "tile", "compare", "inspect", "check"])
def test_keywords_are_the_options_of_the_command(name):
    function = getattr(drystone, name)
    found = set(inspect.signature(function).parameters) - OF_PYTHON
    found |= {"simplify": options.FILE_KEYS, "tile": options.TILE_KEYS}.get(name, frozenset())
    positional = {"compare": {"original", "result"}, "check": {"mesh"}}.get(name, set())
    assert {KEYWORDS.get(keyword, keyword) for keyword in found - positional} == flags_of(name) - OF_TERMINALS


def test_choices_are_those_of_the_command():
    text = subprocess.run([sys.executable, "-m", "drystone", "simplify", "--help"], capture_output=True, text=True).stdout
    hints = typing.get_type_hints(options.FileOptions)
    found = 0
    for name, hint in hints.items():
        if typing.get_origin(hint) is typing.Literal:
            section = re.split(r"\n +(?:-\w, )?--", text.split(f"--{name.replace('_', '-')} <")[1])[0]
            assert set(re.findall(r"^ +- ([a-z0-9-]+):", section, re.MULTILINE)) == set(typing.get_args(hint)), name
            found += 1
    assert found >= 9


def test_every_public_item_has_a_docstring():
    for name in drystone.__all__:
        item = getattr(drystone, name)
        if inspect.isclass(item) or inspect.isfunction(item):
            assert inspect.getdoc(item), name


def test_types_are_strict():
    pytest.importorskip("mypy")
    done = subprocess.run([sys.executable, "-m", "mypy"], cwd=PACKAGE, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout


TYPED = """
import numpy as np
import drystone
report: drystone.Report = drystone.simplify("a.obj", "b.obj", ratio=0.1, seams="lock", metric_options={"border": 2})
count: int = report.faces.output
plan: drystone.Plan = drystone.plan("a.obj", ratio=0.5)
tiles: drystone.TilePlan = drystone.plan("a.obj", tile=True, tile_faces=5000)
mesh = drystone.simplify_mesh(np.zeros((3, 3)), [[0, 1, 2]], ratio=0.5, progress=lambda event: print(event.phase))
vertices, faces, *_ = mesh
"""
MISTYPED = [
    'drystone.simplify("a.obj", "b.obj", ratio=0.1, seams="firm")',
    'drystone.simplify("a.obj", "b.obj", ratio=0.1, seam="lock")',
    'drystone.plan("a.obj", tile=True, ratio=0.5)',
    'drystone.simplify_mesh([[0.0]], [[0]], ratio=0.5, normals="drop")',
]


def test_mistakes_are_seen_by_a_checker_of_types(tmp_path):
    pytest.importorskip("mypy")
    source = tmp_path / "a.py"
    command = [sys.executable, "-m", "mypy", "--strict", source]

    def check(text: str) -> subprocess.CompletedProcess[str]:
        source.write_text(text)
        return subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, env={"MYPYPATH": str(PACKAGE)})

    assert check(TYPED).returncode == 0, check(TYPED).stdout
    done = check("import drystone\n" + "\n".join(MISTYPED))
    assert {int(line.split(":")[1]) for line in done.stdout.splitlines() if ": error:" in line} == {2, 3, 4, 5}


def test_the_stub_is_that_of_the_native_module(tmp_path):
    pytest.importorskip("mypy")
    command = [sys.executable, "-m", "mypy.stubtest", "drystone._native"]
    # From elsewhere: the sources in the checkout need not be built.
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout


def test_versions_agree():
    text = (PACKAGE / "Cargo.toml").read_text()
    assert f'version = "{drystone.__version__}"' in text
    assert f'version = "{drystone.__version__}"' in (Path(ROOT) / "Cargo.toml").read_text()
