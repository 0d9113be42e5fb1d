# SPDX-License-Identifier: Apache-2.0
"""What is there, what is missing, and how to get it: `python -m splatboost doctor`."""

from __future__ import annotations

import importlib.util
import platform
import sys
from typing import Callable, List, Tuple

from . import __version__
from . import _library as lib

#: state, what, remedy (empty where nothing is missing). States: "ok", "note" (works without) and "missing".
Line = Tuple[str, str, str]


def _library() -> List[Line]:
    try:
        library = lib.load()
    except lib.LibraryError as e:
        return [("missing", str(e), "run 'pip install .' in SplatBoost's source tree")]
    lines: List[Line] = [
        ("ok", "libsplatboost %s, ABI %d, %s" % (lib.version(), lib.ABI_VERSION, getattr(library, "path", "")), "")
    ]
    if lib.version() != __version__:
        lines.append(("note", "this package is of version %s" % __version__, "install both from one source tree"))
    if lib.has_cuda():
        lines.append(("ok", "libsplatboost runs on CUDA here", ""))
    else:
        lines.append(
            (
                "note",
                "libsplatboost runs on the CPU only so far: tensors must be on the CPU",
                "this version of SplatBoost has no CUDA code yet",
            )
        )
    return lines


def _torch() -> List[Line]:
    try:
        import torch
    except Exception as e:  # a broken install says many things
        return [("missing", "torch: %s" % e, "pip install torch, or apt-get install python3-torch")]
    lines: List[Line] = [("ok", "torch %s, %s" % (torch.__version__, torch.__file__), "")]
    version = tuple(int(p) for p in torch.__version__.split("+")[0].split(".")[:2] if p.isdigit())
    if version < (1, 13):
        lines.append(("note", "torch before 1.13 is not tested with this package", "pip install --upgrade torch"))
    if torch.cuda.is_available():
        lines.append(("ok", "torch sees CUDA: %s" % torch.cuda.get_device_name(), ""))
    else:
        lines.append(("note", "torch sees no CUDA device", "trains on the CPU; for a GPU install torch with CUDA"))
    return lines


def _upstream() -> List[Line]:
    """The CUDA extensions that drop-ins stand in for: which of them are installed beside us."""
    lines: List[Line] = []
    for name in ("diff_gaussian_rasterization", "simple_knn", "fused_ssim"):
        found = name in sys.modules or importlib.util.find_spec(name) is not None
        what = "installed; the drop-in takes its place" if found else "not installed; the drop-in does its work"
        lines.append(("ok", "%s: %s after install_drop_ins" % (name, what), ""))
    found = importlib.util.find_spec("gsplat") is not None
    lines.append(
        ("ok", "gsplat: installed", "")
        if found
        else ("note", "gsplat: not installed", "only FastGSStrategy is for it: pip install gsplat")
    )
    return lines


def _works() -> List[Line]:
    """Draws one Gaussian, forward and backward."""
    try:
        import torch

        from . import Camera, rasterize

        camera = Camera(16, 16, 16, 16, 8, 8, (1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1))
        opacity = torch.tensor([[0.8]], requires_grad=True)
        done = rasterize(
            camera,
            torch.tensor([[0.0, 0, 2]]),
            opacity,
            scales=torch.full((1, 3), 0.1),
            rotations=torch.tensor([[1.0, 0, 0, 0]]),
            colors=torch.ones(1, 3),
        )
        done.color.sum().backward()
        assert opacity.grad is not None and float(opacity.grad) > 1.0
    except Exception as e:
        return [("missing", "drawing a Gaussian failed: %s" % e, "see the lines above; otherwise report it")]
    return [("ok", "draws and differentiates a Gaussian on the CPU", "")]


def examine() -> List[Line]:
    """All findings."""
    lines: List[Line] = [
        ("ok", "Python %s, %s" % (platform.python_version(), sys.executable), ""),
        ("ok", "splatboost %s, %s" % (__version__, __file__), ""),
    ]
    checks: List[Callable[[], List[Line]]] = [_library, _torch, _upstream]
    for check in checks:
        lines += check()
    if all(state != "missing" for state, _, _ in lines):
        lines += _works()
    return lines


def main() -> int:
    """Prints the findings; 0 if nothing is missing, else 1."""
    lines = examine()
    for state, what, remedy in lines:
        print("%-8s %s" % (state, what))
        if remedy:
            print("%-8s   → %s" % ("", remedy))
    return 1 if any(state == "missing" for state, _, _ in lines) else 0
