"""Maps of what stays, and where a scan was taken in them.

Frames and units are those of stillmap: `T_a_b` takes points from frame b to frame a, lengths are metres, angles radians,
times nanoseconds (`_ns`) or seconds (`_s`). The order of covariances is tx ty tz rx ry rz, perturbation on the right.
"""

from ._native import (
    AlignmentResult,
    Drive,
    InputError,
    Localizer,
    Map,
    OdometryStep,
    ProtectionLevels,
    Scan,
    Session,
    StorageError,
    TrackedPose,
    methods,
    open_drive,
    read_scan,
    read_trajectory,
    write_trajectory,
)
from .drives import write_drive
from .maps import GROUND, FILLED, MEASURED, PROJECTED, MapPoints, map_objects, map_points, open_map
from .poses import matrix_of
from .program import Cancelled, ProgramError, Progress, build, evaluate_localization, run

__version__ = "0.1.0"

__all__ = [
    "AlignmentResult", "Cancelled", "Drive", "FILLED", "GROUND", "InputError", "Localizer", "MEASURED", "Map",
    "MapPoints", "OdometryStep", "PROJECTED", "ProgramError", "Progress", "ProtectionLevels", "Scan", "Session",
    "StorageError", "TrackedPose", "build", "evaluate_localization", "map_objects", "map_points", "matrix_of",
    "methods", "open_drive", "open_map", "read_scan", "read_trajectory", "run", "write_drive", "write_trajectory",
]
