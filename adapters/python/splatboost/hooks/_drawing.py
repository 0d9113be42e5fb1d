# SPDX-License-Identifier: Apache-2.0
"""The compact box in a host's own render function, and the file that stores beta with the host's model."""

from __future__ import annotations

import contextlib
import json
import math
import os
import sys
from typing import Any, Callable, Iterator, Optional

import torch

from .._library import shown
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

#: Next to the host's cfg_args: stores how the model was trained, for rendering it later.
MODEL_FILE = "splatboost.json"


@contextlib.contextmanager
def box_of(beta: Optional[float]) -> Iterator[None]:
    """Within this context, drop-ins render with this beta."""
    before = get_beta()
    set_beta(beta)
    try:
        yield
    finally:
        set_beta(before)


class Drawing:
    """How a model is rendered: with which box, and whether with absolute gradients.

    beta: None renders as published. With `absolute`, `screen_points.grad` [N,4] holds the absolute gradients in columns
    2 and 3 after a backward pass of a view.
    """

    def __init__(self, beta: Optional[float], absolute: bool = False):
        self.beta = beta
        self.absolute = absolute
        self.screen_points: Optional[torch.Tensor] = None
        self.gate: Optional[torch.Tensor] = None  # bool [N·k], for hosts with anchors: slots that may grow now

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
        if self.absolute and means2D.requires_grad and torch.is_grad_enabled():
            # Appends a column to the host's three, so that its own statistics read the same values as before.
            means2D = self.screen_points = torch.nn.functional.pad(means2D, (0, 1))
            means2D.retain_grad()
        ours = module.GaussianRasterizer(module.GaussianRasterizationSettings(**settings._asdict()))
        with box_of(self.beta):
            return ours(means2D=means2D, **given)


def see(model: Any, host: Any, **given: Any) -> torch.Tensor:
    """Radii of the host's anchors that are visible in a view: from its own visible_filter, or ours with boost."""
    if getattr(model, "splatboost", None) is None:
        return host.visible_filter(**given)  # type: ignore[no-any-return]
    settings = diff_gaussian_rasterization_anchors.GaussianRasterizationSettings(**host.raster_settings._asdict())
    return diff_gaussian_rasterization_anchors.GaussianRasterizer(settings).visible_filter(**given)


def rasterizer(model: Any, host: Any, depth: bool = False, weights: bool = False,
               plain_depth: bool = False) -> Callable[..., Any]:
    """The host's own rasterizer, or ours for a model that is trained or was saved with boost.

    depth: whether the host's returns inverse depth as a third result. weights: whether it returns a weight per
    Gaussian. plain_depth: whether the third result is depth, not inverse depth.
    """
    drawing = getattr(model, "splatboost", None)
    if drawing is None:
        return host  # type: ignore[no-any-return]
    settings = host.raster_settings

    def draw(means2D: torch.Tensor, **given: Any) -> Any:
        return drawing(settings, depth, weights, plain_depth, means2D, given)

    return draw


def pinhole(camera: Any, image: torch.Tensor) -> Camera:
    """Converts a host's camera, for its image [3,H,W]."""
    height, width = image.shape[1:]
    tangents = [math.tan(0.5 * float(angle)) for angle in (camera.FoVx, camera.FoVy)]
    return Camera.from_3dgs(height, width, tangents[0], tangents[1], camera.world_view_transform,
                            camera.full_proj_transform, camera.camera_center)


def load(backbone: str, model: Any, model_path: str) -> None:
    """Sets up a saved model of a backbone to be rendered as it was trained; by the host if its folder has no MODEL_FILE.
    Exits the host if the file is damaged, or if the model is another backbone's, which this host does not render as trained."""
    path = os.path.join(model_path, MODEL_FILE)
    if not os.path.exists(path):
        return
    try:
        beta = _stored_beta(path, backbone)
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        sys.stderr.write("%s: %s; delete it to render with the host's own box\n" % (path, reason))
        sys.exit(2)
    model.splatboost = Drawing(beta)


def _stored_beta(path: str, backbone: str) -> Optional[float]:
    """The beta in a MODEL_FILE. Raises ValueError if the file is damaged or of another backbone."""
    with open(path, encoding="utf-8") as file:
        try:
            stored = json.load(file)
        except ValueError as error:
            raise ValueError("not JSON (%s)" % error) from None
    if not isinstance(stored, dict) or not {"backbone", "beta"} <= stored.keys():
        raise ValueError("expected an object with backbone and beta, got %s" % shown(stored))
    if stored["backbone"] != backbone:
        raise ValueError("the model was trained as %s, and this host renders %s" % (shown(stored["backbone"]), shown(backbone)))
    beta = stored["beta"]
    if beta is not None and (type(beta) not in (int, float) or not 0 < beta <= 1):
        raise ValueError("beta: expected a number in (0, 1] or null, got %s" % shown(beta))
    return beta


def save(model_path: str, backbone: str, beta: Optional[float]) -> None:
    """Writes MODEL_FILE, so that load() renders the models of this folder with beta."""
    path = os.path.join(model_path, MODEL_FILE)
    with open(path + ".new", "w", encoding="utf-8") as file:
        json.dump({"backbone": backbone, "beta": beta}, file)
        file.write("\n")
    os.replace(path + ".new", path)


def forget(model_path: str) -> None:
    """Removes MODEL_FILE, so that the host renders the folder's models itself."""
    path = os.path.join(model_path, MODEL_FILE)
    if os.path.exists(path):
        os.remove(path)
