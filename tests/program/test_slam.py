# SPDX-License-Identifier: Apache-2.0
"""splatboost slam: a short synthetic walk, tracked and mapped."""

import json
import os
import re
import shutil
import signal
import time

import numpy as np
import pytest

from conftest import content, killed_at, refused, run_program, run_well, start, wait_for, write_png

FRAMES = 12


def make_walk(folder, width, height):
    """The first frames of a walk of 120: with fewer frames in all they would be too far apart."""
    run_well("synth", folder, "--scene", "walk", "--width", width, "--height", height, "--views", 120, "--samples", 1)
    for number in range(FRAMES, 120):
        for kind in ("frame", "depth"):
            (folder / "results" / f"{kind}{number:06}.png").unlink()
    return folder


@pytest.fixture(scope="module")
def walk(tmp_path_factory):
    return make_walk(tmp_path_factory.mktemp("walk") / "walk", 160, 120)


SMALL = ["--features", 400, "--initial-keyframes", 3, "--quiet"]
SHORT = ["--lockstep", 3, "--iterations", 40, *SMALL]


@pytest.fixture(scope="module")
def mapped(walk, tmp_path_factory):
    folder = tmp_path_factory.mktemp("mapped") / "model"
    done = run_program("slam", "-s", walk, "-m", folder, *SHORT, "--threads", 1)
    if "cannot track a camera" in done.stderr:
        assert done.returncode == 2 and done.stderr.count("\n") == 1
        pytest.skip("this build has no Ceres")
    assert done.returncode == 0, done.stderr
    return folder


def test_a_run_leaves_all_it_promises(mapped):
    results = json.loads((mapped / "results.json").read_text())
    slam = results["slam"]
    assert slam["tracked"] == slam["frames"] == FRAMES and slam["lost"] == 0
    # Other parts of the walk have 2 to 11 cm in pictures as small as these; test_tracker.cpp is about accuracy.
    assert slam["ate_rmse"] < 0.04 and slam["path_length"] > 0.5
    assert slam["depth"] is True and slam["ate_alignment"] == "rigid" and slam["ate_scale"] == pytest.approx(1)
    assert slam["keyframes"]["frames"] >= 3 and results["psnr"] > 12 and results["split"] == "tracked"
    assert len(results["views"]) == FRAMES and results["backbone"] == "photo-slam"
    lines = (mapped / "trajectory.txt").read_text().splitlines()
    assert len(lines) == FRAMES and all(len(line.split()) == 8 for line in lines)
    assert len((mapped / "keyframes.txt").read_text().splitlines()) == slam["keyframes"]["frames"]
    cameras = json.loads((mapped / "cameras.json").read_text())
    assert len(cameras) == slam["keyframes"]["frames"]
    for camera, line in zip(cameras, (mapped / "keyframes.txt").read_text().splitlines()):
        assert camera["position"] == pytest.approx([float(word) for word in line.split()[1:4]], abs=1e-4)
    assert (mapped / f"point_cloud/iteration_{results['iterations']}/point_cloud.ply").is_file()
    report = (mapped / "report.html").read_text()
    assert "Where the camera was" in report and report.count("data:image/jpeg") >= 6


def test_lockstep_gives_the_same_bytes_for_any_number_of_threads(walk, mapped, tmp_path):
    run_well("slam", "-s", walk, "-m", tmp_path / "again", *SHORT, "--threads", 3)
    for name in ("trajectory.txt", "keyframes.txt"):
        assert (mapped / name).read_bytes() == (tmp_path / "again" / name).read_bytes(), name
    models = [next(folder.glob("point_cloud/*/point_cloud.ply")) for folder in (mapped, tmp_path / "again")]
    assert models[0].parent.name == models[1].parent.name
    assert models[0].read_bytes() == models[1].read_bytes()


def test_tracking_and_mapping_run_at_once(walk, mapped, tmp_path):
    del mapped  # skips without Ceres
    run_well("slam", "-s", walk, "-m", tmp_path / "free", "--iterations", 30, "--features", 400, "--quiet",
             "--initial-keyframes", 3, "--no-boost")
    results = json.loads((tmp_path / "free/results.json").read_text())
    assert results["iterations"] >= 30 and not results["boost"] and results["slam"]["tracked"] == FRAMES


