#!/usr/bin/env python3
"""What each way to clean a map removes, loses and costs, in one table: simulated streets with many parked cars, every
point labelled; labelled real scans beside them.

usage: cleaning.py STILLMAP FOLDER [--seeds 128,132,121] [--sensors hdl64,os1-64] [--scans 120] [--parked 0.95]
                   [--methods none,dufomap,...] [--real DRIVE]

FOLDER keeps drives and results; what is there already is not made again, so a run that was ended goes on. Seeds are
chosen by their share of points on parked cars (15 % and more), not by any result. --real takes the folder of a drive
with SemanticKITTI labels; one without poses must be a single scan.
"""

import argparse
import json
import pathlib
import shutil
import statistics
import subprocess

GEOMETRIC = ["--detector", "geometric"]
KEEP = ["--movable", "keep"] + GEOMETRIC
METHODS = {
    "none": KEEP + ["--clean", "none"],
    "removert": KEEP + ["--clean", "removert"],
    "erasor": KEEP + ["--clean", "erasor"],
    "octomap": KEEP + ["--clean", "octomap"],
    "dufomap": KEEP + ["--clean", "dufomap"],
    "free-space": KEEP + ["--clean", "free-space"],
    "paper, geometric": ["--preset", "paper"] + GEOMETRIC,
    "default, geometric": GEOMETRIC,
    "default": [],
    "paper, true boxes": ["--preset", "paper", "--detector", "boxes:{boxes}"],
    "default, true boxes": ["--detector", "boxes:{boxes}"],
}
COLUMNS = ["parked removal", "static loss", "SA moving", "DA moving", "SA movable", "DA movable", "F1 moving",
           "ground filled", "projected alone", "height median, p95 [cm]", "scans/s", "MiB"]


def run(program, *arguments):
    done = subprocess.run([program, *map(str, arguments)], capture_output=True, text=True)
    if done.returncode != 0:
        raise SystemExit(f"stillmap {' '.join(map(str, arguments))}: exit {done.returncode}\n{done.stderr}")


def simulate(program, folder, seed, sensor, scans, parked):
    drive = folder / f"town-{seed}-{sensor}"
    if not drive.exists():
        run(program, "simulate", "town", "-o", drive, "--seed", seed, "--sensor", sensor, "--scans", scans,
            "--parked", parked, "--truth")
    return drive


def with_poses(folder, drive):
    """A single scan needs no poses but its own."""
    if any((drive / name).exists() for name in ("poses.txt", "oxts")):
        return []
    poses = folder / "identity.txt"
    poses.write_text("1 0 0 0 0 1 0 0 0 0 1 0\n")
    return ["--poses", poses]


def measure(program, folder, drive, method):
    name = f"{drive.name}.{method.replace(', ', '-').replace(' ', '-')}"
    result = folder / f"{name}.json"
    if not result.exists():
        target = folder / f"{name}.map"
        shutil.rmtree(target, ignore_errors=True)
        options = [option.format(boxes=drive / "boxes.json") for option in METHODS[method]]
        run(program, "build", drive, "-o", target, *options, *with_poses(folder, drive),
            f"--json={folder / 'build.json'}")
        run(program, "evaluate", "map", target, "--truth", drive, f"--json={folder / 'evaluation.json'}")
        both = {"build": json.loads((folder / "build.json").read_text()),
                "map": json.loads((folder / "evaluation.json").read_text())}
        result.write_text(json.dumps(both))
        shutil.rmtree(target)
    return json.loads(result.read_text())


def figures(result):
    build, evaluation = result["build"], result["map"]
    heights = evaluation["filled_height_error_m"] or {}
    return [evaluation["parked_removal"], evaluation["static_loss"], evaluation["moving"]["SA"],
            evaluation["moving"]["DA"], evaluation["movable"]["SA"], evaluation["movable"]["DA"],
            evaluation["moving"]["F1"], evaluation["ground_completeness"],
            evaluation["ground_completeness_projected"], (heights.get("median"), heights.get("p95")),
            build["scans_per_second"], build["peak_rss_mib"]]


def text(column, values):
    if column.startswith("height"):
        pairs = [v for v in values if v[0] is not None]
        return ", ".join(f"{100 * statistics.mean(p[i] for p in pairs):.1f}" for i in (0, 1)) if pairs else "-"
    known = [v for v in values if v is not None]
    if not known:
        return "-"
    if column in ("scans/s", "MiB"):
        return f"{statistics.mean(known):.1f}" if column == "scans/s" else f"{max(known):.0f}"
    mean = f"{100 * statistics.mean(known):.2f}"
    worst = max(known) if column == "static loss" else min(known)
    return mean if len(known) == 1 else f"{mean} ({100 * worst:.2f})"


def print_table(rows):
    print("| | " + " | ".join(COLUMNS) + " |\n|" + "---|" * (len(COLUMNS) + 1))
    for method, results in rows.items():
        values = zip(*(figures(result) for result in results))
        print(f"| {method} | " + " | ".join(text(c, list(v)) for c, v in zip(COLUMNS, values)) + " |")


def print_ratios(rows, sensor):
    """Time of each method over that of the default, drive by drive in the same run."""
    ours = rows.get(f"{sensor}: default")
    for method, results in rows.items():
        if not ours or not method.startswith(sensor + ":"):
            continue
        ratios = [theirs["build"]["seconds"] / own["build"]["seconds"] for theirs, own in zip(results, ours)]
        print(f"{method}: {statistics.mean(ratios):.1f} times the time of the default")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program")
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--seeds", default="128,132,121")
    parser.add_argument("--sensors", default="hdl64,os1-64")
    parser.add_argument("--scans", type=int, default=120)
    parser.add_argument("--parked", type=float, default=0.95)
    parser.add_argument("--methods", help="names as in the table, parted by ';' (default: all)")
    parser.add_argument("--real", type=pathlib.Path)
    arguments = parser.parse_args()
    methods = arguments.methods.split(";") if arguments.methods else list(METHODS)
    arguments.folder.mkdir(parents=True, exist_ok=True)
    rows = {}
    for sensor in filter(None, arguments.sensors.split(",")):
        drives = [simulate(arguments.program, arguments.folder, seed, sensor, arguments.scans, arguments.parked)
                  for seed in arguments.seeds.split(",")]
        for method in methods:
            rows[f"{sensor}: {method}"] = [measure(arguments.program, arguments.folder, drive, method)
                                           for drive in drives]
            print(f"{sensor}: {method}: done", flush=True)
    if arguments.real:
        for method in methods:
            if "true boxes" not in method:
                rows[f"real: {method}"] = [measure(arguments.program, arguments.folder, arguments.real, method)]
    print("Percent; mean over the drives, the worst in brackets; peak memory of the worst.\n")
    print_table(rows)
    print()
    for sensor in filter(None, arguments.sensors.split(",")):
        print_ratios(rows, sensor)


if __name__ == "__main__":
    main()
