# SPDX-License-Identifier: Apache-2.0
"""scripts/gpu-check reports what it cannot do; its measurements are only tested by running it on a GPU."""

import json
import os
import pathlib
import shutil
import subprocess
import tempfile

SCRIPT = pathlib.Path(__file__).resolve().parents[2] / "scripts" / "gpu-check"


def fails(*arguments, path="/usr/bin:/bin"):
    with tempfile.TemporaryDirectory() as tree:  # without what --prepare left in this one
        (pathlib.Path(tree) / "scripts").mkdir()
        done = subprocess.run([shutil.copy(SCRIPT, pathlib.Path(tree) / "scripts"), *arguments], capture_output=True, text=True,
                              check=False, env={**os.environ, "PATH": path})
    assert done.returncode == 2
    assert done.stdout == ""
    assert len(done.stderr.splitlines()) == 1
    return done.stderr


def fake(folder, name, text, status=0):
    program = folder / name
    program.write_text(f"#!/bin/sh\necho '{text}'\nexit {status}\n")
    program.chmod(0o755)


def checkout(tmp_path, program=None):
    """@return a tree with the script, and with this text as its program; and an environment that has a GPU and nvcc"""
    machine, tree = tmp_path / "machine", tmp_path / "tree"
    for folder in (machine, tree / "scripts", tree / "build/gpu/bin"):
        folder.mkdir(parents=True)
    fake(machine, "nvidia-smi", "NVIDIA T4, 15360, 535.1, 7.5")
    fake(machine, "nvcc", "Cuda compilation tools, release 12.4, V12.4.99")
    shutil.copy(SCRIPT, tree / "scripts/gpu-check")
    if program is not None:
        (tree / "build/gpu/bin/splatboost").write_text(program)
        (tree / "build/gpu/bin/splatboost").chmod(0o755)
    return tree, {**os.environ, "PATH": f"{machine}:/usr/bin:/bin"}


def test_no_gpu(tmp_path):
    fake(tmp_path, "nvidia-smi", "NVIDIA-SMI has failed", 9)
    assert "no GPU here" in fails("build", path=f"{tmp_path}:/usr/bin:/bin")


def test_no_nvcc(tmp_path):
    fake(tmp_path, "nvidia-smi", "NVIDIA T4, 15360, 535.1, 7.5")
    fake(tmp_path, "nvcc", "broken", 1)
    assert "no nvcc here" in fails(path=f"{tmp_path}:/usr/bin:/bin")


def test_unknown_step():
    assert "'mesure' is not a step; available: build, tests" in fails("mesure")


def test_compare_needs_a_scene():
    assert "--scene FILE" in fails("compare")
    assert "not found" in fails("compare", "--scene", "/nowhere/fox.sbscene")


def test_a_failure_does_not_keep_the_next_step_from_running(tmp_path):
    """In a separate tree with fake programs: bench fails, compare writes the expected files."""
    tree, environment = checkout(tmp_path, """#!/bin/sh
echo "asked for $*"
[ "$1" = compare ] || exit 3
mkdir -p "$5" && echo '{"boosted": {"psnr": 30}}' > "$5/compare.json"
""")
    (tmp_path / "fox.sbscene").write_text("scene")
    done = subprocess.run([tree / "scripts/gpu-check", "bench", "compare", "--scene", tmp_path / "fox.sbscene", "--output",
                           tmp_path / "out"], capture_output=True, text=True, check=False, env=environment)
    assert done.returncode == 1
    first, second = done.stdout.splitlines()[-2:]
    assert first.startswith("gpu-check: bench FAILED (bench)") and second.startswith("gpu-check: compare passed")
    bench, compare = (json.loads((tmp_path / f"out/gpu_{step}.json").read_text()) for step in ("bench", "compare"))
    assert bench["commands"][0]["status"] == 3 and bench["bench"] is None and not bench["passed"]
    assert (compare["device"], compare["driver"], compare["cuda"]) == ("NVIDIA T4", "535.1", "12.4")
    assert compare["passed"] and compare["compare"] == {"boosted": {"psnr": 30}}
    asked = (tmp_path / "out/gpu_compare.log").read_text()
    assert "--iterations 30000" in asked and "--device cuda" in asked and "fox.sbscene" in asked
    assert "-s ../fox.sbscene" in compare["commands"][0]["command"]
    told = [command["command"] for command in bench["commands"] + compare["commands"]]
    assert not any(str(tmp_path) in command for command in told), "paths of the machine are not for results"


