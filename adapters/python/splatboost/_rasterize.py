# SPDX-License-Identifier: Apache-2.0
"""The differentiable rasterizer on tensors."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from typing import Any, Optional, Sequence, Union

import torch
from torch.autograd.function import once_differentiable

from . import _library as lib
from ._render import Lease, Render, Tensors, draw, new_gradients, returned_gradients, save_inputs, saved_inputs
from ._tensors import Place, check
from .camera import Camera, check_camera, color_of

_F32 = torch.float32


@dataclass
class _Call:
    """The arguments of a render that are not tensors, and its lease."""

    camera: Camera
    options: Any
    sh_degree: int
    inverse_depth: bool
    alpha: bool
    absolute_sum: bool
    differentiable: bool
    lease: Optional[Lease] = None


_NAMES = ("means", "opacities", "scales", "rotations", "covariances", "sh_dc", "sh_rest", "colors", "features")


def _gaussians(place: Place, tensors: Tensors, sh_degree: int) -> lib.Gaussians:
    gaussians = lib.Gaussians()
    for name in _NAMES:
        setattr(gaussians, name, place.view(tensors[name], name))
    gaussians.sh_degree = sh_degree
    return gaussians


def _draw(place: Place, call: _Call, tensors: Tensors) -> Tensors:
    """Takes a workspace and renders into new images."""
    means, features = tensors["means"], tensors["features"]
    assert means is not None
    h, w, n = int(call.camera.height), int(call.camera.width), means.shape[0]
    images: Tensors = {
        "color": place.empty((3, h, w)),
        "features": None if features is None else place.empty((features.shape[1], h, w)),
        "inverse_depth": place.empty((1, h, w)) if call.inverse_depth else None,
        "alpha": place.empty((1, h, w)) if call.alpha else None,
        "radii": place.empty((n,), torch.int32),
    }
    outputs = lib.RasterOutputs(**{name: place.target(image, name) for name, image in images.items()})
    gaussians = _gaussians(place, tensors, call.sh_degree)
    call.lease = draw(
        "sb_rasterizer",
        place,
        ctypes.byref(call.camera.c_struct()),
        ctypes.byref(gaussians),
        ctypes.byref(call.options),
        ctypes.byref(outputs),
    )
    return images


class _Rasterize(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, call: _Call, screen_points: Any, sh: Any, *inputs: Any) -> Any:
        tensors = save_inputs(ctx, _NAMES, inputs, sh)
        place = Place(tensors["means"], "means")
        images = _draw(place, call, tensors)
        assert call.lease is not None
        pending = call.differentiable and any(ctx.needs_input_grad)
        try:
            if not pending:  # scores and evaluation need every splat; training does not, and does not wait
                place.call("sb_rasterizer_settle", call.lease.workspace.handle, None, place.stream)
        finally:
            call.lease.pending = pending
        ctx.call = call
        ctx.screen_points = None if screen_points is None else screen_points.shape[1]
        ctx.mark_non_differentiable(images["radii"])
        ctx.set_materialize_grads(False)
        return images["color"], images["radii"], images["features"], images["inverse_depth"], images["alpha"]

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, g_color: Any, _: Any, g_features: Any, g_inverse_depth: Any, g_alpha: Any) -> Any:
        call: _Call = ctx.call
        tensors = saved_inputs(ctx, _NAMES)
        means = tensors["means"]
        assert means is not None and call.lease is not None
        place = Place(means, "means")
        if not call.lease.claim():
            _draw(place, call, tensors)

        gradients = new_gradients(ctx, tensors, ctx.needs_input_grad[3:], ctx.needs_input_grad[2])
        n = means.shape[0]
        wants_screen = ctx.screen_points is not None and ctx.needs_input_grad[1]
        wants_absolute = wants_screen and (ctx.screen_points == 4 or call.absolute_sum)
        screen = place.empty((n, 2)) if wants_screen else None
        absolute = place.empty((n, 2)) if wants_absolute else None

        image_gradients = lib.ImageGradients(
            color=place.view(g_color, "gradient of color"),
            features=place.view(g_features, "gradient of features"),
            inverse_depth=place.view(g_inverse_depth, "gradient of inverse_depth"),
            alpha=place.view(g_alpha, "gradient of alpha"),
        )
        targets = lib.GaussianGradients(
            accumulate=0,
            screen_means=place.target(screen, "screen_means"),
            screen_means_abs=place.target(absolute, "screen_means_abs"),
            **{name: place.target(gradient, name) for name, gradient in gradients.items()},
        )
        gaussians = _gaussians(place, tensors, call.sh_degree)
        place.call(
            "sb_rasterizer_backward",
            call.lease.workspace.handle,
            ctypes.byref(gaussians),
            ctypes.byref(image_gradients),
            ctypes.byref(targets),
            place.stream,
        )
        call.lease.pending = False

        g_screen = None
        if screen is not None:
            # From pixels to 3DGS's NDC units.
            g_screen = torch.zeros((n, ctx.screen_points), device=place.device)
            for axis, half in enumerate((0.5 * call.camera.width, 0.5 * call.camera.height)):
                torch.mul(screen[:, axis], half, out=g_screen[:, axis])
                if absolute is not None and ctx.screen_points == 4:
                    torch.mul(absolute[:, axis], half, out=g_screen[:, 2 + axis])
                elif absolute is not None:
                    g_screen[:, 2] += absolute[:, axis] * half
        return (None, g_screen, *returned_gradients(ctx, gradients))


def rasterize(
    camera: Camera,
    means: torch.Tensor,
    opacities: torch.Tensor,
    *,
    scales: Optional[torch.Tensor] = None,
    rotations: Optional[torch.Tensor] = None,
    covariances: Optional[torch.Tensor] = None,
    sh: Optional[torch.Tensor] = None,
    sh_dc: Optional[torch.Tensor] = None,
    sh_rest: Optional[torch.Tensor] = None,
    sh_degree: int = 0,
    colors: Optional[torch.Tensor] = None,
    features: Optional[torch.Tensor] = None,
    background: Union[Sequence[float], torch.Tensor] = (0.0, 0.0, 0.0),
    beta: Optional[float] = None,
    low_pass: float = 0.3,
    compensate_opacity: bool = False,
    near_plane: float = 0.2,
    inverse_depth: bool = False,
    alpha: bool = False,
    screen_points: Optional[torch.Tensor] = None,
    absolute_sum: bool = False,
) -> Render:
    """Renders N Gaussians, differentiable with respect to all of their tensors. All are float32, on one device.

    means          [N,3] world
    opacities      [N,1] or [N], activated
    scales         [N,3] standard deviations, with rotations [N,4], quaternions (w,x,y,z) of any length;
                   or covariances [N,6]: xx xy xz yy yz zz
    sh             [N,K,3] spherical harmonics of all degrees; or sh_dc [N,1,3] or [N,3], with sh_rest [N,K-1,3];
                   or colors [N,3]. sh_degree: the active degree, 0 to 3
    features       [N,F] extra channels to blend, F <= 8, over a background of zero
    background     color, three numbers; no gradient
    beta           β of the compact box, in (0, 1]; None: 3DGS's 3σ square
    low_pass       variance in px² added to both axes of a splat
    compensate_opacity   opacity × sqrt(det Σ / det(Σ + low_pass)): 3DGS's antialiasing, Mip-Splatting's 2D filter
    inverse_depth, alpha  whether to render them
    screen_points  [N,3] or [N,4], values are not read: its gradient receives that of the projected means, in NDC units
                   as in 3DGS. With 4 columns, columns 2 and 3 are the sums over pixels of the absolute gradients along
                   x and y (AbsGS). With 3, column 2 is 0, or the sum of both with absolute_sum (Mip-Splatting)
    """
    check_camera(camera)
    n = means.shape[0] if isinstance(means, torch.Tensor) and means.dim() > 0 else 0
    check(means, "means", _F32, ("N", 3))
    check(opacities, "opacities", _F32, (n, 1), (n,))
    for tensor, name, shapes in (
        (scales, "scales", [(n, 3)]),
        (rotations, "rotations", [(n, 4)]),
        (covariances, "covariances", [(n, 6)]),
        (sh, "sh", [(n, "K", 3)]),
        (sh_dc, "sh_dc", [(n, 1, 3), (n, 3)]),
        (sh_rest, "sh_rest", [(n, "K-1", 3)]),
        (colors, "colors", [(n, 3)]),
        (features, "features", [(n, "F")]),
        (screen_points, "screen_points", [(n, 3), (n, 4)]),
    ):
        if tensor is not None:
            check(tensor, name, _F32, *shapes)  # type: ignore[arg-type]
    if (scales is None) != (rotations is None) or (scales is None) == (covariances is None):
        raise ValueError("give either scales and rotations, or covariances")
    if (sh is not None) + (sh_dc is not None) + (colors is not None) != 1:
        raise ValueError("give either sh, or sh_dc (with sh_rest), or colors")
    if sh_rest is not None and sh_dc is None:
        raise ValueError("sh_rest needs sh_dc")
    if sh is not None and sh.shape[1] < 1:
        raise ValueError("sh: expected shape [%d,K,3] with K > 0, got %s" % (n, list(sh.shape)))

    options = lib.RasterOptions(
        lib.BOX_SQUARE if beta is None else lib.BOX_ELLIPSE,
        1.0 if beta is None else lib.number(beta, "beta"),
        lib.number(low_pass, "low_pass"),
        lib.whole(compensate_opacity, "compensate_opacity", 0, 1),
        lib.number(near_plane, "near_plane"),
    )
    options.background[:] = color_of(background)
    place = Place(means, "means")
    for tensor, name in ((opacities, "opacities"), (screen_points, "screen_points")):
        if tensor is not None:
            place.check_here(tensor, name)
    sh_degree = lib.whole(sh_degree, "sh_degree", 0, 3)
    call = _Call(camera, options, sh_degree, inverse_depth, alpha, absolute_sum, torch.is_grad_enabled())
    color, radii, drawn_features, depth, drawn_alpha = _Rasterize.apply(
        call, screen_points, sh, means, opacities, scales, rotations, covariances, sh_dc, sh_rest, colors, features
    )
    assert call.lease is not None
    return Render(color, radii, drawn_features, depth, drawn_alpha, call.lease)


def mark_visible(camera: Camera, means: torch.Tensor, near_plane: float = 0.2) -> torch.Tensor:
    """bool [N]: which means [N,3] lie beyond the near plane, as 3DGS's markVisible."""
    check_camera(camera)
    check(means, "means", _F32, ("N", 3))
    place = Place(means, "means")
    visible = place.empty((means.shape[0],), torch.uint8)
    place.call(
        "sb_mark_visible",
        place.c_device(),
        ctypes.byref(camera.c_struct()),
        place.view(means, "means"),
        lib.number(near_plane, "near_plane"),
        place.target(visible, "visible"),
    )
    return visible.bool()


