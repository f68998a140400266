#!/usr/bin/env python3
"""Tests of the comparison on clouds whose answer is known. Exit code 77 (skipped) without numpy."""

import json
import pathlib
import sys
import tempfile
import unittest

try:
    import numpy as np
except ImportError:
    print("skipped: numpy is not installed (Debian: python3-numpy)")
    sys.exit(77)

sys.path.insert(0, str(pathlib.Path(__file__).parent))
import divergence
import ground
import rings
import shapes
from features import BY_KEY, FEATURES, Feature, histogram, measure
from scans import Box, Scan, read_streets

ELEVATIONS = np.concatenate([np.linspace(2.0, -8.33, 32), np.linspace(-8.83, -24.33, 32)])


def sweep(columns=720, lost=0.0, seed=1, wall_m=30.0):
    """A flat road 1.73 m below the sensor inside a round wall, written as KITTI does.

    @return (points N x 4, ring per point).
    """
    rng = np.random.default_rng(seed)
    ring, column = (a.ravel() for a in np.mgrid[0:64, 0:columns])
    azimuth = np.radians((column + rng.uniform(0.0, 0.5, ring.size)) * 360.0 / columns)
    elevation = np.radians(ELEVATIONS[ring])
    with np.errstate(divide="ignore"):
        to_road = np.where(elevation < 0, -1.73 / np.sin(elevation), np.inf)
    r = np.minimum(to_road, wall_m / np.cos(elevation)) + rng.normal(0.0, 0.01, ring.size)
    points = np.column_stack([r * np.cos(elevation) * np.cos(azimuth),
                              r * np.cos(elevation) * np.sin(azimuth), r * np.sin(elevation),
                              np.full(ring.size, 0.3)])
    back = rng.random(ring.size) >= lost
    return points[back], ring[back]


class JensenShannon(unittest.TestCase):
    def test_equal_histograms_are_0_apart(self):
        self.assertEqual(divergence.jensen_shannon([3, 5, 0], [6, 10, 0]), 0.0)

    def test_disjoint_histograms_are_1_apart(self):
        self.assertAlmostEqual(divergence.jensen_shannon([1, 2, 0, 0], [0, 0, 9, 1]), 1.0)

    def test_is_symmetric_and_matches_a_case_by_hand(self):
        # p = (1, 0), q = (1/2, 1/2), m = (3/4, 1/4).
        expected = 0.5 * np.log2(4 / 3) + 0.5 * (0.5 * np.log2(2 / 3) + 0.5 * np.log2(2))
        self.assertAlmostEqual(divergence.jensen_shannon([4, 0], [2, 2]), expected)
        self.assertAlmostEqual(divergence.jensen_shannon([2, 2], [4, 0]), expected)

    def test_of_nothing_is_no_number(self):
        self.assertTrue(np.isnan(divergence.jensen_shannon([0, 0], [1, 2])))


class Compare(unittest.TestCase):
    feature = Feature("f", "f", "", tuple(range(11)), floor=10)

    def streets(self, shift, seed=3):
        rng = np.random.default_rng(seed)
        out = {}
        for name in ("real a", "real b", "real c", "sim"):
            offset = shift if name == "sim" else 0.0
            values = [rng.normal(4.0 + offset, 1.0, 400) for _ in range(3)]
            out[name] = [histogram(v, self.feature.edges)[None] for v in values]
        return out

    def result(self, streets):
        return divergence.compare(self.feature, streets, ["sim"], ["real a", "real b", "real c"])

    def test_a_simulator_that_equals_the_world_has_ratio_1(self):
        self.assertLess(abs(self.result(self.streets(0.0))["ratio"] - 1.0), 0.5)

    def test_a_shifted_one_is_above_the_bar(self):
        result = self.result(self.streets(1.0))
        self.assertGreater(result["ratio"], 5.0)
        self.assertLessEqual(result["range"][0], result["ratio"])

    def test_more_scans_of_a_street_do_not_change_the_ratio_much(self):
        streets = self.streets(0.0)
        streets["sim"] = [s * 50 for s in streets["sim"]]
        self.assertLess(self.result(streets)["ratio"], 1.6)

    def test_a_street_with_too_few_samples_is_named(self):
        streets = self.streets(0.0)
        streets["real b"] = [np.zeros((1, 10), np.int64)]
        self.assertEqual(self.result(streets)["left_out"], ["real b in all"])

    def test_same_seed_same_result(self):
        self.assertEqual(self.result(self.streets(0.5)), self.result(self.streets(0.5)))


