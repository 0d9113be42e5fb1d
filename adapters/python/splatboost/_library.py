# SPDX-License-Identifier: Apache-2.0
"""libsplatboost through ctypes: its structs, its entries, and errors as exceptions. Does not need torch."""

from __future__ import annotations

import ctypes
import functools
import operator
import os
import pathlib
from ctypes import POINTER, c_char_p, c_double, c_float, c_int32, c_int64, c_uint64, c_void_p
from typing import Any, List, Optional, Tuple

ABI_VERSION = 1

OK, ERROR_ARGUMENT, ERROR_NO_CUDA, ERROR_MEMORY, ERROR_CALLBACK, ERROR_INTERNAL = range(6)
CPU, CUDA = 0, 1
FLOAT32, FLOAT64, INT32, INT64, UINT8 = range(5)
MAX_DIMENSIONS = 4
BOX_SQUARE, BOX_ELLIPSE = 0, 1
CONVEX_BOX_SQUARE, CONVEX_BOX_COMPACT = 0, 1


class LibraryError(RuntimeError):
    """libsplatboost was not found, cannot be loaded, is of another version than this package, or failed."""


class NoCudaError(RuntimeError):
    """A CUDA tensor was passed, but libsplatboost was built without CUDA or finds no device."""


#: How to get a library with CUDA. pip builds for the GPUs of the machine that it runs on.
CUDA_REMEDY = "pip install . --config-settings=cmake.define.SPLATBOOST_CUDA=ON   (in SplatBoost's source tree, with nvcc on PATH)"


class Device(ctypes.Structure):
    _fields_ = [("kind", c_int32), ("index", c_int32), ("threads", c_int32), ("stream", c_void_p)]


class Tensor(ctypes.Structure):
    _fields_ = [
        ("data", c_void_p),
        ("type", c_int32),
        ("dimensions", c_int32),
        ("shape", c_int64 * MAX_DIMENSIONS),
        ("strides", c_int64 * MAX_DIMENSIONS),
        ("device_kind", c_int32),
        ("device_index", c_int32),
    ]


TensorPointer = POINTER(Tensor)


def _tensors(names: str) -> List[Tuple[str, Any]]:
    """Struct fields that are tensor pointers."""
    return [(name, TensorPointer) for name in names.split()]


# Fields shared by several structs: the tensors of Gaussians and of images.
_GAUSSIANS = _tensors("means scales rotations covariances opacities sh_dc sh_rest colors features")
_IMAGES = _tensors("color features inverse_depth alpha")


class Camera(ctypes.Structure):
    _fields_ = [
        ("width", c_int32),
        ("height", c_int32),
        ("fx", c_float),
        ("fy", c_float),
        ("cx", c_float),
        ("cy", c_float),
        ("camera_from_world", c_float * 16),
    ]


class Gaussians(ctypes.Structure):
    _fields_ = _GAUSSIANS + [("sh_degree", c_int32)]


class RasterOptions(ctypes.Structure):
    _fields_ = [
        ("box", c_int32),
        ("beta", c_float),
        ("low_pass", c_float),
        ("compensate_opacity", c_int32),
        ("near_plane", c_float),
        ("background", c_float * 3),
    ]


class RasterOutputs(ctypes.Structure):
    _fields_ = _IMAGES + _tensors("radii visible")


class ImageGradients(ctypes.Structure):
    _fields_ = _IMAGES


class GaussianGradients(ctypes.Structure):
    _fields_ = [("accumulate", c_int32)] + _GAUSSIANS + _tensors("screen_means screen_means_abs")


_CONVEXES = _tensors("points smoothness sharpness opacities sh_dc sh_rest colors")


class Convexes(ctypes.Structure):
    _fields_ = _CONVEXES + [("sh_degree", c_int32)]


class ConvexOptions(ctypes.Structure):
    _fields_ = [
        ("box", c_int32),
        ("beta", c_float),
        ("near_plane", c_float),
        ("pixel_size", c_float),
        ("background", c_float * 3),
        ("released_view_direction", c_int32),
    ]


class ConvexOutputs(ctypes.Structure):
    _fields_ = _tensors("color alpha visible")


class ConvexGradients(ctypes.Structure):
    _fields_ = [("accumulate", c_int32)] + _CONVEXES + _tensors("sharpness_abs screen_points")


class Truth(ctypes.Structure):
    _fields_ = _tensors("color valid")


class Loss(ctypes.Structure):
    _fields_ = [("l1", c_double), ("ssim", c_double), ("total", c_double)]


class AdamOptions(ctypes.Structure):
    _fields_ = [("learning_rate", c_float), ("beta1", c_float), ("beta2", c_float), ("epsilon", c_float)]


