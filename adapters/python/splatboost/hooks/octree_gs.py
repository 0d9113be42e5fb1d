# SPDX-License-Identifier: Apache-2.0
"""Hooks of Octree-GS, where a view uses anchors of some levels only, and thresholds rise with the level."""

from __future__ import annotations

import functools
from typing import Any

import torch

from ..adapter import ScoredView
from . import _anchors, _drawing
from ._anchors import gated
from ._drawing import rasterizer, see

__all__ = ["Boost", "gated", "load", "rasterizer", "see"]


class Boost(_anchors.Boost):
    backbone = "octree-gs"

    def _thresholds(self) -> torch.Tensor:
        g = self.gaussians
        steps = torch.as_tensor(g.get_level).reshape(-1).float() * float(self._dataset.update_ratio)
        by_anchor = self.options.densify_grad_threshold * torch.pow(torch.full_like(steps, float(g.fork)), steps)
        return by_anchor.repeat_interleave(g.n_offsets)

    def _score(self, camera: Any) -> ScoredView:
        # The levels that a view uses are state of the host's model.
        self.gaussians.set_anchor_mask(camera.camera_center, self.iteration, camera.resolution_scale)
        return super()._score(camera)


load = functools.partial(_drawing.load, Boost.backbone)
