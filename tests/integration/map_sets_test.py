#!/usr/bin/env python3
"""Maps that adjoin, as one set: a vehicle drives back and forth over their borders, and is never lost.

usage: map_sets_test.py STILLMAP [--crossings N] [--keep FOLDER] [TEST...]

Simulates one drive and builds three maps of its parts, which overlap by some metres. The third has a frame of its own.
FOLDER keeps drive and maps for the next call.
"""

import argparse
import json
import math
import pathlib
import random
import subprocess
import sys
import tempfile
import unittest

try:
    import numpy
except ImportError:
    sys.exit(77)

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path += [str(ROOT / "server/clients/python/src"), str(ROOT / "tests/soak")]

from serving import Server  # noqa: E402
from stillmap_client import Client, Gnss, Pose, Prior, Problem  # noqa: E402

PARSER = argparse.ArgumentParser()
PARSER.add_argument("program", type=pathlib.Path)
PARSER.add_argument("--crossings", type=int, default=20)
PARSER.add_argument("--keep", type=pathlib.Path)
ARGUMENTS, OTHERS = PARSER.parse_known_args()
PROGRAM = ARGUMENTS.program.resolve()
SCANS = 150
#: Scans of each map: even ones, so that the odd ones are the vehicle's.
PARTS = {"west": "0:64:2", "middle": "50:112:2", "east": "98:150:2"}
#: T_set_east; the other two have the frame of the set.
EAST = (-120.0, 45.0, 2.0)
LATITUDE, LONGITUDE, ALTITUDE = 48.0, 11.0, 500.0
#: First and last scan of a way over a border, and back.
BORDERS = (("west", "middle", 31, 83), ("middle", "east", 79, 131))


def matrix_of(numbers):
    return numpy.vstack([numpy.array(numbers, float).reshape(3, 4), [0.0, 0.0, 0.0, 1.0]])


def moved_by(x, y, yaw):
    return matrix_of([math.cos(yaw), -math.sin(yaw), 0.0, x, math.sin(yaw), math.cos(yaw), 0.0, y, 0.0, 0.0, 1.0, 0.0])


def quaternion_of(T):
    """Of a rotation by less than a half turn."""
    w = 0.5 * math.sqrt(1.0 + T[0, 0] + T[1, 1] + T[2, 2])
    return ((T[2, 1] - T[1, 2]) / (4 * w), (T[0, 2] - T[2, 0]) / (4 * w), (T[1, 0] - T[0, 1]) / (4 * w), w)


def true_poses(drive):
    """T_set_lidar of each scan."""
    lines = dict(line.split(":", 1) for line in (drive / "calib.txt").read_text().splitlines() if ":" in line)
    T_cam_lidar = matrix_of(lines["Tr"].split())
    return [numpy.linalg.inv(T_cam_lidar) @ matrix_of(line.split()) @ T_cam_lidar
            for line in (drive / "poses.txt").read_text().splitlines()]


def make_maps(folder):
    drive = folder / "drive"
    run("simulate", "town", "-o", drive, "--seed", "1", "--scans", str(SCANS))
    truth = true_poses(drive)
    for name, scans in PARTS.items():
        shift = EAST if name == "east" else (0.0, 0.0, 0.0)
        T_map_set = matrix_of([1, 0, 0, -shift[0], 0, 1, 0, -shift[1], 0, 0, 1, -shift[2]])
        poses = folder / f"{name}.txt"
        numpy.savetxt(poses, [(T_map_set @ T)[:3].ravel() for T in truth], fmt="%.12f")
        place = [LATITUDE + math.degrees(shift[1] / 6.367e6),
                 LONGITUDE + math.degrees(shift[0] / (6.388e6 * math.cos(math.radians(LATITUDE)))), ALTITUDE + shift[2]]
        run("build", drive, "-o", folder / name, "--select", scans, "--poses", poses, "--given-poses", "exact",
            f"--geo-origin={place[0]:.9f},{place[1]:.9f},{place[2]}")


def run(*arguments):
    done = subprocess.run([PROGRAM, *map(str, arguments)], capture_output=True, text=True)
    if done.returncode != 0:
        raise RuntimeError(f"{arguments}: {done.stderr}")


class Clock:
    """Stamps of a vehicle that drives from one end of a way to the other, and stops there. Meanwhile it sways."""

    TOP_M_S = 10.0

    def __init__(self):
        self.now_s = 100.0

    def along(self, truth, scans):
        """(scan, stamp_ns, T_scan_lidar) of each."""
        way = [0.0]
        for a, b in zip(scans, scans[1:]):
            way.append(way[-1] + math.dist(truth[a][:3, 3], truth[b][:3, 3]))
        takes_s = math.pi * way[-1] / (2.0 * self.TOP_M_S)
        for scan, at in zip(scans, way):
            stamp_s = self.now_s + takes_s * math.acos(1.0 - 2.0 * at / way[-1]) / math.pi
            sway = [math.sin(stamp_s / period_s) for period_s in (2.1, 2.9, 3.7)]
            yield scan, round(1e9 * stamp_s), moved_by(0.4 * sway[0], 0.5 * sway[1], 0.05 * sway[2])
        self.now_s += takes_s + 0.1


