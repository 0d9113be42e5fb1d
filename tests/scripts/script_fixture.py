# SPDX-License-Identifier: Apache-2.0
import importlib.machinery
import importlib.util

import pytest


@pytest.fixture(scope="module")
def script(request):
    """The script that the test module names SCRIPT, as a module; it has no .py at its end, so `import` cannot find it."""
    path = request.module.SCRIPT
    loader = importlib.machinery.SourceFileLoader(path.name, str(path))
    module = importlib.util.module_from_spec(importlib.util.spec_from_loader(path.name, loader))
    loader.exec_module(module)
    return module
