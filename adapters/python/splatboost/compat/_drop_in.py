# SPDX-License-Identifier: Apache-2.0
"""Shared by the drop-ins of all layouts: converts the arguments of 3DGS and renders."""

from __future__ import annotations

from contextlib import contextmanager
from typing import Any, Callable, Dict, Iterator, Optional

import torch
from torch import nn

from .. import _library as lib
from .._rasterize import mark_visible, rasterize
from .._render import Render
from .._tensors import check
from ..camera import Camera

_beta: Optional[float] = None
_last: Optional[Render] = None


def set_beta(beta: Optional[float]) -> None:
    """Sets β in (0, 1] of the compact box of all drop-ins; None: 3DGS's 3σ square."""
    global _beta
    number = None if beta is None else lib.number(beta, "beta")
    if number is not None and not 0.0 < number <= 1.0:
        raise ValueError("beta: expected a number in (0, 1] or None, got %r" % (beta,))
    _beta = number


def get_beta() -> Optional[float]:
    """β of the compact box of the drop-ins; None: 3DGS's 3σ square."""
    return _beta


def last_render() -> Render:
    """The last render of a drop-in, for count_flagged(); its images are detached."""
    if _last is None:
        raise RuntimeError("last_render: no drop-in has drawn yet")
    return _last


def forget() -> None:
    """Releases the workspace of the last render for the next one."""
    global _last
    _last = None


def remember(done: Render) -> None:
    global _last
    _last = Render(done.color.detach(), done.radii, None, None, None, done._lease)


def camera_of(settings: Any) -> Camera:
    s = settings
    return Camera.from_3dgs(
        lib.whole(s.image_height, "image_height", 1),
        lib.whole(s.image_width, "image_width", 1),
        s.tanfovx,
        s.tanfovy,
        s.viewmatrix,
        s.projmatrix,
        s.campos,
    )


#: Names of the arguments of rasterize() and rasterize_convexes() in 3DGS's layouts.
_NAMES = {"means": "means3D", "screen_points": "means2D", "covariances": "cov3D_precomp", "sh": "shs", "sh_dc": "dc",
          "sh_rest": "shs", "colors": "colors_precomp", "background": "bg", "points": "convex_points",
          "smoothness": "delta", "sharpness": "sigma"}


@contextmanager
def host_names() -> Iterator[None]:
    """Names arguments in errors as hosts do."""
    try:
        yield
    except ValueError as e:
        name, colon, rest = str(e).partition(": ")
        if not colon or name not in _NAMES:
            raise
        raise ValueError(_NAMES[name] + colon + rest) from e


def check_rows(means3D: torch.Tensor, **tensors: Any) -> None:
    """Raises ValueError unless means3D is float32 [N,3] and each tensor, if given, float32 with N rows of that width;
    for layouts that compute with them before they render. tensors: name=(tensor, width)"""
    check(means3D, "means3D", torch.float32, ("N", 3))
    for name, (tensor, *widths) in tensors.items():
        check(tensor, name, torch.float32, *[(means3D.shape[0], width) for width in widths])


def given(tensor: Optional[torch.Tensor]) -> Optional[torch.Tensor]:
    """Maps an empty vector to None: hosts pass either for omitted arguments. Tensors of no Gaussians are kept."""
    empty = isinstance(tensor, torch.Tensor) and tensor.numel() == 0 and tensor.dim() < 2
    return None if tensor is None or empty else tensor


def scaled(settings: Any, scales: Optional[torch.Tensor]) -> Optional[torch.Tensor]:
    """The scales times scale_modifier; None for None."""
    modifier = lib.number(settings.scale_modifier, "scale_modifier")
    return scales * modifier if isinstance(scales, torch.Tensor) and modifier != 1.0 else scales


