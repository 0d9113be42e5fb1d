# SPDX-License-Identifier: Apache-2.0
"""SPLATBOOST_BIN names the folder with the built programs; the libraries are in lib beside it.

SPLATBOOST_TEST_ON_CUDA=emulated runs the tests on the emulator of CUDA (emulated.py); test_emulated.py does that.

SPLATBOOST_TEST_ALL=1 fails skipped tests of the files in NEVER_SKIPPED; scripts/test --all sets it."""

import os
import pathlib
import sys

import pytest

ROOT = pathlib.Path(__file__).resolve().parents[2]
BUILD = pathlib.Path(os.environ.get("SPLATBOOST_BIN", ROOT / "build/release/bin")).parent
PACKAGE = ROOT / "adapters/python"
EMULATED = os.environ.get("SPLATBOOST_TEST_ON_CUDA") == "emulated"
TEST_ALL = os.environ.get("SPLATBOOST_TEST_ALL") == "1"
#: Their tests need a wheel, viser, Chromium or gsplat, without which they are skipped.
NEVER_SKIPPED = ("test_gsplat.py", "test_view.py", "test_wheel.py")

if EMULATED:
    os.environ["SPLATBOOST_LIBRARY"] = str(BUILD / "lib/libsplatboost_emulated.so")
os.environ.setdefault("SPLATBOOST_LIBRARY", str(BUILD / "lib/libsplatboost.so"))
sys.path[:0] = [str(PACKAGE), str(pathlib.Path(__file__).parent)]

try:
    import torch  # noqa: F401
except ImportError:
    if TEST_ALL:
        raise
    # Tests that need torch are left out, and the summary says so.
    collect_ignore = [p.name for p in pathlib.Path(__file__).parent.glob("test_*.py")
                      if p.name not in ("test_package.py", "test_wheel.py")]

    def pytest_terminal_summary(terminalreporter):
        terminalreporter.write_line(
            "SKIPPED tests of the Python package: torch is not installed (apt-get install python3-torch)", yellow=True
        )


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_makereport(item):
    report = (yield).get_result()
    if TEST_ALL and not EMULATED and report.skipped and item.path.name in NEVER_SKIPPED:
        report.outcome, report.longrepr = "failed", "SPLATBOOST_TEST_ALL=1, but skipped: %s" % report.longrepr[2]


@pytest.fixture(autouse=EMULATED)
def on_emulated_cuda(request):
    """All tensors of a test act as CUDA tensors; test_cuda.py chooses them itself."""
    if request.module.__name__ == "test_cuda":
        yield
        return
    import emulated

    with emulated.cuda():
        yield
