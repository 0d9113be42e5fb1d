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
    if not isinstance(intervals, (tuple, list)) or len(intervals) > len(StepIntervals._fields):
        raise ValueError("intervals: expected StepIntervals, got %s" % lib.shown(intervals))
    numbers = [lib.whole(value, "intervals: " + name) for name, value in zip(StepIntervals._fields, intervals)]
    iteration, total = lib.whole(iteration, "iteration"), lib.whole(total, "total")
    steps = ctypes.c_int32()
    lib.call("sb_steps_at", ctypes.byref(lib.StepIntervals(*numbers)), iteration, total, ctypes.byref(steps))
    return bool(steps.value)


def scaled_iteration(published: int, total: int, published_total: int = PUBLISHED_ITERATIONS) -> int:
    """The iteration of a run of `total` that corresponds to `published` of a run of `published_total`, at least 1."""
    published, total = lib.whole(published, "published", 0), lib.whole(total, "total", 1)
    published_total = lib.whole(published_total, "published_total", 1)
    iteration = ctypes.c_int32()
    lib.call("sb_scaled_iteration", published, total, published_total, ctypes.byref(iteration))
    return int(iteration.value)


def exponential_rate(initial: float, final: float, iteration: int, steps: int) -> float:
    """Log-linear interpolation from `initial` at iteration 0 to `final` at `steps` and after."""
    initial, final = lib.number(initial, "initial"), lib.number(final, "final")
    for name, value in (("initial", initial), ("final", final)):
        if not value > 0:
            raise ValueError("%s: expected a number above 0, got %r" % (name, value))
    iteration, steps = lib.whole(iteration, "iteration"), lib.whole(steps, "steps", 1)
    rate = ctypes.c_double()
    lib.call("sb_exponential_rate", initial, final, iteration, steps, ctypes.byref(rate))
    return float(rate.value)
