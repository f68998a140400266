#!/usr/bin/env python3
"""The Python package beside the command line, its arrays and its errors.

usage: package_test.py STILLMAP MAP DRIVE

DRIVE is simulated, MAP is of its even scans. The module is found by PYTHONPATH.
"""

import contextlib
import gc
import json
import os
import pathlib
import re
import shutil
import signal
import subprocess
import sys
import tarfile
import tempfile
import threading
import time
import unittest

import numpy as np

import stillmap

PROGRAM, MAP, DRIVE = (pathlib.Path(x).resolve() for x in sys.argv[1:4])


class WithFolder(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)


class Maps(WithFolder):
    def test_points_of_all_tiles_are_points_of_the_map(self):
        opened = stillmap.open_map(MAP)
        tiles = np.concatenate([opened.tile(x, y) for x, y in opened.tiles])
        corners = np.concatenate([np.tile(opened.tile_corner(x, y), (len(opened.tile(x, y)), 1)) for x, y in opened.tiles])
        points = stillmap.map_points(opened)
        own = np.stack([tiles[axis] for axis in "xyz"], axis=1).astype(np.float64) + corners
        np.testing.assert_array_equal(points.xyz, own)
        np.testing.assert_array_equal(points.kind, tiles["kind"])
        np.testing.assert_array_equal(points.observations, tiles["observations"])
        self.assertEqual(len(points), opened.manifest["counts"]["static"])

    def test_a_map_far_from_its_origin_has_the_same_tiles(self):
        """Its regions have other names, 1,000 km to the east; what lies in a region does not say where that is."""
        regions = 1562
        files = {}
        manifest = json.loads((MAP / "manifest.json").read_text())
        for name, listed in manifest["files"].items():
            moved = re.sub(r"^regions/(-?\d+)_", lambda found: f"regions/{int(found[1]) + regions}_", name)
            (self.folder / "far" / moved).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(MAP / name, self.folder / "far" / moved)
            files[moved] = listed
        extent = {**manifest["extent"]}
        for corner in ("min", "max"):
            extent[corner] = [extent[corner][0] + regions * 640.0, *extent[corner][1:]]
        (self.folder / "far/manifest.json").write_text(json.dumps({**manifest, "files": files, "extent": extent}))
        here, far = stillmap.open_map(MAP), stillmap.open_map(self.folder / "far")
        shift = np.array([regions * 640.0, 0, 0])
        self.assertGreater(shift[0], 999_000)
        for x, y in here.tiles:
            np.testing.assert_array_equal(here.tile(x, y), far.tile(x + 32 * regions, y))
            np.testing.assert_array_equal(here.tile_corner(x, y) + shift, far.tile_corner(x + 32 * regions, y))
        np.testing.assert_array_equal(stillmap.map_points(here).xyz, stillmap.map_points(far).xyz - shift)
        np.testing.assert_array_equal(here.tile_corner(-1, 2, level=3), here.origin + [-160, 320, 0])

    def test_neighbouring_boxes_share_no_point_and_leave_none_out(self):
        opened = stillmap.open_map(MAP)
        cut = float(stillmap.map_points(opened).xyz[1000, 0])
        infinite = [np.inf, np.inf, np.inf]
        left = stillmap.map_points(opened, ([-np.inf] * 3, [cut, np.inf, np.inf]))
        right = stillmap.map_points(opened, ([cut, -np.inf, -np.inf], infinite))
        self.assertEqual(len(left) + len(right), len(stillmap.map_points(opened)))
        self.assertLess(left.xyz[:, 0].max(), cut)
        self.assertEqual(right.xyz[:, 0].min(), cut)

    def test_objects_are_those_of_the_file(self):
        opened = stillmap.open_map(MAP)
        rows = stillmap.map_objects(opened)
        listed = json.loads((MAP / "objects.json").read_text())["objects"]
        self.assertEqual(set(rows["object"]), set(range(len(listed))))
        self.assertEqual(len(rows[rows["object"] == 0]), len(listed[0]["placements"]))
        x, y, z = rows["centre"][0]
        box = ((x - 0.1, y - 0.1, z - 0.1), (x + 0.1, y + 0.1, z + 0.1))
        self.assertIn(rows["object"][0], stillmap.map_objects(opened, box)["object"])
        self.assertLess(len(stillmap.map_objects(opened, box)), len(rows))

    def test_projected_points_name_their_object(self):
        opened = stillmap.open_map(MAP)
        points = stillmap.map_points(opened)
        of_objects = np.isin(points.kind, (stillmap.PROJECTED, stillmap.FILLED))
        self.assertTrue((points.object[of_objects] >= 0).all())
        self.assertTrue((points.object[~of_objects] == -1).all())

    def test_trajectory_and_checksums(self):
        opened = stillmap.open_map(MAP)
        (stamps, poses), = opened.trajectories()
        np.testing.assert_array_equal(stamps, stillmap.open_drive(DRIVE).stamps_ns[::2])
        self.assertEqual(poses.shape, (20, 4, 4))
        self.assertEqual(opened.verify(), [])

    def test_a_tar_is_a_map_as_long_as_an_array_needs_it(self):
        archive = self.folder / "map.tar"
        with tarfile.open(archive, "w") as tar:
            tar.add(MAP, ".")
        opened = stillmap.open_map(archive)
        self.assertEqual(opened.digest, stillmap.open_map(MAP).digest)
        unpacked = pathlib.Path(opened.folder)
        tile = opened.tile(*opened.tiles[0])
        total = float(tile["x"].sum())
        self.assertTrue(unpacked.exists())
        del opened
        gc.collect()
        self.assertFalse(unpacked.exists())
        self.assertEqual(float(tile["x"].sum()), total)

    def test_a_tar_that_leaves_its_folder_is_refused(self):
        archive = self.folder / "map.tar"
        (self.folder / "file").write_text("x")
        with tarfile.open(archive, "w") as tar:
            tar.add(self.folder / "file", "../beside")
        with self.assertRaisesRegex(stillmap.InputError, "found member '../beside', expected regular files"):
            stillmap.open_map(archive)

    def test_what_is_no_map(self):
        for path in (self.folder, self.folder / "missing", DRIVE / "times.txt"):
            with self.assertRaises(stillmap.InputError):
                stillmap.open_map(path)
        self.assertTrue(issubclass(stillmap.InputError, ValueError))
        self.assertTrue(issubclass(stillmap.StorageError, OSError))


