"""Ground and what stands on it, by one simple method for all sources.

Lowest points of 1 m cells, grown outwards from the road round the vehicle. It is no better than it
needs to be: what matters is that real and simulated scans go through the same code.
"""

import numpy as np

CELL_M = 1.0
REACH_M = 60.0
# Steps up to this [m] from the mean of the ground around are followed: kerbs and slopes are,
# car sills and hedges are not.
FOLLOW_M = 0.25
# Points up to this [m] above the lowest of the ground count as ground: a kerb's upper edge does.
GROUND_BAND_M = 0.2


def lowest_by_cell(x, y, z, cell_m, reach_m):
    """Grid [ix, iy] of the 5 % lowest height of each cell, NaN where there is no point.

    Not the minimum: rays that are mirrored end below the road.
    """
    n = int(2 * reach_m / cell_m)
    ix, iy = ((v + reach_m) // cell_m for v in (x, y))
    inside = (ix >= 0) & (ix < n) & (iy >= 0) & (iy < n)
    cell = (ix[inside] * n + iy[inside]).astype(int)
    order = np.lexsort((z[inside], cell))
    cell, height = cell[order], z[inside][order]
    cells, start, count = np.unique(cell, return_index=True, return_counts=True)
    grid = np.full(n * n, np.nan)
    grid[cells] = height[start + (0.05 * count).astype(int)]
    return grid.reshape(n, n)


def _box_mean(grid, half):
    """Mean of the finite cells within `half` cells, NaN where there is none."""
    known = np.isfinite(grid)
    sums = []
    for values in (np.where(known, grid, 0.0), known.astype(float)):
        padded = np.pad(values, ((half + 1, half), (half + 1, half))).cumsum(0).cumsum(1)
        w = 2 * half + 1
        sums.append(padded[w:, w:] - padded[:-w, w:] - padded[w:, :-w] + padded[:-w, :-w])
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(sums[1] > 0.5, sums[0] / sums[1], np.nan)


def ground_grid(points):
    """Ground height [m] on the 1 m grid, NaN where none is near."""
    low = lowest_by_cell(points[:, 0], points[:, 1], points[:, 2], CELL_M, REACH_M)
    n = low.shape[0]
    centre = (np.arange(n) + 0.5) * CELL_M - REACH_M
    distance = np.hypot(centre[:, None], centre[None, :])
    # KITTI's sensor is 1.73 m above the road; the seed is the commonest height thereabouts.
    near = (distance < 10.0) & (low > -2.5) & (low < -1.0)
    if not near.any():
        return np.full_like(low, np.nan)
    counts, edges = np.histogram(low[near], bins=np.arange(-2.5, -0.95, 0.1))
    road = edges[counts.argmax()] + 0.05
    ground = np.where(near & (np.abs(low - road) < 0.3), low, np.nan)
    for _ in range(2 * n):
        around = _box_mean(ground, 2)
        with np.errstate(invalid="ignore"):
            new = np.isnan(ground) & (np.abs(low - around) < FOLLOW_M)
        if not new.any():
            break
        ground[new] = low[new]
    for _ in range(4):
        around = _box_mean(ground, 2)
        ground = np.where(np.isnan(ground), around, ground)
    return ground


def height_above_ground(points, ground):
    """Height [m] above the grid, bilinear; NaN where the ground is not known."""
    n = ground.shape[0]
    gx, gy = ((points[:, k] + REACH_M) / CELL_M - 0.5 for k in (0, 1))
    inside = (gx >= 0) & (gx < n - 1) & (gy >= 0) & (gy < n - 1)
    ix, iy = (np.where(inside, g, 0).astype(int) for g in (gx, gy))
    fx, fy = gx - ix, gy - iy
    total, weight = np.zeros(len(points)), np.zeros(len(points))
    for dx in (0, 1):
        for dy in (0, 1):
            value = ground[ix + dx, iy + dy]
            share = (fx if dx else 1 - fx) * (fy if dy else 1 - fy)
            known = np.isfinite(value) & inside
            total += np.where(known, value * share, 0.0)
            weight += np.where(known, share, 0.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(weight > 0.25, points[:, 2] - total / weight, np.nan)


def plane_residual_spread(points, cell_m=1.0, min_points=12):
    """Robust spread [m] of the points of each cell about its plane; (spreads, cell centres n x 2).

    Planes z = a x + b y + c by least squares, twice: the second time without what lies beyond 3
    spreads of the first. Spread: 1.4826 times the median absolute residual.
    """
    key = np.floor(points[:, :2] / cell_m).astype(np.int64)
    _, cell, count = np.unique(key[:, 0] * 100003 + key[:, 1], return_inverse=True,
                               return_counts=True)
    kept = count[cell] >= min_points
    points, key = points[kept], key[kept]
    if not len(points):
        return np.zeros(0), np.zeros((0, 2))
    _, first, cell, count = np.unique(key[:, 0] * 100003 + key[:, 1], return_index=True,
                                      return_inverse=True, return_counts=True)
    centre = (key[first] + 0.5) * cell_m
    local = points[:, :2] - centre[cell]
    use = np.ones(len(points), bool)
    for _ in range(2):
        row = np.column_stack([local, np.ones(len(local))]) * use[:, None]
        A = np.zeros((len(first), 3, 3))
        b = np.zeros((len(first), 3))
        for i in range(3):
            b[:, i] = np.bincount(cell, row[:, i] * points[:, 2], len(first))
            for j in range(3):
                A[:, i, j] = np.bincount(cell, row[:, i] * row[:, j], len(first))
        # A touch of damping: all points of a cell may lie on one ring, that is on a line.
        A[:, [0, 1], [0, 1]] += 1e-3 * count[:, None]
        plane = np.linalg.solve(A, b[:, :, None])[:, :, 0]
        residual = points[:, 2] - (local * plane[cell, :2]).sum(1) - plane[cell, 2]
        order = np.lexsort((np.abs(residual), cell))
        starts = np.concatenate([[0], np.cumsum(count)[:-1]])
        spread = 1.4826 * np.abs(residual)[order][starts + count // 2]
        use = np.abs(residual) < 3.0 * np.maximum(spread[cell], 1e-4)
    return spread, centre
