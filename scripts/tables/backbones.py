# SPDX-License-Identifier: Apache-2.0
"""Tables of docs/results/backbones.md: the in-tree backbones other than vanilla 3DGS."""
import statistics

from tables.cells import arrow, decibels, how, load, markdown, minutes
from tables.changes import beside_published, change, differences, grouped, mean_change, mean_of, pairs_of, quality
from tables.suite import equal_number

# JSON of a comparison, what it is of, and the paper's ratios on an RTX 4090: time, primitives, PSNR, and where.
COMPARISONS = [
    ("fox", "vanilla 3DGS", "10.8×", "0.15×", "+0.03 dB", "Mip-NeRF 360; 3.7× against 3DGS with a fast optimizer"),
    ("mip_splatting", "Mip-Splatting", "8.8×", "0.21×", "+0.06 dB", "Mip-NeRF 360"),
    ("dropgaussian_3", "DropGaussian, 3 views", "2.4×", "0.38×", "+0.15 dB", "LLFF"),
    ("dropgaussian_3_published", "DropGaussian, 3 views, 10 000 iterations", "2.4×", "0.38×", "+0.15 dB", "LLFF"),
    ("dropgaussian_6", "DropGaussian, 6 views", "2.4×", "0.50×", "+0.01 dB", "LLFF"),
    ("dropgaussian_6_published", "DropGaussian, 6 views, 10 000 iterations", "2.4×", "0.50×", "+0.01 dB", "LLFF"),
    ("scaffold_gs", "Scaffold-GS", "3.6×", "0.53×", "−0.02 dB", "Mip-NeRF 360"),
    ("octree_gs", "Octree-GS", "2.2×", "0.75×", "0.00 dB", "BungeeNeRF"),
]

# Scenes on which the points of features were chosen.
CHOSE_TRACKED = {*(("3D convexes", scene) for scene in ("bird", "fox", "plush", "room", "stitch")),
                 *(("Scaffold-GS", scene) for scene in ("bird", "plush", "room"))}


#: Rules of rows with the published lengths.
IN_WORLD_UNITS = ("lengths in world units", "lengths in world units, without averages")


def backbones():
    rows = [["", "time", "primitives", "PSNR", "ours: faster", "primitives", "PSNR", "paper: faster", "primitives", "PSNR",
             "on"]]
    runs = []
    for name, title, *paper in COMPARISONS:
        data = load(name)
        a, b = data["baseline"], data["boosted"]
        rows.append([title, f"{minutes(a['train_seconds'])} → {minutes(b['train_seconds'])}",
                     arrow(a["primitives"], b["primitives"]), arrow(a["psnr"], b["psnr"], "{:.2f}"),
                     f"{a['train_seconds'] / b['train_seconds']:.1f}×",
                     f"{b['primitives'] / a['primitives']:.2f}×", decibels(b["psnr"] - a["psnr"]), *paper])
        runs.append(f"- {title}: {how(a)}" + ("" if b["command"] == a["command"] else f"; {how(b)}"))
    return "\n".join([markdown(rows), ""] + runs)


def backbone_scenes():
    """Other backbones with the default beside their published runs, scene by scene, and their means over scenes."""
    runs = {}
    for (backbone, *scene), of in grouped("backbone_scenes", lambda row: (row["backbone"], row["scene"], row.get("views"))).items():
        runs.setdefault(backbone, {})[tuple(scene)] = of
    rows = [["backbone", "scene", "seeds", "PSNR", "ΔPSNR", "ΔSSIM", "ΔLPIPS", "primitives", "CPU time", "peak memory"]]
    ratios = ("primitives", "cpu_seconds", "peak_memory_bytes")
    for backbone, scenes in runs.items():
        changes = []
        for (scene, views), of in scenes.items():
            pairs = pairs_of(of, "published", "default")
            if pairs:
                title = scene + (f", {views} views" if views else "")
                mean = change(pairs, ratios)
                rows.append(["" if changes else backbone, title, str(len(pairs)), f"{mean_of(pairs, 'psnr'):.2f} dB",
                             *differences(mean, ratios)])
                changes.append(mean)
        if len(changes) > 1:
            rows.append(["", f"**mean of {len(changes)}**", "", "", *differences(mean_change(changes), ratios)])
    first = next(iter(next(iter(runs.values())).values()))["default"]
    return markdown(rows) + "\n\n" + how(first[min(first)])


