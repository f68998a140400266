"""bags_test.py STILLMAP COMPARE_DRIVES ORACLES: drives as bags that other programs wrote: @mcap/core, rosmsg2-serialization, lz4 and zstd
(tests/oracles), Debian's rosbag, and Python's sqlite3. What is in them, and the map made of them, is that of the same drive as a folder.
With STILLMAP_REAL_DATA also scans of real drives. Ends with 77 when npm's packages cannot be had."""

import base64
import calendar
import json
import math
import os
import pathlib
import random
import shutil
import sqlite3
import struct
import subprocess
import sys
import tempfile
import time
import unittest

PROGRAM, COMPARE, ORACLES = sys.argv[1], sys.argv[2], pathlib.Path(sys.argv[3])
REAL = os.environ.get("STILLMAP_REAL_DATA")
# Debian's modules, which another Python before it in the path does not see.
SYSTEM_PYTHON = "/usr/bin/python3"
HAVE_ROS1 = subprocess.run([SYSTEM_PYTHON, "-c", "import rosbag, roslz4, sensor_msgs, nav_msgs, tf2_msgs, geometry_msgs"],
                           capture_output=True).returncode == 0
CLOUD, ODOMETRY, POSE, TF, IMU, FIX = ("sensor_msgs/msg/PointCloud2", "nav_msgs/msg/Odometry", "geometry_msgs/msg/PoseStamped",
                                       "tf2_msgs/msg/TFMessage", "sensor_msgs/msg/Imu", "sensor_msgs/msg/NavSatFix")
PCD_TYPES = {("F", 4): 7, ("F", 8): 8, ("U", 1): 2, ("U", 2): 4, ("U", 4): 6, ("I", 1): 1, ("I", 2): 3, ("I", 4): 5}
# What tells a map from another; the sources have names and checksums of their own.
OF_THE_MAP = ("regions", "packs", "objects.json", "trajectory.tum", "fates.bin")


def run(*words, ok=True):
    done = subprocess.run([PROGRAM, *map(str, words)], capture_output=True, text=True)
    if ok and done.returncode != 0:
        raise AssertionError(f"{words}: {done.stderr}")
    return done


