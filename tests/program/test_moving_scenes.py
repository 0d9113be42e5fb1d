# SPDX-License-Identifier: Apache-2.0
"""deformable-3dgs with every command, on a dynamic scene: train, resume, render at given times, eval."""

import json

import pytest

from conftest import run_program, run_well

SHORT = ["--eval", "--iterations", "60", "--quiet"]


@pytest.fixture(scope="module")
def moving(tmp_path_factory):
    folder = tmp_path_factory.mktemp("data") / "moving"
    run_well("synth", folder, "--scene", "moving", "--width", 64, "--height", 48, "--views", 12, "--points", 200)
    return folder


@pytest.fixture(scope="module")
def config(tmp_path_factory):
    path = tmp_path_factory.mktemp("config") / "config.json"
    path.write_text(json.dumps({
        "backbone": {"name": "deformable-3dgs", "net_layers": 3, "net_width": 32, "densify_interval": 10},
        "boost": {"views": 3, "densify_interval": 10}}))
    return path


@pytest.fixture(scope="module")
def both(moving, config, tmp_path_factory):
    folder = tmp_path_factory.mktemp("trained") / "both"
    run_well("compare", "-s", moving, "-m", folder, *SHORT, "--config", config)
    return folder


def model_bytes(model):
    folder = model / "point_cloud/iteration_60"
    return (folder / "point_cloud.ply").read_bytes() + (folder / "parameters.bin").read_bytes()


def test_a_new_run_replaces_an_earlier_one_and_its_models_at_times(moving, config, tmp_path):
    run = ["train", "-s", moving, "-m", tmp_path / "run", "--config", config, "--iterations", 3, "--quiet"]
    run_well(*run)
    run_well("render", "-m", tmp_path / "run", "--sequence", 2, "--quiet")
    run_well("render", "-m", tmp_path / "run", "--orbit", 2, "--quiet")
    run_well(*run, "--seed", 1)
    assert not (tmp_path / "run/sequence").exists() and not (tmp_path / "run/orbit").exists()
    assert (tmp_path / "run/point_cloud/iteration_3/parameters.bin").is_file()


def test_compare_resume_and_eval(moving, config, both, tmp_path):
    for run in ("baseline", "boosted"):
        found = json.loads((both / run / "results.json").read_text())
        assert found["backbone"] == "deformable-3dgs"
        assert found["storage_bytes"] == len(model_bytes(both / run))
        assert found["psnr"] > 8
        assert {"net_forward", "net_backward"} <= found["stage_seconds"].keys()
        assert len(list((both / run / "test/times").iterdir())) == 6
    assert (both / "report.html").read_text().count("time 0.40") >= 2
    settings = json.loads((both / "boosted/config.json").read_text())
    assert settings["backbone"]["is_blender"] is True

    run_well("train", "-s", moving, "-m", tmp_path / "cut", *SHORT, "--config", config, "--checkpoint-iterations", "25")
    assert model_bytes(tmp_path / "cut") == model_bytes(both / "boosted")
    run_well("train", "--resume", tmp_path / "cut/checkpoints/iteration_25.ckpt", "-m", tmp_path / "resumed", "--quiet")
    assert model_bytes(tmp_path / "resumed") == model_bytes(tmp_path / "cut")

    before = json.loads((both / "boosted/results.json").read_text())
    run_well("eval", "-m", both / "boosted", "--quiet")
    assert json.loads((both / "boosted/results.json").read_text())["psnr"] == before["psnr"]


def test_times_are_rendered(both, tmp_path):
    model = both / "boosted"
    run_well("render", "-m", model, "-o", tmp_path / "own", "--quiet")
    run_well("render", "-m", model, "-o", tmp_path / "still", "--time", "0.5", "--quiet")
    name = "test/renders/0000.png"
    assert (tmp_path / "own" / name).read_bytes() == (model / name).read_bytes()
    assert (tmp_path / "still" / name).read_bytes() != (model / name).read_bytes()
    run_well("render", "-m", model, "-o", tmp_path / "stand", "--orbit", "3", "--view", "0001", "--quiet")
    run_well("render", "-m", model, "-o", tmp_path / "walk", "--orbit", "3", "--time", "0", "--quiet")
    for way in ("stand", "walk"):
        assert len({file.read_bytes() for file in (tmp_path / way / "orbit").iterdir()}) == 3
    run_well("render", "-m", model, "-o", tmp_path / "models", "--sequence", "2", "--quiet")
    files = sorted((tmp_path / "models/sequence").iterdir())
    assert [file.name for file in files] == ["00000.ply", "00001.ply"]
    still = (model / "point_cloud/iteration_60/point_cloud.ply").read_bytes()
    assert len({files[0].read_bytes(), files[1].read_bytes(), still}) == 3
    assert len(files[0].read_bytes()) == len(still)


