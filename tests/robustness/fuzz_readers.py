#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Feeds damaged files to every command of the program that reads them, under limits on memory and time.

usage: fuzz_readers.py [--cases N] [--seed S] [--target NAME …] [--first N] [--jobs N] [--keep FOLDER] [--json FILE]

The rule is that of broken_rule(): exit 0, 1 or 2, one clear line. Case N of a target and seed is always the same;
--first starts there. --keep gets the damaged file of each case that broke the rule.
"""

import argparse
import concurrent.futures
import json
import pathlib
import random
import re
import shutil
import struct
import sys
import tempfile

import attacks
from attacks import Totals, broken_rule, run, run_well
from inject_faults import PLY

sys.path.append(str(attacks.ROOT / "tests/python"))
import miniature_host  # noqa: E402

NUMBERS = [b"0", b"-1", b"1", b"nan", b"inf", b"-inf", b"1e400", b"3e38", b"-3e38", b"1e-45", b"1e19", b"2147483647",
           b"2147483648", b"4294967295", b"-2147483649", b"9223372036854775808", b"18446744073709551616", b"0x10", b"",
           b"true", b"null", b'"a"', b"[]", b"{}", b"9" * 400, b"\xff\xfe", b"\x1b[31m", b"\x00", b"../../etc/passwd"]
WORDS = [struct.pack("<I", n) for n in (0, 1, 2, 0x7fffffff, 0x80000000, 0xffffffff, 0x7fc00000, 0x7f800000, 0xff7fffff,
                                        0x00000001)] + \
        [struct.pack("<Q", n) for n in (0, 1, 1 << 31, 1 << 32, 1 << 40, 1 << 61, 1 << 63, (1 << 64) - 1,
                                        0x7ff8000000000000, 0x7fefffffffffffff)]
TOKEN = re.compile(rb"[^\s,:\[\]{}\"]+")


def flip(data, chance):
    for _ in range(chance.choice([1, 1, 2, 8, 64])):
        data[chance.randrange(len(data))] ^= 1 << chance.randrange(8)


def overwrite(data, chance):
    at = chance.randrange(len(data))
    length = chance.choice([1, 2, 4, 8, 16, 100])
    data[at:at + length] = chance.randbytes(min(length, len(data) - at))


def truncate(data, chance):
    del data[chance.randrange(len(data)):]


def insert(data, chance):
    at = chance.randrange(len(data) + 1)
    data[at:at] = chance.randbytes(chance.choice([1, 3, 4, 8, 1000]))


def remove(data, chance):
    at = chance.randrange(len(data))
    del data[at:at + chance.choice([1, 3, 4, 8, 100])]


def repeat(data, chance):
    at = chance.randrange(len(data))
    part = data[at:at + chance.choice([1, 4, 32, 500])]
    data[at:at] = part * chance.choice([1, 2, 50])


def swap(data, chance):
    """Swaps two parts of the same length."""
    length = min(chance.choice([1, 4, 8, 32]), len(data) // 2)
    a = chance.randrange(len(data) - 2 * length + 1)
    b = chance.randrange(a + length, len(data) - length + 1)
    data[a:a + length], data[b:b + length] = data[b:b + length], data[a:a + length]


def word(data, chance):
    """Replaces some bytes by an extreme number."""
    value = chance.choice(WORDS)
    if len(data) > len(value):
        at = chance.randrange(len(data) - len(value))
        at -= at % chance.choice([1, 4])
        data[at:at + len(value)] = value


def token(data, chance):
    found = list(TOKEN.finditer(data))
    if found:
        one = chance.choice(found)
        data[one.start():one.end()] = chance.choice(NUMBERS)


def swap_tokens(data, chance):
    found = list(TOKEN.finditer(data))
    if len(found) > 1:
        a, b = sorted(chance.sample(range(len(found)), 2))
        a, b = found[a], found[b]
        data[:] = data[:a.start()] + b.group() + data[a.end():b.start()] + a.group() + data[b.end():]


def line(data, chance):
    lines = data.split(b"\n")
    at = chance.randrange(len(lines))
    change = chance.randrange(4)
    if change == 0:
        del lines[at]
    elif change == 1:
        lines.insert(at, lines[chance.randrange(len(lines))])
    elif change == 2:
        lines[at] = b""
    else:
        lines[at] = lines[at] + b" " + bytes(lines[at]) * chance.choice([1, 100])
    data[:] = b"\n".join(lines)


def deep(data, chance):
    at = chance.randrange(len(data))
    data[at:at] = chance.choice([b"[", b"{\"a\":"]) * chance.choice([10, 100_000])


BYTES = [flip, overwrite, truncate, insert, remove, repeat, swap, word, word, word]
TEXT = [*BYTES[:-3], token, token, token, token, swap_tokens, line, line]
JSON = [*BYTES[:-3], token, token, token, token, token, swap_tokens, line, deep]
HEAD_AND_BYTES = [*BYTES, token, token, line]


def damage(data, mutations, chance):
    data = bytearray(data)
    for _ in range(chance.choice([1, 1, 1, 2, 4])):
        if data:
            chance.choice(mutations)(data, chance)
    return bytes(data)


def damage_json(data, chance):
    """Well-formed JSON with one value changed."""
    document = json.loads(data)
    places = []

    def walk(value):
        for key, inner in (value.items() if isinstance(value, dict) else enumerate(value)):
            places.append((value, key))
            if isinstance(inner, (dict, list)):
                walk(inner)

    walk(document)
    if places:
        owner, key = chance.choice(places)
        values = [0, -1, 1, 0.5, 1e300, -1e300, 1e-300, 2**31, 2**63, 2**64, True, None, "", "a", "x" * 5000, "é\n\u0000",
                  [], {}, [[]], {"a": 1}, "../..", float("nan"), [1, 2, 3], chance.choice(places)[0]]
        change = chance.randrange(4)
        if change == 0 and isinstance(owner, dict):
            owner[chance.choice(["", "a", key + "x", key.upper()])] = owner.pop(key)
        elif change == 1:
            del owner[key]
        else:
            owner[key] = json.loads(json.dumps(chance.choice(values)))
    return json.dumps(document).encode()


def damage_checkpoint(data, chance):
    """Damages entries; most results have valid checksums, so that the code behind the check is reached."""
    if chance.random() < 0.3:
        return damage(data, BYTES, chance)
    entries = attacks.read_archive(data)
    name = chance.choice(list(entries))
    change = chance.randrange(8)
    if change == 0:
        del entries[name]
    elif change == 1:
        entries[name] = entries[chance.choice(list(entries))]
    elif change == 2:
        entries[name[:-1] or "a"] = entries.pop(name)
    elif name == "trainer" or change == 3:
        entries["trainer"] = b"t" + damage_json(entries.get("trainer", b"t{}")[1:], chance)
    else:
        entries[name] = damage(entries[name], BYTES, chance) or b"f"
    return attacks.archive_bytes(entries)


def damage_packed(data, chance):
    """Like damage_checkpoint(). After the magic: the listing's length and the listing, each with its checksum."""
    if chance.random() < 0.3:
        return damage(data, BYTES, chance)
    start = data.index(b"{")
    (length,) = struct.unpack_from("<Q", data, start - 16)
    listing = data[start:start + length]
    listing_after = damage_json(listing, chance) if chance.random() < 0.8 else damage(listing, TEXT, chance)
    size = struct.pack("<Q", len(listing_after))
    return data[:start - 16] + size + struct.pack("<Q", attacks.checksum(size)) + listing_after + \
        struct.pack("<Q", attacks.checksum(listing_after)) + data[start + length + 8:]


