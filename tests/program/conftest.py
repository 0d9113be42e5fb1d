# SPDX-License-Identifier: Apache-2.0
"""SPLATBOOST_BIN names the folder with the built `splatboost` (default: build/release/bin).

SPLATBOOST_TEST_ALL=1 fails skipped tests, except for the reasons in MAY_SKIP; scripts/test --all sets it."""

import os
import pathlib
import re
import signal
import struct
import subprocess
import sys
import time
import zlib

import numpy as np
import pytest

ROOT = pathlib.Path(__file__).resolve().parents[2]
PROGRAM = pathlib.Path(os.environ.get("SPLATBOOST_BIN", ROOT / "build/release/bin")) / "splatboost"
#: Reasons that no package of Debian can remove: a checkout of Photo-SLAM, a GPU, NVIDIA's files, the data in ../shared.
MAY_SKIP = re.compile("SPLATBOOST_PHOTO_SLAM does not name a checkout|no headers of libtorch|there may be a GPU|needs nvcc|"
                      "needs clang, and the headers of CUDA 12|the real LPIPS weights are not on this machine")


class SkippedTestsFail:
    @pytest.hookimpl(hookwrapper=True)
    def pytest_runtest_makereport(self):
        report = (yield).get_result()
        reason = report.longrepr[2] if report.skipped and isinstance(report.longrepr, tuple) else None
        if reason is not None and not MAY_SKIP.search(reason):
            report.outcome, report.longrepr = "failed", f"SPLATBOOST_TEST_ALL=1, but skipped: {reason}"


def pytest_configure(config):
    # As a plugin, it also sees the tests of tests/scripts in the same run. These can have no conftest.py of their own:
    # `from conftest import` would find only one of two.
    if os.environ.get("SPLATBOOST_TEST_ALL") == "1":
        config.pluginmanager.register(SkippedTestsFail())


def run_program(*arguments, cwd=None):
    command = [str(PROGRAM), *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=300, cwd=cwd, check=False)


def run_well(*arguments, cwd=None):
    done = run_program(*arguments, cwd=cwd)
    assert done.returncode == 0, done.stderr
    return done


def refused(*arguments, cwd=None):
    """@return the one line on the error stream of a command that its user can correct"""
    done = run_program(*arguments, cwd=cwd)
    assert done.returncode == 2, done.stderr
    lines = done.stderr.splitlines()
    assert done.stdout == "" and len(lines) == 1 and lines[0].startswith("splatboost"), done.stderr
    return lines[0]


def killed_at(folder, number, *arguments):
    """Runs the program, which is killed in place of its N-th file operation in this folder."""
    faults = {"LD_PRELOAD": PROGRAM.parents[1] / "lib/libfile_faults.so", "FILE_FAULTS_UNDER": folder.resolve(),
              "FILE_FAULTS_AT": number, "FILE_FAULTS_KIND": "kill"}
    done = subprocess.run([str(PROGRAM), *map(str, arguments)], capture_output=True, text=True, timeout=300, check=False,
                          env={**os.environ, **{name: str(value) for name, value in faults.items()}})
    assert done.returncode == -signal.SIGKILL, done.stderr


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


def content(folder):
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def png(width, height, bits, color_type, data):
    """@param data the compressed rows"""
    def chunk(kind, body):
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    return (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, bits, color_type, 0, 0, 0)) +
            chunk(b"IDAT", data) + chunk(b"IEND", b""))


def write_png(file, pixels):
    """[H,W] or [H,W,3]; 8 or 16 bits."""
    height, width = pixels.shape[:2]
    rows = pixels.astype(pixels.dtype.newbyteorder(">")).reshape(height, -1)
    file.write_bytes(png(width, height, 8 * pixels.itemsize, 2 if pixels.ndim == 3 else 0,
                         zlib.compress(b"".join(b"\0" + row.tobytes() for row in rows))))


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


@pytest.fixture(scope="session")
def lpips_network(tmp_path_factory):
    """A network for --lpips whose weights are all zero."""
    shapes = {"backbone/0": (64, 3, 3, 3)}
    for index, (channels, squeeze, expand) in {3: (64, 16, 64), 4: (128, 16, 64), 6: (128, 32, 128), 7: (256, 32, 128),
                                               9: (256, 48, 192), 10: (384, 48, 192), 11: (384, 64, 256),
                                               12: (512, 64, 256)}.items():
        shapes |= {f"backbone/{index}.squeeze": (squeeze, channels, 1, 1),
                   f"backbone/{index}.expand1x1": (expand, squeeze, 1, 1),
                   f"backbone/{index}.expand3x3": (expand, squeeze, 3, 3)}
    weights = {}
    for name, shape in shapes.items():
        weights |= {f"{name}.weight": np.zeros(shape, "f4"), f"{name}.bias": np.zeros(shape[0], "f4")}
    for i, channels in enumerate([64, 128, 256, 384, 384, 512, 512]):
        weights[f"lin/lin{i}.model.1.weight"] = np.zeros((1, channels, 1, 1), "f4")
    folder = tmp_path_factory.mktemp("lpips")
    np.savez(folder / "weights.npz", **weights)
    onnx = folder / "lpips.onnx"
    subprocess.run([sys.executable, ROOT / "scripts/lpips_to_onnx", folder / "weights.npz", onnx], check=True,
                   capture_output=True)
    if "needs OpenCV" in run_program("train", "-s", "/nowhere", "-m", folder / "model", "--lpips", onnx).stderr:
        pytest.skip("this build has no OpenCV")
    return onnx


# Two events of growth and two of pruning happen before the checkpoint, more after it. Opacities are not reset, since
# they would not recover in so short a run.
SHORT_RUN = ["--eval", "--llffhold", "4", "--iterations", "60", "--config", str(pathlib.Path(__file__).parent / "short.json")]
