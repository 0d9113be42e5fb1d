# SPDX-License-Identifier: Apache-2.0
"""Meshes of models, and their evaluation."""

import fcntl
import json
import math
import re
import resource
import shutil
import struct
import subprocess
import zlib

import numpy as np
import pytest

from conftest import PROGRAM, refused, run_program, run_well, write_png

BOX = [(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)]


def write_points(path, points):
    lines = [f"{x} {y} {z}" for x, y, z in points]
    path.write_text("ply\nformat ascii 1.0\n" + f"element vertex {len(points)}\n" +
                    "property float x\nproperty float y\nproperty float z\nend_header\n" + "\n".join(lines) + "\n")


@pytest.fixture(scope="module")
def meshed(scene, tmp_path_factory):
    """A short run of a surface method, with its mesh; skips where the build cannot extract meshes."""
    folder = tmp_path_factory.mktemp("meshed") / "model"
    run_well("train", "-s", scene, "-m", folder, "--backbone", "pgsr", "--iterations", "60", "--threads", "1", "--quiet")
    done = run_program("mesh", "-m", folder, "--voxel-size", "0.05", "--quiet")
    if done.returncode == 2 and "OpenVDB" in done.stderr:
        pytest.skip("this build makes no meshes")
    assert done.returncode == 0, done.stderr
    return folder


def test_a_mesh_is_written_and_measured(meshed, tmp_path):
    mesh = meshed / "mesh.ply"
    header = mesh.read_bytes().split(b"end_header")[0]
    assert b"red" in header and b"element face" in header
    # A mesh compared with itself.
    done = run_well("mesh-eval", mesh, mesh, "--threshold", "0.1", "--spacing", "0.04", "-o", tmp_path / "numbers.json")
    assert "F1            1.0000" in done.stdout
    numbers = json.loads((tmp_path / "numbers.json").read_text())
    assert numbers["chamfer"] == 0 and numbers["f1"] == 1 and numbers["mesh_points"] > 100
    assert numbers["spacing"] == pytest.approx(0.04)


def test_report_and_picture_show_surfaces_and_mesh(meshed):
    page = (meshed / "report.html").read_text()
    surfaces = sorted(p.name for p in meshed.glob("*/surfaces/*.png"))
    assert len(surfaces) in (2, 4) and all(name.endswith(("_depth.png", "_normals.png")) for name in surfaces)
    assert (meshed / "mesh.png").read_bytes()[:4] == b"\x89PNG"
    assert page.count('<section id="mesh">') == 1
    if "<h2>Pictures</h2>" in page and "without OpenCV" not in page:
        assert "<h2>Surfaces</h2>" in page and "mesh, shaded by its normals" in page


def test_patches_are_compared_in_finer_photos(scene, tmp_path):
    (tmp_path / "fine.json").write_text(json.dumps({"backbone": {"name": "pgsr", "ncc_scale": 0.5}}))
    arguments = ["train", "-s", scene, "-m", tmp_path / "model", "--config", tmp_path / "fine.json", "--iterations", "30",
                 "--threads", "1", "--quiet"]
    refused = run_program(*arguments)
    assert refused.returncode == 2 and "has 80x60 pixels, but ncc_scale needs 160x120" in refused.stderr, refused.stderr
    assert refused.stderr.count("\n") == 1 and not (tmp_path / "model/config.json").exists()
    done = run_program(*arguments, "-r", "2")
    if done.returncode == 2 and "OpenCV" in done.stderr:
        pytest.skip("this build does not resize photos")
    assert done.returncode == 0, done.stderr
    assert json.loads((tmp_path / "model/config.json").read_text())["backbone"]["ncc_scale"] == 0.5


def test_a_mesh_as_gltf_of_fewer_parts(meshed, tmp_path):
    whole = run_well("mesh", "-m", meshed, "--voxel-size", "0.05", "-o", tmp_path / "whole.glb", "--least-triangles", "1")
    part = run_well("mesh", "-m", meshed, "--voxel-size", "0.05", "-o", tmp_path / "part.glb", "--parts", "1")
    vertices = [int(re.search(r"(\d+) vertices", done.stdout)[1]) for done in (part, whole)]
    usual = int(re.search(rb"element vertex (\d+)", (meshed / "mesh.ply").read_bytes())[1])
    assert vertices[0] < usual < vertices[1]
    data = (tmp_path / "part.glb").read_bytes()
    magic, version, length = struct.unpack("<4sII", data[:12])
    assert (magic, version, length) == (b"glTF", 2, len(data))
    assert len(data) <= (tmp_path / "whole.glb").stat().st_size


