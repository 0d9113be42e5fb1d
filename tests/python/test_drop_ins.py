# SPDX-License-Identifier: Apache-2.0
"""The drop-ins: names, signatures and conventions of the upstream packages."""

import importlib
import inspect
import subprocess
import sys

import conftest
import pytest
import reference
import torch
from test_rasterize import small

import splatboost
from splatboost import compat, drop_ins
from splatboost.camera import Camera

N = 24
FIELDS = (
    "image_height image_width tanfovx tanfovy bg scale_modifier viewmatrix projmatrix sh_degree campos prefiltered "
    "debug"
).split()
ARGUMENTS = "means3D means2D opacities shs colors_precomp scales rotations cov3D_precomp".split()


def module(layout):
    return importlib.import_module("splatboost.compat." + drop_ins.LAYOUTS[layout])


def settings(layout, camera, sh_degree=3, **changes):
    view, full, centre, tanfovx, tanfovy = reference.matrices_3dgs(camera)
    values = dict(
        image_height=camera.height,
        image_width=camera.width,
        tanfovx=tanfovx,
        tanfovy=tanfovy,
        bg=torch.tensor([0.1, 0.2, 0.3]),
        scale_modifier=1.0,
        viewmatrix=view,
        projmatrix=full,
        sh_degree=sh_degree,
        campos=centre,
        prefiltered=False,
        debug=False,
    )
    if layout == "mip-splatting":
        values.update(kernel_size=0.1, subpixel_offset=torch.zeros(camera.height, camera.width, 2))
    values.update(changes)
    return module(layout).GaussianRasterizationSettings(**values)


@pytest.fixture(autouse=True)
def published_box():
    splatboost.set_beta(None)
    yield
    splatboost.set_beta(None)


def test_signatures():
    fields = {
        "3dgs-2023": FIELDS,
        "3dgs-2024": FIELDS + ["antialiasing"],
        "3dgs-accelerated": FIELDS + ["antialiasing"],
        "mip-splatting": FIELDS[:4] + ["kernel_size", "subpixel_offset"] + FIELDS[4:],
    }
    for layout, wanted in fields.items():
        m = module(layout)
        assert list(m.GaussianRasterizationSettings._fields) == wanted
        arguments = ARGUMENTS[:3] + ["dc"] + ARGUMENTS[3:] if layout == "3dgs-accelerated" else ARGUMENTS
        assert list(inspect.signature(m.GaussianRasterizer.forward).parameters) == ["self"] + arguments
        assert list(inspect.signature(m.GaussianRasterizer).parameters) == ["raster_settings"]
        assert hasattr(m.GaussianRasterizer, "markVisible") and hasattr(m, "rasterize_gaussians")
        # 3DGS imports the class to detect whether the sparse optimizer is available.
        assert hasattr(m, "SparseGaussianAdam") == (layout == "3dgs-accelerated")


@pytest.mark.parametrize("centre", [(None, None), (13.2, 12.7)])
def test_matrices_become_the_camera(centre):
    camera = reference.turned_camera(cx=centre[0], cy=centre[1])
    view, full, position, tanfovx, tanfovy = reference.matrices_3dgs(camera)
    got = Camera.from_3dgs(camera.height, camera.width, tanfovx, tanfovy, view, full, position)
    for name in ("width", "height", "fx", "fy", "cx", "cy"):
        assert getattr(got, name) == pytest.approx(getattr(camera, name), abs=2e-5), name
    assert got.camera_from_world == pytest.approx(camera.camera_from_world, abs=1e-6)
    if centre == (None, None):
        assert (got.cx, got.cy) == (camera.width / 2, camera.height / 2)


