# SPDX-License-Identifier: Apache-2.0
"""scripts/city: the areas of blocks, the views each trains on, and the merged model."""
import fcntl
import json
import os
import shutil
import signal
import struct
import subprocess
import sys
import time
from pathlib import Path

import pytest

np = pytest.importorskip("numpy")
ROOT = Path(__file__).resolve().parents[2]
PROGRAM = Path(os.environ.get("SPLATBOOST_BIN", ROOT / "build/release/bin")) / "splatboost"
SNAKEMAKE = next((found for found in (os.environ.get("SNAKEMAKE"), shutil.which("snakemake"),
                                      str(ROOT / "build/suite-venv/bin/snakemake")) if found and os.access(found, os.X_OK)), None)
sys.path.insert(0, str(ROOT / "scripts/city"))
import blocks  # noqa: E402

pytestmark = pytest.mark.skipif(not PROGRAM.is_file(), reason="the program is not built")


def run(*command, code=0):
    done = subprocess.run([*map(str, command)], capture_output=True, text=True, check=False, timeout=300, start_new_session=True,
                          env={**os.environ, "SPLATBOOST_BIN": str(PROGRAM.parent)})
    assert done.returncode == code, done.stdout + done.stderr
    return done.stdout + done.stderr


@pytest.fixture(scope="module")
def street(tmp_path_factory):
    folder = tmp_path_factory.mktemp("city") / "street"
    run(PROGRAM, "synth", folder, "--scene", "street", "--views", 24, "--width", 32, "--height", 24, "--points", 600, "--samples", 1)
    return folder


def city(street, out, *arguments, code=0):
    return run(sys.executable, ROOT / "scripts/city/run", "-s", street, "-o", out, *arguments, code=code)


def test_every_place_has_one_owner(street):
    scene = blocks.Scene(street)
    grid = blocks.Grid.around(scene, 3, 2)
    assert grid.names() == ["0_0", "0_1", "1_0", "1_1", "2_0", "2_1"]
    assert np.bincount(grid.owners(scene.centres), minlength=6).tolist() == [4] * 6
    # The street's length is the first axis, and the ground holds both.
    assert np.ptp(scene.centres @ grid.axes[0]) > np.ptp(scene.centres @ grid.axes[1])
    assert np.allclose(grid.axes @ grid.axes.T, np.eye(2), atol=1e-6)
    places = np.random.default_rng(0).uniform(-100, 100, (500, 3))
    owners = grid.owners(places)
    for block in range(6):
        assert (grid.near(places, block, 0) == (owners == block)).all()
        assert grid.near(places, block, 5).sum() > (owners == block).sum()
    again = blocks.Grid(**json.loads(json.dumps(grid.to_json())))
    assert (again.owners(places) == owners).all()


def test_the_ground_holds_a_straight_street(street):
    scene = blocks.Scene(street)
    up = -scene.rotations[:, 1].mean(axis=0)
    along = np.cross(up, [0.3, 0.5, 0.8])
    scene.centres = np.outer(np.linspace(-5, 5, len(scene.names)), along / np.linalg.norm(along))
    grid = blocks.Grid.around(scene, 4, 1)
    assert np.abs(grid.axes @ up).max() < 1e-6 and np.allclose(grid.axes @ grid.axes.T, np.eye(2), atol=1e-6)
    assert np.bincount(grid.owners(scene.centres), minlength=4).tolist() == [6] * 4


def test_points_of_a_frustum(street):
    scene = blocks.Scene(street)
    for view in (0, 7):
        width, height, fx, fy = scene.cameras[scene.view_cameras[view]]
        seen = []
        for point in scene.points:
            x, y, z = scene.rotations[view] @ (point - scene.centres[view])
            seen.append(z > 0 and abs(fx * x / z) < width / 2 and abs(fy * y / z) < height / 2)
        assert scene.seen_by(view).tolist() == seen and any(seen) and not all(seen)


