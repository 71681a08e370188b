"""What is installed: one wheel with the module, the command, its types and a list of what is in it."""

import importlib.metadata
import json
import os
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

import drystone
from conftest import ROOT, TOWN

DISTRIBUTION = importlib.metadata.distribution("drystone")


def installed(name: str) -> Path:
    """A file of the distribution by its name."""
    found = [file for file in DISTRIBUTION.files or [] if file.name == name]
    assert found, f"{name} is not installed"
    return Path(str(DISTRIBUTION.locate_file(found[0])))


def test_the_wheel_is_one_for_all_versions_of_python():
    wheel = DISTRIBUTION.read_text("WHEEL") or ""
    assert "Tag: cp311-abi3-" in wheel and "Root-Is-Purelib: false" in wheel
    metadata = DISTRIBUTION.metadata
    assert metadata["Requires-Python"] == ">=3.11" and metadata["License-Expression"] == "MIT OR Apache-2.0"
    assert [word.split(";")[0].split(">")[0].strip() for word in DISTRIBUTION.requires or []] == ["numpy", "tqdm"]
    assert DISTRIBUTION.version == drystone.__version__


def test_types_are_shipped():
    folder = Path(drystone.__file__).parent
    assert (folder / "py.typed").exists() and (folder / "_native.pyi").exists()


def test_what_the_native_half_is_made_of_is_listed():
    boms = [file for file in DISTRIBUTION.files or [] if file.name.endswith(".cyclonedx.json")]
    assert len(boms) == 1
    bom = json.loads(Path(str(DISTRIBUTION.locate_file(boms[0]))).read_text())
    assert {"pyo3", "rayon", "memmap2"} <= {component["name"] for component in bom["components"]}


def test_the_native_half_uses_what_every_version_of_python_has():
    pytest.importorskip("abi3audit")
    module = Path(drystone.__file__).parent / "_native.abi3.so"
    if not module.exists():
        pytest.skip("another name on this system")
    command = [sys.executable, "-m", "abi3audit", "--strict", "--assume-minimum-abi3", "3.11", str(module)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


def test_the_command_is_a_script():
    script = Path(sysconfig.get_path("scripts")) / "drystone"
    assert script.exists()
    done = subprocess.run([script, "--version"], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == f"drystone {drystone.build}"


def test_the_command_and_files_do_without_numpy(tmp_path):
    code = (
        "import sys; sys.modules['numpy'] = None\n"
        "import drystone\n"
        f"print(drystone.inspect({str(TOWN)!r}).triangles)\n"
        "try: drystone.simplify_mesh\n"
        "except ImportError: print('no arrays')\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "18218\nno arrays\n"


def test_the_command_stops_at_ctrl_c_as_the_program_does(tmp_path):
    import signal
    import time

    source = tmp_path / "a.obj"
    rows = "".join(f"v {i} {j} {(i * j) % 7}\n" for i in range(400) for j in range(400))
    quads = "".join(f"f {i * 400 + j} {i * 400 + j + 1} {i * 400 + j + 401} {i * 400 + j + 400}\n" for i in range(399) for j in range(1, 400))
    source.write_text(rows + quads)
    command = [sys.executable, "-m", "drystone", "simplify", source, "-o", tmp_path / "b.obj", "--ratio", "0.05"]
    child = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    assert child.stderr is not None
    child.stderr.readline()
    time.sleep(0.3)
    child.send_signal(signal.SIGINT)
    said = child.stderr.read()
    assert child.wait(10) == 130 and "stopped by SIGINT" in said and "Traceback" not in said


@pytest.mark.slow
def test_the_source_package_has_all_that_a_build_needs(tmp_path):
    maturin = shutil.which("maturin", path=os.pathsep.join([sysconfig.get_path("scripts"), os.environ["PATH"]]))
    if maturin is None:
        pytest.skip("no maturin")
    subprocess.run([maturin, "sdist", "--out", tmp_path], cwd=ROOT / "python", check=True, capture_output=True)
    (archive,) = tmp_path.glob("drystone-*.tar.gz")
    shutil.unpack_archive(archive, tmp_path / "out")
    (folder,) = (tmp_path / "out").iterdir()
    names = {str(path.relative_to(folder)) for path in folder.rglob("*")}
    assert {"pyproject.toml", "Cargo.lock", "python/Cargo.toml", "src/lib.rs", "PKG-INFO"} <= names
    assert archive.stat().st_size < 3 << 20
    command = ["cargo", "metadata", "--locked", "--offline", "--format-version", "1", "--manifest-path", "python/Cargo.toml"]
    subprocess.run(command, cwd=folder, check=True, capture_output=True)
