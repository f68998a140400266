#!/usr/bin/env python3
"""What maps lose when given poses are off: simulated streets whose poses are made worse on purpose.

usage: given_poses.py STILLMAP FOLDER [--seeds 141,142] [--scans 100] [--parked 0.9] [--levels 0.02:0.05,0.1:0.1,...]
                      [--kinds white,smooth] [--noise DATE] [--reference STILLMAP] [--exact] [--limits] [--anew]
                      [--scenario town] [--relative]

A level is METRES:DEGREES, the deviation of a pose in each direction. White errors are of each scan on its own; smooth
ones are sums of 24 waves of 2 to 10 s. --noise: a number, today's date for one, that draws them. --reference: another
program that builds the same drives. --exact: build with `--given-poses exact`, so that cleaning alone has to cope.
--limits: exit code 1 when a limit is broken: of levels up to 0.1 m and 0.1 deg thin things (poles, signs, trunks) lose
at most 1 %, all that stays at most 0.15 %, parked removal and DA fall by at most 0.3 points against true poses; beyond,
at most a tenth of what the reference loses. --relative: instead of what maps lose, how far motions between scans that
are 10, 30 and 100 m of way apart are off, of the poses as given and of those of the map. Results are kept in FOLDER, so
that a run that was ended goes on; --anew measures again. Needs numpy (else exit 77).
"""

import argparse
import json
import pathlib
import shutil
import subprocess
import sys
import zlib

try:
    import numpy as np
except ImportError:
    print("skipped: numpy is missing")
    sys.exit(77)

import worlds

THIN = ("pole", "traffic sign", "trunk")
LEVELS = "0.02:0.05,0.05:0.05,0.1:0.1,0.2:0.3"
RATE_HZ = 9.65
WAVES = 24
WAYS_M = (10, 30, 100)


def run(program, *arguments):
    done = subprocess.run([program, *map(str, arguments)], capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"stillmap {' '.join(map(str, arguments))}: exit {done.returncode}\n{done.stderr}")


def rotation(vector):
    angle = np.linalg.norm(vector)
    if angle < 1e-12:
        return np.eye(3)
    x, y, z = vector / angle
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K


def errors_of(count, kind, random):
    """`count` rows of six numbers, each of deviation 1."""
    if kind == "white":
        return random.standard_normal((count, 6))
    time_s = np.arange(count) / RATE_HZ
    errors = np.zeros((count, 6))
    for column in range(6):
        period_s, phase = random.uniform(2, 10, WAVES), random.uniform(0, 2 * np.pi, WAVES)
        size = random.standard_normal(WAVES) * np.sqrt(2 / WAVES)
        errors[:, column] = (size * np.sin(2 * np.pi * time_s[:, None] / period_s + phase)).sum(axis=1)
    return errors


def disturbed(T_map_lidar, kind, metres, degrees, noise, seed):
    random = np.random.default_rng([noise, seed, zlib.crc32(kind.encode())])
    poses = []
    for T, error in zip(T_map_lidar, errors_of(len(T_map_lidar), kind, random)):
        D = np.eye(4)
        D[:3, :3], D[:3, 3] = rotation(np.radians(degrees) * error[3:]), metres * error[:3]
        poses.append(T @ D)
    return poses


def read_kitti(file):
    return [worlds.matrix(row) for row in np.loadtxt(file, ndmin=2)]


