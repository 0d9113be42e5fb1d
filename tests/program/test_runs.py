# SPDX-License-Identifier: Apache-2.0
"""Runs of the program: their files, and the same bytes for the same run, interrupted or not, with any threads."""

import fcntl
import json
import os
import pathlib
import re
import resource
import shlex
import shutil
import signal
import struct
import subprocess
import time

import numpy as np
import pytest

from conftest import PROGRAM, SHORT_RUN, run_program, run_well, start, wait_for

RESULT_KEYS = {"backbone", "boost", "iterations", "psnr", "ssim", "lpips", "psnr_beta1", "primitives", "train_seconds",
               "fps", "peak_memory_bytes", "storage_bytes", "device", "threads", "seed", "version"}


def ply(model, iteration=60):
    return (model / f"point_cloud/iteration_{iteration}/point_cloud.ply").read_bytes()


def results(model):
    return json.loads((model / "results.json").read_text())


def png_size(path):
    head = path.read_bytes()[:24]
    assert head[:8] == b"\x89PNG\r\n\x1a\n"
    return struct.unpack(">II", head[16:24])


def test_train_leaves_a_full_folder(trained):
    files = {str(path.relative_to(trained)) for path in trained.rglob("*") if path.is_file()}
    tests = ["0000", "0004", "0008"]
    assert files == {"config.json", "cameras.json", "results.json", "report.html", "point_cloud/iteration_60/point_cloud.ply",
                     "checkpoints/iteration_25.ckpt", *(f"test/renders/{name}.png" for name in tests),
                     *(f"test/truth/{name}.png" for name in tests)}
    assert png_size(trained / "test/renders/0000.png") == (80, 60)

    cameras = json.loads((trained / "cameras.json").read_text())
    assert [camera["split"] for camera in cameras] == ["test"] * 3 + ["train"] * (len(cameras) - 3)
    assert cameras[0]["img_name"] == "0000.png" and (cameras[0]["width"], cameras[0]["height"]) == (80, 60)
    rows = cameras[0]["rotation"]
    assert all(abs(sum(a * b for a, b in zip(rows[i], rows[j])) - (i == j)) < 1e-5 for i in range(3) for j in range(3))
    # The room's cameras surround its centre and look at it.
    assert sum(rows[i][2] * cameras[0]["position"][i] for i in range(3)) < -1

    found = results(trained)
    assert RESULT_KEYS <= set(found)
    assert found["boost"] is True
    assert found["iterations"] == 60
    assert found["primitives"] > 50
    assert found["storage_bytes"] == len(ply(trained))
    assert 0.5 < found["estimated_memory_bytes"] / found["peak_memory_bytes"] < 2
    assert found["split"] == "test"
    assert len(found["views"]) == 3
    assert found["lpips"] is None
    assert found["psnr"] == pytest.approx(np.mean([view["psnr"] for view in found["views"]]))
    assert found["curve"][-1]["iteration"] == 60
    assert found["train_seconds"] == pytest.approx(found["curve"][-1]["seconds"])


def test_config_can_be_used_again(trained, scene, tmp_path):
    config = json.loads((trained / "config.json").read_text())
    assert config["trained"]["beta"] == 0.5
    assert config["trained"]["background"] == "black"
    assert config["source"] == str(scene)
    run_well("train", "--config", trained / "config.json", "-m", tmp_path / "again", "--quiet")
    assert ply(tmp_path / "again") == ply(trained)


def test_command_line_wins_over_the_file(scene, tmp_path):
    config = tmp_path / "config.json"
    config.write_text(json.dumps({"source": str(scene), "iterations": 7, "seed": 3, "boost": {"beta": 0.25},
                                  "threads": 1}))
    model = tmp_path / "model"
    run_well("train", "--config", config, "-m", model, "--iterations", "5", "--quiet")
    assert results(model)["iterations"] == 5
    assert results(model)["seed"] == 3
    assert results(model)["threads"] == 1
    assert json.loads((model / "config.json").read_text())["trained"]["beta"] == 0.25
    run_well("train", "--config", config, "-m", model, "--iterations", "5", "--beta", "0.75", "--quiet")
    assert json.loads((model / "config.json").read_text())["trained"]["beta"] == 0.75
    run_well("train", "--config", config, "-m", model, "--iterations", "5", "--no_boost", "--quiet")
    assert results(model)["boost"] is False
    assert json.loads((model / "config.json").read_text())["trained"]["beta"] is None
    assert json.loads((model / "config.json").read_text())["boost"]["beta"] == 0.25


