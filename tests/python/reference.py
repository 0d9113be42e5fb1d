# SPDX-License-Identifier: Apache-2.0
"""The rasterizer in double precision: no tiles, every Gaussian at every pixel, torch's own derivatives."""

import math

import torch

SH1 = 0.4886025119029199
SH2 = (1.0925484305920792, -1.0925484305920792, 0.31539156525252005, -1.0925484305920792, 0.5462742152960396)
SH3 = (
    -0.5900435899266435,
    2.890611442640554,
    -0.4570457994644658,
    0.3731763325901154,
    -0.4570457994644658,
    1.445305721320277,
    -0.5900435899266435,
)


def rotation_matrices(q):
    w, x, y, z = (q / q.norm(dim=1, keepdim=True)).unbind(1)
    return torch.stack(
        [
            1 - 2 * (y * y + z * z),
            2 * (x * y - w * z),
            2 * (x * z + w * y),
            2 * (x * y + w * z),
            1 - 2 * (x * x + z * z),
            2 * (y * z - w * x),
            2 * (x * z - w * y),
            2 * (y * z + w * x),
            1 - 2 * (x * x + y * y),
        ],
        dim=1,
    ).view(-1, 3, 3)


def covariances_of(scales, rotations):
    m = rotation_matrices(rotations) * scales[:, None, :]
    return m @ m.transpose(1, 2)


def sh_colors(sh, degree, directions):
    x, y, z = directions.unbind(1)
    one = torch.ones_like(x)
    basis = [0.28209479177387814 * one]
    if degree > 0:
        basis += [-SH1 * y, SH1 * z, -SH1 * x]
    if degree > 1:
        basis += [
            SH2[0] * x * y,
            SH2[1] * y * z,
            SH2[2] * (2 * z * z - x * x - y * y),
            SH2[3] * x * z,
            SH2[4] * (x * x - y * y),
        ]
    if degree > 2:
        basis += [
            SH3[0] * y * (3 * x * x - y * y),
            SH3[1] * x * y * z,
            SH3[2] * y * (4 * z * z - x * x - y * y),
            SH3[3] * z * (2 * z * z - 3 * x * x - 3 * y * y),
            SH3[4] * x * (4 * z * z - x * x - y * y),
            SH3[5] * z * (x * x - y * y),
            SH3[6] * x * (x * x - 3 * y * y),
        ]
    basis = torch.stack(basis, dim=1)
    return (0.5 + (basis[:, :, None] * sh[:, : basis.shape[1]]).sum(1)).clamp(min=0)


