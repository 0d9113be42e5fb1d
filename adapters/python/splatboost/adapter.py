# SPDX-License-Identifier: Apache-2.0
"""Decisions of a backbone's adapter: which primitives grow, split and are removed; when parameter groups step."""

from __future__ import annotations

import ctypes
import functools
import math
import numbers
import weakref
from dataclasses import dataclass
from typing import Any, Callable, Dict, Optional, Sequence, Tuple

import torch

from . import _library as lib
from ._tensors import Place, check
from .operations import as_bytes, mask_bytes

_F32 = torch.float32


@dataclass
class ScoredView:
    """A training view rendered without randomness (dropout, jitter).

    color   float32 [3,H,W] the render
    truth   [3,H,W] uint8, or float32 in [0, 1]
    valid   bool or uint8 [H,W]: valid pixels; None: all
    render  the Render that counts its flagged pixels; None: the last render of a drop-in
    """

    color: torch.Tensor
    truth: torch.Tensor
    valid: Optional[torch.Tensor] = None
    render: Any = None  # a Render, or an object with its _add_counts and _add_weights


#: views[j]() renders training view j
ViewSource = Sequence[Callable[[], ScoredView]]


def _device_of(device: Any) -> torch.device:
    try:
        return torch.device(device)
    except (TypeError, RuntimeError, AssertionError):
        raise ValueError("device: expected a device such as cpu or cuda:0, got %s" % lib.shown(device)) from None


def _place_on(device: torch.device) -> Place:
    try:
        nothing = torch.empty(0, device=device)
    except (AssertionError, RuntimeError) as error:  # which of them depends on torch's build
        reason = str(error).strip().split("\n")[0]
        raise ValueError("device: torch cannot use %s: %s" % (device, reason)) from None
    return Place(nothing, "device")


def _setting_kinds(boost: Any) -> Dict[str, Any]:
    """Each setting's name and its type: bool, int or float."""
    kinds: Dict[str, Any] = {}
    name, kind = ctypes.c_char_p(), ctypes.c_int32()
    while True:
        lib.call("sb_boost_setting", boost, len(kinds), ctypes.byref(name), ctypes.byref(kind))
        if name.value is None:
            return kinds
        kinds[name.value.decode()] = lib.SETTING_KINDS[kind.value]


