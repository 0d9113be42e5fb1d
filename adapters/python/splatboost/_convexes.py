# SPDX-License-Identifier: Apache-2.0
"""The differentiable rasterizer of smooth convexes on tensors."""

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
_NAMES = ("points", "smoothness", "sharpness", "opacities", "sh_dc", "sh_rest", "colors")


@dataclass
class _Call:
    """The arguments of a render that are not tensors, and its lease."""

    camera: Camera
    options: Any
    sh_degree: int
    differentiable: bool
    lease: Optional[Lease] = None


def _convexes(place: Place, tensors: Tensors, sh_degree: int) -> lib.Convexes:
    views = {name: place.view(tensors[name], name) for name in _NAMES}
    return lib.Convexes(sh_degree=sh_degree, **views)


def _draw(place: Place, call: _Call, tensors: Tensors) -> Any:
    """Takes a workspace and renders; returns color and visible."""
    points = tensors["points"]
    assert points is not None
    color = place.empty((3, int(call.camera.height), int(call.camera.width)))
    visible = place.empty((points.shape[0],), torch.uint8)
    outputs = lib.ConvexOutputs(color=place.target(color, "color"), visible=place.target(visible, "visible"))
    convexes = _convexes(place, tensors, call.sh_degree)
    call.lease = draw(
        "sb_convex_rasterizer",
        place,
        ctypes.byref(call.camera.c_struct()),
        ctypes.byref(convexes),
        ctypes.byref(call.options),
        ctypes.byref(outputs),
    )
    return color, visible


class _Rasterize(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, call: _Call, screen_points: Any, sh: Any, *inputs: Any) -> Any:
        tensors = save_inputs(ctx, _NAMES, inputs, sh)
        place = Place(tensors["points"], "points")
        color, visible = _draw(place, call, tensors)
        assert call.lease is not None
        call.lease.pending = call.differentiable and any(ctx.needs_input_grad)
        ctx.call = call
        ctx.mark_non_differentiable(visible)
        return color, visible

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, g_color: Any, _: Any) -> Any:
        call: _Call = ctx.call
        tensors = saved_inputs(ctx, _NAMES)
        points = tensors["points"]
        assert points is not None and call.lease is not None
        place = Place(points, "points")
        if not call.lease.claim():
            _draw(place, call, tensors)

        gradients = new_gradients(ctx, tensors, ctx.needs_input_grad[3:], ctx.needs_input_grad[2])
        g_screen = place.empty((points.shape[0], 3)) if ctx.needs_input_grad[1] else None
        targets = lib.ConvexGradients(
            accumulate=0,
            screen_points=place.target(g_screen, "screen_points"),
            **{name: place.target(gradient, name) for name, gradient in gradients.items()},
        )
        place.call(
            "sb_convex_rasterizer_backward",
            call.lease.workspace.handle,
            ctypes.byref(_convexes(place, tensors, call.sh_degree)),
            place.view(g_color, "gradient of color"),
            None,
            ctypes.byref(targets),
            place.stream,
        )
        call.lease.pending = False
        return (None, g_screen, *returned_gradients(ctx, gradients))


def rasterize_convexes(
    camera: Camera,
    points: torch.Tensor,
    smoothness: torch.Tensor,
    sharpness: torch.Tensor,
    opacities: torch.Tensor,
    *,
    sh: Optional[torch.Tensor] = None,
    sh_degree: int = 0,
    colors: Optional[torch.Tensor] = None,
    background: Union[Sequence[float], torch.Tensor] = (0.0, 0.0, 0.0),
    beta: Optional[float] = None,
    near_plane: float = 0.2,
    pixel_size: float = 1.0,
    released_view_direction: bool = False,
    screen_points: Optional[torch.Tensor] = None,
) -> Render:
    """Renders N smooth convexes of K points each, 3 to 8, differentiable with respect to all of their tensors. All are
    float32, on one device. `radii` of the result is 1 for visible convexes, else 0.

    points         [N,K,3] world
    smoothness     [N,1] or [N] δ, activated
    sharpness      [N,1] or [N] σ, activated
    opacities      [N,1] or [N], activated
    sh             [N,B,3] spherical harmonics of all degrees, or colors [N,3]. sh_degree: the active degree, 0 to 3
    background     color, three numbers; no gradient
    beta           β of the compact box, in (0, 1]; None: the square of the published code
    pixel_size     side of a pixel, in the pixels that δ and σ refer to
    released_view_direction   evaluates spherical harmonics with the published code's bug (convex_rasterizer.h)
    screen_points  [N,3], values are not read: its gradient receives, over the gradients of a convex's projected points
                   in pixels, the sum along x, the sum along y and the sum of both absolute values, as published
    """
    check_camera(camera)
    n = points.shape[0] if isinstance(points, torch.Tensor) and points.dim() > 0 else 0
    check(points, "points", _F32, ("N", "K", 3))
    for tensor, name, shapes in (
        (smoothness, "smoothness", [(n, 1), (n,)]),
        (sharpness, "sharpness", [(n, 1), (n,)]),
        (opacities, "opacities", [(n, 1), (n,)]),
        (sh, "sh", [(n, "K", 3)]),
        (colors, "colors", [(n, 3)]),
        (screen_points, "screen_points", [(n, 3)]),
    ):
        if tensor is not None:
            check(tensor, name, _F32, *shapes)  # type: ignore[arg-type]
    if (sh is None) == (colors is None):
        raise ValueError("give either sh or colors")
    if sh is not None and sh.shape[1] < 1:
        raise ValueError("sh: expected shape [%d,K,3] with K > 0, got %s" % (n, list(sh.shape)))
    options = lib.ConvexOptions(
        box=lib.CONVEX_BOX_SQUARE if beta is None else lib.CONVEX_BOX_COMPACT,
        beta=1.0 if beta is None else lib.number(beta, "beta"),
        near_plane=lib.number(near_plane, "near_plane"),
        pixel_size=lib.number(pixel_size, "pixel_size"),
        released_view_direction=int(released_view_direction),
    )
    options.background[:] = color_of(background)
    if screen_points is not None:
        Place(points, "points").check_here(screen_points, "screen_points")
    call = _Call(camera, options, lib.whole(sh_degree, "sh_degree", 0, 3), torch.is_grad_enabled())
    color, visible = _Rasterize.apply(
        call, screen_points, sh, points, smoothness, sharpness, opacities, None, None, colors
    )
    assert call.lease is not None
    return Render(color, visible.to(torch.int32), None, None, None, call.lease)