class StepIntervals(ctypes.Structure):
    _fields_ = [
        ("early", c_int32),
        ("middle", c_int32),
        ("late", c_int32),
        ("early_end", c_int32),
        ("middle_end", c_int32),
    ]


#: Kinds of settings, indexed by the value of sb_boost_setting().
SETTING_KINDS = (bool, int, float)


_MOMENT: List[Tuple[str, Any]] = [("iteration", c_int32), ("total", c_int32), ("scene_extent", c_float)]


class Density(ctypes.Structure):
    _fields_ = _MOMENT + (
        _tensors("gradients gradients_abs opacities max_scales") + [("max_primitives", c_int64)] + _tensors("clearances"))


class ScoredView(ctypes.Structure):
    _fields_ = _tensors("color") + [("truth", Truth)]


RenderFunction = ctypes.CFUNCTYPE(c_int32, c_void_p, c_int64, POINTER(ScoredView))
CountFunction = ctypes.CFUNCTYPE(c_int32, c_void_p, TensorPointer, TensorPointer)
WeighFunction = ctypes.CFUNCTYPE(c_int32, c_void_p, TensorPointer)


class Views(ctypes.Structure):
    _fields_ = [
        ("context", c_void_p),
        ("primitives", c_int64),
        ("views", c_int64),
        ("render", RenderFunction),
        ("count_flagged", CountFunction),
        ("add_weights", WeighFunction),
    ]


_DEVICE, _CAMERA, _STATUS = POINTER(Device), POINTER(Camera), c_int32
_T, _I32, _I64, _F64 = TensorPointer, POINTER(c_int32), POINTER(c_int64), POINTER(c_double)

