# SPDX-License-Identifier: Apache-2.0
"""`splatboost render` leaves the pictures that a run was measured on, and other runs."""
import json
import shutil

import pytest
from conftest import refused, run_program, run_well


@pytest.fixture(scope="module")
def run(trained, tmp_path_factory):
    folder = tmp_path_factory.mktemp("renders") / "run"
    shutil.copytree(trained, folder)
    return folder


def pictures(folder):
    return {path: path.read_bytes() for path in folder.rglob("*.png")}


@pytest.mark.parametrize("option", [("--iteration", 60), ("--beta", 1)])
def test_other_pictures_need_a_folder_of_their_own(run, tmp_path, option):
    before = pictures(run)
    done = run_program("render", "-m", run, *option)
    assert done.returncode == 2 and option[0] + ": these pictures would replace" in done.stderr and "--output" in done.stderr
    assert pictures(run) == before
    run_well("render", "-m", run, *option, "-o", tmp_path / "new")
    assert (tmp_path / "new/test/renders/0004.png").is_file()


def test_pictures_of_another_scene_need_a_folder_of_their_own(run, tmp_path):
    run_well("synth", tmp_path / "other", "--width", 80, "--height", 60, "--views", 10, "--points", 300, "--seed", 5)
    before = pictures(run)
    done = run_program("render", "-m", run, "-s", tmp_path / "other")
    assert done.returncode == 2 and "another scene than that of the run" in done.stderr
    assert pictures(run) == before
    run_well("render", "-m", run, "-s", tmp_path / "other", "-o", tmp_path / "new")


def test_another_run_is_no_folder_for_pictures(run, trained, tmp_path):
    other = tmp_path / "other"
    shutil.copytree(trained, other)
    before = pictures(other)
    done = run_program("render", "-m", run, "-o", other)
    assert done.returncode == 2 and "is the folder of another run" in done.stderr
    assert pictures(other) == before
    run_well("render", "-m", run, "-o", run)  # its own


def test_files_of_the_scene_are_not_replaced(run, scene, tmp_path):
    shutil.copytree(run, tmp_path / "run")
    config = json.loads((tmp_path / "run/config.json").read_text())
    scene, run = shutil.copytree(scene, tmp_path / "copy"), tmp_path / "run"
    (run / "config.json").write_text(json.dumps({**config, "source": str(scene)}))
    (tmp_path / "scene").symlink_to(scene)
    for arguments, place in (((), "test/renders/0004.png"), (("--orbit", 2), "orbit/00001.png")):
        photo = scene / place
        photo.parent.mkdir(parents=True)
        photo.write_text("the only copy")
        for folder in (scene, tmp_path / "scene"):
            assert "in the folder of the scene" in refused("render", "-m", run, "-o", folder, *arguments)
        assert photo.read_text() == "the only copy"
        assert list(photo.parent.iterdir()) == [photo] and not (scene / "train").exists()


def test_places_that_cannot_be_written_are_refused_first(run, tmp_path):
    (tmp_path / "file").write_text("")
    assert "file: is not a folder" in refused("render", "-m", run, "-o", tmp_path / "file/renders")
    assert "none" in refused("render", "-m", run, "--video", tmp_path / "none/a.mp4")
    assert "is in the folder of saved models" in refused("render", "-m", run, "--video", run / "point_cloud/a.mp4")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


@pytest.mark.parametrize("rate", ["0.001", "0", "240.5", "1e9"])
def test_the_frame_rate_of_a_video_has_a_range(run, tmp_path, rate):
    assert "--fps must be 1 to 240" in refused("render", "-m", run, "--video", tmp_path / "a.mp4", "--orbit", 2, "--fps", rate)
    assert list(tmp_path.iterdir()) == []


def test_a_video_has_no_output_folder(run, tmp_path):
    line = refused("render", "-m", run, "--video", tmp_path / "a.mp4", "--orbit", 2, "-o", tmp_path / "pictures")
    assert "--output has no effect with --video" in line
    assert list(tmp_path.iterdir()) == []


def test_a_model_without_time_is_not_asked_for_a_folder(run):
    assert "--time: a model of backbone vanilla does not change with time" in refused("render", "-m", run, "--time", 0.5)


def test_a_circle_needs_cameras_at_two_places(run, scene, tmp_path):
    single = tmp_path / "single"
    run_well("train", "-s", scene, "-m", single, "--eval", "--llffhold", 4, "--n-views", 1, "--iterations", 2, "--quiet")
    for option, name in ((["--orbit", 6], "--orbit"), (["--video", tmp_path / "a.mp4"], "--video")):
        line = refused("render", "-m", single, "--quiet", *option)
        assert f"{name}: the training cameras look at the scene from one place only" in line
    assert not (single / "orbit").exists() and not (tmp_path / "a.mp4").exists()
    run_well("render", "-m", run, "--orbit", 6, "-o", tmp_path / "circle")
    assert len(set(pictures(tmp_path / "circle").values())) == 6


def test_one_picture_is_no_plural(run, tmp_path):
    assert run_well("render", "-m", run, "--orbit", 1, "-o", tmp_path / "one").stdout.startswith("1 render: ")
    assert run_well("render", "-m", run, "--orbit", 2, "-o", tmp_path / "two").stdout.startswith("2 renders: ")
    done = run_program("render", "-m", run, "--orbit", 1, "--video", tmp_path / "a.mp4")
    assert done.stdout.startswith("video of 1 frame: ") or "OpenCV" in done.stderr
