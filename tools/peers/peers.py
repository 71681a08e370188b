"""The tools that are compared: where they come from, how they are called, which version it is.

Everything is brought from the registries: the driver of meshoptimizer is built with Cargo, the others come with pip into a
Python environment beside this file.
"""

import os
import re
import subprocess
import sys
from pathlib import Path

from simplify import QT_PLUGINS

HERE = Path(__file__).resolve().parent
ENVIRONMENT = HERE / ".venv"
REQUIREMENTS = HERE / "requirements.txt"
MESHOPTIMIZER = {"meshoptimizer-update": "update", "meshoptimizer-uv": "uv"}
PYTHON = ["pymeshlab", "pymeshlab-texture", "fast-simplification", "open3d", "vtk"]
NAMES = [*MESHOPTIMIZER, *PYTHON]
# Which package a tool's version is that of.
PACKAGES = {"pymeshlab-texture": "pymeshlab"}


class Peers:
    """The chosen tools, installed."""

    def __init__(self, names):
        self.names = names
        self.driver = build_driver() if any(name in MESHOPTIMIZER for name in names) else None
        self.python = install_packages() if any(name in PYTHON for name in names) else None
        if any("pymeshlab" in name for name in names) and not os.path.isdir(QT_PLUGINS):
            print("NOTE: PyMeshLab reads no JPEG and takes all materials for one without Qt's plugins. On Debian or Ubuntu: "
                  "sudo apt-get install libqt5gui5", file=sys.stderr)

    def command(self, name, source, result, ratio):
        """What is started for one run."""
        if name in MESHOPTIMIZER:
            return [self.driver, source, result, "--ratio", str(ratio), "--mode", MESHOPTIMIZER[name]]
        return [self.python, HERE / "simplify.py", name, source, result, "--ratio", str(ratio)]

    def versions(self):
        """One string for each package."""
        told = [f"`meshopt` crate {locked('meshopt')}"] if self.driver else []
        pins = dict(line.split("==") for line in REQUIREMENTS.read_text().split())
        packages = dict.fromkeys(PACKAGES.get(name, name) for name in self.names if name in PYTHON)
        return told + [f"{package} {pins[package]}" for package in packages]


def build_driver():
    """Path of the release driver of meshoptimizer, built if need be."""
    subprocess.run(["cargo", "build", "--release", "--quiet", "--manifest-path", HERE / "Cargo.toml"], check=True)
    return Path(os.environ.get("CARGO_TARGET_DIR", HERE / "target")) / "release" / "meshopt-obj"


def locked(package):
    return re.search(rf'name = "{package}"\nversion = "([^"]+)"', (HERE / "Cargo.lock").read_text()).group(1)


def install_packages():
    """Path of a Python that has the packages, installed if need be."""
    python, stamp = ENVIRONMENT / "bin" / "python", ENVIRONMENT / "requirements.txt"
    if not stamp.exists() or stamp.read_text() != REQUIREMENTS.read_text():
        subprocess.run([sys.executable, "-m", "venv", "--clear", ENVIRONMENT], check=True)
        subprocess.run([python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "-r", REQUIREMENTS], check=True)
        stamp.write_text(REQUIREMENTS.read_text())
    return python