def mostly_json(data, chance):
    return damage_json(data, chance) if chance.random() < 0.5 else damage(data, JSON, chance)


def by(mutations):
    return lambda data, chance: damage(data, mutations, chance)


RUN = ["--iterations", "1", "--threads", "1", "--quiet"]


class Target:
    """Commands that read one of `files`. Each case runs in a copy of the folder of prepare()."""

    def __init__(self, files, how, commands):
        self.files, self.how, self.commands = files, how, commands


def train(source, *options):
    return ["train", "-s", source, "-m", "out", *RUN, *options]


def of_model(model):
    return [["render", "-m", model, "-o", "out", "--threads", "1", "--quiet"],
            ["eval", "-m", model, "--threads", "1", "--quiet"],
            ["render", "-m", model, "-o", "out", "--orbit", "1", "--threads", "1", "--quiet"]]


def readers_of(source):
    return [train(source), train(source, "--eval"), ["pack", source, "out.sbscene"], train(source, "--backbone", "octree-gs"),
            [*of_model("run")[0], "-s", source], ["compare", "-s", source, "-m", "out", *RUN]]


BACKBONES = ["vanilla", "mip-splatting", "scaffold-gs", "octree-gs", "convex-splatting"]
WITH_NETS = ["scaffold-gs", "octree-gs"]
TARGETS = {
    "COLMAP binary": Target([f"colmap/sparse/0/{name}.bin" for name in ("cameras", "images", "points3D")], by(BYTES),
                            readers_of("colmap")),
    "COLMAP text": Target([f"text/sparse/0/{name}.txt" for name in ("cameras", "images", "points3D")], by(TEXT),
                          readers_of("text")),
    "photo": Target(["colmap/images/0001.png", "colmap/images/0003.png"], by(BYTES), readers_of("colmap")),
    "transforms.json": Target(["blender/transforms_train.json", "blender/transforms_test.json", "nerfstudio/transforms.json"],
                              mostly_json, {"blender": readers_of("blender"), "nerfstudio": readers_of("nerfstudio")}),
    "capture": Target([f"capture/{name}" for name in ("dataset.json", "metadata.json", "scene.json", "camera/0001.json")],
                      mostly_json, readers_of("capture")),
    "array of numpy": Target(["capture/points.npy", "rig/poses_bounds.npy"], by(HEAD_AND_BYTES),
                             {name: readers_of(name) for name in ("capture", "rig")}),
    "points3d.ply": Target(["nerfstudio/points3d.ply"], by(HEAD_AND_BYTES), readers_of("nerfstudio")),
    "packed scene": Target(["packed.sbscene"], damage_packed, readers_of("packed.sbscene")),
    "model": Target([f"of-{name}/{PLY}" for name in BACKBONES], by(HEAD_AND_BYTES),
                    {f"of-{name}": of_model(f"of-{name}") for name in BACKBONES}),
    "nets": Target([f"of-{name}/point_cloud/iteration_4/nets.bin" for name in WITH_NETS], by(BYTES),
                   {f"of-{name}": of_model(f"of-{name}") for name in WITH_NETS}),
    "convexes": Target([f"of-convex-splatting/point_cloud/iteration_4/{name}" for name in ("point_cloud.ply", "convexes.bin")],
                       by(HEAD_AND_BYTES), [*of_model("of-convex-splatting"),
                                            ["export", "-m", "of-convex-splatting", "-o", "out.glb"]]),
    "config.json of a run": Target([f"of-{name}/config.json" for name in BACKBONES], mostly_json,
                                   {f"of-{name}": of_model(f"of-{name}") for name in BACKBONES}),
    "results.json": Target(["run/results.json"], mostly_json, [of_model("run")[1]]),
    "settings": Target([f"settings/{name}.json" for name in BACKBONES], mostly_json, {"settings": None}),
    "checkpoint": Target([f"of-{name}/checkpoints/iteration_2.ckpt" for name in BACKBONES], damage_checkpoint,
                         {"of-" + name: [["train", "--resume", f"of-{name}/checkpoints/iteration_2.ckpt", "--quiet"]]
                          for name in BACKBONES}),
    "config.json of a checkpoint": Target([f"of-{name}/config.json" for name in BACKBONES], mostly_json,
                                          {"of-" + name: [["train", "--resume", f"of-{name}/checkpoints/iteration_2.ckpt",
                                                           "--iterations", "4", "--quiet"]] for name in BACKBONES}),
    "test list": Target(["list.txt"], by(TEXT), [train("colmap", "--test-list", "list.txt")]),
    "record of a patch": Target(["host/.splatboost/patch.json"], mostly_json,
                                [["patch", name, "host"] for name in ("revert", "verify", "status", "doctor")] +
                                [["patch", "apply", "3dgs", "host"]]),
    "patched file": Target(["host/train.py", "host/arguments/__init__.py"], by(TEXT),
                           [["patch", name, "host"] for name in ("revert", "verify", "status", "doctor")]),
    "file to patch": Target(["plain/train.py", "plain/arguments/__init__.py", "plain/gaussian_renderer/__init__.py"], by(TEXT),
                            [["patch", "apply", "3dgs", "plain"], ["patch", "doctor", "plain"], ["patch", "status", "plain"]]),
    "recipe": Target(["recipes/3dgs/recipe.json"], mostly_json,
                     [["patch", "--recipes", "recipes", "validate", "3dgs"], ["patch", "--recipes", "recipes", "list"],
                      ["patch", "--recipes", "recipes", "show", "3dgs"],
                      ["patch", "--recipes", "recipes", "apply", "3dgs", "plain"]]),
}


