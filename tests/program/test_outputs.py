# SPDX-License-Identifier: Apache-2.0
"""Outputs that the user names never replace a model or an input, and impossible ones are refused before the work."""

import fcntl
import os
import shutil
import signal
import time

import pytest

from conftest import content, refused, run_program, run_well, start, wait_for

SQUARE = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0)]


def write_points(path):
    lines = ["ply", "format ascii 1.0", f"element vertex {len(SQUARE)}", "property float x", "property float y",
             "property float z", "end_header", *(" ".join(map(str, point)) for point in SQUARE)]
    path.write_text("\n".join(lines) + "\n")


@pytest.fixture(scope="module")
def convexes(scene, tmp_path_factory):
    folder = tmp_path_factory.mktemp("convexes") / "model"
    run_well("train", "-s", scene, "-m", folder, "--backbone", "convex-splatting", "--iterations", "20", "--quiet")
    return folder


def test_an_export_does_not_replace_the_model(convexes, tmp_path):
    saved = convexes / "point_cloud/iteration_20"
    before = content(convexes)
    (tmp_path / "link.ply").symlink_to(saved / "point_cloud.ply")
    for output in (saved / "point_cloud.ply", tmp_path / "link.ply"):
        assert "is an input of this command" in refused("export", "-m", convexes, "-o", output)
    for output in (saved / "new.glb", convexes / "point_cloud/new.ply"):
        assert f"saved models of {convexes}" in refused("export", "-m", convexes, "-o", output)
    assert "saved models of" in refused("export", "-m", convexes, "-o", "new.ply", cwd=saved)
    assert content(convexes) == before
    run_well("export", "-m", convexes, "-o", tmp_path / "point_cloud.ply")


def test_an_export_does_not_replace_a_model_behind_a_link(convexes, tmp_path):
    model = tmp_path / "model"
    shutil.copytree(convexes, model)
    (model / "point_cloud").rename(tmp_path / "elsewhere")
    (model / "point_cloud").symlink_to(tmp_path / "elsewhere")
    ply = tmp_path / "elsewhere/iteration_20/point_cloud.ply"
    before = ply.read_bytes()
    for output in (ply, model / "point_cloud/iteration_20/point_cloud.ply"):
        assert "is an input of this command" in refused("export", "-m", model, "-o", output)
    assert ply.read_bytes() == before


def test_a_mesh_does_not_replace_the_model_or_the_points_of_the_scene(scene, trained, tmp_path):
    trained = shutil.copytree(trained, tmp_path / "trained")  # mesh adds a picture
    if "OpenVDB" in run_program("mesh", "-m", trained, "-o", tmp_path / "mesh.ply").stderr:
        pytest.skip("this build makes no meshes")
    saved = trained / "point_cloud/iteration_60"
    before = content(saved)
    assert "is an input of this command" in refused("mesh", "-m", trained, "-o", saved / "point_cloud.ply")
    assert "saved models of" in refused("mesh", "-m", trained, "-o", saved / "mesh.glb")
    assert content(saved) == before
    copy = tmp_path / "room"
    shutil.copytree(scene, copy)
    write_points(copy / "sparse/0/points3D.ply")
    line = refused("mesh", "-m", trained, "-s", copy, "-o", copy / "sparse/0/points3D.ply")
    assert "exists in the folder of the scene" in line


def test_figures_do_not_replace_inputs(scene, tmp_path):
    a, b = tmp_path / "a.ply", tmp_path / "b.ply"
    write_points(a)
    write_points(b)
    before = content(tmp_path)
    assert "--output must end in .json" in refused("mesh-eval", a, b, "-o", b)
    assert "--output must end in .json" in refused("bench", "-o", scene / "images/0003.png")
    assert content(tmp_path) == before
    (tmp_path / "crop.json").write_text("{}")
    assert "is an input of this command" in refused("mesh-eval", a, b, "--crop", tmp_path / "crop.json", "-o",
                                                    tmp_path / "crop.json")
    (tmp_path / "old.json").write_text('{"scenes": []}')
    assert "is an input of this command" in refused("bench", "--compare", tmp_path / "old.json", "-o",
                                                    tmp_path / "old.json")
    # Another file of this name, and a second run.
    for _ in range(2):
        run_well("mesh-eval", "a.ply", "b.ply", "--threshold", "0.1", "-o", "cameras.json", cwd=tmp_path)


