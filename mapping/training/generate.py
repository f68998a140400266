#!/usr/bin/env python3
"""Makes the scans that the detector learns from and is validated on.

    generate.py DATA --program stillmap-training-scans --part train --drives 200
    generate.py DATA --program stillmap-training-scans --part validation --drives 24

Every drive is a world of its own: scenario, sensor, share of taken parking places, whether it is
busy, and seed follow from the part and the drive's number alone, so that the same command makes the same bytes, and a
second run with more drives adds to the first. Seeds: training 10,000 and up, validation 20,000 and
up, calibration of the scores 30,000 and up; the drives that judge maps elsewhere in this project
have seeds below 1,000.
"""

import argparse
import concurrent.futures
import json
import pathlib
import random
import subprocess
import time

FIRST_SEED = {"train": 10_000, "validation": 20_000, "calibration": 30_000}
SCENARIOS = (("town", 0.7), ("highway", 0.12), ("depot", 0.18))
SENSORS = (("hdl64", 0.3), ("os1-64", 0.22), ("os1-128", 0.08), ("vlp16", 0.08), ("random", 0.32))
# Validation looks at the two sensors of the published figures, half of the drives each.
VALIDATION_SENSORS = (("hdl64", 0.5), ("os1-64", 0.5))
# Worlds with many two-wheelers and people, and with hedges, walls, bins and poles by the kerb.
BUSY = {"train": 0.75, "validation": 0.5, "calibration": 0.5}
SCANS = {"train": 25, "validation": 15, "calibration": 15}
STRIDE = 12  # some 8 m of a town's street


def draw(rng, choices):
    return rng.choices([c for c, _ in choices], [w for _, w in choices])[0]


def random_sensor(rng):
    """A spinning sensor that nobody sells: the network shall not learn the pattern of a few."""
    beams = rng.choice([16, 32, 32, 40, 64, 64, 80, 128])
    top, bottom = rng.uniform(2.0, 22.0), rng.uniform(-30.0, -16.0)
    bend = rng.uniform(0.6, 1.0)  # below 1: beams are denser near the horizon
    elevations = []
    for i in range(beams):
        t = 2.0 * i / (beams - 1) - 1.0
        t = abs(t) ** (1.0 / bend) * (1 if t >= 0 else -1)
        elevations.append(round(top + (bottom - top) * (t + 1.0) / 2.0, 4))
    return {
        "format": "stillmap-sensor", "version": 1, "name": f"random-{beams}", "rate_hz": 10.0,
        "direction": rng.choice(["clockwise", "counter_clockwise"]),
        "columns": rng.choice([1024, 1800, 2048]),
        "min_range_m": rng.uniform(0.5, 2.0), "max_range_m": 120.0,
        "half_range_m": rng.uniform(70.0, 160.0),
        "range_noise_m": rng.uniform(0.008, 0.03), "ring_bias_m": rng.uniform(0.0, 0.015),
        "divergence_rad": rng.uniform(0.0008, 0.003), "height_m": rng.uniform(1.1, 2.6),
        "beams": [{"elevation_deg": e} for e in elevations],
    }


def drive_of(part, number, folder):
    """Arguments of one drive, and the file it becomes."""
    seed = FIRST_SEED[part] + number
    rng = random.Random(seed)
    sensors = SENSORS if part == "train" else VALIDATION_SENSORS
    scenario, sensor = draw(rng, SCENARIOS), draw(rng, sensors)
    file = folder / f"{part}-{number:05d}-{scenario}-{sensor}.stsc"
    description = random_sensor(rng)
    if sensor == "random":
        sensor = folder / "sensors" / f"{part}-{number:05d}.json"
        sensor.parent.mkdir(parents=True, exist_ok=True)
        sensor.write_text(json.dumps(description))
    arguments = ["--scenario", scenario, "--sensor", str(sensor), "--seed", str(seed),
                 "--scans", str(SCANS[part]), "--stride", str(STRIDE)]
    if scenario == "town":
        arguments += ["--parked", f"{rng.uniform(0.15, 1.0):.2f}"]
    if rng.random() < BUSY[part]:
        arguments.append("--busy")
    return arguments, file


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("data", type=pathlib.Path)
    parser.add_argument("--program", required=True)
    parser.add_argument("--part", choices=sorted(FIRST_SEED), default="train")
    parser.add_argument("--drives", type=int, default=200)
    parser.add_argument("--first", type=int, default=0, help="number of the first drive")
    parser.add_argument("--jobs", type=int, default=2)
    arguments = parser.parse_args()
    arguments.data.mkdir(parents=True, exist_ok=True)
    numbers = range(arguments.first, arguments.first + arguments.drives)
    start = time.monotonic()

    def make(number):
        options, file = drive_of(arguments.part, number, arguments.data)
        if not file.exists():
            subprocess.run([arguments.program, str(file), *options], check=True)

    with concurrent.futures.ThreadPoolExecutor(arguments.jobs) as pool:
        for done, _ in enumerate(pool.map(make, numbers), 1):
            seconds = time.monotonic() - start
            left = seconds / done * (arguments.drives - done)
            print(f"\r{done}/{arguments.drives} drives, {left:.0f} s left ", end="", flush=True)
    print()


if __name__ == "__main__":
    main()
