# SPDX-License-Identifier: Apache-2.0
"""Hooks of 3D Convex Splatting, whose primitives are convexes that split into six. The host decides when to grow."""

from __future__ import annotations

import functools
import sys
from typing import Any, Callable, Dict

import torch

from ..compat import diff_convex_rasterization
from ..operations import keep_largest
from . import _boost, _drawing
from ._drawing import box_of

__all__ = ["Boost", "load", "rasterizer"]


def rasterizer(model: Any, host: Any) -> Callable[..., Any]:
    """The host's own rasterizer, or ours for a model that is trained or was saved with boost."""
    drawing = getattr(model, "splatboost", None)
    if drawing is None:
        return host  # type: ignore[no-any-return]
    settings = diff_convex_rasterization.ConvexRasterizationSettings(**host.raster_settings._asdict())

    def draw(**given: Any) -> Any:
        with box_of(drawing.beta):
            return diff_convex_rasterization.ConvexRasterizer(settings)(**given)

    return draw


class Boost(_boost.Boost):
    backbone = "convex-splatting"
    host_options = {}
    gathers_absolute = False

    def _settings(self) -> Dict[str, Any]:
        """Late pruning begins when the host's growth has ended: it would remove what growth has just added."""
        o = self.options
        if o.densification_interval < 1:
            sys.stderr.write("--densification_interval: expected at least 1, got %d\n" % o.densification_interval)
            sys.exit(2)
        begins = _boost.adapter_of(self.backbone, o, self._device, {}).settings["late_prune_from"]
        ends = -(-min(o.densify_until_iter, o.iterations) * self.published_iterations // o.iterations)  # rounded up
        return dict(super()._settings(), late_prune_from=max(begins, ends))

    def _means(self) -> torch.Tensor:
        return self.gaussians.get_convex_points  # type: ignore[no-any-return]

    def _grows_at(self, iteration: int) -> bool:
        o = self.options
        return bool(o.densify_from_iter < iteration < o.densify_until_iter and iteration % o.densification_interval == 0)

    def _restart_statistics(self) -> None:
        """No effect: only the host's statistics are used."""

    def _keep(self, kept: torch.Tensor) -> None:
        """No effect: the host prunes its statistics itself."""

    def _signed_gradients(self) -> torch.Tensor:
        """[N] mean gradient of the sharpness."""
        g = self.gaussians
        return _boost.mean_gradients(g.sigma_accumulation_gradient_accum, g.denom).reshape(-1)

    def _densify_and_prune(  # type: ignore[override]
        self, min_opacity: float, mask_threshold: float, extent: float, max_screen_size: Any
    ) -> None:
        g = self.gaussians
        self._apply_gradients()
        n = self._means().shape[0]
        views = self._views()
        gradients = self._signed_gradients()
        own = gradients >= g.max_grad
        _, split = self.adapter.grow(self.iteration, views, scene_extent=float(extent), gradients=gradients, split=own)
        children = int(g.nb_points)
        if self._max_primitives() > 0:
            room = max(0, self._max_primitives() - n) // (children - 1)
            split = keep_largest(gradients, room, split)

        before = torch.arange(n, device=split.device)
        if bool(split.any()):
            g.densify_and_split_sigma_big(split)
        elif bool(own.any()):
            self._restart_hosts_statistics()  # as the host does after growth
        origins = torch.cat([before[~split]] + [before[split]] * children)
        self._check_count(origins, "split")

        candidates = ((torch.sigmoid(g._mask) <= mask_threshold) | (g.get_opacity < min_opacity)).reshape(-1)
        if self.adapter.prunes_large_at(self.iteration, bool(max_screen_size)):
            candidates |= g.get_max_scaling > max_screen_size * extent
        self._remove(self.adapter.prune(self.iteration, views, candidates=candidates, origins=origins,
                                        opacities=g.get_opacity.detach()))
        torch.cuda.empty_cache()

    def _max_primitives(self) -> int:
        return int(self.options.boost_max_convexes)

    def _restart_hosts_statistics(self) -> None:
        g = self.gaussians
        for sums in (g.convex_accumulation_gradient_accum, g.sigma_accumulation_gradient_accum, g.denom, g.max_radii2D,
                     g.max_density_factor):
            sums.zero_()

    def only_prune(self, *given: Any, **named: Any) -> Any:
        """The host's own pruning after growth has ended, with its arguments."""
        if self.on:
            self._apply_gradients()
        return self.gaussians.only_prune(*given, **named)


load = functools.partial(_drawing.load, Boost.backbone)
