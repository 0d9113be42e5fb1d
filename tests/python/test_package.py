# SPDX-License-Identifier: Apache-2.0
"""The package without torch, without the library, and against the C headers."""

import os
import re
import subprocess
import sys

import conftest
import pytest

HEADERS = (conftest.ROOT / "core/include/splatboost/c_api.h", conftest.ROOT / "adapters/c/adapters_c.h")


def run(code, **environment):
    return subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
        cwd=conftest.PACKAGE,
        env={**os.environ, **environment},
    )


def declarations():
    text = "".join(h.read_text() for h in HEADERS)
    return re.sub(r"/\*.*?\*/", "", text, flags=re.S)


def test_entries_are_those_of_the_headers():
    from splatboost import _library as lib

    declared = {
        name: 0 if arguments.strip() == "void" else arguments.count(",") + 1
        for name, arguments in re.findall(r"SB_API [\w* ]+?(sb_\w+)\(([^)]*)\);", declarations())
    }
    assert {name: len(arguments) for name, (_, arguments) in lib._ENTRIES.items()} == declared
    assert lib.load().sb_abi_version() == int(re.search(r"#define SB_ABI_VERSION (\d+)", declarations()).group(1))


def test_structs_are_those_of_the_headers():
    from splatboost import _library as lib

    names = {
        "sb_device": lib.Device,
        "sb_tensor": lib.Tensor,
        "sb_camera": lib.Camera,
        "sb_gaussians": lib.Gaussians,
        "sb_raster_options": lib.RasterOptions,
        "sb_raster_outputs": lib.RasterOutputs,
        "sb_image_gradients": lib.ImageGradients,
        "sb_gaussian_gradients": lib.GaussianGradients,
        "sb_convexes": lib.Convexes,
        "sb_convex_options": lib.ConvexOptions,
        "sb_convex_outputs": lib.ConvexOutputs,
        "sb_convex_gradients": lib.ConvexGradients,
        "sb_truth": lib.Truth,
        "sb_loss": lib.Loss,
        "sb_adam_options": lib.AdamOptions,
        "sb_step_intervals": lib.StepIntervals,
        "sb_density": lib.Density,
        "sb_scored_view": lib.ScoredView,
        "sb_views": lib.Views,
    }
    found = re.findall(r"typedef struct (sb_\w+) \{(.*?)\} \1;", declarations(), flags=re.S)
    assert {name for name, _ in found} == set(names)
    kinds = {"int32_t": "c_int", "int64_t": "c_long", "uint64_t": "c_ulong", "float": "c_float", "double": "c_double"}
    for name, body in found:
        fields = []
        for statement in filter(None, (s.strip() for s in body.split(";"))):
            function = re.match(r"int32_t \(\*(\w+)\)", statement)
            if function:
                fields.append((function.group(1), "function"))
                continue
            kind, rest = re.match(r"((?:const )?\w+\*?) (.*)", statement, flags=re.S).groups()
            for field in rest.split(","):
                fields.append((re.sub(r"\[.*", "", field).strip(), kind))
        ours = names[name]._fields_
        assert [f for f, _ in ours] == [f for f, _ in fields], name
        for (field, kind), (_, declared) in zip(ours, fields):
            base = getattr(kind, "_type_", kind) if "Array" in kind.__name__ else kind
            if declared in kinds:
                assert base.__name__ == kinds[declared], (name, field)


def test_library_shows_nothing_but_the_c_abi():
    from splatboost import _library as lib

    library = conftest.BUILD / "lib/libsplatboost.so"
    symbols = subprocess.run(["nm", "-D", "--defined-only", library], capture_output=True, text=True, check=True).stdout
    assert {line.split()[-1] for line in symbols.splitlines()} == set(lib._ENTRIES)


