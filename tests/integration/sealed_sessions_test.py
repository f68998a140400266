#!/usr/bin/env python3
"""Sealed sessions over three servers with copies of one store: they go on from one to the next, whoever is killed.

usage: sealed_sessions_test.py STILLMAP STORE DRIVE USE_CLIENT

USE_CLIENT is the program of use_client.cpp.
"""

import base64
import json
import pathlib
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
import unittest
import urllib.parse

PROGRAM, STORE, DRIVE, USE_CLIENT = (pathlib.Path(x).resolve() for x in sys.argv[1:5])
ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path += [str(ROOT / "server/clients/python/src"), str(ROOT / "tests/soak")]

from serving import Server  # noqa: E402
from stillmap_client import Client, ConnectionLost, Odometry, Pose, Prior, Problem, SessionStream  # noqa: E402

START = Prior(Pose((0.0, 0.0, 0.0)), sigma=(0.5, 0.05))
NEXT = "/v1/maps/town/localize/next"
SCANS = len(list((DRIVE / "velodyne").glob("*.bin")))


def scan(index):
    return (DRIVE / "velodyne" / f"{index:06d}.bin").read_bytes()


def stamp(index):
    return 100_000_000 * (index + 1)


def lasting(answer):
    """All of an answer that two servers must have in common. A session of a server got its prior before."""
    own = ("request_id", "timing_ms", "session", "warnings", "prior_to_pose")
    return {key: value for key, value in answer.raw.items() if key not in own}


