#!/usr/bin/env python3
"""Whether answers contradict each other: a scan whole and in parts, each asked from the same prior.

usage: pairs.py STILLMAP FOLDER [DRIVE...] [--prior-error 1,5] [--limits]

A map of each drive's even scans is made in FOLDER; odd scans are asked for whole, as halves and as quarters by azimuth.
Where two answers for one scan are both `ok`, their poses differ by at most the sum of their levels along each axis of
the lidar and in yaw, or one of the two is beyond its level: no truth is needed. Prints, for each drive, how many pairs
there are, how many are apart by more than that, the largest difference in sums of levels and in metres, and how many
answers are `ok`. --limits: exit code 1 when more than 0.5 % of all pairs are apart. Without a drive the real ones of
STILLMAP_REAL_DATA are taken. Needs numpy (else exit 77).
--anew: what FOLDER holds of an earlier run is made again.
"""

import argparse
import os
import pathlib
import shutil
import sys

try:
    import numpy as np
except ImportError:
    print("skipped: numpy is missing")
    sys.exit(77)

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / "integrity"))
import answers
import distortions
import poses
import scans
from ask import Asker

MOST_APART = 0.005
REAL = ("mulran_seosan01", "kitti_raw/2011_09_26/2011_09_26_drive_0013_sync", "hku_1")


def parts_of(asker, prior):
    """Answers of the drive's odd scans by part."""
    return {name: asker.ask(name, change, prior) for name, change in distortions.PARTS.items()}


def compare(parts):
    """Rows (scan, part a, part b, difference in sums of levels, difference in metres) of all pairs that are `ok`."""
    rows = []
    names = list(parts)
    by_key = {name: {(scan, trial): i for i, (scan, trial) in enumerate(zip(table["scan"], table["trial"]))
                     if table["status"][i] == "ok"} for name, table in parts.items()}
    for a, first in enumerate(names):
        for second in names[a + 1:]:
            for key in by_key[first].keys() & by_key[second].keys():
                rows.append((int(key[0]), first, second,
                             *difference(parts[first], by_key[first][key], parts[second], by_key[second][key])))
    return rows


def difference(table_a, a, table_b, b):
    errors = [np.array([table[name][i] for name in answers.ERRORS]) for table, i in ((table_a, a), (table_b, b))]
    apart = poses.log_se3(np.linalg.inv(poses.exp_se3(errors[0])) @ poses.exp_se3(errors[1]))
    levels = [np.array([table[name][i] for name in answers.LEVELS]) for table, i in ((table_a, a), (table_b, b))]
    share = np.abs(apart[[0, 1, 2, 5]]) / (levels[0] + levels[1])
    return float(share.max()), float(np.linalg.norm(apart[:3]))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program")
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("drives", nargs="*", type=pathlib.Path)
    parser.add_argument("--prior-error", default="1,5")
    parser.add_argument("--limits", action="store_true")
    parser.add_argument("--anew", action="store_true")
    options = parser.parse_args()
    if options.anew:
        shutil.rmtree(options.folder, ignore_errors=True)
    if not options.drives and not os.environ.get("STILLMAP_REAL_DATA"):
        print("skipped: STILLMAP_REAL_DATA is not set")
        return 77
    total = beyond = 0
    for drive in options.drives or [pathlib.Path(os.environ["STILLMAP_REAL_DATA"]) / name for name in REAL]:
        asker = Asker(options.program, options.folder / drive.name, drive)
        parts = parts_of(asker, options.prior_error)
        rows = compare(parts)
        apart = [row for row in rows if row[3] > 1.0]
        total, beyond = total + len(rows), beyond + len(apart)
        for row in sorted(apart, key=lambda row: -row[3])[:10]:
            print("  scan {} {} and {}: {:.2f} sums of levels, {:.3f} m".format(*row))
        ok = ", ".join(f"{name} {np.mean(table['status'] == 'ok'):.0%}" for name, table in parts.items())
        print(f"{drive.name}: {len(apart)} of {len(rows)} pairs apart, at most {max((r[3] for r in rows), default=0):.2f} "
              f"sums of levels, {max((r[4] for r in rows), default=0):.3f} m; ok: {ok}", flush=True)
    print(f"all: {beyond} of {total} pairs apart ({100 * beyond / max(1, total):.2f} %)")
    return 1 if options.limits and beyond > MOST_APART * total else 0


if __name__ == "__main__":
    sys.exit(main())
