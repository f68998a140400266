#!/usr/bin/env python3
"""Whether a wrong scan, a part of one or a bent map gets a confident wrong answer.

usage: run.py STILLMAP FOLDER [--seeds 1,2,3] [--scans 100] [--sets clean,distorted,unsolvable,blocked,bent,torn]
              [--scenarios town,highway] [--sensor hdl64] [--drives DIR,DIR...] [--bends 0.1,0.3,0.6] [--every 1]
              [--method default] [--limits]

A map of the even scans is asked with the odd ones, from priors that are off by 1 m and 5 deg. Simulated drives have
exact truth; for real ones (--drives) it is the trajectory of a map of all scans, which ours refined: use their bent and
torn maps alone. Prints, for each change: queries, those that are `ok`, `ok` beyond 0.5 m, `ok` beyond its level along
any axis, median error and level, and the median share of explained points of answers within 0.5 m and beyond.

In a bent map (a wave of so many metres to the side over 60 m of way) or a torn one (the second half is aside by so many
metres) an answer is judged by the nearer of the local and the true pose. A stitched scan has two poses, and is judged
by the nearer of them; the row below counts by the asked one alone.

--every: asks each so many of the odd scans. --method: ndt, gicp and pcl-icp where STILLMAP was built with PCL (`./dev
bench`). --limits: exit code 1 when one `ok` is beyond 0.5 m, more than a tenth of a row's `ok` beyond their level, a
scan that no pose explains is `ok`, or fewer scans with noise are `ok` than 0.8 of clean ones.
--anew: what FOLDER holds of an earlier run is made again.
"""

import argparse
import json
import pathlib
import shutil
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
MOST_BEYOND = 0.1
LEAST_NOISY = 0.8


class World:
    """A drive, its poses and maps of its even scans."""

    def __init__(self, options, folder, drive, T_map_lidar):
        self.options, self.folder, self.drive, self.T_map_lidar = options, folder, drive, T_map_lidar
        self.select = f"1::{2 * options.every}"

    def ask(self, name, change, kind="", size_m=0.0):
        """Answers in the map whose poses are off so; errors are by these poses. @return table, poses."""
        T_asked = self.T_map_lidar @ offsets(kind, size_m, self.T_map_lidar)
        label = f"{kind}_{size_m}" if kind else "true"
        file, made = self.folder / f"{label}.txt", self.folder / f"map_{label}"
        poses.write_kitti(file, T_asked)
        if not made.exists():
            run(self.options.program, "build", self.drive, "-o", made, "--select", "::2", "--poses", file,
                "--given-poses", "exact")
        asker = Asker(self.options.program, self.folder, self.drive, made, method=self.options.method)
        return asker.ask(f"{label}_{name}", change, "1,5", self.select, poses_file=file), T_asked

    def before(self):
        """The pose of the scan before each."""
        return self.T_map_lidar[np.maximum(np.arange(len(self.T_map_lidar)) - 1, 0)]


def simulated(options, scenario, seed):
    folder = options.folder / f"{scenario}_{seed}_{options.sensor}"
    folder.mkdir(parents=True, exist_ok=True)
    drive = folder / "drive"
    if not drive.exists():
        run(options.program, "simulate", scenario, "-o", drive, "--seed", seed, "--scans", options.scans, "--sensor",
            options.sensor)
    T_cam_lidar = poses.read_calibration(drive / "calib.txt")
    return World(options, folder, drive, np.linalg.inv(T_cam_lidar) @ poses.read_kitti(drive / "poses.txt") @ T_cam_lidar)


def real(options, drive):
    folder = options.folder / drive.name
    folder.mkdir(parents=True, exist_ok=True)
    made, refined = folder / "map_of_all", folder / "refined.txt"
    if not made.exists():
        run(options.program, "build", drive, "-o", made)
    refined.unlink(missing_ok=True)
    run(options.program, "export", made, "--format", "kitti", "-o", refined)
    return World(options, folder, drive, poses.read_kitti(refined))


def offsets(kind, size_m, T_map_lidar):
    """To the side, N x 4 x 4."""
    steps = np.linalg.norm(np.diff(T_map_lidar[:, :3, 3], axis=0), axis=1)
    way_m = np.concatenate([[0.0], np.cumsum(steps)])
    T = np.tile(np.eye(4), (len(way_m), 1, 1))
    if kind == "bent":
        T[:, 1, 3] = size_m * np.sin(2.0 * np.pi * way_m / WAVE_M)
    elif kind == "torn":
        T[:, 1, 3] = size_m * (way_m > 0.5 * way_m[-1])
    return T


