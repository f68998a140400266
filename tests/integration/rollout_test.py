#!/usr/bin/env python3
"""A bad version of a map is rolled out to some vehicles of a running server: their scans are lost, the roll-out halts,
and everyone is back in the active version, also after a restart.

usage: rollout_test.py STILLMAP MAP DRIVE

MAP and DRIVE are those of sample_map.sh. The bad version is a map of another town that claims to be in the same frame.
"""

import json
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import time
import unittest
import urllib.error
import urllib.request

PROGRAM, MAP, DRIVE = sys.argv[1], pathlib.Path(sys.argv[2]), pathlib.Path(sys.argv[3])
BAD, GOOD = [f"depot-{i}" for i in range(3)], [f"truck-{i}" for i in range(3)]


def run(*words):
    done = subprocess.run([PROGRAM, *map(str, words)], capture_output=True, text=True, timeout=200)
    assert done.returncode == 0, done.stderr
    return done.stdout


class Rollout(unittest.TestCase):
    def setUp(self):
        self.folder = pathlib.Path(tempfile.mkdtemp())
        self.addCleanup(shutil.rmtree, self.folder)
        self.store = self.folder / "store"
        self.store.mkdir()
        run("simulate", "town", "-o", self.folder / "drive", "--seed", "9", "--scans", "40")
        run("build", self.folder / "drive", "-o", self.folder / "bad", "--select", "::2")
        # Both say that they are at one place on the Earth, so the server takes them for maps of one frame.
        shutil.copytree(MAP, self.folder / "good")
        for name, version in (("good", "v1"), ("bad", "v2")):
            file = self.folder / name / "manifest.json"
            manifest = json.loads(file.read_text())
            manifest["geodetic_origin"] = {"latitude_deg": 48.0, "longitude_deg": 11.0, "altitude_m": 500.0}
            file.write_text(json.dumps(manifest))
            run("store", "add", self.store, "town", version, self.folder / name)
        run("store", "activate", self.store, "town", "v1")
        self.log = (self.folder / "log").open("w+")
        self.addCleanup(self.log.close)
        self.start()
        self.addCleanup(self.stop)
        self.scan = (DRIVE / "velodyne" / "000001.bin").read_bytes()

    def start(self):
        self.server = subprocess.Popen([PROGRAM, "serve", "--store", self.store, "--port", "0"], stdout=subprocess.PIPE,
                                       stderr=self.log, text=True)
        port = re.search(r"127\.0\.0\.1:(\d+)", self.server.stdout.readline()).group(1)
        self.url = f"http://127.0.0.1:{port}"
        self.wait(lambda: self.status("/readyz") == 200)

    def stop(self):
        self.server.terminate()
        self.server.wait()
        self.server.stdout.close()

    def wait(self, come):
        end = time.monotonic() + 60
        while not come():
            self.assertLess(time.monotonic(), end)
            time.sleep(0.05)

    def status(self, path):
        try:
            with urllib.request.urlopen(self.url + path, timeout=30) as answer:
                return answer.status
        except urllib.error.HTTPError as error:
            return error.code

    def ask(self, method, path, body=None, kind="application/json"):
        data = json.dumps(body).encode() if isinstance(body, dict) else body
        asked = urllib.request.Request(self.url + path, data, {"Content-Type": kind} if data else {}, method=method)
        with urllib.request.urlopen(asked, timeout=30) as answer:
            text = answer.read()
            return json.loads(text) if text else None

    def localize(self, vehicle):
        path = f"/v1/maps/town/localize?prior_t=0,0,0&prior_q=0,0,0,1&vehicle={vehicle}"
        return self.ask("POST", path, self.scan, "application/octet-stream")

    def rollout(self):
        return self.ask("GET", "/v1/maps/town/rollout")

    def test_a_bad_version_is_halted_and_all_are_back(self):
        self.ask("PUT", "/v1/maps/town/rollout",
                 {"version": "v2", "vehicles": ["depot-*"], "halt": {"least_answers": 20}})
        self.wait(lambda: self.rollout()["version_state"] == "ready")
        for vehicle, version in ((BAD[0], "v2"), (GOOD[0], "v1")):
            copy = run("mirror", self.url, "town", "-o", self.folder / f"copy_{vehicle}", "--vehicle", vehicle, "--json")
            self.assertEqual(json.loads(copy)["version"], version)
        found = {name: [] for name in BAD + GOOD}
        for _ in range(40):
            for name in found:
                found[name].append(self.localize(name))
            if self.rollout()["state"] == "halted":
                break
        rollout = self.rollout()
        self.assertEqual(rollout["state"], "halted", rollout)
        self.assertRegex(rollout["reason"], "answers in the new version are (degraded or )?lost")
        self.assertGreaterEqual(sum(rollout["answers"]["rollout"].values()), 20)
        self.assertEqual({each["map"]["version"] for name in GOOD for each in found[name]}, {"v1"})
        self.assertEqual(found[BAD[0]][0]["map"]["version"], "v2")
        self.assertNotEqual(found[BAD[0]][0]["status"], "ok")
        self.assertEqual(found[GOOD[0]][0]["status"], "ok")
        for name in BAD:
            answer = self.localize(name)
            self.assertEqual((answer["map"]["version"], answer["status"]), ("v1", "ok"))
        vehicles = {each["label"]: each for each in self.ask("GET", "/v1/maps/town/vehicles")["vehicles"]}
        self.assertEqual(sorted(vehicles), BAD + GOOD)
        self.assertGreater(vehicles[BAD[0]]["answers"]["lost"] + vehicles[BAD[0]]["answers"]["degraded"], 5)
        self.assertEqual(vehicles[BAD[0]]["version"], "v1")
        self.log.flush()
        self.assertIn("the roll-out of version 'v2' of map 'town' is halted", (self.folder / "log").read_text())
        self.assertEqual(self.status("/v1/maps/town/versions/v2"), 200)

        self.stop()
        self.start()
        self.assertEqual((self.rollout()["state"], self.rollout()["reason"]), ("halted", rollout["reason"]))
        self.assertEqual(self.localize(BAD[0])["map"]["version"], "v1")
        self.assertIsNone(self.ask("DELETE", "/v1/maps/town/rollout"))
        self.assertEqual(self.rollout(), {"map": "town", "state": "none"})


if __name__ == "__main__":
    unittest.main(argv=[sys.argv[0], *sys.argv[4:]])
