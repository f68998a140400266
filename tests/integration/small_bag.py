"""A drive in KITTI odometry layout as a ROS 2 bag (rosbag2, SQLite), and a scan of it as PCD, by Python's standard library.

usage: small_bag.py bag DRIVE FOLDER    a bag with a second topic of clouds in a new folder
       small_bag.py messages DRIVE      its messages on standard output, for a writer of bags in another language"""

import json
import math
import pathlib
import sqlite3
import struct
import sys

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


def messages(drive, rear=False):
    """(topic, stamp [ns], bytes) of a drive: scans as /points, T_first_lidar of each as /odom.

    With `rear` also /rear: of each scan 1,000 points, as if a second lidar had seen them."""
    drive = pathlib.Path(drive)
    camera_lidar = next([float(x) for x in line.split()[1:]]
                        for line in (drive / "calib.txt").read_text().splitlines() if line.startswith("Tr"))
    poses = [[float(x) for x in line.split()] for line in (drive / "poses.txt").read_text().splitlines()]
    stamps = [EPOCH_NS + round(float(line) * 1e9) for line in (drive / "times.txt").read_text().splitlines()]
    scans = sorted((drive / "velodyne").glob("*.bin"))
    for scan, stamp_ns, pose in zip(scans, stamps, poses, strict=True):
        lidar = product(inverse(camera_lidar), product(pose, camera_lidar))
        yield "/odom", stamp_ns, odometry(stamp_ns, lidar[3::4], quaternion(lidar))
        yield "/points", stamp_ns, cloud(stamp_ns, scan.read_bytes())
        if rear:
            yield "/rear", stamp_ns, cloud(stamp_ns, scan.read_bytes()[:16_000])


def write_bag(drive, folder, rear=False):
    """A bag of `messages` in a folder that does not exist yet."""
    folder = pathlib.Path(folder)
    folder.mkdir()
    bag = sqlite3.connect(folder / "bag.db3")
    bag.executescript(
        "CREATE TABLE topics(id INTEGER PRIMARY KEY,name TEXT NOT NULL,type TEXT NOT NULL,serialization_format TEXT NOT "
        "NULL,offered_qos_profiles TEXT NOT NULL);"
        "CREATE TABLE messages(id INTEGER PRIMARY KEY,topic_id INTEGER NOT NULL,timestamp INTEGER NOT NULL,data BLOB NOT "
        "NULL);")
    topics = {"/points": 1, "/odom": 2, **({"/rear": 3} if rear else {})}
    bag.executemany("INSERT INTO topics VALUES (?, ?, ?, 'cdr', '')",
                    [(number, name, ODOMETRY if name == "/odom" else CLOUD) for name, number in topics.items()])
    for topic, stamp_ns, data in messages(drive, rear):
        bag.execute("INSERT INTO messages (topic_id, timestamp, data) VALUES (?, ?, ?)", (topics[topic], stamp_ns, data))
    bag.commit()
    bag.close()


def write_messages(drive, out):
    """For a writer in another language: a line of JSON with topic, type, log_ns and bytes, then so many bytes."""
    for topic, stamp_ns, data in messages(drive, rear=True):
        line = {"topic": topic, "type": ODOMETRY if topic == "/odom" else CLOUD, "log_ns": str(stamp_ns), "bytes": len(data)}
        out.write(json.dumps(line).encode() + b"\n" + data)


def write_pcd(scan, file):
    points = pathlib.Path(scan).read_bytes()
    count = len(points) // 16
    head = (f"VERSION 0.7\nFIELDS x y z intensity\nSIZE 4 4 4 4\nTYPE F F F F\nCOUNT 1 1 1 1\nWIDTH {count}\nHEIGHT 1\n"
            f"VIEWPOINT 0 0 0 1 0 0 0\nPOINTS {count}\nDATA binary\n")
    pathlib.Path(file).write_bytes(head.encode() + points)


if __name__ == "__main__":
    if sys.argv[1] == "messages":
        write_messages(sys.argv[2], sys.stdout.buffer)
    else:
        write_bag(sys.argv[2], sys.argv[3], rear=True)
