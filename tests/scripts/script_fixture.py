# SPDX-License-Identifier: Apache-2.0
import importlib.machinery
import importlib.util

import pytest


@pytest.fixture(scope="module")
def script(request):
    """The script at the test module's SCRIPT, as a module; without the suffix .py `import` cannot find it."""
    path = request.module.SCRIPT
    loader = importlib.machinery.SourceFileLoader(path.name, str(path))
    module = importlib.util.module_from_spec(importlib.util.spec_from_loader(path.name, loader))
    loader.exec_module(module)
    return module
