# SPDX-License-Identifier: Apache-2.0
"""Tables of docs/results/suite.md: the default beside 3DGS as published."""
import math
import statistics

from tables.cells import decibels, how, load, markdown, minutes
from tables.changes import change, differences, grouped, mean_change, mean_of, pairs_of, quality, worst_change

#: The default's rows before accelerated runs added points where the photos show none of the dataset's.
BEFORE_GAPS = "without points in gaps"
#: The default's rows of default_full.json before higher SH bands stepped less often.
BEFORE_BANDS = "higher bands at every iteration"
#: The default's rows before accelerated runs ended with averages of their last parameters.
BEFORE_AVERAGES = "without averages"
#: Rows of files whose default's rows are still of before that.
WITH_AVERAGES = "with averages at the end"
#: Title and file of each line of the table of averages.
AVERAGED = [("3DGS, 400 to 500 pixels", "default_full"), ("3DGS, 250 pixels wide", "default_scenes"),
            ("3D convexes, 66 to 120 pixels wide", "convex_splatting")]


def scene_and_role(row):
    return row["scene"], row["role"]


def chosen_first(item):
    """Orders scenes with a role: those that the rules were chosen on, then by name."""
    (scene, role, *rest), _ = item
    return role != "chosen on", scene, *rest


def starred(scene, role):
    return scene + (" *" if role == "chosen on" else "")


def scenes(name, time="cpu_seconds", time_title="CPU time", other="published", own="default"):
    """Own rules beside the others, scene by scene: means over the seeds that both have, then over scenes."""
    runs = {scene: of for scene, of in grouped(name, scene_and_role).items() if other in of and own in of}
    rows = [["scene", "seeds", "PSNR", "ΔPSNR", "ΔSSIM", "ΔLPIPS", "Gaussians", time_title, "peak memory"]]
    ratios = ("primitives", time, "peak_memory_bytes")
    changes = []
    for (scene, role), of in sorted(runs.items(), key=chosen_first):
        pairs = pairs_of(of, other, own)
        changes.append(change(pairs, ratios))
        rows.append([starred(scene, role), str(len(pairs)), f"{mean_of(pairs, 'psnr'):.2f} dB", *differences(changes[-1], ratios)])
    rows.append([f"**mean of {len(changes)}**", "", "", *differences(mean_change(changes), ratios)])
    rows.append(["**worst**", "", "", *differences(worst_change(changes), ratios)])
    first = next(iter(runs.values()))[own]
    return markdown(rows) + "\n\n" + how(first[min(first)])


#: Pairs of rules that differ in averages alone; of a scene, the first that it has.
OF_AVERAGES = [(BEFORE_AVERAGES, "rate of means by the extent"), (BEFORE_AVERAGES, "default"),
               ("lengths in world units, without averages", WITH_AVERAGES), ("default", WITH_AVERAGES)]


def averages():
    """The default beside itself without averages at the end, as means over scenes of means over seeds."""
    rows = [["backbone", "iterations", "scenes", "runs", "ΔPSNR", "ΔSSIM", "ΔLPIPS", "worst scene", "best scene"]]
    for title, name in AVERAGED:
        scenes = [next(filter(None, (pairs_of(of, *rules) for rules in OF_AVERAGES)), None)
                  for of in grouped(name, lambda row: row["scene"]).values()]
        scenes = [pairs for pairs in scenes if pairs]
        changes = [change(pairs) for pairs in scenes]
        psnr = [one["psnr"] for one in changes]
        iterations = sorted({own["iterations"] for pairs in scenes for _, own in pairs})
        rows.append([title, ", ".join(f"{n:,}" for n in iterations), str(len(scenes)), str(sum(map(len, scenes))),
                     *quality(mean_change(changes)), decibels(min(psnr)), decibels(max(psnr))])
    return markdown(rows)


def free_space():
    """The default with and without free space around the cameras, both beside the published run of the same seeds."""
    without = "without free space"
    measures = ("psnr", "ssim", "lpips", "primitives")
    titles = ("ΔPSNR", "ΔSSIM", "ΔLPIPS", "Gaussians")
    rows = [["scene", "seeds"] + [f"{what}, {rule}" for what in titles for rule in ("without", "with")]]

    def both(a, b):
        cells = [differences(mean | {"error": math.nan}, ("primitives",)) for mean in (a, b)]
        return [cell for k in range(len(measures)) for cell in (cells[0][k], cells[1][k])]

    runs = grouped("default_full", lambda row: row["scene"])
    changes = {without: [], BEFORE_BANDS: []}
    for scene, of in sorted(runs.items()):
        seeds = of.get(without, {}).keys() & of[BEFORE_BANDS].keys() & of["published"].keys()
        if not seeds:
            continue
        for rules, known in changes.items():
            known.append(change([(of["published"][seed], of[rules][seed]) for seed in sorted(seeds)]))
        rows.append([scene, str(len(seeds)), *both(*(known[-1] for known in changes.values()))])
    rows.append([f"**mean of {len(changes[without])}**", "", *both(*map(mean_change, changes.values()))])
    first = next(iter(runs.values()))[BEFORE_BANDS]
    return markdown(rows) + "\n\n" + how(first[min(first)])


