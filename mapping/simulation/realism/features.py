"""What is measured of a scan: histograms with fixed bins, so that results can be compared over time.

Bins are fixed here and never fitted to the sources. A value beyond the last edge counts in the last
bin, unless the comment of the feature says that it is dropped.
"""

import dataclasses

import numpy as np

import shapes
from ground import (GROUND_BAND_M, ground_grid, height_above_ground, lowest_by_cell,
                    plane_residual_spread)
from rings import RING_COUNT, find_rings

# SemanticKITTI classes by name, moving ones with their resting kind.
CLASSES = {
    "road": (40, 44, 60), "sidewalk": (48,), "other ground": (49,), "building": (50,),
    "fence": (51,), "vegetation": (70,), "trunk": (71,), "terrain": (72,), "pole": (80,),
    "sign": (81,), "car": (10, 252), "other vehicle": (13, 16, 18, 20, 256, 257, 258, 259),
    "two-wheeler": (11, 15, 31, 32, 253, 255), "person": (30, 254), "other object": (52, 99),
}
LABELLED = ("road", "sidewalk", "building", "vegetation", "terrain", "car", "trunk", "pole")


@dataclasses.dataclass(frozen=True)
class Feature:
    """A histogram (or, as `profile`, a share that did not come back) per group.

    `floor`: fewest samples with which a scan has a say in a group. `pooled`: too few per scan, so
    all scans of a street make one histogram.
    """

    key: str
    title: str
    unit: str
    edges: tuple
    groups: tuple = ("all",)
    floor: int = 30
    pooled: bool = False
    profile: bool = False


def _steps(start, stop, step):
    return tuple(np.round(np.arange(start, stop + step / 2, step), 6))


def _powers(low, high, per_octave=1):
    return tuple(2.0 ** (np.arange(low * per_octave, high * per_octave + 1) / per_octave))


# Roughness and wall thickness: half octaves from 1 mm; the noise of the sensor is some 10 to 20 mm.
_ROUGHNESS_MM = _powers(0, 8, 2)
_TENTHS = _steps(0, 1, 0.1)
_NEAR_FAR = ("5 to 15 m", "15 to 40 m")

