# SPDX-License-Identifier: Apache-2.0
"""SplatBoostStrategy in a training loop: with a test double of gsplat, and with gsplat's own classes and operations
where it is installed. gsplat's rasterizer needs CUDA, so SplatBoost's is used instead."""

import math
import os
import pickle
import subprocess
import sys

import conftest
import gsplat_double
import pytest
import reference
import torch
from test_rasterize import gaussians

import splatboost

N = 24


def forget_gsplat():
    for name in list(sys.modules):
        if name.split(".")[0] == "gsplat" or name == "splatboost.gsplat":
            del sys.modules[name]


@pytest.fixture(params=["double", "gsplat"])
def strategy_module(request):
    import importlib

    forget_gsplat()
    if request.param == "double":
        gsplat_double.install()
    else:
        pytest.importorskip("gsplat", reason="gsplat is not installed: pip install gsplat==1.5.3")
    yield importlib.import_module("splatboost.gsplat")
    forget_gsplat()


class Trainer:
    """Trains with the `info` of gsplat's rasterization() that a strategy uses: means2d, absgrad and radii."""

    def __init__(self, module, max_steps, absgrad=True, **settings):
        t = {k: v.float() for k, v in gaussians(3).items()}
        values = {
            "means": t["means"],
            "scales": t["scales"].log(),
            "quats": t["rotations"],
            "opacities": torch.logit(t["opacities"][:, 0]),
            "sh0": t["sh"][:, :1],
            "shN": t["sh"][:, 1:],
        }
        self.cameras = [reference.turned_camera(40, 30, cx=16.0 + 4 * i) for i in range(3)]
        self.views, self.truths = [], []
        with torch.no_grad():
            for camera in self.cameras:
                image = self.draw(camera, values)[0].color.clamp(0, 1)
                k = torch.tensor([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]])
                pose = torch.tensor(camera.camera_from_world).view(4, 4)
                self.views.append(module.View(pose, k, image.permute(1, 2, 0)))
                self.truths.append(image)
        kept = torch.arange(N) % 3 > 0  # a third is missing, and must grow back
        self.params = {k: torch.nn.Parameter(v[kept].clone()) for k, v in values.items()}
        rates = {"means": 1e-3, "scales": 5e-3, "quats": 1e-3, "opacities": 5e-2, "sh0": 2.5e-3, "shN": 1e-4}
        self.optimizers = {k: torch.optim.Adam([p], lr=rates[k], eps=1e-15) for k, p in self.params.items()}
        self.strategy = module.SplatBoostStrategy(
            max_steps=max_steps, near_plane=0.2, settings=settings, reset_every=200000, absgrad=absgrad
        )  # opacities do not recover from a reset in short runs
        self.strategy.score_on(self.views)
        self.module = module
        self.strategy.check_sanity(self.params, self.optimizers)
        self.state = self.strategy.initialize_state(scene_scale=1.0)
        self.losses = []

    @staticmethod
    def draw(camera, params):
        points = torch.zeros(params["means"].shape[0], 4, requires_grad=True)
        done = splatboost.rasterize(
            camera,
            params["means"],
            torch.sigmoid(params["opacities"]),
            scales=params["scales"].exp(),
            rotations=params["quats"],
            sh_dc=params["sh0"],
            sh_rest=params["shN"],
            sh_degree=3,
            beta=1.0,
            screen_points=points,
        )
        return done, points

    @staticmethod
    def info_of(done):
        means2d = torch.zeros(1, done.radii.shape[0], 2, requires_grad=True)
        return {"means2d": means2d, "radii": done.radii[None], "width": 40, "height": 30, "n_cameras": 1}

    @staticmethod
    def fill(info, points):
        half = torch.tensor([20.0, 15.0])  # gsplat's gradients are in pixels
        info["means2d"].grad = (points.grad[:, :2] / half)[None]
        info["means2d"].absgrad = (points.grad[:, 2:] / half)[None]

    def step(self, step):
        j = step % 3
        done, points = self.draw(self.cameras[j], self.params)
        info = self.info_of(done)
        self.strategy.step_pre_backward(self.params, self.optimizers, self.state, step, info)
        loss = (done.color - self.truths[j]).abs().mean()
        loss.backward()
        self.fill(info, points)
        self.strategy.step_post_backward(self.params, self.optimizers, self.state, step, info)
        for optimizer in self.module.optimizers_at(self.strategy, self.optimizers, step):
            optimizer.step()
            optimizer.zero_grad(set_to_none=True)
        self.losses.append(loss.item())