@pytest.mark.parametrize("part", ["vcd", "vcp", "cb", "absgrad", "schedule"])
def test_each_part_of_the_acceleration_is_switched_off_alone(scene, trained, tmp_path, part):
    run_well("train", "-s", scene, "-m", tmp_path / "model", "--config", SHORT_RUN[-1], "--iterations", "2", f"--no-{part}")
    whole, without = (json.loads((model / "config.json").read_text())["boost"] for model in (trained, tmp_path / "model"))
    assert whole[part] is True
    assert without == whole | {part: False}


def test_resume_gives_the_bytes_of_an_uninterrupted_run(trained, tmp_path):
    model = tmp_path / "resumed"
    run_well("train", "--resume", trained / "checkpoints/iteration_25.ckpt", "-m", model, "--quiet")
    assert ply(model) == ply(trained)
    found, whole = results(model), results(trained)
    assert found["psnr"] == whole["psnr"]
    assert [(p["iteration"], p["loss"], p["psnr"]) for p in found["curve"]] == \
           [(p["iteration"], p["loss"], p["psnr"]) for p in whole["curve"]]


def test_resume_takes_a_renamed_scene(scene, trained, tmp_path):
    shutil.copytree(scene, tmp_path / "renamed")
    run_well("train", "--resume", trained / "checkpoints/iteration_25.ckpt", "-s", tmp_path / "renamed", "-m",
             tmp_path / "resumed", "--quiet")
    assert ply(tmp_path / "resumed") == ply(trained)


def test_a_coarse_start_is_taken_up_where_it_was_cut(tmp_path):
    scene = tmp_path / "room"
    run_well("synth", scene, "--width", 256, "--height", 256, "--views", 8, "--points", 300)
    settings = json.loads(pathlib.Path(SHORT_RUN[-1]).read_text())
    settings["boost"]["coarse"] = True
    config = tmp_path / "coarse.json"
    config.write_text(json.dumps(settings))
    options = ["-s", scene, *SHORT_RUN[:-1], config]  # the first 18 of 60 iterations
    whole, other, resumed = (tmp_path / name for name in ("whole", "other", "resumed"))
    run_well("train", *options, "-m", whole, "--checkpoint-iterations", "12")
    assert json.loads((whole / "config.json").read_text())["boost"]["coarse"] is True
    run_well("train", "--resume", whole / "checkpoints/iteration_12.ckpt", "-m", resumed)
    assert ply(resumed) == ply(whole)
    run_well("train", *options, "-m", other, "--no-coarse")
    assert ply(other) != ply(whole)
    run_well("train", "-s", scene, *SHORT_RUN, "-m", plain := tmp_path / "plain")
    assert ply(plain) == ply(other), "the default has none"
    published = [tmp_path / "published", tmp_path / "published_too"]
    for model, settings in zip(published, (config, SHORT_RUN[-1])):
        run_well("train", *options[:-1], settings, "-m", model, "--no-boost")
    assert ply(published[0]) == ply(published[1])


