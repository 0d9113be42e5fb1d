# SPDX-License-Identifier: Apache-2.0
"""What `splatboost eval` writes into results.json, and what it leaves as it is."""

import json
import shutil

import pytest

from conftest import refused, run_well


@pytest.fixture
def model(trained, tmp_path):
    folder = tmp_path / "model"
    shutil.copytree(trained, folder)
    return folder


@pytest.fixture
def other(tmp_path):
    folder = tmp_path / "other"
    run_well("synth", folder, "--width", 80, "--height", 60, "--views", 10, "--points", 300, "--seed", 5)
    return folder


def read(model, name="results.json"):
    return json.loads((model / name).read_text())


def change(model, name="results.json", **values):
    (model / name).write_text(json.dumps(read(model, name) | values))


def test_other_data_in_the_folder_of_the_scene_keep_the_results(model, other):
    change(model, "config.json", source=str(other))
    before = (model / "results.json").read_bytes()
    done = run_well("eval", "-m", model)
    assert "PSNR" in done.stdout and f"{other} is another scene than that of the run" in done.stdout
    assert "results.json was not changed" in done.stdout
    assert (model / "results.json").read_bytes() == before
    # What the run left unmeasured is not measured on them.
    (model / "results.json").rename(model / "training.json")
    assert "named by --source" in refused("eval", "-m", model)
    assert not (model / "results.json").exists()


def test_a_run_without_checksums_is_known_by_its_path(model, other):
    psnr = read(model)["psnr"]
    trained = read(model, "config.json")["trained"]
    del trained["data"]
    change(model, "config.json", trained=trained)
    change(model, psnr=1)
    run_well("eval", "-m", model, "-s", other)
    assert read(model)["psnr"] == 1
    run_well("eval", "-m", model)
    assert read(model)["psnr"] == psnr


def test_frames_per_second_are_of_the_threads_beside_them(model):
    threads = read(model)["threads"]
    change(model, fps=1.5, psnr=1)
    done = run_well("eval", "-m", model, "--threads", threads + 1)
    assert f"frames per second were not written: times there are for cpu, {threads} threads" in done.stderr
    assert read(model)["fps"] == 1.5 and read(model)["threads"] == threads
    assert read(model)["psnr"] != 1  # does not depend on threads
    assert run_well("eval", "-m", model, "--threads", threads).stderr == ""
    assert read(model)["fps"] != 1.5
    for key in ("machine", "device"):
        here = read(model)[key]
        change(model, fps=1.5, **{key: "another"})
        assert "another" in run_well("eval", "-m", model, "--threads", threads).stderr
        assert read(model)["fps"] == 1.5 and read(model)[key] == "another"
        change(model, **{key: here})


def test_a_run_that_is_completed_with_other_threads_has_no_frames_per_second(model):
    threads = read(model)["threads"]
    (model / "results.json").rename(model / "training.json")
    run_well("eval", "-m", model, "--threads", threads + 1)
    assert read(model)["fps"] is None and not (model / "training.json").exists()
    run_well("eval", "-m", model, "--threads", threads)
    assert read(model)["fps"] > 0


def test_lpips_is_kept_where_it_is_not_measured(model):
    def with_lpips(name=None):
        views = [view | {"lpips": 0.5} for view in read(model)["views"]]
        views[0]["name"] = name or views[0]["name"]
        change(model, lpips=0.25, psnr=1, views=views)
        run_well("eval", "-m", model)
        assert read(model)["psnr"] != 1
        return [read(model)["lpips"], *(view["lpips"] for view in read(model)["views"])]

    assert with_lpips() == [0.25, 0.5, 0.5, 0.5]
    assert with_lpips("of other views") == [None] * 4


def test_the_folder_of_a_comparison_names_its_runs(scene, tmp_path):
    model = tmp_path / "both"
    run_well("compare", "-s", scene, "-m", model, "--iterations", "5", "--quiet")
    for arguments in (["eval"], ["render"], ["eval", "--iteration", 5]):
        assert f"give one of its runs, such as {model / 'boosted'}" in refused(*arguments, "-m", model)
    run_well("eval", "-m", model / "boosted", "--quiet")
