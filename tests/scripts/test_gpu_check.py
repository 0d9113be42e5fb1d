# SPDX-License-Identifier: Apache-2.0
"""scripts/gpu-check says what it cannot do; what it measures is tested by running it on a GPU."""

import os
import pathlib
import subprocess

SCRIPT = pathlib.Path(__file__).resolve().parents[2] / "scripts" / "gpu-check"


def fails(*arguments, path="/usr/bin:/bin"):
    done = subprocess.run([SCRIPT, *arguments], capture_output=True, text=True, check=False,
                          env={**os.environ, "PATH": path})
    assert done.returncode == 2
    assert done.stdout == ""
    assert len(done.stderr.splitlines()) == 1
    return done.stderr


def fake(folder, name, text, status=0):
    program = folder / name
    program.write_text(f"#!/bin/sh\necho '{text}'\nexit {status}\n")
    program.chmod(0o755)


def test_no_gpu(tmp_path):
    fake(tmp_path, "nvidia-smi", "NVIDIA-SMI has failed", 9)
    assert "no GPU here" in fails("build", path=f"{tmp_path}:/usr/bin:/bin")


def test_no_nvcc(tmp_path):
    fake(tmp_path, "nvidia-smi", "NVIDIA T4, 15360, 535.1, 7.5")
    fake(tmp_path, "nvcc", "broken", 1)
    assert "no nvcc here" in fails(path=f"{tmp_path}:/usr/bin:/bin")


def test_unknown_step():
    assert "'mesure' is no step; there are: build, tests" in fails("mesure")