class MapSets(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.temporary = tempfile.TemporaryDirectory()
        cls.addClassCleanup(cls.temporary.cleanup)
        cls.folder = ARGUMENTS.keep or pathlib.Path(cls.temporary.name)
        if not (cls.folder / "east").exists():
            cls.folder.mkdir(parents=True, exist_ok=True)
            make_maps(cls.folder)
        cls.truth = true_poses(cls.folder / "drive")
        store = pathlib.Path(cls.temporary.name) / "store"
        for name in PARTS:
            run("store", "add", store, name, "v1", cls.folder / name, "--activate")
        cls.server = Server(PROGRAM, store, pathlib.Path(cls.temporary.name) / "log")
        cls.addClassCleanup(lambda: cls.server.process.poll() is None and cls.server.kill())
        assert cls.server.listen(), "did not listen"
        cls.server.wait_ready(60.0)
        cls.client = Client(f"http://127.0.0.1:{cls.server.port}", thin=None)
        cls.client.put_set("city", {"west": None, "middle": None, "east": Pose(EAST)})

    def setUp(self):
        self.random = random.Random(self.id())
        self.noise = numpy.random.default_rng(1)

    def scan(self, index, T_scan_lidar=None):
        """@param T_scan_lidar  the sensor is there, half of the points are missing, and ranges are 2 cm off."""
        data = (self.folder / "drive" / "velodyne" / f"{index:06d}.bin").read_bytes()
        if T_scan_lidar is None:
            return data
        points = numpy.frombuffer(data, numpy.float32).reshape(-1, 4).copy()
        points = points[self.noise.random(len(points), numpy.float32) < 0.5]
        off_m = 0.02 * self.noise.standard_normal(len(points), numpy.float32)
        points[:, :3] *= (1.0 + off_m / numpy.linalg.norm(points[:, :3], axis=1).clip(1.0))[:, None]
        T_lidar_scan = numpy.linalg.inv(T_scan_lidar).astype(numpy.float32)
        points[:, :3] = points[:, :3] @ T_lidar_scan[:3, :3].T + T_lidar_scan[:3, 3]
        return points.astype(numpy.float32).tobytes()

    def prior(self, index, sigma_m=0.5, sigma_rad=0.03):
        """As wrong as it says."""
        T = self.truth[index] @ moved_by(0.0, 0.0, self.random.gauss(0.0, sigma_rad))
        position = tuple(T[i, 3] + self.random.gauss(0.0, sigma_m * (1.0 if i < 2 else 0.1)) for i in range(3))
        return Prior(Pose(position, quaternion_of(T)), sigma=(sigma_m, sigma_rad))

    def fix(self, index, sigma_m=3.0):
        east, north = (self.truth[index][i, 3] + self.random.gauss(0.0, sigma_m) for i in range(2))
        return Gnss(LATITUDE + math.degrees(north / 6.367e6),
                    LONGITUDE + math.degrees(east / (6.388e6 * math.cos(math.radians(LATITUDE)))), sigma_m=sigma_m)

    def error(self, answer, T_set_lidar):
        """In the lidar frame: x, y, z [m]."""
        return T_set_lidar[:3, :3].T @ (numpy.array(answer.T_set_lidar.position) - T_set_lidar[:3, 3])

    def expect_right(self, answer, index, what):
        self.assertEqual(answer.set, "city")
        error = self.error(answer, self.truth[index])
        bounds = answer.protection
        for along, level in zip(error, (bounds.longitudinal_m, bounds.lateral_m, bounds.vertical_m)):
            self.assertLessEqual(abs(along), level, f"{what}: error {error}, levels {bounds}")

    def drive_over_borders(self, begin, crossings):
        """@param begin  opens a session at a scan. @return what was counted."""
        counts = {"scans": 0, "ok": 0, "lost": 0, "crossings": 0, "beyond": 0, "ways": 0, "largest_m": 0.0, "largest_at_crossing_m": 0.0}
        for border in range(2):
            _, _, first, last = BORDERS[border]
            clock, session, way = Clock(), None, list(range(first, last + 1, 2))
            while counts["crossings"] < (border + 1) * crossings // 2:
                counts["ways"] += 1
                self.assertLess(counts["ways"], 2 * crossings + 4, f"the vehicle stays in one map: {counts}")
                if session is None:
                    session = begin(way[0])
                for scan, stamp_ns, T_scan_lidar in clock.along(self.truth, way):
                    answer = session.track(self.scan(scan, T_scan_lidar), stamp_ns)
                    counts["scans"] += 1
                    counts[answer.status] = counts.get(answer.status, 0) + 1
                    if answer.status == "lost":
                        continue
                    error = self.error(answer, self.truth[scan] @ T_scan_lidar)
                    handed_over = [each for each in answer.warnings if each.code == "handed_over"]
                    counts["crossings"] += len(handed_over)
                    size = float(numpy.linalg.norm(error))
                    counts["largest_m"] = max(counts["largest_m"], size)
                    if handed_over:
                        self.assertNotEqual(handed_over[0].from_map, answer.map.name)
                        counts["largest_at_crossing_m"] = max(counts["largest_at_crossing_m"], size)
                    if answer.status == "ok":
                        bounds = answer.protection
                        levels = (bounds.longitudinal_m, bounds.lateral_m, bounds.vertical_m)
                        counts["beyond"] += any(abs(e) > level for e, level in zip(error, levels))
                way.reverse()
        print(json.dumps(counts), file=sys.stderr)
        return counts

    def expect_no_gap(self, counts):
        self.assertEqual(counts["lost"], 0, counts)
        self.assertGreaterEqual(counts["ok"], 0.98 * counts["scans"], counts)
        # One in a thousand on each axis: see the protection levels.
        self.assertLessEqual(counts["beyond"], 2 + 0.003 * counts["scans"], counts)
        self.assertLess(counts["largest_at_crossing_m"], 0.2, counts)

    def test_a_sealed_session_goes_over_the_borders(self):
        self.expect_no_gap(self.drive_over_borders(
            lambda scan: self.client.sealed_session(None, set="city", prior=self.prior(scan)), ARGUMENTS.crossings))

    def test_a_session_of_the_server_goes_over_the_borders(self):
        self.expect_no_gap(self.drive_over_borders(
            lambda scan: self.client.open_session(None, prior=self.prior(scan)), max(4, ARGUMENTS.crossings // 5)))

    def test_a_vehicle_that_stands_on_a_border_stays_in_one_map(self):
        for middle in range(53, 63, 2):
            session = self.client.sealed_session(None, prior=self.prior(middle))
            names = {session.track(self.scan(middle + 2 * (i % 2)), 10**9 * (i + 1)).map.name for i in range(6)}
            self.assertEqual(len(names), 1, middle)

    def test_a_scan_alone_by_prior_and_by_fix(self):
        maps = set()
        for index in range(5, SCANS - 4, 14):
            for what, place in (("prior", {"prior": self.prior(index)}), ("near", {"prior": self.prior(index, 1.0)}),
                                ("fix", {"gnss": self.fix(index)})):
                answer = self.client.localize(None, self.scan(index), **place)
                self.assertIn(answer.status, ("ok", "degraded"), f"{what} {index}: {answer.reasons}")
                if answer.status == "ok":
                    self.expect_right(answer, index, f"{what} {index}")
                maps.add(answer.map.name)
        self.assertEqual(maps, set(PARTS))

    def test_a_scan_alone_anywhere_is_found_in_its_map(self):
        for index, name in ((11, "west"), (81, "middle"), (139, "east")):
            answer = self.client.localize(None, self.scan(index), set="city")
            self.assertEqual((answer.status, answer.map.name), ("ok", name), answer.reasons)
            self.expect_right(answer, index, index)
        session = self.client.sealed_session(None)
        found = [session.track(self.scan(index), 10**8 * index) for index in (135, 137, 139)]
        self.assertEqual([answer.status for answer in found], ["degraded", "ok", "ok"])
        self.assertEqual(found[-1].map.name, "east")

    def test_sets_are_kept_and_refused(self):
        self.client.put_set("other", {"west": None})
        self.addCleanup(self.client.put_set, "city", {"west": None, "middle": None, "east": Pose(EAST)})
        self.assertEqual(self.client.sets()["city"]["east"].position, EAST)
        for refused, code in ((lambda: self.client.localize(None, self.scan(1)), "InvalidRequest"),
                              (lambda: self.client.localize(None, self.scan(1), set="none"), "UnknownSet"),
                              (lambda: self.client.put_set("bad", {"nowhere": None}), "UnknownMap"),
                              (lambda: self.client.delete_map("west", active=True), "InUse")):
            with self.assertRaises(Problem) as raised:
                refused()
            self.assertEqual(raised.exception.code, code)
        # Of several sets a fix needs none of them.
        answer = self.client.localize(None, self.scan(81), gnss=self.fix(81))
        self.assertEqual((answer.map.name, answer.set), ("middle", None))
        self.client.delete_set("other")
        seal = self.client.sealed_session(None, prior=self.prior(81))
        seal.track(self.scan(81), 10**9)
        self.client.put_set("city", {"west": None, "east": Pose(EAST)})
        with self.assertRaises(Problem) as raised:
            self.server_next(seal.seal)
        self.assertEqual(raised.exception.code, "SealedVersionGone")

    def server_next(self, seal):
        response = self.server.ask("POST", "/v1/localize/next?stamp_ns=1100000000", self.scan(83),
                                   {"Content-Type": "application/octet-stream", "Stillmap-Seal": seal})
        if response.status != 200:
            raise Problem(response.status, response.json)


if __name__ == "__main__":
    unittest.main(argv=[sys.argv[0], *OTHERS])
