# SPDX-License-Identifier: Apache-2.0
"""Drop-in for PGSR's `diff_plane_rasterization`: returns color [3,H,W], radii int32 [N], observing pixels int32 [N], the
blended all_map [5,H,W] and the depth of the blended planes [1,H,W]; the last two are zeros without render_geo.

Input all_map [N,5]: a Gaussian's normal in view space (3), 1, and the distance of its plane. The gradient of
means2D_abs is the sum of absolute gradients.
"""

from __future__ import annotations

from collections import namedtuple
from typing import Any, Optional

import torch

from . import _drop_in

__all__ = ["GaussianRasterizationSettings", "GaussianRasterizer"]

GaussianRasterizationSettings = namedtuple(  # type: ignore[misc]
    "GaussianRasterizationSettings", _drop_in.SIZE + _drop_in.VIEW[:-1] + ("render_geo", "debug"))

#: A pixel observes a Gaussian if the transmittance in front of it is above this value.
_OBSERVE_TRANSMITTANCE = 0.5
_CHANNELS = 5


def _plane_depth(settings: Any, all_map: torch.Tensor) -> torch.Tensor:
    """[1,H,W] z at which a pixel's ray intersects its blended plane. As upstream: sums are not normalized, since alpha
    cancels, and the ray passes through the pixel's corner, with the principal point in the image centre."""
    height, width = all_map.shape[1:]
    x = (torch.arange(width, device=all_map.device) / (0.5 * width) - 1.0) * settings.tanfovx
    y = (torch.arange(height, device=all_map.device) / (0.5 * height) - 1.0) * settings.tanfovy
    towards = all_map[0] * x + all_map[1] * y.unsqueeze(1) + all_map[2]
    return (all_map[4] / -(towards + 1e-8)).unsqueeze(0)


class GaussianRasterizer(_drop_in.Drawer):
    def forward(  # type: ignore[override]
        self,
        means3D: torch.Tensor,
        means2D: torch.Tensor,
        means2D_abs: torch.Tensor,
        opacities: torch.Tensor,
        shs: Optional[torch.Tensor] = None,
        colors_precomp: Optional[torch.Tensor] = None,
        scales: Optional[torch.Tensor] = None,
        rotations: Optional[torch.Tensor] = None,
        cov3D_precomp: Optional[torch.Tensor] = None,
        all_map: Optional[torch.Tensor] = None,
    ) -> Any:
        """means2D and means2D_abs [N,3]; other arguments as in the other layouts."""
        settings = self.raster_settings
        _drop_in.check_rows(means3D, means2D=(means2D, 3), means2D_abs=(means2D_abs, 3))
        planes = _drop_in.given(all_map) if settings.render_geo else None
        if settings.render_geo and planes is None and means3D.shape[0] > 0:
            raise ValueError("all_map: expected [N,%d] with render_geo, got none" % _CHANNELS)
        if planes is not None and planes.shape[1:] != (_CHANNELS,):
            raise ValueError("all_map: expected shape [N,%d], got %s" % (_CHANNELS, list(planes.shape)))
        points = torch.cat([means2D[:, :2], means2D_abs[:, :2]], dim=1)
        done = _drop_in.render(settings, means3D, points, opacities, shs=shs, colors_precomp=colors_precomp,
                               scales=scales, rotations=rotations, cov3D_precomp=cov3D_precomp, features=planes)
        observed = done.count_observed(_OBSERVE_TRANSMITTANCE)
        if done.features is None:
            none = torch.zeros((_CHANNELS,) + tuple(done.color.shape[1:]), device=done.color.device)
            return done.color, done.radii, observed, none, none[:1].clone()
        return done.color, done.radii, observed, done.features, _plane_depth(settings, done.features)