def test_blocks_train_alone_and_become_one(street, tmp_path):
    out = tmp_path / "city"
    told = city(street, out, "--grid", 2, 1, "--border", 1, "--share", 0.6, "--split-only", "--", "--iterations", 8)
    assert "block 0_0:" in told and "block 1_0:" in told
    plan = json.loads((out / "plan.json").read_text())
    whole = blocks.Scene(street)
    for block in plan["blocks"]:
        part = blocks.Scene(out / "blocks" / block["name"] / "scene")
        assert 0 < len(part.names) < 21 and len(part.names) == block["views"]
        assert not set(part.names) & set(whole.names[::8])  # test views of the whole scene are in no part
        at = whole.names.index(part.names[0])
        assert np.allclose(part.centres[0], whole.centres[at]) and 0 < len(part.points) <= len(whole.points)
    for block in plan["blocks"]:
        folder = out / "blocks" / block["name"]
        run(PROGRAM, "train", "-s", folder / "scene", "-m", folder / "model", "--iterations", 8, "--threads", 1, "--quiet",
            "--config", out / plan["config"])
    run(sys.executable, ROOT / "scripts/city/run", "--merge", out / "plan.json")
    run(PROGRAM, "eval", "-m", out / "merged", "--threads", 1)
    results = json.loads((out / "merged/results.json").read_text())
    assert [view["name"] for view in results["views"]] == whole.names[::8] and results["psnr"] > 5
    # The viewer shows all views of the scene, where the runs of the blocks have them.
    cameras = json.loads((out / "merged/cameras.json").read_text())
    held_out = whole.names[::8]
    names = held_out + [name for name in whole.names if name not in held_out]
    assert [(c["id"], c["img_name"]) for c in cameras] == list(enumerate(names))
    assert [c["split"] for c in cameras] == ["test"] * 3 + ["train"] * 21
    by_name = {camera["img_name"]: camera for camera in cameras}
    for block in plan["blocks"]:
        for camera in json.loads((out / "blocks" / block["name"] / "model/cameras.json").read_text()):
            found = by_name[camera["img_name"]]
            assert found.keys() == camera.keys() and found["split"] == camera["split"] == "train"
            for key in ("width", "height", "fx", "fy", "position", "rotation"):
                assert np.allclose(found[key], camera[key], atol=1e-5), key
    # The merged model has exactly the Gaussians that each block owns, bit by bit.
    grid = blocks.Grid(**plan["grid"])
    _, merged = blocks.read_ply(out / "merged/point_cloud/iteration_8/point_cloud.ply")
    owners = grid.owners(np.stack([merged[a] for a in "xyz"], 1).astype(float))
    assert results["primitives"] == len(merged)
    for number, block in enumerate(plan["blocks"]):
        _, rows = blocks.read_ply(out / "blocks" / block["name"] / "model/point_cloud/iteration_8/point_cloud.ply")
        own = grid.owners(np.stack([rows[a] for a in "xyz"], 1).astype(float)) == number
        assert 0 < own.sum() < len(rows) and merged[owners == number].tobytes() == rows[own].tobytes()


@pytest.mark.parametrize("options, absolute", [((), True), (("--no-coarse",), True), (("--literal",), False)])
def test_scores_of_blocks_do_not_depend_on_the_block(street, tmp_path, options, absolute):
    """Min-max over a block's own Gaussians would give blocks different thresholds; --literal keeps the paper's scores."""
    city(street, tmp_path, "--split-only", "--grid", 2, 1, "--", *options)
    plan = json.loads((tmp_path / "plan.json").read_text())
    assert ("config" in plan) == absolute
    if absolute:
        assert json.loads((tmp_path / plan["config"]).read_text()) == {"boost": {"absolute_scores": True}}


def test_all_threads_are_those_of_the_cpus_that_it_may_use(street, tmp_path):
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(before)})
    try:
        city(street, tmp_path, "--split-only", "--grid", 2, 1)
    finally:
        os.sched_setaffinity(0, before)
    assert json.loads((tmp_path / "plan.json").read_text())["threads"] == 1


@pytest.mark.skipif(SNAKEMAKE is None, reason="Snakemake is not installed")
def test_the_workflow(street, tmp_path):
    arguments = (street, tmp_path / "city", "--grid", 2, 1, "--threads", 1, "--", "--iterations", 4)
    told = city(*arguments)
    assert "Gaussians, PSNR" in told and (tmp_path / "city/merged/report.html").is_file()
    assert json.loads((tmp_path / "city/blocks/0_0/model/config.json").read_text())["boost"]["absolute_scores"] is True
    before = (tmp_path / "city/blocks/0_0/model/results.json").stat().st_mtime_ns
    other = tmp_path / "other"
    other.write_bytes(PROGRAM.read_bytes() + b"\n")
    other.chmod(0o755)
    assert "another build" not in city(*arguments)
    assert "another build of the program" in city(*arguments[:-3], "--program", other, *arguments[-3:])
    assert (tmp_path / "city/blocks/0_0/model/results.json").stat().st_mtime_ns == before  # not trained again


