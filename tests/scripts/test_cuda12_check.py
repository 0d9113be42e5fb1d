# SPDX-License-Identifier: Apache-2.0
"""Code that CUDA 12 does not support is refused. The check itself runs in CI, since it downloads headers."""
import shutil
import subprocess
from pathlib import Path

import pytest

from script_fixture import script  # noqa: F401, a fixture

SCRIPT = Path(__file__).resolve().parents[2] / "scripts/cuda12_check"


def test_every_cuda_file_is_looked_at_but_that_of_cublas(script):
    names = {path.name for path in script.sources()}
    assert {"blend_cuda.cu", "two_layer_net_cuda.cu", "cuda_bench.cu"} <= names
    assert "matrices_cuda.cu" not in names


def test_what_cuda_12_has_not_is_refused(script, tmp_path):
    compiler = next((name for name in script.COMPILERS if shutil.which(name)), None)
    if compiler is None or not (script.TOOLKIT / "complete").exists():
        pytest.skip("needs clang, and the headers of CUDA 12 from an earlier run of scripts/cuda12_check")
    kernel = "__global__ void set(float* x) { *x = 1; }\n"
    good, bad = tmp_path / "good.cu", tmp_path / "bad.cu"
    good.write_text(kernel)
    bad.write_text(kernel + "cudaEmulationStrategy later;\n")
    assert script.errors_of(compiler, good) == ""
    assert "cudaEmulationStrategy" in script.errors_of(compiler, bad)


def test_a_wrong_option_is_refused():
    assert subprocess.run([SCRIPT, "--fast"], capture_output=True).returncode == 2
