"""Worlds that disturb: what rain, dust, a wet road or a trailer add to the scans of a simulated drive.

A drive is in the layout of KITTI odometry, as `stillmap simulate` writes it. Every point that is added has the class
`outlier` (1), which counts neither as static nor as dynamic. Same seed, same bytes.
"""

import pathlib
import shutil

import numpy as np

OUTLIER = 1 | 1 << 16  # its instance tells it from those that the simulator gives
GROUND = (40, 44, 48, 49, 60, 72)
HEIGHT_M = 1.73  # of the sensor over the ground
DIRECTION_RAD = np.radians(0.3)


class Drive:
    def __init__(self, folder):
        self.folder = pathlib.Path(folder)
        self.scans = sorted((self.folder / "velodyne").glob("*.bin"))
        rows = [line.split(":", 1) for line in (self.folder / "calib.txt").read_text().splitlines() if ":" in line]
        T_cam_lidar = matrix(dict(rows)["Tr"].split())
        self.T_map_lidar = [np.linalg.inv(T_cam_lidar) @ matrix(line.split()) @ T_cam_lidar
                            for line in (self.folder / "poses.txt").read_text().splitlines()]

    def read(self, i):
        """x y z intensity, and SemanticKITTI classes with instances."""
        name = self.scans[i].stem
        return (np.fromfile(self.scans[i], np.float32).reshape(-1, 4),
                np.fromfile(self.folder / "labels" / f"{name}.label", np.uint32))

    def every(self, target, step):
        """A drive of each `step`th scan."""
        drive = self.copy(target, lambda i, points, labels: (points, labels))
        for i, file in enumerate(drive.scans):
            if i % step:
                file.unlink()
                (drive.folder / "labels" / f"{file.stem}.label").unlink()
        for part in ("poses.txt", "times.txt"):
            lines = (drive.folder / part).read_text().splitlines(keepends=True)
            (drive.folder / part).write_text("".join(lines[::step]))
        for number, file in enumerate(sorted((drive.folder / "velodyne").glob("*.bin"))):
            label = drive.folder / "labels" / f"{file.stem}.label"
            file.rename(file.with_name(f"{number:06}.bin"))
            label.rename(label.with_name(f"{number:06}.label"))
        return Drive(target)

    def copy(self, target, change):
        """A drive whose scans are `change(i, points, labels)` of this one's."""
        target = pathlib.Path(target)
        shutil.rmtree(target, ignore_errors=True)
        for part in ("velodyne", "labels", "truth"):
            (target / part).mkdir(parents=True)
        for part in ("calib.txt", "poses.txt", "times.txt", "truth/ground.ply"):
            shutil.copy(self.folder / part, target / part)
        for i, file in enumerate(self.scans):
            points, labels = change(i, *self.read(i))
            points.astype("<f4").tofile(target / "velodyne" / file.name)
            labels.astype("<u4").tofile(target / "labels" / f"{file.stem}.label")
        return Drive(target)


def matrix(numbers):
    return np.vstack([np.array(numbers, float).reshape(3, 4), [0, 0, 0, 1]])


def placed(T, points):
    return points[:, :3] @ T[:3, :3].T + T[:3, 3]


def ranges_of(points):
    return np.linalg.norm(points[:, :3], axis=1)


def at_range(points, chosen, new_ranges, intensity):
    """Moves points along their rays."""
    points[chosen, :3] *= (new_ranges / ranges_of(points[chosen]))[:, None]
    points[chosen, 3] = intensity


def direction_keys(points):
    azimuth = np.arctan2(points[:, 1], points[:, 0])
    elevation = np.arctan2(points[:, 2], np.hypot(points[:, 0], points[:, 1]))
    column, row = (np.floor(angle / DIRECTION_RAD).astype(np.int64) for angle in (azimuth, elevation))
    return column * 4096 + row


