# SPDX-License-Identifier: Apache-2.0
"""Errors, losses, scores, selections, neighbours, Adam and schedule on tensors, against torch's own arithmetic."""

import conftest
import emulated
import pytest
import reference
import torch

import splatboost


@pytest.mark.parametrize("padding", ["same", "valid"])
@pytest.mark.parametrize("shape", [(1, 3, 20, 30), (2, 1, 133, 11), (1, 2, 11, 40)])
def test_fused_ssim_agrees_with_convolutions(padding, shape):
    g = torch.Generator().manual_seed(0)
    a = torch.rand(shape, generator=g)
    b = (a + 0.2 * torch.randn(shape, generator=g)).clamp(0, 1)
    ours = a.clone().requires_grad_()
    exact = a.double().requires_grad_()
    value, truth = splatboost.fused_ssim(ours, b, padding=padding), reference.ssim(exact, b.double(), padding)
    assert value.item() == pytest.approx(truth.item(), abs=2e-5)
    (3 * value).backward()
    (3 * truth).backward()
    assert (ours.grad - exact.grad).abs().max() < 1e-3 * exact.grad.abs().max()


def test_fused_ssim_gradcheck():
    g = torch.Generator().manual_seed(1)
    a = torch.rand((1, 1, 12, 12), generator=g, dtype=torch.float64).requires_grad_()
    b = torch.rand((1, 1, 12, 12), generator=g)
    check = torch.autograd.gradcheck
    assert check(lambda x: splatboost.fused_ssim(x.float(), b).double(), (a,), eps=2e-3, atol=3e-4, rtol=2e-2)


def test_fused_ssim_refuses():
    image = torch.rand(1, 3, 20, 20)
    with pytest.raises(ValueError, match="padding"):
        splatboost.fused_ssim(image, image, padding="full")
    with pytest.raises(ValueError, match=r"img2: expected shape \[1,3,20,20\]"):
        splatboost.fused_ssim(image, image[:, :2])
    with pytest.raises(ValueError, match=r"img1: expected shape \[B,C,H,W\]"):
        splatboost.fused_ssim(image[0], image)
    with pytest.raises(ValueError, match="contains no window"):
        splatboost.fused_ssim(image[..., :10], image[..., :10], padding="valid")
    value = splatboost.fused_ssim(image.requires_grad_(), image.detach(), train=False)
    with pytest.raises(RuntimeError, match="train=False"):
        value.backward()


def test_fused_ssim_has_no_gradient_of_the_second_image():
    a, b = torch.rand(1, 3, 20, 20), torch.rand(1, 3, 20, 20).requires_grad_()
    splatboost.fused_ssim(a, b).backward()
    assert b.grad is None
    splatboost.fused_ssim(a.requires_grad_(), b).backward()
    assert b.grad is None and a.grad.abs().sum() > 0


def test_flag_errors_is_the_paper_s():
    g = torch.Generator().manual_seed(2)
    truth = torch.randint(0, 256, (3, 9, 13), generator=g, dtype=torch.uint8)
    render = (truth / 255.0 + 0.3 * torch.rand((3, 9, 13), generator=g)).float()
    valid = torch.rand((9, 13), generator=g) < 0.8
    flagged, error = splatboost.flag_errors(render, truth, valid, tau=0.4)
    wanted = (render - truth / 255.0).abs().mean(0)
    assert (error - wanted).abs().max() < 1e-6
    low, high = wanted[valid].min(), wanted[valid].max()
    near = ((wanted - low) / (high - low) - 0.4).abs() < 1e-5
    agrees = flagged == (((wanted - low) / (high - low) > 0.4) & valid)
    assert agrees[~near].all() and 5 < flagged.sum() < 100
    as_floats, _ = splatboost.flag_errors(render, truth / 255.0, valid, tau=0.4)
    assert torch.equal(as_floats, flagged)
    constant, _ = splatboost.flag_errors(torch.ones(3, 4, 4), torch.zeros(3, 4, 4))
    assert not constant.any()


