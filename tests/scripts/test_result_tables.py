# SPDX-License-Identifier: Apache-2.0
"""Numbers in the documentation are those of the committed measurements."""
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def test_tables_match_the_measurements():
    done = subprocess.run([ROOT / "scripts/result_tables", "--check"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_every_table_of_the_documents_has_a_measurement():
    pages = [ROOT / "README.md", *sorted((ROOT / "docs/results").glob("*.md"))]
    text = "".join(page.read_text() for page in pages)
    begun, ended = text.count("<!-- begin "), text.count("<!-- end ")
    assert begun == ended and begun >= 8
