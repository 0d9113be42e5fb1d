# SPDX-License-Identifier: Apache-2.0
"""The core's operations on tensors: errors and losses, scores and selections, neighbours, Adam."""

from __future__ import annotations

import ctypes
from typing import Any, NamedTuple, Optional, Tuple

import torch
from torch.autograd.function import once_differentiable

from . import _library as lib
from ._tensors import Place, check

_F32 = torch.float32


def as_bytes(image: torch.Tensor, name: str = "truth") -> torch.Tensor:
    """Converts an image to uint8 for the scores. float32 in [0, 1] is rounded, which is exact for 8-bit photos."""
    if isinstance(image, torch.Tensor) and image.dtype == torch.uint8:
        return image
    check(image, name, (torch.uint8, _F32), (3, "H", "W"))
    return image.detach().clamp(0, 1).mul(255).round_().to(torch.uint8)


def mask_bytes(valid: Optional[torch.Tensor], h: int, w: int) -> Optional[torch.Tensor]:
    """A mask of valid pixels as uint8; None for None."""
    if valid is None:
        return None
    check(valid, "valid", (torch.bool, torch.uint8), (h, w))
    return valid.view(torch.uint8) if valid.dtype == torch.bool else valid


def _truth(place: Place, truth: torch.Tensor, valid: Optional[torch.Tensor], h: int, w: int) -> lib.Truth:
    truth = as_bytes(truth)
    check(truth, "truth", torch.uint8, (3, h, w))
    return lib.Truth(place.view(truth, "truth"), place.view(mask_bytes(valid, h, w), "valid"))


def flag_errors(
    render: torch.Tensor, truth: torch.Tensor, valid: Optional[torch.Tensor] = None, tau: float = 0.1
) -> Tuple[torch.Tensor, torch.Tensor]:
    """Flags pixels whose min-max normalized error exceeds tau (paper eqs. 6-8).

    render [3,H,W] float32; truth [3,H,W] uint8, or float32 in [0, 1]; valid bool or uint8 [H,W]: valid pixels.
    Returns flagged, bool [H,W], and the error, float32 [H,W].
    """
    check(render, "render", _F32, (3, "H", "W"))
    h, w = int(render.shape[1]), int(render.shape[2])
    place = Place(render, "render")
    error, flagged = place.empty((h, w)), place.empty((h, w), torch.uint8)
    image = _truth(place, truth, valid, h, w)
    place.call(
        "sb_flag_errors",
        place.c_device(),
        place.view(render, "render"),
        ctypes.byref(image),
        lib.number(tau, "tau"),
        place.target(error, "error"),
        place.target(flagged, "flagged"),
        None,
    )
    return flagged.bool(), error


class Loss(NamedTuple):
    """Values of photometric_loss."""

    l1: float
    ssim: float
    total: float


def photometric_loss(
    render: torch.Tensor, truth: torch.Tensor, valid: Optional[torch.Tensor] = None, lambda_dssim: float = 0.2
) -> Loss:
    """View loss (1−λ)·L1 + λ·(1−SSIM) that weights the scores (paper eq. 10); no gradient. Shapes as in flag_errors.

    Returns Python floats, so it synchronizes with the GPU.
    """
    check(render, "render", _F32, (3, "H", "W"))
    place = Place(render, "render")
    image = _truth(place, truth, valid, int(render.shape[1]), int(render.shape[2]))
    loss = lib.Loss()
    place.call(
        "sb_photometric_loss",
        place.c_device(),
        place.view(render, "render"),
        ctypes.byref(image),
        lib.number(lambda_dssim, "lambda_dssim"),
        None,
        ctypes.byref(loss),
    )
    return Loss(loss.l1, loss.ssim, loss.total)


class _Ssim(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, images: torch.Tensor, truths: torch.Tensor, valid_padding: bool, train: bool) -> torch.Tensor:
        place = Place(images, "img1")
        gradient = place.empty(images.shape) if train and ctx.needs_input_grad[0] else None
        mean = place.empty((1,), torch.float64)
        place.call(
            "sb_ssim",
            place.c_device(),
            place.view(images, "img1"),
            place.view(truths, "img2"),
            int(valid_padding),
            place.target(gradient, "gradient"),
            place.target(mean, "mean"),
        )
        if gradient is not None:
            ctx.save_for_backward(gradient)
        return mean[0].to(_F32)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, g_mean: torch.Tensor) -> Any:
        if not ctx.needs_input_grad[0]:
            return None, None, None, None  # only img2 needs one, which gets none
        if not ctx.saved_tensors:
            raise RuntimeError("fused_ssim: called with train=False, so there is no gradient")
        return ctx.saved_tensors[0] * g_mean, None, None, None


