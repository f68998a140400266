#!/usr/bin/env python3
"""How far a vehicle slides to its side, as a path has it: a car goes where it points, so the share is small and steady, that of a
sensor that is turned on its mount.

usage: path_slip.py PATH.tum [PATH.tum ...]     prints least, median and most sideways metres per forward metre over 5 m of way
"""

import sys

STEP_M = 5.0


def read(file):
    poses = []
    with open(file, encoding="utf-8") as lines:
        for line in lines:
            if line.strip() and not line.startswith("#"):
                poses.append([float(word) for word in line.split()][1:])
    return poses


def in_frame_of(pose, v):
    """v of the map frame in the lidar frame of a pose (x y z qx qy qz qw)."""
    x, y, z, w = -pose[3], -pose[4], -pose[5], pose[6]
    cross = [y * v[2] - z * v[1], z * v[0] - x * v[2], x * v[1] - y * v[0]]
    again = [y * cross[2] - z * cross[1], z * cross[0] - x * cross[2], x * cross[1] - y * cross[0]]
    return [v[i] + 2 * (w * cross[i] + again[i]) for i in range(3)]


def slips(poses):
    """Sideways per forward metre of every stretch of 5 m, seen from the pose in its middle; to the left positive."""
    way = [0.0]
    for a, b in zip(poses, poses[1:]):
        way.append(way[-1] + sum((b[i] - a[i]) ** 2 for i in range(3)) ** 0.5)
    shares = []
    for first in range(len(poses)):
        last = next((j for j in range(first, len(poses)) if way[j] >= way[first] + STEP_M), None)
        if last is None:
            break
        ahead = in_frame_of(poses[(first + last) // 2], [poses[last][i] - poses[first][i] for i in range(3)])
        shares.append(ahead[1] / ahead[0])
    return sorted(shares), way[-1]


def main():
    for file in sys.argv[1:]:
        shares, length = slips(read(file))
        print(f"{file}: {100 * shares[0]:.2f}, {100 * shares[len(shares) // 2]:.2f}, {100 * shares[-1]:.2f} %, {length:.2f} m")


if __name__ == "__main__":
    main()
