"""The part of the package that is compiled. Import from `stillmap`."""

import os
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

_Path = str | os.PathLike[str]

class InputError(ValueError):
    """A file that cannot be used: the message names it, what was found and what was expected."""

class StorageError(OSError):
    """A file that cannot be opened, read or written."""

class Scan:
    """One sweep of a lidar, in the lidar frame. All arrays are read-only views, which keep the scan alive."""

    def __init__(self, points: NDArray[np.float32], times: NDArray[np.float32] | None = None,
                 intensities: NDArray[np.float32] | None = None, *, stamp_ns: int = 0) -> None:
        """Copies the arrays. points: (N, 3) [m], any strides. times: (N,) [s] from the stamp. intensities: (N,).

        Points without a return (not finite, or exactly zero) are left out with their times and intensities, and
        counted in `dropped`. Raises ValueError for another shape or type.
        """
    @property
    def points(self) -> NDArray[np.float32]:
        """(N, 3) [m]."""
    @property
    def times(self) -> NDArray[np.float32] | None:
        """(N,) [s] from the stamp; None where the scan does not tell."""
    @property
    def intensities(self) -> NDArray[np.float32] | None:
        """(N,) in the sensor's own scale; None where the scan has none."""
    @property
    def stamp_ns(self) -> int: ...
    @property
    def index(self) -> int:
        """Position in its drive, from 0."""
    @property
    def source(self) -> str:
        """File that it came from; empty for one made of arrays."""
    @property
    def points_in_file(self) -> int:
        """Points before any were dropped."""
    @property
    def times_note(self) -> str:
        """What should be known of the times: how the column was read, or why it was left out. Mostly empty."""
    @property
    def dropped(self) -> dict[str, int]:
        """Points left out: non_finite, zero_range, unsure (marked so by the sensor)."""
    def __len__(self) -> int: ...

class Drive:
    """Scans in order, with poses where the drive has some. Scans are read when they are asked for.

    `for scan in drive` reads one after the other. Safe from several threads.
    """

    def __len__(self) -> int: ...
    def __getitem__(self, index: int) -> Scan: ...
    def __iter__(self) -> Iterator[Scan]: ...
    def read(self, index: int) -> Scan:
        """Reads one scan; -1 is the last. Raises IndexError, InputError for a broken file, StorageError."""
    @property
    def stamps_ns(self) -> NDArray[np.int64]:
        """(N,), a read-only view. With `relative_clock` from the start of the drive, else since 1970."""
    @property
    def poses(self) -> NDArray[np.float64] | None:
        """`T_map_lidar` of each scan, (N, 4, 4), a read-only view; None for a drive without poses."""
    @property
    def path(self) -> os.PathLike[str]: ...
    @property
    def layout(self) -> str: ...
    @property
    def notes(self) -> list[str]:
        """What the reader did: scans that it left out and why, what it assumed."""
    @property
    def relative_clock(self) -> bool: ...
    @property
    def geodetic_origin(self) -> tuple[float, float, float] | None:
        """Latitude, longitude [deg], altitude [m] (WGS 84) of the origin of the poses."""

def open_drive(path: _Path, poses: _Path | None = None, *, pose_time_offset_s: float = 0.0) -> Drive:
    """Opens a drive of any layout of `maps/drives.md`, with the choices behind `?`.

    poses: a file of poses instead of the drive's own; `pose_time_offset_s` is added to its stamps.
    Raises InputError.
    """

def read_scan(file: _Path, *, bin_columns: str = "xyzi", stamp_ns: int | None = None) -> Scan:
    """Reads a .pcd, .ply or .bin. bin_columns: a letter for each float32 of a .bin. Raises InputError."""

def read_trajectory(file: _Path) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Stamps (N,) [ns] and poses (N, 4, 4) of a TUM file; copies. Raises InputError."""

def write_trajectory(file: _Path, stamps_ns: NDArray[np.int64], poses: ArrayLike) -> None:
    """Writes a TUM file. poses: (N, 4, 4). Raises ValueError, StorageError."""

class Map:
    """One version of a map, read in place: a tile when it is asked for. Safe from several threads."""

    @property
    def folder(self) -> os.PathLike[str]: ...
    @property
    def digest(self) -> str:
        """SHA-256 of its manifest, which tells it from every other version."""
    @property
    def frame_id(self) -> str: ...
    @property
    def origin(self) -> NDArray[np.float64]:
        """(3,): where the grid of tiles begins, in map coordinates [m]; a view."""
    @property
    def bounds(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Least and largest map coordinates of all points [m]; copies."""
    @property
    def voxel_size_m(self) -> float: ...
    @property
    def geodetic_origin(self) -> tuple[float, float, float] | None:
        """Latitude, longitude [deg], altitude [m] (WGS 84) of the map frame's origin."""
    @property
    def manifest(self) -> dict[str, Any]:
        """manifest.json: options, counts, sources, files."""
    @property
    def tiles(self) -> list[tuple[int, int]]:
        """(x, y) of each tile: squares of 20 m, x = floor((p - origin) / 20 m)."""
    def tile(self, x: int, y: int, *, level: int = 0) -> NDArray[Any]:
        """Points of a tile; a copy.

        Fields x, y, z (float32, relative to `tile_corner` [m]), intensity, observations, kind, object. Empty where
        there is no tile.
        """
    def tile_corner(self, x: int, y: int, *, level: int = 0) -> NDArray[np.float64]:
        """(3,): added to coordinates of the tile in float64 it gives map coordinates [m]."""
    def tile_history(self, x: int, y: int, *, level: int = 0) -> NDArray[Any]:
        """What else is known of a tile's points, in their order; a copy.

        Fields first_scan, last_scan, object (number plus 1, 0 = none), normal (int8, unit vector times 127),
        planarity. Empty where the package has none.
        """
    def trajectories(self) -> list[tuple[NDArray[np.int64], NDArray[np.float64]]]:
        """Stamps and poses of the scans of each drive; copies."""
    def verify(self) -> list[str]:
        """Reads every file; the paths of those that do not fit their checksum."""
    def _points(self, box: ArrayLike | None) -> dict[str, Any]: ...
    def _objects(self, box: ArrayLike | None) -> list[tuple[Any, ...]]: ...

