#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Disturbs commands of the program at their N-th file operation, by an error, a full disk or a kill (file_faults.c).

usage: inject_faults.py [--sample N] [--scenario NAME …] [--seed S] [--jobs N] [--json FILE]

Without --sample every operation is disturbed in every way. The rule: the command ends as broken_rule() allows; files
that were there are intact or replaced whole; the same command again, or a resume, gives the bytes of an undisturbed
run; after `patch revert` a tree is the original.
"""

import argparse
import concurrent.futures
import json
import pathlib
import random
import shutil
import sys
import tempfile

import attacks
from attacks import Totals, broken_rule, run, run_well

sys.path.append(str(attacks.ROOT / "tests/python"))
import miniature_host  # noqa: E402

PLY = "point_cloud/iteration_4/point_cloud.ply"
KINDS = ["error", "full", "kill"]
# Keys whose values differ from run to run.
VARYING = {"train_seconds", "fps", "peak_memory_bytes", "estimated_memory_bytes", "date", "command", "stage_seconds",
           "seconds", "stages", "ratios"}
#: Files that a new run removes before it starts.
RESULTS = ("point_cloud", "test", "train", "training.json", "results.json", "compare.json", "report.html", "cameras.json")


def without_varying(value):
    if isinstance(value, dict):
        return {key: without_varying(v) for key, v in value.items() if key not in VARYING}
    return [without_varying(v) for v in value] if isinstance(value, list) else value


def essence(path):
    """@return the content of a file that is the same in every run; None: the file is not complete"""
    data = path.read_bytes()
    try:
        if path.name in ("results.json", "training.json", "compare.json", "patch.json"):
            return json.dumps(without_varying(json.loads(data)))
        if path.suffix == ".ckpt":
            entries = attacks.read_archive(data)
            trainer = without_varying(json.loads(entries["trainer"][1:]))
            for row in trainer["curve"]:
                row[1] = 0
            return json.dumps(trainer), [(k, v) for k, v in entries.items() if k != "trainer"]
    except ValueError:
        return None
    if path.name == "report.html":
        return "a report" if data.rstrip().endswith(b"</html>") else None
    return data


def is_working_file(path):
    return path.name.startswith((".splatboost-", ".splatboost.lock")) or \
        path.suffix in (".splatboost-new", ".splatboost-old")


def content(folder, working_files=False):
    return {str(path.relative_to(folder)): essence(path) for path in sorted(folder.rglob("*"))
            if path.is_file() and (working_files or not is_working_file(path))}


class Scenario:
    """A command in a folder that starts as a copy of `start`. The folder's name is fixed, since settings contain it."""

    name = ""
    removes = ()  # files that may be missing after a failure
    passing = {"training.json"}  # files that exist only temporarily

    def __init__(self, work):
        self.work = work
        self.start = work / "start"
        self.folder = work / "case"
        self.log = work / "operations"

    def prepare(self):
        self.start.mkdir()

    def command(self):
        raise NotImplementedError

    def again(self, found):
        """The command that completes the folder after a failure that left the files `found`."""
        return self.command()

    def check_more(self, found, done, complain):
        pass

    def reset(self):
        shutil.rmtree(self.folder, ignore_errors=True)
        shutil.copytree(self.start, self.folder)

    def undisturbed(self):
        self.reset()
        self.before = content(self.folder, True)
        self.log.unlink(missing_ok=True)
        run_well(*self.command(), cwd=self.work, faults=self.environment(0, "error") | {"FILE_FAULTS_LOG": str(self.log)})
        self.after = content(self.folder, True)
        return self.log.read_text().splitlines()

    def environment(self, at, kind):
        return {"FILE_FAULTS_UNDER": str(self.folder), "FILE_FAULTS_AT": str(at), "FILE_FAULTS_KIND": kind}

    def disturb(self, at, kind, operation, totals):
        self.reset()
        done = run(*self.command(), cwd=self.work, faults=self.environment(at, kind))
        totals.add(f"{self.name}, {kind}", done)

        def complain(what):
            totals.breaks(f"{self.name}: {kind} at operation {operation}: {what}; "
                          f"{done.stderr.decode(errors='replace').strip()}")

        wrong = broken_rule(done, kind == "kill")
        if wrong:
            complain(wrong)
        found = content(self.folder)
        for name in self.passing & found.keys():
            if found[name] is None:
                complain(f"{name} is not whole")
        for name, old in self.before.items():
            if name not in found:
                if name in self.after and not name.startswith(self.removes) and name not in self.passing:
                    complain(f"{name} is lost")
            elif found[name] != old and found[name] != self.after.get(name) and name not in self.passing:
                complain(f"{name} is neither the old nor the new")
        for name in found.keys() - self.before.keys():
            if name not in self.passing and found[name] != self.after.get(name):
                complain(f"{name} is not that of an undisturbed run")
        if done.returncode == 0 and {**found, **dict.fromkeys(self.passing)} != {**self.after, **dict.fromkeys(self.passing)}:
            complain("exit 0, but the files are not those of an undisturbed run")
        self.check_more(found, done, complain)
        self.finish(found, complain)

    def finish(self, found, complain):
        done = run(*self.again(found), cwd=self.work)
        if done.returncode != 0:
            complain(f"then exit {done.returncode} of {self.again(found)}: {done.stderr.decode(errors='replace').strip()}")
        else:
            self.compare(self.after, complain)

    def compare(self, wanted, complain):
        last = content(self.folder, True)
        differ = sorted(name for name in last.keys() | wanted.keys() if last.get(name) != wanted.get(name))
        if differ:
            complain(f"then other files than of an undisturbed run: {', '.join(differ)}")


