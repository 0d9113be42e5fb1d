# SPDX-License-Identifier: Apache-2.0
"""Drop-in for `fused_ssim`."""

from __future__ import annotations

from ..operations import fused_ssim

__all__ = ["fused_ssim"]
