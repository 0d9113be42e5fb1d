# SPDX-License-Identifier: Apache-2.0
"""Hooks of Mip-Splatting. It accumulates absolute gradients itself, and keeps a 3D filter per Gaussian."""

from __future__ import annotations

import torch

from . import _boost
from ._drawing import load, rasterizer

__all__ = ["Boost", "load", "rasterizer"]


class Boost(_boost.Boost):
    backbone = "mip-splatting"
    gathers_absolute = False

    def _absolute_gradients(self) -> torch.Tensor:
        g = self.gaussians
        return g.xyz_gradient_accum_abs / g.denom.clamp_min(1.0)  # type: ignore[no-any-return]

    def _host_clone(self, mask: torch.Tensor, extent: float) -> None:
        grads = mask.float().unsqueeze(1)
        self.gaussians.densify_and_clone(grads, 0.5, torch.zeros_like(grads), 1.0, extent)

    def _host_split(self, mask: torch.Tensor, extent: float) -> None:
        grads = mask.float().unsqueeze(1)
        self.gaussians.densify_and_split(grads, 0.5, torch.zeros_like(grads), 1.0, extent)

    def _pruned(self) -> None:
        # prune_points does not shrink filter_3D, so the next render would fail.
        self.gaussians.compute_3D_filter(cameras=self._scene.getTrainCameras())
