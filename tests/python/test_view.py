# SPDX-License-Identifier: Apache-2.0
"""`python -m splatboost view`: files it reads, errors, and the page in a headless browser."""

import json
import os
import shutil
import subprocess
import sys
import time
import unittest.mock

import conftest
import pytest

from splatboost.view import VISER, Viewer, _Linked

np = pytest.importorskip("numpy")
models = pytest.importorskip("splatboost._models")

NAMES = ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2",
         "rot_0", "rot_1", "rot_2", "rot_3"]
DC = 0.28209479177387814
RED, GREEN, BLUE = (1, 0, 0), (0, 1, 0), (0, 0, 1)


def write_ply(path, rows, names=None):
    names = NAMES if names is None else names
    path.parent.mkdir(parents=True, exist_ok=True)
    head = "ply\nformat binary_little_endian 1.0\nelement vertex %d\n" % len(rows)
    head += "".join("property float %s\n" % name for name in names) + "end_header\n"
    path.write_bytes(head.encode() + np.array(rows, "<f4").tobytes())
    return path


def ball(x, y, z, color, scale=0.3, opacity=4.0):
    return [x, y, z, 0, 0, 0, *[(c - 0.5) / DC for c in color], opacity, *[np.log(scale)] * 3, 1, 0, 0, 0]


def write_model(folder, rows, iteration=30):
    """Writes a model whose first camera is at the origin and looks along z."""
    write_ply(folder / ("point_cloud/iteration_%d/point_cloud.ply" % iteration), rows)
    camera = {"id": 0, "img_name": "a", "split": "train", "width": 64, "height": 48, "position": [0, 0, 0],
              "rotation": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "fx": 48, "fy": 48}
    aside = {**camera, "id": 1, "img_name": "b", "position": [1, 0, 0]}
    (folder / "cameras.json").write_text(json.dumps([camera, aside]))
    return folder


def view(*arguments, **environment):
    return subprocess.run([sys.executable, "-m", "splatboost", "view", *map(str, arguments)], capture_output=True, text=True,
                          check=False, cwd=conftest.PACKAGE, timeout=60, env={**os.environ, **environment})


def test_gaussians_are_read_as_they_are_drawn(tmp_path):
    row = ball(1, 2, 3, (0.2, 0.4, 0.6))
    row[10:13] = np.log([0.1, 0.2, 0.3])
    row[13:] = [2 * np.sqrt(0.5), 0, 0, 2 * np.sqrt(0.5)]  # a quarter turn about z, not of unit length
    found = models.read_gaussians(str(write_ply(tmp_path / "a.ply", [row])))
    assert np.allclose(found.covariances[0], np.diag([0.04, 0.01, 0.09]), atol=1e-6)
    assert np.allclose(found.opacities, 1 / (1 + np.exp(-4)))
    assert np.allclose(found.colors(np.zeros(3)), [[0.2, 0.4, 0.6]], atol=1e-5)

    # Mip-Splatting: the 3D filter widens a Gaussian and lowers its opacity in proportion.
    found = models.read_gaussians(str(write_ply(tmp_path / "b.ply", [row + [0.4]], NAMES + ["filter_3D"])))
    assert np.allclose(found.covariances[0], np.diag([0.2, 0.17, 0.25]), atol=1e-6)
    assert np.allclose(found.opacities, np.sqrt(0.01 * 0.04 * 0.09 / (0.17 * 0.2 * 0.25)) / (1 + np.exp(-4)))
    # A surfel has no third scale.
    names = [name for name in NAMES if name != "scale_2"]
    found = models.read_gaussians(str(write_ply(tmp_path / "c.ply", [row[:12] + row[13:]], names)))
    assert np.allclose(found.covariances[0], np.diag([0.04, 0.01, 0]), atol=1e-6)


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_colors_are_those_of_the_rasterizer(tmp_path, degree):
    torch = pytest.importorskip("torch")
    import splatboost

    random = np.random.default_rng(degree)
    rest = 3 * ((degree + 1) ** 2 - 1)
    names = NAMES + ["f_rest_%d" % i for i in range(rest)]
    coefficients = random.uniform(-0.15, 0.15, rest)
    eye = np.array([0.4, -0.7, -2.0])
    found = models.read_gaussians(str(write_ply(tmp_path / "a.ply", [ball(0, 0, 0, (0.5, 0.4, 0.6)) + [*coefficients]], names)))
    ahead = -eye / np.linalg.norm(eye)
    right = np.cross([0.0, 1, 0], ahead)
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(ahead, right), ahead])
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, -rotation @ eye
    camera = splatboost.Camera.from_matrices(9, 9, torch.tensor([[40.0, 0, 4.5], [0, 40, 4.5], [0, 0, 1]]),
                                             torch.tensor(pose, dtype=torch.float32))
    done = splatboost.rasterize(camera, torch.zeros(1, 3), torch.ones(1, 1), scales=torch.full((1, 3), 0.5),
                                rotations=torch.tensor([[1.0, 0, 0, 0]]), sh_dc=torch.tensor(found.sh[:, :1]),
                                sh_rest=torch.tensor(found.sh[:, 1:]), sh_degree=degree)
    # At the middle pixel, which blends at most 0.99 over black.
    assert np.allclose(done.color[:, 4, 4].numpy() / 0.99, found.colors(eye)[0], atol=2e-3)