def test_a_mesh_of_a_model_in_use(meshed, tmp_path):
    before = {name: (meshed / name).read_bytes() for name in ("mesh.ply", "mesh.png", "report.html")}
    with open(meshed / ".splatboost.lock", "w") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        refused = run_program("mesh", "-m", meshed, "--voxel-size", "0.1")
        elsewhere = run_well("mesh", "-m", meshed, "--voxel-size", "0.1", "-o", tmp_path / "mesh.ply", "--quiet")
        (meshed / ".splatboost.lock").unlink()
    assert refused.returncode == 2 and "another splatboost process" in refused.stderr and refused.stdout == ""
    assert "no picture of the mesh" in elsewhere.stderr and (tmp_path / "mesh.ply").exists()
    assert {name: (meshed / name).read_bytes() for name in before} == before


@pytest.mark.parametrize("arguments, reason", [
    (["--max-depth", "1e-3"], "increase --max-depth"), (["--least-views", "100"], "--least-views must be at most 10"),
    (["--least-triangles", "100000000"], "lower --least-triangles"), (["--voxel-size", "1000"], "--voxel-size"),
    (["--max-angle", "0.001"], "increase --max-angle"), (["--masks", "black"], "all surfaces are masked"),
    (["--masks", "square"], "40x40 pixels, which is not the shape of the view, 80x60")])
def test_why_a_mesh_is_empty(meshed, tmp_path, arguments, reason):
    for folder, width, height in ("black", 80, 60), ("square", 40, 40):
        (tmp_path / folder).mkdir()
        for view in range(10):
            write_png(tmp_path / folder / f"{view:04d}.png", np.zeros((height, width), "u1"))
    if arguments[0] == "--masks":
        arguments = ["--masks", tmp_path / arguments[1]]
    if "--voxel-size" not in arguments:
        arguments = ["--voxel-size", "0.05", *arguments]
    done = run_program("mesh", "-m", meshed, "-o", tmp_path / "mesh.ply", "--quiet", *arguments)
    assert done.returncode == 2 and done.stderr.count("\n") == 1 and reason in done.stderr, done.stderr
    assert not (tmp_path / "mesh.ply").exists()


def test_masks_are_black_or_not(meshed, tmp_path):
    """Masks with labels 0 and 1, or objects in blue, counted as black."""
    half = np.zeros((60, 80), "u1")
    half[:, 40:] = 1
    blue = np.zeros((60, 80, 3), "u1")
    blue[:, 40:, 2] = 255
    for name, pixels in ("white", 255 * half), ("labels", half), ("blue", blue):
        (tmp_path / name).mkdir()
        for view in range(10):
            write_png(tmp_path / name / f"{view:04d}.png", pixels)
        run_well("mesh", "-m", meshed, "--masks", tmp_path / name, "-o", tmp_path / f"{name}.ply", "--voxel-size", 0.05, "--quiet")
    assert (tmp_path / "labels.ply").read_bytes() == (tmp_path / "white.ply").read_bytes()
    assert (tmp_path / "blue.ply").read_bytes() == (tmp_path / "white.ply").read_bytes()
    picture = (tmp_path / "white/0003.png").read_bytes()
    (tmp_path / "white/0003.png").write_bytes(picture[:-20])
    assert "0003.png" in refused("mesh", "-m", meshed, "--masks", tmp_path / "white", "-o", tmp_path / "x.ply", "--quiet")


def test_a_model_is_not_replaced(meshed, scene, tmp_path):
    model = tmp_path / "mine.ply"
    shutil.copyfile(next(meshed.glob("point_cloud/*/point_cloud.ply")), model)
    before = model.read_bytes()
    for arguments in (["mesh", "-m", meshed], ["points", "-s", scene]):
        assert "mine.ply: holds a model" in refused(*arguments, "-o", model)
    (tmp_path / "notes.sbscene").write_text("mine")
    assert "notes.sbscene: exists and is not a packed scene" in refused("pack", scene, tmp_path / "notes.sbscene")
    assert model.read_bytes() == before and (tmp_path / "notes.sbscene").read_text() == "mine"


