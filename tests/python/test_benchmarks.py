"""The scripts that make the pages of docs/results run to their end, on meshes that take a moment."""

import importlib.machinery
import importlib.util
import subprocess
import sys
from types import SimpleNamespace

import pytest

import objlib

TOOLS = objlib.REPOSITORY / "tools"
BENCHMARKS = TOOLS / "benchmarks"
# In place of a peer: gives its input back.
COPY = "import shutil, sys; shutil.copy(sys.argv[2], sys.argv[3])"


def load(path, monkeypatch):
    """A script as a module, with the folder that it would be started in."""
    monkeypatch.syspath_prepend(str(path.parent))
    loader = importlib.machinery.SourceFileLoader(f"script_{path.stem}", str(path))
    module = importlib.util.module_from_spec(importlib.util.spec_from_loader(loader.name, loader))
    monkeypatch.setitem(sys.modules, loader.name, module)
    loader.exec_module(module)
    return module


def rows(page, name):
    return [line for line in page.splitlines() if line.startswith(f"| {name}")]


def call(drystone, script, *arguments):
    """What a script prints."""
    command = [sys.executable, BENCHMARKS / script, *arguments, "--drystone", drystone.binary]
    done = subprocess.run([str(word) for word in command], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout


@pytest.fixture(scope="module")
def strip():
    return objlib.FIXTURES / "miniatures" / "seam_strip.obj"


def test_promises(drystone, strip):
    page = call(drystone, "promises.py", f"strip={strip}", "--samples", "2000")
    assert len(rows(page, "strip")) == 5, page


def test_baking(drystone, strip, tmp_path):
    page = call(drystone, "baking.py", f"strip={strip}", "--only-ratio", "0.1", "--pictures", tmp_path)
    assert len(rows(page, "10 %")) == 5 and "## strip" in page, page


def test_pyramids(drystone, strip, tmp_path):
    page = call(drystone, "pyramids.py", f"strip={strip}", "--level", f"strip/same={strip}", "--pictures", tmp_path)
    assert len(rows(page, "strip")) >= 2, page
    assert list(tmp_path.glob("*.png"))


def test_far_targets(drystone, strip, monkeypatch, tmp_path, capsys):
    module = load(BENCHMARKS / "far_targets.py", monkeypatch)
    copy = tmp_path / "copy.py"
    copy.write_text(COPY)
    monkeypatch.setattr(module, "SIMPLIFY", copy)
    monkeypatch.setattr(module, "install_packages", lambda: sys.executable)
    monkeypatch.setattr(sys, "argv", ["far_targets.py", f"strip={strip}", "--drystone", drystone.binary, "--samples", "2000"])
    module.main()
    found = rows(capsys.readouterr().out, "strip")
    assert len(found) == len(module.RATIOS)
    # The peers leave all triangles, and miss their targets.
    assert all(row.count(" · 0 (48)") == len(module.PEERS) for row in found), found


def test_sizes(drystone, strip, monkeypatch, tmp_path):
    module = load(BENCHMARKS / "run", monkeypatch)
    page = tmp_path / "benchmarks.md"
    page.write_text(f"before\n{module.BEGIN}\nold\n{module.END}\nafter\n")
    monkeypatch.setattr(module, "PROGRAM", drystone.binary)
    monkeypatch.setattr(module, "FOLDER", tmp_path)
    monkeypatch.setattr(module, "RESULTS", tmp_path)
    module.sizes([("strip", strip)])
    text = page.read_text()
    assert rows(text, "strip") and "old" not in text
    assert text.startswith("before\n") and text.endswith("\nafter\n")


class FakePeers:
    """A peer that gives its input back, and one that fails."""

    names = ["copier", "failure"]

    def __init__(self, _names):
        pass

    def versions(self):
        return ["copier 1"]

    def command(self, name, source, result, _ratio):
        return [sys.executable, "-c", COPY if name == "copier" else "raise SystemExit(7)", name, source, result]


def test_peers(drystone, strip, monkeypatch, tmp_path):
    module = load(TOOLS / "peers" / "run.py", monkeypatch)
    page = tmp_path / "page.md"
    monkeypatch.setattr(module, "Peers", FakePeers)
    options = ["--drystone", drystone.binary, "--ratio", "0.5", "--runs", "2", "--samples", "2000", "--write", page]
    monkeypatch.setattr(sys, "argv", ["run.py", *map(str, [strip, *options])])
    module.main()
    text = page.read_text()
    assert len(rows(text, "copier")) == 2 and len(rows(text, "drystone, 1GiB")) == 3, text
    assert rows(text, "failure")[0].startswith("| failure | exit code 7 |")


def test_versions_of_peers(monkeypatch):
    module = load(TOOLS / "peers" / "peers.py", monkeypatch)
    peers = SimpleNamespace(names=module.NAMES, driver="driver")
    versions = module.Peers.versions(peers)
    assert len(versions) == 1 + len(set(module.PYTHON)) - 1, versions
