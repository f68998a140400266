"""Points and objects of maps as arrays."""

from __future__ import annotations

import os
import pathlib
import tarfile
import tempfile
import weakref
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _native

#: Values of `MapPoints.kind` and of the field `kind` of tiles.
MEASURED, GROUND, PROJECTED, FILLED = 0, 1, 2, 3

_OBJECT = np.dtype([
    ("object", np.int64), ("object_class", "U16"), ("motion", "U16"), ("scan", np.int64), ("centre", np.float64, 3),
    ("yaw_rad", np.float64), ("size_m", np.float64, 3), ("score", np.float64), ("drive", np.int64),
    ("first_scan", np.int64), ("last_scan", np.int64), ("first_stamp_ns", np.int64), ("last_stamp_ns", np.int64),
    ("detections", np.int64), ("points_removed", np.int64)])


@dataclass(frozen=True)
class MapPoints:
    """N points of a map; all arrays are copies."""

    #: float64 (N, 3), map frame [m].
    xyz: NDArray[np.float64]
    #: float32 (N,), in the sensor's own scale.
    intensity: NDArray[np.float32]
    #: uint16 (N,): how many points of scans were merged into this one, saturating.
    observations: NDArray[np.uint16]
    #: uint8 (N,): MEASURED, GROUND (measured), PROJECTED (moved down from an object) or FILLED (synthetic ground).
    kind: NDArray[np.uint8]
    #: int64 (N,): field `object` of `map_objects` that a projected or filled point belongs to; -1 for none.
    object: NDArray[np.int64]
    #: int64 (N,): first and last scan that saw the point, counted over all drives of the map; -1 if not known.
    first_scan: NDArray[np.int64]
    last_scan: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.kind)


def open_map(path: str | os.PathLike[str]) -> _native.Map:
    """Opens a map package: its folder, or a plain tar of it as a server sends it.

    A folder is read in place. A tar is unpacked into a temporary folder, which is removed with the map.
    Raises InputError for what is no package.
    """
    path = pathlib.Path(path)
    if not path.is_file():
        return _native.open_map_folder(path)
    folder = tempfile.TemporaryDirectory(prefix="stillmap-")
    try:
        _unpack(path, folder.name)
        opened = _native.open_map_folder(folder.name)
    except BaseException:
        folder.cleanup()
        raise
    weakref.finalize(opened, folder.cleanup)
    return opened


def _unpack(archive: pathlib.Path, folder: str) -> None:
    """Regular files with plain names alone, so that nothing lands beside the folder or grows beyond the archive."""
    try:
        with tarfile.open(archive, "r:") as tar:
            for member in tar:
                parts = pathlib.PurePosixPath(member.name).parts
                if member.isdir():
                    continue
                if not member.isreg() or member.issparse() or member.name.startswith("/") or ".." in parts:
                    raise _native.InputError(f"{archive}: found member {member.name!r}, expected regular files of a "
                                             "map package: make the tar with `tar cf MAP.tar -C MAP .`")
                tar.extract(member, folder, set_attrs=False)
    except tarfile.TarError as error:
        raise _native.InputError(f"{archive}: found {error}, expected a map package: its folder, or a plain tar of "
                                 "it") from error


def map_points(opened: _native.Map, box: ArrayLike | None = None) -> MapPoints:
    """Points of a map, in the order of its tiles.

    box: ((x, y, z), (x, y, z)) in the map frame [m]; its lower bounds belong to it, its upper bounds do not, so that
    neighbouring boxes share no point. None = the whole map. Use `numpy.inf` where there is no bound.
    """
    return MapPoints(**opened._points(box))


def map_objects(opened: _native.Map, box: ArrayLike | None = None) -> NDArray[Any]:
    """Objects that were removed from a map: a structured array with a row for each place where one stood.

    A parked object has one row, a moving one a row for each scan. box: as for `map_points`, for the centres.
    Fields: object (its number), object_class, motion ("parked", "moving", "unknown"), scan, centre [m], yaw_rad,
    size_m (length, width, height), score, drive, first_scan, last_scan, first_stamp_ns, last_stamp_ns, detections,
    points_removed.
    """
    return np.array(opened._objects(box), dtype=_OBJECT)
