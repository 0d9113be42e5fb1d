# SPDX-License-Identifier: Apache-2.0
"""Hooks of 3D Gaussian Splatting, in all its layouts."""

from __future__ import annotations

import functools

from . import _drawing
from ._boost import Boost
from ._drawing import rasterizer

__all__ = ["Boost", "load", "rasterizer"]

load = functools.partial(_drawing.load, Boost.backbone)
