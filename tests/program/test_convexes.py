# SPDX-License-Identifier: Apache-2.0
"""convex-splatting with every command: train, resume, render, eval, export; and invalid settings."""

import json
import shutil
import struct

import pytest

from conftest import run_program, run_well

SHORT = ["--eval", "--llffhold", "4", "--iterations", "60", "--quiet"]
SETTINGS = {"backbone": {"name": "convex-splatting", "densify_interval": 10, "densify_until": 20000,
                         "gradient_threshold": 1e-6, "reference_focal": 500}, "boost": {"views": 3}}


@pytest.fixture(scope="module")
def config(tmp_path_factory):
    path = tmp_path_factory.mktemp("config") / "config.json"
    path.write_text(json.dumps(SETTINGS))
    return path


@pytest.fixture(scope="module")
def both(scene, config, tmp_path_factory):
    folder = tmp_path_factory.mktemp("convexes") / "both"
    run_well("compare", "-s", scene, "-m", folder, *SHORT, "--config", config)
    return folder


def model_bytes(model):
    folder = model / "point_cloud/iteration_60"
    return (folder / "point_cloud.ply").read_bytes() + (folder / "convexes.bin").read_bytes()


def results(model):
    return json.loads((model / "results.json").read_text())


def test_compare_resume_render_and_eval(scene, config, both, tmp_path):
    for run in ("baseline", "boosted"):
        found = results(both / run)
        assert found["backbone"] == "convex-splatting"
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


def test_export_writes_hulls(both, tmp_path):
    model = both / "baseline"
    run_well("export", "-m", model, "-o", tmp_path / "hulls.ply")
    data = (tmp_path / "hulls.ply").read_bytes()
    header, body = data.split(b"end_header\n", 1)
    counts = {line.split()[1]: int(line.split()[2]) for line in header.decode().splitlines()
              if line.startswith("element")}
    assert len(body) == 16 * counts["vertex"] + 13 * counts["face"]
    assert 0 < counts["vertex"] <= 6 * results(model)["primitives"]
    # The hull of six points has at most eight faces.
    assert counts["vertex"] / 6 * 4 <= counts["face"] <= counts["vertex"] / 6 * 8

    run_well("export", "-m", model, "-o", tmp_path / "hulls.glb")
    data = (tmp_path / "hulls.glb").read_bytes()
    magic, version, length, json_length, kind = struct.unpack("<4sIII4s", data[:20])
    assert (magic, version, length, kind) == (b"glTF", 2, len(data), b"JSON")
    gltf = json.loads(data[20:20 + json_length])
    assert gltf["accessors"][0]["count"] == counts["vertex"]
    assert gltf["accessors"][1]["count"] == 3 * counts["face"]
    assert gltf["buffers"][0]["byteLength"] == len(data) - 20 - json_length - 8
    indices = struct.unpack(f"<{3 * counts['face']}I", data[-12 * counts["face"]:])
    assert max(indices) < counts["vertex"]


@pytest.mark.parametrize("arguments, word", [
    (["-o", "hulls.obj"], ".ply or .glb"),
    ([], "-o/--output"),
    (["-o", "hulls.ply", "--iteration", "7"], "no model was saved"),
])
def test_broken_exports_are_refused(both, tmp_path, arguments, word):
    done = run_program("export", "-m", both / "baseline", *[tmp_path / a if a.startswith("hulls") else a for a in arguments])
    assert done.returncode == 2
    assert word in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


def test_a_model_of_gaussians_has_no_triangles(scene, tmp_path):
    run_well("train", "-s", scene, "-m", tmp_path / "model", "--iterations", "5", "--quiet")
    done = run_program("export", "-m", tmp_path / "model", "-o", tmp_path / "x.ply")
    assert done.returncode == 2
    assert "vanilla" in done.stderr
    assert not (tmp_path / "x.ply").exists()


def floats_of(ply):
    """Offset of the data in a model's .ply, and the names of its columns."""
    end = ply.index(b"end_header\n") + len(b"end_header\n")
    return end, [line.split()[-1].decode() for line in ply[:end].splitlines() if line.startswith(b"property float ")]


def with_number(ply, column, number):
    begin, names = floats_of(ply)
    at = begin + 4 * (len(names) + names.index(column))  # of the second convex
    return ply[:at] + struct.pack("<f", number) + ply[at + 4:]


def with_count(ply, count):
    head, rest = ply.split(b"element vertex ", 1)
    return head + b"element vertex " + count + rest[rest.index(b"\n"):]


def with_focal(archive, number):
    return archive.replace(struct.pack("<f", 500), struct.pack("<f", number), 1)


@pytest.mark.parametrize("file, damage", [
    ("point_cloud.ply", lambda ply: ply[:len(ply) // 2]),
    ("point_cloud.ply", lambda ply: ply[:-1]),
    ("point_cloud.ply", lambda ply: ply[:40]),
    ("point_cloud.ply", lambda ply: b""),
    ("point_cloud.ply", lambda ply: with_count(ply, b"1000000")),
    ("point_cloud.ply", lambda ply: with_count(ply, b"18446744073709551615")),
    ("point_cloud.ply", lambda ply: with_count(ply, b"99999999999999999999999")),
    ("point_cloud.ply", lambda ply: with_count(ply, b"-1")),
    ("point_cloud.ply", lambda ply: with_count(ply, b"many")),
    ("point_cloud.ply", lambda ply: ply.replace(b"property float point_3_y\n", b"")),
    ("point_cloud.ply", lambda ply: ply.replace(b"point_3_y", b"point_9_y")),
    ("point_cloud.ply", lambda ply: with_number(ply, "point_0_x", float("nan"))),
    ("point_cloud.ply", lambda ply: with_number(ply, "smoothness", float("inf"))),
    ("point_cloud.ply", lambda ply: with_number(ply, "f_rest_7", -float("inf"))),
    ("convexes.bin", lambda archive: archive[:len(archive) // 2]),
    ("convexes.bin", lambda archive: b""),
    ("convexes.bin", lambda archive: with_focal(archive, 0)),
    ("convexes.bin", lambda archive: with_focal(archive, float("nan"))),
    ("convexes.bin", lambda archive: with_focal(archive, float("inf"))),
])
def test_damaged_models_are_refused(both, tmp_path, file, damage):
    model = tmp_path / "model"
    shutil.copytree(both / "baseline", model)
    path = model / "point_cloud/iteration_60" / file
    whole = path.read_bytes()
    path.write_bytes(damage(whole))
    assert path.read_bytes() != whole
    done = run_program("export", "-m", model, "-o", tmp_path / "out.glb")
    assert done.returncode == 2, done.stderr
    assert file in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert [entry.name for entry in tmp_path.iterdir()] == ["model"]


@pytest.mark.parametrize("constants, word", [
    ({"preset": "moon"}, "indoor, outdoor or light"),
    ({"reference_focal": -2}, "reference_focal"),
    ({"feat_dim": 30}, "feat_dim"),
])
def test_broken_constants_are_refused(scene, tmp_path, constants, word):
    broken = tmp_path / "broken.json"
    broken.write_text(json.dumps({"backbone": {"name": "convex-splatting", **constants}}))
    done = run_program("train", "-s", scene, "-m", tmp_path / "model", "--config", broken)
    assert done.returncode == 2
    assert word in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
