# SPDX-License-Identifier: Apache-2.0
"""Writes the suite's results as a page (a single HTML file), as Markdown tables and as a plot (SVG)."""
import json
import math
import re
from html import escape
from pathlib import Path

import png
import stats

COLORS = ["#6b7585", "#1565d8", "#c2570c", "#087f5b", "#9c36b5", "#b08900"]
NOTE = ("± is the standard error over seeds. Differences and ratios (×) compare runs of equal seed with “{reference}”; ratios are "
        "geometric means; the worst scene is the one with the lowest mean ΔPSNR.")


# --- numbers ----------------------------------------------------------------------------------------------------------

def minus(text):
    return text.replace("-", "−")


def estimated(value, digits, signed=False):
    if value is None or value["mean"] is None:
        return "–"
    text = f"{value['mean']:{'+' if signed else ''}.{digits}f}"
    return minus(text) + (f" ± {value['error']:.{digits}f}" if value["error"] is not None else "")


def ratio(value):
    return "–" if value is None else f"{value:.2f}×"


def seconds(value):
    if value is None:
        return "–"
    return f"{value:.1f} s" if value < 100 else f"{value / 60:.1f} min"


def count(value):
    return "–" if value is None else f"{value:,.0f}"


def label(suite, row):
    cap = row.get("cap")
    text = suite["rules"][row["rules"]]["label"]
    if cap is None:
        return text
    return f"{text}, ≤ {cap:g}×" if isinstance(cap, float) else f"{text}, ≤ {suite['rules'][cap]['label']}"


# --- tables: [head, row …] of strings ---------------------------------------------------------------------------------

def without_empty(table):
    """Removes empty columns, such as LPIPS if it was not measured."""
    keep = [i for i in range(len(table[0])) if any(row[i] not in ("", "–") for row in table[1:])]
    return [[row[i] for i in keep] for row in table]


def overall_table(suite):
    table = [["rules", "scenes", "ΔPSNR (dB)", "worst scene", "ΔSSIM", "ΔLPIPS", "primitives ×", "time ×", "memory ×"]]
    several = len({row["backbone"] for row in suite["overall"]}) > 1
    for row in suite["overall"]:
        name = label(suite, row) + (f", {row['backbone']}" if several else "")
        worst = row["worst"]
        d, r = row["differences"], row["ratios"]
        table.append([name, f"{row['group'] or 'all'} ({row['scenes']})", estimated(d["psnr"], 2, True),
                      f"{estimated(worst, 2, True)} ({worst['scene']})" if worst else "–", estimated(d["ssim"], 4, True),
                      estimated(d["lpips"], 4, True), ratio(r["primitives"]), ratio(r["train_seconds"]),
                      ratio(r["peak_memory_bytes"])])
    return without_empty(table)


def scene_tables(suite):
    """[(backbone, table)] of the runs without a cap."""
    tables = []
    for backbone in dict.fromkeys(row["backbone"] for row in suite["by_scene"]):
        table = [["scene", "rules", "seeds", "PSNR (dB)", "SSIM", "LPIPS", "primitives", "time", "memory", "ΔPSNR (dB)", "ΔSSIM",
                  "ΔLPIPS", "primitives ×", "time ×", "memory ×"]]
        rows = [row for row in suite["by_scene"] if row["backbone"] == backbone and row["cap"] is None]
        for scene in dict.fromkeys(row["scene"] for row in rows):
            for i, row in enumerate(row for row in rows if row["scene"] == scene):
                m, d, r = row["measures"], row.get("differences"), row.get("ratios")
                memory = m["peak_memory_bytes"]["mean"]
                # Show a scene's name only in its first row.
                table.append(["" if i else scene, label(suite, row), str(len(row["seeds"])), estimated(m["psnr"], 2),
                              estimated(m["ssim"], 4), estimated(m["lpips"], 4), count(m["primitives"]["mean"]),
                              seconds(m["train_seconds"]["mean"]), "–" if memory is None else f"{memory / 2**20:.0f} MiB"] +
                             ([estimated(d["psnr"], 2, True), estimated(d["ssim"], 4, True), estimated(d["lpips"], 4, True),
                               ratio(r["primitives"]), ratio(r["train_seconds"]), ratio(r["peak_memory_bytes"])]
                              if d else [""] * 6))
        tables.append((backbone, without_empty(table)))
    return tables