def read_colmap(folder):
    """@return (width, height, focal, cx, cy), [(name, quaternion, translation)], [(position, color)] of `synth`'s scene"""
    data = (folder / "cameras.bin").read_bytes()
    _, _, width, height = struct.unpack_from("<IiQQ", data, 8)
    focal, _, cx, cy = struct.unpack_from("<4d", data, 32)
    data = (folder / "images.bin").read_bytes()
    images, at = [], 8
    for _ in range(struct.unpack_from("<Q", data)[0]):
        pose = struct.unpack_from("<7d", data, at + 4)
        end = data.index(b"\0", at + 64)
        images.append((data[at + 64:end].decode(), pose[:4], pose[4:]))
        at = end + 9
    data = (folder / "points3D.bin").read_bytes()
    points, at = [], 8
    for _ in range(struct.unpack_from("<Q", data)[0]):
        points.append((struct.unpack_from("<3d", data, at + 8), struct.unpack_from("<3B", data, at + 32)))
        at += 43 + 8 + 8 * struct.unpack_from("<Q", data, at + 43)[0]
    return (width, height, focal, cx, cy), images, points


def transform_of(quaternion, translation):
    """The OpenGL pose of a camera, as transforms.json has it."""
    w, x, y, z = quaternion
    rotation = [[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]]
    centre = [-sum(rotation[k][i] * translation[k] for k in range(3)) for i in range(3)]
    return [[rotation[0][i], -rotation[1][i], -rotation[2][i], centre[i]] for i in range(3)] + [[0, 0, 0, 1]]


