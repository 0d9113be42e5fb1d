# SPDX-License-Identifier: Apache-2.0
"""`splatboost render` leaves the pictures that a run was measured on, and other runs."""
import shutil

import pytest
from conftest import run_program, run_well


@pytest.fixture(scope="module")
def run(trained, tmp_path_factory):
    folder = tmp_path_factory.mktemp("renders") / "run"
    shutil.copytree(trained, folder)
    return folder


def pictures(folder):
    return {path: path.read_bytes() for path in folder.rglob("*.png")}


@pytest.mark.parametrize("option", [("--iteration", 60), ("--beta", 1)])
def test_other_pictures_need_a_folder_of_their_own(run, tmp_path, option):
    before = pictures(run)
    done = run_program("render", "-m", run, *option)
    assert done.returncode == 2 and option[0] + ": these pictures would replace" in done.stderr and "--output" in done.stderr
    assert pictures(run) == before
    run_well("render", "-m", run, *option, "-o", tmp_path / "new")
    assert (tmp_path / "new/test/renders/0004.png").is_file()


def test_pictures_of_another_scene_need_a_folder_of_their_own(run, tmp_path):
    run_well("synth", tmp_path / "other", "--width", 80, "--height", 60, "--views", 10, "--points", 300, "--seed", 5)
    before = pictures(run)
    done = run_program("render", "-m", run, "-s", tmp_path / "other")
    assert done.returncode == 2 and "another scene than that of the run" in done.stderr
    assert pictures(run) == before
    run_well("render", "-m", run, "-s", tmp_path / "other", "-o", tmp_path / "new")


def test_another_run_is_no_folder_for_pictures(run, trained, tmp_path):
    other = tmp_path / "other"
    shutil.copytree(trained, other)
    before = pictures(other)
    done = run_program("render", "-m", run, "-o", other)
    assert done.returncode == 2 and "is the folder of another run" in done.stderr
    assert pictures(other) == before
    run_well("render", "-m", run, "-o", run)  # its own
