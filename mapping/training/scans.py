"""Training scans: reading, augmentation, voxels.

A scan here is `points` float32 [N, 3] (x, y in the lidar frame, z = height over the ground
surface, m), `rings` [N], `owners` [N] (box + 1, or 0), `sensor_height_m`, `boxes` float32 [M, 7]
(centre, with its height over the ground; length, width, height; yaw), `classes` [M], `counts` [M]
(points of each box).
"""

import dataclasses
import pathlib

import numpy as np

STEP_M = 0.0025
# maps::ObjectClass, by its numbers.
OBJECT_CLASSES = ["car", "van", "truck", "bus", "trailer", "tram", "motorcycle", "cyclist",
                  "pedestrian", "unknown"]
# What the network tells apart; two-wheelers, ridden or not, are "cyclist".
LEARNED = {"car": "car", "van": "van", "truck": "truck", "trailer": "truck", "bus": "bus",
           "tram": "bus", "motorcycle": "cyclist", "cyclist": "cyclist", "pedestrian": "pedestrian"}


@dataclasses.dataclass
class Scan:
    points: np.ndarray
    rings: np.ndarray
    owners: np.ndarray
    sensor_height_m: float
    boxes: np.ndarray
    classes: np.ndarray
    moving: np.ndarray

    def counts(self):
        return np.bincount(self.owners, minlength=len(self.boxes) + 1)[1:]

    def keep(self, flags):
        self.points, self.rings = self.points[flags], self.rings[flags]
        self.owners = self.owners[flags]


class ScanFile:
    """Scans of one drive. @raises ValueError for a file that is none."""

    def __init__(self, path):
        self.data = np.memmap(path, np.uint8, "r")
        self.offsets = []
        offset = 0
        while offset < len(self.data):
            magic = bytes(self.data[offset:offset + 4])
            version, points, boxes = self.data[offset + 4:offset + 16].view("<u4")
            if magic != b"STSC" or version != 1:
                raise ValueError(f"{path}: found {magic!r} {version} at {offset}, expected STSC 1")
            self.offsets.append(offset)
            offset += 20 + int(points) * 9 + int(boxes) * 30
        if offset != len(self.data):
            raise ValueError(f"{path}: found {len(self.data)} bytes, expected {offset}")

    def __len__(self):
        return len(self.offsets)

    def __getitem__(self, index):
        offset = self.offsets[index] + 4
        _, n, m = (int(v) for v in self.data[offset:offset + 12].view("<u4"))
        offset += 12

        def take(dtype, *shape):
            nonlocal offset
            size = int(np.prod(shape)) * np.dtype(dtype).itemsize
            values = np.frombuffer(self.data[offset:offset + size].tobytes(), dtype).reshape(shape)
            offset += size
            return values

        height = float(take("<f4", 1)[0])
        points = take("<i2", n, 3).astype(np.float32) * np.float32(STEP_M)
        rings, owners = take("u1", n), take("<u2", n)
        boxes, kinds = take("<f4", m, 7), take("u1", m, 2)
        return Scan(points, rings, owners, height, boxes.copy(), kinds[:, 0], kinds[:, 1])


def open_scans(folder, part, limit=None):
    """(file, index) of every scan of a part."""
    files = sorted(pathlib.Path(folder).glob(f"{part}-*.stsc"))[:limit]
    if not files:
        raise FileNotFoundError(f"{folder}: no {part}-*.stsc, expected what generate.py makes")
    opened = [ScanFile(f) for f in files]
    return [(f, i) for f in opened for i in range(len(f))]


def rotate(points, angle):
    c, s = np.cos(angle), np.sin(angle)
    x, y = points[:, 0].copy(), points[:, 1].copy()
    points[:, 0], points[:, 1] = c * x - s * y, s * x + c * y


def inside(points, box, margin=0.0):
    c, s = np.cos(box[6]), np.sin(box[6])
    d = points[:, :3] - box[:3]
    along, across = c * d[:, 0] + s * d[:, 1], -s * d[:, 0] + c * d[:, 1]
    half = box[3:6] / 2 + margin
    return (np.abs(along) < half[0]) & (np.abs(across) < half[1]) & (np.abs(d[:, 2]) < half[2])


