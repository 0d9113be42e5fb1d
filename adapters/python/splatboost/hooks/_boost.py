# SPDX-License-Identifier: Apache-2.0
"""Accelerates one training run of a host that has 3DGS's classes. Subclasses override what differs between hosts."""

from __future__ import annotations

import functools
import sys
from typing import Any, Callable, Dict, Iterable, List, Optional, Tuple

import torch

from .._library import LibraryError, NoCudaError
from ..adapter import Adapter, ScoredView
from ..operations import as_bytes, camera_clearances, distances_to_scene, spare_one
from ..schedule import PUBLISHED_ITERATIONS
from . import _drawing

SPLIT_CHILDREN = 2


#: Options that must not be less than this; a host has one of the caps.
_LEAST = {"iterations": 1, "boost_max_gaussians": 0, "boost_max_anchors": 0, "boost_max_convexes": 0}

#: Setting of the adapter → the host's option that it comes from, if their names differ.
_OPTIONS = {
    "beta": "boost_beta",
    "tau_d": "boost_tau_d",
    "densify_from": "densify_from_iter",
    "densify_until": "densify_until_iter",
    "densify_interval": "densification_interval",
    "gradient_threshold": "densify_grad_threshold",
    "gradient_abs_threshold": "densify_grad_abs_threshold",
}


def is_on(options: Any) -> bool:
    """Whether --boost is on; exits the host if it is neither on nor off, or if the iterations or the cap are too few."""
    if options.boost not in ("on", "off"):
        sys.stderr.write("--boost: expected on or off, got %s\n" % options.boost)
        sys.exit(2)
    if options.boost == "off":
        return False
    for name, least in _LEAST.items():
        value = getattr(options, name, least)
        if value < least:
            sys.stderr.write("--%s: expected at least %d, got %s\n" % (name, least, value))
            sys.exit(2)
    return True


def _in_options(message: str, options: Any) -> str:
    """An error about a setting of the adapter as one about the host's option, with the value that the user gave."""
    setting, _, wanted = message.partition(" ")
    setting = setting.rstrip(":")
    option = _OPTIONS.get(setting, setting)
    if not hasattr(options, option):
        return "SplatBoost: --boost options: " + message
    return "--%s: %s, got %s" % (option, wanted.partition(", got ")[0], getattr(options, option))


def adapter_of(backbone: str, options: Any, device: torch.device, settings: Dict[str, Any]) -> Adapter:
    """The adapter of a run with these options; exits the host if a setting is invalid, or if there is no library for the
    device."""
    try:
        return Adapter(backbone, total_iterations=options.iterations, device=device, **settings)
    except ValueError as error:
        sys.stderr.write(_in_options(str(error), options) + "\n")
    except (LibraryError, NoCudaError) as error:
        sys.stderr.write("SplatBoost: %s; --boost off trains without it\n" % error)
    sys.exit(2)


def announce(adapter: Adapter, schedule: str) -> None:
    """Prints one line about how the run is accelerated."""
    rules = "literal" if adapter.settings["literal"] else "default"
    box = "published box" if adapter.beta is None else "beta %g" % adapter.beta
    print("SplatBoost: %s rules of %s, %s, tau_d %g, %s" % (
        rules, adapter.backbone, box, adapter.settings["tau_d"], schedule), flush=True)


#: What torch raises if a GPU has too little memory; RuntimeError before torch 1.13.
_OUT_OF_MEMORY = getattr(torch.cuda, "OutOfMemoryError", RuntimeError)


def _fits(parameters: List[torch.Tensor]) -> bool:
    """Whether a GPU has memory for a copy of these beside the most that the run has used until now. Between iterations the
    gradients and a render's temporary memory are free, but the next iteration needs them again."""
    needed: Dict[torch.device, int] = {}
    for p in parameters:
        if p.is_cuda:
            needed[p.device] = needed.get(p.device, 0) + p.numel() * p.element_size()
    return all(torch.cuda.mem_get_info(device)[0] + torch.cuda.memory_reserved(device)
               - torch.cuda.max_memory_allocated(device) > 1.1 * size for device, size in needed.items())