def stamp(ns):
    return {"sec": ns // 10**9, "nanosec": ns % 10**9}


def header(ns, frame):
    return {"stamp": stamp(ns), "frame_id": frame}


def cloud_fields(file):
    """Where the points of a scan begin in its file, and their columns."""
    if file.suffix == ".bin":
        return 0, file.stat().st_size // 16, [(name, 7, 4) for name in ("x", "y", "z", "intensity")]
    head, line = {}, b""
    with open(file, "rb") as stream:
        while not line.startswith(b"DATA"):
            line = stream.readline()
            head[line.split()[0].decode()] = line.decode().split()[1:]
        offset = stream.tell()
    assert head["DATA"] == ["binary"], file
    columns = [(name, PCD_TYPES[kind, int(size)], int(size))
               for name, kind, size in zip(head["FIELDS"], head["TYPE"], head["SIZE"])]
    return offset, int(head["POINTS"][0]), columns


def cloud(file, ns, frame="lidar"):
    start, points, columns = cloud_fields(file)
    fields, offset = [], 0
    for name, kind, size in columns:
        fields.append({"name": name, "offset": offset, "datatype": kind, "count": 1})
        offset += size
    return {"header": header(ns, frame), "height": 1, "width": points, "fields": fields, "is_bigendian": False,
            "point_step": offset, "row_step": offset * points, "is_dense": True,
            "data": {"file": str(file), "offset": start, "bytes": offset * points}}


def xyz(values):
    return dict(zip("xyz", values))


def pose(values):
    return {"position": xyz(values[:3]), "orientation": dict(zip("xyzw", values[3:]))}


def odometry(ns, values, child="lidar"):
    zeros = {"linear": xyz((0, 0, 0)), "angular": xyz((0, 0, 0))}
    return {"header": header(ns, "odom"), "child_frame_id": child, "pose": {"pose": pose(values), "covariance": [0] * 36},
            "twist": {"twist": zeros, "covariance": [0] * 36}}


def transform(ns, parent, child, values):
    return {"transforms": [{"header": header(ns, parent), "child_frame_id": child, "transform": {
        "translation": xyz(values[:3]), "rotation": dict(zip("xyzw", values[3:]))}}]}


def imu(ns):
    return {"header": header(ns, "imu"), "orientation": dict(zip("xyzw", (0, 0, 0, 1))),
            "orientation_covariance": [0] * 9, "angular_velocity": xyz((0, 0, 0)), "angular_velocity_covariance": [0] * 9,
            "linear_acceleration": xyz((0, 0, 9.81)), "linear_acceleration_covariance": [0] * 9}


def fix(ns, latitude_deg, longitude_deg, altitude_m):
    return {"header": header(ns, "imu"), "status": {"status": 2, "service": 1}, "latitude": latitude_deg,
            "longitude": longitude_deg, "altitude": altitude_m, "position_covariance": [0] * 9, "position_covariance_type": 0}


def east_north_up_m(origin, place):
    """Of a place (degrees, degrees, metres) some hundred metres away, by the radii of WGS 84."""
    latitude = math.radians(origin[0])
    w = math.sqrt(1 - 0.00669437999014 * math.sin(latitude) ** 2)
    east = 6378137 / w * math.cos(latitude) * math.radians(place[1] - origin[1])
    north = 6378137 * (1 - 0.00669437999014) / w ** 3 * math.radians(place[0] - origin[0])
    return east, north, place[2] - origin[2]


def turned(yaw, values):
    """A pose after a turn about z."""
    (x, y, z, qx, qy, qz, qw), c, s = values, math.cos(yaw / 2), math.sin(yaw / 2)
    return (x * math.cos(yaw) - y * math.sin(yaw), x * math.sin(yaw) + y * math.cos(yaw), z,
            c * qx - s * qy, c * qy + s * qx, c * qz + s * qw, c * qw - s * qz)


def stamp_ns(text):
    seconds, _, decimals = text.partition(".")
    return int(seconds) * 10**9 + int(decimals.ljust(9, "0"))


def vlp16_packets(scan, ns):
    """@return (stamp, data) of the packets of one turn, which has 1800 firings 0.2 deg apart."""
    start, count, columns = cloud_fields(scan)
    assert [name for name, _, _ in columns] == ["x", "y", "z", "intensity", "t", "ring"]
    data, returns = scan.read_bytes(), {}
    for i in range(count):
        x, y, z, intensity, _, ring = struct.unpack_from("<fffffH", data, start + 22 * i)
        laser = 2 * ring if ring < 8 else 2 * ring - 15
        firing = int(math.degrees(math.atan2(-y, x)) % 360 / 0.2) % 1800
        returns[firing, laser] = (min(round(math.hypot(x, y, z) / 0.002), 65535), round(255 * intensity))
    packets = []
    for first in range(0, 1800, 24):
        blocks = b"".join(struct.pack("<HH", 0xeeff, 20 * firing) +
                          b"".join(struct.pack("<HB", *returns.get((firing + i // 16, i % 16), (0, 0))) for i in range(32))
                          for firing in range(first, first + 24, 2))
        packets.append((ns + first * 55_000, blocks + struct.pack("<IBB", 0, 0x37, 0x22)))
    return packets


def ethernet(payload):
    """From 192.168.1.201 to all, with a VLAN tag."""
    udp = struct.pack(">HHHH", 2368, 2368, len(payload) + 8, 0) + payload
    ip = struct.pack(">BBHHHBBHII", 0x45, 0, len(udp) + 20, 1, 0x4000, 64, 17, 0, 0xc0a801c9, 0xffffffff) + udp
    return b"\xff" * 6 + b"\x60\x76\x88\0\0\1" + struct.pack(">HHH", 0x8100, 5, 0x0800) + ip


def pcap(packets, order="<", digits=6):
    file = struct.pack(order + "IHHiIII", 0xa1b2c3d4 if digits == 6 else 0xa1b23c4d, 2, 4, 0, 0, 262144, 1)
    for ns, payload in packets:
        data = ethernet(payload)
        file += struct.pack(order + "IIII", ns // 10**9, ns % 10**9 // 10**(9 - digits), len(data), len(data)) + data
    return file


def pcapng(packets):
    def block(kind, body):
        body += bytes(-len(body) % 4)
        return struct.pack("<II", kind, len(body) + 12) + body + struct.pack("<I", len(body) + 12)

    file = block(0x0a0d0d0a, struct.pack("<IHHq", 0x1a2b3c4d, 1, 0, -1))
    file += block(1, struct.pack("<HHI", 1, 0, 0) + struct.pack("<HHB3xHH", 9, 1, 9, 0, 0))
    for ns, payload in packets:
        data = ethernet(payload)
        file += block(6, struct.pack("<IIIII", 0, ns >> 32, ns & 0xffffffff, len(data), len(data)) + data)
    return file


class Drive:
    """A folder of scans with a line of TUM each: what all bags here are made of, and compared with."""

    def __init__(self, folder, scans, poses):
        self.folder = folder
        self.folder.mkdir(parents=True)
        self.scans = []
        for scan in scans:
            self.scans.append(self.folder / scan.name)
            shutil.copy(scan, self.scans[-1])
        lines = [line.split() for line in poses]
        self.stamps = [stamp_ns(line[0]) for line in lines]
        self.poses = [[float(value) for value in line[1:]] for line in lines]
        assert len(self.scans) == len(self.poses) > 0
        (self.folder / "poses.tum").write_text("".join(" ".join(line) + "\n" for line in lines))

    def spec(self, poses, **options):
        topics = {"odometry": ("/odom", ODOMETRY), "pose": ("/pose", POSE), "tf": ("/tf", TF)}
        topic = topics[poses]
        messages = []
        for ns, values, scan in zip(self.stamps, self.poses, self.scans):
            # Recorded late, and with others between them.
            log = str(ns + 5 * 10**9)
            value = {"odometry": lambda: odometry(ns, values), "tf": lambda: transform(ns, "map", "lidar", values),
                     "pose": lambda: {"header": header(ns, "map"), "pose": pose(values)}}[poses]()
            messages += [{"topic": 0, "log_ns": log, "value": imu(ns)}, {"topic": 1, "log_ns": log, "value": value},
                         {"topic": 2, "log_ns": log, "value": cloud(scan, ns)}]
        return {"topics": [{"name": name, "type": kind} for name, kind in (("/imu", IMU), topic, ("/points", CLOUD))],
                "messages": messages, "options": options}


def write(spec, file):
    file.parent.mkdir(parents=True, exist_ok=True)
    spec_file = file.with_suffix(".json")
    spec_file.write_text(json.dumps(spec))
    subprocess.run(["node", ORACLES / "write_bag.mjs", spec_file, file], check=True)
    spec_file.unlink()
    return file


def write_ros1(spec, file):
    file.parent.mkdir(parents=True, exist_ok=True)
    spec_file = file.with_suffix(".json")
    spec_file.write_text(json.dumps(spec))
    subprocess.run([SYSTEM_PYTHON, ORACLES / "write_ros1_bag.py", spec_file, file], check=True)
    spec_file.unlink()
    return file


def write_rosbag2(spec, folder, parts=2):
    """As `ros2 bag record` of today, split."""
    messages, names = spec["messages"], []
    for part in range(parts):
        names.append(f"{folder.name}_{part}.db3")
        some = messages[len(messages) * part // parts:len(messages) * (part + 1) // parts]
        packed = write({**spec, "messages": some}, folder / f"{part}.cdr")
        bag = sqlite3.connect(folder / names[-1])
        bag.executescript(
            "CREATE TABLE schema(schema_version INTEGER PRIMARY KEY,ros_distro TEXT NOT NULL);"
            "CREATE TABLE metadata(id INTEGER PRIMARY KEY,metadata_version INTEGER NOT NULL,metadata TEXT NOT NULL);"
            "CREATE TABLE topics(id INTEGER PRIMARY KEY,name TEXT NOT NULL,type TEXT NOT NULL,serialization_format TEXT NOT "
            "NULL,offered_qos_profiles TEXT NOT NULL,type_description_hash TEXT NOT NULL);"
            "CREATE TABLE message_definitions(id INTEGER PRIMARY KEY,topic_type TEXT NOT NULL,encoding TEXT NOT NULL,"
            "encoded_message_definition TEXT NOT NULL,type_description_hash TEXT NOT NULL);"
            "CREATE TABLE messages(id INTEGER PRIMARY KEY,topic_id INTEGER NOT NULL,timestamp INTEGER NOT NULL,data BLOB NOT "
            "NULL);CREATE INDEX timestamp_idx ON messages (timestamp ASC);INSERT INTO schema VALUES (4, 'jazzy');")
        bag.executemany("INSERT INTO topics VALUES (?, ?, ?, 'cdr', '', '')",
                        [(i + 1, topic["name"], topic["type"]) for i, topic in enumerate(spec["topics"])])
        with open(packed, "rb") as stream:
            while line := stream.readline():
                head = json.loads(line)
                bag.execute("INSERT INTO messages (topic_id, timestamp, data) VALUES (?, ?, ?)",
                            (head["topic"] + 1, int(head["log_ns"]), stream.read(head["bytes"])))
        bag.commit()
        bag.close()
        packed.unlink()
    (folder / "metadata.yaml").write_text(
        "rosbag2_bagfile_information:\n  version: 9\n  storage_identifier: sqlite3\n  relative_file_paths:\n"
        + "".join(f"    - {name}\n" for name in names) + "  compression_format: \"\"\n  compression_mode: \"\"\n")


def contents_of(map_folder):
    files = {}
    for name in OF_THE_MAP:
        path = map_folder / name
        for file in sorted(path.rglob("*")) if path.is_dir() else [path]:
            if file.is_file():
                files[str(file.relative_to(map_folder))] = file.read_bytes()
    assert any(name.startswith("packs/") for name in files)
    return files


class Bags(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.work = pathlib.Path(tempfile.mkdtemp(prefix="stillmap-bags-"))
        cls.addClassCleanup(shutil.rmtree, cls.work, ignore_errors=True)
        run("simulate", "town", "-o", cls.work / "simulated", "--seed", 1, "--scans", 6, "--layout", "pcd", "--sensor", "vlp16")
        # T_map_lidar of the scans, as the layout with key frames gives them.
        run("build", cls.work / "simulated", "-o", cls.work / "poses", "--clean", "none", "--detector", "geometric")
        cls.drive = Drive(cls.work / "plain" / "town", sorted((cls.work / "simulated" / "scans").glob("*.pcd")),
                          (cls.work / "poses" / "trajectory.tum").read_text().splitlines())
        cls.map = cls.build(cls.drive.folder, "plain_map")

    @classmethod
    def build(cls, drive, name):
        run("build", drive, "-o", cls.work / name, "--detector", "geometric")
        return contents_of(cls.work / name)

    def expect_same_drive(self, bag, drive=None):
        done = subprocess.run([COMPARE, (drive or self.drive).folder, bag], capture_output=True, text=True)
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)

    def expect_same(self, bag, name):
        self.expect_same_drive(bag)
        made = self.build(bag, name)
        self.assertEqual(sorted(made), sorted(self.map))
        for file, content in self.map.items():
            self.assertEqual(made[file], content, file)

    def test_mcap_of_zstd_with_an_index(self):
        self.expect_same(write(self.drive.spec("odometry", compression="zstd", chunk_bytes=3_000_000),
                               self.work / "zstd" / "town.mcap"), "zstd_map")

    def test_mcap_of_lz4_without_an_index_and_with_tf(self):
        self.expect_same(write(self.drive.spec("tf", compression="lz4", index=False, statistics=False),
                               self.work / "lz4" / "town.mcap"), "lz4_map")

    def test_mcap_without_chunks(self):
        self.expect_same(write(self.drive.spec("pose", chunks=False), self.work / "loose" / "town.mcap"), "loose_map")

    def test_rosbag2(self):
        folder = self.work / "rosbag2" / "town"
        folder.mkdir(parents=True)
        write_rosbag2(self.drive.spec("pose"), folder)
        self.expect_same(folder, "rosbag2_map")

    @unittest.skipUnless(HAVE_ROS1, "/usr/bin/python3 has no rosbag")
    def test_ros1(self):
        for compression, poses in (("none", "odometry"), ("lz4", "tf"), ("bz2", "pose")):
            with self.subTest(compression):
                spec = self.drive.spec(poses, compression=compression, chunk_bytes=1_000_000)
                bag = write_ros1(spec, self.work / "ros1" / compression / "town.bag")
                self.expect_same(bag, f"ros1_{compression}_map")
                # As a killed recorder leaves it: no index, and the last chunk without its end.
                whole = bag.read_bytes()
                index = struct.unpack_from("<Q", whole, whole.index(b"index_pos=") + 10)[0]
                active = bag.with_suffix(".bag.active")
                active.write_bytes(whole[:index].replace(b"index_pos=" + struct.pack("<Q", index), b"index_pos=" + bytes(8)))
                self.expect_same_drive(active)
                self.assertIn("rosbag reindex", run("inspect", active).stdout)
                active.write_bytes(active.read_bytes()[:-40_000])
                inspected = json.loads(run("inspect", active, "--json").stdout)
                self.assertLess(inspected["scans"], len(self.drive.scans))
                self.assertGreater(inspected["scans"], 0)

    @unittest.skipUnless(HAVE_ROS1, "/usr/bin/python3 has no rosbag")
    def test_older_ros1(self):
        bag = self.work / "old.bag"
        bag.write_bytes(b"#ROSBAG V1.2\n" + bytes(100))
        refused = run("inspect", bag, ok=False)
        self.assertEqual(refused.returncode, 1)
        self.assertIn("rosbag filter OLD.bag NEW.bag True", refused.stderr)

    def test_livox(self):
        """CustomMsg holds reflectivities of 8 bits and times in nanoseconds: the folder has the same digits."""
        folder = self.work / "livox" / "plain"
        folder.mkdir(parents=True)
        shutil.copy(self.drive.folder / "poses.tum", folder)
        messages = []
        for ns, values, scan in zip(self.drive.stamps, self.drive.poses, self.drive.scans):
            start, count, columns = cloud_fields(scan)
            self.assertEqual([name for name, _, _ in columns], ["x", "y", "z", "intensity", "t", "ring"])
            points = [struct.unpack_from("<fffffH", scan.read_bytes(), start + 22 * i) for i in range(count)]
            rows = [(*p[:3], round(255 * p[3]), round(1e9 * p[4])) for p in points]
            first = min(row[4] for row in rows)
            head = ("VERSION 0.7\nFIELDS x y z intensity t\nSIZE 4 4 4 1 4\nTYPE F F F U I\nCOUNT 1 1 1 1 1\n"
                    f"WIDTH {count}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {count}\nDATA binary\n").encode()
            (folder / scan.name).write_bytes(head + b"".join(struct.pack("<fffBi", *row) for row in rows))
            value = {"header": header(ns, "lidar"), "timebase": str(ns + first), "point_num": count, "lidar_id": 0, "rsvd": [0] * 3,
                     "points": [{"offset_time": t - first, "x": x, "y": y, "z": z, "reflectivity": i, "tag": 16, "line": 2}
                                for x, y, z, i, t in rows]}
            messages += [{"topic": 0, "log_ns": str(ns), "value": odometry(ns, values)},
                         {"topic": 1, "log_ns": str(ns), "value": value}]
        topics = [{"name": "/odom", "type": ODOMETRY}, {"name": "/livox/lidar", "type": "livox_ros_driver2/msg/CustomMsg"}]
        bag = write({"topics": topics, "messages": messages, "options": {}}, self.work / "livox" / "bag" / "town.mcap")
        done = subprocess.run([COMPARE, folder, bag], capture_output=True, text=True)
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        self.assertEqual(self.build(folder, "livox_folder_map"), self.build(bag, "livox_map"))

    def test_velodyne_packets(self):
        """Points of packets as @foxglove/velodyne-cloud makes them. It gives all firings of a block the block's azimuth, so the
        sensor here stands still within a packet; and it takes the times of lasers of VLP-16, VLP-32C and HDL-32E otherwise than
        the manuals, by up to 55 us. Its angles of HDL-32E have two decimals."""
        generator = random.Random(5)
        for model, factory, flags in (("VLP16", 0x22, (0xeeff,)), ("VLP16HiRes", 0x24, (0xeeff,)), ("HDL32E", 0x21, (0xeeff,)),
                                      ("VLP32C", 0x28, (0xeeff,)), ("VLS128", 0xa1, (0xeeff, 0xddff, 0xccff, 0xbbff)),
                                      ("HDL64E", ord("T"), (0xeeff, 0xddff))):
            with self.subTest(model):
                folder, bags = self.work / "velodyne" / model, self.work / "velodyne_bags" / model
                folder.mkdir(parents=True)
                bags.mkdir(parents=True)
                calibration, choice = None, ""
                if model == "HDL64E":
                    lasers = [{"laser_id": i, "vert_correction": generator.uniform(-0.4, 0.03), "rot_correction":
                               generator.uniform(-0.1, 0.1), "dist_correction": generator.uniform(0.5, 1.5),
                               "dist_correction_x": generator.uniform(0.5, 1.5), "dist_correction_y": generator.uniform(0.5, 1.5),
                               "vert_offset_correction": generator.uniform(0.1, 0.3), "horiz_offset_correction":
                               generator.choice((-0.026, 0.026)), "two_pt_correction_available": True, "focal_distance": 0,
                               "focal_slope": 0} for i in range(64)]
                    calibration = {"lasers": lasers, "distance_resolution": 0.002}
                    text = "".join("- " + "\n  ".join(f"{key}: {str(value).lower()}" for key, value in laser.items()) + "\n"
                                   for laser in lasers)
                    (bags / "64e.yaml").write_text("distance_resolution: 0.002\nlasers:\n" + text)
                    choice = "?calibration=64e.yaml"
                scans, messages = [], []
                for number in range(2):
                    ns = 1_700_000_000_000_000_000 + number * 10**8
                    packets = []
                    for k in range(20):
                        azimuth = (number * 20 + k) * 877
                        blocks = b"".join(
                            struct.pack("<HH", flags[b % len(flags)], azimuth % 36000) +
                            b"".join(struct.pack("<HB", generator.choice((0, generator.randrange(500, 50000))),
                                                 generator.randrange(256)) for _ in range(32)) for b in range(12))
                        packets.append((ns + k * 1_000_000, blocks + struct.pack("<IBB", 0, 0x37, factory)))
                    scans.append({"out": str(folder / f"{ns}.bin"), "packets": [
                        {"base64": base64.b64encode(data).decode(), "from_stamp_s": (at - ns) / 1e9} for at, data in packets]})
                    messages.append({"topic": 0, "log_ns": str(ns), "value": {"header": header(ns, "velodyne"), "packets": [
                        {"stamp": stamp(at), "data": {"base64": base64.b64encode(data).decode()}} for at, data in packets]}})
                spec = bags / "spec.json"
                spec.write_text(json.dumps({"model": model, "calibration": calibration, "scans": scans}))
                subprocess.run(["node", ORACLES / "velodyne_points.mjs", spec], check=True)
                bag = write({"topics": [{"name": "/velodyne_packets", "type": "velodyne_msgs/msg/VelodyneScan"}],
                             "messages": messages, "options": {}}, bags / "packets.mcap")
                done = subprocess.run([COMPARE, f"{folder}?columns=xyzit", f"{bag}{choice}", "0.01"],
                                      capture_output=True, text=True)
                self.assertEqual(done.returncode, 0, done.stdout + done.stderr)

    def test_ouster_packets(self):
        """The drive as an OS-1-32 sends it, and as points by the formula of Ouster's documentation, written once more here."""
        columns, pixels, beam_m = 1024, 32, 0.015806
        up = [math.radians(15.5 - i) for i in range(pixels)]
        aside = [math.radians((i % 4 - 1.5) * 2.8) for i in range(pixels)]
        place = [-1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1, 36.18, 0, 0, 0, 1]
        metadata = {"beam_intrinsics": {"beam_altitude_angles": [math.degrees(angle) for angle in up],
                                        "beam_azimuth_angles": [math.degrees(angle) for angle in aside],
                                        "lidar_origin_to_beam_origin_mm": 1000 * beam_m},
                    "lidar_intrinsics": {"lidar_to_sensor_transform": place},
                    "lidar_data_format": {"columns_per_frame": columns, "columns_per_packet": 16, "pixels_per_column": pixels,
                                          "udp_profile_lidar": "RNG19_RFL8_SIG16_NIR16"}}
        folder = self.work / "ouster" / "plain"
        folder.mkdir(parents=True)
        shutil.copy(self.drive.folder / "poses.tum", folder)
        messages = [{"topic": 2, "log_ns": str(self.drive.stamps[0]), "value": {"data": json.dumps(metadata)}}]
        for turn, (ns, values, scan) in enumerate(zip(self.drive.stamps, self.drive.poses, self.drive.scans)):
            start, count, _ = cloud_fields(scan)
            image = {}
            for i in range(count):
                x, y, z, intensity = struct.unpack_from("<ffff", scan.read_bytes(), start + 22 * i)
                pixel = min(range(pixels), key=lambda k: abs(up[k] - math.atan2(z, math.hypot(x, y))))
                # The sensor's x points away from column 0.
                around = (math.atan2(-y, -x) + aside[pixel]) / (2 * math.pi)
                image[round((1 - around) * columns) % columns, pixel] = (round(1000 * math.hypot(x, y, z)), round(255 * intensity))
            rows, packets = [], []
            for column in range(columns):
                ahead, body = 2 * math.pi * (1 - column / columns), b""
                for pixel in range(pixels):
                    reach, signal = image.get((column, pixel), (0, 0))
                    body += struct.pack("<IBxHxxxx", reach, 0, signal)
                    if reach == 0:
                        continue
                    far, angle = reach / 1000 - beam_m, ahead - aside[pixel]
                    x = far * math.cos(up[pixel]) * math.cos(angle) + beam_m * math.cos(ahead)
                    y = far * math.cos(up[pixel]) * math.sin(angle) + beam_m * math.sin(ahead)
                    rows.append((-x, -y, far * math.sin(up[pixel]) + 0.03618, signal, column * 97_656))
                packets.append(struct.pack("<QHH", ns + column * 97_656, column, 1) + body)
            for i in range(0, columns, 16):
                packet = struct.pack("<HH28x", 1, turn) + b"".join(packets[i:i + 16]) + bytes(32)
                messages.append({"topic": 1, "log_ns": str(ns + i * 97_656),
                                 "value": {"buf": {"base64": base64.b64encode(packet).decode()}}})
            messages.append({"topic": 0, "log_ns": str(ns), "value": odometry(ns, values, "os_sensor")})
            head = ("VERSION 0.7\nFIELDS x y z intensity t\nSIZE 4 4 4 2 4\nTYPE F F F U I\nCOUNT 1 1 1 1 1\n"
                    f"WIDTH {len(rows)}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {len(rows)}\nDATA binary\n").encode()
            (folder / scan.name).write_bytes(head + b"".join(struct.pack("<fffHi", *row) for row in rows))
        topics = [{"name": "/odom", "type": ODOMETRY}, {"name": "/ouster/lidar_packets", "type": "ouster_sensor_msgs/msg/PacketMsg"},
                  {"name": "/ouster/metadata", "type": "std_msgs/msg/String"}]
        bag = write({"topics": topics, "messages": messages, "options": {}}, self.work / "ouster" / "bag" / "town.mcap")
        done = subprocess.run([COMPARE, folder, bag, "1e-5"], capture_output=True, text=True)
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)

    def test_velodyne_capture(self):
        """The simulated drive of a VLP-16, rounded to its packets: a capture is the drive that a bag of these packets is."""
        scans = [vlp16_packets(scan, ns) for scan, ns in zip(self.drive.scans, self.drive.stamps)]
        packets = [packet for scan in scans for packet in scan]
        folder = self.work / "capture"
        folder.mkdir()
        shutil.copy(self.drive.folder / "poses.tum", folder)
        bag = write({"topics": [{"name": "/velodyne_packets", "type": "velodyne_msgs/msg/VelodyneScan"}],
                     "messages": [{"topic": 0, "log_ns": str(scan[0][0]), "value": {
                         "header": header(scan[0][0], "velodyne"),
                         "packets": [{"stamp": stamp(at), "data": {"base64": base64.b64encode(data).decode()}}
                                     for at, data in scan]}} for scan in scans], "options": {}}, folder / "packets.mcap")
        poses = ["--poses", folder / "poses.tum"]
        self.assertEqual(len(scans), len(self.drive.scans))

        def map_of(drive, name):
            run("build", drive, *poses, "-o", self.work / name, "--detector", "geometric")
            return contents_of(self.work / name)

        expected = map_of(bag, "packets_map")
        for name, content in (("run.pcap", pcap(packets)), ("run_ns.pcap", pcap(packets, ">", 9)), ("run.pcapng", pcapng(packets))):
            with self.subTest(name):
                capture = folder / "captures" / name.replace(".", "_") / name
                capture.parent.mkdir(parents=True)
                capture.write_bytes(content)
                done = subprocess.run([COMPARE, bag, capture], capture_output=True, text=True)
                self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
                self.assertEqual(map_of(capture.parent, f"{name}_map"), expected)

    def test_choice(self):
        spec = self.drive.spec("odometry")
        spec["topics"].append({"name": "/rear", "type": CLOUD})
        spec["messages"].append({**spec["messages"][-1], "topic": 3})
        bag = write(spec, self.work / "two" / "town.mcap")
        refused = run("build", bag, "-o", self.work / "two_map", ok=False)
        self.assertEqual(refused.returncode, 1)
        self.assertIn("/points (6 clouds in 'lidar'), /rear (1 clouds in 'lidar')", refused.stderr)
        self.assertIn("town.mcap?cloud=/points'", refused.stderr)
        self.expect_same_drive(f"{bag}?cloud=/points")
        self.assertEqual(run("inspect", f"{bag}?color=red", ok=False).returncode, 1)
        self.assertEqual(run("inspect", self.work / "nothing.mcap", ok=False).returncode, 2)

    def test_localize_follows_a_bag(self):
        bag = write(self.drive.spec("odometry"), self.work / "localize" / "town.mcap")
        pose_of_first = ",".join(map(str, self.drive.poses[0]))
        followed = [run("localize", self.work / "plain_map", drive, "--prior", pose_of_first, "--select", ":2", "-o",
                        self.work / f"{i}.tum") for i, drive in enumerate((bag, self.drive.folder))]
        self.assertEqual([each.returncode for each in followed], [0, 0])
        self.assertEqual((self.work / "0.tum").read_text(), (self.work / "1.tum").read_text())

    @unittest.skipUnless(REAL, "STILLMAP_REAL_DATA is not set")
    def test_real_drives(self):
        real = pathlib.Path(REAL)
        # The poses do not matter here, but each drive has some.
        poses = [f"{1624254615 + i}.100000000 {i} 0.5 0 0 0 0.6 0.8" for i in range(2)]
        for folder, pattern in (("hku_1/Scans", "*.pcd"), ("mulran_seosan01/Scans", "*.pcd"),
                                ("semantickitti/08/velodyne", "*.bin"),
                                ("kitti_raw/2011_09_26/2011_09_26_drive_0013_sync/velodyne_points/data", "*.bin")):
            with self.subTest(folder):
                name = folder.replace("/", "_")
                scans = sorted((real / folder).glob(pattern))[:2]
                drive = Drive(self.work / name / "plain" / "real", scans, poses[:len(scans)])
                bag = write(drive.spec("odometry", compression="lz4"), self.work / name / "bag" / "real.mcap")
                # A path of one pose has to be asked for.
                self.expect_same_drive(f"{bag}?poses=/odom", drive)
                shutil.rmtree(self.work / name)

    @unittest.skipUnless(REAL, "STILLMAP_REAL_DATA is not set")
    def test_gnss_of_a_real_drive(self):
        """KITTI's own place on the Earth, and that of the same drive as a bag: odometry in axes of its own, and the fixes."""
        day = pathlib.Path(REAL) / "kitti_raw" / "2011_09_26"
        raw, work = day / "2011_09_26_drive_0013_sync", self.work / "gnss"

        def placed(drive, name, *words):
            run("build", drive, "-o", work / name, "--detector", "geometric", "--clean", "none", "--given-poses",
                "exact", *words)
            origin = json.loads((work / name / "manifest.json").read_text())["geodetic_origin"]
            lines = (work / name / "trajectory.tum").read_text().splitlines()
            return [origin[key] for key in ("latitude_deg", "longitude_deg", "altitude_m")], lines

        work.mkdir()
        origin, lines = placed(raw, "folder_map", "--select", "::5")
        scans = sorted((raw / "velodyne_points" / "data").glob("*.bin"))[::5]
        drive = Drive(work / "plain" / "real", scans, lines)
        drive.poses = [turned(math.radians(40), values) for values in drive.poses]
        rows = dict(line.partition(": ")[::2] for line in (day / "calib_imu_to_velo.txt").read_text().splitlines())
        lever = [float(value) for value in rows["T"].split()]
        spec = drive.spec("odometry")
        spec["topics"] += [{"name": "/fix", "type": FIX}, {"name": "/tf_static", "type": TF}]
        log = str(drive.stamps[0])
        spec["messages"].append({"topic": 4, "log_ns": log, "value": transform(0, "lidar", "imu", [*lever, 0, 0, 0, 1])})
        moments = (raw / "oxts" / "timestamps.txt").read_text().splitlines()
        for file, moment in zip(sorted((raw / "oxts" / "data").glob("*.txt")), moments):
            second, _, decimals = moment.partition(".")
            ns = stamp_ns(f"{calendar.timegm(time.strptime(second, '%Y-%m-%d %H:%M:%S'))}.{decimals}")
            place = [float(value) for value in file.read_text().split()[:3]]
            spec["messages"].append({"topic": 3, "log_ns": log, "value": fix(ns, *place)})
        bag = write(spec, work / "bag" / "real.mcap")
        other, found = placed(f"{bag}?gnss=/fix&poses=/odom", "bag_map")
        self.assertEqual(len(lines), len(found))
        shift = east_north_up_m(origin, other)
        for a, b in zip(lines, found):
            a, b = ([float(value) for value in line.split()] for line in (a, b))
            self.assertLess(math.dist([b[i + 1] + shift[i] for i in range(3)], a[1:4]), 0.02)


def have_oracles():
    if shutil.which("npm") is None or shutil.which("lz4") is None or shutil.which("zstd") is None:
        return False
    installed = ORACLES / "node_modules" / ".installed"
    if installed.exists() and installed.stat().st_mtime >= (ORACLES / "package-lock.json").stat().st_mtime:
        return True
    if subprocess.run(["npm", "ci", "--no-progress"], cwd=ORACLES, check=False).returncode != 0:
        return False
    installed.touch()
    return True


if __name__ == "__main__":
    if not have_oracles():
        print("skipped: npm, lz4 or zstd is missing, or npm cannot install @mcap/core here")
        sys.exit(77)
    unittest.main(argv=sys.argv[:1], verbosity=2)
