# SPDX-License-Identifier: Apache-2.0
"""Drop-in for `diff_gaussian_rasterization` of 3DGS since 2023: returns color [3,H,W] and radii int32 [N]."""

from __future__ import annotations

from collections import namedtuple

from . import _drop_in

__all__ = ["GaussianRasterizationSettings", "GaussianRasterizer", "rasterize_gaussians"]

GaussianRasterizationSettings = namedtuple(  # type: ignore[misc]
    "GaussianRasterizationSettings", _drop_in.SIZE + _drop_in.VIEW)


class GaussianRasterizer(_drop_in.Drawer):
    pass


rasterize_gaussians = _drop_in.as_function(GaussianRasterizer)
