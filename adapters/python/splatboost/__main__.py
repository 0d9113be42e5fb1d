# SPDX-License-Identifier: Apache-2.0
"""`python -m splatboost doctor`."""

from __future__ import annotations

import sys

from . import doctor

_USAGE = """usage: python -m splatboost doctor

  doctor   what of SplatBoost, torch and CUDA is there, what is missing, and how to get it
"""


def main() -> int:
    if sys.argv[1:] == ["doctor"]:
        return doctor.main()
    if sys.argv[1:] in (["-h"], ["--help"]):
        print(_USAGE, end="")
        return 0
    print(_USAGE, end="", file=sys.stderr)
    return 2


if __name__ == "__main__":
    sys.exit(main())
