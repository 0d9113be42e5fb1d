# SPDX-License-Identifier: Apache-2.0
"""scripts/suite: statistics against known values, plan, pictures and tables, and a small suite from end to end.

SPLATBOOST_BIN names the folder with the built `splatboost` (default: build/release/bin). Tests that need Snakemake are
skipped where there is none; scripts/test installs it.
"""
import json
import math
import os
import pathlib
import shutil
import signal
import stat
import struct
import subprocess
import sys
import time
import zlib

import pytest

ROOT = pathlib.Path(__file__).resolve().parents[2]
SUITE = ROOT / "scripts" / "suite"
PROGRAM = pathlib.Path(os.environ.get("SPLATBOOST_BIN", ROOT / "build/release/bin")) / "splatboost"
sys.path.insert(0, str(SUITE))
import page  # noqa: E402
import plan as planning  # noqa: E402
import png  # noqa: E402
import stats  # noqa: E402
import summary  # noqa: E402


# --- statistics -------------------------------------------------------------------------------------------------------

def test_mean_and_standard_error_of_known_samples():
    assert stats.mean([1, 2, 6]) == 3
    assert stats.standard_error([1, 2, 6]) == pytest.approx(math.sqrt((4 + 1 + 9) / 2 / 3))
    assert stats.mean([]) is None and stats.standard_error([5]) is None
    assert stats.estimate([2, None, 4]) == {"mean": 3, "error": 1, "count": 2}


def test_geometric_mean():
    assert stats.geometric_mean([0.5, 2]) == pytest.approx(1)
    assert stats.geometric_mean([1, 10, 100]) == pytest.approx(10)
    assert stats.geometric_mean([]) is None
    for bad in ([1, 0], [1, -2], [float("nan")]):
        with pytest.raises(ValueError):
            stats.geometric_mean(bad)


def test_pairs_are_of_equal_seed():
    values, reference = {0: 30.0, 1: 31.0, 2: None}, {1: 29.0, 2: 5.0, 3: 7.0}
    assert stats.paired(values, reference, lambda a, b: a - b) == [2.0]


def test_paired_differences_have_a_smaller_error_than_the_values():
    ours, published = {0: 30.0, 1: 33.0}, {0: 29.0, 1: 32.2}
    difference = stats.estimate(stats.paired(ours, published, lambda a, b: a - b))
    assert difference["mean"] == pytest.approx(0.9) and difference["error"] == pytest.approx(0.1)
    assert stats.estimate(ours.values())["error"] == pytest.approx(1.5)


def test_mean_over_scenes_carries_the_error_of_the_seeds():
    whole = stats.mean_of_estimates([{"mean": 1, "error": 0.3, "count": 3}, {"mean": -3, "error": 0.4, "count": 3}])
    assert whole["mean"] == -1 and whole["error"] == pytest.approx(0.25) and whole["count"] == 2
    assert stats.mean_of_estimates([{"mean": 1, "error": None, "count": 1}])["error"] is None
    assert stats.mean_of_estimates([])["mean"] is None


def test_worst_scene():
    estimates = {"a": {"mean": 0.2}, "b": {"mean": -0.7}, "c": {"mean": None}, "d": {"mean": -0.1}}
    assert stats.worst(estimates) == ("b", {"mean": -0.7})
    assert stats.worst({"c": {"mean": None}}) is None


def test_quality_on_a_curve():
    curve = [(10000, 30.0), (100, 20.0), (1000, 26.0), (1000, 24.0)]
    assert stats.on_curve(curve, 1000) == 25.0
    assert stats.on_curve(curve, 10 ** 2.5) == pytest.approx(22.5)  # interpolated in the logarithm
    assert stats.on_curve(curve, 100) == 20.0 and stats.on_curve(curve, 10000) == 30.0
    assert stats.on_curve(curve, 99) is None and stats.on_curve(curve, 10001) is None and stats.on_curve([], 5) is None


