# SPDX-License-Identifier: Apache-2.0
"""What goes wrong is told in one line that says what to do, with exit code 2 for what a user can mend."""

import json
import shutil
import subprocess

import pytest

from conftest import PROGRAM, run_program


def fails(*arguments, code=2):
    """@return the one line on the error stream"""
    done = run_program(*arguments)
    lines = done.stderr.splitlines()
    assert done.returncode == code, done.stderr
    assert len(lines) == 1, done.stderr
    assert done.stdout == ""
    assert lines[0].startswith("splatboost")
    return lines[0]


def test_no_arguments_lists_the_commands():
    line = fails()
    assert "train, compare, render, eval, synth" in line
    assert "splatboost --help" in line


@pytest.mark.parametrize("wrong, right", [("trian", "train"), ("rendr", "render"), ("compair", "compare")])
def test_unknown_command_suggests_the_nearest(wrong, right):
    assert f"did you mean {right}?" in fails(wrong)


@pytest.mark.parametrize("wrong, right", [("--iteratons", "--iterations"), ("--max-primitve", "--max-primitives"),
                                          ("--checkpoint", "--checkpoint-iterations"), ("--sede=4", "--seed")])
def test_unknown_option_suggests_the_nearest(wrong, right):
    line = fails("train", wrong, "5")
    assert f"did you mean {right}?" in line
    assert "splatboost train --help" in line


def test_unknown_option_without_a_near_one():
    assert "unknown option --xyzzy" in fails("train", "--xyzzy")


def test_stray_argument():
    assert "'photos'" in fails("train", "photos")


@pytest.mark.parametrize("command", ["train", "compare"])
def test_missing_source_names_option_and_synth(command):
    line = fails(command, "-m", "somewhere")
    assert "-s/--source" in line
    assert "splatboost synth" in line


def test_missing_output_folder(scene):
    assert "-m/--model" in fails("train", "-s", scene)


@pytest.mark.parametrize("arguments, name", [
    (["--iterations", "many"], "--iterations"), (["--iterations", "0"], "--iterations"), (["--beta", "0"], "--beta"),
    (["--beta", "1.5"], "--beta"), (["--threads", "-1"], "--threads"), (["--views", "0"], "--views"),
    (["--tau-d", "-1"], "--tau-d"), (["--max-primitives", "-3"], "--max-primitives"), (["--seed", "-1"], "--seed"),
    (["--resolution", "0"], "--resolution"), (["--save-iterations", "0"], "--save-iterations"),
    (["--backbone", "none"], "--backbone"), (["--device", "tpu"], "--device"),
    (["--device", "cuda:x"], "--device"), (["--device", "cuda:-1"], "--device"), (["--device", "cuda:1x"], "--device")])
def test_impossible_values(scene, tmp_path, arguments, name):
    length = [] if name == "--iterations" else ["--iterations", "2"]
    assert name in fails("train", "-s", scene, "-m", tmp_path / "model", *length, *arguments)
    assert not (tmp_path / "model").exists()


@pytest.mark.parametrize("device", ["cuda", "cuda:999"])
def test_a_gpu_that_is_not_there(scene, tmp_path, device):
    if device == "cuda" and shutil.which("nvidia-smi"):
        pytest.skip("there may be one")
    line = fails("train", "-s", scene, "-m", tmp_path / "model", "--device", device)
    assert "no CUDA" in line
    assert "--device cpu" in line
    assert not (tmp_path / "model").exists()


def test_config_that_is_not_json(scene, tmp_path):
    config = tmp_path / "config.json"
    config.write_text('{"iterations": 5,\n oops}')
    line = fails("train", "-s", scene, "-m", tmp_path / "model", "--config", config)
    assert str(config) in line
    assert "line 2" in line


@pytest.mark.parametrize("content, names", [
    ({"iteratons": 5}, ["iteratons", "did you mean iterations?"]),
    ({"iterations": "five"}, ["iterations", "whole number"]),
    ({"iterations": 1e30}, ["iterations", "whole number"]),
    ({"iterations": 99999999999}, ["iterations", "range"]),
    ({"backbone": {"sh_degre": 2}}, ["sh_degre"]),
    ({"backbone": {"sh_degree": "two"}}, ["sh_degree"]),
    ({"backbone": 7}, ["backbone"]),
    ({"backbone": {"name": "mip-splatting", "low_pass": 0}}, ["mip-splatting", "low_pass", "above 0"]),
    ({"backbone": {"name": "dropgaussian", "drop_rate": 1.5}}, ["dropgaussian", "drop_rate", "[0, 1)"]),
    ({"backbone": {"name": "dropgaussian", "low_pass": 0.1}}, ["dropgaussian", "low_pass"]),
    ({"boost": {"bata": 0.5}}, ["bata"]),
    ({"boost": {"beta": 7}}, ["beta"]),
    ({"boost": {"coarse_until": 1.2}}, ["coarse_until", "[0, 1]"]),
    ({"backbone": "scaffold-gs", "boost": {"coarse_until": -1}}, ["coarse_until", "[0, 1]"]),
    ({"boost": "yes"}, ["boost"]),
    ([1, 2], ["object"])])
