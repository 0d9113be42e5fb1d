# SPDX-License-Identifier: Apache-2.0
"""Decisions through the package, against the paper's rules computed here, with counts of the real rasterizer."""

import copy
import pickle

import pytest
import reference
import torch
from test_rasterize import small

import splatboost
from splatboost import Adapter, ScoredView

N = 24


class Host:
    """Three views of a scene; their ground truths are renders without some of the Gaussians."""

    def __init__(self, missing):
        self.tensors = {k: v.detach() for k, v in small(7).items()}
        self.cameras = [reference.turned_camera(30, 22, cx=12.0 + 3 * i) for i in range(3)]
        kept = torch.ones(N, dtype=torch.bool)
        kept[missing] = False
        self.truths = [
            splatboost.rasterize(c, **{k: v[kept] for k, v in self.tensors.items()}, beta=0.5).color.clamp(0, 1)
            for c in self.cameras
        ]
        self.rendered = []

    def views(self):
        return [lambda j=j: self.view(j) for j in range(3)]

    def view(self, j):
        self.rendered.append(j)
        done = splatboost.rasterize(self.cameras[j], **self.tensors, beta=0.5)
        return ScoredView(done.color, self.truths[j], render=done)

    def sums(self, tau=0.1):
        """Counts and weighted counts over the views, computed with single operations."""
        counts, weighted = torch.zeros(N, dtype=torch.int64), torch.zeros(N, dtype=torch.float64)
        covered = pixels = 0
        for j in range(3):
            view = self.view(j)
            truth = (view.truth * 255).round().to(torch.uint8)
            flagged, error = splatboost.flag_errors(view.color, truth, tau=tau)
            n = view.render.count_flagged(flagged)
            counts += n
            weighted += splatboost.photometric_loss(view.color, truth).total * n.double()
            covered += int((error > 1e-4).sum())
            pixels += error.numel()
        return counts, weighted, covered / pixels


def test_what_is_near_a_camera_is_removed():
    host = Host([3, 4])
    none = torch.zeros(N, dtype=torch.bool)
    clearances = torch.linspace(0.1, 2, N)
    for limit, settings in ((0.8, {}), (1.5, {"min_clearance": 1.5}), (0.0, {"min_clearance": 0}), (0.0, {"literal": True})):
        adapter = Adapter("vanilla", total_iterations=30000, vcp=False, **settings)
        removed = adapter.prune(1000, host.views(), candidates=none, clearances=clearances)
        assert torch.equal(removed, clearances < limit)
    assert not adapter.prune(1000, host.views(), candidates=none).any()
    with pytest.raises(ValueError, match=r"clearances: expected shape \[24\]"):
        adapter.prune(1000, host.views(), candidates=none, clearances=clearances[:3])


