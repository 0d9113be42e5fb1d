# SPDX-License-Identifier: Apache-2.0
"""Errors are reported in one line that says what to do, with exit code 2 if the user can fix them."""

import json
import os
import pathlib
import re
import resource
import shutil
import struct
import subprocess
import tempfile

import pytest

from conftest import PROGRAM, png, refused as fails, run_program, run_well


def test_no_arguments_lists_the_commands():
    line = fails()
    assert "train, compare, render, eval, mesh" in line
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
    assert "unknown option --xyzzy (see" in fails("train", "--xyzzy")
    assert "unknown option --beta (see" in fails("eval", "--beta", "0.5")


def test_an_option_before_its_command():
    assert "--threads must come after the command" in fails("--threads", "4", "train")


def test_a_second_command_is_told(scene):
    assert "only one command can be given: eval stands after train" in fails("train", "-s", scene, "eval", "-m", "out")


def test_an_option_given_twice(scene):
    line = fails("train", "-s", scene, "-m", "out", "--iterations", "5", "--iterations", "6")
    assert "--iterations is given more than once" in line
    assert "--boost is given more than once" in fails("train", "-s", scene, "-m", "out", "--boost", "--no-boost")


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
    (["--threads", "100000"], "--threads"), (["--iterations", ""], "--iterations"), (["--beta", ""], "--beta"),
    (["--seed", "99999999999999999999999"], "--seed"), (["--iterations", "99999999999"], "--iterations"),
    (["--max-primitives", "18446744073709551616"], "--max-primitives"), (["--beta", "nan"], "--beta"),
    (["--save-iterations", ""], "--save-iterations"),
    (["--config", ""], "--config"), (["--resume", ""], "--resume"), (["--test-list", ""], "--test-list"),
    (["--lpips", ""], "--lpips"), (["--iterations", "1e3"], "--iterations"), (["--n-views", "3x"], "--n-views"),
    (["--resolution", "0"], "--resolution"), (["--save-iterations", "0"], "--save-iterations"),
    (["--backbone", "none"], "--backbone"), (["--device", "tpu"], "--device"),
    (["--device", "cuda:x"], "--device"), (["--device", "cuda:-1"], "--device"), (["--device", "cuda:1x"], "--device")])
def test_impossible_values(scene, tmp_path, arguments, name):
    length = [] if "--iterations" in arguments else ["--iterations", "2"]
    assert name in fails("train", "-s", scene, "-m", tmp_path / "model", *length, *arguments)
    assert not (tmp_path / "model").exists()


@pytest.mark.parametrize("arguments", [["--beta", "0.5"], ["--tau-d", "5"], ["--views", "3"], ["--literal"],
                                       ["--no-vcd"], ["--no-vcp"], ["--no-cb"], ["--no-absgrad"], ["--no-schedule"],
                                       ["--no-coarse"]])
def test_options_without_a_meaning_for_a_published_run(scene, tmp_path, arguments):
    for command in ("train", "slam") if arguments != ["--no-coarse"] else ("train",):
        line = fails(command, "-s", scene, "-m", tmp_path / "model", "--no-boost", *arguments)
        assert f"{arguments[0]} has no effect without acceleration" in line


@pytest.mark.parametrize("command", ["train", "compare"])
@pytest.mark.parametrize("option, switches", [(["--beta", "0.5"], ["--no-cb"]), (["--tau-d", "5"], ["--no-vcd"]),
                                              (["--views", "3"], ["--no-vcd", "--no-vcp"])])
def test_options_of_a_part_that_is_switched_off(scene, tmp_path, command, option, switches):
    line = fails(command, "-s", scene, "-m", tmp_path / "model", *option, *switches)
    assert f"{option[0]} has no effect with {' and '.join(switches)}" in line


def test_a_scene_that_was_moved_is_named_with_its_run(scene, trained, tmp_path):
    shutil.copytree(trained, tmp_path / "model")
    config = tmp_path / "model/config.json"
    config.write_text(config.read_text().replace(str(scene), str(tmp_path / "moved")))
    for command in ("eval", "render", "mesh"):  # mesh needs OpenVDB
        done = run_program(command, "-m", tmp_path / "model")
        assert done.returncode == 2
        assert "OpenVDB" in done.stderr or "moved: does not exist; the run in" in done.stderr and "--source" in done.stderr