def test_trains_grows_and_prunes(strategy_module):
    trainer = Trainer(
        strategy_module, 600, tau_d=0.5, gradient_threshold=1e-5, gradient_abs_threshold=1e-4, percent_dense=0.15
    )
    before = trainer.params["means"].shape[0]
    counts = []
    for step in range(600):
        trainer.step(step)
        n = trainer.params["means"].shape[0]
        counts.append(n)
        for name, p in trainer.params.items():
            assert p.shape[0] == n and trainer.optimizers[name].param_groups[0]["params"] == [p]
            state = trainer.optimizers[name].state.get(p)
            assert state is None or state["exp_avg"].shape == p.shape
        assert trainer.state["count"].shape == (n,) and "origins" not in trainer.state
    # Growth until half of the run reduces the loss; then every event prunes the worst scores. In so small a scene each
    # pruning is visible in the loss, so it is compared before that.
    assert max(counts) > before and counts[-1] < max(counts)
    assert sum(trainer.losses[270:300]) < 0.6 * sum(trainer.losses[:30])
    opacities = torch.sigmoid(trainer.params["opacities"])
    assert torch.isfinite(opacities).all()


@pytest.mark.skipif(conftest.EMULATED, reason="gradients of a GPU are sums in any order")
def test_a_restored_strategy_continues_the_run(strategy_module):
    trainer = Trainer(
        strategy_module, 600, tau_d=0.5, gradient_threshold=1e-5, gradient_abs_threshold=1e-4, percent_dense=0.15
    )
    for step in range(150):
        trainer.step(step)
    assert trainer.strategy._shard is not None, "nothing grew before"
    assert all(p.grad is None for p in trainer.params.values())
    rest = ("params", "optimizers", "state", "strategy")
    saved = pickle.dumps({name: getattr(trainer, name) for name in rest})
    again = []
    for restores in (False, True):
        if restores:
            vars(trainer).update(pickle.loads(saved))
            trainer.strategy.score_on(trainer.views)
        n = trainer.params["means"].shape[0]
        torch.manual_seed(0)  # the double's split draws from torch; its means are replaced
        for step in range(150, 260):
            trainer.step(step)
        assert trainer.params["means"].shape[0] != n, "nothing grew or went"
        again.append({name: p.detach().clone() for name, p in trainer.params.items()})
    for name, value in again[0].items():
        assert torch.equal(again[1][name], value), name


def test_a_saved_strategy_does_not_contain_the_data_set(strategy_module):
    class Data:
        def __len__(self):
            return 1

        def __getitem__(self, index):
            return {}

        def __reduce__(self):
            raise AssertionError("the data set was written")

    strategy = strategy_module.SplatBoostStrategy(max_steps=123)
    strategy.score_on(Data())
    strategy.adapter()
    assert pickle.loads(pickle.dumps(strategy)) == strategy
    with pytest.raises(ValueError, match="no views to score"):
        pickle.loads(pickle.dumps(strategy)).step_post_backward({}, {}, {}, 0, {})


