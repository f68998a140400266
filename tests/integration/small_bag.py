"""A drive in KITTI odometry layout as a ROS 2 bag (rosbag2, SQLite), and a scan of it as PCD, by Python's standard library."""

import math
import pathlib
import sqlite3
import struct

CLOUD, ODOMETRY = "sensor_msgs/msg/PointCloud2", "nav_msgs/msg/Odometry"
EPOCH_NS = 1_700_000_000 * 10**9


class Cdr:
    """Little-endian XCDR1: a value begins at a multiple of its size."""

    def __init__(self):
        self.body = bytearray()

    def put(self, kind, *values):
        for value in values:
            self.body += bytes(-len(self.body) % struct.calcsize(kind)) + struct.pack("<" + kind, value)

    def text(self, value):
        self.put("I", len(value) + 1)
        self.body += value.encode() + b"\0"

    def header(self, stamp_ns, frame):
        self.put("I", stamp_ns // 10**9, stamp_ns % 10**9)
        self.text(frame)

    def message(self):
        return b"\0\1\0\0" + bytes(self.body)


def cloud(stamp_ns, points):
    cdr = Cdr()
    cdr.header(stamp_ns, "lidar")
    cdr.put("I", 1, len(points) // 16, 4)
    for i, name in enumerate(("x", "y", "z", "intensity")):
        cdr.text(name)
        cdr.put("I", 4 * i)
        cdr.put("B", 7)
        cdr.put("I", 1)
    cdr.put("B", 0)
    cdr.put("I", 16, len(points), len(points))
    cdr.body += points
    cdr.put("B", 1)
    return cdr.message()


def odometry(stamp_ns, position, quaternion):
    cdr = Cdr()
    cdr.header(stamp_ns, "odom")
    cdr.text("lidar")
    cdr.put("d", *position, *quaternion, *[0.0] * 78)
    return cdr.message()


def product(a, b):
    """Of two rigid motions, 12 numbers row by row."""
    columns = [[b[4 * k + j] for k in range(3)] for j in range(4)]
    return [sum(a[4 * i + k] * columns[j][k] for k in range(3)) + (a[4 * i + 3] if j == 3 else 0)
            for i in range(3) for j in range(4)]


def inverse(a):
    turned = [a[4 * j + i] for i in range(3) for j in range(3)]
    shift = [-sum(turned[3 * i + k] * a[4 * k + 3] for k in range(3)) for i in range(3)]
    return [*turned[0:3], shift[0], *turned[3:6], shift[1], *turned[6:9], shift[2]]


def quaternion(m):
    """x y z w of a rotation of less than half a turn."""
    w = math.sqrt(max(0.0, 1 + m[0] + m[5] + m[10])) / 2
    return (m[9] - m[6]) / (4 * w), (m[2] - m[8]) / (4 * w), (m[4] - m[1]) / (4 * w), w


def write_bag(drive, folder):
    """Scans as /points, T_first_lidar of each as /odom."""
    drive, folder = pathlib.Path(drive), pathlib.Path(folder)
    folder.mkdir()
    camera_lidar = next([float(x) for x in line.split()[1:]]
                        for line in (drive / "calib.txt").read_text().splitlines() if line.startswith("Tr"))
    poses = [[float(x) for x in line.split()] for line in (drive / "poses.txt").read_text().splitlines()]
    stamps = [EPOCH_NS + round(float(line) * 1e9) for line in (drive / "times.txt").read_text().splitlines()]
    bag = sqlite3.connect(folder / "bag.db3")
    bag.executescript(
        "CREATE TABLE topics(id INTEGER PRIMARY KEY,name TEXT NOT NULL,type TEXT NOT NULL,serialization_format TEXT NOT "
        "NULL,offered_qos_profiles TEXT NOT NULL);"
        "CREATE TABLE messages(id INTEGER PRIMARY KEY,topic_id INTEGER NOT NULL,timestamp INTEGER NOT NULL,data BLOB NOT "
        "NULL);")
    bag.executemany("INSERT INTO topics VALUES (?, ?, ?, 'cdr', '')", [(1, "/points", CLOUD), (2, "/odom", ODOMETRY)])
    scans = sorted((drive / "velodyne").glob("*.bin"))
    for scan, stamp_ns, pose in zip(scans, stamps, poses, strict=True):
        lidar = product(inverse(camera_lidar), product(pose, camera_lidar))
        for topic, data in ((2, odometry(stamp_ns, lidar[3::4], quaternion(lidar))), (1, cloud(stamp_ns, scan.read_bytes()))):
            bag.execute("INSERT INTO messages (topic_id, timestamp, data) VALUES (?, ?, ?)", (topic, stamp_ns, data))
    bag.commit()
    bag.close()


def write_pcd(scan, file):
    points = pathlib.Path(scan).read_bytes()
    count = len(points) // 16
    head = (f"VERSION 0.7\nFIELDS x y z intensity\nSIZE 4 4 4 4\nTYPE F F F F\nCOUNT 1 1 1 1\nWIDTH {count}\nHEIGHT 1\n"
            f"VIEWPOINT 0 0 0 1 0 0 0\nPOINTS {count}\nDATA binary\n")
    pathlib.Path(file).write_bytes(head.encode() + points)