def test_matrices_that_do_not_fit_are_refused():
    camera = reference.turned_camera()
    view, full, position, tanfovx, tanfovy = reference.matrices_3dgs(camera)
    h, w = camera.height, camera.width
    with pytest.raises(ValueError, match="projmatrix: expected a pinhole projection that matches"):
        Camera.from_3dgs(h, w, tanfovx, tanfovy, view, full.T, position)
    with pytest.raises(ValueError, match="projmatrix"):
        Camera.from_3dgs(h, w, 2 * tanfovx, tanfovy, view, full, position)
    with pytest.raises(ValueError, match="viewmatrix: expected a rigid motion"):
        Camera.from_3dgs(h, w, tanfovx, tanfovy, 2 * view, full, position)
    with pytest.raises(ValueError, match="viewmatrix: expected a rigid motion, got one that mirrors"):
        Camera.from_3dgs(h, w, tanfovx, tanfovy, view @ torch.diag(torch.tensor([-1.0, 1, 1, 1])), full, position)
    with pytest.raises(ValueError, match="campos: expected the centre of viewmatrix"):
        Camera.from_3dgs(h, w, tanfovx, tanfovy, view, full, position + 1)
    with pytest.raises(ValueError, match=r"viewmatrix: expected shape \[4,4\]"):
        Camera.from_3dgs(h, w, tanfovx, tanfovy, view[:3], full, position)


def inputs(seed=0, dc_apart=False):
    tensors = small(seed)
    sh = ((torch.rand(N, 16, 3, generator=torch.Generator().manual_seed(9)) - 0.4) * 0.8).requires_grad_()
    arguments = dict(
        means3D=tensors["means"],
        means2D=torch.zeros(N, 3, requires_grad=True),
        opacities=tensors["opacities"],
        shs=sh,
        scales=tensors["scales"],
        rotations=tensors["rotations"],
    )
    if dc_apart:
        arguments["dc"] = sh.detach()[:, :1].clone().requires_grad_()
        arguments["shs"] = sh.detach()[:, 1:].clone().requires_grad_()
    return arguments


@pytest.mark.parametrize(
    "layout, options",
    [
        ("3dgs-2023", {}),
        ("3dgs-2024", {}),
        ("3dgs-2024", {"antialiasing": True}),
        ("3dgs-accelerated", {"antialiasing": False}),
        ("mip-splatting", {}),
    ],
)
def test_each_layout_draws_the_reference(layout, options):
    """The 3σ square cuts splats off; opacities are so low that alpha is below the threshold there."""
    camera = reference.turned_camera(cx=14.0)
    arguments = inputs(dc_apart=layout == "3dgs-accelerated")
    arguments["opacities"] = (arguments["opacities"].detach() * 0.3).requires_grad_()
    done = module(layout).GaussianRasterizer(settings(layout, camera, **options))(**arguments)
    color, radii = done[0], done[1]
    sh = torch.cat([arguments["dc"], arguments["shs"]], 1) if "dc" in arguments else arguments["shs"]
    mip = layout == "mip-splatting"
    names = {"means": "means3D", "opacities": "opacities", "scales": "scales", "rotations": "rotations"}
    exact = {k: arguments[v].detach().double().requires_grad_() for k, v in names.items()}
    image, _, depth, _, counts = reference.render(
        camera,
        **exact,
        sh=sh.detach().double(),
        sh_degree=3,
        background=(0.1, 0.2, 0.3),
        low_pass=0.1 if mip else 0.3,
        compensate_opacity=mip or options.get("antialiasing", False),
    )
    # float32 matrices of 3DGS: the principal point is accurate to about 1e-6 of the image size.
    assert (color - image).abs().max() < 1e-4
    assert radii.dtype == torch.int32 and torch.equal(radii > 0, radii != 0)
    assert len(done) == (2 if layout in ("3dgs-2023", "mip-splatting") else 3)
    if len(done) == 3:
        assert done[2].shape == (1, camera.height, camera.width) and (done[2] - depth).abs().max() < 1e-4
    image.square().sum().backward()
    color.square().sum().backward()
    for k, v in names.items():
        assert (arguments[v].grad - exact[k].grad).abs().max() < 2e-3 * (1 + exact[k].grad.abs().max()), v
    points = arguments["means2D"].grad
    assert points.shape == (N, 3) and points[:, :2].abs().max() > 0
    assert (points[:, 2] > 0).any() if mip else (points[:, 2] == 0).all()
    assert torch.equal(compat.last_render().radii, radii)
    with torch.no_grad():
        everywhere = torch.ones(camera.height, camera.width, dtype=torch.bool)
        module(layout).GaussianRasterizer(settings(layout, camera, **options))(**arguments)
        counted = splatboost.last_render().count_flagged(everywhere)
    # Pixels at the 1/255 threshold may fall on either side.
    assert (counted - counts.sum(dim=(1, 2))).abs().max() <= 2