def frontier_table(suite):
    """Runs with and without caps, sorted by number of primitives, and by how much rule sets exceed the reference at an
    equal number. None if there are no caps."""
    if not any(row["cap"] is not None for row in suite["by_scene"]):
        return None
    table = [["scene", "rules", "primitives", "PSNR (dB)", "SSIM", "LPIPS",
              f"above “{reference_label(suite)}” at equal number (dB)"]]
    several = len({row["backbone"] for row in suite["by_scene"]}) > 1
    above = {(row["scene"], row["backbone"], row["rules"]): row["above"] for row in suite["frontier"]}
    for scene, backbone in dict.fromkeys((row["scene"], row["backbone"]) for row in suite["by_scene"]):
        rows = [row for row in suite["by_scene"] if (row["scene"], row["backbone"]) == (scene, backbone)]
        for i, row in enumerate(sorted(rows, key=lambda row: row["measures"]["primitives"]["mean"])):
            m = row["measures"]
            table.append(["" if i else scene + (f", {backbone}" if several else ""), label(suite, row),
                          count(m["primitives"]["mean"]), estimated(m["psnr"], 2), estimated(m["ssim"], 4),
                          estimated(m["lpips"], 4),
                          "" if row["cap"] is not None or row["rules"] == suite["reference"]
                          else estimated(above.get((scene, backbone, row["rules"])), 2, True)])
    return without_empty(table)


def paper_tables(suite):
    """[(title, table)], one per table of the paper."""
    tables = []
    for each in suite["paper"]["tables"]:
        table = [["", "paper: min", "PSNR", "SSIM", "N", "here: time", "PSNR", "SSIM", "N"]]
        for row in each["rows"]:
            theirs, ours = row["paper"], row["ours"]
            table.append([f"{row['of']}: {row['method']}"] + (
                [f"{theirs['minutes']:.2f}", f"{theirs['psnr']:.2f}", f"{theirs['ssim']:.3f}", f"{theirs['millions']:.2f} M"]
                if theirs else ["–"] * 4) + (
                [seconds(ours["train_seconds"]), f"{ours['psnr']:.2f}", f"{ours['ssim']:.3f}", f"{ours['primitives'] / 1e6:.2f} M"]
                if ours else ["–"] * 4))
        tables.append((f"Table {each['table']}", table))
    return tables


def paper_note(suite):
    lengths = sorted({run["iterations"] for run in suite["runs"] if "/" in run["scene"]})
    return (f"The paper: {suite['paper']['source']}. Here: {', '.join(f'{n:,}' for n in lengths)} iterations, on "
            f"{'; '.join(suite['machines'])}. LPIPS is left out, since the networks differ.")


# --- Markdown ---------------------------------------------------------------------------------------------------------

def markdown_table(table, names=1):
    head, *body = table
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * names + "--:|" * (len(head) - names)]
    return "\n".join(lines + ["| " + " | ".join(row) + " |" for row in body]) + "\n"


def reference_label(suite):
    return suite["rules"][suite["reference"]]["label"]