def test_a_time_limit_ends_mapping(walk, mapped, tmp_path):
    del mapped
    run_well("slam", "-s", walk, "-m", tmp_path / "timed", "--seconds", 3, *SMALL)
    results = json.loads((tmp_path / "timed/results.json").read_text())
    assert results["train_seconds"] >= 3 and results["slam"]["sequence_seconds"] < results["train_seconds"]
    assert results["iterations"] > results["slam"]["iterations_in_sequence"]
    # A config's time limit gives way to what the command line says.
    run_well("slam", "-m", tmp_path / "again", "--config", tmp_path / "timed/config.json", "--iterations", 20, "--quiet")
    assert json.loads((tmp_path / "again/config.json").read_text())["slam"].get("seconds") is None
    run_well("slam", "-m", tmp_path / "lockstep", "--config", tmp_path / "timed/config.json", "--lockstep", 1, "--quiet",
             "--iterations", 20)


def test_a_run_that_ends_with_the_sequence_has_the_last_changes_of_the_map(walk, mapped, tmp_path):
    del mapped
    run_well("slam", "-s", walk, "-m", tmp_path / "model", "--seconds", 0, *SMALL)
    results = json.loads((tmp_path / "model/results.json").read_text())
    # The iteration after the sequence inserts what waits: the features of up to ten keyframes.
    in_sequence = results["slam"]["iterations_in_sequence"]
    assert results["iterations"] > in_sequence
    before = [point["primitives"] for point in results["curve"] if point["iteration"] <= in_sequence]
    assert results["primitives"] > before[-1]


def test_a_run_killed_while_it_measures_is_measured_by_eval(walk, mapped, tmp_path):
    del mapped
    model = tmp_path / "model"
    # The second operation there, after the folder was made, is the first picture of a tracked frame.
    killed_at(model / "test/renders", 2, "slam", "-s", walk, "-m", model, *SHORT)
    before = json.loads((model / "results.json").read_text())
    assert before["slam"]["tracked"] == FRAMES and before["slam"]["ate_rmse"] < 0.04
    run_well("eval", "-m", model)
    after = json.loads((model / "results.json").read_text())
    assert after["psnr"] > 12 and after["slam"] == before["slam"]
    assert not (model / "test").exists()
    pictures = {kind: {file.name for file in (model / "train" / kind).iterdir()} for kind in ("renders", "truth")}
    assert len(pictures["renders"]) == before["slam"]["keyframes"]["frames"] and pictures["renders"] == pictures["truth"]
    report = (model / "report.html").read_text()
    assert "trajectory: ATE" in report and "Where the camera was" in report and report.count("data:image/jpeg") >= 6


def test_eval_of_a_run_without_results_says_to_run_slam_again(mapped, tmp_path):
    shutil.copytree(mapped, tmp_path / "model")
    (tmp_path / "model/results.json").unlink()
    done = run_program("eval", "-m", tmp_path / "model")
    assert done.returncode == 2 and done.stderr.count("\n") == 1
    assert "the run did not finish; run splatboost slam again" in done.stderr and "--resume" not in done.stderr


def test_a_run_that_is_stopped_before_mapping_leaves_an_earlier_one(walk, mapped, tmp_path):
    model = tmp_path / "model"
    shutil.copytree(mapped, model)
    before = content(model)
    slow = tmp_path / "walk"
    shutil.copytree(walk, slow)
    (slow / "results/frame000007.png").unlink()
    os.mkfifo(slow / "results/frame000007.png")
    running = start("slam", "-s", slow, "-m", model, "--features", 400, "--initial-keyframes", 100, "--quiet")
    with open(slow / "results/frame000007.png", "wb"):  # waits for the run to read this frame
        running.send_signal(signal.SIGINT)
        time.sleep(0.2)
    output, errors = running.communicate(timeout=60)
    assert running.returncode == 128 + signal.SIGINT and output == ""
    line = errors.splitlines()[-1]
    assert line.startswith("interrupted after frame ") and "before mapping began; nothing was written" in line
    assert f"{model} still holds the earlier run" in line
    assert content(model) == before


