# SPDX-License-Identifier: Apache-2.0
"""Drop-in for `diff_gaussian_rasterization` of Scaffold-GS and Octree-GS: the 2023 layout plus visible_filter."""

from __future__ import annotations

from typing import Optional

import torch

from .._rasterize import visible_radii
from . import _drop_in
from .diff_gaussian_rasterization_2023 import GaussianRasterizationSettings

__all__ = ["GaussianRasterizationSettings", "GaussianRasterizer", "rasterize_gaussians"]


class GaussianRasterizer(_drop_in.Drawer):
    def visible_filter(
        self,
        means3D: torch.Tensor,
        scales: Optional[torch.Tensor] = None,
        rotations: Optional[torch.Tensor] = None,
        cov3D_precomp: Optional[torch.Tensor] = None,
    ) -> torch.Tensor:
        """int32 [N] radii of the 3σ squares that overlap the image, 0 for others; anchors have no opacity to use."""
        settings = self.raster_settings
        _drop_in.check_rows(means3D)
        scales = _drop_in.scaled(settings, _drop_in.given(scales))
        if means3D.shape[0] == 0:
            return torch.zeros(0, dtype=torch.int32, device=means3D.device)
        with torch.no_grad(), _drop_in.host_names():
            return visible_radii(_drop_in.camera_of(settings), means3D, scales=scales,
                                 rotations=_drop_in.given(rotations), covariances=_drop_in.given(cov3D_precomp))


rasterize_gaussians = _drop_in.as_function(GaussianRasterizer)