class Averages:
    """Means of an optimizer's parameters."""

    def __init__(self) -> None:
        self._forget()

    def _forget(self) -> None:
        self._parameters: List[torch.Tensor] = []
        self._means: List[torch.Tensor] = []
        self._count = 0

    def add(self, optimizer: Any) -> None:
        """Adds the present values. Hosts replace parameters whose rows they add, remove or set; earlier values are then
        dropped. So are all if a GPU has too little memory for means: a run can do without."""
        parameters = [p for group in optimizer.param_groups for p in group["params"]]
        try:
            if [id(p) for p in parameters] != [id(p) for p in self._parameters]:
                self._forget()
                if not _fits(parameters):
                    return
                self._parameters = parameters
                self._means = [torch.zeros_like(p) for p in parameters]
            self._count += 1
            for mean, p in zip(self._means, parameters):
                mean.lerp_(p.detach(), 1 / self._count)
        except _OUT_OF_MEMORY:
            self._forget()

    def take(self) -> None:
        """Sets the parameters to their means, if there are any, which it then drops."""
        for mean, p in zip(self._means, self._parameters):
            p.detach().copy_(mean)
        self._forget()


def step_fused(optimizer: Any) -> None:
    """A step of the host's optimizer. Torch's Adam updates each group on a GPU with one kernel instead of about ten, where it
    can. The groups are as before afterwards, so checkpoints load with boost off, without a GPU, and in older versions."""
    fused = []
    if type(optimizer) is torch.optim.Adam and int(torch.__version__.split(".")[0]) >= 2:
        fused = [group for group in optimizer.param_groups if group.get("fused", False) is None and _can_fuse(group)]
    for group in fused:
        group["fused"] = True
        for p in group["params"]:
            state = optimizer.state.get(p)
            if state:
                state["step"] = state["step"].to(p.device)  # a checkpoint's may be on the CPU
    try:
        optimizer.step()
    finally:
        for group in fused:
            group["fused"] = None


def step_scaled(optimizer: Any, adapter: Adapter, iteration: int) -> None:
    """step_fused() with the adapter's factors on the learning rates of the groups."""
    groups = optimizer.param_groups
    rates = [group["lr"] for group in groups]
    for group in groups:
        group["lr"] *= adapter.rate_factor(group["name"], iteration)
    try:
        step_fused(optimizer)
    finally:
        for group, rate in zip(groups, rates):
            group["lr"] = rate


def _can_fuse(group: Dict[str, Any]) -> bool:
    return not any(group.get(name) for name in ("foreach", "capturable", "differentiable")) and all(
        p.is_cuda and p.dtype == torch.float32 and (p.grad is None or p.grad.stride() == p.stride()) for p in group["params"])


def scored_view(camera: Any, image: torch.Tensor, render: Any = None) -> ScoredView:
    """The view of a host's camera. Outside of the host's mask, if its cameras have one, pixels are not trained and would
    remain errors forever, so they are as in the photo. They still count as pixels: the host's loss is a mean over all."""
    truth = as_bytes(camera.original_image[0:3].to(image.device))
    mask = getattr(camera, "alpha_mask", None)
    if mask is not None:
        within = (mask.to(image.device) > 0.5).reshape(image.shape[-2:])
        image = torch.where(within, image, truth.to(image.dtype) / 255)
    return ScoredView(image.contiguous(), truth, None, render)