def render(
    camera,
    means,
    opacities,
    *,
    scales=None,
    rotations=None,
    covariances=None,
    sh=None,
    sh_degree=0,
    colors=None,
    features=None,
    background=(0, 0, 0),
    low_pass=0.3,
    compensate_opacity=False,
    near_plane=0.2,
    shift=None,
    observed_above=None,
):
    """color, features, inverse depth, alpha and per-pixel counts [N,H,W]; all inputs float64.

    shift [N,2]: pixels added to the projected means, for gradients with respect to these.
    observed_above: only pixels in which the transmittance before a Gaussian is above it are counted.
    """
    world = torch.tensor(camera.camera_from_world, dtype=torch.float64).view(4, 4)
    rotation, translation = world[:3, :3], world[:3, 3]
    view = means @ rotation.T + translation
    x, y, z = view.unbind(1)
    limit_x, limit_y = 1.3 * 0.5 * camera.width / camera.fx, 1.3 * 0.5 * camera.height / camera.fy
    mean2 = torch.stack([camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy], dim=1)
    if shift is not None:
        mean2 = mean2 + shift
    middle_x, middle_y = (0.5 * camera.width - camera.cx) / camera.fx, (0.5 * camera.height - camera.cy) / camera.fy
    rx = (x / z).clamp(min(middle_x - limit_x, 0), max(middle_x + limit_x, 0))
    ry = (y / z).clamp(min(middle_y - limit_y, 0), max(middle_y + limit_y, 0))
    zero = torch.zeros_like(z)
    jacobian = torch.stack(
        [camera.fx / z, zero, -camera.fx * rx / z, zero, camera.fy / z, -camera.fy * ry / z], dim=1
    ).view(-1, 2, 3)
    if covariances is None:
        cov3 = covariances_of(scales, rotations)
    else:
        c = covariances
        cov3 = torch.stack(
            [c[:, 0], c[:, 1], c[:, 2], c[:, 1], c[:, 3], c[:, 4], c[:, 2], c[:, 4], c[:, 5]], dim=1
        ).view(-1, 3, 3)
    t = jacobian @ rotation
    bare = t @ cov3 @ t.transpose(1, 2)
    cov2 = bare + low_pass * torch.eye(2, dtype=torch.float64)
    opacity = opacities.reshape(-1)
    if compensate_opacity:
        opacity = opacity * (torch.linalg.det(bare) / torch.linalg.det(cov2)).clamp(min=2.5e-5).sqrt()
    conic = torch.linalg.inv(cov2)

    rows, columns = torch.meshgrid(torch.arange(camera.height), torch.arange(camera.width), indexing="ij")
    pixels = torch.stack([columns + 0.5, rows + 0.5], dim=-1).double()
    d = pixels[None] - mean2[:, None, None]
    power = -0.5 * torch.einsum("nhwi,nij,nhwj->nhw", d, conic, d)
    raw = opacity[:, None, None] * power.exp()
    alpha = torch.where(raw < 0.99, raw, torch.full_like(raw, 0.99))
    drawn = (alpha >= 1 / 255) & (z > near_plane)[:, None, None]
    alpha = torch.where(drawn, alpha, torch.zeros_like(alpha))

    order = torch.argsort(z.detach().float(), stable=True)
    a = alpha[order]
    after = torch.cumprod(1 - a, dim=0)
    blended = (after >= 1e-4) & (a > 0)
    blended = blended & (torch.cumprod((after >= 1e-4).double(), dim=0) > 0)
    a = torch.where(blended, a, torch.zeros_like(a))
    before = torch.cumprod(torch.cat([torch.ones_like(a[:1]), 1 - a]), dim=0)
    weights = a * before[:-1]
    final = before[-1]

    if colors is None:
        centre = -rotation.T @ translation
        direction = means - centre
        colors = sh_colors(sh, sh_degree, direction / direction.norm(dim=1, keepdim=True))
    shade = torch.as_tensor(background, dtype=torch.float64)
    image = torch.einsum("nhw,nc->chw", weights, colors[order]) + shade[:, None, None] * final
    extra = None if features is None else torch.einsum("nhw,nc->chw", weights, features[order])
    depth = torch.einsum("nhw,n->hw", weights, 1 / z[order])[None]
    counts = torch.zeros_like(blended)
    counts[order] = blended if observed_above is None else blended & (before[:-1] > observed_above)
    return image, extra, depth, (1 - final)[None], counts


def hull(points):
    """Corners of the convex hull of points [K,2], in order (Jarvis's march)."""
    xy = points.detach().tolist()
    start = min(range(len(xy)), key=lambda i: xy[i])
    corners, at = [], start
    while True:
        corners.append(at)
        to = (at + 1) % len(xy)
        for i in range(len(xy)):
            cross = (xy[to][0] - xy[at][0]) * (xy[i][1] - xy[at][1]) - (xy[to][1] - xy[at][1]) * (xy[i][0] - xy[at][0])
            to = i if cross < 0 else to
        at = to
        if at == start:
            return corners


