#!/usr/bin/env python3
"""How far simulated scans are from real ones, HDL-64E against HDL-64E.

usage: compare.py --real FOLDER [--real ...] --simulated DRIVE [--simulated ...]
                  [--json FILE] [--plots FOLDER] [--max-scans N] [--draws N] [--seed S]

A real FOLDER is a KITTI raw drive, a KITTI object folder (each scan a street of its own) or a
SemanticKITTI sequence; a DRIVE has KITTI odometry's layout. For every feature (features.py) the mean
Jensen-Shannon divergence (base 2) of simulated and real streets stands beside the one among the real
streets. How the comparison is kept fair stands in divergence.py: one scan against one scan, the
same number of samples on both sides of every pair, several draws, and nothing left out in silence.

The ratio of the two says whether a simulated street could be one more real one: about 1 if so. Real
streets should be of different places. With a handful of real streets the ratio itself is uncertain:
its range (5 to 95 %) comes from drawing streets and scans anew. A ratio without a second real street
that has the feature (reflectance by class, where one scan is labelled) is not given.

Features not compared with a bar: the shares of the classes, which stand in the table as information.
"""

import argparse
import json
import pathlib
import sys

import numpy as np

import divergence
import report
from features import FEATURES, class_shares, measure
from scans import read_streets


def named_apart(streets):
    """Streets by name; of equal names, the later ones get a number."""
    out = {}
    for street in streets:
        name, k = street.name, 2
        while name in out:
            name, k = f"{street.name} ({k})", k + 1
        out[name] = street
    return out


def measured(street, max_scans):
    counts, facts, shares = [], [], []
    for i in street.evenly(max_scans):
        scan = street.scan(i)
        features, fact = measure(scan)
        counts.append(features)
        facts.append(fact)
        shares.append(class_shares(scan))
    known = [s for s in shares if s is not None]
    mean = {c: float(np.mean([s[c] for s in known])) for c in known[0]} if known else None
    return counts, facts, mean


def parsed(arguments):
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--real", action="append", required=True, type=pathlib.Path)
    parser.add_argument("--simulated", action="append", required=True, type=pathlib.Path)
    parser.add_argument("--json", type=pathlib.Path)
    parser.add_argument("--plots", type=pathlib.Path)
    parser.add_argument("--max-scans", type=int, default=20, help="per street, spread over it")
    parser.add_argument("--draws", type=int, default=12, help="pairs of scans per pair of streets")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args(arguments)
    for name in ("max_scans", "draws"):
        if getattr(options, name) < 1:
            parser.error(f"--{name.replace('_', '-')}: {getattr(options, name)}, must be >= 1")
    return options


def main(arguments=None):
    options = parsed(arguments)
    try:
        groups = [[s for folder in folders for s in read_streets(folder)]
                  for folders in (options.real, options.simulated)]
        streets = named_apart(groups[0] + groups[1])
        real = list(streets)[:len(groups[0])]
        simulated = list(streets)[len(groups[0]):]
        counts, facts, shares = {}, {}, {}
        for name, street in streets.items():
            counts[name], facts[name], share = measured(street, options.max_scans)
            if share is not None:
                shares[name] = share
    except (OSError, ValueError) as error:
        sys.exit(f"compare.py: {error}")
    results = {}
    for feature in FEATURES:
        per_street = {name: [c[feature.key] for c in scans] for name, scans in counts.items()}
        results[feature.key] = divergence.compare(feature, per_street, simulated, real,
                                                  options.draws, options.seed)
    print(report.facts_table(facts), report.divergence_table(results),
          "sim-real / real-real, street by street\n" + report.real_table(results, real),
          "left out for want of samples\n" + report.left_out_lines(results),
          "share of the points by class\n" + report.class_table(shares), sep="\n\n")
    if options.json:
        options.json.write_text(json.dumps(
            {"bar": report.BAR, "features": results, "class_shares": shares, "facts": facts},
            indent=1, allow_nan=True))
    if options.plots:
        import plots
        plots.draw_all(options.plots, results, counts, simulated, real)


if __name__ == "__main__":
    main()
