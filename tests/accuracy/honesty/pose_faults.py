#!/usr/bin/env python3
"""Faults of given poses, put into simulated drives, and what is said of them: true number and found number.

usage: pose_faults.py STILLMAP FOLDER [--seeds 201,...] [--clean 20] [--scans 600] [--clean-scans 300] [--guided]
                      [--real FOLDER] [--limits]

For each seed a town is driven through; its poses are written as TUM files with one fault each and compared with the
scans' motion (`check-poses`, what `inspect --motion` runs; odometry runs once). Scans with mirrored axes are made from
the drive's own. --clean: so many other drives (town, highway and depot with several sensors) are compared with their
true poses and with disturbed ones (0.1 m and 0.1 deg, white and smooth): nothing may be said of any. --real: drives
below this folder that have poses, too. --guided: besides by odometry that looks where the poses say, as that of a
build does; once more for each fault. --limits: exit code 1 when a fault is not found, a number is off by more than its
limit, or something is said of a drive without fault. Needs numpy (else exit 77).
"""

import argparse
import json
import pathlib
import re
import shutil
import subprocess
import sys

try:
    import numpy as np
except ImportError:
    print("skipped: numpy is missing")
    sys.exit(77)

sys.path.insert(0, str(pathlib.Path(__file__).parent.parent / "disturbed"))
import given_poses
import worlds

EPOCH_S = 1_700_000_000
FEET = 1 / 0.3048
OFFSET_S, SCALE, TURN_DEG, LEVER_M, STEP = 0.02, 0.01, 1.0, 0.3, 0.05
SENSORS = ("hdl64", "os1-64", "os1-128", "vlp16", "avia")
WORLDS = ("town", "highway", "town", "depot")


def run(program, *arguments):
    done = subprocess.run([program, *map(str, arguments)], capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"stillmap {' '.join(map(str, arguments))}: exit {done.returncode}\n{done.stderr}")
    return done.stdout


def simulated(options, scenario, seed, sensor, scans):
    folder = options.folder / f"{scenario}_{seed}_{sensor}"
    if not folder.exists():
        run(options.program, "simulate", scenario, "-o", folder, "--seed", seed, "--sensor", sensor, "--scans", scans,
            "--parked", 0.5)
    return folder


def times_of(folder):
    return np.loadtxt(folder / "times.txt")


def quaternion(R):
    """x y z w"""
    w = np.sqrt(max(0.0, 1 + R[0, 0] + R[1, 1] + R[2, 2])) / 2
    x = np.sqrt(max(0.0, 1 + R[0, 0] - R[1, 1] - R[2, 2])) / 2
    y = np.sqrt(max(0.0, 1 - R[0, 0] + R[1, 1] - R[2, 2])) / 2
    z = np.sqrt(max(0.0, 1 - R[0, 0] - R[1, 1] + R[2, 2])) / 2
    return [np.copysign(x, R[2, 1] - R[1, 2]) if w > 1e-3 else x, np.copysign(y, R[0, 2] - R[2, 0]) if w > 1e-3 else y,
            np.copysign(z, R[1, 0] - R[0, 1]) if w > 1e-3 else z, w]


def write_tum(file, times, poses, position="{:.6f}"):
    with open(file, "w") as out:
        for t, T in zip(times, poses):
            place = " ".join(position.format(value) for value in T[:3, 3])
            out.write(f"{t:.9f} {place} {' '.join(f'{v:.12f}' for v in quaternion(T[:3, :3]))}\n")
    return file


def placed(roll, pitch, yaw, x=0, y=0, z=0):
    T = np.eye(4)
    cr, sr, cp, sp, cy, sy = (f(np.radians(a)) for a in (roll, pitch, yaw) for f in (np.cos, np.sin))
    T[:3, :3] = (np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]]) @ np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
                 @ np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]]))
    T[:3, 3] = x, y, z
    return T


def scaled(poses, factor):
    return [np.block([[T[:3, :3], factor * T[:3, 3:]], [np.zeros((1, 3)), np.ones((1, 1))]]) for T in poses]


def moved(poses, by):
    return [np.block([[T[:3, :3], T[:3, 3:] + np.reshape(by, (3, 1))], [np.zeros((1, 3)), np.ones((1, 1))]])
            for T in poses]