def test_growth_is_the_paper_s():
    host = Host([3, 4])
    counts, weighted, covered = host.sums()
    # Growth asks for tau_d + 1 flagged pixels per view, fewer for images below a megapixel.
    threshold = float(counts.double().median()) / 3 + 0.1
    tau_d = threshold * 1e6 / (30 * 22) - 1
    adapter = Adapter("vanilla", total_iterations=30000, tau_d=tau_d)
    g = torch.Generator().manual_seed(0)
    gradients = torch.rand(N, generator=g) * 4e-4
    absolute = torch.rand((N, 1), generator=g) * 1.2e-3
    scales = torch.rand(N, generator=g) * 0.002
    host.rendered.clear()
    clone, split = adapter.grow(
        1000, host.views(), scene_extent=1.0, gradients=gradients, gradients_abs=absolute, max_scales=scales
    )
    assert sorted(host.rendered) == [0, 1, 2]  # one render per view
    important, scale = counts / 3 >= threshold, covered**0.5
    assert 0 < important.sum() < N
    assert torch.equal(clone, important & (scales <= 0.001) & (gradients >= 2e-4 * scale))
    assert torch.equal(split, important & (scales > 0.001) & (absolute[:, 0] >= 6e-4 * scale))
    assert clone.any() or split.any()

    origins = torch.cat([torch.arange(N), torch.tensor([0, 5, 5])])
    candidates = torch.rand(N + 3, generator=g) < 0.5
    removed = adapter.prune(1000, host.views(), candidates=candidates, origins=origins)
    assert removed.sum() == candidates.sum() // 2 and not (removed & ~candidates).any()
    weights = splatboost.pruning_scores(weighted)[origins]
    wanted = splatboost.keep_weighted_sample(weights, int(candidates.sum()) // 2, candidates, seed=0, iteration=1000)
    assert torch.equal(removed, wanted)


def test_a_cap_ranks_by_what_accepts():
    """Clones rank by the signed gradient and splits by the absolute one, each relative to its threshold."""
    adapter = Adapter("vanilla", total_iterations=30000, vcd=False, vcp=False)
    host = Host([3])
    gradients, absolute = torch.zeros(N), torch.zeros(N)
    scales = torch.full((N,), 0.0005)
    scales[12:] = 0.005
    gradients[:4] = 2e-4 * torch.tensor([2.0, 4.0, 1.1, 6.0])  # clones
    gradients[12:16] = 1e-3  # larger than those of all clones, but not relevant for splits
    absolute[12:16] = 6e-4 * torch.tensor([5.0, 1.2, 3.0, 1.5])
    absolute[:4] = 1.0

    def grown(most):
        clone, split = adapter.grow(1000, host.views(), scene_extent=1.0, gradients=gradients, gradients_abs=absolute,
                                    max_scales=scales, max_primitives=most)
        return clone.nonzero().reshape(-1).tolist(), split.nonzero().reshape(-1).tolist()

    assert grown(0) == grown(N + 8) == ([0, 1, 2, 3], [12, 13, 14, 15])
    assert grown(N + 4) == ([1, 3], [12, 14])
    assert grown(N + 1) == ([3], [])
    assert grown(N) == grown(N - 5) == ([], [])
    with pytest.raises(ValueError, match="max_primitives"):
        grown(-1)


def test_late_pruning():
    host = Host([3, 4])
    scores = splatboost.pruning_scores(host.sums()[1])
    opacities = torch.linspace(0.02, 0.9, N)
    adapter = Adapter("vanilla", total_iterations=30000)
    assert adapter.prunes_at(18000, False) and not adapter.prunes_at(17999, False)
    removed = adapter.prune(18000, host.views(), candidates=torch.zeros(N, dtype=torch.bool), opacities=opacities)
    assert torch.equal(removed, (opacities < 0.1) | (scores > 0.9))
    with pytest.raises(ValueError, match="late pruning needs the opacities"):
        adapter.prune(18000, host.views(), candidates=torch.zeros(N, dtype=torch.bool))


def test_pruning_under_a_cap():
    """Growth that reaches a cap makes room for the next, and late pruning leaves what the cap leaves."""
    host = Host([3, 4])
    adapter = Adapter("vanilla", total_iterations=30000, replaced_share=0.1)
    opacities = torch.full((N,), 0.05)
    none, every = torch.zeros(N, dtype=torch.bool), torch.arange(N)

    def removed_at_growth(most):
        still = torch.zeros(N)
        clone, split = adapter.grow(1000, host.views(), scene_extent=1.0, gradients=still, gradients_abs=still,
                                    max_scales=still, max_primitives=most)
        assert not clone.any() and not split.any()
        return adapter.prune(1000, host.views(), candidates=none, origins=every, opacities=opacities, max_primitives=most)

    weights = torch.stack([host.view(j).render.weights() for j in range(3)]).double()
    mean = weights.sum(0) / (weights > 0).sum(0).clamp_min(1)
    order = torch.argsort(mean[mean > 0])
    few = torch.nonzero(mean > 0).reshape(-1)[order][mean[mean > 0][order].cumsum(0) <= 0.1 * mean.sum()]
    assert 0 < len(few) < N
    assert torch.equal(removed_at_growth(N).nonzero().reshape(-1), few.sort().values)
    assert not removed_at_growth(0).any() and not removed_at_growth(2 * N).any()

    late = {"candidates": none, "opacities": opacities}
    assert adapter.prune(18000, host.views(), **late).all()
    assert adapter.prune(18000, host.views(), **late, max_primitives=2 * N).all()
    assert not adapter.prune(18000, host.views(), **late, max_primitives=N).any()
    with pytest.raises(ValueError, match="max_primitives"):
        adapter.prune(18000, host.views(), **late, max_primitives=-1)


def test_backbones_and_settings():
    vanilla = Adapter("vanilla", total_iterations=30000)
    assert vanilla.beta == 0.5 and Adapter("vanilla", total_iterations=100, cb=False).beta is None
    assert vanilla.grows_at(1000, False) and not vanilla.grows_at(1050, True)
    assert not vanilla.resets_opacities_at(3000, True)
    assert not vanilla.prunes_large_at(4000, True)
    assert vanilla.averages_at(30000) and not vanilla.averages_at(28000)
    resetting = Adapter("vanilla", total_iterations=30000, growth_after_reset=3000, prune_large=True)
    assert resetting.prunes_large_at(4000, True) and not resetting.prunes_large_at(4000, False)
    assert resetting.resets_opacities_at(3000, True) and not resetting.resets_opacities_at(3000, False)
    assert not resetting.resets_opacities_at(9000, True)
    assert [g for g in ("xyz", "f_rest") if vanilla.steps_at(g, 17)] == ["xyz"]
    drop = Adapter("dropgaussian", total_iterations=10000)
    assert drop.settings["schedule"] is False and drop.steps_at("f_rest", 17)
    assert drop.settings["densify_until"] == 5000
    scaffold = Adapter("scaffold-gs", total_iterations=1000)
    assert scaffold.rate_factor("scaling", 500) == 1 and scaffold.rate_factor("scaling", 1000) < 0.2
    # Mip-Splatting's statistics are sums of absolute values: their threshold is larger than that of the norm.
    host = Host([3])
    n = torch.full((N,), 6.5e-4)
    common = dict(scene_extent=1.0, gradients=n, gradients_abs=n, max_scales=torch.ones(N))
    settings = dict(total_iterations=30000, vcd=False)
    covered = host.sums()[2]
    for backbone, factor in (("vanilla", 1.0), ("mip-splatting", 1.36)):
        split = Adapter(backbone, **settings).grow(1000, host.views(), **common)[1]
        assert split.all() == (6.5e-4 >= factor * 6e-4 * covered**0.5)
    with pytest.raises(ValueError, match="clone, split: expected the host's own decisions"):
        Adapter("pgsr", **settings).grow(1000, host.views(), **common)
    for wrong, message in (
        (dict(tau_x=1), "tau_x: no such setting"),
        (dict(views=2.5), "views: expected a whole number"),
        (dict(tau_d=None), "tau_d: expected a number, got None"),
        (dict(tau_d="five"), "tau_d: expected a number, got 'five'"),
        (dict(tau_d=float("nan")), "tau_d: expected a finite number, got nan"),
        (dict(views=2**31), "views: expected a whole number from -2147483648 to 2147483647, got 2147483648"),
        (dict(tau_d=10**400), "tau_d: expected a number, got 1000"),
        (dict(views=0), "views must be at least 1"),
        (dict(total_iterations=0), "total_iterations: expected a whole number from 1 to 2147483647, got 0"),
        (dict(total_iterations=None), "total_iterations: expected a whole number, got None"),
        (dict(device="x"), "device: expected a device such as cpu or cuda:0, got 'x'"),
        (dict(seed=1.5), "seed: expected a whole number, got 1.5"),
        (dict(literal="yes"), "literal: expected a whole number, got 'yes'"),
    ):
        with pytest.raises(ValueError, match=message):
            Adapter("vanilla", **{"total_iterations": 100, **wrong})
    with pytest.raises(ValueError, match="available: .*vanilla"):
        Adapter("3dgs", total_iterations=100)
    numpy = pytest.importorskip("numpy")
    found = Adapter("vanilla", total_iterations=100, views=numpy.int64(5), tau_d=numpy.float32(2.5)).settings
    assert (found["views"], found["tau_d"]) == (5, 2.5)


@pytest.mark.skipif(torch.cuda.is_available(), reason="torch can use a GPU")
def test_a_device_that_torch_cannot_use_is_told():
    with pytest.raises(ValueError, match="^device: torch cannot use cuda: [^\n]+$"):
        Adapter("vanilla", total_iterations=100, device="cuda")


def test_what_a_view_raises_comes_through():
    adapter = Adapter("vanilla", total_iterations=30000)
    n = torch.zeros(N)
    common = dict(scene_extent=1.0, gradients=n, gradients_abs=n, max_scales=n)

    def broken():
        raise KeyError("no image")

    with pytest.raises(KeyError, match="no image"):
        adapter.grow(1000, [broken], **common)
    host = Host([3])
    wrong = [lambda: ScoredView(host.view(0).color, torch.zeros(3, 5, 5), render=host.view(0).render)]
    with pytest.raises(ValueError, match=r"truth: expected shape \[3,22,30\], got \[3, 5, 5\]"):
        adapter.grow(1000, wrong, **common)
    for changed, message in (
        (dict(views=None), "views: expected a list of functions that render a view, got None"),
        (dict(views=[3]), r"views\[0\]: expected a function, got 3"),
        (dict(views=[lambda: None]), r"views\[0\]: expected it to return a ScoredView, got NoneType"),
        (dict(views=[lambda: ScoredView(host.view(0).color, host.truths[0], render=3)]), "render: expected a Render, got 3"),
        (dict(views=[lambda: ScoredView(host.view(0).color, host.truths[0], 3, host.view(0).render)]),
         "valid: expected a tensor, got int"),
        (dict(gradients_abs=None), "gradients_abs: expected a tensor, got None"),
        (dict(gradients=3), "gradients: expected a tensor, got int"),
        (dict(iteration="x"), "iteration: expected a whole number, got 'x'"),
        (dict(scene_extent=None), "scene_extent: expected a number, got None"),
    ):
        given = dict(iteration=1000, views=host.views(), scene_extent=1.0, gradients=n, gradients_abs=n, max_scales=n)
        with pytest.raises(ValueError, match=message):
            adapter.grow(**{**given, **changed})
    with pytest.raises(ValueError, match="origins: expected int32 or int64, got float32"):
        adapter.prune(1000, host.views(), candidates=n > 0, origins=n)
    with pytest.raises(ValueError, match="iteration: expected a whole number from .*, got 4294967301"):
        adapter.grows_at(2**32 + 5, True)
    with pytest.raises(ValueError, match="origins need a preceding grow at the same iteration"):
        adapter.prune(2000, host.views(), candidates=torch.zeros(N, dtype=torch.bool), origins=torch.arange(N))


@pytest.mark.parametrize(
    "backbone", ["vanilla", "mip-splatting", "dropgaussian", "convex-splatting", "scaffold-gs", "photo-slam"]
)
@pytest.mark.parametrize("literal", [False, True])
def test_copies_are_adapters_of_their_own(backbone, literal):
    adapter = Adapter(backbone, total_iterations=900, seed=5, literal=literal, views=3)
    copies = [copy.copy(adapter), copy.deepcopy(adapter), pickle.loads(pickle.dumps(adapter))]
    grows = [adapter.grows_at(i, False) for i in range(1, 901)]
    handles = {adapter._handle.value, *(c._handle.value for c in copies)}
    assert len(handles) == 4
    settings = adapter.settings
    del adapter  # frees its handle
    for made in copies:
        assert made.settings == settings and made.seed == 5 and made.backbone == backbone
        assert [made.grows_at(i, False) for i in range(1, 901)] == grows
