#!/usr/bin/env python3
"""server/docs/sizing.py: measures a server with a small map, and computes from fixed figures what was computed by hand.

usage: sizing_test.py STILLMAP MAP DRIVE
"""

import json
import pathlib
import subprocess
import sys

import support

PROGRAM, MAP, DRIVE = sys.argv[1:4]
SIZING = support.DEPLOY.parent / "docs" / "sizing.py"
FIXED = {
    "format": "stillmap-sizing-1",
    "serving": {"cpu_s_per_search": 0.036, "cpu_s_per_sealed_scan": 0.010, "ok_share": 1, "bytes_in_per_scan": 40000,
                "bytes_out_per_scan": 3000, "cpu_s_per_pose_near_prior": 0.010, "scans": 100, "memory_bytes": 10**8},
    "map": {"km": 2.0, "scans": 2000, "package_bytes": 300 * 10**6, "disk_bytes": 400 * 10**6, "index_bytes": 50 * 10**6},
    "proxy": {"cpu_s_per_scan": 0.0006},
    "state": {"transactions_per_s_of_a_server": 2.0, "transactions_per_change": 5, "transactions_per_pose": 0.01, "bytes_per_change": 1000},
    "build": {"scans": 2000, "cpu_s_per_scan": 0.36, "peak_memory_bytes": 1, "estimated_memory_bytes": 1,
              "work_bytes_per_scan": 10**6},
}


def sizing(*arguments):
    done = subprocess.run([sys.executable, "-B", SIZING, *map(str, arguments)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


class Sizing(support.FolderTest):
    def computed(self, measured, *arguments):
        file = self.folder / "measured.json"
        file.write_text(json.dumps(measured))
        rows = json.loads(sizing("compute", file, "--json", *arguments))
        for row in rows:
            self.assertTrue(row["from"], row)
        return {row["what"]: row["value"] for row in rows}

    def test_it_computes_what_was_computed_by_hand(self):
        options = ("--km", 1000, "--vehicles", 1000, "--hz", 1, "--server-cores", 4, "--utilization", 0.5)
        found = self.computed(FIXED, *options, "--zones", 3)
        # 1000 x 10 ms, and 1000 / 3600 x 36 ms.
        self.assertEqual(found["cores that are busy"], "10.0")
        self.assertEqual(found["cores"], "20")
        # Two zones must do: 10 cores in each, 3 servers of 4.
        self.assertEqual(found["servers"], "9")
        self.assertEqual(found["active versions, as sent"], "150 GB")
        self.assertEqual(found["disk of a server (`cache_bytes`)"], "400 GB")
        self.assertEqual(found["S3"], "1.5 TB")
        self.assertEqual((found["network, in"], found["network, out"]), ("320 Mbit/s", "24 Mbit/s"))
        self.assertEqual(found["cores of all proxies"], "1.2")
        self.assertEqual(found["PostgreSQL, transactions"], "28 /s")
        self.assertEqual(found["PostgreSQL, size after a year"], "365 MB")
        self.assertEqual(found["build of all"], "100 core-hours")
        self.assertEqual(found["disk for it"], "1 TB")
        alone = self.computed(FIXED, *options, "--zones", 1)
        self.assertEqual(alone["servers"], "7")  # 20.02 cores are 6 servers, and one may be lost
        self.assertEqual(self.computed(FIXED, "--km", 1, "--vehicles", 1, "--hz", 0.1)["servers"], "3")

    def test_it_measures_a_server(self):
        measured = json.loads(sizing("measure", PROGRAM, MAP, DRIVE, "--scans", 10, "--build-option=--select=:4"))
        serving = measured["serving"]
        self.assertEqual(serving["scans"], 10)
        for name in ("cpu_s_per_search", "cpu_s_per_sealed_scan", "cpu_s_per_pose_near_prior"):
            self.assertGreaterEqual(serving[name], 0, name)
        self.assertGreater(serving["bytes_in_per_scan"], 10000)
        self.assertGreater(serving["bytes_out_per_scan"], 1000)
        self.assertGreater(serving["ok_share"], 0.5)
        files = json.loads(pathlib.Path(MAP, "manifest.json").read_text())["files"]
        self.assertGreater(measured["map"]["package_bytes"], sum(file["bytes"] for file in files.values()))
        self.assertGreater(measured["map"]["disk_bytes"], measured["map"]["package_bytes"])
        self.assertEqual(measured["build"]["scans"], 4)
        self.assertGreater(measured["build"]["cpu_s_per_scan"], 0)
        self.assertTrue(self.computed(measured, "--km", 10, "--vehicles", 10)["servers"])

    def test_it_says_what_is_wrong(self):
        (self.folder / "other.json").write_text("{}")
        for arguments, words in ((["compute", self.folder / "other.json", "--km", 1, "--vehicles", 1], "measure again"),
                                 (["measure", PROGRAM, MAP, self.folder], "velodyne")):
            done = subprocess.run([sys.executable, "-B", SIZING, *map(str, arguments)], capture_output=True, text=True)
            self.assertEqual((done.returncode, words in done.stderr), (1, True), done.stderr)


if __name__ == "__main__":
    import unittest
    unittest.main(argv=sys.argv[:1])
