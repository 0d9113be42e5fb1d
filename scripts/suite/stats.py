# SPDX-License-Identifier: Apache-2.0
"""The suite's statistics, on plain numbers. Results that are not defined are None."""
import math


def mean(values):
    """Arithmetic mean; None without values."""
    values = list(values)
    return math.fsum(values) / len(values) if values else None


def standard_error(values):
    """Standard error of the mean: sample standard deviation (n - 1) / sqrt(n); None for fewer than two values."""
    values = list(values)
    if len(values) < 2:
        return None
    center = mean(values)
    return math.sqrt(math.fsum((v - center) ** 2 for v in values) / (len(values) - 1) / len(values))


def geometric_mean(values):
    """Geometric mean; None without values, ValueError if a value is not positive."""
    values = list(values)
    if any(not v > 0 for v in values):
        raise ValueError("a geometric mean needs positive values")
    return math.exp(mean(math.log(v) for v in values)) if values else None


def estimate(values):
    """{"mean", "error", "count"} of the values that are not None."""
    values = [v for v in values if v is not None]
    return {"mean": mean(values), "error": standard_error(values), "count": len(values)}


def paired(values, reference, operation):
    """List of operation(value, reference value) for the seeds that have both. Arguments are {seed: value or None}."""
    return [operation(values[seed], reference[seed]) for seed in sorted(values.keys() & reference.keys())
            if values[seed] is not None and reference[seed] is not None]


def mean_of_estimates(estimates):
    """Mean over scenes of estimates over seeds. Its error covers variation over seeds, not over scenes; None if a scene
    has none."""
    estimates = [e for e in estimates if e["mean"] is not None]
    errors = [e["error"] for e in estimates]
    known = bool(errors) and all(e is not None for e in errors)
    return {"mean": mean(e["mean"] for e in estimates),
            "error": math.sqrt(math.fsum(e * e for e in errors)) / len(errors) if known else None,
            "count": len(estimates)}


def worst(differences):
    """(name, estimate) with the lowest mean in {name: estimate}; None if there is no mean. The first name wins ties."""
    known = [(e["mean"], name) for name, e in differences.items() if e["mean"] is not None]
    if not known:
        return None
    name = min(known)[1]
    return name, differences[name]


def on_curve(points, number):
    """Quality at `number` primitives on a curve of (number, quality) points, interpolated linearly in the logarithm
    of the number. None outside the curve (no extrapolation). Points with equal numbers are averaged."""
    by_number = {}
    for n, quality in points:
        by_number.setdefault(n, []).append(quality)
    curve = sorted((n, mean(qualities)) for n, qualities in by_number.items())
    if not curve or not curve[0][0] <= number <= curve[-1][0]:
        return None
    for (n0, q0), (n1, q1) in zip(curve, curve[1:]):
        if number <= n1:
            return q0 + (q1 - q0) * (math.log(number) - math.log(n0)) / (math.log(n1) - math.log(n0))
    return curve[0][1]
