# SPDX-License-Identifier: Apache-2.0
"""scaffold-gs and octree-gs with every command: train, resume, render, eval; and invalid settings."""

import json
import shutil
import struct

import pytest

from conftest import run_program, run_well

SHORT = ["--eval", "--llffhold", "4", "--iterations", "60", "--quiet"]
CONSTANTS = {"feat_dim": 8, "n_offsets": 4, "grow_interval": 5, "appearance_dim": 2}


@pytest.fixture(scope="module", params=["scaffold-gs", "octree-gs"])
def config(request, tmp_path_factory):
    path = tmp_path_factory.mktemp("config") / "config.json"
    path.write_text(json.dumps({"backbone": {"name": request.param, **CONSTANTS}, "boost": {"views": 3}}))
    return path


def model_bytes(model):
    folder = model / "point_cloud/iteration_60"
    return (folder / "point_cloud.ply").read_bytes() + (folder / "nets.bin").read_bytes()


def results(model):
    return json.loads((model / "results.json").read_text())


def test_compare_resume_render_and_eval(scene, config, tmp_path):
    both = tmp_path / "both"
    run_well("compare", "-s", scene, "-m", both, *SHORT, "--config", config)
    name = json.loads(config.read_text())["backbone"]["name"]
    for run in ("baseline", "boosted"):
        found = results(both / run)
        assert found["backbone"] == name
        assert found["storage_bytes"] == len(model_bytes(both / run))
        assert found["psnr"] > 8
    assert results(both / "boosted")["boost"] is True

    run_well("train", "-s", scene, "-m", tmp_path / "cut", *SHORT, "--config", config, "--checkpoint-iterations", "25")
    assert model_bytes(tmp_path / "cut") == model_bytes(both / "boosted")
    run_well("train", "--resume", tmp_path / "cut/checkpoints/iteration_25.ckpt", "-m", tmp_path / "resumed", "--quiet")
    assert model_bytes(tmp_path / "resumed") == model_bytes(tmp_path / "cut")

    run_well("render", "-m", both / "boosted", "-o", tmp_path / "pictures", "--quiet")
    assert (tmp_path / "pictures/test/renders/0004.png").read_bytes() == \
           (both / "boosted/test/renders/0004.png").read_bytes()
    before = results(both / "boosted")
    run_well("eval", "-m", both / "boosted", "--quiet")
    assert results(both / "boosted")["psnr"] == before["psnr"]


def scaled(scene, copy, factor):
    """A copy of a COLMAP scene in other units."""
    shutil.copytree(scene, copy)

    def scale(file, record, at):
        """Multiplies three numbers at `at` of each record; record(data, i) is where the record at i ends."""
        data = bytearray(file.read_bytes())
        i = 8
        for _ in range(struct.unpack_from("<Q", data)[0]):
            struct.pack_into("<3d", data, i + at, *(factor * x for x in struct.unpack_from("<3d", data, i + at)))
            i = record(data, i)
        file.write_bytes(data)

    def end_of_image(data, i):
        end = data.index(0, i + 64) + 1
        return end + 8 + 24 * struct.unpack_from("<Q", data, end)[0]

    scale(copy / "sparse/0/images.bin", end_of_image, 36)
    scale(copy / "sparse/0/points3D.bin", lambda data, i: i + 51 + 8 * struct.unpack_from("<Q", data, i + 43)[0], 8)
    return copy


# Scenes in millimetres, or in the metres of a map, lost 2 to 8 dB: published lengths and rates are in world units.
@pytest.mark.parametrize("backbone", ["scaffold-gs", "octree-gs", "convex-splatting"])
def test_accelerated_runs_do_not_depend_on_the_unit_of_the_scene(scene, tmp_path, backbone):
    large = scaled(scene, tmp_path / "scene", 64)
    run = ["--backbone", backbone, "--eval", "--llffhold", 4, "--iterations", 100, "--threads", 1, "--quiet"]
    found = {}
    for name, source in ("small", scene), ("large", large):
        run_well("train", "-s", source, "-m", tmp_path / name, *run)
        found[name] = results(tmp_path / name)
        assert json.loads((tmp_path / name / "config.json").read_text())["backbone"]["absolute_distances"] is False
    assert abs(found["small"]["psnr"] - found["large"]["psnr"]) < 0.1
    assert abs(found["small"]["primitives"] / found["large"]["primitives"] - 1) < 0.01
    # The published run depends on it.
    run_well("train", "-s", large, "-m", tmp_path / "published", *run, "--no-boost")
    assert json.loads((tmp_path / "published/config.json").read_text())["backbone"]["absolute_distances"] is True
    kept = tmp_path / "kept.json"
    kept.write_text(json.dumps({"backbone": {"absolute_distances": True}}))
    run_well("train", "-s", large, "-m", tmp_path / "kept", *run, "--config", kept)
    assert json.loads((tmp_path / "kept/config.json").read_text())["backbone"]["absolute_distances"] is True
    assert results(tmp_path / "kept")["psnr"] != found["large"]["psnr"]


@pytest.mark.parametrize("arguments, word", [
    (["--no-vcp"], "vcp"),
])
def test_parts_that_do_not_apply_are_refused(scene, config, tmp_path, arguments, word):
    done = run_program("train", "-s", scene, "-m", tmp_path / "model", "--config", config, *arguments)
    assert done.returncode == 2
    assert word in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1


@pytest.mark.parametrize("constants, word", [
    ({"feat_dim": 30}, "feat_dim"),
    ({"n_offsets": -1}, "n_offsets"),
    ({"sh_degree": 3}, "sh_degree"),
])
def test_broken_constants_are_refused(scene, config, tmp_path, constants, word):
    settings = json.loads(config.read_text())
    settings["backbone"].update(constants)
    broken = tmp_path / "broken.json"
    broken.write_text(json.dumps(settings))
    done = run_program("train", "-s", scene, "-m", tmp_path / "model", "--config", broken)
    assert done.returncode == 2
    assert word in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1


def test_a_model_without_its_nets_is_refused(scene, config, tmp_path):
    model = tmp_path / "model"
    run_well("train", "-s", scene, "-m", model, "--iterations", "5", "--quiet", "--config", config)
    shutil.rmtree(model / "test", ignore_errors=True)
    (model / "point_cloud/iteration_5/nets.bin").unlink()
    done = run_program("render", "-m", model)
    assert done.returncode == 2
    assert "nets.bin" in done.stderr


def test_street_is_a_scene(tmp_path):
    run_well("synth", tmp_path / "street", "--scene", "street", "--width", 64, "--height", 48, "--views", 5, "--points", 100)
    assert len(list((tmp_path / "street/images").iterdir())) == 5
    done = run_program("synth", tmp_path / "x", "--scene", "castle")
    assert done.returncode == 2
    assert "street" in done.stderr
