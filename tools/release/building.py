"""Steps of a release: program, what goes with it, archive, SBOM, Debian package, checksums."""

import gzip
import hashlib
import io
import json
import os
import re
import shutil
import subprocess
import sys
import tarfile
import venv
import zipfile
from dataclasses import dataclass
from email.utils import formatdate
from pathlib import Path

import licences

REPOSITORY = Path(__file__).resolve().parents[2]
# Versions that the files are made with: others may give other bytes.
TOOLS = {"auditable": "0.7.7", "cyclonedx": "0.5.9"}
DEBIAN_TOOLS = {"deb": "3.8.0"}
# maturin builds the wheel; zig links with an older glibc than this machine's, for cargo by cargo-zigbuild; the others look
# at the wheel.
PYTHON_TOOLS = {"maturin": "1.16.0", "ziglang": "0.17.1", "cargo-zigbuild": "0.24.1", "auditwheel": "6.8.2", "abi3audit": "0.0.26"}
# The oldest glibc that a program for Linux runs with.
OLDEST_GLIBC = "2.28"
# Shells, and the name under which each finds its completions.
COMPLETIONS = {
    "bash": "drystone.bash",
    "elvish": "drystone.elv",
    "fish": "drystone.fish",
    "powershell": "_drystone.ps1",
    "zsh": "_drystone",
}
PAGES = ["README.md", "CHANGELOG.md", "CONTRIBUTING.md", "LICENSE-APACHE", "LICENSE-MIT", "docs/town.png"]


class ReleaseError(Exception):
    """A step that cannot be done, and what helps."""


@dataclass
class Release:
    """What is built: version, target triple of the compiler, commit, and its time in seconds since 1970."""

    version: str
    target: str
    commit: str
    time: int

    @property
    def name(self):
        return f"drystone-{self.version}-{self.target}"

    @property
    def needs_glibc(self):
        return self.target.endswith("linux-gnu")

    @property
    def built(self):
        """Where cargo puts the program, and `package/` beside it."""
        return target_folder() / self.target / "dist"

    @property
    def program(self):
        return self.built / ("drystone.exe" if "windows" in self.target else "drystone")


def target_folder():
    return Path(os.environ.get("CARGO_TARGET_DIR", REPOSITORY / "target")).absolute()


def run(*command, **more):
    try:
        done = subprocess.run(list(map(str, command)), cwd=REPOSITORY, stdin=subprocess.DEVNULL, **more)
    except FileNotFoundError:
        raise ReleaseError(f"'{command[0]}' is missing") from None
    if done.returncode != 0:
        raise ReleaseError(f"exit code {done.returncode} of: {' '.join(map(str, command))}")
    return done


def printed(*command, **more):
    return run(*command, stdout=subprocess.PIPE, text=True, **more).stdout.strip()


def find_release(allow_changes):
    changes = printed("git", "status", "--porcelain", "--untracked-files=no")
    if changes and not allow_changes:
        raise ReleaseError(f"the checkout has changes; commit them, or pass --allow-changes\n{changes}")
    compiler = dict(line.split(": ", 1) for line in printed("rustc", "-vV").splitlines()[1:])
    packages = json.loads(printed("cargo", "metadata", "--locked", "--no-deps", "--format-version", "1"))["packages"]
    package = next(package for package in packages if package["name"] == "drystone")
    commit, time = printed("git", "log", "-1", "--format=%H %ct").split()
    return Release(package["version"], compiler["host"], commit, int(time))


def bring_tools():
    """Installs the tools that are absent; those that are there have the version that is expected."""
    for tool, version in (TOOLS | (DEBIAN_TOOLS if makes_debian() else {})).items():
        install = f"cargo install cargo-{tool}@{version} --locked"
        if shutil.which(f"cargo-{tool}") is None:
            print(f"cargo-{tool} is absent: installing it once ({install})", flush=True)
            run(*install.split(), "--quiet")
        # NOTE: cargo-auditable hands `--version` to cargo and does not name its own.
        elif tool != "auditable" and printed("cargo", tool, "--version").split()[-1] != version:
            raise ReleaseError(f"another cargo-{tool} is installed: {install} --force")


def makes_debian():
    return shutil.which("dpkg-deb") is not None


