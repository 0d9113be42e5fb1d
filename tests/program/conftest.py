# SPDX-License-Identifier: Apache-2.0
"""SPLATBOOST_BIN names the folder with the built `splatboost` (default: build/release/bin)."""

import os
import pathlib
import subprocess

import pytest

ROOT = pathlib.Path(__file__).resolve().parents[2]
PROGRAM = pathlib.Path(os.environ.get("SPLATBOOST_BIN", ROOT / "build/release/bin")) / "splatboost"


def run_program(*arguments, cwd=None):
    command = [str(PROGRAM), *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=300, cwd=cwd, check=False)


def run_well(*arguments, cwd=None):
    done = run_program(*arguments, cwd=cwd)
    assert done.returncode == 0, done.stderr
    return done


@pytest.fixture(scope="session")
def scene(tmp_path_factory):
    """A small scene, made once."""
    folder = tmp_path_factory.mktemp("data") / "room"
    run_well("synth", folder, "--width", 80, "--height", 60, "--views", 10, "--points", 300)
    return folder


@pytest.fixture(scope="session")
def trained(scene, tmp_path_factory):
    """The folder of a run that ended without interruption, with its options."""
    folder = tmp_path_factory.mktemp("trained") / "model"
    run_well("train", "-s", scene, "-m", folder, *SHORT_RUN, "--checkpoint-iterations", "25")
    return folder


# Two events of growth and two of pruning happen before the checkpoint, more after it; opacities are not reset, since a
# run this short does not recover.
SHORT_RUN = ["--eval", "--llffhold", "4", "--iterations", "60", "--config", str(pathlib.Path(__file__).parent / "short.json")]