def test_growth_is_the_adapter_s(strategy_module):
    """One event: the calls of gsplat's operations are the adapter's decisions for the same scores."""
    trainer = Trainer(
        strategy_module, 30000, tau_d=0.5, gradient_threshold=1e-5, gradient_abs_threshold=1e-4, percent_dense=0.15
    )
    for step in range(30):
        trainer.step(step)
    strategy, state, params = trainer.strategy, trainer.state, trainer.params
    n = params["means"].shape[0]
    count = state["count"].clamp_min(1)
    with torch.no_grad():
        clone, split = splatboost.Adapter("vanilla", total_iterations=30000, **strategy.settings).grow(
            1000,
            strategy._sources(params),
            scene_extent=1.0,
            gradients=state["grad2d"] / count,
            gradients_abs=state["absgrad2d"] / count,
            max_scales=params["scales"].exp().amax(dim=1),
        )
        old = params["means"].detach().clone()
        strategy._grow(params, trainer.optimizers, state, 1000)
    assert clone.any() and split.any()
    assert params["means"].shape[0] == n + clone.sum() + split.sum()
    kept = int((~split).sum())
    assert torch.equal(params["means"].detach()[:kept], old[~split])
    assert torch.equal(params["means"].detach()[kept : kept + int(clone.sum())], old[clone])
    assert not state["count"].any() and not state["grad2d"].any()


def projected(module, params, view, antialiased):
    """What gsplat's fully_fused_projection() returns for one view: means2d, conics, depths, radii of two axes (None: not known) and
    opacity compensations. gsplat's own reference in torch where it is installed, else the same in double precision."""
    scales, rotations = params["scales"].exp(), params["quats"]
    if hasattr(module.ops, "__file__"):
        from gsplat.cuda._torch_impl import _fully_fused_projection, _quat_scale_to_covar_preci

        covariances = _quat_scale_to_covar_preci(rotations, scales, compute_preci=False)[0]
        radii, means2d, depths, conics, factors = _fully_fused_projection(
            params["means"], covariances, view.viewmat[None], view.K[None], 40, 30, near_plane=0.2, calc_compensations=True)
        return means2d[0], conics[0], depths[0], radii[0].reshape(len(radii[0]), -1).expand(-1, 2), factors[0] if antialiased else 1
    turn, move = view.viewmat[:3, :3].double(), view.viewmat[:3, 3].double()
    x, y, z = (params["means"].double() @ turn.T + move).T
    (fx, _, cx), (_, fy, cy), _ = view.K.tolist()
    zero = torch.zeros_like(z)
    jacobian = torch.stack([fx / z, zero, -fx * x / z**2, zero, fy / z, -fy * y / z**2], dim=1).view(-1, 2, 3) @ turn
    bare = jacobian @ reference.covariances_of(scales.double(), rotations.double()) @ jacobian.transpose(1, 2)
    wide = bare + 0.3 * torch.eye(2, dtype=torch.float64)
    inverse = torch.linalg.inv(wide)
    conics = torch.stack([inverse[:, 0, 0], inverse[:, 0, 1], inverse[:, 1, 1]], dim=1)
    factors = (torch.linalg.det(bare) / torch.linalg.det(wide)).sqrt() if antialiased else 1
    return torch.stack([fx * x / z + cx, fy * y / z + cy], dim=1), conics, z, None, factors


def contributing_ids(means2d, conics, depths, radii, opacities, width, height):
    """What gsplat 1.6's rasterize_contributing_gaussian_ids() returns, restated because its kernel needs a GPU: for each pixel the ids
    of the Gaussians that are blended there, from front to back; as lists rather than padded with -1."""
    front_to_back = torch.argsort(depths).tolist()
    means2d, conics, opacities = means2d.tolist(), conics.tolist(), opacities.tolist()
    radii = None if radii is None else radii.tolist()
    ids = []
    for pixel in range(width * height):
        column, row = pixel % width + 0.5, pixel // width + 0.5
        found, transmittance = [], 1.0
        for i in front_to_back:
            dx, dy = column - means2d[i][0], row - means2d[i][1]
            if radii is not None and any(not (m - r) // 16 <= p // 16 < -(-(m + r) // 16)
                                         for p, m, r in zip((column, row), means2d[i], radii[i])):
                continue  # the Gaussian's box does not touch the pixel's tile
            sigma = 0.5 * (conics[i][0] * dx * dx + conics[i][2] * dy * dy) + conics[i][1] * dx * dy
            alpha = min(0.99, opacities[i] * math.exp(-sigma))
            if alpha < 1 / 255:
                continue
            transmittance *= 1 - alpha
            if transmittance <= 1e-4:
                break
            found.append(i)
        ids.append(found)
    return ids