def test_photometric_loss():
    g = torch.Generator().manual_seed(3)
    truth = torch.randint(0, 256, (3, 21, 17), generator=g, dtype=torch.uint8)
    render = torch.rand((3, 21, 17), generator=g)
    loss = splatboost.photometric_loss(render, truth)
    exact = truth.double() / 255
    l1, ssim = (render - exact).abs().mean().item(), reference.ssim(render.double()[None], exact[None]).item()
    assert loss.l1 == pytest.approx(l1, abs=1e-6) and loss.ssim == pytest.approx(ssim, abs=2e-5)
    assert loss.total == pytest.approx(0.8 * l1 + 0.2 * (1 - ssim), abs=1e-5)


def test_scores_and_selections():
    counts = torch.tensor([29, 30, 31])
    importance = splatboost.importance_scores(counts, 10)
    assert importance.tolist() == [2, 3, 3]
    assert splatboost.importance_scores(counts, 0).tolist() == [0, 0, 0]
    assert splatboost.pruning_scores(torch.tensor([1.0, 3.0, 2.0]).double()).tolist() == [0, 1, 0.5]
    assert splatboost.pruning_scores(torch.full((4,), 2.0).double()).tolist() == [0] * 4
    every = torch.ones(3, dtype=torch.bool)
    assert splatboost.keep_important(importance, 2.5, every).tolist() == [False, True, True]
    assert every.all()  # input masks are unchanged
    priorities = torch.tensor([1.0, 3.0, 2.0])
    assert splatboost.keep_largest(priorities, 2, every).tolist() == [False, True, True]
    assert splatboost.spare_one(priorities, every).tolist() == [True, False, True]
    weights, candidates = torch.rand(1000), torch.rand(1000) < 0.5
    kept = splatboost.keep_weighted_sample(weights, 100, candidates, seed=1, iteration=7)
    assert kept.sum() == 100 and not (kept & ~candidates).any()
    assert torch.equal(kept, splatboost.keep_weighted_sample(weights, 100, candidates, seed=1, iteration=7))
    assert not torch.equal(kept, splatboost.keep_weighted_sample(weights, 100, candidates, seed=2, iteration=7))
    with pytest.raises(ValueError, match="candidates: expected bool, got uint8"):
        splatboost.keep_largest(priorities, 2, every.to(torch.uint8))
    with pytest.raises(ValueError, match="keep must not be negative"):
        splatboost.keep_largest(priorities, -1, every)


@pytest.mark.parametrize(
    "call, message",
    [
        (lambda image, n: splatboost.flag_errors(image, image, 3), "valid: expected a tensor, got int"),
        (lambda image, n: splatboost.flag_errors(image, image, image[0]), "valid: expected bool or uint8, got float32"),
        (lambda image, n: splatboost.flag_errors(image, image.double()), "truth: expected uint8 or float32, got float64"),
        (lambda image, n: splatboost.flag_errors(image, image, tau="x"), "tau: expected a number, got 'x'"),
        (lambda image, n: splatboost.photometric_loss(image, image, lambda_dssim=None), "lambda_dssim: expected a number"),
        (lambda image, n: splatboost.keep_important(n.long(), None, n > 0), "threshold: expected a number, got None"),
        (lambda image, n: splatboost.keep_largest(n, 2.5, n > 0), "keep: expected a whole number, got 2.5"),
        (lambda image, n: splatboost.keep_weighted_sample(n, 1, n > 0, seed="x"), "seed: expected a whole number, got 'x'"),
        (lambda image, n: splatboost.importance_scores(n.long(), 2**32 + 1), "views: expected a whole number from .*4294967297"),
        (lambda image, n: splatboost.mean_squared_neighbor_distances(image[0], None), "k: expected a whole number, got None"),
        (lambda image, n: splatboost.adam_step(None, n, n, n, 1), "values: expected a tensor, got NoneType"),
        (lambda image, n: splatboost.adam_step(n, n, n, n, 1, betas=0.9), "betas: expected two numbers, got 0.9"),
        (lambda image, n: splatboost.adam_step(n, n, n, n, None), "step: expected a whole number, got None"),
        (lambda image, n: splatboost.steps_at(None, 1, 10), "intervals: expected StepIntervals, got None"),
        (lambda image, n: splatboost.steps_at(splatboost.StepIntervals("x"), 1, 10), "intervals: early: expected a whole"),
        (lambda image, n: splatboost.scaled_iteration(-1, 10), "published: expected a whole number from 0 to"),
        (lambda image, n: splatboost.exponential_rate(0, 1, 1, 1), "initial: expected a number above 0, got 0.0"),
    ],
)
def test_bad_arguments_are_named(call, message):
    with pytest.raises(ValueError, match=message):
        call(torch.rand(3, 12, 3), torch.rand(4))


