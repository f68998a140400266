#!/usr/bin/env python3
"""How often is the localizer wrong without saying so? Sets of queries on simulated drives with exact truth.

usage: run.py STILLMAP FOLDER [--set unsolvable|hard|nominal] [--seeds 24] [--queries 10000] [--quick]

What is done stays in FOLDER, so that a run that was killed goes on; README.md beside this file says what is asked.
Exit code 1 when a limit is broken. Needs NumPy and matplotlib (77, skipped, without them).
"""

import argparse
import datetime
import pathlib
import shutil
import subprocess
import sys

SKIPPED = 77
SETS = ("unsolvable", "hard", "nominal")


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program", metavar="STILLMAP")
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--set", choices=SETS, action="append", dest="sets")
    parser.add_argument("--seeds", type=int, default=24, help="worlds of each set")
    parser.add_argument("--queries", type=int, default=10000, help="of each set, about")
    parser.add_argument("--scans", type=int, default=300, help="of each simulated drive")
    parser.add_argument("--jobs", type=int, default=2, help="drives at the same time")
    parser.add_argument("--quick", action="store_true", help="what CI runs: of each set one seed, some 100 queries, a short drive")
    options = parser.parse_args()
    if options.quick:
        options.seeds, options.queries, options.scans = 1, 100, 60
    for name in ("seeds", "queries", "scans", "jobs"):
        if getattr(options, name) < 1:
            parser.error(f"--{name}: {getattr(options, name)}, >= 1")
    return options


def commit():
    here = pathlib.Path(__file__).resolve().parent
    done = subprocess.run(["git", "describe", "--always", "--dirty", "--abbrev=10"], cwd=here, capture_output=True,
                          text=True)
    return done.stdout.strip() or "unknown"


def main():
    options = arguments()
    try:
        import report
        from program import Program, write_json
    except ImportError as missing:
        print(f"skipped: {missing}")
        return SKIPPED
    program = Program(options.program)
    if options.quick:
        # Scripts change more often than programs, and CI asks for answers of today's.
        for name in options.sets or SETS:
            shutil.rmtree(options.folder / name, ignore_errors=True)
    result = {"date": datetime.date.today().isoformat(), "commit": commit(), "seeds": options.seeds,
              "queries": options.queries, "sets": {}}
    for name in options.sets or SETS:
        result["sets"][name] = report.run_set(name, program, options)
        write_json(options.folder / f"{name}.json", {**result, "sets": {name: result["sets"][name]}})
    broken = report.broken(result, options.quick)
    for line in broken:
        print(f"BROKEN {line}")
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
