#!/usr/bin/env python3
"""A drive becomes a version over HTTP, whatever is killed on the way.

usage: jobs_test.py STILLMAP MAP DRIVE, of sample_map.sh
"""

import base64
import hashlib
import http.client
import io
import json
import os
import pathlib
import signal
import subprocess
import sys
import tarfile
import tempfile
import threading
import time
import unittest

PROGRAM, MAP, DRIVE = sys.argv[1], sys.argv[2], pathlib.Path(sys.argv[3])
LONG_S = 240


def tar_of(folder):
    packed = io.BytesIO()
    with tarfile.open(fileobj=packed, mode="w:gz", compresslevel=1) as tar:
        tar.add(folder, arcname="drive")
    return packed.getvalue()


def is_alive(pid):
    try:
        return pathlib.Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] not in "ZX"
    except OSError:
        return False


class Jobs(unittest.TestCase):
    def setUp(self):
        temporary = tempfile.TemporaryDirectory()
        self.addCleanup(temporary.cleanup)
        self.store = pathlib.Path(temporary.name) / "store"
        self.store.mkdir()
        subprocess.run([PROGRAM, "store", "add", self.store, "town", "v1", MAP, "--activate"], check=True, capture_output=True)
        self.addCleanup(self.end_server)
        self.serve()

    def serve(self):
        self.server = subprocess.Popen([PROGRAM, "serve", "--store", self.store, "--port", "0", "--jobs-nice", "0"],
                                       stdout=subprocess.PIPE, text=True)
        self.port = int(self.server.stdout.readline().rsplit(":", 1)[1].strip().rstrip("/"))
        self.addCleanup(self.server.stdout.close)

    def end_server(self):
        self.server.kill()
        self.server.wait()

    def ask(self, method, path, body=None, **headers):
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=LONG_S)
        try:
            connection.request(method, path, body, {name.replace("_", "-"): value for name, value in headers.items()})
            response = connection.getresponse()
            text = response.read()
            return response.status, json.loads(text) if text else None
        finally:
            connection.close()

    def upload(self, packed):
        status, drive = self.ask("POST", "/v1/maps/town/drives", '{"name": "monday"}', content_type="application/json")
        self.assertEqual(status, 201, drive)
        place = f"/v1/maps/town/drives/{drive['id']}"
        third = len(packed) // 3 + 1
        for n in (3, 1, 2):
            part = packed[(n - 1) * third:n * third]
            digest = base64.b64encode(hashlib.sha256(part).digest()).decode()
            status, answer = self.ask("PUT", f"{place}/parts/{n}", part, content_digest=f"sha-256=:{digest}:")
            self.assertEqual(status, 201, answer)
        status, drive = self.ask("POST", f"{place}/complete")
        self.assertEqual((status, drive["status"]), (200, "complete"), drive)
        return drive["id"]

    def wait(self, job, holds):
        end = time.monotonic() + LONG_S
        while time.monotonic() < end:
            found = self.ask("GET", job)[1]
            if holds(found):
                return found
            self.assertNotIn(found["status"], ("failed", "canceled"), found)
            time.sleep(0.05)
        self.fail(f"waited in vain: {found}")

    def mapper(self):
        """Process id of the mapper that the server runs."""
        children = []
        for task in pathlib.Path(f"/proc/{self.server.pid}/task").iterdir():
            children += (task / "children").read_text().split()
        self.assertEqual(len(children), 1, children)
        return int(children[0])

    def events(self, job):
        """All of a job's, in the background."""
        kinds = []

        def listen():
            connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=LONG_S)
            connection.request("GET", job + "/events")
            for line in connection.getresponse():
                if line.startswith(b"event: "):
                    kinds.append(line[7:].strip().decode())
            connection.close()

        thread = threading.Thread(target=listen)
        thread.start()
        return thread, kinds

    def test_drive_becomes_the_active_version_whatever_is_killed_on_the_way(self):
        packed = tar_of(DRIVE)
        drive, held_back = self.upload(packed), self.upload(packed)
        order = json.dumps({"drives": [drive], "held_back": held_back, "version": "v2", "activate": True,
                            "options": {"detector": "geometric"}})
        headers = {"content_type": "application/json", "idempotency_key": "once"}
        status, job = self.ask("POST", "/v1/maps/town/rebuild", order, **headers)
        self.assertEqual(status, 202, job)
        path = f"/v1/jobs/{job['id']}"
        self.wait(path, lambda found: found["stage"].startswith("map: "))
        os.kill(self.mapper(), signal.SIGKILL)
        crashed = self.wait(path, lambda found: found["attempts"] == 2 and found["progress"] > 0.0)
        self.assertEqual(crashed["status"], "processing")

        mapper = self.mapper()
        self.server.kill()
        self.server.wait()
        end = time.monotonic() + 5
        while is_alive(mapper) and time.monotonic() < end:
            time.sleep(0.01)
        self.assertFalse(is_alive(mapper), "the mapper outlives its server")
        self.serve()
        self.assertEqual(self.ask("POST", "/v1/maps/town/rebuild", order, **headers)[1]["id"], job["id"])
        thread, kinds = self.events(path)
        done = self.wait(path, lambda found: found["status"] == "succeeded")
        thread.join(timeout=10)
        self.assertEqual(kinds.count("end"), 1)
        self.assertEqual(kinds[-1], "end")
        self.assertEqual(done["attempts"], 3)
        self.assertEqual(done["result"]["gate"]["verdict"], "pass", done["result"])
        self.assertTrue(done["result"]["activated"], done["result"])
        self.check_pose()
        end = time.monotonic() + LONG_S
        left = self.store / "jobs" / str(job["id"])
        while (left / "scratch").exists() and time.monotonic() < end:
            time.sleep(0.05)
        self.assertEqual(sorted(each.name for each in left.iterdir()), ["log"])
        self.assertEqual(self.ask("DELETE", f"/v1/maps/town/drives/{drive}")[0], 204)
        self.assertFalse((self.store / "drives" / str(drive)).exists())

    def check_pose(self):
        scan = (DRIVE / "velodyne" / "000001.bin").read_bytes()
        end = time.monotonic() + LONG_S
        status = 503
        while status == 503 and time.monotonic() < end:
            status, pose = self.ask("POST", "/v1/maps/town/localize?prior_t=0,0,0&prior_q=0,0,0,1", scan,
                                    content_type="application/octet-stream")
            time.sleep(0.1)
        self.assertEqual((status, pose["status"], pose["map"]["version"]), (200, "ok", "v2"), pose)

    def test_cancelled_job_ends_soon_and_frees_its_drive(self):
        drive = self.upload(tar_of(DRIVE))
        order = json.dumps({"drives": [drive], "options": {"detector": "geometric"}})
        status, job = self.ask("POST", "/v1/maps/town/rebuild", order, content_type="application/json")
        self.assertEqual(status, 202, job)
        path = f"/v1/jobs/{job['id']}"
        self.wait(path, lambda found: found["stage"].startswith("map: "))
        begin = time.monotonic()
        self.assertEqual(self.ask("POST", path + "/cancel")[0], 202)
        while self.ask("GET", path)[1]["status"] != "canceled":
            self.assertLess(time.monotonic() - begin, 10)
            time.sleep(0.02)
        self.assertEqual(self.ask("DELETE", f"/v1/maps/town/drives/{drive}")[0], 204)

    def test_cloud_becomes_a_version_of_a_new_map(self):
        points = "".join(f"{0.25 * (i % 200)} {0.25 * (i // 200)} 0\n" for i in range(40000))
        header = ("VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 40000\nHEIGHT 1\n"
                  "VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 40000\nDATA ascii\n")
        place = "/v1/maps/yard/versions/v1"
        status, job = self.ask("PUT", place, header + points, content_type="application/vnd.pcd")
        self.assertEqual(status, 202, job)
        self.wait(f"/v1/jobs/{job['id']}", lambda found: found["status"] == "succeeded")
        self.assertEqual(self.ask("PUT", place, header + points, content_type="application/vnd.pcd")[0], 200)
        self.assertEqual(self.ask("GET", place)[1]["name"], "yard")


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
