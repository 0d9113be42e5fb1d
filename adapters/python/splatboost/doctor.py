# SPDX-License-Identifier: Apache-2.0
"""Reports what is installed, what is missing, and how to get it: `python -m splatboost doctor [CHECKOUT]`."""

from __future__ import annotations

import ctypes
import importlib.util
import os
import platform
import shlex
import shutil
import subprocess
import sys
from typing import Callable, List, Optional, Tuple

from . import __version__, _needs, _stand_ins
from . import _library as lib

#: (state, what, remedy); remedy is empty if nothing is missing. States: "ok", "note" (optional) and "missing".
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
        lines.append(("note", "this package has version %s" % __version__, "install both from one source tree"))
    return lines + _library_cuda() + _cuda()


def _library_cuda() -> List[Line]:
    built_for = lib.cuda_architectures()
    if not built_for:
        return [("note", "libsplatboost was built without CUDA: it supports only CPU tensors", "for a GPU: " + lib.CUDA_REMEDY)]
    lines: List[Line] = [("ok", "libsplatboost was built with CUDA, for compute capability %s" % built_for, "")]
    try:
        handle = ctypes.c_void_p()
        lib.call("sb_rasterizer_create", ctypes.byref(lib.Device(lib.CUDA, 0, 0, None)), ctypes.byref(handle))
        lib.load().sb_rasterizer_destroy(handle)
    except (lib.NoCudaError, lib.LibraryError, MemoryError) as e:
        remedy = "install an NVIDIA driver that supports the CUDA version the library was built with, or newer"
        lines.append(("note", "libsplatboost cannot use a GPU here: %s" % e, remedy))
    return lines


