"""Calls that go wrong and power that is cut, at a few places spread over a job; tools/faults/run full takes them all."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

PROJECT = Path(__file__).resolve().parents[2]

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(sys.platform != "linux" or not shutil.which("cc"), reason="needs Linux and a C compiler"),
]


def faults(drystone, script, *options):
    """Runs a script of tools/faults on the town; what it told."""
    command = [sys.executable, PROJECT / "tools" / "faults" / script, drystone.binary, PROJECT / "fixtures/town/town.obj"]
    done = subprocess.run([*map(str, command), *options], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_a_call_that_goes_wrong_costs_nothing(drystone):
    told = faults(drystone, "at_calls.py", "--points", "12")
    assert "kill: 12 of " in told
    assert "interrupt: 12 of " in told


@pytest.mark.parametrize("kind", [[], ["--long"]])
def test_a_power_cut_costs_nothing_that_was_promised(drystone, kind):
    assert " 60 power cuts, 0 faults" in faults(drystone, "power_cuts.py", "--cuts", "60", *kind)
