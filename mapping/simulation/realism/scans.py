"""Scans of real and simulated streets, read into one shape.

Three layouts, told apart by what is in the folder:

- a KITTI raw drive (`velodyne_points/data/*.bin`, boxes in `tracking/label_02.txt`): one street;
- a KITTI object folder (`velodyne/*.bin` beside `label_2/*.txt`): every scan is a street of its own;
- a KITTI odometry drive (`velodyne/*.bin`, perhaps `labels/*.label` and `boxes.json`): one street.
  SemanticKITTI sequences and simulated drives are both of this kind.

Everything is in the lidar frame: x forward, y left, z up, metres.
"""

import dataclasses
import json
import pathlib

import numpy as np


@dataclasses.dataclass(frozen=True)
class Box:
    """An object; `centre` and `size` (length, width, height) in m, `yaw` in rad about +z."""

    centre: np.ndarray
    size: np.ndarray
    yaw: float
    name: str

    def holds(self, points, margin_m=0.0):
        """Mask of the points (N x 3 or more columns) in the box grown by `margin_m`."""
        offset = points[:, :3] - self.centre
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        along = np.abs(c * offset[:, 0] + s * offset[:, 1])
        across = np.abs(-s * offset[:, 0] + c * offset[:, 1])
        half = self.size / 2.0 + margin_m
        return (along <= half[0]) & (across <= half[1]) & (np.abs(offset[:, 2]) <= half[2])


@dataclasses.dataclass(frozen=True)
class Scan:
    """Points N x 4 (x, y, z, reflectance in [0, 1]); `labels` and `instances` per point or None."""

    points: np.ndarray
    labels: np.ndarray | None
    instances: np.ndarray | None
    boxes: list | None


@dataclasses.dataclass(frozen=True)
class Street:
    """A place: its scans are seen from one drive, so they count as one sample of the world."""

    name: str
    files: list
    label_files: dict
    boxes: dict | None

    def scan(self, i):
        file = self.files[i]
        points = np.fromfile(file, "<f4")
        if points.size % 4:
            raise ValueError(f"{file}: {points.size} floats are not whole points of 4")
        points = points.reshape(-1, 4).astype(np.float64)
        labels = instances = None
        if file.stem in self.label_files:
            words = np.fromfile(self.label_files[file.stem], "<u4")
            if len(words) != len(points):
                raise ValueError(f"{file}: {len(points)} points, but {len(words)} labels")
            labels, instances = words & 0xFFFF, words >> 16
        boxes = None if self.boxes is None else self.boxes.get(file.stem, [])
        finite = np.isfinite(points).all(axis=1)
        if not finite.all():
            raise ValueError(f"{file}: {np.count_nonzero(~finite)} points are not finite")
        return Scan(points, labels, instances, boxes)

    def evenly(self, count):
        """Indices of at most `count` scans, spread over the drive."""
        n = len(self.files)
        return np.unique(np.linspace(0, n - 1, min(count, n)).round().astype(int))


def _calibration(file):
    """T_cam_lidar (4 x 4) of a KITTI object or tracking calibration."""
    rows = {}
    for line in file.read_text().splitlines():
        key, *values = line.replace(":", " ").split() or [""]
        rows[key] = values
    tr = rows.get("Tr_velo_to_cam") or rows.get("Tr_velo_cam")
    r0 = rows.get("R0_rect") or rows.get("R_rect")
    if not tr or not r0:
        raise ValueError(f"{file}: neither Tr_velo_to_cam nor Tr_velo_cam with R0_rect or R_rect")
    T = np.eye(4)
    T[:3] = np.array(tr, float).reshape(3, 4)
    R = np.eye(4)
    R[:3, :3] = np.array(r0, float).reshape(3, 3)
    return R @ T


def _kitti_box(fields, T_cam_lidar):
    """A box from `type ... h w l x y z ry` of KITTI; (x, y, z) is the middle of its bottom face."""
    h, w, l, x, y, z, ry = (float(v) for v in fields[-7:])
    centre = np.linalg.solve(T_cam_lidar, np.array([x, y - h / 2.0, z, 1.0]))[:3]
    heading = np.linalg.solve(T_cam_lidar, np.array([np.cos(ry), 0.0, -np.sin(ry), 0.0]))
    return Box(centre, np.array([l, w, h]), np.arctan2(heading[1], heading[0]), fields[0].lower())


def _raw_drive(folder):
    files = sorted((folder / "velodyne_points" / "data").glob("*.bin"))
    boxes, label_file = None, folder / "tracking" / "label_02.txt"
    if label_file.exists():
        T = _calibration(label_file.parent / "calib.txt")
        boxes = {}
        for line in label_file.read_text().splitlines():
            frame, _, *fields = line.split()
            if fields[0] != "DontCare" and int(frame) < len(files):
                # A label has 15 fields after frame and track; a detection has its score last.
                boxes.setdefault(files[int(frame)].stem, []).append(_kitti_box(fields[:15], T))
    return [Street(folder.name, files, {}, boxes)]


def _object_folder(folder):
    streets = []
    for file in sorted((folder / "velodyne").glob("*.bin")):
        label, boxes = folder / "label_2" / f"{file.stem}.txt", None
        if label.exists():
            T = _calibration(folder / "calib" / f"{file.stem}.txt")
            rows = [line.split() for line in label.read_text().splitlines()]
            boxes = {file.stem: [_kitti_box(r[:15], T) for r in rows if r and r[0] != "DontCare"]}
        streets.append(Street(f"object {file.stem}", [file], {}, boxes))
    return streets


def _odometry_drive(folder):
    files = sorted((folder / "velodyne").glob("*.bin"))
    labels = {f.stem: f for f in (folder / "labels").glob("*.label")}
    boxes, box_file = None, folder / "boxes.json"
    if box_file.exists():
        boxes = {}
        for entry in json.loads(box_file.read_text())["scans"]:
            if entry["scan"] < len(files):
                boxes[files[entry["scan"]].stem] = [
                    Box(np.array(b["centre"]), np.array(b["size"]), b["yaw"], b["class"])
                    for b in entry["boxes"]]
    return [Street(folder.name, files, labels, boxes)]


def read_streets(folder):
    """The streets of a folder of any known layout.

    @raises ValueError naming the folder when it has no known layout or no scan.
    """
    folder = pathlib.Path(folder)
    if (folder / "velodyne_points" / "data").is_dir():
        streets = _raw_drive(folder)
    elif (folder / "label_2").is_dir():
        streets = _object_folder(folder)
    elif (folder / "velodyne").is_dir():
        streets = _odometry_drive(folder)
    else:
        raise ValueError(f"{folder}: neither velodyne_points/data nor velodyne in it")
    if not streets or not all(s.files for s in streets):
        raise ValueError(f"{folder}: no scan in it")
    return streets
