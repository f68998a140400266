"""Poses, maps and what else the server answers, as plain values. SI units; map coordinates in metres.

Each keeps the whole JSON answer in `raw`, so that keys which this version does not know are not lost.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Dict, Mapping, Optional, Sequence, Tuple

Vector3 = Tuple[float, float, float]
#: x, y, z, w
Quaternion = Tuple[float, float, float, float]


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
        return {"position": list(self.position), "quaternion": list(self.quaternion)}


@dataclass(frozen=True)
class Prior:
    """Where the search starts: T_map_lidar, and how sure that is.

    `sigma` is (metres, radians) for all directions alike; `covariance` has 36 numbers row by row, order tx ty tz
    rx ry rz, perturbation on the right, in the lidar frame. At most one of the two.
    """

    pose: Pose
    sigma: Optional[Tuple[float, float]] = None
    covariance: Optional[Sequence[float]] = None

    def to_json(self) -> Dict[str, Any]:
        json = self.pose.to_json()
        covariance = covariance_of(self.sigma, self.covariance)
        if covariance is not None:
            json["covariance"] = covariance
        return json


@dataclass(frozen=True)
class Gnss:
    """Where a satellite receiver says that the lidar is (WGS 84); one standard deviation in metres."""

    latitude_deg: float
    longitude_deg: float
    sigma_m: float
    altitude_m: Optional[float] = None

    def to_json(self) -> Dict[str, Any]:
        json: Dict[str, Any] = {"latitude_deg": self.latitude_deg, "longitude_deg": self.longitude_deg,
                                "sigma_m": self.sigma_m}
        if self.altitude_m is not None:
            json["altitude_m"] = self.altitude_m
        return json


@dataclass(frozen=True)
class Odometry:
    """Pose of the lidar at this scan in the lidar frame at the earlier scan `since_ns`."""

    since_ns: int
    pose: Pose
    sigma: Tuple[float, float]

    def to_json(self) -> Dict[str, Any]:
        return {"since_ns": str(self.since_ns), **self.pose.to_json(), "covariance": covariance_of(self.sigma, None)}


@dataclass(frozen=True)
class MovableBox:
    """An object that a detector found in the scan: centre and size [m], yaw [rad], in the lidar frame."""

    centre: Vector3
    size: Vector3
    yaw: float = 0.0

    def to_json(self) -> Dict[str, Any]:
        return {"centre": list(self.centre), "size": list(self.size), "yaw": self.yaw}


def covariance_of(sigma: Optional[Tuple[float, float]], covariance: Optional[Sequence[float]]) -> Optional[Sequence[float]]:
    if sigma is not None and covariance is not None:
        raise ValueError("sigma: found a covariance beside it, expected one of the two")
    if sigma is None:
        return None if covariance is None else [float(x) for x in covariance]
    variances = [sigma[0] ** 2] * 3 + [sigma[1] ** 2] * 3
    return [variances[i] if i == j else 0.0 for i in range(6) for j in range(6)]


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


@dataclass(frozen=True)
class PoseAnswer:
    """What a scan was answered with. `pose` is T_map_lidar and None when the status is `lost`."""

    status: str
    reasons: Tuple[str, ...]
    pose: Optional[Pose]
    T_map_base: Optional[Pose]
    covariance: Optional[Tuple[float, ...]]
    protection: Protection
    inlier_ratio: float
    rmse_m: float
    iterations: int
    map: MapReference
    stamp_ns: Optional[int]
    timing_ms: Mapping[str, float]
    request_id: str
    #: Of a session's scan only.
    searched_from: Optional[str] = None
    raw: Mapping[str, Any] = field(default_factory=dict, repr=False, compare=False)

    @property
    def is_ok(self) -> bool:
        return self.status == "ok"

    @classmethod
    def of(cls, json: Mapping[str, Any]) -> "PoseAnswer":
        pose, base, covariance = json["pose"], json.get("T_map_base"), json["covariance"]
        bounds = json["protection"]
        return cls(status=json["status"], reasons=tuple(json["reasons"]),
                   pose=None if pose is None else Pose.of(pose), T_map_base=None if base is None else Pose.of(base),
                   covariance=None if covariance is None else _floats(covariance),
                   protection=Protection(bounds["longitudinal_m"], bounds["lateral_m"], bounds["vertical_m"],
                                         bounds["yaw_rad"]),
                   inlier_ratio=float(json["inlier_ratio"]), rmse_m=float(json["rmse_m"]),
                   iterations=int(json["iterations"]),
                   map=MapReference(json["map"]["name"], json["map"]["version"], json["map"]["digest"]),
                   stamp_ns=_integer(json["stamp_ns"]), timing_ms=json["timing_ms"], request_id=json["request_id"],
                   searched_from=json.get("searched_from"), raw=json)


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