def test_precomputed_colors_covariances_and_scale_modifier():
    camera, m = reference.turned_camera(), module("3dgs-2023")
    arguments = inputs()
    del arguments["shs"]
    colors = torch.rand(N, 3)
    doubled = m.GaussianRasterizer(settings("3dgs-2023", camera, scale_modifier=2.0))(
        **arguments, colors_precomp=colors
    )
    arguments["scales"] = arguments["scales"] * 2
    plain = m.GaussianRasterizer(settings("3dgs-2023", camera))(**arguments, colors_precomp=colors)
    assert torch.equal(doubled[0], plain[0])
    cov = reference.covariances_of(
        arguments.pop("scales").detach().double(), arguments.pop("rotations").detach().double()
    )
    cov = torch.stack([cov[:, 0, 0], cov[:, 0, 1], cov[:, 0, 2], cov[:, 1, 1], cov[:, 1, 2], cov[:, 2, 2]], 1).float()
    given = m.GaussianRasterizer(settings("3dgs-2023", camera))(**arguments, colors_precomp=colors, cov3D_precomp=cov)
    assert (given[0] - plain[0]).abs().max() < 1e-4
    empty = torch.Tensor([])
    same = m.rasterize_gaussians(
        arguments["means3D"],
        arguments["means2D"],
        empty,
        colors,
        arguments["opacities"],
        empty,
        empty,
        cov,
        settings("3dgs-2023", camera),
    )
    assert torch.equal(same[0], given[0])


@pytest.mark.parametrize("layout", ["3dgs-2023", "3dgs-2024", "3dgs-accelerated", "mip-splatting", "absgs", "anchors"])
@pytest.mark.parametrize("colors", [False, True])
def test_the_functions_draw_no_gaussians(layout, colors):
    empty, m = torch.Tensor([]), module(layout)
    sh = [empty] if colors else [torch.zeros(0, 16, 3)]
    if layout == "3dgs-accelerated":
        sh = [empty, empty] if colors else [torch.zeros(0, 1, 3), torch.zeros(0, 15, 3)]
    means = torch.zeros(0, 3, requires_grad=True)
    done = m.rasterize_gaussians(
        means, torch.zeros(0, 3), *sh, torch.zeros(0, 3) if colors else empty, torch.zeros(0, 1), torch.zeros(0, 3),
        torch.zeros(0, 4), empty, settings(layout, reference.turned_camera()))
    assert torch.equal(done[0], torch.tensor([0.1, 0.2, 0.3]).view(3, 1, 1).expand_as(done[0])) and done[1].shape == (0,)
    done[0].sum().backward()
    assert means.grad.shape == (0, 3)


def test_beta_chooses_the_box():
    camera, m = reference.turned_camera(60, 44), module("3dgs-2023")
    arguments = inputs()
    arguments["scales"] = arguments["scales"].detach() * 0.5

    def drawn():
        return m.GaussianRasterizer(settings("3dgs-2023", camera))(**arguments)[0].detach()

    square = drawn()
    splatboost.set_beta(1.0)
    assert splatboost.get_beta() == 1.0
    exact = drawn()
    splatboost.set_beta(0.3)
    assert not torch.equal(drawn(), exact)
    splatboost.set_beta(None)
    assert torch.equal(drawn(), square)
    for wrong in (0.0, 1.1, float("nan"), "x", torch.zeros(2)):
        with pytest.raises(ValueError, match="beta"):
            splatboost.set_beta(wrong)


