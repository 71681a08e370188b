"""What every test needs: the program, a way to run it, and the committed town."""

import json
import os
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parent))
import objlib

TIME_LIMIT_SECONDS = 600


@dataclass
class Run:
    """A finished run: exit code, the two streams, the report (None unless asked for and written), and the mesh."""

    code: int
    stdout: str
    stderr: str
    report: dict | None
    output: Path | None

    @property
    def mesh(self):
        return objlib.read(self.output)


class Drystone:
    def __init__(self, binary):
        self.binary = str(binary)

    def __call__(self, *arguments, codes=(0,)):
        """Runs the program with these arguments; any exit code outside `codes` fails the test with its messages."""
        command = [self.binary, *map(str, arguments)]
        done = subprocess.run(
            command, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=TIME_LIMIT_SECONDS
        )
        shown = f"{' '.join(command)}\nexit code {done.returncode}, expected {codes}\n{done.stderr}"
        assert done.returncode in codes, shown
        return Run(done.returncode, done.stdout, done.stderr, None, None)

    def simplify(self, source, folder, *options, codes=(0,), name="out.obj"):
        """Simplifies `source` into folder/name with a report."""
        output, report = Path(folder) / name, Path(folder) / f"{name}.json"
        run = self("simplify", source, "-o", output, "--report", report, "--quiet", *options, codes=codes)
        run.output = output
        run.report = json.loads(report.read_text()) if report.exists() else None
        return run


def find_binary():
    named = os.environ.get("DRYSTONE")
    if named:
        return Path(named)
    target = Path(os.environ.get("CARGO_TARGET_DIR", objlib.REPOSITORY / "target"))
    return target / "release" / "drystone"


@pytest.fixture(scope="session")
def drystone():
    binary = find_binary()
    if shutil.which(binary) is None:
        pytest.fail(f"no program at {binary}: run `cargo build --release`, or set DRYSTONE to its path", pytrace=False)
    return Drystone(binary)


@pytest.fixture(scope="session")
def town_path():
    return objlib.FIXTURES / "town" / "town.obj"


@pytest.fixture(scope="session")
def town(town_path):
    return objlib.read(town_path)


def make_town(folder, triangles):
    from town import size_for, write_town

    write_town(folder, *size_for(triangles))
    return folder / "town.obj"


@pytest.fixture(scope="session")
def small_town(tmp_path_factory):
    """Path of a town of about 5,000 triangles, for encoders that take their time."""
    return make_town(tmp_path_factory.mktemp("small_town"), 5_000)


@pytest.fixture(scope="session")
def middle_town(tmp_path_factory):
    """Path of a town of about 400,000 triangles."""
    return make_town(tmp_path_factory.mktemp("middle_town"), 400_000)


@pytest.fixture(scope="session")
def large_town(tmp_path_factory):
    """Path of a town of about a million triangles."""
    return make_town(tmp_path_factory.mktemp("large_town"), 1_000_000)
