#!/usr/bin/env python3
"""Poses as OGC GeoPose 1.0, against OGC's own JSON schemas and against the same poses as JSON.

usage: geopose_test.py STILLMAP DRIVE SCHEMAS

SCHEMAS is tests/data/geopose. 77 = jsonschema is not installed.
"""

import array
import http.client
import json
import math
import pathlib
import re
import subprocess
import sys
import tempfile
import time
import unittest
import urllib.parse

try:
    import jsonschema
except ImportError:
    print("skipped: python3-jsonschema is not installed")
    sys.exit(77)

PROGRAM, DRIVE, SCHEMAS = (pathlib.Path(x).resolve() for x in sys.argv[1:4])

#: 65 degrees north, beside the antimeridian: the drive goes over it.
ORIGIN = (65.0, 179.9999, 30.0)
GEOPOSE, ADVANCED = "application/geopose+json", "application/geopose+json; profile=advanced"


def schema(name):
    return json.loads((SCHEMAS / f"GeoPose.{name}.Schema.json").read_text())


def faults(name, value):
    """What OGC's schema finds."""
    return [error.message for error in jsonschema.Draft201909Validator(schema(name)).iter_errors(value)]


def contract_faults(name, value):
    """What server/openapi.json finds."""
    document = json.loads((pathlib.Path(__file__).resolve().parents[2] / "server/openapi.json").read_text())
    contract = {"components": document["components"], "$ref": f"#/components/schemas/{name}"}
    return [error.message for error in jsonschema.Draft202012Validator(contract).iter_errors(value)]


def ecef(lat, lon, height):
    """WGS 84, by its formulas."""
    a, e2 = 6378137.0, 6.69437999014e-3
    lat, lon = math.radians(lat), math.radians(lon)
    n = a / math.sqrt(1.0 - e2 * math.sin(lat) ** 2)
    return ((n + height) * math.cos(lat) * math.cos(lon), (n + height) * math.cos(lat) * math.sin(lon),
            (n * (1.0 - e2) + height) * math.sin(lat))


def axes(lat, lon):
    """East, north, up in ECEF."""
    lat, lon = math.radians(lat), math.radians(lon)
    return ((-math.sin(lon), math.cos(lon), 0.0),
            (-math.sin(lat) * math.cos(lon), -math.sin(lat) * math.sin(lon), math.cos(lat)),
            (math.cos(lat) * math.cos(lon), math.cos(lat) * math.sin(lon), math.sin(lat)))


def to_ecef(enu, place):
    """A direction of the tangent plane at a place."""
    east, north, up = axes(*place)
    return tuple(enu[0] * e + enu[1] * n + enu[2] * u for e, n, u in zip(east, north, up))


def rotated(q, v):
    x, y, z, w = q
    t = (2 * (y * v[2] - z * v[1]), 2 * (z * v[0] - x * v[2]), 2 * (x * v[1] - y * v[0]))
    return (v[0] + w * t[0] + y * t[2] - z * t[1], v[1] + w * t[1] + z * t[0] - x * t[2],
            v[2] + w * t[2] + x * t[1] - y * t[0])


