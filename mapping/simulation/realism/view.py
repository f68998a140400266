#!/usr/bin/env python3
"""A scan as a picture: from above, and from the driver's seat.

usage: view.py DRIVE SCAN [DRIVE SCAN ...] -o PNG [--reach METRES] [--by class|intensity|height]

One row a scan: on the left from above with the boxes of its objects, on the right through a camera
that looks ahead (KITTI's: 1242 x 375 pixels, 721 pixels focal length). SCAN counts from 0. Layouts
are those of scans.py. Colours are SemanticKITTI's classes where there are labels, else heights.
"""

import argparse
import pathlib
import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from features import CLASSES
from scans import read_streets

_BACKGROUND = "#101418"
_COLOURS = {
    "road": "#7d7f8c", "sidewalk": "#b58fa8", "other ground": "#9a8f78", "building": "#e8c65a",
    "fence": "#d98f4e", "vegetation": "#4fae54", "trunk": "#9a6b3f", "terrain": "#9fc46b",
    "pole": "#f4f0c9", "sign": "#ff5a4f", "car": "#5aa2ff", "other vehicle": "#3f6fe0",
    "two-wheeler": "#38d6d6", "person": "#ff7ad1", "other object": "#8ef0d0",
}
_MOVING = "#ff4fd8"
_UNKNOWN = "#dddddd"
_FOCAL, _MIDDLE, _SIZE = 721.5, (609.6, 172.9), (1242, 375)


def class_colours(labels):
    out = np.full((len(labels), 3), matplotlib.colors.to_rgb(_UNKNOWN))
    for name, ids in CLASSES.items():
        out[np.isin(labels, ids)] = matplotlib.colors.to_rgb(_COLOURS[name])
    out[labels >= 252] = matplotlib.colors.to_rgb(_MOVING)
    return out


def colours_of(scan, by):
    if by == "class" and scan.labels is not None:
        # Brighter where more light came back, so that shapes show within a class.
        shade = 0.55 + 0.45 * np.clip(scan.points[:, 3] / 0.5, 0.0, 1.0)
        return class_colours(scan.labels) * shade[:, None]
    values = (np.clip(scan.points[:, 3] / 0.6, 0, 1) if by == "intensity"
              else np.clip((scan.points[:, 2] + 2.0) / 6.0, 0.0, 1.0))
    return plt.get_cmap("turbo")(values)[:, :3]


def draw_above(axes, scan, colours, reach):
    order = np.argsort(scan.points[:, 2])
    axes.scatter(-scan.points[order, 1], scan.points[order, 0], s=0.35, c=colours[order], lw=0)
    for box in scan.boxes or []:
        c, s = np.cos(box.yaw), np.sin(box.yaw)
        l, w = box.size[0] / 2.0, box.size[1] / 2.0
        corners = np.array([(l, w), (l, -w), (-l, -w), (-l, w), (l, w), (l + 0.8, 0.0)])
        xy = box.centre[:2] + corners @ np.array([[c, s], [-s, c]])
        axes.plot(-xy[:5, 1], xy[:5, 0], color="white", lw=0.5, alpha=0.8)
    axes.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal")


def draw_ahead(axes, scan, colours):
    """Far points first, so that near ones hide them; their discs grow as gaps between rings do."""
    x, y, z = scan.points[:, 0], scan.points[:, 1], scan.points[:, 2]
    u = _MIDDLE[0] - _FOCAL * y / np.maximum(x, 0.1)
    v = _MIDDLE[1] - _FOCAL * (z + 0.08) / np.maximum(x, 0.1)
    seen = (x > 1.5) & (u > 0) & (u < _SIZE[0]) & (v > 0) & (v < _SIZE[1])
    order = np.flatnonzero(seen)[np.argsort(-x[seen])]
    sizes = np.clip(70.0 / x[order], 0.8, 9.0)
    axes.scatter(u[order], v[order], s=sizes, c=colours[order], lw=0)
    axes.set(xlim=(0, _SIZE[0]), ylim=(_SIZE[1], 90), aspect="equal")


def draw(scans, target, reach, by):
    figure, axes = plt.subplots(len(scans), 2, squeeze=False, facecolor=_BACKGROUND,
                                figsize=(15.0, 5.0 * len(scans)),
                                gridspec_kw={"width_ratios": [1.0, 2.0]})
    for row, scan in zip(axes, scans):
        colours = colours_of(scan, by)
        draw_above(row[0], scan, colours, reach)
        draw_ahead(row[1], scan, colours)
        for part in row:
            part.set_facecolor(_BACKGROUND)
            part.set_xticks([])
            part.set_yticks([])
            for spine in part.spines.values():
                spine.set_visible(False)
    figure.tight_layout(pad=0.3)
    figure.savefig(target, dpi=75, facecolor=_BACKGROUND)


def parsed(arguments):
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("scans", nargs="+", metavar="DRIVE SCAN")
    parser.add_argument("-o", "--output", required=True, type=pathlib.Path)
    parser.add_argument("--reach", type=float, default=40.0, help="from above, to each side [m]")
    parser.add_argument("--by", choices=("class", "intensity", "height"), default="class")
    options = parser.parse_args(arguments)
    if len(options.scans) % 2:
        parser.error("a scan is named by DRIVE and SCAN")
    return options


def main(arguments=None):
    options = parsed(arguments)
    try:
        chosen = []
        for folder, number in zip(options.scans[::2], options.scans[1::2]):
            streets = read_streets(folder)
            scans = [(street, i) for street in streets for i in range(len(street.files))]
            if not 0 <= int(number) < len(scans):
                raise ValueError(f"{folder}: found scan {number}, expected 0 to {len(scans) - 1}")
            street, i = scans[int(number)]
            chosen.append(street.scan(i))
        draw(chosen, options.output, options.reach, options.by)
    except (OSError, ValueError) as error:
        sys.exit(f"view.py: {error}")


if __name__ == "__main__":
    main()
