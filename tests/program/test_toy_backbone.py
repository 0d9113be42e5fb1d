# SPDX-License-Identifier: Apache-2.0
"""A backbone is two folders: the program is built with those of tests/toy_backbone, and no other file refers to it."""

import json
import subprocess

from conftest import PROGRAM, run_program

TOY = PROGRAM.with_name("splatboost_with_toy")


def run_toy(*arguments):
    return subprocess.run([str(TOY), *map(str, arguments)], capture_output=True, text=True, timeout=300, check=False)


def test_a_tenth_backbone_is_compared_and_measured_again(scene, tmp_path):
    config = tmp_path / "config.json"
    config.write_text(json.dumps({"backbone": {"name": "toy", "scaling_rate": 0.004}, "boost": {"views": 3}}))
    done = run_toy("compare", "-s", scene, "-m", tmp_path / "both", "--iterations", "40", "--config", config, "--quiet")
    assert done.returncode == 0, done.stderr
    for run in ("baseline", "boosted"):
        assert json.loads((tmp_path / "both" / run / "results.json").read_text())["backbone"] == "toy"
        settings = json.loads((tmp_path / "both" / run / "config.json").read_text())
        assert settings["backbone"] == {"name": "toy", "scaling_rate": 0.004}
        assert settings["boost"]["beta"] == 0.8 and settings["boost"]["views"] == 3
    assert run_toy("eval", "-m", tmp_path / "both/boosted", "--quiet").returncode == 0


def test_help_names_it():
    shown = run_toy("train", "--help").stdout
    assert "toy" in shown and "vanilla" in shown and "toy 2000" in shown and "toy 0.8" in shown


def test_the_program_without_its_folders_does_not_know_it(scene, tmp_path):
    done = run_program("train", "-s", scene, "-m", tmp_path / "model", "--backbone", "toy")
    assert done.returncode == 2 and "toy" in done.stderr and "vanilla" in done.stderr and done.stderr.count("\n") == 1
