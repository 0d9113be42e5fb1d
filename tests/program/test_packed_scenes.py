# SPDX-License-Identifier: Apache-2.0
"""A packed scene is equivalent to its folder: the same runs give the same bytes."""

import json
import shutil

import pytest

from conftest import SHORT_RUN, refused, run_well


@pytest.fixture(scope="module")
def packed(scene, tmp_path_factory):
    file = tmp_path_factory.mktemp("packed") / "room.sbscene"
    done = run_well("pack", scene, file)
    assert str(file) in done.stdout
    return file


def ply(model):
    return (model / "point_cloud/iteration_60/point_cloud.ply").read_bytes()


def test_training_gives_the_bytes_of_the_folder(packed, trained, tmp_path):
    model = tmp_path / "model"
    run_well("train", "-s", packed, "-m", model, *SHORT_RUN)
    assert ply(model) == ply(trained)
    of_file, of_folder = (json.loads((folder / "results.json").read_text()) for folder in (model, trained))
    for key in ("psnr", "ssim", "views", "source", "primitives"):
        assert of_file[key] == of_folder[key]
    renders = {path.name: path.read_bytes() for path in (model / "test/renders").iterdir()}
    assert renders == {path.name: path.read_bytes() for path in (trained / "test/renders").iterdir()}
    # Commands find the file through the run's config.json.
    run_well("eval", "-m", model)
    run_well("render", "-m", model, "-o", tmp_path / "renders")
    assert (tmp_path / "renders/test/renders/0000.png").read_bytes() == renders["0000.png"]


def test_a_run_on_the_folder_goes_on_with_the_file(packed, trained, tmp_path):
    model, renamed = tmp_path / "resumed", tmp_path / "renamed.sbscene"
    shutil.copyfile(packed, renamed)
    run_well("train", "--resume", trained / "checkpoints/iteration_25.ckpt", "-m", model, "-s", renamed, "--quiet")
    assert ply(model) == ply(trained)


def test_compare_takes_it(packed, tmp_path):
    run_well("compare", "-s", packed, "-m", tmp_path / "both", *SHORT_RUN[:-2], "--quiet")
    assert (tmp_path / "both/compare.json").exists()


def test_pictures_that_were_not_packed_are_refused(packed, tmp_path):
    line = refused("train", "-s", packed, "-m", tmp_path / "model", "-r", "2")
    assert "--resolution 2" in line
    assert "room.sbscene" in line
    assert "pack the scene again" in line
    assert "--images" in refused("train", "-s", packed, "-m", tmp_path / "model", "--images", "images_4")
    assert not (tmp_path / "model").exists()


def test_files_that_are_none(packed, tmp_path):
    whole = packed.read_bytes()
    damaged = bytearray(whole)
    damaged[len(whole) // 2] ^= 1
    bad = tmp_path / "bad.sbscene"
    for content, what in [(whole[:-10], "cut short"), (bytes(damaged), "damaged"), (b"PK\3\4" + whole, "nor a packed"),
                          (b"", "nor a packed"), (whole[:6] + b"99" + whole[8:], "version 99")]:
        bad.write_bytes(content)
        line = refused("train", "-s", bad, "-m", tmp_path / "model")
        assert what in line
        assert "bad.sbscene" in line


def test_packing_leaves_other_files_alone(scene, packed, tmp_path):
    photo = tmp_path / "photo.jpg"
    photo.write_text("precious")
    assert ".sbscene" in refused("pack", scene, photo)
    assert photo.read_text() == "precious"
    (tmp_path / "folder.sbscene").mkdir()
    assert "is a folder" in refused("pack", scene, tmp_path / "folder.sbscene")
    assert "is packed already" in refused("pack", packed, tmp_path / "again.sbscene")
    assert "no dataset" in refused("pack", tmp_path, tmp_path / "none.sbscene")
    assert "SCENE" in refused("pack")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["folder.sbscene", "photo.jpg"]
