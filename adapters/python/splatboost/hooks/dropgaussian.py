# SPDX-License-Identifier: Apache-2.0
"""Hooks of DropGaussian, whose training renders leave out random Gaussians."""

from __future__ import annotations

import functools

from . import _boost, _drawing
from ._drawing import rasterizer

__all__ = ["Boost", "load", "rasterizer"]

#: The host's dropout rate grows linearly and reaches _RATE at iteration _RATE_AT, whatever the length of the run.
_RATE, _RATE_AT = 0.2, 10000


class Boost(_boost.Boost):
    backbone = "dropgaussian"
    published_iterations = 10000
    host_options = {**_boost.Boost.host_options, "densify_until_iter": ("densify_until", 10000),
                    "densify_grad_threshold": ("gradient_threshold", 0.0005)}

    def _views_of_one(self) -> float:
        # With 3DGS's square, a dropped Gaussian counts as seen, without a gradient. The compact box does not list it,
        # so each view in which it is kept also counts for those in which it is dropped.
        if self.adapter.beta is None:
            return 1.0
        return 1.0 / (1.0 - _RATE * self.iteration / _RATE_AT)


load = functools.partial(_drawing.load, Boost.backbone)