def markdown(suite):
    parts = []
    if suite["overall"]:
        parts += [markdown_table(overall_table(suite), 2), NOTE.format(reference=reference_label(suite)) + "\n"]
    for backbone, table in scene_tables(suite):
        parts += [f"**{backbone}**\n", markdown_table(table, 2)]
    if frontier_table(suite):
        parts += [markdown_table(frontier_table(suite), 2), "![PSNR against the number of primitives](frontier.svg)\n"]
    for name, table in paper_tables(suite):
        parts += [f"**The paper's {name}**\n", markdown_table(table)]
    if suite["paper"]["tables"]:
        parts.append(paper_note(suite) + "\n")
    for name in ("missing", "left_out"):
        if suite[name]:
            parts.append(f"{name.replace('_', ' ').capitalize()}: " + "; ".join(suite[name]) + ".\n")
    parts.append(f"{'; '.join(suite['machines'])}, {suite['date'][:10]}: `{suite['command']}`\n")
    return "\n".join(parts)


# --- the plot ---------------------------------------------------------------------------------------------------------

def ticks(low, high, most=4):
    """(round numbers in [low, high], their step), at most about `most` of them."""
    step = 10 ** math.floor(math.log10(max(high - low, 1e-9) / most))
    step *= next(factor for factor in (1, 2, 5, 10) if (high - low) / (step * factor) <= most)
    first = math.ceil(low / step)
    return [step * i for i in range(first, math.floor(high / step) + 1)], step


def short_count(number):
    return f"{number / 1e6:g}M" if number >= 1e6 else f"{number / 1e3:g}k" if number >= 1e3 else f"{number:g}"


def panel(suite, title, rows, width, height):
    """Plot of quality against number of primitives (logarithmic) for one scene and backbone."""
    points = {}
    for row in rows:
        m = row["measures"]
        if m["psnr"]["mean"] is not None and m["primitives"]["mean"]:
            points.setdefault(row["rules"], []).append((m["primitives"]["mean"], m["psnr"]["mean"], m["psnr"]["error"] or 0))
    every = [point for each in points.values() for point in each]
    low = math.log10(min(n for n, _, _ in every) / 1.25)
    high = math.log10(max(n for n, _, _ in every) * 1.25)
    bottom, top = min(q - e for _, q, e in every), max(q + e for _, q, e in every)
    slack = max(0.08 * (top - bottom), 0.05)
    bottom, top = bottom - slack, top + slack
    left, right, up, down = 44, width - 12, 28, height - 34

    def place(n, q):
        return (left + (math.log10(n) - low) / (high - low) * (right - left), down - (q - bottom) / (top - bottom) * (down - up))

    out = [f'<text x="{left}" y="16" class="t">{escape(title)}</text>']
    values, step = ticks(bottom, top)
    for value in values:
        y = place(10 ** low, value)[1]
        digits = max(0, -math.floor(math.log10(step)))
        out.append(f'<line x1="{left}" x2="{right}" y1="{y:.1f}" y2="{y:.1f}" class="g"/>'
                   f'<text x="{left - 6}" y="{y + 3.5:.1f}" class="l" text-anchor="end">{value:.{digits}f}</text>')
    last = -100
    for power in range(math.floor(low), math.ceil(high) + 1):
        for digit in (1, 2, 5):
            n = digit * 10 ** power
            x = place(n, bottom)[0]
            if left <= x <= right and x - last > 34:
                out.append(f'<line x1="{x:.1f}" x2="{x:.1f}" y1="{down}" y2="{down + 4}" class="a"/>'
                           f'<text x="{x:.1f}" y="{down + 15}" class="l" text-anchor="middle">{short_count(n)}</text>')
                last = x
    out.append(f'<line x1="{left}" x2="{right}" y1="{down}" y2="{down}" class="a"/>')
    for i, rules in enumerate(suite["rules"]):
        color = COLORS[i % len(COLORS)]
        each = sorted(points.get(rules, []))
        if len(each) > 1:
            line = " ".join(f"{x:.1f},{y:.1f}" for x, y in (place(n, q) for n, q, _ in each))
            out.append(f'<polyline points="{line}" fill="none" stroke="{color}" stroke-width="1.6"/>')
        for n, q, error in each:
            x, y = place(n, q)
            if error:
                out.append(f'<line x1="{x:.1f}" x2="{x:.1f}" y1="{place(n, q - error)[1]:.1f}" y2="{place(n, q + error)[1]:.1f}" '
                           f'stroke="{color}" stroke-width="1.4"/>')
            out.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3.6" fill="{color}" stroke="#fff"/>')
    return "".join(out)