@pytest.mark.parametrize("command", ["train", "compare"])
def test_test_views_need_eval(scene, tmp_path, command):
    line = fails(command, "-s", scene, "-m", tmp_path / "model", "--llffhold", "4")
    assert "--llffhold has no effect without --eval" in line


def test_a_frame_rate_needs_a_video(trained):
    assert "--fps requires --video" in fails("render", "-m", trained, "--orbit", "3", "--fps", "5")


@pytest.mark.parametrize("command", ["train", "compare"])
@pytest.mark.parametrize("option", ["--save-iterations", "--checkpoint-iterations"])
def test_iterations_after_the_end(scene, tmp_path, command, option):
    run = [command, "-s", scene, "-m", tmp_path / "model", "--iterations", "5"]
    assert f"{option}: 6 is after the end of the run, 5 iterations" in fails(*run, option, "2,6")
    assert not (tmp_path / "model").exists()


@pytest.mark.parametrize("option, number", [("--iterations", "0100"), ("--seed", "00"), ("--resolution", "-01"),
                                            ("--save-iterations", "5,010")])
def test_numbers_that_would_be_octal(scene, tmp_path, option, number):
    line = fails("train", "-s", scene, "-m", tmp_path / "model", option, number)
    assert option in line and "must not begin with 0" in line


def test_views_too_small_for_lpips(lpips_network, tmp_path):
    scene, model = tmp_path / "room", tmp_path / "model"
    run_well("synth", scene, "--width", 40, "--height", 30, "--views", 4, "--points", 50)
    for command in ("train", "compare"):
        line = fails(command, "-s", scene, "-m", model, "--iterations", "2", "--lpips", lpips_network)
        assert "--lpips" in line and "'0000.png' has 40×30" in line
        assert not model.exists()
    run_well("train", "-s", scene, "-m", model, "--iterations", "2", "--quiet")
    config = json.loads((model / "config.json").read_text())
    (model / "config.json").write_text(json.dumps(config | {"lpips": str(lpips_network)}))
    assert "LPIPS is not measured" in run_well("eval", "-m", model).stderr
    assert json.loads((model / "results.json").read_text())["lpips"] is None
    assert "40×30" in fails("eval", "-m", model, "--lpips", lpips_network)


def test_a_run_whose_lpips_network_was_moved_can_be_measured(trained, tmp_path):
    model = tmp_path / "model"
    shutil.copytree(trained, model)
    config = json.loads((model / "config.json").read_text())
    (model / "config.json").write_text(json.dumps(config | {"lpips": str(tmp_path / "gone.onnx")}))
    assert "LPIPS is not measured" in run_well("eval", "-m", model).stderr
    assert "give --lpips its path" in fails("eval", "-m", model, "--lpips", tmp_path / "gone.onnx")


def test_a_zero_byte_in_a_name_does_not_end_the_message(tmp_path):
    scene = tmp_path / "room"
    run_well("synth", scene, "--width", 40, "--height", 30, "--views", 4, "--points", 50)
    (tmp_path / "list.txt").write_bytes(b"a\0b\n")
    line = fails("train", "-s", scene, "-m", tmp_path / "model", "--eval", "--test-list", tmp_path / "list.txt")
    assert "'a\\x00b'" in line