def test_the_report_does_not_show_the_mesh_of_another_scene(meshed, tmp_path):
    run_well("synth", tmp_path / "other", "--width", 80, "--height", 60, "--views", 10, "--points", 300, "--seed", 7)
    before = {name: (meshed / name).read_bytes() for name in ("mesh.png", "report.html")}
    other = ["-s", tmp_path / "other", "--voxel-size", "0.05"]
    assert "whose mesh would be replaced" in refused("mesh", "-m", meshed, *other)
    done = run_well("mesh", "-m", meshed, *other, "-o", tmp_path / "mesh.ply")
    assert "another scene" in done.stdout and "picture:" not in done.stdout and (tmp_path / "mesh.ply").exists()
    assert {name: (meshed / name).read_bytes() for name in before} == before


def test_the_report_does_not_show_the_mesh_of_an_earlier_iteration(scene, tmp_path):
    model = tmp_path / "model"
    run_well("train", "-s", scene, "-m", model, "--iterations", 30, "--save-iterations", 20, "--quiet")
    run_well("mesh", "-m", model, "--voxel-size", "0.05")
    before = {name: (model / name).read_bytes() for name in ("mesh.png", "mesh.ply", "report.html")}
    assert "would replace that of the run" in refused("mesh", "-m", model, "--iteration", 20, "--voxel-size", "0.05")
    done = run_well("mesh", "-m", model, "--iteration", 20, "--voxel-size", "0.05", "-o", tmp_path / "mesh.ply")
    assert "of an earlier iteration" in done.stdout and "picture:" not in done.stdout
    assert {name: (model / name).read_bytes() for name in before} == before


def test_files_of_the_run_s_scene_are_not_replaced(meshed, tmp_path):
    model = shutil.copytree(meshed, tmp_path / "model")
    config = json.loads((model / "config.json").read_text())
    scene = shutil.copytree(config["source"], tmp_path / "scene")
    (model / "config.json").write_text(json.dumps({**config, "source": str(scene)}))
    (scene / "truth.ply").write_text("the only copy")
    line = refused("mesh", "-m", model, "-s", config["source"], "-o", scene / "truth.ply")
    assert "in the folder of the scene" in line and (scene / "truth.ply").read_text() == "the only copy"


def test_a_measurement_does_not_replace_other_files(meshed, tmp_path):
    config = (meshed / "config.json").read_bytes()
    line = refused("mesh-eval", meshed / "mesh.ply", meshed / "mesh.ply", "-o", meshed / "config.json")
    assert "was not written by splatboost mesh-eval" in line and (meshed / "config.json").read_bytes() == config
    for _ in range(2):
        run_well("mesh-eval", meshed / "mesh.ply", meshed / "mesh.ply", "-o", tmp_path / "distances.json")


def test_masks_of_photos_with_absolute_names(meshed, scene, tmp_path):
    copy = tmp_path / "scene"
    frames = [{"file_path": str(scene / f"images/{i:04d}.png"), "transform_matrix": np.eye(4).tolist()} for i in range(3)]
    copy.mkdir()
    (copy / "transforms.json").write_text(json.dumps({"fl_x": 70, "frames": frames}))
    arguments = ["mesh", "-m", meshed, "-s", copy, "--masks", tmp_path, "-o", tmp_path / "mesh.ply", "--voxel-size", 0.05,
                 "--quiet"]
    assert f"{tmp_path}/0000.png: missing; each view needs a mask" in refused(*arguments)
    write_png(tmp_path / "0000.png", np.zeros((60, 80), "u1"))
    (copy / "another").mkdir()
    shutil.copyfile(scene / "images/0001.png", copy / "another/0000.png")
    frames[1]["file_path"] = str(copy / "another/0000.png")
    (copy / "transforms.json").write_text(json.dumps({"fl_x": 70, "frames": frames[:2]}))
    assert "0000.png: would be the mask of both" in refused(*arguments)