def open_map_folder(folder: _Path) -> Map: ...

class ProtectionLevels:
    """Bounds of the errors of an `ok` pose, each exceeded once in a thousand; infinite where there is none."""

    @property
    def longitudinal_m(self) -> float: ...
    @property
    def lateral_m(self) -> float: ...
    @property
    def vertical_m(self) -> float: ...
    @property
    def yaw_rad(self) -> float: ...

class AlignmentResult:
    """Where a scan was taken. Arrays are read-only views, which keep the result alive; None where it is `lost`."""

    @property
    def status(self) -> str:
        """ok, degraded or lost."""
    @property
    def reasons(self) -> list[str]:
        """Why it is not ok."""
    @property
    def T_map_lidar(self) -> NDArray[np.float64] | None:
        """(4, 4)."""
    @property
    def position(self) -> NDArray[np.float64] | None:
        """(3,): of the lidar in the map frame [m]."""
    @property
    def quaternion(self) -> NDArray[np.float64] | None:
        """(4,): x, y, z, w with w >= 0; a copy."""
    @property
    def covariance(self) -> NDArray[np.float64] | None:
        """(6, 6): tx ty tz [m], rx ry rz [rad], perturbation on the right, in the lidar frame."""
    @property
    def protection(self) -> ProtectionLevels:
        """In the lidar frame."""
    def protection_in_base(self, T_base_lidar: ArrayLike) -> ProtectionLevels:
        """In the frame of a vehicle. T_base_lidar: (4, 4), the mount of the lidar."""
    @property
    def inlier_ratio(self) -> float: ...
    @property
    def rmse_m(self) -> float: ...
    @property
    def iterations(self) -> int: ...
    @property
    def degenerate_directions(self) -> NDArray[np.float64]:
        """(K, 6): unit directions that the scan does not constrain, rotations counted in metres at 15 m."""

class OdometryStep:
    """The vehicle's own measure of its motion since an earlier scan."""

    def __init__(self, since_ns: int, T_since_lidar: ArrayLike, covariance: ArrayLike) -> None:
        """since_ns: stamp of that scan. T_since_lidar: (4, 4), pose of the lidar in the lidar frame of that scan.
        covariance: (6, 6), positive definite."""
    @property
    def since_ns(self) -> int: ...

class TrackedPose:
    """A session's answer to one scan."""

    @property
    def stamp_ns(self) -> int: ...
    @property
    def result(self) -> AlignmentResult: ...
    @property
    def searched_from(self) -> str:
        """Where the search started: everywhere, given, velocity, odometry, interpolation or nowhere."""

class Session:
    """Follows one vehicle through one map. Calls from several threads wait for each other."""

    def initialize(self, T_map_lidar: ArrayLike, covariance: ArrayLike) -> None:
        """Forgets everything and looks for the next scan around this pose. (4, 4) and (6, 6)."""
    @overload
    def track(self, stamp_ns: Scan, *, odometry: OdometryStep | None = None,
              movable: ArrayLike | None = None) -> TrackedPose: ...
    @overload
    def track(self, stamp_ns: int, points: NDArray[np.float32], times: NDArray[np.float32] | None = None, *,
              odometry: OdometryStep | None = None, movable: ArrayLike | None = None) -> TrackedPose:
        """Answers one scan: a Scan, or its stamp, points and times as for `Scan`.

        movable: as for `Localizer.localize`. Raises ValueError; then nothing has changed.
        """

class Localizer:
    """A method for one map. Safe from several threads; long calls leave Python free."""

    def __init__(self, map: Map, *, method: str = "default", preset: str = "vehicle",
                 options: Mapping[str, float] = ...) -> None:
        """method: one of `methods()`. preset: vehicle, indoor or handheld. options: changes to it, such as
        `{"aligner.search_radius_m": 3.0}` (`localization/options.md`).

        Opens the map's index, or builds it and keeps it in the package's folder. Raises ValueError, InputError.
        """
    def localize(self, points: Scan | NDArray[np.float32], times: NDArray[np.float32] | None = None, *,
                 prior: ArrayLike | None = None, prior_covariance: ArrayLike | None = None,
                 movable: ArrayLike | None = None) -> AlignmentResult:
        """Answers where a scan was taken.

        points, times: a Scan, or arrays as for `Scan`. prior: (4, 4), where the search starts; None = anywhere in the
        map. prior_covariance: (6, 6), how far it may be off. movable: (K, 7), boxes of the caller's own detector in
        the lidar frame (x, y, z, length, width, height, yaw); points inside them are left out.
        Raises ValueError.
        """
    def session(self) -> Session:
        """A new session with the options of this localizer."""

def methods() -> list[str]:
    """Methods of alignment, the default first."""

def pose_matrix(position: Sequence[float], quaternion: Sequence[float]) -> NDArray[np.float64]: ...