def test_the_readme_lists_all_layouts():
    from splatboost.drop_ins import LAYOUTS

    readme = conftest.PACKAGE / "README.md"
    if not readme.exists():
        pytest.skip("the README is not here")
    table = [line for line in readme.read_text(encoding="utf-8").splitlines() if line.startswith('| `"')]
    for layout, module in LAYOUTS.items():
        assert any('`"%s"`' % layout in row and ".%s`" % module in row for row in table), layout


def test_the_blocks_of_the_readme_run():
    pytest.importorskip("torch")
    readme = conftest.PACKAGE / "README.md"
    if not readme.exists():
        pytest.skip("the README is not here")
    blocks = re.findall(r"^```python\n(.*?)^```", readme.read_text(encoding="utf-8"), flags=re.S | re.M)
    assert len(blocks) == 4
    # One after another, since some continue an earlier one; gsplat itself needs CUDA.
    double = "import sys\nsys.path.append(%r)\nimport gsplat_double\ngsplat_double.install()\n" % os.path.dirname(__file__)
    done = run(double + "\n".join(blocks))
    assert done.returncode == 0, done.stderr


def test_imports_without_torch_and_without_the_library():
    code = """
import sys
sys.modules["torch"] = None  # as if it were not there
import splatboost
assert splatboost.__version__
assert set(splatboost.__all__) == {"__version__", *splatboost._NAMES}
from splatboost import steps_at, StepIntervals, Camera
assert steps_at(StepIntervals(16, 32, 64), 16, 30000)
try:
    splatboost.rasterize
except ImportError as e:
    assert "torch" in str(e)
else:
    raise AssertionError
"""
    done = run(code)
    assert done.returncode == 0, done.stderr
    done = run("import splatboost; splatboost.scaled_iteration(1, 2)", SPLATBOOST_LIBRARY="/nowhere/libsplatboost.so")
    assert done.returncode == 1 and "libsplatboost was not found" in done.stderr
    assert "/nowhere/libsplatboost.so: not found" in done.stderr


def test_a_library_of_another_abi_is_refused(tmp_path):
    source = tmp_path / "other.c"
    source.write_text("int sb_abi_version(void) { return 99; }\n")
    library = tmp_path / "libother.so"
    subprocess.run(["cc", "-shared", "-fPIC", "-o", library, source], check=True)
    done = run("import splatboost; splatboost.scaled_iteration(1, 2)", SPLATBOOST_LIBRARY=str(library))
    assert done.returncode == 1 and "has ABI version 99, this package needs 1" in done.stderr


def test_a_library_that_is_older_than_the_package_is_refused(tmp_path):
    source = tmp_path / "other.c"
    source.write_text("int sb_abi_version(void) { return 1; }\nconst char* sb_version(void) { return \"0\"; }\n")
    library = tmp_path / "libother.so"
    subprocess.run(["cc", "-shared", "-fPIC", "-o", library, source], check=True)
    from splatboost import _library as lib

    told = "the library at %s lacks sb_last_error and %d more: install it and this package from one version" % (
        library, len(lib._ENTRIES) - 3)
    done = run("import splatboost; splatboost.scaled_iteration(1, 2)", SPLATBOOST_LIBRARY=str(library))
    assert done.returncode == 1 and done.stderr.endswith("LibraryError: %s\n" % told)
    done = run("from splatboost import doctor; print(doctor._library())", SPLATBOOST_LIBRARY=str(library))
    assert done.returncode == 0 and "('missing', '%s'" % told in done.stdout


