# SPDX-License-Identifier: Apache-2.0
"""Runs a 3DGS repository's own script without a GPU: `python -m splatboost.cpu train.py -s SCENE -m OUT`.

CUDA calls of the script run on the CPU, and it renders with SplatBoost's rasterizer. Meant for trying a checkout or a
patch before renting a GPU.
"""

from __future__ import annotations

import argparse
import contextlib
import functools
import inspect
import os
import runpy
import sys
import time
from typing import Any, Callable, Dict, List, Optional

from . import _needs, _stand_ins

#: torch functions that take device=
_FACTORIES = (
    "arange as_tensor asarray empty empty_like empty_strided eye full full_like linspace logspace normal ones ones_like "
    "rand rand_like randint randint_like randn randn_like randperm scalar_tensor sparse_coo_tensor tensor zeros "
    "zeros_like"
).split()
_METHODS = "new_empty new_full new_ones new_tensor new_zeros".split()


def _on_cpu(device: Any) -> Any:
    """Maps a CUDA device that a script names to the CPU; returns other values unchanged."""
    import torch

    if isinstance(device, torch.device) and device.type == "cuda":
        return torch.device("cpu")
    if isinstance(device, str) and device.split(":")[0] == "cuda":
        return "cpu"
    return device


def _with_device(function: Callable[..., Any]) -> Callable[..., Any]:
    @functools.wraps(function)
    def call(*arguments: Any, **named: Any) -> Any:
        if "device" in named:
            named["device"] = _on_cpu(named["device"])
        return function(*arguments, **named)

    return call


def _with_any_device(function: Callable[..., Any]) -> Callable[..., Any]:
    """For functions whose device may be any argument, as in tensor.to("cuda")."""

    @functools.wraps(function)
    def call(*arguments: Any, **named: Any) -> Any:
        if isinstance(named.get("device"), int):
            named["device"] = "cpu"
        return function(*[_on_cpu(a) for a in arguments], **{name: _on_cpu(a) for name, a in named.items()})

    return call


class _Event:
    """torch.cuda.Event, implemented with the host's clock."""

    def __init__(self, *_: Any, **__: Any):
        self._seconds = 0.0

    def record(self, *_: Any) -> None:
        self._seconds = time.perf_counter()

    def elapsed_time(self, end: "_Event") -> float:
        return 1000.0 * (end._seconds - self._seconds)

    def synchronize(self) -> None:
        pass

    def query(self) -> bool:
        return True

    def wait(self, *_: Any) -> None:
        pass


def _peak_memory(*_: Any) -> int:
    import resource

    return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def _loading_to_cpu(load: Callable[..., Any], defaults: Dict[str, Any]) -> Callable[..., Any]:
    """A function of torch that reads a file, with other defaults, and with tensors on the CPU."""

    @functools.wraps(load)
    def load_on_cpu(file: Any, map_location: Any = None, *arguments: Any, **named: Any) -> Any:
        named = {**defaults, **named}
        return load(file, "cpu" if map_location is None else _on_cpu(map_location), *arguments, **named)

    return load_on_cpu


