# SPDX-License-Identifier: Apache-2.0
"""Trained models in a browser: `python -m splatboost view MODEL`. Needs viser, and no GPU, no torch and no libsplatboost."""

from __future__ import annotations

import argparse
import contextlib
import html
import http.server
import io
import os
import sys
import threading
import time
from typing import Any, Callable, Dict, List, Optional, Sequence, Tuple

#: Seconds between two checks of a live page; a file is complete once two checks agree.
_PAUSE = 1.0

VISER = "pip install viser 'typing_extensions>=4.5'"

_PAGE = """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>SplatBoost: %s</title><style>
html, body { margin: 0; height: 100%%; font: 14px sans-serif; background: #222; color: #eee }
main { display: flex; height: 100%% }
section { flex: 1; display: flex; flex-direction: column; border-left: 1px solid #555 }
h1 { font-size: 14px; font-weight: normal; margin: 6px 10px; overflow: hidden; white-space: nowrap; text-overflow: ellipsis }
iframe { flex: 1; border: 0 }
</style></head><body><main>%s</main><script>
for (const frame of document.querySelectorAll("iframe"))
  frame.src = location.protocol + "//" + location.hostname + ":" + frame.dataset.port + "/?hideViserLogo";
</script></body></html>
"""


class _Shown:
    """One model on its own page."""

    def __init__(self, model: str, label: str, host: str, port: int, small: bool):
        import viser

        from . import _models

        self.model, self.label = model, label
        self.folder = _models.folder_of(model)
        self.gaussians: Optional[_models.Gaussians] = None
        self._stamp: Any = None
        self._seen: Any = None
        self._splats: Any = None
        self._drawn: Optional[_models.Gaussians] = None  # the model of _splats
        self._eye: Any = None
        self._near = 0.0
        self.up: Any = None
        self._frusta: List[Tuple[Any, Any]] = []  # (frustum, camera position)
        self._lock = threading.Lock()
        with contextlib.redirect_stdout(io.StringIO()):  # hides its banner, whose port is not that of our page
            self.server = viser.ViserServer(host=host, port=port, label="SplatBoost: " + label, verbose=False)
        self.port = int(self.server.get_port())
        self.server.gui.configure_theme(show_logo=False, show_share_button=False)
        if small:
            self.server.gui.main_panel.minimize()
        white = _models.has_white_background(self.folder)
        import numpy as np

        self.server.scene.set_background_image(np.full((1, 1, 3), 255 if white else 0, np.uint8), format="png")
        self._told = self.server.gui.add_markdown("Waiting for a model …")
        self._boxes = self.server.gui.add_checkbox("Cameras", True, hint="Click on one to look through it")
        self._boxes.on_update(lambda _: self._show_frusta())

    def _show_frusta(self) -> None:
        """Shows all camera frusta except those near the viewpoint."""
        for frustum, position in self._frusta:
            frustum.visible = bool(self._boxes.value and ((position - self._eye) ** 2).sum() > self._near**2)

    def reload(self, waits: bool) -> bool:
        """Shows the newest model if it is not shown yet; returns whether it did. waits: if the file is missing or still
        growing, return and try again later instead of raising ModelError."""
        from . import _models

        path = _models.newest_model(self.model)
        if path is None:
            if waits:
                return False
            raise _models.ModelError("%s: contains no model: expected a .ply, or a folder with "
                                     "point_cloud/iteration_N/point_cloud.ply (--live waits for it)" % self.model)
        try:
            status = os.stat(path)
        except OSError as e:  # a training run replaced the folder
            if waits:
                return False
            raise _models.ModelError("%s: %s" % (path, e.strerror))
        stamp = (path, status.st_mtime_ns, status.st_size)
        settled, self._seen = stamp == self._seen, stamp
        if stamp == self._stamp or (waits and not settled):
            return False
        try:
            gaussians = _models.read_gaussians(path)
        except _models.ModelError as e:
            if waits and (self._stamp is not None or isinstance(e, _models.UnfinishedError)):
                return False
            raise
        first = self.gaussians is None
        self._stamp = stamp
        with self._lock:
            self.gaussians = gaussians
        if first:
            self._set_cameras(gaussians)
        self._draw()
        name = os.path.basename(os.path.dirname(path)).replace("_", " ") if "iteration_" in path else os.path.basename(path)
        self._told.content = "**%s**\n\n%s, %s Gaussians" % (self.label, name, format(len(gaussians.means), ","))
        return True

    def _set_cameras(self, gaussians: Any) -> None:
        """Sets the initial viewpoint and up direction, and adds the camera frusta."""
        import numpy as np
        import viser.transforms

        from . import _models

        cameras = _models.read_cameras(self.folder)
        middle = np.median(gaussians.means, axis=0)
        if cameras:
            first = next((c for c in cameras if c.split != "train"), cameras[0])
            up = -np.mean([c.rotation[:, 1] for c in cameras], axis=0)
            if np.linalg.norm(up) < 1e-3:  # no common up direction
                up = -first.rotation[:, 1]
            places = np.array([c.position for c in cameras])
            reach = max(float(np.linalg.norm(places - places.mean(axis=0), axis=1).max()), 1e-3)
        else:
            spread = float(np.median(np.linalg.norm(gaussians.means - middle, axis=1)))
            up, reach = np.array([0.0, -1.0, 0.0]), max(spread, 1e-3)  # COLMAP's y axis points roughly down
        start = self.server.initial_camera
        self.up = up / np.linalg.norm(up)
        self.server.scene.set_up_direction(self.up)
        start.near, start.far = 0.01 * reach, 1000 * reach
        if not cameras:
            start.position, start.look_at = middle + reach * np.array([0.0, -1.0, -2.5]), middle
            self._eye = start.position
            return
        start.fov = self._fov(first)
        start.position, start.look_at = first.position, self._target(first, middle, reach)
        self._eye = first.position
        colors = {"train": (90, 160, 255), "test": (255, 170, 60)}
        for i, camera in enumerate(cameras):
            frustum = self.server.scene.add_camera_frustum(
                "/cameras/%d" % i, self._fov(camera), camera.width / camera.height, scale=0.04 * reach,
                thickness=0.0015 * reach, color=colors.get(camera.split, (200, 200, 200)), position=camera.position,
                wxyz=viser.transforms.SO3.from_matrix(camera.rotation).wxyz)
            frustum.on_click(self._look_through(camera, middle, reach))
            self._frusta.append((frustum, camera.position))
        self._near = 0.1 * reach
        self._show_frusta()

    @staticmethod
    def _fov(camera: Any) -> float:
        import math

        return 2 * math.atan(0.5 * camera.height / camera.fy)

    @staticmethod
    def _target(camera: Any, middle: Any, reach: float) -> Any:
        """The point to orbit around: on the camera's optical axis, nearest to the centre of the scene."""
        ahead = camera.rotation[:, 2]
        return camera.position + max(float(ahead @ (middle - camera.position)), 0.2 * reach) * ahead

    def _look_through(self, camera: Any, middle: Any, reach: float) -> Callable[[Any], None]:
        def look(event: Any) -> None:
            with event.client.atomic():
                event.client.camera.position = camera.position
                event.client.camera.look_at = self._target(camera, middle, reach)
                event.client.camera.up_direction = -camera.rotation[:, 1]

        return look

    def _draw(self) -> None:
        import numpy as np

        with self._lock:
            gaussians = self.gaussians
            if gaussians is None:
                return
            colors, opacities = gaussians.colors(self._eye), gaussians.opacities[:, None]
            if self._splats is not None and len(self._splats.buffer) == len(colors) and self._drawn is gaussians:
                self._splats.rgbs = colors
                return
            # Viser stores covariances in half precision.
            covariances = np.clip(gaussians.covariances, -6e4, 6e4)
            self._splats = self.server.scene.add_gaussian_splats("/model", gaussians.means, covariances, colors, opacities)
            self._drawn = gaussians

    def look_from(self, eye: Any) -> None:
        """Updates the view-dependent colors for this viewpoint."""
        self._eye = eye
        self._draw()
        self._show_frusta()


