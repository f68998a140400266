#!/usr/bin/env python3
"""Where a build spends its time: CPU a scan, how busy the cores are, and each stage; two programs in turns.

usage: build_profile.py STILLMAP FOLDER [--against OTHER] [--real DRIVE ...] [--options "--detector geometric"]
                        [--repeat 5] [--sensors hdl64,os1-64] [--scans 80]

FOLDER keeps simulated drives (town, seed 5). Programs take turns, so that what else runs on the machine meets both;
figures are medians. A stage's time is that of the threads in it, waiting for a core included, so it is more than its
CPU where cores are few. `waits` is the time of the cores without work of ours: idle, or at work for others.
"""

import argparse
import json
import os
import pathlib
import resource
import shutil
import statistics
import subprocess
import time


def simulated(program, folder, sensor, scans):
    drive = folder / f"town-{sensor}-{scans}"
    if not drive.exists():
        subprocess.run([program, "simulate", "town", "-o", drive, "--seed", "5", "--sensor", sensor,
                        "--scans", str(scans)], check=True, capture_output=True)
    return drive


def build(program, drive, folder, options):
    """Figures of one build, by name."""
    target = folder / "map"
    shutil.rmtree(target, ignore_errors=True)
    report = folder / "build.json"
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
    done = subprocess.run([program, "build", drive, "-o", target, f"--json={report}", *options],
                          capture_output=True, text=True)
    wall = time.monotonic() - start
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode != 0:
        raise SystemExit(f"{program} build {drive}: exit {done.returncode}\n{done.stderr}")
    result = json.loads(report.read_text())
    shutil.rmtree(target)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    scans = result["scans"]
    figures = {"CPU": 1e3 * cpu / scans, "wall": 1e3 * wall / scans,
               "waits": 1e3 * (wall * os.cpu_count() - cpu) / scans}
    figures.update({f"  {stage}": 1e3 * seconds / scans for stage, seconds in result["stage_seconds"].items()})
    figures["busy [%]"] = 100 * cpu / wall / os.cpu_count()
    figures["peak [MiB]"] = result["peak_rss_mib"]
    return figures


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("program", type=pathlib.Path)
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--against", type=pathlib.Path, help="another stillmap to compare with")
    parser.add_argument("--real", type=pathlib.Path, nargs="*", default=[], help="drives besides the simulated ones")
    parser.add_argument("--options", default="", help="of both builds")
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--sensors", default="hdl64,os1-64")
    parser.add_argument("--scans", type=int, default=80)
    arguments = parser.parse_args()
    arguments.folder.mkdir(parents=True, exist_ok=True)
    programs = [p for p in (arguments.against, arguments.program) if p]
    drives = list(arguments.real)
    for sensor in filter(None, arguments.sensors.split(",")):
        drives.append(simulated(arguments.program, arguments.folder, sensor, arguments.scans))
    for drive in drives:
        runs = {p: [] for p in programs}
        for _ in range(arguments.repeat):
            for program in programs:
                runs[program].append(build(program, drive, arguments.folder, arguments.options.split()))
        medians = [{name: statistics.median(run.get(name, 0.0) for run in runs[p]) for name in runs[programs[-1]][0]}
                   for p in programs]
        print(f"{drive.name}, {arguments.repeat} runs: ms a scan")
        for name in medians[-1]:
            values = [m[name] for m in medians]
            ratio = f"{values[-1] / values[0]:8.2f}" if len(values) > 1 and values[0] > 0 else ""
            print(f"{name:16}" + "".join(f"{v:10.1f}" for v in values) + ratio, flush=True)


if __name__ == "__main__":
    main()
