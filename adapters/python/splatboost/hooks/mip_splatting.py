# SPDX-License-Identifier: Apache-2.0
"""Hooks of Mip-Splatting. It accumulates absolute gradients itself, and keeps a 3D filter per Gaussian."""

from __future__ import annotations

import functools

import torch

from . import _boost, _drawing
from ._drawing import rasterizer

__all__ = ["Boost", "load", "rasterizer"]

#: Iterations between the host's renewals of the 3D filter.
_FILTER_INTERVAL = 100


class Boost(_boost.Boost):
    backbone = "mip-splatting"
    gathers_absolute = False

    def _absolute_gradients(self) -> torch.Tensor:
        g = self.gaussians
        return _boost.mean_gradients(g.xyz_gradient_accum_abs, g.denom)

    def _host_clone(self, mask: torch.Tensor, extent: float) -> None:
        grads = mask.float().unsqueeze(1)
        self.gaussians.densify_and_clone(grads, 0.5, torch.zeros_like(grads), 1.0, extent)

    def _host_split(self, mask: torch.Tensor, extent: float) -> None:
        grads = mask.float().unsqueeze(1)
        self.gaussians.densify_and_split(grads, 0.5, torch.zeros_like(grads), 1.0, extent)

    def prune_late(self) -> None:
        super().prune_late()
        # The host renews the filter when Gaussians grow, and every 100 iterations after densify_until_iter. Growth may
        # end earlier here, or pause.
        now, o = self.iteration, self.options
        if (self.on and now % _FILTER_INTERVAL == 0 and now <= o.densify_until_iter
                and now < o.iterations - _FILTER_INTERVAL and not self.grows()):
            self._pruned()

    def _pruned(self) -> None:
        # prune_points does not shrink filter_3D, so the next render would fail.
        self.gaussians.compute_3D_filter(cameras=self._scene.getTrainCameras())


load = functools.partial(_drawing.load, Boost.backbone)