def visible_radii(
    camera: Camera,
    means: torch.Tensor,
    *,
    scales: Optional[torch.Tensor] = None,
    rotations: Optional[torch.Tensor] = None,
    covariances: Optional[torch.Tensor] = None,
    low_pass: float = 0.3,
    near_plane: float = 0.2,
) -> torch.Tensor:
    """int32 [N] radii in px of the 3σ squares that overlap the image, 0 for others (visible_filter); no rendering."""
    check_camera(camera)
    check(means, "means", _F32, ("N", 3))
    n = means.shape[0]
    for tensor, name, width in ((scales, "scales", 3), (rotations, "rotations", 4), (covariances, "covariances", 6)):
        if tensor is not None:
            check(tensor, name, _F32, (n, width))
    place = Place(means, "means")
    radii = place.empty((n,), torch.int32)
    tensors: Tensors = dict.fromkeys(_NAMES)
    tensors.update(means=means, scales=scales, rotations=rotations, covariances=covariances)
    options = lib.RasterOptions(
        lib.BOX_SQUARE, 1.0, lib.number(low_pass, "low_pass"), 0, lib.number(near_plane, "near_plane")
    )
    place.call(
        "sb_visible_radii",
        place.c_device(),
        ctypes.byref(camera.c_struct()),
        ctypes.byref(_gaussians(place, tensors, 0)),
        ctypes.byref(options),
        place.target(radii, "radii"),
    )
    return radii