class Views(unittest.TestCase):
    """Arrays outlive what they are views of, share its memory and cannot be written to."""

    def check(self, array, copy):
        gc.collect()
        [np.full(100_000, 7.0) for _ in range(20)]  # what was freed would be written over
        np.testing.assert_array_equal(array, copy)
        self.assertFalse(array.flags.writeable)
        self.assertFalse(array.flags.owndata)

    def view_of(self, make):
        array = make()
        return array, array.copy()

    def test_of_a_map(self):
        self.check(*self.view_of(lambda: stillmap.open_map(MAP).origin))

    def test_of_a_drive(self):
        self.check(*self.view_of(lambda: stillmap.open_drive(DRIVE).poses))
        self.check(*self.view_of(lambda: stillmap.open_drive(DRIVE).stamps_ns))
        self.check(*self.view_of(lambda: stillmap.open_drive(DRIVE)[0].points))
        self.check(*self.view_of(lambda: stillmap.open_drive(DRIVE)[0].intensities))

    def test_of_answers(self):
        localizer = stillmap.Localizer(stillmap.open_map(MAP))
        scan = stillmap.open_drive(DRIVE)[1]
        self.check(*self.view_of(lambda: localizer.localize(scan).T_map_lidar))
        self.check(*self.view_of(lambda: localizer.localize(scan).covariance))
        self.check(*self.view_of(lambda: localizer.session().track(scan).result.position))

    def test_points_and_histories_of_a_tile_are_the_callers_own(self):
        opened = stillmap.open_map(MAP)
        for read, field in ((opened.tile, "x"), (opened.tile_history, "first_scan")):
            array = read(0, 0)
            before = array.copy()
            array[field] += 1
            np.testing.assert_array_equal(read(0, 0), before)
            self.assertEqual(len(read(1000, 1000)), 0)

    def test_arrays_that_were_gathered_are_the_callers_own(self):
        points = stillmap.map_points(stillmap.open_map(MAP), ((-5, -5, -5), (5, 5, 5)))
        points.xyz[0] = 0.0
        self.assertTrue(points.xyz.flags.writeable)


