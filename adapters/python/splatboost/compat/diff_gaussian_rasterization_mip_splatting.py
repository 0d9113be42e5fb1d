# SPDX-License-Identifier: Apache-2.0
"""Drop-in for Mip-Splatting's `diff_gaussian_rasterization`: the 2D Mip filter; returns color [3,H,W] and radii int32
[N]. Column 2 of the gradient of means2D is the sum of the absolute ones."""

from __future__ import annotations

from collections import namedtuple
from typing import Any, Dict

from . import _drop_in

__all__ = ["GaussianRasterizationSettings", "GaussianRasterizer", "rasterize_gaussians"]

# kernel_size: px², the low-pass. subpixel_offset: zeros or None, this rasterizer samples at pixel centres.
GaussianRasterizationSettings = namedtuple(  # type: ignore[misc]
    "GaussianRasterizationSettings", _drop_in.SIZE + ("kernel_size", "subpixel_offset") + _drop_in.VIEW)


class GaussianRasterizer(_drop_in.Drawer):
    def options(self) -> Dict[str, Any]:
        offset = self.raster_settings.subpixel_offset
        if offset is not None and bool(offset.any()):
            raise ValueError("subpixel_offset: zeros wanted, others given: run without --ray_jitter")
        return {"low_pass": float(self.raster_settings.kernel_size), "compensate_opacity": True, "absolute_sum": True}


rasterize_gaussians = _drop_in.as_function(GaussianRasterizer)
