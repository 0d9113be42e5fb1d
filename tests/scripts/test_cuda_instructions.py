# SPDX-License-Identifier: Apache-2.0
"""The loop over a tile's splats is found in the output of nvdisasm."""
import json
import subprocess
import sys
from pathlib import Path

import pytest

from script_fixture import script  # noqa: F401, a fixture

ROOT = Path(__file__).resolve().parents[2]
SCRIPT = ROOT / "scripts/cuda_instructions"

# Two loops, the inner one with the exponential (ex2); and a kernel without a loop.
TEXT = """.text._ZN12blend_kernelILi0ELb0EEEv:
        /*0000*/                   MOV R1, c[0x0][0x28] ;
.L_x_2:
        /*0010*/                   IADD3 R2, R2, 0x1, RZ ;
.L_x_1:
        /*0020*/                   MUFU.EX2 R3, R4 ;
        /*0030*/                   FMUL R3, R3, R5 ;
        /*0040*/              @P0  BRA `(.L_x_1) ;
        /*0050*/              @P1  BRA `(.L_x_2) ;
        /*0060*/              @P2  BRA `(.L_x_3) ;
.L_x_3:
        /*0070*/                   EXIT ;
.text._ZN5otherEv:
        /*0000*/                   EXIT ;
"""


def test_loops_are_found_by_their_jumps_back(script):
    inner, outer = script.loops(TEXT)
    assert len(inner) == 3 and inner[0].startswith("MUFU.EX2")
    assert len(outer) == 5


def test_the_innermost_loop_of_the_kernel_is_counted(script):
    assert script.splat_loop(TEXT, "blend_kernelILi0ELb0E") == 3
    with pytest.raises(SystemExit, match="no loop found in other"):
        script.splat_loop(TEXT, "other")


def test_the_committed_report_has_both_columns(script):
    report = json.loads(script.FILE.read_text())
    assert set(report["instructions"]) == set(script.KERNELS)
    assert all(len(pair) == 2 for part in ("instructions", "visits") for pair in report[part].values())


def test_what_is_missing_is_named(tmp_path):
    done = subprocess.run([sys.executable, SCRIPT], capture_output=True, text=True, env={"PATH": str(tmp_path)})
    assert done.returncode == 1
    assert "is not on PATH; it comes with the CUDA toolkit" in done.stderr
    assert subprocess.run([SCRIPT, "--fast"], capture_output=True).returncode == 2
