# SPDX-License-Identifier: Apache-2.0
"""Tables of docs/results/upstream.md, and one of README.md: upstream checkouts, unpatched and patched."""
import statistics

from tables.cells import arrow, decibels, difference, load, markdown
from tables.changes import standard_error


def name_of(run):
    return f"{run['title']}, {run['layout']}"


def from_off_to_on(run):
    """Cells of the number of Gaussians, PSNR and SSIM without boost and with it."""
    off, on = run["off"], run["on"]
    return [arrow(off["gaussians"], on["gaussians"]), arrow(off["psnr"], on["psnr"], "{:.2f}", " dB"),
            arrow(off["ssim"], on["ssim"], "{:.3f}")]


def seconds(run):
    """Processor time of train.py."""
    off, on = run["off"], run["on"]
    return arrow(off["cpu_seconds"], on["cpu_seconds"], "{:.0f}", " s") if "cpu_seconds" in off else "–"


def upstream():
    data = load("upstream")
    rows = [["checkout", "commit", "changed lines", "Gaussians", "PSNR", "SSIM", "processor time", "loss, last 100",
             "losses with `--boost off`", "after `revert`"]]
    for run in data["runs"]:
        rows.append([name_of(run), f"`{run['commit'][:7]}`", f"+{run['lines_added']} −{run['lines_removed']}", *from_off_to_on(run),
                     seconds(run), arrow(run["off"]["loss_by_100"][-1], run["on"]["loss_by_100"][-1], "{:.4f}"),
                     f"all {run['losses_compared']} equal" if run["losses_equal"] else "differ",
                     "clean" if run["clean_after_revert"] else "not clean"])
    return markdown(rows) + f"\n\n{data['machine']}, {data['date']}"


def upstream_short():
    rows = [["checkout", "changed lines", "Gaussians, off → on", "PSNR, off → on", "processor time, off → on"]]
    for run in load("upstream")["runs"]:
        rows.append([name_of(run), f"+{run['lines_added']} −{run['lines_removed']}", *from_off_to_on(run)[:2], seconds(run)])
    return markdown(rows)


def upstream_longer():
    rows = [["checkout", "options", "Gaussians", "PSNR", "SSIM", "processor time"]]
    for run in load("upstream")["longer"]:
        rows.append([name_of(run), f"`{run['options'].split(' --test_iterations')[0]}`", *from_off_to_on(run), seconds(run)])
    return markdown(rows) + f"\n\n{run['machine']}, {run['date']}"


def upstream_points():
    """A patched host that starts from more points, with boost and without."""
    rows = [["scene", "points: dataset", "added", "Gaussians", "PSNR", "ΔPSNR", "ΔSSIM", "with `--boost off`: ΔPSNR"]]
    data = load("upstream")["more_points"]
    gains, gains_off = [], []
    for run in data["runs"]:
        on, more, off, off_more = (run[key] for key in ("on", "on_more", "off", "off_more"))
        gains.append(more["psnr"] - on["psnr"])
        gains_off.append(off_more["psnr"] - off["psnr"])
        rows.append([run["scene"], f"{run['points']:,}", f"{run['added']:,}", arrow(on["gaussians"], more["gaussians"]),
                     arrow(on["psnr"], more["psnr"], "{:.2f}", " dB"), decibels(gains[-1]), difference(more["ssim"] - on["ssim"], 4),
                     decibels(gains_off[-1])])
    of_all = [decibels(statistics.mean(values), standard_error(values)) for values in (gains, gains_off)]
    rows.append([f"**mean of {len(gains)}**", "", "", "", "", of_all[0], "", of_all[1]])
    return markdown(rows) + f"\n\n{data['machine']}, {data['date']}: `{data['command']}`"


def fidelity():
    """The unpatched upstream beside the in-tree backbone as published: means over seeds."""
    rows = [["backbone", "commit", "data", "seeds", "primitives: upstream", "in-tree", "PSNR: upstream", "in-tree"]]
    for run in load("upstream")["fidelity"]:
        sides = run["upstream"], run["in_tree"]
        number = [statistics.mean(side["primitives"]) for side in sides]
        psnr = [f"{statistics.mean(side['psnr']):.2f} dB" for side in sides]
        seeds = [str(len(side["psnr"])) for side in sides]
        rows.append([run["title"], f"`{run['commit'][:7]}`", run["data"], " and ".join(dict.fromkeys(seeds)), f"{number[0]:,.0f}",
                     f"{number[1]:,.0f} ({number[1] / number[0]:.2f}×)", *psnr])
    return markdown(rows)


TABLES = {"upstream": upstream, "upstream_short": upstream_short, "upstream_longer": upstream_longer, "upstream_points": upstream_points,
          "fidelity": fidelity}
