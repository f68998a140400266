"""poses_test.py STILLMAP DRIVE: a simulated drive with the poses of other programs, and as the folders that these write.
Each gives the map of the drive's own folder, or one as near as its digits allow. Ends with 77 when numpy is not installed."""

import json
import math
import pathlib
import shutil
import struct
import subprocess
import sys
import tempfile
import unittest

try:
    import numpy as np
except ImportError:
    sys.exit(77)

PROGRAM, DRIVE = sys.argv[1], pathlib.Path(sys.argv[2])
EPOCH_NS = 1_700_000_000 * 10**9
SCANS = 12


def run(*words):
    return subprocess.run([PROGRAM, *map(str, words)], capture_output=True, text=True, timeout=200)


def inspected(drive):
    result = run("inspect", drive, "--json")
    assert result.returncode == 0, result.stderr
    return json.loads(result.stdout)


def quaternion(R):
    """x y z w of a rotation of less than half a turn."""
    w = math.sqrt(max(0.0, 1.0 + R[0, 0] + R[1, 1] + R[2, 2])) / 2
    return [(R[2, 1] - R[1, 2]) / (4 * w), (R[0, 2] - R[2, 0]) / (4 * w), (R[1, 0] - R[0, 1]) / (4 * w), w]


def pcd(path, points, viewpoint="0 0 0 1 0 0 0"):
    path.parent.mkdir(parents=True, exist_ok=True)
    head = ("VERSION 0.7\nFIELDS x y z intensity\nSIZE 4 4 4 4\nTYPE F F F F\nCOUNT 1 1 1 1\n"
            f"WIDTH {len(points)}\nHEIGHT 1\nVIEWPOINT {viewpoint}\nPOINTS {len(points)}\nDATA binary\n")
    path.write_bytes(head.encode() + points.astype("<f4").tobytes())


def digits(values):
    return " ".join(repr(float(value)) for value in values)