@pytest.mark.parametrize("option, place", [
    ("--calibration", "keyframes/images/mine.json"), ("--config", "test/renders/mine.json"),
    ("--lpips", "train/renders/mine.onnx")])
def test_inputs_among_the_results_are_kept(walk, mapped, tmp_path, option, place):
    model = tmp_path / "model"
    shutil.copytree(mapped, model)
    (model / place).parent.mkdir(parents=True, exist_ok=True)
    (model / place).write_text("{}")
    before = content(model)
    done = run_program("slam", "-s", walk, "-m", model, *SHORT, option, model / place)
    assert done.returncode == 2 and done.stderr.count("\n") == 1
    assert f"{model / place}: was not written by a run, and a new run in {model} would delete it" in done.stderr
    assert content(model) == before


def test_eval_of_a_run_that_was_killed_while_it_tracked_says_to_run_slam_again(mapped, tmp_path):
    shutil.copytree(mapped, tmp_path / "model")
    config = json.loads((tmp_path / "model/config.json").read_text())
    (tmp_path / "model/config.json").write_text(json.dumps({**config, "source": str(tmp_path / "model/keyframes")}))
    shutil.rmtree(tmp_path / "model/keyframes")
    (tmp_path / "model/results.json").unlink()
    assert "the run did not finish; run splatboost slam again" in refused("eval", "-m", tmp_path / "model")


def test_a_video_of_the_sequence_is_not_replaced(walk, mapped):
    film = walk / "film.mp4"
    film.write_bytes(b"the camera's own")
    done = run_program("render", "-m", mapped, "--video", film, "--orbit", 2)
    assert done.returncode == 2 and "in the folder of the scene" in done.stderr
    assert film.read_bytes() == b"the camera's own"
    film.unlink()


def test_keyframes_are_a_scene(mapped, tmp_path):
    run_well("train", "-s", mapped / "keyframes", "-m", tmp_path / "model", "--iterations", 5, "--quiet")
    run_well("render", "-m", mapped, "-o", tmp_path / "pictures")
    assert len(list((tmp_path / "pictures").rglob("*.png"))) >= 3
    config = json.loads((mapped / "config.json").read_text())
    assert config["slam"]["lockstep"] == 3 and config["slam"]["source"].endswith("walk")


def test_eval_keeps_what_was_measured_on_all_tracked_frames(mapped, tmp_path):
    model = tmp_path / "model"
    shutil.copytree(mapped, model)
    before = (model / "results.json").read_bytes()
    done = run_well("eval", "-m", model)
    assert "PSNR" in done.stdout and "train views" in done.stdout
    assert "results.json was not changed, because it is for all tracked frames" in done.stdout
    assert (model / "results.json").read_bytes() == before


def test_a_run_that_was_moved_is_measured_on_its_own_keyframes(mapped, tmp_path):
    def psnr(folder):
        return [line for line in run_well("eval", "-m", folder).stdout.splitlines() if line.startswith("PSNR")]

    there, moved = tmp_path / "there", tmp_path / "moved"
    shutil.copytree(mapped, there)
    shutil.copytree(mapped, moved)
    config = json.loads((moved / "config.json").read_text()) | {"source": str(there / "keyframes")}
    (moved / "config.json").write_text(json.dumps(config))
    first, *others = sorted((there / "keyframes/images").iterdir())  # now of another run
    for image in others:
        shutil.copyfile(first, image)
    assert psnr(moved) == psnr(mapped) != psnr(there)
    run_well("render", "-m", moved)  # its own scene, also for the pictures in its folder
    shutil.rmtree(there)
    assert psnr(moved) == psnr(mapped)


def test_a_run_is_repeated_by_its_config(mapped, tmp_path):
    run_well("slam", "-m", tmp_path / "again", "--config", mapped / "config.json", "--quiet")
    assert (mapped / "trajectory.txt").read_bytes() == (tmp_path / "again/trajectory.txt").read_bytes()