# --- the plan ---------------------------------------------------------------------------------------------------------

RULES = {"published": {"label": "published", "options": ["--no-boost"]}, "default": {"label": "SplatBoost", "options": []},
         "paper": {"label": "paper", "options": ["--paper"], "paper": True, "settings": {"boost": {"tau": 0.1, "views": 10}}}}


def runs_of(scene=None, **changes):
    what = {"scenes": [{"name": "a", "group": "g", "path": "/data/a", "print": "1", "options": ["-r", "2"], **(scene or {})}],
            "seeds": [0], "rules": RULES, "backbones": ["vanilla"], "caps": [], "capped": ["published"],
            "common": ["--threads", "2"], "programs": {None: ("/bin/p", "hash")}, "lpips": None, **changes}
    return planning.make_runs(**what)


def test_an_id_follows_from_what_determines_the_run_and_from_nothing_else():
    first = runs_of()[0]["id"]
    assert runs_of({"path": "/elsewhere/a", "name": "b"}, programs={None: ("/other/p", "hash")})[0]["id"] == first
    ids = [first, runs_of()[1]["id"]] + [changed[0]["id"] for changed in (
        runs_of({"print": "2"}), runs_of({"options": ["-r", "4"]}), runs_of(seeds=[1]), runs_of(backbones=["mip-splatting"]),
        runs_of(common=["--threads", "1"]), runs_of(programs={None: ("/bin/p", "new")}), runs_of(lpips=("/x.onnx", "7")))]
    assert len(set(ids)) == len(ids)


def test_another_program_for_published_leaves_its_runs_valid():
    kept = {"published": ("/kept", "old")}
    before = runs_of(programs={None: ("/bin/p", "1"), **kept})
    after = runs_of(programs={None: ("/bin/p", "2"), **kept})
    assert before[0]["id"] == after[0]["id"] and before[1]["id"] != after[1]["id"]


def test_capped_runs_wait_for_the_run_whose_number_they_take():
    runs = runs_of(seeds=[0, 1], caps=[0.3, "default"])
    assert [run["cap"] for run in runs] == [None] * 6 + [0.3, "default"] * 2
    uncapped = {(run["rules"], run["seed"]): run["id"] for run in runs if run["cap"] is None}
    for run in runs[6:]:
        assert run["needs"] == uncapped["published" if run["cap"] == 0.3 else "default", run["seed"]]
    assert [run["pictures"] for run in runs] == [True] * 3 + [False] * 7


def test_settings_of_a_scene_join_those_of_a_rule_set_of_the_paper():
    runs = {run["rules"]: run for run in runs_of({"paper_settings": {"boost": {"tau": 0.06}}})}
    assert runs["paper"]["settings"] == {"boost": {"tau": 0.06, "views": 10}}
    assert runs["published"]["settings"] == {} and RULES["paper"]["settings"]["boost"]["tau"] == 0.1


def test_a_rule_set_that_the_program_does_not_know_is_left_out():
    rules, left_out = planning.choose_rules(["published", "literal", "default"], {"--no-boost"})
    assert list(rules) == ["published", "default"] and left_out == ["rule set literal: this program has no --literal"]
    rules, left_out = planning.choose_rules(["literal"], {"--literal"})
    assert list(rules) == ["literal"] and not left_out


def test_a_settings_file_is_a_rule_set(tmp_path):
    (tmp_path / "mine.json").write_text('{"boost": {"tau_d": 1}}')
    rules, _ = planning.choose_rules([str(tmp_path / "mine.json")], set())
    assert rules["mine"]["settings"] == {"boost": {"tau_d": 1}}


def test_a_fingerprint_tells_scenes_apart_and_ignores_what_trainers_write(tmp_path):
    (tmp_path / "sparse").mkdir()
    (tmp_path / "sparse/cameras.bin").write_bytes(b"abc")
    first = planning.fingerprint(tmp_path)
    (tmp_path / "sparse/points3D.ply").write_bytes(b"by another trainer")
    assert planning.fingerprint(tmp_path) == first
    (tmp_path / "sparse/cameras.bin").write_bytes(b"abd")
    assert planning.fingerprint(tmp_path) != first


