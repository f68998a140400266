"""Drives are written as `stillmap simulate --layout pcd` writes them, so that every reader of drives takes them."""

from __future__ import annotations

import os
import pathlib
import shutil
from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _native

#: Smaller stamps count from the start of the drive (`maps/drives.md`).
_FIRST_EPOCH_NS = 10**17


def write_drive(folder: str | os.PathLike[str], scans: Iterable[_native.Scan], poses: ArrayLike | None = None) -> None:
    """Writes a drive that `open_drive` and `stillmap build` read.

    folder: must not exist; it appears when all is written. scans: with increasing `stamp_ns`; one is held at a time.
    poses: N x 4 x 4, `T_map_lidar` of each scan. Without poses the stamps must count from 1970, because they are
    kept in the names of the scans.
    Intensities and times of points are written; a scan without intensities gets zeros.
    """
    target = pathlib.Path(folder)
    if target.exists():
        raise FileExistsError(f"{target}: exists already; give the name of a new folder")
    matrices = None if poses is None else _poses_of(poses)
    partial = target.with_name(target.name + ".partial")
    shutil.rmtree(partial, ignore_errors=True)
    (partial / "scans").mkdir(parents=True)
    try:
        stamps = _write_scans(partial / "scans", scans, with_poses=matrices is not None)
        if matrices is not None:
            _write_poses(partial, stamps, matrices)
        partial.rename(target)
    except BaseException:
        shutil.rmtree(partial, ignore_errors=True)
        raise


def _poses_of(poses: ArrayLike) -> NDArray[np.float64]:
    matrices = np.asarray(poses, dtype=np.float64)
    if matrices.ndim != 3 or matrices.shape[1:] != (4, 4):
        raise ValueError(f"poses: found an array with shape {matrices.shape}, expected shape (N, 4, 4)")
    return matrices


def _write_scans(folder: pathlib.Path, scans: Iterable[_native.Scan], with_poses: bool) -> list[int]:
    stamps: list[int] = []
    for scan in scans:
        stamp = scan.stamp_ns
        if stamps and stamp <= stamps[-1]:
            raise ValueError(f"scans: found stamp {stamp} ns after {stamps[-1]} ns, expected increasing stamps")
        if stamp < 0 or (not with_poses and stamp < _FIRST_EPOCH_NS):
            raise ValueError(f"scans: found stamp {stamp} ns, expected "
                             + ("0 or more" if with_poses else "ns since 1970, or poses"))
        name = f"{len(stamps):06}" if with_poses else f"{stamp // 10**9:010}.{stamp % 10**9:09}"
        (folder / f"{name}.pcd").write_bytes(_pcd_of(scan))
        stamps.append(stamp)
    if not stamps:
        raise ValueError("scans: found none, expected at least one")
    return stamps


def _pcd_of(scan: _native.Scan) -> bytes:
    """PCD 0.7, binary: x y z intensity, and t [s] relative to the stamp where the scan has times."""
    names = ["x", "y", "z", "intensity"] + (["t"] if scan.times is not None else [])
    table = np.zeros((len(scan), len(names)), dtype="<f4")
    table[:, :3] = scan.points
    if scan.intensities is not None:
        table[:, 3] = scan.intensities
    if scan.times is not None:
        table[:, 4] = scan.times
    header = ("# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\n"
              f"FIELDS {' '.join(names)}\nSIZE{' 4' * len(names)}\nTYPE{' F' * len(names)}\nCOUNT{' 1' * len(names)}\n"
              f"WIDTH {len(scan)}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {len(scan)}\nDATA binary\n")
    return header.encode() + table.tobytes()


def _write_poses(folder: pathlib.Path, stamps: list[int], matrices: NDArray[np.float64]) -> None:
    if len(matrices) != len(stamps):
        raise ValueError(f"poses: found {len(matrices)}, expected one for each of the {len(stamps)} scans")
    _native.write_trajectory(folder / "trajectory.txt", np.array(stamps, dtype=np.int64), matrices)
    rows = (" ".join(repr(float(number)) for number in matrix[:3].ravel()) for matrix in matrices)
    (folder / "optimized_poses.txt").write_text("".join(row + "\n" for row in rows))
    (folder / "times.txt").write_text("".join(f"{stamp // 10**9}.{stamp % 10**9:09}\n" for stamp in stamps))