def test_four_columns_get_absolute_gradients():
    arguments = inputs()
    arguments["means2D"] = torch.zeros(N, 4, requires_grad=True)
    rasterizer = module("3dgs-2023").GaussianRasterizer(settings("3dgs-2023", reference.turned_camera()))
    rasterizer(**arguments)[0].square().sum().backward()
    g = arguments["means2D"].grad
    assert (g[:, 2:] >= g[:, :2].abs() * 0.999).all() and (g[:, 2:] > 1.5 * g[:, :2].abs()).any()


def test_mark_visible():
    rasterizer = module("3dgs-2023").GaussianRasterizer(settings("3dgs-2023", reference.turned_camera()))
    centre = rasterizer.raster_settings.campos
    forward = torch.tensor(reference.turned_camera().camera_from_world).view(4, 4)[2, :3]
    points = torch.stack([centre + forward * z for z in (0.1, 0.3, -1.0)])
    assert rasterizer.markVisible(points).tolist() == [False, True, False]


def test_wrong_combinations_are_refused():
    rasterizer = module("3dgs-2023").GaussianRasterizer(settings("3dgs-2023", reference.turned_camera()))
    arguments = inputs()
    with pytest.raises(ValueError, match="either shs or colors_precomp"):
        rasterizer(**arguments, colors_precomp=torch.zeros(N, 3))
    with pytest.raises(ValueError, match="either scales and rotations, or cov3D_precomp"):
        rasterizer(**arguments, cov3D_precomp=torch.zeros(N, 6))
    for changed, message in (
        (dict(means3D=None), "means3D: expected a tensor, got NoneType"),
        (dict(means2D=torch.zeros(N, 2)), r"means2D: expected shape \[24,3\] or \[24,4\], got \[24, 2\]"),
        (dict(shs=torch.zeros(N, 3)), r"shs: expected shape \[24,K,3\], got \[24, 3\]"),
        (dict(scales=3), "scales: expected a tensor, got int"),
    ):
        with pytest.raises(ValueError, match=message):
            rasterizer(**{**arguments, **changed})
    for changed, message in (
        (dict(image_height=None), "image_height: expected a whole number, got None"),
        (dict(tanfovx=0.0), "tanfovx: expected a number above 0, got 0.0"),
        (dict(bg=None), "bg: expected a vector or a matrix of numbers, got NoneType"),
        (dict(sh_degree=9), "sh_degree: expected a whole number from 0 to 3, got 9"),
        (dict(scale_modifier="x"), "scale_modifier: expected a number, got 'x'"),
    ):
        with pytest.raises(ValueError, match=message):
            rasterizer.__class__(rasterizer.raster_settings._replace(**changed))(**arguments)
    with pytest.raises(ValueError, match="layout: expected one of"):
        splatboost.install_drop_ins(["pgsr"])
    offset = torch.full((22, 30, 2), 0.25)
    mip = module("mip-splatting").GaussianRasterizer(
        settings("mip-splatting", reference.turned_camera(), subpixel_offset=offset)
    )
    with pytest.raises(ValueError, match="subpixel_offset: expected zeros"):
        mip(**arguments)


def test_sparse_adam_steps_what_was_visible():
    adam = module("3dgs-accelerated").SparseGaussianAdam
    value = torch.nn.Parameter(torch.ones(4, 2))
    optimizer = adam([{"params": [value], "lr": 0.1, "name": "xyz"}], lr=0.0, eps=1e-15)
    visible = torch.tensor([True, False, True, False])
    first, second = torch.zeros(4, 2), torch.zeros(4, 2)
    expected = torch.ones(4, 2)
    for step in range(3):
        value.grad = torch.arange(8.0).view(4, 2) - step
        optimizer.step(visible, 4)
        first[visible] = 0.9 * first[visible] + 0.1 * value.grad[visible]
        second[visible] = 0.999 * second[visible] + 0.001 * value.grad[visible] ** 2
        expected[visible] -= 0.1 * first[visible] / (second[visible].sqrt() + 1e-15)
        assert torch.allclose(value.detach(), expected, atol=1e-6)
    assert torch.equal(value.detach()[~visible], torch.ones(2, 2))
    assert {"exp_avg", "exp_avg_sq"} <= set(optimizer.state[value])
    with pytest.raises(ValueError, match=r"visibility: expected bool \[4\]"):
        optimizer.step(visible[:3], 4)
    # Right after growth the host still has the visibility of before it; the new tensors have no gradient yet.
    optimizer.param_groups[0]["params"] = [torch.nn.Parameter(torch.ones(6, 2))]
    optimizer.step(visible, 4)
    assert torch.equal(optimizer.param_groups[0]["params"][0].detach(), torch.ones(6, 2))
    optimizer.param_groups[0]["params"][0].grad = torch.ones(6, 2)
    with pytest.raises(ValueError, match="expected tensors of 4 rows"):
        optimizer.step(visible, 4)


