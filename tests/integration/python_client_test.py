#!/usr/bin/env python3
"""The Python client against a real server.

usage: python_client_test.py STILLMAP STORE DRIVE PACKAGE
"""

import array
import json
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import threading
import time
import unittest

PROGRAM, STORE, DRIVE, PACKAGE = (pathlib.Path(x).resolve() for x in sys.argv[1:5])
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "server/clients/python/src"))

from stillmap_client import (Client, ConnectionLost, MovableBox, Odometry, Pose, Prior, Problem,  # noqa: E402
                             SessionStream)

START = Prior(Pose((0.0, 0.0, 0.0)), sigma=(0.5, 0.05))


def scan(index):
    return (DRIVE / "velodyne" / f"{index:06d}.bin").read_bytes()


class Server:
    """`stillmap serve` on a copy of the sample store; can be started anew on the same port."""

    def __init__(self, folder, *arguments):
        self.store, self.arguments, self.port, self.process = folder / "store", arguments, 0, None
        shutil.copytree(STORE, self.store)

    def start(self):
        self.process = subprocess.Popen([PROGRAM, "serve", "--store", self.store, "--port", str(self.port),
                                         *self.arguments], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        self.port = int(re.search(r"127\.0\.0\.1:(\d+)", self.process.stdout.readline()).group(1))
        client = Client(self.url)
        for _ in range(200):
            if client.is_ready():
                return self
            time.sleep(0.1)
        raise AssertionError("not ready within 20 s")

    def stop(self):
        if self.process is not None:
            self.process.terminate()
            self.process.communicate(timeout=30)
            self.process = None

    @property
    def url(self):
        return f"http://127.0.0.1:{self.port}"


class RealServer(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.temporary = tempfile.TemporaryDirectory()
        cls.folder = pathlib.Path(cls.temporary.name)
        cls.server = Server(cls.folder).start()
        cls.client = Client(cls.server.url)

    @classmethod
    def tearDownClass(cls):
        cls.server.stop()
        cls.temporary.cleanup()

    def test_a_scan_is_localized_flat_and_by_parts(self):
        flat = self.client.localize("town", scan(1), START, stamp_ns=2**60, deadline_ms=20000)
        self.assertEqual(flat.status, "ok", flat.raw)
        self.assertEqual((flat.map.name, flat.stamp_ns, len(flat.covariance)), ("town", 2**60, 36))
        box = MovableBox((500.0, 0.0, 0.0), (4.0, 2.0, 2.0))
        parts = self.client.localize("town", scan(1), START, T_base_lidar=Pose((0.0, 0.0, 1.0)), movable=[box],
                                     version="v1")
        self.assertEqual(parts.pose.position, flat.pose.position)
        self.assertAlmostEqual(parts.T_map_base.position[2], flat.pose.position[2] - 1.0, places=1)

    def test_arrays_and_lists_are_the_same_scan(self):
        floats = array.array("f")
        floats.frombytes(scan(1))
        points = [tuple(floats[i:i + 3]) for i in range(0, len(floats), 4)]
        wanted = self.client.localize("town", scan(1), START).pose
        self.assertEqual(self.client.localize("town", floats, START).pose, wanted)
        self.assertEqual(self.client.localize("town", points, START).pose, wanted)

    def test_what_the_server_refuses_is_a_problem_with_its_code(self):
        for code, ask in (("UnknownMap", lambda: self.client.localize("village", scan(1))),
                          ("InvalidPrior", lambda: self.client.localize("town", scan(1), Prior(Pose((0, 0, 0), (0, 0, 0, 2))))),
                          ("TooFewPoints", lambda: self.client.localize("town", [(1.0, 2.0, 3.0)] * 3))):
            with self.assertRaises(Problem) as raised:
                ask()
            self.assertEqual(raised.exception.code, code)
            self.assertTrue(raised.exception.request_id)

    def test_a_session_follows_and_tells_its_events(self):
        with self.client.open_session("town", prior=START) as session:
            first = session.track(scan(0), 0)
            step = Odometry(0, Pose((0.5, 0.0, 0.0)), sigma=(1.0, 0.1))
            second = session.track(scan(1), 100_000_000, odometry=step)
            self.assertEqual((first.status, second.status), ("ok", "ok"))
            self.assertEqual(session.info().scans, 2)
            session.initialize(START)
            events = session.events()
            self.assertEqual(next(events).type, "status")
            last = next(e for e in self.after_close(session, events) if e.type == "closed")
            self.assertEqual(last.data["reason"], "deleted")

    @staticmethod
    def after_close(session, events):
        session.close()
        yield from events

    def test_maps_come_and_go(self):
        self.assertEqual(self.client.create_map("yard").version, None)
        made = self.client.upload_version("yard", "a", PACKAGE)
        self.assertEqual(self.client.upload_version("yard", "a", PACKAGE), made)
        self.assertEqual(self.client.activate("yard", "a", if_revision=0).version, "a")
        self.client.upload_version("yard", "b", PACKAGE)
        self.client.activate("yard", "b")
        self.assertEqual(self.client.roll_back("yard").version, "a")
        with self.assertRaises(Problem) as raised:
            self.client.activate("yard", "b", if_revision=0)
        self.assertEqual(raised.exception.code, "RevisionChanged")
        self.client.delete_version("yard", "b")
        self.assertEqual([(v.name, v.active) for v in self.client.versions("yard")], [("a", True)])
        self.assertEqual(self.client.stats("yard")["queries"]["ok"], 0)
        with self.assertRaises(Problem) as raised:
            self.client.delete_map("yard")
        self.assertEqual(raised.exception.code, "VersionActive")
        self.client.delete_map("yard", active=True)
        self.assertNotIn("yard", [each.name for each in self.client.maps()])

    def test_a_download_goes_on_where_it_ended_and_can_be_uploaded(self):
        whole = self.folder / "whole.tar"
        size = self.client.download_version("town", "v1", whole)
        data = whole.read_bytes()
        self.assertEqual(size, len(data))
        cut = self.folder / "cut.tar"
        (self.folder / "cut.tar.part").write_bytes(data[:100_000])
        etag = self.client._transport.call("HEAD", "/v1/maps/town/versions/v1/content").headers["etag"]
        (self.folder / "cut.tar.etag").write_text(etag)
        self.assertEqual(self.client.download_version("town", "v1", cut), len(data))
        self.assertEqual(cut.read_bytes(), data)
        self.assertEqual(sorted(x.name for x in self.folder.glob("cut*")), ["cut.tar"])
        digest = next(v.digest for v in self.client.versions("town") if v.name == "v1")
        self.assertEqual(self.client.upload_version("copy", "v1", whole).digest, digest)
        self.client.delete_map("copy")

    def test_a_broken_upload_is_refused_in_words(self):
        broken = self.folder / "broken.tar"
        broken.write_bytes(b"\0" * 5000)
        with self.assertRaises(Problem) as raised:
            self.client.upload_version("town", "v9", broken)
        self.assertEqual(raised.exception.code, "InvalidUpload")

    def test_a_drive_comes_in_parts_and_goes_on(self):
        drive = self.folder / "drive"
        (drive / "velodyne").mkdir(parents=True)
        for name in ("calib.txt", "poses.txt", "times.txt"):
            if (DRIVE / name).exists():
                shutil.copy(DRIVE / name, drive)
        for index in range(2):
            (drive / "velodyne" / f"{index:06d}.bin").write_bytes(scan(index))
        poses = (DRIVE / "poses.txt").read_text().splitlines(True)
        (drive / "poses.txt").write_text("".join(poses[:2]))
        if (DRIVE / "times.txt").exists():
            (drive / "times.txt").write_text("".join((DRIVE / "times.txt").read_text().splitlines(True)[:2]))

        class Cut(Exception):
            pass

        def cut(there, _):
            if there > 1 << 20:
                raise Cut

        with self.assertRaises(Cut):
            self.client.upload_drive("town", drive, name="cut", part_bytes=1 << 20, on_part=cut)
        found = self.client.drives("town")[-1]
        self.assertEqual((found["name"], found["status"]), ("cut", "open"))
        told = []
        self.assertEqual(self.client.upload_drive("town", drive, drive=found["id"], part_bytes=1 << 20,
                                                  on_part=lambda there, all: told.append((there, all))), found["id"])
        self.assertEqual(told[-1][0], told[-1][1])
        self.assertEqual(self.client.drives("town")[-1]["status"], "complete")
        self.client.delete_drive("town", found["id"])


class Rebuilds(unittest.TestCase):
    """On a server of their own, whose map they change."""

    @classmethod
    def setUpClass(cls):
        cls.temporary = tempfile.TemporaryDirectory()
        cls.server = Server(pathlib.Path(cls.temporary.name), "--jobs-nice", "0").start()
        cls.client = Client(cls.server.url)
        cls.drive = cls.client.upload_drive("town", DRIVE, name="monday")

    @classmethod
    def tearDownClass(cls):
        cls.server.stop()
        cls.temporary.cleanup()

    def test_a_drive_becomes_a_version_that_is_waited_for(self):
        job = self.client.rebuild("town", [self.drive], version="made", options={"detector": "geometric"})
        self.assertEqual((job["kind"], job["map"]), ("rebuild", "town"))
        seen = []
        with self.assertRaises(TimeoutError):
            self.client.wait_for_job(job["id"], timeout_s=0.2)
        events = self.client.job_events(job["id"])
        first = next(events)
        self.assertEqual(first.type, "progress")
        ended = self.client.wait_for_job(job["id"], timeout_s=200, on_change=lambda found: seen.append(found["progress"]))
        self.assertEqual(ended["status"], "succeeded", ended)
        self.assertEqual((ended["result"]["version"], ended["result"]["activated"]), ("made", False))
        self.assertEqual((seen[-1], seen), (1.0, sorted(seen)))
        last = list(events)[-1]
        self.assertEqual((last.type, last.data["status"]), ("end", "succeeded"))
        # Whoever has seen the end is told of nothing more.
        self.assertEqual(list(self.client.job_events(job["id"], last_id=last.id)), [])
        self.assertIn("made", [each.name for each in self.client.versions("town")])
        self.assertEqual(self.client.localize("town", scan(1), START, version="made").status, "ok")

    def test_a_job_can_be_cancelled_and_its_drive_removed(self):
        drive = self.client.upload_drive("town", DRIVE)
        job = self.client.rebuild("town", [drive], options={"detector": "geometric"})["id"]
        with self.assertRaises(Problem) as raised:
            self.client.delete_drive("town", drive)
        self.assertEqual(raised.exception.code, "InUse")
        self.client.cancel_job(job)
        ended = self.client.wait_for_job(job, timeout_s=60)
        self.assertEqual(ended["status"], "canceled")
        self.assertEqual(self.client.cancel_job(job)["status"], "canceled")
        self.client.delete_drive("town", drive)
        self.assertNotIn(drive, [each["id"] for each in self.client.drives("town")])

    def test_what_cannot_be_rebuilt_is_refused(self):
        for code, ask in (("UnknownDrive", lambda: self.client.rebuild("town", [999])),
                          ("InvalidRequest", lambda: self.client.rebuild("town", [self.drive], options={"voxel": -1})),
                          ("UnknownJob", lambda: self.client.job(999)),
                          ("UnknownJob", lambda: self.client.cancel_job(999))):
            with self.assertRaises(Problem) as raised:
                ask()
            self.assertEqual(raised.exception.code, code)


class Keys(unittest.TestCase):
    def test_a_key_is_asked_for_by_scope_and_can_be_taken_back(self):
        with tempfile.TemporaryDirectory() as name:
            server = Server(pathlib.Path(name)).start()
            self.addCleanup(server.stop)

            def keys(*arguments):
                return subprocess.run([PROGRAM, "keys", *arguments, "--store", server.store], check=True,
                                      capture_output=True, text=True).stdout.strip()

            reader = keys("create", "reader", "--scope", "read")
            with self.assertRaises(Problem) as raised:
                Client(server.url).maps()
            self.assertEqual((raised.exception.status, raised.exception.code), (401, "MissingKey"))
            client = Client(server.url, reader)
            self.assertEqual([each.name for each in client.maps()], ["town"])
            for ask in (lambda: client.localize("town", scan(1)), lambda: client.create_map("a"),
                        lambda: client.upload_version("a", "b", PACKAGE)):
                with self.assertRaises(Problem) as raised:
                    ask()
                self.assertEqual(raised.exception.code, "Forbidden")
            keys("revoke", json.loads(keys("list", "--json"))["keys"][0]["id"])
            with self.assertRaises(Problem) as raised:
                client.maps()
            self.assertEqual(raised.exception.code, "RefusedKey")


class Restart(unittest.TestCase):
    def test_queries_streams_and_events_go_on_with_a_server_started_anew(self):
        with tempfile.TemporaryDirectory() as name:
            server = Server(pathlib.Path(name)).start()
            self.addCleanup(server.stop)
            client = Client(server.url, retries=12)
            answers, errors = [], []
            with SessionStream(client, "town", on_answer=lambda stamp, answer: answers.append((stamp, answer.status)),
                               on_error=lambda stamp, error: errors.append(error)) as stream:
                stream.put(scan(0), 0)
                self.assertTrue(stream.drain(30))
                server.stop()
                stream.put(scan(1), 100_000_000)
                asked = []
                asking = threading.Thread(target=lambda: asked.append(client.localize("town", scan(1), START).status))
                asking.start()
                time.sleep(0.5)
                server.start()
                self.assertTrue(stream.drain(60))
                asking.join(60)
                self.assertEqual(asked, ["ok"])
                self.assertEqual([stamp for stamp, _ in answers], [0, 100_000_000])
                self.assertNotIn("lost", [status for _, status in answers])
                self.assertTrue(any(isinstance(error, ConnectionLost) for error in errors))
                self.assertEqual(stream.sessions, 2)

    def test_the_newest_scan_is_sent_when_the_vehicle_is_faster(self):
        with tempfile.TemporaryDirectory() as name:
            server = Server(pathlib.Path(name)).start()
            self.addCleanup(server.stop)
            answers = []
            with SessionStream(Client(server.url), "town", prior=START,
                               on_answer=lambda stamp, answer: answers.append(stamp)) as stream:
                for index in range(20):
                    stream.put(scan(index), index * 100_000_000)
                self.assertTrue(stream.drain(60))
                self.assertEqual(answers, sorted(answers))
                self.assertEqual(answers[-1], 1_900_000_000)
                self.assertGreater(stream.superseded, 0)
                self.assertEqual(stream.answered + stream.superseded + stream.failed, 20)

    def test_a_stream_is_told_where_the_vehicle_is(self):
        with tempfile.TemporaryDirectory() as name:
            server = Server(pathlib.Path(name)).start()
            self.addCleanup(server.stop)
            searched = []
            with SessionStream(Client(server.url), "town",
                               on_answer=lambda _, answer: searched.append((answer.searched_from, answer.status))) as stream:
                stream.initialize(START)
                for index in range(3):
                    if index == 2:
                        stream.initialize(START)
                    stream.put(scan(index), index * 100_000_000)
                    self.assertTrue(stream.drain(60))
                self.assertEqual([each for each, _ in searched], ["given", "velocity", "given"])
                self.assertEqual({status for _, status in searched}, {"ok"})
                self.assertEqual((stream.sessions, stream.failed), (1, 0))


if __name__ == "__main__":
    unittest.main(argv=[sys.argv[0], *sys.argv[5:]])