def tracked_points():
    """Backbones that start from points of features, beside themselves without."""
    runs = grouped("backbone_scenes", lambda row: (row["backbone"], row["scene"], row.get("views")))
    runs |= grouped("convex_splatting", lambda row: ("3D convexes", row["scene"], None))
    rows = [["backbone", "scene", "seeds", "PSNR, without", "ΔPSNR", "ΔSSIM", "ΔLPIPS", "primitives"]]
    changes, last = [], None
    for (backbone, scene, _), of in runs.items():
        pairs = pairs_of(of, "without tracked points", next((rules for rules in IN_WORLD_UNITS if rules in of), "default"))
        if not pairs:
            continue
        changes.append(change(pairs))
        star = " *" if (backbone, scene) in CHOSE_TRACKED else ""
        rows.append(["" if backbone == last else backbone, scene + star, str(len(pairs)), f"{mean_of(pairs, 'psnr'):.2f} dB",
                     *differences(changes[-1], ("primitives",))])
        last = backbone
    rows.append([f"**mean of {len(changes)}**", "", "", "", *differences(mean_change(changes), ("primitives",))])
    return markdown(rows)


def scene_units():
    """Backbones with lengths in the unit of the scene, beside themselves with the published ones."""
    runs = grouped("backbone_scenes", lambda row: (row["backbone"], row["scene"], row.get("views")))
    runs |= grouped("convex_splatting", lambda row: ("3D convexes", row["scene"], None))
    rows = [["backbone", "scene", "seeds", "PSNR, in world units", "ΔPSNR", "ΔSSIM", "ΔLPIPS", "primitives"]]
    last = None
    for (backbone, scene, _), of in runs.items():
        for rules in [(rules, "default") for rules in IN_WORLD_UNITS] + [("default", "lengths in the unit of the scene")]:
            pairs = pairs_of(of, *rules)
            if pairs:
                rows.append(["" if backbone == last else backbone, scene, str(len(pairs)), f"{mean_of(pairs, 'psnr'):.2f} dB",
                             *differences(change(pairs), ("primitives",))])
                last = backbone
    return markdown(rows)


def deformable():
    """Deformable-3DGS with the default beside the published runs of the same seeds, and the error of the motion."""
    runs = {}
    for row in load("deformable_runs"):
        results = {**row["results"], "motion": row.get("motion")}
        runs.setdefault(row["scene"], {}).setdefault(row["rules"], {})[row["seed"]] = results
    rows = [["scene", "rules", "seeds", "PSNR", "ΔPSNR", "ΔSSIM", "ΔLPIPS", "Gaussians", "CPU time", "rendering", "error of the motion"]]
    amounts = {"primitives": "{:,.0f}", "cpu_seconds": "{:,.0f} s", "fps": "{:.1f} fps"}
    for scene, of in runs.items():
        for rules, cells, results in beside_published(of, ("psnr", "ssim", "lpips"), amounts):
            motions = [r["motion"]["moving"] for r in results if r["motion"]]
            error = (f"{statistics.mean(m['error'] for m in motions):.3f} of "
                     f"{statistics.mean(m['displacement'] for m in motions):.3f} m" if motions else "")
            rows.append([scene, rules, *cells, error])
    first = next(iter(runs.values()))["default"]
    return markdown(rows) + "\n\n" + how(first[max(first)])


