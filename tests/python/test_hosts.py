# SPDX-License-Identifier: Apache-2.0
"""Patched hosts, from the command line to the saved model: miniature checkouts of each layout, on the CPU."""

import json
import os
import shutil
import subprocess
import sys
import types

import conftest
import host_runner
import miniature_anchors
import miniature_convexes
import miniature_host
import numpy
import pytest
import torch

PROGRAM = conftest.BUILD / "bin/splatboost"
LAYOUTS = list(miniature_host.RECIPES)
# Growth every 10 iterations from 20 to 60; late pruning after 60.
RUN = "--iterations 120 --densification_interval 10 --densify_from_iter 10 --densify_until_iter 61".split()
# Growth at 15, 30 and 45, late pruning from 30 on; then the host's own pruning.
RUN_OF_CONVEXES = "--iterations 90 --densification_interval 15 --densify_from_iter 10 --densify_until_iter 50".split()
RUN_OF_ANCHORS = "--iterations 90 --start_stat 3 --update_interval 10 --update_from 9 --update_until 61".split()


def patch(*arguments):
    done = subprocess.run([str(PROGRAM), "patch", *map(str, arguments)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def command(tree, script, *arguments):
    """Runs the command line itself; host_runner.run does the same without importing torch anew."""
    environment = dict(os.environ, PYTHONPATH=str(conftest.PACKAGE), OMP_NUM_THREADS="1")
    return subprocess.run([sys.executable, "-m", "splatboost.cpu", str(tree / script), *map(str, arguments)],
                          capture_output=True, text=True, check=False, env=environment, timeout=300)


def train(tree, model, *arguments, run=None):
    done = host_runner.run(tree, "train.py", "--model_path", model, *(run or RUN), *arguments)
    assert done.returncode == 0, done.stderr
    boosted = "splatboost" in (tree / "train.py").read_text() and "off" not in arguments
    assert done.stdout.count("SplatBoost: ") == boosted  # one line of information
    return dict(json.loads((model / "losses.json").read_text()), told=done.stdout)


def files_of(tree):
    return {path.relative_to(tree): path.read_bytes() for path in tree.rglob("*")
            if path.is_file() and "__pycache__" not in path.parts}


@pytest.mark.skipif(not PROGRAM.exists(), reason="the program is not built")
@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_layout_from_patch_to_revert(tmp_path, layout):
    tree = miniature_host.write_host(tmp_path / "tree", layout)
    before = files_of(tree)
    unpatched = train(tree, tmp_path / "unpatched")

    recipe = miniature_host.RECIPES[layout]
    assert recipe + " fits" in patch("status", tree)
    patch("apply", recipe, tree)
    patch("verify", tree)

    off = train(tree, tmp_path / "off", "--boost", "off")
    assert off["losses"] == unpatched["losses"]
    assert off["counts"] == unpatched["counts"]
    assert not (tmp_path / "off/splatboost.json").exists()

    # A box that cuts, even if the default does not, so that the renders below show whether it is used.
    hosts_own = layout in ("2dgs", "gof")  # the host's rasterizer draws
    on = train(tree, tmp_path / "on", *([] if hosts_own else ["--boost_beta", "0.5"]))
    assert on["counts"][-1] < off["counts"][-1]
    assert on["counts"][-1] < max(on["counts"]), "late pruning removed nothing"
    assert sum(on["losses"][-20:]) < 0.9 * sum(on["losses"][:20]), "it does not learn"
    backbones = {"3dgs": "vanilla", "absgs": "vanilla", "2dgs": "vanilla", "gaussian-opacity-fields": "mip-splatting"}
    assert json.loads((tmp_path / "on/splatboost.json").read_text()) == {
        "backbone": backbones.get(recipe, recipe), "beta": None if hosts_own else 0.5}

    if hosts_own:
        patch("revert", tree)
        assert files_of(tree) == before
        return
    # The host's render script draws with the beta of the model, and as published without it.
    drawn = []
    for keep in (True, False):
        if not keep:
            (tmp_path / "on/splatboost.json").unlink()
        done = host_runner.run(tree, "render.py", "--model_path", tmp_path / "on")
        assert done.returncode == 0, done.stderr
        drawn.append(torch.load(str(tmp_path / "on/render.pt")))
    assert not torch.equal(*drawn)
    assert (drawn[0] - drawn[1]).abs().mean() < 0.05

    patch("revert", tree)
    assert files_of(tree) == before


@pytest.mark.skipif(not PROGRAM.exists(), reason="the program is not built")
def test_a_recipe_for_a_fork_lives_in_a_folder_of_the_users(tmp_path):
    """The steps of docs/patching.md, A recipe for a fork, with the hooks shown there."""
    fork = miniature_host.write_host(tmp_path / "fork", "3dgs-2023")
    for file, old, new in (
            ("train.py", "from arguments import ModelParams, OptimizationParams", "from arguments import OptimizationParams, ModelParams"),
            ("train.py", "def training(dataset, opt, pipe, checkpoint_iterations):", "def training(dataset, opt, pipe, *rest):"),
            ("train.py", "densify_and_prune(opt.densify_grad_threshold,", "densify_and_prune(opt.densify_grad_threshold, 0.0004,"),
            ("scene/gaussian_model.py", "densify_and_prune(self, max_grad,", "densify_and_prune(self, max_grad, max_grad_abs,")):
        text = (fork / file).read_text()
        assert text.count(old) == 1
        (fork / file).write_text(text.replace(old, new))
    before = files_of(fork)
    unpatched = train(fork, tmp_path / "unpatched")
    mine = ["--recipes", tmp_path / "my recipes"]
    folder = tmp_path / "my recipes/my-fork"
    shutil.copytree(conftest.ROOT / "patches/3dgs", folder)
    told = patch(*mine, "doctor", fork)
    assert "nearest is line 10: 'from arguments import OptimizationParams, ModelParams'" in told
    assert "expected (self, max_grad, min_opacity" in told and "expected 4 arguments" in told

    recipe = json.loads((folder / "recipe.json").read_text())
    recipe["layouts"] = recipe["layouts"][:1]
    for key in ("edits", "needs"):
        recipe[key] = [part for part in recipe[key] if "2023" in part.pop("layouts", ["2023"])]
    recipe["files"] = [{"file": "my_hooks.py", "source": "my_hooks.py", "why": "our hooks"}]
    text = json.dumps(recipe)
    for old, new in (("from splatboost.hooks import vanilla as", "import my_hooks as"),
                     ("dataset.model_path, checkpoint_iterations)", "dataset.model_path)"),
                     ("from arguments import ModelParams", "from arguments import OptimizationParams"),
                     ('"max_grad", "min_opacity"', '"max_grad", "max_grad_abs", "min_opacity"'), ('"arguments": 4', '"arguments": 5')):
        assert old in text
        text = text.replace(old, new)
    (folder / "recipe.json").write_text(text)
    page = (conftest.ROOT / "docs/patching.md").read_text().split("## A recipe for a fork")[1]
    hooks = page.split("```python\n")[1].split("```")[0]
    (folder / "my_hooks.py").write_text(hooks + "        print('my growth')\n")
    assert "my-fork: well formed" in patch(*mine, "validate", "my-fork")

    # The commands that are shown find the recipe.
    apply = "splatboost patch --recipes '%s' apply my-fork %s\n" % (mine[1], fork)
    assert "my-fork fits" in patch(*mine, "status", fork) and apply in patch(*mine, "status", fork)
    assert "Everything matches: " + apply in patch(*mine, "doctor", fork)
    patch(*mine, "apply", "my-fork", fork)
    patch("verify", fork)
    off = train(fork, tmp_path / "off", "--boost", "off")
    assert off["losses"] == unpatched["losses"] and "my growth" not in off["told"]
    on = train(fork, tmp_path / "on")
    assert on["told"].count("my growth") > 2 and on["counts"] != off["counts"]
    patch("revert", fork)
    assert files_of(fork) == before


@pytest.mark.skipif(not PROGRAM.exists(), reason="the program is not built")
@pytest.mark.parametrize("layout", list(miniature_anchors.RECIPES))
def test_a_layout_of_anchors_from_patch_to_revert(tmp_path, layout):
    tree = miniature_anchors.write_host(tmp_path / "tree", layout)
    before = files_of(tree)
    unpatched = train(tree, tmp_path / "unpatched", run=RUN_OF_ANCHORS)

    recipe = miniature_anchors.RECIPES[layout]
    assert recipe + " fits" in patch("status", tree)
    patch("apply", recipe, tree)
    patch("verify", tree)

    off = train(tree, tmp_path / "off", "--boost", "off", run=RUN_OF_ANCHORS)
    assert (off["losses"], off["counts"]) == (unpatched["losses"], unpatched["counts"])
    assert (tmp_path / "off/model.npz").read_bytes() == (tmp_path / "unpatched/model.npz").read_bytes()
    assert not (tmp_path / "off/splatboost.json").exists()

    # Slots are numbered anchor by anchor; with another order the gate would prevent less growth.
    on = train(tree, tmp_path / "on", "--boost_tau_d", "4.2", run=RUN_OF_ANCHORS)
    assert 60 < on["counts"][-1] < 0.9 * off["counts"][-1]
    assert sum(on["losses"][-20:]) < 0.9 * sum(on["losses"][:20]), "it does not learn"
    beta = {"scaffold-gs": 0.7, "octree-gs": 1}[recipe]
    assert json.loads((tmp_path / "on/splatboost.json").read_text()) == {"backbone": recipe, "beta": pytest.approx(beta)}
    assert "SplatBoost: default rules of %s, beta %g, tau_d 4.2, anchors grow every 10 from 9 to 61" % (recipe, beta) in on["told"]

    if layout == "scaffold":
        capped = train(tree, tmp_path / "capped", "--boost_max_anchors", "75", "--boost_tau_d", "4.2", run=RUN_OF_ANCHORS)
        assert 60 < max(capped["counts"]) <= 75
    else:  # a closed gate stops growth only: levels of detail still change
        closed = train(tree, tmp_path / "closed", "--boost_tau_d", "1e9", run=RUN_OF_ANCHORS)
        assert max(closed["counts"]) == 60 and closed["extra"] > 0

    # render.py draws as the trainer's own evaluation did, with the beta of the model.
    done = host_runner.run(tree, "render.py", "--model_path", tmp_path / "on")
    assert done.returncode == 0, done.stderr
    assert torch.equal(torch.load(str(tmp_path / "on/trained.pt")), torch.load(str(tmp_path / "on/render.pt")))

    patch("revert", tree)
    assert files_of(tree) == before


@pytest.mark.skipif(not PROGRAM.exists(), reason="the program is not built")
def test_convexes_from_patch_to_revert(tmp_path):
    tree = miniature_convexes.write_host(tmp_path / "tree")
    before = files_of(tree)
    unpatched = train(tree, tmp_path / "unpatched", run=RUN_OF_CONVEXES)
    assert unpatched["counts"][-1] > 3 * unpatched["counts"][0]

    assert "convex-splatting fits" in patch("status", tree)
    patch("apply", "convex-splatting", tree)
    patch("verify", tree)

    off = train(tree, tmp_path / "off", "--boost", "off", run=RUN_OF_CONVEXES)
    assert (off["losses"], off["counts"]) == (unpatched["losses"], unpatched["counts"])
    assert (tmp_path / "off/model.npz").read_bytes() == (tmp_path / "unpatched/model.npz").read_bytes()
    assert not (tmp_path / "off/splatboost.json").exists()

    # The threshold is scaled down for images this small, and convexes cover much of them.
    on = train(tree, tmp_path / "on", "--boost_tau_d", "30000", run=RUN_OF_CONVEXES)
    assert on["counts"][0] < on["counts"][-1] < 0.6 * off["counts"][-1]
    assert sum(on["losses"][-20:]) < 0.7 * sum(on["losses"][:20]), "it does not learn"
    assert json.loads((tmp_path / "on/splatboost.json").read_text()) == {"backbone": "convex-splatting", "beta": 1.0}
    # Late pruning waits for the end of the host's growth.
    assert ("SplatBoost: default rules of convex-splatting, beta 1, tau_d 30000, growth at 15 to 45 every 15, late pruning at 50 to "
            "81, steps by schedule") in on["told"]
    assert max(a - b for a, b in zip(on["counts"][54:], on["counts"][55:])) > 0, "late pruning removed nothing"

    capped = train(tree, tmp_path / "capped", "--boost_max_convexes", "90", "--boost_tau_d", "0", run=RUN_OF_CONVEXES)
    assert 80 < max(capped["counts"]) <= 90
    # With a closed gate only growth changes; the host's statistics are reset as with growth.
    closed = train(tree, tmp_path / "closed", "--boost_tau_d", "1e9", run=RUN_OF_CONVEXES)
    assert max(closed["counts"]) == 60

    # The host's render script draws with the beta of the model, and as published without it.
    drawn = []
    for keep in (True, False):
        if not keep:
            (tmp_path / "on/splatboost.json").unlink()
        done = host_runner.run(tree, "render.py", "--model_path", tmp_path / "on")
        assert done.returncode == 0, done.stderr
        drawn.append(torch.load(str(tmp_path / "on/render.pt")))
    assert not torch.equal(*drawn) and (drawn[0] - drawn[1]).abs().mean() < 0.1

    patch("revert", tree)
    assert files_of(tree) == before


@pytest.mark.skipif(not PROGRAM.exists(), reason="the program is not built")
def test_pgsr_reads_cameras_of_one_focal_length_and_its_cap_holds(tmp_path):
    tree = miniature_host.write_host(tmp_path / "tree", "pgsr")
    readers = tree / "scene/dataset_readers.py"

    def focals():
        scope = {}
        exec(readers.read_text(encoding="utf-8"), scope)
        return scope["focals"]("SIMPLE_PINHOLE", [50.0], 100)

    with pytest.raises(UnboundLocalError):
        focals()
    patch("apply", "pgsr", tree)
    assert focals() == (50.0, 50.0, 2.0)
    # Under a cap those with the highest priority grow; the host's own functions would choose others.
    capped = train(tree, tmp_path / "model", "--max_all_points", "75", "--boost_max_gaussians", "900")
    assert 60 < max(capped["counts"]) <= 75
    assert capped["told"].startswith("SplatBoost: default rules of pgsr, beta 1,")


@pytest.mark.skipif(not PROGRAM.exists(), reason="the program is not built")
def test_options_of_the_patch(tmp_path):
    tree = miniature_host.write_host(tmp_path / "tree", "3dgs-2023")
    patch("apply", "3dgs", tree)
    done = command(tree, "train.py", "--model_path", tmp_path / "model", "--iterations", "5", "--boost", "perhaps")
    assert done.returncode == 2
    assert "--boost: expected on or off, got perhaps" in done.stderr
    capped = train(tree, tmp_path / "model", "--boost_max_gaussians", "70", "--boost_beta", "0.7")
    assert max(capped["counts"]) == 70
    assert json.loads((tmp_path / "model/splatboost.json").read_text())["beta"] == pytest.approx(0.7)
    # Training again without the boost removes the stored beta.
    train(tree, tmp_path / "model", "--boost", "off")
    assert not (tmp_path / "model/splatboost.json").exists()


@pytest.mark.skipif(not PROGRAM.exists(), reason="the program is not built")
@pytest.mark.parametrize("hosts, layout, options", [
    (miniature_host, "3dgs-2023", {
        "--boost_beta 0": "--boost_beta: must be in (0, 1], got 0.0", "--boost_beta 2": "--boost_beta: must be in (0, 1], got 2.0",
        "--boost_tau_d -1": "--boost_tau_d: must be at least 0, got -1.0",
        "--densification_interval 0": "--densification_interval: must be at least 1, got 0",
        "--iterations 0": "--iterations: expected at least 1, got 0",
        "--boost_max_gaussians -5": "--boost_max_gaussians: expected at least 0, got -5"}),
    (miniature_anchors, "scaffold", {
        "--boost_beta 2": "--boost_beta: must be in (0, 1], got 2.0",
        "--boost_max_anchors -5": "--boost_max_anchors: expected at least 0, got -5"}),
    (miniature_convexes, None, {
        "--densification_interval 0": "--densification_interval: expected at least 1, got 0",
        "--boost_tau_d nan": "--boost_tau_d: expected a finite number, got nan",
        "--boost_max_convexes -5": "--boost_max_convexes: expected at least 0, got -5"})])
def test_bad_options_are_told_in_one_line(tmp_path, hosts, layout, options):
    tree = hosts.write_host(tmp_path / "tree", *([layout] if layout else []))
    patch("apply", hosts.RECIPES[layout] if layout else "convex-splatting", tree)
    for given, words in options.items():
        done = host_runner.run(tree, "train.py", "--model_path", tmp_path / "model", "--iterations", "5", *given.split())
        assert (done.returncode, done.stderr.count("\n")) == (2, 1), done.stderr
        assert done.stderr.startswith(words)
    done = host_runner.run(tree, "train.py", "--model_path", tmp_path / "model", "--iterations", "1", "--boost", "off",
                           *given.split())
    assert done.returncode == 0, "without boost the options have no effect: " + done.stderr


def test_errors_of_the_runner(tmp_path):
    done = command(tmp_path, "train.py")
    assert done.returncode == 2
    assert "there is no script" in done.stderr
    (tmp_path / "needy.py").write_text("import no_such_package_at_all\n")
    done = command(tmp_path, "needy.py")
    assert done.returncode == 2
    assert "needy.py needs the Python module no_such_package_at_all: pip install" in done.stderr
    # All missing modules are listed at once, by their names on PyPI; optional imports are not.
    (tmp_path / "part").mkdir()
    (tmp_path / "part/__init__.py").write_text("from . import inner\n")
    (tmp_path / "part/inner.py").write_text("import no_such_b.sub\n\ndef f():\n    import no_such_c\n")
    (tmp_path / "needy.py").write_text(
        "import os\nfrom part import inner\nimport no_such_a\ntry:\n    import no_such_d\nexcept ImportError:\n    pass\n")
    done = command(tmp_path, "needy.py")
    assert done.returncode == 2
    assert "needs the Python modules no_such_a, no_such_b: pip install" in done.stderr
    assert "no_such_c" not in done.stderr and "no_such_d" not in done.stderr
    (tmp_path / "failing.py").write_text("raise SystemExit(7)\n")
    assert command(tmp_path, "failing.py").returncode == 7


def test_a_script_in_a_folder_of_the_checkout(tmp_path):
    tree = miniature_host.write_host(tmp_path / "tree", "pgsr")
    (tree / "scripts/beside.py").write_text("import no_such_package_at_all\n")
    (tree / "scripts/look.py").write_text(
        "import os, sys\nsys.path.append(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))\n"
        "from scene import Scene\nfrom gaussian_renderer import render\nimport diff_plane_rasterization\n"
        "print(diff_plane_rasterization.__name__)\n")
    done = command(tree, "scripts/look.py")
    assert done.returncode == 0, done.stderr
    assert "diff_plane_rasterization" in done.stdout
    with (tree / "scripts/look.py").open("a") as script:
        script.write("import beside\n")
    done = command(tree, "scripts/look.py")
    assert done.returncode == 2
    assert "look.py needs the Python module no_such_package_at_all: pip install" in done.stderr


def test_cuda_calls_happen_on_the_cpu(tmp_path):
    (tmp_path / "calls.py").write_text("""
import sys
import torch
for tensor in (torch.zeros(2, device="cuda"), torch.tensor([1.0], device=torch.device("cuda:0")), torch.rand(3).cuda(),
               torch.ones(1).to("cuda"), torch.ones(1).to(device="cuda", dtype=torch.float64), torch.eye(2).to(0 * 1.0 + torch.ones(1)),
               torch.ones(2).new_zeros((2,), device="cuda"), torch.zeros_like(torch.ones(2), device="cuda"),
               torch.nn.Linear(2, 2).cuda().weight, torch.nn.Linear(2, 2).to("cuda").weight,
               torch.randperm(4, device="cuda"), torch.randn(2, generator=torch.Generator(device="cuda").manual_seed(3))):
    assert tensor.device.type == "cpu", tensor
assert torch.ones(1).to(device="cuda", dtype=torch.float64).dtype == torch.float64
start, end = torch.cuda.Event(enable_timing=True), torch.cuda.Event(enable_timing=True)
start.record()
end.record()
torch.cuda.synchronize()
torch.cuda.empty_cache()
torch.cuda.set_device("cuda:0")
assert start.elapsed_time(end) >= 0
assert torch.cuda.max_memory_allocated() > 0
with torch.cuda.stream(None), torch.cuda.device(0):
    pass
torch.save(torch.ones(2), "t.pt")
assert torch.load("t.pt", map_location="cuda").sum() == 2
assert not torch.cuda.is_available()
assert sys.argv[1:] == ["--flag", "x"] and __name__ == "__main__"
import open3d, wandb, lpipsPyTorch
lpipsPyTorch.lpips(1, 2)
import subprocess
told = subprocess.run("nvidia-smi -q -d Memory |grep -A4 GPU|grep Used", shell=True, stdout=subprocess.PIPE).stdout.decode()
assert int(told.split("\\n")[0].split()[2]) >= 0
""")
    done = subprocess.run([sys.executable, "-m", "splatboost.cpu", "calls.py", "--flag", "x"], capture_output=True, text=True,
                          check=False, cwd=tmp_path, env=dict(os.environ, PYTHONPATH=str(conftest.PACKAGE), TORCH_HOME=str(tmp_path)))
    assert done.returncode == 0, done.stderr
    assert "LPIPS is not measured" in done.stdout


def test_checkpoints_are_read_whole_by_any_torch():
    """In a separate process, which patches torch. By default torch since 2.6 reads only tensors and plain values."""
    done = subprocess.run([sys.executable, "-c", """
import torch
def of_newer_torch(f, map_location=None, pickle_module=None, *, weights_only=None):
    return f, map_location, weights_only
def of_older_torch(f, map_location=None, pickle_module=None):
    return f, map_location
torch.load = of_newer_torch
from splatboost import cpu
cpu.map_cuda()
assert torch.load("a") == ("a", "cpu", False) and torch.load("a", "cuda:0", weights_only=True) == ("a", "cpu", True)
torch.load, torch._splatboost_on_cpu = of_older_torch, False
cpu.map_cuda()
assert torch.load("a") == ("a", "cpu")
"""], capture_output=True, text=True, check=False, env=dict(os.environ, PYTHONPATH=str(conftest.PACKAGE)))
    assert done.returncode == 0, done.stderr


def test_scatter_max_of_hosts_with_anchors():
    from splatboost import _stand_ins

    values, index = torch.randn(40, 3), torch.randint(0, 6, (40,))
    index[:6] = torch.arange(6)
    values[7] = values[8]
    largest, rows = _stand_ins.scatter_max(values, index.unsqueeze(1).expand(-1, 3), dim=0)
    for i in range(6):
        assert torch.equal(largest[i], values[index == i].max(dim=0).values)
    assert torch.equal(values.gather(0, rows), largest)
    none = _stand_ins.scatter_max(torch.zeros(0, 3), torch.zeros((0, 3), dtype=torch.long), dim=0)[0]
    assert none.shape == (0, 3)


def test_pictures_as_torchvision_reads_and_writes_them(tmp_path):
    pytest.importorskip("PIL")
    from PIL import Image

    from splatboost import _stand_ins

    picture = torch.tensor([[[0.0, 1.0], [0.5, 1.5]]] * 3)
    _stand_ins._save_image(picture, str(tmp_path / "p.png"))
    read = _stand_ins._to_tensor(Image.open(tmp_path / "p.png"))
    assert torch.allclose(read, picture.clamp(0, 1), atol=0.5 / 255 + 1e-6) and read.shape == (3, 2, 2)


def test_pictures_of_signed_bytes(monkeypatch):
    pytest.importorskip("PIL")
    from PIL import Image

    from splatboost import _stand_ins

    fromarray = Image.fromarray

    def of_newer_pillow(array, mode=None):
        if array.dtype == numpy.int8:
            raise TypeError("Cannot handle this data type: (1, 1, 3), |i1")
        return fromarray(array, mode)

    monkeypatch.setattr(Image, "fromarray", of_newer_pillow)
    _stand_ins._pictures()
    bytes_of_host = numpy.array(numpy.full((2, 2, 3), 200.0), dtype=numpy.uint8).view(numpy.byte)
    assert (numpy.asarray(Image.fromarray(bytes_of_host, "RGB")) == 200).all()


def test_maps_are_drawn_with_a_newer_matplotlib(monkeypatch):
    from splatboost import _stand_ins

    class FigureCanvasAgg:
        def buffer_rgba(self):
            return memoryview(numpy.arange(24, dtype=numpy.uint8).reshape(2, 3, 4))

    agg, cm = types.SimpleNamespace(FigureCanvasAgg=FigureCanvasAgg), types.SimpleNamespace()
    backends = types.SimpleNamespace(backend_agg=agg)
    whole = types.SimpleNamespace(backends=backends, cm=cm, colormaps={"turbo": "a map"})
    for name, module in (("", whole), (".cm", cm), (".backends", backends), (".backends.backend_agg", agg)):
        monkeypatch.setitem(sys.modules, "matplotlib" + name, module)
    _stand_ins._drawing()
    assert cm.get_cmap("turbo") == "a map"
    assert FigureCanvasAgg().tostring_rgb() == bytes(i for i in range(24) if i % 4 != 3)


def test_numpy_that_torch_cannot_use_is_told(monkeypatch):
    from splatboost import _needs, doctor

    assert _needs.numpy_trouble() is None

    class Zeros:
        def numpy(self):
            raise RuntimeError("Numpy is not available")

    monkeypatch.setattr(torch, "zeros", lambda *_: Zeros())
    assert "Numpy is not available" in _needs.numpy_trouble() and 'pip install "numpy<2"' in _needs.numpy_trouble()
    told = doctor._torch()
    assert ("missing", 'pip install "numpy<2"') in [(state, remedy) for state, _, remedy in told]
    monkeypatch.setattr(torch, "__version__", "1.13.0a0+git")
    assert _needs.install_command(["cv2", "dateutil.parser", "PIL"]) == \
        'pip install "numpy<2" opencv-python-headless pillow python-dateutil'
    monkeypatch.setattr(torch, "__version__", "2.15.0+cpu")
    assert _needs.install_command(["plyfile"]) == "pip install plyfile"