def typical_depth(cameras: List[Any], means: torch.Tensor) -> float:
    """Median over cameras of the median depth of the means [N,3] in their pictures; 0 if none shows any. Of many cameras and
    means, even subsets are taken."""
    means = means.detach()[::max(1, means.shape[0] // 100000)].float()
    homogeneous = torch.cat([means, torch.ones_like(means[:, :1])], dim=1)
    medians = []
    for camera in cameras[::max(1, len(cameras) // 200)]:
        x, y, _, depth = (homogeneous @ camera.full_proj_transform.to(means.device)).unbind(1)
        inside = (depth > 0) & (x.abs() < depth) & (y.abs() < depth)
        if bool(inside.any()):
            medians.append(depth[inside].median())
    return float(torch.stack(medians).median()) if medians else 0.0


def mean_gradients(sums: torch.Tensor, counts: torch.Tensor) -> torch.Tensor:
    """Means per Gaussian; 0 where a gradient was NaN, as in the hosts."""
    return torch.nan_to_num(sums / counts.clamp_min(1.0))


class Boost:
    """Replaces the host's calls that grow, prune and step.

    gaussians, scene   the host's
    options            its optimization parameters, with those that the patch adds (boost…)
    render             renders a training camera without randomness, as the loss sees it
    model_path         the host's output folder
    checkpoints        iterations at which the host writes checkpoints: all groups step then, so no gradient is lost

    With --boost off every call is forwarded to the host.
    """

    backbone = "vanilla"
    published_iterations = PUBLISHED_ITERATIONS
    #: Host option → (setting of the adapter, the host's default). Other values were set by the user and are passed on.
    host_options: Dict[str, Tuple[str, float]] = {
        "densify_from_iter": ("densify_from", 500),
        "densify_until_iter": ("densify_until", 15000),
        "densification_interval": ("densify_interval", 100),
        "densify_grad_threshold": ("gradient_threshold", 0.0002),
        "percent_dense": ("percent_dense", 0.01),
        "lambda_dssim": ("lambda_dssim", 0.2),
    }
    #: Options that are iterations of the host's run; converted to iterations of the published run for the adapter.
    _scaled = ("densify_from_iter", "densify_until_iter")
    #: Whether absolute gradients are accumulated here; False if the host does so itself.
    gathers_absolute = True
    #: Whether a run ends with the means of the last parameters in the optimizer of the Gaussians. False where a network
    #: with an optimizer of its own moves the Gaussians, because both would have to be averaged.
    averages = True
    #: [C,3] of the training cameras, and [C] their distances to the scene; None: not used.
    _centres: Optional[torch.Tensor] = None
    _distances: Optional[torch.Tensor] = None

    def __init__(self, gaussians: Any, scene: Any, options: Any, render: Callable[[Any], torch.Tensor],
                 model_path: str, checkpoints: Iterable[int] = ()):
        self.on = is_on(options)
        self.gaussians = gaussians
        self.options = options
        self.iteration = 0
        if not self.on:
            _drawing.forget(model_path)
            return
        self._scene = scene
        self._render = render
        self._checkpoints = frozenset(checkpoints)
        self._device = self._means().device
        self.adapter = adapter_of(self.backbone, options, self._device, self._settings())
        self._averages = Averages()
        self._describe_scene()
        self._extend_growth()  # changes the host's options, which _settings() reads
        gaussians.splatboost = _drawing.Drawing(self.adapter.beta, absolute=self.gathers_absolute)
        self._restart_statistics()
        _drawing.save(model_path, self.backbone, self.adapter.beta)
        announce(self.adapter, self._schedule())

    def _means(self) -> torch.Tensor:
        """[N,3], or another tensor of the host with one row per primitive."""
        return self.gaussians.get_xyz  # type: ignore[no-any-return]

    def _describe_scene(self) -> None:
        """Tells the adapter what it needs to know about the scene. The distances of the training cameras are to the Gaussians
        that the run begins with, which are the checkpoint's if it is resumed."""
        known: Dict[str, Any] = {}
        cameras = self._scene.getTrainCameras()
        if "training_views" in self.adapter.settings:
            known["training_views"] = len(cameras)
        if self.adapter.settings.get("min_clearance", 0) > 0:
            centres = torch.stack([camera.camera_center.detach().float().reshape(3) for camera in cameras])
            self._centres = centres.to(self._device)
            self._distances = distances_to_scene(self._centres, self._means().detach())
            if not bool((self._distances > 0).any()):  # random points: their free space is cleared by resets of opacities
                known["random_points"] = True
        extent = float(self._scene.cameras_extent) if self.adapter.settings.get("rate_by_depth", False) else 0.0
        if extent > 0:  # 0 with all cameras at one place
            known["depth_ratio"] = typical_depth(cameras, self._means()) / extent
        if known:
            self.adapter = adapter_of(self.backbone, self.options, self._device, dict(self._settings(), **known))

    def _clearances(self) -> Optional[torch.Tensor]:
        if self._centres is None or self._distances is None:
            return None
        return camera_clearances(self._means().detach(), self._centres, self._distances)

    def _grows_at(self, iteration: int) -> bool:
        return self.adapter.grows_at(iteration, False)

    def _growth(self) -> List[int]:
        """The iterations at which Gaussians grow."""
        return [i for i in range(1, self.options.iterations + 1) if self._grows_at(i)]

    def _extend_growth(self) -> None:
        """Raises the host's option that ends growth, unless the user set it: in longer runs growth ends later."""
        options, known = self.options, self.host_options.get("densify_until_iter")
        if known and options.densify_until_iter == known[1]:
            options.densify_until_iter = max([options.densify_until_iter] + [i + 1 for i in self._growth()])

    def _schedule(self) -> str:
        """Describes the schedule in iterations of this run."""
        total = self.options.iterations
        grows = self._growth()
        late = [i for i in range(1, total + 1) if self.adapter.prunes_at(i, False)]
        told = "no growth" if not grows else "growth at %d to %d every %d" % (
            grows[0], grows[-1], grows[1] - grows[0] if len(grows) > 1 else total)
        if late:
            told += ", late pruning at " + (", ".join(map(str, late)) if len(late) < 4 else "%d to %d" % (late[0], late[-1]))
        return told + (", steps by schedule" if self.adapter.settings["schedule"] else ", a step every iteration")

    def _settings(self) -> Dict[str, Any]:
        return dict(self._host_settings(), beta=self.options.boost_beta, tau_d=self.options.boost_tau_d)

    def _host_settings(self) -> Dict[str, Any]:
        """Adapter settings from the host's options that the user changed."""
        options = self.options
        settings: Dict[str, Any] = {}
        for name, (setting, default) in self.host_options.items():
            value = getattr(options, name, default)  # a fork may lack it
            if value == default:
                continue
            if name in self._scaled:
                value = int(round(value * self.published_iterations / options.iterations))
            settings[setting] = value
        if "densify_grad_threshold" in self.host_options and not hasattr(options, "densify_grad_abs_threshold"):
            # Splits, which absolute gradients decide on, become rarer or more frequent with the clones.
            ratio = options.densify_grad_threshold / self.host_options["densify_grad_threshold"][1]
            if ratio != 1:
                known = adapter_of(self.backbone, options, self._device, {}).settings
                settings["gradient_abs_threshold"] = ratio * known["gradient_abs_threshold"]
        return settings

    def begin(self, iteration: int) -> None:
        self.iteration = iteration

    # --- statistics of the host's Gaussians

    def add_densification_stats(self, *given: Any, **named: Any) -> Any:
        """As the host's, with its arguments."""
        result = self.gaussians.add_densification_stats(*given, **named)
        if self.on:
            self._gather(*given, **named)
        return result

    def _gather(self, viewspace_points: torch.Tensor, seen: torch.Tensor) -> None:
        """seen: bool [N], or indices of any shape, depending on the host."""
        # Masks, because indexing with a bool tensor would synchronize with the GPU to get the number of rows.
        if seen.dtype != torch.bool:
            none = torch.zeros((self._seen.shape[0],), dtype=torch.bool, device=seen.device)
            seen = none.index_fill_(0, seen.reshape(-1), True)
        seen = seen.reshape(-1, 1)
        extra = self._views_of_one() - 1.0
        if extra > 0:
            self.gaussians.denom += extra * seen
        if self.gathers_absolute:
            gradients = self.gaussians.splatboost.screen_points.grad
            self._absolute += torch.norm(gradients[:, 2:], dim=-1, keepdim=True).masked_fill_(~seen, 0)
            self._seen += (1.0 + extra) * seen

    def _views_of_one(self) -> float:
        """Weight of one view in the mean of gradients."""
        return 1.0

    def _signed_gradients(self) -> torch.Tensor:
        return mean_gradients(self.gaussians.xyz_gradient_accum, self.gaussians.denom)

    def _absolute_gradients(self) -> torch.Tensor:
        return mean_gradients(self._absolute, self._seen)

    def _restart_statistics(self) -> None:
        n = self._means().shape[0]
        self._absolute = torch.zeros((n, 1), device=self._device)
        self._seen = torch.zeros((n, 1), device=self._device)

    def _views(self) -> List[Callable[[], ScoredView]]:
        return [functools.partial(self._score, camera) for camera in self._scene.getTrainCameras()]

    def _score(self, camera: Any) -> ScoredView:
        return scored_view(camera, self._render(camera))

    # --- growth and pruning

    def grows(self) -> bool:
        """Whether Gaussians grow at this iteration."""
        options = self.options
        own = self.iteration > options.densify_from_iter and self.iteration % options.densification_interval == 0
        return self.adapter.grows_at(self.iteration, own) if self.on else own

    def densify_and_prune(self, *given: Any, **named: Any) -> Any:
        """As the host's, with its arguments."""
        if not self.on:
            return self.gaussians.densify_and_prune(*given, **named)
        return self._densify_and_prune(*given, **named)

    def _densify_and_prune(self, max_grad: float, min_opacity: float, extent: float, max_screen_size: Any,
                           *radii: torch.Tensor) -> None:
        """radii: only for hosts that keep them through growth."""
        g = self.gaussians
        self._apply_gradients()
        views = self._views()
        gradients = self._signed_gradients()
        max_scales = g.get_scaling.detach().max(dim=1).values
        clone, split = self.adapter.grow(
            self.iteration, views, scene_extent=float(extent), gradients=gradients,
            gradients_abs=self._absolute_gradients(), max_scales=max_scales,
            max_primitives=self._max_primitives(), **self._own_growth(gradients, max_scales, float(extent)))
        if radii:
            g.tmp_radii = radii[0]
        origins = self._grow(clone, split, float(extent))
        candidates = (g.get_opacity < min_opacity).reshape(-1)
        if self.adapter.prunes_large_at(self.iteration, bool(max_screen_size)):
            candidates |= g.get_scaling.max(dim=1).values > 0.1 * extent
        remove = self.adapter.prune(self.iteration, views, candidates=candidates, origins=origins,
                                    opacities=g.get_opacity.detach(), clearances=self._clearances())
        self._remove(remove)
        if radii:
            g.tmp_radii = None
        self._restart_statistics()

    def _max_primitives(self) -> int:
        """Cap on the number of primitives after growth; 0: no cap."""
        return int(self.options.boost_max_gaussians)

    def _own_growth(self, gradients: torch.Tensor, max_scales: torch.Tensor, extent: float) -> Dict[str, torch.Tensor]:
        """The host's own clone and split masks, for an adapter without absolute gradients."""
        return {}

    def _grow(self, clone: torch.Tensor, split: torch.Tensor, extent: float) -> torch.Tensor:
        """Lets the host clone and split these; returns for each Gaussian the previous index it was made from."""
        g = self.gaussians
        n = clone.shape[0]
        percent_dense = g.percent_dense
        origins = torch.arange(n, device=clone.device)
        try:
            # The host tests sizes too: let every Gaussian count as small, then as large, so that only the masks decide.
            g.percent_dense = float("inf")
            self._host_clone(clone, extent)
            origins = torch.cat([origins, origins[clone]])
            self._check_count(origins, "cloned")
            g.percent_dense = -1.0
            self._host_split(split, extent)
        finally:
            g.percent_dense = percent_dense
        kept = torch.ones_like(origins, dtype=torch.bool)
        kept[:n] = ~split
        origins = torch.cat([origins[kept]] + [torch.arange(n, device=clone.device)[split]] * SPLIT_CHILDREN)
        self._check_count(origins, "split")
        return origins

    def _check_count(self, origins: torch.Tensor, what: str) -> None:
        n = self._means().shape[0]
        if n != origins.shape[0]:
            raise RuntimeError("splatboost: expected %d primitives after the host %s some, got %d: its "
                               "densify functions were changed" % (origins.shape[0], what, n))

    def _host_clone(self, mask: torch.Tensor, extent: float) -> None:
        self.gaussians.densify_and_clone(mask.float().unsqueeze(1), 0.5, extent)

    def _host_split(self, mask: torch.Tensor, extent: float) -> None:
        self.gaussians.densify_and_split(mask.float().unsqueeze(1), 0.5, extent, SPLIT_CHILDREN)

    def _remove(self, mask: torch.Tensor) -> torch.Tensor:
        mask = spare_one(self.gaussians.get_opacity.detach().reshape(-1), mask)
        if bool(mask.any()):
            self.gaussians.prune_points(mask)
        return mask

    def prune_late(self) -> None:
        """Late pruning by scores, at the iterations of the schedule."""
        if not self.on or not self.adapter.prunes_at(self.iteration, False):
            return
        g = self.gaussians
        self._apply_gradients()
        opacities = g.get_opacity.detach()
        none = torch.zeros((opacities.shape[0],), dtype=torch.bool, device=self._device)
        remove = self.adapter.prune(self.iteration, self._views(), candidates=none, opacities=opacities,
                                    clearances=self._clearances(), max_primitives=self._max_primitives())
        # Hosts that keep radii through growth index them in prune_points.
        g.tmp_radii = torch.zeros((opacities.shape[0],), device=self._device)
        remove = self._remove(remove)
        g.tmp_radii = None
        self._keep(~remove)
        self._pruned()

    def prune_points(self, mask: torch.Tensor, *given: Any, **named: Any) -> Any:
        """As the host's, with its arguments, for hosts that remove Gaussians outside of growth too."""
        if self.on:
            self._apply_gradients()
        result = self.gaussians.prune_points(mask, *given, **named)
        if self.on:
            self._keep(~mask)
        return result

    def _keep(self, kept: torch.Tensor) -> None:
        """Keeps the statistics of these Gaussians only."""
        self._absolute, self._seen = self._absolute[kept], self._seen[kept]

    def _pruned(self) -> None:
        """For hosts with per-Gaussian data that prune_points does not handle."""

    def reset_opacity(self, *given: Any, **named: Any) -> Any:
        """As the host's, with its arguments, unless the adapter skips this reset."""
        if self.on:
            if not self.adapter.resets_opacities_at(self.iteration, True):
                return None
            self._apply_gradients()
        return self.gaussians.reset_opacity(*given, **named)

    # --- the optimizer

    @property
    def optimizer(self) -> Any:
        return _Scheduled(self) if self.on else self.gaussians.optimizer

    def steps(self, group: str) -> bool:
        """Whether a group steps now. The host's last step is one iteration before the end of the run."""
        last = self.iteration >= self.options.iterations - 1
        return last or self.iteration in self._checkpoints or self.adapter.steps_at(group, self.iteration)

    def _apply_gradients(self) -> None:
        """Applies accumulated gradients, which would be lost when Gaussians are added or removed."""
        if getattr(self.options, "optimizer_type", "") == "sparse_adam":
            return  # it steps at every iteration, so nothing is accumulated
        step_scaled(self.gaussians.optimizer, self.adapter, self.iteration)
        self.gaussians.optimizer.zero_grad(set_to_none=True)

    def average(self) -> None:
        """To be called after the step of each iteration. After the last one, the parameters are set to their means."""
        if not self.averages or not self.adapter.averages_at(self.iteration + 1):
            return
        self._averages.add(self.gaussians.optimizer)
        if self.iteration + 1 == self.options.iterations:
            self._averages.take()


class _Scheduled:
    """Wraps the host's optimizer for its training loop: groups that do not step now keep their gradients."""

    def __init__(self, boost: Boost):
        self._boost = boost
        self._inner = boost.gaussians.optimizer

    def step(self, *sparse: Any) -> None:
        """sparse: arguments of a sparse optimizer, which updates the Gaussians of one view only, so it always steps."""
        waiting = []
        for group in self._inner.param_groups:
            if not sparse and not self._boost.steps(group["name"]):
                waiting += [(p, p.grad) for p in group["params"] if p.grad is not None]
        for parameter, _ in waiting:
            parameter.grad = None
        if sparse:
            self._inner.step(*sparse)
        else:
            step_scaled(self._inner, self._boost.adapter, self._boost.iteration)
        self._inner.zero_grad(set_to_none=True)
        for parameter, gradient in waiting:
            parameter.grad = gradient
        self._boost.average()

    def zero_grad(self, set_to_none: bool = True) -> None:
        """No effect: step() has zeroed the gradients of the groups that stepped."""
