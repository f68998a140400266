#!/usr/bin/env python3
"""The node of ROS 1, with a drive that `rosbag play` plays to it and a real server.

usage: ros1_node_test.py STILLMAP STILLMAP_NODE STORE DRIVE

Ends with 77 where Debian's ROS 1 is not installed. The node's topics are told on the standard output.
"""

import os
import pathlib
import re
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
import unittest

try:
    import geometry_msgs.msg
    import nav_msgs.msg
    import numpy
    import rosbag
    import rospy
    import sensor_msgs.msg
    import tf2_msgs.msg
    from diagnostic_msgs.msg import DiagnosticArray
except ImportError as missing:
    print(f"skipped: {missing}")
    sys.exit(77)

PROGRAM, NODE, STORE, DRIVE = (pathlib.Path(x) for x in sys.argv[1:5])
OK, WARN, ERROR = 0, 1, 2
NODE_NAME = "/stillmap"


def motion(position, quaternion):
    x, y, z, w = numpy.array(quaternion) / numpy.linalg.norm(quaternion)
    T = numpy.eye(4)
    T[:3, :3] = [[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                 [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                 [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]]
    T[:3, 3] = position
    return T


def turned(yaw, position=(0, 0, 0)):
    return motion(position, (0, 0, numpy.sin(yaw / 2), numpy.cos(yaw / 2)))


def quaternion(T):
    """x y z w of a rotation of less than half a turn."""
    w = numpy.sqrt(max(0.0, 1 + numpy.trace(T[:3, :3]))) / 2
    return [(T[2, 1] - T[1, 2]) / (4 * w), (T[0, 2] - T[2, 0]) / (4 * w), (T[1, 0] - T[0, 1]) / (4 * w), w]


def motion_of(pose):
    p, q = pose.position, pose.orientation
    return motion((p.x, p.y, p.z), (q.x, q.y, q.z, q.w))


def pose_of(T):
    return geometry_msgs.msg.Pose(geometry_msgs.msg.Point(*T[:3, 3]), geometry_msgs.msg.Quaternion(*quaternion(T)))


def transform_of(stamp, parent, child, T):
    transform = geometry_msgs.msg.TransformStamped()
    transform.header.stamp, transform.header.frame_id, transform.child_frame_id = stamp, parent, child
    transform.transform.translation = geometry_msgs.msg.Vector3(*T[:3, 3])
    transform.transform.rotation = geometry_msgs.msg.Quaternion(*quaternion(T))
    return transform


def rigid(line):
    return numpy.vstack([numpy.array(line, float).reshape(3, 4), [0, 0, 0, 1]])


#: Mounts of lidars are seldom straight.
T_BASE_LIDAR = turned(1.2, (1.1, 0.3, 0.0)) @ motion((0, 0, 0), (0.02, -0.01, 0, 1))
#: Odometry begins somewhere, and drifts by a turn and in scale.
T_ODOM_START = turned(-0.7, (40.0, -7.0, 0.5))


def between(a, b, share):
    T = numpy.eye(4)
    qa, qb = numpy.array(quaternion(a)), numpy.array(quaternion(b))
    q = (1 - share) * qa + share * (qb if qa @ qb > 0 else -qb)
    return motion((1 - share) * a[:3, 3] + share * b[:3, 3], q)


class Drive:
    """A drive in KITTI layout, where it was in the map, and a bag of it with odometry of 50 Hz."""

    def __init__(self, epoch_s):
        camera_lidar = next(rigid(line.split()[1:]) for line in (DRIVE / "calib.txt").read_text().splitlines()
                            if line.startswith("Tr"))
        poses = [rigid(line.split()) for line in (DRIVE / "poses.txt").read_text().splitlines()]
        # The map is of the same drive, so it is in the drive's frame.
        self.T_map_lidar = [numpy.linalg.inv(camera_lidar) @ pose @ camera_lidar for pose in poses]
        self.times = [epoch_s + float(line) for line in (DRIVE / "times.txt").read_text().splitlines()]
        self.T_map_base = {round(1e9 * t): T @ numpy.linalg.inv(T_BASE_LIDAR)
                           for t, T in zip(self.times, self.T_map_lidar)}
        self.scans = sorted((DRIVE / "velodyne").glob("*.bin"))

    def T_odom_base(self, i, share):
        T = between(self.T_map_lidar[i], self.T_map_lidar[i + 1], share)
        T = T_BASE_LIDAR @ T @ numpy.linalg.inv(T_BASE_LIDAR)
        moved = turned(0.0005 * (i + share)) @ T
        moved[:3, 3] *= 1.02
        return T_ODOM_START @ moved

    def cloud(self, i):
        points = self.scans[i].read_bytes()
        cloud = sensor_msgs.msg.PointCloud2()
        cloud.header.stamp, cloud.header.frame_id = rospy.Time.from_sec(self.times[i]), "velodyne"
        cloud.fields = [sensor_msgs.msg.PointField(name, 4 * k, 7, 1) for k, name in enumerate(("x", "y", "z", "intensity"))]
        cloud.height, cloud.width, cloud.point_step, cloud.row_step = 1, len(points) // 16, 16, len(points)
        cloud.data = points
        return cloud

    def write(self, file):
        with rosbag.Bag(str(file), "w") as bag:
            start = rospy.Time.from_sec(self.times[0])
            mount = transform_of(start, "base_link", "velodyne", T_BASE_LIDAR)
            bag.write("/tf_static", tf2_msgs.msg.TFMessage([mount]), start)
            for i, seconds in enumerate(self.times):
                bag.write("/points", self.cloud(i), rospy.Time.from_sec(seconds + 0.05))
                for part in range(5 if i + 1 < len(self.times) else 0):
                    stamp = rospy.Time.from_sec(seconds + (self.times[i + 1] - seconds) * part / 5)
                    message = nav_msgs.msg.Odometry()
                    message.header.stamp, message.header.frame_id, message.child_frame_id = stamp, "odom", "base_link"
                    message.pose.pose = pose_of(self.T_odom_base(i, part / 5))
                    bag.write("/odom", message, stamp)


class Listener:
    """What the node tells, as it came."""

    def __init__(self):
        self.changed = threading.Condition()
        self.poses, self.transforms, self.odometry, self.tiles, self.health = [], [], {}, [], []
        self.frames = {}
        for topic, kind, take in (
                (NODE_NAME + "/pose", geometry_msgs.msg.PoseWithCovarianceStamped, self.poses.append),
                (NODE_NAME + "/map_tiles", sensor_msgs.msg.PointCloud2, self.tiles.append),
                ("/tf", tf2_msgs.msg.TFMessage, lambda message: self.transforms.extend(message.transforms)),
                ("/tf_static", tf2_msgs.msg.TFMessage,
                 lambda message: self.frames.update({each.child_frame_id: each for each in message.transforms})),
                ("/odom", nav_msgs.msg.Odometry,
                 lambda message: self.odometry.__setitem__(message.header.stamp.to_nsec(), motion_of(message.pose.pose))),
                ("/diagnostics", DiagnosticArray, lambda message: self.health.extend(message.status))):
            rospy.Subscriber(topic, kind, lambda message, take=take: self.take(take, message), queue_size=1000)

    def take(self, take, message):
        with self.changed:
            take(message)
            self.changed.notify_all()

    def wait(self, until, what, timeout_s=30.0):
        with self.changed:
            if not self.changed.wait_for(until, timeout_s):
                last = self.health[-1] if self.health else "nothing"
                raise AssertionError(f"{what}: not within {timeout_s} s; the node's health: {last}")

    def clear(self):
        with self.changed:
            for heard in (self.poses, self.transforms, self.tiles, self.health):
                heard.clear()


def free_port():
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


def wait_for_port(port):
    for _ in range(100):
        with socket.socket() as one:
            if one.connect_ex(("127.0.0.1", port)) == 0:
                return
        time.sleep(0.1)
    raise AssertionError(f"nobody listens on port {port}")


class NodeTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.work = pathlib.Path(tempfile.mkdtemp(prefix="stillmap-ros1-"))
        cls.addClassCleanup(shutil.rmtree, cls.work, ignore_errors=True)
        os.environ.update(ROS_MASTER_URI=f"http://127.0.0.1:{free_port()}", ROS_IP="127.0.0.1", ROS_HOME=str(cls.work))
        master_port = os.environ["ROS_MASTER_URI"].rsplit(":", 1)[1]
        cls.run_beside(["rosmaster", "--core", "-p", master_port])
        wait_for_port(int(master_port))
        cls.drive = Drive(1_700_000_000)
        shutil.copytree(STORE, cls.work / "store")
        cls.server, cls.server_port = None, 0
        cls.addClassCleanup(cls.stop_server)
        cls.start_server()
        rospy.init_node("listener", disable_signals=True)
        cls.heard = Listener()
        cls.initial = rospy.Publisher("/initialpose", geometry_msgs.msg.PoseWithCovarianceStamped, queue_size=1, latch=False)
        cls.clouds = rospy.Publisher("/points", sensor_msgs.msg.PointCloud2, queue_size=1)
        cls.node = cls.run_beside([NODE, f"_url:=http://127.0.0.1:{cls.server_port}", "_map:=town", "_patience_s:=1.5",
                                   "_tile_radius_m:=30"])

    @classmethod
    def run_beside(cls, words):
        child = subprocess.Popen(list(map(str, words)), stdout=subprocess.DEVNULL)

        def end():
            child.send_signal(signal.SIGINT)
            try:
                child.wait(10)
            except subprocess.TimeoutExpired:
                child.kill()
                child.wait()

        cls.addClassCleanup(end)
        return child

    @classmethod
    def start_server(cls):
        cls.server = subprocess.Popen([PROGRAM, "serve", "--store", cls.work / "store", "--port", str(cls.server_port)],
                                      stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        cls.server_port = int(re.search(r"127\.0\.0\.1:(\d+)", cls.server.stdout.readline()).group(1))

    @classmethod
    def stop_server(cls):
        if cls.server is not None:
            cls.server.terminate()
            cls.server.communicate(timeout=30)
            cls.server = None

    def play(self, rate):
        """The drive, each time later."""
        self.heard.clear()
        type(self).drive = Drive(self.drive.times[0] + 1000)
        self.drive.write(self.work / "drive.bag")
        player = subprocess.Popen(["rosbag", "play", "--quiet", "--wait-for-subscribers", "--rate", str(rate),
                                   str(self.work / "drive.bag")], stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
        self.addCleanup(lambda: (player.terminate(), player.wait(10)))
        return player

    def errors_m_rad(self, estimates):
        """(of the position, of the rotation) of poses (stamp [ns], T_map_base)."""
        for stamp_ns, T in estimates:
            truth = self.drive.T_map_base[min(self.drive.T_map_base, key=lambda each: abs(each - stamp_ns))]
            off = numpy.linalg.inv(truth) @ T
            yield numpy.linalg.norm(off[:3, 3]), numpy.arccos(min(1.0, (numpy.trace(off[:3, :3]) - 1) / 2))

    def test_1_a_played_drive_is_localized(self):
        player = self.play(1)
        self.assertEqual(player.wait(60), 0)
        self.heard.wait(lambda: len(self.heard.poses) >= len(self.drive.scans) // 4, "poses")
        self.heard.wait(lambda: self.heard.tiles and "map_tiles" in self.heard.frames, "map tiles and their frame")
        cloud, frame = self.heard.tiles[-1], self.heard.frames["map_tiles"]
        self.assertEqual((cloud.header.frame_id, frame.header.frame_id), ("map_tiles", "map"))
        self.assertEqual([frame.transform.translation.x % 1000, frame.transform.translation.y % 1000], [0, 0])
        xyz = numpy.frombuffer(cloud.data, "<f4").reshape(-1, 4)[:, :3].astype(float)
        xyz += [getattr(frame.transform.translation, axis) for axis in "xyz"]
        way = numpy.array([T[:3, 3] for T in self.drive.T_map_base.values()])
        self.assertLess(numpy.abs(numpy.median(xyz, axis=0) - numpy.median(way, axis=0)).max(), 60)
        estimates = [(each.header.stamp.to_nsec(), motion_of(each.pose.pose)) for each in self.heard.poses]
        self.assertEqual({each.header.frame_id for each in self.heard.poses}, {"map"})
        off = numpy.array(list(self.errors_m_rad(estimates)))
        print(f"{len(off)} poses of {len(self.drive.scans)} scans, off by {numpy.median(off[:, 0]):.4f} m in the median, "
              f"{off[:, 0].max():.4f} m and {off[:, 1].max():.5f} rad at most")
        self.assertLess(numpy.median(off[:, 0]), 0.03)
        self.assertLess(off[:, 0].max(), 0.15)
        self.assertLess(off[:, 1].max(), 0.01)
        for each in self.heard.poses:
            covariance = numpy.array(each.pose.covariance).reshape(6, 6)
            self.assertGreater(numpy.linalg.eigvalsh((covariance + covariance.T) / 2).min(), 0)

    def test_2_map_odom_takes_the_drift_away(self):
        """In the times between the scans, too."""
        self.play(1).wait(60)
        chains = [(each.header.frame_id, each.child_frame_id) for each in self.heard.transforms]
        self.assertEqual(set(chains), {("map", "odom")})
        estimates = []
        for each in self.heard.transforms:
            t, q, stamp_ns = each.transform.translation, each.transform.rotation, each.header.stamp.to_nsec()
            T_map_odom = motion((t.x, t.y, t.z), (q.x, q.y, q.z, q.w))
            if stamp_ns in self.heard.odometry and min(abs(stamp_ns - each) for each in self.drive.T_map_base) < 1000:
                estimates.append((stamp_ns, T_map_odom @ self.heard.odometry[stamp_ns]))
        self.assertGreater(len(estimates), len(self.drive.scans) // 4)
        off = numpy.array(list(self.errors_m_rad(estimates)))
        print(f"{len(self.heard.transforms)} transforms map -> odom, base off by {numpy.median(off[:, 0]):.4f} m in the median")
        self.assertLess(numpy.median(off[:, 0]), 0.1)

    def test_3_health_tells_of_the_server_and_goes_back(self):
        player = self.play(0.2)
        self.heard.wait(lambda: any(each.level == OK for each in self.heard.health), "ok")
        self.stop_server()
        self.heard.wait(lambda: self.heard.health[-1].level == ERROR and "no pose" in self.heard.health[-1].message, "error")
        print("server away:", self.heard.health[-1].message)
        self.start_server()
        self.heard.clear()
        self.heard.wait(lambda: any(each.level == OK for each in self.heard.health), "ok again")
        values = {each.key: each.value for each in self.heard.health[-1].values}
        print("values:", values)
        self.assertGreater(int(values["sessions"]), 1)
        self.assertEqual((values["map"], values["version"]), ("town", "v1"))
        player.terminate()
        self.heard.wait(lambda: self.heard.health and "no scans" in self.heard.health[-1].message, "no scans")
        self.assertEqual(self.heard.health[-1].level, ERROR)

    def test_4_an_initial_pose_is_taken_at_the_height_of_the_ground(self):
        # Slowly: what one scan was answered must be seen in the diagnostics, which come twice a second.
        player = self.play(0.08)
        self.heard.wait(lambda: len(self.heard.poses) > 2, "poses")
        last = self.heard.poses[-1]
        wrong = geometry_msgs.msg.PoseWithCovarianceStamped()
        wrong.header.frame_id = "map"
        T = motion_of(last.pose.pose) @ turned(0.05)
        T[:3, 3] += (0.5, -0.4, 0)
        wrong.pose.pose = pose_of(T)
        # As RViz sends it: on the plane z = 0.
        wrong.pose.pose.position.z = 0.0
        wrong.pose.covariance = [0.0] * 36
        wrong.pose.covariance[0] = wrong.pose.covariance[7] = 0.25
        wrong.pose.covariance[35] = 0.07
        self.initial.publish(wrong)

        def was_given():
            return any(value.key == "searched from" and value.value == "given"
                       for each in self.heard.health for value in each.values)

        self.heard.wait(was_given, "a search from the given pose")
        self.heard.wait(lambda: self.heard.health[-1].level == OK, "ok after it")
        player.terminate()

    def test_5_scans_of_another_place_are_lost_and_damaged_ones_are_told(self):
        self.heard.clear()
        cloud = self.drive.cloud(0)
        noise = numpy.random.default_rng(1).normal(0, 20, (20000, 4)).astype("f4")
        cloud.data, cloud.width, cloud.row_step = noise.tobytes(), len(noise), noise.nbytes
        damaged = self.drive.cloud(0)
        damaged.data = damaged.data[:1000]
        for i in range(40):
            cloud.header.stamp = rospy.Time.from_sec(self.drive.times[-1] + 100 + i)
            self.clouds.publish(cloud)
            time.sleep(0.1)
        self.heard.wait(lambda: any(each.level == ERROR and each.message.startswith("lost") for each in self.heard.health), "lost")
        print("lost:", next(each.message for each in self.heard.health if each.message.startswith("lost")))
        self.clouds.publish(damaged)
        self.heard.wait(lambda: any("row_step" in each.message or "points" in each.message for each in self.heard.health
                                    if each.level == ERROR), "damaged")
        print("damaged:", self.heard.health[-1].message)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2, warnings="ignore")
