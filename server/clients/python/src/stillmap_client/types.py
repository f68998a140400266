"""Poses, maps and what else the server answers, as plain values. SI units; map coordinates in metres.

Each keeps the whole JSON answer in `raw`, so that keys which this version does not know are not lost.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Any, Dict, Iterable, Mapping, Optional, Sequence, Tuple, Union

from .scan import Scan

Vector3 = Tuple[float, float, float]
#: x, y, z, w
Quaternion = Tuple[float, float, float, float]
#: 36 numbers row by row, or 6 rows (such as a numpy array of 6 x 6); order tx ty tz rx ry rz. A row and column of
#: zeros is "not told", as planar localizers and odometry have them for z, roll and pitch.
Covariance = Union[Sequence[float], Sequence[Sequence[float]]]


def _floats(values: Sequence[Any]) -> Tuple[float, ...]:
    return tuple(float(x) for x in values)


def _integer(value: Any) -> Optional[int]:
    return None if value is None else int(value)


@dataclass(frozen=True)
class Pose:
    """T_a_b: takes points from frame b to frame a."""

    position: Vector3
    quaternion: Quaternion = (0.0, 0.0, 0.0, 1.0)

    @classmethod
    def of(cls, json: Mapping[str, Any]) -> "Pose":
        x, y, z = _floats(json["position"])
        qx, qy, qz, qw = _floats(json["quaternion"])
        return cls((x, y, z), (qx, qy, qz, qw))

    def to_json(self) -> Dict[str, Any]:
        return {"position": list(_floats(self.position)), "quaternion": list(_floats(self.quaternion))}


@dataclass(frozen=True)
class Prior:
    """Where the search starts: T_map_lidar, and how sure that is.

    `sigma` is (metres, radians) for all directions alike; `covariance` is a `Covariance`, perturbation on the right,
    in the lidar frame. At most one of the two.
    """

    pose: Pose
    sigma: Optional[Tuple[float, float]] = None
    covariance: Optional[Covariance] = None

    def to_json(self) -> Dict[str, Any]:
        json = self.pose.to_json()
        covariance = covariance_of(self.sigma, self.covariance)
        if covariance is not None:
            json["covariance"] = covariance
        return json


class LastPlace:
    """Where a vehicle was in a set of maps when its session ended: the next one begins around there, as far as the
    vehicle may have come since then. A large set needs a place to begin at."""

    _MOST_M_S = 15.0  # one standard deviation

    def __init__(self) -> None:
        self._pose: Optional[Pose] = None
        self._at_s = 0.0

    def note(self, answer: "PoseAnswer") -> None:
        if answer.T_set_lidar is not None and answer.status == "ok":
            self._pose, self._at_s = answer.T_set_lidar, time.monotonic()

    def prior(self) -> Optional[Prior]:
        """None where nothing is known, as in one map: there it is searched for everywhere."""
        if self._pose is None:
            return None
        way_m = 10.0 + self._MOST_M_S * (time.monotonic() - self._at_s)
        deviations = (way_m, way_m, 10.0, 0.2, 0.2, 2.0)
        return Prior(self._pose, covariance=[deviations[i] ** 2 if i == j else 0.0 for i in range(6) for j in range(6)])


@dataclass(frozen=True)
class Gnss:
    """Where a satellite receiver says that the lidar is (WGS 84); one standard deviation in metres."""

    latitude_deg: float
    longitude_deg: float
    sigma_m: float
    altitude_m: Optional[float] = None

    def to_json(self) -> Dict[str, Any]:
        json: Dict[str, Any] = {"latitude_deg": float(self.latitude_deg), "longitude_deg": float(self.longitude_deg),
                                "sigma_m": float(self.sigma_m)}
        if self.altitude_m is not None:
            json["altitude_m"] = float(self.altitude_m)
        return json


@dataclass(frozen=True)
class Odometry:
    """Pose of the lidar at this scan in the lidar frame at the earlier scan `since_ns`; with either a `sigma`
    (metres, radians) or a `covariance`, as `Prior` has them."""

    since_ns: int
    pose: Pose
    sigma: Optional[Tuple[float, float]] = None
    covariance: Optional[Covariance] = None

    def to_json(self) -> Dict[str, Any]:
        covariance = covariance_of(self.sigma, self.covariance)
        if covariance is None:
            raise ValueError("odometry: found neither sigma nor covariance, expected one of the two")
        return {"since_ns": str(self.since_ns), **self.pose.to_json(), "covariance": covariance}


@dataclass(frozen=True)
class MovableBox:
    """An object that a detector found in the scan: centre and size [m], yaw [rad], in the lidar frame."""

    centre: Vector3
    size: Vector3
    yaw: float = 0.0

    def to_json(self) -> Dict[str, Any]:
        return {"centre": list(_floats(self.centre)), "size": list(_floats(self.size)), "yaw": float(self.yaw)}


def _pose(json: Optional[Mapping[str, Any]]) -> Optional[Pose]:
    return None if json is None else Pose.of(json)


def _row_by_row(covariance: Covariance) -> Sequence[float]:
    flat = [float(x) for row in covariance for x in (row if isinstance(row, Iterable) else (row,))]
    if len(flat) != 36:
        raise ValueError(f"covariance: found {len(flat)} numbers, expected 36, or 6 rows of 6")
    return flat


def covariance_of(sigma: Optional[Tuple[float, float]], covariance: Optional[Covariance]) -> Optional[Sequence[float]]:
    if sigma is not None and covariance is not None:
        raise ValueError("sigma: found a covariance beside it, expected one of the two")
    if sigma is None:
        return None if covariance is None else _row_by_row(covariance)
    variances = [float(sigma[0]) ** 2] * 3 + [float(sigma[1]) ** 2] * 3
    return [variances[i] if i == j else 0.0 for i in range(6) for j in range(6)]


@dataclass(frozen=True)
class Query:
    """One scan of `Client.localize_batch`, with what `Client.localize` takes beside it."""

    scan: Scan
    prior: Optional[Prior] = None
    layout: Optional[str] = None
    gnss: Optional[Gnss] = None
    stamp_ns: Optional[int] = None
    method: Optional[str] = None
    T_base_lidar: Optional[Pose] = None
    movable: Sequence[MovableBox] = ()


@dataclass(frozen=True)
class Protection:
    """What the errors of an `ok` pose stay within but for one in a thousand; None = no bound."""

    longitudinal_m: Optional[float]
    lateral_m: Optional[float]
    vertical_m: Optional[float]
    yaw_rad: Optional[float]


@dataclass(frozen=True)
class MapReference:
    name: str
    version: str
    digest: str

    @classmethod
    def of(cls, json: Mapping[str, Any]) -> "MapReference":
        return cls(json["name"], json["version"], json["digest"])


@dataclass(frozen=True)
class Offset:
    """How far a pose is from the prior."""

    m: float
    rad: float


@dataclass(frozen=True)
class PoseWarning:
    """`clock_skew`: the stamp is `ahead_s` ahead of the server's clock. Of sealed sessions `seal_replayed`: the server
    has gone on from this seal before; `version_activated`: the vehicle would get `version` now. Of sessions in a set `handed_over`:
    until this scan the vehicle was followed in the map `from_map`."""

    code: str
    ahead_s: Optional[float] = None
    version: Optional[str] = None
    from_map: Optional[str] = None

    @classmethod
    def of(cls, json: Mapping[str, Any]) -> "PoseWarning":
        ahead_s, version = json.get("ahead_s"), json.get("version")
        return cls(str(json["code"]), None if ahead_s is None else float(ahead_s),
                   None if version is None else str(version), json.get("from_map"))


@dataclass(frozen=True)
class PoseAnswer:
    """What a scan was answered with. `pose` is T_map_lidar and None when the status is `lost`.

    `covariance` has 36 numbers row by row, in the order of `covariance_order`; each of the `degenerate_directions`
    six, of which the last three are metres that a turn moves a point 15 m away."""

    status: str
    reasons: Tuple[str, ...]
    pose: Optional[Pose]
    T_map_base: Optional[Pose]
    covariance: Optional[Tuple[float, ...]]
    covariance_order: Tuple[str, ...]
    protection: Protection
    inlier_ratio: float
    rmse_m: float
    movable_points: int
    #: Points of the scan that say that nothing came back.
    no_returns: int
    degenerate_directions: Tuple[Tuple[float, ...], ...]
    prior_to_pose: Optional[Offset]
    iterations: int
    map: MapReference
    stamp_ns: Optional[int]
    timing_ms: Mapping[str, float]
    warnings: Tuple[PoseWarning, ...]
    request_id: str
    #: Of a session's scan only, as `searched_from`.
    session: Optional[str] = None
    searched_from: Optional[str] = None
    #: In a set of maps only: its name, and the pose in its frame, None when the status is `lost`.
    set: Optional[str] = None
    T_set_lidar: Optional[Pose] = None
    raw: Mapping[str, Any] = field(default_factory=dict, repr=False, compare=False)

    @property
    def is_ok(self) -> bool:
        return self.status == "ok"

    @classmethod
    def of(cls, json: Mapping[str, Any]) -> "PoseAnswer":
        covariance, bounds, offset = json["covariance"], json["protection"], json["prior_to_pose"]
        return cls(status=json["status"], reasons=tuple(json["reasons"]),
                   pose=_pose(json["pose"]), T_map_base=_pose(json.get("T_map_base")),
                   covariance=None if covariance is None else _floats(covariance),
                   covariance_order=tuple(json["covariance_order"]),
                   protection=Protection(bounds["longitudinal_m"], bounds["lateral_m"], bounds["vertical_m"],
                                         bounds["yaw_rad"]),
                   inlier_ratio=float(json["inlier_ratio"]), rmse_m=float(json["rmse_m"]),
                   movable_points=int(json["movable_points"]),
                   no_returns=int(json["no_returns"]),
                   degenerate_directions=tuple(_floats(each) for each in json["degenerate_directions"]),
                   prior_to_pose=None if offset is None else Offset(float(offset["m"]), float(offset["rad"])),
                   iterations=int(json["iterations"]), map=MapReference.of(json["map"]),
                   stamp_ns=_integer(json["stamp_ns"]), timing_ms=json["timing_ms"],
                   warnings=tuple(PoseWarning.of(each) for each in json["warnings"]),
                   request_id=json["request_id"], session=json.get("session"),
                   searched_from=json.get("searched_from"), set=json.get("set"),
                   T_set_lidar=_pose(json.get("T_set_lidar")), raw=json)


@dataclass(frozen=True)
class GeoPose:
    """A pose on the Earth as OGC GeoPose 1.0 has it: of the base if `T_base_lidar` was sent, else of the lidar.

    `quaternion` takes the vehicle's axes to east, north and up at the vehicle. `status` is `ok` or `degraded`:
    GeoPose itself has no word for it. `valid_time_ms` is the scan's stamp."""

    status: str
    reasons: Tuple[str, ...]
    latitude_deg: float
    longitude_deg: float
    #: Above the ellipsoid.
    height_m: float
    quaternion: Quaternion
    valid_time_ms: Optional[int]
    raw: Mapping[str, Any] = field(default_factory=dict, repr=False, compare=False)

    @property
    def is_ok(self) -> bool:
        return self.status == "ok"

    @classmethod
    def of(cls, json: Mapping[str, Any], headers: Mapping[str, str]) -> "GeoPose":
        """@param json  of Advanced. @param headers  of the answer, in lower case."""
        place = dict(part.split("=") for part in json["frameSpecification"]["parameters"].split("&"))
        reasons = headers.get("stillmap-reasons", "")
        x, y, z, w = _floats([json["quaternion"][name] for name in "xyzw"])
        return cls(status=headers["stillmap-status"], reasons=tuple(reasons.split(", ")) if reasons else (),
                   latitude_deg=float(place["latitude"]), longitude_deg=float(place["longitude"]),
                   height_m=float(place["height"]), quaternion=(x, y, z, w),
                   valid_time_ms=_integer(json.get("validTime")), raw=json)