def test_a_relative_lpips_is_found_from_any_folder(street, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "net.onnx").write_bytes(b"1")
    for name, given in (("a", ("--lpips", "net.onnx")), ("b", ("--lpips=net.onnx",))):
        city(street, name, "--split-only", "--grid", 2, 1, "--", *given)
        assert json.loads((tmp_path / name / "plan.json").read_text())["options"] == ["--lpips", str(tmp_path / "net.onnx")]
    told = city(street, "c", "--split-only", "--grid", 2, 1, "--", "--lpips", "none.onnx", code=2)
    assert told == f"city: --lpips: {tmp_path}/none.onnx: no such file\n" and not (tmp_path / "c/plan.json").exists()


@pytest.mark.parametrize("name", ["sparse/0/points3D.bin", "images", "net.onnx"])
def test_files_that_changed_are_noticed(street, tmp_path, name):
    scene, network = tmp_path / "scene", tmp_path / "net.onnx"
    shutil.copytree(street, scene)
    network.write_bytes(b"1")
    arguments = (scene, tmp_path / "out", "--split-only", "--grid", 2, 1, "--", "--lpips", network)
    city(*arguments)
    before = (tmp_path / "out/plan.json").read_bytes()
    (scene / "points3D.ply").write_bytes(b"not used")
    city(*arguments)  # continues
    if name == "images":
        next((scene / "images").iterdir()).unlink()
    else:
        changed = network if name == "net.onnx" else scene / name
        changed.write_bytes(changed.read_bytes()[:-1] + b"2")
    what = "the file of --lpips" if name == "net.onnx" else f"the scene {scene}"
    assert city(*arguments, code=2) == f"city: {tmp_path}/out: contains blocks of {what} before it changed; give another --out\n"
    assert (tmp_path / "out/plan.json").read_bytes() == before


def killer(path):
    """A program that kills Snakemake and the jobs on its first training, and afterwards is the real one."""
    path.write_text(f"""#!/bin/sh
if [ "$1" = train ] && [ ! -e "{path}.ran" ]; then touch "{path}.ran" "$5/results.json"; kill -KILL 0; fi
exec "{PROGRAM}" "$@"
""")
    path.chmod(0o755)
    return path


@pytest.mark.skipif(SNAKEMAKE is None, reason="Snakemake is not installed")
def test_the_same_command_continues_after_a_kill(street, tmp_path, monkeypatch):
    monkeypatch.setenv("TMPDIR", str(tmp_path))  # for what the killed Snakemake leaves
    arguments = (street, tmp_path / "city", "--grid", 2, 1, "--threads", 1, "--program", killer(tmp_path / "program"))
    options = ("--", "--iterations", 4)
    assert "a job failed" in city(*arguments, *options, code=1)
    assert "Gaussians, PSNR" in city(*arguments, *options)


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
@pytest.mark.parametrize("early", [False, True])  # the first moment: from the started Snakemake itself
def test_an_interrupt_ends_the_jobs(street, tmp_path, name, early):
    snakemake = tmp_path / "snakemake"
    told = f'echo $$ > "{tmp_path}/pid.part"; mv "{tmp_path}/pid.part" "{tmp_path}/pid"'
    if early:
        told = f'echo $$ > "{tmp_path}/pid"; kill -{name[3:]} $PPID'
    snakemake.write_text(f"#!/bin/sh\n{told}; exec sleep 100\n")
    snakemake.chmod(0o755)
    process = subprocess.Popen([sys.executable, ROOT / "scripts/city/run", "-s", street, "-o", tmp_path / "city", "--grid", "2", "1"],
                               stderr=subprocess.PIPE, text=True,
                               env={**os.environ, "SPLATBOOST_BIN": str(PROGRAM.parent), "SNAKEMAKE": str(snakemake)},
                               # Tests in the background or under nohup inherit ignored signals.
                               preexec_fn=lambda: signal.signal(signal.Signals[name], signal.SIG_DFL))
    while not (tmp_path / "pid").exists() and process.poll() is None:
        time.sleep(0.05)
    if not early:
        process.send_signal(signal.Signals[name])
    assert process.communicate(timeout=60)[1].endswith("\ncity: interrupted; the same command continues\n")
    assert process.returncode == 130
    with pytest.raises(ProcessLookupError):
        os.kill(int((tmp_path / "pid").read_text()), 0)


