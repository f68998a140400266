#!/usr/bin/env python3
"""How much an IMU helps odometry: simulated drives are followed with their IMU and without it.

usage: imu.py STILLMAP FOLDER [--worlds town:hand:1,town:fast:1,...] [--scans 200] [--sensor vlp16]
              [--methods default,loam] [--limits]

A world is SCENARIO:CARRIER:SEED (see mapping/simulation/README.md). FOLDER keeps the simulated drives.

Prints one row a drive and method: drift over 10 m [%] and [deg], and ATE [m], without the IMU and with it, and what was
found of the IMU. --limits: exit code 1 where the drift without an IMU is above 0.5 % and that with it is above half of
it, or where it is not and that with the IMU is above 1.05 times as much and 0.02 % more; and where the clock offset is
off by more than 5 ms on a drive with turns.
"""

import argparse
import json
import pathlib
import re
import subprocess
import sys

CLOCK_S = 0.037  # of mapping/simulation/sensing/imu_model.hpp
HIGH_PERCENT, MOST_OF_HIGH, MOST_ELSEWHERE, NOISE_PERCENT, CLOCK_OFF_S = 0.5, 0.5, 1.05, 0.02, 0.005


def run(program, *arguments):
    done = subprocess.run([program, *map(str, arguments)], capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"stillmap {' '.join(map(str, arguments))}: exit {done.returncode}\n{done.stderr}")
    return done.stdout


def evaluated(program, drive, method):
    return json.loads(run(program, "evaluate", "odometry", drive, "--odometry", method, "--loops", "off", "--json"))


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
    row = "{:<20}{:<9}{:>9}{:>9}{:>8}   {:>9}{:>9}{:>8}   {}"
    print(row.format("drive", "method", "10 m [%]", "[deg]", "ATE", "IMU: [%]", "[deg]", "ATE", "clock [s]"))
    for world in asked.worlds.split(","):
        scenario, carrier, seed = world.split(":")
        drive = asked.folder / f"{scenario}_{carrier}_{seed}_{asked.sensor}_{asked.scans}"
        if not drive.exists():
            run(asked.program, "simulate", scenario, "-o", drive, "--seed", seed, "--carrier", carrier, "--imu",
                "--layout", "pcd", "--sensor", asked.sensor, "--scans", asked.scans)
        for method in asked.methods.split(","):
            without, with_imu = (evaluated(asked.program, place, method) for place in (f"{drive}?imu=none", drive))
            figures = [(each["rpe"]["translation_percent_10m"], each["rpe"]["rotation_deg_10m"], each["ate_rmse_m"])
                       for each in (without, with_imu)]
            notes = " ".join(with_imu["notes"])
            clock = re.search(r"is used: .* Hz, ([-+.\d]+) s added", notes)
            print(row.format(world, method, *(f"{value:.3f}" for each in figures for value in each),
                             clock[1] if clock else notes), flush=True)
            before, after = (each[0] for each in figures)
            if before > HIGH_PERCENT and after > MOST_OF_HIGH * before:
                failures.append(f"{world} {method}: {before:.3f} % became {after:.3f} %, expected at most half")
            if before <= HIGH_PERCENT and after > MOST_ELSEWHERE * before + NOISE_PERCENT:
                failures.append(f"{world} {method}: {before:.3f} % became {after:.3f} %, expected within 5 %")
            if carrier != "vehicle" and (clock is None or abs(float(clock[1]) + CLOCK_S) > CLOCK_OFF_S):
                failures.append(f"{world} {method}: clock {clock[1] if clock else 'unknown'}, expected {-CLOCK_S}")
    for failure in failures:
        print("FAILED", failure)
    return 1 if asked.limits and failures else 0


if __name__ == "__main__":
    sys.exit(main())
