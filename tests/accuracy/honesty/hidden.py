#!/usr/bin/env python3
"""What odometry does with scans that show nothing of the surroundings: one to ten scans of a drive are replaced.

usage: hidden.py STILLMAP FOLDER [--drives DIR,DIR...] [--radii 0.2,0.5,1,2,4,8] [--noise 0.01,0.05] [--counts 1,3,10]
                 [--kinds shell,dust,again] [--scans 60] [--first] [--limits]

--drives: folders of KITTI's odometry or raw layout, or of PCD files in Scans/; none: a simulated town and a highway,
which are made in FOLDER. A shell puts each point of a scan on a sphere of that radius [m], with that noise [m]; dust
lies along the same rays, 5 m deep in the mean; again sends the scan before. The scans in the middle of the drive are
replaced; --first: the first ones. FOLDER keeps the simulated drives and is else of no use afterwards.

Prints one table: what was replaced, how far its scans and the largest of all later ones are from the path of the drive
as it was [m], and which scans were called hidden; `none` is the drive as it was, where none may be. With the first
scans replaced, the two paths are laid on each other first. --limits: exit code 1 where a scan is called hidden that is
not, or not where it is; where one scan is off by more than 0.1 m, or later ones by more than 0.02 m (0.04 m on the
highway, whose length little tells of: two runs of it differ by that much); after 3 and more by more than 0.05 m. Of
DIRS, whose key frames may be far apart, 3 and more may also lose the place, if that is said. Needs numpy (else exit 77).
"""

import argparse
import json
import os
import pathlib
import shutil
import subprocess
import sys

try:
    import numpy as np
except ImportError:
    print("skipped: numpy is missing")
    sys.exit(77)

PLACES = ("velodyne/*.bin", "velodyne_points/data/*.bin", "Scans/*.pcd", "*.pcd", "*.bin")
WORLDS = (("town", 7), ("highway", 12))
DUST_M = 5.0
OWN_M, LATER_M, LATER_HIGHWAY_M, AFTER_GAP_M = 0.1, 0.02, 0.04, 0.05


def run(program, *arguments):
    done = subprocess.run([program, *map(str, arguments)], capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"stillmap {' '.join(map(str, arguments))}: exit {done.returncode}\n{done.stderr}")


def scans_of(drive):
    for place in PLACES:
        if files := sorted(drive.glob(place)):
            return files
    sys.exit(f"{drive}: found no scans, expected one of {', '.join(PLACES)}")


class Scan:
    """Points of a .bin of four floats, or of a binary .pcd; what stands beside x y z stays."""

    def __init__(self, file):
        raw = file.read_bytes()
        self.head = b""
        if file.suffix == ".bin":
            self.table = np.frombuffer(raw, np.dtype([(name, "<f4") for name in "xyzi"])).copy()
            return
        mark = b"\nDATA binary\n"
        if mark not in raw:
            sys.exit(f"{file}: found another PCD, expected DATA binary")
        begin = raw.index(mark) + len(mark)
        self.head = raw[:begin]
        lines = {line.split()[0]: line.split()[1:] for line in self.head.decode().splitlines() if line.split()}
        counts = map(int, lines.get("COUNT", ["1"] * len(lines["FIELDS"])))
        kinds = {"F": "f", "U": "u", "I": "i"}
        columns = [(name if name in "xyz" else f"column {i}", f"<{kinds[kind]}{size}", (count,) if count > 1 else ())
                   for i, (name, kind, size, count) in enumerate(zip(lines["FIELDS"], lines["TYPE"], lines["SIZE"], counts))]
        self.table = np.frombuffer(raw, np.dtype(columns), int(lines["POINTS"][0]), begin).copy()

    def put_on(self, ranges_m):
        """@param ranges_m  of the true ones."""
        xyz = np.column_stack([self.table[name].astype(float) for name in "xyz"])
        true_m = np.linalg.norm(xyz, axis=1)
        seen = np.isfinite(true_m) & (true_m > 0.0)
        moved = xyz[seen] / true_m[seen, None] * ranges_m(true_m[seen])[:, None]
        for axis, name in enumerate("xyz"):
            self.table[name][seen] = moved[:, axis]

    def bytes(self):
        return self.head + self.table.tobytes()


def replaced(drive, out, numbers, change):
    """The drive with links to all of its files but those scans. @param change  (file, file before) -> bytes."""
    shutil.rmtree(out, ignore_errors=True)
    files = scans_of(drive)
    targets = {files[number]: number for number in numbers}
    made = out / "day" / drive.name
    for beside in drive.parent.glob("calib_*.txt"):  # KITTI raw has them there
        made.parent.mkdir(parents=True, exist_ok=True)
        os.symlink(beside.resolve(), made.parent / beside.name)
    for file in sorted(drive.rglob("*")):
        copy = made / file.relative_to(drive)
        if file.is_dir():
            copy.mkdir(parents=True, exist_ok=True)
        elif file in targets:
            copy.parent.mkdir(parents=True, exist_ok=True)
            copy.write_bytes(change(file, files[max(numbers[0] - 1, 0)]))
        else:
            copy.parent.mkdir(parents=True, exist_ok=True)
            os.symlink(file.resolve(), copy)
    return made