class Adapter:
    """Decisions of one run.

    backbone: "vanilla", "mip-splatting", "dropgaussian", … as for the program's --backbone. total_iterations: length of
    the host's run, to which the published iteration numbers scale. device: where the host's renders and masks are.
    seed: of the random draws. settings: those of the backbone's adapter by name, such as vcd, vcp, cb, absgrad,
    schedule (parts: True or False), views (K), beta, tau_d, gradient_threshold, densify_until; see `settings`. Set
    training_views (their number), random_points (True if the run starts from random points) and depth_ratio (typical depth
    of the scene in its views / its extent), where the adapter has them: rates, resets and late pruning depend on them.
    Copies and pickles have the same settings and seed, and so make the same decisions.
    """

    def __init__(self, backbone: str, *, total_iterations: int, device: Any = "cpu", seed: int = 0, **settings: Any):
        self.backbone = backbone
        self.total_iterations = lib.whole(total_iterations, "total_iterations", 1)
        self.device = _device_of(device)
        self.seed = lib.whole(seed, "seed", *lib.SEEDS)
        boost = ctypes.c_void_p()
        literal = lib.whole(settings.get("literal", 0), "literal", 0, 1)
        lib.call("sb_boost_create", str(backbone).encode(), literal, ctypes.byref(boost))
        try:
            self._kinds = _setting_kinds(boost)
            for name, value in settings.items():
                self._set(boost, name, value)
            #: All settings by name, with their current values.
            self.settings = {name: self._get(boost, name) for name in self._kinds}
            place = _place_on(self.device)
            handle = ctypes.c_void_p()
            place.call("sb_adapter_create", boost, self.seed, place.c_device(), ctypes.byref(handle))
        finally:
            lib.load().sb_boost_destroy(boost)
        self._handle = handle
        self._close = weakref.finalize(self, lib.load().sb_adapter_destroy, handle)

    def __reduce__(self) -> Any:
        # A new handle: the library frees that of each adapter.
        make = functools.partial(
            type(self), self.backbone, total_iterations=self.total_iterations, device=self.device, seed=self.seed,
            **self.settings
        )
        return make, ()

    def _set(self, boost: Any, name: str, value: Any) -> None:
        if name not in self._kinds:
            raise ValueError("%s: no such setting; available: %s" % (name, ", ".join(sorted(self._kinds))))
        if self._kinds[name] is float:
            number = lib.number(value, name)
            if not math.isfinite(number):
                raise ValueError("%s: expected a finite number, got %s" % (name, lib.shown(value)))
        elif isinstance(value, numbers.Integral):
            number = lib.whole(value, name)
        else:
            raise ValueError("%s: expected a whole number, got %s" % (name, lib.shown(value)))
        lib.call("sb_boost_set", boost, name.encode(), number)

    def _get(self, boost: Any, name: str) -> Any:
        value = ctypes.c_double()
        lib.call("sb_boost_get", boost, name.encode(), ctypes.byref(value))
        return self._kinds[name](value.value)

    @property
    def beta(self) -> Optional[float]:
        """β of the compact box, for set_beta; None without the compact box."""
        beta = ctypes.c_float()
        lib.call("sb_adapter_beta", self._handle, ctypes.byref(beta))
        return float(self.settings["beta"]) if beta.value > 0 else None

    def _asks(self, entry: str, iteration: int, host_would: bool) -> bool:
        answer = ctypes.c_int32()
        iteration = lib.whole(iteration, "iteration")
        lib.call(entry, self._handle, iteration, self.total_iterations, int(bool(host_would)), ctypes.byref(answer))
        return bool(answer.value)

    def grows_at(self, iteration: int, host_would: bool) -> bool:
        """Whether to grow at this iteration (from 1), given whether the host's own rule would."""
        return self._asks("sb_adapter_grows_at", iteration, host_would)

    def prunes_at(self, iteration: int, host_would: bool) -> bool:
        """Whether to prune at this iteration, given whether the host's own rule would."""
        return self._asks("sb_adapter_prunes_at", iteration, host_would)

    def steps_at(self, group: str, iteration: int) -> bool:
        """Whether a parameter group ("xyz", "f_dc", "f_rest", "opacity", "scaling", "rotation") steps now."""
        answer = ctypes.c_int32()
        lib.call(
            "sb_adapter_steps_at", self._handle, str(group).encode(), lib.whole(iteration, "iteration"),
            self.total_iterations, ctypes.byref(answer)
        )
        return bool(answer.value)

    def rate_factor(self, group: str, iteration: int) -> float:
        """Factor on the host's own learning rate of a parameter group at this iteration."""
        factor = ctypes.c_float()
        lib.call(
            "sb_adapter_rate_factor", self._handle, str(group).encode(), lib.whole(iteration, "iteration"),
            self.total_iterations, ctypes.byref(factor)
        )
        return float(factor.value)

    def averages_at(self, iteration: int) -> bool:
        """Whether the parameters after this iteration's steps are among those whose mean replaces them at the end."""
        answer = ctypes.c_int32()
        lib.call("sb_adapter_averages_at", self._handle, lib.whole(iteration, "iteration"), self.total_iterations,
                 ctypes.byref(answer))
        return bool(answer.value)

    def prunes_large_at(self, iteration: int, host_would: bool) -> bool:
        """Whether the candidates of growth include Gaussians that are large in the world, given whether the host's do."""
        return self._asks("sb_adapter_prunes_large_at", iteration, host_would)

    def resets_opacities_at(self, iteration: int, host_would: bool) -> bool:
        """Whether opacities are reset at this iteration, given whether the host's own rule would."""
        return self._asks("sb_adapter_resets_opacities_at", iteration, host_would)

    def grow(
        self,
        iteration: int,
        views: ViewSource,
        *,
        scene_extent: float,
        gradients: torch.Tensor,
        gradients_abs: Optional[torch.Tensor] = None,
        max_scales: Optional[torch.Tensor] = None,
        clone: Optional[torch.Tensor] = None,
        split: Optional[torch.Tensor] = None,
        max_primitives: int = 0,
    ) -> Tuple[torch.Tensor, torch.Tensor]:
        """Scores up to K of the views and decides growth. Returns clone and split, bool [N].

        scene_extent   1.1 times the largest distance of a training camera from their mean, world units
        gradients      float32 [N] or [N,1] mean norm of the signed screen-space gradient, NDC units
        gradients_abs  same of the absolute gradient (Mip-Splatting: of its sums); required unless absgrad is off
        max_scales     longest standard deviation, world units; required unless absgrad is off
        clone, split   bool [N] the host's own decisions, of which growth selects if absgrad is off; then at least one of
                       them is required
        max_primitives cap on their number after growth, which keeps the strongest candidates; 0: no cap
        """
        n = self._rows(gradients, "gradients")
        if clone is None and split is None and not self.settings.get("absgrad"):
            raise ValueError("clone, split: expected the host's own decisions, of which growth selects (absgrad is off)")
        masks = []
        for mask, name in ((clone, "clone"), (split, "split")):
            if mask is None:
                mask = torch.zeros((n,), dtype=torch.bool, device=self.device)
            check(mask, name, torch.bool, (n,))
            masks.append(mask.to(torch.uint8))
        place = Place(gradients, "gradients")
        density = self._density(
            place,
            iteration,
            n,
            scene_extent=scene_extent,
            gradients=gradients,
            gradients_abs=gradients_abs,
            max_scales=max_scales,
        )
        density.max_primitives = lib.whole(max_primitives, "max_primitives", 0, 2**63 - 1)
        with _Host(views, n, self.device) as host:
            host.call(
                "sb_adapter_grow",
                self._handle,
                ctypes.byref(density),
                host.c_views(),
                place.target(masks[0], "clone"),
                place.target(masks[1], "split"),
                place.stream,
            )
        return masks[0].bool(), masks[1].bool()

    def prune(
        self,
        iteration: int,
        views: ViewSource,
        *,
        candidates: torch.Tensor,
        origins: Optional[torch.Tensor] = None,
        opacities: Optional[torch.Tensor] = None,
        clearances: Optional[torch.Tensor] = None,
        max_primitives: int = 0,
    ) -> torch.Tensor:
        """Decides removal; returns bool [M]: the primitives to remove.

        candidates  bool [M] primitives that the host's own rule would remove
        origins     integers [M]: index that each primitive, or the one it was made from, had in grow() of this
                    iteration. None if not within growth: then late pruning, which scores the views and needs the
                    opacities, adds candidates at its own iterations (prunes_at)
        opacities   float32 [M] or [M,1], activated
        clearances  float32 [M] of camera_clearances(): those below the setting min_clearance are removed, at any iteration
        max_primitives  as for grow(): late pruning removes none if growth has reached it
        """
        m = self._rows(candidates, "candidates")
        check(candidates, "candidates", torch.bool, (m,))
        place = Place(candidates, "candidates")
        remove = candidates.to(torch.uint8)
        if origins is not None:
            check(origins, "origins", (torch.int32, torch.int64), (m,))
            origins = origins.to(torch.int32)
        density = self._density(place, iteration, m, opacities=opacities, clearances=clearances)
        density.max_primitives = lib.whole(max_primitives, "max_primitives", 0, 2**63 - 1)
        with _Host(views, m, self.device) as host:
            host.call(
                "sb_adapter_prune",
                self._handle,
                ctypes.byref(density),
                host.c_views(),
                place.target(remove, "remove"),
                place.view(origins, "origins"),
                place.stream,
            )
        return remove.bool()

    def _rows(self, tensor: Any, name: str) -> int:
        if not isinstance(tensor, torch.Tensor):
            raise ValueError("%s: expected a tensor, got %s" % (name, type(tensor).__name__))
        if tensor.dim() == 0:
            raise ValueError("%s: expected a tensor of at least one dimension, got shape []" % name)
        if tensor.device.type != self.device.type:
            raise ValueError("%s: expected a tensor on %s, got one on %s" % (name, self.device, tensor.device))
        return int(tensor.shape[0])

    def _density(
        self, place: Place, iteration: int, n: int, scene_extent: float = 0.0, **statistics: Optional[torch.Tensor]
    ) -> lib.Density:
        density = lib.Density(
            lib.whole(iteration, "iteration"), self.total_iterations, lib.number(scene_extent, "scene_extent")
        )
        for name, tensor in statistics.items():
            if tensor is not None:
                check(tensor, name, _F32, (n,), (n, 1))
                setattr(density, name, place.view(tensor, name))
        return density


