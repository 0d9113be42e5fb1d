# SPDX-License-Identifier: Apache-2.0
"""splatboost bench: measurements of every stage, as a table and as JSON; the values are not checked."""

import json
import shutil

import pytest

from conftest import run_program, run_well

STAGES = {"activate", "project", "tile_lists", "blend", "loss", "blend_backward", "project_backward", "statistics",
          "optimizer", "iteration", "scoring"}


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    path = tmp_path_factory.mktemp("bench") / "bench.json"
    done = run_well("bench", "--scenes", "20k", "--repeats", "2", "--threads", "1", "--scaling", "-o", path)
    return path, done.stdout


def test_writes_every_stage(measured):
    path, table = measured
    found = json.loads(path.read_text())
    assert (found["device"], found["threads"], found["repeats"]) == ("cpu", 1, 2)
    assert found["machine"] and found["instruction_set"] in table
    (scene,) = found["scenes"]
    assert (scene["splats"], scene["width"], scene["height"]) == (20000, 400, 300)
    assert set(scene["milliseconds"]) == STAGES
    assert all(value > 0 for value in scene["milliseconds"].values())
    assert 30 < scene["blended_per_pixel"] < 100


def test_counts_the_work_of_blending(measured):
    path, table = measured
    found = json.loads(path.read_text())
    assert found["limits"]["bytes_per_second"] > 1e8 and found["limits"]["operations_per_second"] > 1e9
    (scene,) = found["scenes"]
    work = scene["blend_work"]
    assert 20000 < work["entries"] < work["rows"] < work["pairs"] < 16 * work["rows"] < 256 * work["entries"]
    for stage, direction in [("blend", "forward"), ("blend_backward", "backward")]:
        effort = work[direction]
        speed = effort["operations"] / (1e-3 * scene["milliseconds"][stage])
        assert effort["share_of_operations"] == pytest.approx(speed / found["limits"]["operations_per_second"])
        assert effort["operations"] > 28 * work["pairs"] and effort["bytes"] > 68 * work["entries"]
        assert 0 < effort["share_of_bytes"] and f"blend {direction}" in table


def test_measures_convexes(tmp_path):
    path = tmp_path / "convexes.json"
    run_well("bench", "--scenes", "convexes", "--repeats", "1", "--threads", "1", "-o", path)
    (scene,) = json.loads(path.read_text())["scenes"]
    assert (scene["name"], scene["splats"]) == ("convexes", 20000)
    assert set(scene["milliseconds"]) == STAGES
    assert 10 < scene["blended_per_pixel"] < 100
    work = scene["blend_work"]
    assert 20000 < work["entries"] < work["rows"] < work["pairs"] < 16 * work["rows"] < 256 * work["entries"]
    for direction in ("forward", "backward"):
        assert work[direction]["operations"] > 59 * work["pairs"]
        assert 0 < work[direction]["share_of_operations"] < 1


def test_scales_by_splats_pixels_and_threads(measured):
    path, table = measured
    scaling = json.loads(path.read_text())["scaling"]
    assert [point["splats"] for point in scaling["splats"]] == [10000, 20000, 40000, 80000, 160000]
    assert [point["width"] * 3 == 4 * point["height"] for point in scaling["pixels"]] == [True] * 5
    assert [point["threads"] for point in scaling["threads"]] == [1]
    assert set(scaling["pixels"][0]["milliseconds"]) == STAGES - {"scoring"}
    assert "by splats:" in table


def test_compares_with_an_earlier_file(measured, tmp_path):
    path, _ = measured
    old = json.loads(path.read_text())
    for stage in STAGES:
        old["scenes"][0]["milliseconds"][stage] *= 1e6  # more than a busy machine delays a stage of 0.1 ms
    (tmp_path / "old.json").write_text(json.dumps(old))
    done = run_well("bench", "--scenes", "20k", "--repeats", "1", "--instruction-set", "portable", "--compare",
                    tmp_path / "old.json")
    rows = [line for line in done.stdout.splitlines() if line.endswith("x")]
    assert len(rows) == len(STAGES)
    assert all(float(row.split()[-1][:-1]) > 1 for row in rows)


@pytest.mark.parametrize("scenes", [{}, [1], [{"name": "20k", "milliseconds": [1]}],
                                    [{"name": "20k", "milliseconds": {"blend": "1"}}]])
def test_a_damaged_earlier_file_is_refused_before_measuring(tmp_path, scenes):
    old = tmp_path / "old.json"
    old.write_text(json.dumps({"scenes": scenes}))
    done = run_program("bench", "--scenes", "20k", "--repeats", "1", "--compare", old, "-o", tmp_path / "new.json")
    assert done.returncode == 2 and done.stdout == "" and not (tmp_path / "new.json").exists()
    assert f"{old}: not an output file of splatboost bench" in done.stderr and len(done.stderr.splitlines()) == 1


def test_a_file_that_it_did_not_write_is_not_replaced(measured, tmp_path):
    for text in ('{"frames": []}', '{"scenes": []}', "no JSON"):
        (tmp_path / "transforms.json").write_text(text)
        done = run_program("bench", "--scenes", "20k", "--repeats", "1", "-o", tmp_path / "transforms.json")
        assert done.returncode == 2 and "was not written by splatboost bench" in done.stderr
        assert (tmp_path / "transforms.json").read_text() == text
    shutil.copyfile(measured[0], tmp_path / "bench.json")
    run_well("bench", "--scenes", "20k", "--repeats", "1", "-o", tmp_path / "bench.json")


@pytest.mark.parametrize("arguments, told", [
    (["--scenes", "5k"], "unknown scene '5k'"),
    (["--repeats", "0"], "--repeats must be"),
    (["--instruction-set", "mmx"], "'mmx' is not one of"),
    (["--compare", "nowhere.json"], "nowhere.json"),
    (["--device", "gpu"], "--device must be cpu, cuda or cuda:N, not 'gpu'"),
    (["--device", "cuda", "--scaling"], "--scaling is only available on the CPU"),
    (["--device", "cuda", "--scenes", "convexes"], "--scenes convexes is only available on the CPU"),
])
def test_mistakes_are_told(arguments, told):
    done = run_program("bench", *arguments)
    assert done.returncode == 2
    assert told in done.stderr and len(done.stderr.splitlines()) == 1