def fused_ssim(img1: torch.Tensor, img2: torch.Tensor, padding: str = "same", train: bool = True) -> torch.Tensor:
    """Mean SSIM (11×11 Gaussian window, σ 1.5) of float32 [B,C,H,W]; the gradient goes to img1 only.

    padding: "same" (zeros around the image) or "valid" (only windows within it). train=False: value only.
    """
    if padding not in ("same", "valid"):
        raise ValueError('padding: expected "same" or "valid", got %r' % (padding,))
    check(img1, "img1", _F32, ("B", "C", "H", "W"))
    check(img2, "img2", _F32, tuple(img1.shape))
    result: torch.Tensor = _Ssim.apply(img1, img2, padding == "valid", train)
    return result


def importance_scores(counts: torch.Tensor, views: int) -> torch.Tensor:
    """s⁺, int64 [N] (paper eq. 9). counts: int64 [N], flagged pixels summed over the views."""
    check(counts, "counts", torch.int64, ("N",))
    place = Place(counts, "counts")
    scores = torch.empty_like(counts, memory_format=torch.contiguous_format)
    place.call(
        "sb_importance_scores", place.c_device(), place.view(counts, "counts"), lib.whole(views, "views"), place.target(scores, "scores")
    )
    return scores


def pruning_scores(weighted_counts: torch.Tensor) -> torch.Tensor:
    """s⁻, float32 [N] in [0, 1] (paper eq. 11). weighted_counts: float64 [N], Σ_j E_j·n_ij."""
    check(weighted_counts, "weighted_counts", torch.float64, ("N",))
    place = Place(weighted_counts, "weighted_counts")
    scores = place.empty(weighted_counts.shape)
    place.call(
        "sb_pruning_scores",
        place.c_device(),
        place.view(weighted_counts, "weighted_counts"),
        place.target(scores, "scores"),
    )
    return scores


def _mask(candidates: torch.Tensor, name: str, n: int) -> torch.Tensor:
    check(candidates, name, torch.bool, (n,))
    return candidates.to(torch.uint8)


def _count(value: int, name: str) -> int:
    return lib.whole(value, name, -(2**63), 2**63 - 1)


def keep_important(importance: torch.Tensor, threshold: float, candidates: torch.Tensor) -> torch.Tensor:
    """bool [N]: the candidates (bool [N]) whose importance (int64 [N]) exceeds the threshold."""
    check(importance, "importance", torch.int64, ("N",))
    place, kept = Place(importance, "importance"), _mask(candidates, "candidates", importance.shape[0])
    place.call(
        "sb_keep_important",
        place.c_device(),
        place.view(importance, "importance"),
        lib.number(threshold, "threshold"),
        place.target(kept, "candidates"),
        None,
    )
    return kept.bool()


def keep_weighted_sample(
    weights: torch.Tensor, keep: int, candidates: torch.Tensor, *, seed: int = 0, iteration: int = 0
) -> torch.Tensor:
    """bool [N]: `keep` of the candidates (bool [N]), drawn without replacement by weight (float32 [N])."""
    check(weights, "weights", _F32, ("N",))
    place, kept = Place(weights, "weights"), _mask(candidates, "candidates", weights.shape[0])
    place.call(
        "sb_keep_weighted_sample",
        place.c_device(),
        place.view(weights, "weights"),
        _count(keep, "keep"),
        lib.whole(seed, "seed", *lib.SEEDS),
        lib.whole(iteration, "iteration", *lib.SEEDS),
        place.target(kept, "candidates"),
    )
    return kept.bool()


def keep_largest(priorities: torch.Tensor, keep: int, candidates: torch.Tensor) -> torch.Tensor:
    """bool [N]: the `keep` candidates (bool [N]) with the largest priority (float32 [N]); ties: lower index."""
    check(priorities, "priorities", _F32, ("N",))
    place, kept = Place(priorities, "priorities"), _mask(candidates, "candidates", priorities.shape[0])
    place.call(
        "sb_keep_largest",
        place.c_device(),
        place.view(priorities, "priorities"),
        _count(keep, "keep"),
        place.target(kept, "candidates"),
    )
    return kept.bool()