class RingRecovery(unittest.TestCase):
    def test_finds_every_ring_of_a_full_sweep(self):
        points, truth = sweep()
        found = rings.find_rings(points)
        np.testing.assert_array_equal(found.ring, truth)
        self.assertEqual(found.notes, [])
        np.testing.assert_allclose(found.elevation_deg, ELEVATIONS, atol=0.2)

    def test_counts_the_shots_that_did_not_come_back(self):
        points, truth = sweep(lost=0.0)
        keep = (truth != 40) | (np.arange(len(truth)) % 4 != 0)
        found = rings.find_rings(points[keep])
        self.assertLess(abs(found.shots - 720), 8)
        self.assertLess(abs(found.returns[40] / found.shots - 0.75), 0.02)

    def test_points_thrown_back_over_straight_ahead_start_no_ring(self):
        points, truth = sweep()
        first = np.flatnonzero(np.diff(truth)) + 1
        # As motion compensation does: the second point of a ring ends up right of straight ahead.
        moved = first + 1
        r = np.hypot(points[moved, 0], points[moved, 1])
        points[moved, 0], points[moved, 1] = r * np.cos(-0.001), r * np.sin(-0.001)
        found = rings.find_rings(points)
        self.assertEqual(found.ring.max(), 63)
        self.assertLess(np.count_nonzero(found.ring != truth), 2 * 64)

    def test_counts_from_the_bottom_when_the_top_saw_only_sky(self):
        points, truth = sweep()
        found = rings.find_rings(points[truth >= 5])
        np.testing.assert_array_equal(found.ring, truth[truth >= 5])
        self.assertEqual(len(found.notes), 1)


class Ground(unittest.TestCase):
    def noisy_plane(self, spread_m, seed=4):
        rng = np.random.default_rng(seed)
        xy = rng.uniform(-10.0, 10.0, (40000, 2))
        z = 0.05 * xy[:, 0] - 0.02 * xy[:, 1] - 1.73 + rng.normal(0.0, spread_m, len(xy))
        return np.column_stack([xy, z])

    def test_plane_spread_is_that_of_the_noise(self):
        for spread_m in (0.005, 0.02):
            found, _ = ground.plane_residual_spread(self.noisy_plane(spread_m))
            self.assertLess(abs(np.median(found) / spread_m - 1.0), 0.05)

    def test_plane_spread_is_not_moved_by_a_post(self):
        points = self.noisy_plane(0.01)
        points[::50, 2] += 1.0
        found, _ = ground.plane_residual_spread(points)
        self.assertLess(abs(np.median(found) / 0.01 - 1.0), 0.15)

    def test_plane_spread_of_nothing_is_empty(self):
        self.assertEqual(len(ground.plane_residual_spread(np.zeros((0, 3)))[0]), 0)

    def test_follows_a_slope_and_leaves_a_wall_above(self):
        points, _ = sweep()
        points[:, 2] += 0.04 * points[:, 0]
        height = ground.height_above_ground(points, ground.ground_grid(points))
        r = np.hypot(points[:, 0], points[:, 1])
        road = (r < 28.0) & (r > 4.0)
        self.assertGreater(np.mean(np.abs(height[road]) < 0.1), 0.99)
        wall = (r > 29.5) & (points[:, 2] - 0.04 * points[:, 0] > -1.0)
        self.assertGreater(np.nanmin(height[wall]), 0.4)


