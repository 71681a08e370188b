"""Builds a commit twice and compares: other folders, another CARGO_HOME, the same bytes."""

import filecmp
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from building import REPOSITORY, ReleaseError, bring_tools, printed, run


def clone(folder, commit):
    run("git", "clone", "--quiet", "--no-checkout", REPOSITORY, folder)
    run("git", "-C", folder, "checkout", "--quiet", "--detach", commit)


def other_home(folder):
    """A CARGO_HOME elsewhere with the same registries, so that nothing is downloaded again."""
    home = Path(os.environ.get("CARGO_HOME", Path.home() / ".cargo"))
    folder.mkdir()
    for entry in home.iterdir():
        (folder / entry.name).symlink_to(entry)
    return folder


def made(folder):
    dist = folder / "target" / "dist"
    programs = [path for path in folder.glob("target/*/dist/drystone*") if path.suffix in ("", ".exe")]
    return {path.name: path for path in [*dist.glob("drystone[-_]*.*"), dist / "SHA256SUMS", *programs]}


def is_same(first, second):
    return first is not None and second is not None and filecmp.cmp(first, second, shallow=False)


def compare_two_builds(with_wheel):
    bring_tools()
    commit = printed("git", "rev-parse", "HEAD")
    if printed("git", "status", "--porcelain", "--untracked-files=no"):
        print("NOTE: the checkout has changes; the last commit is compared", flush=True)
    with tempfile.TemporaryDirectory(prefix="drystone-release-") as name:
        place = Path(name)
        folders = [place / "first", place / "another folder" / "second"]
        homes = [None, other_home(place / "home")]
        for folder, home in zip(folders, homes):
            print(f"── {folder}", flush=True)
            clone(folder, commit)
            variables = {key: text for key, text in os.environ.items() if key != "CARGO_TARGET_DIR"}
            if home:
                variables["CARGO_HOME"] = str(home)
            command = [sys.executable, str(folder / "tools" / "release"), *(["--wheel"] if with_wheel else [])]
            if subprocess.run(command, env=variables, stdin=subprocess.DEVNULL).returncode != 0:
                raise ReleaseError("the build failed")
        first, second = map(made, folders)
        names = sorted(first.keys() | second.keys())
        is_equal = {name: is_same(first.get(name), second.get(name)) for name in names}
    for name in names:
        print(f"{'equal    ' if is_equal[name] else 'DIFFERENT'}  {name}")
    if not all(is_equal.values()):
        raise ReleaseError(f"two builds of {commit} differ")