def test_a_library_that_cannot_be_loaded_is_told_with_the_reason(tmp_path):
    text = tmp_path / "libtext.so"
    text.write_text("no library\n" * 100)
    needy = tmp_path / "libneedy.so"
    for name, needs in (("libneeded_by_needy.so", []), (needy.name, ["-Wl,--no-as-needed", "-L%s" % tmp_path, "-lneeded_by_needy"])):
        command = ["cc", "-shared", "-fPIC", "-x", "c", "/dev/null", "-o", tmp_path / name, *needs]
        subprocess.run(command, check=True)
    (tmp_path / "libneeded_by_needy.so").unlink()
    code = "import splatboost; splatboost.scaled_iteration(1, 2)"
    for path, reason in ((text, "invalid ELF header"), (needy, "libneeded_by_needy.so: cannot open shared object file")):
        done = run(code, SPLATBOOST_LIBRARY=str(path))
        assert done.returncode == 1 and "libsplatboost at %s cannot be loaded: %s" % (path, reason) in done.stderr
        assert "was not found" not in done.stderr
    done = run(code, SPLATBOOST_LIBRARY="libof_no_one.so")  # on the system's search path
    assert done.returncode == 1 and "was not found" in done.stderr and "libof_no_one.so: not found" in done.stderr


def test_doctor():
    done = subprocess.run(
        [sys.executable, "-m", "splatboost", "doctor"],
        capture_output=True,
        text=True,
        check=False,
        cwd=conftest.PACKAGE,
        timeout=120,
    )
    from splatboost import __version__

    assert "ok       libsplatboost %s, ABI 1" % __version__ in done.stdout  # CMake's version is the package's
    if "missing" not in done.stdout:
        assert done.returncode == 0 and "draws and differentiates a Gaussian" in done.stdout
    code = "import sys; sys.modules['torch'] = None; from splatboost import doctor; sys.exit(doctor.main())"
    done = run(code)
    assert done.returncode == 1
    remedies = ("apt-get install python3-torch", "--system-site-packages", "pip install torch   (with CUDA")
    assert any(remedy in done.stdout for remedy in remedies)
    done = run(code, SPLATBOOST_LIBRARY="/nowhere/x.so")
    assert done.returncode == 1 and "missing  libsplatboost was not found" in done.stdout


def test_the_torch_for_a_gpu_is_one_with_cuda(tmp_path):
    driver = tmp_path / "nvidia-smi"
    driver.write_text("#!/bin/sh\n")
    driver.chmod(0o755)
    code = "from splatboost import _needs; print(_needs.where_torch_is())"
    with_gpu, without = run(code, PATH=str(tmp_path)).stdout, run(code, PATH="/nowhere").stdout
    assert with_gpu.startswith("pip install torch   (with CUDA") and "with CUDA" not in without


def test_doctor_tells_of_cuda():
    from splatboost import _library as lib

    code = "from splatboost import doctor; print(doctor._library_cuda())"
    told = run(code).stdout
    if not lib.cuda_architectures():
        assert "was built without CUDA" in told and "pip install . --config-settings=cmake.define.SPLATBOOST_CUDA=ON" in told
    else:
        assert "was built with CUDA, for compute capability " + lib.cuda_architectures() in told
        assert ("cannot use a GPU here: no CUDA device 0" in told) == (not lib.load().sb_has_device(lib.CUDA))
    emulated = conftest.BUILD / "lib/libsplatboost_emulated.so"
    if emulated.exists():
        told = run(code, SPLATBOOST_LIBRARY=str(emulated)).stdout
        assert "for compute capability the CPU" in told and "cannot use" not in told


def test_doctor_looks_at_a_checkout(tmp_path):
    (tmp_path / "train.py").write_text("import torchvision\nimport no_such_a, no_such_b.sub\nfrom helpers import f\n")
    (tmp_path / "helpers.py").write_text("from dateutil_of_no_one import parser\n")
    done = run("import sys; from splatboost import doctor; sys.exit(doctor.main(%r))" % str(tmp_path))
    assert done.returncode == 1
    assert "needs dateutil_of_no_one, no_such_a, no_such_b, not installed" in done.stdout
    (tmp_path / "train.py").write_text("import json\n")
    done = run("import sys; from splatboost import doctor; sys.exit(doctor.main(%r))" % str(tmp_path))
    assert "all Python modules that its scripts need are installed" in done.stdout
    (tmp_path / "train.py").unlink()
    done = run("import sys; from splatboost import doctor; sys.exit(doctor.main(%r))" % str(tmp_path))
    assert done.returncode == 1 and "there is no train.py" in done.stdout
    for path in (tmp_path / "nowhere", tmp_path / "helpers.py"):
        done = run("import sys; from splatboost import doctor; sys.exit(doctor.main(%r))" % str(path))
        assert (done.returncode, done.stdout) == (2, "")
        assert done.stderr == "splatboost doctor: there is no folder %s; give that of a backbone's checkout\n" % path