# entry: (result, arguments)
_ENTRIES = {
    "sb_abi_version": (c_int32, []),
    "sb_version": (c_char_p, []),
    "sb_last_error": (c_char_p, []),
    "sb_has_device": (c_int32, [c_int32]),
    "sb_cuda_architectures": (c_char_p, []),
    "sb_cuda_activity": (_STATUS, [_I64, _I64]),
    "sb_raster_options_default": (_STATUS, [POINTER(RasterOptions)]),
    "sb_rasterizer_create": (_STATUS, [_DEVICE, POINTER(c_void_p)]),
    "sb_rasterizer_destroy": (None, [c_void_p]),
    "sb_rasterizer_forward": (
        _STATUS,
        [c_void_p, _CAMERA, POINTER(Gaussians), POINTER(RasterOptions), POINTER(RasterOutputs), c_void_p],
    ),
    "sb_rasterizer_backward": (
        _STATUS,
        [c_void_p, POINTER(Gaussians), POINTER(ImageGradients), POINTER(GaussianGradients), c_void_p],
    ),
    "sb_rasterizer_count_flagged": (_STATUS, [c_void_p, _T, _T, c_void_p]),
    "sb_rasterizer_add_weights": (_STATUS, [c_void_p, _T, c_void_p]),
    "sb_rasterizer_count_observed": (_STATUS, [c_void_p, c_float, _T, c_void_p]),
    "sb_rasterizer_settle": (_STATUS, [c_void_p, _I32, c_void_p]),
    "sb_rasterizer_counts": (_STATUS, [c_void_p, _I64, _I64, c_void_p]),
    "sb_convex_rasterizer_create": (_STATUS, [_DEVICE, POINTER(c_void_p)]),
    "sb_convex_rasterizer_destroy": (None, [c_void_p]),
    "sb_convex_rasterizer_forward": (
        _STATUS,
        [c_void_p, _CAMERA, POINTER(Convexes), POINTER(ConvexOptions), POINTER(ConvexOutputs), c_void_p],
    ),
    "sb_convex_rasterizer_backward": (
        _STATUS,
        [c_void_p, POINTER(Convexes), _T, _T, POINTER(ConvexGradients), c_void_p],
    ),
    "sb_convex_rasterizer_count_flagged": (_STATUS, [c_void_p, _T, _T, c_void_p]),
    "sb_convex_rasterizer_add_weights": (_STATUS, [c_void_p, _T, c_void_p]),
    "sb_mark_visible": (_STATUS, [_DEVICE, _CAMERA, _T, c_float, _T]),
    "sb_visible_radii": (_STATUS, [_DEVICE, _CAMERA, POINTER(Gaussians), POINTER(RasterOptions), _T]),
    "sb_flag_errors": (_STATUS, [_DEVICE, _T, POINTER(Truth), c_float, _T, _T, _I64]),
    "sb_photometric_loss": (_STATUS, [_DEVICE, _T, POINTER(Truth), c_float, _T, POINTER(Loss)]),
    "sb_ssim": (_STATUS, [_DEVICE, _T, _T, c_int32, _T, _T]),
    "sb_importance_scores": (_STATUS, [_DEVICE, _T, c_int32, _T]),
    "sb_pruning_scores": (_STATUS, [_DEVICE, _T, _T]),
    "sb_keep_important": (_STATUS, [_DEVICE, _T, c_double, _T, _I64]),
    "sb_keep_weighted_sample": (_STATUS, [_DEVICE, _T, c_int64, c_uint64, c_uint64, _T]),
    "sb_keep_largest": (_STATUS, [_DEVICE, _T, c_int64, _T]),
    "sb_spare_one": (_STATUS, [_DEVICE, _T, _T, _I64]),
    "sb_adam_step": (_STATUS, [_DEVICE, _T, _T, _T, _T, c_int64, POINTER(AdamOptions)]),
    "sb_distances_to_scene": (_STATUS, [_DEVICE, _T, _T, _T]),
    "sb_camera_clearances": (_STATUS, [_DEVICE, _T, _T, _T, _T]),
    "sb_mean_squared_neighbor_distances": (_STATUS, [_DEVICE, _T, c_int32, _T]),
    "sb_steps_at": (_STATUS, [POINTER(StepIntervals), c_int32, c_int32, _I32]),
    "sb_scaled_iteration": (_STATUS, [c_int32, c_int32, c_int32, _I32]),
    "sb_exponential_rate": (_STATUS, [c_double, c_double, c_int32, c_int32, _F64]),
    "sb_boost_create": (_STATUS, [c_char_p, c_int32, POINTER(c_void_p)]),
    "sb_boost_destroy": (None, [c_void_p]),
    "sb_boost_setting": (_STATUS, [c_void_p, c_int32, POINTER(c_char_p), _I32]),
    "sb_boost_get": (_STATUS, [c_void_p, c_char_p, _F64]),
    "sb_boost_set": (_STATUS, [c_void_p, c_char_p, c_double]),
    "sb_adapter_create": (_STATUS, [c_void_p, c_uint64, _DEVICE, POINTER(c_void_p)]),
    "sb_adapter_destroy": (None, [c_void_p]),
    "sb_adapter_beta": (_STATUS, [c_void_p, POINTER(c_float)]),
    "sb_adapter_grows_at": (_STATUS, [c_void_p, c_int32, c_int32, c_int32, _I32]),
    "sb_adapter_prunes_at": (_STATUS, [c_void_p, c_int32, c_int32, c_int32, _I32]),
    "sb_adapter_steps_at": (_STATUS, [c_void_p, c_char_p, c_int32, c_int32, _I32]),
    "sb_adapter_rate_factor": (_STATUS, [c_void_p, c_char_p, c_int32, c_int32, POINTER(c_float)]),
    "sb_adapter_averages_at": (_STATUS, [c_void_p, c_int32, c_int32, _I32]),
    "sb_adapter_prunes_large_at": (_STATUS, [c_void_p, c_int32, c_int32, c_int32, _I32]),
    "sb_adapter_resets_opacities_at": (_STATUS, [c_void_p, c_int32, c_int32, c_int32, _I32]),
    "sb_adapter_grow": (_STATUS, [c_void_p, POINTER(Density), POINTER(Views), _T, _T, c_void_p]),
    "sb_adapter_prune": (_STATUS, [c_void_p, POINTER(Density), POINTER(Views), _T, _T, c_void_p]),
}

_FILE = "libsplatboost.so"
_loaded: Optional[ctypes.CDLL] = None


def candidates() -> List[str]:
    """Paths at which the library is searched, in order."""
    named = os.environ.get("SPLATBOOST_LIBRARY")
    if named:
        return [named]
    package = pathlib.Path(__file__).resolve().parent
    found = [str(package / _FILE)]
    if (package.parents[2] / "CMakePresets.json").exists():  # a source tree
        found.append(str(package.parents[2] / "build" / "release" / "lib" / _FILE))
    return found + [_FILE + "." + str(ABI_VERSION)]  # the system's search path


def _open(path: str) -> Optional[ctypes.CDLL]:
    """The library at a path, or of this name on the system's search path; None if there is none. Raises LibraryError, with the
    loader's reason, if there is one that cannot be loaded."""
    if os.path.dirname(path) and not os.path.exists(path):
        return None
    try:
        return ctypes.CDLL(path)
    except OSError as e:
        reason = str(e)
        # The loader begins with the file that it could not open, which may be another one that the library needs.
        if reason.startswith(path + ": cannot open shared object file: No such file"):
            return None
        reason = reason[len(path) + 2:] if reason.startswith(path + ": ") else reason
        raise LibraryError("libsplatboost at %s cannot be loaded: %s" % (path, reason)) from None