class Localization(WithFolder):
    @classmethod
    def setUpClass(cls):
        cls.map = stillmap.open_map(MAP)
        cls.localizer = stillmap.Localizer(cls.map)
        cls.drive = stillmap.open_drive(DRIVE)

    def command_line(self, *words):
        said = subprocess.run([PROGRAM, "localize", MAP, *words, "--json"], capture_output=True, text=True)
        return json.loads(said.stdout)

    def assert_same(self, result, answer):
        self.assertEqual(result.status, answer["status"])
        self.assertEqual(result.reasons, answer["reasons"])
        self.assertEqual(result.inlier_ratio, answer["inlier_ratio"])
        if answer["pose"]:
            self.assertEqual(list(result.position), answer["pose"]["position"])
            self.assertEqual(list(result.quaternion), answer["pose"]["quaternion"])
            self.assertEqual(list(result.covariance.ravel()), answer["covariance"])
            level = result.protection.lateral_m
            self.assertEqual(level if np.isfinite(level) else None, answer["protection"]["lateral_m"])

    def test_scans_with_and_without_priors_as_the_command_line(self):
        for index, prior, words in ((1, None, []), (7, (4.0, 0.5, 0.2, -4.0), ["--prior", "4,0.5,0.2,-4"]),
                                    (39, (900.0, 0.0, 0.0, 0.0), ["--prior", "900,0,0,0"])):
            start = None if prior is None else stillmap.matrix_of(prior[:3], yaw_deg=prior[3])
            with self.subTest(index=index):
                file = DRIVE / f"velodyne/{index:06}.bin"
                answer = self.command_line(file, *words)
                self.assert_same(self.localizer.localize(self.drive[index], prior=start), answer)
                self.assert_same(self.localizer.localize(stillmap.read_scan(file), prior=start), answer)
                raw = np.fromfile(file, np.float32).reshape(-1, 4)
                self.assert_same(self.localizer.localize(raw[:, :3], prior=start), answer)

    def test_a_prior_of_a_quaternion(self):
        words = ["--prior", "1,0,0,0.1,0.0,0.0,0.995"]
        prior = stillmap.matrix_of((1, 0, 0), (0.1, 0.0, 0.0, 0.995))
        answer = self.command_line(DRIVE / "velodyne/000001.bin", *words)
        self.assert_same(self.localizer.localize(self.drive[1], prior=prior), answer)

    def test_other_methods_and_options(self):
        prior = stillmap.matrix_of((0.6, 0, 0))
        file = DRIVE / "velodyne/000001.bin"
        icp = stillmap.Localizer(self.map, method="point_to_plane")
        self.assert_same(icp.localize(self.drive[1], prior=prior),
                         self.command_line(file, "--prior", "0.6,0,0,0", "--method", "point_to_plane"))
        options = self.folder / "options.json"
        options.write_text('{"preset": "indoor", "verdict": {"ok_support": 1.0}}')
        strict = stillmap.Localizer(self.map, preset="indoor", options={"verdict.ok_support": 1.0})
        answer = self.command_line(file, "--prior", "0.6,0,0,0", "--options", options)
        self.assertEqual(answer["status"], "degraded")
        self.assert_same(strict.localize(self.drive[1], prior=prior), answer)

    def test_a_session_as_the_command_line(self):
        file = self.folder / "poses.tum"
        subprocess.run([PROGRAM, "localize", MAP, DRIVE, "--select", "1::2", "-o", file], check=True,
                       capture_output=True)
        stamps, poses = stillmap.read_trajectory(file)
        session = self.localizer.session()
        tracked = [session.track(self.drive[index]) for index in range(1, 40, 2)]
        found = [pose for pose in tracked if pose.result.T_map_lidar is not None]
        self.assertEqual([pose.stamp_ns for pose in found], list(stamps))
        np.testing.assert_array_equal([pose.result.position for pose in found], poses[:, :3, 3])
        self.assertEqual(tracked[0].searched_from, "everywhere")

    def test_a_session_of_arrays_with_odometry(self):
        session = self.localizer.session()
        session.initialize(self.drive.poses[1], 0.01 * np.eye(6))
        first = session.track(self.drive.stamps_ns[1], self.drive[1].points)
        self.assertEqual((first.result.status, first.searched_from), ("ok", "given"))
        step = stillmap.OdometryStep(first.stamp_ns, np.linalg.inv(self.drive.poses[1]) @ self.drive.poses[3],
                                     1e-4 * np.eye(6))
        second = session.track(int(self.drive.stamps_ns[3]), self.drive[3].points, odometry=step)
        self.assertEqual((second.result.status, second.searched_from), ("ok", "odometry"))

    def test_a_prior_that_excludes_the_pose(self):
        prior = stillmap.matrix_of((3, 0, 0))
        sharp = self.localizer.localize(self.drive[1], prior=prior, prior_covariance=1e-2 * np.eye(6))
        self.assertNotEqual(sharp.status, "ok")
        self.assertEqual(self.localizer.localize(self.drive[1], prior=prior).status, "ok")

    def test_points_without_a_return_and_in_boxes_are_left_out(self):
        points = self.drive[1].points.copy()
        plain = self.localizer.localize(points)
        spoiled = np.concatenate([np.full((5, 3), np.nan, np.float32), np.zeros((3, 3), np.float32), points])
        scan = stillmap.Scan(spoiled)
        self.assertEqual(scan.dropped, {"non_finite": 5, "zero_range": 3, "unsure": 0})
        np.testing.assert_array_equal(self.localizer.localize(scan).T_map_lidar, plain.T_map_lidar)
        box = np.array([[20.0, 0.0, 0.0, 10.0, 20.0, 6.0, 0.0]])
        with_box = self.localizer.localize(points, movable=box)
        inside = (np.abs(points - box[0, :3]) <= box[0, 3:6] / 2 + 0.1).all(axis=1)
        self.assertGreater(inside.sum(), 100)
        np.testing.assert_array_equal(with_box.T_map_lidar, self.localizer.localize(points[~inside]).T_map_lidar)

    def test_python_goes_on_while_a_scan_is_searched(self):
        scan, busy, seen = self.drive[1], [False], 0

        def search():
            for _ in range(3):
                busy[0] = True
                self.localizer.localize(scan)
                busy[0] = False

        # Nobody is interrupted: this thread sees the other busy only when that one lets Python go.
        interval = sys.getswitchinterval()
        sys.setswitchinterval(1000)
        self.addCleanup(sys.setswitchinterval, interval)
        thread = threading.Thread(target=search)
        thread.start()
        while thread.is_alive():
            seen += busy[0]
            time.sleep(0.001)
        self.assertGreater(seen, 0)

    def test_threads_get_the_same_answers(self):
        expected, found = self.localizer.localize(self.drive[1]).T_map_lidar, []
        threads = [threading.Thread(target=lambda: found.append(self.localizer.localize(self.drive[1]).T_map_lidar))
                   for _ in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        for each in found:
            np.testing.assert_array_equal(each, expected)
        self.assertEqual(len(found), 4)


class WrongArguments(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.localizer = stillmap.Localizer(stillmap.open_map(MAP))

    def refused(self, words, call, *arguments, **named):
        with self.assertRaises(ValueError) as caught:
            call(*arguments, **named)
        self.assertIn(words, str(caught.exception))

    def test_points_and_times(self):
        localize = self.localizer.localize
        points = np.zeros((5, 3), np.float32)
        self.refused("points: found float64 array with shape (5, 3), expected a float32 array with shape (N, 3): convert",
                     localize, points.astype(np.float64))
        self.refused("points: found float32 array with shape (5, 4), expected a float32 array with shape (N, 3): give the "
                     "columns", localize, np.zeros((5, 4), np.float32))
        self.refused("points: found float32 array with shape (15,)", localize, points.ravel())
        self.refused("points: found >f4 array", localize, points.astype(">f4"))
        self.refused("points: found list, expected a float32 array with shape (N, 3), or a Scan", localize, [[1, 2, 3]])
        self.refused("times: found float32 array with shape (4,), expected a float32 array with shape (5,)", localize,
                     points, np.zeros(4, np.float32))
        self.refused("times: found float64 array", localize, points, np.zeros(5))
        self.refused("times: found float32 array with shape (5,), expected None beside a Scan", localize,
                     stillmap.Scan(points), np.zeros(5, np.float32))
        self.refused("10", localize, points + 1, np.full(5, 11, np.float32))

    def test_scans_of_a_session(self):
        session, scan = self.localizer.session(), stillmap.Scan(np.ones((5, 3), np.float32), stamp_ns=1)
        self.refused("stamp_ns: found float, expected a whole number, or a Scan", session.track, 1.5, scan.points)
        self.refused("points: found None, expected", session.track, 1)
        self.refused("points: found float32 array with shape (5, 3), expected None beside a Scan", session.track, scan,
                     scan.points)
        self.refused("covariance: found float64 array with shape (3, 3)", session.initialize, np.eye(4), np.eye(3))
        self.refused("", session.initialize, np.eye(4), np.zeros((6, 6)))
        self.refused("covariance", stillmap.OdometryStep, 1, np.eye(4), 1.0)

    def test_priors(self):
        localize, points = self.localizer.localize, np.ones((5, 3), np.float32)
        self.refused("prior: found float64 array with shape (3, 4), expected a 4 x 4 matrix", localize, points,
                     prior=np.eye(4)[:3])
        self.refused("prior: found str, expected a 4 x 4 matrix", localize, points, prior="here")
        self.refused("prior: found a last row other than 0 0 0 1", localize, points, prior=np.ones((4, 4)))
        self.refused("prior: found a number that is not finite", localize, points, prior=np.full((4, 4), np.nan))
        self.refused("prior: found None beside prior_covariance", localize, points, prior_covariance=np.eye(6))
        self.refused("prior_covariance: found float64 array with shape (3, 3), expected a 6 x 6", localize, points,
                     prior=np.eye(4), prior_covariance=np.eye(3))
        self.refused("", localize, points, prior=np.diag([2.0, 2.0, 2.0, 1.0]))
        self.refused("movable: found float64 array with shape (1, 6)", localize, points, movable=np.ones((1, 6)))
        self.refused("quaternion: found norm 2", stillmap.matrix_of, (0, 0, 0), (0, 0, 0, 2))

    def test_options_boxes_and_scans(self):
        opened = stillmap.open_map(MAP)
        self.refused("method", stillmap.Localizer, opened, method="magic")
        self.refused("preset", stillmap.Localizer, opened, preset="boat")
        self.refused("options: found 'radius'", stillmap.Localizer, opened, options={"radius": 1})
        self.refused("aligner.search_radius_m", stillmap.Localizer, opened, options={"aligner.search_radius_m": 99})
        self.refused("expected a whole number", stillmap.Localizer, opened, options={"aligner.max_places": 1.5})
        self.refused("box: found float64 array with shape (2, 2)", stillmap.map_points, opened, ((0, 0), (1, 1)))
        self.refused("the second beyond the first", stillmap.map_points, opened, ((0, 0, 0), (1, 1, 0)))
        with self.assertRaises(IndexError):
            stillmap.open_drive(DRIVE)[40]
        self.assertEqual(stillmap.open_drive(DRIVE)[-1].index, 39)


class Drives(WithFolder):
    def test_a_drive_with_times_of_points_is_read_as_it_was_written(self):
        subprocess.run([PROGRAM, "simulate", "town", "-o", self.folder / "drive", "--scans", "5", "--layout", "pcd"],
                       check=True, capture_output=True)
        drive = stillmap.open_drive(self.folder / "drive")
        self.assertIsNotNone(drive[0].times)
        stillmap.write_drive(self.folder / "copy", drive, drive.poses)
        copy = stillmap.open_drive(self.folder / "copy")
        self.assertEqual(copy.layout, drive.layout)
        np.testing.assert_array_equal(copy.stamps_ns, drive.stamps_ns)
        np.testing.assert_allclose(copy.poses, drive.poses, rtol=0, atol=1e-12)
        for ours, theirs in zip(copy, drive, strict=True):
            np.testing.assert_array_equal(ours.points, theirs.points)
            np.testing.assert_array_equal(ours.intensities, theirs.intensities)
            np.testing.assert_array_equal(ours.times, theirs.times)

    def test_a_drive_without_poses_keeps_its_stamps(self):
        points = np.random.default_rng(1).normal(size=(2000, 3)).astype(np.float32)
        stamps = [1_700_000_000_000_000_001, 1_700_000_000_100_000_007]
        stillmap.write_drive(self.folder / "drive", [stillmap.Scan(points, stamp_ns=stamp) for stamp in stamps])
        drive = stillmap.open_drive(self.folder / "drive")
        self.assertEqual(list(drive.stamps_ns), stamps)
        self.assertIsNone(drive.poses)
        np.testing.assert_array_equal(drive[1].points, points)

    def test_what_cannot_be_written(self):
        scan = stillmap.Scan(np.ones((5, 3), np.float32), stamp_ns=5)
        for words, scans, poses in (("increasing stamps", [scan, scan], np.tile(np.eye(4), (2, 1, 1))),
                                    ("found 2, expected one for each of the 1", [scan], np.tile(np.eye(4), (2, 1, 1))),
                                    ("expected shape \\(N, 4, 4\\)", [scan], np.eye(4)),
                                    ("ns since 1970, or poses", [scan], None), ("found none", [], None)):
            with self.assertRaisesRegex(ValueError, words):
                stillmap.write_drive(self.folder / "drive", scans, poses)
            self.assertEqual(list(self.folder.iterdir()), [])
        with self.assertRaises(FileExistsError):
            stillmap.write_drive(self.folder, [scan], [np.eye(4)])

    def test_trajectories(self):
        drive = stillmap.open_drive(DRIVE)
        stillmap.write_trajectory(self.folder / "poses.tum", drive.stamps_ns, drive.poses)
        stamps, poses = stillmap.read_trajectory(self.folder / "poses.tum")
        np.testing.assert_array_equal(stamps, drive.stamps_ns)
        np.testing.assert_allclose(poses, drive.poses, rtol=0, atol=1e-12)
        with self.assertRaisesRegex(ValueError, "one 4 x 4 matrix for each of the 40 stamps"):
            stillmap.write_trajectory(self.folder / "poses.tum", drive.stamps_ns, drive.poses[1:])


class Programs(WithFolder):
    def build(self, **options):
        return stillmap.build(DRIVE, self.folder / "map", select="::2", **options)

    def assert_ended(self):
        """No map, and no process of the build."""
        self.assertFalse((self.folder / "map").exists())
        for process in pathlib.Path("/proc").glob("[0-9]*"):
            with contextlib.suppress(OSError):  # it ended meanwhile
                self.assertNotIn(os.fsencode(self.folder / "map"), (process / "cmdline").read_bytes())

    def test_progress_never_falls_and_a_build_that_was_stopped_goes_on(self):
        class Enough(Exception):
            pass

        def stop(progress):
            if progress.fraction > 0.2:
                raise Enough

        with self.assertRaises(Enough):
            self.build(progress=stop)
        self.assert_ended()
        told = []
        result = self.build(progress=told.append)
        fractions = [each.fraction for each in told]
        self.assertEqual(fractions, sorted(fractions))
        self.assertGreater(len({each.stage for each in told}), 3)
        self.assertEqual((self.folder / "map/manifest.json").read_bytes(), (MAP / "manifest.json").read_bytes())
        self.assertIsInstance(result, dict)

    def test_cancel_and_interrupt_end_a_build(self):
        cancel = threading.Event()
        with self.assertRaises(stillmap.Cancelled):
            self.build(progress=lambda _: cancel.set(), cancel=cancel)
        self.assert_ended()
        timer = threading.Timer(0.7, lambda: signal.raise_signal(signal.SIGINT))
        timer.start()
        with self.assertRaises(KeyboardInterrupt):
            self.build()
        self.assert_ended()

    def test_errors_are_those_of_the_program(self):
        with self.assertRaisesRegex(stillmap.ProgramError, "stillmap: .*--voxel") as caught:
            self.build(voxel="wide")
        self.assertEqual(caught.exception.exit_code, 2)
        with self.assertRaises(stillmap.ProgramError):
            stillmap.evaluate_localization(self.folder / "none", DRIVE)
        with self.assertRaisesRegex(ValueError, "progress: found for inspect"):
            stillmap.run("inspect", DRIVE, progress=print)
        self.assertEqual(stillmap.run("inspect", DRIVE)["scans"], 40)
        program = os.environ.pop("STILLMAP_PROGRAM")
        path, os.environ["PATH"] = os.environ["PATH"], str(self.folder)
        try:
            with self.assertRaisesRegex(FileNotFoundError, "STILLMAP_PROGRAM"):
                self.build()
        finally:
            os.environ["STILLMAP_PROGRAM"], os.environ["PATH"] = program, path

    def test_a_lost_scan_is_an_answer(self):
        answer = stillmap.run("localize", MAP, DRIVE / "velodyne/000001.bin", prior=(900, 0, 0, 0))
        self.assertEqual(answer["status"], "lost")


if __name__ == "__main__":
    os.environ["STILLMAP_PROGRAM"] = str(PROGRAM)
    unittest.main(argv=sys.argv[:1] + sys.argv[4:])
