#!/usr/bin/env python3
"""Streams scans of a drive to a running stillmap server and prints how far the answers are from the truth.

The drive is a folder in KITTI odometry layout (velodyne/*.bin, calib.txt, poses.txt), as `stillmap simulate` writes
it. Each scan is sent as raw float32 x y z intensity with a prior that is wrong on purpose: exactly the given distance
in a random horizontal direction and a tenth of it up or down, exactly the given angle of yaw and a tenth of it of
roll and pitch.
"""

import argparse
import math
import pathlib
import random
import statistics
import sys
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "clients/python/src"))

from stillmap_client import Client, Pose, Prior, StillmapError  # noqa: E402


def multiply(a, b):
    return [[sum(a[i][k] * b[k][j] for k in range(4)) for j in range(4)] for i in range(4)]


def inverse(t):
    r = [[t[j][i] for j in range(3)] for i in range(3)]
    p = [-sum(r[i][k] * t[k][3] for k in range(3)) for i in range(3)]
    return [r[0] + [p[0]], r[1] + [p[1]], r[2] + [p[2]], [0.0, 0.0, 0.0, 1.0]]


def from_12(numbers):
    return [numbers[0:4], numbers[4:8], numbers[8:12], [0.0, 0.0, 0.0, 1.0]]


def from_euler(roll, pitch, yaw, translation):
    """Rotation Rz(yaw) Ry(pitch) Rx(roll)."""
    cr, sr, cp, sp, cy, sy = (f(a) for a in (roll, pitch, yaw) for f in (math.cos, math.sin))
    return [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr, translation[0]],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr, translation[1]],
        [-sp, cp * sr, cp * cr, translation[2]],
        [0.0, 0.0, 0.0, 1.0],
    ]


def quaternion(t):
    """[x, y, z, w] of a rotation matrix (Shepperd: the largest component first)."""
    trace = t[0][0] + t[1][1] + t[2][2]
    candidates = [t[0][0], t[1][1], t[2][2], trace]
    i = candidates.index(max(candidates))
    if i == 3:
        q = [t[2][1] - t[1][2], t[0][2] - t[2][0], t[1][0] - t[0][1], 1.0 + trace]
    else:
        j, k = (i + 1) % 3, (i + 2) % 3
        q = [0.0] * 4
        q[i] = 1.0 - trace + 2.0 * t[i][i]
        q[j] = t[j][i] + t[i][j]
        q[k] = t[k][i] + t[i][k]
        q[3] = t[k][j] - t[j][k]
    norm = math.sqrt(sum(x * x for x in q))
    return [x / norm for x in q]


def rotation_of(q):
    x, y, z, w = q
    return [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]


def numbers_of(file, name):
    for line in file.read_text().splitlines():
        key, _, rest = line.partition(":")
        if key == name:
            return [float(x) for x in rest.split()]
    sys.exit(f"{file}: found no line '{name}:', expected one")


def true_poses(drive):
    """T_map_lidar of every scan: KITTI's poses are of the camera, calib.txt takes lidar points to it."""
    T_cam_lidar = from_12(numbers_of(drive / "calib.txt", "Tr"))
    T_lidar_cam = inverse(T_cam_lidar)
    lines = (drive / "poses.txt").read_text().splitlines()
    return [multiply(multiply(T_lidar_cam, from_12([float(x) for x in line.split()])), T_cam_lidar) for line in lines]


def wrong_prior(T_map_lidar, metres, degrees, draw):
    direction, angle = draw.uniform(-math.pi, math.pi), math.radians(degrees)
    sign = lambda: draw.choice((-1.0, 1.0))
    turned = multiply(T_map_lidar, from_euler(0.1 * angle * sign(), 0.1 * angle * sign(), angle * sign(), [0.0] * 3))
    turned[0][3] += metres * math.cos(direction)
    turned[1][3] += metres * math.sin(direction)
    turned[2][3] += 0.1 * metres * sign()
    return turned


def ask(client, map_name, scan, T_prior):
    qx, qy, qz, qw = quaternion(T_prior)
    prior = Prior(Pose((T_prior[0][3], T_prior[1][3], T_prior[2][3]), (qx, qy, qz, qw)))
    began = time.perf_counter()
    try:
        answer = client.localize(map_name, scan, prior)
    except StillmapError as error:
        sys.exit(f"the server: {error}")
    return answer, 1e3 * (time.perf_counter() - began)


def error_of(answer, T_map_lidar):
    """Distance [m] and angle [deg] between the answer and the truth; infinite when the scan is lost."""
    if answer.pose is None:
        return math.inf, math.inf
    position, R = answer.pose.position, rotation_of(answer.pose.quaternion)
    distance = math.dist(position, [T_map_lidar[i][3] for i in range(3)])
    trace = sum(R[i][j] * T_map_lidar[i][j] for i in range(3) for j in range(3))
    return distance, math.degrees(math.acos(max(-1.0, min(1.0, (trace - 1.0) / 2.0))))


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("server", help="for example http://127.0.0.1:8080")
    parser.add_argument("map")
    parser.add_argument("drive", type=pathlib.Path)
    parser.add_argument("--select", default="::1", help="a:b:step of the scans")
    parser.add_argument("--prior-error", default="1,5", help="METRES,DEGREES")
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()

    metres, degrees = (float(x) for x in arguments.prior_error.split(","))
    poses = true_poses(arguments.drive)
    chosen = range(len(poses))[slice(*(int(x) if x else None for x in arguments.select.split(":")))]
    draw = random.Random(arguments.seed)
    client = Client(arguments.server)

    print(f"{'scan':>5} {'status':>9} {'prior off by':>16} {'pose off by':>18} {'inliers':>8} {'round trip':>11}")
    errors, failed = [], 0
    for index in chosen:
        body = (arguments.drive / "velodyne" / f"{index:06d}.bin").read_bytes()
        prior = wrong_prior(poses[index], metres, degrees, draw)
        answer, milliseconds = ask(client, arguments.map, body, prior)
        distance, angle = error_of(answer, poses[index])
        failed += not (answer.status == "ok" and distance < 0.2 and angle < 1.0)
        errors.append(distance)
        print(f"{index:5d} {answer.status:>9} {metres:6.2f} m {degrees:5.1f} deg {100 * distance:7.1f} cm "
              f"{angle:5.2f} deg {100 * answer.inlier_ratio:6.0f} % {milliseconds:8.0f} ms", flush=True)
    print(f"{len(errors)} scans, median error {100 * statistics.median(errors):.1f} cm, "
          f"{failed} not ok within 0.2 m and 1 deg")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
