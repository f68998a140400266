"""What is done to a scan before it is asked for.

A change takes records (fields x, y, z [m, lidar frame]), the scan's index and a reader of other scans of the drive, and
gives records. Same index, same result.
"""

import numpy as np

import scans

SWEEP_S = 0.1


def azimuth_deg(records):
    return np.degrees(np.arctan2(records["y"], records["x"]))


def off_deg(records, middle_deg):
    return np.abs((azimuth_deg(records) - middle_deg + 180.0) % 360.0 - 180.0)


def whole(records, index, read):
    return records


def sector(middle_deg, width_deg):
    """Only the points of a sector of azimuths."""
    return lambda records, index, read: records[off_deg(records, middle_deg) <= 0.5 * width_deg]


def blocked(middle_deg, share):
    """Nothing from a sector of azimuths, as behind a truck."""
    return lambda records, index, read: records[off_deg(records, middle_deg) > 180.0 * share]


def biased(middle_deg, width_deg, bias_m):
    """The ranges of a sector are off."""
    def change(records, index, read):
        points = scans.positions(records)
        ranges = np.linalg.norm(points, axis=1, keepdims=True)
        off = off_deg(records, middle_deg)[:, None] <= 0.5 * width_deg
        return scans.with_positions(records, points * np.where(off, 1.0 + bias_m / np.maximum(ranges, 1.0), 1.0))
    return change


def noise(share):
    """So many of the returns lie anywhere along their rays, up to 60 m."""
    def change(records, index, read):
        random = np.random.default_rng([1, index])
        points = scans.positions(records)
        ranges = np.linalg.norm(points, axis=1, keepdims=True)
        wrong = random.uniform(size=(len(points), 1)) < share
        anywhere = random.uniform(1.0, 60.0, (len(points), 1))
        return scans.with_positions(records, points * np.where(wrong, anywhere / np.maximum(ranges, 0.1), 1.0))
    return change


def moving(speed_m_s=0.0, turn_deg_s=0.0):
    """As recorded by a sensor that turns once in a sweep, seam behind, and moves meanwhile; not deskewed."""
    def change(records, index, read):
        points = scans.positions(records)
        time_s = SWEEP_S * np.arctan2(points[:, 1], points[:, 0]) / (2.0 * np.pi)
        angle = -np.radians(turn_deg_s) * time_s
        x, y = points[:, 0] - speed_m_s * time_s, points[:, 1]
        turned = np.c_[np.cos(angle) * x - np.sin(angle) * y, np.sin(angle) * x + np.cos(angle) * y, points[:, 2]]
        return scans.with_positions(records, turned)
    return change


def stitched(records, index, read):
    """The left half is of the scan before: two half turns that do not belong together."""
    before = read(max(0, index - 1))
    return np.concatenate([records[records["y"] <= 0.0], before[before["y"] > 0.0]])


def scaled(factor, axes=(0, 1, 2)):
    def change(records, index, read):
        points = scans.positions(records)
        points[:, axes] *= factor
        return scans.with_positions(records, points)
    return change


PARTS = {
    "whole": whole,
    "front": sector(0, 180), "left": sector(90, 180), "back": sector(180, 180), "right": sector(-90, 180),
    "front_left": sector(45, 90), "back_left": sector(135, 90), "back_right": sector(-135, 90),
    "front_right": sector(-45, 90),
}
DIRECTIONS = {"front": 0, "left": 90, "back": 180, "right": -90}
BLOCKED = {f"blocked_{name}_{100 * share:.0f}": blocked(middle, share)
           for name, middle in DIRECTIONS.items() for share in (0.25, 0.5, 0.75)}
# The pose is there, and should be found.
SOLVABLE = {
    "turn_6_deg_s": moving(turn_deg_s=6.0), "turn_20_deg_s": moving(turn_deg_s=20.0), "speed_2_m_s": moving(2.0),
    "half_5_cm_off": biased(90, 180, 0.05), "all_5_cm_off": biased(0, 361, 0.05), "stitched": stitched,
    "noise_10": noise(0.1), "noise_30": noise(0.3),
}
# No pose explains these.
UNSOLVABLE = {"mirrored": scaled(-1.0, (1,)), "upside_down": scaled(-1.0, (1, 2)), "scale_0.9": scaled(0.9),
              "scale_1.1": scaled(1.1)}