class Shapes(unittest.TestCase):
    def test_clusters_are_told_apart_and_measured(self):
        rng = np.random.default_rng(5)
        post = rng.uniform([0.05, 0.05, 0.0], [0.35, 0.35, 3.0], (300, 3))
        box = rng.uniform([8.0, 0.0, 0.0], [12.0, 2.0, 1.5], (5000, 3))
        extent, area = shapes.cluster_sizes(np.vstack([post, box]))
        self.assertEqual(len(extent), 2)
        np.testing.assert_allclose(sorted(extent), [1.5, 3.0], atol=0.05)
        np.testing.assert_allclose(sorted(area), [0.16, 8.0], atol=0.01)

    def test_a_wall_is_flat_and_upright(self):
        rng = np.random.default_rng(6)
        wall = rng.uniform([10.0, -5.0, 0.0], [10.0, 5.0, 5.0], (20000, 3))
        wall[:, 0] += rng.normal(0.0, 0.01, len(wall)) + 0.3
        values, steep, _ = shapes.voxel_eigen(wall)
        self.assertLess(np.median(steep), 0.05)
        self.assertLess(abs(1000 * np.median(np.sqrt(values[:, 2])) - 10.0), 1.0)


class Boxes(unittest.TestCase):
    def test_holds_what_is_inside_a_turned_box(self):
        box = Box(np.array([10.0, 5.0, 0.0]), np.array([4.0, 2.0, 1.5]), np.radians(90.0), "car")
        points = np.array([[10.0, 6.9, 0.0], [11.9, 5.0, 0.0], [10.9, 5.0, 0.7], [10.0, 5.0, 0.8]])
        self.assertEqual(box.holds(points).tolist(), [True, False, True, False])
        self.assertTrue(box.holds(points, 0.1)[3])


class Features(unittest.TestCase):
    def test_every_feature_of_a_sweep_has_its_shape(self):
        points, _ = sweep(lost=0.1)
        counts, facts = measure(Scan(points, None, None, None))
        for feature in FEATURES:
            self.assertEqual(counts[feature.key].shape,
                             (len(feature.groups), len(feature.edges) - 1), feature.key)
        self.assertEqual(counts["range"].sum(), len(points))
        self.assertEqual(facts["points"], len(points))

    def test_values_beyond_the_bins_count_in_the_outer_ones(self):
        self.assertEqual(histogram([-1.0, 81.0, 5.0, np.nan], (0, 10, 80)).tolist(), [2, 1])

    def test_cars_are_counted_by_distance(self):
        points, _ = sweep()
        box = Box(np.array([10.0, 0.0, -1.7]), np.array([4.0, 2.0, 1.0]), 0.0, "car")
        counts, _ = measure(Scan(points, None, None, [box]))
        self.assertEqual(counts["car_points"].sum(axis=1).tolist(), [1, 0, 0])
        self.assertEqual(BY_KEY["car_points"].groups[0], "5 to 15 m")


class Folders(unittest.TestCase):
    def test_reads_a_drive_with_labels_and_boxes(self):
        with tempfile.TemporaryDirectory() as name:
            folder = pathlib.Path(name)
            (folder / "velodyne").mkdir()
            (folder / "labels").mkdir()
            np.array([[1, 2, 3, 0.5]], "<f4").tofile(folder / "velodyne/000000.bin")
            np.array([(7 << 16) | 252], "<u4").tofile(folder / "labels/000000.label")
            (folder / "boxes.json").write_text(json.dumps({"scans": [{"scan": 0, "boxes": [
                {"centre": [1, 2, 3], "size": [4, 2, 1], "yaw": 0.0, "class": "car"}]}]}))
            (street,) = read_streets(folder)
            scan = street.scan(0)
        self.assertEqual((scan.labels[0], scan.instances[0]), (252, 7))
        self.assertTrue(scan.boxes[0].holds(scan.points)[0])

    def test_a_folder_of_no_known_layout_is_named(self):
        with tempfile.TemporaryDirectory() as name:
            with self.assertRaisesRegex(ValueError, "neither"):
                read_streets(name)


if __name__ == "__main__":
    unittest.main()