def frontier_svg(suite):
    """Small plots side by side, one per scene and backbone; used as a file and in the page."""
    panels = {}
    several = len({row["backbone"] for row in suite["by_scene"]}) > 1
    for row in suite["by_scene"]:
        if row["measures"]["psnr"]["mean"] is not None:
            name = row["scene"] + (f", {row['backbone']}" if several else "")
            panels.setdefault(name, []).append(row)
    width, height, columns = 290, 220, min(3, max(1, len(panels)))
    total = 30 + height * math.ceil(len(panels) / columns)
    out = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {max(580, width * columns)} {total}" role="img" '
           f'style="max-width:{400 * max(2, columns)}px" '
           'aria-label="PSNR in dB against the number of primitives" font-family="system-ui, sans-serif">'
           "<style>.t{font-size:12px;font-weight:600;fill:#17202e}.l{font-size:10px;fill:#5b6677}.g{stroke:#e8ecf2}"
           ".a{stroke:#aab3c0}</style>"
           f'<rect width="100%" height="{total}" fill="#fff"/>']
    x = 44
    for i, rules in enumerate(suite["rules"]):
        text = suite["rules"][rules]["label"]
        out.append(f'<circle cx="{x}" cy="14" r="4" fill="{COLORS[i % len(COLORS)]}"/>'
                   f'<text x="{x + 8}" y="18" class="l">{escape(text)}</text>')
        x += 30 + 6 * len(text)
    for i, (name, rows) in enumerate(panels.items()):
        out.append(f'<g transform="translate({width * (i % columns)} {30 + height * (i // columns)})">'
                   + panel(suite, name, rows, width, height) + "</g>")
    return "".join(out) + "</svg>\n"


# --- crops ------------------------------------------------------------------------------------------------------------

def crops(plan, out, suite):
    """[(title, [(label, image as a URI)])]: for each scene and backbone the view, and its part, in which the last
    rule set loses most against the reference: the truth, then all rule sets."""
    found = []
    runs = {(run["scene"], run["backbone"], run["rules"]): run for run in plan["runs"] if run["pictures"]}
    reference, judged = suite["reference"], list(plan["rules"])[-1]
    if judged == reference:
        return found
    for scene, backbone in dict.fromkeys((row["scene"], row["backbone"]) for row in suite["by_scene"]):
        these = [runs[scene, backbone, rules] for rules in plan["rules"] if (scene, backbone, rules) in runs]
        folders = {run["rules"]: out / "runs" / run["id"] for run in these}
        if not {reference, judged} <= folders.keys():
            continue
        found += crop_of_scene(suite, scene, backbone, folders, reference, judged)
    return found


