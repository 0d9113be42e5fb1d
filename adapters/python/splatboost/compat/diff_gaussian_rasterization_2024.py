# SPDX-License-Identifier: Apache-2.0
"""Drop-in for `diff_gaussian_rasterization` as 3DGS has had it since 2024: antialiasing; returns color [3,H,W], radii
int32 [N] and inverse depth [1,H,W]."""

from __future__ import annotations

from collections import namedtuple
from typing import Any, Dict

from .._render import Render
from . import _drop_in

__all__ = ["GaussianRasterizationSettings", "GaussianRasterizer", "rasterize_gaussians"]

# The layouts of August 2024 leave antialiasing out.
GaussianRasterizationSettings = namedtuple(  # type: ignore[misc]
    "GaussianRasterizationSettings", _drop_in.SIZE + _drop_in.VIEW + ("antialiasing",), defaults=(False,))


class GaussianRasterizer(_drop_in.Drawer):
    def options(self) -> Dict[str, Any]:
        return {"inverse_depth": True, "compensate_opacity": bool(self.raster_settings.antialiasing)}

    def results(self, done: Render) -> Any:
        return done.color, done.radii, done.inverse_depth


rasterize_gaussians = _drop_in.as_function(GaussianRasterizer)
