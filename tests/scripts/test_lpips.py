# SPDX-License-Identifier: Apache-2.0
"""LPIPS: scripts/lpips_to_onnx and the program's network against a plain numpy implementation.

SPLATBOOST_BIN names the folder with the built `lpips_distance` (default: build/release/bin).
"""

import json
import os
import pathlib
import struct
import subprocess
import sys
import zlib

import numpy as np
import pytest

ROOT = pathlib.Path(__file__).resolve().parents[2]
SCRIPT = ROOT / "scripts" / "lpips_to_onnx"
PROGRAM = pathlib.Path(os.environ.get("SPLATBOOST_BIN", ROOT / "build/release/bin")) / "lpips_distance"
REAL_WEIGHTS = ROOT / "../shared/data/lpips/lpips_squeeze_v0.1.npz"

FIRES = {3: (64, 16, 64), 4: (128, 16, 64), 6: (128, 32, 128), 7: (256, 32, 128),
         9: (256, 48, 192), 10: (384, 48, 192), 11: (384, 64, 256), 12: (512, 64, 256)}
TAP_CHANNELS = [64, 128, 256, 384, 384, 512, 512]
# Odd and even sizes, so that every pooling has inputs that fit its windows and inputs that need ceil mode.
SIZES = [(32, 32), (37, 40), (40, 37), (33, 47), (64, 51), (62, 35)]


# --- reference implementation -----------------------------------------------------------------------------------------