def test_install_drop_ins():
    """In a separate process, since sys.modules is global."""
    script = """
import sys, splatboost
from splatboost.drop_ins import LAYOUTS
splatboost.install_drop_ins("absgs")
import diff_gaussian_rasterization_abs, simple_knn._C
assert diff_gaussian_rasterization_abs.GaussianRasterizer.__module__ == "splatboost.compat." + LAYOUTS.pop("absgs")
assert "diff_gaussian_rasterization" not in sys.modules
splatboost.install_drop_ins("pgsr")
import diff_plane_rasterization
assert diff_plane_rasterization.GaussianRasterizer.__module__ == "splatboost.compat." + LAYOUTS.pop("pgsr")
splatboost.install_drop_ins("surfels")
import diff_surfel_rasterization
assert diff_surfel_rasterization.GaussianRasterizer.__module__ == "splatboost.compat." + LAYOUTS.pop("surfels")
splatboost.install_drop_ins("convexes")
import diff_convex_rasterization
assert diff_convex_rasterization.ConvexRasterizer.__module__ == "splatboost.compat." + LAYOUTS.pop("convexes")
for layout in LAYOUTS:
    names = splatboost.install_drop_ins(layout)
    assert splatboost.install_drop_ins(layout) == names
    from diff_gaussian_rasterization import GaussianRasterizer, GaussianRasterizationSettings
    from simple_knn._C import distCUDA2
    from fused_ssim import fused_ssim
    assert GaussianRasterizer.__module__ == "splatboost.compat." + LAYOUTS[layout]
    other = "3dgs-2023" if layout != "3dgs-2023" else "3dgs-2024"
    try:
        splatboost.install_drop_ins(other)
    except RuntimeError as e:
        assert "imported already" in str(e)
    else:
        raise AssertionError("a second layout was taken")
    for name in names:
        del sys.modules[name]
import torch
points = torch.tensor([[0.0, 0, 0], [1, 0, 0], [3, 0, 0], [7, 0, 0]])
assert abs(distCUDA2(points)[0] - 59 / 3) < 1e-5
image = torch.rand(1, 3, 20, 20)
assert abs(fused_ssim(image, image) - 1) < 1e-6
try:
    splatboost.install_drop_ins("3dgs")
except ValueError as e:
    assert "layout: expected one of" in str(e)
else:
    raise AssertionError("an unknown layout was taken")
"""
    subprocess.run([sys.executable, "-c", script], check=True, cwd=conftest.PACKAGE, timeout=120)


def test_deformable_gives_absolute_gradients_and_depth():
    rasterizer = module("deformable-3dgs").GaussianRasterizer(settings("deformable-3dgs", reference.turned_camera()))
    given = inputs()
    densify = torch.zeros(N, 3, requires_grad=True)
    color, radii, depth = rasterizer(means2D_densify=densify, **given)
    assert depth.shape == (1,) + color.shape[1:] and not depth.requires_grad
    color.square().sum().backward()
    plain = inputs()
    plain["means2D"] = torch.zeros(N, 4, requires_grad=True)
    again = module("3dgs-2023").GaussianRasterizer(settings("3dgs-2023", reference.turned_camera()))(**plain)
    assert torch.equal(again[0], color) and torch.equal(again[1], radii)
    again[0].square().sum().backward()
    # A GPU sums gradients in any order.
    torch.testing.assert_close(given["means2D"].grad[:, :2], plain["means2D"].grad[:, :2], rtol=1e-5, atol=1e-5)
    torch.testing.assert_close(densify.grad[:, :2], plain["means2D"].grad[:, 2:], rtol=1e-5, atol=1e-5)
    assert (densify.grad[:, :2] >= given["means2D"].grad[:, :2].abs() - 1e-5).all()
    # Depth is blended: where alpha is below 1, it lies between 0 and the depth of the farthest Gaussian.
    view = settings("deformable-3dgs", reference.turned_camera()).viewmatrix
    z = given["means3D"].detach() @ view[:3, 2] + view[3, 2]
    assert 0 < depth.max() <= z.max()


