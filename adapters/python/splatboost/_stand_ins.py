# SPDX-License-Identifier: Apache-2.0
"""Stand-ins for packages that hosts import but a machine without a GPU may lack.

They cover what the hosts' training, rendering and metrics use.
"""

from __future__ import annotations

import atexit
import functools
import importlib.util
import os
import shutil
import sys
import tempfile
import types
import warnings
from typing import Any, List, Optional, Tuple

#: Packages that hosts import but do not use in training, rendering and metrics, except for meshes (FOR_MESHES).
_OPTIONAL = ("open3d", "joblib", "wandb", "matplotlib")
#: Stand-ins cannot make meshes.
FOR_MESHES = "open3d"
#: Packages that a host can run without, because this module or the drop-ins provide them.
PROVIDED = _OPTIONAL + ("torchvision", "torch_scatter", "lpips", "lpipsPyTorch", "diff_gaussian_rasterization",
                        "diff_gaussian_rasterization_abs", "diff_surfel_rasterization", "diff_convex_rasterization",
                        "diff_plane_rasterization", "simple_knn", "fused_ssim", "pytorch3d")


def install() -> None:
    """Installs stand-ins for the packages that are not installed."""
    for name in _OPTIONAL:
        if _lacks(name):
            sys.modules[name] = _Missing(name)
            if name == "matplotlib":
                setattr(sys.modules[name], "pyplot", _Missing("matplotlib.pyplot"))
                sys.modules["matplotlib.pyplot"] = getattr(sys.modules[name], "pyplot")
            if name == "open3d":
                _open3d(sys.modules[name])
    if _lacks("torchvision"):
        _torchvision()
    if _lacks("torch_scatter"):
        scatter: Any = types.ModuleType("torch_scatter")
        scatter.scatter_max = scatter_max
        sys.modules["torch_scatter"] = scatter
    if _lacks("pytorch3d"):
        _pytorch3d()
    _numpy_names()
    _pictures()
    _drawing()
    _histograms()
    _lpips()
    if shutil.which("nvidia-smi") is None:
        _nvidia_smi()


def _numpy_names() -> None:
    """Restores numpy's aliases of Python types, removed in 1.24, which hosts of 2023 still use."""
    import numpy

    for kind in (bool, int, float, complex, object):
        if kind.__name__ not in numpy.__dict__:
            setattr(numpy, kind.__name__, kind)


def _pictures() -> None:
    """Hosts create images from arrays of numpy.byte, which is signed; Pillow since 11.3 accepts only unsigned bytes."""
    if _lacks("PIL"):
        return
    import numpy
    from PIL import Image

    fromarray: Any = Image.fromarray

    @functools.wraps(fromarray)
    def from_bytes(array: Any, *arguments: Any, **named: Any) -> Any:
        if isinstance(array, numpy.ndarray) and array.dtype == numpy.int8:
            array = array.view(numpy.uint8)
        return fromarray(array, *arguments, **named)

    Image.fromarray = from_bytes


def _drawing() -> None:
    """Restores functions of matplotlib with which hosts draw maps: get_cmap, removed in 3.9, and tostring_rgb, removed in 3.10."""
    if _lacks("matplotlib") or isinstance(sys.modules.get("matplotlib"), _Missing):
        return
    import matplotlib
    import numpy
    from matplotlib import cm
    from matplotlib.backends import backend_agg

    maps: Any = cm
    if not hasattr(maps, "get_cmap"):
        maps.get_cmap = lambda name: matplotlib.colormaps[name]
    canvas: Any = backend_agg.FigureCanvasAgg
    if not hasattr(canvas, "tostring_rgb"):
        canvas.tostring_rgb = lambda self: numpy.asarray(self.buffer_rgba())[..., :3].tobytes()


def _histograms() -> None:
    """Skips TensorBoard histograms, which torch before 2.0 cannot create with numpy 1.24 or later."""
    import torch

    if _lacks("tensorboard") or int(torch.__version__.split(".")[0]) >= 2:
        return
    from torch.utils.tensorboard import SummaryWriter

    add_histogram: Any = SummaryWriter.add_histogram

    @functools.wraps(add_histogram)
    def add_where_possible(*arguments: Any, **named: Any) -> None:
        try:
            add_histogram(*arguments, **named)
        except TypeError:
            pass

    SummaryWriter.add_histogram = add_where_possible


def _lacks(name: str) -> bool:
    return name not in sys.modules and importlib.util.find_spec(name) is None


class _Missing(types.ModuleType):
    """Stands in for a package that is not installed: importing it succeeds, using it raises ModuleNotFoundError."""

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        raise ModuleNotFoundError("%s.%s is used, but %s is not installed" % (self.__name__, name, self.__name__),
                                  name=self.__name__)


def _open3d(root: Any) -> None:
    """PGSR's render.py creates a TSDF volume even if nothing is fused into it."""

    class ScalableTSDFVolume:
        def __init__(self, *_: Any, **__: Any):
            pass

        def __getattr__(self, name: str) -> Any:
            raise ModuleNotFoundError("open3d: required for meshes, but not installed", name="open3d")

    integration: Any = types.ModuleType("open3d.pipelines.integration")
    integration.ScalableTSDFVolume = ScalableTSDFVolume
    integration.TSDFVolumeColorType = types.SimpleNamespace(RGB8="RGB8")
    root.pipelines = types.SimpleNamespace(integration=integration)