def test_backbones_are_measured_on_scenes_that_the_program_makes(tmp_path):
    tree, environment = checkout(tmp_path, """#!/bin/sh
if [ "$1" = synth ]; then mkdir "$2"; exit; fi
echo "asked for $*"
[ "$3" != pgsr ] || [ "$5" != room ] || exit 1
mkdir -p "$7" && echo '{"psnr": 30, "views": [1, 2]}' > "$7/results.json"
""")
    (tmp_path / "fox.sbscene").write_text("scene")

    def measure(folder, seconds, *options):
        done = subprocess.run([tree / "scripts/gpu-check", "backbones", "--output", folder, *options], capture_output=True,
                              text=True, check=False, env={**environment, "STEP_SECONDS": seconds})
        return done.returncode, json.loads((folder / "gpu_backbones.json").read_text())

    status, found = measure(tmp_path / "out", "300", "--scene", tmp_path / "fox.sbscene")
    assert status == 1 and not found["passed"], "PGSR failed on the room"
    runs = {(run["backbone"], run["scene"], run["rules"]): run["results"] for run in found["runs"]}
    assert len(runs) == len(found["runs"]) == 16 and not found["out_of_time"]
    assert runs["deformable-3dgs", "moving", "default"] == {"psnr": 30}
    assert runs["convex-splatting", "fox", "published"] == {"psnr": 30} and runs["pgsr", "room", "default"] == {}
    asked = (tmp_path / "out/gpu_backbones.log").read_text()
    assert "--no-boost" in asked and "--backbone octree-gs -s ../fox.sbscene" in asked
    status, found = measure(tmp_path / "alone", "300")
    assert {run["backbone"] for run in found["runs"]} == {"deformable-3dgs", "pgsr"}
    status, found = measure(tmp_path / "short", "5")
    assert status == 0 and found["runs"] == [] and found["out_of_time"]


def test_a_step_without_a_scene_is_told(tmp_path):
    """All steps, none of whose programs exist: each has its line and its file; compare is left out."""
    machine, tree = tmp_path / "machine", tmp_path / "tree"
    for folder in (machine, tree / "scripts"):
        folder.mkdir(parents=True)
    fake(machine, "nvidia-smi", "NVIDIA T4, 15360, 535.1, 7.5")
    fake(machine, "nvcc", "Cuda compilation tools, release 12.4, V12.4.99")
    fake(machine, "cmake", "no compiler here", 1)
    fake(machine, "ctest", "no tests here", 1)
    shutil.copy(SCRIPT, tree / "scripts/gpu-check")
    done = subprocess.run([tree / "scripts/gpu-check", "--output", tmp_path / "out"], capture_output=True, text=True,
                          check=False, env={**os.environ, "PATH": f"{machine}:/usr/bin:/bin"})
    assert done.returncode == 1
    lines = done.stdout.splitlines()[-7:]
    assert [line.split()[1:3] for line in lines[:5]] == [[step, "FAILED"] for step in
                                                         ("build", "tests", "all-tests", "sanitize", "bench")]
    assert lines[5] == "gpu-check: compare left out: no --scene given"
    assert lines[6].startswith("gpu-check: backbones FAILED")
    assert all((tmp_path / f"out/gpu_{step}.json").exists() for step in ("build", "tests", "all_tests", "sanitize", "bench"))


def test_programs_that_were_built_elsewhere_are_unpacked(tmp_path):
    machine, tree = tmp_path / "machine", tmp_path / "tree"
    for folder in (machine, tree / "scripts", tree / "build/gpu-check", tmp_path / "bin"):
        folder.mkdir(parents=True)
    fake(machine, "nvidia-smi", "NVIDIA T4, 15360, 535.1, 7.5")
    fake(machine, "nvcc", "Cuda compilation tools, release 12.4, V12.4.99")
    fake(tmp_path / "bin", "splatboost", "asked")
    subprocess.run(["tar", "-cJf", tree / "build/gpu-check/programs.tar.xz", "-C", tmp_path, "bin"], check=True)
    (tree / "build/gpu-check/built.json").write_text('{"architecture": "75", "cuda": "13.0"}')
    (tree / "build/gpu-check/commit").write_text("abc123")
    shutil.copy(SCRIPT, tree / "scripts/gpu-check")

    def run(*steps):
        return subprocess.run([tree / "scripts/gpu-check", *steps], capture_output=True, text=True, check=False,
                              env={**os.environ, "PATH": f"{machine}:/usr/bin:/bin"})

    done = run("build", "bench")
    assert done.returncode == 0, done.stdout
    build = json.loads((tree / "build/gpu-check/gpu_build.json").read_text())
    assert (build["built"], build["commit"], build["cuda"]) == ("elsewhere", "abc123", "13.0")
    assert run("all-tests").stderr == ("gpu-check: all-tests needs a build made here: --prepare packed only the programs of the "
                                       "other steps\n")
    (tree / "build/gpu-check/built.json").write_text('{"architecture": "90", "cuda": "13.0"}')
    done = run("build")
    assert done.returncode == 2 and "built for 90, this GPU is 75: repeat --prepare 75" in done.stderr


def test_prepare_takes_a_compute_capability():
    assert "a compute capability such as 90" in fails("--prepare", "sm_90")