def convolve(x, weight, bias, stride=1, padding=0):
    x = np.pad(x, ((0, 0), (padding, padding), (padding, padding)))
    size = weight.shape[2]
    rows, columns = ((n - size) // stride + 1 for n in x.shape[1:])
    out = np.zeros((weight.shape[0], rows, columns)) + bias[:, None, None]
    for dy in range(size):
        for dx in range(size):
            window = x[:, dy:dy + stride * (rows - 1) + 1:stride, dx:dx + stride * (columns - 1) + 1:stride]
            out += np.tensordot(weight[:, :, dy, dx], window, axes=1)
    return np.maximum(out, 0)


def pool(x):
    """3×3 max pooling, stride 2, ceil mode: the last window is cut off at the image border."""
    rows, columns = (-(-(n - 3) // 2) + 1 for n in x.shape[1:])
    return np.stack([[x[:, 2 * i:2 * i + 3, 2 * j:2 * j + 3].max(axis=(1, 2)) for j in range(columns)]
                     for i in range(rows)]).transpose(2, 0, 1)


def features(weights, image):
    def layer(name, x, **options):
        key = "backbone/" + name
        return convolve(x, weights[key + ".weight"].astype(float), weights[key + ".bias"].astype(float), **options)

    x = 2 * image - 1
    x = (x - np.array([-.030, -.088, -.188])[:, None, None]) / np.array([.458, .448, .450])[:, None, None]
    x = layer("0", x, stride=2)
    taps = [x]
    for index in range(2, 13):
        if index in (2, 5, 8):
            x = pool(x)
        else:
            squeezed = layer(f"{index}.squeeze", x)
            x = np.concatenate([layer(f"{index}.expand1x1", squeezed),
                                layer(f"{index}.expand3x3", squeezed, padding=1)])
        if index in (4, 7, 9, 10, 11, 12):
            taps.append(x)
    return taps


def plain_lpips(weights, a, b):
    total = 0.0
    for i, (fa, fb) in enumerate(zip(features(weights, a), features(weights, b))):
        ua, ub = (f / (np.sqrt((f ** 2).sum(axis=0)) + 1e-10) for f in (fa, fb))
        linear = weights[f"lin/lin{i}.model.1.weight"].reshape(-1).astype(float)
        total += np.tensordot(linear, (ua - ub) ** 2, axes=1).mean()
    return total


# --- helpers ----------------------------------------------------------------------------------------------------------

def random_weights(seed=7):
    random = np.random.default_rng(seed)
    weights = {}

    def convolution(name, out, channels, size):
        deviation = np.sqrt(2 / (channels * size * size))  # keeps the variance of activations through the ReLUs
        weights[f"backbone/{name}.weight"] = random.normal(0, deviation, (out, channels, size, size)).astype("f4")
        weights[f"backbone/{name}.bias"] = random.normal(0, 0.1, out).astype("f4")

    convolution("0", 64, 3, 3)
    for index, (channels, squeeze, expand) in FIRES.items():
        convolution(f"{index}.squeeze", squeeze, channels, 1)
        convolution(f"{index}.expand1x1", expand, squeeze, 1)
        convolution(f"{index}.expand3x3", expand, squeeze, 3)
    for i, channels in enumerate(TAP_CHANNELS):
        weights[f"lin/lin{i}.model.1.weight"] = random.uniform(0, 1, (1, channels, 1, 1)).astype("f4")
    return weights


def convert(npz, onnx):
    return subprocess.run([sys.executable, SCRIPT, npz, onnx], capture_output=True, text=True, check=False)


def write_png(path, image):
    """Writes 8-bit RGB [H,W,3] or grey [H,W] as PNG, with the standard library only."""
    rows, columns = image.shape[:2]
    lines = b"".join(b"\0" + image[y].tobytes() for y in range(rows))
    header = struct.pack(">IIBBBBB", columns, rows, 8, 2 if image.ndim == 3 else 0, 0, 0, 0)
    with open(path, "wb") as out:
        out.write(b"\x89PNG\r\n\x1a\n")
        for kind, data in ((b"IHDR", header), (b"IDAT", zlib.compress(lines)), (b"IEND", b"")):
            out.write(struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data)))


def planar(image):
    return image.transpose(2, 0, 1) / 255.0


def random_pair(rows, columns, seed=1):
    random = np.random.default_rng(seed)
    truth = random.integers(0, 256, (rows, columns, 3), dtype=np.uint8)
    # Half of the pixels are equal, so that the distance is of a realistic size.
    render = np.where(random.random((rows, columns, 1)) < 0.5, truth, random.integers(0, 256, truth.shape, np.uint8))
    return render.astype(np.uint8), truth


def program_lpips(onnx, pairs, folder, mask=None):
    if not PROGRAM.exists():
        pytest.skip(f"{PROGRAM} is not built")
    command = [PROGRAM, onnx]
    for i, images in enumerate(pairs):
        for kind, image in zip("rt", images):
            command.append(folder / f"{kind}{i}.png")
            write_png(command[-1], image)
    if mask is not None:
        write_png(folder / "mask.png", mask)
        command += ["--mask", folder / "mask.png"]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    return [float(line) for line in result.stdout.split()]


@pytest.fixture(scope="module", params=["random", "real"])
def network(request, tmp_path_factory):
    """(weights, ONNX file)"""
    folder = tmp_path_factory.mktemp("lpips")
    if request.param == "real":
        if not REAL_WEIGHTS.exists():
            pytest.skip("the real LPIPS weights are not on this machine")
        npz = REAL_WEIGHTS
    else:
        npz = folder / "weights.npz"
        np.savez(npz, **random_weights())
    result = convert(npz, folder / "lpips.onnx")
    assert result.returncode == 0, result.stderr
    with np.load(npz) as archive:
        return dict(archive), folder / "lpips.onnx"


# --- tests ------------------------------------------------------------------------------------------------------------

def test_program_matches_plain_implementation(network, tmp_path):
    weights, onnx = network
    # One process for all sizes: the network must also adapt from one image to the next.
    pairs = [random_pair(*size, seed=i) for i, size in enumerate(SIZES)]
    measured = program_lpips(onnx, pairs, tmp_path)
    expected = [plain_lpips(weights, planar(render), planar(truth)) for render, truth in pairs]
    np.testing.assert_allclose(measured, expected, rtol=2e-5)


def test_large_odd_image(network, tmp_path):
    weights, onnx = network
    render, truth = random_pair(265, 473)
    measured = program_lpips(onnx, [(render, truth)], tmp_path)
    np.testing.assert_allclose(measured, [plain_lpips(weights, planar(render), planar(truth))], rtol=2e-5)


def test_flat_black_and_white(network, tmp_path):
    weights, onnx = network
    black = np.zeros((40, 40, 3), np.uint8)
    measured = program_lpips(onnx, [(black, 255 - black)], tmp_path)
    np.testing.assert_allclose(measured, [plain_lpips(weights, planar(black), planar(255 - black))], rtol=2e-5)


def test_equal_images_have_distance_zero(network, tmp_path):
    truth = random_pair(40, 37)[1]
    assert program_lpips(network[1], [(truth, truth)], tmp_path) == [0]


def test_invalid_pixels_read_as_truth(network, tmp_path):
    weights, onnx = network
    render, truth = random_pair(40, 37)
    mask = np.full((40, 37), 255, np.uint8)
    mask[10:30, 5:20] = 0
    measured = program_lpips(onnx, [(render, truth)], tmp_path, mask)
    filled = np.where(mask[:, :, None] != 0, render, truth)
    np.testing.assert_allclose(measured, [plain_lpips(weights, planar(filled), planar(truth))], rtol=2e-5)


def test_small_image_and_foreign_file_are_refused(network, tmp_path):
    if not PROGRAM.exists():
        pytest.skip(f"{PROGRAM} is not built")
    write_png(tmp_path / "small.png", np.zeros((31, 40, 3), np.uint8))
    (tmp_path / "text.onnx").write_text("no network at all")
    (tmp_path / "half.onnx").write_bytes(network[1].read_bytes()[:100000])
    for onnx, message in ((network[1], "at least 32"), (tmp_path / "text.onnx", "damaged"),
                          (tmp_path / "half.onnx", "damaged"), (tmp_path / "none.onnx", "cannot read")):
        result = subprocess.run([PROGRAM, onnx, tmp_path / "small.png", tmp_path / "small.png"],
                                capture_output=True, text=True, check=False)
        assert result.returncode == 2 and message in result.stderr, result.stderr
        assert len(result.stderr.splitlines()) == 1, result.stderr


def bad_inputs():
    yield "key", lambda w: w.pop("backbone/9.squeeze.bias"), "backbone/9.squeeze.bias"
    yield "shape", lambda w: w.update({"backbone/0.bias": np.zeros(63, "f4")}), "expected [64]"
    yield "nan", lambda w: w["backbone/0.bias"].fill(np.nan), "finite"
    yield "negative", lambda w: w["lin/lin2.model.1.weight"].fill(-1), "negative"
    yield "type", lambda w: w.update({"backbone/0.bias": np.array(["a"] * 64)}), "not of numbers"


@pytest.mark.parametrize("change,message", [case[1:] for case in bad_inputs()], ids=[case[0] for case in bad_inputs()])
def test_converter_refuses_bad_weights(change, message, tmp_path):
    weights = random_weights()
    change(weights)
    np.savez(tmp_path / "weights.npz", **weights)
    check_refused(tmp_path / "weights.npz", tmp_path / "out.onnx", message)
    assert not (tmp_path / "out.onnx").exists()


def test_converter_refuses_bad_files(tmp_path):
    check_refused(tmp_path / "missing.npz", tmp_path / "out.onnx", "No such file")
    (tmp_path / "text.npz").write_text("hello")
    check_refused(tmp_path / "text.npz", tmp_path / "out.onnx", "not an .npz")
    np.save(tmp_path / "array.npy", np.zeros(3))
    check_refused(tmp_path / "array.npy", tmp_path / "out.onnx", "not an .npz")
    np.savez(tmp_path / "good.npz", **random_weights())
    data = (tmp_path / "good.npz").read_bytes()
    (tmp_path / "half.npz").write_bytes(data[:len(data) // 2])
    check_refused(tmp_path / "half.npz", tmp_path / "out.onnx", "not an .npz")
    check_refused(tmp_path / "good.npz", tmp_path / "no/folder/out.onnx", "cannot write")


def check_refused(npz, onnx, message):
    result = convert(npz, onnx)
    assert result.returncode == 2
    assert message in result.stderr
    assert len(result.stderr.splitlines()) == 1, result.stderr


def test_converter_help():
    result = subprocess.run([sys.executable, SCRIPT, "--help"], capture_output=True, text=True, check=False)
    assert result.returncode == 0
    assert "WEIGHTS.npz" in result.stdout and "OUT.onnx" in result.stdout


def test_slam_measures_it_on_its_frames(network, tmp_path):
    splatboost = PROGRAM.with_name("splatboost")
    if not splatboost.exists():
        pytest.skip(f"{splatboost} is not built")

    def run(*arguments):
        return subprocess.run([splatboost, *map(str, arguments)], capture_output=True, text=True, check=False)

    walk, model = tmp_path / "walk", tmp_path / "model"
    assert run("synth", walk, "--scene", "walk", "--width", 160, "--height", 120, "--views", 60,
               "--samples", 1).returncode == 0
    done = run("slam", "-s", walk, "-m", model, "--frames", 4, "--lockstep", 2, "--iterations", 10, "--features", 400,
               "--quiet", "--lpips", network[1])
    if "cannot track a camera" in done.stderr:
        pytest.skip("this build has no Ceres")
    assert done.returncode == 0, done.stderr
    results = json.loads((model / "results.json").read_text())
    pictures = [model / "test" / kind / view["name"] for view in results["views"] for kind in ("renders", "truth")]
    result = subprocess.run([PROGRAM, network[1], *pictures], capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    measured = [view["lpips"] for view in results["views"]]
    np.testing.assert_allclose(measured, [float(line) for line in result.stdout.split()], rtol=0.02)  # 8-bit pictures
    np.testing.assert_allclose(results["lpips"], np.mean(measured), rtol=1e-6)
    assert results["slam"]["keyframes"]["lpips"] > 0
