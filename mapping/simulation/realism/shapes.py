"""Shapes of what stands on the ground: clusters, and eigenvalues of small neighbourhoods."""

import numpy as np

CLUSTER_CELL_M = 0.4
VOXEL_M = 0.8
MIN_CLUSTER_POINTS = 10
MIN_VOXEL_POINTS = 8
# Row length of hashed cell numbers: more cells than any scan is wide.
_ROW = 4096


def component_of(cells):
    """Component number per cell of sorted, unique integer cells (x * _ROW + y), 8 neighbours."""
    parent = np.arange(len(cells))
    links = []
    for offset in (1, _ROW - 1, _ROW, _ROW + 1):
        at = np.searchsorted(cells, cells + offset)
        at[at == len(cells)] = 0
        hit = np.flatnonzero(cells[at] == cells + offset)
        links.append(np.column_stack([hit, at[hit]]))
    a, b = np.concatenate(links).T
    while True:
        # Both ends take the smaller root, then every chain is shortened: logarithmic in length.
        low = np.minimum(parent[a], parent[b])
        before = parent.copy()
        np.minimum.at(parent, parent[a], low)
        np.minimum.at(parent, parent[b], low)
        parent = parent[parent]
        if np.array_equal(parent, before):
            return parent


def cluster_sizes(points):
    """(vertical extents [m], footprints [m2]) of grid-connected clusters of 10 points or more."""
    if not len(points):
        return np.zeros(0), np.zeros(0)
    key = np.floor(points[:, :2] / CLUSTER_CELL_M).astype(np.int64) + _ROW // 2
    cells, cell = np.unique(key[:, 0] * _ROW + key[:, 1], return_inverse=True)
    root = component_of(cells)
    _, cluster = np.unique(root, return_inverse=True)
    area = np.bincount(cluster) * CLUSTER_CELL_M**2
    of_point = cluster[cell]
    order = np.lexsort((points[:, 2], of_point))
    count = np.bincount(of_point)
    end = np.cumsum(count)
    z = points[order, 2]
    extent = z[end - 1] - z[end - count]
    kept = count >= MIN_CLUSTER_POINTS
    return extent[kept], area[kept]


def free_range(points, azimuth_deg):
    """Distance [m] over the ground to the nearest point per degree; inf where there is none.

    The second nearest, in truth: a single speck does not make an obstacle.
    """
    sector = np.minimum(azimuth_deg.astype(int), 359)
    distance = np.hypot(points[:, 0], points[:, 1])
    order = np.lexsort((distance, sector))
    count = np.bincount(sector, minlength=360)
    start = np.cumsum(count) - count
    out = np.full(360, 1e6)
    seen = count >= 2
    out[seen] = distance[order][start[seen] + 1]
    return out


def voxel_eigen(points):
    """Per voxel with enough points: eigenvalues l1 >= l2 >= l3 [m2], |n_z|, distance [m]."""
    key = np.floor(points[:, :3] / VOXEL_M).astype(np.int64) + 512
    _, voxel, count = np.unique((key[:, 0] * 1024 + key[:, 1]) * 1024 + key[:, 2],
                                return_inverse=True, return_counts=True)
    kept = count[voxel] >= MIN_VOXEL_POINTS
    points, voxel = points[kept, :3], voxel[kept]
    if not len(points):
        return np.zeros((0, 3)), np.zeros(0), np.zeros(0)
    _, voxel, count = np.unique(voxel, return_inverse=True, return_counts=True)
    n = len(count)
    mean = np.stack([np.bincount(voxel, points[:, k], n) / count for k in range(3)], axis=1)
    d = points - mean[voxel]
    covariance = np.zeros((n, 3, 3))
    for i in range(3):
        for j in range(i, 3):
            covariance[:, i, j] = np.bincount(voxel, d[:, i] * d[:, j], n) / count
            covariance[:, j, i] = covariance[:, i, j]
    values, vectors = np.linalg.eigh(covariance)
    return (np.maximum(values[:, ::-1], 0.0), np.abs(vectors[:, 2, 0]),
            np.hypot(mean[:, 0], mean[:, 1]))


def local_shapes(points, above, on_ground, flat):
    """Values of the shape features, each as a list [near, far]."""
    out = {k: [] for k in ("linearity", "planarity", "scatter", "wall_thickness", "normal")}
    for low, high in ((5.0, 15.0), (15.0, 40.0)):
        band = (flat >= low) & (flat < high)
        values, _, _ = voxel_eigen(points[band & above])
        l1, l2, l3 = values.T
        planarity = (l2 - l3) / l1
        out["linearity"].append((l1 - l2) / l1)
        out["planarity"].append(planarity)
        out["scatter"].append(l3 / l1)
        out["wall_thickness"].append(1000.0 * np.sqrt(l3[planarity > 0.4]))
        values, steep, _ = voxel_eigen(points[band & (above | on_ground)])
        flat_enough = (values[:, 1] - values[:, 2]) / values[:, 0] > 0.4
        out["normal"].append(steep[flat_enough])
    return out
