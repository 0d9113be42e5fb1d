# SPDX-License-Identifier: Apache-2.0
"""Drop-in for trying 2D Gaussian Splatting without its CUDA extension: returns color, radii and a map of 7 channels.

Surfels are rendered as flat Gaussians by affine projection, not by exact ray intersection. The map: blended depth,
alpha, blended normal in view space (3), mean depth instead of median depth, and zeros instead of distortion.
"""

from __future__ import annotations

from typing import Any, Optional

import torch

from . import _drop_in
from .diff_gaussian_rasterization_2023 import GaussianRasterizationSettings

__all__ = ["GaussianRasterizationSettings", "GaussianRasterizer", "flat"]


def flat(scales: torch.Tensor) -> torch.Tensor:
    """Extends the surfels' two standard deviations [N,2] by 0 to [N,3]."""
    return torch.nn.functional.pad(scales, (0, 1))


def _normals(rotations: torch.Tensor) -> torch.Tensor:
    """[N,3] normals: the third axis of rotations given as quaternions (w,x,y,z)."""
    w, x, y, z = torch.nn.functional.normalize(rotations).unbind(dim=1)
    return torch.stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)], dim=1)


class GaussianRasterizer(_drop_in.Drawer):
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
    ) -> Any:
        if scales is None or rotations is None:
            raise ValueError("cov3D_precomp: not supported for surfels; give scales and rotations")
        _drop_in.check_rows(means3D, scales=(scales, 2), rotations=(rotations, 4))
        view = self.raster_settings.viewmatrix
        seen_from = means3D @ view[:3, :3] + view[3, :3]
        normals = _normals(rotations) @ view[:3, :3]
        towards = -torch.sign((normals * seen_from).sum(dim=1, keepdim=True)).detach()
        done = _drop_in.render(self.raster_settings, means3D, means2D, opacities, shs=shs, colors_precomp=colors_precomp,
                               scales=flat(scales), rotations=rotations, alpha=True,
                               features=torch.cat([seen_from[:, 2:], normals * towards], dim=1))
        assert done.features is not None and done.alpha is not None
        depth = done.features[:1]
        channels = [depth, done.alpha, done.features[1:], depth / done.alpha.clamp_min(1e-6), torch.zeros_like(depth)]
        return done.color, done.radii, _drop_in.without_nan(torch.cat(channels))