def quaternion_to_matrix(quaternions: Any) -> Any:
    """[…,3,3] rotation matrices of quaternions (w,x,y,z) […,4] of any nonzero length."""
    import torch

    w, x, y, z = torch.nn.functional.normalize(quaternions, dim=-1).unbind(dim=-1)
    rows = [
        torch.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)], dim=-1),
        torch.stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)], dim=-1),
        torch.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], dim=-1),
    ]
    return torch.stack(rows, dim=-2)


def _pytorch3d() -> None:
    """The part of pytorch3d that PGSR uses."""
    root: Any = types.ModuleType("pytorch3d")
    root.__path__ = []
    transforms: Any = types.ModuleType("pytorch3d.transforms")
    transforms.quaternion_to_matrix = quaternion_to_matrix
    root.transforms = transforms
    for module in (root, transforms):
        sys.modules[module.__name__] = module


def scatter_max(values: Any, index: Any, dim: int = -1, *_: Any) -> Tuple[Any, Any]:
    """[M,C] maximum of the values [N,C] per index, and its row. Only along dim 0, without an output argument."""
    import torch

    if dim != 0 or values.dim() != 2 or index.shape != values.shape:
        raise NotImplementedError("scatter_max: expected values and index [N,C] along dim 0")
    n, channels = values.shape
    rows = int(index.max()) + 1 if n else 0
    warnings.filterwarnings("ignore", "scatter_reduce")  # torch 1.13 warns that it is in beta
    largest = values.new_zeros((rows, channels)).scatter_reduce(0, index, values, "amax", include_self=False)
    at = torch.arange(n, device=values.device).unsqueeze(1).expand(n, channels)
    where = torch.where(values == largest.gather(0, index), at, torch.full_like(at, n)) if n else at
    first = torch.full((rows, channels), n, dtype=torch.long, device=values.device)
    return largest, first.scatter_reduce(0, index, where, "amin")


def _to_tensor(picture: Any) -> Any:
    """[C,H,W] from a PIL image or an array [H,W] or [H,W,C]; uint8 becomes float32 in [0, 1]."""
    import numpy
    import torch

    array = numpy.array(picture)
    if array.ndim == 2:
        array = array[:, :, None]
    tensor = torch.from_numpy(numpy.ascontiguousarray(array.transpose(2, 0, 1)))
    return tensor.float() / 255 if tensor.dtype == torch.uint8 else tensor


def _save_image(image: Any, path: Any, *_: Any, **__: Any) -> None:
    """Saves an image [C,H,W] or [1,C,H,W] with values in [0, 1]."""
    import torch
    from PIL import Image

    image = image.detach()
    if image.dim() == 4 and image.shape[0] == 1:
        image = image[0]
    if image.dim() != 3:
        raise NotImplementedError("save_image: expected one image [C,H,W], got %s: pip install torchvision"
                                  % list(image.shape))
    if image.shape[0] == 1:
        image = image.expand(3, -1, -1)
    rounded = (image.float() * 255 + 0.5).clamp(0, 255).permute(1, 2, 0).to(torch.uint8)
    Image.fromarray(rounded.cpu().numpy()).save(path)


def _torchvision() -> None:
    """Reading and writing images; networks need the real torchvision."""
    root: Any = types.ModuleType("torchvision")
    root.__path__ = []
    utils: Any = types.ModuleType("torchvision.utils")
    utils.save_image = _save_image
    transforms: Any = types.ModuleType("torchvision.transforms")
    transforms.__path__ = []
    functional: Any = types.ModuleType("torchvision.transforms.functional")
    functional.to_tensor = _to_tensor
    transforms.functional = functional
    transforms.ToTensor = lambda: _to_tensor
    root.utils, root.transforms, root.models = utils, transforms, _Missing("torchvision.models")
    for module in (root, utils, transforms, functional, root.models):
        sys.modules[module.__name__] = module


def _vgg() -> Optional[str]:
    """The path at which VGG's weights are missing; None if they exist."""
    import torch

    path = os.path.join(torch.hub.get_dir(), "checkpoints", "vgg16-397923af.pth")
    return None if os.path.exists(path) else path


def _lpips() -> None:
    """LPIPS needs weights that torchvision would download. Without them it returns NaN, with one message."""
    import torch

    weights = _vgg()
    if weights is None:
        return
    said: List[bool] = []

    def distance(*_: Any, **__: Any) -> Any:
        if not said:
            print("splatboost.cpu: LPIPS is not measured (nan): its VGG weights are not at %s" % weights)
            said.append(True)
        return torch.tensor(float("nan"))

    ours: Any = types.ModuleType("lpipsPyTorch")
    ours.lpips = distance
    sys.modules["lpipsPyTorch"] = ours

    class LPIPS(torch.nn.Module):
        def __init__(self, *_: Any, **__: Any):
            super().__init__()

        forward = staticmethod(distance)

    theirs: Any = types.ModuleType("lpips")
    theirs.LPIPS = LPIPS
    sys.modules["lpips"] = theirs


def _nvidia_smi() -> None:
    """Scaffold-GS and its successors query nvidia-smi for the device with the most free memory, and fail without it."""
    folder = tempfile.mkdtemp(prefix="splatboost-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    path = os.path.join(folder, "nvidia-smi")
    with open(path, "w", encoding="utf-8") as file:
        file.write("#!/bin/sh\necho 'GPU 0'\necho '    Used : 0 MiB'\n")
    os.chmod(path, 0o755)
    os.environ["PATH"] = folder + os.pathsep + os.environ.get("PATH", "")