class Poses(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.temporary = tempfile.TemporaryDirectory()
        cls.addClassCleanup(cls.temporary.cleanup)
        cls.folder = pathlib.Path(cls.temporary.name)
        cls.scans = [np.fromfile(file, "<f4").reshape(-1, 4) for file in sorted((DRIVE / "velodyne").glob("*.bin"))[:SCANS]]
        calibration = dict(line.split(":", 1) for line in (DRIVE / "calib.txt").read_text().splitlines() if ":" in line)
        matrix = lambda text: np.vstack([np.array(text.split(), float).reshape(3, 4), [0, 0, 0, 1]])
        T = matrix(calibration["Tr"])
        lines = (DRIVE / "poses.txt").read_text().splitlines()[:SCANS]
        cls.poses = [np.linalg.inv(T) @ matrix(line) @ T for line in lines]
        cls.stamps = [EPOCH_NS + i * 10**8 for i in range(SCANS)]
        cls.plain = cls.scans_in("plain")
        (cls.plain / "poses.txt").write_text(cls.kitti())
        cls.digest = cls.built(cls.plain)

    @classmethod
    def scans_in(cls, name):
        folder = cls.folder / name
        for i, scan in enumerate(cls.scans):
            pcd(folder / f"{cls.stamps[i]}.pcd", scan)
        return folder

    @classmethod
    def kitti(cls):
        return "".join(digits(T[:3].ravel()) + "\n" for T in cls.poses)

    @classmethod
    def built(cls, drive, *words):
        """Digest of the content of its map."""
        out = cls.folder / "map"
        shutil.rmtree(out, ignore_errors=True)
        result = run("build", drive, "-o", out, "--given-poses", "exact", *words)
        assert result.returncode == 0, result.stderr
        return run("inspect", out, "--content").stdout.strip()

    def poses_of_map(self):
        """Of the map that `built` wrote last: T_map_lidar of each scan, 4x4."""
        out = self.folder / "path.txt"
        result = run("export", self.folder / "map", "--format", "kitti", "-o", out)
        assert result.returncode == 0, result.stderr
        rows = np.loadtxt(out, ndmin=2).reshape(-1, 3, 4)
        out.unlink()
        return np.concatenate([rows, np.tile([[[0, 0, 0, 1]]], (len(rows), 1, 1))], axis=1)

    def moved(self, i):
        """A scan in the frame of the map."""
        scan = self.scans[i].copy()
        scan[:, :3] = scan[:, :3].astype(float) @ self.poses[i][:3, :3].T + self.poses[i][:3, 3]
        return scan

    def test_files_of_poses_give_the_map_of_the_same_numbers(self):
        rows = [[*T[:3, 3], *quaternion(T[:3, :3])] for T in self.poses]
        seconds = [f"{ns // 10**9}.{ns % 10**9:09d}" for ns in self.stamps]
        tum = "".join(f"{s} {digits(row)}\n" for s, row in zip(seconds, rows))
        header = "timestamp_ns,qw,qx,qy,qz,x,y,z\n"
        csv = header + "".join(f"{ns}," + digits([row[6], *row[3:6], *row[:3]]).replace(" ", ",") + "\n"
                               for ns, row in zip(self.stamps, rows))
        files = {"a.tum": tum, "bom.tum": "\ufeff" + tum.replace("\n", "\r\n"), "a.csv": csv,
                 "a.g2o": "".join(f"VERTEX_SE3:QUAT {i} {digits(row)}\n" for i, row in enumerate(rows)),
                 "ns.txt": "".join(f"{ns} {digits(row)}\n" for ns, row in zip(self.stamps, rows))}
        reference = None
        for name, text in files.items():
            (self.folder / name).write_bytes(text.encode())
            digest = self.built(self.plain, "--poses", self.folder / name)
            reference = reference or digest
            self.assertEqual(digest, reference, name)
        numbered = self.folder / "numbered.txt"
        numbered.write_text("".join(f"{i} {digits(T[:3].ravel())}\n" for i, T in enumerate(self.poses)))
        self.assertEqual(self.built(self.plain, "--poses", numbered), self.digest)

    def test_a_dump_of_hdl_graph_slam_is_a_drive_and_a_file_of_poses(self):
        dump = self.folder / "hdl"
        for i, (scan, T) in enumerate(zip(self.scans, self.poses)):
            pcd(dump / f"{i:06d}/cloud.pcd", scan)
            rows = "".join(digits(row) + "\n" for row in T)
            (dump / f"{i:06d}/data").write_text(f"stamp {self.stamps[i] // 10**9} {self.stamps[i] % 10**9}\nestimate\n{rows}"
                                                f"odom\n{rows}accum_distance {i}\nid {i}\n")
        self.assertEqual(self.built(dump), self.digest)
        self.assertEqual(self.built(self.plain, "--poses", dump), self.digest)
        self.assertEqual(inspected(dump)["layout"], "hdl_graph_slam")

    def test_viewpoints_are_poses_of_points_in_either_frame(self):
        rows = [digits([*T[:3, 3], *(q := quaternion(T[:3, :3]))[3:], *q[:3]]) for T in self.poses]
        for name, points in (("sensor", lambda i: self.scans[i]), ("map", self.moved)):
            folder = self.folder / f"points_of_{name}"
            for i, row in enumerate(rows):
                pcd(folder / f"{i:06d}.pcd", points(i), row)
            found = inspected(folder)
            self.assertTrue(any(f"points are in the frame of the {name}" in note for note in found["notes"]), found["notes"])
            self.assertEqual([each["code"] for each in found.get("findings", []) if each["code"] == "frame_of_poses"], [])
            self.built(folder)
            self.assertLess(np.abs(self.poses_of_map() - np.array(self.poses)).max(), 1e-6, name)

    def test_registered_scans_are_chosen_where_nothing_says_so(self):
        folder = self.folder / "registered"
        for i in range(SCANS):
            pcd(folder / f"{i:06d}.pcd", self.moved(i))
        (folder / "poses.txt").write_text(self.kitti())
        wrong = run("inspect", folder).stdout
        self.assertIn("DRIVE?points=map", wrong)
        right = run("inspect", f"{folder}?points=map").stdout
        self.assertNotIn("wrong?", right)

    def test_kitti_360_is_brought_from_its_imu_to_the_lidar(self):
        root, name = self.folder / "KITTI-360", "2013_05_28_drive_0000_sync"
        velodyne = root / "data_3d_raw" / name / "velodyne_points"
        (velodyne / "data").mkdir(parents=True)
        first = 40
        for i, scan in enumerate(self.scans):
            scan.tofile(velodyne / "data" / f"{first + i:010d}.bin")
        (velodyne / "timestamps.txt").write_text("".join(
            f"2013-05-28 10:46:{10 + i // 10:02d}.{i % 10}00000000\n" for i in range(first + SCANS)))
        # IMU: x ahead, y right, z down; camera: x right, y down, z ahead.
        T_velo_cam = np.array([[0, 0, 1, 0.3], [-1, 0, 0, 0.1], [0, -1, 0, -0.2], [0, 0, 0, 1]], float)
        T_imu_cam = np.array([[0, 0, 1, 1.5], [1, 0, 0, 0.3], [0, 1, 0, -0.9], [0, 0, 0, 1]], float)
        # The camera of cam0_to_world.txt is the rectified one.
        R_rect = np.eye(4)
        R_rect[:2, :2] = [[math.cos(0.1), math.sin(0.1)], [-math.sin(0.1), math.cos(0.1)]]
        calibration = root / "calibration"
        calibration.mkdir()
        (calibration / "perspective.txt").write_text("R_rect_00: " + digits(R_rect[:3, :3].ravel()) + "\n")
        (calibration / "calib_cam_to_velo.txt").write_text(digits(T_velo_cam[:3].ravel()) + "\n")
        (calibration / "calib_cam_to_pose.txt").write_text(
            "image_00: " + digits(T_imu_cam[:3].ravel()) + "\nimage_01: " + digits(T_imu_cam[:3].ravel()) + "\n")
        T_velo_imu = T_velo_cam @ np.linalg.inv(T_imu_cam)
        poses = root / "data_poses" / name
        poses.mkdir(parents=True)
        T_velo_rect = T_velo_cam @ np.linalg.inv(R_rect)
        for file, T_velo_pose, numbers in (("poses.txt", T_velo_imu, 3), ("cam0_to_world.txt", T_velo_rect, 4)):
            (poses / file).write_text("".join(f"{first + i} {digits((T @ T_velo_pose)[:numbers].ravel())}\n"
                                              for i, T in enumerate(self.poses)))
        drive = velodyne.parent
        found = inspected(drive)
        self.assertEqual(found["layout"], "kitti_raw")
        self.assertTrue(any("KITTI-360" in note for note in found["notes"]), found["notes"])
        self.assertGreater(found["pose_overlap"]["given"], 0.5)
        self.assertNotIn("frame_of_poses", json.dumps(found))
        for file in ("poses.txt", "cam0_to_world.txt"):
            self.built(drive, "--poses", poses / file)
            self.assertLess(np.abs(self.poses_of_map() - np.array(self.poses)).max(), 1e-6, file)

    def test_a_dump_of_glim_says_what_to_do(self):
        dump = self.folder / "glim"
        (dump / "000000").mkdir(parents=True)
        (dump / "000000/data.txt").write_text("id: 0\n")
        (dump / "000000/points_compact.bin").write_bytes(struct.pack("<3f", 1, 2, 3))
        rows = [[*T[:3, 3], *quaternion(T[:3, :3])] for T in self.poses]
        (dump / "traj_lidar.txt").write_text("".join(f"{ns // 10**9}.{ns % 10**9:09d} {digits(row)}\n"
                                                     for ns, row in zip(self.stamps, rows)))
        said = run("inspect", dump).stderr
        self.assertIn("a dump of GLIM", said)
        self.assertIn(f"--poses {dump}", said)
        tum = self.folder / "of_glim.tum"
        shutil.copy(dump / "traj_lidar.txt", tum)
        self.assertEqual(self.built(self.plain, "--poses", dump), self.built(self.plain, "--poses", tum))

    def test_coarse_digits_are_said(self):
        utm = [T.copy() for T in self.poses]
        for T in utm:
            T[:3, 3] += [458_123.0, 5_428_117.0, 115.0]
        lines = "".join(" ".join(f"{value:.6g}" for value in T[:3].ravel()) + "\n" for T in utm)
        drive = self.scans_in("coarse")
        (drive / "poses.txt").write_text(lines)
        self.assertIn("coarse_positions", json.dumps(inspected(drive)))

    def test_our_own_autoware_maps_are_imported(self):
        plain, out = self.folder / "aw_map", self.folder / "aw"
        self.assertEqual(run("build", self.plain, "-o", plain, "--geo-origin", "49.01,8.42,110").returncode, 0)
        points = inspected(plain)["points"]
        for coordinates in ("map", "utm", "mgrs", "transverse-mercator"):
            shutil.rmtree(out, ignore_errors=True)
            back = self.folder / f"back_{coordinates}"
            for words in (("export", plain, "--format", "autoware", "--coordinates", coordinates, "-o", out),
                          ("import", out, "-o", back)):
                result = run(*words)
                self.assertEqual(result.returncode, 0, result.stderr)
            found = inspected(back)
            # Voxels of another grid take two points of the map for one here and there.
            self.assertEqual(found["counts"]["in"], points, coordinates)
            self.assertGreater(found["points"], 0.5 * points, coordinates)
            place = found["geodetic_origin"]
            # MGRS names a square: the frame is in the middle of the points then.
            near_deg = 0.01 if coordinates == "mgrs" else 1e-9
            self.assertAlmostEqual(place["latitude_deg"], 49.01, delta=near_deg, msg=coordinates)
            self.assertAlmostEqual(place["longitude_deg"], 8.42, delta=near_deg, msg=coordinates)
            result = run("localize", back, self.plain / f"{self.stamps[0]}.pcd")
            self.assertEqual(result.returncode, 0, result.stdout + result.stderr)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