class _Host:
    """The library's callbacks for the host's views. Exceptions in them are re-raised after the library has returned."""

    def __init__(self, views: ViewSource, primitives: int, device: torch.device):
        if not hasattr(views, "__len__") or not hasattr(views, "__getitem__"):
            raise ValueError("views: expected a list of functions that render a view, got %s" % lib.shown(views))
        self._sources = views
        self._primitives = primitives
        self._device = device
        self._error: Optional[BaseException] = None
        self._view: Optional[ScoredView] = None
        self._place: Optional[Place] = None

    def __enter__(self) -> "_Host":
        return self

    def __exit__(self, *_: Any) -> None:
        self._view = self._place = None

    def c_views(self) -> Any:
        self._functions = (lib.RenderFunction(self._render), lib.CountFunction(self._count), lib.WeighFunction(self._weigh))
        return ctypes.byref(lib.Views(None, self._primitives, len(self._sources), *self._functions))

    def call(self, entry: str, *arguments: Any) -> None:
        try:
            lib.call(entry, *arguments)
        except lib.LibraryError:
            if self._error is not None:
                raise self._error
            raise

    def _render(self, _: Any, index: int, scored: Any) -> int:
        try:
            source = self._sources[index]
            if not callable(source):
                raise ValueError("views[%d]: expected a function, got %s" % (index, lib.shown(source)))
            with torch.no_grad():
                view = source()
            if not isinstance(view, ScoredView):
                raise ValueError("views[%d]: expected it to return a ScoredView, got %s" % (index, type(view).__name__))
            if view.render is None:
                from .compat import last_render

                view.render = last_render()
            if not hasattr(view.render, "_add_counts"):
                raise ValueError("render: expected a Render, got %s" % lib.shown(view.render))
            check(view.color, "color", _F32, (3, "H", "W"))
            h, w = view.color.shape[1:]
            truth, valid = as_bytes(view.truth), mask_bytes(view.valid, h, w)
            check(truth, "truth", torch.uint8, (3, h, w))
            place = Place(view.color, "color")
            scored[0].color = place.view(view.color, "color")
            scored[0].truth = lib.Truth(place.view(truth, "truth"), place.view(valid, "valid"))
            self._view, self._place = view, place
            return 0
        except BaseException as e:  # exceptions must not propagate through C
            self._error = e
            return 1

    def _count(self, _: Any, flagged: Any, counts: Any) -> int:
        try:
            view, place = self._view, self._place
            assert view is not None and view.render is not None and place is not None
            view.render._add_counts(flagged, counts, place)
            return 0
        except BaseException as e:
            self._error = e
            return 1

    def _weigh(self, _: Any, weights: Any) -> int:
        try:
            view, place = self._view, self._place
            assert view is not None and view.render is not None and place is not None
            view.render._add_weights(weights, place)
            return 0
        except BaseException as e:
            self._error = e
            return 1
