"""The Python package: a wheel for old and new Linux, and the source package."""

import os
import subprocess
import sys
import venv

from building import REPOSITORY, ReleaseError, run, target_folder

# maturin builds; zig links with an older glibc than this machine's; auditwheel looks at the result.
TOOLS = ["maturin==1.16.0", "ziglang==0.17.1", "auditwheel==6.8.2", "abi3audit==0.0.26"]
PLATFORM = "manylinux_2_28"


def environment_of_tools():
    """The folder of programs of a virtual environment that has the tools."""
    folder = target_folder() / "release-venv"
    programs = folder / ("Scripts" if os.name == "nt" else "bin")
    stamp = folder / "tools.txt"
    if not stamp.exists() or stamp.read_text() != "\n".join(TOOLS):
        venv.create(folder, with_pip=True, clear=True)
        run(programs / "python", "-m", "pip", "install", "--quiet", "--disable-pip-version-check", *TOOLS)
        stamp.write_text("\n".join(TOOLS))
    return programs


def build_wheel(place, variables):
    """Writes the wheel and the source package; refuses a wheel that needs more than it says."""
    programs = environment_of_tools()
    variables = variables | {"PATH": f"{programs}{os.pathsep}{os.environ['PATH']}"}
    command = [programs / "maturin", "build", "--locked", "--profile", "dist", "--manifest-path", REPOSITORY / "python" / "Cargo.toml"]
    linux = ["--zig", "--compatibility", PLATFORM] if sys.platform == "linux" else []
    run(*command, *linux, "--sdist", "--out", place, env=variables)
    wheels = list(place.glob("drystone-*.whl"))
    if len(wheels) != 1:
        raise ReleaseError(f"expected one wheel in {place}, found {len(wheels)}")
    run(programs / "abi3audit", "--strict", wheels[0])
    if linux:
        shown = run(programs / "auditwheel", "show", wheels[0], stdout=subprocess.PIPE, text=True).stdout
        if PLATFORM not in shown.replace("\n", " "):
            raise ReleaseError(f"the wheel is not one for {PLATFORM}:\n{shown}")