def test_scenes_of_the_lists():
    assert [s["name"] for s in planning.own_scenes(SUITE / "scenes.json", None, "full")] == ["synth-room", "synth-street"]
    groups = {}
    for scene in planning.own_scenes(SUITE / "scenes.json", "/data", "quick"):
        groups.setdefault(scene["group"], []).append(scene["name"])
    assert sorted(groups["develop"]) == ["bonsai", "fox", "lego", "room", "stitch", "synth-room"]
    assert sorted(groups["report"]) == ["bird", "dtu_scan24", "facade", "fern", "plush", "synth-street"]
    assert len(planning.paper_scenes("/data", "full")) == 13


def test_scenes_of_the_paper_are_found_in_the_usual_folders(tmp_path):
    (tmp_path / "360_v2/garden/sparse").mkdir(parents=True)
    scenes = {scene["name"]: scene for scene in planning.paper_scenes(tmp_path, "full")}
    assert scenes["mip-nerf-360/garden"]["path"] == str(tmp_path / "360_v2/garden")
    assert scenes["mip-nerf-360/garden"]["options"] == ["-i", "images_4"]
    assert scenes["mip-nerf-360/kitchen"]["options"] == ["-i", "images_2"] and scenes["deep-blending/playroom"]["options"] == []


# The paper's own means over the scenes of a dataset (its Table 1): minutes, PSNR, SSIM, LPIPS, millions. None stands for three
# that are not the means of its Table 17: 1.93 min (the scenes give 1.94), 3.58 min (3.48) and 1.15 M (1.16).
TABLE_1 = {("mip-nerf-360", "3DGS"): (20.93, 27.53, .812, .221, 2.63), ("mip-nerf-360", "FastGS"): (None, 27.56, .797, .261, .40),
           ("mip-nerf-360", "FastGS-Big"): (None, 27.93, .820, .216, None), ("deep-blending", "3DGS"): (19.77, 29.71, .903, .241, 2.46),
           ("deep-blending", "FastGS"): (1.28, 30.03, .901, .270, .22), ("deep-blending", "FastGS-Big"): (2.00, 30.12, .907, .243, .65),
           ("tanks-and-temples", "3DGS"): (11.34, 23.71, .850, .170, 1.57), ("tanks-and-temples", "FastGS"): (1.32, 24.15, .839, .210, .24),
           ("tanks-and-temples", "FastGS-Big"): (2.03, 24.39, .855, .175, .54)}


@pytest.mark.parametrize("dataset,method", TABLE_1)
def test_rows_of_the_paper_give_its_means(dataset, method):
    rows = [row for row in planning.read_json(SUITE / "paper.json")["rows"]
            if (row["dataset"], row["method"]) == (dataset, method) and row["scene"]]
    scenes = next(d for d in planning.read_json(SUITE / "datasets.json")["datasets"] if d["name"] == dataset)["scenes"]
    assert sorted(row["scene"] for row in rows) == sorted(scenes)
    # The paper rounds the values of scenes and the means.
    for key, mean, rounding in zip(("minutes", "psnr", "ssim", "lpips", "millions"), TABLE_1[dataset, method],
                                   (.011, .0101, .00101, .00101, .0101)):
        if mean is not None:
            assert stats.mean(row[key] for row in rows) == pytest.approx(mean, abs=rounding), key


def test_rule_sets_of_the_papers_tables_exist():
    rules = planning.read_json(SUITE / "rules.json")
    for row in planning.read_json(SUITE / "paper.json")["rows"]:
        assert row["rules"] is None or row["rules"] in rules
    for table in planning.read_json(SUITE / "datasets.json")["tables"].values():
        assert set(table["rules"]) <= rules.keys()


