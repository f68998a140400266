"""Poses as 4 x 4 matrices."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from . import _native


def matrix_of(position: Sequence[float], quaternion: Sequence[float] | None = None, *,
              yaw_deg: float = 0.0) -> NDArray[np.float64]:
    """The 4 x 4 matrix of a pose, as `stillmap localize --prior` reads it.

    position: x, y, z [m]. quaternion: x, y, z, w with norm 1 within 1e-3; without it, upright with `yaw_deg`,
    counter-clockwise from +x. Raises ValueError for other numbers.
    """
    if quaternion is None:
        # As the command line does it, to the bit.
        half = 0.5 * yaw_deg * (math.pi / 180.0)
        quaternion = (0.0, 0.0, math.sin(half), math.cos(half))
    elif yaw_deg != 0.0:
        raise ValueError("yaw_deg: found beside a quaternion, expected one of them")
    return _native.pose_matrix(position, quaternion)
