# SPDX-License-Identifier: Apache-2.0
"""SplatBoost for PyTorch: faster training of 3D Gaussian Splatting by controlling which Gaussians exist.

The package's README describes its contents. Importing it needs neither torch nor the library; using it needs both.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any, List

__version__ = "0.1.0"

if TYPE_CHECKING:
    from ._library import LibraryError, NoCudaError, set_threads
    from ._rasterize import mark_visible, rasterize, visible_radii
    from ._render import Render
    from .adapter import Adapter, ScoredView
    from .camera import Camera
    from .compat import get_beta, last_render, set_beta
    from .drop_ins import install_drop_ins
    from .operations import (
        Loss,
        adam_step,
        camera_clearances,
        distances_to_scene,
        flag_errors,
        fused_ssim,
        importance_scores,
        keep_important,
        keep_largest,
        keep_weighted_sample,
        mean_squared_neighbor_distances,
        photometric_loss,
        pruning_scores,
        spare_one,
    )
    from .schedule import StepIntervals, exponential_rate, scaled_iteration, steps_at

# name → module, imported on first access
_NAMES = {
    name: module
    for module, names in {
        "_library": ("LibraryError", "NoCudaError", "set_threads"),
        "_rasterize": ("mark_visible", "rasterize", "visible_radii"),
        "_render": ("Render",),
        "adapter": ("Adapter", "ScoredView"),
        "camera": ("Camera",),
        "compat": ("get_beta", "last_render", "set_beta"),
        "drop_ins": ("install_drop_ins",),
        "operations": (
            "Loss",
            "adam_step",
            "camera_clearances",
            "distances_to_scene",
            "flag_errors",
            "fused_ssim",
            "importance_scores",
            "keep_important",
            "keep_largest",
            "keep_weighted_sample",
            "mean_squared_neighbor_distances",
            "photometric_loss",
            "pruning_scores",
            "spare_one",
        ),
        "schedule": ("StepIntervals", "exponential_rate", "scaled_iteration", "steps_at"),
    }.items()
    for name in names
}

__all__ = [
    "__version__",
    "adam_step",
    "Adapter",
    "Camera",
    "camera_clearances",
    "distances_to_scene",
    "exponential_rate",
    "flag_errors",
    "fused_ssim",
    "get_beta",
    "importance_scores",
    "install_drop_ins",
    "keep_important",
    "keep_largest",
    "keep_weighted_sample",
    "last_render",
    "LibraryError",
    "Loss",
    "mark_visible",
    "mean_squared_neighbor_distances",
    "NoCudaError",
    "photometric_loss",
    "pruning_scores",
    "rasterize",
    "Render",
    "scaled_iteration",
    "ScoredView",
    "set_beta",
    "set_threads",
    "spare_one",
    "StepIntervals",
    "steps_at",
    "visible_radii",
]


def __getattr__(name: str) -> Any:
    module = _NAMES.get(name)
    if module is None:
        raise AttributeError("module 'splatboost' has no attribute %r" % name)
    value = getattr(importlib.import_module("." + module, __name__), name)
    globals()[name] = value
    return value


def __dir__() -> List[str]:
    return sorted(__all__)
