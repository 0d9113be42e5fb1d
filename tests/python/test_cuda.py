# SPDX-License-Identifier: Apache-2.0
"""Every operation on CUDA tensors against the CPU's; on a GPU, or on the emulator (test_emulated.py)."""

import contextlib
import json
import os
import subprocess
import sys

import conftest
import emulated
import miniature_host
import pytest
import reference
import torch
from test_rasterize import N, gaussians

import splatboost
from splatboost import _library as lib
from splatboost import _render
from splatboost.hooks import _boost

ON_GPU = torch.cuda.is_available() and not conftest.EMULATED and bool(lib.cuda_architectures())

pytestmark = pytest.mark.skipif(not (ON_GPU or conftest.EMULATED), reason="no GPU, or a library without CUDA")
on_gpu_only = pytest.mark.skipif(not ON_GPU, reason="no GPU, or a library without CUDA")


def moved(value, device):
    """A copy of the tensors in nested lists and dictionaries."""
    if isinstance(value, torch.Tensor):
        return value.detach().clone().to(device)
    if isinstance(value, dict):
        return {key: moved(v, device) for key, v in value.items()}
    return [moved(v, device) for v in value] if isinstance(value, (list, tuple)) else value


def both(operation, *arguments):
    """Results of an operation on the CPU and on CUDA, both as CPU tensors."""
    results = [operation(*moved(arguments, "cpu"))]
    with contextlib.nullcontext() if ON_GPU else emulated.cuda():
        on_cuda = operation(*moved(arguments, "cuda" if ON_GPU else "cpu"))
        for tensor in on_cuda if isinstance(on_cuda, (list, tuple)) else [on_cuda]:
            if ON_GPU and isinstance(tensor, torch.Tensor):
                assert tensor.is_cuda
        results.append(moved(on_cuda, "cpu"))
    return results


def scene(*names, seed=0):
    tensors = {k: v.float() for k, v in gaussians(seed).items()}
    scales, rotations = tensors["scales"], tensors["rotations"]
    c = reference.covariances_of(scales, rotations)
    tensors["covariances"] = torch.stack([c[:, 0, 0], c[:, 0, 1], c[:, 0, 2], c[:, 1, 1], c[:, 1, 2], c[:, 2, 2]], dim=1)
    return {name: tensors[name] for name in names}


def differentiated(tensors, options, columns=4):
    """Images and gradients of a view."""
    tensors = {k: v.requires_grad_() for k, v in tensors.items()}
    points = torch.zeros(N, columns, device=tensors["means"].device, requires_grad=True)
    done = splatboost.rasterize(
        reference.turned_camera(40, 30), **tensors, **options, inverse_depth=True, alpha=True, screen_points=points
    )
    images = [i for i in (done.color, done.features, done.inverse_depth, done.alpha) if i is not None]
    generator = torch.Generator().manual_seed(5)
    loss = sum((i * torch.randn(i.shape, generator=generator).to(i.device)).sum() for i in images)
    loss.backward()
    flagged = (done.color.detach().sum(dim=0) * 7).long() % 2 == 0
    return images + [points.grad] + [t.grad for t in tensors.values()] + [done.radii, done.count_flagged(flagged)]


@pytest.mark.parametrize(
    "names, options",
    [
        (("scales", "rotations", "sh"), {"sh_degree": 3, "background": (0.2, 0.5, 0.9)}),
        (("scales", "rotations", "colors", "features"), {"beta": 0.5}),
        (("covariances", "colors"), {"compensate_opacity": True, "low_pass": 0.1}),
    ],
)
def test_the_rasterizer_is_the_cpu_s(names, options):
    tensors = scene("means", "opacities", *names)
    cpu, cuda = both(lambda t: differentiated(t, options), tensors)
    assert len(cpu) == len(cuda)
    for a, b in zip(cpu[:-2], cuda[:-2]):
        assert (a - b).abs().max() < 1e-4 * (1 + a.abs().max())
    assert (cpu[-2] - cuda[-2]).abs().max() <= 1  # a radius just below a whole pixel may differ
    flags_may_differ = 3  # at thresholds, where rounding decides
    assert (cpu[-1] - cuda[-1]).abs().max() <= flags_may_differ and cpu[-1].sum() > 100


