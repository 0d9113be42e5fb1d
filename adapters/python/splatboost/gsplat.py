# SPDX-License-Identifier: Apache-2.0
"""SplatBoost as a densification strategy of gsplat (https://github.com/nerfstudio-project/gsplat).

gsplat keeps its tensors, optimizers and operations; SplatBoost adds the scores and the decisions. gsplat rasterizes
with its own boxes, so the compact box is not used.
"""

from __future__ import annotations

import numbers
from dataclasses import dataclass, field
from typing import Any, Callable, Dict, List, Optional, Sequence

import torch

from . import _library as lib
from ._rasterize import rasterize
from ._tensors import check
from .adapter import Adapter, ScoredView
from .camera import Camera
from .distributed import Processes, Shard, SharedAdapter
from .operations import as_bytes

try:
    from gsplat.strategy import DefaultStrategy, ops
except ImportError as e:
    raise ImportError("splatboost.gsplat needs gsplat, which is not installed: pip install gsplat (%s)" % e) from e

Params = Dict[str, Any]  # or a torch.nn.ParameterDict
Optimizers = Dict[str, torch.optim.Optimizer]

#: End of growth in 3DGS. The adapter is called until then even if it ends growth earlier, because it still prunes.
_PUBLISHED_GROWTH_END = 15000

_REQUIRED = ("means", "scales", "quats", "opacities", "sh0", "shN")


@dataclass
class View:
    """A training view that may be scored, in gsplat's conventions.

    viewmat  [4,4] camera from world
    K        [3,3] intrinsics in pixels
    image    [H,W,3] ground truth: uint8, or float32 in [0, 1]
    mask     bool [H,W]: valid pixels; None: all
    """

    viewmat: torch.Tensor
    K: torch.Tensor
    image: torch.Tensor
    mask: Optional[torch.Tensor] = None

    def __post_init__(self) -> None:
        for name, shape in (("viewmat", (4, 4)), ("K", (3, 3))):
            value = getattr(self, name)
            if not isinstance(value, torch.Tensor) or tuple(value.shape) != shape:
                raise ValueError("%s: expected a tensor of shape %s, got %s" % (name, list(shape), lib.shown(value)))
        check(self.image, "image", (torch.uint8, torch.float32), ("H", "W", 3))
        if self.mask is not None:
            check(self.mask, "mask", (torch.bool, torch.uint8), tuple(self.image.shape[:2]))


#: Corrections of simple_trainer that its loss sees and scores do not; their names differ between versions of gsplat.
_CORRECTIONS = ("post_processing", "use_bilateral_grid", "pose_opt", "pose_noise")

#: Optimizers that update the Gaussians of one view only, so they must step at every iteration.
_OF_ONE_VIEW = ("SelectiveAdam", "SparseAdam")


def score_views(config: Any, views: Any) -> None:
    """Calls score_on(views, config) of config.strategy (simple_trainer's configuration) if it is SplatBoostStrategy."""
    if isinstance(config.strategy, SplatBoostStrategy):
        config.strategy.score_on(views, config)


def optimizers_at(strategy: Any, optimizers: Optimizers, step: int) -> List[torch.optim.Optimizer]:
    """The optimizers that step now, for any strategy (all, unless it is ours); the others keep their gradients."""
    if not isinstance(strategy, SplatBoostStrategy):
        return list(optimizers.values())
    return [optimizer for name, optimizer in optimizers.items()
            if type(optimizer).__name__ in _OF_ONE_VIEW or strategy.steps_at(name, step)]


def _view_of(item: Dict[str, Any]) -> View:
    """Converts an item of a data set to a View."""
    image, mask = torch.as_tensor(item["image"]), item.get("mask")
    image = image if image.dtype == torch.uint8 else image.float() / 255
    return View(torch.inverse(torch.as_tensor(item["camtoworld"]).float()), torch.as_tensor(item["K"]).float(),
                image[..., :3], None if mask is None else torch.as_tensor(mask))


