# SPDX-License-Identifier: Apache-2.0
"""splatboost patch on miniature checkouts. The patched hosts are run in tests/python."""

import pathlib
import shutil
import subprocess
import sys

import pytest

from conftest import PROGRAM, ROOT, content, refused, run_well

sys.path.append(str(ROOT / "tests/python"))
import miniature_anchors  # noqa: E402
import miniature_convexes  # noqa: E402
import miniature_host  # noqa: E402

RECIPES = ["3dgs", "deformable-3dgs", "dropgaussian", "mip-splatting"]
ALL_RECIPES = sorted(path.parent.name for path in (ROOT / "patches").glob("*/recipe.json"))
COMMANDS = ["list", "show", "apply", "verify", "status", "doctor", "revert", "validate"]


def fails(*arguments):
    """@return the one line on the error stream"""
    line = refused("patch", *arguments)
    assert line.startswith("splatboost patch")
    return line


@pytest.fixture(params=list(miniature_host.RECIPES))
def host(request, tmp_path):
    """A checkout and the recipe that fits it."""
    return miniature_host.write_host(tmp_path / "host", request.param), miniature_host.RECIPES[request.param]


@pytest.fixture(params=[*miniature_host.RECIPES, *miniature_anchors.RECIPES, *miniature_convexes.RECIPES])
def any_host(request, tmp_path):
    """Like host, and also for hosts with other classes than those of 3DGS."""
    hosts = next(m for m in (miniature_anchors, miniature_convexes, miniature_host) if request.param in m.RECIPES)
    return hosts.write_host(tmp_path / "host", request.param), hosts.RECIPES[request.param]


def test_help_is_enough():
    text = run_well("patch", "--help").stdout
    for command in COMMANDS:
        assert command in text
        assert "Example" in run_well("patch", command, "--help").stdout or command == "list"


def test_list_and_show_tell_layouts_options_and_edits():
    text = run_well("patch", "list").stdout
    for name in RECIPES:
        assert name in text
        shown = run_well("patch", "show", name).stdout
        for part in ("layouts", "--boost", "train.py", "boost.densify_and_prune(", "github.com"):
            assert part in shown
    for name in ALL_RECIPES:
        assert name in text
        assert "github.com" in run_well("patch", "show", name).stdout
        assert "well formed" in run_well("patch", "validate", name).stdout


def test_from_apply_to_revert(any_host):
    tree, recipe = any_host
    before = content(tree)
    assert f"patch apply {recipe} {tree}" in run_well("patch", "status", tree).stdout
    diff = run_well("patch", "apply", recipe, tree, "--dry-run").stdout
    assert content(tree) == before
    assert "patched with" in run_well("patch", "apply", recipe, tree).stdout
    patched = content(tree)
    assert "patched already" in run_well("patch", "apply", recipe, tree).stdout
    assert content(tree) == patched
    assert "is in place" in run_well("patch", "verify", tree).stdout
    assert "is in place" in run_well("patch", "status", tree).stdout
    assert "+++ b/train.py" in run_well("patch", "revert", tree, "--dry-run").stdout
    assert "was removed" in run_well("patch", "revert", tree).stdout
    assert content(tree) == before
    assert "not patched" in run_well("patch", "revert", tree).stdout

    # patch(1) accepts the diff and produces the same files.
    if shutil.which("patch"):
        subprocess.run(["patch", "-p1", "-s"], input=diff, text=True, cwd=tree, check=True)
        assert content(tree) == {path: text for path, text in patched.items() if not path.startswith(".splatboost/")}


def test_own_edits_stay(any_host):
    tree, recipe = any_host
    train = tree / "train.py"
    run_well("patch", "apply", recipe, tree)
    train.write_text("# mine\n" + train.read_text())
    assert "your own changes are kept in train.py" in run_well("patch", "verify", tree).stdout
    run_well("patch", "revert", tree)
    assert train.read_text().startswith("# mine\n")
    assert "boost" not in train.read_text()


