# SPDX-License-Identifier: Apache-2.0
"""`python -m splatboost doctor [CHECKOUT]` and `python -m splatboost view MODEL`."""

from __future__ import annotations

import difflib
import sys
from typing import List, Sequence

from . import doctor, view

_USAGE = """usage: python -m splatboost doctor [CHECKOUT]
       python -m splatboost view MODEL [MODEL] [--live] [--port N] [--host ADDRESS]

  doctor   shows which parts of SplatBoost, torch and CUDA are installed and how to install what is missing; with the
           folder of a backbone's checkout, also checks the Python modules that its scripts need
  view     shows a trained model in a browser, or the two of a comparison side by side (options: python -m splatboost view --help)

python -m splatboost.cpu SCRIPT …   runs a checkout's script on the CPU (options: python -m splatboost.cpu --help)
"""


_COMMANDS = ("doctor", "view")


def _near(wrong: str, names: Sequence[str]) -> str:
    """The nearest of the names, as the end of an error; all of them if none is near."""
    found = difflib.get_close_matches(wrong, names, 1)
    return "did you mean %s?" % found[0] if found else "available: " + ", ".join(names)


def _fail(message: str) -> int:
    print("splatboost %s" % message, file=sys.stderr)
    return 2


def _doctor(arguments: List[str]) -> int:
    for argument in arguments:
        if argument.startswith("-"):
            return _fail("doctor: unknown option %s; %s" % (argument, _near(argument, ("--help",))))
    if len(arguments) > 1:
        return _fail("doctor: expected one folder, got %d: %s" % (len(arguments), " ".join(arguments)))
    return doctor.main(*arguments)


def main() -> int:
    command, rest = "".join(sys.argv[1:2]), sys.argv[2:]
    if command == "view":
        return view.main(rest)
    if {"-h", "--help"}.intersection(sys.argv[1:]):
        print(_USAGE, end="")
        return 0
    if command == "doctor":
        return _doctor(rest)
    if command:
        return _fail("%s: no such command; %s" % (command, _near(command, _COMMANDS)))
    print(_USAGE, end="", file=sys.stderr)
    return 2


if __name__ == "__main__":
    sys.exit(main())
