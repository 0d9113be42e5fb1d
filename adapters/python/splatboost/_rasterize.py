# SPDX-License-Identifier: Apache-2.0
"""The differentiable rasterizer on tensors."""

from __future__ import annotations

import ctypes
import threading
import weakref
from dataclasses import dataclass
from typing import Any, Dict, List, Optional, Sequence, Tuple, Union

import torch
from torch.autograd.function import once_differentiable

from . import _library as lib
from ._tensors import Place, check
from .camera import Camera, host_rows

_F32 = torch.float32


class _Lease:
    """A render's claim on the workspace that holds its tile lists.

    A workspace that nobody waits for goes to the next render: when the lease is gone, or when its backward pass has
    run. A backward pass that comes after that draws the view again first.
    """

    def __init__(self, workspace: "_Workspace"):
        self.workspace = workspace
        self.pending = False  # a backward pass is still to come

    @property
    def held(self) -> bool:
        return self.workspace.lease() is self


class _Workspace:
    """entries: how the names of the rasterizer's entries begin, "sb_rasterizer" or "sb_convex_rasterizer"."""

    def __init__(self, entries: str, place: Place):
        handle = ctypes.c_void_p()
        place.call(entries + "_create", place.c_device(), ctypes.byref(handle))
        self.entries = entries
        self.handle = handle
        self.lease: Any = lambda: None
        weakref.finalize(self, getattr(lib.load(), entries + "_destroy"), handle)


_workspaces: Dict[Tuple[str, int, int, int], List[_Workspace]] = {}
_lock = threading.Lock()


def _take_workspace(entries: str, place: Place) -> _Lease:
    with _lock:
        pool = _workspaces.setdefault((entries, place.kind, place.index, place.threads), [])
        for workspace in pool:
            owner = workspace.lease()
            if owner is None or not owner.pending:
                break
        else:
            workspace = _Workspace(entries, place)
            pool.append(workspace)
        lease = _Lease(workspace)
        workspace.lease = weakref.ref(lease)
        return lease


@dataclass
class _Call:
    """What of a render is no tensor, and the render's lease."""

    camera: Camera
    options: Any
    sh_degree: int
    inverse_depth: bool
    alpha: bool
    absolute_sum: bool
    differentiable: bool
    lease: Optional[_Lease] = None


_NAMES = ("means", "opacities", "scales", "rotations", "covariances", "sh_dc", "sh_rest", "colors", "features")


def _gaussians(place: Place, tensors: Dict[str, Optional[torch.Tensor]], sh_degree: int) -> lib.Gaussians:
    gaussians = lib.Gaussians()
    for name in _NAMES:
        setattr(gaussians, name, place.view(tensors[name], name))
    gaussians.sh_degree = sh_degree
    return gaussians


def _draw(place: Place, call: _Call, tensors: Dict[str, Optional[torch.Tensor]]) -> Dict[str, Optional[torch.Tensor]]:
    """Takes a workspace and draws into new images."""
    means, features = tensors["means"], tensors["features"]
    assert means is not None
    h, w, n = call.camera.height, call.camera.width, means.shape[0]
    images: Dict[str, Optional[torch.Tensor]] = {
        "color": place.empty((3, h, w)),
        "features": None if features is None else place.empty((features.shape[1], h, w)),
        "inverse_depth": place.empty((1, h, w)) if call.inverse_depth else None,
        "alpha": place.empty((1, h, w)) if call.alpha else None,
        "radii": place.empty((n,), torch.int32),
    }
    outputs = lib.RasterOutputs(**{name: place.target(image, name) for name, image in images.items()})
    gaussians = _gaussians(place, tensors, call.sh_degree)
    call.lease = _take_workspace("sb_rasterizer", place)
    place.call(
        "sb_rasterizer_forward",
        call.lease.workspace.handle,
        ctypes.byref(call.camera.c_struct()),
        ctypes.byref(gaussians),
        ctypes.byref(call.options),
        ctypes.byref(outputs),
        place.stream,
    )
    return images


