# SPDX-License-Identifier: Apache-2.0
"""Hooks of Deformable-3DGS, whose Gaussians are moved by a network. Its branch main accumulates absolute gradients
itself, instead of signed ones; its branch paper accumulates signed ones, as 3DGS does."""

from __future__ import annotations

import functools
from typing import Any, Callable, Dict

import torch

from . import _boost, _drawing

__all__ = ["Boost", "BoostOfPaper", "at_its_time", "load", "rasterizer"]

#: The host's rasterizer returns depth, not inverse depth.
rasterizer = functools.partial(_drawing.rasterizer, plain_depth=True)


def at_its_time(render: Callable[..., Any], camera: Any, gaussians: Any, pipe: Any, background: torch.Tensor,
                deform: Any, moves: bool, is_6dof: bool) -> torch.Tensor:
    """Renders a camera with the Gaussians moved to its time.

    moves: whether the host's warm-up is over, so that the network is used
    """
    means = gaussians.get_xyz.detach()
    away = camera.fid.device != means.device  # --load2gpu_on_the_fly
    if away:
        camera.load2device()
    deltas = (0.0, 0.0, 0.0)
    if moves:
        deltas = deform.step(means, camera.fid.unsqueeze(0).expand(means.shape[0], -1))
    image: torch.Tensor = render(camera, gaussians, pipe, background, *deltas, is_6dof)["render"]
    if away:
        camera.load2device("cpu")
    return image


class BoostOfPaper(_boost.Boost):
    """For the branch paper, which grows as 3DGS does."""

    backbone = "deformable-3dgs"
    published_iterations = 40000
    averages = False  # the network has an optimizer of its own

    def _settings(self) -> Dict[str, Any]:
        return dict(super()._settings(), absgrad=True)


class Boost(_boost.Boost):
    """For the branch main, which selects growth candidates by absolute gradients; these are scored as they are."""

    backbone = BoostOfPaper.backbone
    published_iterations = BoostOfPaper.published_iterations
    averages = False
    # Its own growth candidates apply densify_grad_threshold and percent_dense.
    host_options = {name: known for name, known in _boost.Boost.host_options.items()
                    if name not in ("densify_grad_threshold", "percent_dense")}
    gathers_absolute = False

    def _settings(self) -> Dict[str, Any]:
        return dict(super()._settings(), absgrad=False)

    def _absolute_gradients(self) -> None:  # type: ignore[override]
        return None

    def _own_growth(self, gradients: torch.Tensor, max_scales: torch.Tensor, extent: float) -> Dict[str, torch.Tensor]:
        growing = gradients.reshape(-1) >= self.options.densify_grad_threshold
        small = max_scales <= self.gaussians.percent_dense * extent
        return {"clone": growing & small, "split": growing & ~small}


load = functools.partial(_drawing.load, Boost.backbone)
