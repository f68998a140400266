#!/usr/bin/env python3
"""Prints one table of what `tests/bench/run.sh` measured on one drive.   usage: table.py FOLDER NAME RESULT"""

import json
import pathlib
import sys

METHODS = ("default", "pcl-icp", "ndt", "gicp")


def main():
    folder, name, result = pathlib.Path(sys.argv[1]), sys.argv[2], sys.argv[3]
    build = json.loads((folder / f"{name}.build.json").read_text())
    print(f"\n{result}: build {build['scans_per_second']:.1f} scans/s, peak {build['peak_rss_mib']:.0f} MiB")
    print(f"{'method':>10} {'prior error':>14} {'success':>9} {'ok/degr./lost':>15} {'median':>8} {'p95':>8} "
          f"{'CPU p50':>9} {'CPU p95':>9} {'false ok':>9}")
    cpu = {}
    for method in METHODS:
        for level in json.loads((folder / f"{result}.{method}.json").read_text())["levels"]:
            status, error, prior = level["status"], level["translation_error_m"], level["prior_error_m"]
            cpu[method, prior] = level["cpu_ms"]["p50"]
            print(f"{method:>10} {prior:5.1f} m {level['prior_error_deg']:3.0f} deg {100 * level['success_rate']:7.1f} % "
                  f"{status['ok']:5d}/{status['degraded']:4d}/{status['lost']:4d} {100 * error['median']:5.1f} cm "
                  f"{100 * error['p95']:5.1f} cm {level['cpu_ms']['p50']:6.1f} ms {level['cpu_ms']['p95']:6.1f} ms "
                  f"{100 * level['false_ok_rate']:7.2f} %")
    for prior in sorted({prior for _, prior in cpu}):
        ratios = (f"default : {method} = 1 : {cpu[method, prior] / cpu['default', prior]:.1f}"
                  for method in METHODS[1:])
        print(f"CPU medians from {prior} m: {', '.join(ratios)}")


if __name__ == "__main__":
    main()
