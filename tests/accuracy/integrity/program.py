"""stillmap from the command line, and the drives it writes."""

import dataclasses
import hashlib
import json
import os
import pathlib
import shutil
import subprocess

import numpy as np

import answers
import poses


class Program:
    """Runs the program at `path`; each call uses one thread, since batches run side by side."""

    def __init__(self, path):
        self.path = pathlib.Path(path).resolve()
        if not self.path.is_file():
            raise ValueError(f"{path}: no such program, expected build/release/stillmap")

    def digest(self):
        """Of the binaries that answers depend on."""
        sum_ = hashlib.sha256()
        for file in sorted(self.path.parent.glob("stillmap*")):
            if file.name in ("stillmap", "stillmap-mapper", "stillmap-evaluate"):
                sum_.update(file.read_bytes())
        return sum_.hexdigest()

    def run(self, *arguments):
        command = [str(self.path), *map(str, arguments)]
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode != 0:
            raise RuntimeError(f"{' '.join(command)}: exit {done.returncode}\n{done.stderr[-2000:]}")

    def simulate(self, folder, scenario, seed, scans, sensor, day=1, change=False):
        self.run("simulate", scenario, "-o", folder, "--seed", seed, "--day", day, "--scans", scans,
                 "--sensor", sensor, "--threads", 1, *(["--change"] if change else []))
        return Drive.read(folder)

    def build(self, drive, folder, select="::"):
        self.run("build", drive.folder, "-o", folder, "--select", select, "--threads", 1)
        return Map(pathlib.Path(folder), drive.T_map_lidar[indices_of(select, len(drive))])

    def ask(self, map_, drive, prior="1,5", trials=1, seed=1, around=None):
        """Answers for every scan of `drive`, from priors that are off by `prior` (metres,degrees; or none).

        `around` (N x 4 x 4) are the poses that priors are drawn around; the drive's own otherwise. Errors are
        always against the drive's own poses.
        """
        file = drive.folder.parent / f"{drive.folder.name}.answers.csv"
        arguments = ["--prior", "none"] if prior == "none" else ["--prior-error", prior]
        if around is not None:
            around_file = file.with_suffix(".poses.txt")
            poses.write_kitti(around_file, around)
            arguments += ["--poses", around_file]
        self.run("evaluate", "localization", map_.folder, drive.folder, *arguments, "--trials", trials,
                 "--seed", seed, "--threads", 1, "--bias", "none", "--csv", file)
        found = answers.read(file)
        if around is not None:
            answers.refer_to(found, around, drive.T_map_lidar)
        file.unlink()
        return found


def indices_of(select, size):
    return list(range(size))[slice(*(int(part) if part else None for part in select.split(":")))]


@dataclasses.dataclass(frozen=True)
class Map:
    folder: pathlib.Path
    # Where the scans that it was built from were taken (N x 4 x 4).
    T_map_lidar: np.ndarray

    def distances_m(self, T_map_lidar):
        """Horizontal distance of each pose to the nearest one the map was made from."""
        return np.array([np.linalg.norm(self.T_map_lidar[:, :2, 3] - T[:2, 3], axis=1).min() for T in T_map_lidar])

    def somewhere(self, count, random):
        """`count` poses on the way that was mapped, each in one of the two directions of driving."""
        chosen = self.T_map_lidar[random.integers(0, len(self.T_map_lidar), count)]
        turned = [poses.yawed(np.pi * random.integers(0, 2)) for _ in range(count)]
        return chosen @ np.array(turned)


@dataclasses.dataclass(frozen=True)
class Drive:
    """A KITTI odometry folder: `velodyne/*.bin` (float32 x y z intensity, lidar frame) and true poses."""

    folder: pathlib.Path
    files: list
    T_map_lidar: np.ndarray

    @staticmethod
    def read(folder):
        folder = pathlib.Path(folder)
        T_cam_lidar = poses.read_calibration(folder / "calib.txt")
        T = np.linalg.inv(T_cam_lidar) @ poses.read_kitti(folder / "poses.txt") @ T_cam_lidar
        files = sorted((folder / "velodyne").glob("*.bin"))
        if len(files) != len(T):
            raise ValueError(f"{folder}: {len(files)} scans, but {len(T)} poses")
        return Drive(folder, files, T)

    def __len__(self):
        return len(self.files)

    def points(self, i):
        return np.fromfile(self.files[i], "<f4").reshape(-1, 4)

    def labels(self, i):
        """SemanticKITTI class of each point."""
        return np.fromfile(self.folder / "labels" / f"{self.files[i].stem}.label", "<u4") & 0xFFFF

    def travelled_m(self):
        steps = np.linalg.norm(np.diff(self.T_map_lidar[:, :3, 3], axis=0), axis=1)
        return np.concatenate([[0.0], np.cumsum(steps)])

    def spaced(self, among, count):
        """At most `count` of the scans `among`, evenly spaced along the way, so that standing still counts once."""
        among = np.asarray(among)
        way = self.travelled_m()[among]
        wanted = np.linspace(way[0], way[-1], count)
        return among[np.unique(np.searchsorted(way, wanted).clip(0, len(among) - 1))]

    def derived(self, folder, indices, change=None):
        """A drive of these scans; `change(points, i)` gives other points, without it files are shared."""
        folder = pathlib.Path(folder)
        (folder / "velodyne").mkdir(parents=True)
        for position, i in enumerate(indices):
            target = folder / "velodyne" / f"{position:06}.bin"
            if change is None:
                os.link(self.files[i], target)
            else:
                change(self.points(i), i).astype("<f4").tofile(target)
        shutil.copy(self.folder / "calib.txt", folder)
        for name in ("poses.txt", "times.txt"):
            lines = (self.folder / name).read_text().splitlines()
            (folder / name).write_text("".join(lines[i] + "\n" for i in indices))
        return Drive.read(folder)

    def remove(self):
        shutil.rmtree(self.folder)


def write_json(file, value):
    """Whole or not at all."""
    part = file.with_suffix(".part")
    part.write_text(json.dumps(value, indent=1) + "\n")
    part.replace(file)