def test_points_are_added_where_the_dataset_has_none(tmp_path):
    scene = tmp_path / "room"
    run_well("synth", scene, "--width", 160, "--height", 120, "--views", 24, "--points", 300, "--samples", 1)

    def started(name, *options):
        result = run_well("train", "-s", scene, "-m", tmp_path / name, "--iterations", "1", "--threads", "1", *options)
        note = re.search(r"note: this run starts from (\d+) more points, triangulated from the photos", result.stderr)
        found = results(tmp_path / name)
        assert ("triangulation" in found["stage_seconds"]) == bool(note)
        return found["primitives"], int(note[1]) if note else 0

    config = tmp_path / "off.json"
    config.write_text('{"boost": {"fill_gaps": false}}')
    count, more = started("default")
    assert more > 500 and count == 300 + more
    assert started("off", "--config", config) == (300, 0)
    assert started("published", "--no-boost") == started("literal", "--literal") == (300, 0)
    assert started("capped", "--max-primitives", "1000") == (300, 0), "half of a cap is kept for growth"
    for backbone in ("mip-splatting", "pgsr"):
        assert started(backbone, "--backbone", backbone) == (count, more)
    assert started("dropgaussian", "--backbone", "dropgaussian") == (300, 0), "no gain in the mean"
    convexes, tracked = started("convexes", "--backbone", "convex-splatting")
    assert 20 < tracked < more / 2 and convexes == 300 + tracked, "features only"
    anchors, anchors_more = started("anchors", "--backbone", "scaffold-gs")
    assert anchors_more == tracked and anchors > started("fewer", "--backbone", "scaffold-gs", "--no-boost")[0]

    few = shutil.copytree(scene, tmp_path / "few")
    points = few / "sparse/0/points3D.bin"
    points.write_bytes(struct.pack("<Q", 20) + points.read_bytes()[8:8 + 20 * 51])  # 43 bytes, and an empty track
    run_well("train", "-s", few, "-m", tmp_path / "of_few", "--iterations", "1", "--threads", "1", "--quiet")
    assert results(tmp_path / "of_few")["primitives"] > more, "as where the dataset has none"

    run_well("compare", "-s", scene, "-m", tmp_path / "both", "--iterations", "1", "--threads", "1", "--quiet")
    counts = [results(tmp_path / "both" / run)["primitives"] for run in ("baseline", "boosted")]
    assert counts == [300, count]

    options = ["--iterations", "6", "--threads", "1", "--quiet"]
    run_well("train", "-s", scene, "-m", tmp_path / "whole", *options, "--checkpoint-iterations", "3")
    run_well("train", "--resume", tmp_path / "whole/checkpoints/iteration_3.ckpt", "-m", tmp_path / "resumed", "--quiet")
    assert ply(tmp_path / "resumed", 6) == ply(tmp_path / "whole", 6)


def ply_points(path):
    """The points of a .ply as hosts read them: float positions and normals, byte colours."""
    header, data = path.read_bytes().split(b"end_header\n", 1)
    names = [line.split()[-1] for line in header.decode().split("\n") if line.startswith("property")]
    assert names == ["x", "y", "z", "nx", "ny", "nz", "red", "green", "blue"]
    return np.frombuffer(data, [(name, "<f4") for name in names[:6]] + [(name, "u1") for name in names[6:]])


def test_points_of_a_run_are_written_for_patched_checkouts(tmp_path):
    """The file has the points of the dataset, then those that an accelerated run of the same options adds."""
    scene = tmp_path / "room"
    run_well("synth", scene, "--width", 160, "--height", 120, "--views", 24, "--points", 300, "--samples", 1)
    files = {}
    for name, options in {"all": [], "eval": ["--eval"]}.items():
        run = run_well("train", "-s", scene, "-m", tmp_path / name, "--iterations", "1", *options)
        more = int(re.search(r"starts from (\d+) more points", run.stderr)[1])
        files[name] = tmp_path / f"{name}.ply"
        written = run_well("points", "-s", scene, "-o", files[name], *options)
        assert f"(300 of the dataset, {more} added)" in written.stdout
        points = ply_points(files[name])
        assert len(points) == 300 + more and np.ptp(points["red"]) > 50
    assert ply_points(files["all"])[300:].tobytes() != ply_points(files["eval"])[300:].tobytes(), "test views are not used"

    run = run_well("train", "-s", scene, "-m", tmp_path / "convexes", "--iterations", "1", "--backbone", "convex-splatting")
    more = int(re.search(r"starts from (\d+) more points", run.stderr)[1])
    run_well("points", "-s", scene, "-o", tmp_path / "features.ply", "--features-only")
    assert len(ply_points(tmp_path / "features.ply")) == 300 + more < len(ply_points(files["all"]))

    # Written to where hosts look for points, it changes nothing for the program, which reads points3D.bin.
    run_well("points", "-s", scene, "-o", scene / "sparse/0/points3D.ply")
    again = run_well("points", "-s", scene, "-o", tmp_path / "again.ply")
    assert "(300 of the dataset" in again.stdout and (tmp_path / "again.ply").read_bytes() == files["all"].read_bytes()