def test_what_is_seen_is_the_cpu_s():
    camera, t = reference.turned_camera(), scene("means", "scales", "rotations", seed=4)
    t["means"][:5] *= 8
    cpu, cuda = both(lambda s: splatboost.visible_radii(camera, **s), t)
    assert (cpu - cuda).abs().max() <= 1 and 0 < (cpu > 0).sum() < N
    cpu, cuda = both(lambda means: splatboost.mark_visible(camera, means), t["means"])
    assert torch.equal(cpu, cuda)


def test_errors_and_losses_are_the_cpu_s():
    g = torch.Generator().manual_seed(2)
    truth = torch.randint(0, 256, (3, 19, 33), generator=g, dtype=torch.uint8)
    render = (truth / 255.0 + 0.3 * torch.rand((3, 19, 33), generator=g)).float()
    valid = torch.rand((19, 33), generator=g) < 0.8
    cpu, cuda = both(splatboost.flag_errors, render, truth, valid)
    assert (cpu[1] - cuda[1]).abs().max() < 1e-6 and (cpu[0] != cuda[0]).sum() <= 1 and cpu[0].any()
    cpu, cuda = both(splatboost.photometric_loss, render, truth, valid)
    assert all(a == pytest.approx(b, abs=1e-5) for a, b in zip(cpu, cuda))

    for padding in ("same", "valid"):

        def ssim(image, other, padding=padding):
            image = image.requires_grad_()
            value = splatboost.fused_ssim(image, other, padding=padding)
            (3 * value).backward()
            return value, image.grad

        cpu, cuda = both(ssim, render[None], truth[None] / 255.0)
        assert cpu[0].item() == pytest.approx(cuda[0].item(), abs=2e-6)
        assert (cpu[1] - cuda[1]).abs().max() < 1e-3 * cpu[1].abs().max()


def test_scores_and_selections_are_the_cpu_s():
    g = torch.Generator().manual_seed(3)
    counts = torch.randint(0, 1000, (500,), generator=g)
    weighted, priorities = torch.rand(500, generator=g).double(), (torch.rand(500, generator=g) * 9).round()
    mask, every = torch.rand(500, generator=g) < 0.5, torch.ones(500, dtype=torch.bool)
    for operation, arguments in (
        (splatboost.importance_scores, (counts, 7)),
        (splatboost.pruning_scores, (weighted,)),
        (splatboost.keep_important, (counts, 300.0, mask)),
        (splatboost.keep_largest, (priorities, 100, mask)),
        (splatboost.spare_one, (priorities, every)),
        (splatboost.spare_one, (priorities, mask)),
    ):
        cpu, cuda = both(operation, *arguments)
        assert torch.equal(cpu, cuda), operation.__name__
    cpu, cuda = both(lambda w, c: splatboost.keep_weighted_sample(w, 100, c, seed=1, iteration=7), priorities, mask)
    # Logarithms of the devices differ by rounding: two nearly equal keys may change places.
    assert (cpu != cuda).sum() <= 2 and cuda.sum() == 100 and not (cuda & ~mask).any()


def test_neighbors_and_adam_are_the_cpu_s():
    g = torch.Generator().manual_seed(4)
    points = torch.rand((300, 3), generator=g)
    cpu, cuda = both(splatboost.mean_squared_neighbor_distances, points)
    assert ((cpu - cuda) / cpu).abs().max() < 1e-5

    def steps(values, gradients):
        first, second = torch.zeros_like(values), torch.zeros_like(values)
        for step in (1, 2, 3):
            splatboost.adam_step(values, gradients.clone(), first, second, step, lr=0.02)
        return values, first, second

    cpu, cuda = both(steps, torch.randn((40, 3), generator=g), torch.randn((40, 3), generator=g))
    assert all((a - b).abs().max() < 1e-6 for a, b in zip(cpu, cuda))


