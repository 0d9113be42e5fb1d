# SPDX-License-Identifier: Apache-2.0
"""Scripts say how they are called, and refuse arguments that they do not know before they do anything."""
import os
import shutil
import subprocess
import tarfile
from pathlib import Path

import pytest

SCRIPTS = Path(__file__).resolve().parents[2] / "scripts"


def run(name, argument):
    return subprocess.run([SCRIPTS / name, argument], capture_output=True, text=True, check=False, timeout=60)


@pytest.mark.parametrize("name", ["city/run", "format", "install-deps", "motion_error", "quickstart", "result_tables",
                                  "score_in_processes", "suite/run", "test", "two_at_once", "wheel"])
def test_help_and_unknown_arguments(name):
    told = run(name, "--help")
    assert told.returncode == 0 and "usage: " in told.stdout and not told.stderr
    assert run(name, "--nonsense").returncode == 2


def test_the_wheel_refuses_arguments_after_the_first_too():
    """pip would, but after dist/ was emptied."""
    done = subprocess.run([SCRIPTS / "wheel", "--cuda", "--in-tree"], capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 2 and done.stderr == "wheel: unknown argument --in-tree; see --help\n"


def test_a_program_that_is_missing():
    done = run("two_at_once", "/nonexistent")
    assert done.returncode == 2 and done.stderr.endswith("/nonexistent is not a program; scripts/build builds it\n")


#: Stands for every tool that scripts/wheel calls. It notes pip's arguments, and the name of the package that pip builds.
TOOL = """#!/bin/bash
case "${0##*/}" in
  python) mkdir -p dist && cp sdist.tar.gz dist/splatboost-0.1.0.tar.gz ;;
  nvcc) echo "Cuda compilation tools, release 12.8, V12.8.93" ;;
  pip) printf '%s\\n' "gpus: ${CUDA_VISIBLE_DEVICES-all}" "$@" > told; source=${@:6:1}
       [[ -d $source ]] && grep ^name $source/pyproject.toml >> told; mkdir -p build/wheel-raw ;;
esac
"""


@pytest.mark.parametrize("arguments", [(), ("--cuda",)])
def test_the_wheel_for_gpus_has_a_name_of_its_own(tmp_path, arguments):
    tools = tmp_path / "build/wheel-tools/bin"
    tools.mkdir(parents=True)
    for name in ("python", "pip", "auditwheel", "twine", "nvcc"):
        (tools / name).write_text(TOOL)
        (tools / name).chmod(0o755)
    (tmp_path / "scripts").mkdir()
    shutil.copy(SCRIPTS / "wheel", tmp_path / "scripts")
    with tarfile.open(tmp_path / "sdist.tar.gz", "w:gz") as archive:
        archive.add(SCRIPTS.parent / "pyproject.toml", "splatboost-0.1.0/pyproject.toml")
    environment = {**os.environ, "PATH": f"{tools}:{os.environ['PATH']}"}
    environment.pop("CUDA_VISIBLE_DEVICES", None)
    done = subprocess.run([tmp_path / "scripts/wheel", *arguments], capture_output=True, text=True, check=False, timeout=60,
                          env=environment)
    assert done.returncode == 0, done.stderr
    told = (tmp_path / "told").read_text().splitlines()
    assert ("cmake.define.SPLATBOOST_CUDA=ON" in told) == bool(arguments)
    assert told[0] == ("gpus: " if arguments else "gpus: all")
    assert (told[-1] == 'name = "splatboost-cuda12"') == bool(arguments)
