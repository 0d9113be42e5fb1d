# SPDX-License-Identifier: Apache-2.0
"""The patch of Photo-SLAM: its recipe, and train_colmap of a patched checkout on the CPU.

The second needs SPLATBOOST_PHOTO_SLAM, a pristine checkout of HuajianUP/Photo-SLAM, and libtorch's headers and
libraries: of /usr (libtorch-dev, libjsoncpp-dev), or of SPLATBOOST_TORCH, a folder with include/ and lib/. It compiles
libtorch twice, for several minutes; SPLATBOOST_PHOTO_SLAM_BUILDS names a folder that keeps the builds.
"""

import json
import os
import pathlib
import re
import shutil
import subprocess

import pytest
from conftest import PROGRAM, ROOT, content, run_program, run_well

RECIPE = json.loads((ROOT / "patches/photo-slam/recipe.json").read_text())
CHECKOUT = os.environ.get("SPLATBOOST_PHOTO_SLAM")
TORCH = pathlib.Path(os.environ.get("SPLATBOOST_TORCH", "/usr"))
PARTS = ["CMakeLists.txt", "include", "src", "examples", "third_party", "cfg", "ORB-SLAM3/include", "ORB-SLAM3/Thirdparty"]


def write_miniature(tree):
    """Files with the text that the recipe looks for, in functions, and nothing else of Photo-SLAM."""
    lines = {}
    for layout in RECIPE["layouts"]:
        for sign in layout["detect"]:
            lines.setdefault(sign["file"], []).append(sign["contains"])
    for edit in RECIPE["edits"]:
        lines.setdefault(edit["file"], []).extend([edit["anchor"]] * edit.get("count", 1))
    for need in RECIPE["needs"]:
        lines.setdefault(need["file"], []).append(need["text"].replace(", ", ",\n        "))
    for name, own in lines.items():
        text = ""
        for line in dict.fromkeys(own):
            count = max(1, next((e.get("count", 1) for e in RECIPE["edits"] if e["anchor"] == line), 1))
            line += ")" * (line.count("(") - line.count(")"))
            line += "" if name == "CMakeLists.txt" or line.startswith("#") or line.endswith((";", "()")) else ";"
            text += (line if line.startswith("#") else "    " + line) * 1 + "\n"
            text += ("    " + line + "\n") * (count - 1)
        (tree / name).parent.mkdir(parents=True, exist_ok=True)
        (tree / name).write_text(text)
    return tree


def test_a_miniature_from_apply_to_revert(tmp_path):
    tree = write_miniature(tmp_path / "host")
    before = content(tree)
    assert "photo-slam fits" in run_well("patch", "status", tree).stdout
    diff = run_well("patch", "apply", "photo-slam", tree, "--dry-run").stdout
    assert content(tree) == before
    assert "patch show photo-slam lists its options" in run_well("patch", "apply", "photo-slam", tree).stdout
    after = content(tree)
    for edit in RECIPE["edits"]:
        assert "+" in diff and after[edit["file"]].decode().count(edit["snippet"][0]) >= edit.get("count", 1)
    for own in RECIPE["files"]:
        assert after[own["file"]] == (ROOT / "patches/photo-slam" / own["source"]).read_bytes()
    run_well("patch", "verify", tree)
    run_well("patch", "revert", tree)
    assert content(tree) == before
    assert not (tree / "splatboost").exists()


def test_a_changed_signature_is_refused(tmp_path):
    tree = write_miniature(tmp_path / "host")
    header = tree / "include/gaussian_model.h"
    header.write_text(header.read_text().replace("int N = 2", "int N, bool more"))
    before = content(tree)
    done = run_program("patch", "apply", "photo-slam", tree)
    assert done.returncode == 2
    assert "densifyAndSplit" in done.stderr and "the patch calls it to change the Gaussians" in done.stderr
    assert content(tree) == before


def test_the_documented_edits_for_newer_libtorch_fit_beside_the_patch(tmp_path):
    commands = re.findall(r"^  (sed -i .*)$", (ROOT / "docs/patching.md").read_text(), re.M)
    assert len(commands) == 3
    lines = {
        "src/gaussian_model.cpp": ("auto key = c10::guts::to_string(param.unsafeGetTensorImpl());",
                                   "auto key = param.unsafeGetTensorImpl();"),
        "examples/a.cpp": ("c10Alloc::DeviceStats all = f(0);\nc10Alloc::Stat"
                           " one = all.reserved_bytes[static_cast<int>(c10Alloc::StatType::AGGREGATE)];",
                           "auto all = f(0);\nauto one = all.reserved_bytes[0];"),
        "third_party/simple-knn/simple_knn.cu": ("#define BOX", "#include <float.h>\n#define BOX")}
    for name, (before, _) in lines.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(before + "\n")
    for command in commands:
        subprocess.run(["sh", "-c", command], cwd=tmp_path, check=True)
    for name, (_, after) in lines.items():
        assert (tmp_path / name).read_text() == after + "\n"
    anchors = {edit["anchor"] for edit in RECIPE["edits"]} | {need["text"] for need in RECIPE["needs"]}
    assert not any("getTensorImpl" in text or "c10Alloc" in text for text in anchors)


def copy_checkout(to):
    for part in PARTS:
        source = pathlib.Path(CHECKOUT) / part
        if source.is_dir():
            shutil.copytree(source, to / part)
        else:
            to.mkdir(parents=True, exist_ok=True)
            shutil.copy(source, to / part)
    return to


