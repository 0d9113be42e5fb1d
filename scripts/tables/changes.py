# SPDX-License-Identifier: Apache-2.0
"""Runs of two rule sets at the same seeds: what changes in a scene, as means over its seeds, and over scenes."""
import math
import statistics

from tables.cells import decibels, difference, load, ratio

QUALITIES = ("psnr", "ssim", "lpips")


def grouped(name, key, wanted=lambda row: True):
    """{key(row): {rules: {seed: results}}} of the wanted rows of a file of runs, in the order of the file."""
    runs = {}
    for row in filter(wanted, load(name)):
        runs.setdefault(key(row), {}).setdefault(row["rules"], {})[row["seed"]] = row["results"]
    return runs


def pairs_of(of, other, own):
    """(results of `other`, results of `own`) of the seeds that both have."""
    others, owns = of.get(other, {}), of.get(own, {})
    return [(others[seed], owns[seed]) for seed in sorted(others.keys() & owns.keys())]


def standard_error(values):
    """Of their mean; NaN for fewer than two."""
    return statistics.stdev(values) / math.sqrt(len(values)) if len(values) > 1 else math.nan


def known_mean(values):
    """Geometric mean of those that are known."""
    known = [value for value in values if not math.isnan(value)]
    return statistics.geometric_mean(known) if known else math.nan


def change(pairs, ratios=("primitives",), qualities=QUALITIES):
    """Means over the pairs: changes of the qualities, "error", which is the standard error of the change of PSNR, and geometric means
    of ratios, NaN where no pair has the value (times of runs that were not measured together are left out of the files)."""
    mean = {what: statistics.mean(own[what] - other[what] for other, own in pairs) for what in qualities}
    mean["error"] = standard_error([own["psnr"] - other["psnr"] for other, own in pairs])
    for what in ratios:
        mean[what] = known_mean(own[what] / other[what] if what in own and what in other else math.nan for other, own in pairs)
    return mean


def mean_change(changes):
    """Means of change() over scenes. "error" is the standard error over the scenes."""
    mean = {}
    for what in changes[0]:
        values = [change[what] for change in changes]
        mean[what] = statistics.mean(values) if what in QUALITIES else known_mean(values)
    mean["error"] = standard_error([change["psnr"] for change in changes])
    return mean


def worst_change(changes):
    """The worst of each value of change() over scenes; without an error."""
    worst = {}
    for what in changes[0]:
        known = [change[what] for change in changes if not math.isnan(change[what])]
        worst[what] = (min if what in ("psnr", "ssim") else max)(known, default=math.nan)
    return worst | {"error": math.nan}


def quality(mean):
    """Cells of a change's qualities; there may be no LPIPS."""
    return [decibels(mean["psnr"], mean.get("error", math.nan)), *(difference(mean[what], 4) for what in ("ssim", "lpips") if what in mean)]


def differences(mean, ratios):
    """Cells of a change's qualities and ratios."""
    return [*quality(mean), *(ratio(mean[what]) for what in ratios)]


def mean_of(pairs, what, side=0):
    """The mean of a value over the first (or second) runs of pairs."""
    return statistics.mean(pair[side][what] for pair in pairs)


def beside_published(of, qualities, amounts):
    """For each rule set of a scene: its name; the number of seeds that the published run has too, the mean PSNR, mean changes
    from the published runs, and mean amounts with their ratios, as cells; and its results of these seeds.
    @param of      {rule set: {seed: results}}
    @param amounts {name in the results: format of a mean}, over the pairs that have it"""
    for rules in of:
        pairs = pairs_of(of, "published", rules)
        cells = [str(len(pairs)), f"{mean_of(pairs, 'psnr', 1):.2f} dB"]
        cells += [""] * len(qualities) if rules == "published" else quality(change(pairs, (), qualities))
        for what, form in amounts.items():
            known = [(p, r) for p, r in pairs if what in p and what in r]
            cells.append(form.format(mean_of(known, what, 1)) if known else "–")
            if known and rules != "published":
                cells[-1] += f" ({statistics.geometric_mean(r[what] / p[what] for p, r in known):.2f}×)"
        yield rules, cells, [r for _, r in pairs]
