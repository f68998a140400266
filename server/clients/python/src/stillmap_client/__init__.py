"""Client of a stillmap server: "where am I in this map?" over HTTP. Standard library only.

    from stillmap_client import Client, Pose, Prior
    answer = Client("http://127.0.0.1:8080").localize("town", scan_bytes, Prior(Pose((0, 0, 0)), sigma=(1, 0.1)))
"""

from .client import Client
from .errors import ConnectionLost, DownloadChanged, NeedsChoice, Problem, StillmapError
from .mirror import Mirrored
from .scan import Pcd, Scan
from .sealed import SealedSession
from .session import Session, SessionStream
from .types import (Event, GeoPose, Gnss, MapInfo, MapReference, MovableBox, Odometry, Offset, Pose, PoseAnswer,
                    PoseWarning, Prior, Protection, Query, SessionInfo, Version)

__all__ = ["Client", "ConnectionLost", "DownloadChanged", "Event", "GeoPose", "Gnss", "MapInfo", "MapReference",
           "Mirrored", "MovableBox", "NeedsChoice", "Odometry", "Offset", "Pcd", "Pose", "PoseAnswer", "PoseWarning",
           "Prior", "Problem", "Protection", "Query", "Scan", "SealedSession", "Session", "SessionInfo",
           "SessionStream", "StillmapError", "Version"]