def numbers_in(text):
    return [float(each) for each in re.findall(r"-?\d+\.?\d*(?:e[-+]?\d+)?", text)]


def told(findings, code):
    return next((each for each in findings if each["code"] == code), None)


class Fault:
    """A fault: how poses are written with it, and how far what is found may be from the truth."""

    def __init__(self, name, code, true, limit, write):
        self.name, self.code, self.true, self.limit, self.write = name, code, np.atleast_1d(true), limit, write

    def found(self, findings):
        finding = told(findings, self.code)
        if finding is None:
            return None
        return np.array({"pose_clock": self.clock, "pose_clocks": self.clocks, "pose_scale": self.scale,
                         "pose_frame": self.frame, "coarse_positions": self.step}[self.code](finding))

    def clock(self, finding):
        return numbers_in(finding["remedy"].split("offset")[1])[:1]

    def clocks(self, finding):
        return numbers_in(finding["what"].split("with", 1)[1])[:2]

    def scale(self, finding):
        return numbers_in(finding["what"].split("are", 1)[1])[:1]

    def frame(self, finding):
        values = numbers_in(finding["what"].split("yaw", 1)[1])
        return (values + [0, 0, 0])[:6][:len(self.true)]

    def step(self, finding):
        return numbers_in(finding["what"].split("steps of", 1)[1])[:1]

    def is_right(self, found):
        if self.code == "pose_frame":
            off = placed(*self.true[:3])[:3, :3].T @ placed(*found[:3])[:3, :3]
            turn = np.degrees(np.arccos(np.clip((np.trace(off) - 1) / 2, -1, 1)))
            return turn <= self.limit and np.all(np.abs(found[3:5] - self.true[3:5]) <= LEVER_M)
        if self.code in ("pose_scale", "coarse_positions"):
            return bool(np.all(np.abs(found / self.true - 1) <= self.limit))
        return bool(np.all(np.abs(found - self.true) <= self.limit))