@pytest.mark.parametrize("device", ["cuda", "cuda:999"])
def test_a_gpu_that_is_not_there(scene, tmp_path, device):
    if device == "cuda" and shutil.which("nvidia-smi"):
        pytest.skip("there may be a GPU")
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
    ({"iterations": 0}, ["config.json: iterations must be at least 1"]),
    ({"threads": -1}, ["config.json: threads must be 0 to"]),
    ({"iterations": 99999999999}, ["iterations", "range"]),
    ({"backbone": {"sh_degre": 2}}, ["sh_degre"]),
    ({"backbone": {"sh_degree": "two"}}, ["sh_degree"]),
    ({"backbone": 7}, ["backbone"]),
    ({"backbone": {"name": "mip-splatting", "low_pass": 0}}, ["mip-splatting", "low_pass", "above 0"]),
    ({"backbone": {"name": "dropgaussian", "drop_rate": 1.5}}, ["dropgaussian", "drop_rate", "[0, 1)"]),
    ({"backbone": {"name": "dropgaussian", "low_pass": 0.1}}, ["dropgaussian", "low_pass"]),
    ({"backbone": {"release": "2025"}}, ["release", "2023", "2024"]),
    ({"boost": {"bata": 0.5}}, ["bata"]),
    ({"boost": {"densify_until": 20000}}, ["densify_until 20000", "backbone's, 15000"]),
    ({"boost": {"beta": 7}}, ["beta"]),
    ({"boost": {"coarse_until": 1.2}}, ["coarse_until", "[0, 1]"]),
    ({"backbone": "scaffold-gs", "boost": {"coarse_until": -1}}, ["coarse_until", "[0, 1]"]),
    ({"boost": "yes"}, ["boost"]),
    ({"bogus": None}, ["unknown key 'bogus'"]),
    ({"boost": {"taud": None}}, ["unknown key 'taud'"]),
    ({"boost": {"tau_d": None}}, ["tau_d", "a number"]),
    ({"boost": None}, ["boost must be"]),
    ({"backbone": {"sh_degree": None}}, ["sh_degree"]),
    ({"backbone": None}, ["backbone must be"]),
    ({"seed": None}, ["seed", "whole number"]),
    ({"config": "other.json"}, ["a settings file cannot name another one"]),
    ([1, 2], ["object"])])
def test_config_with_wrong_keys_or_values(scene, tmp_path, content, names):
    config = tmp_path / "config.json"
    config.write_text(json.dumps(content))
    line = fails("train", "-s", scene, "-m", tmp_path / "model", "--config", config)
    for name in names:
        assert name in line


def test_config_with_nulls_that_mean_the_default(scene, tmp_path):
    config = tmp_path / "config.json"
    config.write_text(json.dumps({"resolution": None, "beta": None, "trained": {"beta": None}}))
    run_well("train", "-s", scene, "-m", tmp_path / "model", "--iterations", "2", "--config", config, "--quiet")
    run_well("train", "-s", scene, "-m", tmp_path / "again", "--config", tmp_path / "model/config.json", "--quiet")


def test_config_with_a_key_twice(scene, tmp_path):
    config = tmp_path / "config.json"
    config.write_text('{"iterations": 5, "boost": {"beta": 0.5}, "iterations": 6}')
    line = fails("train", "-s", scene, "-m", tmp_path / "model", "--config", config)
    assert f"{config}: the key 'iterations' occurs twice" in line


@pytest.mark.parametrize("content, names", [({"iterations": "five"}, ["iterations", "whole number"]),
                                            ({"seed": None}, ["seed", "whole number"]),
                                            ({"backbone": {"name": 3}}, ["name", "string"])])
def test_config_is_checked_also_where_the_command_line_overrides_it(scene, tmp_path, content, names):
    config = tmp_path / "config.json"
    config.write_text(json.dumps(content))
    line = fails("train", "-s", scene, "-m", tmp_path / "model", "--config", config, "--iterations", "2", "--seed", "1",
                 "--backbone", "vanilla")
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


@pytest.mark.parametrize("place", ["train", "orbit/deeper", "keyframes/notes.txt", "report.html", "orbit/mine.png",
                                   "point_cloud/iteration_60/mine.ply", "point_cloud/iteration_7_backup/point_cloud.ply",
                                   "test/renders/notes.txt"])
def test_what_no_run_wrote_is_not_deleted(scene, trained, tmp_path, place):
    model = tmp_path / "model"
    shutil.copytree(trained, model)
    if "." in place and place != "report.html":
        (model / place).parent.mkdir(parents=True, exist_ok=True)
        (model / place).write_text("precious")
    else:
        (model / "report.html").unlink()
        shutil.rmtree(model / "train", ignore_errors=True)
        shutil.copytree(trained, model / place)  # another run
    before = {path: path.stat().st_mtime for path in model.rglob("*")}
    line = fails("train", "-s", scene, "-m", model, "--iterations", "2")
    assert str(model / place.split("/")[0]) in line and "was not written by a run" in line
    assert {path: path.stat().st_mtime for path in model.rglob("*")} == before