def scene_of(work):
    scene = work / "scene"
    if not scene.exists():
        run_well("synth", scene, *attacks.TINY_SCENE)
    return scene


TRAINING = ["--eval", "--llffhold", "3", "--iterations", "4", "--threads", "1", "--quiet"]


class Train(Scenario):
    name = "train"
    removes = RESULTS
    seed = "7"
    backbone = "vanilla"

    def prepare(self):
        scene_of(self.work)
        super().prepare()

    def command(self):
        return ["train", "-s", "scene", "-m", "case", *TRAINING, "--seed", self.seed, "--backbone", self.backbone,
                "--checkpoint-iterations", "2", "--save-iterations", "3"]

    def again(self, found):
        checkpoint = "checkpoints/iteration_2.ckpt"
        if found.get(checkpoint) == self.after[checkpoint] and found.get("config.json") == self.after["config.json"]:
            return ["train", "--resume", f"case/{checkpoint}", "--save-iterations", "3", "--quiet"]
        return self.command()

    def check_more(self, found, done, complain):
        """A complete model need not be trained again. What could not be written before it stays as it was."""
        model = {name for name in self.after if name.startswith("point_cloud/iteration_4/")}
        if not all(found.get(name) == self.after[name] for name in model) or \
           "results.json" in found or found.get("config.json") != self.after["config.json"]:
            return
        kept = self.work / "kept"
        shutil.rmtree(kept, ignore_errors=True)
        shutil.copytree(self.folder, kept, symlinks=True)
        measured = run("eval", "-m", "case", "--quiet", cwd=self.work)
        if measured.returncode != 0:
            complain(f"eval of the model at its end: {measured.stderr.decode(errors='replace').strip()}")
        else:
            early = ("checkpoints/", "point_cloud/iteration_3/")
            self.compare({name: value for name, value in self.after.items() if not name.startswith(early)} |
                         {name: value for name, value in found.items() if name.startswith(early)}, complain)
        shutil.rmtree(self.folder)
        kept.rename(self.folder)


class TrainNets(Train):
    name = "train scaffold-gs"
    backbone = "scaffold-gs"


class TrainOver(Train):
    name = "train over another run"

    def prepare(self):
        scene_of(self.work)
        self.seed = "3"
        run_well(*self.command(), cwd=self.work)
        self.seed = Train.seed
        self.folder.rename(self.start)


class Compare(Scenario):
    name = "compare"
    removes = tuple(f"{folder}{name}" for folder in ("", "baseline/", "boosted/") for name in RESULTS)
    passing = {"baseline/training.json", "boosted/training.json"}

    def prepare(self):
        scene_of(self.work)
        super().prepare()

    def command(self):
        return ["compare", "-s", "scene", "-m", "case", *TRAINING]


class CompareResumed(Compare):
    name = "compare, then resumed"

    def again(self, found):
        whole = found.get("config.json") == self.after["config.json"]
        return ["compare", "--resume", "case", "--quiet"] if whole else self.command()


