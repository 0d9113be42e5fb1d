# SPDX-License-Identifier: Apache-2.0
"""A sample of the attacks of tests/robustness: damaged files, and faults at file operations. By hand they take more."""

import concurrent.futures
import os
import pathlib
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
    """The totals of each attack, made side by side."""
    assert attacks.FILE_FAULTS.exists(), "build the target file_faults (scripts/build --all)"
    whole = pathlib.Path(tmp_path_factory.mktemp("whole")).resolve()
    fuzz_readers.prepare(whole)
    with concurrent.futures.ProcessPoolExecutor(os.cpu_count()) as pool:
        found = {name: pool.submit(fuzz_readers.attack, name, whole, 0, DAMAGED_OF_A_KIND, 0) for name in fuzz_readers.TARGETS}
        found |= {name: pool.submit(inject_faults.attack, name, FAULTS_OF_A_COMMAND) for name in inject_faults.SCENARIOS}
        yield found


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