def scene_without_binary_points(scene, copy):
    """A scene whose only points are those of points3D.ply."""
    shutil.copytree(scene, copy)
    run_well("points", "-s", scene, "-o", copy / "sparse/0/points3D.ply")
    (copy / "sparse/0/points3D.bin").unlink()
    return copy


def test_points_are_refused_where_none_can_be_added(scene, tmp_path):
    def error(*arguments):
        run = run_program("points", *arguments)
        assert run.returncode == 2 and not list(tmp_path.glob("*.ply")), run.stderr
        return run.stderr.splitlines()[-1]

    assert "-s/--source" in error("-o", tmp_path / "a.ply")
    assert "-o/--output" in error("-s", scene)
    assert "must end in .ply" in error("-s", scene, "-o", tmp_path / "a.bin")
    assert "cannot be written" in error("-s", scene, "-o", tmp_path / "missing/a.ply")
    run_well("synth", tmp_path / "moving", "--scene", "moving", "--width", 64, "--height", 48, "--views", 8)
    assert "do not move" in error("-s", tmp_path / "moving", "-o", tmp_path / "a.ply")
    lonely = scene_without_binary_points(scene, tmp_path / "lonely")
    shutil.copy(lonely / "sparse/0/points3D.ply", lonely / "sparse/0/dense.ply")
    assert "is a file of the scene" in error("-s", lonely, "-o", lonely / "sparse/0/dense.ply")
    before = (lonely / "sparse/0/points3D.ply").read_bytes()
    assert "would be replaced" in error("-s", lonely, "-o", lonely / "sparse/0/points3D.ply")
    shutil.move(lonely / "sparse", tmp_path / "elsewhere")
    (lonely / "sparse").symlink_to(tmp_path / "elsewhere")
    assert "would be replaced" in error("-s", lonely, "-o", lonely / "sparse/0/points3D.ply")
    assert (tmp_path / "elsewhere/0/points3D.ply").read_bytes() == before
    run_well("synth", tmp_path / "few", "--width", 64, "--height", 48, "--views", 8, "--points", 20)
    assert "no points could be added" in error("-s", tmp_path / "few", "-o", tmp_path / "a.ply"), "tiny photos"


@pytest.mark.parametrize("stop", [signal.SIGINT, signal.SIGTERM])
def test_interruption_leaves_a_checkpoint(scene, tmp_path, stop):
    long_run = ["-s", scene, "--eval", "--iterations", "2000", "--threads", "1", "--max-primitives", "1500"]
    model = tmp_path / "model"
    # In a background job SIGINT is ignored, and child processes would inherit that.
    started = subprocess.Popen([str(PROGRAM), "train", "-m", str(model), *map(str, long_run)], stderr=subprocess.PIPE,
                               stdout=subprocess.PIPE, text=True, preexec_fn=lambda: signal.signal(stop, signal.SIG_DFL))
    deadline = time.monotonic() + 60
    while not (model / "point_cloud").exists() and time.monotonic() < deadline:
        time.sleep(0.01)
    time.sleep(0.5)
    started.send_signal(stop)
    _, errors = started.communicate(timeout=60)
    assert started.returncode == 128 + stop
    [checkpoint] = (model / "checkpoints").iterdir()
    assert str(checkpoint) in errors.splitlines()[-1]
    assert "--resume" in errors.splitlines()[-1]
    assert not (model / "results.json").exists()

    done = run_well("train", "--resume", checkpoint)
    assert "report" in done.stdout
    whole = tmp_path / "whole"
    run_well("train", "-m", whole, *long_run)
    assert ply(model, 2000) == ply(whole, 2000)


