# SPDX-License-Identifier: Apache-2.0
"""What the fuzzer and the fault injection share: runs under limits, the rule for how a command may end, totals."""

import collections
import datetime
import json
import os
import pathlib
import platform
import resource
import shlex
import struct
import subprocess
import sys
import unicodedata

ROOT = pathlib.Path(__file__).resolve().parents[2]
FOLDER = pathlib.Path(os.environ.get("SPLATBOOST_BIN", ROOT / "build/release/bin"))
PROGRAM = FOLDER / "splatboost"
FILE_FAULTS = FOLDER.parent / "lib/libfile_faults.so"

TINY_SCENE = ["--width", "32", "--height", "24", "--views", "6", "--points", "40"]
ADDRESS_SPACE = 3 << 30  # libraries take 1 GiB of it
SECONDS = 60
LONGEST_OUTPUT = 1 << 20


def run(*arguments, cwd=None, faults=None):
    """Runs the program under limits, with a clock that runs fast, so that timed sections are short.
    @param faults environment variables for file_faults.c
    @return the finished process; returncode None: it took too long"""
    def limit():
        resource.setrlimit(resource.RLIMIT_AS, (ADDRESS_SPACE, ADDRESS_SPACE))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    environment = {**os.environ, "LD_PRELOAD": str(FILE_FAULTS), "FILE_FAULTS_HURRY": "1000", **(faults or {})}
    command = [str(PROGRAM), *map(str, arguments)]
    try:
        return subprocess.run(command, capture_output=True, timeout=SECONDS, cwd=cwd, check=False, env=environment,
                              stdin=subprocess.DEVNULL, preexec_fn=limit)
    except subprocess.TimeoutExpired as late:
        return subprocess.CompletedProcess(command, None, late.stdout or b"", late.stderr or b"")


def run_well(*arguments, cwd=None, faults=None):
    done = run(*arguments, cwd=cwd, faults=faults)
    if done.returncode != 0:
        raise RuntimeError(f"{shlex.join(done.args)}: exit {done.returncode}: {done.stderr.decode(errors='replace')}")
    return done


def broken_rule(done, may_be_killed=False):
    """@return how a command broke the rule (exit 0, 1 or 2; one line on failure, no raw bytes); empty: it did not"""
    if done.returncode is None:
        return f"took more than {SECONDS} s"
    if done.returncode == -9 and may_be_killed:
        return ""
    if done.returncode not in (0, 1, 2):
        return f"exit {done.returncode}"
    try:
        text = done.stderr.decode()
    except UnicodeDecodeError:
        return "raw bytes in the message"
    if any(unicodedata.category(c) == "Cc" for c in text.replace("\n", "")):
        return "control characters in the message"
    lines = text.removesuffix("\n").split("\n") if text else []
    lines = [line for line in lines if not line.startswith(("note: ", "warning: "))]
    if done.returncode == 0:
        return "" if len(lines) <= 1 else f"{len(lines)} lines on success"
    if len(lines) != 1 or not lines[0].startswith("splatboost"):
        return f"{len(lines)} lines where one is due"
    return "" if len(lines[0]) < 2000 else "an endless line"


class Totals:
    """Counts cases, and keeps those that broke the rule with instructions to reproduce them."""

    def __init__(self):
        self.cases = 0
        self.by_attack = collections.Counter()
        self.exits = collections.Counter()
        self.broken = []

    def add(self, attack, done):
        self.cases += 1
        self.by_attack[attack] += 1
        code = done.returncode
        self.exits["too long" if code is None else str(code) if code >= 0 else f"signal {-code}"] += 1

    def breaks(self, what):
        self.broken.append(what)
        print(f"BROKEN: {what}", file=sys.stderr)

    def merge(self, other):
        self.cases += other.cases
        self.by_attack += other.by_attack
        self.exits += other.exits
        self.broken += other.broken

    def record(self, command):
        return {"command": command, "machine": machine(), "date": now(), "cases": self.cases,
                "exits": dict(sorted(self.exits.items())), "attacks": dict(sorted(self.by_attack.items())),
                "broken": self.broken}

    def finish(self, arguments, key):
        """Prints the totals, and with --json writes them to that file.
        @return the exit status"""
        record = self.record(command_of(sys.argv))
        print(f"{self.cases} cases; exits: " + ", ".join(f"{code}: {n}" for code, n in record["exits"].items()))
        for attack, count in record["attacks"].items():
            print(f"  {attack}: {count}")
        print(f"{len(self.broken)} against the rule")
        if arguments.json:
            path = pathlib.Path(arguments.json)
            document = json.loads(path.read_text()) if path.exists() else {}
            document[key] = record
            path.write_text(json.dumps(document, indent=1) + "\n")
        return 1 if self.broken else 0


def command_of(argv):
    """The command line without options that only control the output."""
    words = ["tests/robustness/" + pathlib.Path(argv[0]).name]
    left_out = ("--json", "--keep", "--jobs")
    for before, word in zip(argv, argv[1:]):
        if word not in left_out and before not in left_out:
            words.append(word)
    return shlex.join(words)


def machine():
    for line in pathlib.Path("/proc/cpuinfo").read_text().splitlines():
        if line.startswith("model name"):
            return line.split(":", 1)[1].strip()
    return platform.machine()


def now():
    return datetime.datetime.now(datetime.timezone.utc).strftime("%Y-%m-%dT%H:%M:%SZ")


def checksum(data, before=0):
    """The checksum of packed scenes and checkpoints (backbones/trainer/support/checksum.h)."""
    mask = (1 << 64) - 1
    total = (len(data) + before) & mask
    for (word,) in struct.iter_unpack("<Q", data + bytes(-len(data) % 8)):
        total = (total ^ word) * 0x9e3779b97f4a7c15 & mask
        total = (total << 29 | total >> 35) & mask
    return total


def read_archive(data):
    """Reads a checkpoint (backbones/trainer/support/archive.cpp).
    @return entries by name, with their type byte. Raises ValueError if it is not complete."""
    at, total = 0, 0

    def block(length):
        nonlocal at, total
        part = data[at:at + length]
        if len(part) != length:
            raise ValueError("truncated")
        at += length
        total = checksum(part, total)
        return part

    if block(8) != b"SBCKPT02":
        raise ValueError("another magic")
    entries = {}
    for _ in range(struct.unpack("<I", block(4))[0]):
        name = block(struct.unpack("<I", block(4))[0]).decode()
        entries[name] = block(struct.unpack("<Q", block(8))[0])
    if data[at:] != struct.pack("<Q", total):
        raise ValueError("another checksum")
    return entries


def archive_bytes(entries):
    parts = [b"SBCKPT02", struct.pack("<I", len(entries))]
    for name, content in entries.items():
        parts += [struct.pack("<I", len(name)), name.encode(), struct.pack("<Q", len(content)), content]
    total = 0
    for part in parts:
        total = checksum(part, total)
    return b"".join(parts) + struct.pack("<Q", total)
