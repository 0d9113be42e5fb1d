# SPDX-License-Identifier: Apache-2.0
"""Hooks of AbsGS. It accumulates absolute gradients, reduces opacities periodically, and may prune by weights."""

from __future__ import annotations

import functools
import sys
from typing import Any, Callable

import torch

from . import _boost, _drawing

__all__ = ["Boost", "load", "rasterizer"]


def rasterizer(model: Any, host: Any) -> Callable[..., Any]:
    """As for other hosts, with weights as a third result."""
    return _drawing.rasterizer(model, host, weights=True)


class Boost(_boost.Boost):
    gathers_absolute = False
    # AbsGS splits smaller Gaussians than 3DGS does.
    host_options = {**_boost.Boost.host_options, "densify_grad_abs_threshold": ("gradient_abs_threshold", 0.0004),
                    "percent_dense": ("percent_dense", 0.001)}

    def __init__(self, gaussians: Any, scene: Any, options: Any, *rest: Any):
        if options.boost == "on" and options.use_prune_weight:
            sys.stderr.write("--use_prune_weight: needs the blending weights that the host's rasterizer returns, and SplatBoost's "
                             "does not; leave it out, or train with --boost off\n")
            sys.exit(2)
        if options.boost == "on" and gaussians.get_xyz.shape[0] == 0:
            sys.stderr.write("AbsGS begins with no Gaussians: it takes only points that three photos or more saw, with an error of at "
                             "most 2 pixels, and the scene has none; triangulate them, as colmap point_triangulator does, and remove "
                             "the host's points3D.ply, which it would read again\n")
            sys.exit(2)
        super().__init__(gaussians, scene, options, *rest)

    def _absolute_gradients(self) -> torch.Tensor:
        g = self.gaussians
        return _boost.mean_gradients(g.xyz_gradient_accum_abs, g.denom)

    def _densify_and_prune(self, max_grad: float, max_grad_abs: float, *rest: Any) -> None:  # type: ignore[override]
        super()._densify_and_prune(max_grad, *rest)

    def reduce_opacity(self) -> None:
        """The host's own, after applying accumulated gradients: it replaces the opacities."""
        if self.on:
            self._apply_gradients()
        self.gaussians.reduce_opacity()


load = functools.partial(_drawing.load, Boost.backbone)