@pytest.mark.parametrize("command", [["bench", "--device", "cuda:99", "-o"],
                                     ["mesh-eval", "none.ply", "none.ply", "-o"]])
def test_figures_need_a_place(tmp_path, command):
    (tmp_path / "folder.json").mkdir()
    (tmp_path / "file").write_text("")
    assert "it is a folder; name a file" in refused(*command, tmp_path / "folder.json")
    assert "--output must end in .json" in refused(*command, tmp_path)
    assert "name a file in an existing folder" in refused(*command, tmp_path / "none/x.json")
    assert "name a file in an existing folder" in refused(*command, tmp_path / "file/x.json")


def test_pack_needs_a_place_before_it_reads_photos(scene, tmp_path):
    copy = tmp_path / "room"
    shutil.copytree(scene, copy)
    (copy / "images/0003.png").write_text("damaged")  # told first if photos were read first
    line = refused("pack", copy, tmp_path / "none/x.sbscene")
    assert "x.sbscene: cannot be written: No such file" in line
    (tmp_path / "folder.sbscene").mkdir()
    assert "is a folder" in refused("pack", copy, tmp_path / "folder.sbscene")
    assert "0003.png" in refused("pack", copy, tmp_path / "x.sbscene")


def test_a_packed_scene_is_not_packed_onto_itself(scene, tmp_path):
    packed = tmp_path / "room.sbscene"
    run_well("pack", scene, packed)
    before = packed.read_bytes()
    assert "is an input of this command" in refused("pack", packed, packed)
    assert packed.read_bytes() == before


@pytest.mark.parametrize("name", ["turn.png", "turn.jpg", "turn.webm", "turn"])
def test_a_video_has_the_name_of_a_video(trained, tmp_path, name):
    line = refused("render", "-m", trained, "--orbit", "3", "--video", tmp_path / name)
    assert "must end in .mp4" in line or "needs OpenCV" in line
    assert list(tmp_path.iterdir()) == []


def test_the_next_video_removes_what_an_interrupted_one_left(trained, tmp_path):
    command = ["render", "-m", trained, "--video", tmp_path / "turn.mp4", "--orbit"]
    if run_program(*command, "2").returncode != 0:
        pytest.skip("OpenCV has no codec")
    (tmp_path / "turn.mp4").unlink()

    running = start(*command, "100000")
    while not (parts := list(tmp_path.glob(".splatboost-*-*.tmp.mp4"))):
        assert running.poll() is None
        time.sleep(0.005)
    # A video that is still being written stays.
    run_well("render", "-m", trained, "--video", tmp_path / "other.mp4", "--orbit", "2")
    assert parts[0].exists()
    running.send_signal(signal.SIGKILL)
    running.communicate(timeout=60)
    assert [path.name for path in tmp_path.iterdir() if path.name.startswith(".")] == [parts[0].name]
    run_well(*command, "2")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["other.mp4", "turn.mp4"]


def test_two_synths_do_not_mix_their_scenes(tmp_path):
    small = ["--width", "80", "--height", "60", "--points", "50"]
    first = start("synth", tmp_path / "room", *small, "--views", "2000")
    wait_for(tmp_path / "room/images/0000.png", first)
    line = refused("synth", tmp_path / "room", *small, "--views", "3", "--scene", "street")
    assert "another splatboost process is using this folder" in line and "--model" not in line
    assert '"room"' in (tmp_path / "room/synth.json").read_text()
    first.send_signal(signal.SIGKILL)
    first.communicate(timeout=60)
    # The lock ends with the process.
    run_well("synth", tmp_path / "room", *small, "--views", "3")
    run_well("synth", tmp_path / "fresh", *small, "--views", "3")
    assert content(tmp_path / "room") == content(tmp_path / "fresh")


def test_synth_waits_for_no_lock_of_a_dead_process(tmp_path):
    (tmp_path / "room").mkdir()
    (tmp_path / "room/.splatboost.lock").write_text("")
    small = ["--width", "80", "--height", "60", "--points", "50", "--views", "3"]
    with open(tmp_path / "room/.splatboost.lock") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        assert "another splatboost process" in refused("synth", tmp_path / "room", *small)
        assert os.listdir(tmp_path / "room") == [".splatboost.lock"]
    run_well("synth", tmp_path / "room", *small)
    assert not (tmp_path / "room/.splatboost.lock").exists()
