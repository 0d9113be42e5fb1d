# SPDX-License-Identifier: Apache-2.0
"""Drop-in for the accelerated `diff_gaussian_rasterization` (3dgs_accel, Taming-3DGS): separate `dc`, sparse Adam."""

from __future__ import annotations

from typing import Any, Optional

import torch

from . import _drop_in
from .diff_gaussian_rasterization_2024 import GaussianRasterizationSettings
from .diff_gaussian_rasterization_2024 import GaussianRasterizer as Rasterizer2024

__all__ = ["GaussianRasterizationSettings", "GaussianRasterizer", "SparseGaussianAdam", "rasterize_gaussians"]


def rasterize_gaussians(
    means3D: torch.Tensor,
    means2D: torch.Tensor,
    dc: torch.Tensor,
    sh: torch.Tensor,
    colors_precomp: torch.Tensor,
    opacities: torch.Tensor,
    scales: torch.Tensor,
    rotations: torch.Tensor,
    cov3Ds_precomp: torch.Tensor,
    raster_settings: Any,
) -> Any:
    """Returns color [3,H,W], radii int32 [N], inverse depth [1,H,W]. Omitted arguments: None or an empty tensor."""
    given = _drop_in.given
    return GaussianRasterizer(raster_settings)(
        means3D,
        means2D,
        opacities,
        given(dc),
        given(sh),
        given(colors_precomp),
        given(scales),
        given(rotations),
        given(cov3Ds_precomp),
    )


class GaussianRasterizer(Rasterizer2024):
    def forward(  # type: ignore[override]
        self,
        means3D: torch.Tensor,
        means2D: torch.Tensor,
        opacities: torch.Tensor,
        dc: Optional[torch.Tensor] = None,
        shs: Optional[torch.Tensor] = None,
        colors_precomp: Optional[torch.Tensor] = None,
        scales: Optional[torch.Tensor] = None,
        rotations: Optional[torch.Tensor] = None,
        cov3D_precomp: Optional[torch.Tensor] = None,
    ) -> Any:
        """As in the 2024 layout, with the spherical harmonics in two tensors: dc [N,1,3] and shs [N,K-1,3]."""
        return self.draw(means3D, means2D, opacities, dc=dc, shs=shs, colors_precomp=colors_precomp, scales=scales,
                         rotations=rotations, cov3D_precomp=cov3D_precomp)


class SparseGaussianAdam(torch.optim.Adam):
    """Adam that updates only visible Gaussians: values and moments of the others stay unchanged.

    As the original, it has no bias correction. Each group has one tensor, with one row per Gaussian.
    """

    def __init__(self, params: Any, lr: float, eps: float):
        super().__init__(params=params, lr=lr, eps=eps)

    @torch.no_grad()
    def step(self, visibility: torch.Tensor, N: int) -> None:  # type: ignore[override]
        """visibility: bool [N]."""
        if not isinstance(visibility, torch.Tensor):
            raise ValueError("visibility: expected a tensor, got %s" % type(visibility).__name__)
        if visibility.dtype != torch.bool or tuple(visibility.shape) != (N,):
            raise ValueError(
                "visibility: expected bool [%s], got %s %s"
                % (N, str(visibility.dtype).replace("torch.", ""), list(visibility.shape))
            )
        for group in self.param_groups:
            if len(group["params"]) != 1:
                raise ValueError("SparseGaussianAdam: expected one tensor per group, got %d" % len(group["params"]))
            value = group["params"][0]
            if value.grad is None:  # hosts call this right after growth too, with the number of rows before it
                continue
            if value.shape[:1] != (N,):
                raise ValueError("SparseGaussianAdam: expected tensors of %d rows, got shape %s" % (N, list(value.shape)))
            state = self.state[value]
            if len(state) == 0:
                state["step"] = torch.tensor(0.0)
                state["exp_avg"] = torch.zeros_like(value)
                state["exp_avg_sq"] = torch.zeros_like(value)
            beta1, beta2 = group["betas"]
            # Masks, because indexing would synchronize with the GPU to get the number of rows.
            gradient, first, second = value.grad, state["exp_avg"], state["exp_avg_sq"]
            seen = visibility.reshape((N,) + (1,) * (value.dim() - 1))
            first.copy_(torch.where(seen, (beta1 * first).add_(gradient, alpha=1 - beta1), first))
            second.copy_(torch.where(seen, (beta2 * second).addcmul_(gradient, gradient, value=1 - beta2), second))
            value -= (group["lr"] * first / (second.sqrt() + group["eps"])).masked_fill_(~seen, 0)