def spare_one(priorities: torch.Tensor, removals: torch.Tensor) -> torch.Tensor:
    """bool [N]: the removals (bool [N]); if these are all, that of the largest priority (float32 [N]) is kept."""
    check(priorities, "priorities", _F32, ("N",))
    place, kept = Place(priorities, "priorities"), _mask(removals, "removals", priorities.shape[0])
    place.call(
        "sb_spare_one", place.c_device(), place.view(priorities, "priorities"), place.target(kept, "removals"), None
    )
    return kept.bool()


def mean_squared_neighbor_distances(points: torch.Tensor, k: int = 3) -> torch.Tensor:
    """float32 [N]: mean squared distance of each point (float32 [N,3]) to its k nearest others."""
    check(points, "points", _F32, ("N", 3))
    place = Place(points, "points")
    distances = place.empty((points.shape[0],))
    place.call(
        "sb_mean_squared_neighbor_distances",
        place.c_device(),
        place.view(points, "points"),
        lib.whole(k, "k"),
        place.target(distances, "distances"),
    )
    return distances


def distances_to_scene(centres: torch.Tensor, points: torch.Tensor) -> torch.Tensor:
    """float32 [C]: distances of cameras to the nearest points of the scene; max(10, M / max(1000, 10 C)) points may be
    nearer, because some may be wrong. 0 if the points fill their bounding box evenly, as if drawn at random, or are fewer than
    64: then they show no surface. Computed on the host.

    centres  float32 [C,3] of all training cameras
    points   float32 [M,3] of the scene before training, such as those of structure from motion
    """
    check(centres, "centres", _F32, ("C", 3))
    check(points, "points", _F32, ("M", 3))
    place = Place(centres, "centres")
    distances = place.empty((centres.shape[0],))
    place.call(
        "sb_distances_to_scene",
        place.c_device(),
        place.view(centres, "centres"),
        place.view(points, "points"),
        place.target(distances, "distances"),
    )
    return distances


def camera_clearances(means: torch.Tensor, centres: torch.Tensor, distances: torch.Tensor) -> torch.Tensor:
    """float32 [N]: distance of each Gaussian from the nearest camera, relative to that camera's from the scene.

    means      float32 [N,3]
    centres    float32 [C,3] of the cameras
    distances  float32 [C] of distances_to_scene(); cameras at distance 0 are left out
    """
    check(means, "means", _F32, ("N", 3))
    check(centres, "centres", _F32, ("C", 3))
    check(distances, "distances", _F32, (centres.shape[0],))
    place = Place(means, "means")
    clearances = place.empty((means.shape[0],))
    place.call(
        "sb_camera_clearances",
        place.c_device(),
        place.view(means, "means"),
        place.view(centres, "centres"),
        place.view(distances, "distances"),
        place.target(clearances, "clearances"),
    )
    return clearances


def adam_step(
    values: torch.Tensor,
    gradients: torch.Tensor,
    first_moments: torch.Tensor,
    second_moments: torch.Tensor,
    step: int,
    *,
    lr: float = 1e-3,
    betas: Tuple[float, float] = (0.9, 0.999),
    eps: float = 1e-15,
) -> None:
    """One Adam step in place, as in torch.optim.Adam; the gradients are zeroed.

    All tensors are float32, contiguous, of one shape (1 to 4 dimensions). step: number of this step, from 1.
    """
    place = Place(values, "values")
    check(values, "values", _F32, tuple(values.shape))
    for tensor, name in (
        (gradients, "gradients"),
        (first_moments, "first_moments"),
        (second_moments, "second_moments"),
    ):
        check(tensor, name, _F32, tuple(values.shape))
    if not isinstance(betas, (tuple, list)) or len(betas) != 2:
        raise ValueError("betas: expected two numbers, got %s" % lib.shown(betas))
    options = lib.AdamOptions(lib.number(lr, "lr"), *[lib.number(b, "betas") for b in betas], lib.number(eps, "eps"))
    place.call(
        "sb_adam_step",
        place.c_device(),
        place.target(values, "values"),
        place.target(gradients, "gradients"),
        place.target(first_moments, "first_moments"),
        place.target(second_moments, "second_moments"),
        _count(step, "step"),
        ctypes.byref(options),
    )