def test_a_moving_model_is_rendered_from_the_cameras_of_a_still_scene(both, scene, tmp_path):
    for time in ("0", "1"):
        run_well("render", "-m", both / "boosted", "-s", scene, "-o", tmp_path / time, "--time", time, "--quiet")
    first, last = (sorted((tmp_path / time / "test/renders").iterdir()) for time in ("0", "1"))
    assert first and [file.read_bytes() for file in first] != [file.read_bytes() for file in last]


@pytest.mark.parametrize("arguments, word", [
    (["--time", "1.5"], "--time must be in [0, 1]"),
    (["--sequence", "0"], "--sequence must be 1 to 100000"),
    (["--view", "0001"], "--view requires --video or --orbit"),
    (["--orbit", "2", "--view", "nobody"], "no view 'nobody'"),
    (["--orbit", "2", "--view", "0001", "--time", "0"], "leave out --time"),
])
def test_impossible_renders_are_refused(both, tmp_path, arguments, word):
    done = run_program("render", "-m", both / "boosted", "-o", tmp_path / "x", "--quiet", *arguments)
    assert done.returncode == 2
    assert word in done.stderr
    assert not (tmp_path / "x").exists()


def test_still_scenes_and_still_models_are_refused_in_one_line(scene, trained, tmp_path):
    done = run_program("train", "--backbone", "deformable-3dgs", "-s", scene, "-m", tmp_path / "model", "--quiet")
    assert done.returncode == 2
    assert "training views have the same time" in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert not (tmp_path / "model").exists()
    done = run_program("render", "-m", trained, "--sequence", "3", "-o", tmp_path / "x", "--quiet")
    assert done.returncode == 2
    assert "does not change with time" in done.stderr


def test_a_mesh_is_of_one_time(both, tmp_path):
    model = both / "boosted"
    refused = run_program("mesh", "-m", model, "-o", tmp_path / "mesh.ply")
    if "OpenVDB" in refused.stderr:
        pytest.skip("this build makes no meshes")
    assert refused.returncode == 2 and refused.stderr.count("\n") == 1 and "--time T" in refused.stderr
    for time in ("0", "1"):
        done = run_well("mesh", "-m", model, "--time", time, "--voxel-size", "0.05", "-o", tmp_path / f"{time}.ply")
        assert "fused 12 of 12 views" in done.stderr  # not on a terminal: plain lines
    assert (tmp_path / "0.ply").read_bytes() != (tmp_path / "1.ply").read_bytes()


def test_a_backbone_for_still_scenes_says_that_it_ignores_times(moving, config, tmp_path):
    done = run_well("train", "-s", moving, "-m", tmp_path / "still", "--iterations", "2")
    assert done.stderr.count("different times, which backbone vanilla ignores") == 1
    done = run_well("train", "-s", moving, "-m", tmp_path / "moving", "--iterations", "2", "--config", config)
    assert "ignores" not in done.stderr


def test_a_packed_scene_carries_the_times_that_it_was_packed_with(scene, tmp_path):
    """A COLMAP scene has times with --frame-times; runs on the folder and on the packed file give the same bytes."""
    run = ["--backbone", "deformable-3dgs", "--eval", "--iterations", "12", "--quiet", "--frame-times"]
    config = tmp_path / "config.json"
    config.write_text(json.dumps({"backbone": {"net_layers": 2, "net_width": 16, "warm_up": 0}}))
    run_well("pack", scene, tmp_path / "moving.sbscene", "--frame-times")
    models = {}
    for name, source in (("folder", scene), ("file", tmp_path / "moving.sbscene")):
        run_well("train", "-s", source, "-m", tmp_path / name, "--config", config, *run)
        folder = tmp_path / name / "point_cloud/iteration_12"
        models[name] = (folder / "point_cloud.ply").read_bytes() + (folder / "parameters.bin").read_bytes()
    assert models["file"] == models["folder"]
    run_well("pack", scene, tmp_path / "still.sbscene", "--frames", "3")  # only used for rigs, as in a run
    done = run_program("train", "-s", tmp_path / "still.sbscene", "-m", tmp_path / "x", *run)
    assert done.returncode == 2
    assert "packed without times" in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert not (tmp_path / "x").exists()
