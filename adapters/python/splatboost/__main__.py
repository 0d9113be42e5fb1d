# SPDX-License-Identifier: Apache-2.0
"""`python -m splatboost doctor [CHECKOUT]` and `python -m splatboost view MODEL`."""

from __future__ import annotations

import sys

from . import doctor, view

_USAGE = """usage: python -m splatboost doctor [CHECKOUT]
       python -m splatboost view MODEL [MODEL] [--live] [--port N] [--host ADDRESS]

  doctor   shows which parts of SplatBoost, torch and CUDA are installed and how to install what is missing; with the
           folder of a backbone's checkout, also checks the Python modules that its scripts need
  view     shows a trained model in a browser, or the two of a comparison side by side (see --help)

python -m splatboost.cpu SCRIPT …   runs a checkout's script on the CPU (see --help)
"""


def main() -> int:
    command, rest = sys.argv[1:2], sys.argv[2:]
    if command == ["view"]:
        return view.main(rest)
    if {"-h", "--help"}.intersection(sys.argv[1:]):
        print(_USAGE, end="")
        return 0
    if command == ["doctor"] and len(rest) <= 1 and not "".join(rest).startswith("-"):
        return doctor.main(*rest)
    print(_USAGE, end="", file=sys.stderr)
    return 2


if __name__ == "__main__":
    sys.exit(main())
