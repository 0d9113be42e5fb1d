# SPDX-License-Identifier: Apache-2.0
"""The convex rasterizer on tensors, and the drop-in for 3D Convex Splatting, against double precision."""

import inspect

import pytest
import reference
import torch
from test_rasterize import assert_same, draw_in_threads, run_apart

import splatboost
from splatboost import compat
from splatboost._convexes import rasterize_convexes
from splatboost.compat import diff_convex_rasterization as drop_in

N, K = 9, 6
NAMES = ("points", "smoothness", "sharpness", "opacities", "sh")
BACKGROUND = (0.2, 0.5, 0.9)


@pytest.fixture(autouse=True)
def published_box():
    splatboost.set_beta(None)
    yield
    splatboost.set_beta(None)


def convexes(seed=3):
    """Random convexes: float64 tensors with float32 values, which require gradients."""
    g = torch.Generator().manual_seed(seed)

    def uniform(*shape):
        return torch.rand(*shape, generator=g)

    size = 0.2 + 0.6 * uniform(N, 1, 1)
    tensors = {
        "points": (uniform(N, 1, 3) - 0.5) * torch.tensor([3.0, 2.0, 2.0]) + size * (2 * uniform(N, K, 3) - 1),
        "smoothness": 0.02 + 0.1 * uniform(N, 1),
        "sharpness": 0.1 + 0.4 * uniform(N, 1),
        "opacities": 0.2 + 0.75 * uniform(N, 1),
        "sh": (uniform(N, 16, 3) - 0.4) * 0.8,
    }
    return {name: value.double().requires_grad_() for name, value in tensors.items()}


def loss_of(image, certain):
    weights = torch.randn(image.shape, generator=torch.Generator().manual_seed(5), dtype=torch.float64)
    return (image * (weights * certain).to(image.dtype)).sum()


def assert_close(found, expected, name):
    assert expected.abs().max() > 0, name
    error = (found.double() - expected).abs().max() / expected.abs().max()
    assert error < 1e-3, (name, error)


def test_images_and_gradients_are_the_references():
    exact = convexes()
    image, screen, blended, certain = reference.render_convexes(
        reference.turned_camera(), **exact, sh_degree=3, background=BACKGROUND)
    assert certain.float().mean() > 0.98 and 0.1 < image.std()
    loss_of(image, certain).backward()

    single = {name: value.detach().float().requires_grad_() for name, value in convexes().items()}
    points = torch.zeros(N, 3, requires_grad=True)
    done = rasterize_convexes(reference.turned_camera(), **single, sh_degree=3, background=BACKGROUND, beta=1.0,
                              screen_points=points)
    assert ((done.color - image) * certain).abs().max() < 2e-5
    loss_of(done.color, certain).backward()
    for name in NAMES:
        assert_close(single[name].grad, exact[name].grad, name)
    assert_close(points.grad[:, :2], screen.grad.sum(dim=1), "screen_points")
    assert_close(points.grad[:, 2], screen.grad.abs().sum(dim=(1, 2)), "screen_points, absolute")
    with torch.no_grad():
        done = rasterize_convexes(reference.turned_camera(), **single, sh_degree=3, beta=1.0)
    assert torch.equal(done.count_flagged(certain), (blended & certain).sum(dim=(1, 2)).int())


def test_weights_make_up_the_picture_of_white_convexes():
    tensors = {name: value.detach().float() for name, value in convexes().items() if name != "sh"}
    camera = reference.turned_camera()
    with torch.no_grad():
        done = rasterize_convexes(camera, **tensors, colors=torch.ones(N, 3), beta=1.0)
        weights = done.weights()
        blended = done.count_flagged(torch.ones(camera.height, camera.width, dtype=torch.bool))
        assert (weights <= 256 * blended).all() and (weights > 0).sum() > N / 4
        assert abs(float(weights.sum()) / 256 - float(done.color[0].sum())) < 0.5 / 256 * float(blended.sum())
        with pytest.raises(TypeError, match="only available for renders of Gaussians"):
            done.count_observed()


def train_and_look():
    def train(seed):
        tensors = {name: value.detach().float().requires_grad_() for name, value in convexes(seed).items()}
        done = rasterize_convexes(reference.turned_camera(200, 150), **tensors, sh_degree=3, beta=1.0)
        return (done.color.detach(), *torch.autograd.grad(done.color.sum(), list(tensors.values())))

    def look():
        tensors = {name: value.detach().float() for name, value in convexes().items()}
        with torch.no_grad():
            done = rasterize_convexes(reference.turned_camera(120, 260), **tensors, sh_degree=3, beta=1.0)
        return done.color, done.radii

    draw_in_threads([lambda: train(3), lambda: train(4), look, look])


def test_threads_render_at_the_same_time():
    run_apart("test_convexes", "train_and_look")


def test_the_references_gradients_are_differences():
    tensors = {name: value.detach()[:2] for name, value in convexes().items()}
    camera = reference.turned_camera(12, 9)

    def image(*inputs):
        return reference.render_convexes(camera, *inputs[:4], colors=inputs[4])[0].reshape(-1)[::7]

    inputs = [tensors[name].requires_grad_() for name in NAMES[:4]] + [torch.rand(2, 3).double().requires_grad_()]
    assert torch.autograd.gradcheck(image, inputs, eps=1e-7, atol=1e-5, rtol=1e-4)


def given(tensors, **changes):
    """Arguments of the release's ConvexRasterizer, in the shapes that its host passes."""
    counts = torch.full((N,), K, dtype=torch.int32)
    arguments = dict(
        convex_points=tensors["points"].flatten(0), delta=tensors["smoothness"], sigma=tensors["sharpness"],
        num_points_per_convex=counts, cumsum_of_points_per_convex=torch.cumsum(counts, 0, dtype=torch.int32) - K,
        number_of_points=N, opacities=tensors["opacities"], means2D=torch.zeros(N, 3, requires_grad=True),
        scaling=torch.zeros(N), density_factor=torch.zeros(N), shs=tensors["sh"])
    arguments.update(changes)
    return arguments