# --- pictures ---------------------------------------------------------------------------------------------------------

def png_file(path, rows, channels, filters):
    """A PNG whose rows are filtered as `filters` say, by the definition of each filter."""
    width, packed, above = len(rows[0]) // channels, b"", bytes(len(rows[0]))
    for row, kind in zip(rows, filters):
        line = bytearray()
        for i, value in enumerate(row):
            a, c = (row[i - channels], above[i - channels]) if i >= channels else (0, 0)
            b = above[i]
            nearest = min((abs(b - c), 0, a), (abs(a - c), 1, b), (abs(a + b - 2 * c), 2, c))[2]
            line.append((value - [0, a, b, (a + b) // 2, nearest][kind]) % 256)
        packed += bytes([kind]) + line
        above = row
    kinds = {1: 0, 3: 2, 4: 6}
    header = struct.pack(">IIBBBBB", width, len(rows), 8, kinds[channels], 0, 0, 0)
    with open(path, "wb") as out:
        out.write(b"\x89PNG\r\n\x1a\n")
        for kind, data in ((b"IHDR", header), (b"IDAT", zlib.compress(packed)), (b"IEND", b"")):
            out.write(struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data)))


def noise(length, seed):
    return bytes((seed * 7919 + i * i * 31 + i * 17) % 251 for i in range(length))


@pytest.mark.parametrize("channels", [1, 3, 4])
def test_reads_pictures_of_every_filter(channels, tmp_path):
    rows = [noise(5 * channels, seed) for seed in range(6)]
    png_file(tmp_path / "a.png", rows, channels, [0, 1, 2, 3, 4, 4])
    picture = png.read(tmp_path / "a.png")
    assert (picture.width, picture.height) == (5, 6)
    for row, line in zip(rows, picture.rows):
        expected = [row[channels * x + (c if channels > 1 else 0)] for x in range(5) for c in range(3)]
        assert list(line) == expected


def test_a_picture_written_is_read_again(tmp_path):
    import base64
    picture = png.Picture(4, [bytearray(noise(12, seed)) for seed in range(3)])
    (tmp_path / "b.png").write_bytes(base64.b64decode(picture.data_uri().split(",")[1]))
    assert png.read(tmp_path / "b.png").rows == picture.rows


def test_damaged_pictures_are_refused(tmp_path):
    (tmp_path / "no.png").write_bytes(b"text")
    with pytest.raises(ValueError, match="not a PNG"):
        png.read(tmp_path / "no.png")
    png_file(tmp_path / "c.png", [noise(6, 1)] * 2, 3, [0, 0])
    data = (tmp_path / "c.png").read_bytes()
    (tmp_path / "c.png").write_bytes(data.replace(struct.pack(">II", 2, 2), struct.pack(">II", 2, 3)))
    with pytest.raises(ValueError, match="damaged"):
        png.read(tmp_path / "c.png")


def test_the_window_is_where_the_second_render_is_worse():
    def flat(value):
        return png.Picture(12, [bytearray([value] * 36) for _ in range(12)])
    truth, reference, render = flat(100), flat(90), flat(90)
    for y in range(12):
        reference.rows[y][:12] = bytes([0] * 12)  # the reference is wrong on the left too
        render.rows[y][:12] = bytes([0] * 12)
    for y in range(8, 12):
        render.rows[y][24:36] = bytes([20] * 12)
    assert png.worst_window(truth, reference, render, 4, 4) == (8, 8)


# --- tables -----------------------------------------------------------------------------------------------------------

def made_up_suite():
    """Two scenes, two seeds, rules published and default, and published with default's number of primitives as cap."""
    runs = []
    for scene, group, gain in (("a", "develop", 0.5), ("b", "report", -1.0)):
        for seed in (0, 1):
            for rules, cap, psnr, number, time in (("published", None, 30.0, 1000, 100.0), ("default", None, 30.0 + gain, 250, 40.0),
                                                   ("published", "default", 28.0, 250, 60.0)):
                runs.append({"id": "x", "scene": scene, "group": group, "backbone": "vanilla", "rules": rules, "seed": seed, "cap": cap,
                             "command": "splatboost train", "psnr": psnr + seed + (0.1 * seed if rules == "default" else 0),
                             "psnr_beta1": psnr, "ssim": 0.9, "lpips": None, "primitives": number, "train_seconds": time,
                             "peak_memory_bytes": 2 ** 30, "fps": 100.0, "storage_bytes": 1, "iterations": 10, "machine": "<m>",
                             "device": "cpu", "threads": 2, "date": "2026"})
    rows = summary.by_scene(runs, "published")
    return {"command": "scripts/suite/run", "date": "2026-01-01", "commit": None, "machines": ["<m>"], "reference": "published",
            "rules": {name: RULES[name] for name in ("published", "default")}, "left_out": [], "missing": ["b, <late>"],
            "overall": summary.overall(rows), "by_scene": rows, "frontier": summary.frontier(runs, rows, "published"),
            "paper": {"source": "paper", "tables": []}, "runs": runs}


def test_overall_figures_of_a_known_suite():
    suite = made_up_suite()
    whole, develop, report = suite["overall"]
    assert (whole["group"], develop["group"], report["group"]) == (None, "develop", "report")
    # Differences of the seeds are 0.5, 0.6 in one scene and −1.0, −0.9 in the other.
    assert whole["differences"]["psnr"]["mean"] == pytest.approx(-0.2)
    assert whole["differences"]["psnr"]["error"] == pytest.approx(0.05 / math.sqrt(2))
    assert whole["worst"]["scene"] == "b" and whole["worst"]["mean"] == pytest.approx(-0.95)
    assert whole["ratios"]["primitives"] == pytest.approx(0.25) and whole["ratios"]["train_seconds"] == pytest.approx(0.4)
    assert whole["differences"]["lpips"]["mean"] is None
    assert [row["above"]["mean"] for row in suite["frontier"]] == [pytest.approx(2.55), pytest.approx(1.05)]


def test_frontier_falls_back_on_the_curve():
    suite = made_up_suite()
    runs = [dict(run, cap=0.25 if run["cap"] else None, primitives=160 if run["cap"] else run["primitives"]) for run in suite["runs"]]
    rows = summary.by_scene(runs, "published")
    above = summary.frontier(runs, rows, "published")[0]["above"]
    expected = 28.5 + 2.0 * math.log(250 / 160) / math.log(1000 / 160)
    assert above["mean"] == pytest.approx(31.05 - expected) and above["error"] is None


def test_page_and_tables_say_what_was_measured():
    suite = made_up_suite()
    text = page.markdown(suite)
    assert "| SplatBoost | all (2) | −0.20 ± 0.04 | −0.95 ± 0.05 (b) |" in text and "0.25× | 0.40× | 1.00× |" in text
    assert "LPIPS" not in text  # not measured
    html = page.html(suite, page.frontier_svg(suite), [("a", [("truth", "data:,")])])
    assert "<td class=bad>−0.95 ± 0.05</td>" in html and "<td class=good>+0.55 ± 0.05</td>" in html
    assert "&lt;late&gt;" in html and "<m>" not in html and "http://" not in html.replace("http://www.w3.org/2000/svg", "")
    assert html.count("<circle") == 2 + 2 * 3


# --- end to end -------------------------------------------------------------------------------------------------------

def small_list(path):
    size = ["--width", "64", "--height", "48", "--views", "12", "--points", "200"]
    scenes = [{"name": name, "group": group, "synth": {"full": ["--scene", kind, *size], "quick": ["--scene", kind, *size]}}
              for name, group, kind in (("room", "develop", "room"), ("street", "report", "street"))]
    path.write_text(json.dumps({"scenes": scenes}))
    return path


def run_suite(*words, **environment):
    return subprocess.run([SUITE / "run", *map(str, words)], capture_output=True, text=True, timeout=300,
                          env={**os.environ, **environment})


def snakemake():
    for candidate in (os.environ.get("SNAKEMAKE"), shutil.which("snakemake"), str(ROOT / "build/suite-venv/bin/snakemake")):
        if candidate and os.access(candidate, os.X_OK):
            return candidate
    pytest.skip("there is no Snakemake (scripts/test installs it in build/suite-venv)")


def test_all_threads_are_those_of_the_cpus_that_it_may_use(tmp_path):
    if not PROGRAM.exists():
        pytest.skip(f"{PROGRAM} is not built")
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(before)})
    try:
        run_suite("--scene-list", small_list(tmp_path / "scenes.json"), "--out", tmp_path / "out", "--page")  # writes the plan
    finally:
        os.sched_setaffinity(0, before)
    assert json.loads((tmp_path / "out/plan.json").read_text())["threads"] == 1


