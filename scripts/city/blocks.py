# SPDX-License-Identifier: Apache-2.0
"""Splits a large COLMAP scene into blocks (with their views and points), and merges the models of the blocks into one.

A block owns a rectangle of the ground; outer blocks are unbounded outwards, so every place has exactly one owner.
"""
import json
import os
import shutil
import struct
from pathlib import Path

import numpy as np


class BadInput(Exception):
    """An error that the user can fix, as one line."""


#: By model id of COLMAP: the number of camera parameters, and whether fy is a separate parameter after fx.
_MODELS = {0: (3, False), 1: (4, True), 2: (4, False), 3: (5, False), 4: (8, True), 5: (8, True), 6: (12, True), 7: (5, True),
           8: (4, False), 9: (5, False), 10: (12, True)}


class Scene:
    """A COLMAP model in binary form: cameras {id: (width, height, fx, fy)}; names, poses [V,7] (w x y z, translation; camera
    from world) and camera ids of the views, by name; points [N,3], their colours [N,3] and errors [N]."""

    def __init__(self, folder):
        self.folder = Path(folder)
        self.sparse = next((p for p in (self.folder / "sparse/0", self.folder / "sparse") if (p / "images.bin").is_file()), None)
        if self.sparse is None:
            raise BadInput(f"{folder}: no sparse/0/images.bin; convert a text model to binary: colmap model_converter "
                           "--output_type BIN")
        try:
            self._read_cameras((self.sparse / "cameras.bin").read_bytes())
            self._read_images((self.sparse / "images.bin").read_bytes())
            self._read_points((self.sparse / "points3D.bin").read_bytes())
        except OSError as error:
            raise BadInput(f"{error.filename}: {error.strerror}") from error
        except (struct.error, IndexError, KeyError, ValueError) as error:
            raise BadInput(f"{self.sparse}: is not a complete COLMAP model ({error})") from error

    def _read_cameras(self, data):
        self.cameras, at = {}, 8
        for _ in range(struct.unpack_from("<Q", data)[0]):
            number, model, width, height = struct.unpack_from("<IiQQ", data, at)
            count, two = _MODELS[model]
            values = struct.unpack_from(f"<{count}d", data, at + 24)
            self.cameras[number] = (width, height, values[0], values[1 if two else 0])
            at += 24 + 8 * count

    def _read_images(self, data):
        views, at = [], 8
        for _ in range(struct.unpack_from("<Q", data)[0]):
            pose, camera = struct.unpack_from("<7d", data, at + 4), struct.unpack_from("<I", data, at + 60)[0]
            end = data.index(b"\0", at + 64)
            views.append((data[at + 64:end].decode(), pose, camera))
            at = end + 9 + 24 * struct.unpack_from("<Q", data, end + 1)[0]
        views.sort()
        if len(views) < 2:
            raise BadInput(f"{self.sparse}: {len(views)} views are too few for blocks")
        for name, pose, camera in views:
            if camera not in self.cameras:
                raise BadInput(f"{self.sparse}: {name} has camera {camera}, which is not in cameras.bin")
            if not np.isfinite(pose).all() or not any(pose[:4]):
                raise BadInput(f"{self.sparse}: {name} has no valid pose; remove it from the model")
        self.names = [name for name, _, _ in views]
        self.poses = np.array([pose for _, pose, _ in views])
        self.view_cameras = [camera for _, _, camera in views]
        w, x, y, z = (self.poses[:, :4] / np.linalg.norm(self.poses[:, :4], axis=1, keepdims=True)).T
        self.rotations = np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
                                   2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
                                   2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], 1).reshape(-1, 3, 3)
        self.centres = -np.einsum("vji,vj->vi", self.rotations, self.poses[:, 4:])

    def _read_points(self, data):
        count, at = struct.unpack_from("<Q", data)[0], 8
        if count > len(data) // 51:  # the smallest size of a point
            raise ValueError("points3D.bin ends early")
        self.points, self.colors, self.errors = np.zeros((count, 3)), np.zeros((count, 3), np.uint8), np.zeros(count)
        for i in range(count):
            self.points[i] = struct.unpack_from("<3d", data, at + 8)
            self.colors[i] = struct.unpack_from("<3B", data, at + 32)
            self.errors[i], tracks = struct.unpack_from("<dQ", data, at + 35)
            at += 51 + 8 * tracks

    def seen_by(self, view):
        """bool [N]: points in the frustum of a view, occluded or not."""
        width, height, fx, fy = self.cameras[self.view_cameras[view]]
        x, y, z = (self.points @ self.rotations[view].T + self.poses[view, 4:]).T
        ahead = z > 1e-6
        return ahead & (np.abs(x) * 2 * fx < width * z) & (np.abs(y) * 2 * fy < height * z)

    def viewer_cameras(self, hold):
        """The content of a model's cameras.json: test views (every `hold`-th; 0: none), then training views, with the
        size and focal lengths of the COLMAP model."""
        listed = []
        for split in ("test", "train"):
            for view, name in enumerate(self.names):
                if (split == "test") == (hold > 0 and view % hold == 0):
                    width, height, fx, fy = self.cameras[self.view_cameras[view]]
                    listed.append({"id": len(listed), "img_name": name, "split": split, "width": width, "height": height,
                                   "position": self.centres[view].tolist(), "rotation": self.rotations[view].T.tolist(),
                                   "fx": fx, "fy": fy})
        return listed

    def write(self, folder, views, points):
        """Writes a scene of these views (indices) and points (bool [N]), with a link to this scene's images."""
        out = Path(folder) / "sparse/0"
        out.mkdir(parents=True)
        shutil.copyfile(self.sparse / "cameras.bin", out / "cameras.bin")
        with open(out / "images.bin", "wb") as file:
            file.write(struct.pack("<Q", len(views)))
            for number, view in enumerate(views, 1):
                file.write(struct.pack("<I7dI", number, *self.poses[view], self.view_cameras[view]))
                file.write(self.names[view].encode() + struct.pack("<BQ", 0, 0))
        with open(out / "points3D.bin", "wb") as file:
            kept = np.flatnonzero(points)
            file.write(struct.pack("<Q", len(kept)))
            for i in kept:
                file.write(struct.pack("<Q3d3BdQ", i + 1, *self.points[i], *self.colors[i], self.errors[i], 0))
        os.symlink((self.folder / "images").resolve(), Path(folder) / "images", target_is_directory=True)


