# SPDX-License-Identifier: Apache-2.0
"""Tables of README.md and docs/results/README.md."""
import json
import math

from tables.cells import ROOT, decibels, difference, how, load, markdown, minutes
from tables.changes import change, differences, grouped, mean_change, pairs_of


# Rows of the table of means: title, link below docs/results, file, and which of its rows.
# stitch, whose points are poor, is left out: it gains 13 dB with 3DGS and 3 dB with convexes.
MEANS = [
    ("3DGS, captures that took no part in any choice", "suite.md#scene-by-scene", "new_scenes", lambda row: row["role"] == "not seen"),
    ("3DGS", "suite.md#scene-by-scene", "default_full", lambda row: row["scene"] != "stitch"),
    ("3DGS", "suite.md#30-000-iterations", "long_runs", lambda row: row["results"]["iterations"] == 30000 and
     row["results"]["width"] < 300),
    ("Mip-Splatting", "backbones.md#other-scenes", "backbone_scenes", lambda row: row["backbone"] == "Mip-Splatting"),
    ("DropGaussian, 3 to 9 views of five scenes", "backbones.md#other-scenes", "backbone_scenes", lambda row: row["backbone"] == "DropGaussian"),
    ("Scaffold-GS", "backbones.md#other-scenes", "backbone_scenes", lambda row: row["backbone"] == "Scaffold-GS"),
    ("Octree-GS", "backbones.md#other-scenes", "backbone_scenes", lambda row: row["backbone"] == "Octree-GS"),
    ("PGSR", "backbones.md#pgsr-surfaces", "pgsr", lambda row: row["results"]["iterations"] == 7000),
    ("PGSR, photos", "backbones.md#other-scenes", "backbone_scenes", lambda row: row["backbone"] == "PGSR"),
    ("3D convexes", "backbones.md#3d-convex-splatting", "convex_splatting", lambda row: row["scene"] != "stitch"),
    ("Deformable-3DGS", "backbones.md#deformable-3dgs", "deformable_runs", lambda row: row["scene"].startswith("lego")),
]


def means():
    """Every backbone in one row: the default beside the published runs of the same seeds, as means over scenes."""
    rows = [["backbone", "scenes", "seeds", "iterations", "primitives", "time", "ΔPSNR", "worst scene", "ΔLPIPS"]]
    for title, link, name, wanted in MEANS:
        runs = grouped(name, lambda row: (row["scene"], row.get("views")), wanted)
        scenes = [pairs for pairs in (pairs_of(of, "published", "default") for of in runs.values()) if pairs]
        time = "train_seconds" if name == "default_full" else "cpu_seconds"
        changes = [change(pairs, ("primitives", time)) for pairs in scenes]
        mean = mean_change(changes) if len(changes) > 1 else changes[0]
        if any(math.isnan(one[time]) for one in changes):
            mean[time] = math.nan  # a mean over some of the scenes would mislead
        psnr, _, lpips, number, seconds = differences(mean, ("primitives", time))
        worst = decibels(min(one["psnr"] for one in changes)) if len(changes) > 1 else ""
        iterations = {own["iterations"] for pairs in scenes for _, own in pairs}
        seeds = sorted({len(pairs) for pairs in scenes})
        rows.append([f"[{title}](docs/results/{link})", str(len(scenes)), " to ".join(map(str, dict.fromkeys((seeds[0], seeds[-1])))),
                     ", ".join(f"{n:,}" for n in sorted(iterations)), number, seconds, psnr, worst, lpips])
    return markdown(rows)


def seconds_to_psnr(curve, psnr):
    """Training seconds until the curve first shows `psnr`, linearly between its points; None if it never does."""
    before = None
    for point in curve:
        if point["psnr"] >= psnr:
            if before is None:
                return point["seconds"]
            share = (psnr - before["psnr"]) / (point["psnr"] - before["psnr"])
            return before["seconds"] + share * (point["seconds"] - before["seconds"])
        before = point
    return None