def rasterizer():
    camera = reference.turned_camera()
    view, full, centre, tanfovx, tanfovy = reference.matrices_3dgs(camera)
    return drop_in.ConvexRasterizer(drop_in.ConvexRasterizationSettings(
        image_height=camera.height, image_width=camera.width, tanfovx=tanfovx, tanfovy=tanfovy,
        bg=torch.tensor(BACKGROUND), scale_modifier=1.0, viewmatrix=view, projmatrix=full, sh_degree=3, campos=centre,
        prefiltered=False, debug=False))


def test_the_drop_in_has_the_releases_interface():
    assert list(inspect.signature(drop_in.ConvexRasterizer.forward).parameters) == ["self", *given(convexes())][:-1] + [
        "shs", "colors_precomp"]
    assert list(inspect.signature(drop_in.rasterize_convexes).parameters) == [
        "convex_points", "delta", "sigma", "num_points_per_convex", "cumsum_of_points_per_convex", "number_of_points", "sh",
        "colors_precomp", "opacities", "means2D", "scaling", "density_factor", "raster_settings"]
    assert drop_in.ConvexRasterizationSettings._fields == (
        "image_height", "image_width", "tanfovx", "tanfovy", "bg", "scale_modifier", "viewmatrix", "projmatrix", "sh_degree",
        "campos", "prefiltered", "debug")


def test_the_drop_in_draws_as_the_release():
    splatboost.set_beta(1.0)
    exact = convexes()
    image, screen, _, certain = reference.render_convexes(
        reference.turned_camera(), **exact, sh_degree=3, background=BACKGROUND, released_view_direction=True)
    loss_of(image, certain).backward()
    single = {name: value.detach().float().requires_grad_() for name, value in convexes().items()}
    arguments = given(single)
    color, radii, scaling, density_factor, others = rasterizer()(**arguments)
    # float32 matrices of 3DGS: the principal point is accurate to about 1e-6 of the image size.
    assert ((color - image) * certain).abs().max() < 1e-4
    assert others.shape == (7,) + color.shape[1:] and not others.any() and not density_factor.any()
    loss_of(color, certain).backward()
    for name in ("smoothness", "sharpness", "opacities", "sh"):  # not points, see convex_rasterizer.h
        assert_close(single[name].grad, exact[name].grad, name)
    assert_close(arguments["means2D"].grad[:, :2], screen.grad.sum(dim=1), "means2D")

    assert radii.dtype == torch.int32 and (radii > 0).all()
    centres = reference_pixels(exact["points"].detach().mean(dim=1, keepdim=True))
    far = (screen.detach() - centres).norm(dim=-1).amax(dim=1)
    assert ((radii >= 1.1 * far - 1e-3) & (radii <= 1.1 * far + 1 + 1e-3)).all()
    deviations = exact["points"].detach().std(dim=1, unbiased=False).amax(dim=1)
    assert (scaling - deviations).abs().max() < 1e-5
    assert torch.equal(compat.last_render().radii, radii)

    empty = torch.Tensor([])
    ordered = {**arguments, "sh": arguments["shs"], "colors_precomp": empty}
    names = list(inspect.signature(drop_in.rasterize_convexes).parameters)[:-1]
    again = drop_in.rasterize_convexes(*[ordered[name] for name in names], rasterizer().raster_settings)
    assert_same(again[0].detach(), color.detach())


def reference_pixels(points):
    camera = reference.turned_camera()
    world = torch.tensor(camera.camera_from_world, dtype=torch.float64).view(4, 4)
    view = points @ world[:3, :3].T + world[:3, 3]
    return view[..., :2] / view[..., 2:] * torch.tensor([camera.fx, camera.fy]).double() + torch.tensor(
        [camera.cx, camera.cy]).double()


def test_beta_chooses_the_box_and_behind_the_camera_nothing_is_seen():
    single = {name: value.detach().float() for name, value in convexes().items()}
    square = rasterizer()(**given(single))[0]
    splatboost.set_beta(0.3)
    assert not torch.equal(rasterizer()(**given(single))[0], square)
    splatboost.set_beta(None)
    assert torch.equal(rasterizer()(**given(single))[0], square)
    single["points"] = single["points"].clone()
    centre = rasterizer().raster_settings.campos
    single["points"][4] = 2.5 * centre + single["points"][4]
    _, radii, scaling, _, _ = rasterizer()(**given(single))
    assert radii[4] == 0 and scaling[4] == 0 and (radii > 0).sum() == N - 1


def test_wrong_arguments_are_refused():
    single = {name: value.detach().float() for name, value in convexes().items()}
    with pytest.raises(ValueError, match="either shs or colors_precomp"):
        rasterizer()(**given(single, colors_precomp=torch.zeros(N, 3)))
    counts = torch.full((N,), K, dtype=torch.int32)
    counts[0], counts[1] = K - 1, K + 1
    with pytest.raises(ValueError, match="the same number of points for every convex"):
        rasterizer()(**given(single, num_points_per_convex=counts))
    with pytest.raises(ValueError, match="points: expected 3 to 8 points per convex, got 2"):
        rasterize_convexes(reference.turned_camera(), **{**single, "points": single["points"][:, :2].contiguous()}, sh_degree=3)
    with pytest.raises(ValueError, match=r"sharpness: expected shape \[9,1\] or \[9\]"):
        rasterize_convexes(reference.turned_camera(), **{**single, "sharpness": torch.ones(3)}, sh_degree=3)
