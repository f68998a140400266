"""drive_faults_test.py STILLMAP DRIVE: a good drive of KITTI's layout, made faulty in the ways that drives are; what `inspect`, and
`build` before it starts, say of it, and what to do. Ends with 77 when numpy is not installed."""

import json
import pathlib
import shutil
import subprocess
import sys
import tempfile
import unittest

try:
    import numpy as np
except ImportError:
    sys.exit(77)

PROGRAM, DRIVE = sys.argv[1], pathlib.Path(sys.argv[2])


def run(*words):
    return subprocess.run([PROGRAM, *map(str, words)], capture_output=True, text=True, timeout=120)


def turn(axis, degrees):
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    i, j = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    matrix = np.eye(4)
    matrix[[i, i, j, j], [i, j, i, j]] = c, -s, s, c
    return matrix


class Faults(unittest.TestCase):
    def setUp(self):
        temporary = tempfile.TemporaryDirectory()
        self.addCleanup(temporary.cleanup)
        self.folder = pathlib.Path(temporary.name) / "drive"
        (self.folder / "velodyne").mkdir(parents=True)
        scans = sorted((DRIVE / "velodyne").glob("*.bin"))
        self.scans = [np.fromfile(file, "<f4").reshape(-1, 4) for file in scans]
        lines = [np.array(line.split(), float) for line in (DRIVE / "poses.txt").read_text().splitlines()]
        cameras = [np.vstack([line.reshape(3, 4), [0, 0, 0, 1]]) for line in lines]
        calibration = dict(line.split(":", 1) for line in (DRIVE / "calib.txt").read_text().splitlines() if ":" in line)
        T_cam_lidar = np.vstack([np.array(calibration["Tr"].split(), float).reshape(3, 4), [0, 0, 0, 1]])
        self.poses = [np.linalg.inv(T_cam_lidar) @ camera @ T_cam_lidar for camera in cameras]
        self.times = [0.1 * i for i in range(len(scans))]

    def write(self):
        """As KITTI odometry whose camera is the lidar."""
        for i, scan in enumerate(self.scans):
            scan.astype("<f4").tofile(self.folder / f"velodyne/{i:06d}.bin")
        (self.folder / "poses.txt").write_text("".join(" ".join(map(repr, map(float, T[:3].ravel()))) + "\n" for T in self.poses))
        (self.folder / "times.txt").write_text("".join(f"{time:.6f}\n" for time in self.times))
        (self.folder / "calib.txt").write_text("Tr: 1 0 0 0 0 1 0 0 0 0 1 0\n")

    def mount(self, T_level_lidar):
        """The sensor stood otherwise, and the poses know."""
        T_lidar_level = np.linalg.inv(T_level_lidar)
        for scan in self.scans:
            scan[:, :3] = scan[:, :3] @ T_lidar_level[:3, :3].T
        self.poses = [T @ T_level_lidar for T in self.poses]

    def inspected(self):
        self.write()
        done = run("inspect", self.folder, "--json")
        self.assertEqual(done.returncode, 0, done.stderr)
        return json.loads(done.stdout)

    def said(self, code, *words):
        """One finding of the code, in words to people as well."""
        found = [each for each in self.inspected()["findings"] if each["code"] == code]
        self.assertEqual(len(found), 1, code)
        for word in words:
            self.assertIn(word, found[0]["what"] + " | " + found[0]["remedy"])
        text = run("inspect", self.folder).stdout
        self.assertIn("wrong? " + found[0]["what"], text)
        self.assertIn(found[0]["remedy"], text)
        return found[0]

    def test_motion_needs_poses(self):
        self.write()
        (self.folder / "poses.txt").unlink()
        done = run("inspect", self.folder, "--motion")
        self.assertNotEqual(done.returncode, 0)
        self.assertIn("no poses to compare with motion; leave out --motion, or put a poses file beside the scans", done.stderr)
        self.assertNotIn("odometry", done.stderr)

    def test_good_drive(self):
        drive = self.inspected()
        self.assertEqual(drive["findings"], [])
        self.assertEqual(drive["notes"], [])

    def test_tilted_sensor_with_its_angles(self):
        self.mount(turn("y", 4.0))
        self.said("sensor_tilted", "pitch 4.", "turn the points by these angles")
        mounting = self.inspected()["mounting"]
        self.assertAlmostEqual(mounting["tilt_rad"], np.radians(4.0), delta=np.radians(0.5))
        self.assertAlmostEqual(mounting["height_m"], 1.73, delta=0.1)

    def test_little_tilt_is_fine(self):
        self.mount(turn("x", 1.0))
        self.assertEqual(self.inspected()["findings"], [])

    def test_sensor_upside_down(self):
        self.mount(turn("x", 180.0))
        self.said("sensor_upside_down", "hangs upside down", "so that z is up")

    def test_poses_in_a_cameras_frame(self):
        T_camera_lidar = np.array([[0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1.0]])
        self.poses = [T_camera_lidar @ T @ T_camera_lidar.T for T in self.poses]
        self.said("frame_of_poses", "overlap by", "T_map_lidar")

    def test_poses_of_another_drive_are_worse_than_none(self):
        """It stood; they say that it drove."""
        self.scans = [self.scans[0] + np.array([0, 0, 1e-3 * i, 0]) for i in range(len(self.scans))]
        self.said("frame_of_poses", "without any", "--odometry default")

    def test_time_that_goes_back_once(self):
        self.times[7] = self.times[3]
        drive = self.inspected()
        self.assertEqual(drive["scans"], len(self.scans) - 1)
        self.assertIn("1 scans left out, whose stamps are out of order: 000007.bin", drive["notes"][0])

    def test_time_that_goes_back_all_the_way(self):
        self.times.reverse()
        self.write()
        done = run("inspect", self.folder)
        self.assertEqual(done.returncode, 1)
        self.assertIn("stamps out of order for", done.stderr)
        self.assertIn("sort the scans", done.stderr)

    def test_duplicate_scans(self):
        self.scans[11] = self.scans[10]
        self.said("duplicates", "1 scans are equal to the one before, the first is scan 11", "leave them out")

    def test_sensor_is_guessed_and_sets_ranges(self):
        self.assertIn("hdl-64e", self.inspected()["sensors"])
        reports = {}
        for words, arguments in (("", ()), ("?sensor=mid-360", ()), ("?sensor=mid-360", ("--max-range", 60))):
            report = self.folder.parent / "report.json"
            done = run("build", f"{self.folder}{words}", "-o", self.folder.parent / f"map{len(reports)}", "--select", ":2", "--detector",
                       "geometric", f"--json={report}", *arguments)
            self.assertEqual(done.returncode, 0, done.stderr)
            reports[len(reports)] = json.loads(report.read_text())
        self.assertEqual([(each["options"]["min_range_m"], each["options"]["max_range_m"]) for each in reports.values()],
                         [(2.7, 80), (0.5, 40), (0.5, 60)])
        far = [each["points"]["dropped_too_far"] for each in reports.values()]
        self.assertLess(far[0], far[2])
        self.assertLess(far[2], far[1])
        done = run("inspect", f"{self.folder}?sensor=hdl64")
        self.assertEqual(done.returncode, 1)
        self.assertIn("sensor: found 'hdl64', expected one of hdl-64e", done.stderr)

    def test_build_says_so_before_it_starts(self):
        self.mount(turn("y", 4.0))
        self.write()
        done = run("build", self.folder, "-o", self.folder.parent / "map", "--select", ":2", "--detector", "geometric")
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("is tilted by", done.stderr)

    def test_build_says_what_poses_leave_out(self):
        """They start with scan 4, 0.2 s after scan 2, and pause for over a second."""
        self.times = [0.1 * i for i in range(len(self.scans) - 2)] + [10.0, 10.1]
        self.write()
        path = [(time, T[:3, 3]) for i, (time, T) in enumerate(zip(self.times, self.poses)) if i >= 4 and time not in self.times[-4:-1]]
        tum = self.folder.parent / "late.tum"
        tum.write_text("".join(f"{time:.6f} {x} {y} {z} 0 0 0 1\n" for time, (x, y, z) in path))
        report = self.folder.parent / "report.json"
        done = run("build", self.folder, "-o", self.folder.parent / "map", "--poses", tum, "--select", ":2", "--detector", "geometric",
                   f"--json={report}")
        self.assertEqual(done.returncode, 0, done.stderr)
        notes = json.loads(report.read_text())["notes"]
        self.assertEqual(len(notes), 2, notes)
        self.assertIn("2 scans left out, which have no pose in late.tum", notes[0])
        self.assertIn("3 scans left out, which lie in gaps of over 1 s between poses of late.tum while the sensor moved", notes[1])
        for note in notes:
            self.assertIn("note: " + note, done.stderr)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
