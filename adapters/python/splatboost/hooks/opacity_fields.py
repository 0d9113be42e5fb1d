# SPDX-License-Identifier: Apache-2.0
"""Hooks of Gaussian Opacity Fields, which has Mip-Splatting's classes. The host's rasterizer renders, without a compact
box; flagged pixels are counted in an additional render with Mip-Splatting's filter."""

from __future__ import annotations

from typing import Any, Callable, Dict, Iterable, Optional

import torch

from .._rasterize import rasterize
from ..adapter import ScoredView
from . import _drawing, mip_splatting

__all__ = ["Boost", "as_the_loss_sees"]

#: Size of the cells that the host's appearance network gives factors to, px.
_CELL = 32


def as_the_loss_sees(image: torch.Tensor, camera: Any, gaussians: Any, appearance: Optional[Callable[..., torch.Tensor]]) -> torch.Tensor:
    """The render with the host's factors for the photo's appearance.

    appearance  the host's function for whole cells, or None if the host does not use it. What does not fill a cell at the
                borders has no factors.
    """
    height, width = (n // _CELL * _CELL for n in image.shape[-2:])
    if appearance is None or height == 0 or width == 0:
        return image
    top, left = image.shape[-2] // 2 - height // 2, image.shape[-1] // 2 - width // 2
    rows, columns = slice(top, top + height), slice(left, left + width)
    inner = image[:, rows, columns]
    image = image.clone()
    image[:, rows, columns] = appearance(inner, inner, gaussians, camera.idx, return_transformed_image=True)
    return image


class Boost(mip_splatting.Boost):
    def __init__(self, gaussians: Any, scene: Any, options: Any, render: Any, model_path: str,
                 checkpoints: Iterable[int] = (), kernel_size: float = 0.0):
        """kernel_size: px², the host's option of this name"""
        self._low_pass = float(kernel_size)
        super().__init__(gaussians, scene, options, render, model_path, checkpoints)

    def _settings(self) -> Dict[str, Any]:
        return dict(self._host_settings(), tau_d=self.options.boost_tau_d, cb=False)

    def steps(self, group: str) -> bool:
        """The network of the photos' appearance shares the optimizer, but steps every iteration."""
        return group.startswith("appearance") or super().steps(group)

    def _score(self, camera: Any) -> ScoredView:
        view, g = super()._score(camera), self.gaussians
        view.render = rasterize(
            _drawing.pinhole(camera, view.color), g.get_xyz.detach(), g.get_opacity_with_3D_filter.detach(),
            scales=g.get_scaling_with_3D_filter.detach(), rotations=g.get_rotation.detach(),
            colors=g.get_xyz.detach().clone().zero_(), low_pass=self._low_pass, compensate_opacity=True)
        return view
