"""What the guide, the docstrings and the types say holds."""

import ast
import doctest
import importlib
import inspect
import re
import contextlib
import io
import subprocess
import sys
import tomllib
import typing
from pathlib import Path

import pytest

import drystone
from conftest import ROOT, TOWN
from drystone import options

GUIDES = ROOT / "docs" / "guide"
GUIDE = GUIDES / "python.md"
PACKAGE = ROOT / "python"
MODULES = ["", ".arrays", ".array_file", ".errors", ".files", ".options", ".progress", ".record", ".report"]


def blocks(page: Path) -> list[tuple[str, str]]:
    """Language and code of each fenced block."""
    found = re.findall(r"^( *)```(\w*)\n(.*?)^ *```$", page.read_text(), re.MULTILINE | re.DOTALL)
    return [(language, re.sub(f"^{indentation}", "", code, flags=re.MULTILINE)) for indentation, language, code in found]


def test_the_guide_runs_and_prints_what_it_shows(tmp_path, monkeypatch):
    pytest.importorskip("matplotlib").use("Agg")
    pytest.importorskip("trimesh")
    (tmp_path / "fixtures").symlink_to(ROOT / "fixtures")
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    printed, count = "", 0
    for language, code in blocks(GUIDE):
        if language == "python":
            out = io.StringIO()
            with contextlib.redirect_stdout(out):
                exec(compile(code, str(GUIDE), "exec"), names)
            printed, count = out.getvalue(), count + 1
        elif language == "" and "venv" not in code:
            assert code == printed
    assert count >= 8 and (tmp_path / "hills.png").stat().st_size > 10_000
    assert (GUIDE.parent / "python-hills.png").exists()


