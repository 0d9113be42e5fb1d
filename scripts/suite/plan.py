# SPDX-License-Identifier: Apache-2.0
"""Turns scenes, seeds, rule sets and backbones into a list of runs, each identified by a hash of what determines it."""
import hashlib
import json
import math
import os
import re
import shutil
import subprocess
from pathlib import Path

HERE = Path(__file__).resolve().parent


class BadInput(Exception):
    """An error that the user can fix, as one line."""


def read_json(path):
    try:
        document = json.loads(Path(path).read_text())
    except OSError as error:
        raise BadInput(f"{path}: {error.strerror or 'cannot be read'}")
    except ValueError as error:
        raise BadInput(f"{path}: not JSON: {error}")
    if not isinstance(document, dict):
        raise BadInput(f"{path}: must hold a JSON object")
    return document


def write_atomically(path, text):
    aside = Path(f"{path}.{os.getpid()}.tmp")
    aside.write_text(text)
    os.replace(aside, path)


# --- what determines a run --------------------------------------------------------------------------------------------

def hash_of_file(path):
    digest = hashlib.sha256()
    with open(path, "rb") as stream:
        for block in iter(lambda: stream.read(1 << 20), b""):
            digest.update(block)
    return digest.hexdigest()


def fingerprint(folder):
    """Hash of a scene: names and sizes of all its files, and the content of those with cameras and points (.bin, .txt,
    .json). points3D.ply, which other trainers write, is ignored. A packed scene (one file) is hashed whole."""
    folder = Path(folder)
    if folder.is_file():
        return hash_of_file(folder)
    listing = []
    for place, folders, files in os.walk(folder, followlinks=True):
        folders.sort()
        for name in sorted(files):
            path = Path(place) / name
            if name == "points3D.ply":
                continue
            content = hash_of_file(path) if path.suffix in (".bin", ".txt", ".json") else ""
            listing.append([str(path.relative_to(folder)), path.stat().st_size, content])
    return identity(listing)


def identity(value):
    """Hash of a JSON value: 16 hexadecimal digits."""
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()[:16]


# --- scenes -----------------------------------------------------------------------------------------------------------

def own_scenes(listing, folder, size):
    """Scenes of a listing such as scenes.json, as {name, group, options, path or synth}; those with a path need `folder`."""
    scenes, entries = [], read_json(listing).get("scenes", [])
    if not isinstance(entries, list):
        raise BadInput(f"{listing}: scenes must be a list; see scripts/suite/scenes.json for the form")
    for entry in entries:
        try:
            scene = {"name": entry["name"], "group": entry["group"], "options": list(entry.get("options", []))}
            if "synth" in entry:
                scene["synth"] = entry["synth"][size]
            elif folder is None:
                continue
            else:
                scene["path"] = str(Path(folder) / entry["path"])
                scene["options"] += entry[size]
        except (KeyError, TypeError) as error:
            raise BadInput(f"{listing}: a scene without {error}; see scripts/suite/scenes.json for the form")
        scenes.append(scene)
    return scenes


def paper_scenes(folder, size):
    """The scenes of the paper's datasets, each in the first known subfolder of `folder` that has it, else the first."""
    scenes = []
    for dataset in read_json(HERE / "datasets.json")["datasets"]:
        for name, options in dataset["scenes"].items():
            places = [Path(folder) / inner / name for inner in dataset["folders"]]
            path = next((place for place in places if (place / "sparse").is_dir()), places[0])
            scenes.append({"name": f"{dataset['name']}/{name}", "group": dataset["name"], "path": str(path), "paper": name,
                           "options": options + (["-r", "250"] if size == "quick" else []),
                           "paper_settings": dataset.get("paper_settings", {}).get(name)})
    return scenes


def choose(scenes, wanted):
    """The scenes whose name or group is in `wanted`; all scenes if it is empty."""
    names = {scene["name"] for scene in scenes} | {scene["group"] for scene in scenes}
    for name in wanted:
        if name not in names:
            raise BadInput(f"unknown scene or group '{name}'; available: {', '.join(sorted(names))}")
    return [scene for scene in scenes if not wanted or scene["name"] in wanted or scene["group"] in wanted]


def make_synth(program, options, folder):
    """Path of the scene that `splatboost synth` makes with these options; made only once per program."""
    path = Path(folder) / identity([hash_of_file(program), options])
    if not path.is_dir():
        aside = path.with_suffix(f".{os.getpid()}.tmp")
        aside.parent.mkdir(parents=True, exist_ok=True)
        shutil.rmtree(aside, ignore_errors=True)
        done = subprocess.run([program, "synth", str(aside), *options], capture_output=True, text=True)
        if done.returncode != 0:
            shutil.rmtree(aside, ignore_errors=True)
            raise BadInput(f"splatboost synth {' '.join(options)}: {last_line(done.stderr)}")
        os.replace(aside, path)
    return str(path)


