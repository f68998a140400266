"""Which laser measured a point, and how many shots did not come back.

KITTI's files do not say; but they are written laser by laser, top first, each from straight ahead
once round to the left. So a ring ends where the azimuth falls back.
"""

import dataclasses

import numpy as np

RING_COUNT = 64

# A turn of the head is cut into sectors for counting shots: narrow enough that nearly every sector
# is answered in full by some of the 64 rings, wide enough to hold some 60 shots.
SECTORS = 36


@dataclasses.dataclass(frozen=True)
class Rings:
    """`ring` per point (0 = top) and, per ring, points, shots and median elevation [deg].

    `notes` says what did not look like an HDL-64E.
    """

    ring: np.ndarray
    azimuth_deg: np.ndarray
    returns: np.ndarray
    shots: int
    elevation_deg: np.ndarray
    notes: list


def azimuth_deg_of(points):
    return np.degrees(np.arctan2(points[:, 1], points[:, 0])) % 360.0


def elevation_deg_of(points):
    return np.degrees(np.arctan2(points[:, 2], np.hypot(points[:, 0], points[:, 1])))


def ring_by_order(azimuth_deg):
    """Ring per point from the file order alone, 0 for the first.

    Motion compensation throws single points back over straight ahead (0.05 deg -> 359.95 deg): such
    a step up undoes the wrap before it, so it is counted against it. A real gap in a ring goes up
    too, but not from beside 0 to beside 360.
    """
    step = np.diff(azimuth_deg)
    # 30 deg: no ring overlaps itself by so much, and no pair of rings fails to fall back by it
    # unless both see less than a half turn.
    wraps = step < -30.0
    jitter = (azimuth_deg[:-1] < 5.0) & (azimuth_deg[1:] > 355.0)
    ring = np.cumsum(wraps.astype(int) - jitter.astype(int))
    return np.maximum(np.concatenate([[0], ring]), 0)


def shots_per_ring(ring, azimuth_deg):
    """Shots in a turn: per sector, the 90th percentile over the rings of the points, summed.

    All lasers fire in step, so the fullest rings of a sector show how many shots it had. Not the
    azimuth step: real heads store it rounded, and its median is 8 % off its mean.
    """
    sector = np.minimum((azimuth_deg / 360.0 * SECTORS).astype(int), SECTORS - 1)
    counts = np.bincount(ring * SECTORS + sector, minlength=RING_COUNT * SECTORS)
    return int(round(np.percentile(counts.reshape(-1, SECTORS), 90, axis=0).sum()))


def find_rings(points):
    """Rings of an HDL-64E scan.

    When the top rings all looked at the sky there are fewer than 64: they are counted from the
    bottom, which always sees the road.
    """
    azimuth, elevation, notes = azimuth_deg_of(points), elevation_deg_of(points), []
    ring = ring_by_order(azimuth)
    found = int(ring.max()) + 1
    if found != RING_COUNT:
        notes.append(f"{found} rings by file order instead of {RING_COUNT}")
    ring = np.clip(ring + (RING_COUNT - found), 0, RING_COUNT - 1)
    returns = np.bincount(ring, minlength=RING_COUNT)
    order = np.argsort(ring, kind="stable")
    parts = np.split(elevation[order], np.cumsum(returns)[:-1])
    median = np.array([np.median(part) if len(part) else np.nan for part in parts])
    seen = median[np.isfinite(median)]
    rising = np.count_nonzero(np.diff(seen) > 0.1)
    if rising > 3:
        notes.append(f"{rising} rings lie above the one before: the file is not sorted top first")
    return Rings(ring, azimuth, returns, shots_per_ring(ring, azimuth), median, notes)