def test_what_is_no_model_is_told_in_one_line(tmp_path):
    anchors = write_ply(tmp_path / "anchors.ply", [[0] * 4], ["x", "y", "z", "f_anchor_feat_0"])
    convexes = write_ply(tmp_path / "convexes.ply", [[0] * 4], ["x", "y", "z", "point_0_x"])
    points = write_ply(tmp_path / "points.ply", [[0] * 3], ["x", "y", "z"])
    short = write_ply(tmp_path / "short.ply", [ball(0, 0, 1, RED)])
    short.write_bytes(short.read_bytes()[:-1])
    (tmp_path / "photo.ply").write_bytes(b"\x89PNG")
    for path, words in ((anchors, "model of anchors.*splatboost render -m MODEL"), (convexes, "splatboost export -m MODEL"),
                        (points, "not a model of Gaussians: it lacks opacity"), (short, "ends before all of its 1 vertices"),
                        (tmp_path / "photo.ply", "not a .ply file"), (tmp_path / "nowhere.ply", "No such file")):
        with pytest.raises(models.ModelError, match=words) as error:
            models.read_gaussians(str(path))
        assert "\n" not in str(error.value)


HEAD = "ply\nformat binary_little_endian 1.0\nelement vertex 1\n"


@pytest.mark.parametrize("names, words", [
    ([n for n in NAMES if n != "f_dc_1"], "lacks f_dc_1"),
    ([n for n in NAMES if n != "rot_1"], "lacks rot_1"),
    ([], "lacks x, y, z"),
    (NAMES + ["rot_1"], "property rot_1 occurs twice"),
    (NAMES + ["f_rest_0"], "1 properties f_rest_"),
])
@pytest.mark.parametrize("form", ["binary_little_endian", "ascii"])
def test_damaged_properties_are_told_in_one_line(tmp_path, names, words, form):
    head = HEAD.replace("binary_little_endian", form) + "".join("property float %s\n" % name for name in names)
    row = " 0" * len(names) if form == "ascii" else "\0" * 4 * len(names)
    (tmp_path / "a.ply").write_text(head + "end_header\n" + row)
    with pytest.raises(models.ModelError, match=words) as error:
        models.read_gaussians(str(tmp_path / "a.ply"))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("old, new, words", [
    ("element vertex 1", "element", "first element is not vertex with a count"),
    ("element vertex 1", "element vertex", "first element is not vertex with a count"),
    ("element vertex 1", "element vertex \u00b2", "first element is not vertex with a count"),
    ("element vertex 1", "element vertex " + "9" * 5000, "first element is not vertex with a count"),
    ("element vertex 1", "element vertex 0", "no Gaussian with finite values"),
    ("format binary_little_endian 1.0", "format", r"unknown format \(none\)"),
])
def test_damaged_headers_are_told_in_one_line(tmp_path, old, new, words):
    path = write_ply(tmp_path / "a.ply", [ball(0, 0, 1, RED)])
    path.write_bytes(path.read_bytes().replace(old.encode(), new.encode("latin-1")))
    with pytest.raises(models.ModelError, match=words) as error:
        models.read_gaussians(str(path))
    assert "\n" not in str(error.value)