def test_sparse_adam_is_the_cpu_s():
    from splatboost.compat.diff_gaussian_rasterization_accelerated import SparseGaussianAdam

    g = torch.Generator().manual_seed(6)

    def steps(values, gradients, seen):
        parameter = torch.nn.Parameter(values)
        optimizer = SparseGaussianAdam([{"params": [parameter]}], lr=0.1, eps=1e-15)
        for _ in range(3):
            parameter.grad = gradients.clone()
            optimizer.step(seen, seen.shape[0])
        return parameter.detach()

    values = torch.randn((40, 1, 3), generator=g)
    seen = torch.rand(40, generator=g) < 0.5
    cpu, cuda = both(steps, values, torch.randn((40, 1, 3), generator=g), seen)
    assert (cpu - cuda).abs().max() < 1e-6
    assert torch.equal(cpu[~seen], values[~seen]) and not torch.equal(cpu[seen], values[seen])


def test_decisions_are_the_cpu_s():
    camera, shown = reference.turned_camera(30, 22), scene("means", "opacities", "scales", "rotations", "colors", seed=7)
    g = torch.Generator().manual_seed(0)
    statistics = {
        "gradients": torch.rand(N, generator=g) * 4e-4,
        "gradients_abs": torch.rand((N, 1), generator=g) * 2.4e-3,
        "max_scales": torch.rand(N, generator=g) * 0.002,
    }
    truth = torch.rand((3, 22, 30), generator=g)
    candidates = torch.rand(N, generator=g) < 0.5

    def decide(tensors, statistics, truth, candidates):
        def view():
            done = splatboost.rasterize(camera, **tensors, beta=0.5)
            return splatboost.ScoredView(done.color, truth, render=done)

        adapter = splatboost.Adapter("vanilla", total_iterations=30000, tau_d=1.0, device=candidates.device)
        clone, split = adapter.grow(1000, [view], scene_extent=1.0, **statistics)
        origins = torch.arange(N, device=candidates.device)
        within = adapter.prune(1000, [view], candidates=candidates, origins=origins)
        late = adapter.prune(18000, [view], candidates=candidates, opacities=tensors["opacities"])
        own = splatboost.Adapter("vanilla", total_iterations=30000, absgrad=False, device=candidates.device)
        kept = own.grow(1000, [view], scene_extent=1.0, **statistics, clone=candidates, split=~candidates)
        return [clone, split, within, late] + list(kept)

    cpu, cuda = both(decide, shown, statistics, truth, candidates)
    assert all(torch.equal(a, b) for a, b in zip(cpu, cuda)), (cpu, cuda)
    assert all(mask.any() for mask in cpu[:4])


def test_a_steady_loop_neither_allocates_nor_waits():
    def train(tensors, truth):
        tensors = {k: v.requires_grad_() for k, v in tensors.items()}
        moments = [(torch.zeros_like(v), torch.zeros_like(v)) for v in tensors.values()]
        cameras = [reference.turned_camera(40, 30, cx=16.0 + i) for i in range(3)]
        activity = None
        for step in range(1, 10):
            points = torch.zeros(N, 4, device=truth.device, requires_grad=True)
            done = splatboost.rasterize(cameras[step % 3], **tensors, beta=0.5, screen_points=points)
            loss = 1 - splatboost.fused_ssim(done.color[None], truth)
            loss.backward()
            done.count_flagged(torch.ones((30, 40), dtype=torch.bool, device=truth.device))
            with torch.no_grad():
                for value, (first, second) in zip(tensors.values(), moments):
                    splatboost.adam_step(value, value.grad, first, second, step, lr=1e-4)
            if step == 4:
                activity = lib.cuda_activity()
        assert lib.cuda_activity() == activity
        return loss.detach()

    _render._workspaces.clear()
    tensors = scene("means", "opacities", "scales", "rotations", "colors")
    cpu, cuda = both(train, tensors, torch.full((1, 3, 30, 40), 0.5))
    assert cpu.item() == pytest.approx(cuda.item(), abs=1e-4)


