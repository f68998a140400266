#!/usr/bin/env python3
"""How many points of what was never there a map keeps: a mirror world below the road, rain, dust, a trailer, traffic
before a fixed sensor.

usage: run.py STILLMAP FOLDER [--kinds mirror,rain,dust,trailer,fixed] [--seed 1] [--scans 60] [--sensor hdl64]
              [--every 1] [--drives FOLDER] [--quick] [--limits]

A point is left when a measured map point lies within 0.1 m of it, and the map of the undisturbed drive has none there.
Prints, for each world, the points that were added, how many of them are left, and static loss, DA and parked removal of
its map; the same of the undisturbed drive. --every: each so many of the scans. --drives: where drives are kept and
found again, for another program.
--quick: counts only. --limits: exit code 1 when more is left or lost than LIMITS allow. Needs numpy (else exit 77).
"""

import argparse
import json
import pathlib
import shutil
import subprocess
import sys

try:
    import numpy as np
except ImportError:
    print("skipped: numpy is missing")
    sys.exit(77)

import worlds

KINDS = ("mirror", "rain", "dust", "trailer", "fixed")
MOVING = tuple(range(252, 260))
NEAR_M = 0.1
# Share of the added points that may be left, and of the static points that may be lost.
LIMITS = {"mirror": 0.12, "rain": 0.07, "dust": 0.08, "trailer": 0.01, "fixed": 0.01}
STATIC_LOSS = 0.0015


def run(program, *arguments):
    done = subprocess.run([program, *map(str, arguments)], capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"stillmap {' '.join(map(str, arguments))}: exit {done.returncode}\n{done.stderr}")


class Cells:
    """Points by cells of 0.1 m; finds whether one lies near."""

    def __init__(self, points):
        keys = self.key(self.cell(points))
        order = np.argsort(keys, kind="stable")
        self.keys, self.points = keys[order], points[order]

    @staticmethod
    def cell(points):
        return np.floor(points / NEAR_M).astype(np.int64) + (1 << 20)

    @staticmethod
    def key(cells):
        return (cells[:, 0] << 42) | (cells[:, 1] << 21) | cells[:, 2]

    def near(self, points):
        cells, found = self.cell(points), np.zeros(len(points), bool)
        for step in np.ndindex(3, 3, 3):
            keys = self.key(cells + np.array(step) - 1)
            begin, end = np.searchsorted(self.keys, keys), np.searchsorted(self.keys, keys, side="right")
            open_ = np.flatnonzero(~found & (end > begin))
            offset = 0
            while len(open_):
                at = begin[open_] + offset
                found[open_] |= ((self.points[at] - points[open_]) ** 2).sum(1) <= NEAR_M ** 2
                offset += 1
                open_ = open_[~found[open_] & (end[open_] > begin[open_] + offset)]
        return found


def read_ply(file):
    raw = file.read_bytes()
    end = raw.index(b"end_header\n") + len(b"end_header\n")
    types = {"double": "<f8", "float": "<f4", "uchar": "u1", "ushort": "<u2", "uint": "<u4", "int": "<i4", "char": "i1"}
    fields = [line.split()[1:] for line in raw[:end].decode().splitlines() if line.startswith("property")]
    rows = np.frombuffer(raw, np.dtype([(name, types[kind]) for kind, name in fields]), offset=end)
    return np.c_[rows["x"], rows["y"], rows["z"]]


def outliers(i, labels):
    return labels == worlds.OUTLIER


class Movers:
    """Points of what moves while it moves: half a metre or more within two seconds. What waits for as long as we look
    is there for all that a sensor can tell. Of a sensor that stands."""

    def __init__(self, drive):
        boxes = json.loads((drive.folder / "boxes.json").read_text())["scans"]
        self.centres = [{box["track"]: np.array(box["centre"]) for box in scan["boxes"]} for scan in boxes]

    def moves(self, i, track):
        near = [scan[track] for scan in self.centres[max(0, i - 10):i + 11] if track in scan]
        return len(near) > 1 and np.linalg.norm(near[-1] - near[0]) >= 0.5

    def __call__(self, i, labels):
        tracks = {track for track in np.unique(labels[np.isin(labels & 0xFFFF, MOVING)] >> 16) if self.moves(i, track)}
        return np.isin(labels & 0xFFFF, MOVING) & np.isin(labels >> 16, list(tracks))


