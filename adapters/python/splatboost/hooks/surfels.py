# SPDX-License-Identifier: Apache-2.0
"""Hooks of 2D Gaussian Splatting. The host's rasterizer renders, without a compact box and without absolute gradients;
flagged pixels are counted in an additional render of the surfels as flat Gaussians."""

from __future__ import annotations

from typing import Any, Dict

import torch

from .._rasterize import rasterize
from ..adapter import ScoredView
from ..compat.diff_surfel_rasterization import flat
from . import _boost, _drawing

__all__ = ["Boost"]


class Boost(_boost.Boost):
    gathers_absolute = False

    def _settings(self) -> Dict[str, Any]:
        return dict(self._host_settings(), tau_d=self.options.boost_tau_d, cb=False, absgrad=False)

    def _absolute_gradients(self) -> None:  # type: ignore[override]
        return None

    def _own_growth(self, gradients: torch.Tensor, max_scales: torch.Tensor, extent: float) -> Dict[str, torch.Tensor]:
        large = gradients.reshape(-1) >= self.adapter.settings["gradient_threshold"]
        small = max_scales <= self.gaussians.percent_dense * extent
        return {"clone": large & small, "split": large & ~small}

    def _score(self, camera: Any) -> ScoredView:
        view, g = super()._score(camera), self.gaussians
        view.render = rasterize(_drawing.pinhole(camera, view.color), g.get_xyz.detach(), g.get_opacity.detach(),
                                scales=flat(g.get_scaling.detach()), rotations=g.get_rotation.detach(),
                                colors=g.get_xyz.detach().clone().zero_())
        return view