def test_a_changed_file_stops_all(host):
    tree, recipe = host
    train = tree / "train.py"
    train.write_text(train.read_text().replace("gaussians.densify_and_prune(", "gaussians.grow("))
    before = content(tree)
    line = fails("apply", recipe, tree)
    assert "train.py: 'gaussians.densify_and_prune(' is missing" in line
    assert f"{recipe} would fit, but train.py" in run_well("patch", "status", tree).stdout
    assert content(tree) == before


def test_a_doubled_anchor_is_told_with_its_lines(host):
    tree, recipe = host
    train = tree / "train.py"
    train.write_text(train.read_text() + "\n# Optimizer step\n")
    assert "train.py: '# Optimizer step' is on lines" in fails("apply", recipe, tree)


#: fork → the message for each of its changes
FORK_MESSAGES = {
    "pixel-gs": ["scene/gaussian_model.py: line 101: 'def add_densification_stats(self, on_screen, seen, covered):'",
                 "train.py: line 35: 'gaussians.add_densification_stats("],
    "deformable-3dgs": ["train.py: 'checkpoint_iterations', which the patch uses, is not defined in training(), line 12: "
                        "'def training(dataset, opt, pipe):'",
                        "gaussian_renderer/__init__.py: line 6: 'def render(cam, pc, pipe, bg_color, moved, turned, stretched):'",
                        "expected no argument means2D_densify", "expected 2 results"],
    "absgs": ["gaussian_renderer/__init__.py: line 17: 'rendered_image, radii, weights = rasterizer(",
              "expected (self, max_grad, min_opacity, extent, max_screen_size)", "expected 4 arguments"],
}


@pytest.mark.parametrize("fork, only", [(fork, only) for fork, all_of_it in FORK_MESSAGES.items()
                                        for only in [None, *range(len(all_of_it))]])
def test_forks_that_only_look_like_3dgs_are_refused(tmp_path, fork, only):
    tree = miniature_host.write_fork(tmp_path / "fork", fork, only)
    before = content(tree)
    line = fails("apply", "3dgs", tree)
    if only is None:
        assert any(message in line for message in FORK_MESSAGES[fork])
    else:
        assert FORK_MESSAGES[fork][only] in line
    # The advice is never to undo the fork's changes.
    assert "a fork needs its own recipe: splatboost patch doctor PATH" in line
    assert "put" not in line.split("; ")[-1] and "fresh checkout" not in line
    assert content(tree) == before
    assert "3dgs would fit, but" in run_well("patch", "status", tree).stdout


@pytest.mark.parametrize("layout", list(miniature_anchors.RECIPES))
def test_a_changed_near_plane_is_refused(tmp_path, layout):
    """Our rasterizer would train with 0.2 without a word."""
    tree = miniature_anchors.write_host(tmp_path / "host", layout)
    file = tree / miniature_anchors.NEAR_PLANE
    old = file.read_text()
    for kept in ("", "// if (p_view.z <= 0.2f)\n"):  # the old line, kept as a comment
        file.write_text(kept + old.replace("0.2f", "0.0001f"))
        line = fails("apply", miniature_anchors.RECIPES[layout], tree)
        assert "auxiliary.h: 'if (p_view.z <= 0.2f)' is missing; nearest is line 1" in line
        assert "our rasterizer has this near plane" in line


def test_doctor_tells_the_nearest_recipe_and_what_does_not_hold(host, tmp_path):
    tree, recipe = host
    text = run_well("patch", "doctor", tree).stdout
    assert f"nearest is {recipe}, " in text and f"Everything matches: splatboost patch apply {recipe} {tree}" in text
    assert "\n  no " not in text
    fork = miniature_host.write_fork(tmp_path / "fork", "deformable-3dgs")
    before = content(fork)
    text = run_well("patch", "doctor", fork).stdout
    assert "nearest is 3dgs, layout 2023" in text and "A recipe for a fork" in text
    for told in ("def render", "expected no argument means2D_densify, expected 2 results", "'checkpoint_iterations'",
                 "ok train.py:35  'gaussians.add_densification_stats('"):
        assert told in text
    assert text.count("\n  no ") == 3
    assert content(fork) == before
    run_well("patch", "apply", recipe, tree)
    assert "is in place" in run_well("patch", "doctor", tree).stdout
    (tmp_path / "empty").mkdir()
    assert "no part of any recipe matches" in run_well("patch", "doctor", tmp_path / "empty").stdout