def equal_number(name="default_full", backbone=None, own=BEFORE_GAPS):
    """The default, or an earlier one, beside the published run under a cap at about the default's number of Gaussians."""
    rows = [["scene", "seeds", "Gaussians: published, capped", "default", "published, capped: PSNR", "SSIM", "LPIPS", "default: ΔPSNR",
             "ΔSSIM", "ΔLPIPS"]]
    capped = "published under a cap"
    runs = grouped(name, lambda row: (row.get("backbone"), row["scene"]))
    runs = {scene: of for (of_backbone, scene), of in runs.items() if of_backbone == backbone}
    changes = []
    for scene, of in sorted(runs.items()):
        pairs = pairs_of(of, capped, own)
        if not pairs:
            continue
        changes.append(change(pairs))
        rows.append([scene, str(len(pairs)), *(f"{mean_of(pairs, 'primitives', side):,.0f}" for side in (0, 1)),
                     f"{mean_of(pairs, 'psnr'):.2f} dB", *(f"{mean_of(pairs, what):.4f}" for what in ("ssim", "lpips")),
                     *quality(changes[-1])])
    rows.append([f"**mean of {len(changes)}**", *[""] * 6, *quality(mean_change(changes))])
    return markdown(rows) + "\n\n" + how(next(iter(next(of[capped] for of in runs.values() if capped in of).values())))


def given_size():
    """The default under a cap beside the published run under the same cap, without the rule for caps too."""
    rows = [["scene", "seeds", "cap", "Gaussians", "published: PSNR", "without the rule: ΔPSNR", "ΔPSNR", "ΔSSIM", "ΔLPIPS"]]
    runs = grouped("given_size", lambda row: (row["scene"], row["role"], row["cap"], row["backbone"]))
    runs = {key[:3]: of for key, of in runs.items() if key[3] == "vanilla"}
    changes = []
    for (scene, role, cap), of in sorted(runs.items(), key=chosen_first):
        pairs = pairs_of(of, "published", "default")
        changes.append(change(pairs))
        without = pairs_of(of, "published", "without the rule")
        rows.append([starred(scene, role), str(len(pairs)), f"{cap:,}", f"{mean_of(pairs, 'primitives', 1):,.0f}",
                     f"{mean_of(pairs, 'psnr'):.2f} dB",
                     decibels(statistics.mean(own["psnr"] - other["psnr"] for other, own in without)) if without else "–",
                     *quality(changes[-1])])
    rows.append([f"**mean of {len(changes)}**", "", "", "", "", "", *quality(mean_change(changes))])
    first = next(iter(runs.values()))["default"]
    return markdown(rows) + "\n\n" + how(first[min(first)])


def long_runs():
    """Long runs and larger photos: those on a CPU, with processor times where known, and those on a GPU."""
    rows = [["scene", "iterations", "rules", "seed", "Gaussians", "time", "PSNR", "SSIM", "LPIPS"]]

    def add(scene, rules, seed, r, seconds):
        rows.append([f"{scene}, {r['width']}×{r['height']}", f"{r['iterations']:,}", rules, str(seed), f"{r['primitives']:,}",
                     "–" if math.isnan(seconds) else minutes(seconds),
                     f"{r['psnr']:.2f} dB", f"{r['ssim']:.4f}", f"{r['lpips']:.4f}"])

    for row in load("long_runs"):
        add(row["scene"], f"{row['rules']}, CPU", row["seed"], row["results"], row["results"].get("cpu_seconds", math.nan))
    for scene, runs in load("gpu_compare")["scenes"].items():
        for rules, key in (("published", "baseline"), ("default", "boosted")):
            add(scene, f"{rules}, GPU", 0, runs[key], runs[key]["train_seconds"])
    return markdown(rows) + "\n\n" + how(load("long_runs")[0]["results"])


TABLES = {"default_full": lambda: scenes("default_full", "train_seconds", "time"),
          "default_scenes": lambda: scenes("default_scenes"),
          "large_gaussians": lambda: scenes("default_scenes", other="with large Gaussians pruned", own=BEFORE_AVERAGES),
          "large_on_backdrops": lambda: scenes("plain_backdrops", other="with large Gaussians pruned"),
          "averages": averages,
          "new_scenes": lambda: scenes("new_scenes"),
          "no_points": lambda: scenes("no_points", other="default, random start"),
          "random_start": lambda: scenes("no_points", other="published, random start", own="default, random start"),
          "backdrops": lambda: scenes("plain_backdrops"),
          "points_in_gaps": lambda: scenes("points_in_gaps", other=BEFORE_GAPS),
          "free_space": free_space, "equal_number": equal_number, "given_size": given_size, "long_runs": long_runs}