def test_bad_frames_are_told_and_left_out(walk, mapped, tmp_path):
    del mapped
    folder = tmp_path / "walk"
    shutil.copytree(walk, folder)
    (folder / "results/frame000003.png").write_bytes(b"nothing")
    (folder / "results/depth000005.png").unlink()
    done = run_well("slam", "-s", folder, "-m", tmp_path / "model", *SHORT)
    assert re.search(r"frame 3 .*frame000003.png.*left out", done.stderr)
    assert re.search(r"frame 5 .*tracked by colour alone", done.stderr)
    slam = json.loads((tmp_path / "model/results.json").read_text())["slam"]
    assert slam["dropped"] == 1 and slam["tracked"] == FRAMES - 1


@pytest.mark.parametrize("stop, endless, wait", [
    (signal.SIGINT, ["--lockstep", 100000], 1),  # in the sequence
    (signal.SIGTERM, ["--iterations", 1000000], 1),  # in it or after it
    (signal.SIGINT, ["--lockstep", 0], 0)])  # in it, before the first iteration
def test_a_run_that_is_stopped_keeps_what_it_has(walk, mapped, tmp_path, stop, endless, wait):
    del mapped
    model = tmp_path / "model"
    running = start("slam", "-s", walk, "-m", model, *SMALL, *endless)
    wait_for(model / "config.json", running)
    time.sleep(wait)
    running.send_signal(stop)
    output, errors = running.communicate(timeout=60)
    assert running.returncode == 128 + stop, errors
    [line] = errors.splitlines()
    assert "interrupted after frame" in line and "keyframes, model and results so far are in" in line
    assert output == ""
    results = json.loads((model / "results.json").read_text())
    slam = results["slam"]
    assert slam["complete"] is False and slam["tracked"] >= 3 and slam["ate_rmse"] < 0.1 and results["psnr"] is None
    assert slam["tracked"] < FRAMES or stop == signal.SIGTERM
    assert (results["iterations"] == 0) == (wait == 0)
    assert len((model / "trajectory.txt").read_text().splitlines()) == slam["tracked"]
    assert len(list((model / "keyframes/images").iterdir())) == slam["keyframes"]["frames"] >= 3
    assert (model / f"point_cloud/iteration_{results['iterations']}/point_cloud.ply").is_file()
    run_well("eval", "-m", model)
    measured = json.loads((model / "results.json").read_text())
    assert measured["psnr"] > (12 if results["iterations"] else 8) and measured["slam"] == slam
    assert measured["split"] == "train"
    report = (model / "report.html").read_text()
    assert f"interrupted after frame {slam['tracked'] + slam['lost']} of {FRAMES}" in report
    assert f"{measured['psnr']:.2f} dB" in report and "Where the camera was" in report


def without_a_map(walk, tmp_path, *arguments, depth=None, color=None):
    """Standard error of a run on the walk, with this image in place of all depth or colour images."""
    folder = tmp_path / "walk"
    shutil.copytree(walk, folder)
    for kind, pixels in (("depth", depth), ("frame", color)):
        for file in folder.glob(f"results/{kind}*") if pixels is not None else []:
            write_png(file, pixels)
    done = run_program("slam", "-s", folder, "-m", tmp_path / "model", *SHORT, *arguments)
    assert done.returncode == 2 and not (tmp_path / "model").exists(), done.stderr
    return done.stderr


def test_black_photos_are_named_as_the_reason(walk, mapped, tmp_path):
    del mapped
    [line] = without_a_map(walk, tmp_path, color=np.zeros((120, 160, 3), "u1")).splitlines()
    assert f"in {FRAMES} of {FRAMES} frames the colour image has fewer than 50 features (at most 0)" in line
    assert "depth_scale" not in line


@pytest.mark.parametrize("depth, words", [
    (np.full((120, 160), 9, "u1"), "depth images must have one 16-bit channel"),
    (np.full((60, 80), 9000, "u2"), "has 80x60 pixels, but the calibration has 160x120"),
    (np.zeros((120, 160), "u2"), "contains no depth values")])
def test_depth_that_cannot_be_used_is_named_as_the_reason(walk, mapped, tmp_path, depth, words):
    del mapped
    *frames, line = without_a_map(walk, tmp_path, depth=depth).splitlines()
    assert len(frames) == 5 and all(words in frame and "tracked by colour" not in frame for frame in frames)
    assert "; left out, because a map begins with depth" in frames[0]
    assert f"in {FRAMES} of {FRAMES} frames there is no depth that can be used; see the messages about single frames" in line