def test_an_unwritable_mesh_is_told_before_the_work(meshed, tmp_path):
    done = run_program("mesh", "-m", meshed, "-o", tmp_path / "none/mesh.ply", "--voxel-size", "0.0005", "--max-memory", "1")
    assert done.returncode == 2 and "mesh.ply: cannot be written: No such file" in done.stderr, done.stderr


def test_the_same_mesh_for_any_number_of_threads(meshed, tmp_path):
    for threads in ("1", "3"):
        run_well("mesh", "-m", meshed, "--voxel-size", "0.05", "-o", tmp_path / f"{threads}.ply", "--threads", threads)
    assert (tmp_path / "1.ply").read_bytes() == (tmp_path / "3.ply").read_bytes()


def matlab_file(arrays, packed):
    """A MATLAB file of version 5. arrays: name → (shape, doubles in column-major order)."""
    def element(kind, data):
        return struct.pack("<II", kind, len(data)) + data + bytes(-len(data) % 8)

    file = b"MATLAB 5.0".ljust(124) + struct.pack("<H", 0x0100) + b"IM"
    for name, (shape, values) in arrays.items():
        inner = (element(6, struct.pack("<II", 6, 0)) + element(5, struct.pack(f"<{len(shape)}i", *shape)) +
                 element(1, name.encode()) + element(9, struct.pack(f"<{len(values)}d", *values)))
        matrix = struct.pack("<II", 14, len(inner)) + inner
        if packed:
            matrix = zlib.compress(matrix)
            matrix = struct.pack("<II", 15, len(matrix)) + matrix
        file += matrix
    return file


@pytest.mark.parametrize("packed", [False, True])
def test_dtu_counts_what_was_observed_and_stands_on_the_table(tmp_path, packed):
    # The grid of the mask: 10 mm spacing from the origin, observed for x up to 20.
    grid = [1.0 if x <= 2 else 0.0 for z in range(4) for y in range(5) for x in range(5)]
    (tmp_path / "mask.mat").write_bytes(matlab_file(
        {"BB": ((2, 3), [0, 40, 0, 40, 0, 30]), "Res": ((1, 1), [10]), "ObsMask": ((5, 5, 4), grid)}, packed))
    (tmp_path / "plane.mat").write_bytes(matlab_file({"P": ((4, 1), [0, 0, 1, -5])}, packed))
    scan = [(x, y, 10) for x in range(0, 41, 2) for y in range(0, 41, 2)]  # above the table, and the table
    write_points(tmp_path / "scan.ply", scan + [(x, y, 0) for x in range(0, 41, 2) for y in range(0, 41, 2)])
    # 1 above the scan for x up to 24, which is observed, and 9 above it beyond. Three more points: an outlier, a
    # duplicate, which is thinned out, and one outside of all bounds.
    found = [(x, y, 11 if x <= 24 else 19) for x in range(0, 41, 2) for y in range(0, 41, 2)]
    write_points(tmp_path / "found.ply", found + [(0, 0, 34), (0, 0, 11), (0, 0, 900)])
    arguments = ["mesh-eval", tmp_path / "found.ply", tmp_path / "scan.ply", "--dtu-mask", tmp_path / "mask.mat",
                 "--dtu-plane", tmp_path / "plane.mat", "-o", tmp_path / "numbers.json"]
    done = run_program(*arguments)
    if done.returncode == 2 and "libmatio" in done.stderr:
        pytest.skip("this build reads no MATLAB files")
    assert done.returncode == 0, done.stderr
    numbers = json.loads((tmp_path / "numbers.json").read_text())
    columns = [x for x in range(0, 41, 2)]
    observed = [x for x in columns if x <= 24]  # 25 would be nearer to the fourth grid point
    # The outlier counts; it is 24 away from the scan.
    assert numbers["mesh_points"] == 21 * len(observed) + 1 and numbers["truth_points"] == 21 * 21
    assert numbers["accuracy"] == pytest.approx(1.0)
    # Scan points with x beyond 24 are nearest to the point 9 above them, or to one at x = 24, 1 above the scan.
    wanted = [1 if x <= 24 else min(9, ((x - 24) ** 2 + 1) ** 0.5) for x in columns]
    assert numbers["completeness"] == pytest.approx(sum(wanted) / 21)
    assert numbers["spacing"] == 0.2
    whole = json.loads((run_well(*arguments, "--cut", "100"), (tmp_path / "numbers.json").read_text())[1])
    assert whole["accuracy"] == pytest.approx((21 * len(observed) + 24) / (21 * len(observed) + 1))
    for wrong, words in [(arguments[:5], "must be given together"), (arguments + ["--crop", "x.json"], "Tanks and Temples"),
                         (arguments[:4] + [tmp_path / "plane.mat"] + arguments[5:], "BB is missing")]:
        refused = run_program(*wrong)
        assert refused.returncode == 2 and words in refused.stderr and refused.stderr.count("\n") == 1, refused.stderr