def render_convexes(camera, points, smoothness, sharpness, opacities, sh=None, sh_degree=0, colors=None,
                    background=(0.0, 0.0, 0.0), released_view_direction=False):
    """Smooth convexes in double precision, without tiles. Returns the image, the points on screen [N,K,2] with retained
    gradient, where each convex is blended [N,H,W], and the pixels [H,W] in which no decision depends on rounding."""
    world = torch.tensor(camera.camera_from_world, dtype=torch.float64).view(4, 4)
    rotation, translation = world[:3, :3], world[:3, 3]
    view = points @ rotation.T + translation
    centres = points.mean(dim=1)
    depth = view[..., 2].mean(dim=1)
    screen = torch.stack([camera.fx * view[..., 0] / view[..., 2] + camera.cx,
                          camera.fy * view[..., 1] / view[..., 2] + camera.cy], dim=-1)
    if screen.requires_grad:
        screen.retain_grad()
    rows, columns = torch.meshgrid(torch.arange(camera.height), torch.arange(camera.width), indexing="ij")
    pixels = torch.stack([columns + 0.5, rows + 0.5], dim=-1).double()
    direction = centres + rotation.T @ translation
    if released_view_direction:  # as in the release, the z of a centre is used as its x and y too
        direction = centres[:, 2:] + rotation.T @ translation
    shades = colors if sh is None else sh_colors(sh, sh_degree, direction / direction.norm(dim=1, keepdim=True))

    shape = (camera.height, camera.width)
    image, after = torch.zeros(3, *shape, dtype=torch.float64), torch.ones(shape, dtype=torch.float64)
    is_open, certain = torch.ones(shape, dtype=torch.bool), torch.ones(shape, dtype=torch.bool)
    blended = torch.zeros((len(points),) + shape, dtype=torch.bool)
    for i in torch.argsort(depth.detach()).tolist():
        a = screen[i][hull(screen[i])]
        normals = torch.stack([a.roll(-1, 0)[:, 1] - a[:, 1], a[:, 0] - a.roll(-1, 0)[:, 0]], dim=1)
        lines = torch.einsum("ehwc,ec->ehw", pixels[None] - a[:, None, None], normals)
        phi = torch.logsumexp(depth[i] * smoothness[i] * lines, dim=0)
        raw = opacities[i] * torch.sigmoid(-depth[i] * sharpness[i] * phi)
        alpha = torch.where(raw < 0.99, raw, torch.full_like(raw, 0.99))
        next_after = after * (1 - alpha)
        here = (alpha >= 1 / 255) & is_open & (next_after >= 1e-4)
        blended[i] = here
        is_open = is_open & ~((alpha >= 1 / 255) & (next_after < 1e-4))
        certain &= ((alpha - 1 / 255).abs() > 1e-6) & ((next_after - 1e-4).abs() > 1e-7) & ((raw - 0.99).abs() > 1e-5)
        weight = torch.where(here, alpha * after, torch.zeros_like(alpha))
        image = image + weight * shades[i][:, None, None]
        after = torch.where(here, next_after, after)
    return image + after * torch.as_tensor(background, dtype=torch.float64)[:, None, None], screen, blended, certain


def ssim(a, b, padding="same"):
    """Mean SSIM of float64 [B,C,H,W]."""
    offsets = torch.arange(11, dtype=torch.float64) - 5
    window = torch.exp(-offsets * offsets / (2 * 1.5 * 1.5))
    window = window / window.sum()
    channels = a.shape[1]
    kernel = (window[:, None] * window[None])[None, None].expand(channels, 1, 11, 11)

    def blur(x):
        return torch.nn.functional.conv2d(x, kernel, padding=5 if padding == "same" else 0, groups=channels)

    ma, mb = blur(a), blur(b)
    va, vb, vab = blur(a * a) - ma * ma, blur(b * b) - mb * mb, blur(a * b) - ma * mb
    c1, c2 = 0.01**2, 0.03**2
    return ((2 * ma * mb + c1) * (2 * vab + c2) / ((ma * ma + mb * mb + c1) * (va + vb + c2))).mean()


def matrices_3dgs(camera, near=0.01, far=100.0):
    """viewmatrix, projmatrix, campos, tanfovx, tanfovy as 3DGS passes them: for points as row vectors."""
    world = torch.tensor(camera.camera_from_world, dtype=torch.float64).view(4, 4)
    projection = torch.zeros(4, 4, dtype=torch.float64)
    projection[0, 0] = 2 * camera.fx / camera.width
    projection[1, 1] = 2 * camera.fy / camera.height
    projection[0, 2] = 2 * camera.cx / camera.width - 1
    projection[1, 2] = 2 * camera.cy / camera.height - 1
    projection[2, 2] = far / (far - near)
    projection[2, 3] = -far * near / (far - near)
    projection[3, 2] = 1
    centre = -world[:3, :3].T @ world[:3, 3]
    return (
        world.T.float().contiguous(),
        (projection @ world).T.float().contiguous(),
        centre.float(),
        0.5 * camera.width / camera.fx,
        0.5 * camera.height / camera.fy,
    )


def turned_camera(width=30, height=22, cx=None, cy=None):
    """A camera at distance 4 that looks at the origin, rotated about y and x."""
    a, b = 0.3, -0.2
    ry = torch.tensor([[math.cos(a), 0, math.sin(a)], [0, 1, 0], [-math.sin(a), 0, math.cos(a)]], dtype=torch.float64)
    rx = torch.tensor([[1, 0, 0], [0, math.cos(b), -math.sin(b)], [0, math.sin(b), math.cos(b)]], dtype=torch.float64)
    world = torch.eye(4, dtype=torch.float64)
    world[:3, :3] = rx @ ry
    world[:3, 3] = torch.tensor([0.1, -0.05, 4.0])
    from splatboost import Camera

    return Camera(
        width,
        height,
        28.0,
        26.0,
        0.5 * width if cx is None else cx,
        0.5 * height if cy is None else cy,
        tuple(world.flatten().tolist()),
    )