def test_neighbors_by_brute_force():
    points = torch.rand((200, 3), generator=torch.Generator().manual_seed(4))
    squared = torch.cdist(points.double(), points.double()).square()
    squared.fill_diagonal_(float("inf"))
    wanted = squared.sort(dim=1).values[:, :3].mean(1)
    ours = splatboost.mean_squared_neighbor_distances(points.t().contiguous().t())  # not contiguous
    assert ((ours - wanted) / wanted).abs().max() < 1e-4
    if not conftest.EMULATED:  # values on a GPU are not checked
        with pytest.raises(ValueError, match="finite"):
            splatboost.mean_squared_neighbor_distances(points * float("nan"))
    with pytest.raises(ValueError, match=r"points: expected shape \[N,3\]"):
        splatboost.mean_squared_neighbor_distances(points[:, :2])


def test_clearances_by_brute_force():
    g = torch.Generator().manual_seed(5)
    points, means, centres = torch.rand((600, 3), generator=g), torch.rand((500, 3), generator=g) * 3, torch.rand((9, 3), generator=g) * 3
    assert not splatboost.distances_to_scene(centres, points).any()  # drawn at random in a box: no surface
    points[:, 2] = 0.5
    distances = splatboost.distances_to_scene(centres, points)
    wanted = torch.cdist(centres.double(), points.double()).sort(dim=1).values[:, 10]  # ten may be wrong
    assert torch.allclose(distances.double(), wanted, atol=1e-6)
    distances[3] = 0  # left out
    ours = splatboost.camera_clearances(means, centres, distances)
    known = distances > 0
    wanted = (torch.cdist(means.double(), centres.double())[:, known] / distances[known].double()).min(dim=1).values
    assert torch.allclose(ours.double(), wanted, rtol=1e-5)
    with pytest.raises(ValueError, match=r"distances: expected shape \[9\]"):
        splatboost.camera_clearances(means, centres, distances[:4])


def test_adam_is_torch_s():
    g = torch.Generator().manual_seed(5)
    values = torch.randn((7, 3), generator=g)
    theirs = torch.nn.Parameter(values.clone())
    optimizer = torch.optim.Adam([theirs], lr=0.02, eps=1e-15)
    first, second = torch.zeros(7, 3), torch.zeros(7, 3)
    for step in range(1, 5):
        gradients = torch.randn((7, 3), generator=g)
        theirs.grad = gradients.clone()
        optimizer.step()
        splatboost.adam_step(values, gradients, first, second, step, lr=0.02)
        assert (values - theirs.detach()).abs().max() < 1e-6 and not gradients.any()
    with pytest.raises(ValueError, match="gradients: expected a contiguous tensor"):
        splatboost.adam_step(values, torch.zeros(3, 7).t(), first, second, 1)


def test_schedule():
    rest = splatboost.StepIntervals(16, 32, 64)
    assert [i for i in range(1, 100) if splatboost.steps_at(rest, i, 30000)] == [16, 32, 48, 64, 80, 96]
    assert splatboost.scaled_iteration(15000, 7000) == 3500
    assert splatboost.exponential_rate(1e-2, 1e-4, 50, 100) == pytest.approx(1e-3)
    with pytest.raises(ValueError, match="above 0"):
        splatboost.steps_at(rest, 1, 0)


@pytest.mark.skipif(conftest.EMULATED or torch.cuda.is_available(), reason="there is a device")
def test_cuda_tensors_without_a_gpu_are_refused_with_the_reason():
    with emulated.cuda():
        with pytest.raises(splatboost.NoCudaError, match="built without CUDA: .*SPLATBOOST_CUDA=ON|no CUDA device 0 on this"):
            splatboost.importance_scores(torch.zeros(3, dtype=torch.int64), 1)