def test_a_small_suite_from_end_to_end(tmp_path):
    if not PROGRAM.exists():
        pytest.skip(f"{PROGRAM} is not built")
    snakemake()
    words = ["--scene-list", small_list(tmp_path / "scenes.json"), "--out", tmp_path / "out", "--seeds", 0, 1, "--iterations", 40,
             "--rules", "published", "default", "--threads", 1]
    done = run_suite(*words)
    assert done.returncode == 0, done.stderr
    suite = json.loads((tmp_path / "out/suite.json").read_text())
    assert len(suite["runs"]) == 8 and not suite["missing"] and len(suite["overall"]) == 3
    assert {run["seed"] for run in suite["runs"]} == {0, 1} and {run["iterations"] for run in suite["runs"]} == {40}
    assert str(tmp_path) not in json.dumps(suite["runs"]) + suite["command"]
    html = (tmp_path / "out/suite.html").read_text()
    assert html.count("data:image/png") == 6  # truth and two rule sets of two scenes
    assert "ΔPSNR" in (tmp_path / "out/suite.md").read_text()

    # Running the same suite again trains nothing; a cap only adds its own runs, which respect it.
    records = {path: path.stat().st_mtime_ns for path in (tmp_path / "out/runs").glob("*/record.json")}
    assert len(records) == 8
    done = run_suite(*words, "--caps", 0.5, "--scenes", "room")
    assert done.returncode == 0 and "6 runs, 4 of them already done" in done.stderr, done.stderr
    assert {path: path.stat().st_mtime_ns for path in records} == records
    suite = json.loads((tmp_path / "out/suite.json").read_text())
    number = {(run["scene"], run["seed"]): run["primitives"] for run in suite["runs"]
              if run["rules"] == "published" and run["cap"] is None}
    capped = [run for run in suite["runs"] if run["cap"] == 0.5]
    assert len(capped) == 2
    for run in capped:
        assert run["primitives"] <= round(0.5 * number[run["scene"], run["seed"]])