FEATURES = (
    # 2 m: fine enough to see the rings on the road, some 3,000 points a bin. KITTI ends at 80 m;
    # what is beyond counts in the last bin, so a sensor that sees further shows.
    Feature("range", "Points by range", "range [m]", _steps(0, 80, 2)),
    # One bin per laser.
    Feature("ring", "Points by ring, 0 = top", "ring", _steps(0, 64, 1)),
    # One group per degree: there the lasers are 0.33 to 0.5 deg apart, so each holds 2 or 3.
    Feature("no_return", "Shots that did not come back", "elevation [deg]", (0, 1, 2),
            tuple(f"{e} to {e + 1} deg" for e in range(-25, 4)), profile=True),
    # Powers of two: drop-out at random makes gaps of 1, glass, sky and dark paint make long ones.
    Feature("gap", "Shots missing in a row", "shots", _powers(0, 10)),
    # 0.02 deg: an eighth of the mean step of 0.17 deg. Beyond 0.5 deg it is a gap, not a step.
    Feature("azimuth_step", "Azimuth between neighbours in a ring", "azimuth [deg]",
            _steps(0, 0.5, 0.02)),
    Feature("ground_roughness", "Ground about its plane, 1 m cells", "robust spread [mm]",
            _ROUGHNESS_MM, ("5 to 10 m", "10 to 20 m")),
    # 1 cm up to 10 cm, where crown and slope end; 2 cm then: kerbs stand 4 to 16 cm. The second
    # group is the first from 5 cm on, which would drown in flat road otherwise.
    Feature("ground_step", "Steps between 0.5 m ground cells, up to 15 m", "step [m]",
            _steps(0, 0.1, 0.01) + _steps(0.12, 0.3, 0.02), ("all", "from 5 cm")),
    # Octaves against a full 4 x 1.5 m side at that distance: few cars, so wide bins. 5 points: what
    # is hidden carries a label in neither source or in one only.
    Feature("car_points", "Points on cars, against a bare 4 x 1.5 m side", "log2(points / full)",
            _steps(-7, 3, 1), ("5 to 15 m", "15 to 30 m", "30 to 60 m"), floor=1, pooled=True),
    # 0.5 m: cars, hedges, walkers and walls differ by more; beyond 10 m the sensor sees nothing.
    Feature("cluster_height", "Vertical extent of what stands on the ground", "extent [m]",
            _steps(0, 10, 0.5), floor=20),
    # Octaves of area from one cell of 0.4 m.
    Feature("cluster_area", "Footprint of what stands on the ground", "area [m2]",
            tuple(0.16 * e for e in _powers(0, 12)), floor=20),
    # 0.05: KITTI stores hundredths, and the head's own steps are near 0.01.
    Feature("intensity", "Reflectance", "reflectance", _steps(0, 1, 0.05),
            ("ground", "above ground")),
    Feature("intensity_by_class", "Reflectance by class, labelled scans only", "reflectance",
            _steps(0, 1, 0.05), LABELLED, floor=100),
    # Tenths; voxels of 0.8 m hold what a ball of 0.5 m radius does, at a tenth of the price.
    Feature("linearity", "Linearity of 0.8 m voxels above ground", "(l1 - l2) / l1", _TENTHS,
            _NEAR_FAR),
    Feature("planarity", "Planarity of 0.8 m voxels above ground", "(l2 - l3) / l1", _TENTHS,
            _NEAR_FAR),
    Feature("scatter", "Scatter of 0.8 m voxels above ground", "l3 / l1", _TENTHS, _NEAR_FAR),
    Feature("wall_thickness", "Thickness of flat voxels above ground", "sqrt(l3) [mm]",
            _ROUGHNESS_MM, _NEAR_FAR),
    Feature("normal", "Steepness of flat voxels", "|vertical part of the normal|", _TENTHS,
            _NEAR_FAR),
    # 2 m, one sample per degree of azimuth; free beyond 40 m counts in the last bin.
    Feature("free_range", "Nearest thing above ground, per degree", "range [m]", _steps(0, 40, 2)),
)
BY_KEY = {f.key: f for f in FEATURES}


def histogram(values, edges):
    """Counts with what lies beyond the edges in the outer bins; NaN is left out."""
    values = np.asarray(values, float)
    values = values[np.isfinite(values)]
    low, high = edges[0], np.nextafter(edges[-1], -np.inf)
    return np.histogram(np.clip(values, low, high), edges)[0].astype(np.int64)


def _no_return(rings):
    out = np.zeros((len(BY_KEY["no_return"].groups), 2), np.int64)
    for ring in np.flatnonzero(np.isfinite(rings.elevation_deg)):
        g = int(np.floor(rings.elevation_deg[ring])) + 25
        if 0 <= g < len(out):
            back = min(int(rings.returns[ring]), rings.shots)
            out[g] += (back, rings.shots - back)
    return out


def _steps_and_gaps(rings):
    order = np.lexsort((rings.azimuth_deg, rings.ring))
    ring, azimuth = rings.ring[order], rings.azimuth_deg[order]
    step = np.diff(azimuth)[np.diff(ring) == 0]
    missing = np.round(step * rings.shots / 360.0) - 1
    return (histogram(step[step < 0.5], BY_KEY["azimuth_step"].edges),
            histogram(missing[missing >= 1], BY_KEY["gap"].edges))


def _ground_steps(points):
    grid = lowest_by_cell(points[:, 0], points[:, 1], points[:, 2], 0.5, 15.0)
    steps = np.concatenate([np.abs(np.diff(grid, axis=axis)).ravel() for axis in (0, 1)])
    edges = BY_KEY["ground_step"].edges
    return np.array([histogram(steps, edges), histogram(steps[steps >= 0.05], edges)])


def full_points(distance_m):
    """Shots that would meet a 4 x 1.5 m side at a distance, 0.17 x 0.42 deg apart."""
    return 4.0 * 1.5 / (np.radians(0.17) * np.radians(0.42) * distance_m**2)


