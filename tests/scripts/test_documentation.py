# SPDX-License-Identifier: Apache-2.0
"""Blocks of Python and of commands in the documents leave nothing out and are valid code. tests/python/test_package.py runs
those of the Python package."""
import re
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "adapters/python/README.md", *sorted((ROOT / "docs").rglob("*.md"))]
BLOCKS = [pytest.param(language, code, id=f"{page.relative_to(ROOT)}:{page.read_text()[:found.start()].count(chr(10)) + 1}")
          for page in PAGES for found in re.finditer(r"^```(python|sh)\n(.*?)^```", page.read_text(), re.S | re.M)
          for language, code in [found.groups()]]


@pytest.mark.parametrize("language, code", BLOCKS)
def test_a_block_is_whole(language, code):
    assert "…" not in re.sub(r"(^|\s)#.*", "", code), "leaves something out"
    if language == "python":
        compile(code, "block", "exec")
    else:
        told = subprocess.run(["bash", "-n"], input=code, capture_output=True, text=True, check=False, timeout=60)
        assert told.returncode == 0 and not told.stderr, told.stderr