@pytest.mark.parametrize("antialiased", [False, True])
def test_counts_are_those_of_gsplats_contributing_ids(strategy_module, antialiased):
    trainer = Trainer(strategy_module, 30000)
    trainer.strategy.antialiased = antialiased
    total = 0
    for j, view in enumerate(trainer.views):
        flagged = torch.rand(30, 40, generator=torch.Generator().manual_seed(j)) < 0.4
        with torch.no_grad():
            n = trainer.params["means"].shape[0]
            counts = trainer.strategy._sources(trainer.params)[j]().render.count_flagged(flagged)
            means2d, conics, depths, radii, factors = projected(strategy_module, trainer.params, view, antialiased)
            ids = contributing_ids(means2d, conics, depths, radii, torch.sigmoid(trainer.params["opacities"]) * factors, 40, 30)
        blended = [i for pixel, found in enumerate(ids) if flagged.reshape(-1)[pixel] for i in found]
        assert torch.equal(counts, torch.bincount(torch.tensor(blended), minlength=n).int())
        total += len(blended)
    assert total > 1000


def test_late_pruning_also_follows_growth(strategy_module):
    trainer = Trainer(strategy_module, 30000, literal=1, densify_until=20000)
    calls = []
    trainer.strategy._grow = lambda *_: calls.append("grow")
    trainer.strategy._prune_late = lambda *_: calls.append("prune")
    for step in (17498, 17499, 17999, 20999):  # iterations are one more
        trainer.step(step)
    assert calls == ["grow", "grow", "prune", "prune"]


def test_accumulated_gradients_are_applied_before_surgery(strategy_module):
    trainer = Trainer(strategy_module, 30000)
    rest = trainer.params["shN"].detach().clone()
    for step in range(5):
        trainer.step(step)
    assert torch.equal(trainer.params["shN"].detach(), rest)  # it steps every 16 iterations
    trainer.strategy._apply_pending(trainer.params, trainer.optimizers)
    assert not torch.equal(trainer.params["shN"].detach(), rest) and trainer.params["shN"].grad is None


def test_large_gaussians_are_pruned(strategy_module):
    trainer = Trainer(strategy_module, 30000)
    assert trainer.strategy.adapter().prunes_large_at(4000, True) and not trainer.strategy.adapter().prunes_large_at(4000, False)


def test_opacities_are_reset(strategy_module):
    trainer = Trainer(strategy_module, 30000)
    trainer.strategy.reset_every = 10
    for step in range(9):
        trainer.step(step)
        assert torch.sigmoid(trainer.params["opacities"]).max() > 0.1
    trainer.step(9)
    assert torch.sigmoid(trainer.params["opacities"]).max() <= 0.0101


def test_packed_and_two_radii(strategy_module):
    trainer = Trainer(strategy_module, 30000)
    n = trainer.params["means"].shape[0]
    radii = torch.tensor([5, 0, 7] + [0] * (n - 3))
    g, a = torch.rand(1, n, 2), torch.rand(1, n, 2)
    states = []
    for form in ("plain", "two radii", "packed"):
        state = trainer.strategy.initialize_state()
        info = {"width": 40, "height": 30, "n_cameras": 1, "radii": radii[None]}
        rows = torch.tensor([0, 2])
        means2d = torch.zeros(1, n, 2, requires_grad=True)
        means2d.grad, means2d.absgrad = g, a
        if form == "two radii":
            info["radii"] = torch.stack([radii, radii], dim=-1)[None]
        if form == "packed":
            means2d = torch.zeros(2, 2, requires_grad=True)
            means2d.grad, means2d.absgrad = g[0, rows], a[0, rows]
            info.update(radii=radii[rows], gaussian_ids=rows)
        info["means2d"] = means2d
        trainer.strategy._gather(trainer.params, state, info, form == "packed")
        states.append(state)
        wanted = (g[0, 0] * torch.tensor([20.0, 15.0])).norm()
        assert state["grad2d"][0] == pytest.approx(wanted.item()) and state["grad2d"][1] == 0
        assert state["count"].tolist() == [1, 0, 1] + [0] * (n - 3)
    for name in ("grad2d", "absgrad2d", "count"):
        assert torch.equal(states[0][name], states[1][name]) and torch.equal(states[0][name], states[2][name])


