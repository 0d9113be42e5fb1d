# SPDX-License-Identifier: Apache-2.0
"""Installs the drop-ins in sys.modules under the names of the upstream extensions."""

from __future__ import annotations

import importlib
import sys
import types
from typing import List

#: layout → module of splatboost.compat
LAYOUTS = {
    "3dgs-2023": "diff_gaussian_rasterization_2023",
    "3dgs-2024": "diff_gaussian_rasterization_2024",
    "3dgs-accelerated": "diff_gaussian_rasterization_accelerated",
    "mip-splatting": "diff_gaussian_rasterization_mip_splatting",
    "deformable-3dgs": "diff_gaussian_rasterization_deformable",
    "absgs": "diff_gaussian_rasterization_absgs",
    "opacity-fields": "diff_gaussian_rasterization_opacity_fields",
    "surfels": "diff_surfel_rasterization",
    "anchors": "diff_gaussian_rasterization_anchors",
    "convexes": "diff_convex_rasterization",
    "pgsr": "diff_plane_rasterization",
}

#: layout → the name that its host imports, if other than diff_gaussian_rasterization
_NAMES = {"absgs": "diff_gaussian_rasterization_abs", "surfels": "diff_surfel_rasterization",
          "convexes": "diff_convex_rasterization", "pgsr": "diff_plane_rasterization"}


def install_drop_ins(layout: str) -> List[str]:
    """Makes `import diff_gaussian_rasterization`, `simple_knn._C` and `fused_ssim` import SplatBoost's drop-ins.

    layout: one of LAYOUTS. Must be called before the host's imports. Returns the names of the modules set. A second
    call with the same layout has no effect.
    """
    if not isinstance(layout, str) or layout not in LAYOUTS:
        raise ValueError("layout: expected one of %s, got %r" % (", ".join(sorted(LAYOUTS)), layout))
    compat = __package__ + ".compat." if __package__ else "splatboost.compat."
    rasterization = importlib.import_module(compat + LAYOUTS[layout])
    name = _NAMES.get(layout, "diff_gaussian_rasterization")
    present = sys.modules.get(name)
    if present is not None and present is not rasterization:
        raise RuntimeError(
            "install_drop_ins: %s is imported already, from %s; call it before the host's "
            "imports" % (name, getattr(present, "__file__", "elsewhere"))
        )
    simple_knn = sys.modules.get("simple_knn") or types.ModuleType("simple_knn")
    simple_knn.__path__ = getattr(simple_knn, "__path__", [])
    knn = importlib.import_module(compat + "simple_knn")
    setattr(simple_knn, "_C", knn)
    modules = {
        name: rasterization,
        "simple_knn": simple_knn,
        "simple_knn._C": knn,
        "fused_ssim": importlib.import_module(compat + "fused_ssim"),
    }
    sys.modules.update(modules)
    return sorted(modules)