def test_a_run_that_fails_leaves_the_others_and_a_page(tmp_path):
    if not PROGRAM.exists():
        pytest.skip(f"{PROGRAM} is not built")
    snakemake()
    (tmp_path / "broken.json").write_text('{"boost": {"no such rule": 1}}')
    done = run_suite("--scene-list", small_list(tmp_path / "scenes.json"), "--out", tmp_path / "out", "--seeds", 0, "--iterations", 20,
                     "--scenes", "room", "--threads", 1, "--rules", "published", tmp_path / "broken.json")
    assert done.returncode == 1
    assert "broken, seed 0: FAILED with status 2" in done.stderr and "no such rule" in done.stderr
    suite = json.loads((tmp_path / "out/suite.json").read_text())
    assert [run["rules"] for run in suite["runs"]] == ["published"] and suite["missing"] == ["room, vanilla, broken, seed 0"]


def idle_program(folder):
    """Stands for `splatboost` where nothing is trained."""
    program = folder / "splatboost"
    program.write_text("#!/bin/sh\necho --no-boost\n")
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    return program


@pytest.mark.parametrize("words,message", [
    (["--scenes", "nowhere"], "unknown scene or group 'nowhere'"), (["--rules", "wat"], "unknown rule set 'wat'"),
    (["--rules", "none.json"], "none.json: No such file"), (["--caps", "-1"], "neither a share"),
    (["--caps", "inf"], "neither a share"), (["--caps", "nan"], "neither a share"),
    (["--rules", "default", "--caps", "0.5"], "add published"), (["--table", "17"], "needs --data"),
    (["--own", "/nonexistent"], "no such folder"), (["--program", "/nonexistent"], "is not a program")])
