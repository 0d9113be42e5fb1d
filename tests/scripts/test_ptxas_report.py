# SPDX-License-Identifier: Apache-2.0
"""No blend kernel spills registers, and the check detects if one does."""
import json
import shutil
import subprocess
from pathlib import Path

import pytest

from script_fixture import script  # noqa: F401, a fixture

ROOT = Path(__file__).resolve().parents[2]
SCRIPT = ROOT / "scripts/ptxas_report"

MANGLED = "_ZN10splatboost4cuda46_GLOBAL__N__00a9be7a_13_blend_cuda_cu_a5cf25eb12blend_kernelILb1ELi9EEEvNS0_9TileListsE"
TEXT = f"""ptxas info    : Compiling entry function '{MANGLED}' for 'sm_90'
ptxas info    : Function properties for {MANGLED}
    8 bytes stack frame, 16 bytes spill stores, 24 bytes spill loads
ptxas info    : Used 45 registers, used 1 barriers, 13312 bytes smem
"""


def test_what_ptxas_says_is_read(script):
    assert script.parse(TEXT) == {(MANGLED, 90): {"stack_bytes": 8, "spill_store_bytes": 16, "spill_load_bytes": 24,
                                            "registers": 45, "shared_bytes": 13312}}
    assert script.short(MANGLED) == "blend_kernel<true, 9>"


def test_a_blend_kernel_that_spills_is_found(script):
    (numbers,) = script.parse(TEXT).values()
    spills = {"file": "blend_cuda.cu", "kernel": "blend_kernel"} | numbers
    clean = spills | {"stack_bytes": 0, "spill_store_bytes": 0, "spill_load_bytes": 0}
    assert script.spilling([spills, clean, spills | {"file": "project_cuda.cu"}]) == [spills]


def test_the_committed_report_has_the_blend_kernels_and_no_spill(script):
    kernels = json.loads(script.FILE.read_text())["kernels"]
    assert script.BLEND_FILES <= {k["file"] for k in kernels}
    assert script.spilling(kernels) == []


@pytest.mark.skipif(shutil.which("nvcc") is None, reason="needs nvcc")
def test_no_blend_kernel_spills():
    done = subprocess.run([SCRIPT, "--check"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    for kernel in ("sm_75", "sm_90", "blend_kernel<", "pixel_backward_kernel<", "count_kernel"):
        assert kernel in done.stdout


def test_a_wrong_option_is_refused():
    assert subprocess.run([SCRIPT, "--fast"], capture_output=True).returncode == 2
