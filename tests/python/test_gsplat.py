# SPDX-License-Identifier: Apache-2.0
"""FastGSStrategy in a training loop, on a miniature double of gsplat (gsplat itself needs CUDA)."""

import sys

import gsplat_double
import pytest
import reference
import torch
from test_rasterize import gaussians

import splatboost

N = 24


@pytest.fixture()
def strategy_module(monkeypatch):
    for name in ("gsplat", "gsplat.strategy", "gsplat.strategy.base", "gsplat.strategy.ops", "splatboost.gsplat"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    gsplat_double.install()
    import importlib

    module = importlib.import_module("splatboost.gsplat")
    yield module
    for name in ("gsplat", "gsplat.strategy", "gsplat.strategy.base", "gsplat.strategy.ops", "splatboost.gsplat"):
        sys.modules.pop(name, None)


class Trainer:
    """Draws as gsplat's rasterization() does, as far as a strategy can see: info with means2d, absgrad and radii."""

    def __init__(self, module, max_steps, **settings):
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
        kept = torch.arange(N) % 3 > 0  # a third is missing, and must be grown again
        self.params = {k: torch.nn.Parameter(v[kept].clone()) for k, v in values.items()}
        rates = {"means": 1e-3, "scales": 5e-3, "quats": 1e-3, "opacities": 5e-2, "sh0": 2.5e-3, "shN": 1e-4}
        self.optimizers = {k: torch.optim.Adam([p], lr=rates[k], eps=1e-15) for k, p in self.params.items()}
        self.strategy = module.FastGSStrategy(
            views=self.views, max_steps=max_steps, near_plane=0.2, settings=settings, reset_every=200000
        )  # short runs do not recover from a reset
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

    def step(self, step):
        j = step % 3
        done, points = self.draw(self.cameras[j], self.params)
        half = torch.tensor([20.0, 15.0])
        means2d = torch.zeros(1, points.shape[0], 2, requires_grad=True)
        info = {"means2d": means2d, "radii": done.radii[None], "width": 40, "height": 30, "n_cameras": 1}
        self.strategy.step_pre_backward(self.params, self.optimizers, self.state, step, info)
        loss = (done.color - self.truths[j]).abs().mean()
        loss.backward()
        means2d.grad = (points.grad[:, :2] / half)[None]  # gsplat's are in pixels
        means2d.absgrad = (points.grad[:, 2:] / half)[None]
        self.strategy.step_post_backward(self.params, self.optimizers, self.state, step, info)
        for name, optimizer in self.optimizers.items():
            if self.strategy.steps_at(name, step):
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
    # Growth until half of the run brings the loss down; then every event removes what scores worst. A scene of so few
    # feels each one, so the loss is judged before that.
    assert max(counts) > before and counts[-1] < max(counts)
    assert sum(trainer.losses[300:330]) < 0.6 * sum(trainer.losses[:30])
    opacities = torch.sigmoid(trainer.params["opacities"])
    assert torch.isfinite(opacities).all()


def test_growth_is_the_adapter_s(strategy_module):
    """One event: what gsplat's operations are asked for is what the adapter says of the same scores."""
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


def test_accumulated_gradients_are_applied_before_surgery(strategy_module):
    trainer = Trainer(strategy_module, 30000)
    rest = trainer.params["shN"].detach().clone()
    for step in range(5):
        trainer.step(step)
    assert torch.equal(trainer.params["shN"].detach(), rest)  # it steps every 16
    trainer.strategy._apply_pending(trainer.params, trainer.optimizers)
    assert not torch.equal(trainer.params["shN"].detach(), rest) and trainer.params["shN"].grad is None


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
    with pytest.raises(ValueError, match="views: at least one"):
        strategy_module.FastGSStrategy()
    trainer = Trainer(strategy_module, 100)
    params = {k: v for k, v in trainer.params.items() if k != "sh0"}
    optimizers = {k: v for k, v in trainer.optimizers.items() if k != "sh0"}
    with pytest.raises(ValueError, match="params: sh0 wanted"):
        trainer.strategy.check_sanity(params, optimizers)
    for name in list(sys.modules):
        if name.split(".")[0] == "gsplat" or name == "splatboost.gsplat":
            monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "gsplat", None)
    with pytest.raises(ImportError, match="needs gsplat, which is not there: pip install gsplat"):
        import splatboost.gsplat  # noqa: F401
