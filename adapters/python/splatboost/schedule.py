# SPDX-License-Identifier: Apache-2.0
"""Scales the schedule of the published run to runs of any length. Does not need torch."""

from __future__ import annotations

import ctypes
from typing import NamedTuple

from . import _library as lib

#: Length of the published run; iteration numbers of the papers refer to it.
PUBLISHED_ITERATIONS = 30000


class StepIntervals(NamedTuple):
    """Step intervals of a parameter group in each of three phases; their ends refer to the published run."""

    early: int = 1
    middle: int = 1
    late: int = 1
    early_end: int = 15000
    middle_end: int = 20000


def steps_at(intervals: StepIntervals, iteration: int, total: int) -> bool:
    """Whether a group with these intervals steps at this iteration (from 1) of a run of `total`."""
    steps = ctypes.c_int32()
    lib.call("sb_steps_at", ctypes.byref(lib.StepIntervals(*intervals)), iteration, total, ctypes.byref(steps))
    return bool(steps.value)


def scaled_iteration(published: int, total: int, published_total: int = PUBLISHED_ITERATIONS) -> int:
    """The iteration of a run of `total` that corresponds to `published` of a run of `published_total`, at least 1."""
    iteration = ctypes.c_int32()
    lib.call("sb_scaled_iteration", published, total, published_total, ctypes.byref(iteration))
    return int(iteration.value)


def exponential_rate(initial: float, final: float, iteration: int, steps: int) -> float:
    """Log-linear interpolation from `initial` at iteration 0 to `final` at `steps` and after."""
    rate = ctypes.c_double()
    lib.call("sb_exponential_rate", initial, final, iteration, steps, ctypes.byref(rate))
    return float(rate.value)