@pytest.mark.parametrize("layout, channel", [("surfels", 0), ("opacity-fields", 6)])
def test_maps_where_nothing_is_drawn_pass_no_nan_on(layout, channel):
    """Hosts divide depth by alpha at every pixel."""
    view = settings("mip-splatting" if layout == "opacity-fields" else "3dgs-2023", Camera(40, 30, 40, 40, 20, 15, (1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1)))
    means = torch.tensor([[0.0, 0, 3], [0.2, 0.1, 2]], requires_grad=True)
    scales = torch.full((2, 2 if layout == "surfels" else 3), 0.05)
    done = module(layout).GaussianRasterizer(view)(
        means, torch.zeros(2, 3), torch.full((2, 1), 0.9), colors_precomp=torch.ones(2, 3), scales=scales,
        rotations=torch.tensor([[1.0, 0.2, 0, 0]]).repeat(2, 1))
    maps = done[2] if layout == "surfels" else done[0]
    alpha = maps[1] if layout == "surfels" else maps[7]
    assert (alpha == 0).any() and (alpha > 0.5).any()
    torch.nan_to_num(maps[channel] / alpha).sum().backward()
    assert torch.isfinite(means.grad).all() and means.grad[:, 2].abs().sum() > 0


def plane_settings(camera, render_geo=True):
    values = settings("3dgs-2023", camera)._asdict()
    return module("pgsr").GaussianRasterizationSettings(render_geo=render_geo, **values)


def plane_inputs():
    given = inputs(3)
    given["means2D_abs"] = torch.zeros(N, 3, requires_grad=True)
    maps = torch.rand(N, 5, generator=torch.Generator().manual_seed(4)) - torch.tensor([0.5, 0.5, 1.5, 0, -1])
    given["all_map"] = maps.requires_grad_()  # normals that face the camera
    given["scales"] = (given["scales"].detach() * 1.5).requires_grad_()
    return given


def exact_planes(camera, given, moved=None, **options):
    """Maps, depth of planes, alpha and counts of the double-precision renderer; depth by its formula for each pixel."""
    names = {"means": "means3D", "opacities": "opacities", "scales": "scales", "rotations": "rotations", "features": "all_map"}
    exact = {k: given[v].detach().double() for k, v in names.items()}
    for name, change in (moved or {}).items():
        exact[name] = exact[name] + change
    _, maps, _, alpha, counts = reference.render(camera, **exact, colors=torch.zeros(N, 3, dtype=torch.float64), **options)
    depth = torch.zeros(camera.height, camera.width, dtype=torch.float64)
    for j in range(camera.height):
        for i in range(camera.width):
            # The host uses the ray through a pixel's corner.
            ray = torch.tensor([(i - 0.5 * camera.width) / camera.fx, (j - 0.5 * camera.height) / camera.fy, 1.0]).double()
            depth[j, i] = -maps[4, j, i] / (maps[:3, j, i] @ ray + 1e-8)
    return maps, depth, alpha, counts