def test_needs(strategy_module, monkeypatch):
    with pytest.raises(ValueError, match="views: expected at least one"):
        strategy_module.SplatBoostStrategy().score_on([])
    for wrong in (None, 3):
        with pytest.raises(ValueError, match="views: expected a list of View or a data set, got %s" % wrong):
            strategy_module.SplatBoostStrategy().score_on(wrong)
    with pytest.raises(ValueError, match="max_steps: expected a whole number, got None"):
        strategy_module.SplatBoostStrategy(max_steps=None).adapter()
    with pytest.raises(ValueError, match="tau_d: expected a number, got 'x'"):
        strategy_module.SplatBoostStrategy(settings={"tau_d": "x"}).adapter()
    whole = dict(viewmat=torch.eye(4), K=torch.eye(3), image=torch.zeros(15, 20, 3))
    for changed, message in (
        (dict(viewmat=None), r"viewmat: expected a tensor of shape \[4, 4\], got None"),
        (dict(K=torch.eye(4)), r"K: expected a tensor of shape \[3, 3\], got Tensor of shape \[4, 4\]"),
        (dict(image=torch.zeros(3, 15, 20)), r"image: expected shape \[H,W,3\], got \[3, 15, 20\]"),
        (dict(mask=torch.zeros(15, 20)), "mask: expected bool or uint8, got float32"),
    ):
        with pytest.raises(ValueError, match=message):
            strategy_module.View(**{**whole, **changed})
    unready = strategy_module.SplatBoostStrategy()
    with pytest.raises(ValueError, match="call score_on"):
        unready.step_post_backward({}, {}, unready.initialize_state(), 0, {})
    trainer = Trainer(strategy_module, 100)
    with pytest.raises(ValueError, match=r"info: expected that of gsplat's rasterization\(\), got one without radii, width"):
        trainer.strategy.step_post_backward(trainer.params, {}, trainer.strategy.initialize_state(), 0, {"means2d": 0})
    params = {k: v for k, v in trainer.params.items() if k != "sh0"}
    optimizers = {k: v for k, v in trainer.optimizers.items() if k != "sh0"}
    with pytest.raises(ValueError, match="params: expected sh0"):
        trainer.strategy.check_sanity(params, optimizers)
    # Rows added or removed by others are detected.
    trainer.strategy._rows(trainer.params)
    with pytest.raises(ValueError, match="params: 15 Gaussians, but expected 16 from"):
        trainer.strategy._rows({name: p[1:] for name, p in trainer.params.items()})
    forget_gsplat()
    monkeypatch.setitem(sys.modules, "gsplat", None)
    with pytest.raises(ImportError, match="needs gsplat, which is not installed: pip install gsplat"):
        import splatboost.gsplat  # noqa: F401


@pytest.mark.skipif(conftest.EMULATED, reason="hundreds of views take the emulator long")
def test_without_absolute_gradients(strategy_module):
    """Without them 3DGS's own rule selects the candidates, from the signed gradient."""
    trainer = Trainer(strategy_module, 600, absgrad=False, tau_d=0.5, gradient_threshold=1e-5, percent_dense=0.15)
    assert not trainer.strategy.adapter().settings["absgrad"]
    before = trainer.params["means"].shape[0]
    counts = [trainer.params["means"].shape[0] for step in range(200) if trainer.step(step) is None]
    assert max(counts) > before


