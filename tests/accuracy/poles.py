#!/usr/bin/env python3
"""What cleaning costs a map of poles, signs and trunks, without labels.

usage: poles.py KEPT CLEANED...

KEPT is a package built with `--clean none`, CLEANED others of the same drive with the same poses. A pole is a chain of
slices of 0.25 m of measured points, each at most 0.4 m wide and apart from all else by 0.1 m, whose centres lie within
0.2 m of each other: at least 1.5 m high, between 0.3 and 6 m over the ground, seen in at least 5 scans. A point of it
is lost when CLEANED has no measured point within 0.1 m. Needs numpy.
"""

import pathlib
import sys

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
from map_package import MapPackage  # noqa: E402

MEASURED, GROUND = 0, 1
SLICE_M, CELL_M, WIDTH_M, LEAN_M, HEIGHT_M = 0.25, 0.1, 0.4, 0.2, 1.5
LOWEST_M, HIGHEST_M = 0.3, 6.0
SCANS = 5
NEAR_M = 0.1


class Package:
    """Its points, relative to its origin."""

    def __init__(self, folder):
        package = MapPackage(folder)
        tiles = list(package.tiles())
        self.origin = list(package.origin)
        self.position, self.kind, self.first_scan, self.last_scan = (
            np.concatenate([getattr(tile, name) for tile in tiles])
            for name in ("position", "kind", "first_scan", "last_scan"))
        self.position = self.position - package.origin


def heights_over_ground(package, positions):
    """NaN where no ground lies within 3 m."""
    ground = {}
    of_ground = package.position[package.kind == GROUND]
    for cell, z in zip(map(tuple, np.floor(of_ground[:, :2]).astype(int)), of_ground[:, 2]):
        ground.setdefault(cell, []).append(z)
    ground = {cell: float(np.median(z)) for cell, z in ground.items()}

    def level(cell):
        for reach in range(4):
            around = [(cell[0] + x, cell[1] + y) for x in range(-reach, reach + 1) for y in range(-reach, reach + 1)
                      if max(abs(x), abs(y)) == reach]
            found = [ground[each] for each in around if each in ground]
            if found:
                return min(found)
        return np.nan

    cells, number = np.unique(np.floor(positions[:, :2]).astype(int), axis=0, return_inverse=True)
    return positions[:, 2] - np.array([level(tuple(cell)) for cell in cells])[number.ravel()]


def clusters_of(cells):
    """Number of its cluster for each of some different cells; neighbours in any of 8 directions belong together."""
    at = {tuple(cell): i for i, cell in enumerate(cells)}
    cluster = np.full(len(cells), -1)
    count = 0
    for first in range(len(cells)):
        if cluster[first] >= 0:
            continue
        cluster[first], open_ = count, [first]
        while open_:
            x, y = cells[open_.pop()]
            for other in ((x + i, y + j) for i in (-1, 0, 1) for j in (-1, 0, 1)):
                found = at.get(other)
                if found is not None and cluster[found] < 0:
                    cluster[found] = count
                    open_.append(found)
        count += 1
    return cluster, count


def thin_slices(positions, heights_m):
    """(slice, centre, indices) of all clusters of a slice that are thin."""
    slices = np.floor(heights_m / SLICE_M).astype(int)
    for level in np.unique(slices):
        inside = np.flatnonzero(slices == level)
        cells, number = np.unique(np.floor(positions[inside, :2] / CELL_M).astype(int), axis=0, return_inverse=True)
        cluster, count = clusters_of(cells)
        of_point = cluster[number.ravel()]
        order = np.argsort(of_point, kind="stable")
        begins = np.searchsorted(of_point[order], np.arange(count + 1))
        for i in range(count):
            indices = inside[order[begins[i]:begins[i + 1]]]
            if np.all(np.ptp(positions[indices, :2], axis=0) <= WIDTH_M):
                yield int(level), positions[indices, :2].mean(axis=0), indices


def chains_of(thin):
    """Lists of indices into `thin`, upward; a slice may be missing."""
    def cell(centre):
        return tuple(np.floor(centre / LEAN_M).astype(int))

    at = {}
    for i, (level, centre, _) in enumerate(thin):
        at.setdefault((level, *cell(centre)), []).append(i)
    used = set()

    def above(i):
        level, centre, _ = thin[i]
        x, y = cell(centre)
        for step in (1, 2):
            for key in ((level + step, x + dx, y + dy) for dx in (-1, 0, 1) for dy in (-1, 0, 1)):
                for j in at.get(key, ()):
                    if j not in used and np.linalg.norm(thin[j][1] - centre) < LEAN_M:
                        return j
        return None

    for i in range(len(thin)):
        if i in used:
            continue
        chain = [i]
        while (following := above(chain[-1])) is not None:
            chain.append(following)
        if (thin[chain[-1]][0] - thin[i][0] + 1) * SLICE_M >= HEIGHT_M:
            used.update(chain)
            yield chain


def poles_of(package):
    """Indices of the points of each pole."""
    measured = np.flatnonzero(package.kind == MEASURED)
    positions = package.position[measured]
    heights_m = heights_over_ground(package, positions)
    band = (heights_m > LOWEST_M) & (heights_m < HIGHEST_M)
    measured, positions, heights_m = measured[band], positions[band], heights_m[band]
    thin = list(thin_slices(positions, heights_m))
    poles = []
    for chain in chains_of(thin):
        indices = np.concatenate([thin[i][2] for i in chain])
        seen = measured[indices]
        leans = np.any(np.ptp(positions[indices, :2], axis=0) > WIDTH_M + LEAN_M)
        if not leans and len(np.union1d(package.first_scan[seen], package.last_scan[seen])) >= SCANS:
            poles.append(measured[indices])
    return poles


def keys_of(positions):
    cells = np.floor(positions / NEAR_M).astype(np.int64) + (1 << 20)
    return (cells[:, 0] << 42) | (cells[:, 1] << 21) | cells[:, 2]


def lost_of(positions, package):
    """Flags of the positions that no measured point of the package is near to."""
    measured = package.position[package.kind <= GROUND]
    keys = keys_of(measured)
    order = np.argsort(keys, kind="stable")
    keys, measured = keys[order], measured[order]
    found = np.zeros(len(positions), bool)
    for step in np.ndindex(3, 3, 3):
        wanted = keys_of(positions + (np.array(step) - 1) * NEAR_M)
        begin, end = np.searchsorted(keys, wanted), np.searchsorted(keys, wanted, side="right")
        for i in np.flatnonzero(~found & (end > begin)):
            found[i] = np.min(((measured[begin[i]:end[i]] - positions[i]) ** 2).sum(axis=1)) <= NEAR_M ** 2 + 1e-6
    return ~found


def loss_of(kept, poles, cleaned):
    """Share of the poles' points that are lost, and how many poles lose more than half."""
    if kept.origin != cleaned.origin:
        sys.exit(f"maps with the origins {kept.origin} and {cleaned.origin}: build both from the same poses")
    lost = lost_of(kept.position[np.concatenate(poles)], cleaned)
    ends = np.cumsum([len(pole) for pole in poles])
    gone = sum(part.mean() > 0.5 for part in np.split(lost, ends[:-1]))
    return float(lost.mean()), int(gone)


def main():
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    kept = Package(sys.argv[1])
    poles = poles_of(kept)
    print(f"{len(poles)} poles of {sum(map(len, poles))} points")
    for folder in sys.argv[2:]:
        share, gone = loss_of(kept, poles, Package(folder))
        print(f"{folder}: {100 * share:.2f} % of their points lost, {gone} poles lose more than half")


if __name__ == "__main__":
    main()
