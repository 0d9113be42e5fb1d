# SPDX-License-Identifier: Apache-2.0
"""scripts/tidy, with a stub of clang-tidy that prints the files it is given."""
import os
import shutil
import subprocess
from pathlib import Path

import pytest

SCRIPT = Path(__file__).resolve().parents[2] / "scripts/tidy"


@pytest.fixture
def tree(tmp_path):
    """A repository with the script, a compiled source with a space in its name, and one that this build does not compile."""
    root = tmp_path / "tree"
    for name in ("scripts", "core", "build/release", "bin"):
        (root / name).mkdir(parents=True)
    shutil.copy(SCRIPT, root / "scripts/tidy")
    for name in ("core/a b.cpp", "core/other.cpp", "core/a.h"):
        (root / name).write_text("\n")
    (root / "build/release/compile_commands.json").write_text('[{"file": "%s/core/a b.cpp"}]\n' % root)
    stub = root / "bin/clang-tidy"
    stub.write_text('#!/bin/sh\nfor word; do case "$word" in -*|build/release) ;; *) echo "$word" ;; esac; done\n')
    stub.chmod(0o755)
    git(root, "init", "-q")
    git(root, "add", "core")
    git(root, "commit", "-qm", "first")
    return root


def git(root, *arguments):
    subprocess.run(["git", "-C", root, "-c", "user.name=a", "-c", "user.email=a@example.org", *arguments], check=True)


def tidy(tree, *arguments, at=""):
    done = subprocess.run([tree / "scripts/tidy", *arguments], capture_output=True, text=True, cwd=tree / at,
                          env={**os.environ, "PATH": f"{tree / 'bin'}:{os.environ['PATH']}"})
    return done.returncode, done.stdout, done.stderr


def test_changed_files_are_checked(tree):
    assert tidy(tree) == (0, "", "")
    for name in ("core/a b.cpp", "core/other.cpp", "core/a.h"):
        (tree / name).write_text("int a;\n")
    assert tidy(tree) == tidy(tree, "--since", "HEAD") == (0, "core/a b.cpp\n", "")


def test_given_files_are_checked_from_any_folder(tree):
    for at, name in (("", "core/a b.cpp"), ("", "./core/../core/a b.cpp"), ("core", "a b.cpp"), ("bin", tree / "core/a b.cpp")):
        assert tidy(tree, name, at=at) == (0, "core/a b.cpp\n", "")


@pytest.mark.parametrize("arguments, words", [
    (["--since", "no-such-commit"], "tidy: --since no-such-commit: no such commit"),
    (["--since"], "include them. Exit status"),
    (["core/missing.cpp"], "tidy: core/missing.cpp: no such file"),
    (["core/a b.cpp", "core/other.cpp"], "tidy: core/other.cpp: is not in build/release/compile_commands.json")])
def test_what_cannot_be_checked_is_an_error(tree, arguments, words):
    code, out, err = tidy(tree, *arguments)
    assert (code, out) == (2, "") and words in err
