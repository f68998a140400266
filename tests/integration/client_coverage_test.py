#!/usr/bin/env python3
"""What the clients send and understand, against server/openapi.json: whatever the document has for poses and sessions
and a client has not fails here by name.

usage: client_coverage_test.py OPENAPI USE_CLIENT

USE_CLIENT is the program of use_client.cpp.
"""

import array
import dataclasses
import http.server
import json
import math
import pathlib
import re
import subprocess
import sys
import tempfile
import threading
import unittest
import urllib.parse

OPENAPI, USE_CLIENT = (pathlib.Path(x).resolve() for x in sys.argv[1:3])
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "server/clients/python/src"))

from stillmap_client import (Client, Gnss, MovableBox, Odometry, Pcd, Pose, PoseAnswer, Prior, Query)  # noqa: E402

DOCUMENT = json.loads(OPENAPI.read_text())
#: Of the query, and the key of JSON that says the same.
TWINS = {"prior_t": "prior", "prior_q": "prior", "prior_sigma": "prior", "odom_since_ns": "odometry",
         "odom_t": "odometry", "odom_q": "odometry", "odom_sigma": "odometry"}
PACKAGE = bytes(range(250)) * 28
#: What a client need not send: a scan as JSON is for people, PCD is for files.
OTHER_SCANS = {"application/json"}
CPP_OTHER_SCANS = {"application/json", "application/vnd.pcd"}


def resolved(value):
    while "$ref" in value:
        place = DOCUMENT
        for part in value["$ref"][2:].split("/"):
            place = place[part.replace("~1", "/").replace("~0", "~")]
        value = place
    return value


def operations():
    """Those of poses and sessions, and the download of a map: (method, path, operation)."""
    for path, item in DOCUMENT["paths"].items():
        for method in ("get", "put", "post", "delete"):
            operation = item.get(method)
            if operation and (set(operation["tags"]) & {"pose", "sessions"} or path.endswith("/{version}/content")):
                yield method.upper(), path, operation


def sample(schema, name=""):
    """A value with every property that a schema has, and other numbers and words for each."""
    schema = resolved(schema)
    if "oneOf" in schema:
        return sample(next(each for each in schema["oneOf"] if each.get("type") != "null"), name)
    if "enum" in schema:
        return schema["enum"][0]
    kind = schema.get("type")
    kind = next((each for each in kind if each != "null"), None) if isinstance(kind, list) else kind
    if kind == "object":
        return {key: sample(each, key) for key, each in schema.get("properties", {}).items()}
    if kind == "array":
        return [sample(schema["items"], name) for _ in range(schema.get("minItems", 1))]
    sample.count += 1
    if kind == "integer":
        return sample.count
    if kind == "number":
        return sample.count + 0.5
    if "longitude=" in schema.get("pattern", ""):
        return "longitude=8.5&latitude=49.25&height=-110.125"
    return str(10**15 + sample.count) if "[0-9]" in schema.get("pattern", "") else f"{name}-{sample.count}"


sample.count = 0


def parts_of(body, kind):
    """Those of a multipart body, by name: type and bytes."""
    boundary = ("--" + re.search("boundary=(.*)", kind).group(1)).encode()
    found = {}
    for part in body.split(boundary)[1:-1]:
        head, _, data = part[2:-2].partition(b"\r\n\r\n")
        found[re.search(rb'name="(.*?)"', head).group(1).decode()] = (
            re.search(rb"Content-Type: (\S+)", head).group(1).decode(), data)
    return found


