# SPDX-License-Identifier: Apache-2.0
"""Scripts say how they are called, and refuse arguments that they do not know before they do anything."""
import subprocess
from pathlib import Path

import pytest

SCRIPTS = Path(__file__).resolve().parents[2] / "scripts"


def run(name, argument):
    return subprocess.run([SCRIPTS / name, argument], capture_output=True, text=True, check=False, timeout=60)


@pytest.mark.parametrize("name", ["city/run", "format", "install-deps", "quickstart", "result_tables", "suite/run", "test", "two_at_once"])
def test_help_and_unknown_arguments(name):
    told = run(name, "--help")
    assert told.returncode == 0 and "usage: " in told.stdout and not told.stderr
    assert run(name, "--nonsense").returncode == 2


def test_a_program_that_is_missing():
    done = run("two_at_once", "/nonexistent")
    assert done.returncode == 2 and done.stderr.endswith("/nonexistent is not a program; scripts/build builds it\n")
