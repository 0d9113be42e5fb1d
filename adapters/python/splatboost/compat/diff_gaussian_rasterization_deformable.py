# SPDX-License-Identifier: Apache-2.0
"""Drop-in for Deformable-3DGS's `diff_gaussian_rasterization`: returns color [3,H,W], radii int32 [N] and depth [1,H,W],
the alpha-blended z, without a gradient. The gradient of means2D_densify is the sum of absolute gradients."""

from __future__ import annotations

from collections import namedtuple
from typing import Any, Optional

import torch

from . import _drop_in

__all__ = ["GaussianRasterizationSettings", "GaussianRasterizer"]

GaussianRasterizationSettings = namedtuple(  # type: ignore[misc]
    "GaussianRasterizationSettings", _drop_in.SIZE + _drop_in.VIEW)


def screen_points(means2D: torch.Tensor, means2D_densify: Optional[torch.Tensor]) -> torch.Tensor:
    """[N,4] whose gradient goes to means2D (columns 0 and 1) and means2D_densify (2 and 3, absolute gradients)."""
    if means2D_densify is None:
        means2D_densify = torch.zeros_like(means2D)
    return torch.cat([means2D[:, :2], means2D_densify[:, :2]], dim=1)


class GaussianRasterizer(_drop_in.Drawer):
    def forward(  # type: ignore[override]
        self,
        means3D: torch.Tensor,
        means2D: torch.Tensor,
        opacities: torch.Tensor,
        shs: Optional[torch.Tensor] = None,
        colors_precomp: Optional[torch.Tensor] = None,
        scales: Optional[torch.Tensor] = None,
        rotations: Optional[torch.Tensor] = None,
        cov3D_precomp: Optional[torch.Tensor] = None,
        means2D_densify: Optional[torch.Tensor] = None,
    ) -> Any:
        """means2D [N,3], or [N,4] from screen_points(); other arguments as in the other layouts."""
        _drop_in.check_rows(means3D, means2D=(means2D, 3, 4))
        if means2D_densify is not None:
            _drop_in.check_rows(means3D, means2D_densify=(means2D_densify, 3))
        points = means2D if means2D.shape[1] == 4 else screen_points(means2D, means2D_densify)
        with torch.no_grad():
            # Row vectors: the third column of the view matrix gives z.
            view = self.raster_settings.viewmatrix
            z = means3D @ view[:3, 2:3] + view[3, 2]
        done = _drop_in.render(self.raster_settings, means3D, points, opacities, shs=shs,
                               colors_precomp=colors_precomp, scales=scales, rotations=rotations,
                               cov3D_precomp=cov3D_precomp, features=z)
        assert done.features is not None
        return done.color, done.radii, done.features.detach()
