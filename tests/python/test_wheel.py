# SPDX-License-Identifier: Apache-2.0
"""The wheel built by scripts/wheel, in empty environments. SPLATBOOST_WHEEL names it; otherwise it is the one in dist/."""

import os
import pathlib
import re
import subprocess
import sys
import zipfile

import conftest
import pytest

WHEELS = [pathlib.Path(os.environ["SPLATBOOST_WHEEL"])] if "SPLATBOOST_WHEEL" in os.environ else sorted(
    (conftest.ROOT / "dist").glob("*.whl"))

#: The glibc of Ubuntu 22.04, the oldest system that wheels are for; Debian 12, where they are built, has 2.36.
OLDEST_GLIBC = (2, 35)

pytestmark = pytest.mark.skipif(not WHEELS, reason="no wheel: scripts/wheel makes one")


def run(*command, code=0, **more):
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("SPLATBOOST", "PYTHON"))}
    done = subprocess.run([*map(str, command)], capture_output=True, text=True, check=False, timeout=300, env=environment, **more)
    assert done.returncode == code, done.stderr + done.stdout
    return done.stdout + done.stderr


def environment(folder, *options):
    run(sys.executable, "-m", "venv", *options, folder)
    run(folder / "bin/python", "-m", "pip", "install", "--quiet", "--no-index", WHEELS[-1])
    return folder / "bin"


def test_what_is_in_it():
    name = WHEELS[-1].name
    assert "-py3-none-manylinux" in name, "auditwheel has not repaired it"
    glibc = min(tuple(map(int, found)) for found in re.findall(r"manylinux_(\d+)_(\d+)_", name))
    assert glibc <= OLDEST_GLIBC, "it needs glibc %d.%d: build it on Debian 12" % glibc
    names = zipfile.ZipFile(WHEELS[-1]).namelist()
    for part in ("libsplatboost.so", "bin/splatboost", "py.typed", "hooks/scaffold_gs.py",
                 "share/splatboost/patches/3dgs/recipe.json"):
        assert "splatboost/" + part in names, part
    # No libraries that only some build machines have.
    bundled = {re.match(r"splatboost(?:_cuda\d+)?\.libs/(\w+)", n).group(1) for n in names if ".libs/lib" in n}
    assert bundled == {"libhwy", "libhwy_contrib", "libpng16"}
    # No files of the build machine; the recipe for Photo-SLAM consists of C++ files.
    assert not [n for n in names if "__pycache__" in n or "/tests/" in n
                or n.endswith((".cpp", ".h")) and "/patches/photo-slam/" not in n]


def test_the_program_trains_in_an_empty_environment(tmp_path):
    bin_folder = environment(tmp_path / "empty")
    program = bin_folder / "splatboost"
    assert "scaffold-gs" in run(program, "patch", "list")
    run(program, "synth", tmp_path / "scene", "--views", 8, "--width", 48, "--height", 32)
    run(program, "train", "-s", tmp_path / "scene", "-m", tmp_path / "out", "--iterations", 40, "--threads", 1)
    assert list((tmp_path / "out").glob("point_cloud/*/point_cloud.ply"))
    told = run(bin_folder / "python", "-m", "splatboost", "doctor", code=1)  # there is no torch
    assert "ok       libsplatboost" in told and "missing  torch" in told
    assert "usage: python -m splatboost" in run(bin_folder / "python", "-m", "splatboost", "--help")


def test_the_package_trains_beside_torch(tmp_path):
    pytest.importorskip("torch")
    bin_folder = environment(tmp_path / "torch", "--system-site-packages")
    losses = run(bin_folder / "python", "-c", """
import torch, splatboost
camera = splatboost.Camera(32, 32, 32, 32, 16, 16, (1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1))
color = torch.zeros(4, 3, requires_grad=True)
still = dict(scales=torch.full((4, 3), 0.3), rotations=torch.tensor([[1.0, 0, 0, 0]]).repeat(4, 1))
means = torch.tensor([[x, y, 2.0] for x in (-0.4, 0.4) for y in (-0.4, 0.4)])
optimizer = torch.optim.Adam([color], lr=0.1)
for step in range(10):
    done = splatboost.rasterize(camera, means, torch.full((4, 1), 0.9), colors=color, **still)
    loss = (done.color - 0.5).abs().mean()
    loss.backward()
    optimizer.step()
    optimizer.zero_grad()
    print(loss.item())
""", cwd=str(tmp_path)).split()
    assert float(losses[-1]) < 0.7 * float(losses[0])