def test_what_cannot_be_is_told_in_one_line(street, tmp_path):
    for arguments, words in ((("--grid", 20, 20), "cannot be cut into"),
                             (("--", "--eval"), "--eval: cannot be passed to the blocks"),
                             (("--", "--images=a"), "--images: cannot be passed to the blocks"),
                             (("--", "-ia"), "-ia: cannot be passed to the blocks"),
                             (("--", "--test_list", "a"), "--test_list: cannot be passed to the blocks"),
                             (("--", "--backbone", "scaffold-gs"), "--backbone scaffold-gs: its models cannot be merged"),
                             (("--", "--backbone=scaffold-gs"), "--backbone scaffold-gs: its models cannot be merged"),
                             (("--grid", 0, 1), "--grid must be at least 1 1"),
                             (("--border", "nan"), "--border at least 0"),
                             (("--share", 1.5), "--share in (0, 1]"),
                             (("--threads", -1), "--threads must be at least 0"),
                             (("--jobs", 0), "--jobs at least 1"),
                             (("--", "--resume", "a"), "--resume: cannot be passed to the blocks"),
                             (("--llffhold", 1), "--llffhold 1 holds out every view")):
        assert words in city(street, tmp_path / "a", "--split-only", *arguments, code=2)
        assert not (tmp_path / "a/plan.json").exists()
    assert "no sparse/0/images.bin" in city(tmp_path, tmp_path / "b", "--split-only", code=2)
    (tmp_path / "file").write_text("")
    assert "file: cannot be made a folder (File exists)" in city(street, tmp_path / "file", "--split-only", code=2)
    broken = tmp_path / "broken"
    shutil.copytree(street, broken)
    images = broken / "sparse/0/images.bin"
    images.write_bytes(images.read_bytes()[:-100])
    assert "is not a complete COLMAP model" in city(broken, tmp_path / "c", "--split-only", code=2)
    city(street, tmp_path / "d", "--split-only", "--grid", 2, 1)
    assert "contains blocks of another command" in city(street, tmp_path / "d", "--split-only", "--grid", 1, 2, code=2)
    with open(tmp_path / "d/lock", "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        assert "another city is running" in city(street, tmp_path / "d", "--split-only", "--grid", 2, 1, code=2)
    (tmp_path / "d/plan.json").write_text("{")
    assert "d/plan.json: not JSON" in city(street, tmp_path / "d", "--split-only", "--grid", 2, 1, code=2)


@pytest.mark.parametrize("name, at, wrong, words", [
    ("images.bin", 8 + 60, struct.pack("<I", 77), "has camera 77, which is not in cameras.bin"),
    ("images.bin", 8 + 4, struct.pack("<d", float("nan")), "has no valid pose"),
    ("images.bin", 8 + 36, struct.pack("<d", float("inf")), "has no valid pose"),
    ("images.bin", 8 + 4, bytes(32), "has no valid pose"),
    ("points3D.bin", 0, struct.pack("<Q", 1 << 40), "points3D.bin ends early"),
    (None, 0, b"", "no folder images")], ids=["camera", "nan", "inf", "rotation", "points", "images"])
def test_a_damaged_scene_is_told_in_one_line(street, tmp_path, name, at, wrong, words):
    scene = tmp_path / "scene"
    shutil.copytree(street, scene)
    if name is None:
        shutil.rmtree(scene / "images")
    else:
        data = bytearray((scene / "sparse/0" / name).read_bytes())
        data[at:at + len(wrong)] = wrong
        (scene / "sparse/0" / name).write_bytes(data)
    told = city(scene, tmp_path / "out", "--split-only", code=2)
    assert words in told and len(told.splitlines()) == 1
