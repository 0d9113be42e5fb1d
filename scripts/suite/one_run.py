# SPDX-License-Identifier: Apache-2.0
"""Executes one run of a plan: trains, then writes RUN/record.json and, if the page needs them, images.

usage: one_run.py PLAN.json ID
"""
import json
import shutil
import subprocess
import sys
import time
from pathlib import Path

from plan import last_line, write_atomically


def title(run):
    cap = ""
    if run["cap"] is not None:
        cap = f", at most {run['cap']}" + ("× published" if isinstance(run["cap"], float) else "'s number")
    return f"{run['scene']}, {run['backbone']}, {run['rules']}{cap}, seed {run['seed']}"


def command_of(run, model, folder):
    """The training command. Reads the record of the run whose number of primitives determines the cap."""
    command = [run["program"], "train", "-s", run["source"], "-m", str(model), *run["options"], "--quiet"]
    if run["settings"]:
        settings = folder / "settings.json"
        write_atomically(settings, json.dumps(run["settings"], indent=1) + "\n")
        command += ["--config", str(settings)]
    if run["lpips"]:
        command += ["--lpips", run["lpips"]]
    if run["cap"] is not None:
        number = json.loads((folder.parent / run["needs"] / "record.json").read_text())["results"]["primitives"]
        cap = max(1, round(number * run["cap"])) if isinstance(run["cap"], float) else number
        command += ["--max-primitives", str(cap)]
    return command


def say(plan, line):
    with open(Path(plan["out"]) / "progress.txt", "a") as progress:
        progress.write(line + "\n")


def main():
    plan = json.loads(Path(sys.argv[1]).read_text())
    run = next(run for run in plan["runs"] if run["id"] == sys.argv[2])
    folder = Path(plan["out"]) / "runs" / run["id"]
    model = folder / "model"
    shutil.rmtree(model, ignore_errors=True)
    folder.mkdir(parents=True, exist_ok=True)
    command = command_of(run, model, folder)
    begun = time.monotonic()
    with open(folder / "log.txt", "w") as log:
        status = subprocess.run(command, stdout=log, stderr=subprocess.STDOUT).returncode
    if status != 0:
        why = last_line((folder / "log.txt").read_text(errors="replace"))
        say(plan, f"{title(run)}: FAILED with status {status}: {why} ({folder}/log.txt)")
        return 1
    results = json.loads((model / "results.json").read_text())
    if not plan["keep_models"]:
        for path in (model / "point_cloud", model / "report.html"):
            shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)
        if not run["pictures"]:
            for split in ("test", "train"):
                shutil.rmtree(model / split, ignore_errors=True)
    record = {"id": run["id"], "key": run["key"], "command": command, "wall_seconds": time.monotonic() - begun,
              "results": results}
    write_atomically(folder / "record.json", json.dumps(record, indent=1) + "\n")
    say(plan, f"{title(run)}: {results['psnr']:.2f} dB, {results['primitives']:,} primitives, {results['train_seconds']:.1f} s")
    return 0


if __name__ == "__main__":
    sys.exit(main())
