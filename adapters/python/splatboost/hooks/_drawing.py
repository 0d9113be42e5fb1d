# SPDX-License-Identifier: Apache-2.0
"""The compact box in a host's own render function, and beta beside the host's model."""

from __future__ import annotations

import contextlib
import json
import math
import os
from typing import Any, Callable, Iterator, Optional

import torch

from ..camera import Camera
from ..compat import (
    diff_gaussian_rasterization_2023,
    diff_gaussian_rasterization_2024,
    diff_gaussian_rasterization_absgs,
    diff_gaussian_rasterization_accelerated,
    diff_gaussian_rasterization_anchors,
    diff_gaussian_rasterization_deformable,
    diff_gaussian_rasterization_mip_splatting,
    diff_plane_rasterization,
    get_beta,
    set_beta,
)

#: Beside the host's cfg_args: how the model was trained, for whoever draws it.
MODEL_FILE = "splatboost.json"


@contextlib.contextmanager
def box_of(beta: Optional[float]) -> Iterator[None]:
    """Drop-ins draw with this beta within."""
    before = get_beta()
    set_beta(beta)
    try:
        yield
    finally:
        set_beta(before)


class Drawing:
    """How a model is drawn: with which box, and whether absolute gradients are wanted.

    beta: None draws as published. After a backward pass of a view, `screen_points.grad` [N,4] holds the absolute
    gradients in columns 2 and 3, where they are wanted.
    """

    def __init__(self, beta: Optional[float], absolute: bool = False):
        self.beta = beta
        self.absolute = absolute
        self.screen_points: Optional[torch.Tensor] = None
        self.gate: Optional[torch.Tensor] = None  # bool [N·k], of hosts with anchors: slots that may grow now

    def __call__(self, settings: Any, depth: bool, weights: bool, plain_depth: bool, means2D: torch.Tensor,
                 given: Any) -> Any:
        module: Any = diff_gaussian_rasterization_absgs if weights else diff_gaussian_rasterization_2023
        if hasattr(settings, "kernel_size"):
            module = diff_gaussian_rasterization_mip_splatting
        elif hasattr(settings, "render_geo"):
            module = diff_plane_rasterization
        elif "dc" in given:
            module = diff_gaussian_rasterization_accelerated
        elif depth:
            module = diff_gaussian_rasterization_2024
        elif plain_depth:
            module = diff_gaussian_rasterization_deformable
        if self.absolute and means2D.requires_grad:
            # The host's three columns lead, so that its own statistics read what they always did.
            means2D = self.screen_points = torch.nn.functional.pad(means2D, (0, 1))
            means2D.retain_grad()
        ours = module.GaussianRasterizer(module.GaussianRasterizationSettings(**settings._asdict()))
        with box_of(self.beta):
            return ours(means2D=means2D, **given)


def see(model: Any, host: Any, **given: Any) -> torch.Tensor:
    """Radii of what a view can see of a host's anchors: by its own visible_filter, or ours with boost."""
    if getattr(model, "splatboost", None) is None:
        return host.visible_filter(**given)  # type: ignore[no-any-return]
    settings = diff_gaussian_rasterization_anchors.GaussianRasterizationSettings(**host.raster_settings._asdict())
    return diff_gaussian_rasterization_anchors.GaussianRasterizer(settings).visible_filter(**given)


def rasterizer(model: Any, host: Any, depth: bool = False, weights: bool = False,
               plain_depth: bool = False) -> Callable[..., Any]:
    """The host's own rasterizer, or ours for a model that is trained or was saved with boost.

    depth: whether the host's returns inverse depth as a third image. weights: whether it returns a weight a Gaussian.
    plain_depth: whether the third image is a depth that is not inverse.
    """
    drawing = getattr(model, "splatboost", None)
    if drawing is None:
        return host  # type: ignore[no-any-return]
    settings = host.raster_settings

    def draw(means2D: torch.Tensor, **given: Any) -> Any:
        return drawing(settings, depth, weights, plain_depth, means2D, given)

    return draw


def pinhole(camera: Any, image: torch.Tensor) -> Camera:
    """A host's camera of an image [3,H,W]."""
    height, width = image.shape[1:]
    tangents = [math.tan(0.5 * float(angle)) for angle in (camera.FoVx, camera.FoVy)]
    return Camera.from_3dgs(height, width, tangents[0], tangents[1], camera.world_view_transform,
                            camera.full_proj_transform, camera.camera_center)


def load(model: Any, model_path: str) -> None:
    """Draws a saved model as it was trained. Without MODEL_FILE in its folder it is the host's own."""
    path = os.path.join(model_path, MODEL_FILE)
    if not os.path.exists(path):
        return
    with open(path, encoding="utf-8") as file:
        beta = json.load(file)["beta"]
    model.splatboost = Drawing(beta)


def save(model_path: str, backbone: str, beta: Optional[float]) -> None:
    """Lets load() draw the models of this folder with beta."""
    path = os.path.join(model_path, MODEL_FILE)
    with open(path + ".new", "w", encoding="utf-8") as file:
        json.dump({"backbone": backbone, "beta": beta}, file)
        file.write("\n")
    os.replace(path + ".new", path)


def forget(model_path: str) -> None:
    """The folder's models are the host's own again."""
    path = os.path.join(model_path, MODEL_FILE)
    if os.path.exists(path):
        os.remove(path)