def test_broken_requests_are_told_in_one_line(meshed, tmp_path):
    write_points(tmp_path / "box.ply", BOX)
    write_points(tmp_path / "large.ply", [(1000 * x, 1000 * y, 1000 * z) for x, y, z in BOX])
    (tmp_path / "17.txt").write_text("1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n5\n")
    (tmp_path / "bad.ply").write_text("no mesh\n")
    for arguments, words in [
            (["mesh"], "no model folder"),
            (["mesh", "-m", meshed, "--voxel-size", "0"], "--voxel-size"),
            (["mesh", "-m", meshed, "-o", tmp_path / "mesh.obj"], ".glb"),
            (["mesh", "-m", meshed, "--max-angle", "100"], "--max-angle"),
            (["mesh", "-m", meshed, "--least-views", "0"], "--least-views"),
            (["mesh", "-m", meshed, "--time", "0.5"], "does not change with time"),
            (["mesh", "-m", meshed, "--time", "2"], "--time must be in [0, 1]"),
            (["mesh", "-m", meshed, "--masks", tmp_path / "none"], "masks"),
            (["mesh", "-m", meshed, "--voxel-size", "0.0005", "--max-memory", "1"], "--voxel-size"),
            (["mesh", "-m", meshed, "--max-memory", str(2**44)], "--max-memory must be at most 17592186044415 MiB"),
            (["mesh", "-m", meshed, "--voxel-size", "1e-9"], "--voxel-size 1e-09 is too small for a depth of"),
            (["mesh-eval", tmp_path / "box.ply"], "two files"),
            (["mesh-eval", tmp_path / "large.ply", tmp_path / "box.ply"], f"large.ply: is 1000 times as large as {tmp_path}/box.ply"),
            (["mesh-eval", tmp_path / "box.ply", tmp_path / "large.ply"], f"large.ply: is 1000 times as large as {tmp_path}/box.ply"),
            (["mesh-eval", tmp_path / "box.ply", tmp_path / "box.ply", "--align", tmp_path / "none.txt"], "none.txt: cannot be read"),
            (["mesh-eval", tmp_path / "box.ply", tmp_path / "box.ply", "--align", tmp_path / "17.txt"], "17.txt: must hold the 16"),
            (["mesh-eval", tmp_path / "bad.ply", tmp_path / "box.ply"], "bad.ply"),
            (["mesh-eval", tmp_path / "box.ply", tmp_path / "none.ply"], "none.ply"),
            (["mesh-eval", tmp_path / "box.ply", tmp_path / "box.ply", "--threshold", "-1"], "--threshold"),
            (["mesh-eval", tmp_path / "box.ply", tmp_path / "box.ply", "--crop", tmp_path / "bad.ply"], "bad.ply"),
    ]:
        done = run_program(*arguments)
        assert done.returncode == 2, (arguments, done.stdout, done.stderr)
        assert words in done.stderr and done.stderr.count("\n") == 1, done.stderr


