#!/usr/bin/env python3
"""The Python client thins as the header of server and C++ client does, to the byte.

usage: thin_scan_test.py THIN_SCAN CLIENT_SOURCES
"""

import os
import pathlib
import subprocess
import sys
import tempfile
import unittest

import numpy as np

THIN_SCAN, CLIENT = sys.argv[1:3]
sys.path.insert(0, CLIENT)
from stillmap_client.thinning import thin_scan  # noqa: E402


def street(random, points):
    """A floor, two walls, rain, no returns, points sent twice, and a bonnet."""
    floor = np.c_[random.uniform(-80, 80, points), random.uniform(-6, 6, points), random.normal(-1.7, 0.02, points)]
    walls = np.c_[random.uniform(-80, 80, points), random.choice([-8.0, 8.0], points), random.uniform(-1.7, 9, points)]
    rain = random.uniform(-40, 40, (points // 20, 3))
    bonnet = random.uniform(-1.5, 1.5, (points // 10, 3))
    far = random.uniform(-900, 900, (points // 50, 3))
    scan = np.concatenate([floor, walls, rain, bonnet, far]).astype(np.float32)
    scan = scan[random.permutation(len(scan))]
    scan[::31] = np.nan
    scan[::37] = 0
    scan[5::41] = scan[4::41][:len(scan[5::41])]
    scan[::53, 1] = np.inf
    return scan


class Thinning(unittest.TestCase):
    def require_equal(self, xyz, width=3, own_vehicle_m=2.7):
        rest = np.zeros((len(xyz), width - 3), np.float32)
        if width == 5:
            rest[:, 1] = np.linspace(-0.1, 0.0, len(xyz), dtype=np.float32)
        scan = np.ascontiguousarray(np.c_[xyz, rest].astype(np.float32))
        for profile in ("exact", "compact"):
            with tempfile.TemporaryDirectory() as folder:
                file = pathlib.Path(folder, "scan.bin")
                scan.tofile(file)
                expected = subprocess.run([THIN_SCAN, str(file), str(width), profile, str(own_vehicle_m)],
                                          capture_output=True, check=True).stdout
            found = thin_scan(scan, profile, own_vehicle_m)
            self.assertEqual(len(found), len(expected), profile)
            self.assertEqual(found, expected, profile)
            if profile == "compact":
                self.assertLessEqual(len(found), 48_000)
        return expected

    def test_streets_with_and_without_times(self):
        for seed in range(4):
            for width in (3, 4, 5):
                self.require_equal(street(np.random.default_rng(seed), 40_000), width)

    def test_scans_of_few_points_and_of_very_many(self):
        for points in (1, 40, 2_000, 5_000, 260_000):
            self.require_equal(street(np.random.default_rng(points), points))

    def test_narrow_places_and_other_vehicles(self):
        random = np.random.default_rng(5)
        self.require_equal((0.02 * street(random, 20_000)).astype(np.float32))
        self.require_equal(street(random, 20_000), own_vehicle_m=4.1)

    def test_nothing(self):
        self.require_equal(np.zeros((0, 3), np.float32))
        self.require_equal(np.zeros((100, 3), np.float32))

    @unittest.skipUnless(os.environ.get("STILLMAP_REAL_DATA"), "STILLMAP_REAL_DATA is not set")
    def test_real_scans(self):
        files = sorted(pathlib.Path(os.environ["STILLMAP_REAL_DATA"]).glob("kitti_raw/**/*.bin"))[:3]
        for file in files:
            self.require_equal(np.fromfile(file, np.float32).reshape(-1, 4)[:, :3])

    def test_other_arrays_are_refused(self):
        for scan in (np.zeros((4, 2), np.float32), np.zeros((4, 3)), np.zeros(12, np.float32)):
            with self.assertRaisesRegex(ValueError, "expected float32, N x 3, 4 or 5"):
                thin_scan(scan)
        with self.assertRaisesRegex(ValueError, "expected exact or compact"):
            thin_scan(np.zeros((4, 3), np.float32), "small")


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