def mirror(drive, target, seed, share=0.05):
    """A wet road: `share` of the ground returns are replaced by what the reflected ray meets.

    Three quarters of them lie in puddles of 1.5 m that stay where they are, so that the same virtual scene below the
    road is seen from everywhere; the others are anywhere. Where the reflected ray meets nothing that the scan has seen,
    the return lies 0.3 to 6 m below the road on the ray: the road over a cellar that is not there.
    """
    def change(i, points, labels):
        random = np.random.default_rng([seed, i])
        ground = np.flatnonzero(np.isin(labels & 0xFFFF, GROUND))
        where = np.floor(placed(drive.T_map_lidar[i], points[ground])[:, :2] / 1.5).astype(np.int64)
        puddle = (where[:, 0] * 73856093 ^ where[:, 1] * 19349663 ^ seed * 83492791) % 1000 < 750 * share
        chosen = ground[puddle | (random.random(len(ground)) < 0.25 * share)]
        ranges = ranges_of(points)
        # The plane of the road below the sensor; mirror images of what stands within 30 m of it.
        near = ground[ranges[ground] < 15.0]
        plane = np.linalg.lstsq(np.c_[points[near, :2], np.ones(len(near))], points[near, 2], rcond=None)[0]
        height = points[:, 2] - points[:, :2] @ plane[:2] - plane[2]
        standing = np.flatnonzero((height > 0.2) & (ranges < 50.0) & ~np.isin(labels & 0xFFFF, GROUND))
        normal = np.array([-plane[0], -plane[1], 1.0])
        images = points[standing, :3] - 2.0 * (height[standing] / (normal @ normal))[:, None] * normal
        keys, depths = direction_keys(images), ranges_of(images)
        order = np.lexsort((depths, keys))
        keys, depths = keys[order], depths[order]
        wanted = direction_keys(points[chosen])
        at = np.minimum(np.searchsorted(keys, wanted), max(len(keys) - 1, 0))
        met = (keys[at] == wanted) & (depths[at] > ranges[chosen] + 0.3)
        below = random.uniform(0.3, 6.0, len(chosen))
        sine = np.maximum(-points[chosen, 2] / ranges[chosen], 0.02)
        new = np.where(met, depths[at], np.minimum(ranges[chosen] + below / sine, 75.0))
        at_range(points, chosen, new + random.normal(0.0, 0.02, len(chosen)), 0.05)
        labels[chosen] = OUTLIER
        return points, labels

    return drive.copy(target, change)


def rain(drive, target, seed, drops=2500):
    """Drops a scan, most within 10 to 15 m and some to 25 m. Half of them stand before a return, which is lost; the
    others are where nothing came back. Of the returns 3 % more are lost."""
    def change(i, points, labels):
        random = np.random.default_rng([seed, i])
        kept = random.random(len(points)) >= 0.03
        points, labels = points[kept], labels[kept]
        ranges = ranges_of(points)
        drop_ranges = np.clip(2.0 + random.gamma(2.2, 3.2, len(points)), 2.0, 25.0)
        before = np.flatnonzero(drop_ranges < ranges - 0.3)
        chosen = random.choice(before, min(drops // 2, len(before)), replace=False)
        at_range(points, chosen, drop_ranges[chosen], 0.02)
        labels[chosen] = OUTLIER
        # Into the beams' elevations: rays without a return are mostly those that look over everything.
        elevation = np.arcsin(np.clip(points[:, 2] / ranges, -1.0, 1.0))
        low, high = np.percentile(elevation, [40, 99.9])
        rest = drops - len(chosen)
        azimuth, elevation = random.uniform(-np.pi, np.pi, rest), random.uniform(max(low, -0.1), high, rest)
        range_m = np.clip(2.0 + random.gamma(2.2, 3.2, rest), 2.0, 25.0)
        to_ground = 0.95 * HEIGHT_M / -np.sin(np.minimum(elevation, -0.02))
        range_m = np.where(elevation < -0.02, np.minimum(range_m, to_ground), range_m)
        flat = range_m * np.cos(elevation)
        air = np.c_[flat * np.cos(azimuth), flat * np.sin(azimuth), range_m * np.sin(elevation), np.full(rest, 0.02)]
        return np.vstack([points, air.astype(np.float32)]), np.r_[labels, np.full(rest, OUTLIER, np.uint32)]

    return drive.copy(target, change)


def way_of(drive):
    positions = np.array([T[:3, 3] for T in drive.T_map_lidar])
    return positions, np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(positions, axis=0), axis=1))]


