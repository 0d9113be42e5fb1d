# SPDX-License-Identifier: Apache-2.0
"""Drop-in for `diff_gaussian_rasterization` of 3DGS since 2024, with antialiasing: returns color [3,H,W], radii
int32 [N] and inverse depth [1,H,W]."""

from __future__ import annotations

from collections import namedtuple
from typing import Any, Dict

from .._render import Render
from . import _drop_in

__all__ = ["GaussianRasterizationSettings", "GaussianRasterizer", "rasterize_gaussians"]

# The layout of August 2024 has no antialiasing field.
GaussianRasterizationSettings = namedtuple(  # type: ignore[misc]
    "GaussianRasterizationSettings", _drop_in.SIZE + _drop_in.VIEW + ("antialiasing",), defaults=(False,))


class GaussianRasterizer(_drop_in.Drawer):
    def options(self) -> Dict[str, Any]:
        return {"inverse_depth": True, "compensate_opacity": bool(self.raster_settings.antialiasing)}

    def results(self, done: Render) -> Any:
        return done.color, done.radii, done.inverse_depth


rasterize_gaussians = _drop_in.as_function(GaussianRasterizer)