def test_a_view_that_nobody_differentiates_is_settled():
    _render._workspaces.clear()

    def draw(tensors):
        splatboost.rasterize(reference.turned_camera(), **tensors)
        before = lib.cuda_activity()[1]
        with torch.no_grad():
            splatboost.rasterize(reference.turned_camera(), **tensors)
        waited = lib.cuda_activity()[1] - before
        training = {k: v.requires_grad_() for k, v in tensors.items()}
        before = lib.cuda_activity()[1]
        splatboost.rasterize(reference.turned_camera(), **training)
        return waited, lib.cuda_activity()[1] - before

    cpu, cuda = both(draw, scene("means", "opacities", "scales", "rotations", "colors"))
    assert list(cpu) == [0, 0]
    assert cuda[0] > 0 and cuda[1] == 0


def test_tensors_of_two_devices_are_refused():
    tensors = scene("means", "opacities", "scales", "rotations", "colors")
    if ON_GPU:
        tensors = {k: v if k == "colors" else v.cuda() for k, v in tensors.items()}
    else:
        tensors["colors"] = tensors["colors"].to("meta")
    with pytest.raises(ValueError, match="colors: expected a tensor on .* .as means., got one on .*"):
        splatboost.rasterize(reference.turned_camera(), **tensors)


@on_gpu_only
def test_gradcheck_on_a_gpu():
    camera, tensors = reference.turned_camera(16, 12), gaussians(1)
    fixed = {k: tensors[k].float().cuda() for k in ("means", "opacities", "scales", "rotations")}

    def images(colors, features):
        done = splatboost.rasterize(camera, **fixed, colors=colors.float(), features=features.float())
        return done.color.double(), done.features.double()

    inputs = (tensors["colors"].cuda().requires_grad_(), tensors["features"].cuda().requires_grad_())
    assert torch.autograd.gradcheck(images, inputs, eps=1e-2, atol=1e-4, rtol=1e-3, nondet_tol=1e-4)


@on_gpu_only
def test_the_current_stream_is_the_call_s():
    """A stream that is busy for a while: a call on another stream would read values not yet written."""
    tensors = {k: v.cuda() for k, v in scene("means", "opacities", "scales", "rotations", "colors").items()}
    with torch.no_grad():
        wanted = splatboost.rasterize(reference.turned_camera(), **tensors).color
        torch.cuda.synchronize()
        for _ in range(3):
            stream = torch.cuda.Stream()
            with torch.cuda.stream(stream):
                late = {k: torch.full_like(v, float("nan")) for k, v in tensors.items()}
                torch.cuda._sleep(50_000_000)
                for name, tensor in late.items():
                    tensor.copy_(tensors[name], non_blocking=True)
                color = splatboost.rasterize(reference.turned_camera(), **late).color
            torch.cuda.current_stream().wait_stream(stream)
            assert (color - wanted).abs().max() < 1e-6


@on_gpu_only
def test_nothing_of_an_iteration_makes_torch_wait():
    tensors = {k: v.cuda().requires_grad_() for k, v in scene("means", "opacities", "scales", "rotations", "sh").items()}
    truth = torch.rand(1, 3, 30, 40, device="cuda")
    camera = reference.turned_camera(40, 30)

    def iteration():
        points = torch.zeros(N, 4, device="cuda", requires_grad=True)
        done = splatboost.rasterize(camera, **tensors, sh_degree=3, screen_points=points)
        (1 - splatboost.fused_ssim(done.color[None], truth)).backward()

    iteration()
    torch.cuda.set_sync_debug_mode("error")
    try:
        iteration()
    finally:
        torch.cuda.set_sync_debug_mode("default")