class _Rasterize(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, call: _Call, screen_points: Any, sh: Any, *inputs: Any) -> Any:
        tensors = dict(zip(_NAMES, inputs))
        if sh is not None:  # one tensor of all coefficients, as 3DGS passes them
            tensors["sh_dc"], tensors["sh_rest"] = sh[:, :1].contiguous(), sh[:, 1:].contiguous()
        place = Place(tensors["means"], "means")
        images = _draw(place, call, tensors)
        assert call.lease is not None
        call.lease.pending = call.differentiable and any(ctx.needs_input_grad)
        if not call.lease.pending:  # for scores or evaluation, where every splat counts; training does not wait for it
            place.call("sb_rasterizer_settle", call.lease.workspace.handle, None, place.stream)
        ctx.call = call
        ctx.screen_points = None if screen_points is None else screen_points.shape[1]
        ctx.together = sh is not None
        ctx.given = [name for name in _NAMES if tensors[name] is not None]
        ctx.save_for_backward(*[tensors[name] for name in ctx.given])
        ctx.mark_non_differentiable(images["radii"])
        ctx.set_materialize_grads(False)
        return images["color"], images["radii"], images["features"], images["inverse_depth"], images["alpha"]

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, g_color: Any, _: Any, g_features: Any, g_inverse_depth: Any, g_alpha: Any) -> Any:
        call: _Call = ctx.call
        tensors: Dict[str, Optional[torch.Tensor]] = dict.fromkeys(_NAMES)
        tensors.update(zip(ctx.given, ctx.saved_tensors))
        means = tensors["means"]
        assert means is not None and call.lease is not None
        place = Place(means, "means")
        if not call.lease.held:
            _draw(place, call, tensors)

        needs = dict(zip(_NAMES, ctx.needs_input_grad[3:]))
        if ctx.together:
            needs["sh_dc"] = needs["sh_rest"] = ctx.needs_input_grad[2]
        gradients: Dict[str, Optional[torch.Tensor]] = {
            name: torch.empty_like(tensor, memory_format=torch.contiguous_format)
            if tensor is not None and needs[name]
            else None
            for name, tensor in tensors.items()
        }
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
        g_sh = None
        if ctx.together and gradients["sh_dc"] is not None:
            g_sh = torch.cat([gradients["sh_dc"], gradients["sh_rest"]], dim=1)  # type: ignore[list-item]
            gradients["sh_dc"] = gradients["sh_rest"] = None
        return (None, g_screen, g_sh) + tuple(gradients[name] for name in _NAMES)


