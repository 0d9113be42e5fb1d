# SPDX-License-Identifier: Apache-2.0
"""Tables of docs/results/cpu.md, and its plot: speed on the CPU."""
from tables.cells import RESULTS, how, load, machine_of, markdown, minutes

SCALES = [("splats", "splats, thousands"), ("pixels", "pixels, thousands"), ("threads", "threads")]


def bench():
    data = load("bench")
    scenes = data["scenes"]
    rows = [["milliseconds"] + [f"{s['splats']:,} {'convexes' if s['name'] == 'convexes' else 'splats'}, "
                                f"{s['width']}×{s['height']}" for s in scenes]]
    order = ["activate", "project", "tile_lists", "blend", "loss", "blend_backward", "project_backward", "statistics",
             "optimizer", "iteration", "scoring"]
    for stage in order:
        rows.append([stage.replace("_", " ")] + [f"{s['milliseconds'][stage]:.1f}" for s in scenes])
    rows.append(["blended per pixel"] + [f"{s['blended_per_pixel']:.0f}" for s in scenes])
    return markdown(rows) + f"\n\n{machine_of(data)}, medians of {data['repeats']}: `{data['command']}`"


def sets():
    """One scene with each instruction set."""
    data = load("bench_sets")
    rows = [["milliseconds"] + [d["instruction_set"] for d in data]]
    for stage in ["blend", "blend_backward", "iteration"]:
        rows.append([stage.replace("_", " ")] + [f"{d['scenes'][0]['milliseconds'][stage]:.1f}" for d in data])
    least = data[0]["scenes"][0]["milliseconds"]["iteration"]
    rows.append(["iteration, to the first"] +
                [f"{d['scenes'][0]['milliseconds']['iteration'] / least:.2f}×" for d in data])
    return markdown(rows) + f"\n\n{machine_of(data[0])}, medians of {data[0]['repeats']}: `{data[0]['command']}` and alike"


def runs():
    """Single runs, each with a name."""
    data = load("runs")
    rows = [["", "time", "PSNR", "Gaussians", "peak memory"]]
    for run in data:
        r = run["results"]
        rows.append([run["name"], minutes(r["train_seconds"]), f"{r['psnr']:.2f} dB", f"{r['primitives']:,}",
                     f"{r['peak_memory_bytes'] / 2**20:.0f} MiB"])
    return "\n".join([markdown(rows), ""] + [f"- {run['name']}: {how(run['results'])}" for run in data])


def limits():
    data = load("bench")
    rows = [["", "time", "operations", "of the limit", "bytes", "of the limit"]]
    for scene in data["scenes"]:
        for title, stage, direction in [("blend forward", "blend", "forward"),
                                        ("blend backward", "blend_backward", "backward")]:
            effort = scene["blend_work"][direction]
            rows.append([f"{scene['name']}, {title}", f"{scene['milliseconds'][stage]:.1f} ms",
                         f"{effort['operations'] / 1e6:,.0f} M", f"{effort['share_of_operations']:.0%}",
                         f"{effort['bytes'] / 1e6:.0f} MB", f"{effort['share_of_bytes']:.0%}"])
    counts = [["", "entries", "rows", "pairs", "pixels of a row that are blended"]]
    for scene in data["scenes"]:
        work = scene["blend_work"]
        counts.append([scene["name"], f"{work['entries']:,}", f"{work['rows']:,}", f"{work['pairs']:,}",
                       f"{work['pairs'] / (16 * work['rows']):.0%}"])
    return (markdown(rows) + "\n\n" + markdown(counts) +
            f"\n\nLimits of this machine: {data['limits']['bytes_per_second'] / 1e9:.1f} GB/s, "
            f"{data['limits']['operations_per_second'] / 1e9:,.0f} billion operations per second. {machine_of(data)}.")


def scale_value(of, point):
    """Where a point of a series lies on its axis."""
    return {"splats": point["splats"] / 1000, "pixels": point["width"] * point["height"] / 1000,
            "threads": point["threads"]}[of]


def scaling():
    data = load("bench")
    tables = []
    for of, title in SCALES:
        points = data["scaling"][of]
        rows = [[title] + [f"{scale_value(of, point):.0f}" for point in points]]
        rows.append(["iteration, ms"] + [f"{point['milliseconds']['iteration']:.1f}" for point in points])
        tables.append(markdown(rows))
    tables.append(f"{machine_of(data)}: `{data['command']}`")
    return "\n\n".join(tables + ["![time of an iteration against splats, pixels and threads](scaling.png)"])


def instructions():
    data = load("instructions")
    rows = [["instructions"] + list(data["instructions"])]
    kernels = list(next(iter(data["instructions"].values())))
    for kernel in kernels:
        rows.append([kernel.replace("_", " ")] + [f"{counts[kernel]:,}" for counts in data["instructions"].values()])
    return markdown(rows) + f"\n\n{data['compiler']}, Release: `scripts/instruction_counts`"


def draw_scaling():
    """Writes scaling.png. One panel a series: the iteration, and its parts stacked below it."""
    import matplotlib
    matplotlib.use("Agg")
    from matplotlib import pyplot
    data = load("bench")
    parts = [("blend", "blend forward", "#2457a6"), ("blend_backward", "blend backward", "#6f9bd8"),
             ("loss", "loss", "#c98a1b"), ("project", "project", "#3f8f5b"),
             ("project_backward", "project backward", "#8cc7a1"), ("tile_lists", "sort and bin", "#9a5fb5"),
             ("optimizer", "Adam", "#b0b0b0")]
    figure, panels = pyplot.subplots(1, 3, figsize=(11, 3.8), layout="constrained")
    for axes, (of, title) in zip(panels, SCALES):
        points = data["scaling"][of]
        x = [scale_value(of, point) for point in points]
        values = [[point["milliseconds"][part] for point in points] for part, _, _ in parts]
        labels, colors = [label for _, label, _ in parts], [color for _, _, color in parts]
        whole = [point["milliseconds"]["iteration"] for point in points]
        if of == "threads":
            bottom = [0.0] * len(x)
            names = [f"{v:.0f}" for v in x]
            for heights, label, color in zip(values, labels, colors):
                axes.bar(names, heights, bottom=bottom, label=label, color=color, width=0.6)
                bottom = [b + h for b, h in zip(bottom, heights)]
            axes.plot(names, whole, "ko", markersize=4, label="iteration")
        else:
            axes.stackplot(x, values, labels=labels, colors=colors)
            axes.plot(x, whole, "ko-", markersize=4, linewidth=1, label="iteration")
        axes.set_xlabel(title)
        axes.set_ylim(bottom=0)
        axes.grid(alpha=0.3)
        axes.set_axisbelow(True)
    panels[0].set_ylabel("milliseconds an iteration")
    handles, names = panels[0].get_legend_handles_labels()
    panels[0].legend(handles[::-1], names[::-1], fontsize=7, loc="upper left")  # as they are stacked
    figure.suptitle(machine_of(data), fontsize=9)
    figure.savefig(RESULTS / "scaling.png", dpi=120)


TABLES = {"bench": bench, "sets": sets, "runs": runs, "limits": limits, "scaling": scaling, "instructions": instructions}
