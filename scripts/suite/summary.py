# SPDX-License-Identifier: Apache-2.0
"""Writes OUT/suite.json from the records of a plan's runs, and the page and the tables from that.

usage: summary.py PLAN.json
"""
import json
import sys
from pathlib import Path

import page
import stats
from one_run import title
from plan import HERE, BadInput, read_json, write_atomically

MEASURES = ["psnr", "ssim", "lpips", "primitives", "train_seconds", "peak_memory_bytes", "psnr_beta1", "fps", "storage_bytes"]
DIFFERENCES = ["psnr", "ssim", "lpips", "psnr_beta1"]  # quality: rule set − reference
RATIOS = ["primitives", "train_seconds", "peak_memory_bytes"]  # cost: rule set / reference
FACTS = ["iterations", "width", "height", "split", "machine", "device", "threads", "version", "date"]


def by_run(plan, out):
    """Measurements per run, and the titles of the runs that are missing."""
    runs, missing = [], []
    for run in plan["runs"]:
        path = out / "runs" / run["id"] / "record.json"
        if not path.exists():
            missing.append(title(run))
            continue
        record = read_json(path)
        # Remove paths of this machine.
        names = {run["program"]: "splatboost", run["source"]: run["scene"], str(path.parent / "model"): "OUT",
                 str(path.parent / "settings.json"): f"{run['rules']}.json", run["lpips"]: "squeeze.onnx"}
        entry = {key: run[key] for key in ("id", "scene", "group", "backbone", "rules", "seed", "cap")}
        entry["command"] = " ".join(names.get(word, word) for word in record["command"])
        entry.update({key: record["results"].get(key) for key in MEASURES + FACTS})
        entry["wall_seconds"] = record["wall_seconds"]
        runs.append(entry)
    return runs, missing


def by_scene(runs, reference):
    """Means over seeds per scene, backbone, rule set and cap, and comparisons with the reference at equal seeds."""
    groups = {}
    for run in runs:
        groups.setdefault((run["scene"], run["group"], run["backbone"], run["rules"], run["cap"]), {})[run["seed"]] = run
    rows = []
    for (scene, group, backbone, rules, cap), seeds in groups.items():
        row = {"scene": scene, "group": group, "backbone": backbone, "rules": rules, "cap": cap, "seeds": sorted(seeds),
               "measures": {key: stats.estimate(run[key] for run in seeds.values()) for key in MEASURES}}
        other = groups.get((scene, group, backbone, reference, None))
        if other is not None and other is not seeds:
            def pairs(key, operation):
                return stats.paired({seed: run[key] for seed, run in seeds.items()},
                                    {seed: run[key] for seed, run in other.items()}, operation)
            row["differences"] = {key: stats.estimate(pairs(key, lambda a, b: a - b)) for key in DIFFERENCES}
            row["ratios"] = {key: stats.geometric_mean(pairs(key, lambda a, b: a / b)) for key in RATIOS}
        rows.append(row)
    return rows


def overall(rows):
    """Per group of scenes, and over all scenes: mean differences, the worst scene, geometric means of ratios."""
    found = []
    compared = [row for row in rows if row["cap"] is None and "differences" in row]
    for backbone, rules in dict.fromkeys((row["backbone"], row["rules"]) for row in compared):
        of_these = [row for row in compared if (row["backbone"], row["rules"]) == (backbone, rules)]
        groups = list(dict.fromkeys(row["group"] for row in of_these))
        for group in [None, *(groups if len(groups) > 1 else [])]:
            scenes = [row for row in of_these if group in (None, row["group"])]
            lowest = stats.worst({row["scene"]: row["differences"]["psnr"] for row in scenes})
            found.append({
                "backbone": backbone, "rules": rules, "group": group, "scenes": len(scenes),
                "differences": {key: stats.mean_of_estimates(row["differences"][key] for row in scenes) for key in DIFFERENCES},
                "worst": None if lowest is None else {"scene": lowest[0], **lowest[1]},
                "ratios": {key: stats.geometric_mean(row["ratios"][key] for row in scenes if row["ratios"][key] is not None)
                           for key in RATIOS}})
    return found


def frontier(runs, rows, reference):
    """For each rule set without a cap, its PSNR minus the reference's at the same number of primitives: compared with
    the reference's runs of equal seed under exactly this cap if there are any, else with the curve through the means of
    the reference. None if the curve does not reach that number."""
    found = []
    for row in rows:
        if row["cap"] is not None or row["rules"] == reference:
            continue

        def of_seed(rules, cap):
            return {run["seed"]: run["psnr"] for run in runs if (run["scene"], run["backbone"], run["rules"], run["cap"])
                    == (row["scene"], row["backbone"], rules, cap)}
        above = stats.estimate(stats.paired(of_seed(row["rules"], None), of_seed(reference, row["rules"]), lambda a, b: a - b))
        if above["mean"] is None:
            curve = [(other["measures"]["primitives"]["mean"], other["measures"]["psnr"]["mean"]) for other in rows
                     if (other["scene"], other["backbone"], other["rules"]) == (row["scene"], row["backbone"], reference)]
            at_equal = stats.on_curve(curve, row["measures"]["primitives"]["mean"])
            if at_equal is not None and len(curve) > 1:
                above = {"mean": row["measures"]["psnr"]["mean"] - at_equal, "error": None, "count": None}
        found.append({"scene": row["scene"], "backbone": row["backbone"], "rules": row["rules"], "above": above})
    return found


