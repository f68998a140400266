#!/usr/bin/env python3
"""Patches of towns by drives of another day whose poses are off: how many are refused, and their worst seams.

usage: patch_seams.py STILLMAP FOLDER [--towns 20] [--patches 10] [--bend 0.05]

Each town (seed 101, 102, ...) is mapped with exact poses. A patch takes a part of 60 scans of day 2. Its poses bend
smoothly by --bend metres (and 0.1 deg), with 5 mm of noise from scan to scan. FOLDER keeps drives and maps.
"""

import argparse
import json
import math
import pathlib
import random
import shutil
import subprocess

SCANS, PART, LEAST_WAY_M = 300, 60, 20.0
BUILD = ["--detector", "geometric", "--given-poses", "exact"]


def run(program, *arguments):
    return subprocess.run([program, *map(str, arguments)], capture_output=True, text=True)


def simulated(program, folder, seed, day):
    drive = folder / f"town{seed}_day{day}"
    if not drive.exists():
        run(program, "simulate", "town", "-o", drive, "--seed", seed, "--day", day, "--sensor", "vlp16",
            "--layout", "pcd", "--scans", SCANS).check_returncode()
    return drive


def mapped(program, folder, seed):
    place = folder / f"town{seed}"
    if not place.exists():
        run(program, "build", simulated(program, folder, seed, 1), "-o", place, *BUILD).check_returncode()
    return place


def way_m(lines):
    """How far apart the ends are: where the vehicle waits, nothing is seen to register by."""
    first, last = ([float(x) for x in line.split()][3::4] for line in (lines[0], lines[-1]))
    return math.dist(first, last)


def disturbed(lines, bend_m, seed):
    """KITTI poses, bent."""
    draw = random.Random(seed)
    waves = [(draw.uniform(0.5, 1.0) * bend_m / 2, draw.uniform(80, 250), draw.uniform(0, 6.3)) for _ in range(6)]
    out = []
    for i, line in enumerate(lines):
        m = [float(x) for x in line.split()]
        for axis in range(3):
            shift = sum(a * math.sin(6.283 * i / length + phase) for a, length, phase in waves[axis::3])
            m[4 * axis + 3] += (shift if axis < 2 else 0.5 * shift) + draw.gauss(0, 0.005)
        turn = 0.0017 * math.sin(6.283 * i / waves[0][1] + waves[1][2])
        for column in range(3):
            x, y = m[column], m[4 + column]
            m[column], m[4 + column] = x - turn * y, y + turn * x
        out.append(" ".join(f"{x:.9g}" for x in m))
    return "\n".join(out) + "\n"


def patched(program, folder, seed, number, arguments):
    """The patch's figures, or the message that refuses it."""
    day2, place = simulated(program, folder, seed, 2), mapped(program, folder, seed)
    lines = (day2 / "optimized_poses.txt").read_text().splitlines()
    begins = [b for b in range(0, SCANS - PART + 1, 5) if way_m(lines[b:b + PART]) >= LEAST_WAY_M]
    begin = begins[number * (len(begins) - 1) // max(1, arguments.patches - 1)]
    poses = folder / "poses.txt"
    poses.write_text(disturbed(lines, arguments.bend, 1000 * seed + number))
    for name in ("work", "new"):
        shutil.rmtree(folder / name, ignore_errors=True)
    report = folder / "report.json"
    done = run(program, "rebuild", day2, "-o", folder / "new", "--work", folder / "work", "--previous", place,
               "--patch", "--poses", poses, "--select", f"{begin}:{begin + PART}", f"--json={report}", *BUILD)
    if done.returncode not in (0, 4):
        return None, done.stderr.strip().splitlines()[-1]
    figures = json.loads(report.read_text())
    return figures["patch"], "; ".join(figures["reasons"])


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("program", type=pathlib.Path)
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--towns", type=int, default=20)
    parser.add_argument("--patches", type=int, default=10)
    parser.add_argument("--bend", type=float, default=0.05)
    arguments = parser.parse_args()
    arguments.folder.mkdir(parents=True, exist_ok=True)
    seams, refused = [], 0
    for seed in range(101, 101 + arguments.towns):
        for number in range(arguments.patches):
            patch, words = patched(arguments.program, arguments.folder, seed, number, arguments)
            if patch is None:
                refused += 1
            else:
                seams.append(patch["worst_seam_m"])
            print(seed, number, "refused" if patch is None else f"{patch['worst_seam_m']:.4f} m", words, flush=True)
    seams.sort()
    print(f"{len(seams) + refused} patches, {refused} refused" +
          (f"; worst seam {seams[-1]:.4f} m, median {seams[len(seams) // 2]:.4f} m" if seams else ""))


if __name__ == "__main__":
    main()
