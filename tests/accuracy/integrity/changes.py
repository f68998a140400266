"""What is done to scans before they are asked or mapped: noise, things in the way, buildings gone.

Each takes points (N x 4: x y z [m, lidar frame], intensity) and gives points.
"""

import numpy as np

import poses

NOISE_RADIUS_M = 60.0
# Laser rings lie farther apart than this in every sensor that is simulated [rad].
RING_RAD = np.radians(0.15)
WALL_M = 3.0
# SemanticKITTI: building, other structure.
BUILDINGS = [50, 52]
PLOT_M = 15.0
REMOVED_SHARE = 0.5


def ball(points, random):
    """As many points, uniform in a ball."""
    directions = random.normal(size=(len(points), 3))
    radii = NOISE_RADIUS_M * np.cbrt(random.uniform(size=(len(points), 1)))
    changed = points.copy()
    changed[:, :3] = directions / np.linalg.norm(directions, axis=1, keepdims=True) * radii
    return changed


def scaled_ranges(points, random):
    """Every range times a factor of its own between 0.5 and 1.5."""
    changed = points.copy()
    changed[:, :3] *= random.uniform(0.5, 1.5, (len(points), 1))
    return changed


def shuffled_azimuths(points, random):
    """Points change azimuths with others of their elevation; ranges and elevations stay, and with them the ground."""
    horizontal = np.hypot(points[:, 0], points[:, 1])
    azimuth = np.arctan2(points[:, 1], points[:, 0])
    rings = np.round(np.arctan2(points[:, 2], horizontal) / RING_RAD).astype(int)
    order = np.argsort(rings, kind="stable")
    for ring in np.split(order, np.flatnonzero(np.diff(rings[order])) + 1):
        azimuth[ring] = azimuth[random.permutation(ring)]
    changed = points.copy()
    changed[:, 0], changed[:, 1] = horizontal * np.cos(azimuth), horizontal * np.sin(azimuth)
    return changed


def without_half(points, random):
    """Nothing comes from one half of all azimuths, as when the sensor is mounted at a wall."""
    heading = random.uniform(-np.pi, np.pi)
    return points[points[:, 0] * np.cos(heading) + points[:, 1] * np.sin(heading) < 0.0]


def behind_wall(points, random):
    """What lies beyond a flat wall 3 m away, as of a truck beside, is replaced by the wall."""
    heading = random.uniform(-np.pi, np.pi)
    along = points[:, 0] * np.cos(heading) + points[:, 1] * np.sin(heading)
    changed = points.copy()
    changed[:, :3] *= np.where(along > WALL_M, WALL_M / np.maximum(along, WALL_M), 1.0)[:, None]
    return changed


def keyed(change, seed):
    """`change(points, random)` as `change(points, scan)`: the same for the same scan."""
    return lambda points, scan: change(points, np.random.default_rng([seed, scan]))


class BuildingsGone:
    """Takes building points of half of all plots (15 m squares of the map) out of a drive's scans."""

    def __init__(self, drive, seed):
        self.drive = drive
        self.gone = np.random.default_rng(seed).uniform(size=(64, 64)) < REMOVED_SHARE

    def __call__(self, points, scan):
        T_map_lidar = self.drive.T_map_lidar[scan]
        xy = points[:, :3] @ T_map_lidar[:2, :3].T + T_map_lidar[:2, 3]
        column, row = np.floor(xy.T / PLOT_M).astype(int) % 64
        return points[~(np.isin(self.drive.labels(scan), BUILDINGS) & self.gone[row, column])]


def parallel_street(map_, T_map_lidar):
    """The pose on the map's way that looks along the same line as `T_map_lidar`, straight to its side by 50 to 180 m.

    @return it with the heading of `T_map_lidar`, or None where there is no such street.
    """
    T_lidar_way = np.linalg.inv(T_map_lidar) @ map_.T_map_lidar
    ahead, aside = T_lidar_way[:, 0, 3], np.abs(T_lidar_way[:, 1, 3])
    along = np.abs(T_lidar_way[:, 0, 0]) > np.cos(np.radians(15.0))
    fits = along & (aside > 50.0) & (aside < 180.0) & (np.abs(ahead) < 8.0)
    if not fits.any():
        return None
    best = np.flatnonzero(fits)[np.argmin(np.abs(ahead[fits]))]
    return map_.T_map_lidar[best] @ (np.eye(4) if T_lidar_way[best, 0, 0] > 0.0 else poses.yawed(np.pi))
