# SPDX-License-Identifier: Apache-2.0
"""Drop-in for Mip-Splatting's `diff_gaussian_rasterization`: the 2D Mip filter; returns color [3,H,W] and radii int32
[N]. Column 2 of the gradient of means2D is the sum of the absolute ones."""

from __future__ import annotations

from collections import namedtuple
from typing import Any, Dict, Optional, Tuple

import torch

from . import _drop_in

__all__ = ["GaussianRasterizationSettings", "GaussianRasterizer", "rasterize_gaussians"]

# kernel_size: px², the low-pass. subpixel_offset: zeros or None, this rasterizer samples at pixel centres.
GaussianRasterizationSettings = namedtuple(  # type: ignore[misc]
    "GaussianRasterizationSettings", _drop_in.SIZE + ("kernel_size", "subpixel_offset") + _drop_in.VIEW)


#: Of a GPU: whether the offsets of an earlier render held others than zeros, once the event is done.
_asked: Optional[Tuple[torch.Tensor, Any]] = None


def _has_offsets(offset: torch.Tensor) -> bool:
    """Whether there are others than zeros. On a GPU the answer is of an earlier render: nothing waits for it."""
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
            raise ValueError("subpixel_offset: zeros wanted, others given: run without --ray_jitter")
        return {"low_pass": float(self.raster_settings.kernel_size), "compensate_opacity": True, "absolute_sum": True}


rasterize_gaussians = _drop_in.as_function(GaussianRasterizer)