@on_gpu_only
def test_another_device_is_current_afterwards_as_before():
    if torch.cuda.device_count() < 2:
        pytest.skip("one GPU")
    tensors = {k: v.to("cuda:1") for k, v in scene("means", "opacities", "scales", "rotations", "colors").items()}
    with torch.cuda.device(0), torch.no_grad():
        color = splatboost.rasterize(reference.turned_camera(), **tensors).color
        assert torch.cuda.current_device() == 0 and color.device == torch.device("cuda:1")
        assert torch.isfinite(color).all()


#: Runs the host's script: unchanged on a GPU, or with its CUDA calls on the emulator.
_RUN = {
    True: "import splatboost; splatboost.install_drop_ins('3dgs-2023'); sys.path.insert(0, '.'); "
    "sys.argv = sys.argv[1:]; runpy.run_path('train.py', run_name='__main__')",
    False: "import emulated; from splatboost import cpu\nwith emulated.cuda(): sys.exit(cpu.main(sys.argv[1:]))",
}


@on_gpu_only
def test_a_fused_optimizer_steps_as_before():
    """Also after a parameter was replaced by a longer one, as hosts do when Gaussians grow."""
    results = []
    for fused in (False, True):
        torch.manual_seed(3)
        optimizer = torch.optim.Adam([{"params": [torch.nn.Parameter(torch.randn(9, 3, device="cuda"))], "lr": 1e-2}], eps=1e-15)
        for _ in range(3):
            values = optimizer.param_groups[0]["params"][0]
            values.grad = torch.randn_like(values)
            if fused:
                _boost.step_fused(optimizer)
                assert optimizer.state[values]["step"].is_cuda and not optimizer.param_groups[0]["fused"]
            else:
                optimizer.step()
            state = optimizer.state.pop(values)
            grown = torch.nn.Parameter(torch.cat([values.detach(), torch.randn(2, 3, device="cuda")]))
            for name in ("exp_avg", "exp_avg_sq"):
                state[name] = torch.cat([state[name], torch.zeros(2, 3, device="cuda")])
            optimizer.param_groups[0]["params"][0] = grown
            optimizer.state[grown] = state
        results.append(grown.detach())
    torch.testing.assert_close(*results, rtol=1e-6, atol=1e-7)


def test_a_patched_host_trains(tmp_path):
    """A miniature of 3DGS with the drop-in rasterizer, on CUDA tensors."""
    program = conftest.BUILD / "bin/splatboost"
    if not program.exists():
        pytest.skip("the program is not built")
    tree = miniature_host.write_host(tmp_path / "tree", "3dgs-2023")
    subprocess.run([str(program), "patch", "apply", "3dgs", str(tree)], check=True, capture_output=True)
    options = "--iterations 60 --densification_interval 10 --densify_from_iter 10 --densify_until_iter 41".split()
    results = {}
    for boost in ("off", "on"):
        model = tmp_path / boost
        done = subprocess.run(
            [sys.executable, "-c", "import runpy, sys; " + _RUN[ON_GPU], "train.py"]
            + ["--model_path", str(model), "--boost", boost] + options,
            capture_output=True,
            text=True,
            check=False,
            cwd=tree,
            env={**os.environ, "PYTHONPATH": os.pathsep.join([str(conftest.PACKAGE), str(conftest.ROOT / "tests/python")])},
        )
        assert done.returncode == 0, done.stderr
        results[boost] = json.loads((model / "losses.json").read_text())
        assert sum(results[boost]["losses"][-5:]) < sum(results[boost]["losses"][:5])
    assert results["on"]["counts"][-1] != results["off"]["counts"][-1]
