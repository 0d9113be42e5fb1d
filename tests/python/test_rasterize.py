# SPDX-License-Identifier: Apache-2.0
"""The rasterizer on tensors against the reference in double precision, values and gradients."""

import dataclasses
import pathlib
import subprocess
import sys
import threading

import conftest
import pytest
import reference
import torch

import splatboost
from splatboost import Camera, _render

N = 24
# The library computes in float32; gradients are sums over hundreds of pixels.
VALUE, GRADIENT = 2e-5, 2e-3


def gaussians(seed=0, degree=3):
    g = torch.Generator().manual_seed(seed)

    def uniform(*shape):
        return torch.rand(*shape, generator=g, dtype=torch.float64)

    return {
        "means": (uniform(N, 3) - 0.5) * torch.tensor([3.0, 2.0, 2.0]),
        "opacities": 0.2 + 0.7 * uniform(N, 1),
        "scales": 0.08 + 0.25 * uniform(N, 3),
        "rotations": uniform(N, 4) + 0.1,
        "sh": (uniform(N, (degree + 1) ** 2, 3) - 0.4) * 0.8,
        "colors": uniform(N, 3),
        "features": uniform(N, 5) - 0.5,
    }


def assert_same(found, expected):
    """Gradients of one view; on a GPU they are summed by atomics, in varying order."""
    if not conftest.EMULATED:
        assert torch.equal(found, expected)
    largest = expected.abs().max().item()
    torch.testing.assert_close(found, expected, rtol=1e-5, atol=1e-5 * largest)


def upper(m):
    return torch.stack([m[:, 0, 0], m[:, 0, 1], m[:, 0, 2], m[:, 1, 1], m[:, 1, 2], m[:, 2, 2]], dim=1)


def both(tensors, **options):
    """Renders and differentiates a random projection of all images; returns values and gradients of both."""
    camera = reference.turned_camera()
    weights = torch.Generator().manual_seed(5)
    results = []
    for dtype in (torch.float64, torch.float32):
        inputs = {k: v.detach().to(torch.float32).to(dtype).requires_grad_() for k, v in tensors.items()}
        if dtype == torch.float64:
            color, features, depth, alpha, _ = reference.render(camera, **inputs, **options)
        else:
            done = splatboost.rasterize(camera, **inputs, **options, beta=1.0, inverse_depth=True, alpha=True)
            color, features, depth, alpha = done.color, done.features, done.inverse_depth, done.alpha
        images = [i for i in (color, features, depth, alpha) if i is not None]
        weights.manual_seed(5)
        loss = sum((i * torch.randn(i.shape, generator=weights).to(dtype)).sum() for i in images)
        gradients = torch.autograd.grad(loss, list(inputs.values()))
        results.append(([i.detach().double() for i in images], {k: g.double() for k, g in zip(inputs, gradients)}))
    return results