def test_config_with_wrong_keys_or_values(scene, tmp_path, content, names):
    config = tmp_path / "config.json"
    config.write_text(json.dumps(content))
    line = fails("train", "-s", scene, "-m", tmp_path / "model", "--config", config)
    for name in names:
        assert name in line


def test_config_that_is_not_there(scene, tmp_path):
    assert "no such file" in fails("train", "-s", scene, "-m", tmp_path / "model", "--config", tmp_path / "none.json")


def test_source_that_is_not_there(tmp_path):
    assert "/nowhere" in fails("train", "-s", "/nowhere", "-m", tmp_path / "model")


def test_source_without_a_dataset(tmp_path):
    (tmp_path / "empty").mkdir()
    assert "empty" in fails("train", "-s", tmp_path / "empty", "-m", tmp_path / "model")


def test_source_without_images(scene, tmp_path):
    copy = tmp_path / "room"
    subprocess.run(["cp", "-r", scene, copy], check=True)
    subprocess.run(["rm", "-r", copy / "images"], check=True)
    assert "images" in fails("train", "-s", copy, "-m", tmp_path / "model")


@pytest.mark.parametrize("command", ["train", "compare"])
def test_foreign_folder_is_not_touched(scene, tmp_path, command):
    model = tmp_path / "thesis"
    model.mkdir()
    (model / "chapter1.tex").write_text("precious")
    (model / "config.json").write_text("{}")
    line = fails(command, "-s", scene, "-m", model)
    assert "thesis" in line
    assert sorted(path.name for path in model.iterdir()) == ["chapter1.tex", "config.json"]


def test_model_that_is_a_file(scene, tmp_path):
    (tmp_path / "file").write_text("x")
    assert "not a folder" in fails("train", "-s", scene, "-m", tmp_path / "file")


@pytest.mark.parametrize("command", ["render", "eval"])
def test_commands_that_need_a_model(tmp_path, command):
    assert "-m/--model" in fails(command)
    assert "no such model folder" in fails(command, "-m", tmp_path / "none")
    assert "config.json" in fails(command, "-m", tmp_path)


def test_model_whose_run_did_not_end(trained, tmp_path):
    (tmp_path / "config.json").write_bytes((trained / "config.json").read_bytes())
    assert "no model was saved" in fails("render", "-m", tmp_path)


def test_truncated_model(trained, tmp_path):
    saved = tmp_path / "point_cloud/iteration_60"
    saved.mkdir(parents=True)
    (tmp_path / "config.json").write_bytes((trained / "config.json").read_bytes())
    whole = (trained / "point_cloud/iteration_60/point_cloud.ply").read_bytes()
    (saved / "point_cloud.ply").write_bytes(whole[:-100])
    assert "point_cloud.ply" in fails("render", "-m", tmp_path)


def test_checkpoints_that_are_none(trained, tmp_path):
    assert "no such checkpoint" in fails("train", "--resume", tmp_path / "none.ckpt", "-m", tmp_path / "model")
    whole = (trained / "checkpoints/iteration_25.ckpt").read_bytes()
    bad = tmp_path / "run/checkpoints/iteration_25.ckpt"
    bad.parent.mkdir(parents=True)
    (tmp_path / "run/config.json").write_bytes((trained / "config.json").read_bytes())
    for content, what in [(whole[:-10], "truncated"), (b"PK\3\4" + whole, "not a checkpoint"), (b"", "truncated"),
                          (whole + b"x", "damaged"), (whole[:6] + b"99" + whole[8:], "version 99")]:
        bad.write_bytes(content)
        line = fails("train", "--resume", bad)
        assert what in line
        assert "iteration_25.ckpt" in line


@pytest.mark.parametrize("arguments, name", [(["--seed", "5"], "seed"), (["--iterations", "61"], "iterations"),
                                             (["--no-boost"], "boost"), (["--beta", "0.7"], "beta"),
                                             (["--n-views", "4"], "training views"),
                                             (["--max-primitives", "9999"], "max-primitives")])
def test_checkpoint_of_another_run(trained, tmp_path, arguments, name):
    line = fails("train", "--resume", trained / "checkpoints/iteration_25.ckpt", "-m", tmp_path / "model", *arguments)
    assert name in line
    assert "resume with the settings of that run" in line


def test_help_is_help():
    for command in ([], ["train"], ["compare"], ["render"], ["eval"], ["synth"]):
        done = run_program(*command, "--help")
        assert done.returncode == 0
        assert done.stderr == ""
        assert len(done.stdout.splitlines()) < 60
        assert max(map(len, done.stdout.splitlines())) <= 120


def test_version():
    done = run_program("--version")
    assert done.returncode == 0
    assert done.stdout.startswith("splatboost ")


def test_unwritable_output(scene):
    line = fails("train", "-s", scene, "-m", "/proc/splatboost-out", "--iterations", "1")
    assert "/proc/splatboost-out" in line
    assert PROGRAM.exists()