def fox():
    """One comparison, measure by measure."""
    data = load("fox")
    baseline, boosted = data["baseline"], data["boosted"]
    rows = [["", "3DGS as published", "SplatBoost", ""]]

    def add(title, key, form, less="{:.2f}×"):
        a, b = baseline[key], boosted[key]
        rows.append([title, form(a), form(b), less.format(b / a)])

    def add_faster(title, a, b, form):
        rows.append([title, form(a), form(b), f"{max(a, b) / min(a, b):.1f}× faster"])

    add_faster("training time", baseline["train_seconds"], boosted["train_seconds"], minutes)
    to_same = [seconds_to_psnr(run["curve"], baseline["curve"][-1]["psnr"]) for run in (baseline, boosted)]
    if to_same[1]:
        add_faster("time to the published run's PSNR", *to_same, minutes)
    else:
        rows.append(["time to the published run's PSNR", minutes(to_same[0]), "not reached", "–"])
    add("Gaussians", "primitives", "{:,}".format)
    for key, label, digits, unit in [("psnr", "PSNR", 2, " dB"), ("psnr_beta1", "PSNR in any viewer (β = 1)", 2, " dB"),
                                     ("ssim", "SSIM", 4, ""), ("lpips", "LPIPS (SqueezeNet)", 4, "")]:
        a, b = baseline[key], boosted[key]
        if a is not None and b is not None:
            rows.append([label, f"{a:.{digits}f}{unit}", f"{b:.{digits}f}{unit}", difference(b - a, digits) + unit])
    add_faster("rendering", baseline["fps"], boosted["fps"], "{:.0f} fps".format)
    add("peak memory", "peak_memory_bytes", lambda n: f"{n / 2**20:.0f} MiB")
    add("model on disk", "storage_bytes", lambda n: f"{n / 1e6:.1f} MB")
    runs = [how(baseline)] if baseline["command"] == boosted["command"] else [how(baseline), how(boosted)]
    return markdown(rows) + "\n\n" + "; ".join(runs)


def measures_of(r):
    time = minutes(r["cpu_seconds"]) if "cpu_seconds" in r else "–"
    return [time, f"{r['psnr']:.2f} dB", f"{r['ssim']:.4f}", f"{r['lpips']:.4f}", f"{r['primitives']:,}"]


def rule_sets():
    """The three rule sets side by side, by length of the run."""
    data = load("rule_sets")
    rows = [["iterations", "rules", "CPU time", "PSNR", "SSIM", "LPIPS", "Gaussians"]]
    for iterations in sorted({row["results"]["iterations"] for row in data}):
        for rules in ("published", "literal", "default without free space", "default"):
            for row in data:
                if (row["rules"], row["results"]["iterations"]) == (rules, iterations):
                    rows.append([f"{iterations:,}", rules, *measures_of(row["results"])])
    return markdown(rows) + "\n\n" + how(data[0]["results"])


def paper(number):
    """Rows of one of the paper's tables here and there. A row of the paper that was not run here is left out."""
    ours = {row["rules"]: row["results"] for row in load("rule_sets") if row["results"]["iterations"] == 7000}
    rows = [["", "CPU time", "PSNR", "SSIM", "LPIPS", "N", "paper: time", "PSNR", "SSIM", "LPIPS", "N"]]
    for row in json.loads((ROOT / "scripts/suite/paper.json").read_text())["rows"]:
        if row["table"] == number and row["rules"] in ours:
            rows.append([row["method"], *measures_of(ours[row["rules"]]), f"{row['minutes']:.2f} min", f"{row['psnr']:.2f} dB",
                         f"{row['ssim']:.4f}", f"{row['lpips']:.4f}", f"{row['millions']:.2f} M"])
    return markdown(rows)


def robustness():
    data = load("robustness")
    rows = [["", "cases", "exit 0", "exit 1", "exit 2", "killed by us", "against the rule"]]
    for key, label in [("readers", "damaged files"), ("faults", "faults at a file operation")]:
        part = data[key]
        exits = [f"{part['exits'].get(code, 0):,}" for code in ("0", "1", "2", "signal 9")]
        rows.append([label, f"{part['cases']:,}", *exits, f"{len(part['broken'])}"])
    of = "; ".join(f"{part['machine']}, {part['date'][:10]}: `{part['command']}`" for part in data.values())
    return f"{markdown(rows)}\n\n{of}"


TABLES = {"means": means, "fox": fox, "rule_sets": rule_sets, "paper_13": lambda: paper(13), "paper_14": lambda: paper(14), "robustness": robustness}