def test_a_settings_file_among_the_results_is_not_deleted(scene, trained, tmp_path):
    model = tmp_path / "model"
    shutil.copytree(trained, model)
    folder = next((model / "point_cloud").glob("iteration_*"))
    (folder / "mine.json").write_text("{}")
    line = fails("train", "-s", scene, "-m", model, "--iterations", "2", "--config", folder / "mine.json")
    assert "mine.json: was not written by a run" in line and (folder / "mine.json").exists()


def test_inputs_with_the_name_of_a_result_are_not_deleted(scene, trained, tmp_path):
    model = tmp_path / "model"
    shutil.copytree(trained, model)
    page = (model / "report.html").read_bytes()
    line = fails("train", "-s", scene, "-m", model, "--iterations", "2", "--test-list", model / "report.html")
    assert "report.html is in the run in" in line and "which this run would replace" in line
    assert (model / "report.html").read_bytes() == page


def test_a_resumed_run_keeps_the_files_of_its_user(scene, tmp_path):
    model = tmp_path / "model"
    run_well("train", "-s", scene, "-m", model, "--iterations", "4", "--checkpoint-iterations", "2", "--quiet")
    mine = model / "point_cloud/iteration_4/mine.ply"
    mine.write_text("precious")
    run_well("train", "--resume", model / "checkpoints/iteration_2.ckpt", "--quiet")
    assert mine.read_text() == "precious"


def test_a_model_of_another_backbone_is_refused(scene, tmp_path):
    model = tmp_path / "model"
    run_well("train", "-s", scene, "-m", model, "--backbone", "mip-splatting", "--iterations", "2", "--quiet")
    config = json.loads((model / "config.json").read_text())
    (model / "config.json").write_text(json.dumps({**config, "backbone": "vanilla"}))
    assert "has filter_3D of Mip-Splatting" in fails("render", "-m", model)


def test_model_that_is_a_file(scene, tmp_path):
    (tmp_path / "file").write_text("x")
    assert "not a folder" in fails("train", "-s", scene, "-m", tmp_path / "file")


def test_a_folder_that_a_killed_save_left_is_passed_over(trained, tmp_path):
    model = tmp_path / "model"
    shutil.copytree(trained, model)
    (model / "point_cloud/iteration_999999").mkdir()
    run_well("eval", "-m", model)


@pytest.mark.parametrize("command", ["render", "eval"])
def test_commands_that_need_a_model(tmp_path, command):
    assert "-m/--model" in fails(command)
    assert "no such model folder" in fails(command, "-m", tmp_path / "none")
    assert "config.json" in fails(command, "-m", tmp_path)


@pytest.mark.parametrize("command", ["render", "eval", "mesh", "export"])
def test_a_negative_iteration(trained, tmp_path, command):
    output = ["-o", tmp_path / "out.ply"] if command in ("mesh", "export") else []
    assert "--iteration must be at least 0" in fails(command, "-m", trained, "--iteration", "-5", *output)


@pytest.mark.parametrize("count", ["-1", "0", "2147483647"])
def test_a_series_without_an_end(trained, count):
    assert "--orbit must be 1 to 100000" in fails("render", "-m", trained, "--orbit", count)
    assert "--sequence must be 1 to 100000" in fails("render", "-m", trained, "--sequence", count)


@pytest.mark.parametrize("command", [["bench", "--device", "cuda:99"], ["mesh-eval", "none.ply", "none.ply"]])
def test_an_unwritable_output_is_told_before_the_work(tmp_path, command):
    assert "out.json: cannot be written: No such file" in fails(*command, "-o", tmp_path / "none/out.json")


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