def last_line(text):
    lines = [line for line in re.split(r"[\r\n]+", text) if line.strip()]
    return lines[-1] if lines else "ended without a message"


# --- rule sets --------------------------------------------------------------------------------------------------------

def known_options(program):
    done = subprocess.run([program, "train", "--help"], capture_output=True, text=True)
    if done.returncode != 0:
        raise BadInput(f"{program} train --help: {last_line(done.stderr)}")
    return set(re.findall(r"--[a-z][a-z0-9-]*", done.stdout))


def choose_rules(wanted, options):
    """({name: rule set}, [reasons for those left out]). A name that ends in .json is a settings file for
    `splatboost train --config`; a rule set of the table with options that are not in `options` is left out."""
    table, rules, left_out = read_json(HERE / "rules.json"), {}, []
    for name in wanted:
        if name.endswith(".json"):
            settings, stem = read_json(name), Path(name).stem
            if stem in table or stem in rules:
                raise BadInput(f"{name}: rule set '{stem}' exists already; rename the file")
            rules[stem] = {"label": stem, "options": [], "settings": settings}
        elif name not in table:
            raise BadInput(f"unknown rule set '{name}'; available: {', '.join(table)}, or a file NAME.json of settings")
        else:
            unknown = [o for o in table[name]["options"] if o.startswith("--") and o not in options]
            if unknown:
                left_out.append(f"rule set {name}: this program has no {', '.join(unknown)}")
            else:
                rules[name] = table[name]
    return rules, left_out


# --- runs -------------------------------------------------------------------------------------------------------------

def parse_cap(text, rules):
    """A fraction of the published number of primitives (float), or the name of a rule set whose number is the cap."""
    if text in rules:
        return text
    try:
        share = float(text)
    except ValueError:
        share = 0
    if not (share > 0 and math.isfinite(share)):
        raise BadInput(f"--caps: '{text}' is neither a share of the published number, such as 0.3, nor a rule set of this suite")
    return share


def merged(first, second):
    """Settings of `first` overridden by those of `second`, recursively."""
    result = dict(first)
    for key, value in second.items():
        both = isinstance(value, dict) and isinstance(result.get(key), dict)
        result[key] = merged(result[key], value) if both else value
    return result


def make_runs(scenes, seeds, rules, backbones, caps, capped, common, programs, lpips):
    """All runs, those without a cap first. `scenes` have "path" and "print" (fingerprint); `common` are options of all
    runs; `programs` maps a rule set to (path, hash), with key None for all others; `lpips` is (path, hash) or None.

    The id of a run is a hash of what determines its result: program, scene, options, settings, cap, LPIPS network."""
    runs, ids = [], {}

    def add(scene, backbone, rule, seed, cap):
        program, print_of_program = programs.get(rule, programs[None])
        options = [*scene["options"], "--eval", "--backbone", backbone, "--seed", str(seed), *common, *rules[rule]["options"]]
        settings = rules[rule].get("settings", {})
        if rules[rule].get("paper") and scene.get("paper_settings"):
            settings = merged(settings, scene["paper_settings"])
        needs = None
        if cap is not None:
            needs = ids[scene["name"], backbone, cap if isinstance(cap, str) else "published", seed]
        key = {"program": print_of_program, "scene": scene["print"], "options": options, "settings": settings,
               "cap": cap if isinstance(cap, float) else None, "number_of": needs, "lpips": lpips[1] if lpips else None}
        run = {"id": identity(key), "scene": scene["name"], "group": scene["group"], "backbone": backbone, "rules": rule,
               "seed": seed, "cap": cap, "needs": needs, "program": program, "source": scene["path"], "options": options,
               "settings": settings, "lpips": lpips[0] if lpips else None, "key": key,
               "pictures": cap is None and seed == seeds[0]}
        ids[scene["name"], backbone, rule if cap is None else None, seed] = run["id"]
        runs.append(run)

    for scene in scenes:
        for backbone in backbones:
            for seed in seeds:
                for rule in rules:
                    add(scene, backbone, rule, seed, None)
    for scene in scenes:
        for backbone in backbones:
            for seed in seeds:
                for rule in capped:
                    for cap in caps:
                        if cap != rule:
                            add(scene, backbone, rule, seed, cap)
    return runs