class Sealed(unittest.TestCase):
    def setUp(self):
        temporary = tempfile.TemporaryDirectory()
        self.addCleanup(temporary.cleanup)
        self.folder = pathlib.Path(temporary.name)
        first = self.folder / "store-0"
        shutil.copytree(STORE, first)
        self.servers = [self.start(0)]  # makes the key
        for index in (1, 2):
            shutil.copytree(STORE, self.folder / f"store-{index}")
            shutil.copy2(first / "seal.keys", self.folder / f"store-{index}" / "seal.keys")
            self.servers.append(self.start(index))

    def start(self, index):
        server = Server(PROGRAM, self.folder / f"store-{index}", self.folder / f"log-{index}")
        self.addCleanup(lambda: server.process.poll() is None and server.kill())
        self.assertTrue(server.listen(), "did not listen")
        server.wait_ready(30.0)
        return server

    def client(self, server, **more):
        return Client(f"http://127.0.0.1:{server.port}", **more)

    def sealed(self, *servers, **more):
        first, *others = [self.client(each, retries=1) for each in servers]
        return first.sealed_session("town", others=others, **more)

    def ask(self, server, index, seal=None, body=None, path=NEXT, **query):
        headers = {"Content-Type": "application/octet-stream", **({} if seal is None else {"Stillmap-Seal": seal})}
        return server.ask("POST", path + "?" + urllib.parse.urlencode({"stamp_ns": stamp(index), **query}),
                          scan(index) if body is None else body, headers)

    def test_a_drive_over_servers_that_are_killed_equals_one_session_of_one_server(self):
        a, b, c = self.servers
        # The map has the even scans. Odometry now and then, as the session of the server has it.
        step = {index: Odometry(stamp(index - 1), Pose((1.0, 0.0, 0.0)), sigma=(1.0, 0.1)) for index in range(1, SCANS, 5)}
        with self.client(c).open_session("town", prior=START) as session:
            expected = [lasting(session.track(scan(index), stamp(index), odometry=step.get(index))) for index in range(SCANS)]
        self.assertGreater(sum(each["status"] == "ok" for each in expected), 0.9 * SCANS)
        sealed, killed = self.sealed(a, b, c, prior=START), []
        for index in range(SCANS):
            if index == 10:
                a.kill()
                killed.append(a)
            if index == 20:
                b.kill()
                a = self.servers[0] = self.start(0)
                killed.append(b)
            answer = sealed.track(scan(index), stamp(index), odometry=step.get(index))
            self.assertEqual(lasting(answer), expected[index], f"scan {index}")
            self.assertEqual(answer.warnings, ())
            # Every other scan on another server than the one before.
            if index % 2 == 0:
                sealed._servers.append(sealed._servers.pop(0))
        self.assertEqual((sealed.begun, len(killed)), (1, 2))
        self.assertEqual(sum(each["searched_from"] == "everywhere" for each in expected), 0)

    def test_a_server_that_dies_within_an_answer_costs_nothing(self):
        a, b, _ = self.servers
        sealed = self.sealed(a, b, prior=START)
        for index in range(4):
            before = sealed.track(scan(index), stamp(index))
        kill = threading.Timer(0.005, a.process.send_signal, (signal.SIGKILL,))
        kill.start()
        for index in range(4, 20):
            answer = sealed.track(scan(index), stamp(index))
            self.assertEqual((answer.status, answer.session), ("ok", before.session), f"scan {index}")
            self.assertNotEqual(answer.searched_from, "everywhere")
        kill.join()
        self.assertEqual(sealed.begun, 1)

    def test_the_client_in_cpp_goes_on_as_well(self):
        a, b, _ = self.servers
        sealed = self.sealed(b, prior=START)
        expected = [lasting(sealed.track(scan(index), stamp(index))) for index in range(12)]
        urls = ",".join(f"http://127.0.0.1:{server.port}" for server in (a, b))
        a.kill()
        done = subprocess.run([USE_CLIENT, "follow", urls, *(DRIVE / "velodyne" / f"{index:06d}.bin" for index in range(12))],
                              capture_output=True, text=True, timeout=60)
        self.assertEqual(done.returncode, 0, done.stderr)
        found = json.loads(done.stdout)
        self.assertEqual(found["begun"], 1)
        for index, answer in enumerate(found["answers"]):
            self.assertEqual({key: answer[key] for key in expected[index]}, expected[index], f"scan {index}")

    def test_the_same_seal_at_two_servers_at_once(self):
        a, b, _ = self.servers
        seal = self.ask(a, 0, prior_t="0,0,0", prior_q="0,0,0,1", prior_sigma="0.5,0.05").headers["Stillmap-Seal"]
        for index in range(1, 10):
            answers = [None, None]

            def race(which, server):
                answers[which] = self.ask(server, index, seal)

            threads = [threading.Thread(target=race, args=each) for each in enumerate((a, b))]
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join()
            here, there = answers
            self.assertEqual((here.status, there.status), (200, 200), here.body)
            self.assertEqual(here.json["pose"], there.json["pose"])
            self.assertEqual(here.json["covariance"], there.json["covariance"])
            self.assertNotEqual(here.headers["Stillmap-Seal"], there.headers["Stillmap-Seal"])
            # Whichever answer the vehicle takes.
            seal = answers[index % 2].headers["Stillmap-Seal"]
        again = self.ask(a, 9, seal=self.ask(a, 8).headers["Stillmap-Seal"])
        self.assertEqual(again.json["warnings"], [])

    def test_a_changed_byte_is_refused_and_a_rotated_key_goes_on(self):
        a, b, _ = self.servers
        seal = self.ask(a, 0).headers["Stillmap-Seal"]
        self.assertLessEqual(len(seal), 2328)
        whole = base64.b64decode(seal)
        refusals = set()
        for at in range(0, len(whole), 97):
            changed = bytearray(whole)
            changed[at] ^= 1
            refused = self.ask(b, 1, base64.b64encode(bytes(changed)).decode())
            refusals.add((refused.status, refused.json["code"], refused.json["detail"]))
        refused = self.ask(b, 1, seal[:-8])
        refusals.add((refused.status, refused.json["code"], refused.json["detail"]))
        self.assertEqual(len(refusals), 1, refusals)
        self.assertEqual(refusals.pop()[:2], (400, "InvalidSeal"))
        key = (self.folder / "store-1" / "seal.keys").read_text().split()[0]
        done = subprocess.run([PROGRAM, "store", "rotate-seal-key", self.folder / "store-1"], capture_output=True, text=True)
        self.assertEqual(done.returncode, 0, done.stderr)
        time.sleep(1.1)
        after = self.ask(b, 1, seal)
        self.assertEqual(after.status, 200, after.body)
        self.assertEqual(self.ask(b, 2, after.headers["Stillmap-Seal"]).status, 200)
        self.assertEqual(self.ask(a, 2, after.headers["Stillmap-Seal"]).json["code"], "InvalidSeal")
        for log in self.folder.glob("log-*"):
            self.assertNotIn(key, log.read_text())
            self.assertNotIn(seal[:40], log.read_text())

    def test_a_backup_has_no_key(self):
        done = subprocess.run([PROGRAM, "store", "backup", self.folder / "store-0", "-o", self.folder / "backup"],
                              capture_output=True, text=True)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertEqual(list((self.folder / "backup").rglob("seal.keys")), [])
        key = (self.folder / "store-0" / "seal.keys").read_text().strip()
        for file in (self.folder / "backup").rglob("state.db*"):
            self.assertNotIn(key.encode(), file.read_bytes())

    def test_a_client_begins_anew_where_its_seal_is_of_no_more_use(self):
        a, _, _ = self.servers
        sealed = self.sealed(a, seal="AAAA")
        self.assertEqual(sealed.track(scan(0), stamp(0)).searched_from, "everywhere")
        self.assertEqual(sealed.begun, 1)
        with self.assertRaises(Problem) as raised:
            sealed.track(scan(0), stamp(0))
        self.assertEqual(raised.exception.code, "ScanNotNewer")
        bad = self.client(a).sealed_session("town", prior=Prior(Pose((0, 0, 0))))
        with self.assertRaises(Problem) as raised:
            bad.track(scan(0), stamp(0))
        self.assertEqual(raised.exception.code, "InvalidPrior")
        self.assertEqual(bad.track(scan(0), stamp(0)).searched_from, "everywhere")
        for server in self.servers:
            server.kill()
        with self.assertRaises(ConnectionLost):
            sealed.track(scan(1), stamp(1))
        self.assertIsNotNone(sealed.seal)

    def test_a_stream_outlives_its_servers(self):
        a, b, _ = self.servers
        answers = []
        with SessionStream(self.client(a, retries=1), "town", on_answer=lambda stamp_ns, answer: answers.append(answer),
                           prior=START, sealed=True, others=[self.client(b, retries=1)]) as stream:
            for index in range(20):
                stream.put(scan(index), stamp(index))
                self.assertTrue(stream.drain(30.0))
                if index == 8:
                    a.kill()
            self.assertEqual((len(answers), stream.failed, stream.sessions), (20, 0, 1))
        self.assertEqual({answer.status for answer in answers}, {"ok"})


if __name__ == "__main__":
    unittest.main(argv=[sys.argv[0], *sys.argv[5:]])