def test_the_guide_installs_what_its_code_imports():
    (line,) = (line for _, code in blocks(GUIDE) for line in code.splitlines() if "install ./python" in line)
    project = tomllib.loads((PACKAGE / "pyproject.toml").read_text())["project"]
    brought = {re.split(r"[^\w-]", requirement)[0] for requirement in project["dependencies"]}
    brought |= set(line.split("install ")[1].split()) - {"./python"}
    codes = [ast.parse(code) for language, code in blocks(GUIDE) if language == "python"]
    nodes = [node for code in codes for node in ast.walk(code)]
    names = {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
    names |= {node.module for node in nodes if isinstance(node, ast.ImportFrom) and node.module}
    needed = {name.split(".")[0] for name in names} - set(sys.stdlib_module_names) - {"drystone"}
    assert len(needed) >= 3 and needed <= brought


def test_the_guide_names_everything_public():
    text = GUIDE.read_text()
    missing = [name for name in drystone.__all__ if f"{name}" not in text and name not in ("errors", "__version__", "build")]
    assert [name for name in missing if name not in ("Mesh",)] == []


# A row of the table of calls: `plan(input, …)`, `plan(input, tile=True, …)` | words | `Plan`, `TilePlan`
CALLS = re.compile(r"^\| (`\w+\([^|]*\)`) \|[^|]*\| ((?:`\w+`(?:, )?)+) \|$", re.MULTILINE)


def forms_of(function) -> list:
    """The overloads of a call, or the call."""
    return typing.get_overloads(function) or [function]


def test_the_guide_shows_the_calls_as_they_are():
    shown = set()
    for calls, results in CALLS.findall(GUIDE.read_text()):
        calls = re.findall(r"`(\w+)\(([^`]*)\)`", calls)
        (name,) = {name for name, _ in calls}
        forms = forms_of(getattr(drystone, name))
        for (_, text), form in zip(calls, forms, strict=True):
            parameters = inspect.signature(form).parameters
            has_more = text.endswith(", …")
            call = ast.parse(f"f({text.removesuffix(', …')})", mode="eval").body
            for keyword in call.keywords:
                parameter, value = parameters[keyword.arg], ast.literal_eval(keyword.value)
                assert value == parameter.default or value in typing.get_args(parameter.annotation), text
            named = [argument.id for argument in call.args] + [keyword.arg for keyword in call.keywords]
            in_order = [key for key, parameter in parameters.items() if parameter.kind is parameter.POSITIONAL_OR_KEYWORD]
            assert named[: len(in_order)] == in_order, text
            assert has_more == bool(parameters.keys() - {*named, "progress", "stop"}), text
        returned = set().union(*(names_of(form.__annotations__["return"]) for form in forms))
        assert set(re.findall(r"\w+", results)) == returned, name
        shown.add(name)
    public = {name for name in drystone.__all__ if inspect.isfunction(getattr(drystone, name))}
    assert shown == public - {"simplify_mesh"}


def names_of(hint) -> set[str]:
    """Names of a class, or of the classes of a union."""
    return {kind.__name__ for kind in typing.get_args(hint) or [hint]}


def test_the_guide_shows_each_array_that_simplify_mesh_takes():
    parameters = list(inspect.signature(drystone.simplify_mesh).parameters)
    shown = re.findall(r"^\| ((?:`\w+`(?:, )?)+) \| \(\w", GUIDE.read_text(), re.MULTILINE)
    assert set(re.findall(r"\w+", " ".join(shown))) == set(parameters[: parameters.index("texture")])


def test_keywords_in_the_words_of_the_guide_are_keywords():
    calls = [getattr(drystone, name) for name in drystone.__all__ if inspect.isfunction(getattr(drystone, name))]
    known = set().union(*(keywords_of(form) for call in calls for form in forms_of(call)))
    words = re.sub(r"```.*?```", "", GUIDE.read_text(), flags=re.DOTALL)
    codes = [code for code in re.findall(r"`([^`]+)`", words) if not code.startswith("--")]
    shown = set(re.findall(r"\b([a-z_]+)=", " ".join(codes)))
    assert len(shown) >= 8 and shown <= known


def test_the_adapters_take_a_mesh_as_the_guide_shows():
    for library in ("trimesh", "pyvista", "open3d"):
        assert f"`drystone.{library}.simplify(mesh, …)`" in GUIDE.read_text()
        simplify = importlib.import_module(f"drystone.{library}").simplify
        assert [*inspect.signature(simplify).parameters][0] == "mesh"


@pytest.mark.parametrize("module", MODULES)
def test_examples_in_docstrings(module):
    assert doctest.testmod(importlib.import_module(f"drystone{module}")).failed == 0


def flags_of(command: str) -> set[str]:
    """Flags of a command, as keywords."""
    text = subprocess.run([sys.executable, "-m", "drystone", command, "--help"], capture_output=True, text=True).stdout
    return {flag.replace("-", "_") for flag in re.findall(r"^ +(?:-\w, )?--([a-z-]+)", text, re.MULTILINE)}


def keywords_of(form) -> set[str]:
    """Keywords that a call takes."""
    parameters = inspect.signature(form).parameters.values()
    names = {parameter.name for parameter in parameters}
    packed = [parameter.annotation for parameter in parameters if parameter.kind is parameter.VAR_KEYWORD]
    return names.union(*(typing.get_type_hints(typing.get_args(annotation)[0]) for annotation in packed))


KEYWORDS = {"face_count": "faces", "metric_options": "metric_option"}
OF_TERMINALS = {"help", "version", "json", "quiet", "format", "output"}
OF_PYTHON = {"hands", "progress", "stop", "strict", "options", "input", "output", "tile"}


@pytest.mark.parametrize("name", ["simplify", "tile", "plan", "compare", "inspect", "check"])
def test_keywords_are_the_options_of_the_command(name):
    found = set().union(*map(keywords_of, forms_of(getattr(drystone, name)))) - OF_PYTHON
    positional = {"compare": {"original", "result"}, "check": {"mesh"}}.get(name, set())
    left_out = OF_TERMINALS | ({"tile"} if name == "plan" else set())
    assert {KEYWORDS.get(keyword, keyword) for keyword in found - positional} == flags_of(name) - left_out


def test_one_dict_of_options_serves_simplify_and_plan(tmp_path):
    every = keywords_of(drystone.simplify) - {"input", "output", "options"}
    assert every <= keywords_of(forms_of(drystone.plan)[0])
    options = dict(
        ratio=0.1, force=True, resume="never", keep_work=True, no_sync=True, tasks=4, task_tries=2, strict=True,
        hands=lambda stage, count, is_stopped: None, report=tmp_path / "a.json", measure=True, samples=2000, seed=3,
        work=tmp_path / "work", memory="256MiB", threads=2, cluster_faces=50_000, textures="bake",
    )  # fmt: skip
    planned = drystone.plan(TOWN, **options)
    assert list(tmp_path.iterdir()) == []
    report = drystone.simplify(TOWN, tmp_path / "a.obj", **options)
    assert report.faces.target == planned.target and (tmp_path / "a.json").exists()


@pytest.mark.parametrize("of_tiles", [False, True])
def test_a_plan_takes_the_keywords_that_its_types_have(of_tiles):
    form = forms_of(drystone.plan)[of_tiles]
    every = set().union(*(keywords_of(call) for call in [*forms_of(drystone.plan), drystone.simplify, drystone.tile]))
    taken = set()
    for keyword in every - {"input", "tile"}:
        with pytest.raises((TypeError, ValueError)) as caught:
            drystone.plan("gone.obj", tile=of_tiles, **{keyword: object()})
        if "unexpected keyword" not in str(caught.value):
            taken.add(keyword)
    assert taken == keywords_of(form) - {"input", "tile", "options"}


def test_choices_are_those_of_the_command():
    text = subprocess.run([sys.executable, "-m", "drystone", "simplify", "--help"], capture_output=True, text=True).stdout
    hints = typing.get_type_hints(options.FileOptions)
    found = 0
    for name, hint in hints.items():
        if typing.get_origin(hint) is typing.Literal:
            section = re.split(r"\n {2,6}(?:-\w, )?--", text.split(f"--{name.replace('_', '-')} <")[1])[0]
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


# Pages on engines have functions without types, and import what need not be installed.
RELAXED = "# mypy: allow-untyped-defs, check-untyped-defs, disable-error-code=import-not-found\n"
PAGES = {PACKAGE / "README.md": "", GUIDE: "", GUIDES / "machines.md": RELAXED, GUIDES / "many-jobs.md": RELAXED}


def test_the_code_of_each_page_has_strict_types(tmp_path):
    pytest.importorskip("mypy")
    programs = []
    for page, settings in PAGES.items():
        codes = [code for language, code in blocks(page) if language == "python"]
        assert codes
        programs.append(tmp_path / f"{page.stem.lower().replace('-', '_')}.py")
        programs[-1].write_text(settings + "".join(codes))
    done = subprocess.run([sys.executable, "-m", "mypy", *programs], cwd=PACKAGE, capture_output=True, text=True)
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


def test_the_types_are_those_of_the_package_as_it_runs(tmp_path):
    pytest.importorskip("mypy")
    settings = ["--mypy-config-file", PACKAGE / "pyproject.toml", "--allowlist", PACKAGE / "tests" / "stubtest.txt"]
    command = [sys.executable, "-m", "mypy.stubtest", "drystone", *settings]
    # From elsewhere: the sources in the checkout need not be built.
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout


def test_versions_agree():
    text = (PACKAGE / "Cargo.toml").read_text()
    assert f'version = "{drystone.__version__}"' in text
    assert f'version = "{drystone.__version__}"' in (Path(ROOT) / "Cargo.toml").read_text()