def test_threads_do_not_change_the_bytes(trained, scene, tmp_path):
    for threads in (1, 2):
        model = tmp_path / f"threads{threads}"
        run_well("train", "-s", scene, "-m", model, *SHORT_RUN, "--threads", threads)
        assert ply(model) == ply(trained)


def test_threads_are_no_more_than_the_cpus_of_the_process(scene, tmp_path):
    cpu = min(os.sched_getaffinity(0))
    command = [str(PROGRAM), "train", "-s", scene, "-m", tmp_path / "model", "--iterations", "5", "--quiet"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False,
                          preexec_fn=lambda: os.sched_setaffinity(0, {cpu}))
    assert done.returncode == 0, done.stderr
    assert results(tmp_path / "model")["threads"] == 1


def test_seed_changes_the_bytes(trained, scene, tmp_path):
    run_well("train", "-s", scene, "-m", tmp_path / "model", *SHORT_RUN, "--seed", "1")
    assert ply(tmp_path / "model") != ply(trained)


def test_saving_on_the_way_does_not_change_the_run(trained, scene, tmp_path):
    model = tmp_path / "model"
    run_well("train", "-s", scene, "-m", model, *SHORT_RUN, "--save-iterations", "10,30", "--checkpoint_iterations",
             "20", "40")
    assert sorted(path.name for path in (model / "point_cloud").iterdir()) == \
           ["iteration_10", "iteration_30", "iteration_60"]
    assert sorted(path.name for path in (model / "checkpoints").iterdir()) == ["iteration_20.ckpt", "iteration_40.ckpt"]
    assert ply(model) == ply(trained)


def test_a_run_replaces_an_older_one(trained, tmp_path):
    model = tmp_path / "model"
    shutil.copytree(trained, model)
    run_well("render", "-m", model, "--orbit", "2")
    (model / "sequence").mkdir()
    (model / "sequence/00000.ply").write_text("ply")
    run_well("train", "--config", model / "config.json", "-m", model, "--iterations", "5", "--quiet")
    assert not (model / "orbit").exists() and not (model / "sequence").exists()
    assert [path.name for path in (model / "point_cloud").iterdir()] == ["iteration_5"]
    assert (model / "checkpoints/iteration_25.ckpt").exists()


def test_cap_on_primitives_holds(scene, tmp_path):
    run_well("train", "-s", scene, "-m", tmp_path / "model", *SHORT_RUN, "--max-primitives", "250")
    assert results(tmp_path / "model")["primitives"] <= 250


def test_without_test_views_the_training_views_are_measured(scene, tmp_path):
    run_well("train", "-s", scene, "-m", tmp_path / "model", "--iterations", "5", "--quiet")
    assert results(tmp_path / "model")["split"] == "train"
    assert len(list((tmp_path / "model/train/renders").iterdir())) == 10


def test_progress_is_plain_lines_when_not_on_a_terminal(scene, tmp_path):
    done = run_well("train", "-s", scene, "-m", tmp_path / "model", "--iterations", "20")
    lines = [line for line in done.stderr.splitlines() if "20/20" in line]
    assert len(lines) == 1
    for word in ("loss", "primitives", "it/s", "left"):
        assert word in lines[0]
    assert "\r" not in done.stderr


