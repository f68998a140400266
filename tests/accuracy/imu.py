#!/usr/bin/env python3
"""How much an IMU helps odometry: simulated drives are followed with their IMU and without it.

usage: imu.py STILLMAP FOLDER [--worlds town:hand:1,town:fast:1,...] [--scans 200] [--sensor vlp16]
              [--methods default,loam] [--limits]

A world is SCENARIO:CARRIER:SEED (see mapping/simulation/README.md). FOLDER keeps the simulated drives. The IMU's clock
is late by up to 0.3 s of either sign, drawn from the world's name.

Prints one row a drive and method: drift over 10 m [%] and [deg], and ATE [m], without the IMU and with it, how far the
sensor turned [deg], and by how much the clock offset is off [ms], with its own sigma. Then with the method `default` the
same drives with wrong gyroscopes, which must not be used: one that always tells 0, one of the other sign, and one whose axes are permuted.

--limits: exit code 1 in any of these cases:
- The drift without the IMU is above 0.5 %, and that with it is above half of it.
- The drift without the IMU is not above 0.5 %, and that with it is above 1.05 times as much and 0.02 % more.
- The sensor turned by more than 60 deg, and the IMU is not used.
- The clock offset is off by more than 5 ms and by more than 3 of its sigmas.
- A wrong gyroscope is used.
"""

import argparse
import json
import math
import pathlib
import random
import re
import shutil
import subprocess
import sys

CLOCK_S = 0.037  # of mapping/simulation/sensing/imu_model.hpp
HIGH_PERCENT, MOST_OF_HIGH, MOST_ELSEWHERE, NOISE_PERCENT, CLOCK_OFF_S, CLOCK_SIGMAS = 0.5, 0.5, 1.05, 0.02, 0.005, 3.0
TURNS_DEG = 60.0
WRONG = {
    "zero": lambda w: [0.0, 0.0, 0.0],
    "negated": lambda w: [-value for value in w],
    "permuted": lambda w: [w[2], w[0], w[1]],
}


def run(program, *arguments):
    done = subprocess.run([program, *map(str, arguments)], capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"stillmap {' '.join(map(str, arguments))}: exit {done.returncode}\n{done.stderr}")
    return done.stdout


def evaluated(program, drive, method):
    return json.loads(run(program, "evaluate", "odometry", drive, "--odometry", method, "--loops", "off", "--json"))


def with_imu_of(drive, target, shift_s=0.0, change=lambda rates: rates):
    """The same drive, with other stamps or rates in its imu.csv."""
    shutil.rmtree(target, ignore_errors=True)
    target.mkdir()
    for file in drive.iterdir():
        if file.name != "imu.csv":
            (target / file.name).symlink_to(file.resolve())
    header, *lines = (drive / "imu.csv").read_text().splitlines()
    with (target / "imu.csv").open("w") as out:
        print(header, file=out)
        for line in lines:
            stamp, *values = line.split(",")
            values = [float(value) for value in values]
            print(int(stamp) + round(1e9 * shift_s), *change(values[:3]), *values[3:], sep=",", file=out)


def simulated(program, folder, world, sensor, scans):
    """The drive, and what has to be added to the stamps of its IMU [s]."""
    scenario, carrier, seed = world.split(":")
    shift_s = round(random.Random(world).uniform(-0.3, 0.3), 3)
    drive = folder / f"{scenario}_{carrier}_{seed}_{sensor}_{scans}"
    if not drive.exists():
        run(program, "simulate", scenario, "-o", drive, "--seed", seed, "--carrier", carrier, "--imu",
            "--layout", "pcd", "--sensor", sensor, "--scans", scans)
    shifted = drive.with_name(drive.name + "_shifted")
    with_imu_of(drive, shifted, shift_s)
    return shifted, -CLOCK_S - shift_s


def turned_deg(drive):
    """Sum of the true turns from scan to scan."""
    lines = (drive / "trajectory.txt").read_text().splitlines()
    quaternions = [[float(value) for value in line.split()[4:8]] for line in lines if line and not line.startswith("#")]
    cosines = (abs(sum(a * b for a, b in zip(*pair))) for pair in zip(quaternions, quaternions[1:]))
    return sum(math.degrees(2.0 * math.acos(min(1.0, cosine))) for cosine in cosines)


def faults_of(world, method, figures, turned, clock_off_s, sigma_s):
    """What is beyond the limits. clock_off_s is None where the IMU is not used."""
    without, with_imu = figures
    most = MOST_OF_HIGH * without if without > HIGH_PERCENT else MOST_ELSEWHERE * without + NOISE_PERCENT
    if with_imu > most:
        yield f"{world} {method}: {without:.3f} % became {with_imu:.3f} %, expected at most {most:.3f} %"
    if clock_off_s is None and turned > TURNS_DEG:
        yield f"{world} {method}: the IMU is not used, expected it after {turned:.0f} deg"
    if clock_off_s is not None and abs(clock_off_s) > max(CLOCK_OFF_S, CLOCK_SIGMAS * sigma_s):
        yield f"{world} {method}: clock {clock_off_s} s off, expected at most {CLOCK_OFF_S} s or {CLOCK_SIGMAS} sigmas"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program")
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--worlds", default="town:hand:1,town:fast:1,town:vehicle:1")
    parser.add_argument("--scans", type=int, default=200)
    parser.add_argument("--sensor", default="vlp16")
    parser.add_argument("--methods", default="default,loam")
    parser.add_argument("--limits", action="store_true")
    asked = parser.parse_args()
    asked.folder.mkdir(parents=True, exist_ok=True)
    failures = []
    row = "{:<20}{:<9}{:>9}{:>9}{:>8}   {:>9}{:>9}{:>8}{:>9}   {}"
    print(row.format("drive", "method", "10 m [%]", "[deg]", "ATE", "IMU: [%]", "[deg]", "ATE", "turned",
                     "clock off, sigma [ms]"))
    for world in asked.worlds.split(","):
        drive, clock_s = simulated(asked.program, asked.folder, world, asked.sensor, asked.scans)
        turned = turned_deg(drive)
        for method in asked.methods.split(","):
            without, with_imu = (evaluated(asked.program, place, method) for place in (f"{drive}?imu=none", drive))
            figures = [(each["rpe"]["translation_percent_10m"], each["rpe"]["rotation_deg_10m"], each["ate_rmse_m"])
                       for each in (without, with_imu)]
            notes = " ".join(with_imu["notes"])
            found = re.search(r"is used: .* Hz, ([-+.\d]+) s added to its stamps \(sigma ([.\d]+) s\)", notes)
            off_s, sigma_s = (round(float(found[1]) - clock_s, 4), float(found[2])) if found else (None, None)
            print(row.format(world, method, *(f"{value:.3f}" for each in figures for value in each), f"{turned:.0f}",
                             f"{1000 * off_s:.1f}, {1000 * sigma_s:.1f}" if found else notes), flush=True)
            failures += faults_of(world, method, [each[0] for each in figures], turned, off_s, sigma_s)
        for kind, change in WRONG.items() if "default" in asked.methods else ():
            wrong = drive.with_name(f"{drive.name}_{kind}")
            with_imu_of(drive, wrong, change=change)
            notes = " ".join(evaluated(asked.program, wrong, "default")["notes"])
            print(f"{world:<20}{kind:<9}{notes}", flush=True)
            if "is not used" not in notes:
                failures.append(f"{world}: a {kind} gyroscope is used")
            shutil.rmtree(wrong)
    for failure in failures:
        print("FAILED", failure)
    return 1 if asked.limits and failures else 0


if __name__ == "__main__":
    sys.exit(main())
