# SPDX-License-Identifier: Apache-2.0
"""A sample of the attacks of tests/robustness: damaged files, and faults at file operations. Manual runs use more."""

import concurrent.futures
import os
import pathlib
import subprocess
import sys

import pytest

from conftest import ROOT

sys.path.append(str(ROOT / "tests/robustness"))
import attacks  # noqa: E402
import fuzz_readers  # noqa: E402
import inject_faults  # noqa: E402

DAMAGED_OF_A_KIND = 12
FAULTS_OF_A_COMMAND = 8


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    """The totals of each attack, run in parallel."""
    assert attacks.FILE_FAULTS.exists(), "build the target file_faults (scripts/build --all)"
    whole = pathlib.Path(tmp_path_factory.mktemp("whole")).resolve()
    fuzz_readers.prepare(whole)
    with concurrent.futures.ProcessPoolExecutor(len(os.sched_getaffinity(0))) as pool:
        found = {name: pool.submit(fuzz_readers.attack, name, whole, 0, DAMAGED_OF_A_KIND, 0) for name in fuzz_readers.TARGETS}
        found |= {name: pool.submit(inject_faults.attack, name, FAULTS_OF_A_COMMAND) for name in inject_faults.SCENARIOS}
        yield found


def ended(code, stderr):
    return attacks.broken_rule(subprocess.CompletedProcess([], code, b"", stderr))


def test_the_rule_can_be_broken():
    line = b"splatboost train: cannot be read\n"
    assert not ended(2, line) and not ended(0, b"") and not ended(0, b"note: a\nnote: b\n" + line)
    for code, stderr in [(-11, b""), (134, line), (None, b""), (2, b""), (1, line + line), (2, b"terminate called\n"),
                         (2, line[:-1] + b"\xff\n"), (2, line[:-1] + b"\x1b[31m\n"), (2, line[:-1] * 100 + b"\n")]:
        assert ended(code, stderr), (code, stderr)
    assert ended(-9, b"") and not attacks.broken_rule(subprocess.CompletedProcess([], -9, b"", b""), may_be_killed=True)


def test_faults_come_where_they_are_asked_for(tmp_path):
    folder = tmp_path.resolve() / "scene"
    command = ["synth", folder, *attacks.TINY_SCENE]
    under = {"FILE_FAULTS_UNDER": str(folder), "FILE_FAULTS_AT": "3"}
    failed = {kind: attacks.run(*command, faults=under | {"FILE_FAULTS_KIND": kind}) for kind in inject_faults.KINDS}
    assert [done.returncode for done in failed.values()] == [1, 1, -9]
    assert b"Input/output error" in failed["error"].stderr and b"No space left" in failed["full"].stderr


def test_eval_takes_a_run_killed_right_after_its_model(tmp_path):
    work = tmp_path.resolve()
    scenario = inject_faults.Train(work)
    scenario.prepare()
    operations = scenario.undisturbed()
    at = next(i for i, line in enumerate(operations, 1) if "rename /point_cloud/iteration_4/" in line)
    scenario.reset()
    attacks.run(*scenario.command(), cwd=work, faults=scenario.environment(at + 1, "kill"))
    assert (scenario.folder / inject_faults.PLY).exists() and not (scenario.folder / "results.json").exists()
    attacks.run_well("eval", "-m", "case", "--quiet", cwd=work)
    assert inject_faults.content(scenario.folder, True) == scenario.after


@pytest.mark.parametrize("name", fuzz_readers.TARGETS)
def test_a_damaged_file_is_told_in_a_line(found, name):
    totals = found[name].result()
    assert totals.cases == DAMAGED_OF_A_KIND
    assert not totals.broken


@pytest.mark.parametrize("name", inject_faults.SCENARIOS)
def test_a_fault_loses_nothing(found, name):
    totals = found[name].result()
    assert totals.cases == FAULTS_OF_A_COMMAND
    assert not totals.broken