def test_a_model_without_primitives(trained, tmp_path):
    """It would be drawn as black pictures."""
    saved = tmp_path / "point_cloud/iteration_60"
    saved.mkdir(parents=True)
    (tmp_path / "config.json").write_bytes((trained / "config.json").read_bytes())
    (tmp_path / "results.json").write_bytes((trained / "results.json").read_bytes())
    whole = (trained / "point_cloud/iteration_60/point_cloud.ply").read_bytes()
    header = whole[:whole.index(b"end_header\n") + 11]
    (saved / "point_cloud.ply").write_bytes(re.sub(rb"element vertex \d+", b"element vertex 0", header))
    assert "no primitives" in fails("render", "-m", tmp_path)
    before = (tmp_path / "results.json").read_bytes()
    assert "no primitives" in fails("eval", "-m", tmp_path)
    assert (tmp_path / "results.json").read_bytes() == before


def test_checkpoints_that_are_none(trained, tmp_path):
    assert "no such checkpoint" in fails("train", "--resume", tmp_path / "none.ckpt", "-m", tmp_path / "model")
    assert "is a folder; name a checkpoint" in fails("train", "--resume", trained)
    model = trained / "point_cloud/iteration_60/point_cloud.ply"
    assert "is not a checkpoint; name one" in fails("train", "--resume", model)
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


def test_help_of_slam_is_about_its_own_backbone():
    told = run_well("slam", "--help").stdout
    assert "faint edges [0.5]" in told and "scaffold-gs" not in told and "--no-coarse" not in told
    assert "scaffold-gs 0.7]" in re.sub(r"\s+", " ", run_well("train", "--help").stdout)


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


@pytest.mark.parametrize("content, what", [('{"iterations": 1e400}', "out of range"), ('{"seed": 1' + "0" * 400 + "}", "range"),
                                           ("[" * 1000000, "nested deeper"), ('{"a":' * 1000000, "nested deeper"),
                                           ('{"a": "caf\udce9"}', "not JSON")],
                         ids=["exponent", "digits", "lists", "objects", "bytes"])
def test_config_that_no_number_or_stack_holds(scene, tmp_path, content, what):
    config = tmp_path / "bad.json"
    config.write_bytes(content.encode(errors="surrogateescape"))
    line = fails("train", "-s", scene, "-m", tmp_path / "model", "--config", config)
    assert what in line
    assert "bad.json" in line
    assert "json.exception" not in line


def test_a_pipe_as_scene(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    assert "neither a folder nor a file" in fails("train", "-s", tmp_path / "pipe", "-m", tmp_path / "model")
    assert "neither a folder nor a file" in fails("pack", tmp_path / "pipe", tmp_path / "out.sbscene")


@pytest.mark.parametrize("hidden", [".", "sparse"])
def test_a_folder_that_may_not_be_read(scene, hidden):
    with tempfile.TemporaryDirectory(dir="/tmp") as folder:  # pytest's own are hidden from other users
        os.chmod(folder, 0o755)
        copy = pathlib.Path(folder) / "room"
        shutil.copytree(scene, copy)
        (copy / hidden).chmod(0)
        command = [str(PROGRAM), "train", "-s", str(copy), "-m", str(copy.parent / "model")]
        done = subprocess.run(command, capture_output=True, text=True, check=False, cwd="/",
                              preexec_fn=lambda: os.setuid(65534) if os.geteuid() == 0 else None)
        (copy / hidden).chmod(0o755)
        assert done.returncode == 2
        assert "Permission denied" in done.stderr
        assert len(done.stderr.splitlines()) == 1


def test_standard_output_that_is_full(trained, tmp_path):
    with open("/dev/full", "w") as full:
        for arguments in (["--version"], ["--help"], ["train", "--help"], ["render", "-m", str(trained), "-o", str(tmp_path)]):
            done = subprocess.run([str(PROGRAM), *arguments], stdout=full, stderr=subprocess.PIPE, text=True, check=False)
            assert done.returncode == 1, arguments
            assert "cannot write to standard output" in done.stderr


def test_a_limit_of_file_sizes_is_told(scene, tmp_path):
    limit = 4096
    done = subprocess.run([str(PROGRAM), "train", "-s", str(scene), "-m", str(tmp_path / "model"), "--iterations", "2",
                           "--quiet"], capture_output=True, text=True, check=False,
                          preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)))
    assert done.returncode == 1
    assert "point_cloud.ply: cannot be written: File too large" in done.stderr.splitlines()[-1]