def test_further_columns_are_ignored(tmp_path):
    found = models.read_gaussians(str(write_ply(tmp_path / "a.ply", [ball(0, 0, 1, RED) + [0] * 3],
                                                NAMES + ["rot_4", "scale_3", "f_dc_3"])))
    assert found.covariances.shape == (1, 3, 3) and found.sh.shape == (1, 1, 3)


def test_the_newest_model_of_a_folder(tmp_path):
    assert models.newest_model(str(tmp_path)) is None
    for iteration in (900, 1000, 30):
        write_model(tmp_path, [ball(0, 0, 1, RED)], iteration)
    (tmp_path / "point_cloud/iteration_2000").mkdir()  # no file in it yet
    found = models.newest_model(str(tmp_path))
    assert found == str(tmp_path / "point_cloud/iteration_1000/point_cloud.ply")
    assert models.folder_of(found) == str(tmp_path) and [c.name for c in models.read_cameras(str(tmp_path))] == ["a", "b"]
    assert not models.has_white_background(str(tmp_path))
    (tmp_path / "cfg_args").write_text("Namespace(white_background=True)")
    assert models.has_white_background(str(tmp_path))
    (tmp_path / "config.json").write_text('{"trained": {"background": "black"}}')
    assert not models.has_white_background(str(tmp_path))
    (tmp_path / "cameras.json").write_text("[{}]")
    with pytest.raises(models.ModelError, match="cameras.json: cannot be read"):
        models.read_cameras(str(tmp_path))


def test_usage_and_a_missing_viser(tmp_path):
    (tmp_path / "viser.py").write_text("raise ImportError('no viser')\n")
    done = view(tmp_path, PYTHONPATH=str(tmp_path))
    assert done.returncode == 2 and "pip install viser" in done.stderr and len(done.stderr.splitlines()) == 1
    assert view().returncode == 2
    assert "--live" in view("--help").stdout
    (tmp_path / "viser.py").write_text("")
    done = view(tmp_path / "nowhere", PYTHONPATH=str(tmp_path))
    assert done.returncode == 2 and done.stderr == "splatboost view: %s: no such file or folder\n" % (tmp_path / "nowhere")


@pytest.mark.parametrize("live", [False, True])
@pytest.mark.parametrize("missing", [50, 10**6])  # within the vertices; all of it
def test_a_model_that_is_still_being_written(tmp_path, monkeypatch, live, missing):
    """Without a browser or viser, in whose place a mock stands."""
    for name in ("viser", "viser.transforms"):
        monkeypatch.setitem(sys.modules, name, unittest.mock.MagicMock())
    pauses = []
    monkeypatch.setattr("time.sleep", pauses.append)
    path = write_model(tmp_path, [ball(0, 0, 4, RED)] * 2) / "point_cloud/iteration_30/point_cloud.ply"
    whole = path.read_bytes()
    path.write_bytes(whole[:-missing])
    if not live:
        with pytest.raises(models.ModelError, match="is it still being written"):
            Viewer([str(tmp_path)])
        return
    viewer = Viewer([str(tmp_path)], live=True)
    # Two checks at the same moment would always agree.
    assert len(pauses) == 1 and pauses[0] >= 0.5
    assert viewer.shown[0].gaussians is None and not viewer.refresh()
    path.write_bytes(whole)
    assert not viewer.refresh() and viewer.refresh()
    assert len(viewer.shown[0].gaussians.means) == 2

    # What is no model of Gaussians will not become one.
    write_ply(tmp_path / "points.ply", [[0] * 3], ["x", "y", "z"])
    with pytest.raises(models.ModelError, match="it lacks opacity"):
        Viewer([str(tmp_path / "points.ply")], live=True)


CHROMIUM = next((found for found in map(shutil.which, ("chromium", "chromium-browser", "google-chrome")) if found), None)