def paste(scan, other, rng, wanted):
    """Takes objects of another scan over, at their distance but in another direction: the sensor
    would see them there with the same points. What stands behind them is shadowed."""
    counts = other.counts()
    candidates = [i for i in range(len(other.boxes)) if counts[i] >= 5]
    weights = np.array([wanted.get(OBJECT_CLASSES[other.classes[i]], 0.0) for i in candidates])
    if not weights.sum() > 0:
        return
    number = min(int(rng.integers(0, 5)), int((weights > 0).sum()))
    chosen = rng.choice(candidates, number, replace=False, p=weights / weights.sum())
    for i in chosen:
        box = other.boxes[i:i + 1].copy()
        points = other.points[other.owners == i + 1].copy()
        rings = other.rings[other.owners == i + 1]
        turn = rng.uniform(-np.pi, np.pi)
        rotate(box, turn)
        rotate(points, turn)
        box[0, 6] += turn
        above = scan.points[:, 2] > 0.15
        near = inside(scan.points, np.r_[box[0, :3], box[0, 3:6] + 0.6, box[0, 6]])
        distance = np.linalg.norm(scan.boxes[:, :2] - box[0, :2], axis=1)
        if (near & above).sum() > 3 or (distance < 1.5).any():
            continue
        # Its shadow: the same directions, farther away.
        azimuth = np.arctan2(points[:, 1], points[:, 0])
        centre = np.arctan2(box[0, 1], box[0, 0])
        spread = np.abs(np.angle(np.exp(1j * (azimuth - centre)))).max()
        of_points = np.arctan2(scan.points[:, 1], scan.points[:, 0])
        r = np.hypot(scan.points[:, 0], scan.points[:, 1])
        r_box = np.hypot(points[:, 0], points[:, 1]).mean()
        top = scan.sensor_height_m + (points[:, 2].max() - scan.sensor_height_m) / r_box * r
        hidden = ((np.abs(np.angle(np.exp(1j * (of_points - centre)))) < spread) & (r > r_box) &
                  (scan.points[:, 2] < top))
        scan.keep(~hidden)
        scan.points = np.concatenate([scan.points, points])
        scan.rings = np.concatenate([scan.rings, rings])
        owner = np.full(len(points), len(scan.boxes) + 1, scan.owners.dtype)
        scan.owners = np.concatenate([scan.owners, owner])
        scan.boxes = np.concatenate([scan.boxes, box.astype(np.float32)])
        scan.classes = np.append(scan.classes, other.classes[i])
        scan.moving = np.append(scan.moving, other.moving[i])


def augment(scan, rng):
    """Another scan of the same kind of street: turned, mirrored, scaled, with another ground error,
    with fewer beams or points or a lost sector, with noise along the rays."""
    points, boxes = scan.points, scan.boxes
    if rng.random() < 0.4:  # fewer beams: every second to fourth ring (16 of 64 beams), or some at random
        rings = scan.rings
        if rng.random() < 0.5:
            step = int(rng.integers(2, 5)) if rings.max(initial=0) > 40 else 1
            scan.keep(rings % step == rng.integers(0, step))
        else:
            lost = rng.random(256) < rng.uniform(0.0, 0.5)
            scan.keep(~lost[rings])
    if rng.random() < 0.15:  # behind a roof box, or out of the sensor's window
        azimuth = np.arctan2(scan.points[:, 1], scan.points[:, 0])
        scan.keep(np.mod(azimuth - rng.uniform(0.0, 2 * np.pi), 2 * np.pi) > rng.uniform(0.1, 1.5))
    if rng.random() < 0.5:
        scan.keep(rng.random(len(scan.points)) > rng.uniform(0.0, 0.4))
    points = scan.points
    r = np.maximum(np.hypot(points[:, 0], points[:, 1]), 0.5)
    noise = rng.normal(0.0, rng.uniform(0.0, 0.04), len(points)).astype(np.float32)
    points *= 1.0 + (noise / r)[:, None] * np.array([1, 1, 0], np.float32)
    # The ground surface is wrong by some centimetres, and by a slope.
    tilt = rng.normal(0.0, 0.003, 2)
    shift = rng.normal(0.0, 0.04)
    points[:, 2] += (points[:, :2] @ tilt + shift).astype(np.float32)
    boxes[:, 2] += (boxes[:, :2] @ tilt + shift).astype(np.float32)
    scale = rng.uniform(0.93, 1.07)
    points *= np.float32(scale)
    boxes[:, :6] *= np.float32(scale)
    if rng.random() < 0.5:
        points[:, 1] *= -1
        boxes[:, 1] *= -1
        boxes[:, 6] *= -1
    turn = rng.uniform(-np.pi, np.pi)
    rotate(points, turn)
    rotate(boxes, turn)
    boxes[:, 6] += turn
    return scan


def voxels(points, config):
    """Mean features [V, F] and sites [V, 3] (z, y, x) of the occupied voxels, ordered by site."""
    low, high = np.float32(config["range_m"][:3]), np.float32(config["range_m"][3:])
    size = np.float32(config["voxel_m"])
    counts = np.round((high - low) / size).astype(np.int64)
    place = np.floor((points - low) / size).astype(np.int64)
    valid = ((place >= 0) & (place < counts)).all(1)
    points, place = points[valid], place[valid]
    key = (place[:, 2] * counts[1] + place[:, 1]) * counts[0] + place[:, 0]
    unique, rows, number = np.unique(key, return_inverse=True, return_counts=True)
    # Of no points numpy makes integers.
    sums = np.stack([np.bincount(rows, points[:, a], len(unique)) for a in range(3)], 1)
    mean = sums / number[:, None]
    sites = np.stack([unique // (counts[0] * counts[1]), unique // counts[0] % counts[1],
                      unique % counts[0]], 1)
    centre = low + (sites[:, ::-1] + 0.5) * size
    offset = (mean - centre) / size
    r = np.maximum(np.hypot(mean[:, 0], mean[:, 1]), 1e-6)
    known = {"x": mean[:, 0], "y": mean[:, 1], "z": mean[:, 2], "height": mean[:, 2],
             "dx": offset[:, 0], "dy": offset[:, 1], "dz": offset[:, 2],
             "ux": mean[:, 0] / r, "uy": mean[:, 1] / r}
    features = np.stack([known[name] for name in config["features"]], 1)
    return features.astype(np.float32), sites