def test_tanks_and_temples_uses_the_scene_s_threshold_in_its_volume(tmp_path):
    # A grid 4 mm above the truth; Barn's threshold is 10 mm, Ignatius' 3 mm. Half of the truth is outside the volume.
    grid = [(x / 50, y / 50) for x in range(50) for y in range(50)]
    write_points(tmp_path / "truth.ply", [(x, y, 0) for x, y in grid] + [(x + 5, y, 0) for x, y in grid])
    write_points(tmp_path / "mesh.ply", [(x, y, 0.004) for x, y in grid])
    volume = {"class_name": "SelectionPolygonVolume", "orthogonal_axis": "Z", "axis_min": -1, "axis_max": 1,
              "bounding_polygon": [[-1, -1, 0], [2, -1, 0], [2, 2, 0], [-1, 2, 0]]}
    arguments = ["mesh-eval", tmp_path / "mesh.ply", tmp_path / "truth.ply", "-o", tmp_path / "numbers.json"]
    for scene, threshold, f1 in ("Barn", 0.01, 1), ("Ignatius", 0.003, 0):
        (tmp_path / f"{scene}.json").write_text(json.dumps(volume))
        run_well(*arguments, "--crop", tmp_path / f"{scene}.json")
        numbers = json.loads((tmp_path / "numbers.json").read_text())
        assert (numbers["threshold"], numbers["f1"], numbers["truth_points"]) == (threshold, f1, 2500)
        assert "refinement" not in numbers
    run_well(*arguments, "--crop", tmp_path / "Ignatius.json", "--refine")
    numbers = json.loads((tmp_path / "numbers.json").read_text())
    assert numbers["f1"] == 1 and numbers["refinement"][11] == pytest.approx(-0.004, abs=1e-6)
    refused = run_program(*arguments, "--refine")
    assert refused.returncode == 2 and "--refine needs --crop" in refused.stderr, refused.stderr


def test_a_mesh_is_aligned_by_its_cameras(tmp_path):
    # truth = 2.5 · turn · mesh + shift; the pose of one camera is wrong.
    c, s = math.cos(0.7), math.sin(0.7)
    turn, shift, scale = [[c, -s, 0], [0, 0, -1], [s, c, 0]], [3, -1, 7], 2.5

    def moved(p):
        return [scale * sum(turn[r][k] * p[k] for k in range(3)) + shift[r] for r in range(3)]

    grid = [(x / 10, y / 10, math.sin(x + y) / 5) for x in range(20) for y in range(20)]
    write_points(tmp_path / "mesh.ply", grid)
    write_points(tmp_path / "truth.ply", [moved(p) for p in grid])
    places = [(3 * math.cos(0.5 * i), 3 * math.sin(0.5 * i), 1 + 0.1 * i) for i in range(12)]

    def log_of(numbers):
        text = ""
        for i, n in enumerate(numbers):
            at = [90, 0, 0] if n == 4 else moved(places[n])
            text += f"{i} {i} 0\n" + "".join(f"1 0 0 {x}\n" for x in at) + "0 0 0 1\n"
        return text

    (tmp_path / "all.log").write_text(log_of(range(12)))
    model = tmp_path / "model"
    model.mkdir()

    def write_cameras(numbers):
        (model / "cameras.json").write_text(json.dumps(
            [{"id": i, "img_name": f"{n + 1}.jpg", "position": places[n]} for i, n in enumerate(numbers)]))

    colmap = tmp_path / "colmap/sparse/0"
    colmap.mkdir(parents=True)
    (colmap / "cameras.txt").write_text("1 PINHOLE 10 10 10 10 5 5\n")
    (colmap / "images.txt").write_text("".join(  # turned by half a turn about x
        f"{n + 1} 0 1 0 0 {-p[0]} {p[1]} {p[2]} 1 {n + 1:06}.jpg\n\n" for n, p in enumerate(places)))
    arguments = ["mesh-eval", tmp_path / "mesh.ply", tmp_path / "truth.ply", "--threshold", "0.01", "--vertices",
                 "--trajectory", tmp_path / "all.log", "-o", tmp_path / "of.json", "--cameras"]
    for cameras, numbers in [(model, [11, *range(11)]), (model / "cameras.json", [9, 2, 11, 7, 0, 5]), (colmap, []),
                             (tmp_path / "colmap", [])]:
        write_cameras(numbers)
        done = run_well(*arguments, cameras)
        found = json.loads((tmp_path / "of.json").read_text())
        wrong = 0 if len(numbers) == 6 else 1
        used = (len(numbers) or 12) - wrong
        assert f"cameras       {used} aligned with" in done.stdout, done.stdout
        assert f"scale 2.5; {wrong} left out" in done.stdout, done.stdout
        assert found["f1"] == 1 and found["accuracy"] < 1e-4
        assert (found["trajectory"]["cameras"], found["trajectory"]["left_out"]) == (used, wrong)
        wanted = [[scale * x for x in turn[r]] + [shift[r]] for r in range(3)] + [[0, 0, 0, 1]]
        assert found["trajectory"]["transform"] == pytest.approx([x for row in wanted for x in row], abs=1e-5)
    # The benchmark's matrix comes after it.
    (tmp_path / "up.txt").write_text("1 0 0 0\n0 1 0 0\n0 0 1 100\n0 0 0 1\n")
    run_well(*arguments, colmap, "--align", tmp_path / "up.txt")
    assert json.loads((tmp_path / "of.json").read_text())["f1"] == 0

    write_cameras([0, 1])
    (tmp_path / "none.json").write_text('[{"img_name": "1.jpg"}]')
    (tmp_path / "far.json").write_text('[{"img_name": "13.jpg", "position": [0, 0, 0]}]')
    (tmp_path / "cut.log").write_text(log_of(range(12))[:-9])
    for broken, words in [(arguments[:-1], "must be given together"), ([*arguments, model], "not all on one line"),
                          ([*arguments, tmp_path / "none.json"], "camera 0 needs img_name and position"),
                          ([*arguments, tmp_path / "far.json"], "image '13.jpg' has no pose"),
                          ([*arguments, tmp_path], "neither cameras.bin nor cameras.txt"),
                          ([*arguments[:-5], *arguments[-3:], colmap, "--trajectory", tmp_path / "cut.log"], "ends within")]:
        refused = run_program(*broken)
        assert refused.returncode == 2 and words in refused.stderr and refused.stderr.count("\n") == 1, refused.stderr


