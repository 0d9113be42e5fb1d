# SPDX-License-Identifier: Apache-2.0
"""Repeats the package's tests with CUDA tensors on the emulator, which needs no GPU."""

import os
import pathlib
import subprocess
import sys

import conftest
import pytest

FILES = ("operations", "rasterize", "convexes", "drop_ins", "adapter", "hooks", "gsplat", "cuda")
LIBRARY = conftest.BUILD / "lib/libsplatboost_emulated.so"


@pytest.mark.skipif(conftest.EMULATED, reason="this is it")
@pytest.mark.skipif(not LIBRARY.exists(), reason="the emulator's library is not built")
def test_the_package_on_the_emulator():
    folder = pathlib.Path(__file__).parent
    # Tests that draw hundreds of views are slow on the emulator; a host trains in test_cuda.py.
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-k", "not test_gradcheck and not test_trains"]
    done = subprocess.run(
        command + [str(folder / ("test_%s.py" % name)) for name in FILES],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "SPLATBOOST_TEST_ON_CUDA": "emulated"},
    )
    assert done.returncode == 0, done.stdout + done.stderr
