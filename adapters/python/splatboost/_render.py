# SPDX-License-Identifier: Apache-2.0
"""Shared by the rasterizers of Gaussians and of convexes: a render, its workspace, and helpers for autograd."""

from __future__ import annotations

import ctypes
import threading
import weakref
from contextlib import contextmanager
from typing import Any, Dict, Iterator, List, Optional, Sequence, Tuple

import torch

from . import _library as lib
from ._tensors import Place, check

# Input tensors by name; None if not given.
Tensors = Dict[str, Optional[torch.Tensor]]


class Lease:
    """A render's claim on the workspace that holds its tile lists.

    A workspace is free for the next render, of any thread, once its lease no longer exists or is no longer pending. A
    backward pass that runs after that renders the view again first.
    """

    def __init__(self, workspace: "_Workspace"):
        self.workspace = workspace
        self.pending = True  # in use, or a backward pass is still to come

    @property
    def held(self) -> bool:
        return self.workspace.lease() is self

    def claim(self) -> bool:
        """Makes it pending; False if a later render has the workspace."""
        with _lock:
            self.pending = self.held
            return self.pending

    @contextmanager
    def in_use(self) -> Iterator[bool]:
        """claim() for the duration of a call."""
        before = self.pending
        try:
            yield self.claim()
        finally:
            self.pending = before


class _Workspace:
    """entries: prefix of the rasterizer's entries, "sb_rasterizer" or "sb_convex_rasterizer"."""

    def __init__(self, entries: str, place: Place):
        handle = ctypes.c_void_p()
        place.call(entries + "_create", place.c_device(), ctypes.byref(handle))
        self.entries = entries
        self.handle = handle
        self.lease: Any = lambda: None
        weakref.finalize(self, getattr(lib.load(), entries + "_destroy"), handle)


_workspaces: Dict[Tuple[str, int, int, int], List[_Workspace]] = {}
_lock = threading.Lock()


def take_workspace(entries: str, place: Place) -> Lease:
    with _lock:
        pool = _workspaces.setdefault((entries, place.kind, place.index, place.threads), [])
        for workspace in pool:
            owner = workspace.lease()
            if owner is None or not owner.pending:
                break
        else:
            workspace = _Workspace(entries, place)
            pool.append(workspace)
        lease = Lease(workspace)
        workspace.lease = weakref.ref(lease)
        return lease


def draw(entries: str, place: Place, *arguments: Any) -> Lease:
    """Takes a workspace and renders; the lease is pending."""
    lease = take_workspace(entries, place)
    try:
        place.call(entries + "_forward", lease.workspace.handle, *arguments, place.stream)
    except BaseException:
        lease.pending = False
        raise
    return lease


def save_inputs(ctx: Any, names: Sequence[str], inputs: Sequence[Any], sh: Optional[torch.Tensor]) -> Tensors:
    """Saves the given inputs for the backward pass. sh: spherical harmonics of all degrees in one tensor, as in 3DGS;
    it is split into sh_dc and sh_rest."""
    tensors: Tensors = dict(zip(names, inputs))
    if sh is not None:
        tensors["sh_dc"], tensors["sh_rest"] = sh[:, :1].contiguous(), sh[:, 1:].contiguous()
    ctx.together = sh is not None
    ctx.given = [name for name in names if tensors[name] is not None]
    ctx.save_for_backward(*[tensors[name] for name in ctx.given])
    return tensors


def saved_inputs(ctx: Any, names: Sequence[str]) -> Tensors:
    tensors: Tensors = dict.fromkeys(names)
    tensors.update(zip(ctx.given, ctx.saved_tensors))
    return tensors


def new_gradients(ctx: Any, tensors: Tensors, needed: Sequence[bool], sh_needed: bool) -> Tensors:
    """Allocates gradients for the inputs that need one; None for the others."""
    needs = dict(zip(tensors, needed))
    if ctx.together:
        needs["sh_dc"] = needs["sh_rest"] = sh_needed
    return {
        name: torch.empty_like(tensor, memory_format=torch.contiguous_format)
        if tensor is not None and needs[name]
        else None
        for name, tensor in tensors.items()
    }


def returned_gradients(ctx: Any, gradients: Tensors) -> Tuple[Any, ...]:
    """The gradient of sh (None unless it was one tensor), then those of the inputs, in their order."""
    g_sh = None
    if ctx.together and gradients["sh_dc"] is not None:
        g_sh = torch.cat([gradients["sh_dc"], gradients["sh_rest"]], dim=1)  # type: ignore[list-item]
        gradients["sh_dc"] = gradients["sh_rest"] = None
    return (g_sh, *gradients.values())


class Render:
    """A rendered view.

    color          [3,H,W] with background, not clamped
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
        lease: Lease,
    ):
        self.color = color
        self.radii = radii
        self.features = features
        self.inverse_depth = inverse_depth
        self.alpha = alpha
        self._lease = lease

    @property
    def visible(self) -> torch.Tensor:
        """bool [N]: whether each Gaussian is listed in at least one tile."""
        return self.radii > 0

    def count_flagged(self, flagged: torch.Tensor, counts: Optional[torch.Tensor] = None) -> torch.Tensor:
        """Adds to counts the number of flagged pixels in which each Gaussian was blended (paper eq. 9); returns counts.

        flagged: bool or uint8 [H,W]. counts: int32 [N], contiguous; None: new zeros.
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
        """int32 [N]: number of pixels in which each Gaussian was blended at a transmittance above min_transmittance.

        Replays the tile lists of this render, so it must come before the next render.
        """
        least = lib.number(min_transmittance, "min_transmittance")
        counts = torch.zeros_like(self.radii)
        place = Place(self.radii, "radii")
        target = place.target(counts, "counts")
        with self._replayed("count_observed") as workspace:
            if workspace.entries != "sb_rasterizer":
                raise TypeError("count_observed: only available for renders of Gaussians")
            lib.call("sb_rasterizer_count_observed", workspace.handle, least, target, place.stream)
        return counts

    def weights(self) -> torch.Tensor:
        """int32 [N]: blending weights of each Gaussian, summed over pixels, in units of 1/256 (rounded per pixel);
        at most 2^31 - 1.

        Replays the tile lists of this render, so it must come before the next render.
        """
        weights = torch.zeros_like(self.radii)
        place = Place(self.radii, "radii")
        self._add_weights(place.target(weights, "weights"), place)
        return weights

    @contextmanager
    def _replayed(self, what: str) -> Iterator[_Workspace]:
        """The workspace with this render's tile lists, in use meanwhile."""
        with self._lease.in_use() as held:
            if not held:
                raise RuntimeError("%s: this render's tile lists were overwritten by a later render" % what)
            yield self._lease.workspace

    def _add_weights(self, weights: Any, place: Place) -> None:
        with self._replayed("weights") as workspace:
            lib.call(workspace.entries + "_add_weights", workspace.handle, weights, place.stream)

    def _add_counts(self, flagged: Any, counts: Any, place: Place) -> None:
        with self._replayed("count_flagged") as workspace:
            lib.call(workspace.entries + "_count_flagged", workspace.handle, flagged, counts, place.stream)
