# SPDX-License-Identifier: Apache-2.0
"""Hooks of 3D Gaussian Splatting, in all its layouts."""

from __future__ import annotations

from ._boost import Boost
from ._drawing import load, rasterizer

__all__ = ["Boost", "load", "rasterizer"]
