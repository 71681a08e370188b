"""What is packaged: the crate, manual pages and completions, the archive of a release."""

import re
import subprocess
import sys
import tarfile
import tomllib
import zipfile

import pytest

import objlib

REPOSITORY = objlib.REPOSITORY
sys.path.insert(0, str(REPOSITORY / "tools" / "release"))
import building
import licences

CRATE_BYTES_MAX = 6_000_000
FILE_BYTES_MAX = 300_000
SHELLS = ["bash", "elvish", "fish", "powershell", "zsh"]


@pytest.fixture(scope="module")
def manifest():
    return tomllib.loads((REPOSITORY / "Cargo.toml").read_text())


@pytest.fixture(scope="module")
def crate():
    """Paths of the files that `cargo package` takes."""
    command = ["cargo", "package", "--list", "--allow-dirty", "--locked"]
    done = subprocess.run(command, cwd=REPOSITORY, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return set(done.stdout.splitlines())


@pytest.fixture(scope="module")
def commands(drystone):
    """Names of the commands that the help lists."""
    listed = drystone("--help").stdout.split("Commands:\n")[1].split("\n\n")[0]
    names = set(re.findall(r"^  (\w[\w-]*)  ", listed, re.MULTILINE)) - {"help"}
    assert {"simplify", "tile", "plan", "compare", "man"} <= names
    return names


def test_the_crate_holds_all_that_it_is_compiled_from(crate):
    tracked = subprocess.run(
        ["git", "ls-files", "src", "benches", "examples", "build.rs"], cwd=REPOSITORY, capture_output=True, text=True, check=True
    )
    assert set(tracked.stdout.splitlines()) <= crate
    assert {"Cargo.toml", "Cargo.lock", "README.md", "CHANGELOG.md", "LICENSE-MIT", "LICENSE-APACHE"} <= crate


def test_links_of_the_readme_and_the_index_lead_to_files_of_the_crate(crate):
    for page in ["README.md", "docs/README.md"]:
        links = re.findall(r"\]\(([^)#]+)", (REPOSITORY / page).read_text().replace("\n", " "))
        paths = [(REPOSITORY / page).parent / link for link in links if "://" not in link]
        assert len(paths) > 5
        for path in paths:
            assert path.resolve().relative_to(REPOSITORY).as_posix() in crate, (page, path)


def test_examples_in_the_documentation_use_files_of_the_crate(crate):
    used = set()
    for path in (REPOSITORY / "src").rglob("*.rs"):
        lines = [line for line in path.read_text().splitlines() if line.lstrip().startswith(("//!", "///"))]
        used.update(re.findall(r'"(fixtures/[^"]+)"', "\n".join(lines)))
    assert used and used <= crate


def test_the_crate_is_small(crate):
    sizes = {name: (REPOSITORY / name).stat().st_size for name in crate if (REPOSITORY / name).exists()}
    large = {name: size for name, size in sizes.items() if size > FILE_BYTES_MAX}
    assert not large and sum(sizes.values()) < CRATE_BYTES_MAX
    assert not [name for name in crate if name.startswith(("tests/", "fuzz/", "tools/", "fixtures/town"))]


def test_the_program_of_a_release_is_built_like_release_and_passes_panics_on(manifest):
    profiles = manifest["profile"]
    dist = profiles["release"] | profiles["dist"]
    assert dist["inherits"] == "release" and dist["strip"] == "symbols" and "panic" not in dist


def test_every_command_has_a_manual_page(drystone, commands, tmp_path):
    drystone("man", "--out", tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {"drystone.1"} | {f"drystone-{name}.1" for name in commands}


@pytest.mark.parametrize("shell", SHELLS)
def test_every_shell_completes_every_command(drystone, commands, shell):
    script = drystone("completions", shell).stdout
    assert all(name in script for name in commands)
    assert "max-error" in script


@pytest.mark.parametrize("target", ["x86_64-unknown-linux-gnu", "x86_64-pc-windows-msvc"])
def test_binstall_asks_for_the_archive_of_a_release(manifest, target, tmp_path):
    entry = manifest["package"]["metadata"]["binstall"]
    entry = entry | entry["overrides"].get(target, {})
    release = building.Release("1.2.3", target, "0" * 40, 1_700_000_000)
    (tmp_path / release.program.name).write_text("program")
    archive = building.archive(release, tmp_path, tmp_path)
    values = {"repo": "https://forge", "name": "drystone", "version": "1.2.3", "target": target, "bin": "drystone"}
    values |= {"archive-suffix": {"tgz": ".tar.gz", "zip": ".zip"}[entry["pkg-fmt"]]}
    values |= {"binary-ext": release.program.suffix}
    filled = lambda text: re.sub(r"\{ ([a-z-]+) \}", lambda match: values[match[1]], text)
    assert filled(entry["pkg-url"]) == f"https://forge/releases/download/v1.2.3/{archive.name}"
    opened = zipfile.ZipFile(archive).namelist() if archive.suffix == ".zip" else tarfile.open(archive).getnames()
    assert opened == [filled(entry["bin-dir"])]


def test_the_debian_package_takes_files_that_are_made(manifest):
    made = {f"package/completions/{name}" for name in building.COMPLETIONS.values()} | {"package/THIRD-PARTY-LICENCES.txt"}
    made |= {"drystone"} | {f"debian/{name}" for name in ["*.1.gz", "changelog.gz", "changelog.Debian.gz", "copyright"]}
    sources = [source for source, _, _ in manifest["package"]["metadata"]["deb"]["assets"]]
    assert "target/release/drystone" in sources
    for source in sources:
        assert source.removeprefix("target/release/") in made or (REPOSITORY / source).is_file(), source


def package(name, version="1.0.0", source="registry", licence="MIT", folder=None):
    return {
        "name": name,
        "version": version,
        "source": source,
        "license": licence,
        "authors": [f"Author of {name}"],
        "manifest_path": str(folder / "Cargo.toml") if folder else "",
    }


def test_licences_are_those_of_linked_crates_and_each_text_stands_once(tmp_path):
    packages = []
    for name, text in [("linked", "Free, as\nin all."), ("other", "Free, as in all.\n"), ("bare", None), ("unused", "No.")]:
        folder = tmp_path / name
        folder.mkdir()
        packages.append(package(name, folder=folder))
        if text:
            (folder / "LICENSE").write_text(text)
    metadata = {"packages": [*packages, package("drystone", source=None)]}
    crates = licences.linked_crates(metadata, "drystone v1.0.0 (/somewhere)\nlinked v1.0.0\nother v1.0.0\nbare v1.0.0")
    assert [crate["name"] for crate in crates] == ["bare", "linked", "other"]
    notices = licences.notices(crates)
    assert notices.count("Free, as") == 1 and "linked 1.0.0, other 1.0.0" in notices
    assert "bare 1.0.0: MIT, by Author of bare" in notices and "unused" not in notices


def test_the_bill_of_materials_names_no_crate_that_is_not_compiled():
    component = lambda name: {"bom-ref": f"ref {name}", "name": name, "version": "1.0.0"}
    bill = {
        "metadata": {"component": component("drystone")},
        "components": [component("used"), component("unused")],
        "dependencies": [
            {"ref": "ref drystone", "dependsOn": ["ref used"]},
            {"ref": "ref used", "dependsOn": ["ref unused"]},
            {"ref": "ref unused"},
        ],
    }
    bill = licences.without_unused(bill, "drystone v1.0.0 (/somewhere)\nused v1.0.0 (proc-macro)")
    assert bill["components"] == [component("used")]
    assert bill["dependencies"] == [{"ref": "ref drystone", "dependsOn": ["ref used"]}, {"ref": "ref used", "dependsOn": []}]


def test_the_glibc_that_a_program_needs_is_the_newest_that_it_names():
    program = b"GLIBC_2.40 in words\0GLIBC_2.2.5\0GLIBC_2.28\0GLIBC_2.4\0GLIBC_PRIVATE\0"
    assert building.newest_glibc(program) == (2, 28) <= building.version_parts(building.OLDEST_GLIBC)
    assert building.newest_glibc(b"static") == (0,)


def test_an_archive_does_not_depend_on_times_modes_and_the_folder(tmp_path):
    release = building.Release("1.2.3", "x86_64-unknown-linux-gnu", "0" * 40, 1_700_000_000)
    archives = []
    for at, mode in enumerate([0o600, 0o777]):
        folder = tmp_path / f"folder {at}"
        (folder / "man").mkdir(parents=True)
        for name in ["drystone", "man/drystone.1"]:
            (folder / name).write_text(name)
            (folder / name).chmod(mode)
        archives.append(building.archive(release, folder, folder))
    first, second = archives
    assert first.read_bytes() == second.read_bytes()
    with tarfile.open(first) as tar:
        found = {entry.name: (oct(entry.mode), entry.mtime, entry.uid) for entry in tar}
    assert found == {
        "drystone-1.2.3-x86_64-unknown-linux-gnu/drystone": ("0o755", release.time, 0),
        "drystone-1.2.3-x86_64-unknown-linux-gnu/man/drystone.1": ("0o644", release.time, 0),
    }


def test_a_file_that_changed_does_not_match_its_checksum(tmp_path):
    file = tmp_path / "drystone-1.2.3-x86_64-unknown-linux-gnu.tar.gz"
    file.write_text("archive")
    (tmp_path / ".cargo-lock").touch()
    assert building.checksums(tmp_path).count("\n") == 1
    check = ["sha256sum", "--check", "--strict", "SHA256SUMS"]
    assert subprocess.run(check, cwd=tmp_path, capture_output=True).returncode == 0
    file.write_text("other")
    assert subprocess.run(check, cwd=tmp_path, capture_output=True).returncode != 0


def test_the_program_of_a_release_names_no_folder_of_the_machine(monkeypatch):
    monkeypatch.setenv("RUSTFLAGS", "-Ctarget-cpu=native")
    monkeypatch.setenv("CARGO_HOME", "/some where/cargo")
    release = building.Release("1.2.3", "x86_64-unknown-linux-gnu", "0" * 40, 1_700_000_000)
    variables = building.environment(release)
    flags = variables["CARGO_ENCODED_RUSTFLAGS"].split("\x1f")
    assert f"--remap-path-prefix={REPOSITORY}=/drystone" in flags
    assert "--remap-path-prefix=/some where/cargo=/cargo" in flags
    assert "RUSTFLAGS" not in variables and variables["SOURCE_DATE_EPOCH"] == "1700000000"
