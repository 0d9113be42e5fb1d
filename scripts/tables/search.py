# SPDX-License-Identifier: Apache-2.0
"""Tables of docs/results/search.md: how the default was found."""
import math

from tables.cells import how, load, markdown
from tables.changes import change, differences, grouped, mean_change, mean_of, pairs_of
from tables.suite import BEFORE_GAPS


def default_search():
    """Rules that were tried for the default, beside the published run of the same scene and seed."""
    data = load("default_search")
    published = {row["scene"]: row["results"] for row in data if row["rules"] == "published"}
    scenes = sorted(published)
    rows = [["rules"] + [f"{scene}: {what}" for scene in scenes for what in ("PSNR", "SSIM", "LPIPS", "Gaussians")]]
    for rules in dict.fromkeys(row["rules"] for row in data):
        found = {row["scene"]: row["results"] for row in data if row["rules"] == rules}
        cells = [rules]
        for scene in scenes:
            r, p = found.get(scene), published[scene]
            if r is None:
                cells += ["–"] * 4
            elif r is p:
                cells += values(p)
            else:
                cells += differences(change([(p, r)]), ("primitives",))
        rows.append(cells)
    return markdown(rows) + "\n\n" + how(published[scenes[0]])


def values(r):
    return [f"{r['psnr']:.2f} dB", f"{r['ssim']:.4f}", f"{r['lpips']:.4f}", f"{r['primitives']:,}"]


def growth_end():
    """Where growth ends and late pruning begins, scene by scene."""
    runs = {}
    for row in load("growth_end"):
        runs.setdefault((row["results"]["iterations"], row["scene"]), {})[row["growth_until"]] = row["results"]
    shares = ["half", "third", "quarter"]
    rows = [["iterations, scene"] + [f"{share}: {what}" for share in shares for what in ("PSNR", "SSIM", "LPIPS", "Gaussians")]]
    for (iterations, scene), of in sorted(runs.items()):
        cells = [f"{iterations:,}, {scene}".replace(",", " ", iterations >= 1000)]
        for share in shares:
            cells += values(of[share]) if share in of else ["–"] * 4
        rows.append(cells)
    return markdown(rows) + "\n\n" + how(runs[min(runs)]["half"])


def growth_end_full():
    """Growth until a quarter of the run beside growth until a third, at full size."""
    rows = [["scene", "seeds", "third: PSNR", "quarter: ΔPSNR", "ΔSSIM", "ΔLPIPS", "Gaussians"]]
    runs = grouped("default_full", lambda row: row["scene"])
    changes = []
    for scene, of in sorted(runs.items()):
        pairs = pairs_of(of, "growth until a third", BEFORE_GAPS)
        if pairs:
            changes.append(change(pairs))
            rows.append([scene, str(len(pairs)), f"{mean_of(pairs, 'psnr'):.2f} dB", *differences(changes[-1], ("primitives",))])
    rows.append([f"**mean of {len(changes)}**", "", "", *differences(mean_change(changes), ("primitives",))])
    return markdown(rows) + "\n\n" + how(next(iter(runs.values()))[BEFORE_GAPS][0])


def growth_rules():
    """Rules of growth, resets and box that were varied at full size, beside the published run of the same seeds."""
    runs = grouped("growth_rules", lambda row: row["scene"])
    rows = [["scene", "rules", "seeds", "PSNR", "SSIM", "LPIPS", "Gaussians"]]
    for scene, of in sorted(runs.items()):
        for rules in of:
            pairs = pairs_of(of, "published", rules)
            if rules == "published":
                cells = [f"{mean_of(pairs, 'psnr'):.2f} dB", *(f"{mean_of(pairs, what):.4f}" for what in ("ssim", "lpips")),
                         f"{mean_of(pairs, 'primitives'):,.0f}"]
            else:
                cells = differences(change(pairs) | {"error": math.nan}, ("primitives",))
            rows.append([scene if rules == "published" else "", rules, str(len(pairs)), *cells])
    first = next(iter(runs.values()))["published"]
    return markdown(rows) + "\n\n" + how(first[min(first)])


def higher_bands():
    """Variants of how the coefficients of higher SH bands step, beside steps at every iteration, at the same seeds."""
    runs = {}
    for row in load("higher_bands"):
        variant = (row["accumulates"], row["rest_interval"], row["rest_rate"])
        runs.setdefault(row["scene"], {}).setdefault(variant, {})[row["seed"]] = row["results"]
    plain = (True, 1, 1)
    variants = {variant for of in runs.values() for variant in of} - {plain}
    rows = [["a step every", "rate", "scenes", "runs", "ΔPSNR", "ΔSSIM", "ΔLPIPS", "Gaussians", "CPU time"]]
    ratios = ("primitives", "cpu_seconds")
    for variant in sorted(variants, key=lambda variant: (not variant[0], variant[1:])):
        accumulates, interval, rate = variant
        pairs = [pairs_of(of, plain, variant) for of in runs.values() if variant in of]
        title = f"{interval} iterations" if accumulates else f"{interval} iterations, other gradients not computed"
        rows.append([title, f"{rate}×", str(len(pairs)), str(sum(map(len, pairs))),
                     *differences(mean_change([change(of_scene, ratios) for of_scene in pairs]), ratios)])
    return markdown(rows) + "\n\n" + how(runs["fox"][plain][0])


TABLES = {"default_search": default_search, "growth_end": growth_end, "growth_end_full": growth_end_full, "growth_rules": growth_rules,
          "higher_bands": higher_bands}