def convexes():
    """3D Convex Splatting with the default beside the published runs of the same seeds, and the mean over scenes."""
    runs = grouped("convex_splatting", lambda row: f"{row['scene']}, {row['results']['width']}×{row['results']['height']}")
    rows = [["scene", "rules", "seeds", "PSNR", "ΔPSNR", "ΔSSIM", "ΔLPIPS", "convexes", "CPU time"]]
    amounts = {"primitives": "{:,.0f}", "cpu_seconds": "{:.0f} s"}
    for scene, of in runs.items():
        for rules, cells, _ in beside_published(of, ("psnr", "ssim", "lpips"), amounts):
            rows.append([scene, rules, *cells])
    changes = [change(pairs_of(of, "published", "default")) for of in runs.values()]
    rows.append([f"**mean of {len(runs)}**", "default", "", "", *quality(mean_change(changes)), "", ""])
    first = next(iter(runs.values()))["default"]
    return markdown(rows) + "\n\n" + how(first[min(first)])


def photo_slam():
    """Photo-SLAM with the default and with other rules beside the published runs of the same seeds."""
    runs = grouped("photo_slam", lambda row: (row["sequence"], row["results"]["iterations"]))
    rows = [["sequence", "iterations", "rules", "seeds", "PSNR, all tracked frames", "ΔPSNR", "ΔSSIM", "Gaussians", "mapper's time", "ATE"]]
    amounts = {"primitives": "{:,.0f}", "mapper_seconds": "{:.0f} s"}
    for (sequence, iterations), of in runs.items():
        for rules, cells, results in beside_published(of, ("psnr", "ssim"), amounts):
            error = statistics.mean(r["ate_rmse"] for r in results)
            rows.append([sequence, f"{iterations:,}", rules, *cells, f"{100 * error:.2f} cm"])
    return markdown(rows) + "\n\n" + how_of_default("photo_slam")


def photo_slam_online():
    """Photo-SLAM with a time limit, tracking beside mapping: the default beside the published runs."""
    runs = grouped("photo_slam_online", lambda row: (row["sequence"], round(row["results"]["seconds"])))
    rows = [["sequence", "rules", "seeds", "PSNR, all tracked frames", "ΔPSNR", "ΔSSIM", "ΔLPIPS", "Gaussians", "iterations",
             "frames tracked per second"]]
    amounts = {"primitives": "{:,.0f}", "iterations": "{:,.0f}"}
    for (sequence, seconds), of in runs.items():
        for rules, cells, results in beside_published(of, ("psnr", "ssim", "lpips"), amounts):
            rows.append([f"{sequence}, {seconds} s", rules, *cells, f"{statistics.mean(r['tracking_fps'] for r in results):.1f}"])
    return markdown(rows) + "\n\n" + how_of_default("photo_slam_online")


def how_of_default(name):
    """how() of the first run with the default in a file whose rows hold the command."""
    first = next(row for row in load(name) if row["rules"] == "default")
    return how({**first["results"], "command": first["command"]})


def pgsr():
    """PGSR with the default beside the published runs of the same seeds: photos and meshes."""
    runs = {}
    for row in load("pgsr"):
        if row["results"]["iterations"] == 7000:
            results = {**row["results"], "mesh": row.get("mesh"), "command": row["command"]}
            runs.setdefault(row["scene"], {}).setdefault(row["rules"], {})[row["seed"]] = results
    rows = [["scene", "rules", "seeds", "PSNR", "ΔPSNR", "ΔSSIM", "ΔLPIPS", "Gaussians", "CPU time", "mesh: median error", "Chamfer", "F1"]]
    amounts = {"primitives": "{:,.0f}", "cpu_seconds": "{:.0f} s"}
    for scene, of in runs.items():
        for rules, cells, results in beside_published(of, ("psnr", "ssim", "lpips"), amounts):
            meshes = [r["mesh"] for r in results if r["mesh"]]
            of_meshes = ["", "", ""]
            if meshes:
                of_meshes[:2] = [f"{100 * statistics.mean(m[what] / m['diagonal'] for m in meshes):.2f} %"
                                 for what in ("median_accuracy", "chamfer")]
                of_meshes[2] = f"{statistics.mean(m['f1'] for m in meshes):.3f}"
            rows.append([scene, rules, *cells, *of_meshes])
    first = next(iter(runs.values()))["default"]
    return markdown(rows) + "\n\n" + how(first[min(first)])