def change_of(kind, radius_m, noise_m):
    random = np.random.default_rng(29)

    def change(file, before):
        if kind == "again":
            return before.read_bytes()
        scan = Scan(file)
        if kind == "shell":
            scan.put_on(lambda true_m: radius_m + random.normal(0.0, noise_m, len(true_m)))
        else:
            scan.put_on(lambda true_m: np.minimum(np.maximum(random.exponential(DUST_M, len(true_m)), 0.3), true_m))
        return scan.bytes()

    return change


def follow(program, drive, work):
    """Places [m], numbers of the hidden scans, and of those that are begun anew."""
    poses = work / "poses.txt"
    # The drive's own are not looked at; some drives have none.
    poses.write_text("1 0 0 0 0 1 0 0 0 0 1 0\n" * len(scans_of(drive)))
    path, result = work / "path.txt", work / "result.json"
    run(program, "evaluate", "odometry", drive, "--loops", "off", "--poses", poses, "--trajectory", path, f"--json={result}")
    found = json.loads(result.read_text())
    return np.loadtxt(path)[:, 1:4], found["scans_hidden"], found["scans_begun_anew"]


def laid_on(path, other, seen):
    """The path where its scans that are seen lie best on the other one."""
    a, b = path[seen], other[seen]
    u, _, vt = np.linalg.svd((a - a.mean(0)).T @ (b - b.mean(0)))
    turn = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    return (path - a.mean(0)) @ turn + b.mean(0)


def cases_of(options):
    counts = [int(each) for each in options.counts.split(",")]
    for kind in options.kinds.split(","):
        if kind == "again" and options.first:
            continue
        shapes = [(float(r), float(n)) for r in options.radii.split(",") for n in options.noise.split(",")]
        for radius_m, noise_m in shapes if kind == "shell" else [(None, None)]:
            for count in counts:
                yield kind, radius_m, noise_m, count


def measure(program, drive, work, options, may_lose):
    """Prints the drive's rows. @param may_lose  the place, after 3 and more. @return whether limits are broken."""
    world = drive.name
    clean, hidden, anew = follow(program, drive, work)
    broken = bool(hidden or anew)
    print(f"{world:28} {'none':6} {'':6} {'':6} {0:5} {'':9} {'':9}  {hidden or 'none'}", flush=True)
    for kind, radius_m, noise_m, count in cases_of(options):
        begin = 0 if options.first else len(clean) // 2
        numbers = list(range(begin, min(begin + count, len(clean))))
        made = replaced(drive, work / "replaced", numbers, change_of(kind, radius_m, noise_m))
        path, hidden, anew = follow(program, made, work)
        seen = [i for i in range(len(clean)) if i not in numbers]
        if options.first:
            path = laid_on(path, clean, seen)
        off = np.linalg.norm(path - clean, axis=1)
        own_m, later_m = off[numbers].max(), off[numbers[-1] + 1:].max()
        told = "those" if hidden == numbers else f"{hidden}"
        print(f"{world:28} {kind:6} {radius_m or '':>6} {noise_m or '':>6} {count:5} {own_m:9.3f} {later_m:9.3f}  {told}"
              + (f"; begun anew at {anew}" if anew else ""), flush=True)
        # A drive that ends before five scans fit each other cannot be begun anew: all that is left is called hidden.
        said = may_lose and count > 1 and (bool(anew) or hidden == list(range(numbers[0], len(clean))))
        most_m = AFTER_GAP_M if count > 1 else LATER_HIGHWAY_M if "highway" in world else LATER_M
        broken |= (hidden != numbers or bool(anew) or later_m > most_m) and not said
        broken |= count == 1 and own_m > OWN_M
    return broken


def main():
    parser = argparse.ArgumentParser(usage=__doc__)
    parser.add_argument("program")
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--drives", default="")
    parser.add_argument("--radii", default="0.2,0.5,1,2,4,8")
    parser.add_argument("--noise", default="0.01,0.05")
    parser.add_argument("--counts", default="1,3,10")
    parser.add_argument("--kinds", default="shell,dust,again")
    parser.add_argument("--scans", type=int, default=60)
    parser.add_argument("--first", action="store_true")
    parser.add_argument("--limits", action="store_true")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    drives = [pathlib.Path(each) for each in options.drives.split(",") if each]
    for world, seed in WORLDS if not drives else ():
        drives.append(options.folder / world)
        if not drives[-1].exists():
            run(options.program, "simulate", world, "--seed", seed, "--scans", options.scans, "-o", drives[-1])
    print(f"{'world':28} {'kind':6} {'radius':>6} {'noise':>6} {'count':>5} {'own':>9} {'later':>9}  called hidden")
    broken = [drive.name for drive in drives if measure(options.program, drive, options.folder, options, bool(options.drives))]
    if broken and options.limits:
        print(f"limits are broken: {', '.join(broken)}")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
