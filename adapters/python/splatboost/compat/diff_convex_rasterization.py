# SPDX-License-Identifier: Apache-2.0
"""Drop-in for 3D Convex Splatting's `diff_convex_rasterization`: returns color [3,H,W], radii int32 [N], scaling [N],
density_factor [N] and a map of other channels [7,H,W].

As in the published code, density_factor and the map are zeros, and spherical harmonics are evaluated as if x and y of a
centre were its z. Gradients are the true ones of the render: the published code omits the depth of the centre, and for
gradients through the projected points the factor from pixels to NDC, half the image size. The gradient of means2D is in
pixels: columns 0 and 1 are sums over a convex's points, column 2 is the sum of absolute values.
"""

from __future__ import annotations

from collections import namedtuple
from typing import Any, Optional, Tuple

import torch
from torch import nn

from .. import _convexes
from .. import _library as lib
from . import _drop_in

__all__ = ["ConvexRasterizationSettings", "ConvexRasterizer", "rasterize_convexes"]

ConvexRasterizationSettings = namedtuple(  # type: ignore[misc]
    "ConvexRasterizationSettings", _drop_in.SIZE + _drop_in.VIEW)

_OTHERS = 7  # channels of the map


def _shaped(points: torch.Tensor, counts: torch.Tensor, number: int) -> torch.Tensor:
    """Reshapes points to [N,K,3]; counts [N] are checked only on the CPU, to avoid synchronizing with a GPU."""
    per_convex = points.numel() // (3 * number) if number else 6
    ragged = counts.device.type == "cpu" and bool((counts != per_convex).any())
    if ragged or points.numel() != 3 * number * per_convex:
        raise ValueError("convex_points: expected the same number of points for every convex")
    return points.reshape(number, per_convex, 3)


def _sizes(settings: Any, points: torch.Tensor, visible: torch.Tensor) -> Tuple[torch.Tensor, torch.Tensor]:
    """For visible convexes, 0 for others: radii int32 [N], 1.1 × the distance of the farthest point from the centre in
    pixels, rounded up (as published, but without the margin of the soft edge); and the largest standard deviation
    along an axis [N]."""
    with torch.no_grad():
        centres = points.mean(dim=1, keepdim=True)
        deviations = (points - centres).square().mean(dim=1).sqrt().amax(dim=1)
        both = torch.cat([centres, points], dim=1)
        projection = settings.projmatrix
        w = both @ projection[:3, 3] + projection[3, 3]
        size = (0.5 * settings.image_width, 0.5 * settings.image_height)
        x, y = [half * (both @ projection[:3, i] + projection[3, i]) / w for i, half in enumerate(size)]
        far = torch.hypot(x[:, 1:] - x[:, :1], y[:, 1:] - y[:, :1]).amax(dim=1)
        seen = visible > 0
        radii = torch.where(seen, (1.1 * far).ceil(), torch.zeros_like(far)).to(torch.int32)
        return torch.maximum(radii, visible), torch.where(seen, deviations, torch.zeros_like(deviations))


class ConvexRasterizer(nn.Module):
    def __init__(self, raster_settings: Any):
        super().__init__()
        self.raster_settings = raster_settings

    def markVisible(self, positions: torch.Tensor) -> torch.Tensor:
        """bool [N]: which positions [N,3] lie beyond the near plane."""
        return _drop_in.visible(self.raster_settings, positions)

    def forward(
        self,
        convex_points: torch.Tensor,
        delta: torch.Tensor,
        sigma: torch.Tensor,
        num_points_per_convex: torch.Tensor,
        cumsum_of_points_per_convex: torch.Tensor,
        number_of_points: int,
        opacities: torch.Tensor,
        means2D: torch.Tensor,
        scaling: torch.Tensor,
        density_factor: torch.Tensor,
        shs: Optional[torch.Tensor] = None,
        colors_precomp: Optional[torch.Tensor] = None,
    ) -> Any:
        """convex_points: points of N convexes concatenated, the same number for each; number_of_points: N;
        delta, sigma, opacities [N,1]; means2D [N,3]; shs [N,K,3] or colors_precomp [N,3]. scaling and density_factor
        are not read."""
        if (shs is None) == (colors_precomp is None):
            raise ValueError("give either shs or colors_precomp")
        settings = self.raster_settings
        for tensor, name in ((convex_points, "convex_points"), (num_points_per_convex, "num_points_per_convex"),
                             (means2D, "means2D")):
            if not isinstance(tensor, torch.Tensor):
                raise ValueError("%s: expected a tensor, got %s" % (name, type(tensor).__name__))
        points = _shaped(convex_points, num_points_per_convex, lib.whole(number_of_points, "number_of_points", 0))
        _drop_in.forget()
        with _drop_in.host_names():
            done = _convexes.rasterize_convexes(
                _drop_in.camera_of(settings), points, delta, sigma, opacities,
                sh=shs, sh_degree=settings.sh_degree, colors=colors_precomp, background=settings.bg,
                beta=_drop_in.get_beta(), released_view_direction=True,
                screen_points=means2D.reshape(-1, 3))
        done.radii, deviations = _sizes(settings, points, done.radii)
        _drop_in.remember(done)
        others = torch.zeros((1, 1, 1), device=points.device).expand((_OTHERS,) + done.color.shape[1:])
        return done.color, done.radii, deviations, torch.zeros_like(deviations), others


def rasterize_convexes(
    convex_points: torch.Tensor,
    delta: torch.Tensor,
    sigma: torch.Tensor,
    num_points_per_convex: torch.Tensor,
    cumsum_of_points_per_convex: torch.Tensor,
    number_of_points: int,
    sh: torch.Tensor,
    colors_precomp: torch.Tensor,
    opacities: torch.Tensor,
    means2D: torch.Tensor,
    scaling: torch.Tensor,
    density_factor: torch.Tensor,
    raster_settings: Any,
) -> Any:
    """ConvexRasterizer as a function; an empty sh or colors_precomp counts as not given."""
    return ConvexRasterizer(raster_settings)(
        convex_points, delta, sigma, num_points_per_convex, cumsum_of_points_per_convex, number_of_points, opacities,
        means2D, scaling, density_factor, _drop_in.given(sh), _drop_in.given(colors_precomp))