def test_views_of_a_data_set_and_masks(strategy_module):
    """Items like those of simple_trainer's Dataset, and its configuration; masked pixels are not scored."""
    import types

    trainer = Trainer(strategy_module, 300)
    masks = [torch.ones(30, 40, dtype=torch.bool) for _ in trainer.views]
    masks[1][:, 20:] = False

    class Dataset:
        def __len__(self):
            return 3

        def __getitem__(self, j):
            view = trainer.views[j]
            return {"K": view.K, "camtoworld": torch.inverse(view.viewmat), "image": view.image * 255, "image_id": j,
                    "mask": masks[j]}

    config = types.SimpleNamespace(strategy=trainer.strategy, max_steps=77, near_plane=0.2, antialiased=True)
    strategy_module.score_views(config, Dataset())
    strategy = trainer.strategy
    assert (strategy.max_steps, strategy.antialiased, strategy.adapter().total_iterations) == (77, True, 77)
    # simple_trainer's adjust_steps() has scaled reset_every like max_steps; a second call changes nothing.
    strategy.reset_every, config.steps_scaler = 750, 0.25
    for _ in range(2):
        strategy_module.score_views(config, Dataset())
        assert strategy.reset_every == 3000
    strategy.antialiased = False
    from_items = strategy._sources(trainer.params)[1]()
    strategy.score_on(trainer.views)
    from_views = strategy._sources(trainer.params)[1]()
    assert torch.allclose(from_items.color, from_views.color, atol=1e-5)
    assert (from_items.truth.int() - from_views.truth.int()).abs().max() <= 1
    assert torch.equal(from_items.valid, masks[1]) and from_views.valid is None
    strategy_module.score_views(types.SimpleNamespace(strategy=object()), Dataset())  # another strategy: no effect
    # Scored as pinhole images, views of another camera would give wrong scores without an error.
    config.camera_model = "pinhole"
    strategy_module.score_views(config, Dataset())
    config.camera_model = "fisheye"
    with pytest.raises(ValueError, match="config: expected camera_model pinhole, with which views are scored, got fisheye"):
        strategy_module.score_views(config, Dataset())
    # Nor would the errors of renders without the trainer's corrections be those of its loss.
    config.camera_model, config.post_processing, config.pose_opt = "pinhole", None, False
    strategy_module.score_views(config, Dataset())
    for name, value in (("post_processing", "bilateral_grid"), ("use_bilateral_grid", True), ("pose_opt", True), ("pose_noise", 0.1)):
        changed = types.SimpleNamespace(**{**config.__dict__, name: value})
        with pytest.raises(ValueError, match="config: expected %s off, because views are scored without it, got %s" % (name, value)):
            strategy_module.score_views(changed, Dataset())


def test_optimizers_that_wait_and_those_that_cannot(strategy_module):
    trainer = Trainer(strategy_module, 30000)
    due = strategy_module.optimizers_at(trainer.strategy, trainer.optimizers, 3)
    assert trainer.optimizers["shN"] not in due and trainer.optimizers["means"] in due
    assert len(strategy_module.optimizers_at(trainer.strategy, trainer.optimizers, 29999)) == 6  # all step at the end

    class SelectiveAdam:
        pass

    of_one_view = SelectiveAdam()
    assert strategy_module.optimizers_at(trainer.strategy, {"shN": of_one_view}, 3) == [of_one_view]
    assert len(strategy_module.optimizers_at(object(), trainer.optimizers, 3)) == 6


def test_what_lies_beside_parameters_follows(strategy_module):
    """gsplat 1.6 notifies its scene of every operation."""
    trainer = Trainer(strategy_module, 300)
    calls = []
    trainer.step(0)
    ops = strategy_module.ops
    kept = {name: getattr(ops, name) for name in ("duplicate", "split", "remove")}
    try:
        for name in kept:
            setattr(ops, name, lambda name=name, **named: calls.append((name, named["scene"])))
        trainer.strategy._scene = {"scene": "a scene"}
        trainer.strategy._remove(trainer.params, {}, {}, torch.arange(16) < 3)
    finally:
        for name, operation in kept.items():
            setattr(ops, name, operation)
    assert calls == [("remove", "a scene")]


