# SPDX-License-Identifier: Apache-2.0
"""Measurements as Markdown: the files of docs/results, and the cells and rows of a table."""
import json
import math
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
RESULTS = ROOT / "docs" / "results"


def load(name):
    return json.loads((RESULTS / f"{name}.json").read_text())


def markdown(rows):
    head, *body = rows
    lines = ["| " + " | ".join(head) + " |", "|---|" + "--:|" * (len(head) - 1)]
    lines += ["| " + " | ".join(row) + " |" for row in body]
    return "\n".join(lines)


def minutes(seconds):
    seconds = round(seconds)
    return f"{seconds} s" if seconds < 120 else f"{seconds // 60} min {seconds % 60:02d} s"


def how(run):
    """Machine, threads, date and command of a run."""
    command = run["command"].replace(" --quiet", "")
    return f"{run['machine']}, {run['threads']} threads, {run['date'][:10]}: `{command}`"


def machine_of(data):
    return f"{data['machine']}, {data['threads']} threads, {data['instruction_set']}, {data['date'][:10]}"


def difference(value, digits):
    return f"{value:+.{digits}f}".replace("-", "−")


def decibels(value, error=math.nan):
    """A change of PSNR, with its standard error if that is known."""
    text = difference(round(value, 2) + 0.0, 2)
    return f"{text} dB" if math.isnan(error) else f"{text} ± {error:.2f} dB"


def ratio(value):
    return "–" if math.isnan(value) else f"{value:.2f}×"


def arrow(a, b, form="{:,}", unit=""):
    """Before and after."""
    return f"{form.format(a)} → {form.format(b)}{unit}"