class Resume(Train):
    name = "resume"
    removes = ()

    def prepare(self):
        scene_of(self.work)
        run_well(*super().command(), cwd=self.work)
        self.folder.rename(self.start)

    def command(self):
        return ["train", "--resume", "case/checkpoints/iteration_2.ckpt", "--save-iterations", "3", "--quiet"]

    def again(self, found):
        return self.command()


class Eval(Resume):
    name = "eval"

    def command(self):
        return ["eval", "-m", "case", "--quiet"]


class EvalUnmeasured(Eval):
    name = "eval of a run killed while it measured"

    def prepare(self):
        super().prepare()
        (self.start / "results.json").rename(self.start / "training.json")
        shutil.rmtree(self.start / "test")
        (self.start / "report.html").unlink()


class Render(Eval):
    name = "render"

    def command(self):
        return ["render", "-m", "case"]


class Pack(Scenario):
    name = "pack"

    def prepare(self):
        super().prepare()
        run_well("synth", "other", *attacks.TINY_SCENE, "--seed", "5", cwd=self.work)
        run_well("pack", "other", "start/scene.sbscene", cwd=self.work)
        scene_of(self.work)

    def command(self):
        return ["pack", "scene", "case/scene.sbscene"]


class Synth(Scenario):
    name = "synth"

    def command(self):
        return ["synth", "case/scene", *attacks.TINY_SCENE]


class PatchApply(Scenario):
    name = "patch apply"
    passing = {".splatboost/patch.json"}  # records the progress while the command runs

    def prepare(self):
        miniature_host.write_host(self.start, "3dgs-2023")

    def command(self):
        return ["patch", "apply", "3dgs", "case"]

    def check_more(self, found, done, complain):
        if done.returncode in (1, 2) and "patch revert" not in done.stderr.decode(errors="replace") and \
           "same command again" not in done.stderr.decode(errors="replace") and content(self.folder, True) != self.before:
            complain("the tree is not the original, and the message does not say what to do")

    def finish(self, found, complain):
        self.revert(complain)
        super().finish(found, complain)
        self.revert(complain)

    def revert(self, complain):
        done = run("patch", "revert", "case", cwd=self.work)
        if done.returncode != 0:
            complain(f"then revert: {done.stderr.decode(errors='replace').strip()}")
        self.compare(content(self.work / "original", True), complain)
        if (self.folder / ".splatboost").exists():
            complain("then revert: .splatboost stays")

    def undisturbed(self):
        if not (self.work / "original").exists():
            miniature_host.write_host(self.work / "original", "3dgs-2023")
        return super().undisturbed()


class PatchRevert(PatchApply):
    name = "patch revert"

    def prepare(self):
        super().prepare()
        self.start.rename(self.folder)
        run_well(*PatchApply.command(self), cwd=self.work)
        self.folder.rename(self.start)

    def command(self):
        return ["patch", "revert", "case"]

    def finish(self, found, complain):
        self.revert(complain)


SCENARIOS = {scenario.name: scenario for scenario in (
    Train, TrainNets, TrainOver, Compare, CompareResumed, Resume, Eval, EvalUnmeasured, Render, Pack, Synth, PatchApply,
    PatchRevert)}


def attack(name, sample=None, seed=0):
    """@param sample number of operations, evenly spread, each with one fault; None: each operation with every fault"""
    totals = Totals()
    with tempfile.TemporaryDirectory(prefix="splatboost-faults-") as folder:
        scenario = SCENARIOS[name](pathlib.Path(folder).resolve())
        scenario.prepare()
        operations = scenario.undisturbed()
        cases = [(at, kind) for at in range(1, len(operations) + 1) for kind in KINDS]
        if sample is not None and sample < len(cases):
            generator = random.Random(f"{name} {seed}")
            step = len(cases) / sample
            cases = [cases[int((i + generator.random()) * step)] for i in range(sample)]
        for at, kind in cases:
            scenario.disturb(at, kind, operations[at - 1], totals)
    return totals


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sample", type=int)
    parser.add_argument("--scenario", nargs="+", choices=list(SCENARIOS), default=list(SCENARIOS))
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--json")
    arguments = parser.parse_args()
    totals = Totals()
    with concurrent.futures.ProcessPoolExecutor(arguments.jobs) as pool:
        for one in pool.map(attack, arguments.scenario, *zip(*[(arguments.sample, arguments.seed)] * len(arguments.scenario))):
            totals.merge(one)
    return totals.finish(arguments, "faults")


if __name__ == "__main__":
    sys.exit(main())