def crop_of_scene(suite, scene, backbone, folders, reference, judged):
    records = {rules: folder / "record.json" for rules, folder in folders.items()}
    if not records[reference].exists() or not records[judged].exists():
        return []
    first, second = (json.loads(records[rules].read_text())["results"] for rules in (reference, judged))
    psnr = {view["name"]: view["psnr"] for view in first["views"]}
    losses = sorted((view["psnr"] - psnr[view["name"]], view["name"]) for view in second["views"]
                    if view["psnr"] is not None and psnr.get(view["name"]) is not None)
    if not losses:
        return []
    loss, view = losses[0]
    name = Path(view).stem + ".png"
    pictures = {}
    for rules, folder in folders.items():
        path = folder / "model" / second["split"] / "renders" / name
        if path.exists():
            pictures[rules] = path
    truth = folders[reference] / "model" / second["split"] / "truth" / name
    if not truth.exists() or not {reference, judged} <= pictures.keys():
        return []
    truth = png.read(truth)
    pictures = {rules: png.read(path) for rules, path in pictures.items()}
    width, height = max(16, truth.width // 3), max(16, truth.height // 3)
    x, y = png.worst_window(truth, pictures[reference], pictures[judged], width, height)
    title = f"{scene}{'' if backbone == 'vanilla' else ', ' + backbone}: {view}, {minus(f'{loss:+.2f}')} dB"
    return [(title, [("truth", truth.crop(x, y, width, height).data_uri())] +
             [(suite["rules"][rules]["label"], picture.crop(x, y, width, height).data_uri())
              for rules, picture in pictures.items()])]


# --- HTML -------------------------------------------------------------------------------------------------------------

STYLE = """
body{margin:0;background:#f5f7fb;color:#17202e;font:15px/1.5 system-ui,sans-serif}
main{max-width:1320px;margin:0 auto;padding:28px 20px 60px}
h1{font-size:26px;margin:2px 0 4px}h2{font-size:18px;margin:36px 0 10px}h3{font-size:14px;margin:18px 0 6px}
.kind{color:#1565d8;font-weight:600;font-size:12px;margin:0}.note,header p:last-child{color:#5b6677;font-size:13px;margin:8px 0}
.cards{display:grid;grid-template-columns:repeat(auto-fit,minmax(205px,1fr));gap:12px;margin:22px 0}
.card,.wide,figure{background:#fff;border:1px solid #e1e6ee;border-radius:10px}
.card{padding:14px 16px}.card b{display:block;font-size:21px;white-space:nowrap}.card span{color:#5b6677;font-size:12.5px}
.wide{overflow-x:auto}table{border-collapse:collapse;width:100%;font-size:13px;font-variant-numeric:tabular-nums}
th,td{padding:6px 8px;text-align:right;white-space:nowrap;border-top:1px solid #e8ecf2}
thead th{border-top:0;color:#5b6677;font-weight:500}tr.same td,tr.same th{border-top-color:transparent}
.left{text-align:left}.good{color:#087f3c}.bad{color:#b42318}
figure{margin:0 0 12px;padding:12px}figcaption{font-weight:600;font-size:13px;margin-bottom:8px}
.crops{display:grid;grid-template-columns:repeat(auto-fit,minmax(200px,1fr));gap:10px}
.crops img{width:100%;display:block;border-radius:6px}.crops span{font-size:12px;color:#5b6677}
svg{width:100%;height:auto;display:block}details{margin-top:10px}code{font-size:12px;word-break:break-all}
"""


def html_table(table, names=1):
    """HTML of a table. Differences of more than two standard errors are green if better, red if worse."""
    head, *body = table

    def cell(i, text):
        kind = "left" if i < names else ""
        difference = re.match(r"([+−])([0-9.]+) ± ([0-9.]+)", text)
        if difference and float(difference[2]) > 2 * float(difference[3]):
            kind = "good" if (difference[1] == "+") == ("LPIPS" not in head[i]) else "bad"
        return f"<td{f' class={kind}' if kind else ''}>{escape(text)}</td>"

    out = ["<div class=wide><table><thead><tr>"]
    out += [f"<th{' class=left' if i < names else ''}>{escape(text)}</th>" for i, text in enumerate(head)]
    out.append("</tr></thead><tbody>")
    for row in body:
        out.append(f"<tr{' class=same' if row[0] == '' else ''}>" + "".join(cell(i, text) for i, text in enumerate(row)) + "</tr>")
    return "".join(out) + "</tbody></table></div>"


def cards(suite):
    """Summary of the last rule set over all scenes, for the first backbone."""
    whole = [row for row in suite["overall"] if row["group"] is None]
    if not whole:
        return ""
    row = [each for each in whole if each["backbone"] == whole[0]["backbone"]][-1]
    worst, r = row["worst"], row["ratios"]
    facts = [(estimated(row["differences"]["psnr"], 2, True) + " dB", f"mean ΔPSNR over {row['scenes']} scenes")]
    if worst:
        facts.append((estimated(worst, 2, True) + " dB", f"worst scene: {worst['scene']}"))
    facts += [(ratio(r["primitives"]), "primitives"), (ratio(r["train_seconds"]), "training time"),
              (ratio(r["peak_memory_bytes"]), "peak memory")]
    return (f"<h2>{escape(label(suite, row))} against {escape(reference_label(suite))}, {escape(row['backbone'])}</h2><div class=cards>"
            + "".join(f"<div class=card><b>{escape(a)}</b><span>{escape(b)}</span></div>" for a, b in facts) + "</div>")


def html(suite, svg, pictures):
    scenes = len({row["scene"] for row in suite["by_scene"]})
    seeds = sorted({run["seed"] for run in suite["runs"]})
    facts = [f"{len(suite['runs'])} runs", f"{scenes} scene{'s' if scenes > 1 else ''}", "seeds " + ", ".join(map(str, seeds)),
             *suite["machines"], suite["date"][:10], f"commit {suite['commit']}" if suite["commit"] else ""]
    out = ["<!DOCTYPE html><html lang=en><head><meta charset=utf-8><meta name=viewport content='width=device-width'>"
           "<meta http-equiv=Content-Security-Policy content=\"default-src 'none'; img-src data:; style-src 'unsafe-inline'\">"
           f"<title>SplatBoost suite</title><style>{STYLE}</style></head><body><main><header><p class=kind>SplatBoost suite</p>"
           f"<h1>{escape(' · '.join(rule['label'] for rule in suite['rules'].values()))}</h1>"
           f"<p>{escape(' · '.join(fact for fact in facts if fact))}</p></header>"]
    for name, text in (("missing", "Missing runs"), ("left_out", "Left out")):
        if suite[name]:
            out.append(f"<p class=note><b>{text}:</b> {escape('; '.join(suite[name]))}</p>")
    out.append(cards(suite))
    if suite["overall"]:
        out += ["<h2>Over the scenes</h2>", html_table(overall_table(suite), 2),
                f"<p class=note>{escape(NOTE.format(reference=reference_label(suite)))} Differences of more than two standard errors "
                "are coloured.</p>"]
    for backbone, table in scene_tables(suite):
        out += [f"<h2>Scene by scene, {escape(backbone)}</h2>", html_table(table, 2)]
    out += ["<h2>Quality against number of primitives</h2>", f"<figure>{svg}</figure>",
            "<p class=note>PSNR in dB against the number of primitives, means over seeds with standard errors. Lines join runs of one "
            "rule set under different caps.</p>"]
    if frontier_table(suite):
        out.append(html_table(frontier_table(suite), 2))
    if suite["paper"]["tables"]:
        out.append("<h2>Compared with the paper</h2>")
        for name, table in paper_tables(suite):
            out += [f"<h3>{escape(name)}</h3>", html_table(table)]
        out.append(f"<p class=note>{escape(paper_note(suite))}</p>")
    if pictures:
        out.append("<h2>Worst views</h2><p class=note>For each scene the view that loses most, a third of it in each direction, where it "
                   "loses most. First seed.</p>")
        for title, parts in pictures:
            out.append(f"<figure><figcaption>{escape(title)}</figcaption><div class=crops>" + "".join(
                f"<div><img src='{uri}' alt='{escape(text)}'><span>{escape(text)}</span></div>" for text, uri in parts)
                + "</div></figure>")
    out.append(f"<h2>How it was run</h2><p><code>{escape(suite['command'])}</code></p><details><summary>Every run</summary>")
    rows = [["scene", "rules", "backbone", "seed", "PSNR (dB)", "primitives", "time", "command"]]
    for run in suite["runs"]:
        rows.append([run["scene"], label(suite, run), run["backbone"], str(run["seed"]), estimated(stats.estimate([run["psnr"]]), 2),
                     count(run["primitives"]), seconds(run["train_seconds"]), run["command"]])
    out.append(html_table(rows, 3) + "</details></main></body></html>\n")
    return "".join(out)