def test_doctor_tells_what_needs_open3d(tmp_path):
    for script in ("train.py", "render.py"):
        (tmp_path / script).write_text("import wandb\n" if script == "train.py" else "import open3d\n")
    code = """
import importlib.util
from splatboost import doctor
there = importlib.util.find_spec
importlib.util.find_spec = lambda name, *given: None if name in ("open3d", "wandb") else there(name, *given)
print(doctor._host(%r))""" % str(tmp_path)
    told = run(code).stdout
    assert "not installed: open3d; render.py needs it for meshes" in told and "--skip_train" in told
    assert "'not installed: wandb', 'python -m splatboost.cpu works without them" in told


def test_doctor_knows_a_checkout_of_photo_slam(tmp_path):
    (tmp_path / "src").mkdir()
    (tmp_path / "src/gaussian_mapper.cpp").write_text("\n")
    told = run("from splatboost import doctor; print(doctor._host(%r))" % str(tmp_path)).stdout
    assert told.startswith("[('ok', '%s: Photo-SLAM, in C++, needs no Python modules" % tmp_path)


def test_doctor_looks_at_a_checkout_of_gsplat(tmp_path):
    trainer = tmp_path / "examples/simple_trainer.py"
    (tmp_path / "examples/datasets").mkdir(parents=True)
    trainer.write_text("import no_such_a\nfrom datasets.colmap import Dataset\nfrom fused_ssim import fused_ssim\n")
    (tmp_path / "examples/datasets/colmap.py").write_text("import no_such_b\n")
    code = "import sys; from splatboost import doctor; print(doctor._host(%r))" % str(tmp_path)
    told = run(code).stdout
    assert "simple_trainer.py needs fused_ssim, no_such_a, no_such_b, not installed" in told
    assert "pip install -e %s && pip install -r %s/examples/requirements.txt" % (tmp_path, tmp_path) in told
    trainer.write_text("import json\n")
    assert "all Python modules that simple_trainer.py needs are installed" in run(code).stdout


def command(*given):
    return subprocess.run(
        [sys.executable, "-m", "splatboost", *given],
        capture_output=True,
        text=True,
        check=False,
        cwd=conftest.PACKAGE,
        timeout=120,
    )


@pytest.mark.parametrize("given, told", [
    (["dcotor"], "splatboost dcotor: no such command; did you mean doctor?"),
    (["xyzzy"], "splatboost xyzzy: no such command; available: doctor, view"),
    (["--foo"], "splatboost --foo: no such command; available: doctor, view"),
    (["doctor", "--foo"], "splatboost doctor: unknown option --foo; available: --help"),
    (["doctor", "--hlep", "a"], "splatboost doctor: unknown option --hlep; did you mean --help?"),
    (["doctor", "a", "b"], "splatboost doctor: expected one folder, got 2: a b")])
def test_wrong_arguments_are_told_in_one_line(given, told):
    done = command(*given)
    assert (done.returncode, done.stdout, done.stderr) == (2, "", told + "\n")


@pytest.mark.parametrize("given, code", [([], 2), (["--help"], 0), (["doctor", "--help"], 0), (["doctor", "-h"], 0)])
def test_usage(given, code):
    done = command(*given)
    told, silent = (done.stderr, done.stdout) if code else (done.stdout, done.stderr)
    assert done.returncode == code and "usage: python -m splatboost doctor [CHECKOUT]" in told and silent == ""
