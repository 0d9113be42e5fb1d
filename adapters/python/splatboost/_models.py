# SPDX-License-Identifier: Apache-2.0
"""Reads trained models for the viewer: the newest .ply of a folder, its Gaussians, and the cameras next to it."""

from __future__ import annotations

import json
import os
import re
from dataclasses import dataclass
from typing import Any, Dict, Iterable, List, Optional, Tuple

import numpy as np


class ModelError(ValueError):
    """A model cannot be shown. The message is one line: file, cause and remedy."""


class UnfinishedError(ModelError):
    """A file ends early: it may still be being written."""


@dataclass
class Gaussians:
    """means [N,3] and covariances [N,3,3] in world units; opacities [N] in [0, 1]; sh [N,(degree+1)²,3]."""

    means: np.ndarray
    covariances: np.ndarray
    opacities: np.ndarray
    sh: np.ndarray

    def colors(self, eye: np.ndarray) -> np.ndarray:
        """[N,3] colors in [0, 1], as seen from the point `eye` [3] in world coordinates."""
        directions = self.means - np.asarray(eye, np.float32)
        directions /= np.maximum(np.linalg.norm(directions, axis=1, keepdims=True), 1e-12)
        basis = sh_basis(directions, int(round(self.sh.shape[1] ** 0.5)) - 1)
        return np.clip(np.einsum("nb,nbc->nc", basis, self.sh) + 0.5, 0, 1)


@dataclass
class ViewCamera:
    """A camera of cameras.json. rotation [3,3]: world from camera; camera axes: x right, y down, z forward."""

    name: str
    split: str
    width: int
    height: int
    fy: float
    position: np.ndarray
    rotation: np.ndarray


def sh_basis(directions: np.ndarray, degree: int) -> np.ndarray:
    """[N,(degree+1)²] real spherical harmonics of unit directions, degree 0 to 3, in 3DGS's order and signs."""
    x, y, z = directions.T
    xx, yy, zz = x * x, y * y, z * z
    columns = [np.full_like(x, 0.28209479177387814)]
    if degree > 0:
        columns += [c * 0.4886025119029199 for c in (-y, z, -x)]
    if degree > 1:
        columns += [1.0925484305920792 * x * y, -1.0925484305920792 * y * z, 0.31539156525252005 * (2 * zz - xx - yy),
                    -1.0925484305920792 * x * z, 0.5462742152960396 * (xx - yy)]
    if degree > 2:
        columns += [-0.5900435899266435 * y * (3 * xx - yy), 2.890611442640554 * x * y * z,
                    -0.4570457994644658 * y * (4 * zz - xx - yy), 0.3731763325901154 * z * (2 * zz - 3 * xx - 3 * yy),
                    -0.4570457994644658 * x * (4 * zz - xx - yy), 1.445305721320277 * z * (xx - yy),
                    -0.5900435899266435 * x * (xx - 3 * yy)]
    return np.stack(columns, axis=1)


_TYPES = {"char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2", "uint16": "u2",
          "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4", "double": "f8",
          "float64": "f8"}


def _vertices(path: str) -> Dict[str, np.ndarray]:
    """The vertex properties of a .ply file by name; the vertices must be its first element."""
    try:
        with open(path, "rb") as file:
            data = file.read()
    except OSError as e:
        raise ModelError("%s: %s" % (path, e.strerror)) from e
    end = data.find(b"end_header")
    end = data.find(b"\n", end) + 1 if end >= 0 else 0
    lines = [line.split() for line in data[:end].decode("latin-1").splitlines()]
    if end == 0 and b"ply".startswith(data[:3]):
        raise UnfinishedError("%s: ends within its header; is it still being written?" % path)
    if end == 0 or lines[0] != ["ply"]:
        raise ModelError("%s: not a .ply file" % path)
    elements = [line for line in lines if line[:1] == ["element"]]
    if not elements or not re.fullmatch("element vertex [0-9]{1,18}", " ".join(elements[0])):
        raise ModelError("%s: its first element is not vertex with a count" % path)
    count = int(elements[0][2])
    fields: List[Tuple[str, str]] = []
    inside = False
    for line in lines:
        if line[:1] == ["element"]:
            inside = line is elements[0]
        elif inside and line[:1] == ["property"]:
            if len(line) != 3 or line[1] not in _TYPES:
                raise ModelError("%s: property %s cannot be read" % (path, " ".join(line[1:])))
            if any(line[2] == name for name, _ in fields):
                raise ModelError("%s: property %s occurs twice" % (path, line[2]))
            fields.append((line[2], _TYPES[line[1]]))
    form = next((line[1] for line in lines if line[:1] == ["format"] and len(line) > 1), "")
    short = UnfinishedError("%s: ends before all of its %d vertices; is it still being written?" % (path, count))
    if form == "ascii":
        words = data[end:].split()
        if len(words) < count * len(fields):
            raise short
        try:
            table = np.array(words[: count * len(fields)], np.float64).reshape(count, len(fields))
        except ValueError as e:
            raise ModelError("%s: %s" % (path, e)) from e
        return {name: table[:, i].astype(np.float32) for i, (name, _) in enumerate(fields)}
    if form not in ("binary_little_endian", "binary_big_endian"):
        raise ModelError("%s: unknown format %s" % (path, form or "(none)"))
    order = "<" if form == "binary_little_endian" else ">"
    row = np.dtype([(name, order + kind) for name, kind in fields])
    if len(data) - end < count * row.itemsize:
        raise short
    rows: Any = np.frombuffer(data, row, count, end) if fields else {}
    return {name: rows[name].astype(np.float32) for name, _ in fields}


