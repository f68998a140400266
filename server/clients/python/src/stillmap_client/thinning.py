"""What of a scan is matched, as `application/vnd.stillmap.scan`: 48 to 260 kB instead of 2 MB.

The rule and the layout stand in localization/thin_scan.md; the numbers are those of the server's own header, and the
bytes are equal to its. Needs numpy.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Any, Callable, Optional, Tuple, TypeVar

from .errors import Problem

if TYPE_CHECKING:
    import numpy as np

CONTENT_TYPE = "application/vnd.stillmap.scan"
_Answer = TypeVar("_Answer")
PROFILES = ("exact", "compact")
OWN_VEHICLE_M = 2.7

_CELL_M, _FEW_POINTS, _MOST_MATCHED = 0.5, 1000, 4000
_MOST_RANGE_M, _MOST_OWN_SHARE, _MOST_READ = 500.0, 0.25, 400_000
_EDGES_PER_RANGE, _MOST_LONE_EDGES, _SPARSE_POINTS, _DIAGONAL = 32.0, 4.0, 10_000, 1.74
_MOST_LONE_SHARE, _MOST_LONE_SHARE_OF_RANGE = 0.15, 0.35
_COLUMN_M, _MOST_COMPACT_BYTES, _STEPS = 2.0, 48_000, 32_767
_HEADER = struct.Struct("<4sBBBBIIIIffffI")


class Thinning:
    """How scans are thinned before they are sent. Without numpy they are sent whole.

    profile        "exact", "compact", or None: whole
    own_vehicle_m  as the server's option
    """

    def __init__(self, profile: Optional[str], own_vehicle_m: float) -> None:
        if profile not in (None, *PROFILES):
            raise ValueError(f"thin: found '{profile}', expected exact, compact or None")
        self.profile, self.own_vehicle_m = profile, own_vehicle_m
        try:
            import numpy  # noqa: F401
        except ImportError:
            self.profile = None

    def or_whole(self, may_thin: bool, send: "Callable[[Optional[Thinning]], _Answer]",
                 is_refused: Callable[[_Answer], bool] = lambda _: False) -> _Answer:
        """What `send` gives for thinned scans. If the server refuses these and takes whole ones, all later scans are sent
        whole, too. @param is_refused  of an answer that holds refusals, as that of a batch may."""
        if not may_thin or self.profile is None:
            return send(None)
        try:
            answer = send(self)
            if not is_refused(answer):
                return answer
        except Problem as problem:
            if not refuses_thin(problem):
                raise
        answer = send(None)
        if not is_refused(answer):
            self.profile = None
        return answer

    def body(self, raw: bytes, columns: int) -> Optional[bytes]:
        """What to send instead of float32 points of so many columns; None where these are as short."""
        if self.profile is None:
            return None
        import numpy as np

        points = np.frombuffer(raw, "<f4").astype(np.float32, copy=False).reshape(-1, columns)
        thin = thin_scan(points, self.profile, self.own_vehicle_m)
        return thin if len(thin) < len(raw) else None


def refuses_thin(problem: Problem) -> bool:
    """As a server does that is configured for a vehicle of another size, or too old to know thin scans."""
    return problem.code in ("InvalidScan", "UnsupportedMediaType")


def thin_scan(points: "np.ndarray[Any, Any]", profile: str = "exact", own_vehicle_m: float = OWN_VEHICLE_M) -> bytes:
    """The body for a scan.

    :param points: float32, N x 3 (x y z [m]), N x 4 (with intensity) or N x 5 (with the time relative to the stamp [s]).
    :param profile: "exact" (answered as the whole scan, to the bit) or "compact" (at most 48,000 bytes).
    :param own_vehicle_m: as the server's option; it refuses another one.
    :raises ValueError: for what is no such array, or another profile.
    """
    import numpy as np

    if profile not in PROFILES:
        raise ValueError(f"profile: found '{profile}', expected exact or compact")
    if points.ndim != 2 or points.shape[1] not in (3, 4, 5) or points.dtype != np.float32:
        raise ValueError(f"scan: found {points.dtype} of shape {points.shape}, expected float32, N x 3, 4 or 5")
    compact, has_times = profile == "compact", points.shape[1] == 5
    with np.errstate(invalid="ignore", over="ignore", under="ignore"):
        scan = _Scan(points[:, :3], own_vehicle_m)
        indices, matched, cell_m = scan.thinned()
        values = 4 if has_times else 3
        if compact:
            indices = scan.with_lowest(indices, matched, (_MOST_COMPACT_BYTES - _HEADER.size) // (2 * values))
    xyz = points[indices, :3]
    times = points[indices, 4] if has_times else points[:0, 0]
    step_m, step_s = _step(xyz), _step(times)
    header = _HEADER.pack(b"SMTS", 1, int(compact), int(has_times) | (2 if scan.nearest_m == 0 else 0), 0, len(indices),
                          matched, scan.count, len(points) - scan.count, cell_m, np.float32(own_vehicle_m),
                          step_m if compact else 0.0, step_s if compact else 0.0, 0)
    if compact:
        planes = [_steps(xyz[:, axis], step_m) for axis in range(3)] + ([_steps(times, step_s)] if has_times else [])
        return bytes(header + b"".join(planes))
    return bytes(header + xyz.astype("<f4").tobytes() + times.astype("<f4").tobytes())


def _step(values: "np.ndarray[Any, Any]") -> "np.float32":
    import numpy as np

    return np.float32(np.abs(values).max() / np.float32(_STEPS)) if values.size else np.float32(0)


def _steps(values: "np.ndarray[Any, Any]", step: "np.float32") -> bytes:
    """Half steps are rounded away from 0."""
    import numpy as np

    if step == 0:
        return bytes(2 * len(values))
    quotients = (values / step).astype(np.float64)
    return bytes((np.sign(quotients) * np.floor(np.abs(quotients) + 0.5)).astype("<i2").tobytes())


class _Scan:
    """A scan with its squared ranges, in 32-bit floats as the server has them."""

    def __init__(self, xyz: "np.ndarray[Any, Any]", own_vehicle_m: float) -> None:
        import numpy as np

        self.xyz = xyz
        x, y, z = xyz[:, 0], xyz[:, 1], xyz[:, 2]
        self.range2 = x * x + (y * y + z * z)
        is_point = np.isfinite(xyz).all(axis=1) & (xyz != 0).any(axis=1)
        self.count = int(is_point.sum())
        own_m = np.float32(own_vehicle_m)
        near = np.float32((is_point & (self.range2 < own_m * own_m)).sum())
        self.nearest_m = own_m if near / np.float32(self.count + 1) < np.float32(_MOST_OWN_SHARE) else np.float32(0)

    def thinned(self) -> "Tuple[np.ndarray[Any, Any], int, float]":
        """Indices, matched ones first; how many are matched; the cells' edge."""
        import numpy as np

        cell_m = _CELL_M
        kept = self._one_point_a_cell(cell_m)
        if len(kept) < _FEW_POINTS:
            cell_m = 0.5 * _CELL_M
            kept = self._one_point_a_cell(cell_m)
        matched = min(len(kept), _MOST_MATCHED)
        chosen = np.arange(matched) * len(kept) // max(1, matched)
        others = np.ones(len(kept), bool)
        others[chosen] = False
        return np.concatenate([kept[chosen], kept[others]]), matched, cell_m

    def with_lowest(self, indices: "np.ndarray[Any, Any]", matched: int, most: int) -> "np.ndarray[Any, Any]":
        """Of those that are not matched, the lowest of their columns, if there are too many."""
        import numpy as np

        if len(indices) <= most:
            return indices
        flat = self.xyz[indices].copy()
        flat[:, 2] = 0
        columns = _keys(flat, _COLUMN_M)
        order = np.lexsort((np.arange(len(indices)), self.xyz[indices, 2], columns))
        lowest = order[np.r_[True, np.diff(columns[order]) != 0]]
        extra = indices[np.sort(lowest[lowest >= matched])]
        count = min(len(extra), most - matched)
        return np.concatenate([indices[:matched], extra[np.arange(count) * len(extra) // max(1, count)]])

    def _one_point_a_cell(self, cell_m: float) -> "np.ndarray[Any, Any]":
        """Indices of the first point of each cell, ascending, without lone ones."""
        import numpy as np

        step = self.count // _MOST_READ + 1
        read = np.arange(0, len(self.xyz), step)
        range2 = self.range2[read]
        most = np.float32(_MOST_RANGE_M)
        read = read[(range2 < most * most) & ~(range2 < self.nearest_m * self.nearest_m) & (range2 != 0)]
        if not len(read):
            return read
        keys = _keys(self.xyz[read], cell_m)
        order = np.argsort(keys, kind="stable")
        starts = np.flatnonzero(np.r_[True, np.diff(keys[order]) != 0])
        ends = np.r_[starts[1:], len(order)]
        # Counted from the first point on that differs from the cell's first: one that is sent twice is alone still.
        first_of = np.repeat(order[starts], ends - starts)
        differs = (self.xyz[read[order]] != self.xyz[read[first_of]]).any(axis=1)
        from_place = np.where(differs, np.arange(len(order)), len(order))
        counts = 1 + np.maximum(0, ends - np.minimum.reduceat(from_place, starts))
        cells = read[order[starts]]
        by_order = np.argsort(cells)
        cells, counts = cells[by_order], counts[by_order]
        if self.count >= _SPARSE_POINTS:
            cells = cells[~self._lone(cells, counts, cell_m)]
        return np.asarray(cells)

    def _lone(self, cells: "np.ndarray[Any, Any]", counts: "np.ndarray[Any, Any]",
              cell_m: float) -> "np.ndarray[Any, Any]":
        """A flag for each cell whose point is the only one around it."""
        import numpy as np

        found = []
        from_m, edge_m = np.float32(0), np.float32(cell_m)
        while edge_m <= np.float32(_MOST_LONE_EDGES) * np.float32(cell_m):
            to_m = np.float32(_EDGES_PER_RANGE) * edge_m
            found.append(self._lone_in_range(cells, counts, edge_m, (from_m, to_m), bool(edge_m > cell_m)))
            from_m, edge_m = to_m, edge_m * np.float32(2)
        many = sum(len(lone) for lone, _ in found) > _MOST_LONE_SHARE * counts.sum()
        flags = np.zeros(len(cells), bool)
        for lone, share in found:
            if not (many and share > _MOST_LONE_SHARE_OF_RANGE):
                flags[lone] = True
        return flags

    def _lone_in_range(self, cells: "np.ndarray[Any, Any]", counts: "np.ndarray[Any, Any]", edge_m: "np.float32",
                       bounds: "Tuple[np.float32, np.float32]", is_coarse: bool) -> "Tuple[np.ndarray[Any, Any], float]":
        import numpy as np

        range2 = self.range2[cells]

        def is_within(near_m: "np.float32", far_m: "np.float32") -> "np.ndarray[Any, Any]":
            return np.asarray((range2 >= near_m * near_m) & (range2 < far_m * far_m))

        inside = is_within(*bounds)
        margin_m = np.float32(_DIAGONAL) * edge_m if is_coarse else np.float32(0)
        around = is_within(bounds[0] - margin_m, bounds[1] + margin_m)
        keys = _keys(self.xyz[cells], edge_m)
        of_key, number = np.unique(keys, return_inverse=True)
        sums = np.bincount(number[around], weights=counts[around], minlength=len(of_key))
        lone = np.flatnonzero(inside & (counts == 1) & (sums[number] <= 1))
        return lone, len(lone) / max(1, counts[inside].sum())


def _keys(xyz: "np.ndarray[Any, Any]", edge_m: Any) -> "np.ndarray[Any, Any]":
    """A number for each cell."""
    import numpy as np

    cells = np.floor(xyz / np.float32(edge_m)).astype(np.int64) + (1 << 20)
    return np.asarray((cells[:, 0] << 42) | (cells[:, 1] << 21) | cells[:, 2])