@pytest.fixture
def browser(tmp_path):
    """Opens a page in a headless browser with software rendering."""
    pytest.importorskip("viser", reason="viser is not installed: " + VISER)
    if CHROMIUM is None:
        pytest.skip("Chromium is not installed: apt-get install chromium")
    started = []

    def start(url):
        started.append(subprocess.Popen(
            [CHROMIUM, "--headless=new", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
             "--disable-dev-shm-usage",  # containers have a small /dev/shm
             "--window-size=640,360", "--user-data-dir=%s" % (tmp_path / "browser"), "--remote-debugging-port=0", url],
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL))

    yield start
    for process in started:
        process.terminate()
        process.wait(30)


def wait_for(what, seconds=60):
    end = time.monotonic() + seconds
    while not what():
        assert time.monotonic() < end, "nothing came"
        time.sleep(0.05)


def client_of(shown):
    wait_for(lambda: shown.server.get_clients())
    client = next(iter(shown.server.get_clients().values()))
    wait_for(lambda: np.linalg.norm(client.camera._state.look_at) > 0)
    return client


@pytest.mark.parametrize("wrong", ["OUT", [], ["a", "b", "c"]])
def test_models_are_one_or_two_paths(wrong):
    with pytest.raises(models.ModelError, match="models: expected a list of one or two paths, got "):
        Viewer(wrong)


def middle_of(shown, channel):
    """Centroid (row, column) of what a page shows in red, green or blue in 24×32 pixels; None if there is none."""
    drawn = client_of(shown).get_render(height=24, width=32, transport_format="png", timeout=60)[..., :3] / 255.0
    weights = np.clip(drawn[..., channel] - np.delete(drawn, channel, axis=2).max(axis=2) - 0.3, 0, None)
    return tuple((weights * index).sum() / weights.sum() for index in np.indices((24, 32))) if weights.sum() > 0.3 else None


def test_the_page_shows_both_models_and_links_their_cameras(tmp_path, browser):
    write_model(tmp_path / "baseline", [ball(-1, 0, 4, RED), ball(1, 0, 4, BLUE), ball(0, -1, 4, GREEN)])
    write_model(tmp_path / "boosted", [ball(-1, 0, 4, RED)])
    viewer = Viewer([str(tmp_path)], live=True, port=0)  # any free one
    try:
        browser(viewer.url)
        baseline, boosted = viewer.shown
        assert (baseline.label, boosted.label) == ("baseline", "boosted")
        client_of(boosted)
        wait_for(lambda: middle_of(baseline, 2) and middle_of(boosted, 0))  # they fade in
        # As the camera sees it: x to the right, y down; black elsewhere.
        (red_row, red), (blue_row, blue), (green_row, green) = [middle_of(baseline, channel) for channel in (0, 2, 1)]
        assert red < 14 < 18 < blue and 14 < green < 18 and abs(red_row - 12) < 2 and abs(blue_row - 12) < 2 and green_row < 9
        assert middle_of(boosted, 0)[1] < 14 and middle_of(boosted, 1) is None and middle_of(boosted, 2) is None

        # The camera of one page moves that of the other, without feedback; not yet that of a page that has just opened.
        time.sleep(_Linked.OPENING)
        camera = client_of(baseline).camera
        assert np.allclose(camera.position, client_of(boosted).camera.position, atol=1e-3)
        camera.position, camera.look_at = (0.0, 0.0, -2.0), (0.0, 0.0, 4.0)
        follower = client_of(boosted).camera
        wait_for(lambda: np.allclose(follower.position, (0, 0, -2), atol=1e-3))
        time.sleep(0.8)
        assert np.allclose(camera.position, (0, 0, -2), atol=1e-3)

        # A model saved during training is shown while the page is open.
        write_model(tmp_path / "boosted", [ball(-1, 0, 4, GREEN)], 60)
        assert not viewer.refresh()  # the file may still be being written
        assert viewer.refresh()
        wait_for(lambda: middle_of(boosted, 1) and middle_of(boosted, 0) is None)
        assert "iteration 60, 1 Gaussians" in boosted._told.content
    finally:
        viewer.stop()