class Render:
    """A view that was drawn.

    color          [3,H,W] background added, not clamped
    radii          int32 [N] 3σ radius in pixels, rounded up; 0 where not visible
    features       [F,H,W], or None
    inverse_depth  [1,H,W] Σ wᵢ / zᵢ, or None
    alpha          [1,H,W] 1 − final transmittance, or None
    """

    def __init__(
        self,
        color: torch.Tensor,
        radii: torch.Tensor,
        features: Optional[torch.Tensor],
        inverse_depth: Optional[torch.Tensor],
        alpha: Optional[torch.Tensor],
        lease: _Lease,
    ):
        self.color = color
        self.radii = radii
        self.features = features
        self.inverse_depth = inverse_depth
        self.alpha = alpha
        self._lease = lease

    @property
    def visible(self) -> torch.Tensor:
        """bool [N] whether each Gaussian is listed in at least one tile."""
        return self.radii > 0

    def count_flagged(self, flagged: torch.Tensor, counts: Optional[torch.Tensor] = None) -> torch.Tensor:
        """Adds to counts the flagged pixels where each Gaussian was blended (paper eq. 9), and returns them.

        flagged: bool or uint8 [H,W]. counts: int32 [N], contiguous; zeros where not given.
        Replays the tile lists of this render, so it must come before the next render.
        """
        h, w = self.color.shape[1:]
        if isinstance(flagged, torch.Tensor) and flagged.dtype == torch.bool:
            flagged = flagged.view(torch.uint8)
        check(flagged, "flagged", torch.uint8, (h, w))
        if counts is None:
            counts = torch.zeros_like(self.radii)
        check(counts, "counts", torch.int32, (self.radii.shape[0],))
        place = Place(self.radii, "radii")
        self._add_counts(place.view(flagged, "flagged"), place.target(counts, "counts"), place)
        return counts

    def count_observed(self, min_transmittance: float = 0.5) -> torch.Tensor:
        """int32 [N]: pixels where each Gaussian was blended while the transmittance before it was above this one.

        Replays the tile lists of this render, so it must come before the next render.
        """
        counts = torch.zeros_like(self.radii)
        place = Place(self.radii, "radii")
        self._check_held("count_observed")
        workspace = self._lease.workspace
        if workspace.entries != "sb_rasterizer":
            raise TypeError("count_observed: only renders of Gaussians tell it")
        target = place.target(counts, "counts")
        lib.call("sb_rasterizer_count_observed", workspace.handle, min_transmittance, target, place.stream)
        return counts

    def weights(self) -> torch.Tensor:
        """int32 [N]: blending weights of each Gaussian, summed over pixels, in 1/256 (rounded a pixel).

        Replays the tile lists of this render, so it must come before the next render.
        """
        weights = torch.zeros_like(self.radii)
        place = Place(self.radii, "radii")
        self._add_weights(place.target(weights, "weights"), place)
        return weights

    def _check_held(self, what: str) -> None:
        if not self._lease.held:
            raise RuntimeError("%s: this render's tile lists are gone, another view was drawn since" % what)

    def _add_weights(self, weights: Any, place: Place) -> None:
        self._check_held("weights")
        workspace = self._lease.workspace
        lib.call(workspace.entries + "_add_weights", workspace.handle, weights, place.stream)

    def _add_counts(self, flagged: Any, counts: Any, place: Place) -> None:
        self._check_held("count_flagged")
        workspace = self._lease.workspace
        lib.call(workspace.entries + "_count_flagged", workspace.handle, flagged, counts, place.stream)


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
    """Draws N Gaussians; gradients flow to every tensor of them. All are float32, on one device.

    means          [N,3] world
    opacities      [N,1] or [N], activated
    scales         [N,3] standard deviations, with rotations [N,4], quaternions (w,x,y,z) of any length;
                   or covariances [N,6]: xx xy xz yy yz zz
    sh             [N,K,3] spherical harmonics of all degrees; or sh_dc [N,1,3] or [N,3], with sh_rest [N,K-1,3];
                   or colors [N,3]. sh_degree: the active one, 0 to 3
    features       [N,F] extra channels to blend, F <= 8, over a background of zero
    background     three numbers; no gradient
    beta           of the compact box, in (0, 1]; None: 3DGS's 3σ square
    low_pass       variance in px² added to a splat's both axes
    compensate_opacity   opacity × sqrt(det Σ / det(Σ + low_pass)): 3DGS's antialiasing, Mip-Splatting's 2D filter
    inverse_depth, alpha  whether to draw them
    screen_points  [N,3] or [N,4], its values are not read: its gradient receives that of the means on screen, in
                   NDC units as 3DGS has it. With 4 columns, 2 and 3 are the sums over pixels of the absolute
                   gradients along x and y (AbsGS); with 3, column 2 is 0, or their sum with absolute_sum
                   (Mip-Splatting)
    """
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
        raise ValueError("sh: shape [%d,K,3] with K > 0 wanted, %s given" % (n, list(sh.shape)))

    options = lib.RasterOptions(
        lib.BOX_SQUARE if beta is None else lib.BOX_ELLIPSE,
        1.0 if beta is None else beta,
        low_pass,
        int(compensate_opacity),
        near_plane,
    )
    shade = host_rows(background)[0]
    if len(shade) != 3:
        raise ValueError("background: 3 numbers wanted, %d given" % len(shade))
    options.background[:] = shade
    place = Place(means, "means")
    for tensor, name in ((opacities, "opacities"), (screen_points, "screen_points")):
        if tensor is not None:
            place.check_here(tensor, name)
    call = _Call(camera, options, int(sh_degree), inverse_depth, alpha, absolute_sum, torch.is_grad_enabled())
    color, radii, drawn_features, depth, drawn_alpha = _Rasterize.apply(
        call, screen_points, sh, means, opacities, scales, rotations, covariances, sh_dc, sh_rest, colors, features
    )
    assert call.lease is not None
    return Render(color, radii, drawn_features, depth, drawn_alpha, call.lease)


def mark_visible(camera: Camera, means: torch.Tensor, near_plane: float = 0.2) -> torch.Tensor:
    """bool [N]: which means [N,3] lie beyond the near plane, as 3DGS's markVisible."""
    check(means, "means", _F32, ("N", 3))
    place = Place(means, "means")
    visible = place.empty((means.shape[0],), torch.uint8)
    place.call(
        "sb_mark_visible",
        place.c_device(),
        ctypes.byref(camera.c_struct()),
        place.view(means, "means"),
        near_plane,
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
    """int32 [N] radii of the 3σ squares that meet the image, 0 elsewhere, without drawing (visible_filter)."""
    check(means, "means", _F32, ("N", 3))
    n = means.shape[0]
    for tensor, name, width in ((scales, "scales", 3), (rotations, "rotations", 4), (covariances, "covariances", 6)):
        if tensor is not None:
            check(tensor, name, _F32, (n, width))
    place = Place(means, "means")
    radii = place.empty((n,), torch.int32)
    tensors: Dict[str, Optional[torch.Tensor]] = dict.fromkeys(_NAMES)
    tensors.update(means=means, scales=scales, rotations=rotations, covariances=covariances)
    options = lib.RasterOptions(lib.BOX_SQUARE, 1.0, low_pass, 0, near_plane)
    place.call(
        "sb_visible_radii",
        place.c_device(),
        ctypes.byref(camera.c_struct()),
        ctypes.byref(_gaussians(place, tensors, 0)),
        ctypes.byref(options),
        place.target(radii, "radii"),
    )
    return radii