def _declare_entries(library: ctypes.CDLL, path: str) -> None:
    """Sets the types of the entries. Raises LibraryError if the library is older than this package and lacks some."""
    lacking = [name for name in _ENTRIES if not hasattr(library, name)]
    if lacking:
        more = " and %d more" % (len(lacking) - 1) if len(lacking) > 1 else ""
        raise LibraryError("the library at %s lacks %s%s: install it and this package from one version" % (path, lacking[0], more))
    for name, (result, arguments) in _ENTRIES.items():
        entry = getattr(library, name)
        entry.restype = result
        entry.argtypes = arguments


def load() -> ctypes.CDLL:
    """The library, loaded once. Raises LibraryError if it is not found, cannot be loaded or is of another version."""
    global _loaded
    if _loaded is not None:
        return _loaded
    tried = []
    for path in candidates():
        library = _open(path)
        if library is None:
            tried.append(path + ": not found")
            continue
        version = getattr(library, "sb_abi_version", None)
        if version is None or version() != ABI_VERSION:
            have = "none" if version is None else str(version())
            raise LibraryError(
                "%s has ABI version %s, this package needs %d: reinstall both from one version"
                % (path, have, ABI_VERSION)
            )
        _declare_entries(library, path)
        library.path = path  # type: ignore[attr-defined]
        _loaded = library
        return library
    raise LibraryError(
        "libsplatboost was not found: build it with 'pip install .' in the source tree, or set SPLATBOOST_LIBRARY to its "
        "path. Searched: " + "; ".join(tried)
    )


def call(entry: str, *arguments: Any) -> None:
    """Calls an entry that returns a status; raises ValueError, NoCudaError, MemoryError or LibraryError on failure."""
    library = load()
    status = getattr(library, entry)(*arguments)
    if status == OK:
        return
    message = library.sb_last_error().decode("utf-8", "replace")
    if status == ERROR_ARGUMENT:
        raise ValueError(message.replace(" must not be NULL", ": expected a tensor, got None"))
    if status == ERROR_NO_CUDA:
        raise NoCudaError(message)
    if status == ERROR_MEMORY:
        raise MemoryError(message)
    raise LibraryError(entry + ": " + message)


def shown(value: Any) -> str:
    """An argument in an error message, on one line."""
    shape = getattr(value, "shape", None)
    if shape is not None and len(shape) > 0:
        return "%s of shape %s" % (type(value).__name__, list(shape))
    text = " ".join(repr(value).split())
    return text if len(text) <= 60 else text[:60] + "…"


def number(value: Any, name: str) -> float:
    """An argument as a float; ctypes does not name the argument. The library checks the range."""
    try:
        if isinstance(value, (str, bytes)):
            raise TypeError
        return float(value)
    except (TypeError, ValueError, OverflowError, RuntimeError):
        raise ValueError("%s: expected a number, got %s" % (name, shown(value))) from None


def whole(value: Any, name: str, least: int = -(2**31), most: int = 2**31 - 1) -> int:
    """An argument as an int in a range; ctypes does not name the argument and drops the upper bits."""
    try:
        result = int(value) if isinstance(value, float) and value.is_integer() else operator.index(value)
    except (TypeError, ValueError):
        raise ValueError("%s: expected a whole number, got %s" % (name, shown(value))) from None
    if not least <= result <= most:
        raise ValueError("%s: expected a whole number from %d to %d, got %d" % (name, least, most, result))
    return result


#: Seeds of 64 bits, signed or not.
SEEDS = (-(2**63), 2**64 - 1)

_threads = 0
_MAX_THREADS = 4096  # kMaxThreads of splatboost/threads.h, which the library checks too


def set_threads(threads: int) -> None:
    """Sets the number of CPU threads of the operations. 0: OMP_NUM_THREADS if set, else one per CPU that the
    process may use, given its affinity mask and the quotas of its control groups."""
    global _threads
    if isinstance(threads, bool) or not isinstance(threads, int) or not 0 <= threads <= _MAX_THREADS:
        raise ValueError("threads: expected a whole number from 0 to %d, got %r" % (_MAX_THREADS, threads))
    _threads = threads


def get_threads() -> int:
    """Number of CPU threads of the operations; 0: one per CPU that the process may use."""
    if _threads == 0:
        wanted = os.environ.get("OMP_NUM_THREADS", "").split(",")[0]
        return int(wanted) if wanted.isdigit() else 0
    return _threads


@functools.lru_cache(maxsize=None)
def cuda_architectures() -> str:
    """Compute capabilities that the library was built for; empty without CUDA."""
    return str(load().sb_cuda_architectures().decode())


def cuda_activity() -> Tuple[int, int]:
    """Numbers of the library's CUDA allocations and device synchronizations since the process started."""
    allocations, waits = c_int64(), c_int64()
    call("sb_cuda_activity", ctypes.byref(allocations), ctypes.byref(waits))
    return allocations.value, waits.value


def version() -> str:
    """Version of the library."""
    return str(load().sb_version().decode())