def test_compare_writes_all_files(scene, tmp_path):
    model = tmp_path / "both"
    done = run_well("compare", "-s", scene, "-m", model, *SHORT_RUN)
    for run in ("baseline", "boosted"):
        for name in ("config.json", "results.json", "report.html", "point_cloud/iteration_60/point_cloud.ply",
                     "test/renders/0004.png", "test/truth/0004.png"):
            assert (model / run / name).is_file(), f"{run}/{name}"
    assert (model / "report.html").is_file()
    found = json.loads((model / "compare.json").read_text())
    assert {"baseline", "boosted", "ratios"} <= set(found)
    assert found["baseline"]["boost"] is False
    assert found["boosted"]["boost"] is True
    assert found["baseline"]["seed"] == found["boosted"]["seed"]
    assert found["baseline"]["psnr"] == results(model / "baseline")["psnr"]
    assert found["boosted"]["peak_memory_bytes"] > 0
    assert "PSNR" in done.stdout
    assert str(model / "report.html") in done.stdout
    # The folder of a comparison may be overwritten by another, and each run equals one by train.
    run_well("compare", "-s", scene, "-m", model, *SHORT_RUN)
    run_well("train", "-s", scene, "-m", tmp_path / "alone", *SHORT_RUN, "--no-boost")
    assert ply(tmp_path / "alone") == ply(model / "baseline")


def without_times(value):
    varying = {"train_seconds", "seconds", "stage_seconds", "fps", "peak_memory_bytes", "estimated_memory_bytes",
               "date", "command", "ratios"}
    if isinstance(value, dict):
        return {key: without_times(inner) for key, inner in value.items() if key not in varying}
    return [without_times(inner) for inner in value] if isinstance(value, list) else value


def interrupt(process, run):
    """Interrupts a comparison in this run. @return the arguments of the command that it says resumes it"""
    wait_for(run / "point_cloud", process)
    time.sleep(0.2)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 128 + signal.SIGINT, errors
    command = shlex.split(errors.splitlines()[-1].partition("resume with: ")[2])
    assert command[0] == "splatboost"
    return command[1:]


def test_an_interrupted_comparison_is_resumed_by_the_command_it_prints(scene, tmp_path):
    options = ["-s", scene, "--eval", "--iterations", "4000", "--threads", "1", "--max-primitives", "1500"]
    model, whole = tmp_path / "it's both", tmp_path / "whole"
    command = interrupt(start("compare", "-m", model, *options), model / "baseline")
    assert command == ["compare", "--resume", str(model)]
    # A checkpoint of a run with other settings is not taken, though it is of a later iteration.
    run_well("train", "-s", scene, "-m", tmp_path / "other", *SHORT_RUN, "--checkpoint-iterations", "25")
    shutil.copyfile(tmp_path / "other/checkpoints/iteration_25.ckpt",
                    model / "baseline/checkpoints/iteration_3999.ckpt")
    assert interrupt(start(*command), model / "boosted") == command
    trained = results(model / "baseline")["date"]
    assert str(model / "report.html") in run_well(*command).stdout
    assert results(model / "baseline")["date"] == trained, "a finished run is kept"
    run_well("compare", "-m", whole, *options)
    for run in ("baseline", "boosted"):
        assert ply(model / run, 4000) == ply(whole / run, 4000)
    found, expected = (json.loads((folder / "compare.json").read_text()) for folder in (model, whole))
    assert without_times(found) == without_times(expected)
    pictures = [(folder / "report.html").read_text().count("<img") for folder in (model, whole)]
    assert pictures[0] == pictures[1]


def test_eval_finds_the_same_results(trained, tmp_path):
    model = tmp_path / "model"
    shutil.copytree(trained, model)
    done = run_well("eval", "-m", model)
    assert "PSNR" in done.stdout
    before, after = results(trained), results(model)
    for key in ("psnr", "ssim", "psnr_beta1", "views", "primitives", "train_seconds", "curve"):
        assert after[key] == before[key], key


