# SPDX-License-Identifier: Apache-2.0
"""Drop-in for Mip-Splatting's `diff_gaussian_rasterization`, with the 2D Mip filter: returns color [3,H,W] and radii
int32 [N]. Column 2 of the gradient of means2D is the sum of the absolute gradients."""

from __future__ import annotations

from collections import namedtuple
from typing import Any, Dict, Optional, Tuple

import torch

from . import _drop_in

__all__ = ["GaussianRasterizationSettings", "GaussianRasterizer", "rasterize_gaussians"]

# kernel_size: low-pass in px². subpixel_offset: must be zeros or None, since this rasterizer samples pixel centres.
GaussianRasterizationSettings = namedtuple(  # type: ignore[misc]
    "GaussianRasterizationSettings", _drop_in.SIZE + ("kernel_size", "subpixel_offset") + _drop_in.VIEW)


#: (answer, event) for a GPU: whether the offsets of an earlier render had nonzero values, valid once the event is done.
_asked: Optional[Tuple[torch.Tensor, Any]] = None


def _has_offsets(offset: torch.Tensor) -> bool:
    """Whether any offset is nonzero. On a GPU the answer is for an earlier render, to avoid synchronizing."""
    global _asked
    if not offset.is_cuda:
        return bool(offset.any())
    found = False
    if _asked is not None and _asked[1].query():
        found, _asked = bool(_asked[0]), None
    if _asked is None:
        answer = torch.empty((), dtype=torch.bool, pin_memory=True)
        answer.copy_(offset.any(), non_blocking=True)
        done = torch.cuda.Event()
        done.record(torch.cuda.current_stream(offset.device))
        _asked = (answer, done)
    return found


class GaussianRasterizer(_drop_in.Drawer):
    def options(self) -> Dict[str, Any]:
        offset = self.raster_settings.subpixel_offset
        if offset is not None and _has_offsets(offset):
            raise ValueError("subpixel_offset: expected zeros, got other values: run without --ray_jitter")
        return {"low_pass": float(self.raster_settings.kernel_size), "compensate_opacity": True, "absolute_sum": True}


rasterize_gaussians = _drop_in.as_function(GaussianRasterizer)
