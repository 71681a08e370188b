"""Every name in the JSON of the commands stands on its page of the reference."""

import json
import re

import pytest

import objlib

REFERENCE = objlib.REPOSITORY / "docs" / "reference"
# Names that come with the input, not from the program.
OPEN = {"faults"}


def names(value):
    """All names of objects in a value."""
    if isinstance(value, dict):
        for name, inner in value.items():
            yield name
            if name not in OPEN:
                yield from names(inner)
    elif isinstance(value, list):
        for inner in value:
            yield from names(inner)


def undocumented(value, *pages):
    """Names that no code on the pages has, neither in a line nor in a block."""
    text = "".join((REFERENCE / page).read_text() for page in pages)
    code = " ".join(text.split("`")[1::2]) + " ".join(re.findall(r"```(.*?)```", text, re.DOTALL))
    words = set(re.findall(r"\w+", code))
    return sorted(set(names(value)) - words)


@pytest.fixture(scope="module")
def told(drystone, town_path, tmp_path_factory):
    """What each command prints."""
    folder = tmp_path_factory.mktemp("told")
    result, tiles = folder / "out.obj", folder / "tiles"
    bake = ["--textures", "bake", "--image", "jpeg:80"]
    small = ["--tile-faces", "4000", "--tile-side", "512"]
    machines = ["--machines", "4", "--shared-bandwidth", "1GB"]
    simplify = ["simplify", town_path, "-o", result, "--ratio", "0.1", "--keep-work", "--quiet"]
    commands = {
        "simplify": [*simplify, "--measure", "--samples", "2000", "--format", "json"],
        "status": ["status", f"{result}.work", "--json"],
        "plan": ["plan", town_path, "--ratio", "0.1", *bake, *machines, "--json"],
        "plan --tile": ["plan", town_path, "--tile", *machines, "--json"],
        "inspect": ["inspect", town_path, "--json"],
        "check": ["check", result, "--against", town_path, "--json"],
        "compare": ["compare", town_path, result, "--samples", "2000", "--json"],
        "tile": ["tile", town_path, "-o", tiles, *small, "--json"],
        "check tiles": ["check", tiles, "--json"],
    }
    # An exit code of 1 says that `check` found something.
    return {name: json.loads(drystone(*command, codes=(0, 1)).stdout) for name, command in commands.items()}


@pytest.mark.parametrize("command", ["status", "plan", "plan --tile", "inspect", "check", "tile", "check tiles"])
def test_other_commands(told, command):
    assert undocumented(told[command], "json.md", "comparison.md") == []


def test_reports(told):
    assert undocumented(told["simplify"]["comparison"], "comparison.md", "report.md") == []
    assert undocumented(told["compare"], "comparison.md", "report.md") == []
    inner = {"options", "repairs", "comparison", "command", "program"}
    assert undocumented({key: value for key, value in told["simplify"].items() if key not in inner}, "report.md") == []


def test_status_of_a_finished_job(drystone, town_path, tmp_path):
    for name in ["out.obj", "out.ply", "out.glb", "out.drystone"]:
        output = tmp_path / name
        drystone("simplify", town_path, "-o", output, "--ratio", "0.1", "--quiet")
        assert json.loads(drystone("status", f"{output}.work", "--json").stdout)["written"], name
    drystone("tile", town_path, "-o", tmp_path / "tiles", "--tile-faces", "8000", "--tile-side", "512", "--quiet")
    assert json.loads(drystone("status", tmp_path / "tiles.work", "--json").stdout)["written"]
    (tmp_path / "note.txt").write_text('{"generator":"drystone 1"}')
    drystone("status", tmp_path / "note.txt.work", codes=(2,))