class GeoPose(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.temporary = tempfile.TemporaryDirectory()
        folder = pathlib.Path(cls.temporary.name)
        origin = ",".join(str(x) for x in ORIGIN)
        for name, options in (("placed", ["--geo-origin", origin]), ("nowhere", [])):
            subprocess.run([PROGRAM, "build", DRIVE, "-o", folder / name, "--select", "::4", "--detector", "geometric",
                            *options], check=True, capture_output=True)
            subprocess.run([PROGRAM, "store", "add", folder / "store", name, "v1", folder / name, "--activate"],
                           check=True, capture_output=True)
        cls.server = subprocess.Popen([PROGRAM, "serve", "--store", folder / "store", "--port", "0"],
                                      stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        cls.port = int(re.search(r"127\.0\.0\.1:(\d+)", cls.server.stdout.readline()).group(1))
        for _ in range(300):
            if cls.send("GET", "/readyz")[0] == 200:
                break
            time.sleep(0.1)

    @classmethod
    def tearDownClass(cls):
        cls.server.terminate()
        cls.server.communicate(timeout=30)
        cls.temporary.cleanup()

    @classmethod
    def send(cls, method, path, body=None, **headers):
        connection = http.client.HTTPConnection("127.0.0.1", cls.port, timeout=60)
        connection.request(method, path, body, {name.replace("_", "-"): value for name, value in headers.items()})
        answer = connection.getresponse()
        data = answer.read()
        connection.close()
        return answer.status, answer.headers, json.loads(data) if data else None

    def localize(self, accept, scan=None, map="placed"):
        scan = (DRIVE / "velodyne/000012.bin").read_bytes() if scan is None else scan
        return self.send("POST", f"/v1/maps/{map}/localize?stamp_ns=1629069964274600000", scan,
                         Content_Type="application/octet-stream", Accept=accept)

    def check(self, answer, lat, lon, height, quaternion):
        """The place and the rotation of GeoPose are those of the pose in the map."""
        pose = answer["pose"]
        placed = [x + y for x, y in zip(ecef(*ORIGIN), to_ecef(pose["position"], ORIGIN[:2]))]
        self.assertLess(math.dist(placed, ecef(lat, lon, height)), 1e-4)
        for axis in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)):
            in_map = to_ecef(rotated(pose["quaternion"], axis), ORIGIN[:2])
            q = [quaternion[k] for k in "xyzw"]
            self.assertLess(math.dist(in_map, to_ecef(rotated(q, axis), (lat, lon))), 1e-7)

    def test_basic_quaternion_is_what_the_schema_says_and_where_the_pose_is(self):
        answer = self.localize("application/json")[2]
        self.assertEqual(answer["status"], "ok", answer)
        status, headers, found = self.localize(GEOPOSE)
        self.assertEqual((status, headers["Content-Type"]), (200, "application/geopose+json; version=1.0"))
        self.assertEqual(headers["Stillmap-Status"], "ok")
        self.assertEqual(faults("Basic.Quaternion", found) + faults("Basic.Strict_Quaternion", found), [])
        self.assertEqual(contract_faults("GeoPoseBasicQuaternion", found) + contract_faults("GeoPose", found), [])
        place = found["position"]
        self.assertTrue(-180.0 <= place["lon"] <= 180.0)
        self.check(answer, place["lat"], place["lon"], place["h"], found["quaternion"])

    def test_advanced_is_what_the_schema_says_and_where_the_pose_is(self):
        status, headers, found = self.localize(ADVANCED)
        self.assertEqual((status, headers["Content-Type"]),
                         (200, "application/geopose+json; version=1.0; profile=advanced"))
        self.assertEqual(faults("Advanced", found), [])
        self.assertEqual(contract_faults("GeoPoseAdvanced", found) + contract_faults("GeoPose", found), [])
        self.assertTrue(contract_faults("GeoPoseBasicQuaternion", found))
        self.assertEqual(found["validTime"], 1629069964275)
        sample = json.loads((SCHEMAS / "sample4_Advanced.json").read_text())["frameSpecification"]
        frame = found["frameSpecification"]
        self.assertEqual((frame["authority"], frame["id"]), (sample["authority"], sample["id"]))
        place = dict(urllib.parse.parse_qsl(frame["parameters"], strict_parsing=True))
        self.assertEqual(list(place), list(dict(urllib.parse.parse_qsl(sample["parameters"]))))
        self.check(self.localize("application/json")[2], float(place["latitude"]), float(place["longitude"]),
                   float(place["height"]), found["quaternion"])

    def test_a_session_answers_in_it(self):
        session = self.send("POST", "/v1/sessions", json.dumps({"map": "placed"}),
                            Content_Type="application/json")[2]["id"]
        for index in range(12, 15):
            scan = (DRIVE / "velodyne" / f"{index:06d}.bin").read_bytes()
            status, headers, found = self.send("POST", f"/v1/sessions/{session}/scans?stamp_ns={index}00000000", scan,
                                               Content_Type="application/octet-stream", Accept=ADVANCED)
            if status == 422:  # before a second scan agrees
                self.assertEqual((found["code"], headers["Stillmap-Status"]), ("NoPose", "lost"))
        self.assertEqual(status, 200, found)
        self.assertEqual(faults("Advanced", found), [])
        self.assertEqual(found["validTime"], 1400)
        self.assertIn(headers["Stillmap-Status"], ("ok", "degraded"))

    def test_a_sealed_session_answers_in_it_and_goes_on_from_a_lost_scan(self):
        seal, statuses = {}, []
        for index in range(12, 16):
            scan = (DRIVE / "velodyne" / f"{index:06d}.bin").read_bytes()
            if index == 12:
                scan = array.array("f", [float(i % 7) for i in range(4000)]).tobytes()
            status, headers, found = self.send("POST", f"/v1/maps/placed/localize/next?stamp_ns={index}00000000", scan,
                                               Content_Type="application/octet-stream", Accept=ADVANCED, **seal)
            statuses.append(status)
            seal = {"Stillmap_Seal": headers["Stillmap-Seal"]}
        self.assertEqual((statuses[0], status), (422, 200), statuses)
        self.assertEqual(faults("Advanced", found), [])

    def test_a_lost_scan_has_none(self):
        nothing = array.array("f", [float((7 * i + j * i) % (11 + j)) for i in range(4000) for j in range(4)]).tobytes()
        status, headers, found = self.localize(GEOPOSE, nothing)
        self.assertEqual((status, found["code"], headers["Stillmap-Status"]), (422, "NoPose", "lost"), found)
        self.assertTrue(headers["Stillmap-Reasons"])
        status, _, found = self.localize(GEOPOSE + ", application/json", nothing)
        self.assertEqual((status, found["status"], found["pose"]), (200, "lost", None))

    def test_a_map_without_a_place_has_none(self):
        status, _, found = self.localize(GEOPOSE, map="nowhere")
        self.assertEqual((status, found["code"]), (406, "NotAcceptable"))
        self.assertIn("--geo-origin", found["detail"])

    def test_the_schemas_take_their_samples_and_find_faults(self):
        basic = json.loads((SCHEMAS / "sample3_BasicQuaternion.json").read_text())
        advanced = json.loads((SCHEMAS / "sample4_Advanced.json").read_text())
        self.assertEqual(faults("Basic.Strict_Quaternion", basic) + faults("Advanced", advanced), [])
        self.assertTrue(faults("Basic.Strict_Quaternion", {**basic, "status": "ok"}))
        self.assertTrue(faults("Basic.Quaternion", {"position": basic["position"]}))
        self.assertTrue(faults("Advanced", {**advanced, "validTime": "now"}))
        self.assertTrue(faults("Advanced", basic))


if __name__ == "__main__":
    unittest.main(argv=[sys.argv[0], *sys.argv[4:]])
