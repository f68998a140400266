"""What the sets rest on: rates, rigid errors and what is done to scans. Exit code 77 (skipped) without NumPy."""

import sys
import unittest

try:
    import numpy as np
except ImportError:
    print("skipped: numpy is not installed (Debian: python3-numpy)")
    sys.exit(77)

import changes
import figures
import poses
import rates
import report
from program import Map


def a_scan(count=4000):
    random = np.random.default_rng(3)
    azimuth, elevation = random.uniform(-np.pi, np.pi, count), np.radians(random.integers(-15, 16, count))
    ranges = random.uniform(1.0, 60.0, count)
    return np.stack([ranges * np.cos(elevation) * np.cos(azimuth), ranges * np.cos(elevation) * np.sin(azimuth),
                     ranges * np.sin(elevation), random.uniform(size=count)], axis=1)


def elevations(points):
    return np.arctan2(points[:, 2], np.hypot(points[:, 0], points[:, 1]))


def at(x, y, yaw=0.0):
    T = poses.yawed(yaw)
    T[:2, 3] = x, y
    return T


def answer(status, metres, kind="building_new"):
    table = {name: np.zeros(1) for name in ("error_y_m", "error_z_m", "error_roll_rad", "error_pitch_rad",
                                            "error_yaw_rad")}
    return {**table, "error_x_m": np.array([metres]), "status": np.array([status]), "kind": np.array([kind])}


class Changes(unittest.TestCase):
    def setUp(self):
        self.points = a_scan()

    def random(self):
        return np.random.default_rng(5)

    def test_half_of_the_azimuths_is_missing_and_the_other_half_is_as_it_was(self):
        kept = changes.without_half(self.points, self.random())
        self.assertAlmostEqual(len(kept) / len(self.points), 0.5, delta=0.05)
        azimuth = np.sort(np.arctan2(kept[:, 1], kept[:, 0]))
        gaps = np.append(np.diff(azimuth), azimuth[0] + 2.0 * np.pi - azimuth[-1])
        self.assertAlmostEqual(gaps.max(), np.pi, delta=0.05)
        self.assertTrue({tuple(p) for p in kept} <= {tuple(p) for p in self.points})

    def test_nothing_is_seen_behind_the_wall_and_directions_stay(self):
        seen = changes.behind_wall(self.points, self.random())
        moved = np.any(seen != self.points, axis=1)
        self.assertTrue(0.3 < moved.mean() < 0.5)
        normal, *_ = np.linalg.lstsq(seen[moved, :2], np.full(moved.sum(), changes.WALL_M), rcond=None)
        self.assertAlmostEqual(np.linalg.norm(normal), 1.0, places=6)
        self.assertLess((seen[:, :2] @ normal).max(), changes.WALL_M + 1e-6)
        np.testing.assert_allclose(elevations(seen), elevations(self.points), atol=1e-9)
        np.testing.assert_allclose(np.arctan2(seen[:, 1], seen[:, 0]), np.arctan2(self.points[:, 1], self.points[:, 0]))

    def test_shuffled_azimuths_keep_ranges_and_elevations(self):
        shuffled = changes.shuffled_azimuths(self.points, self.random())
        np.testing.assert_allclose(np.linalg.norm(shuffled[:, :3], axis=1), np.linalg.norm(self.points[:, :3], axis=1))
        np.testing.assert_allclose(elevations(shuffled), elevations(self.points), atol=1e-9)
        self.assertGreater(np.mean(np.linalg.norm(shuffled - self.points, axis=1) > 0.5), 0.9)

    def test_scaled_ranges_keep_directions(self):
        scaled = changes.scaled_ranges(self.points, self.random())
        factors = np.linalg.norm(scaled[:, :3], axis=1) / np.linalg.norm(self.points[:, :3], axis=1)
        np.testing.assert_allclose(scaled[:, :3], factors[:, None] * self.points[:, :3])
        self.assertTrue(0.5 <= factors.min() < 0.6 and 1.4 < factors.max() <= 1.5)

    def test_same_scan_is_changed_in_the_same_way(self):
        change = changes.keyed(changes.ball, 7)
        np.testing.assert_array_equal(change(self.points, 3), change(self.points, 3))
        self.assertFalse(np.array_equal(change(self.points, 3), change(self.points, 4)))

    def test_the_parallel_street_lies_aside_and_keeps_the_heading(self):
        there = [at(x, 0.0) for x in range(100)]
        back = [at(100 - x, 120.0, np.pi) for x in range(100)]
        across = [at(100.0, y, np.pi / 2.0) for y in range(120)]
        map_ = Map(None, np.array(there + across + back))
        aside = changes.parallel_street(map_, at(30.0, 1.0))
        np.testing.assert_allclose(aside, at(30.0, 120.0), atol=1e-9)
        self.assertIsNone(changes.parallel_street(Map(None, np.array(there + across)), at(30.0, 1.0)))


class Figures(unittest.TestCase):
    def test_an_ok_beyond_half_a_metre_is_false(self):
        self.assertEqual([bool(figures.false_ok(answer(status, m))[0])
                          for status, m in (("ok", 0.49), ("ok", 0.51), ("degraded", 9.0), ("ok", np.nan))],
                         [False, True, False, True])

    def test_only_in_the_parallel_street_unsure_is_enough(self):
        self.assertFalse(figures.handled(answer("lost", np.nan))[0])
        self.assertTrue(figures.handled(answer("lost", np.nan, "parallel_street"))[0])
        self.assertTrue(figures.handled(answer("degraded", 120.0, "parallel_street"))[0])
        self.assertFalse(figures.handled(answer("ok", 120.0, "parallel_street"))[0])

    def test_nothing_seen_in_n_queries_bounds_the_rate_by_three_in_n(self):
        self.assertAlmostEqual(rates.rate([0] * 10, [100] * 10)["upper_95"] * 1000.0, 3.0, delta=0.05)

    def test_what_happens_on_one_drive_only_is_bounded_wider_than_by_its_count(self):
        spread, together = rates.rate([2] * 10, [100] * 10), rates.rate([20] + [0] * 9, [100] * 10)
        self.assertEqual(spread["rate"], together["rate"])
        self.assertGreater(together["upper_95"], 1.3 * spread["upper_95"])

    def test_a_quick_run_bears_one_bad_answer_and_fewer_right_ones_but_not_two_or_none(self):
        def broken(right, bad):
            limits = figures.Limits()
            limits("right, share of queries", right, low=0.9)
            return report.broken({"sets": {"hard": {"limits": limits.lines, "listed": [{}] * bad}}}, quick=True)

        self.assertEqual(broken(0.85, 1), [])
        self.assertEqual(len(broken(0.85, 2)), 1)
        self.assertEqual(len(broken(0.0, 0)), 1)
        self.assertEqual(len(broken(np.nan, 0)), 1)

    def test_twists_come_back(self):
        twist = np.array([0.3, -2.0, 0.1, 0.02, -0.4, 1.1])
        np.testing.assert_allclose(poses.log_se3(poses.exp_se3(twist)), twist, atol=1e-12)


if __name__ == "__main__":
    unittest.main()
