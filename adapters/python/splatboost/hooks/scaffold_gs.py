# SPDX-License-Identifier: Apache-2.0
"""Hooks of Scaffold-GS."""

from __future__ import annotations

import functools
from typing import Any

from . import _anchors, _drawing
from ._anchors import gated
from ._drawing import rasterizer, see

__all__ = ["Boost", "gated", "load", "rasterizer", "see"]


class Boost(_anchors.Boost):
    backbone = "scaffold-gs"

    def __init__(self, gaussians: Any, *given: Any):
        self.anchors_per_slot = int(gaussians.update_depth)  # one on each of the host's grids
        super().__init__(gaussians, *given)


load = functools.partial(_drawing.load, Boost.backbone)