_SCALES, _ROTATION = ["scale_0", "scale_1", "scale_2"], ["rot_0", "rot_1", "rot_2", "rot_3"]
_DC = ["f_dc_0", "f_dc_1", "f_dc_2"]


def read_gaussians(path: str) -> Gaussians:
    """Reads the Gaussians of a .ply file written by 3DGS and its successors. Raises ModelError."""
    found = _vertices(path)

    def stacked(names: Iterable[str]) -> np.ndarray:
        return np.stack([found[n] for n in names], axis=1)

    if "f_anchor_feat_0" in found:
        raise ModelError("%s: is a model of anchors, whose Gaussians its networks compute; render it with: splatboost render "
                         "-m MODEL --video orbit.mp4 --orbit 120" % path)
    if "point_0_x" in found:
        raise ModelError("%s: is a model of convexes; export triangles for a mesh viewer with: splatboost export -m MODEL "
                         "-o convexes.glb" % path)
    absent = [n for n in ["x", "y", "z", "opacity", *_SCALES[:2], *_ROTATION, *_DC] if n not in found]
    if absent:
        raise ModelError("%s: not a model of Gaussians: it lacks %s" % (path, ", ".join(absent)))
    means = stacked("xyz")
    count = len(means)
    higher = sorted((n for n in found if re.fullmatch("f_rest_[0-9]{1,3}", n)), key=lambda n: int(n[len("f_rest_"):]))
    rest = stacked(higher) if higher else np.zeros((count, 0), np.float32)
    bands = 1 + rest.shape[1] // 3
    if rest.shape[1] % 3 or bands not in (1, 4, 9, 16):
        raise ModelError("%s: %d properties f_rest_*, expected 0, 9, 24 or 45" % (path, rest.shape[1]))
    sh = np.concatenate([stacked(_DC)[:, None], rest.reshape(count, 3, bands - 1).transpose(0, 2, 1)], axis=1)
    opacities = 1 / (1 + np.exp(-np.clip(found["opacity"], -80, 80)))
    scales = stacked(n for n in _SCALES if n in found)
    squares = np.exp(2 * np.clip(scales, -40, 40))
    if scales.shape[1] == 2:  # surfels
        squares = np.concatenate([squares, np.zeros((count, 1), np.float32)], axis=1)
    if "filter_3D" in found:  # Mip-Splatting: the filter widens a Gaussian and reduces its opacity to compensate
        widened = squares + found["filter_3D"][:, None] ** 2
        opacities = opacities * np.sqrt(np.prod(squares / np.maximum(widened, 1e-30), axis=1))
        squares = widened
    axes = _rotations(stacked(_ROTATION)) * np.sqrt(squares)[:, None, :]
    whole = np.isfinite(means).all(1) & np.isfinite(axes).all((1, 2)) & np.isfinite(opacities) & np.isfinite(sh).all((1, 2))
    if not whole.any():
        raise ModelError("%s: has no Gaussian with finite values" % path)
    axes = axes[whole]
    return Gaussians(means[whole], axes @ axes.transpose(0, 2, 1), opacities[whole], sh[whole])


def _rotations(quaternions: np.ndarray) -> np.ndarray:
    """[N,3,3] rotation matrices of quaternions [N,4] (w x y z) of any length."""
    w, x, y, z = (quaternions / np.maximum(np.linalg.norm(quaternions, axis=1, keepdims=True), 1e-12)).T
    return np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
                     2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
                     2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], axis=1).reshape(-1, 3, 3)


def newest_model(model: str) -> Optional[str]:
    """The .ply to show: `model` itself, or that of the last iteration in a model folder; None if none was saved yet."""
    if os.path.isfile(model):
        return model
    saved = os.path.join(model, "point_cloud")
    found = [(int(name[10:]), os.path.join(saved, name, "point_cloud.ply"))
             for name in (os.listdir(saved) if os.path.isdir(saved) else [])
             if re.fullmatch(r"iteration_\d+", name)]
    found = [entry for entry in found if os.path.isfile(entry[1])]
    return max(found)[1] if found else None


def folder_of(model: str) -> str:
    """The model folder of a path that the user gave: a model folder or a .ply file in it."""
    if not os.path.isfile(model):
        return model
    folder = os.path.dirname(os.path.abspath(model))
    while os.path.basename(folder).startswith("iteration_") or os.path.basename(folder) == "point_cloud":
        folder = os.path.dirname(folder)
    return folder


def read_cameras(folder: str) -> List[ViewCamera]:
    """Cameras of the run, from cameras.json; empty if there is no such file."""
    path = os.path.join(folder, "cameras.json")
    try:
        with open(path, encoding="utf-8") as file:
            listed = json.load(file)
        return [ViewCamera(str(c["img_name"]), str(c.get("split", "")), int(c["width"]), int(c["height"]), float(c["fy"]),
                           np.array(c["position"], float).reshape(3), np.array(c["rotation"], float).reshape(3, 3))
                for c in listed]
    except FileNotFoundError:
        return []
    except (OSError, ValueError, KeyError, TypeError) as e:
        raise ModelError("%s: cannot be read: %s" % (path, e)) from e


def has_white_background(folder: str) -> bool:
    """Whether a model was trained on a white background, from SplatBoost's config.json or a host's cfg_args."""
    try:
        with open(os.path.join(folder, "config.json"), encoding="utf-8") as file:
            config: Any = json.load(file)
        return bool(config["trained"]["background"] == "white")
    except (OSError, ValueError, KeyError, TypeError):
        pass
    try:
        with open(os.path.join(folder, "cfg_args"), encoding="utf-8") as file:
            return "white_background=True" in file.read()
    except (OSError, ValueError):
        return False
