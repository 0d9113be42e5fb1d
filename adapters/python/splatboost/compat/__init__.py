# SPDX-License-Identifier: Apache-2.0
"""Modules with the names and signatures of the CUDA extensions that 3DGS repositories build.

They render with SplatBoost's rasterizer. `set_beta` selects the box; `last_render` returns the render for counting.
"""

from __future__ import annotations

from ._drop_in import get_beta, last_render, set_beta

__all__ = ["get_beta", "last_render", "set_beta"]