def _cuda() -> List[Line]:
    """Checks the driver, its devices, and the compiler needed to build a library with CUDA."""
    lines: List[Line] = []
    if shutil.which("nvidia-smi"):
        query = ["nvidia-smi", "--query-gpu=index,name,compute_cap,driver_version", "--format=csv,noheader"]
        done = subprocess.run(query, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            lines.append(("note", "nvidia-smi: %s" % (done.stdout + done.stderr).strip(), "see NVIDIA's driver"))
        for row in done.stdout.splitlines() if done.returncode == 0 else []:
            fields = [field.strip() for field in row.split(",")]
            if len(fields) == 4:
                lines.append(("ok", "GPU %s: %s, compute capability %s, driver %s" % tuple(fields), ""))
    else:
        lines.append(("note", "nvidia-smi: not found", "for a GPU install NVIDIA's driver"))
    if not lib.cuda_architectures() and not shutil.which("nvcc"):
        remedy = "to build the library with CUDA install the CUDA toolkit, 12.0 or later, and put its bin on PATH"
        lines.append(("note", "nvcc: not found", remedy))
    return lines


def _torch() -> List[Line]:
    try:
        import torch
    except Exception as e:  # a broken installation may raise any exception
        return [("missing", "torch: %s" % e, _needs.where_torch_is())]
    lines: List[Line] = [("ok", "torch %s, %s" % (torch.__version__, torch.__file__), "")]
    trouble = _needs.numpy_trouble()
    if trouble:
        what, _, remedy = trouble.rpartition(": ")
        lines.append(("missing", what, remedy))
    version = tuple(int(p) for p in torch.__version__.split("+")[0].split(".")[:2] if p.isdigit())
    if version < (1, 13):
        lines.append(("note", "torch before 1.13 is not tested with this package", "pip install --upgrade torch"))
    if torch.version.cuda is None:
        lines.append(("note", "torch was built without CUDA", "for a GPU: https://pytorch.org/get-started/locally"))
    elif not torch.cuda.is_available():
        lines.append(("note", "torch, built for CUDA %s, finds no device" % torch.version.cuda, "see NVIDIA's driver"))
    else:
        for i in range(torch.cuda.device_count()):
            capability = "%d.%d" % torch.cuda.get_device_capability(i)
            what = "torch, built for CUDA %s, finds cuda:%d: %s, compute capability %s"
            lines.append(("ok", what % (torch.version.cuda, i, torch.cuda.get_device_name(i), capability), ""))
    return lines


def _upstream() -> List[Line]:
    """Lists which of the CUDA extensions that the drop-ins replace are installed."""
    lines: List[Line] = []
    for name in ("diff_gaussian_rasterization", "simple_knn", "fused_ssim"):
        found = name in sys.modules or importlib.util.find_spec(name) is not None
        what = "installed; the drop-in takes its place" if found else "not installed; the drop-in replaces it"
        lines.append(("ok", "%s: %s after install_drop_ins" % (name, what), ""))
    found = importlib.util.find_spec("gsplat") is not None
    lines.append(
        ("ok", "gsplat: installed", "")
        if found
        else ("note", "gsplat: not installed", "only SplatBoostStrategy needs it: pip install gsplat")
    )
    return lines


#: Scripts of a host that its users run.
_SCRIPTS = ("train.py", "render.py", "metrics.py")

#: Files of the checkouts without these, by which their recipes recognise them too.
_GSPLAT = os.path.join("examples", "simple_trainer.py")
_PHOTO_SLAM = os.path.join("src", "gaussian_mapper.cpp")


def _gsplat(folder: str, trainer: str) -> List[Line]:
    """Checks the Python modules of gsplat's example trainer. It has no stand-ins, since it does not run without a GPU."""
    missing = _needs.missing_modules(trainer)
    if not missing:
        return [("ok", "%s: all Python modules that simple_trainer.py needs are installed" % folder, "")]
    listed = os.path.join(folder, "examples", "requirements.txt")
    remedy = "pip install -e %s && pip install -r %s" % (shlex.quote(folder), shlex.quote(listed))
    return [("missing", "%s needs %s, not installed" % (trainer, ", ".join(missing)), remedy)]


def _host(folder: str) -> List[Line]:
    """Checks the Python modules that a host's checkout needs."""
    scripts = [os.path.join(folder, name) for name in _SCRIPTS if os.path.isfile(os.path.join(folder, name))]
    if scripts:
        return _scripts(folder, scripts)
    trainer = os.path.join(folder, _GSPLAT)
    if os.path.isfile(trainer):
        return _gsplat(folder, trainer)
    if os.path.isfile(os.path.join(folder, _PHOTO_SLAM)):
        what = "%s: Photo-SLAM, in C++, needs no Python modules; its build needs an installed SplatBoost (docs/patching.md)"
        return [("ok", what % folder, "")]
    what = "%s: there is no train.py, no %s (gsplat) and no %s (Photo-SLAM)" % (folder, _GSPLAT, _PHOTO_SLAM)
    return [("missing", what, "give the folder of a backbone's checkout")]


def _scripts(folder: str, scripts: List[str]) -> List[Line]:
    needed = {name for script in scripts for name in _needs.needed_modules(script)}
    missing = {name for script in scripts for name in _needs.missing_modules(script, _stand_ins.PROVIDED)}
    lines: List[Line] = []
    if missing:
        what = "%s needs %s, not installed" % (folder, ", ".join(sorted(missing)))
        lines.append(("missing", what, _needs.install_command(missing)))
    else:
        lines.append(("ok", "%s: all Python modules that its scripts need are installed" % folder, ""))
    absent = [name for name in sorted(needed & set(_stand_ins.PROVIDED))
              if importlib.util.find_spec(name) is None]
    meshes = _stand_ins.FOR_MESHES
    if meshes in absent:
        absent.remove(meshes)
        remedy = "%s; without it leave the meshes out, with --skip_train (PGSR) or --skip_mesh (2D Gaussian Splatting)"
        what = "not installed: %s; render.py needs it for meshes" % meshes
        lines.append(("note", what, remedy % _needs.install_command([meshes])))
    if absent:
        what = "not installed: %s" % ", ".join(absent)
        lines.append(("note", what, "python -m splatboost.cpu works without them; the scripts themselves need them"))
    return lines


def _works() -> List[Line]:
    """Renders one Gaussian, forward and backward, on every device that both torch and the library support."""
    import torch

    lines = [_works_on("cpu", "the CPU", "see the lines above; otherwise report it")]
    if lib.cuda_architectures():
        for i in range(torch.cuda.device_count() if torch.cuda.is_available() else 0):
            remedy = "build the library on this machine, for its GPU: " + lib.CUDA_REMEDY
            lines.append(_works_on("cuda:%d" % i, "cuda:%d" % i, remedy))
    return lines


def _works_on(device: str, name: str, remedy: str) -> Line:
    try:
        import torch

        from . import Camera, rasterize

        camera = Camera(16, 16, 16, 16, 8, 8, (1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1))
        opacity = torch.tensor([[0.8]], device=device, requires_grad=True)
        done = rasterize(
            camera,
            torch.tensor([[0.0, 0, 2]], device=device),
            opacity,
            scales=torch.full((1, 3), 0.1, device=device),
            rotations=torch.tensor([[1.0, 0, 0, 0]], device=device),
            colors=torch.ones(1, 3, device=device),
        )
        done.color.sum().backward()
        assert opacity.grad is not None and float(opacity.grad) > 1.0
    except Exception as e:
        return ("missing", "drawing a Gaussian on %s failed: %s" % (name, e), remedy)
    return ("ok", "draws and differentiates a Gaussian on %s" % name, "")


def examine(folder: Optional[str] = None) -> List[Line]:
    """All findings. folder: a checkout of a backbone whose requirements are checked too."""
    lines: List[Line] = [
        ("ok", "Python %s, %s" % (platform.python_version(), sys.executable), ""),
        ("ok", "splatboost %s, %s" % (__version__, __file__), ""),
    ]
    checks: List[Callable[[], List[Line]]] = [_library, _torch, _upstream]
    for check in checks:
        lines += check()
    if all(state != "missing" for state, _, _ in lines):
        lines += _works()
    if folder is not None:
        lines += _host(folder)
    return lines


def main(folder: Optional[str] = None) -> int:
    """Prints the findings; 0 if nothing is missing, else 1; 2 if there is no such folder."""
    if folder is not None and not os.path.isdir(folder):
        print("splatboost doctor: there is no folder %s; give that of a backbone's checkout" % folder, file=sys.stderr)
        return 2
    lines = examine(folder)
    for state, what, remedy in lines:
        print("%-8s %s" % (state, what))
        if remedy:
            print("%-8s   → %s" % ("", remedy))
    return 1 if any(state == "missing" for state, _, _ in lines) else 0