def test_depth_out_of_range_is_named_as_the_reason(walk, mapped, tmp_path):
    del mapped
    [line] = without_a_map(walk, tmp_path, "--max-depth", 0.5).splitlines()
    nearest = re.search(r"most features are beyond --max-depth, 0\.5 m: the nearest is ([0-9.]+) m away", line)
    assert nearest and 0.5 < float(nearest[1]) < 3
    shutil.rmtree(tmp_path / "walk")
    camera = json.loads((walk / "cam_params.json").read_text())["camera"]
    (tmp_path / "camera.json").write_text(json.dumps(camera | {"scale": 1e12}))
    [line] = without_a_map(walk, tmp_path, "--calibration", tmp_path / "camera.json").splitlines()
    assert "most features are nearer than 0.1 m" in line and "check depth_scale" in line


def test_more_iterations_than_asked_for_are_told_once(walk, mapped, tmp_path):
    del mapped
    run = ["slam", "-s", walk, "--features", 400, "--initial-keyframes", 3, "--lockstep", 20]
    done = run_well(*run, "-m", tmp_path / "few", "--iterations", 20)
    [line] = re.findall("note: mapping takes .*", done.stderr)
    total, asked, before = map(int, re.findall(r"\d+", line))
    assert asked == 20 and before >= 20 and total == 2 * (before + 1), line
    assert json.loads((tmp_path / "few/results.json").read_text())["iterations"] == total
    done = run_well(*run, "-m", tmp_path / "enough", "--iterations", total)
    assert "note: mapping takes" not in done.stderr
    done = run_well(*run[:-1], 0, "-m", tmp_path / "none", "--iterations", 1, "--first-frame", 1, "--stride", 2, "--no-loops")
    assert "note: mapping takes" not in done.stderr
    slam = json.loads((tmp_path / "none/results.json").read_text())["slam"]
    assert slam["frames"] == FRAMES // 2 and slam["loops"] == 0
    assert min(file.name for file in (tmp_path / "none/keyframes/images").iterdir()) == "frame000001.png"
    assert json.loads((tmp_path / "none/config.json").read_text())["slam"]["no-loops"] is True


def test_one_keyframe_is_no_plural(walk, mapped, tmp_path):
    del mapped
    done = run_well("slam", "-s", walk, "-m", tmp_path / "model", "--frames", 1, "--lockstep", 1, "--iterations", 3)
    assert ", 1 keyframe, " in done.stdout and "  1 keyframe  " in done.stderr


@pytest.mark.parametrize("arguments, words", [
    (["-r", 3], "resolution 3 is not possible"),
    (["-r", 9], "the divisors 1, 2, 4, 8, or a width of at least 16 px"),
    (["--calibration", "nowhere.json"], "nowhere.json"),
    (["--lockstep", 1, "--seconds", 1], "cannot be combined"),
    (["--seconds", 1], "--iterations and --seconds cannot be combined"),
    (["--features", 5], "--features must be"),
    (["--stride", 0], "--stride must be"),
    (["--backbone", "vanilla"], "vanilla cannot train on views that arrive during training"),
])
def test_mistakes_are_one_line(walk, mapped, tmp_path, arguments, words):
    del mapped
    done = run_program("slam", "-s", walk, "-m", tmp_path / "model", "--quiet", "--iterations", 5, *arguments)
    assert done.returncode == 2 and done.stderr.count("\n") == 1 and words in done.stderr, done.stderr
    assert not (tmp_path / "model").exists()


@pytest.mark.parametrize("name, settings, words", [
    ("config.json", {"backbone": {"name": "photo-slam", "foo": 1}}, "unknown key 'foo'"),
    ("config.json", {"backbone": {"name": "photo-slam", "pyramid_levels": 99}}, "pyramid_levels must be 0 to 8"),
    ("config.json", {"backbone": "vanilla"}, "vanilla cannot train on views that arrive"),
    ("model", {}, "model: is not a folder")])