def test_arguments_that_are_not_utf8(scene, tmp_path):
    for arguments in ([b"-m", b"caf\xe9"], [b"-s", b"/tmp/caf\xe9"], [b"--caf\xe9"]):
        done = subprocess.run([str(PROGRAM).encode(), b"train", *arguments], capture_output=True, check=False, cwd=tmp_path)
        assert done.returncode == 2
        assert "caf\\xe9' is not UTF-8" in done.stderr.decode()
        assert len(done.stderr.splitlines()) == 1
    folder = os.path.join(os.fsencode(tmp_path), b"caf\xe9")
    shutil.copytree(os.fsencode(scene), os.path.join(folder, b"room"))
    model = tmp_path / "model"
    done = subprocess.run([str(PROGRAM), "train", "-s", "room", "-m", str(model)], capture_output=True, check=False,
                          cwd=folder)
    assert done.returncode == 2
    assert "not UTF-8" in done.stderr.decode()
    assert not model.exists()


def test_names_of_images_that_are_not_utf8(scene, tmp_path):
    copy = tmp_path / "room"
    shutil.copytree(scene, copy)
    images = copy / "sparse/0/images.bin"
    images.write_bytes(images.read_bytes().replace(b"0003.png", b"00\xe93.png"))
    os.rename(copy / "images/0003.png", os.path.join(os.fsencode(copy / "images"), b"00\xe93.png"))
    line = fails("train", "-s", copy, "-m", tmp_path / "model")
    assert "00\\xe93.png" in line
    assert "not UTF-8" in line
    assert not (tmp_path / "model").exists()


def test_long_names_of_images(scene, tmp_path):
    copy = tmp_path / "room"
    shutil.copytree(scene, copy)
    images = copy / "sparse/0/images.bin"
    long_name = "n" * 251 + ".png"
    images.write_bytes(images.read_bytes().replace(b"0003.png", long_name.encode()))
    os.rename(copy / "images/0003.png", copy / "images" / long_name)
    run_well("train", "-s", copy, "-m", tmp_path / "model", "--iterations", "2", "--quiet")
    assert len(list((tmp_path / "model/train/truth").iterdir())) == 10


def test_raw_bytes_of_a_damaged_file_are_not_printed(scene, tmp_path):
    copy = tmp_path / "room"
    shutil.copytree(scene, copy)
    images = copy / "sparse/0/images.bin"
    images.write_bytes(images.read_bytes().replace(b"0003.png", b"\x1b[2J\x07\x01."))
    line = fails("train", "-s", copy, "-m", tmp_path / "model")
    assert "\\x1b[2J\\x07\\x01" in line
    assert line.isprintable()
    images.write_bytes(images.read_bytes()[:100] + b"x" * 100000)
    assert len(fails("train", "-s", copy, "-m", tmp_path / "model")) < 1200


def test_a_damaged_picture_is_one_line(scene, tmp_path):
    copy = tmp_path / "room"
    shutil.copytree(scene, copy)
    photo = copy / "images/0003.png"
    # Valid checksums around data that cannot be decompressed: only the decoder notices.
    photo.write_bytes(png(80, 60, 8, 2, b"\x78\x9c" + b"damaged" * 20))
    line = fails("train", "-s", copy, "-m", tmp_path / "model")
    assert "0003.png" in line
    assert "cannot be decoded" in line


def test_a_pose_far_away(scene, tmp_path):
    copy = tmp_path / "room"
    shutil.copytree(scene, copy)
    images = copy / "sparse/0/images.bin"
    whole = images.read_bytes()
    images.write_bytes(whole[:8 + 4 + 32] + struct.pack("<d", 3e38) + whole[8 + 4 + 32 + 8:])
    line = fails("train", "-s", copy, "-m", tmp_path / "model", "--iterations", "1")
    assert "'0000.png'" in line
    assert "units away from the origin" in line
    assert "units away" in fails("pack", copy, tmp_path / "room.sbscene")
