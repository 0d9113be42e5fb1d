# SPDX-License-Identifier: Apache-2.0
"""Datasets that do not fit into the memory."""

import json
import os
import resource
import subprocess
import zlib

from conftest import PROGRAM, png


def run_with_memory(limit, *arguments):
    def restrict():
        resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})  # each thread reserves addresses too
    return subprocess.run([PROGRAM, *map(str, arguments)], capture_output=True, text=True, check=False, timeout=300,
                          preexec_fn=restrict)


def test_a_photo_that_does_not_fit_into_memory_is_named(tmp_path):
    """40 KB in the file, 270 MB as grey, 810 MB as RGB; the camera states no size."""
    width, height = 18000, 15000
    rows = zlib.compress(bytes((1 + width // 8) * height), 6)
    photo = tmp_path / "big.png"
    photo.write_bytes(png(width, height, 1, 0, rows))
    assert photo.stat().st_size < 100_000
    pose = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
    frames = [{"file_path": "big.png", "transform_matrix": pose}]
    (tmp_path / "transforms.json").write_text(json.dumps({"camera_angle_x": 1, "frames": frames}))
    done = run_with_memory(2**30, "train", "-s", tmp_path, "-m", tmp_path / "model")
    assert done.returncode == 2, done.stderr
    assert f"{photo}: there is not enough memory to read it" in done.stderr.splitlines()[-1]


def test_synth_without_memory_suggests_none_of_the_options_it_lacks(tmp_path):
    done = run_with_memory(2**30, "synth", tmp_path / "scene", "--width", 16, "--height", 16, "--views", 1, "--points", 10**8)
    assert (done.returncode, done.stderr) == (1, "splatboost synth: out of memory\n")