class _Linked:
    """Synchronizes the cameras of all pages; colors are updated once the camera stops moving."""

    #: seconds after which a page's own camera updates count again, even if it never reported the pose it was sent
    PATIENCE = 10.0
    #: seconds in which a new page may still report viser's default pose, even after that which it was sent
    OPENING = 2.0

    def __init__(self, shown: Sequence[_Shown]):
        self._shown = shown
        self._pose: Any = None  # position, look_at, up and field of view shared by all pages
        self._told: Dict[Any, float] = {}  # client → time at which it was sent the pose, until it reports it
        self._opened: Dict[Any, float] = {}  # client → time of its connection
        self._lock = threading.Lock()
        self._latest = 0
        for one in shown:
            one.server.on_client_connect(self._follow)

    def _follow(self, client: Any) -> None:
        """Moves a new page to the shared pose. Poses that it reports before it arrives are old, and are ignored."""
        with self._lock:
            if self._pose is None:
                start = self._shown[0].server.initial_camera
                if self._shown[0].gaussians is not None:
                    self._pose = (start.position, start.look_at, self._shown[0].up, start.fov)
            if self._pose is not None:
                self._opened[client.client_id, id(client)] = time.monotonic()
                self._tell(client)
        client.camera.on_update(lambda camera: self._moved(client, camera))

    def _has_pose(self, camera: Any) -> bool:
        reach = abs(camera.look_at - camera.position).max()
        return all(abs(own - shared).max() < 1e-3 * reach
                   for own, shared in zip((camera.position, camera.look_at), self._pose))

    def _tell(self, client: Any) -> None:
        # A page that is there already does not move, and so reports nothing.
        if not self._has_pose(client.camera):
            self._told[client.client_id, id(client)] = time.monotonic()
        position, look_at, up, fov = self._pose
        with client.atomic():
            client.camera.position = position
            client.camera.up_direction = up
            client.camera.look_at = look_at
            client.camera.fov = fov

    def _moved(self, client: Any, camera: Any) -> None:
        key, now = (client.client_id, id(client)), time.monotonic()
        with self._lock:
            if self._pose is not None and self._has_pose(camera):
                self._told.pop(key, None)
                return
            if now - self._told.get(key, -self.PATIENCE) < self.PATIENCE:
                return
            if now - self._opened.get(key, -self.OPENING) < self.OPENING:
                self._tell(client)
                return
            self._told.pop(key, None)
            self._pose = (camera.position.copy(), camera.look_at.copy(), camera.up_direction.copy(), camera.fov)
            self._latest += 1
            turn, eye = self._latest, self._pose[0]
            for one in self._shown:
                for other in one.server.get_clients().values():
                    if other is not client:
                        self._tell(other)
        time.sleep(0.15)
        if turn == self._latest:  # no movement since
            for one in self._shown:
                one.look_from(eye)