#: Names and order of calls of gsplat's simple_trainer, as far as the recipe and the strategy depend on them.
SIMPLE_TRAINER = """
import sys
import types
import gsplat_double
gsplat_double.install()
import torch
from gsplat.strategy import DefaultStrategy, MCMCStrategy
import test_gsplat


class Config(types.SimpleNamespace):
    max_steps, near_plane, antialiased = 30_000, 0.2, False


class Runner:
    def __init__(self, cfg):
        self.cfg = cfg
        self.parser = types.SimpleNamespace(scene_scale=1.0)
        import splatboost.gsplat
        made = test_gsplat.Trainer(splatboost.gsplat, cfg.max_steps)
        self.trainset = made.views
        self.scene_scale = self.parser.scene_scale * 1.1
        self.splats, self.optimizers = made.params, made.optimizers
        cfg.strategy.check_sanity(self.splats, self.optimizers)
        self.strategy_state = cfg.strategy.initialize_state(scene_scale=self.scene_scale)
        self.made = made

    def train(self):
        cfg = self.cfg
        self.steps = 0
        for step in range(60):
            done, points = self.made.draw(self.made.cameras[step % 3], self.splats)
            info = self.made.info_of(done)
            cfg.strategy.step_pre_backward(self.splats, self.optimizers, self.strategy_state, step, info)
            (done.color - self.made.truths[step % 3]).abs().mean().backward()
            self.made.fill(info, points)
            for optimizer in self.optimizers.values():
                optimizer.step()
                optimizer.zero_grad(set_to_none=True)
                self.steps += 1
            cfg.strategy.step_post_backward(self.splats, self.optimizers, self.strategy_state, step, info, packed=False)


configs = {
    "default": ("", Config(strategy=DefaultStrategy())),
    "mcmc": ("", Config(strategy=MCMCStrategy())),
}
runner = Runner(configs[sys.argv[1]][1])
runner.train()
print(runner.steps, len(runner.splats["means"]))
"""


@pytest.mark.skipif(conftest.EMULATED, reason="a process of its own, on the CPU")
@pytest.mark.skipif(not (conftest.BUILD / "bin/splatboost").exists(), reason="the program is not built")
def test_the_recipe_for_simple_trainer(tmp_path):
    def run(*command):
        environment = dict(os.environ, PYTHONPATH=os.pathsep.join([str(conftest.PACKAGE), os.path.dirname(__file__)]))
        done = subprocess.run([*map(str, command)], capture_output=True, text=True, check=False, env=environment, timeout=120)
        assert done.returncode == 0, done.stderr
        return done.stdout

    program, trainer = conftest.BUILD / "bin/splatboost", tmp_path / "examples/simple_trainer.py"
    trainer.parent.mkdir()
    trainer.write_text(SIMPLE_TRAINER)
    operations = tmp_path / "gsplat/strategy/ops.py"
    operations.parent.mkdir(parents=True)
    operations.write_text("".join("def %s: pass\n" % text for text in (
        "duplicate(params, optimizers, state, mask)", "split(params, optimizers, state, mask, revised_opacity=False)",
        "remove(params, optimizers, state, mask)", "reset_opa(params, optimizers, state, value)")))
    run(program, "patch", "apply", "gsplat", tmp_path)
    old, new = SIMPLE_TRAINER.splitlines(), trainer.read_text().splitlines()
    assert len([line for line in new if line not in old]) <= 5
    assert run(sys.executable, trainer, "default").split()[0] == "360"  # six optimizers
    steps, n = map(int, run(sys.executable, trainer, "splatboost").splitlines()[-1].split())
    assert steps == 5 * 60 + 3 and n > 0  # spherical harmonics step every 16 iterations
    run(program, "patch", "revert", tmp_path)
    assert trainer.read_text() == SIMPLE_TRAINER