def map_cuda() -> None:
    """Patches torch in this process so that CUDA requests run on the CPU. A second call has no effect."""
    import torch

    if getattr(torch, "_splatboost_on_cpu", False):
        return
    setattr(torch, "_splatboost_on_cpu", True)
    for name in _FACTORIES:
        if hasattr(torch, name):
            setattr(torch, name, _with_device(getattr(torch, name)))
    tensor: Any = torch.Tensor
    for name in _METHODS:
        setattr(tensor, name, _with_device(getattr(tensor, name)))
    tensor.to = _with_any_device(tensor.to)
    tensor.cuda = lambda self, *_, **__: self
    tensor.pin_memory = lambda self, *_, **__: self
    module: Any = torch.nn.Module
    module.to = _with_any_device(module.to)
    module.cuda = lambda self, *_, **__: self

    class Generator(torch._C.Generator):
        def __new__(cls, device: Any = "cpu") -> Any:
            return super().__new__(cls, device=_on_cpu(device))

    torch.Generator = Generator  # type: ignore[misc]

    # Since 2.6 torch refuses the numpy numbers in the hosts' checkpoints by default.
    whole = {"weights_only": False} if "weights_only" in inspect.signature(torch.load).parameters else {}
    torch.load = _loading_to_cpu(torch.load, whole)
    torch.jit.load = _loading_to_cpu(torch.jit.load, {})

    cuda: Any = torch.cuda
    cuda.Event = _Event
    for name in ("synchronize", "empty_cache", "set_device", "reset_peak_memory_stats", "reset_max_memory_allocated",
                 "ipc_collect", "init"):
        setattr(cuda, name, lambda *_, **__: None)
    for name in ("max_memory_allocated", "max_memory_reserved", "memory_allocated", "memory_reserved"):
        setattr(cuda, name, _peak_memory)
    cuda.current_device = lambda: 0
    cuda.get_device_name = lambda *_: "CPU"
    cuda.mem_get_info = lambda *_: (os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"),
                                    os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    cuda.stream = lambda *_: contextlib.nullcontext()
    cuda.device = lambda *_: contextlib.nullcontext()
    for name in ("range_push", "range_pop", "mark"):
        setattr(cuda.nvtx, name, lambda *_: None)


def detect_layout(folder: str) -> Optional[str]:
    """The drop-in layout that the checkout in a folder needs; None if it is not a 3DGS checkout."""
    if os.path.exists(os.path.join(folder, "convex_renderer", "__init__.py")):
        return "convexes"
    path = os.path.join(folder, "gaussian_renderer", "__init__.py")
    if not os.path.exists(path):
        return None
    with open(path, encoding="utf-8", errors="replace") as file:
        text = file.read()
    if "diff_plane_rasterization" in text:
        return "pgsr"
    if "view2gaussian" in text:
        return "opacity-fields"
    if "kernel_size" in text and "subpixel_offset" in text:
        return "mip-splatting"
    if "means2D_densify" in text or "d_scaling, is_6dof=False" in text:
        return "deformable-3dgs"
    if "visible_filter" in text or "def prefilter_voxel(" in text:
        return "anchors"
    if "diff_surfel_rasterization" in text:
        return "surfels"
    if "gs_w" in text:
        return "absgs"
    return "3dgs-2024" if "depth_image" in text or "antialiasing" in text else "3dgs-2023"


def checkout_of(folder: str) -> str:
    """The checkout that a folder of scripts belongs to: the folder itself, or the one above it if only that is a 3DGS
    checkout."""
    above = os.path.dirname(folder)
    return above if detect_layout(folder) is None and detect_layout(above) is not None else folder


def _fail(message: str) -> int:
    sys.stderr.write("splatboost.cpu: %s\n" % message)
    return 2


def _fail_for_modules(script: str, modules: List[str]) -> int:
    what = "module" if len(modules) == 1 else "modules"
    return _fail("%s needs the Python %s %s: %s" % (script, what, ", ".join(modules), _needs.install_command(modules)))


def main(arguments: Optional[List[str]] = None) -> int:
    from .drop_ins import LAYOUTS

    parser = argparse.ArgumentParser(
        prog="python -m splatboost.cpu",
        description="Runs a 3DGS repository's own script on the CPU, with SplatBoost's rasterizer.",
        epilog="Example: python -m splatboost.cpu train.py -s scene -m out --iterations 600 -r 8")
    parser.add_argument("--layout", choices=sorted(LAYOUTS), help="layout of the rasterizer; default: detected from the checkout")
    parser.add_argument("script", help="the host's train.py, render.py, metrics.py, …")
    parser.add_argument("arguments", nargs=argparse.REMAINDER, help="arguments of the script")
    options = parser.parse_args(arguments)

    if not os.path.isfile(options.script):
        return _fail("there is no script %s; give the path of the checkout's train.py" % options.script)
    try:
        import torch  # noqa: F401
    except ModuleNotFoundError:
        return _fail("torch is not installed: " + _needs.where_torch_is())
    trouble = _needs.numpy_trouble()
    if trouble:
        return _fail(trouble)
    folder = os.path.dirname(os.path.abspath(options.script))
    checkout = checkout_of(folder)
    missing = _needs.missing_modules(options.script, _stand_ins.PROVIDED, checkout)
    if missing:
        return _fail_for_modules(options.script, missing)
    layout = options.layout or detect_layout(checkout)
    from ._library import LibraryError

    map_cuda()
    try:
        if layout is not None:
            from .drop_ins import install_drop_ins

            install_drop_ins(layout)
            from . import _library

            _library.load()
    except LibraryError as error:
        return _fail(str(error))
    _stand_ins.install()
    sys.argv = [options.script] + options.arguments
    sys.path.insert(0, folder)
    try:
        runpy.run_path(options.script, run_name="__main__")
    except ModuleNotFoundError as error:
        if error.name is None:
            raise
        return _fail_for_modules(options.script, [error.name])
    return 0


if __name__ == "__main__":
    sys.exit(main())