def dust(drive, target, seed, ahead_m=13.0):
    """A cloud of 7 x 3.5 x 2.4 m on our way ahead, as a vehicle ahead raises it; it stops half of the rays."""
    positions, way = way_of(drive)

    def change(i, points, labels):
        random = np.random.default_rng([seed, i])
        station = way[i] + ahead_m
        centre = np.array([np.interp(station, way, positions[:, k]) for k in range(3)])
        if station > way[-1]:
            centre = positions[-1] + (station - way[-1]) * drive.T_map_lidar[-1][:3, 0]
        T_lidar_map = np.linalg.inv(drive.T_map_lidar[i])
        centre = placed(T_lidar_map, centre[None])[0] + [0, 0, -HEIGHT_M + 1.15]
        axes = np.array([3.5, 1.75, 1.2])
        ranges = ranges_of(points)
        direction = points[:, :3] / ranges[:, None]
        a = ((direction / axes) ** 2).sum(1)
        b = (direction / axes) @ (centre / axes)
        inside = b * b - a * (((centre / axes) ** 2).sum() - 1.0)
        half = np.sqrt(np.maximum(inside, 0.0)) / a
        near, far = b / a - half, np.minimum(b / a + half, ranges)
        through = (inside > 0.0) & (b > 0.0) & (near > 0.0) & (far > near + 0.1)
        depth = random.exponential(3.0, len(points))
        chosen = np.flatnonzero(through & (near + depth < far - 0.1))
        at_range(points, chosen, (near + depth)[chosen], 0.05)
        labels[chosen] = OUTLIER
        return points, labels

    return drive.copy(target, change)


def trailer(drive, target, seed, hitch_m=2.6, front_m=3.6, axle_m=5.2):
    """A box of 2.5 x 2 x 2 m behind the vehicle, drawn by its hitch; it hides what lies behind it."""
    T_start = drive.T_map_lidar[0]
    axle = placed(T_start, np.array([[-axle_m, 0.0, 0.0]]))[0]
    T_lidar_trailer = []
    for T in drive.T_map_lidar:
        hitch = placed(T, np.array([[-hitch_m, 0.0, 0.0]]))[0]
        forward = (hitch - axle) / np.linalg.norm(hitch - axle)
        axle = hitch - (axle_m - hitch_m) * forward
        in_lidar = T[:3, :3].T @ forward
        T_lidar_trailer.append((np.array([-hitch_m, 0.0, 0.0]), np.arctan2(in_lidar[1], in_lidar[0])))

    def change(i, points, labels):
        random = np.random.default_rng([seed, i])
        hitch, yaw = T_lidar_trailer[i]
        turn = np.array([[np.cos(yaw), np.sin(yaw), 0.0], [-np.sin(yaw), np.cos(yaw), 0.0], [0.0, 0.0, 1.0]])
        ranges = ranges_of(points)
        origin, direction = turn @ -hitch, (points[:, :3] / ranges[:, None]) @ turn.T
        low = np.array([-(front_m - hitch_m) - 2.5, -1.0, -HEIGHT_M + 0.3])
        high = np.array([-(front_m - hitch_m), 1.0, -HEIGHT_M + 2.3])
        with np.errstate(divide="ignore", invalid="ignore"):
            to_low, to_high = (low - origin) / direction, (high - origin) / direction
        enters = np.nanmax(np.minimum(to_low, to_high), axis=1)
        leaves = np.nanmin(np.maximum(to_low, to_high), axis=1)
        chosen = np.flatnonzero((enters < leaves) & (enters > 0.0) & (enters < ranges))
        at_range(points, chosen, enters[chosen] + random.normal(0.0, 0.02, len(chosen)), 0.3)
        labels[chosen] = OUTLIER
        return points, labels

    return drive.copy(target, change)


def without(drive, target, classes):
    """The drive without the points of some classes."""
    def change(i, points, labels):
        kept = ~np.isin(labels & 0xFFFF, classes)
        return points[kept], labels[kept]

    return drive.copy(target, change)