class Recorder:
    """A server that answers by the document, and keeps what it was asked."""

    def __init__(self):
        recorder, self.seen, self.answers = self, [], {}
        self.patterns = [(method, re.compile(re.sub(r"\{\w+\}", "[^/]+", path) + "$"), operation)
                         for method, path, operation in operations()]

        class Handler(http.server.BaseHTTPRequestHandler):
            def log_message(self, *_):
                pass

            def do(self):
                parts = urllib.parse.urlsplit(self.path)
                body = self.rfile.read(int(self.headers.get("Content-Length", 0)))
                operation = next(operation for method, pattern, operation in recorder.patterns
                                 if method == self.command and pattern.match(parts.path))
                recorder.seen.append((operation["operationId"], dict(urllib.parse.parse_qsl(parts.query)),
                                      {name.lower(): value for name, value in self.headers.items()}, body))
                status, headers, data = recorder.answer(operation, self.headers.get("Accept", ""))
                size = len(data)
                if data == PACKAGE and "Range" not in self.headers:
                    data = data[:3000]  # the connection is lost
                elif data == PACKAGE:
                    status, data = 206, data[int(self.headers["Range"][6:-1]):]
                    size = len(data)
                self.send_response(status)
                for name, value in headers.items():
                    self.send_header(name, value)
                if status != 204:
                    self.send_header("Content-Length", str(size))
                self.end_headers()
                self.wfile.write(data)

            do_GET = do_POST = do_DELETE = do

        self.server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.server.daemon_threads = True
        threading.Thread(target=self.server.serve_forever, args=(0.05,), daemon=True).start()
        self.url = f"http://127.0.0.1:{self.server.server_port}"

    def answer(self, operation, accept):
        status, described = next((int(status), resolved(each)) for status, each in operation["responses"].items()
                                 if status.startswith("2"))
        content = described.get("content", {})
        if not content:
            return status, {}, b""
        if "text/event-stream" in content:
            return status, {"Content-Type": "text/event-stream"}, (
                b'id: 4\nevent: status\ndata: {"status": "ok"}\n\n: silence\n\nevent: gap\ndata: {"missed": 1}\n\n'
                b'id: 9\nevent: closed\ndata: {"reason": "deleted"}\n\n')
        if "application/json" not in content:
            return status, {"Content-Type": next(iter(content)), "ETag": '"e"'}, PACKAGE
        geopose = "application/geopose+json" in accept
        value = sample(content["application/json"]["schema"] if not geopose else
                       {"$ref": "#/components/schemas/GeoPoseAdvanced"})
        if operation["operationId"].startswith("localizeBatch"):
            value["answers"] = [{"status": 200, "answer": value["answers"][0]["answer"]}]
        self.answers[("geopose " if geopose else "") + operation["operationId"]] = value
        kind = "application/geopose+json" if geopose else "application/json"
        return status, {"Content-Type": kind, "Stillmap-Status": "degraded", "Stillmap-Seal": "c2VhbA==",
                        "Stillmap-Revision": "3", "Stillmap-Reasons": "ambiguous, coasting"}, json.dumps(value).encode()

    def close(self):
        self.server.shutdown()
        self.server.server_close()


class Sent:
    """What was sent of one operation, over all its calls."""

    def __init__(self, recorder, operation):
        self.names, self.kinds, self.accepted, self.json = set(), set(), "", {}
        for name, query, headers, body in recorder.seen:
            if name != operation["operationId"]:
                continue
            self.names |= set(query) | set(headers)
            self.accepted += headers.get("accept", "") + " "
            kind = headers.get("content-type", "")
            self.kinds.add(kind.split(";")[0])
            if kind.startswith("multipart/"):
                parts = parts_of(body, kind)
                self.json = merged(self.json, json.loads(parts["request"][1]))
                self.kinds |= {kind for kind, _ in parts.values()} - {"application/json"}
            elif kind.startswith("application/json") and body:
                self.json = merged(self.json, json.loads(body))


def merged(a, b):
    if isinstance(a, dict) and isinstance(b, dict):
        return {key: merged(a.get(key), b.get(key)) for key in {*a, *b}}
    return a if b is None else b


