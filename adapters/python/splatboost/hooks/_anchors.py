# SPDX-License-Identifier: Apache-2.0
"""Accelerates one training run of an anchor-based host (Scaffold-GS and its successors).

Each anchor generates Gaussians from several slots. The host's own adjust_anchor adds and removes anchors; slots that do
not pass the gate add none. Everything else (statistics, their resets, pruning) stays the host's.
"""

from __future__ import annotations

import functools
from typing import Any, Callable, Dict, List, Optional

import torch

from .._tensors import Place, counts_of
from ..adapter import ScoredView
from ..compat import last_render
from ..operations import keep_largest
from . import _drawing
from ._boost import adapter_of, announce, is_on, scored_view, step_scaled


class _OfSlots:
    """The render of a view, whose counts per Gaussian are mapped to the slots that generated them."""

    def __init__(self, render: Any, slots: torch.Tensor):
        self._render = render
        self._slots = slots  # [M] the slot of each Gaussian of the render, without duplicates

    def _add_counts(self, flagged: Any, counts: Any, place: Place) -> None:
        drawn = torch.zeros_like(self._render.radii)
        self._render._add_counts(flagged, place.target(drawn, "drawn"), place)
        counts_of(counts, place).index_add_(0, self._slots, drawn)


class Boost:
    """Replaces the host's calls that grow and step.

    gaussians, scene   the host's
    options            its optimization parameters, with those that the patch adds (boost…)
    dataset            its model parameters
    see                returns the anchors that a training camera sees, bool [N], from the host's prefilter, given a
                       background
    render             renders a training camera with a background and those anchors; returns the host's dictionary

    With --boost off every call is forwarded to the host.
    """

    backbone = "scaffold-gs"
    #: Maximum number of anchors that one slot adds per growth.
    anchors_per_slot = 1

    def __init__(self, gaussians: Any, scene: Any, options: Any, dataset: Any,
                 see: Callable[[Any, torch.Tensor], torch.Tensor],
                 render: Callable[[Any, torch.Tensor, torch.Tensor], Dict[str, torch.Tensor]]):
        self.on = is_on(options)
        self.gaussians = gaussians
        self.options = options
        self.iteration = 0
        if not self.on:
            _drawing.forget(dataset.model_path)
            return
        self._scene = scene
        self._dataset = dataset
        self._see = see
        self._render = render
        device = gaussians.get_anchor.device
        self._background = torch.full((3,), float(dataset.white_background), device=device)
        self.adapter = adapter_of(self.backbone, options, device,
                                  {"beta": options.boost_beta, "tau_d": options.boost_tau_d})
        gaussians.splatboost = _drawing.Drawing(self.adapter.beta)
        _drawing.save(dataset.model_path, self.backbone, self.adapter.beta)
        announce(self.adapter, "anchors grow every %d from %d to %d, rates fall from %d" % (
            options.update_interval, options.update_from, options.update_until,
            round(self.adapter.settings["rates_fall_from"] * options.iterations)))

    def begin(self, iteration: int) -> None:
        self.iteration = iteration

    def adjust_anchor(self, *given: Any, **named: Any) -> Any:
        """As the host's, with its arguments."""
        g = self.gaussians
        if not self.on:
            return g.adjust_anchor(*given, **named)
        # The host replaces all parameters of anchors; their last gradient would be lost.
        self.optimizer.step()
        self.optimizer.zero_grad(set_to_none=True)
        g.splatboost.gate = self._gate()
        try:
            return g.adjust_anchor(*given, **named)
        finally:
            g.splatboost.gate = None

    # --- which slots may grow

    def _gate(self) -> torch.Tensor:
        """bool [N·k]: slots that may add anchors."""
        g, o = self.gaussians, self.options
        seen = g.offset_denom.reshape(-1)
        gradients = torch.nan_to_num(g.offset_gradient_accum.reshape(-1) / seen)
        candidates = (gradients >= self._thresholds()) & (seen > o.update_interval * o.success_threshold * 0.5)
        gate, _ = self.adapter.grow(self.iteration, self._views(), scene_extent=float(g.spatial_lr_scale),
                                    gradients=gradients, clone=candidates)
        if o.boost_max_anchors > 0:
            room = max(0, o.boost_max_anchors - g.get_anchor.shape[0]) // self.anchors_per_slot
            gate = keep_largest(gradients, room, gate)
        return gate

    def _thresholds(self) -> Any:
        """Minimum mean gradient of a candidate slot; one number, or one per slot."""
        return self.options.densify_grad_threshold

    def _views(self) -> List[Callable[[], ScoredView]]:
        return [functools.partial(self._score, camera) for camera in self._scene.getTrainCameras()]

    def _score(self, camera: Any) -> ScoredView:
        g = self.gaussians
        seen = self._see(camera, self._background)
        drawn = self._render(camera, self._background, seen)
        # Gaussians of the render: the slots of visible anchors, in order, that have an opacity above 0.
        slots = torch.nonzero(seen.repeat_interleave(g.n_offsets)).reshape(-1)[drawn["selection_mask"]]
        image = drawn["render"].contiguous()
        return scored_view(camera, image, _OfSlots(last_render(), slots))

    # --- the optimizer

    @property
    def optimizer(self) -> Any:
        return _WithRates(self) if self.on else self.gaussians.optimizer


class _WithRates:
    """Wraps the host's optimizer for its training loop, applying the adapter's factors to the learning rates."""

    def __init__(self, boost: Boost):
        self._boost = boost
        self._inner = boost.gaussians.optimizer

    def step(self) -> None:
        step_scaled(self._inner, self._boost.adapter, self._boost.iteration)

    def zero_grad(self, set_to_none: bool = True) -> None:
        self._inner.zero_grad(set_to_none=set_to_none)


def gated(model: Any, candidates: torch.Tensor) -> torch.Tensor:
    """The slots that the host would grow from and that pass the gate; all candidates without boost."""
    drawing: Optional[Any] = getattr(model, "splatboost", None)
    gate = getattr(drawing, "gate", None)
    return candidates if gate is None else candidates & gate
