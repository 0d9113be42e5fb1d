# SPDX-License-Identifier: Apache-2.0
"""The tree respects its layers, and the check detects violations."""
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SCRIPT = ROOT / "scripts/check_tree"


def run(root):
    return subprocess.run([SCRIPT, root], capture_output=True, text=True)


def test_the_tree_keeps_its_layers():
    assert run(ROOT).stderr == ""


def test_a_folder_without_a_checkout_is_told_in_one_line(tmp_path):
    done = run(tmp_path / "none")
    assert done.returncode == 2 and "git cannot list its files" in done.stderr and len(done.stderr.splitlines()) == 1


@pytest.fixture
def tree(tmp_path):
    """A small tree with this repository's layer table."""
    def write(path, text):
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).write_text(text)

    write("cmake/SplatBoostTargets.cmake", (ROOT / "cmake/SplatBoostTargets.cmake").read_text())
    for header in ("core/include/splatboost/adam.h", "core/src/device/launch.h", "core/src/loss/ssim_window.h",
                   "core/src/optim/adam_math.h", "backbones/trainer/support/archive.h",
                   "backbones/trainer/evaluation/results.h", "backbones/families/nets/net.h",
                   "backbones/vanilla/vanilla.h", "backbones/program/commands/commands.h", "adapters/vanilla/adapter.h"):
        write(header, "")
    write("backbones/other/good.cpp", '#include "splatboost/adam.h"\n#include "families/nets/net.h"\n'
                                      '#include "trainer/support/archive.h"\n')
    write("backbones/families/nets/kernel.cu", '#include "device/launch.h"\n')
    write("README.md", "`core/src/device/launch.h`, [nets](backbones/families/nets), `backbones/NAME/name.cpp`\n")
    subprocess.run(["git", "init", "-q", tmp_path], check=True)
    return write


def test_what_the_table_allows_passes(tree, tmp_path):
    result = run(tmp_path)
    assert (result.returncode, result.stderr) == (0, "")


@pytest.mark.parametrize("path, include, fault", [
    ("core/src/device/a.cpp", "optim/adam_math.h", "layer 'core_device' may not use layer 'core_optim'"),
    ("core/src/optim/a.cpp", "loss/ssim_window.h", "layer 'core_optim' may not use layer 'core_loss'"),
    ("backbones/families/nets/a.cu", "optim/adam_math.h", "this is a private header of the core"),
    ("backbones/other/a.cpp", "vanilla/vanilla.h", "layer 'backbone' may not use layer"),
    ("backbones/trainer/support/a.h", "trainer/evaluation/results.h", "layer 'trainer_support' may not use layer"),
    ("backbones/program/session/a.cpp", "program/commands/commands.h", "program/session may not use program/commands"),
    ("patches/tool/a.cpp", "splatboost/adam.h", "layer 'patch' may not use the core"),
    ("core/src/loss/a.cpp", "loss/nowhere.h", "loss/nowhere.h is not a file of the tree"),
])
def test_an_include_against_the_order_is_named(tree, tmp_path, path, include, fault):
    tree(path, f'#pragma once\n#include "{include}"\n')
    result = run(tmp_path)
    assert result.returncode == 1
    assert result.stderr.startswith(f"{path}:2: ") and fault in result.stderr and result.stderr.count("\n") == 1


def test_a_class_that_two_headers_define_is_named(tree, tmp_path):
    tree("core/src/device/frame.h", "namespace splatboost {\nstruct Frame {\n};\n}  // namespace splatboost\n")
    tree("backbones/other/frame.h", "namespace splatboost::other {\nclass Frame {\n};\n}  // namespace splatboost\n")
    assert run(tmp_path).stderr == ""
    tree("backbones/trainer/support/frame.h", "namespace splatboost {\nclass Frame;\nclass Frame final {\n};\n}\n")
    result = run(tmp_path)
    assert result.returncode == 1
    [line] = result.stderr.splitlines()
    assert line.endswith(": splatboost::Frame is defined in backbones/trainer/support/frame.h too")


@pytest.mark.parametrize("text", ["see `core/src/device/lunch.h`", "[nets](backbones/families/net)"])
def test_a_path_in_the_docs_that_is_not_there_is_named(tree, tmp_path, text):
    tree("docs/page.md", text.replace("](", "](../"))
    result = run(tmp_path)
    assert result.returncode == 1 and result.stderr.startswith("docs/page.md:1: ")
