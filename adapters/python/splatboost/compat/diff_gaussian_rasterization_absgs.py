# SPDX-License-Identifier: Apache-2.0
"""Drop-in for AbsGS's `diff_gaussian_rasterization`: returns color, radii and weights [N], which are zeros here."""

from __future__ import annotations

from typing import Any

import torch

from .._render import Render
from . import _drop_in
from .diff_gaussian_rasterization_2023 import GaussianRasterizationSettings

__all__ = ["GaussianRasterizationSettings", "GaussianRasterizer", "rasterize_gaussians"]


class GaussianRasterizer(_drop_in.Drawer):
    def results(self, done: Render) -> Any:
        return done.color, done.radii, torch.zeros_like(done.radii, dtype=torch.float32)


rasterize_gaussians = _drop_in.as_function(GaussianRasterizer)
