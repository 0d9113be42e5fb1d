# SPDX-License-Identifier: Apache-2.0
"""Hooks of Gaussian Opacity Fields, which has Mip-Splatting's classes. The host's rasterizer renders, without a compact
box; flagged pixels are counted in an additional render with Mip-Splatting's filter."""

from __future__ import annotations

from typing import Any, Dict, Iterable

from .._rasterize import rasterize
from ..adapter import ScoredView
from . import _drawing, mip_splatting

__all__ = ["Boost"]


class Boost(mip_splatting.Boost):
    def __init__(self, gaussians: Any, scene: Any, options: Any, render: Any, model_path: str,
                 checkpoints: Iterable[int] = (), kernel_size: float = 0.0):
        """kernel_size: px², the host's option of this name"""
        self._low_pass = float(kernel_size)
        super().__init__(gaussians, scene, options, render, model_path, checkpoints)

    def _settings(self) -> Dict[str, Any]:
        return dict(self._host_settings(), tau_d=self.options.boost_tau_d, cb=False)

    def _score(self, camera: Any) -> ScoredView:
        view, g = super()._score(camera), self.gaussians
        view.render = rasterize(
            _drawing.pinhole(camera, view.color), g.get_xyz.detach(), g.get_opacity_with_3D_filter.detach(),
            scales=g.get_scaling_with_3D_filter.detach(), rotations=g.get_rotation.detach(),
            colors=g.get_xyz.detach().clone().zero_(), low_pass=self._low_pass, compensate_opacity=True)
        return view
