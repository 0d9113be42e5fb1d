# SPDX-License-Identifier: Apache-2.0
"""No kernel needs markedly more instructions than the committed counts, and the check detects if one does."""
import json
import shutil
import subprocess
from pathlib import Path

import pytest

from script_fixture import script  # noqa: F401, a fixture

ROOT = Path(__file__).resolve().parents[2]
SCRIPT = ROOT / "scripts/instruction_counts"


def test_calls_of_a_function_are_summed(script):
    text = "fn=main()\n0 5\ncfn=f(int)\ncalls=1 0\n0 100\ncfn=g()\ncalls=2 0\n0 7\ncfn=f(int)\ncalls=1 0\n3 11\n0 900\n"
    assert script.inclusive_costs(text) == {"f(int)": 111, "g()": 7}


def test_a_kernel_that_needs_more_is_named(script):
    then = {"instructions": {"avx2": {"blend": 1000, "project": 1000}}}
    now = {"instructions": {"avx2": {"blend": 1051, "project": 1049}}}
    (line,) = script.check(now, then)
    assert line.startswith("blend, avx2") and "+5.1%" in line


def test_the_committed_counts_are_complete(script):
    found = json.loads(script.FILE.read_text())["instructions"]
    assert set(found) == set(script.SETS)
    assert all(set(counts) == set(script.KERNELS) for counts in found.values())


@pytest.mark.skipif(not shutil.which("valgrind"), reason="valgrind is not installed")
def test_no_kernel_became_slower(script):
    if not script.PROGRAM.is_file():
        pytest.skip("splatboost_counted_iteration is not built")
    done = subprocess.run([SCRIPT, "--check"], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
