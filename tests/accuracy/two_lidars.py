#!/usr/bin/env python3
"""Two lidars of one vehicle: how well `stillmap calibrate` finds how they stand, and how sharp the map of both is.

usage: two_lidars.py STILLMAP FOLDER [--seeds N ...] [--scans N] [--late MS ...] [--no-map]

Simulates a minute of the town with turns, by a lidar over the windscreen and one over the boot, which looks back and
scans at other times. The rear lidar's clock is late by each of --late. Fails where the mount is off by more than 1 cm
or 0.1 degrees or 4 of its own deviations, where the clock is off by more than 4 of its deviations, or where walls or
ground are thicker in the map of both lidars than in that of one (median ratio of the cells that both maps see); and
where a straight drive by two clocks, which tells no mount, gives a file of mounts. Prints errors and their share of
sigma.
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
CELL_M = 0.4


def run(program, *words):
    done = subprocess.run([program, *map(str, words)], capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"stillmap {' '.join(map(str, words))}: exit {done.returncode}\n{done.stderr}")
    return done.stdout


def rotation_of(roll, pitch, yaw):
    (cr, cp, cy), (sr, sp, sy) = np.cos(np.radians([roll, pitch, yaw])), np.sin(np.radians([roll, pitch, yaw]))
    return (np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]]) @ np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
            @ np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]]))


def angles_of(rotation):
    """Roll, pitch, yaw [deg]."""
    return np.degrees([np.arctan2(rotation[2, 1], rotation[2, 2]), -np.arcsin(rotation[2, 0]),
                       np.arctan2(rotation[1, 0], rotation[0, 0])])


def mounts(seed):
    """Of front and rear: x y z roll pitch yaw."""
    draw = np.random.default_rng(seed)
    front = [1.0, 0.0, -0.1, 0.0, round(draw.uniform(2.0, 8.0), 2), 0.0]
    rear = [-1.6, round(draw.uniform(-0.5, 0.5), 3), round(draw.uniform(-0.15, 0.05), 3),
            *np.round(draw.uniform(-4.0, 4.0, 2), 2), round(draw.uniform(150.0, 210.0), 2)]
    return front, [float(value) if value <= 180 else float(value - 360) for value in rear]


def errors_of(mount, front, rear):
    """What x y z [m] and roll pitch yaw [deg] are off by; and in sigmas."""
    front_rotation, rear_rotation = rotation_of(*front[3:]), rotation_of(*rear[3:])
    place = front_rotation.T @ (np.array(rear[:3]) - np.array(front[:3]))
    truth = [*place, *angles_of(front_rotation.T @ rear_rotation)]
    values, sigmas = (np.array([each[key] for each in mount["parameters"].values()]) for key in ("value", "sigma"))
    errors = values - truth
    errors[3:] = (errors[3:] + 180) % 360 - 180
    return errors, errors / sigmas


def simulate(program, folder, seed, scans):
    front, rear = mounts(seed)
    phase = (7 * seed % 90 + 5) / 1000
    for name, mount, extra in (("front", front, ()), ("rear", rear, ("--phase", phase))):
        run(program, "simulate", "town", "-o", folder / name, "--seed", seed, "--scans", scans, "--sensor", "vlp16",
            "--layout", "pcd", "--mount=" + ",".join(map(str, mount)), *extra)
    return front, rear


def late(drive, target, late_s):
    """The same drive by another clock."""
    target.mkdir()
    for file in drive.iterdir():
        if file.name not in ("times.txt", "trajectory.txt"):
            (target / file.name).symlink_to(file.resolve())
            continue
        lines = (line.split() for line in file.read_text().splitlines() if line)
        shifted = (" ".join([f"{float(words[0]) + late_s:.9f}", *words[1:]]) for words in lines)
        (target / file.name).write_text("\n".join(shifted) + "\n")


def points_of(program, drive, target):
    """Of the first scans with true poses of the front lidar: what is left is the rear one's mount and times."""
    run(program, "build", drive, "-o", target, "--given-poses", "exact", "--select", ":150", "--detector", "geometric")
    cloud = target.with_suffix(".ply")
    run(program, "export", target, "--format", "ply", "--without", "filled,projected", "-o", cloud)
    head, data = cloud.read_bytes().split(b"end_header\n", 1)
    words = [line.split() for line in head.decode().splitlines()]
    types = {"float": "<f4", "double": "<f8", "uchar": "u1", "ushort": "<u2", "uint": "<u4"}
    columns = np.dtype([(line[2], types[line[1]]) for line in words if line[0] == "property"])
    points = np.frombuffer(data, columns)
    return np.column_stack([points[axis].astype(float) for axis in "xyz"])


def thickness_of(points, corner):
    """Of each planar cell with 8 points and more: deviation across its plane [m], and how far it looks up."""
    cells = np.floor((points - corner) / CELL_M).astype(np.int64)
    keys = (cells[:, 0] << 42) + (cells[:, 1] << 21) + cells[:, 2]
    order = np.argsort(keys, kind="stable")
    keys, points = keys[order], points[order]
    found = {}
    for places in np.split(np.arange(len(keys)), np.flatnonzero(np.diff(keys)) + 1):
        if len(places) < 8:
            continue
        # A plane has three unknowns.
        variances, axes = np.linalg.eigh(np.cov(points[places].T, bias=True) * len(places) / (len(places) - 3))
        if variances[1] > 9 * variances[0] and variances[1] > 0.003:
            found[keys[places[0]]] = (np.sqrt(max(variances[0], 0.0)), abs(axes[2, 0]))
    return found