def test_settings_are_checked_before_tracking(walk, mapped, tmp_path, name, settings, words):
    del mapped
    (tmp_path / name).write_text(json.dumps(settings))
    given = ["--config", tmp_path / name] if settings else []
    done = run_program("slam", "-s", walk, "-m", tmp_path / "model/of/run", *given)  # not quiet: tracking would print lines
    assert done.returncode == 2 and done.stderr.count("\n") == 1 and words in done.stderr, done.stderr


def test_images_too_small_for_lpips_are_refused_before_tracking(walk, mapped, lpips_network, tmp_path):
    del mapped
    done = run_program("slam", "-s", walk, "-m", tmp_path / "model", *SHORT, "-r", 8, "--lpips", lpips_network)
    assert done.returncode == 2 and done.stderr.count("\n") == 1
    assert "--lpips" in done.stderr and "has 20×15" in done.stderr
    assert not (tmp_path / "model").exists()


def test_a_calibration_that_is_wrong_never_crashes(walk, mapped, tmp_path):
    del mapped
    (tmp_path / "camera.json").write_text(json.dumps(
        {"width": 160, "height": 120, "fx": 20, "fy": 400, "cx": 3, "cy": 110, "depth_scale": 20}))
    done = run_program("slam", "-s", walk, "-m", tmp_path / "model", *SHORT, "--calibration", tmp_path / "camera.json")
    assert done.returncode in (0, 2), done.stderr
    assert "calibration" in done.stderr


def camera_of(walk, file):
    """A calibration without depth_scale, so that depth images are not used."""
    camera = json.loads((walk / "cam_params.json").read_text())["camera"]
    del camera["scale"]
    file.write_text(json.dumps(camera))
    return file


def test_without_depth_a_walk_is_tracked_up_to_its_scale(mapped, tmp_path):
    del mapped
    walk = make_walk(tmp_path / "walk", 320, 240)  # without depth, smaller images are tracked less accurately
    camera = camera_of(walk, tmp_path / "camera.json")
    shown = [argument for argument in SHORT if argument != "--quiet"]
    done = run_well("slam", "-s", walk, "-m", tmp_path / "model", *shown, "-r", 2, "--calibration", camera)
    assert "tracked without depth" in done.stderr and "after alignment with scale" in done.stdout
    results = json.loads((tmp_path / "model/results.json").read_text())
    slam = results["slam"]
    assert slam["depth"] is False and slam["ate_alignment"] == "similarity" and slam["ate_scale"] > 1
    assert slam["ate_rmse"] < 0.03 and slam["path_length"] > 1 and slam["lost"] == 0 and slam["keyframes"]["frames"] >= 3
    assert slam["tracked"] + slam["waiting"] == FRAMES and slam["tracked"] >= 6
    assert results["psnr"] > 12
    run_well("slam", "-m", tmp_path / "again", "--config", tmp_path / "model/config.json")
    for name in ("trajectory.txt", f"point_cloud/iteration_{results['iterations']}/point_cloud.ply"):
        assert (tmp_path / "model" / name).read_bytes() == (tmp_path / "again" / name).read_bytes(), name


def test_without_depth_a_camera_that_stands_still_is_one_line(walk, mapped, tmp_path):
    del mapped
    (tmp_path / "images").mkdir()
    for number in range(FRAMES):
        shutil.copy(walk / "results/frame000000.png", tmp_path / f"images/{number}.png")
    camera_of(walk, tmp_path / "calibration.json")
    done = run_program("slam", "-s", tmp_path, "-m", tmp_path / "model", *SHORT)
    assert done.returncode == 2 and done.stderr.count("\n") == 1, done.stderr
    assert "nothing could be tracked" in done.stderr and "the camera must move sideways" in done.stderr
    assert not (tmp_path / "model").exists()


def test_what_is_wrong_with_a_video_is_one_line(walk, mapped, tmp_path):
    del mapped
    (tmp_path / "walk.mp4").write_text("no video")
    done = run_program("slam", "-s", tmp_path / "walk.mp4", "-m", tmp_path / "model", "--calibration",
                       camera_of(walk, tmp_path / "camera.json"))
    assert done.returncode == 2 and done.stderr.count("\n") == 1, done.stderr
    assert "walk.mp4: OpenCV cannot read the video" in done.stderr or "a video needs OpenCV" in done.stderr
    assert not (tmp_path / "model").exists()
