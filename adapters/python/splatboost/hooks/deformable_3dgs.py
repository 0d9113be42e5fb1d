# SPDX-License-Identifier: Apache-2.0
"""Hooks of Deformable-3DGS, whose Gaussians a net moves. Its branch main gathers absolute gradients itself, in place of
signed ones; its branch paper signed ones, as 3DGS does."""

from __future__ import annotations

import functools
from typing import Any, Callable

import torch

from . import _boost, _drawing
from ._drawing import load

__all__ = ["Boost", "BoostOfPaper", "at_its_time", "load", "rasterizer"]

#: The host's rasterizer returns a depth that is not inverse.
rasterizer = functools.partial(_drawing.rasterizer, plain_depth=True)


def at_its_time(render: Callable[..., Any], camera: Any, gaussians: Any, pipe: Any, background: torch.Tensor,
                deform: Any, moves: bool, is_6dof: bool) -> torch.Tensor:
    """The image of a camera whose Gaussians are moved to its own time.

    moves: whether the host's warm-up is over
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
    """Of the branch paper."""

    backbone = "deformable-3dgs"
    published_iterations = 40000


class Boost(BoostOfPaper):
    """Of the branch main."""

    host_options = {**_boost.Boost.host_options,
                    "densify_grad_threshold": ("gradient_abs_threshold", 0.0007)}

    def _restart_statistics(self) -> None:
        super()._restart_statistics()
        self._signed = torch.zeros_like(self._absolute)

    def _gather(self, viewspace_points: torch.Tensor, seen: torch.Tensor) -> None:
        """viewspace_points: those whose gradients are absolute, which the host gathers."""
        super()._gather(viewspace_points, seen)
        gradients = self.gaussians.splatboost.screen_points.grad
        self._signed += torch.norm(gradients[:, :2], dim=-1, keepdim=True).masked_fill_(~seen.reshape(-1, 1), 0)

    def _signed_gradients(self) -> torch.Tensor:
        return self._signed / self._seen.clamp_min(1.0)

    def _keep(self, kept: torch.Tensor) -> None:
        super()._keep(kept)
        self._signed = self._signed[kept]