def judge_maps(one, both, words):
    """What is thicker by both lidars, in the cells that both maps see."""
    corner = np.minimum(one.min(axis=0), both.min(axis=0)) - 1.0
    by_one, by_both = thickness_of(one, corner), thickness_of(both, corner)
    for kind, (least, most) in {"walls": (0.0, 0.3), "ground": (0.95, 1.01)}.items():
        pairs = np.array([(by_one[key][0], by_both[key][0]) for key in by_one.keys() & by_both.keys()
                          if least <= by_one[key][1] < most and least <= by_both[key][1] < most])
        ratio = np.median(pairs[:, 1] / pairs[:, 0])
        print(f"{words} {kind}: {1000 * np.median(pairs[:, 0]):.2f} mm thick by one lidar, "
              f"{1000 * np.median(pairs[:, 1]):.2f} mm by both; ratio {ratio:.3f} (medians of {len(pairs)} cells)")
        if not ratio <= THICKER:
            yield f"{words} {kind} are thicker by both lidars"


def judge_mount(program, folder, name, front, rear, late_ms):
    """Shares of sigma, by how the mount was found, and what is wrong."""
    words = f"seed {folder.name}, {late_ms:+g} ms:"
    run(program, "calibrate", folder / "front", folder / name, "-o", folder / "lidars.json",
        f"--json={folder / 'found.json'}")
    found = json.loads((folder / "found.json").read_text())["lidars"][0]
    wrong, shares = [], {}
    clock = found["time_offset_s"]
    if clock is None:
        sys.exit(f"{name}: no clock offset")
    clock_off = clock["value"] + late_ms / 1000
    print(f"{words} clock       off by {1000 * clock_off:.2f} ms; in sigmas "
          f"{clock_off / clock['sigma']:.1f}; {'used' if clock['used'] else 'not used'}")
    if abs(clock_off) > MOST_SIGMAS * clock["sigma"]:
        wrong.append(f"{words} clock off by {1000 * clock_off:.2f} ms, more than {MOST_SIGMAS} sigmas")
    for kind in ("from_motion", "from_maps"):
        if found[kind] is None:
            sys.exit(f"{name}: no mount {kind}")
        errors, shares[kind] = errors_of(found[kind], front, rear)
        print(f"{words} {kind:11} off by {np.round(100 * errors[:3], 2)} cm {np.round(errors[3:], 3)} deg; "
              f"in sigmas {np.round(shares[kind], 1)}", flush=True)
    if np.abs(errors[:3]).max() > MOST_CM / 100 or np.abs(errors[3:]).max() > MOST_DEG:
        wrong.append(f"{words} off by more than {MOST_CM} cm or {MOST_DEG} deg")
    for kind, share in shares.items():
        if np.abs(share).max() > MOST_SIGMAS:
            wrong.append(f"{words} {kind}: off by more than {MOST_SIGMAS} sigmas")
    return shares, wrong


def judge(program, folder, seed, scans, late_ms, with_map):
    front, rear = simulate(program, folder, seed, scans)
    all_shares, wrong = [], []
    for ms in late_ms:
        name = "rear"
        if ms != 0:
            name = f"rear_{ms}"
            late(folder / "rear", folder / name, ms / 1000)
        shares, of_this = judge_mount(program, folder, name, front, rear, ms)
        all_shares.append(shares)
        wrong += of_this
    if with_map:
        one = points_of(program, folder / "front", folder / "map_front")
        wrong += judge_maps(one, points_of(program, folder, folder / "map_both"), f"seed {seed}:")
    return all_shares, wrong


def writes_what_is_not_known(program, folder):
    """Whether a straight drive, which tells neither place nor clock, gives a lidars.json all the same."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    for name, mount in (("front", "1,0,-0.1,0,5,0"), ("rear", "-1.6,0,-0.1,0,3,180")):
        run(program, "simulate", "highway", "-o", folder / name, "--scans", 120, "--sensor", "vlp16", "--layout", "pcd",
            f"--mount={mount}")
    late(folder / "rear", folder / "late", 1.7)
    done = subprocess.run([program, "calibrate", folder / "front", folder / "late", "-o", folder / "lidars.json"],
                          capture_output=True, text=True)
    print(f"straight, 1.7 s late: exit {done.returncode}: {done.stderr.strip()}")
    return done.returncode == 0 or (folder / "lidars.json").exists()


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("stillmap")
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--seeds", type=int, nargs="+", default=[27])
    parser.add_argument("--scans", type=int, default=600)
    parser.add_argument("--late", type=float, nargs="+", default=[4, -30, 0], metavar="MS",
                        help="the last one is that of the map (default: 4 -30 0)")
    parser.add_argument("--no-map", action="store_true")
    arguments = parser.parse_args()
    all_shares, wrong = {"from_motion": [], "from_maps": []}, []
    arguments.folder.mkdir(parents=True, exist_ok=True)
    if writes_what_is_not_known(arguments.stillmap, arguments.folder / "straight"):
        wrong.append("a straight drive gave a lidars.json")
    for seed in arguments.seeds:
        folder = arguments.folder / str(seed)
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
        of_seed, wrong_of_seed = judge(arguments.stillmap, folder, seed, arguments.scans, arguments.late,
                                       not arguments.no_map)
        wrong += wrong_of_seed
        for shares in of_seed:
            for kind, share in shares.items():
                all_shares[kind].append(share)
        shutil.rmtree(folder)
    for kind, shares in all_shares.items():
        in_sigmas = np.sqrt(np.mean(np.square(shares), axis=0))
        print(f"{kind}: root mean square of the errors in sigmas {np.round(in_sigmas, 2)}")
    sys.exit("\n".join(wrong) if wrong else 0)


if __name__ == "__main__":
    main()