@dataclass
class SplatBoostStrategy(DefaultStrategy):  # type: ignore[misc]
    """Multi-view consistent densification and pruning, a replacement of gsplat's DefaultStrategy.

    Of DefaultStrategy's settings, only absgrad, prune_opa, prune_scale3d, reset_every, revised_opacity and verbose are
    used; SplatBoost decides when to grow, for any length of run. reset_every refers to a run of 30 000 iterations.

    max_steps    length of the run
    settings     of splatboost.Adapter: vcd, vcp, schedule, tau_d, views (K), … Integers for booleans and counts
    max_gaussians  cap on the number of Gaussians after growth, over all processes; 0: no cap
    eps2d, near_plane, antialiased, background   the arguments of your calls of gsplat's rasterization()

    Several processes: as for gsplat's rasterization(..., distributed=True), each holds its own Gaussians, distributed
    round-robin (points[rank::count]), and all have the same views. The decisions equal those of one process that
    renders all cameras of a step. At events, every process gathers all Gaussians and renders its share of the views.

    Pass it the training views, call rasterization(..., absgrad=strategy.absgrad), and step the optimizers that
    optimizers_at() returns, before or after step_post_backward:

        strategy.score_on(views)
        …
        loss.backward()
        for optimizer in optimizers_at(strategy, optimizers, step):
            optimizer.step()
            optimizer.zero_grad(set_to_none=True)
        strategy.step_post_backward(params, optimizers, state, step, info, packed)

    Copies and pickles do not contain the views. To resume a run, restore params, optimizers, state and the strategy, and call
    score_on(views) again, but not initialize_state().
    """

    absgrad: bool = True
    max_steps: int = 30_000
    max_gaussians: int = 0
    settings: Dict[str, float] = field(default_factory=dict)
    eps2d: float = 0.3
    near_plane: float = 0.01
    antialiased: bool = False
    background: Sequence[float] = (0.0, 0.0, 0.0)
    seed: int = 0

    def __post_init__(self) -> None:
        self._scaled_by = 1.0
        self._adapter: Optional[Adapter] = None
        self._shard: Optional[Shard] = None
        self._views: Any = ()
        self._lists_views = True
        self._device: Any = None
        self._scene: Dict[str, Any] = {}

    def __getstate__(self) -> Dict[str, Any]:
        # Without the data set: simple_trainer writes its configuration, which contains the strategy, to cfg.yml.
        return {**self.__dict__, "_views": (), "_scene": {}, "_adapter": None}

    def score_on(self, views: Any, config: Any = None) -> None:
        """Sets the training views to score, up to K at each event.

        views   Views; or a data set such as that of gsplat's simple_trainer, whose items have camtoworld, K, image
                (0 to 255) and optionally mask
        config  simple_trainer's: max_steps, near_plane and antialiased are read from it, and reset_every is divided by
                its steps_scaler; its camera_model must be pinhole, and it must not correct images or poses
        """
        if not hasattr(views, "__len__") or not hasattr(views, "__getitem__"):
            raise ValueError("views: expected a list of View or a data set, got %s" % lib.shown(views))
        if len(views) == 0:
            raise ValueError("views: expected at least one training view")
        model = getattr(config, "camera_model", "pinhole")
        if model != "pinhole":
            raise ValueError("config: expected camera_model pinhole, with which views are scored, got %s" % model)
        for name in _CORRECTIONS:
            if getattr(config, name, None):
                raise ValueError("config: expected %s off, because views are scored without it, got %s"
                                 % (name, getattr(config, name)))
        self._views = views
        self._lists_views = isinstance(views[0], View)
        for name in ("max_steps", "near_plane", "antialiased"):
            if config is not None and hasattr(config, name):
                setattr(self, name, getattr(config, name))
        # simple_trainer has scaled its strategy's iterations; here reset_every refers to a run of 30 000.
        scaler = float(getattr(config, "steps_scaler", self._scaled_by))
        self.reset_every: int = round(self.reset_every * self._scaled_by / scaler)
        self._scaled_by = scaler
        self._adapter = None

    def initialize_state(self, scene_scale: float = 1.0) -> Dict[str, Any]:
        """State of a run. Its tensors have one row per Gaussian, which gsplat's operations keep up to date."""
        self._shard = None
        return {"scene_scale": scene_scale, "grad2d": None, "absgrad2d": None, "count": None}

    def check_sanity(self, params: Params, optimizers: Optimizers) -> None:
        super().check_sanity(params, optimizers)
        for name in _REQUIRED:
            if name not in params:
                raise ValueError("params: expected %s, got %s" % (name, ", ".join(sorted(params.keys()))))

    def adapter(self, device: Any = None) -> Adapter:
        """The adapter in use; on the given device, if any."""
        if self._adapter is None or (device is not None and self._adapter.device != torch.device(device)):
            device = "cpu" if device is None else device
            settings = {name: int(v) if isinstance(v, numbers.Real) and float(v).is_integer() else v
                        for name, v in self.settings.items()}
            settings.setdefault("absgrad", bool(self.absgrad))
            settings.setdefault("growth_after_reset", 3000)  # here only resets clear the space around the cameras
            settings.setdefault("prune_large", True)  # not measured without the rule for that space
            # The optimizers are gsplat's, and so are their rates.
            settings.update(rest_interval=1, rest_rate=1, rest_rate_few=1, rate_by_depth=False)
            steps = lib.whole(self.max_steps, "max_steps", 1)
            self._adapter = Adapter("vanilla", total_iterations=steps, device=device, seed=self.seed, **settings)
        return self._adapter

    def steps_at(self, name: str, step: int) -> bool:
        """Whether the optimizer of this parameter steps now; between steps gradients accumulate."""
        last = step + 1 >= self.max_steps
        return last or self.adapter(self._device).steps_at("f_rest" if name == "shN" else "xyz", step + 1)

    def step_pre_backward(
        self, params: Params, optimizers: Optimizers, state: Dict[str, Any], step: int, info: Dict[str, Any]
    ) -> None:
        if "means2d" not in info:
            raise ValueError("info: expected means2d, as returned by gsplat's rasterization()")
        info["means2d"].retain_grad()

    @torch.no_grad()
    def step_post_backward(
        self,
        params: Params,
        optimizers: Optimizers,
        state: Dict[str, Any],
        step: int,
        info: Dict[str, Any],
        packed: bool = False,
        scene: Any = None,
    ) -> None:
        """scene: gsplat 1.6's scene object, which keeps data beside the parameters of Gaussians."""
        if not self._views:
            raise ValueError("no views to score: call score_on(views) before training")
        for given, name, needed in ((info, "info", ("means2d", "radii", "width", "height", "n_cameras")),
                                    (state, "state", ("scene_scale", "grad2d", "absgrad2d", "count"))):
            lacks = [key for key in needed if key not in given]
            if lacks:
                origin = "gsplat's rasterization()" if name == "info" else "initialize_state()"
                raise ValueError("%s: expected that of %s, got one without %s" % (name, origin, ", ".join(lacks)))
        iteration = step + 1
        self._device = params["means"].device
        self._scene = {} if scene is None else {"scene": scene}
        adapter = self.adapter(self._device)
        until = self._at(max(adapter.settings["densify_until"], _PUBLISHED_GROWTH_END))
        if iteration < until:
            self._gather(params, state, info, packed)
        published = iteration > self._at(500) and iteration < until and iteration % 100 == 0
        if iteration < until and adapter.grows_at(iteration, published):
            self._apply_pending(params, optimizers)
            self._grow(params, optimizers, state, iteration)
        if adapter.prunes_at(iteration, False):  # with other settings, growth may not have ended
            self._apply_pending(params, optimizers)
            self._prune_late(params, optimizers, state, iteration)
        if adapter.resets_opacities_at(iteration, iteration < until and iteration % self._at(self.reset_every) == 0):
            self._apply_pending(params, optimizers)
            ops.reset_opa(params=params, optimizers=optimizers, state=state, value=2 * self.prune_opa)

    def _rows(self, params: Params) -> Shard:
        """The Gaussians that this process holds."""
        n = params["means"].shape[0]
        if self._shard is None:
            self._shard = Shard.dealt(n, Processes(), params["means"].device)
        elif self._shard.ids.shape[0] != n:
            raise ValueError("params: %d Gaussians, but expected %d from this strategy; does other code add or remove some?"
                             % (n, self._shard.ids.shape[0]))
        return self._shard

    def _shared(self, params: Params) -> SharedAdapter:
        shard = self._rows(params)
        several = shard.processes.count > 1  # a single process holds its rows in the order of their ids
        return SharedAdapter(self.adapter(), shard if several else None, shard.processes, self.max_gaussians)

    def _at(self, published: int) -> int:
        from .schedule import PUBLISHED_ITERATIONS, scaled_iteration

        return scaled_iteration(published, self.max_steps, PUBLISHED_ITERATIONS)

    def _gather(self, params: Params, state: Dict[str, Any], info: Dict[str, Any], packed: bool) -> None:
        n = params["means"].shape[0]
        means2d, radii = info["means2d"], info["radii"]
        if not hasattr(means2d, "absgrad") and self.adapter(self._device).settings["absgrad"]:
            raise ValueError("info: means2d without absgrad: call rasterization(..., absgrad=True); in several processes gsplat "
                             "has none: give the strategy absgrad=False")
        if means2d.grad is None:
            raise ValueError("info: means2d without a gradient: call step_pre_backward before backward, and "
                             "step_post_backward after it")
        if radii.dim() == means2d.dim():  # gsplat since 1.5: one radius per axis
            radii = radii.amin(dim=-1)
        # To NDC units, for the loss of one camera.
        half = [0.5 * info["n_cameras"] * info[size] for size in ("width", "height")]

        def add(name: str, values: torch.Tensor) -> None:
            if state[name] is None:
                state[name] = torch.zeros(n, device=values.device)
            if packed:
                state[name].index_add_(0, info["gaussian_ids"], values)
            else:  # a mask, since indexing would synchronize with the GPU to get the number of rows
                state[name] += values.masked_fill(radii <= 0, 0).sum(dim=0)

        for name, gradient in (("grad2d", means2d.grad), ("absgrad2d", getattr(means2d, "absgrad", None))):
            if gradient is not None:
                add(name, torch.stack([gradient[..., axis] * half[axis] for axis in (0, 1)], dim=-1).norm(dim=-1))
        add("count", torch.ones(means2d.shape[:-1], device=means2d.device))

    def _apply_pending(self, params: Params, optimizers: Optimizers) -> None:
        """Applies the accumulated gradients, which would be lost when the parameters are replaced."""
        for name, optimizer in optimizers.items():
            if params[name].grad is not None and type(optimizer).__name__ not in _OF_ONE_VIEW:
                optimizer.step()
                optimizer.zero_grad(set_to_none=True)

    def _sources(self, params: Params) -> List[Callable[[], ScoredView]]:
        shard = self._rows(params)
        if shard.processes.count > 1:
            params = {name: shard.all_rows(params[name].detach()) for name in _REQUIRED}

        def source(index: int) -> Callable[[], ScoredView]:
            return lambda: self._score(params, index)

        return [source(j) for j in range(len(self._views))]

    def _score(self, params: Params, index: int) -> ScoredView:
        view, device = self._views[index], params["means"].device
        if not self._lists_views:
            view = _view_of(view)
        truth = as_bytes(view.image.permute(2, 0, 1)).to(device).contiguous()
        height, width = truth.shape[1:]
        bands = 1 + params["shN"].shape[1]
        render = rasterize(
            Camera.from_matrices(width, height, view.K.cpu(), view.viewmat.cpu()),
            params["means"],
            torch.sigmoid(params["opacities"]),
            scales=torch.exp(params["scales"]),
            rotations=params["quats"],
            sh_dc=params["sh0"],
            sh_rest=params["shN"],
            sh_degree=int(bands**0.5) - 1,
            background=self.background,
            beta=1.0,
            low_pass=self.eps2d,
            compensate_opacity=self.antialiased,
            near_plane=self.near_plane,
        )
        mask = None if view.mask is None else view.mask.to(device)
        return ScoredView(render.color, truth, mask, render)

    def _grow(self, params: Params, optimizers: Optimizers, state: Dict[str, Any], iteration: int) -> None:
        count = state["count"].clamp_min(1)
        n, device = count.shape[0], count.device
        absolute = None if state["absgrad2d"] is None else state["absgrad2d"] / count
        longest = torch.exp(params["scales"]).amax(dim=-1)
        gradients = state["grad2d"] / count
        border = self.adapter().settings["percent_dense"] * state["scene_scale"]
        large = gradients >= self.adapter().settings["gradient_threshold"]  # 3DGS's own rule, where absgrad is off
        shared, shard = self._shared(params), self._rows(params)
        clone, split = shared.grow(
            iteration,
            self._sources(params),
            scene_extent=float(state["scene_scale"]),
            gradients=gradients,
            gradients_abs=absolute,
            max_scales=longest,
            clone=large & (longest <= border),
            split=large & (longest > border),
        )
        state["origins"] = torch.arange(n, device=device)
        if clone.any():
            ops.duplicate(params=params, optimizers=optimizers, state=state, mask=clone, **self._scene)
        made_from = shard.grow(clone, split)
        if split.any():
            whole = torch.cat([split, torch.zeros(int(clone.sum()), dtype=torch.bool, device=device)])
            places = self._children(params, whole, shard, iteration, self.seed)
            ops.split(params=params, optimizers=optimizers, state=state, mask=whole,
                      revised_opacity=self.revised_opacity, **self._scene)
            params["means"][-places.shape[0]:] = places
        origins = state.pop("origins")
        if shared.shard is not None:
            origins = made_from

        opacities = torch.sigmoid(params["opacities"]).reshape(-1)
        candidates = opacities < self.prune_opa
        if self.adapter().prunes_large_at(iteration, iteration > self._at(self.reset_every)):
            candidates |= torch.exp(params["scales"]).amax(dim=-1) > self.prune_scale3d * state["scene_scale"]
        removed = shared.prune(
            iteration, self._sources(params), candidates=candidates, origins=origins, opacities=opacities
        )
        self._remove(params, optimizers, state, removed)
        for name in ("grad2d", "absgrad2d", "count"):
            if state[name] is not None:
                state[name].zero_()
        if self.verbose:
            print(
                "Step %d: %d duplicated, %d split, %d pruned, %d Gaussians now"
                % (iteration - 1, clone.sum(), split.sum(), removed.sum(), params["means"].shape[0])
            )

    def _prune_late(self, params: Params, optimizers: Optimizers, state: Dict[str, Any], iteration: int) -> None:
        opacities = torch.sigmoid(params["opacities"]).reshape(-1)
        none = torch.zeros_like(opacities, dtype=torch.bool)
        removed = self._shared(params).prune(iteration, self._sources(params), candidates=none, opacities=opacities)
        self._remove(params, optimizers, state, removed)
        if self.verbose:
            print("Step %d: %d pruned, %d Gaussians now" % (iteration - 1, removed.sum(), params["means"].shape[0]))

    @staticmethod
    def _children(params: Params, mask: torch.Tensor, shard: Shard, iteration: int, seed: int) -> torch.Tensor:
        """[2 n, 3] means of the children of split Gaussians; the random draws depend on ids, not on the process."""
        parents = torch.where(mask)[0].repeat(2)
        turn = torch.nn.functional.normalize(params["quats"][parents], dim=-1)
        away = shard.normal(seed, iteration, 3)[-parents.shape[0]:] * torch.exp(params["scales"][parents])
        w, axis = turn[:, :1], turn[:, 1:]
        twice = 2 * torch.cross(axis, away, dim=-1)
        return params["means"][parents] + away + w * twice + torch.cross(axis, twice, dim=-1)

    def _remove(self, params: Params, optimizers: Optimizers, state: Dict[str, Any], removed: torch.Tensor) -> None:
        self._rows(params).remove(removed)
        if removed.any():
            ops.remove(params=params, optimizers=optimizers, state=state, mask=removed, **self._scene)