def test_eval_of_another_scene_keeps_the_results_of_the_run(scene, trained, tmp_path):
    model, moved, other = tmp_path / "model", tmp_path / "moved", tmp_path / "other"
    shutil.copytree(trained, model)
    before = (model / "results.json").read_bytes()
    run_well("synth", other, "--width", 80, "--height", 60, "--views", 10, "--points", 300, "--seed", 5)
    done = run_well("eval", "-m", model, "-s", other)
    assert "PSNR" in done.stdout and "results.json was not changed" in done.stdout
    assert (model / "results.json").read_bytes() == before
    # The run's own scene, from another folder.
    shutil.copytree(scene, moved)
    assert f"results: {model / 'results.json'}" in run_well("eval", "-m", model, "-s", moved).stdout
    assert (model / "results.json").read_bytes() != before  # frames per second, at least
    # What the run left unmeasured is not measured on another scene.
    (model / "results.json").rename(model / "training.json")
    refused = run_program("eval", "-m", model, "-s", other)
    assert refused.returncode == 2 and "without --source" in refused.stderr, refused.stderr
    assert not (model / "results.json").exists()


@pytest.mark.parametrize("backbone", ["mip-splatting", "dropgaussian", "pgsr", "photo-slam"])
def test_other_backbones_run_through_all_commands(scene, tmp_path, backbone):
    config = tmp_path / "config.json"
    config.write_text(json.dumps({"backbone": {"name": backbone, "opacity_reset_interval": 100000,
                                               "densify_interval": 5}, "boost": {"densify_interval": 5, "tau_d": 1}}))
    run = ["-s", scene, "--eval", "--llffhold", "4", "--n-views", "6", "--iterations", "60", "--config", config]
    model = tmp_path / "both"
    done = run_well("compare", "-m", model, *run)
    assert "1 (trained)" in done.stdout and "1/4" in done.stdout
    found = json.loads((model / "compare.json").read_text())
    for which in ("baseline", "boosted"):
        assert found[which]["backbone"] == backbone
        assert [scale["divisor"] for scale in found[which]["scales"]] == [1, 2, 4]  # at 1/8 an image is 10×7
        assert found[which]["scales"][0]["psnr"] == pytest.approx(found[which]["psnr"])
    alone = tmp_path / "alone"
    run_well("train", "-m", alone, *run, "--checkpoint-iterations", "25", "--threads", "1", "--quiet")
    assert ply(alone) == ply(model / "boosted")
    run_well("train", "--resume", alone / "checkpoints/iteration_25.ckpt", "-m", tmp_path / "resumed", "--quiet")
    assert ply(tmp_path / "resumed") == ply(alone)
    before = results(alone)
    assert "1/2" in run_well("eval", "-m", alone).stdout
    for key in ("psnr", "ssim", "psnr_beta1", "views", "scales", "primitives"):
        assert results(alone)[key] == before[key], key
    run_well("render", "-m", alone, "-o", tmp_path / "shown")
    assert (tmp_path / "shown/test/renders/0004.png").read_bytes() == (alone / "test/renders/0004.png").read_bytes()


def test_a_backbone_has_a_length_of_its_own(scene, tmp_path):
    # --max-primitives keeps iterations fast; the run is interrupted long before its 10 000 iterations.
    started = subprocess.Popen([str(PROGRAM), "train", "-s", str(scene), "-m", str(tmp_path / "model"), "--backbone",
                                "dropgaussian", "--max-primitives", "5"], stderr=subprocess.PIPE,
                               stdout=subprocess.DEVNULL, text=True)
    deadline = time.monotonic() + 60
    while not (tmp_path / "model/point_cloud").exists() and time.monotonic() < deadline:
        time.sleep(0.01)
    started.send_signal(signal.SIGTERM)
    started.communicate(timeout=60)
    assert json.loads((tmp_path / "model/config.json").read_text())["iterations"] == 10000


def test_render_all_views(trained, tmp_path):
    run_well("render", "-m", trained, "-o", tmp_path)
    assert len(list((tmp_path / "test/renders").iterdir())) == 3
    assert len(list((tmp_path / "train/renders").iterdir())) == 7
    assert (tmp_path / "test/renders/0004.png").read_bytes() == (trained / "test/renders/0004.png").read_bytes()


