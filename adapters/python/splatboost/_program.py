# SPDX-License-Identifier: Apache-2.0
"""The command `splatboost` of an installed package: the program that wheels hold."""

from __future__ import annotations

import os
import sys
from typing import List, Optional

PATH = os.path.join(os.path.dirname(os.path.abspath(__file__)), "bin", "splatboost")


def main(arguments: Optional[List[str]] = None) -> int:
    """Becomes the program; returns where there is none."""
    arguments = sys.argv[1:] if arguments is None else arguments
    if not os.access(PATH, os.X_OK):
        sys.stderr.write("splatboost: this installation holds the Python package alone; scripts/build in the source tree builds "
                         "the program, and wheels hold it\n")
        return 2
    os.execv(PATH, ["splatboost"] + arguments)


if __name__ == "__main__":
    sys.exit(main())
