"""The Python package: a wheel for old and new Linux, and the source package that it is built from."""

import base64
import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
import tarfile
import zipfile

import licences
from building import (
    OLDEST_GLIBC,
    REPOSITORY,
    ReleaseError,
    environment_of_tools,
    linked_crates,
    printed,
    run,
    target_folder,
)

# A name that maturin takes for that of a licence.
NOTICES = "LICENCES-OF-CRATES.txt"


def unpack_source(package, release):
    """Unpacks the source package; adds what only the checkout knows: the commit, and the licences of the crates."""
    # NOTE: `maturin build --sdist` unpacks it, too, but into a folder of random name, which stays in the program.
    folder = target_folder() / "release-source"
    shutil.rmtree(folder, ignore_errors=True)
    with tarfile.open(package) as archive:
        archive.extractall(folder, filter="data")
    (source,) = folder.iterdir()
    changes = printed("git", "status", "--porcelain", "--untracked-files=no")
    note = {"git": {"sha1": release.commit, "dirty": bool(changes)}}
    (source / ".cargo_vcs_info.json").write_text(json.dumps(note))
    text = licences.notices(linked_crates(release, "drystone-python"))
    (source / NOTICES).write_text(text, encoding="utf-8", newline="\n")
    return source


def replace_paths(wheel, source):
    """Replaces the folder of the source in the wheel's SBOM, and the hashes of what changed in its RECORD."""
    with zipfile.ZipFile(wheel) as old:
        entries = {info: old.read(info) for info in old.infolist()}
    record = next(info for info in entries if info.filename.endswith(".dist-info/RECORD"))
    for info, content in entries.items():
        if "/sboms/" not in info.filename:
            continue
        entries[info] = content.replace(source.as_uri().encode(), b"file:///drystone")
        line = re.compile(rb"^%s,.*$" % re.escape(info.filename.encode()), re.MULTILINE)
        digest = base64.urlsafe_b64encode(hashlib.sha256(entries[info]).digest()).rstrip(b"=")
        changed = b"%s,sha256=%s,%d" % (info.filename.encode(), digest, len(entries[info]))
        entries[record], count = line.subn(changed, entries[record])
        if count != 1:
            raise ReleaseError(f"RECORD of {wheel.name} names {info.filename} {count} times")
    with zipfile.ZipFile(wheel, "w") as new:
        for info, content in entries.items():
            new.writestr(info, content)


def only(place, pattern):
    found = list(place.glob(pattern))
    if len(found) != 1:
        raise ReleaseError(f"expected one {pattern} in {place}, found {len(found)}")
    return found[0]


def build_wheel(release, place, variables):
    """Writes the wheel and the source package; refuses a wheel that needs more than it says."""
    programs = environment_of_tools()
    variables = variables | {"PATH": f"{programs}{os.pathsep}{os.environ['PATH']}"}
    manifest = REPOSITORY / "python" / "Cargo.toml"
    run(programs / "maturin", "sdist", "--manifest-path", manifest, "--out", place, env=variables)
    source = unpack_source(only(place, f"drystone-{release.version}.tar.gz"), release)
    command = [programs / "maturin", "build", "--locked", "--profile", "dist", "--out", place]
    platform = "manylinux_" + OLDEST_GLIBC.replace(".", "_")
    linux = ["--zig", "--compatibility", platform] if sys.platform == "linux" else []
    run(*command, *linux, "--manifest-path", source / "python" / "Cargo.toml", env=variables)
    wheel = only(place, "drystone-*.whl")
    replace_paths(wheel, source)
    run(programs / "abi3audit", "--strict", wheel)
    if linux:
        shown = run(programs / "auditwheel", "show", wheel, stdout=subprocess.PIPE, text=True).stdout
        tag = re.search(r'platform tag: "manylinux_2_([0-9]+)_', " ".join(shown.split()))
        if tag is None or int(tag[1]) > int(OLDEST_GLIBC.rpartition(".")[2]):
            raise ReleaseError(f"the wheel is not one for {platform}:\n{shown}")