def lacks(schema, value, path):
    """Properties of a schema that a value has not."""
    schema = resolved(schema)
    if schema.get("type") == "array" and schema["items"] and isinstance(value, list):
        return lacks(schema["items"], value[0], path + "[]") if value else [path + "[]"]
    found = []
    for key, each in schema.get("properties", {}).items():
        if not isinstance(value, dict) or key not in value:
            found.append(f"{path}.{key}")
        else:
            found += lacks(each, value[key], f"{path}.{key}")
    return found


def missing_in_requests(recorder, other_scans):
    found = []
    for method, path, operation in operations():
        sent, name = Sent(recorder, operation), operation["operationId"]
        if not any(each[0] == name for each in recorder.seen):
            found.append(f"{name} ({method} {path}): never called")
            continue
        for parameter in map(resolved, operation.get("parameters", [])):
            there = {parameter["name"], TWINS.get(parameter["name"], parameter["name"])} & (
                {each.lower() for each in sent.names} | set(sent.json)) or parameter["name"].lower() in sent.names
            if parameter["in"] != "path" and not there and parameter["name"] not in ("Range", "If-Range", "If-None-Match"):
                found.append(f"{name}: {parameter['name']}")
        content = operation.get("requestBody", {}).get("content", {})
        scans = "multipart/form-data" in content
        for kind in set(content) - sent.kinds - (other_scans if scans else set()):
            found.append(f"{name}: body {kind}")
        for kind in ("application/json", "multipart/form-data"):
            schema = resolved(content.get(kind, {}).get("schema", {}))
            if kind == "multipart/form-data":
                schema = resolved(schema.get("properties", {}).get("request", {}))
            elif scans and not name.startswith("localizeBatch"):
                continue  # as the part `request`, and the points themselves
            found += [each for each in lacks(schema, sent.json, name) if not each.endswith(".points")]
        for status, response in operation["responses"].items():
            for kind in resolved(response).get("content", {}) if status.startswith("2") else ():
                usual = kind.startswith(("application/json", "application/octet", "application/x-tar", "application/zstd"))
                if not usual and kind not in sent.accepted:
                    found.append(f"{name}: Accept {kind}")
    return found


def differences(expected, found, path):
    """Where a client's types hold something else than an answer."""
    if isinstance(expected, dict):
        return [each for key in expected
                for each in (differences(expected[key], found[key], f"{path}.{key}")
                             if isinstance(found, dict) and key in found else [f"{path}.{key}: nothing"])]
    if isinstance(expected, list):
        if not isinstance(found, list) or len(found) != len(expected):
            return [f"{path}: {found}"]
        return [each for i, (x, y) in enumerate(zip(expected, found)) for each in differences(x, y, f"{path}[{i}]")]
    return [] if str(expected) == str(found) or expected == found else [f"{path}: found {found}, expected {expected}"]


def plain(value):
    """A Python client's value as JSON."""
    if dataclasses.is_dataclass(value):
        return {each.name: plain(getattr(value, each.name)) for each in dataclasses.fields(value) if each.name != "raw"}
    return [plain(each) for each in value] if isinstance(value, tuple) else value