def npy(width, rows):
    header = f"{{'descr': '<f8', 'fortran_order': False, 'shape': ({len(rows)}, {width}), }}\n".encode()
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header + \
        b"".join(struct.pack(f"<{width}d", *row) for row in rows)


def write_moving(work, lens, images, points):
    """Writes the same photos as a capture of Nerfies, one per time, and as a rig of two cameras."""
    width, height, focal, cx, cy = lens
    shutil.copytree(work / "colmap/images", work / "capture/rgb/1x")
    (work / "capture/camera").mkdir()
    names = [pathlib.Path(name).stem for name, _, _ in images]
    for name, (_, q, t) in zip(names, images):
        pose = transform_of(q, t)
        camera = {"orientation": [[pose[c][r] * (1, -1, -1)[r] for c in range(3)] for r in range(3)],
                  "position": [row[3] for row in pose[:3]], "focal_length": focal, "pixel_aspect_ratio": 1.0, "skew": 0.0,
                  "principal_point": [cx, cy], "radial_distortion": [0, 0, 0], "tangential_distortion": [0, 0],
                  "image_size": [width, height]}
        (work / f"capture/camera/{name}.json").write_text(json.dumps(camera))
    (work / "capture/dataset.json").write_text(json.dumps({"ids": names, "train_ids": names[1:], "val_ids": names[:1]}))
    (work / "capture/metadata.json").write_text(json.dumps({n: {"time_id": i} for i, n in enumerate(names)}))
    (work / "capture/scene.json").write_text(json.dumps({"scale": 1.0, "center": [0.0, 0.0, 0.0]}))
    (work / "capture/points.npy").write_bytes(npy(3, [position for position, _ in points]))
    rows = []
    for camera in range(2):
        pose = transform_of(*images[camera][1:])
        rows.append([value for r in range(3) for value in
                     (-pose[r][1], pose[r][0], pose[r][2], pose[r][3], (height, width, focal)[r])] + [0.1, 9.0])
        for frame in range(2):
            folder = work / f"rig/cam{camera}"
            folder.mkdir(parents=True, exist_ok=True)
            shutil.copy(work / "colmap/images" / images[2 * camera + frame][0], folder / f"{frame}.png")
    (work / "rig/poses_bounds.npy").write_bytes(npy(17, rows))