def render(
    settings: Any,
    means3D: torch.Tensor,
    means2D: Optional[torch.Tensor],
    opacities: torch.Tensor,
    *,
    dc: Optional[torch.Tensor] = None,
    shs: Optional[torch.Tensor] = None,
    colors_precomp: Optional[torch.Tensor] = None,
    scales: Optional[torch.Tensor] = None,
    rotations: Optional[torch.Tensor] = None,
    cov3D_precomp: Optional[torch.Tensor] = None,
    **options: Any,
) -> Render:
    """Renders with `settings` and stores the render for last_render(). dc: degree 0; shs then holds the higher ones."""
    if (shs is None and dc is None) == (colors_precomp is None):
        raise ValueError("give either shs or colors_precomp")
    if (scales is None or rotations is None) == (cov3D_precomp is None):
        raise ValueError("give either scales and rotations, or cov3D_precomp")
    dc, shs, colors_precomp = given(dc), given(shs), given(colors_precomp)
    scales, rotations, cov3D_precomp = given(scales), given(rotations), given(cov3D_precomp)
    forget()
    with host_names():
        done = rasterize(
            camera_of(settings),
            means3D,
            opacities,
            scales=scaled(settings, scales),
            rotations=rotations,
            covariances=cov3D_precomp,
            sh=shs if dc is None else None,
            sh_dc=dc,
            sh_rest=shs if dc is not None else None,
            sh_degree=settings.sh_degree,
            colors=colors_precomp,
            background=settings.bg,
            beta=_beta,
            screen_points=means2D,
            **options,
        )
    remember(done)
    return done


def visible(settings: Any, positions: torch.Tensor) -> torch.Tensor:
    check(positions, "positions", torch.float32, ("N", 3))
    with torch.no_grad():
        return mark_visible(camera_of(settings), positions)


def without_nan(maps: torch.Tensor) -> torch.Tensor:
    """The maps, with NaN gradients replaced by 0: hosts divide by alpha even where it is 0."""
    if maps.requires_grad:
        maps.register_hook(lambda gradient: torch.nan_to_num(gradient, 0.0, 0.0, 0.0))
    return maps


#: Fields of 3DGS's settings of a view; matrices are for row vectors. prefiltered and debug have no effect here.
SIZE = ("image_height", "image_width", "tanfovx", "tanfovy")
VIEW = ("bg", "scale_modifier", "viewmatrix", "projmatrix", "sh_degree", "campos", "prefiltered", "debug")


class Drawer(nn.Module):
    """Base class of the layouts' GaussianRasterizers, which override options() and results()."""

    def __init__(self, raster_settings: Any):
        super().__init__()
        self.raster_settings = raster_settings

    def options(self) -> Dict[str, Any]:
        """Arguments of rasterize() for this layout's settings. Raises ValueError if they are not supported."""
        return {}

    def results(self, done: Render) -> Any:
        return done.color, done.radii

    def draw(self, means3D: torch.Tensor, means2D: torch.Tensor, opacities: torch.Tensor, **tensors: Any) -> Any:
        return self.results(render(self.raster_settings, means3D, means2D, opacities, **self.options(), **tensors))

    def markVisible(self, positions: torch.Tensor) -> torch.Tensor:
        """bool [N]: which positions [N,3] lie beyond the near plane."""
        return visible(self.raster_settings, positions)

    def forward(
        self,
        means3D: torch.Tensor,
        means2D: torch.Tensor,
        opacities: torch.Tensor,
        shs: Optional[torch.Tensor] = None,
        colors_precomp: Optional[torch.Tensor] = None,
        scales: Optional[torch.Tensor] = None,
        rotations: Optional[torch.Tensor] = None,
        cov3D_precomp: Optional[torch.Tensor] = None,
    ) -> Any:
        """means3D [N,3], means2D [N,3] or [N,4], opacities [N,1], shs [N,K,3] or colors_precomp [N,3], scales [N,3] and
        rotations [N,4] or cov3D_precomp [N,6]. The layout's module documents the result."""
        return self.draw(means3D, means2D, opacities, shs=shs, colors_precomp=colors_precomp, scales=scales,
                         rotations=rotations, cov3D_precomp=cov3D_precomp)


def as_function(rasterizer: Callable[[Any], Drawer]) -> Callable[..., Any]:
    """The layout's rasterize_gaussians, with positional arguments; omitted ones are None or an empty tensor."""

    def rasterize_gaussians(
        means3D: torch.Tensor,
        means2D: torch.Tensor,
        sh: torch.Tensor,
        colors_precomp: torch.Tensor,
        opacities: torch.Tensor,
        scales: torch.Tensor,
        rotations: torch.Tensor,
        cov3Ds_precomp: torch.Tensor,
        raster_settings: Any,
    ) -> Any:
        return rasterizer(raster_settings)(means3D, means2D, opacities, given(sh), given(colors_precomp), given(scales),
                                           given(rotations), given(cov3Ds_precomp))

    return rasterize_gaussians
