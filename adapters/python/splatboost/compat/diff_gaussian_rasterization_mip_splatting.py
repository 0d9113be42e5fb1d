# SPDX-License-Identifier: Apache-2.0
"""Drop-in for Mip-Splatting's `diff_gaussian_rasterization`: the 2D Mip filter, absolute gradients in means2D."""

from __future__ import annotations

from typing import Any, NamedTuple, Optional, Tuple

import torch
from torch import nn

from . import _drop_in

__all__ = ["GaussianRasterizationSettings", "GaussianRasterizer", "rasterize_gaussians"]


class GaussianRasterizationSettings(NamedTuple):
    """As 3DGS's of 2023, with kernel_size (px², the low-pass) and subpixel_offset.

    subpixel_offset must be zero everywhere (or None): this rasterizer samples at pixel centres.
    """

    image_height: int
    image_width: int
    tanfovx: float
    tanfovy: float
    kernel_size: float
    subpixel_offset: Optional[torch.Tensor]
    bg: torch.Tensor
    scale_modifier: float
    viewmatrix: torch.Tensor
    projmatrix: torch.Tensor
    sh_degree: int
    campos: torch.Tensor
    prefiltered: bool
    debug: bool


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
) -> Tuple[torch.Tensor, torch.Tensor]:
    """color [3,H,W] and radii int32 [N]. What is left out is None or an empty tensor."""
    given = _drop_in.given
    done: Tuple[torch.Tensor, torch.Tensor] = GaussianRasterizer(raster_settings)(
        means3D,
        means2D,
        opacities,
        given(sh),
        given(colors_precomp),
        given(scales),
        given(rotations),
        given(cov3Ds_precomp),
    )
    return done


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
    ) -> Tuple[torch.Tensor, torch.Tensor]:
        """Arguments and results as in 2023. Column 2 of the gradient of means2D is the sum of the absolute ones."""
        offset = self.raster_settings.subpixel_offset
        if offset is not None and bool(offset.any()):
            raise ValueError("subpixel_offset: zeros wanted, others given: run without --ray_jitter")
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
            low_pass=float(self.raster_settings.kernel_size),
            compensate_opacity=True,
            absolute_sum=True,
        )
        return done.color, done.radii