def added_points(drive, is_added):
    """In the frame of the map, but for what every build drops: too near and too far."""
    found = []
    for i in range(len(drive.scans)):
        points, labels = drive.read(i)
        chosen = points[is_added(i, labels)]
        range_m = worlds.ranges_of(chosen)
        found.append(worlds.placed(drive.T_map_lidar[i], chosen[(range_m > 2.7) & (range_m < 80.0)]))
    return np.vstack(found)


class Measurement:
    def __init__(self, program, folder, quick):
        self.program, self.folder, self.quick = program, folder, quick

    def map_of(self, drive):
        """Measured points of the drive's default map, and its figures."""
        name = drive.folder.name
        made, ply, figures = (self.folder / f"{name}{end}" for end in ("_map", ".ply", ".json"))
        shutil.rmtree(made, ignore_errors=True)
        ply.unlink(missing_ok=True)
        run(self.program, "build", drive.folder, "-o", made, f"--json={self.folder / f'{name}_build.json'}")
        run(self.program, "export", made, "--format", "ply", "-o", ply, "--without", "projected,filled")
        if self.quick:
            return Cells(read_ply(ply)), None
        run(self.program, "evaluate", "map", made, "--truth", drive.folder, f"--json={figures}")
        return Cells(read_ply(ply)), json.loads(figures.read_text())

    def left(self, drive, is_added, reference):
        """What is left of the points whose labels `is_added` flags."""
        points, figures = self.map_of(drive)
        added = added_points(drive, is_added)
        left = points.near(added) & ~reference.near(added)
        np.save(self.folder / f"{drive.folder.name}_left.npy", added[left])
        return {"added": len(added), "left": int(left.sum()), **shares(figures)}


def shares(figures):
    if figures is None:
        return {}
    return {"static_loss": figures["static_loss"], "DA": figures["DA"], "parked_removal": figures["parked_removal"]}


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("program")
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--drives", type=pathlib.Path)
    parser.add_argument("--kinds", default=",".join(KINDS))
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--scans", type=int, default=60)
    parser.add_argument("--every", type=int, default=1)
    parser.add_argument("--sensor", default="hdl64")
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--limits", action="store_true")
    options = parser.parse_args()
    drives = options.drives or options.folder / "drives"
    for folder in (options.folder, drives):
        folder.mkdir(parents=True, exist_ok=True)
    kinds = options.kinds.split(",")
    measurement = Measurement(options.program, options.folder, options.quick)
    results = {}

    def made(name, make):
        if not (drives / name).exists():
            make(drives / name)
        return worlds.Drive(drives / name)

    def simulate(*more):
        return lambda target: run(options.program, "simulate", "town", "-o", target, "--seed", options.seed,
                                  "--sensor", options.sensor, "--truth", *more)

    if set(kinds) != {"fixed"}:
        calm = made("calm", simulate("--scans", options.scans, "--parked", 0.9))
        if options.every > 1:
            whole = calm
            calm = made("thinned", lambda target: whole.every(target, options.every))
        reference, figures = measurement.map_of(calm)
        results[calm.folder.name] = shares(figures)
    for kind in kinds:
        if kind == "fixed":
            disturbed = made("fixed", simulate("--standing", "--scans", 4 * options.scans))
            calm = made("fixed_calm", lambda target: worlds.without(disturbed, target, MOVING))
            reference, figures = measurement.map_of(calm)
            results["fixed_calm"] = shares(figures)
            results["fixed"] = measurement.left(disturbed, Movers(disturbed), reference)
        else:
            disturbed = made(kind, lambda target: getattr(worlds, kind)(calm, target, options.seed))
            results[kind] = measurement.left(disturbed, outliers, reference)
    return report(results, options)


def report(results, options):
    broken = 0
    for name, result in results.items():
        line = ", ".join(f"{key} {value if isinstance(value, int) else f'{100 * value:.3f} %'}"
                         for key, value in result.items() if value is not None)
        if "left" in result:
            share = result["left"] / max(result["added"], 1)
            line += f", left of added {100 * share:.3f} %"
            if options.limits:
                holds = share <= LIMITS[name] and result.get("static_loss", 0.0) <= STATIC_LOSS
                broken += not holds
                line = ("ok      " if holds else "BROKEN  ") + line
        print(f"{name}: {line}", flush=True)
    (options.folder / "results.json").write_text(json.dumps(results, indent=1))
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