def test_bad_input_is_one_line(words, message, tmp_path):
    done = run_suite("--out", tmp_path / "out", "--program", idle_program(tmp_path), "--dry-run", *words)
    assert done.returncode == 2 and message in done.stderr, done.stderr
    assert len([line for line in done.stderr.splitlines() if "left out" not in line]) == 1
    assert not (tmp_path / "out/runs").exists()


@pytest.mark.parametrize("option,content,message", [
    ("--scene-list", "[1]", "must hold a JSON object"), ("--scene-list", '{"scenes": 3}', "scenes must be a list"),
    ("--scene-list", '{"scenes": [{"name": "a"}]}', "a scene without 'group'"), ("--rules", "[1]", "must hold a JSON object")])
def test_a_file_of_another_form_is_one_line(option, content, message, tmp_path):
    file = tmp_path / "file.json"
    file.write_text(content)
    done = run_suite("--out", tmp_path / "out", "--program", idle_program(tmp_path), "--dry-run", option, file)
    assert done.returncode == 2 and f"{file}: {message}" in done.stderr, done.stderr
    assert len(done.stderr.splitlines()) == 1, done.stderr


def test_an_out_that_is_a_file_is_one_line(tmp_path):
    (tmp_path / "out").write_text("")
    done = run_suite("--out", tmp_path / "out", "--dry-run")
    assert done.returncode == 2 and "cannot be made a folder" in done.stderr and len(done.stderr.splitlines()) == 1


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
@pytest.mark.parametrize("early", [False, True])  # the first moment: from the started Snakemake itself
def test_an_interrupt_ends_the_current_run(tmp_path, name, early):
    program, workflow = tmp_path / "splatboost", tmp_path / "snakemake"
    program.write_text("#!/bin/sh\necho --no-boost\n[ \"$1\" != synth ] || mkdir -p \"$2\"\n")
    told = f'echo $$ > "{tmp_path}/pid.part"; mv "{tmp_path}/pid.part" "{tmp_path}/pid"'
    if early:
        told = f'echo $$ > "{tmp_path}/pid"; kill -{name[3:]} $PPID'
    workflow.write_text(f"#!/bin/sh\n{told}; exec sleep 100\n")
    for file in (program, workflow):
        file.chmod(0o755)
    process = subprocess.Popen([sys.executable, ROOT / "scripts/suite/run", "--quick", "--out", tmp_path / "out", "--program", program,
                                "--rules", "published"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
                               env={**os.environ, "SNAKEMAKE": str(workflow)},
                               # Tests in the background or under nohup inherit ignored signals.
                               preexec_fn=lambda: signal.signal(signal.Signals[name], signal.SIG_DFL))
    while not (tmp_path / "pid").exists() and process.poll() is None:
        time.sleep(0.05)
    if not early:
        process.send_signal(signal.Signals[name])
    assert process.communicate(timeout=60)[1].endswith("\nsuite: interrupted; the same command continues\n")
    assert process.returncode == 130
    with pytest.raises(ProcessLookupError):
        os.kill(int((tmp_path / "pid").read_text()), 0)


def test_help():
    done = run_suite("--help")
    assert done.returncode == 0 and "--data DIR" in done.stdout and "--quick" in done.stdout