def pgsr_rules():
    """PGSR on photos: the rules that its default has got in 2026-11, one after the other, seed 0."""
    runs = grouped("backbone_scenes", lambda row: row["scene"], lambda row: row["backbone"] == "PGSR" and row["seed"] == 0)
    runs = {scene: of for scene, of in runs.items() if len(of) > 2}
    rows = [["rules"] + [f"{scene}: {what}" for scene in runs for what in ("PSNR", "LPIPS", "Gaussians")]]
    for rules in ("published", *(rules for rules in next(iter(runs.values())) if rules not in ("published", "default")), "default"):
        results = [of[rules][0] for of in runs.values()]
        rows.append([rules] + [cell for r in results for cell in (f"{r['psnr']:.2f} dB", f"{r['lpips']:.3f}", f"{r['primitives']:,}")])
    return markdown(rows)


def few_views():
    """DropGaussian's growth, on the way and now."""
    rows = [["", "as published", "growth to the end", "growth to half", "default"]]
    for row in load("dropgaussian_growth"):
        rows.append([row["run"]] + [f"{run['psnr']:.2f} dB, {run['primitives']:,}"
                                    for run in (row["baseline"], row["to_the_end"], row["to_half"], row["default"])])
    return markdown(rows)


def seeds():
    """How far one run may be from the next: the same comparison with other random numbers."""
    rows = [["seed", "PSNR", "Gaussians", "", ""]]
    gains = []
    for row in load("dropgaussian_seeds"):
        a, b = row["baseline"], row["boosted"]
        gains.append(b["psnr"] - a["psnr"])
        rows.append([str(row["seed"]), arrow(a["psnr"], b["psnr"], "{:.2f}", " dB"), arrow(a["primitives"], b["primitives"]),
                     f"{b['primitives'] / a['primitives']:.2f}×", decibels(gains[-1])])
    rows.append(["mean", "", "", "", decibels(statistics.mean(gains))])
    return markdown(rows)


def of_anchors(name):
    """Rules of importance, and seeds, one run a row."""
    rows = [["", "PSNR", "SSIM", "anchors"]]
    for run in load(name):
        r = run["results"]
        rows.append([run["name"], f"{r['psnr']:.2f} dB", f"{r['ssim']:.4f}", f"{r['primitives']:,}"])
    return markdown(rows)


def scales():
    """Quality at other scales than the trained one."""
    columns = [("3DGS", load("fox")["baseline"]), ("3DGS, SplatBoost", load("fox")["boosted"]),
               ("Mip-Splatting", load("mip_splatting")["baseline"]),
               ("Mip-Splatting, SplatBoost", load("mip_splatting")["boosted"])]
    rows = [["PSNR at"] + [title for title, _ in columns]]
    for at, scale in enumerate(columns[-1][1]["scales"]):
        name = "the trained scale" if scale["divisor"] == 1 else f"1/{scale['divisor']} of it"
        rows.append([name] + [f"{run['scales'][at]['psnr']:.2f} dB" for _, run in columns])
    return markdown(rows)


TABLES = {"backbones": backbones, "backbone_scenes": backbone_scenes,
          "mip_equal_number": lambda: equal_number("backbone_scenes", "Mip-Splatting"), "tracked_points": tracked_points,
          "scene_units": scene_units, "deformable": deformable, "convexes": convexes, "photo_slam_online": photo_slam_online, "photo_slam": photo_slam, "pgsr": pgsr,
          "pgsr_rules": pgsr_rules,
          "few_views": few_views, "seeds": seeds, "scaffold": lambda: of_anchors("scaffold_runs"),
          "levels": lambda: of_anchors("octree_runs"), "scales": scales}