def prepare(work):
    """Writes one valid file of each kind."""
    run_well("synth", "colmap", *attacks.TINY_SCENE, cwd=work)
    (width, height, focal, cx, cy), images, points = read_colmap(work / "colmap/sparse/0")
    sparse = work / "text/sparse/0"
    sparse.mkdir(parents=True)
    shutil.copytree(work / "colmap/images", work / "text/images")
    (sparse / "cameras.txt").write_text(f"# cameras\n1 PINHOLE {width} {height} {focal} {focal} {cx} {cy}\n")
    numbers = lambda values: " ".join(map(repr, values))  # noqa: E731
    (sparse / "images.txt").write_text("# images\n" + "".join(
        f"{i + 1} {numbers(q)} {numbers(t)} 1 {name}\n\n" for i, (name, q, t) in enumerate(images)))
    (sparse / "points3D.txt").write_text("# points\n" + "".join(
        f"{i + 1} {numbers(p)} {numbers(c)} 0.5 1 0 2 1\n" for i, (p, c) in enumerate(points)))
    frames = [{"file_path": f"images/{name}", "transform_matrix": transform_of(q, t)} for name, q, t in images]
    for scene in ("blender", "nerfstudio"):
        shutil.copytree(work / "colmap/images", work / scene / "images")
    for name, part in (("train", frames[:4]), ("test", frames[4:])):
        (work / f"blender/transforms_{name}.json").write_text(json.dumps({"camera_angle_x": 0.9, "frames": part}, indent=1))
    (work / "nerfstudio/points3d.ply").write_bytes(
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n".encode() +
        b"".join(f"property float {axis}\n".encode() for axis in "xyz") +
        b"".join(f"property uchar {color}\n".encode() for color in ("red", "green", "blue")) + b"end_header\n" +
        b"".join(struct.pack("<3f3B", *p, *c) for p, c in points))
    (work / "nerfstudio/transforms.json").write_text(json.dumps(
        {"w": width, "h": height, "fl_x": focal, "fl_y": focal, "cx": cx, "cy": cy, "ply_file_path": "points3d.ply",
         "frames": frames}, indent=1))
    write_moving(work, (width, height, focal, cx, cy), images, points)
    run_well("pack", "colmap", "packed.sbscene", cwd=work)
    (work / "list.txt").write_text("".join(f"{name}\n" for name, _, _ in images[::3]))
    (work / "settings").mkdir()
    for backbone in BACKBONES:
        run_well("train", "-s", "colmap", "-m", f"of-{backbone}", "--iterations", "4", "--threads", "1", "--backbone", backbone,
                 "--checkpoint-iterations", "2", "--quiet", cwd=work)
        shutil.copy(work / f"of-{backbone}/config.json", work / f"settings/{backbone}.json")
    shutil.copytree(work / "of-vanilla", work / "run")
    for scene in ("text", "blender", "nerfstudio", "packed.sbscene"):
        run_well("train", "-s", scene, "-m", "good", *RUN, cwd=work)
    shutil.rmtree(work / "good")
    for host in ("host", "plain"):
        miniature_host.write_host(work / host, "3dgs-2023")
    run_well("patch", "apply", "3dgs", "host", cwd=work)
    shutil.copytree(attacks.ROOT / "patches/3dgs", work / "recipes/3dgs")