CASES = {
    "sh": (("means", "opacities", "scales", "rotations", "sh"), {"sh_degree": 3, "background": (0.2, 0.5, 0.9)}),
    "sh, lower active degree": (("means", "opacities", "scales", "rotations", "sh"), {"sh_degree": 1}),
    "colors": (("means", "opacities", "scales", "rotations", "colors"), {}),
    "features": (("means", "opacities", "scales", "rotations", "colors", "features"), {}),
    "covariances": (("means", "opacities", "covariances", "colors"), {}),
    "antialiasing": (("means", "opacities", "scales", "rotations", "colors"), {"compensate_opacity": True}),
    "mip filter": (
        ("means", "opacities", "scales", "rotations", "colors"),
        {"compensate_opacity": True, "low_pass": 0.1},
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_agrees_with_the_reference(case):
    names, options = CASES[case]
    tensors = gaussians()
    tensors["covariances"] = upper(reference.covariances_of(tensors["scales"], tensors["rotations"]))
    truth, ours = both({name: tensors[name] for name in names}, **options)
    for a, b in zip(truth[0], ours[0]):
        assert (a - b).abs().max() < VALUE
    for name in names:
        a, b = truth[1][name], ours[1][name]
        assert (a - b).abs().max() < GRADIENT * (1 + a.abs().max()), name
        assert a.abs().max() > 1e-2, name  # not all zero


def test_sh_in_two_parts_is_the_same():
    tensors = {k: v.float() for k, v in gaussians().items()}
    camera = reference.turned_camera()
    common = {k: tensors[k] for k in ("means", "opacities", "scales", "rotations")}
    sh = tensors["sh"].requires_grad_()
    whole = splatboost.rasterize(camera, **common, sh=sh, sh_degree=3)
    whole.color.square().sum().backward()
    dc, rest = sh.detach()[:, :1].requires_grad_(), sh.detach()[:, 1:].requires_grad_()  # neither is contiguous
    parts = splatboost.rasterize(camera, **common, sh_dc=dc, sh_rest=rest, sh_degree=3)
    parts.color.square().sum().backward()
    assert torch.equal(whole.color, parts.color)
    assert_same(sh.grad, torch.cat([dc.grad, rest.grad], dim=1))


def test_gradcheck():
    """torch.autograd.gradcheck with float32 renders: images are linear in colours and features."""
    camera = reference.turned_camera(16, 12)
    tensors = gaussians(1)
    fixed = {k: tensors[k].float() for k in ("means", "opacities", "scales", "rotations")}

    def images(colors, features):
        done = splatboost.rasterize(camera, **fixed, colors=colors.float(), features=features.float())
        return done.color.double(), done.features.double()

    inputs = (tensors["colors"].requires_grad_(), tensors["features"].requires_grad_())
    assert torch.autograd.gradcheck(images, inputs, eps=1e-2, atol=1e-4, rtol=1e-3)


def test_screen_gradients_are_those_of_the_mean_on_screen():
    camera = reference.turned_camera(14, 10)
    tensors = gaussians(2)
    names = ("means", "opacities", "scales", "rotations", "colors")
    exact = {k: tensors[k].float().double() for k in names}
    shift = torch.zeros(N, 2, dtype=torch.float64, requires_grad=True)
    image = reference.render(camera, **exact, shift=shift)[0]
    weights = torch.randn(image.shape, generator=torch.Generator().manual_seed(3), dtype=torch.float64)
    half = torch.tensor([7.0, 5.0], dtype=torch.float64)
    signed, absolute = torch.zeros(N, 2, dtype=torch.float64), torch.zeros(N, 2, dtype=torch.float64)
    for pixel in (image * weights).sum(0).flatten():
        (g,) = torch.autograd.grad(pixel, shift, retain_graph=True)
        signed += g
        absolute += g.abs()
    for columns, absolute_sum in ((4, False), (3, False), (3, True)):
        points = torch.zeros(N, columns, requires_grad=True)
        done = splatboost.rasterize(
            camera,
            **{k: v.float() for k, v in exact.items()},
            beta=1.0,
            screen_points=points,
            absolute_sum=absolute_sum,
        )
        (done.color * weights).sum().backward()
        g = points.grad.double()
        assert (g[:, :2] - signed * half).abs().max() < 1e-3 * (1 + (signed * half).abs().max())
        if columns == 4:
            assert (g[:, 2:] - absolute * half).abs().max() < 1e-3 * (1 + (absolute * half).abs().max())
        else:
            wanted = (absolute * half).sum(1) if absolute_sum else torch.zeros(N)
            assert (g[:, 2] - wanted).abs().max() < 1e-3 * (1 + wanted.abs().max())


def small(seed=0):
    tensors = {k: v.float() for k, v in gaussians(seed).items()}
    return {k: tensors[k].requires_grad_() for k in ("means", "opacities", "scales", "rotations", "colors")}


def test_weights_make_up_the_alpha():
    camera, tensors = reference.turned_camera(), small()
    with torch.no_grad():
        done = splatboost.rasterize(camera, **tensors, beta=1.0, alpha=True)
        weights = done.weights()
        blended = done.count_flagged(torch.ones(camera.height, camera.width, dtype=torch.bool))
        assert (weights <= 256 * blended).all() and (weights > 0).sum() > N / 4
        # The weights of a pixel sum to its alpha, up to half a unit of rounding each.
        assert abs(float(weights.sum()) / 256 - float(done.alpha.sum())) < 0.5 / 256 * float(blended.sum())
        splatboost.rasterize(camera, **tensors, beta=1.0)
        with pytest.raises(RuntimeError, match="weights: this render's tile lists were overwritten"):
            done.weights()


def test_counts_are_the_reference_s():
    camera, tensors = reference.turned_camera(), small()
    flagged = torch.rand(camera.height, camera.width, generator=torch.Generator().manual_seed(0)) < 0.3
    counts = reference.render(camera, **{k: v.detach().double() for k, v in tensors.items()})[4]
    wanted = (counts & flagged).sum(dim=(1, 2))
    with torch.no_grad():
        done = splatboost.rasterize(camera, **tensors, beta=1.0)
        assert torch.equal(done.count_flagged(flagged), wanted.int())
        assert torch.equal(
            done.count_flagged(flagged.to(torch.uint8), torch.ones(N, dtype=torch.int32)), wanted.int() + 1
        )
    assert wanted.sum() > 100
    assert torch.equal(done.visible, done.radii > 0)


def test_renders_may_wait_for_their_backward_passes():
    """Each render whose backward pass is pending has its own tile lists; gradients do not mix."""
    camera, a, b = reference.turned_camera(), small(0), small(1)
    alone = []
    for tensors in (a, b):
        loss = splatboost.rasterize(camera, **tensors).color.square().sum()
        alone.append(torch.autograd.grad(loss, list(tensors.values())))
    first = splatboost.rasterize(camera, **a)
    second = splatboost.rasterize(camera, **b)
    together = [torch.autograd.grad(r.color.square().sum(), list(t.values())) for r, t in ((first, a), (second, b))]
    for x, y in zip(alone, together):
        for i, j in zip(x, y):
            assert_same(i, j)


def test_a_second_backward_pass_draws_again():
    camera, a, b = reference.turned_camera(), small(0), small(1)
    done = splatboost.rasterize(camera, **a)
    loss = done.color.square().sum()
    once = torch.autograd.grad(loss, list(a.values()), retain_graph=True)
    splatboost.rasterize(camera, **b)  # takes the tile lists
    with pytest.raises(RuntimeError, match="overwritten by a later render"):
        done.count_flagged(torch.ones(camera.height, camera.width, dtype=torch.bool))
    twice = torch.autograd.grad(loss, list(a.values()))
    for i, j in zip(once, twice):
        assert_same(i, j)


def test_a_loop_keeps_one_workspace():
    _render._workspaces.clear()
    camera, tensors = reference.turned_camera(), small()
    for _ in range(4):
        done = splatboost.rasterize(camera, **tensors)
        done.color.sum().backward()
        with torch.no_grad():
            done = splatboost.rasterize(camera, **tensors)
    assert sum(len(pool) for pool in _render._workspaces.values()) == 1


def test_a_render_that_fails_gives_its_workspace_back():
    _render._workspaces.clear()
    camera, tensors = reference.turned_camera(), small()
    with pytest.raises(ValueError, match="beta must lie in") as kept:
        splatboost.rasterize(camera, **tensors, beta=1.5)
    done = splatboost.rasterize(camera, **tensors)
    assert kept.tb is not None and sum(len(pool) for pool in _render._workspaces.values()) == 1
    done.color.sum().backward()


def draw_in_threads(draws, times=60):
    """Repeats each draw() in a thread of its own; the tensors that it returns must be those of serial renders."""
    alone = [draw() for draw in draws]
    failed = []

    def repeat(draw, expected):
        try:
            for _ in range(times):
                assert all(torch.equal(a, b) for a, b in zip(draw(), expected)), "other values than alone"
        except Exception as e:
            failed.append(e)

    threads = [threading.Thread(target=repeat, args=job) for job in zip(draws, alone)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not failed, failed


def run_apart(module, function):
    """Calls a function of a test module in a process of its own, because a render in two threads may crash."""
    code = "import conftest, %s as tests; tests.splatboost.set_threads(1); tests.%s()" % (module, function)
    done = subprocess.run([sys.executable, "-c", code], cwd=pathlib.Path(__file__).parent, capture_output=True, text=True,
                          check=False, timeout=300)
    assert done.returncode == 0, (done.returncode, done.stderr)


def train_and_look():
    def many(seed):
        return {k: v.detach().repeat(80, 1) for k, v in small(seed).items()}

    def train():
        tensors = {k: v.requires_grad_() for k, v in many(0).items()}
        done = splatboost.rasterize(reference.turned_camera(200, 150), **tensors)
        weights = done.weights()
        return (done.color.detach(), weights, *torch.autograd.grad(done.color.sum(), list(tensors.values())))

    def look():
        with torch.no_grad():
            done = splatboost.rasterize(reference.turned_camera(120, 260), **many(1))
        return done.color, done.radii

    draw_in_threads([train, look, look])


def test_threads_render_at_the_same_time():
    run_apart("test_rasterize", "train_and_look")


def test_no_gaussians_give_the_background():
    camera = reference.turned_camera()
    empty = {
        "means": torch.zeros(0, 3, requires_grad=True),
        "opacities": torch.zeros(0, 1),
        "scales": torch.zeros(0, 3),
        "rotations": torch.zeros(0, 4),
        "colors": torch.zeros(0, 3),
    }
    done = splatboost.rasterize(camera, **empty, background=torch.tensor([0.1, 0.2, 0.3]))
    done.color.sum().backward()
    assert torch.allclose(done.color[:, 3, 4], torch.tensor([0.1, 0.2, 0.3]))
    assert empty["means"].grad.shape == (0, 3) and done.radii.shape == (0,)


def test_visible_radii_are_those_of_the_square():
    camera, tensors = reference.turned_camera(), small(4)
    tensors["means"].data[:5] *= 8  # some outside of the image
    radii = splatboost.rasterize(camera, **tensors).radii
    ours = splatboost.visible_radii(camera, tensors["means"], scales=tensors["scales"], rotations=tensors["rotations"])
    assert torch.equal(radii, ours) and 0 < (radii > 0).sum() < N
    behind = tensors["means"].detach() @ torch.tensor(camera.camera_from_world).view(4, 4)[2, :3] + 4.0 <= 0.2
    assert torch.equal(splatboost.mark_visible(camera, tensors["means"]), ~behind)


@pytest.mark.parametrize(
    "change, message",
    [
        ({"means": torch.zeros(N, 2)}, r"means: expected shape \[N,3\], got \[24, 2\]"),
        ({"means": torch.zeros(N, 3).double()}, "means: expected float32, got float64"),
        ({"means": [[0.0, 0.0, 0.0]]}, "means: expected a tensor, got list"),
        ({"opacities": torch.zeros(N + 1, 1)}, r"opacities: expected shape \[24,1\] or \[24\], got \[25, 1\]"),
        ({"scales": None}, "either scales and rotations, or covariances"),
        ({"colors": None}, "either sh, or sh_dc"),
        ({"features": torch.zeros(N, 9)}, "features: at most 8 channels"),
        ({"background": (0.0, 1.0)}, "background: expected 3 numbers, got 2"),
        ({"background": torch.zeros(2, 3)}, r"background: expected 3 numbers, got shape \[2,3\]"),
        ({"background": 0.5}, "background: expected a vector or a matrix of numbers, got float"),
        ({"background": (float("nan"), 0.0, 0.0)}, "background: expected finite numbers"),
        ({"beta": 1.5}, "beta must lie in"),
        ({"beta": "x"}, "beta: expected a number, got 'x'"),
        ({"low_pass": None}, "low_pass: expected a number, got None"),
        ({"near_plane": torch.zeros(3)}, r"near_plane: expected a number, got Tensor of shape \[3\]"),
        ({"sh_degree": 4}, "sh_degree: expected a whole number from 0 to 3, got 4"),
        ({"sh_degree": -1}, "sh_degree: expected a whole number from 0 to 3, got -1"),
        ({"compensate_opacity": "x"}, "compensate_opacity: expected a whole number, got 'x'"),
        ({"screen_points": torch.zeros(N, 2)}, r"screen_points: expected shape \[24,3\] or \[24,4\]"),
        (
            {"means": torch.zeros(N, 3, device="meta")},
            "means: expected a tensor on the CPU or on CUDA, got one on meta",
        ),
        (
            {"opacities": torch.zeros(N, 1, device="meta")},
            "opacities: expected a tensor on cpu .as means., got one on meta",
        ),
    ],
)
def test_bad_arguments_are_named(change, message):
    with pytest.raises(ValueError, match=message):
        splatboost.rasterize(reference.turned_camera(), **{**small(), **change})


def pose_of(*rows):
    """A pose with these rows [3,3] in place of a rotation, as numbers of a Camera."""
    return tuple(float(v) for row in rows for v in [*row, 1]) + (0.0, 0.0, 0.0, 1.0)


@pytest.mark.parametrize(
    "change, message",
    [
        ({"width": 0}, "width: expected a whole number from 1 to 2147483647, got 0"),
        ({"height": 2**32 + 22}, "height: expected a whole number from 1"),
        ({"fx": None}, "fx: expected a number, got None"),
        ({"camera_from_world": (1.0, 2.0)}, "camera_from_world: expected 16 numbers, got 2 numbers"),
        ({"camera_from_world": None}, "camera_from_world: expected a vector or a matrix of numbers, got NoneType"),
        ({"camera_from_world": 15 * (0.0,) + (1.0,)}, "camera_from_world: expected a rigid motion, got one that scales or shears"),
        ({"camera_from_world": pose_of([2, 0, 0], [0, 2, 0], [0, 0, 2])}, "expected a rigid motion, got one that scales or shears"),
        ({"camera_from_world": pose_of([1, 0.5, 0], [0, 1, 0], [0, 0, 1])}, "expected a rigid motion, got one that scales or shears"),
        ({"camera_from_world": pose_of([-1, 0, 0], [0, 1, 0], [0, 0, 1])}, "expected a rigid motion, got one that mirrors"),
        ({"camera_from_world": (1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 1, 2, 3, 1)}, "camera_from_world: .*is it transposed"),
    ],
)
def test_bad_cameras_are_named(change, message):
    camera = dataclasses.replace(reference.turned_camera(), **change)
    tensors = small()
    for draw in (lambda: splatboost.rasterize(camera, **tensors), lambda: splatboost.mark_visible(camera, tensors["means"])):
        with pytest.raises(ValueError, match=message):
            draw()
    with pytest.raises(ValueError, match="camera: expected a Camera, got NoneType"):
        splatboost.rasterize(None, **tensors)


def test_sh_too_short_for_its_degree():
    tensors = small()
    del tensors["colors"]
    with pytest.raises(ValueError, match="sh_rest: expected 8 coefficients for sh_degree 2, got 3"):
        splatboost.rasterize(reference.turned_camera(), **tensors, sh=torch.zeros(N, 4, 3), sh_degree=2)


MOVED = torch.eye(4)
MOVED[:3, 3] = torch.tensor([0.5, 0.0, 2.0])


@pytest.mark.parametrize(
    "intrinsics, pose, message",
    [
        ([[30, 0, 16], [0, 30, 12], [0, 0, 1]], MOVED.T, "camera_from_world: .*is it transposed"),
        ([[30, 0, 16], [0, 30, 12], [0, 0, 1]], MOVED @ torch.diag(torch.tensor([2.0, 2, 2, 1])), "expected a rigid motion"),
        ([[30, 0, 16], [0, 30, 12], [0, 0, 1]], MOVED @ torch.diag(torch.tensor([1.0, 1, -1, 1])), "got one that mirrors"),
        ([[30, 0, 0], [0, 30, 0], [16, 12, 1]], MOVED, "intrinsics: .*is it transposed"),
        (torch.eye(2), MOVED, r"intrinsics: expected shape \[3,3\], got \[2,2\]"),
        (torch.eye(3), MOVED[0], r"camera_from_world: expected shape \[4,4\], got 4 numbers"),
        (torch.eye(3)[None], MOVED, r"intrinsics: expected a vector or a matrix of numbers, got shape \[1, 3, 3\]"),
    ],
)
def test_bad_matrices_of_a_camera_are_named(intrinsics, pose, message):
    with pytest.raises(ValueError, match=message):
        Camera.from_matrices(32, 24, intrinsics, pose)


def test_matrices_of_a_camera():
    intrinsics = torch.tensor([[30.0, 0, 16], [0, 31, 12], [0, 0, 1]])
    camera = Camera.from_matrices(32, 24, intrinsics, MOVED)
    assert camera == Camera(32, 24, 30.0, 31.0, 16.0, 12.0, tuple(MOVED.flatten().tolist()))
    assert camera == Camera.from_matrices(32, 24, intrinsics.tolist(), MOVED[:3].numpy())


def test_matrices_on_a_gpu_in_inference_mode():
    class OnCuda(torch.Tensor):
        device = property(lambda self: torch.device("cuda"))

    with torch.inference_mode():
        pose = MOVED.clone().as_subclass(OnCuda)
        assert Camera.from_matrices(8, 8, torch.eye(3), pose).camera_from_world[3] == 0.5
        pose[0, 3] = 0.25
        assert Camera.from_matrices(8, 8, torch.eye(3), pose).camera_from_world[3] == 0.25
