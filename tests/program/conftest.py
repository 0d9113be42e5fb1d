# SPDX-License-Identifier: Apache-2.0
"""SPLATBOOST_BIN names the folder with the built `splatboost` (default: build/release/bin)."""

import os
import pathlib
import signal
import subprocess
import time

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


def start(*arguments):
    # In a background job signals may be ignored, and child processes would inherit that.
    def default_signals():
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGPIPE):
            signal.signal(number, signal.SIG_DFL)
    return subprocess.Popen([str(PROGRAM), *map(str, arguments)], stderr=subprocess.PIPE, stdout=subprocess.PIPE,
                            text=True, preexec_fn=default_signals)


def wait_for(path, process):
    deadline = time.monotonic() + 60
    while not path.exists():
        assert time.monotonic() < deadline and process.poll() is None, path
        time.sleep(0.005)


@pytest.fixture(scope="session")
def scene(tmp_path_factory):
    """A small scene, created once."""
    folder = tmp_path_factory.mktemp("data") / "room"
    run_well("synth", folder, "--width", 80, "--height", 60, "--views", 10, "--points", 300)
    return folder


@pytest.fixture(scope="session")
def trained(scene, tmp_path_factory):
    """The folder of an uninterrupted run."""
    folder = tmp_path_factory.mktemp("trained") / "model"
    run_well("train", "-s", scene, "-m", folder, *SHORT_RUN, "--checkpoint-iterations", "25")
    return folder


# Two events of growth and two of pruning happen before the checkpoint, more after it. Opacities are not reset, since
# they would not recover in so short a run.
SHORT_RUN = ["--eval", "--llffhold", "4", "--iterations", "60", "--config", str(pathlib.Path(__file__).parent / "short.json")]