def beside_the_paper(plan, rows):
    """Tables of the paper for which there are results: {"table", "rows"}, each row with `paper` and `ours` side by
    side, either of which may be None. A row is for a scene, for a dataset of which all scenes have results, or, in
    tables by scene, for the mean over the scenes that have results."""
    paper, datasets = read_json(HERE / "paper.json"), read_json(HERE / "datasets.json")["datasets"]
    names = {scene["name"]: (scene["group"], scene["paper"]) for scene in plan["scenes"] if scene["paper"]}
    here = {}  # (dataset, scene, backbone, rules) → measures
    for row in rows:
        if row["cap"] is None and row["scene"] in names:
            here[(*names[row["scene"]], row["backbone"], row["rules"])] = row["measures"]

    def ours(dataset, scenes, backbone, rules):
        measures = [here.get((dataset, scene, backbone, rules)) for scene in scenes]
        if not scenes or None in measures:
            return None
        return {key: stats.mean(each[key]["mean"] for each in measures) for key in ("train_seconds", "psnr", "ssim", "primitives")}

    tables = []
    for number in sorted({entry["table"] for entry in paper["rows"]}):
        entries = [entry for entry in paper["rows"] if entry["table"] == number]
        found = []
        for dataset in datasets:
            of_dataset = [entry for entry in entries if entry["dataset"] == dataset["name"]]
            trained = [scene for scene in dataset["scenes"] if any(key[:2] == (dataset["name"], scene) for key in here)]
            for backbone in dict.fromkeys(entry["backbone"] for entry in of_dataset):
                scenewise = any(entry["scene"] for entry in of_dataset)
                units = [(scene, [scene]) for scene in trained] if scenewise else [(dataset["title"], list(dataset["scenes"]))]
                if scenewise and len(trained) > 1:
                    units.append((f"mean of {len(trained)} scenes", trained))
                for title, scenes in units:
                    of_unit = [entry for entry in of_dataset if entry["backbone"] == backbone
                               and (not entry["scene"] or entry["scene"] in scenes)]
                    methods = {entry["method"]: entry["rules"] for entry in of_unit}
                    methods.update({rule["label"]: name for name, rule in plan["rules"].items() if name not in methods.values()})
                    unit = []
                    for method, rules in methods.items():
                        theirs = [entry for entry in of_unit if entry["method"] == method]
                        unit.append({"of": title, "backbone": backbone, "method": method, "rules": rules,
                                     "paper": {key: stats.mean(entry[key] for entry in theirs)
                                               for key in ("minutes", "psnr", "ssim", "millions")} if theirs else None,
                                     "ours": ours(dataset["name"], scenes, backbone, rules)})
                    if any(row["ours"] for row in unit):
                        found += [row for row in unit if row["paper"] or row["ours"]]
        # Skip tables with results only in the rows that all tables of this dataset share: the rest would be dashes.
        own = {entry["rules"] for entry in entries} - {"published", "literal", None}
        if any(row["ours"] and row["paper"] and (not own or row["rules"] in own) for row in found):
            tables.append({"table": number, "rows": found})
    return {"source": paper["source"], "tables": tables}


def summarize(plan, out):
    runs, missing = by_run(plan, out)
    if not runs:
        raise BadInput(f"{out}: no run has ended yet")
    reference = "published" if "published" in plan["rules"] else next(iter(plan["rules"]))
    rows = by_scene(runs, reference)
    return {
        "command": plan["command"], "date": plan["date"], "commit": plan["commit"],
        "programs": {name: program["sha256"] for name, program in plan["programs"].items()},
        "machines": sorted({f"{run['machine']}, {run['device']}, {run['threads']} threads" for run in runs}),
        "rules": plan["rules"], "reference": reference, "left_out": plan["left_out"], "missing": missing,
        "overall": overall(rows), "by_scene": rows, "frontier": frontier(runs, rows, reference),
        "paper": beside_the_paper(plan, rows), "runs": runs}


def main():
    plan = read_json(sys.argv[1])
    out = Path(plan["out"])
    try:
        suite = summarize(plan, out)
    except BadInput as error:
        print(f"suite: {error}", file=sys.stderr)
        return 2
    svg = page.frontier_svg(suite)
    write_atomically(out / "frontier.svg", svg)
    write_atomically(out / "suite.md", page.markdown(suite))
    write_atomically(out / "suite.html", page.html(suite, svg, page.crops(plan, out, suite)))
    write_atomically(out / "suite.json", json.dumps(suite, indent=1, ensure_ascii=False) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