class Coverage(unittest.TestCase):
    def setUp(self):
        self.maxDiff = None
        self.recorder = Recorder()
        self.addCleanup(self.recorder.close)
        temporary = tempfile.TemporaryDirectory()
        self.addCleanup(temporary.cleanup)
        self.folder = pathlib.Path(temporary.name)

    def check_answers(self, found):
        """@param found  by operationId, of whatever was called last."""
        answers = dict(self.recorder.answers)
        for name in ("localizeBatch", "localizeBatchInVersion"):
            answers[name] = answers[name]["answers"][0]["answer"]
        answers["listSessions"] = answers["listSessions"]["sessions"][0]
        self.assertEqual([each for name in found for each in differences(answers[name], found[name], name)], [])
        self.assertEqual(set(answers) - set(found), {name for name in answers if name.startswith("geopose ")}
                         | {"openSession"} & set(answers))

    def check_geopose(self, pose, name):
        answer = self.recorder.answers["geopose " + name]
        self.assertEqual((pose["status"], pose["reasons"]), ("degraded", ["ambiguous", "coasting"]))
        self.assertEqual(pose["place"], [8.5, 49.25, -110.125])
        self.assertEqual(pose["quaternion"], [answer["quaternion"][each] for each in "xyzw"])
        self.assertEqual(pose["valid_time_ms"], answer["validTime"])

    def test_python(self):
        client = Client(self.recorder.url, retries=2)
        xyzi = array.array("f", [1.0] * 240)
        pose, covariance = Pose((1.0, 2.0, 3.0), (0.0, 0.0, 0.6, 0.8)), [0.01 if i % 7 == 0 else 0.0 for i in range(36)]
        prior, gnss, boxes = Prior(pose, sigma=(0.5, 0.1)), Gnss(49.0, 8.4, 2.0, 110.0), [MovableBox((1, 2, 3), (4, 2, 1))]
        flat = {"prior": prior, "stamp_ns": 7, "method": "icp", "deadline_ms": 900}
        full = {"prior": Prior(pose, covariance=covariance), "gnss": gnss, "stamp_ns": 7, "method": "icp",
                "T_base_lidar": pose, "movable": boxes}
        found = {}
        found["localize"] = client.localize("town", xyzi, **flat, vehicle="truck 7")
        client.localize("town", xyzi, gnss=gnss)
        client.localize("town", xyzi, **full, deadline_ms=900)
        client.localize("town", Pcd(b"VERSION 0.7"))
        client.localize("town", xyzi, version="v1", **flat, vehicle="truck 7")
        client.localize("town", xyzi, version="v1", gnss=gnss)
        client.localize("town", Pcd(b"VERSION 0.7"), version="v1")
        found["localizeInVersion"] = client.localize("town", xyzi, version="v1", **full, deadline_ms=900)
        found["localize"] = client.localize("town", xyzi)
        client.localize(None, xyzi, **flat, vehicle="truck 7", set="city")
        client.localize(None, xyzi, gnss=gnss)
        client.localize(None, Pcd(b"VERSION 0.7"))
        found["localizeInSet"] = client.localize(None, xyzi, **full, deadline_ms=900)
        poses = {"localizeInSet": client.localize_geopose(None, xyzi), "localize": client.localize_geopose("town", xyzi),
                 "localizeInVersion": client.localize_geopose("town", xyzi, version="v1", **full)}
        for name, version in (("localizeBatch", None), ("localizeBatchInVersion", "v1")):
            found[name], = client.localize_batch("town", [Query(xyzi, **full)], version=version, deadline_ms=900,
                                                  vehicle="truck 7")
            self.assertIsInstance(found[name], PoseAnswer)
        client.open_session("town")
        session = client.open_session("town", version="v1", label="truck 7", prior=full["prior"], gnss=gnss)
        client.open_session(None, set="city")
        step = Odometry(5, pose, covariance=covariance)
        session.track(xyzi, 7, deadline_ms=900)
        session.track(Pcd(b"VERSION 0.7"), 7)
        found["trackScan"] = session.track(xyzi, 7, odometry=step, T_base_lidar=pose, movable=boxes, deadline_ms=900)
        poses["trackScan"] = session.track_geopose(xyzi, 7)

        def place(answer, in_set):
            pose = answer.T_set_lidar if in_set else answer.pose
            return ",".join(str(math.floor(value / 500)) for value in pose.position[:2])

        for name, of in (("trackSealed", {}), ("trackSealedInVersion", {"version": "v1"}), ("trackSealedInSet", {"set": "city"})):
            sealed = client.sealed_session(None if "set" in of else "town", **of, label="truck 7", prior=full["prior"], gnss=gnss)
            sealed.track(xyzi, 7, odometry=step, T_base_lidar=pose, movable=boxes, deadline_ms=900)
            self.assertEqual((sealed.seal, sealed.begun), ("c2VhbA==", 1))
            answer = sealed.track(Pcd(b"VERSION 0.7"), 7)
            found[name] = sealed.track(xyzi, 7, deadline_ms=900)
            self.assertEqual(self.recorder.seen[-1][2]["stillmap-region"], place(answer, "set" in of))
            poses[name] = sealed.track_geopose(xyzi, 7)
        self.check_regions()
        session.initialize(prior, gnss=gnss)
        found["getSession"] = session.info()
        found["listSessions"], = client.sessions("town")
        self.assertEqual([(each.id, each.type) for each in session.events(last_id=3)],
                         [(4, "status"), (None, "gap"), (9, "closed")])
        session.close()
        self.assertEqual(client.download_version("town", "v1", self.folder / "v1.tar"), len(PACKAGE))
        client.download_version("town", "v2", self.folder / "v2.tar", from_digest="0" * 64)
        self.assertEqual((self.folder / "v1.tar").read_bytes(), PACKAGE)
        self.assertEqual(missing_in_requests(self.recorder, OTHER_SCANS), [])
        self.recorder.answers.pop("initializeSession")
        self.check_answers({name: plain(each) for name, each in found.items()})
        for name, each in poses.items():
            self.check_geopose({**plain(each), "place": [each.longitude_deg, each.latitude_deg, each.height_m]}, name)

    def check_regions(self):
        """Proxies are told where a vehicle is, if the client knows: by a prior, or by the answer before."""
        for name in ("localize", "localizeInVersion", "trackSealed", "trackSealedInVersion"):
            told = {headers.get("stillmap-region") for each, _, headers, _ in self.recorder.seen if each == name}
            self.assertTrue(told - {None}, name)
            for region in told - {None}:
                self.assertRegex(region, r"^-?\d+,-?\d+$")

    def test_cpp(self):
        done = subprocess.run([USE_CLIENT, self.recorder.url, self.folder], capture_output=True, text=True, timeout=60)
        self.assertEqual(done.returncode, 0, done.stderr)
        found = json.loads(done.stdout)
        self.check_regions()
        seen = [headers.get("stillmap-region") for name, _, headers, _ in self.recorder.seen if name == "trackSealed"]
        # The first two begin without a place; the answer to the second has one.
        self.assertEqual((seen[:2], seen[2] is None), ([None, None], False))
        self.assertEqual(missing_in_requests(self.recorder, CPP_OTHER_SCANS), [])
        self.assertEqual(found.pop("events"), [[4, "status", {"status": "ok"}], [None, "gap", {"missed": 1}],
                                               [9, "closed", {"reason": "deleted"}]])
        self.assertEqual((found.pop("bytes"), (self.folder / "v1.tar").read_bytes()), (len(PACKAGE), PACKAGE))
        for name in ("localize", "trackScan", "trackSealed", "trackSealedInVersion", "localizeInSet", "trackSealedInSet"):
            self.check_geopose(found.pop("geopose " + name), name)
        self.check_answers(found)

    def test_what_is_missing_is_told_by_name(self):
        schemas = DOCUMENT["components"]["schemas"]
        schemas["ScanParameters"]["properties"]["colour"] = {"type": "number"}
        self.addCleanup(schemas["ScanParameters"]["properties"].pop, "colour")
        session = Client(self.recorder.url, retries=0).open_session("town")
        session.track(array.array("f", [1.0] * 240), 7, movable=[MovableBox((1, 2, 3), (4, 2, 1))])
        missing = missing_in_requests(self.recorder, OTHER_SCANS)
        self.assertIn("trackScan.colour", missing)
        self.assertIn("trackScan.odometry", missing)
        self.assertIn("closeSession (DELETE /v1/sessions/{session}): never called", missing)
        self.assertEqual(differences({"a": 1, "b": {"c": [1.5]}}, {"b": {"c": [1.5]}}, "x"), ["x.a: nothing"])


if __name__ == "__main__":
    unittest.main(argv=[sys.argv[0], *sys.argv[3:]])