def test_render_orbit(trained, tmp_path):
    model = shutil.copytree(trained, tmp_path / "model")
    run_well("render", "-m", model, "--orbit", "5")
    pictures = sorted((model / "orbit").iterdir())
    assert [path.name for path in pictures] == [f"{i:05d}.png" for i in range(5)]
    assert png_size(pictures[0]) == (80, 60)
    assert len({path.read_bytes() for path in pictures}) == 5
    run_well("render", "-m", model, "--orbit", "3")
    assert sorted((model / "orbit").iterdir()) == pictures[:3], "the rest of a longer series is of other cameras"


def test_render_video_or_say_why_not(trained, tmp_path):
    done = run_program("render", "-m", trained, "--orbit", "4", "--video", tmp_path / "turn.mp4", "--fps", "5")
    if done.returncode == 0:
        data = (tmp_path / "turn.mp4").read_bytes()
        assert len(data) > 500
        # The header of the track: version, flags and two dates, then the units of a second and the length in units.
        scale, length = struct.unpack(">II", data.split(b"mdhd", 1)[1][12:20])
        assert length / scale == pytest.approx(4 / 5)
    else:
        assert done.returncode == 2
        assert "PNG" in done.stderr
    done = run_program("render", "-m", trained, "--orbit", "4", "--video", tmp_path / "turn.xyz")
    assert done.returncode == 2
    assert [path.name for path in tmp_path.iterdir() if path.name != "turn.mp4"] == []


def test_an_incomplete_video_does_not_replace_a_complete_one(trained, tmp_path):
    video = tmp_path / "turn.mp4"
    command = [str(PROGRAM), "render", "-m", trained, "--orbit", "60", "--video", video]
    if run_program(*command[1:]).returncode != 0:
        pytest.skip("OpenCV has no codec")
    before = video.read_bytes()
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False,
                          preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (2048, 2048)))
    assert done.returncode == 1
    assert len(done.stderr.splitlines()) == 1 and "incomplete" in done.stderr
    assert video.read_bytes() == before
    assert list(tmp_path.iterdir()) == [video]


def test_a_video_replaces_no_pipe_and_no_link(trained, tmp_path):
    pipe, link = tmp_path / "pipe.mp4", tmp_path / "link.mp4"
    os.mkfifo(pipe)
    done = run_program("render", "-m", trained, "--orbit", "4", "--video", pipe)
    assert done.returncode == 2 and "is a device or a pipe" in done.stderr and pipe.is_fifo()
    (tmp_path / "turn.mp4").write_bytes(b"old")
    link.symlink_to("turn.mp4")
    done = run_program("render", "-m", trained, "--orbit", "4", "--video", link)
    if done.returncode == 0:  # OpenCV has a codec
        assert link.is_symlink() and (tmp_path / "turn.mp4").stat().st_size > 500


def test_a_video_needs_no_lock_on_the_model(trained, tmp_path):
    with open(trained / ".splatboost.lock", "w") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        done = run_program("render", "-m", trained, "--orbit", "4", "--video", tmp_path / "turn.mp4")
        pictures = run_program("render", "-m", trained, "--orbit", "4")
        (trained / ".splatboost.lock").unlink()
    assert done.returncode == 0 or "OpenCV" in done.stderr
    assert pictures.returncode == 2 and "another splatboost process" in pictures.stderr


def test_synth_is_deterministic(tmp_path):
    for name in ("a", "b"):
        run_well("synth", tmp_path / name, "--width", 40, "--height", 30, "--views", 3, "--points", 50)
    a = {str(p.relative_to(tmp_path / "a")): p.read_bytes() for p in (tmp_path / "a").rglob("*") if p.is_file()}
    b = {str(p.relative_to(tmp_path / "b")): p.read_bytes() for p in (tmp_path / "b").rglob("*") if p.is_file()}
    assert a == b


def test_literal_does_not_take_the_constants_of_the_default(scene, trained, tmp_path):
    """config.json of a run holds all constants, which would replace the paper's under the name of literal."""
    done = run_program("train", "-s", scene, "-m", tmp_path / "model", "--config", trained / "config.json", "--literal")
    assert done.returncode == 2 and "--literal would not change; leave out one of them" in done.stderr
    assert not (tmp_path / "model").exists()
