"""Answers of `stillmap evaluate localization --csv` as columns.

A table is a dict of NumPy arrays of equal length: the columns of the program's CSV (NaN where it left them empty;
`status` and `reasons` as text), and what the sets add: `kind` (text).
"""

import csv

import numpy as np

import poses

ERRORS = ["error_x_m", "error_y_m", "error_z_m", "error_roll_rad", "error_pitch_rad", "error_yaw_rad"]
LEVELS = ["level_longitudinal_m", "level_lateral_m", "level_vertical_m", "level_yaw_rad"]
# The error that each level bounds.
BOUNDED = ["error_x_m", "error_y_m", "error_z_m", "error_yaw_rad"]
NUMBERS = ["scan", "trial", "prior_error_m", "prior_error_deg", *ERRORS, *LEVELS, "nees", "inlier_ratio", "cpu_ms",
           "wall_ms"]
TEXTS = ["status", "reasons"]


def read(file):
    with open(file, newline="") as stream:
        rows = list(csv.DictReader(stream))
    if not rows:
        raise ValueError(f"{file}: no answers")
    missing = [name for name in NUMBERS + TEXTS if name not in rows[0]]
    if missing:
        raise ValueError(f"{file}: no columns {', '.join(missing)}")
    table = {name: np.array([float(row[name] or "nan") for row in rows]) for name in NUMBERS}
    for name in TEXTS + (["kind"] if "kind" in rows[0] else []):
        table[name] = np.array([row[name] for row in rows])
    for name in LEVELS:
        table[name][np.isinf(table[name])] = np.nan
    return table


def write(file, table):
    part = file.with_suffix(".part")
    names = [*NUMBERS, *TEXTS, "kind"]
    with open(part, "w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(names)
        for i in range(len(table["status"])):
            writer.writerow([_cell(table[name][i]) for name in names])
    part.replace(file)


def _cell(value):
    if isinstance(value, str):
        return value
    return "" if np.isnan(value) else f"{value:.9g}"


def joined(tables):
    return {name: np.concatenate([table[name] for table in tables]) for name in tables[0]}


def of_kind(table, kind):
    return {**table, "kind": np.full(len(table["status"]), kind)}


def where(table, mask):
    return {name: column[mask] for name, column in table.items()}


def refer_to(table, T_map_reference, T_map_lidar):
    """Errors against `T_map_lidar` instead of `T_map_reference` (N x 4 x 4, by scan), in place.

    The squared error in units of the covariance cannot be carried over, and is emptied.
    """
    T_lidar_reference = np.linalg.inv(T_map_lidar) @ T_map_reference
    for i, scan in enumerate(table["scan"].astype(int)):
        error = np.array([table[name][i] for name in ERRORS])
        if np.isnan(error).any():
            continue
        error = poses.log_se3(T_lidar_reference[scan] @ poses.exp_se3(error))
        for name, value in zip(ERRORS, error):
            table[name][i] = value
    table["nees"][:] = np.nan


def without_truth(table):
    """For scans that have no pose in the map."""
    empty = np.full(len(table["status"]), np.nan)
    return {**table, **{name: empty for name in [*ERRORS, "nees"]}}


def errors_of(table):
    """Distance [m] and turn [deg] of each answer."""
    e = np.stack([table[name] for name in ERRORS])
    return np.linalg.norm(e[:3], axis=0), np.degrees(np.linalg.norm(e[3:], axis=0))
