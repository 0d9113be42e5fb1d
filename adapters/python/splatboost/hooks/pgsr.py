# SPDX-License-Identifier: Apache-2.0
"""Hooks of PGSR, whose Gaussians are planes. It keeps its own trim by observing views, and selects growth
candidates by absolute gradients, which it accumulates itself; the candidates are scored as they are."""

from __future__ import annotations

import functools
import sys
from typing import Any, Callable, Dict

import torch

from ..adapter import ScoredView
from . import _boost, _drawing
from ._drawing import rasterizer

__all__ = ["Boost", "as_the_loss_sees", "load", "rasterizer"]


def as_the_loss_sees(render: Callable[..., Any], camera: Any, gaussians: Any, pipe: Any, background: torch.Tensor,
                     app_model: Any) -> torch.Tensor:
    """Renders a camera without planes, with exposure compensation if the host uses it."""
    drawn = render(camera, gaussians, pipe, background, app_model=app_model, return_plane=False, return_depth_normal=False)
    return drawn.get("app_image", drawn["render"])  # type: ignore[no-any-return]


class Boost(_boost.Boost):
    backbone = "pgsr"
    gathers_absolute = False
    # Its own growth candidates apply densify_grad_threshold and percent_dense.
    host_options = {name: known for name, known in _boost.Boost.host_options.items()
                    if name not in ("densify_grad_threshold", "percent_dense")}

    def __init__(self, gaussians: Any, scene: Any, options: Any, *rest: Any):
        if options.boost == "on" and gaussians.get_xyz.shape[0] == 0:
            sys.stderr.write("PGSR begins with no Gaussians: it takes only points that three photos or more saw, and the scene's "
                             "have no such tracks; triangulate them, as colmap point_triangulator does\n")
            sys.exit(2)
        super().__init__(gaussians, scene, options, *rest)

    def _absolute_gradients(self) -> None:  # type: ignore[override]
        return None

    def _own_growth(self, gradients: torch.Tensor, max_scales: torch.Tensor, extent: float) -> Dict[str, torch.Tensor]:
        g, options = self.gaussians, self.options
        growing = gradients.reshape(-1) >= options.densify_grad_threshold
        small = max_scales <= g.percent_dense * extent
        absolute = _boost.mean_gradients(g.xyz_gradient_accum_abs, g.denom_abs).reshape(-1)
        blurred = ((absolute >= options.densify_abs_grad_threshold) & ~growing & ~small
                   & (g.max_radii2D > g.abs_split_radii2D_threshold))
        if int(blurred.sum()) > g.max_abs_split_points:
            most = absolute.masked_fill(~blurred, -1.0).topk(int(g.max_abs_split_points)).indices
            blurred = torch.zeros_like(blurred).index_fill_(0, most, True)
        return {"clone": growing & small, "split": growing & ~small | blurred}

    def _score(self, camera: Any) -> ScoredView:
        # The host's loss covers every pixel, even of photos with a mask.
        return ScoredView(self._render(camera).contiguous(), camera.get_image()[0])

    def _max_primitives(self) -> int:
        own, asked = int(self.gaussians.max_all_points), super()._max_primitives()
        return min(own, asked) if asked > 0 else own

    def _densify_and_prune(self, max_grad: float, abs_max_grad: float, *rest: Any) -> None:  # type: ignore[override]
        super()._densify_and_prune(max_grad, *rest)

    def _grow(self, clone: torch.Tensor, split: torch.Tensor, extent: float) -> torch.Tensor:
        # Disables the host's cap: at the cap its functions would select others, and the masks here respect it already.
        g = self.gaussians
        most, g.max_all_points = g.max_all_points, float("inf")
        try:
            return super()._grow(clone, split, extent)
        finally:
            g.max_all_points = most

    def _host_split(self, mask: torch.Tensor, extent: float) -> None:
        gradients = mask.float().unsqueeze(1)
        none = torch.zeros_like(gradients)
        self.gaussians.densify_and_split(gradients, 0.5, none, 1.0, extent, none, _boost.SPLIT_CHILDREN)

    def _keep(self, kept: torch.Tensor) -> None:
        """No effect: the host prunes its statistics itself."""


load = functools.partial(_drawing.load, Boost.backbone)