def build(host, folder):
    configure = ["cmake", "-S", ROOT / "tests/patches/photo_slam", "-B", folder, "-G", "Ninja", f"-DHOST={host}",
                 f"-DTORCH={TORCH}", f"-DSPLATBOOST={PROGRAM.parent.parent}"]
    for command in (configure, ["cmake", "--build", folder, "-j1"]):
        done = subprocess.run(list(map(str, command)), capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-4000:]
    return folder / "train_colmap"


def write_settings(path, own, **keys):
    """The checkout's settings for COLMAP scenes, with the values of `keys` replaced."""
    text = own.read_text()
    for key, value in keys.items():
        text, found = re.subn(rf"(?m)^(\w+\.{key}):.*$", rf"\1: {value}", text)
        assert found == 1, key
    path.write_text(text)
    return path


def train(program, settings, scene, out):
    """Photo-SLAM's train_colmap saves the model and then fails on sparse points, which only SLAM gives it."""
    done = subprocess.run([program, settings, scene, out, "no_viewer"], capture_output=True, text=True, check=False,
                          env=dict(os.environ, OMP_NUM_THREADS="1"), timeout=1200)
    models = list(out.glob("*_shutdown/ply/point_cloud/*/point_cloud.ply"))
    assert len(models) == 1, done.stdout[-2000:] + done.stderr[-2000:]
    model = models[0].read_bytes()
    psnr = [float(line.split()[1]) for line in next(out.glob("*_shutdown/psnr.txt")).read_text().splitlines()[1:]]
    return {"model": model, "count": int(re.search(rb"element vertex (\d+)", model)[1]), "told": done.stdout,
            "psnr": sum(psnr) / len(psnr)}


@pytest.mark.skipif(not CHECKOUT, reason="SPLATBOOST_PHOTO_SLAM does not name a checkout of HuajianUP/Photo-SLAM")
@pytest.mark.skipif(not (TORCH / "include/torch/csrc/api/include/torch/torch.h").exists(),
                    reason="no headers of libtorch in /usr/include (apt-get install libtorch-dev) or SPLATBOOST_TORCH")
def test_train_colmap_of_a_checkout(tmp_path):
    builds = pathlib.Path(os.environ.get("SPLATBOOST_PHOTO_SLAM_BUILDS", tmp_path / "builds"))
    hosts = {}
    for name in ("unpatched", "patched"):
        hosts[name] = builds / f"{name}_host"
        if not hosts[name].exists():
            copy_checkout(hosts[name])
    before = content(hosts["unpatched"])
    run_well("patch", "apply", "photo-slam", hosts["patched"])
    try:
        run_well("patch", "verify", hosts["patched"])
        programs = {name: build(host, builds / name) for name, host in hosts.items()}
    finally:
        run_well("patch", "revert", hosts["patched"])
    assert content(hosts["patched"]) == before

    scene = tmp_path / "room"
    run_well("synth", scene, "--width", "96", "--height", "72", "--views", "16", "--points", "800")
    # Growth every 20 iterations to 60, late pruning at 72, 84, …
    own = write_settings(tmp_path / "own.yaml", hosts["unpatched"] / "cfg/colmap/gaussian_splatting.yaml",
                         max_num_iterations=120, densification_interval=20, densify_until_iter=61,
                         opacity_reset_interval=0, training_report_interval=0, record_rendered_image=0)
    off = tmp_path / "off.yaml"
    off.write_text(own.read_text() + "\nSplatBoost.on: 0\n")

    # With the boost off, the host's own code runs, with the same bytes.
    unpatched = train(programs["unpatched"], own, scene, tmp_path / "out_unpatched")
    as_before = train(programs["patched"], off, scene, tmp_path / "out_off")
    assert as_before["model"] == unpatched["model"]
    assert "SplatBoost: " not in as_before["told"]

    on = train(programs["patched"], own, scene, tmp_path / "out_on")
    assert "SplatBoost: default rules of photo-slam, beta 0.5" in on["told"]
    assert on["count"] > 800 and on["model"] != unpatched["model"]
    assert on["psnr"] > unpatched["psnr"] - 1
    capped_settings = tmp_path / "capped.yaml"
    capped_settings.write_text(own.read_text() + "\nSplatBoost.max_gaussians: 1500\n")
    assert 800 < train(programs["patched"], capped_settings, scene, tmp_path / "out_capped")["count"] <= 1500

    # Unknown keys and invalid values are refused.
    wrong = tmp_path / "wrong.yaml"
    for line in ("bta: 0.7", "beta: -1", "on: 2", "on: .nan", "literal: -1", "max_gaussians: -5", "max_gaussians: .nan",
                 "max_gaussians: 10.5", "max_gaussians: 1e30", 'max_gaussians: "many"'):
        wrong.write_text(own.read_text() + f"\nSplatBoost.{line}\n")
        done = subprocess.run([programs["patched"], wrong, scene, tmp_path / "out_wrong", "no_viewer"],
                              capture_output=True, text=True, check=False, timeout=300)
        assert done.returncode == 2 and done.stderr.count("\n") == 1, line + done.stderr
        assert done.stderr.startswith(f"{wrong}: SplatBoost.") and line.split(":")[0] in done.stderr, done.stderr
