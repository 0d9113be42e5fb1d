# SPDX-License-Identifier: Apache-2.0
"""The command `splatboost` of an installed package: runs the program that wheels contain."""

from __future__ import annotations

import os
import sys
from typing import List, Optional

PATH = os.path.join(os.path.dirname(os.path.abspath(__file__)), "bin", "splatboost")


def main(arguments: Optional[List[str]] = None) -> int:
    """Replaces this process by the program; returns 2 if it is not installed."""
    arguments = sys.argv[1:] if arguments is None else arguments
    if not os.access(PATH, os.X_OK):
        sys.stderr.write("splatboost: this installation contains only the Python package; scripts/build in the source tree "
                         "builds the program, and wheels include it\n")
        return 2
    os.execv(PATH, ["splatboost"] + arguments)


if __name__ == "__main__":
    sys.exit(main())