class Grid:
    """Rectangles of the ground, columns × rows, with about equally many cameras each. As JSON: axes [2,3] of the
    ground in world space, column_cuts [columns − 1], row_cuts [columns][rows − 1], along these axes."""

    def __init__(self, axes, column_cuts, row_cuts):
        self.axes, self.column_cuts, self.row_cuts = np.array(axes), list(column_cuts), [list(cuts) for cuts in row_cuts]

    @staticmethod
    def around(scene, columns, rows):
        spread = scene.centres - scene.centres.mean(axis=0)
        _, lengths, directions = np.linalg.svd(spread, full_matrices=False)
        on_line = len(lengths) < 3 or lengths[1] <= 0.01 * lengths[0]
        if not on_line and lengths[2] < 0.3 * lengths[1]:
            up = directions[2]  # camera positions are nearly coplanar: take their plane as the ground
        else:
            up = -scene.rotations[:, 1].mean(axis=0)  # rows of a rotation are the camera's axes; y is down
            if on_line:  # the line lies on the ground
                up -= directions[0] * (up @ directions[0])
            if np.linalg.norm(up) < 0.3:
                raise BadInput(f"{scene.folder}: the ground cannot be found from the cameras' positions or up directions")
            up /= np.linalg.norm(up)
        spread -= np.outer(spread @ up, up)
        along = np.linalg.svd(spread, full_matrices=False)[2][0]
        axes = np.stack([along, np.cross(up, along)])
        places = scene.centres @ axes.T
        column_cuts = _cuts(places[:, 0], columns)
        column = np.searchsorted(column_cuts, places[:, 0], side="right")
        row_cuts = [_cuts(places[column == c, 1], rows) for c in range(columns)]
        return Grid(axes, column_cuts, row_cuts)

    def names(self):
        return [f"{c}_{r}" for c, cuts in enumerate(self.row_cuts) for r in range(len(cuts) + 1)]

    def owners(self, points):
        """int [N]: index in names() of the block that owns each point [N,3]."""
        u, v = (points @ self.axes.T).T
        column = np.searchsorted(self.column_cuts, u, side="right")
        row = np.zeros(len(u), int)
        for c, cuts in enumerate(self.row_cuts):
            row[column == c] = np.searchsorted(cuts, v[column == c], side="right")
        return column * (len(self.row_cuts[0]) + 1) + row

    def near(self, points, block, border):
        """bool [N]: points in a block or at most `border` (world units) outside it."""
        rows = len(self.row_cuts[0]) + 1
        u, v = (points @ self.axes.T).T
        inside = np.ones(len(u), bool)
        for values, cuts, i in ((u, self.column_cuts, block // rows), (v, self.row_cuts[block // rows], block % rows)):
            edges = [-np.inf, *cuts, np.inf]
            inside &= (values >= edges[i] - border) & (values < edges[i + 1] + border)
        return inside

    def to_json(self):
        return {"axes": self.axes.tolist(), "column_cuts": self.column_cuts, "row_cuts": self.row_cuts}


def _cuts(values, parts):
    """The parts − 1 cuts that divide the values into parts of about equal size."""
    if len(values) < parts:
        raise BadInput(f"--grid: {len(values)} cameras cannot be cut into {parts} parts")
    return [float(np.quantile(values, i / parts)) for i in range(1, parts)]


def split(scene, grid, out, border, share, hold):
    """Writes a scene OUT/blocks/NAME/scene per block. Held-out views (every `hold`-th; 0: none) are in no block.
    border: world units. share: fraction of a view's visible points that must lie in or near a block to use it there.
    Returns a list of {"name", "views", "points"} per block."""
    train = [v for v in range(len(scene.names)) if not hold or v % hold]
    seen = {v: scene.seen_by(v) for v in train}
    listing = []
    for block, name in enumerate(grid.names()):
        points = grid.near(scene.points, block, border)
        stands = grid.near(scene.centres, block, border)
        views = [v for v in train if stands[v] or (seen[v].any() and points[seen[v]].mean() >= share)]
        if not views:
            raise BadInput(f"block {name} has no views; use a coarser --grid or a larger --border")
        # Include the points that its views see outside the block; otherwise Gaussians in the block would model them.
        for v in views:
            points |= seen[v]
        folder = out / "blocks" / name / "scene"
        scene.write(folder, views, points)
        listing.append({"name": name, "views": len(views), "points": int(points.sum())})
    return listing


def read_ply(path):
    """Property names and rows (structured array) of a model that `splatboost train` wrote."""
    data = Path(path).read_bytes()
    end = data.index(b"end_header\n") + 11
    header = data[:end].decode().splitlines()
    count = next(int(line.split()[2]) for line in header if line.startswith("element vertex"))
    names = [line.split()[2] for line in header if line.startswith("property float")]
    return names, np.frombuffer(data, np.dtype([(name, "<f4") for name in names]), count, end)


def merge(plan, out):
    """Writes OUT/merged: the Gaussians that each block owns, and the files that `splatboost eval` and the viewer need."""
    grid = Grid(**plan["grid"])
    kept, names = [], None
    train_seconds, memory = [], []
    for block, name in enumerate(grid.names()):
        model = out / "blocks" / name / "model"
        results = json.loads((model / "results.json").read_text())
        these, rows = read_ply(model / f"point_cloud/iteration_{results['iterations']}/point_cloud.ply")
        if names not in (None, these):
            raise BadInput(f"{model}: its properties differ from those of the other blocks")
        names = these
        places = np.stack([rows[axis] for axis in "xyz"], axis=1).astype(float)
        kept.append(rows[grid.owners(places) == block])
        train_seconds.append(results["train_seconds"])
        memory.append(results["peak_memory_bytes"])
    rows = np.concatenate(kept)
    merged = out / "merged"
    shutil.rmtree(merged, ignore_errors=True)
    saved = merged / f"point_cloud/iteration_{results['iterations']}"
    saved.mkdir(parents=True)
    head = ["ply", "format binary_little_endian 1.0", f"element vertex {len(rows)}"]
    head += [f"property float {name}" for name in names] + ["end_header"]
    (saved / "point_cloud.ply").write_bytes(("\n".join(head) + "\n").encode() + rows.tobytes())
    config = json.loads((model / "config.json").read_text())
    config.update(source=plan["source"], eval=plan["hold"] > 0)
    config["trained"].pop("data", None)  # of the block's photos; eval then knows the scene by its path
    if plan["hold"]:
        config["llffhold"] = plan["hold"]
    (merged / "config.json").write_text(json.dumps(config, indent=2) + "\n")
    (merged / "cameras.json").write_text(json.dumps(Scene(plan["source"]).viewer_cameras(plan["hold"])) + "\n")
    # Blocks can train in parallel, so report the time of the slowest and the memory of the largest.
    results.update(primitives=len(rows), train_seconds=max(train_seconds), peak_memory_bytes=max(memory), curve=[],
                   views=[], scales=[], stage_seconds={}, command=plan["command"], source=Path(plan["source"]).name)
    (merged / "training.json").write_text(json.dumps(results, indent=2) + "\n")
    return {"gaussians": len(rows), "of_blocks": [len(r) for r in kept], "train_seconds": train_seconds}