def judged(answered, other=None):
    """Columns ok, error_m, share of the level, level_m, explained; by the nearer of two poses for each scan."""
    table, T_asked = answered
    ok = table["status"] == "ok"
    levels = np.stack([table[name] for name in answers.LEVELS], axis=1)
    errors = [np.stack([table[name] for name in answers.ERRORS], axis=1)]
    if other is not None:
        T_other_asked = np.linalg.inv(other) @ T_asked
        errors.append(np.array([poses.log_se3(T_other_asked[int(scan)] @ poses.exp_se3(error))
                                if not np.isnan(error).any() else error
                                for scan, error in zip(table["scan"], errors[0])]))
    share = np.stack([np.max(np.abs(each[:, [0, 1, 2, 5]]) / levels, axis=1) for each in errors])
    error_m = np.stack([np.linalg.norm(each[:, :3], axis=1) for each in errors])
    return {"ok": ok, "error_m": error_m.min(axis=0), "share": share.min(axis=0),
            "level_m": np.linalg.norm(levels[:, :3], axis=1), "explained": table["inlier_ratio"]}


def median(values, scale=100.0, digits=1):
    return f"{scale * np.median(values):.{digits}f}" if len(values) and np.isfinite(values).all() else "-"


def row(name, tables):
    table = {key: np.concatenate([each[key] for each in tables]) for key in tables[0]}
    ok = table["ok"]
    far, beyond = ok & (table["error_m"] > HAZARD_M), ok & (table["share"] > 1.0)
    near = ok & ~far
    print(f"| {name} | {len(ok)} | {100 * ok.mean():.0f} % | {far.sum()} | {beyond.sum()} | "
          f"{median(table['error_m'][ok])} | {median(table['level_m'][ok])} | {median(table['explained'][near], 1, 2)} | "
          f"{median(table['explained'][far], 1, 2)} |", flush=True)
    return {"queries": int(len(ok)), "ok": int(ok.sum()), "far": int(far.sum()), "beyond": int(beyond.sum())}


def rows_of(name, worlds, options):
    """Prints the rows of a set. @return counts by row."""
    if name in ("bent", "torn"):
        parts = {"whole": distortions.whole, **distortions.BLOCKED}
        return {f"{name} by {size_m} m, {part}": row(
            f"{name} by {size_m} m, {part}",
            [judged(world.ask(part, change, name, size_m), world.T_map_lidar) for world in worlds])
            for size_m in map(float, options.bends.split(",")) for part, change in parts.items()}
    sets = {"clean": {"whole": distortions.whole}, "distorted": distortions.SOLVABLE,
            "unsolvable": distortions.UNSOLVABLE, "blocked": distortions.BLOCKED}
    found = {}
    for change, function in sets[name].items():
        answered = [world.ask(change, function) for world in worlds]
        stitched = change == "stitched"
        others = [world.before() if stitched else None for world in worlds]
        found[change] = row(change, [judged(*each) for each in zip(answered, others)])
        if stitched:
            row("stitched, by the asked pose", [judged(each) for each in answered])
    return found


def broken(results):
    """What breaks the limits, in words."""
    lines = []
    for name, counts in results.items():
        if counts["far"] > 0:
            lines.append(f"{name}: {counts['far']} ok beyond {HAZARD_M} m")
        if counts["beyond"] > max(1, MOST_BEYOND * counts["ok"]):
            lines.append(f"{name}: {counts['beyond']} of {counts['ok']} ok beyond their level")
        if name in distortions.UNSOLVABLE and counts["ok"] > 0:
            lines.append(f"{name}: {counts['ok']} ok")
    if "whole" in results and "noise_10" in results:
        clean, noisy = results["whole"]["ok"], results["noise_10"]["ok"]
        if noisy < LEAST_NOISY * clean:
            lines.append(f"noise_10: {noisy} ok, of clean ones {clean}")
    return lines


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
    parser.add_argument("--drives", default="", help="real ones, instead of simulated")
    parser.add_argument("--method", default="default")
    parser.add_argument("--limits", action="store_true")
    parser.add_argument("--anew", action="store_true")
    options = parser.parse_args()
    if options.anew:
        shutil.rmtree(options.folder, ignore_errors=True)
    if options.drives:
        worlds = [real(options, pathlib.Path(drive)) for drive in options.drives.split(",")]
    else:
        worlds = [simulated(options, scenario, int(seed)) for scenario in options.scenarios.split(",")
                  for seed in options.seeds.split(",")]
    print(f"| change | queries | ok | ok beyond {HAZARD_M} m | ok beyond level | median error cm | median level cm | "
          "explained by right ones | by those beyond |\n|---|---|---|---|---|---|---|---|---|")
    results = {}
    for name in options.sets.split(","):
        results.update(rows_of(name, worlds, options))
    (options.folder / "results.json").write_text(json.dumps(results, indent=1))
    lines = broken(results) if options.limits else []
    for line in lines:
        print(f"BROKEN {line}")
    return 1 if lines else 0


if __name__ == "__main__":
    sys.exit(main())
