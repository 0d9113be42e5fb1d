# SPDX-License-Identifier: Apache-2.0
"""A pinhole camera, and its conversion from the matrices of 3DGS. Does not need torch."""

from __future__ import annotations

import math
import weakref
from dataclasses import dataclass
from typing import Any, Dict, List, Sequence, Tuple

from . import _library as lib

Rows = List[List[float]]


@dataclass(frozen=True)
class Camera:
    """Pinhole in COLMAP's frame: x right, y down, z forward; pixel (i, j) has its centre at (i + 0.5, j + 0.5).

    fx, fy, cx, cy in pixels. camera_from_world: rigid 4×4 matrix, row-major, for column vectors.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    camera_from_world: Tuple[float, ...]

    @staticmethod
    def from_matrices(width: int, height: int, intrinsics: Any, camera_from_world: Any) -> "Camera":
        """From a 3×3 matrix of intrinsics and a 4×4 (or 3×4) pose: tensors, arrays or nested lists."""
        k, pose = host_rows(intrinsics, "intrinsics"), host_rows(camera_from_world, "camera_from_world")
        if len(k) != 3 or any(len(r) != 3 for r in k):
            raise ValueError("intrinsics: expected shape [3,3], got %s" % _shape_of(k))
        if len(pose) not in (3, 4) or any(len(r) != 4 for r in pose):
            raise ValueError("camera_from_world: expected shape [4,4], got %s" % _shape_of(pose))
        for name, row in [("intrinsics", k[2])] + [("camera_from_world", r) for r in pose[3:]]:
            _check_last_row(row, name)
        _check_rotation([r[:3] for r in pose[:3]], "camera_from_world")
        flat = [v for r in pose[:3] for v in r] + [0.0, 0.0, 0.0, 1.0]
        width, height = lib.whole(width, "width", 1), lib.whole(height, "height", 1)
        return Camera(width, height, k[0][0], k[1][1], k[0][2], k[1][2], tuple(flat))

    @staticmethod
    def from_3dgs(
        height: int, width: int, tanfovx: float, tanfovy: float, viewmatrix: Any, projmatrix: Any, campos: Any = None
    ) -> "Camera":
        """From the arguments of 3DGS's rasterizer.

        viewmatrix, projmatrix: 4×4 for row vectors (world → camera, world → clip). projmatrix contains the principal
        point. campos must be the camera centre of viewmatrix, the origin of view directions for spherical harmonics.
        """
        view, full = host_rows(viewmatrix, "viewmatrix"), host_rows(projmatrix, "projmatrix")
        for name, m in (("viewmatrix", view), ("projmatrix", full)):
            if len(m) != 4 or any(len(r) != 4 for r in m):
                raise ValueError("%s: expected shape [4,4], got %s" % (name, _shape_of(m)))
        rotation = [[view[j][i] for j in range(3)] for i in range(3)]
        translation = [view[3][i] for i in range(3)]
        _check_rotation(rotation, "viewmatrix")
        # Rows x, y and w of clip_from_camera = clip_from_world · world_from_camera, without translation.
        clip = [[sum(full[k][i] * rotation[c][k] for k in range(3)) for c in range(3)] for i in (0, 1, 3)]
        width, height = lib.whole(width, "width", 1), lib.whole(height, "height", 1)
        tangents = [lib.number(value, name) for value, name in ((tanfovx, "tanfovx"), (tanfovy, "tanfovy"))]
        for name, tangent in zip(("tanfovx", "tanfovy"), tangents):
            if not tangent > 0:
                raise ValueError("%s: expected a number above 0, got %r" % (name, tangent))
        focal_x, focal_y = [1.0 / tangent for tangent in tangents]
        fits = (
            abs(clip[0][0] - focal_x) <= 1e-3 * abs(focal_x)
            and abs(clip[1][1] - focal_y) <= 1e-3 * abs(focal_y)
            and abs(clip[0][1]) < 1e-3
            and abs(clip[1][0]) < 1e-3
            and abs(clip[2][0]) < 1e-3
            and abs(clip[2][1]) < 1e-3
            and abs(clip[2][2] - 1.0) < 1e-3
        )
        if not fits:
            raise ValueError("projmatrix: expected a pinhole projection that matches viewmatrix, tanfovx and tanfovy")
        if campos is not None:
            centre = [-sum(rotation[k][i] * translation[k] for k in range(3)) for i in range(3)]
            given = host_rows(campos, "campos")[0]
            size = 1.0 + max(abs(c) for c in centre)
            if len(given) != 3 or any(not abs(a - b) < 1e-3 * size for a, b in zip(given, centre)):
                raise ValueError("campos: expected the centre of viewmatrix, %s, got %s" % (centre, given))
        # Rounding of a centred matrix must not move the principal point.
        shift = [0.0 if abs(clip[i][2]) < 1e-6 else clip[i][2] for i in (0, 1)]
        flat = [v for i in range(3) for v in rotation[i] + [translation[i]]] + [0.0, 0.0, 0.0, 1.0]
        return Camera(
            width,
            height,
            0.5 * width * focal_x,
            0.5 * height * focal_y,
            0.5 * width * (1.0 + shift[0]),
            0.5 * height * (1.0 + shift[1]),
            tuple(flat),
        )

    def c_struct(self) -> lib.Camera:
        sizes = [lib.whole(getattr(self, name), name, 1) for name in ("width", "height")]
        numbers = [lib.number(getattr(self, name), name) for name in ("fx", "fy", "cx", "cy")]
        camera = lib.Camera(*sizes, *numbers)
        rows = host_rows(self.camera_from_world, "camera_from_world")
        if len(rows) != 1 or len(rows[0]) != 16:
            raise ValueError("camera_from_world: expected 16 numbers, got %s" % _shape_of(rows))
        pose = rows[0]
        _check_last_row(pose[12:], "camera_from_world")
        _check_rotation([pose[0:3], pose[4:7], pose[8:11]], "camera_from_world")
        camera.camera_from_world[:] = pose
        return camera


def check_camera(camera: Any) -> None:
    """Raises ValueError unless this is a Camera with valid values."""
    if not isinstance(camera, Camera):
        raise ValueError("camera: expected a Camera, got %s" % type(camera).__name__)
    camera.c_struct()


def _shape_of(rows: Rows) -> str:
    """The shape of a matrix, or the length of a vector."""
    if len(rows) == 1:
        return "%d numbers" % len(rows[0])
    widths = {len(row) for row in rows}
    return "[%d,%d]" % (len(rows), widths.pop()) if len(widths) == 1 else "rows of different lengths"


def _check_last_row(row: List[float], name: str) -> None:
    unit = [0.0] * (len(row) - 1) + [1.0]
    if any(not abs(v - u) < 1e-3 for v, u in zip(row, unit)):
        raise ValueError("%s: expected %s as the last row, got %s; is it transposed?" % (name, unit, row))


def _check_rotation(rows: Rows, name: str) -> None:
    """Raises ValueError unless these rows [3,3] are those of a rotation, up to rounding. name: of their matrix"""
    x, y, z = rows
    lengths, angles = (_dot(x, x), _dot(y, y), _dot(z, z)), (_dot(x, y), _dot(y, z), _dot(z, x))
    if any(not abs(v - 1.0) < 1e-3 for v in lengths) or any(not abs(v) < 1e-3 for v in angles):
        raise ValueError("%s: expected a rigid motion, got one that scales or shears" % name)
    if _dot(x, [y[1] * z[2] - y[2] * z[1], y[2] * z[0] - y[0] * z[2], y[0] * z[1] - y[1] * z[0]]) < 0:
        raise ValueError("%s: expected a rigid motion, got one that mirrors" % name)


def _dot(a: List[float], b: List[float]) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


# Host copies of small GPU tensors, so that a camera that is used again needs no synchronization:
# id → (weak reference to the tensor, version, rows).
_copies: Dict[int, Tuple[Any, int, Rows]] = {}


def host_rows(matrix: Any, name: str) -> Rows:
    """A small matrix (or a vector, as one row) as Python floats on the host. name: of the argument, for errors."""
    device = getattr(matrix, "device", None)
    if device is None or getattr(device, "type", "cpu") == "cpu":
        return _rows(matrix, name)
    if matrix.is_inference():  # torch does not count the changes of these
        return _rows(matrix, name)
    known = _copies.get(id(matrix))
    if known is not None and known[0]() is matrix and known[1] == matrix._version:
        return known[2]
    rows = _rows(matrix, name)
    key = id(matrix)
    _copies[key] = (weakref.ref(matrix, lambda _: _copies.pop(key, None)), matrix._version, rows)
    return rows


def color_of(background: Any) -> List[float]:
    """The three numbers of a background."""
    rows = host_rows(background, "background")
    if len(rows) != 1 or len(rows[0]) != 3:
        shape = "shape [%d,%d]" % (len(rows), len(rows[0])) if len(rows) != 1 else "%d" % len(rows[0])
        raise ValueError("background: expected 3 numbers, got %s" % shape)
    return rows[0]


def _rows(matrix: Any, name: str) -> Rows:
    try:
        values: Sequence[Any] = matrix.tolist() if hasattr(matrix, "tolist") else matrix
        nested = len(values) > 0 and isinstance(values[0], (list, tuple))
        rows = [[float(v) for v in r] for r in (values if nested else [values])]
    except (TypeError, ValueError):
        shape = getattr(matrix, "shape", None)
        what = type(matrix).__name__ if shape is None else "shape %s" % list(shape)
        raise ValueError("%s: expected a vector or a matrix of numbers, got %s" % (name, what)) from None
    if any(not math.isfinite(v) for r in rows for v in r):
        raise ValueError("%s: expected finite numbers, got %s" % (name, rows))
    return rows