def test_a_formatters_line_breaks_do_not_matter(tmp_path):
    tree = miniature_host.write_host(tmp_path / "host", "3dgs-2023")
    changes = [
        ("train.py", "if iteration > opt.densify_from_iter and iteration % opt.densification_interval == 0:",
         """if (
                    iteration > opt.densify_from_iter
                    and iteration % opt.densification_interval == 0
                ):"""),
        ("gaussian_renderer/__init__.py", "rasterizer = GaussianRasterizer(view)", """rasterizer = GaussianRasterizer(
        view,  # (made above
    )"""),
        ("render.py", "scene = Scene(dataset, gaussians, load_iteration=1, shuffle=False)", """scene = Scene(
            dataset,
            gaussians,
            load_iteration=1,
            shuffle=False,
        )"""),
        ("train.py", "from arguments import ModelParams, OptimizationParams", """from arguments import ModelParams, \\
    OptimizationParams"""),
    ]
    for file, what, by in changes:
        text = (tree / file).read_text()
        assert what in text
        (tree / file).write_text(text.replace(what, by))
    before = content(tree)
    run_well("patch", "apply", "3dgs", tree)
    for path in tree.rglob("*.py"):
        compile(path.read_text(), str(path), "exec")
    assert "if (\n                    boost.grows()\n                ):" in (tree / "train.py").read_text()
    run_well("patch", "verify", tree)
    run_well("patch", "revert", tree)
    assert content(tree) == before


def test_what_an_interrupted_command_left_is_told_and_removed(tmp_path):
    tree = miniature_host.write_host(tmp_path / "host", "3dgs-2023")
    before = content(tree)
    (tree / ".splatboost").mkdir()
    (tree / ".splatboost/patch.json.splatboost-new").write_text("{")
    assert "patch revert" in run_well("patch", "status", tree).stdout
    assert "removed .splatboost/patch.json.splatboost-new" in run_well("patch", "revert", tree).stdout
    assert content(tree) == before and not (tree / ".splatboost").exists()
    run_well("patch", "apply", "3dgs", tree)
    (tree / "train.py.splatboost-old").write_text("")
    assert "left train.py.splatboost-old" in run_well("patch", "status", tree).stdout
    run_well("patch", "apply", "3dgs", tree)
    assert not (tree / "train.py.splatboost-old").exists()