def _models_of(given: List[str]) -> List[Tuple[str, str]]:
    """(model, label) of the user's arguments: one or two models, or a folder of `splatboost compare`."""
    from ._models import ModelError

    if isinstance(given, str) or not 1 <= len(given) <= 2:
        raise ModelError("models: expected a list of one or two paths, got %r" % (given,))
    for name in given:
        if not os.path.exists(name):
            raise ModelError("%s: no such file or folder" % name)
    if len(given) == 1:
        both = [os.path.join(given[0], name) for name in ("baseline", "boosted")]
        if all(os.path.isdir(folder) for folder in both):
            return [(both[0], "baseline"), (both[1], "boosted")]
    names = [os.path.basename(os.path.abspath(name)) for name in given]
    return list(zip(given, given if len(set(names)) < len(names) else names))


class Viewer:
    """The pages of one or two models.

    models   model folders or .ply files; a folder of `splatboost compare` stands for two models
    live     reloads a model when its file changes, and waits for a model that does not exist yet
    port     of the page; with two models, their pages use the next two ports
    """

    def __init__(self, models: List[str], live: bool = False, host: str = "127.0.0.1", port: int = 8080):
        self._live = live
        named = _models_of(models)
        self._page: Optional[http.server.ThreadingHTTPServer] = None
        if len(named) == 2:  # first, because it fails if the port is in use
            self._page = http.server.ThreadingHTTPServer((host, port), http.server.BaseHTTPRequestHandler)
        self.shown: List[_Shown] = []
        try:
            for model, label in named:
                own = port if self._page is None else self._page.server_port + 1 + len(self.shown)
                one = _Shown(model, label, host, own, small=len(named) > 1)
                self.shown.append(one)
                if not live:
                    one.reload(waits=False)
            if live:
                self.refresh()
                time.sleep(_PAUSE)
                self.refresh()
        except BaseException:
            self.stop()
            raise
        _Linked(self.shown)
        self.port = self.shown[0].port
        if self._page is not None:
            self.port = self._page.server_port
            self._serve_page(self._page)
        self.url = "http://%s:%d" % ("localhost" if host in ("127.0.0.1", "0.0.0.0") else host, self.port)

    def _serve_page(self, page: http.server.ThreadingHTTPServer) -> None:
        frames = "".join('<section><h1>%s</h1><iframe title="%s" data-port="%d"></iframe></section>'
                         % (html.escape(one.label), html.escape(one.label), one.port) for one in self.shown)
        body = (_PAGE % (" | ".join(html.escape(one.label) for one in self.shown), frames)).encode()

        class Handler(http.server.BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                found = self.path.split("?")[0] == "/"
                self.send_response(200 if found else 404)
                self.send_header("Content-Type", "text/html; charset=utf-8")
                self.send_header("Content-Length", str(len(body) if found else 0))
                self.end_headers()
                self.wfile.write(body if found else b"")

            def log_message(self, *_: Any) -> None:
                pass

        page.RequestHandlerClass = Handler
        threading.Thread(target=page.serve_forever, daemon=True).start()

    def refresh(self) -> bool:
        """Reloads changed files of a live page; returns whether there was one."""
        return any([one.reload(waits=True) for one in self.shown])

    def stop(self) -> None:
        if self._page is not None:
            threading.Thread(target=self._page.shutdown, daemon=True).start()
            self._page.server_close()
        with contextlib.redirect_stdout(io.StringIO()):
            for one in self.shown:
                one.server.stop()


def main(arguments: Sequence[str]) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m splatboost view", description="Shows a trained model in a browser.",
        epilog="Drag to orbit, wheel to zoom, right button to move; click on a camera's frustum to look through it. "
               "Example: python -m splatboost view OUT. For a folder of splatboost compare both models are shown side by "
               "side.")
    parser.add_argument("models", metavar="MODEL", nargs="+",
                        help="model folder, .ply file, or a folder of splatboost compare; two are shown side by side")
    parser.add_argument("--live", action="store_true", help="reload the model whenever it is saved during training")
    parser.add_argument("--port", metavar="N", type=int, default=8080,
                        help="port of the page; two models also use the next two ports [8080]")
    parser.add_argument("--host", metavar="ADDRESS", default="127.0.0.1",
                        help="0.0.0.0 shows it to other machines too [127.0.0.1, this one only]")
    given = parser.parse_args(arguments)
    if len(given.models) > 2:
        parser.error("at most two models")
    if not 0 < given.port < 65000:
        parser.error("--port must be from 1 to 64999")
    try:
        import viser  # noqa: F401
    except ImportError as e:
        print("splatboost view: needs viser (%s): %s" % (e, VISER), file=sys.stderr)
        return 2
    from ._models import ModelError

    try:
        viewer = Viewer(given.models, given.live, given.host, given.port)
    except ModelError as e:
        print("splatboost view: %s" % e, file=sys.stderr)
        return 2
    except OSError as e:
        print("splatboost view: port %d of %s: %s; choose another --port" % (given.port, given.host, e.strerror or e),
              file=sys.stderr)
        return 2
    print("open %s in a browser; Ctrl-C ends" % viewer.url, flush=True)
    try:
        while True:
            time.sleep(_PAUSE)
            if given.live and viewer.refresh():
                for one in viewer.shown:
                    print("%s: %d Gaussians" % (one.label, len(one.gaussians.means) if one.gaussians else 0), flush=True)
    except KeyboardInterrupt:
        viewer.stop()
        return 0
    except ModelError as e:
        print("splatboost view: %s" % e, file=sys.stderr)
        return 2
