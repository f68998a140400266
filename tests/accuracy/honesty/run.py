#!/usr/bin/env python3
"""Whether a wrong scan, a part of one or a bent map gets a confident wrong answer.

usage: run.py STILLMAP FOLDER [--seeds 1,2,3] [--scans 100] [--sets clean,distorted,unsolvable,blocked,bent,torn]
              [--scenarios town,highway] [--sensor hdl64] [--bends 0.1,0.3,0.6] [--every 1]

Simulated drives with exact truth; a map of the even scans, asked with the odd ones, from priors that are off by 1 m and
5 deg. Prints, for each change: queries, those that are `ok`, `ok` beyond 0.5 m, `ok` beyond its level along any axis,
median error and level. In a bent map (a wave of so many metres over 60 m of way) or a torn one (the second half is aside by so many metres) an
answer is judged by the nearer of the local and the true pose. --every: asks each so many of the odd scans.
"""

import argparse
import json
import pathlib
import sys

try:
    import numpy as np
except ImportError:
    print("skipped: numpy is missing")
    sys.exit(77)

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / "integrity"))
import answers
import distortions
import poses
import scans
from ask import Asker, run

HAZARD_M = 0.5
WAVE_M = 60.0


class World:
    def __init__(self, options, scenario, seed):
        self.options, self.name = options, f"{scenario}_{seed}_{options.sensor}"
        self.folder = options.folder / self.name
        self.folder.mkdir(parents=True, exist_ok=True)
        self.drive = self.folder / "drive"
        if not self.drive.exists():
            run(options.program, "simulate", scenario, "-o", self.drive, "--seed", seed, "--scans", options.scans,
                "--sensor", options.sensor)
        T_cam_lidar = poses.read_calibration(self.drive / "calib.txt")
        self.T_map_lidar = np.linalg.inv(T_cam_lidar) @ poses.read_kitti(self.drive / "poses.txt") @ T_cam_lidar
        self.select = f"1::{2 * options.every}"
        self.poses_file = self.folder / "true.txt"
        poses.write_kitti(self.poses_file, self.T_map_lidar)

    def ask(self, name, change):
        asker = Asker(self.options.program, self.folder, self.drive)
        return judged(asker.ask(name, change, "1,5", self.select, poses_file=self.poses_file))

    def ask_bent(self, kind, size_m, parts):
        """Answers by part in a map whose poses are bent or torn."""
        T_bent = self.T_map_lidar @ offsets(kind, size_m, self.T_map_lidar)
        name = f"{kind}_{size_m}"
        file, made = self.folder / f"{name}.txt", self.folder / f"map_{name}"
        poses.write_kitti(file, T_bent)
        if not made.exists():
            run(self.options.program, "build", self.drive, "-o", made, "--select", "::2", "--poses", file,
                "--given-poses", "exact")
        asker = Asker(self.options.program, self.folder, self.drive, made)
        found = {}
        for part, change in parts.items():
            table = asker.ask(f"{name}_{part}", change, "1,5", self.select, poses_file=file)
            found[part] = judged(table, T_bent, self.T_map_lidar)
        return found


def offsets(kind, size_m, T_map_lidar):
    """To the side, N x 4 x 4."""
    steps = np.linalg.norm(np.diff(T_map_lidar[:, :3, 3], axis=0), axis=1)
    way_m = np.concatenate([[0.0], np.cumsum(steps)])
    T = np.tile(np.eye(4), (len(way_m), 1, 1))
    if kind == "bent":
        T[:, 1, 3] = size_m * np.sin(2.0 * np.pi * way_m / WAVE_M)
    else:
        T[:, 1, 3] = size_m * (way_m > 0.5 * way_m[-1])
    return T


def judged(table, T_asked=None, T_true=None):
    """Columns ok, error_m, beyond (of its level), level_m; the nearer of two truths."""
    ok = table["status"] == "ok"
    levels = np.stack([table[name] for name in answers.LEVELS], axis=1)
    errors = np.stack([table[name] for name in answers.ERRORS], axis=1)
    candidates = [errors]
    if T_asked is not None:
        T_true_asked = np.linalg.inv(T_true) @ T_asked
        other = np.array([poses.log_se3(T_true_asked[int(scan)] @ poses.exp_se3(error)) if not np.isnan(error).any()
                          else error for scan, error in zip(table["scan"], errors)])
        candidates.append(other)
    share = np.stack([np.max(np.abs(each[:, [0, 1, 2, 5]]) / levels, axis=1) for each in candidates])
    error_m = np.stack([np.linalg.norm(each[:, :3], axis=1) for each in candidates])
    return {"ok": ok, "error_m": error_m.min(axis=0), "share": share.min(axis=0),
            "level_m": np.linalg.norm(levels[:, :3], axis=1)}


def row(name, tables):
    table = {key: np.concatenate([each[key] for each in tables]) for key in tables[0]}
    ok = table["ok"]
    far, beyond = ok & (table["error_m"] > HAZARD_M), ok & (table["share"] > 1.0)
    middle = (f"{100 * np.median(table['error_m'][ok]):.1f} | {100 * np.median(table['level_m'][ok]):.1f} | "
              f"{table['share'][ok].max():.2f}" if ok.any() else "- | - | -")
    print(f"| {name} | {len(ok)} | {100 * ok.mean():.0f} % | {far.sum()} | {beyond.sum()} | {middle} |", flush=True)
    return {"queries": int(len(ok)), "ok": int(ok.sum()), "far": int(far.sum()), "beyond": int(beyond.sum())}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program")
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--seeds", default="1,2,3")
    parser.add_argument("--scans", type=int, default=100)
    parser.add_argument("--sets", default="clean,distorted,unsolvable,blocked,bent,torn")
    parser.add_argument("--scenarios", default="town,highway")
    parser.add_argument("--sensor", default="hdl64")
    parser.add_argument("--bends", default="0.1,0.3,0.6")
    parser.add_argument("--every", type=int, default=1)
    options = parser.parse_args()
    sets = {"clean": {"whole": distortions.whole}, "distorted": distortions.SOLVABLE,
            "unsolvable": distortions.UNSOLVABLE, "blocked": distortions.BLOCKED}
    worlds = [World(options, scenario, int(seed)) for scenario in options.scenarios.split(",")
              for seed in options.seeds.split(",")]
    print(f"| change | queries | ok | ok beyond {HAZARD_M} m | ok beyond level | median error cm | median level cm | "
          "largest error in levels |\n|---|---|---|---|---|---|---|---|")
    results = {}
    for name in options.sets.split(","):
        if name in sets:
            for change, function in sets[name].items():
                results[change] = row(change, [world.ask(change, function) for world in worlds])
            continue
        parts = {part: distortions.PARTS[part] for part in ("whole", "front", "left", "back", "right")}
        parts.update({part: distortions.BLOCKED[part] for part in ("blocked_front_75", "blocked_back_75")})
        for size_m in map(float, options.bends.split(",")):
            found = [world.ask_bent(name, size_m, parts) for world in worlds]
            for part in parts:
                results[f"{name}_{size_m}_{part}"] = row(f"{name} by {size_m} m, {part}", [each[part] for each in found])
    (options.folder / "results.json").write_text(json.dumps(results, indent=1))


if __name__ == "__main__":
    sys.exit(main())