def environment(release):
    """Variables of the build: no path of this machine enters the program, no clock either."""
    home = Path(os.environ.get("CARGO_HOME", Path.home() / ".cargo")).absolute()
    # The last prefix that fits counts. The folder below `src` is named for the registry or its mirror.
    prefixes = [(home, "/cargo"), (REPOSITORY, "/drystone"), (target_folder(), "/drystone/target")]
    prefixes += [(folder, "/cargo/registry") for folder in sorted((home / "registry" / "src").glob("*"))]
    flags = [f"--remap-path-prefix={path}={name}" for path, name in prefixes]
    if release.target.endswith("windows-msvc"):
        flags.append("-Clink-arg=/Brepro")
    variables = {name: text for name, text in os.environ.items() if name != "RUSTFLAGS"}
    return variables | {
        "CARGO_ENCODED_RUSTFLAGS": "\x1f".join(flags),
        "CARGO_INCREMENTAL": "0",
        "SOURCE_DATE_EPOCH": str(release.time),
    }


def environment_of_tools():
    """The folder of programs of a virtual environment that has the tools of Python's registry."""
    folder, tools = target_folder() / "release-venv", [f"{name}=={version}" for name, version in PYTHON_TOOLS.items()]
    programs = folder / ("Scripts" if os.name == "nt" else "bin")
    stamp = folder / "tools.txt"
    if not stamp.exists() or stamp.read_text() != "\n".join(tools):
        venv.create(folder, with_pip=True, clear=True)
        run(programs / "python", "-m", "pip", "install", "--quiet", "--disable-pip-version-check", *tools)
        stamp.write_text("\n".join(tools))
    return programs


def compile_program(release, variables):
    """Compiles the program; where it needs glibc, for the oldest one, and refuses it if it asks for a newer one."""
    run("cargo", "fetch", "--locked", "--quiet", "--target", release.target)
    # Fetching may have made the registry's folder.
    variables |= environment(release)
    build, target = "build", release.target
    if release.needs_glibc:
        build, target = "zigbuild", f"{target}.{OLDEST_GLIBC}"
        variables = variables | {"PATH": f"{environment_of_tools()}{os.pathsep}{os.environ['PATH']}"}
    command = ["cargo", "auditable", build, "--locked", "--profile", "dist", "--bin", "drystone"]
    run(*command, "--target", target, env=variables)
    asked = newest_glibc(release.program.read_bytes())
    if release.needs_glibc and asked > version_parts(OLDEST_GLIBC):
        raise ReleaseError(f"the program asks for glibc {'.'.join(map(str, asked))}, not {OLDEST_GLIBC}")


def version_parts(text):
    return tuple(map(int, text.split(".")))


def newest_glibc(program):
    """The newest version of glibc of which the bytes of a program name symbols."""
    named = re.findall(rb"\0GLIBC_([0-9]+(?:\.[0-9]+)+)(?=\0)", program)
    return max((version_parts(version.decode()) for version in named), default=(0,))


def gather(release):
    """Fills `package/` with all that goes with the program."""
    folder = release.built / "package"
    shutil.rmtree(folder, ignore_errors=True)
    (folder / "completions").mkdir(parents=True)
    shutil.copy(release.program, folder)
    run(release.program, "man", "--out", folder / "man")
    for shell, name in COMPLETIONS.items():
        script = run(release.program, "completions", shell, stdout=subprocess.PIPE).stdout
        (folder / "completions" / name).write_bytes(script)
    pages = [path for path in printed("git", "ls-files", "docs").splitlines() if path.endswith(".md")]
    for page in PAGES + pages:
        (folder / page).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(REPOSITORY / page, folder / page)
    notes = {
        "THIRD-PARTY-LICENCES.txt": licences.notices(linked_crates(release)),
        "BUILD.txt": build_note(release),
    }
    for name, text in notes.items():
        (folder / name).write_text(text, encoding="utf-8", newline="\n")
    return folder


def tree(release, edges, package="drystone"):
    """Crates that are compiled for the program, or for the Python package, one a line."""
    command = ["cargo", "tree", "--locked", "--package", package, "--target", release.target]
    command += ["--no-dedupe", "--prefix", "none"]
    return printed(*command, "--format", "{p}", "--edges", edges)


def linked_crates(release, package="drystone"):
    command = ["cargo", "metadata", "--locked", "--format-version", "1", "--filter-platform", release.target]
    return licences.linked_crates(json.loads(printed(*command)), tree(release, "normal,no-proc-macro", package))


def build_note(release):
    """What the bytes of the program depend on."""
    lines = [f"commit: {release.commit}", f"target: {release.target}"]
    lines += [printed("rustc", "--version"), printed("cargo", "--version")]
    lines += [f"cargo-{tool} {version}" for tool, version in TOOLS.items()]
    if release.needs_glibc:
        lines += [f"{tool} {PYTHON_TOOLS[tool]}" for tool in ("ziglang", "cargo-zigbuild")] + [f"glibc {OLDEST_GLIBC}"]
    return "\n".join([*lines, "again: python3 tools/release, in a checkout of the commit", ""])


