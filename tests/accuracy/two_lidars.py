#!/usr/bin/env python3
"""Two lidars of one vehicle: how well `stillmap calibrate` finds how they stand, and how sharp the map of both is.

usage: two_lidars.py STILLMAP FOLDER [--seeds N ...] [--scans N] [--no-map]

Simulates a minute of the town with turns, by a lidar over the windscreen and one over the boot, which looks back and
scans at other times. Fails where the mount is off by more than 1 cm or 0.1 degrees or 4 of its own deviations, or where
walls or ground are thicker in the map of both lidars than in that of one. Prints errors and their share of sigma.
"""

import argparse
import json
import pathlib
import shutil
import subprocess
import sys

import numpy as np

MOST_CM, MOST_DEG, MOST_SIGMAS = 1.0, 0.1, 4.0
# What is noise between two maps of one place.
THICKER = 1.02


def run(program, *words):
    done = subprocess.run([program, *map(str, words)], capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"stillmap {' '.join(map(str, words))}: exit {done.returncode}\n{done.stderr}")
    return done.stdout


def rotation_of(roll, pitch, yaw):
    (cr, cp, cy), (sr, sp, sy) = np.cos(np.radians([roll, pitch, yaw])), np.sin(np.radians([roll, pitch, yaw]))
    return (np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]]) @ np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
            @ np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]]))


def rotation_of_quaternion(q):
    x, y, z, w = q
    return np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                     [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                     [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]])


def mounts(seed):
    """Of front and rear: x y z roll pitch yaw."""
    draw = np.random.default_rng(seed)
    front = [1.0, 0.0, -0.1, 0.0, round(draw.uniform(2.0, 8.0), 2), 0.0]
    rear = [-1.6, round(draw.uniform(-0.5, 0.5), 3), round(draw.uniform(-0.15, 0.05), 3),
            *np.round(draw.uniform(-4.0, 4.0, 2), 2), round(draw.uniform(150.0, 210.0), 2)]
    return front, [float(value) if value <= 180 else float(value - 360) for value in rear]


def errors_of(mount, front, rear):
    """Place [m] and turn [rad] that the mount is off by, along the axes of the reference; and in sigmas."""
    front_rotation, rear_rotation = rotation_of(*front[3:]), rotation_of(*rear[3:])
    place = front_rotation.T @ (np.array(rear[:3]) - np.array(front[:3]))
    turned = rotation_of_quaternion(mount["quaternion"]) @ (front_rotation.T @ rear_rotation).T
    turn = 0.5 * np.array([turned[2, 1] - turned[1, 2], turned[0, 2] - turned[2, 0], turned[1, 0] - turned[0, 1]])
    errors = np.concatenate([np.array(mount["position"]) - place, np.degrees(turn)])
    return errors, errors / np.array([value["sigma"] for value in mount["parameters"].values()])


def simulate(program, folder, seed, scans):
    front, rear = mounts(seed)
    phase = (7 * seed % 90 + 5) / 1000
    for name, mount, extra in (("front", front, ()), ("rear", rear, ("--phase", phase))):
        run(program, "simulate", "town", "-o", folder / name, "--seed", seed, "--scans", scans, "--sensor", "vlp16",
            "--layout", "pcd", "--mount=" + ",".join(map(str, mount)), *extra)
    return front, rear


def thickness_of(program, drive, target):
    """Of the first scans with true poses of the front lidar: what is left is the rear one's mount and times."""
    run(program, "build", drive, "-o", target, "--given-poses", "exact", "--select", ":150", "--detector", "geometric")
    return json.loads((target / "build.json").read_text())["consistency"]


def judge(program, folder, seed, scans, with_map):
    front, rear = simulate(program, folder, seed, scans)
    run(program, "calibrate", folder / "front", folder / "rear", "-o", folder / "lidars.json",
        f"--json={folder / 'found.json'}")
    found = json.loads((folder / "found.json").read_text())["lidars"][0]
    wrong = []
    shares = {}
    for kind in ("from_motion", "from_maps"):
        if found[kind] is None:
            sys.exit(f"seed {seed}: no mount {kind}")
        errors, shares[kind] = errors_of(found[kind], front, rear)
        print(f"seed {seed} {kind:11} off by {np.round(100 * errors[:3], 2)} cm {np.round(errors[3:], 3)} deg; "
              f"in sigmas {np.round(shares[kind], 1)}")
    if np.abs(errors[:3]).max() > MOST_CM / 100 or np.abs(errors[3:]).max() > MOST_DEG:
        wrong.append(f"seed {seed}: off by more than {MOST_CM} cm or {MOST_DEG} deg")
    for kind, share in shares.items():
        if np.abs(share).max() > MOST_SIGMAS:
            wrong.append(f"seed {seed} {kind}: off by more than {MOST_SIGMAS} sigmas")
    if with_map:
        one = thickness_of(program, folder / "front", folder / "map_front")
        both = thickness_of(program, folder, folder / "map_both")
        for kind in ("walls", "ground"):
            a, b = one[kind]["thickness_median_m"], both[kind]["thickness_median_m"]
            print(f"seed {seed} {kind}: {1000 * a:.2f} mm thick by one lidar ({one[kind]['planar_cells']} cells), "
                  f"{1000 * b:.2f} mm by both ({both[kind]['planar_cells']} cells)")
            if not b <= THICKER * a:
                wrong.append(f"seed {seed}: {kind} are thicker by both lidars")
    return shares, wrong


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("stillmap")
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--seeds", type=int, nargs="+", default=[3])
    parser.add_argument("--scans", type=int, default=600)
    parser.add_argument("--no-map", action="store_true")
    arguments = parser.parse_args()
    all_shares, wrong = {"from_motion": [], "from_maps": []}, []
    for seed in arguments.seeds:
        folder = arguments.folder / str(seed)
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        shares, of_seed = judge(arguments.stillmap, folder, seed, arguments.scans, not arguments.no_map)
        wrong += of_seed
        for kind, share in shares.items():
            all_shares[kind].append(share)
        shutil.rmtree(folder)
    for kind, shares in all_shares.items():
        print(f"{kind}: root mean square of the errors in sigmas {np.round(np.sqrt(np.mean(np.square(shares), axis=0)), 2)}")
    sys.exit("\n".join(wrong) if wrong else 0)


if __name__ == "__main__":
    main()
