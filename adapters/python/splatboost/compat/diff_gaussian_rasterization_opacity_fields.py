# SPDX-License-Identifier: Apache-2.0
"""Drop-in for trying Gaussian Opacity Fields without its CUDA extension: returns an image of 9 channels and radii.

Gaussians are rendered by affine projection with Mip-Splatting's filter, not by exact ray intersection. The channels are
color (3), the blended shortest axis in view space (3), depth divided by alpha, alpha, and zeros instead of distortion.
"""

from __future__ import annotations

from typing import Any, Optional

import torch

from . import _drop_in
from .diff_gaussian_rasterization_mip_splatting import GaussianRasterizationSettings, GaussianRasterizer as _MipSplatting

__all__ = ["GaussianRasterizationSettings", "GaussianRasterizer"]


def _shortest_axes(scales: torch.Tensor, rotations: torch.Tensor) -> torch.Tensor:
    """[N,3] unit vectors along the shortest axes, in world coordinates."""
    w, x, y, z = torch.nn.functional.normalize(rotations).unbind(dim=1)
    axes = torch.stack([
        torch.stack([1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)], dim=1),
        torch.stack([2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)], dim=1),
        torch.stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)], dim=1)], dim=1)
    return axes[torch.arange(len(axes), device=axes.device), scales.argmin(dim=1)]


class GaussianRasterizer(_MipSplatting):
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
        view2gaussian_precomp: Optional[torch.Tensor] = None,
    ) -> Any:
        if scales is None or rotations is None or view2gaussian_precomp is not None:
            raise ValueError("cov3D_precomp, view2gaussian_precomp: not supported; give scales and rotations")
        _drop_in.check_rows(means3D, scales=(scales, 3), rotations=(rotations, 4))
        view = self.raster_settings.viewmatrix
        seen_from = means3D @ view[:3, :3] + view[3, :3]
        axes = _shortest_axes(scales, rotations) @ view[:3, :3]
        axes = axes * -torch.sign((axes * seen_from).sum(dim=1, keepdim=True)).detach()
        done = _drop_in.render(self.raster_settings, means3D, means2D, opacities, shs=shs, colors_precomp=colors_precomp,
                               scales=scales, rotations=rotations, alpha=True,
                               features=torch.cat([axes, seen_from[:, 2:]], dim=1), **self.options())
        assert done.features is not None and done.alpha is not None
        depth = done.features[3:] / done.alpha.clamp_min(1e-6)
        maps = _drop_in.without_nan(torch.cat([done.features[:3], depth, done.alpha, torch.zeros_like(depth)]))
        return torch.cat([done.color, maps]), done.radii