def archive(release, folder, place):
    """An archive of the folder; order, times, owners and modes do not depend on the machine."""
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    entries = [(f"{release.name}/{path.relative_to(folder).as_posix()}", path) for path in files]
    is_program = lambda path: path.name == release.program.name
    if "windows" in release.target:
        path = place / f"{release.name}.zip"
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as zipped:
            for name, file in entries:
                zipped.writestr(zipfile.ZipInfo(name), file.read_bytes(), zipfile.ZIP_DEFLATED)
        return path
    path = place / f"{release.name}.tar.gz"
    tarred = io.BytesIO()
    with tarfile.open(fileobj=tarred, mode="w", format=tarfile.USTAR_FORMAT) as tar:
        for name, file in entries:
            entry = tarfile.TarInfo(name)
            entry.size, entry.mtime = file.stat().st_size, release.time
            entry.mode = 0o755 if is_program(file) else 0o644
            with file.open("rb") as stream:
                tar.addfile(entry, stream)
    path.write_bytes(gzip.compress(tarred.getvalue(), 9, mtime=0))
    return path


def bill_of_materials(release, place, variables):
    """The SBOM. The tool writes it beside Cargo.toml; it is moved, and paths of this machine leave it."""
    name = f"{release.name}.cdx"
    command = ["cargo", "cyclonedx", "--format", "json", "--spec-version", "1.5", "--target", release.target]
    run(*command, "--override-filename", name, "--quiet", env=variables)
    made = REPOSITORY / f"{name}.json"
    text = made.read_text(encoding="utf-8")
    # The tool writes one for the Python package, too.
    for path in [made, REPOSITORY / "python" / made.name]:
        path.unlink(missing_ok=True)
    bill = licences.without_unused(json.loads(text.replace(REPOSITORY.as_uri(), "file:///drystone")), tree(release, "normal,build"))
    bill.pop("serialNumber", None)
    (place / f"{name}.json").write_text(json.dumps(bill, indent=1) + "\n", encoding="utf-8", newline="\n")


def debian_package(release, package, place, variables):
    folder = release.built / "debian"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    maintainer = "The drystone contributors"
    command = ["cargo", "deb", "--locked", "--no-build", "--no-strip", "--profile", "dist", "--target", release.target]
    name, address = os.environ.get("DEBFULLNAME"), os.environ.get("DEBEMAIL")
    if name and address:
        maintainer = f"{name} <{address}>"
        command += ["--maintainer", maintainer]
    else:
        print("NOTE: the Debian package names no address: set DEBFULLNAME and DEBEMAIL before publication")
    compressed = {f"{page.name}.gz": page.read_bytes() for page in (package / "man").iterdir()}
    compressed["changelog.gz"] = (REPOSITORY / "CHANGELOG.md").read_bytes()
    compressed["changelog.Debian.gz"] = debian_changelog(release, maintainer).encode()
    for name, text in compressed.items():
        (folder / name).write_bytes(gzip.compress(text, 9, mtime=0))
    (folder / "copyright").write_text(licences.debian_copyright(), encoding="utf-8")
    run(*command, "--output", place, env=variables)


def debian_changelog(release, maintainer):
    time = formatdate(release.time)
    return f"drystone ({release.version}-1) unstable; urgency=medium\n\n  * See changelog.gz.\n\n -- {maintainer}  {time}\n"


def checksums(place):
    # Cargo keeps files of its own there.
    files = sorted(place.glob("drystone[-_]*.*"))
    sums = [f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {path.name}\n" for path in files]
    (place / "SHA256SUMS").write_text("".join(sums), encoding="utf-8", newline="\n")
    return "".join(sums)


def build(allow_changes, build_wheel=None):
    release = find_release(allow_changes)
    bring_tools()
    variables = environment(release)
    compile_program(release, variables)
    print(printed(release.program, "--version"), flush=True)
    place = target_folder() / "dist"
    place.mkdir(parents=True, exist_ok=True)
    for old in [*place.glob("drystone[-_]*.*"), place / "SHA256SUMS"]:
        old.unlink(missing_ok=True)
    package = gather(release)
    archive(release, package, place)
    bill_of_materials(release, place, variables)
    if makes_debian():
        debian_package(release, package, place, variables)
    else:
        print("NOTE: no dpkg: no Debian package", file=sys.stderr)
    if build_wheel is not None:
        build_wheel(release, place, variables)
    print(checksums(place), end="")