def test_commands_at_the_same_time_wait_for_each_other(tmp_path):
    tree = miniature_host.write_host(tmp_path / "host", "3dgs-2023")
    before = content(tree)

    def twice(*command):
        running = [subprocess.Popen([PROGRAM, "patch", *command], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
                   for _ in range(2)]
        ends = [(one.communicate(), one.returncode) for one in running]
        assert all(code == 0 for _, code in ends), ends
        return sorted(said[0].split(": ")[1].split(" ")[1] for said, _ in ends)

    for _ in range(5):
        assert twice("apply", "3dgs", str(tree)) == ["already", "with"]
        run_well("patch", "verify", tree)
        twice("revert", str(tree))
        assert content(tree) == before


def test_a_lost_record_is_told(any_host):
    tree, recipe = any_host
    run_well("patch", "apply", recipe, tree)
    patched = content(tree)
    shutil.rmtree(tree / ".splatboost")
    told = "contains a patch, but not its record"
    for command in (["apply", recipe], ["verify"], ["revert"]):
        line = fails(*command, tree)
        assert told in line and "git checkout" in line and "train.py" in line
    for command in ("status", "doctor"):
        assert told in run_well("patch", command, tree).stdout
    assert content(tree) == {path: text for path, text in patched.items() if not path.startswith(".splatboost/")}


@pytest.mark.skipif(not shutil.which("git"), reason="needs git")
def test_git_clean_and_stash_leave_the_record(tmp_path):
    tree = miniature_host.write_host(tmp_path / "host", "3dgs-2023")
    git = ["git", "-C", str(tree), "-c", "user.name=a", "-c", "user.email=a@b"]
    for command in (["init", "-q"], ["add", "-A"], ["commit", "-qm", "upstream"]):
        subprocess.run(git + command, check=True)
    run_well("patch", "apply", "3dgs", tree)
    subprocess.run(git + ["clean", "-fdq"], check=True)
    run_well("patch", "verify", tree)
    subprocess.run(git + ["stash", "-qu"], check=True)
    subprocess.run(git + ["stash", "pop", "-q"], check=True)
    run_well("patch", "verify", tree)
    run_well("patch", "revert", tree)
    assert not subprocess.run(git + ["status", "--porcelain", "--ignored"], check=True, capture_output=True).stdout


def test_the_recipe_that_fits_is_named(tmp_path):
    tree = miniature_host.write_host(tmp_path / "host", "3dgs-2023")
    assert f"mip-splatting does not fit, but 3dgs does: splatboost patch apply 3dgs {tree}" in fails("apply", "mip-splatting", tree)
    (tmp_path / "none").mkdir()
    assert "contains no folder NAME with a recipe.json" in fails("--recipes", tmp_path / "none", "list")


def test_mistakes(tmp_path):
    assert "available: list, show" in fails()
    assert "did you mean apply?" in fails("aply")
    assert "there is no recipe 'mip'" in fails("show", "mip")
    assert "is not a folder" in fails("apply", "3dgs", tmp_path / "none")
    assert "unknown layout of 3dgs" in fails("apply", "3dgs", tmp_path)
    assert "not patched" in fails("verify", tmp_path)
    assert "did you mean --dry-run?" in fails("apply", "3dgs", tmp_path, "--dry-rum")
    assert "path" in fails("apply", "3dgs")
    shutil.copytree(ROOT / "patches/3dgs", tmp_path / "recipes/mine")
    recipe = tmp_path / "recipes/mine/recipe.json"
    recipe.write_text(recipe.read_text().replace('"boost.grows()"', '"boost.grows("'))
    assert "recipe.json: edits[" in fails("--recipes", tmp_path / "recipes", "validate", "mine")
    assert "not a folder of recipes" in fails("--recipes", tmp_path / "none", "list")


def test_the_wrong_recipe_changes_nothing(any_host):
    tree, recipe = any_host
    before = content(tree)
    for other in ALL_RECIPES:
        if other != recipe:
            assert f"{other} does not fit, but {recipe} does" in fails("apply", other, tree)
    assert content(tree) == before


def test_an_installed_program_finds_its_recipes(tmp_path):
    (tmp_path / "bin").mkdir()
    program = shutil.copy(PROGRAM, tmp_path / "bin/splatboost")
    for recipe in (ROOT / "patches").glob("*/recipe.json"):
        shutil.copytree(recipe.parent, tmp_path / "share/splatboost/patches" / recipe.parent.name)
    done = subprocess.run([program, "patch", "list"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "mip-splatting" in done.stdout


def test_recipes_are_installed(tmp_path):
    build = pathlib.Path(PROGRAM).parents[1]
    script = build / "cmake_install.cmake"
    # CMake writes an empty script where there are no rules.
    if not script.exists() or "SPLATBOOST_INSTALL:BOOL=OFF" in (build / "CMakeCache.txt").read_text():
        pytest.skip("no install rules in this build")
    assert "share/splatboost/patches" in script.read_text()
