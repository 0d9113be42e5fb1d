# SPDX-License-Identifier: Apache-2.0
"""The error of a model's motion: of Gaussians that follow, that stay behind, that are too faint or too far away."""
import json
import struct
import subprocess
from pathlib import Path

import pytest

SCRIPT = Path(__file__).resolve().parents[2] / "scripts/motion_error"


def write(folder, times, names):
    folder.mkdir()
    for k, rows in enumerate(times):
        header = "ply\nformat binary_little_endian 1.0\nelement vertex %d\n" % len(rows)
        header += "".join(f"property float {name}\n" for name in names) + "end_header\n"
        (folder / f"{k:05d}.ply").write_bytes(header.encode() + b"".join(struct.pack("<%df" % len(row), *row) for row in rows))
    return folder


@pytest.fixture
def truth(tmp_path):
    """Two points that move by 1 and by 2 along x, and one that does not."""
    return write(tmp_path / "motion", [[(k * 0.5, 0, 0), (k, 3, 0), (5, 5, 5)] for k in range(3)], ["x", "y", "z"])


def sequence(folder, shift, opacity=2.0):
    """Gaussians beside the points; the first moves by `shift` at the last time, the others stay."""
    return write(folder, [[(0.03 + shift * k / 2, 0, 0, opacity), (0, 3.04, 0, 2), (5, 5, 5.05, 2), (0.01, 0, 0, -9)]
                          for k in range(3)], ["x", "y", "z", "opacity"])


def run(*arguments):
    return subprocess.run([SCRIPT, *arguments], capture_output=True, text=True, check=False, timeout=60)


def test_displacements_are_compared(tmp_path, truth):
    found = json.loads(run(truth, sequence(tmp_path / "sequence", 1)).stdout)
    # Displacements of 0.5, 1 and of 1, 2; the first Gaussian follows, the second does not.
    assert found["moving"] == {"points": 2, "lost": 0, "error": pytest.approx(0.75), "displacement": pytest.approx(1.125)}
    assert found["still"] == {"points": 1, "lost": 0, "error": 0, "displacement": 0}


def test_faint_gaussians_do_not_count(tmp_path, truth):
    found = json.loads(run(truth, sequence(tmp_path / "sequence", 1, opacity=-3)).stdout)
    assert found["moving"]["lost"] == 1
    assert found["moving"]["error"] == pytest.approx(1.5)


def test_wrong_folders_are_told_in_one_line(tmp_path, truth):
    moving = sequence(tmp_path / "sequence", 1)

    def refused(*arguments):
        done = run(*arguments)
        assert done.returncode == 2
        return done.stderr.splitlines()[-1]

    (moving / "00002.ply").unlink()
    assert "holds 2 files" in refused(truth, moving) and "--sequence 3" in refused(truth, moving)
    assert "motion_error: error: " in refused(tmp_path, moving) and "fewer than two files" in refused(tmp_path, moving)
    assert "with x, y, z, opacity" in refused(truth, truth)
    whole = (truth / "00001.ply").read_bytes()
    (truth / "00001.ply").write_bytes(whole[:-4])
    assert "00001.ply: is cut short" in refused(truth, moving)
    (truth / "00001.ply").write_bytes(whole[:-4] + struct.pack("<f", float("nan")))
    assert "00001.ply: holds values that are not finite" in refused(truth, moving)
