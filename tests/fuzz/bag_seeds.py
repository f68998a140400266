"""Small whole inputs of `ros_message`, `mcap`, `rosbag1`, `rosbag2`, `pcap`, `bag_choice` and `rawlog`, packed by the tools lz4 and
zstd. For seeds.py."""

import bz2
import pathlib
import sqlite3
import struct
import subprocess
import tempfile
import zlib

START_S = 1_700_000_000
CLOUD, ODOMETRY, POSE, TF, FIX = ("sensor_msgs/msg/PointCloud2", "nav_msgs/msg/Odometry", "geometry_msgs/msg/PoseStamped",
                                  "tf2_msgs/msg/TFMessage", "sensor_msgs/msg/NavSatFix")
FIXES = "/fix"  # which the targets ask for


class Message:
    """Values one after the other: CDR in both byte orders, or ROS 1."""

    def __init__(self, order="<", ros1=False):
        self.order, self.ros1 = order, ros1
        self.bytes = b"" if ros1 else (b"\0\1\0\0" if order == "<" else b"\0\0\0\0")

    def put(self, kind, *values):
        for value in values:
            size = struct.calcsize(kind)
            if not self.ros1:
                self.bytes += bytes(-(len(self.bytes) - 4) % size)
            self.bytes += struct.pack(self.order + kind, value)
        return self

    def text(self, letters):
        letters = letters.encode() + (b"" if self.ros1 else b"\0")
        self.put("I", len(letters)).bytes += letters
        return self

    def header(self, tenths, frame):
        if self.ros1:
            self.put("I", 7)
        return self.put("I", START_S + tenths // 10, tenths % 10 * 100_000_000).text(frame)


def cloud(tenths, order="<", ros1=False, frame="lidar"):
    message = Message(order, ros1).header(tenths, frame).put("I", 1, 3, 5)
    for name, offset, kind in (("x", 0, 7), ("y", 4, 7), ("z", 8, 7), ("intensity", 12, 2), ("t", 16, 6)):
        message.text(name).put("I", offset).put("B", kind).put("I", 1)
    points = b"".join(struct.pack(order + "3fB3xI", i, 1.5, -2, 9, 1000 * i) for i in range(3))
    message.put("B", order == ">").put("I", 20, 60, len(points)).bytes += points
    return message.put("B", 1).bytes


def livox(tenths, ros1=False):
    message = Message(ros1=ros1).header(tenths, "livox").put("Q", (START_S * 10 + tenths) * 10**8).put("I", 3)
    message.put("B", 1, 0, 0, 0).put("I", 3)
    for i in range(3):
        message.put("I", 1000 * i).put("f", i, 1.5, -2).put("B", 9, 16 * i, i)
    return message.bytes


OUSTER_METADATA = (b'{"beam_intrinsics": {"beam_altitude_angles": [10, 0], "beam_azimuth_angles": [3, -3], "beam_to_lidar_transform": '
                   b'[1, 0, 0, 15.8, 0, 1, 0, 0, 0, 0, 1, 2, 0, 0, 0, 1]}, "lidar_intrinsics": {"lidar_to_sensor_transform": '
                   b'[-1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1, 36.2, 0, 0, 0, 1]}, "lidar_data_format": {"columns_per_frame": 1024, '
                   b'"columns_per_packet": 16, "pixels_per_column": 2, "udp_profile_lidar": "RNG15_RFL8_NIR8"}}')


def ouster(size, ros1=False):
    """A packet whose columns are valid and whose pixels differ."""
    packet = bytearray(i % 251 for i in range(size))
    for i in range(2):
        if ros1:
            packet[size // 2 * (i + 1) - 4:size // 2 * (i + 1)] = b"\xff" * 4
        else:
            packet[32 + i * 44 + 10] = 1
    return Message(ros1=ros1).put("I", size).bytes + bytes(packet)


def velodyne(tenths, factory, flags=(0xeeff,)):
    message = Message(ros1=True).header(tenths, "velodyne").put("I", 1, START_S, tenths * 10**8)
    for block in range(12):
        message.put("H", flags[block % len(flags)], 40 * block)
        for laser in range(32):
            message.put("H", 500 * laser).put("B", laser)
    return message.put("I", 0).put("B", 0x37, factory).bytes


def pose(tenths, odometry=True, order="<", x_m=None):
    message = Message(order).header(tenths, "odom")
    if odometry:
        message.text("base_link")
    message.put("d", 0.1 * tenths if x_m is None else x_m, 2, 3, 0, 0, 0.6, 0.8)
    return message.bytes if not odometry else message.put("d", *[0.0] * 78).bytes


def fix(tenths, order="<", east_m=0.0):
    message = Message(order).header(tenths, "gps").put("b", 0).put("H", 1).put("d", 48.1, 11.5 + east_m / 74_300, 519)
    return message.put("d", *[0.0] * 9).put("B", 0).bytes


def imu(tenths, ros1=False):
    return Message(ros1=ros1).header(tenths, "imu").put("d", *[0.0] * 13, 0.1, 0.2, 0.3, *[0.0] * 9, 0, 0, 9.8, *[0.0] * 9).bytes


def tf(tenths, parent, child, ros1=False):
    return Message(ros1=ros1).put("I", 1).header(tenths, parent).text(child).put("d", 0, 0, 1.5, 0, 0, 0, 1).bytes


MESSAGES = [("/tf_static", TF, tf(0, "base_link", "lidar"))]
for TENTHS in range(3):
    MESSAGES += [("/points", CLOUD, cloud(TENTHS)), ("/odom", ODOMETRY, pose(TENTHS))]
OF_TF = [(topic, kind, data) for topic, kind, data in MESSAGES if kind != ODOMETRY]
OF_TF += [("/tf", TF, tf(tenths, "map", "base_link")) for tenths in range(3)]

PLACED = [("/points", CLOUD, cloud(0)), ("/points", CLOUD, cloud(10))]
PLACED += [("/pose", POSE, pose(tenths, False, x_m=4.0 * tenths)) for tenths in (0, 10)]
PLACED += [(FIXES, FIX, fix(tenths, east_m=4.0 * tenths)) for tenths in range(11)]


OF_ROS1 = [("/points", CLOUD, cloud(tenths, ros1=True)) for tenths in range(3)]
OF_ROS1 += [("/tf", TF, tf(tenths, "/map", "/lidar", True)) for tenths in range(3)]


def record(op, content):
    return struct.pack("<BQ", op, len(content)) + content


def text(letters):
    return struct.pack("<I", len(letters)) + letters.encode()


def packed(data, compression):
    return subprocess.run([compression, "-c", "-q"], input=data, capture_output=True, check=True).stdout if compression else data


def mcap(messages, compression=None, index=True, chunks=True, encoding="cdr"):
    topics = sorted({(topic, kind) for topic, kind, _ in messages})
    names = b"".join(record(3, struct.pack("<H", i + 1) + text(kind) + text("ros2msg") + text("")) +
                     record(4, struct.pack("<HH", i + 1, i + 1) + text(topic) + text(encoding) + text(""))
                     for i, (topic, kind) in enumerate(topics))
    file, indexes, records = b"\x89MCAP0\r\n" + record(1, text("ros2") + text("seed")), b"", [names]
    records += [record(5, struct.pack("<HIQQ", topics.index((topic, kind)) + 1, 0, 1, 1) + data)
                for topic, kind, data in messages]
    if not chunks:
        file += b"".join(records)
    for part in ((records[:4], records[4:]) if chunks else ()):
        part = b"".join(part)
        body = packed(part, compression)
        chunk = record(6, struct.pack("<QQQI", 1, 1, len(part), zlib.crc32(part)) + text(compression or "") +
                       struct.pack("<Q", len(body)) + body)
        indexes += record(8, struct.pack("<QQQQIQ", 1, 1, len(file), len(chunk), 0, 0) + text(compression or "") +
                          struct.pack("<QQ", len(body), len(part)))
        file += chunk
    file += record(15, bytes(4))
    summary = names + indexes if index else b""
    footer = struct.pack("<BQQQ", 2, 20, len(file) if index else 0, 0)
    return file + summary + footer + struct.pack("<I", zlib.crc32(summary + footer) if index else 0) + b"\x89MCAP0\r\n"


def fields(**values):
    parts = [name.encode() + b"=" + value for name, value in values.items()]
    return b"".join(struct.pack("<I", len(part)) + part for part in parts)


def ros1_record(op, header, data):
    header = fields(op=bytes([op])) + header
    return struct.pack("<I", len(header)) + header + struct.pack("<I", len(data)) + data


def rosbag1(messages, compression="none", index=True):
    """Format 2.0, with the padding of its header left out, so that a seed is small."""
    messages = [((topic, kind.replace("/msg/", "/")), data) for topic, kind, data in messages]
    topics = sorted({topic for topic, _ in messages})
    connections = b"".join(
        ros1_record(7, fields(conn=struct.pack("<I", i), topic=topic.encode()),
                    fields(topic=topic.encode(), type=kind.encode(), md5sum=b"*", message_definition=b""))
        for i, (topic, kind) in enumerate(topics))
    records = [ros1_record(2, fields(conn=struct.pack("<I", topics.index(topic)), time=bytes(8)), data)
               for topic, data in messages]
    empty = ros1_record(3, fields(index_pos=bytes(8), conn_count=bytes(4), chunk_count=bytes(4)), b"")
    start = len(b"#ROSBAG V2.0\n") + len(empty)
    body, infos = b"", b""
    for part in (connections + b"".join(records[:3]), b"".join(records[3:])):
        data = bz2.compress(part) if compression == "bz2" else packed(part, None if compression == "none" else compression)
        infos += ros1_record(6, fields(ver=struct.pack("<I", 1), chunk_pos=struct.pack("<Q", start + len(body)),
                                       start_time=bytes(8), end_time=bytes(8), count=struct.pack("<I", len(topics))),
                             b"".join(struct.pack("<II", i, 1) for i in range(len(topics))))
        body += ros1_record(5, fields(compression=compression.encode(), size=struct.pack("<I", len(part))), data)
    header = ros1_record(3, fields(index_pos=struct.pack("<Q", start + len(body) if index else 0),
                                   conn_count=struct.pack("<I", len(topics)), chunk_count=struct.pack("<I", 2)), b"")
    return b"#ROSBAG V2.0\n" + header + body + (connections + infos if index else b"")


def rosbag2(messages, compression=None):
    with tempfile.TemporaryDirectory() as folder:
        file = pathlib.Path(folder) / "bag.db3"
        bag = sqlite3.connect(file)
        bag.executescript("PRAGMA page_size=512; CREATE TABLE topics(id INTEGER PRIMARY KEY,name,type,serialization_format);"
                          "CREATE TABLE messages(id INTEGER PRIMARY KEY,topic_id,timestamp,data);")
        topics = sorted({(topic, kind) for topic, kind, _ in messages})
        bag.executemany("INSERT INTO topics VALUES (?, ?, ?, 'cdr')", [(i + 1, *topic) for i, topic in enumerate(topics)])
        bag.executemany("INSERT INTO messages (topic_id, timestamp, data) VALUES (?, 1, ?)",
                        [(topics.index((topic, kind)) + 1, packed(data, compression)) for topic, kind, data in messages])
        bag.commit()
        bag.close()
        return file.read_bytes()


def data_packet(azimuth, source):
    """From 10.0.0.SOURCE, on raw IP."""
    data = b"".join(struct.pack("<HH", 0xeeff, azimuth + 20 * i) + struct.pack("<HB", 500 + i, i) * 32 for i in range(12))
    udp = struct.pack(">HHHH", 2368, 2368, 1214, 0) + data + struct.pack("<IBB", 0, 0x37, 0x22)
    return struct.pack(">BBHHHBBHII", 0x45, 0, len(udp) + 20, 1, 0, 64, 17, 0, 0x0a000000 + source, 0xffffffff) + udp


def pcap(packets, order="<", magic=0xa1b2c3d4):
    """@param packets: (tenths, azimuth, source) each."""
    file = struct.pack(order + "IHHiIII", magic, 2, 4, 0, 0, 262144, 101)
    for tenths, azimuth, source in packets:
        data = data_packet(azimuth, source)
        file += struct.pack(order + "IIII", START_S, tenths * 100_000, len(data), len(data)) + data
    return file


def pcapng(packets, order="<"):
    def block(kind, body):
        return struct.pack(order + "II", kind, len(body) + 12) + body + struct.pack(order + "I", len(body) + 12)

    file = block(0x0a0d0d0a, struct.pack(order + "IHHq", 0x1a2b3c4d, 1, 0, -1))
    file += block(1, struct.pack(order + "HHI", 101, 0, 0) + struct.pack(order + "HHB3xHHqHH", 9, 1, 3, 14, 8, START_S, 0, 0))
    for tenths, azimuth, source in packets:
        data = data_packet(azimuth, source)
        file += block(6, struct.pack(order + "IIIII", 0, 0, tenths * 100, len(data), len(data)) + data + bytes(-len(data) % 4))
    return file


def rawlog_record(kind, stamp_ns=0, text=b"", points=(), flags=0, objects=0, unusable=0):
    """As maps/src/rawlogs/rawlog_record.hpp has it."""
    identity = [1.0, 0, 0, 0.5, 0, 1.0, 0, 0, 0, 0, 1.0, 0]
    head = struct.pack("<IIq12dIIQQ", kind, len(text), stamp_ns, *identity, len(points), flags, objects, unusable)
    return head + text + b"".join(struct.pack("<5f", *point) for point in points)


def make_all(put):
    scan = rawlog_record(1, 1_561_000_444_000_000_000, b"lidar", [(1, 2, 3, 0.5, 0.01), (4, 5, 6, 0.7, 0.02)], 3)
    robot = rawlog_record(2, 1_561_000_444_000_000_000, flags=2)
    put("rawlog", "whole", scan + robot + rawlog_record(3, objects=2, unusable=1))
    put("rawlog", "broken_off", robot + scan + rawlog_record(3, text=b"no such class"))
    put("rawlog", "cut", scan + robot)
    put("ros_message", "cloud", b"\0" + cloud(0))
    put("ros_message", "cloud_big_endian", b"\0" + cloud(0, ">"))
    put("ros_message", "cloud_ros1", b"\1" + cloud(0, ros1=True))
    put("ros_message", "odometry", b"\2" + pose(0))
    put("ros_message", "pose", b"\4" + pose(0, False, ">"))
    put("ros_message", "tf", b"\6" + tf(0, "map", "base_link"))
    put("ros_message", "fix", b"\10" + fix(0))
    put("ros_message", "imu", b"\16" + imu(0))
    put("ros_message", "imu_ros1", b"\17" + imu(0, ros1=True))
    put("ros_message", "livox", b"\12" + livox(0))
    put("ros_message", "livox_ros1", b"\13" + livox(0, ros1=True))
    put("ros_message", "velodyne_ros1", b"\15" + velodyne(0, 0x22))
    put("ros_message", "ouster_dual", b"\20" + ouster(2 * (12 + 2 * 16) + 64))
    put("ros_message", "ouster_legacy_ros1", b"\21" + ouster(2 * (16 + 2 * 12 + 4), ros1=True))
    put("ros_message", "ouster_metadata", b"\22" + OUSTER_METADATA)
    put("ros_message", "velodyne_two_banks_ros1", b"\15" + velodyne(0, 0x56, (0xeeff, 0xddff)))
    put("ros_message", "tf_ros1", b"\7" + tf(0, "/map", "/base_link", True))
    for compression in (None, "lz4", "zstd"):
        put("mcap", f"indexed_{compression}", mcap(MESSAGES, compression))
    put("mcap", "plain_chunks", mcap(MESSAGES, index=False))
    put("mcap", "loose", mcap(MESSAGES, index=False, chunks=False))
    put("mcap", "tf", mcap(OF_TF, "zstd", index=False))
    put("mcap", "ros1", mcap([("/points", "sensor_msgs/PointCloud2", cloud(0, ros1=True))], encoding="ros1"))
    put("mcap", "placed", mcap(PLACED))
    put("mcap", "packed", packed(mcap(MESSAGES, index=False), "zstd"))
    put("mcap", "cut", mcap(MESSAGES, index=False)[:900])
    for compression in ("none", "lz4", "bz2"):
        put("rosbag1", f"indexed_{compression}", rosbag1(OF_ROS1, compression))
    put("rosbag1", "cut_off", rosbag1(OF_ROS1, "lz4", index=False)[:-40])
    few = [MESSAGES[0], ("/points", CLOUD, cloud(1)), *[("/pose", POSE, pose(tenths, False)) for tenths in (0, 2)]]
    put("rosbag2", "few", rosbag2(few))
    put("rosbag2", "tf", rosbag2(OF_TF))
    put("rosbag2", "placed", rosbag2(PLACED))
    put("rosbag2", "zstd", rosbag2(few, "zstd"))
    put("rosbag2", "cut", rosbag2(few)[:2000])
    put("pcap", "two_sensors", pcap([(0, 30_000, 1), (1, 100, 1), (2, 200, 2)]))
    put("pcap", "nanoseconds", pcap([(0, 100, 1), (1, 3_000, 1)], ">", 0xa1b23c4d))
    put("pcap", "cut", pcap([(0, 100, 1), (1, 3_000, 1)])[:-30])
    put("pcap", "pcapng", pcapng([(0, 30_000, 1), (1, 100, 1)]))
    put("pcap", "pcapng_big_endian", pcapng([(0, 30_000, 1), (1, 100, 1)], ">"))
    put("bag_choice", "words", "cloud=/points&poses=/odom&pose_frame=base_link")
    put("bag_choice", "lidars", '{"format": "stillmap-lidars", "version": 1, "lidars": [{"drive": "front"}, {"drive": '
        '"run.mcap?cloud=/rear", "time_offset_s": 0.01, "T_reference_lidar": {"position": [-2, 0, 0.5], "quaternion": '
        '[0, 0, 1, 0]}}]}')
    put("bag_choice", "words_gnss", "gnss=/fix")
    put("bag_choice", "metadata", "rosbag2_bagfile_information:\n  version: 4\n  relative_file_paths:\n    - run_0.db3\n"
        "    - \"../run_1.db3.zstd\"\n  compression_format: zstd\n")