def read_tum(file):
    poses = []
    for row in np.loadtxt(file, ndmin=2):
        x, y, z, w = row[4:]
        T = np.eye(4)
        T[:3, 3] = row[1:4]
        T[:3, :3] = [[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                     [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                     [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]]
        poses.append(T)
    return poses


def relative_errors_m(true, poses, way_m):
    """Median and largest error of motions between scans so far apart along the way; None where the drive is shorter."""
    positions = np.array([T[:3, 3] for T in true])
    way = np.r_[0, np.cumsum(np.linalg.norm(np.diff(positions, axis=0), axis=1))]
    errors_m = []
    for i in range(len(true)):
        j = int(np.searchsorted(way, way[i] + way_m))
        if j == len(true):
            break
        right, found = np.linalg.inv(true[i]) @ true[j], np.linalg.inv(poses[i]) @ poses[j]
        errors_m.append(np.linalg.norm((np.linalg.inv(right) @ found)[:3, 3]))
    return [float(np.median(errors_m)), float(np.max(errors_m))] if errors_m else None


class Street:
    def __init__(self, options, seed):
        self.options, self.seed = options, seed
        self.folder = options.folder / f"{options.scenario}_{seed}"
        if not self.folder.exists():
            run(options.program, "simulate", options.scenario, "-o", self.folder, "--seed", seed, "--scans",
                options.scans, "--parked", options.parked, "--truth")

    def measured(self, program, name, kind, level):
        """Figures of the map of a program by these poses."""
        tag = f"{self.options.scenario}_{name}_{self.seed}_{kind}_{level}_{self.options.noise}".replace(":", "_")
        if self.options.relative:
            tag += "_relative"
        result, made = self.options.folder / f"{tag}.json", self.options.folder / f"{tag}_map"
        if self.options.anew or not result.exists():
            shutil.rmtree(made, ignore_errors=True)
            run(program, "build", self.folder, "-o", made, *self.poses(kind, level, tag),
                *(["--given-poses", "exact"] if self.options.exact and name == "new" else []))
            if self.options.relative:
                result.write_text(json.dumps(self.relative_errors(made, tag)))
            else:
                run(program, "evaluate", "map", made, "--truth", self.folder, f"--json={result}")
            shutil.rmtree(made)
        return json.loads(result.read_text())

    def relative_errors(self, made, tag):
        true = worlds.Drive(self.folder).T_map_lidar
        file = self.options.folder / f"{tag}.txt"
        given = read_kitti(file) if file.exists() else true
        refined = read_tum(made / "trajectory.tum")
        return {str(way_m): {name: relative_errors_m(true, poses, way_m)
                             for name, poses in (("given", given), ("map", refined))} for way_m in WAYS_M}

    def poses(self, kind, level, tag):
        if kind == "true":
            return []
        metres, degrees = map(float, level.split(":"))
        poses = disturbed(worlds.Drive(self.folder).T_map_lidar, kind, metres, degrees, self.options.noise, self.seed)
        file = self.options.folder / f"{tag}.txt"
        np.savetxt(file, np.array(poses)[:, :3, :].reshape(-1, 12), fmt="%.9f")
        return ["--poses", file]


def figures_of(evaluation):
    thin = [evaluation["static_loss_by_class"][name] for name in THIN if name in evaluation["static_loss_by_class"]]
    lost = sum(max(0, each["lost"] - each["lost_uncleaned"]) for each in thin)
    return {"thin_loss": lost / max(1, sum(each["points"] for each in thin)),
            "static_loss": evaluation["static_loss"], "parked_removal": evaluation["parked_removal"],
            "DA": evaluation["moving"]["DA"]}


class Checks:
    def __init__(self):
        self.broken = 0

    def __call__(self, what, holds):
        if not holds:
            print(f"BROKEN {what}")
            self.broken += 1

    def small(self, name, found, true):
        self(f"{name}: thin things lose at most 1 %", found["thin_loss"] <= 0.01)
        self(f"{name}: all that stays loses at most 0.15 %", found["static_loss"] <= 0.0015)
        for figure in ("parked_removal", "DA"):
            self(f"{name}: {figure} at most 0.3 points below true poses", found[figure] >= true[figure] - 0.003)

    def large(self, name, found, reference):
        for figure in ("thin_loss", "static_loss"):
            self(f"{name}: {figure} a tenth of the reference's", found[figure] <= 0.1 * reference[figure])


def row(name, cells):
    print(f"| {name} | " + " | ".join(cells) + " |", flush=True)


def relative_row(name, errors):
    for poses in ("given", "map"):
        row(f"{name}, {poses}", ["-" if each[poses] is None else "{:.1f}, {:.1f}".format(*np.multiply(100, each[poses]))
                                 for each in errors.values()])


def losses_row(name, figures):
    row(name, [f"{100 * figures[key]:.3f}" for key in ("thin_loss", "static_loss", "parked_removal", "DA")])


def compare_relative(options):
    print("| poses | " + " | ".join(f"{way_m} m: median, largest cm" for way_m in WAYS_M) + " |\n|---"
          + "|---" * len(WAYS_M) + "|")
    for seed in map(int, options.seeds.split(",")):
        street = Street(options, seed)
        relative_row(f"{options.scenario} {seed}, true", street.measured(options.program, "new", "true", "0"))
        for level in options.levels.split(","):
            for kind in options.kinds.split(","):
                relative_row(f"{options.scenario} {seed}, {kind} {level.replace(':', ' m, ')} deg",
                             street.measured(options.program, "new", kind, level))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program")
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--seeds", default="141,142")
    parser.add_argument("--scans", type=int, default=100)
    parser.add_argument("--parked", type=float, default=0.9)
    parser.add_argument("--levels", default=LEVELS)
    parser.add_argument("--kinds", default="white,smooth")
    parser.add_argument("--noise", type=int, default=1)
    parser.add_argument("--reference")
    parser.add_argument("--exact", action="store_true")
    parser.add_argument("--limits", action="store_true")
    parser.add_argument("--anew", action="store_true")
    parser.add_argument("--scenario", default="town")
    parser.add_argument("--relative", action="store_true")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    if options.relative:
        compare_relative(options)
        return 0
    check = Checks()
    print("| poses | poles, signs, trunks lost % | static loss % | parked removal % | DA % |\n|---|---|---|---|---|")
    for seed in map(int, options.seeds.split(",")):
        street = Street(options, seed)
        true = figures_of(street.measured(options.program, "new", "true", "0"))
        losses_row(f"street {seed}, true", true)
        for level in options.levels.split(","):
            for kind in options.kinds.split(","):
                name = f"street {seed}, {kind} {level.replace(':', ' m, ')} deg"
                found = figures_of(street.measured(options.program, "new", kind, level))
                losses_row(name, found)
                metres, degrees = map(float, level.split(":"))
                if metres <= 0.1 and degrees <= 0.1:
                    check.small(name, found, true)
                if options.reference:
                    reference = figures_of(street.measured(options.reference, "reference", kind, level))
                    losses_row(f"{name}, reference", reference)
                    if metres > 0.1 or degrees > 0.1:
                        check.large(name, found, reference)
    return 1 if options.limits and check.broken else 0


if __name__ == "__main__":
    sys.exit(main())