def faults_of(times, poses):
    middle = times[len(times) // 2]
    utm = np.array([483021.3, 5455123.7, 301.2])

    def clock(early_s):
        return lambda file: write_tum(file, times - early_s, poses)

    def frame(*place):
        T_inverse = np.linalg.inv(placed(*place))
        return lambda file: write_tum(file, times, [T @ T_inverse for T in poses])

    def as_floats(file):
        return write_tum(file, times, [np.block([[T[:3, :3], T[:3, 3:].astype(np.float32).astype(float)],
                                                 [np.zeros((1, 3)), np.ones((1, 1))]]) for T in moved(poses, utm)])

    faults = [Fault(f"clocks {early_s} s apart", "pose_clock", early_s, OFFSET_S, clock(early_s))
              for early_s in (0.1, -0.1, 0.5, 3.0, -37.0, 37.0) if abs(early_s) < 0.7 * (times[-1] - times[0])]
    faults += [
        Fault("two clocks, a step", "pose_clocks", (0.5, 0.1), 0.05,
              lambda file: write_tum(file, times - np.where(times < middle, 0.5, 0.1), poses)),
        Fault("two clocks, a drift of 1 %", "pose_clocks", (0.0025 * times[-1], 0.0075 * times[-1]), 0.1,
              lambda file: write_tum(file, times - 0.01 * times, poses)),
        Fault("UTM with 6 digits", "coarse_positions", 10.0, STEP,
              lambda file: write_tum(file, times, moved(poses, utm), "{:.6g}")),
        Fault("UTM as 32-bit floats", "coarse_positions", 0.5, STEP, as_floats),
        Fault("one decimal", "coarse_positions", 0.1, STEP, lambda file: write_tum(file, times, poses, "{:.1f}")),
        Fault("feet", "pose_scale", FEET, SCALE, lambda file: write_tum(file, times, scaled(poses, FEET))),
        Fault("wheels, 2 % too long", "pose_scale", 1.02, SCALE,
              lambda file: write_tum(file, times, scaled(poses, 1.02)))]
    # Halves of a short drive differ too little.
    if times[-1] > 50:
        faults.append(Fault("two clocks, a drift of 0.3 %", "pose_clocks", (0.00075 * times[-1], 0.00225 * times[-1]),
                            0.05, lambda file: write_tum(file, times - 0.003 * times, poses)))
    for name, place in (("lidar turned by 90 deg", (0, 0, 90)), ("lidar turned by 180 deg", (0, 0, 180)),
                        ("poses of a camera", (90, -90, 0)), ("lidar pitched by 5 deg", (0, 5, 0)),
                        ("poses of the rear axle", (0, 0, 0, 1.5, 0, 0)),
                        ("body, turned and apart", (2, -3, 30, 1.2, -0.4, 0))):
        faults.append(Fault(name, "pose_frame", place, TURN_DEG, frame(*place)))
    return faults


def mirrored(folder, axis):
    """The drive with an axis of its scans turned round."""
    made = folder.parent / f"{folder.name}_mirrored_{axis}"
    if not made.exists():
        shutil.copytree(folder, made, ignore=shutil.ignore_patterns("velodyne", "labels", "truth*"))
        (made / "velodyne").mkdir()
        for scan in sorted((folder / "velodyne").glob("*.bin")):
            points = np.fromfile(scan, np.float32).reshape(-1, 4)
            points[:, "xyz".index(axis)] *= -1
            points.tofile(made / "velodyne" / scan.name)
    return made


class Table:
    def __init__(self):
        self.broken = []

    def row(self, drive, name, true, found, findings, right):
        others = ", ".join(each["code"] for each in findings)
        print(f"| {drive} | {name} | {true} | {found} | {others or '-'} | {'' if right else 'WRONG'} |", flush=True)
        if not right:
            self.broken.append(f"{drive}, {name}")
            for each in findings:
                print(f"    {each['what']}; {each['remedy']}", flush=True)


def text_of(values):
    return "nothing" if values is None else " ".join(f"{value:.3f}".rstrip("0").rstrip(".") for value in values)


def checked(options, folder, files, guided=False):
    return json.loads(run(options.program, "check-poses", folder, *(["--poses", *files] if files else []),
                          *(["--guided"] if guided else [])))


def scan_folder(options, folder, file, most):
    """The drive's first scans in a folder, named by their stamps, with the file of poses."""
    made = options.folder / "scan_folder"
    shutil.rmtree(made, ignore_errors=True)
    (made / "scans").mkdir(parents=True)
    for t, scan in list(zip(times_of(folder), sorted((folder / "velodyne").glob("*.bin"))))[:most]:
        (made / "scans" / f"{round((EPOCH_S + t) * 1e3) * 1_000_000}.bin").symlink_to(scan.resolve())
    with open(file) as lines, open(made / "poses.tum", "w") as out:
        for line in lines:
            stamp, rest = line.split(" ", 1)
            out.write(f"{EPOCH_S + float(stamp):.9f} {rest}")
    return made


def inspected(options, folder, *words):
    return json.loads(run(options.program, "inspect", folder, "--json", *words))["findings"]


def built(options, folder, *words):
    made, report = options.folder / "map", options.folder / "report.json"
    shutil.rmtree(made, ignore_errors=True)
    run(options.program, "build", folder, "-o", made, "--detector", "geometric", "--clean", "none", "--voxel", 0.5,
        f"--json={report}", *words)
    shutil.rmtree(made)
    return json.loads(report.read_text())


def compare_programs(options, table):
    """`inspect --motion`, `build`, and what `--pose-time-offset` makes of it."""
    folder = simulated(options, "town", 203, "vlp16", 200)
    times, poses = times_of(folder), worlds.Drive(folder).T_map_lidar
    fault = Fault("clocks 0.5 s apart", "pose_clock", 0.5, OFFSET_S, None)
    drive = scan_folder(options, folder, write_tum(options.folder / "late.tum", times - 0.5, poses), 200)
    for way, findings in (("inspect --motion", inspected(options, drive, "--motion")),
                          ("build", built(options, drive)["pose_faults"])):
        found = fault.found(findings)
        table.row("town 203", f"{fault.name}, {way}", "0.5", text_of(found), findings,
                  found is not None and fault.is_right(found) and len(findings) == 1)
    report = built(options, drive, "--pose-time-offset", "auto")
    found = np.array(report["found_pose_time_offsets_s"])
    table.row("town 203", "the same, --pose-time-offset auto", "0.5", text_of(found), report["pose_faults"],
              fault.is_right(found) and not report["pose_faults"])
    findings = built(options, drive, "--pose-time-offset", 0.5)["pose_faults"]
    table.row("town 203", "the same, --pose-time-offset 0.5", "nothing", "something" if findings else "nothing",
              findings, not findings)


def compare_faults(options, seed, table):
    folder = simulated(options, "town", seed, "hdl64", options.scans)
    times, poses = times_of(folder), worlds.Drive(folder).T_map_lidar
    work = options.folder / f"poses_{seed}"
    work.mkdir(exist_ok=True)
    faults = faults_of(times, poses)
    files = [fault.write(work / f"{number}.tum") for number, fault in enumerate(faults)]
    by_guided = checked(options, folder, files, True) if options.guided else [None] * len(files)
    for fault, file, findings, guided in zip(faults, files, checked(options, folder, files), by_guided):
        if fault.code == "coarse_positions":
            findings += [each for each in inspected(options, scan_folder(options, folder, file, 30))
                         if each["code"] == "coarse_positions"]
        ways = {"": findings}
        if guided is not None and fault.code != "coarse_positions":
            ways[", guided"] = guided
        for way, found_so in ways.items():
            found = fault.found(found_so)
            right = found is not None and fault.is_right(found) and len(found_so) == 1
            table.row(f"town {seed}", fault.name + way, text_of(fault.true), text_of(found), found_so, right)
    for axis in "xyz":
        drive = mirrored(folder, axis)
        ways = {"": checked(options, drive, [])[0]}
        if options.guided:
            ways[", guided"] = checked(options, drive, [], True)[0]
        for way, findings in ways.items():
            finding = told(findings, "mirrored_axis")
            found = finding and re.search(r"axes: (\w) ", finding["what"]).group(1)
            table.row(f"town {seed}", f"{axis} turned round{way}", axis, found, findings,
                      found == axis and len(findings) == 1)


def clean_poses(options, folder, seed):
    times, poses = times_of(folder), worlds.Drive(folder).T_map_lidar
    files = {"true": write_tum(folder / "true.tum", times, poses)}
    for kind in ("white", "smooth"):
        files[kind] = write_tum(folder / f"{kind}.tum", times,
                                given_poses.disturbed(poses, kind, 0.1, 0.1, options.noise, seed))
    return files


def compare_clean(options, table):
    for number in range(options.clean):
        seed, scenario, sensor = 300 + number, WORLDS[number % len(WORLDS)], SENSORS[number % len(SENSORS)]
        folder = simulated(options, scenario, seed, sensor, options.clean_scans)
        files = clean_poses(options, folder, seed)
        for name, findings in zip(files, checked(options, folder, list(files.values()))):
            table.row(f"{scenario} {seed} {sensor}", f"{name} poses", "nothing",
                      "nothing" if not findings else "something", findings, not findings)
        if not options.keep:
            shutil.rmtree(folder)


def compare_real(options, table):
    for place in ("kitti_raw/2011_09_26/2011_09_26_drive_0013_sync", "mulran_seosan01", "hku_1"):
        if (options.real / place).exists():
            findings = checked(options, options.real / place, [])[0]
            table.row(place, "its own poses", "nothing", "nothing" if not findings else "something", findings,
                      not findings)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program")
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--seeds", default="201")
    parser.add_argument("--scans", type=int, default=600)
    parser.add_argument("--clean", type=int, default=20)
    parser.add_argument("--clean-scans", type=int, default=300)
    parser.add_argument("--noise", type=int, default=1)
    parser.add_argument("--real", type=pathlib.Path)
    parser.add_argument("--guided", action="store_true")
    parser.add_argument("--keep", action="store_true", help="keep the drives of --clean")
    parser.add_argument("--limits", action="store_true")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    print("| drive | fault | true | found | said | |\n|---|---|---|---|---|---|")
    table = Table()
    for seed in filter(None, options.seeds.split(",")):
        compare_faults(options, int(seed), table)
    if options.seeds:
        compare_programs(options, table)
    compare_clean(options, table)
    if options.real:
        compare_real(options, table)
    for each in table.broken:
        print(f"WRONG {each}")
    sys.exit(1 if options.limits and table.broken else 0)


if __name__ == "__main__":
    main()