def cars_of(scan):
    """(distance [m], points) of the cars ahead, +-40 deg, as far as KITTI labels go.

    From boxes; where there are none, from instances, at the mean of their points.
    """
    cars = []
    if scan.boxes is not None:
        for box in scan.boxes:
            if box.name == "car":
                cars.append((box.centre[:2], np.count_nonzero(box.holds(scan.points, 0.1))))
    elif scan.labels is not None:
        mine = np.isin(scan.labels, CLASSES["car"])
        for instance in np.unique(scan.instances[mine]):
            on = mine & (scan.instances == instance)
            cars.append((scan.points[on, :2].mean(axis=0), np.count_nonzero(on)))
    ahead = np.radians(40.0)
    return [(np.hypot(*xy), n) for xy, n in cars
            if n >= 5 and abs(np.arctan2(xy[1], xy[0])) < ahead]


def _car_points(scan):
    feature, rows = BY_KEY["car_points"], []
    cars = np.array(cars_of(scan)).reshape(-1, 2)
    for low, high in ((5, 15), (15, 30), (30, 60)):
        d, n = cars[(cars[:, 0] >= low) & (cars[:, 0] < high)].T
        rows.append(histogram(np.log2(n / full_points(d)) if len(d) else [], feature.edges))
    return np.array(rows)


def _intensity_by_class(scan):
    edges = BY_KEY["intensity_by_class"].edges
    if scan.labels is None:
        return np.zeros((len(LABELLED), len(edges) - 1), np.int64)
    return np.array([histogram(scan.points[np.isin(scan.labels, CLASSES[c]), 3], edges)
                     for c in LABELLED])


def class_shares(scan):
    """Share of the points by class; None where there are no labels."""
    if scan.labels is None:
        return None
    shares = {name: float(np.isin(scan.labels, ids).mean()) for name, ids in CLASSES.items()}
    return shares | {"unlabelled": 1.0 - sum(shares.values())}


def measure(scan):
    """({feature key: counts, groups x bins}, facts about the scan) of one scan."""
    points = scan.points
    rings = find_rings(points)
    distance = np.linalg.norm(points[:, :3], axis=1)
    flat = np.hypot(points[:, 0], points[:, 1])
    height = height_above_ground(points, ground_grid(points))
    on_ground = np.abs(height) < GROUND_BAND_M
    above = (height >= GROUND_BAND_M) & (height < 12.0) & (flat > 3.0)
    spread, centre = plane_residual_spread(points[on_ground & (flat > 4.0) & (flat < 21.0), :3])
    off = np.hypot(centre[:, 0], centre[:, 1])
    edges = {key: feature.edges for key, feature in BY_KEY.items()}
    step, gap = _steps_and_gaps(rings)
    out = {
        "range": histogram(distance, edges["range"]),
        "ring": np.bincount(rings.ring, minlength=RING_COUNT)[:RING_COUNT],
        "no_return": _no_return(rings), "gap": gap, "azimuth_step": step,
        "ground_roughness": [histogram(1000 * spread[(off >= a) & (off < b)],
                                       edges["ground_roughness"]) for a, b in ((5, 10), (10, 20))],
        "ground_step": _ground_steps(points[on_ground]),
        "car_points": _car_points(scan),
        "intensity": [histogram(points[on_ground, 3], edges["intensity"]),
                      histogram(points[above, 3], edges["intensity"])],
        "intensity_by_class": _intensity_by_class(scan),
        "free_range": histogram(shapes.free_range(points[above], rings.azimuth_deg[above]),
                                edges["free_range"]),
    }
    extent, area = shapes.cluster_sizes(points[above & (flat < 40.0)])
    out["cluster_height"] = histogram(extent, edges["cluster_height"])
    out["cluster_area"] = histogram(area, edges["cluster_area"])
    for key, values in shapes.local_shapes(points, above, on_ground, flat).items():
        out[key] = [histogram(v, edges[key]) for v in values]
    out = {key: np.atleast_2d(np.asarray(value, np.int64)) for key, value in out.items()}
    facts = {"points": len(points), "shots": rings.shots, "nearest_m": float(distance.min()),
             "farthest_m": float(distance.max()), "ground_share": float(on_ground.mean()),
             "ring_elevation_deg": [round(float(e), 2) for e in rings.elevation_deg],
             "returns_per_ring": rings.returns[:RING_COUNT].tolist(), "notes": rings.notes}
    return out, facts
