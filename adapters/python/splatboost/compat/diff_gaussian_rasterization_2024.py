# SPDX-License-Identifier: Apache-2.0
"""Drop-in for `diff_gaussian_rasterization` as 3DGS has had it since 2024: inverse depth, antialiasing."""

from __future__ import annotations

from typing import Any, NamedTuple, Optional, Tuple

import torch
from torch import nn

from . import _drop_in

__all__ = ["GaussianRasterizationSettings", "GaussianRasterizer", "rasterize_gaussians"]

Drawn = Tuple[torch.Tensor, torch.Tensor, Optional[torch.Tensor]]


class GaussianRasterizationSettings(NamedTuple):
    """As in 2023, with antialiasing; the layouts of August 2024 leave that out."""

    image_height: int
    image_width: int
    tanfovx: float
    tanfovy: float
    bg: torch.Tensor
    scale_modifier: float
    viewmatrix: torch.Tensor
    projmatrix: torch.Tensor
    sh_degree: int
    campos: torch.Tensor
    prefiltered: bool
    debug: bool
    antialiasing: bool = False


def rasterize_gaussians(
    means3D: torch.Tensor,
    means2D: torch.Tensor,
    sh: torch.Tensor,
    colors_precomp: torch.Tensor,
    opacities: torch.Tensor,
    scales: torch.Tensor,
    rotations: torch.Tensor,
    cov3Ds_precomp: torch.Tensor,
    raster_settings: Any,
) -> Drawn:
    """color [3,H,W], radii int32 [N], inverse depth [1,H,W]. What is left out is None or an empty tensor."""
    given = _drop_in.given
    done = _drop_in.render(
        raster_settings,
        means3D,
        means2D,
        opacities,
        shs=given(sh),
        colors_precomp=given(colors_precomp),
        scales=given(scales),
        rotations=given(rotations),
        cov3D_precomp=given(cov3Ds_precomp),
        inverse_depth=True,
        compensate_opacity=bool(raster_settings.antialiasing),
    )
    return done.color, done.radii, done.inverse_depth


class GaussianRasterizer(nn.Module):
    def __init__(self, raster_settings: GaussianRasterizationSettings):
        super().__init__()
        self.raster_settings = raster_settings

    def markVisible(self, positions: torch.Tensor) -> torch.Tensor:
        """bool [N]: which positions [N,3] lie beyond the near plane."""
        return _drop_in.visible(self.raster_settings, positions)

    def forward(
        self,
        means3D: torch.Tensor,
        means2D: torch.Tensor,
        opacities: torch.Tensor,
        shs: Optional[torch.Tensor] = None,
        colors_precomp: Optional[torch.Tensor] = None,
        scales: Optional[torch.Tensor] = None,
        rotations: Optional[torch.Tensor] = None,
        cov3D_precomp: Optional[torch.Tensor] = None,
    ) -> Drawn:
        """Arguments as in 2023; returns color [3,H,W], radii int32 [N], inverse depth [1,H,W]."""
        done = _drop_in.render(
            self.raster_settings,
            means3D,
            means2D,
            opacities,
            shs=shs,
            colors_precomp=colors_precomp,
            scales=scales,
            rotations=rotations,
            cov3D_precomp=cov3D_precomp,
            inverse_depth=True,
            compensate_opacity=bool(self.raster_settings.antialiasing),
        )
        return done.color, done.radii, done.inverse_depth