def commands_for(target, file):
    if isinstance(target.commands, list):
        return target.commands
    commands = target.commands[file.split("/")[0]]
    return [train("colmap", "--config", file), ["compare", "-s", "colmap", "-m", "out", *RUN, "--config", file]] \
        if commands is None else commands


def attack(name, whole, first, cases, seed, keep=None):
    """@param whole folder of prepare()"""
    target = TARGETS[name]
    totals = Totals()
    with tempfile.TemporaryDirectory(prefix="splatboost-fuzz-") as folder:
        work = pathlib.Path(folder).resolve() / "case"
        shutil.copytree(whole, work)
        for number in range(first, first + cases):
            chance = random.Random(f"{name} {seed} {number}")
            file = target.files[number % len(target.files)]
            data = target.how((whole / file).read_bytes(), chance)
            (work / file).write_bytes(data)
            command = chance.choice(commands_for(target, file))
            done = run(*command, cwd=work)
            totals.add(name, done)
            wrong = broken_rule(done)
            if wrong:
                totals.breaks(f"{name} {number} of seed {seed}: {' '.join(command)}, {file} damaged: {wrong}: "
                              f"{done.stderr[-600:]!r}")
                if keep:
                    pathlib.Path(keep).mkdir(parents=True, exist_ok=True)
                    (pathlib.Path(keep) / f"{name}-{seed}-{number}-{pathlib.Path(file).name}".replace(" ", "-")).write_bytes(data)
            # Files left by a command must not affect the next case.
            for used in {file.split("/")[0], command[command.index("-m") + 1] if "-m" in command else "out", "out",
                         "out.sbscene", "out.glb", "plain", "host"}:
                if (work / used).is_dir():
                    shutil.rmtree(work / used)
                else:
                    (work / used).unlink(missing_ok=True)
                if (whole / used).is_dir():
                    shutil.copytree(whole / used, work / used)
                elif (whole / used).exists():
                    shutil.copy(whole / used, work / used)
    return totals


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=1000, help="of all targets together")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--target", nargs="+", choices=list(TARGETS), default=list(TARGETS))
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--keep")
    parser.add_argument("--json")
    arguments = parser.parse_args()
    each = -(-arguments.cases // len(arguments.target))
    totals = Totals()
    with tempfile.TemporaryDirectory(prefix="splatboost-fuzz-") as whole, \
            concurrent.futures.ProcessPoolExecutor(arguments.jobs) as pool:
        prepare(pathlib.Path(whole).resolve())
        for one in [pool.submit(attack, name, pathlib.Path(whole).resolve(), arguments.first, each, arguments.seed,
                                arguments.keep) for name in arguments.target]:
            totals.merge(one.result())
    return totals.finish(arguments, "readers")


if __name__ == "__main__":
    sys.exit(main())