def test_planes_are_the_reference_s():
    camera, given = reference.turned_camera(20, 15), plane_inputs()
    splatboost.set_beta(1.0)
    color, radii, observed, maps, depth = module("pgsr").GaussianRasterizer(plane_settings(camera))(**given)
    exact_maps, exact_depth, alpha, counts = exact_planes(camera, given, observed_above=0.5)
    seen = alpha[0] > 0.3
    assert maps.shape == (5, 15, 20) and depth.shape == (1, 15, 20) and seen.sum() > 100
    assert (maps - exact_maps).abs().max() < 1e-4
    assert ((depth[0] - exact_depth).abs() / exact_depth.abs())[seen].max() < 1e-3
    # Pixels at a threshold may fall on either side.
    assert observed.dtype == torch.int32 and (observed - counts.sum(dim=(1, 2))).abs().max() <= 2
    assert 0 < (observed > 0).sum() and observed.sum() < 0.8 * splatboost.last_render().count_flagged(
        torch.ones(15, 20, dtype=torch.bool)).sum()
    plain = module("3dgs-2023").GaussianRasterizer(settings("3dgs-2023", camera))(
        **{k: v for k, v in given.items() if k not in ("means2D_abs", "all_map")})
    assert torch.equal(plain[0], color) and torch.equal(plain[1], radii)


def test_gradients_go_through_planes():
    """Against finite differences of the double-precision renderer: each input changes along a random direction."""
    camera, given = reference.turned_camera(12, 9), plane_inputs()
    splatboost.set_beta(1.0)
    _, _, alpha, _ = exact_planes(camera, given)
    random = torch.Generator().manual_seed(8)
    of_maps = torch.randn(5, 9, 12, generator=random)
    of_depth = torch.randn(9, 12, generator=random) * (alpha[0] > 0.3)

    def loss(maps, depth):
        return (maps * of_maps.to(maps)).sum() + (depth * of_depth.to(depth)).sum()

    done = module("pgsr").GaussianRasterizer(plane_settings(camera))(**given)
    loss(done[3], done[4][0]).backward()
    for name, argument in (("features", "all_map"), ("means", "means3D"), ("opacities", "opacities"), ("scales", "scales"),
                           ("rotations", "rotations")):
        direction = torch.randn(given[argument].shape, generator=random).double()
        h = 1e-6
        up, down = (loss(*exact_planes(camera, given, {name: sign * h * direction})[:2]) for sign in (1, -1))
        wanted = ((up - down) / (2 * h)).item()
        found = (given[argument].grad.double() * direction).sum().item()
        assert abs(wanted) > 0.1 and abs(found - wanted) < 2e-3 * (1 + abs(wanted)), (argument, found, wanted)
    # The gradients that the host's density control reads.
    signed, absolute = given["means2D"].grad, given["means2D_abs"].grad
    assert signed[:, :2].abs().max() > 0 and (absolute[:, :2] >= 0.999 * signed[:, :2].abs()).all()
    assert not signed[:, 2].any() and not absolute[:, 2].any() and not torch.equal(absolute[:, :2], signed[:, :2].abs())


def test_without_planes_their_maps_are_zero():
    camera, given = reference.turned_camera(), plane_inputs()
    _, _, observed, maps, depth = module("pgsr").GaussianRasterizer(plane_settings(camera, False))(**given)
    assert observed.any() and maps.shape == (5, 22, 30) and depth.shape == (1, 22, 30)
    assert not maps.any() and not depth.any() and not maps.requires_grad
    given["all_map"] = given["all_map"].detach()[:, :4]
    with pytest.raises(ValueError, match=r"all_map: expected shape \[N,5\]"):
        module("pgsr").GaussianRasterizer(plane_settings(camera))(**given)
    del given["all_map"]
    with pytest.raises(ValueError, match="all_map: expected .* with render_geo"):
        module("pgsr").GaussianRasterizer(plane_settings(camera))(**given)


def test_stand_ins_of_pgsr():
    from splatboost import _stand_ins

    q = torch.randn(5, 4, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    turned = _stand_ins.quaternion_to_matrix(q)
    assert torch.allclose(turned, reference.rotation_matrices(q)) and torch.allclose(turned.det(), torch.ones(5).double())
    root = _stand_ins._Missing("open3d")
    _stand_ins._open3d(root)
    integration = root.pipelines.integration
    volume = integration.ScalableTSDFVolume(voxel_length=1, sdf_trunc=4, color_type=integration.TSDFVolumeColorType.RGB8)
    with pytest.raises(ModuleNotFoundError, match="open3d: required for meshes, but not installed"):
        volume.integrate(1)