def test_a_truth_without_size(tmp_path):
    write_points(tmp_path / "box.ply", BOX)
    write_points(tmp_path / "dot.ply", [(0, 0, 0)] * 5)
    refused = run_program("mesh-eval", tmp_path / "box.ply", tmp_path / "dot.ply")
    assert refused.returncode == 2 and "all points coincide; set --threshold" in refused.stderr, refused.stderr
    for mesh, accuracy in ("box.ply", "1.12"), ("dot.ply", "0 "):
        done = run_well("mesh-eval", tmp_path / mesh, tmp_path / "dot.ply", "--threshold", "0.1", "-o", tmp_path / "of.json")
        assert "accuracy      " + accuracy in done.stdout
        assert "%" not in done.stdout and "nan" not in done.stdout and "inf" not in done.stdout, done.stdout
        assert json.loads((tmp_path / "of.json").read_text())["diagonal"] == 0


def test_points_are_moved_and_measured(tmp_path):
    write_points(tmp_path / "box.ply", BOX)
    write_points(tmp_path / "moved.ply", [(x + 5, y, z) for x, y, z in BOX])
    (tmp_path / "back.txt").write_text("1 0 0 -5\n0 1 0 0\n0 0 1 0\n0 0 0 1\n")
    for extra, f1 in ([], 0), (["--align", tmp_path / "back.txt"], 1):
        run_well("mesh-eval", tmp_path / "moved.ply", tmp_path / "box.ply", "--threshold", "0.1", "-o",
                 tmp_path / "numbers.json", *extra)
        numbers = json.loads((tmp_path / "numbers.json").read_text())
        assert numbers["f1"] == f1 and numbers["truth_points"] == 8


def test_the_memory_limit_counts_scattered_blocks_too(meshed, tmp_path):
    """Voxels far smaller than a pixel make blocks that share no inner node of the volume, which are larger than blocks."""
    two_gib = (2 << 30, 2 << 30)
    done = subprocess.run([PROGRAM, "mesh", "-m", meshed, "-o", tmp_path / "mesh.ply", "--voxel-size", "0.00001", "--max-memory", "100",
                           "--threads", "1"], capture_output=True, text=True, check=False, timeout=120,
                          preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, two_gib))
    assert done.returncode == 2 and "more than 100 MiB of memory" in done.stderr, done.stderr