@dataclass(frozen=True)
class SessionInfo:
    """How a session stands. `pose` is that of the newest scan that was not lost, at `pose_stamp_ns`."""

    #: None for a session of another key.
    id: Optional[str]
    label: str
    map: MapReference
    active_version: str
    scans: int
    status: Optional[str]
    reasons: Tuple[str, ...]
    stamp_ns: Optional[int]
    pose: Optional[Pose]
    pose_stamp_ns: Optional[int]
    covariance: Optional[Tuple[float, ...]]
    covariance_order: Tuple[str, ...]
    inlier_ratio: Optional[float]
    idle_s: float
    idle_limit_s: float
    #: In lists of sessions.
    key_id: Optional[str] = None
    key_name: Optional[str] = None
    #: The set that its map is of; None without one.
    set: Optional[str] = None
    raw: Mapping[str, Any] = field(default_factory=dict, repr=False, compare=False)

    @classmethod
    def of(cls, json: Mapping[str, Any]) -> "SessionInfo":
        covariance, inliers = json["covariance"], json["inlier_ratio"]
        return cls(id=json.get("id"), label=json["label"], map=MapReference.of(json["map"]),
                   active_version=json["active_version"], scans=int(json["scans"]), status=json["status"],
                   reasons=tuple(json["reasons"]), stamp_ns=_integer(json["stamp_ns"]), pose=_pose(json["pose"]),
                   pose_stamp_ns=_integer(json["pose_stamp_ns"]),
                   covariance=None if covariance is None else _floats(covariance),
                   covariance_order=tuple(json["covariance_order"]),
                   inlier_ratio=None if inliers is None else float(inliers), idle_s=float(json["idle_s"]),
                   idle_limit_s=float(json["idle_limit_s"]), key_id=json.get("key_id"), key_name=json.get("key_name"),
                   set=json.get("set"), raw=json)


@dataclass(frozen=True)
class MapInfo:
    """A map of the store; `version` is the active one, `revision` what `if_match` compares with."""

    name: str
    version: Optional[str]
    previous_version: Optional[str]
    revision: int
    raw: Mapping[str, Any] = field(default_factory=dict, repr=False, compare=False)

    @classmethod
    def of(cls, json: Mapping[str, Any]) -> "MapInfo":
        return cls(json["name"], json["version"], json["previous_version"], int(json["revision"]), json)


@dataclass(frozen=True)
class Version:
    name: str
    digest: str
    bytes: int
    created_ns: int
    active: bool = False

    @classmethod
    def of(cls, json: Mapping[str, Any]) -> "Version":
        return cls(json["version"], json["digest"], int(json["bytes"]), int(json["created_ns"]),
                   bool(json.get("active", False)))


@dataclass(frozen=True)
class Event:
    """A server-sent event. `id` is None for those that are not kept (`gap`, `end`)."""

    id: Optional[int]
    type: str
    data: Mapping[str, Any]
