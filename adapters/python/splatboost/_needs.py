# SPDX-License-Identifier: Apache-2.0
"""Finds the Python modules that a host's script needs, which are missing, and the command that installs them."""

from __future__ import annotations

import ast
import importlib.util
import os
import shutil
import sys
from typing import Iterable, Iterator, List, Optional, Set

#: Module → its package on PyPI, if the names differ.
PACKAGES = {
    "PIL": "pillow",
    "cv2": "opencv-python-headless",
    "dateutil": "python-dateutil",
    "skimage": "scikit-image",
    "sklearn": "scikit-learn",
    "torch_scatter": "torch-scatter",
    "yaml": "pyyaml",
}

#: Command that creates an environment in which Debian's torch can be imported.
ENVIRONMENT = "/usr/bin/python3 -m venv --system-site-packages"


def _imports(tree: ast.AST) -> Iterator[str]:
    """Modules imported whenever the file is: excludes imports within functions and try blocks."""
    waiting: List[ast.AST] = [tree]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield alias.name
        elif isinstance(node, ast.ImportFrom):
            if node.level == 0 and node.module:
                yield node.module
                for alias in node.names:
                    yield node.module + "." + alias.name
            elif node.level > 0:
                yield "." * node.level + (node.module or "")
        elif not isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda, ast.Try)):
            waiting.extend(ast.iter_child_nodes(node))


def _file_of(folder: str, module: str) -> Optional[str]:
    """The file of a module in the checkout; None for other modules."""
    base = os.path.join(folder, *module.split("."))
    for path in (base + ".py", os.path.join(base, "__init__.py")):
        if os.path.isfile(path):
            return path
    return None


def needed_modules(script: str, checkout: Optional[str] = None) -> List[str]:
    """Top-level modules needed by a script and by the files of its folder that it imports, sorted.

    checkout: another folder with files that the script may import
    """
    folders = [os.path.dirname(os.path.abspath(script))] + ([os.path.abspath(checkout)] if checkout else [])
    found: Set[str] = set()
    seen: Set[str] = set()
    waiting = [os.path.abspath(script)]
    while waiting:
        path = waiting.pop()
        if path in seen:
            continue
        seen.add(path)
        try:
            with open(path, encoding="utf-8", errors="replace") as file:
                tree = ast.parse(file.read())
        except (OSError, SyntaxError):
            continue
        for module in _imports(tree):
            here = folders
            if module.startswith("."):
                package = os.path.dirname(path)
                for _ in range(len(module) - len(module.lstrip(".")) - 1):
                    package = os.path.dirname(package)
                here = [package]
                module = module.lstrip(".")
            # Importing a module imports its parent packages too.
            names = module.split(".")
            files = [_file_of(folder, ".".join(names[: i + 1])) for i in range(len(names)) for folder in here]
            waiting.extend(file for file in files if file is not None)
            if here is folders and not any(files) and not any(os.path.isdir(os.path.join(folder, names[0])) for folder in here):
                found.add(names[0])
    return sorted(found)


def _is_there(module: str) -> bool:
    if module in sys.modules:
        return True
    try:
        return importlib.util.find_spec(module) is not None
    except (ImportError, ValueError):
        return False


def missing_modules(script: str, stand_ins: Iterable[str] = (), checkout: Optional[str] = None) -> List[str]:
    """The needed modules that are not installed. stand_ins: modules that the runner of the script provides."""
    provided = set(stand_ins)
    return [name for name in needed_modules(script, checkout) if name not in provided and not _is_there(name)]


def install_command(modules: Iterable[str]) -> str:
    """One command that installs all of them without breaking torch's numpy."""
    packages = sorted({PACKAGES.get(name.split(".")[0], name.split(".")[0]) for name in modules})
    return "pip install " + " ".join(_numpy_limit() + packages)


def _numpy_limit() -> List[str]:
    """A torch built for numpy 1 cannot use numpy 2, which the newest packages would install."""
    try:
        import torch
    except Exception:
        return []
    return ['"numpy<2"'] if _version_of(torch.__version__) < [2, 3] else []


def _version_of(text: str) -> List[int]:
    return [int(part) for part in text.split("+")[0].split(".")[:2] if part.isdigit()]


def numpy_trouble() -> Optional[str]:
    """Why torch cannot share memory with numpy, and the remedy; None if it can."""
    import torch

    try:
        torch.zeros(1).numpy()
        return None
    except Exception as error:  # its type and message depend on the version of torch
        try:
            import numpy

            have = "numpy %s" % numpy.__version__
        except ImportError:
            return "torch %s needs numpy, which is not installed: pip install %s" % (
                torch.__version__, " ".join(_numpy_limit() or ["numpy"]))
        return "torch %s cannot use %s (%s): pip install \"numpy<2\"" % (torch.__version__, have, str(error).split("\n")[0])


def where_torch_is() -> str:
    """How to get torch, for a Python without it."""
    if shutil.which("nvidia-smi"):
        return "pip install torch   (with CUDA; other versions of CUDA: https://pytorch.org/get-started/locally)"
    debian = "/usr/lib/python3/dist-packages/torch"
    if os.path.isdir(debian):
        return "Debian's torch is installed, but %s cannot find it: %s ~/sb && . ~/sb/bin/activate" % (
            sys.executable, ENVIRONMENT)
    return "pip install torch --index-url https://download.pytorch.org/whl/cpu, or apt-get install python3-torch"
