#!/usr/bin/env python3
"""Real answers against the schemas of /openapi.json, strictly: a key that the document does not know is a fault.

usage: contract_test.py STILLMAP STORE DRIVE PACKAGE
"""

import http.client
import json
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import time
import unittest
import uuid

from small_bag import write_bag

PROGRAM, STORE, DRIVE, PACKAGE = (pathlib.Path(x).resolve() for x in sys.argv[1:5])
TYPES = {"object": dict, "array": list, "string": str, "number": (int, float), "integer": int, "boolean": bool,
         "null": type(None)}
#: What the document uses of JSON Schema; anything else would pass unseen.
KNOWN = {"$ref", "type", "description", "properties", "required", "additionalProperties", "items", "minItems",
         "maxItems", "enum", "pattern", "minimum", "maximum", "exclusiveMinimum", "oneOf", "default", "minLength",
         "maxLength"}


class Schema:
    def __init__(self, document):
        self.document = document

    def resolved(self, value):
        while "$ref" in value:
            place = self.document
            for part in value["$ref"][2:].split("/"):
                place = place[part.replace("~1", "/").replace("~0", "~")]
            value = place
        return value

    def faults(self, schema, value, path="$"):
        schema = self.resolved(schema)
        unknown = set(schema) - KNOWN
        if unknown:
            return [f"{path}: schema with {unknown}, expected {KNOWN}"]
        if "oneOf" in schema:
            tried = [self.faults(each, value, path) for each in schema["oneOf"]]
            return [] if sum(not each for each in tried) == 1 else [f"{path}: fits not one of {tried}"]
        kinds = schema.get("type", [])
        kinds = [kinds] if isinstance(kinds, str) else kinds
        fits = any(isinstance(value, TYPES[kind]) and not (isinstance(value, bool) and kind != "boolean")
                   for kind in kinds)
        if kinds and not fits:
            return [f"{path}: found {value!r}, expected {kinds}"]
        if "enum" in schema and value not in schema["enum"]:
            return [f"{path}: found {value!r}, expected one of {schema['enum']}"]
        check = {dict: self.object_faults, list: self.array_faults, str: self.text_faults}.get(type(value))
        return check(schema, value, path) if check else self.number_faults(schema, value, path)

    def object_faults(self, schema, value, path):
        properties, others = schema.get("properties", {}), schema.get("additionalProperties")
        faults = [f"{path}.{key}: nothing" for key in schema.get("required", []) if key not in value]
        for key, each in value.items():
            found = properties.get(key, others)
            if found is not None:
                faults += self.faults(found, each, f"{path}.{key}")
            elif properties:
                faults.append(f"{path}.{key}: not in the document")
        return faults

    def array_faults(self, schema, value, path):
        faults = []
        if not schema.get("minItems", 0) <= len(value) <= schema.get("maxItems", len(value)):
            faults.append(f"{path}: {len(value)} items")
        for i, each in enumerate(value):
            faults += self.faults(schema.get("items", {}), each, f"{path}[{i}]")
        return faults

    @staticmethod
    def text_faults(schema, value, path):
        found = "pattern" not in schema or re.search(schema["pattern"], value)
        return [] if found else [f"{path}: found {value!r}, expected {schema['pattern']}"]

    @staticmethod
    def number_faults(schema, value, path):
        if value is None or isinstance(value, bool):
            return []
        fits = schema.get("minimum", value) <= value <= schema.get("maximum", value)
        return [] if fits else [f"{path}: found {value}"]


class Contract(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.temporary = tempfile.TemporaryDirectory()
        store = pathlib.Path(cls.temporary.name) / "store"
        shutil.copytree(STORE, store)
        cls.server = subprocess.Popen([PROGRAM, "serve", "--store", store, "--port", "0"], stdout=subprocess.PIPE,
                                      stderr=subprocess.DEVNULL, text=True)
        cls.port = int(re.search(r"127\.0\.0\.1:(\d+)", cls.server.stdout.readline()).group(1))
        for _ in range(200):
            if cls.send("GET", "/readyz")[0] == 200:
                break
            time.sleep(0.1)
        cls.document = json.loads(cls.send("GET", "/openapi.json")[2])
        cls.schema = Schema(cls.document)
        cls.asked = set()

    @classmethod
    def tearDownClass(cls):
        cls.server.terminate()
        cls.server.communicate(timeout=30)
        cls.temporary.cleanup()

    @classmethod
    def send(cls, method, path, body=None, headers=None):
        connection = http.client.HTTPConnection("127.0.0.1", cls.port, timeout=60)
        connection.request(method, path, body, headers or {})
        answer = connection.getresponse()
        data = answer.read()
        connection.close()
        cls.seal = answer.getheader("Stillmap-Seal")
        return answer.status, answer.getheader("Content-Type") or "", data

    @classmethod
    def wait(cls, path, while_it_is):
        """Until what is made in the background is there."""
        for _ in range(600):
            if cls.send("GET", path)[0] != while_it_is:
                return
            time.sleep(0.1)

    def ask(self, method, pattern, expected, body=None, query="", kind=None, accept=None, seal=None, **parts):
        """Sends a request and holds its answer against what the document says of this status."""
        path = pattern
        for name, value in parts.items():
            path = path.replace("{" + name + "}", str(value))
        if isinstance(body, (dict, list)):
            body, kind = json.dumps(body), "application/json"
        headers = {name: value for name, value in (("Content-Type", kind), ("Accept", accept), ("Stillmap-Seal", seal)) if value}
        status, found, data = self.send(method, path + query, body, headers)
        self.assertEqual(status, expected, f"{method} {path}: {data[:500]!r}")
        responses = self.document["paths"][pattern][method.lower()]["responses"]
        self.assertIn(str(status), responses, f"{method} {pattern}")
        described = self.schema.resolved(responses[str(status)])
        self.asked.add((method, pattern))
        if not data:
            self.assertNotIn("content", described, f"{method} {pattern} {status}")
            return None
        self.assertIn(found.split(";")[0], described["content"], f"{method} {pattern}")
        if not found.startswith(("application/json", "application/problem+json")):
            return data
        answer = json.loads(data)
        faults = self.schema.faults(described["content"][found.split(";")[0]].get("schema", {}), answer)
        self.assertEqual(faults, [], f"{method} {pattern}")
        return answer

    @staticmethod
    def scan(index):
        return (DRIVE / "velodyne" / f"{index:06d}.bin").read_bytes()

    def test_what_can_be_read(self):
        town = {"map": "town", "version": "v1"}
        for path in ("/livez", "/healthz", "/readyz", "/v1/status", "/v1/maps", "/v1/sessions", "/v1/maps/{map}",
                     "/v1/maps/{map}/ready", "/v1/maps/{map}/versions", "/v1/maps/{map}/versions/{version}",
                     "/v1/maps/{map}/versions/{version}/trajectory", "/v1/maps/{map}/versions/{version}/objects",
                     "/v1/maps/{map}/versions/{version}/content", "/v1/maps/{map}/versions/{version}/preview",
                     "/v1/maps/{map}/versions/{version}/graph", "/v1/maps/{map}/edits", "/v1/maps/{map}/stats",
                     "/v1/maps/{map}/drives", "/v1/maps/{map}/rollout", "/v1/maps/{map}/vehicles"):
            self.ask("GET", path, 200, **town)
        layer = "/v1/maps/{map}/versions/{version}/layers/{layer}"
        for name in ("coverage", "localizability"):
            for _ in range(600):
                if self.send("GET", f"/v1/maps/town/versions/v1/layers/{name}")[0] != 503:
                    break
                time.sleep(0.1)
            found = self.ask("GET", layer, 200, **town, layer=name)
            cells = found["cells_per_side"] ** 2 * len(found["tiles"])
            for band in found["bands"]:
                self.assertEqual(len(self.ask("GET", layer + "/{band}", 200, **town, layer=name, band=band["name"])),
                                 4 * cells)
            self.assertIn(name if name == "localizability" else "scans", [band["name"] for band in found["bands"]])
        self.ask("GET", layer, 404, **town, layer="colour")
        self.ask("GET", "/v1/maps/{map}", 404, map="village")
        about = self.ask("GET", "/v1/maps/{map}", 200, map="town")
        tiles = self.ask("GET", "/v1/maps/{map}/versions/{version}/tiles", 200, map="town", version=about["version"])
        tile = tiles["tiles"][-1]
        place = {key: tile[key] for key in ("level", "x", "y")}
        points = self.ask("GET", "/v1/maps/{map}/versions/{version}/tiles/{level}/{x}/{y}", 200, **town, **place)
        self.assertEqual(len(points), 20 * tile["points"])
        self.ask("GET", "/v1/maps/{map}/tiles/{level}/{x}/{y}", 307, map="town", **place)
        levels = "/v1/maps/{map}/versions/{version}/3dtiles/"
        self.wait("/v1/maps/town/versions/v1/3dtiles/tileset.json", 503)
        self.ask("GET", levels + "tileset.json", 200, **town)
        self.assertEqual(self.ask("GET", levels + "{level}/{x}/{y}.glb", 200, **town, **place)[-len(points):], points)
        self.ask("GET", levels + "{level}/{x}/{y}.glb", 404, **town, level=0, x=9999, y=0)
        self.ask("GET", levels + "{level}/{x}/{y}.json", 404, **town, level=5, x=0, y=0)
        difference = "/v1/maps/{map}/versions/{version}/difference/{other}"
        self.ask("GET", difference, 202, **town, other="v1")
        self.wait("/v1/maps/town/versions/v1/difference/v1", 202)
        self.assertEqual(self.ask("GET", difference, 200, **town, other="v1")["tiles"], [])
        self.ask("GET", difference, 400, query="?tolerance_m=0", **town, other="v1")
        self.ask("GET", difference, 404, **town, other="v9")
        self.ask("GET", difference + "/{side}/{x}/{y}.glb", 404, **town, other="v1", side="other", x=0, y=0)
        diff = self.ask("POST", "/v1/maps/{map}/tiles/diff", 200, {"center": [0, 0], "radius_m": 50}, map="town")
        self.assertTrue(diff["add"])
        self.ask("POST", "/v1/maps/{map}/tiles/diff", 400, {"center": [0, 0]}, map="town")

    def test_poses(self):
        raw, prior = "application/octet-stream", "?prior_t=0,0,0&prior_q=0,0,0,1&stamp_ns=5"
        base = {"position": [0, 0, 1], "quaternion": [0, 0, 0, 1]}
        boundary = uuid.uuid4().hex
        parts = (f'--{boundary}\r\nContent-Disposition: form-data; name="request"\r\n\r\n'
                 + json.dumps({"T_base_lidar": base})
                 + f'\r\n--{boundary}\r\nContent-Disposition: form-data; name="scan"\r\nContent-Type: {raw}\r\n\r\n'
                 ).encode() + self.scan(1) + f"\r\n--{boundary}--\r\n".encode()
        for place in ("/v1/maps/{map}/localize", "/v1/maps/{map}/versions/{version}/localize"):
            answer = self.ask("POST", place, 200, self.scan(1), prior, raw, map="town", version="v1")
            self.assertEqual(answer["status"], "ok")
            self.ask("POST", place, 200, parts, "", f"multipart/form-data; boundary={boundary}", map="town", version="v1")
            self.ask("POST", place, 422, self.scan(1)[:160], prior, raw, map="town", version="v1")
            # The sample has no place on the Earth; geopose_test.py has a map that does.
            self.ask("POST", place, 406, self.scan(1), prior, raw, accept="application/geopose+json", map="town",
                     version="v1")
            self.ask("POST", place, 200, self.scan(1), prior + "&vehicle=truck", raw, map="town", version="v1")
            self.ask("POST", place, 400, self.scan(1), prior + "&vehicle=", raw, map="town", version="v1")
            lost = [[float(i % 7), float(i % 11), float(i % 3)] for i in range(2000)]
            self.ask("POST", place + "/batch", 406, {"queries": []}, accept="application/geopose+json", map="town",
                     version="v1")
            self.ask("POST", place + "/batch", 200, {"queries": [{"points": lost}, {"points": []}]}, map="town",
                     version="v1")

    def test_roll_outs(self):
        archive = self.send("GET", "/v1/maps/town/versions/v1/content")[2]
        self.ask("PUT", "/v1/maps/{map}/versions/{version}", 201, archive, "", "application/x-tar", map="town", version="w")
        rollout = "/v1/maps/{map}/rollout"
        wanted = {"version": "w", "share": 0.1, "vehicles": ["depot-*"], "halt": {"least_answers": 50, "most_rise": 0.1}}
        found = self.ask("PUT", rollout, 200, wanted, map="town")
        self.assertEqual({key: found[key] for key in wanted}, wanted)
        self.assertEqual(self.ask("GET", rollout, 200, map="town")["state"], "running")
        self.ask("GET", "/v1/maps/{map}", 200, query="?vehicle=depot-1", map="town")
        self.assertIn("depot-1", [each["label"] for each in self.ask(
            "GET", "/v1/maps/{map}/vehicles", 200, query="?limit=100", map="town")["vehicles"]])
        self.ask("GET", "/v1/maps/{map}/vehicles", 400, query="?before=1", map="town")
        self.ask("DELETE", "/v1/maps/{map}/versions/{version}", 409, map="town", version="w")
        self.ask("PUT", rollout, 400, {"version": "w", "share": 2}, map="town")
        self.ask("PUT", rollout, 404, {"version": "none"}, map="town")
        self.ask("PUT", rollout, 409, {"version": "v1"}, map="town")
        self.ask("DELETE", rollout, 204, map="town")
        self.ask("DELETE", rollout, 404, map="village")

    def test_sessions(self):
        one = "/v1/sessions/{session}"
        session = self.ask("POST", "/v1/sessions", 201, {"map": "town"})["id"]
        self.ask("POST", one + "/scans", 200, self.scan(0), "?stamp_ns=0", "application/octet-stream", session=session)
        self.ask("POST", one + "/scans", 406, self.scan(0), "?stamp_ns=1", "application/octet-stream",
                 accept="application/geopose+json", session=session)
        self.ask("GET", one, 200, session=session)
        self.ask("GET", "/v1/sessions", 200)
        self.ask("POST", one + "/initialize", 200, {}, session=session)
        self.ask("DELETE", one, 204, session=session)
        self.ask("DELETE", one, 404, session=session)

    def test_sealed_sessions(self):
        raw, town = "application/octet-stream", {"map": "town", "version": "v1"}
        for place in ("/v1/maps/{map}/localize/next", "/v1/maps/{map}/versions/{version}/localize/next"):
            first = self.ask("POST", place, 200, self.scan(0), "?stamp_ns=0&prior_t=0,0,0&prior_q=0,0,0,1&prior_sigma=0.5,0.05", raw,
                             **town)
            seal = self.seal
            self.assertEqual((first["status"], len(seal) <= 2416), ("ok", True))
            for warnings in ([], [{"code": "seal_replayed"}]):
                again = self.ask("POST", place, 200, self.scan(1), "?stamp_ns=103600000", raw, seal=seal, **town)
                self.assertEqual((again["session"], again["warnings"]), (first["session"], warnings))
            self.assertEqual(self.ask("POST", place, 409, self.scan(1), "?stamp_ns=0", raw, seal=seal, **town)["code"], "ScanNotNewer")
            self.assertEqual(self.ask("POST", place, 400, self.scan(1), "?stamp_ns=9", raw, seal=seal[4:], **town)["code"],
                             "InvalidSeal")
            self.ask("POST", place, 422, self.scan(1), "?stamp_ns=9&prior_t=0,0,0&prior_q=0,0,0,1", raw, **town)
            self.ask("POST", place, 406, self.scan(1), "?stamp_ns=9", raw, accept="application/geopose+json", **town)
            self.ask("POST", place, 404, self.scan(1), "?stamp_ns=9", raw, map="village", version="v1")

    def test_sets(self):
        raw, place = "application/octet-stream", "prior_t=0,0,0&prior_q=0,0,0,1&prior_sigma=0.5,0.05"
        one = "/v1/sets/{set}"
        self.ask("PUT", one, 201, {"maps": [{"map": "town"}]}, set="city")
        self.ask("PUT", one, 200, {"maps": [{"map": "town", "position": [5, 0, 0]}]}, set="city")
        self.ask("PUT", one, 400, {"maps": []}, set="city")
        self.ask("PUT", one, 404, {"maps": [{"map": "village"}]}, set="city")
        self.ask("PUT", one, 422, {"maps": [{"map": "town", "quaternion": [0, 0, 0, 0]}]}, set="city")
        self.ask("GET", one, 200, set="city")
        self.assertEqual([each["name"] for each in self.ask("GET", "/v1/sets", 200)["sets"]], ["city"])
        self.ask("DELETE", "/v1/maps/{map}", 409, query="?active=true", map="town")
        for index, route in enumerate(("/v1/localize", "/v1/localize/next")):
            query = f"?stamp_ns=5&{place.replace('t=0', 't=5')}"
            answer = self.ask("POST", route, 200, self.scan(1), query, raw)
            self.assertEqual((answer["status"], answer["set"]), ("ok", "city"))
            self.assertAlmostEqual(answer["T_set_lidar"]["position"][0] - answer["pose"]["position"][0], 5.0)
            self.ask("POST", route, 404, self.scan(1), query + "&set=none", raw)
            self.ask("POST", route, 400, self.scan(1), query + "&set=%20", raw)
            self.ask("POST", route, 422, self.scan(1)[:160], query, raw)
            self.ask("POST", route, 406, self.scan(1), query, raw, accept="application/geopose+json")
        self.ask("POST", "/v1/localize/next", 200, self.scan(2), "?stamp_ns=103600000", raw, seal=self.seal)
        session = self.ask("POST", "/v1/sessions", 201, {"set": "city"})
        self.assertEqual(session["set"], "city")
        self.ask("POST", "/v1/sessions", 404, {"set": "none"})
        self.assertIn("city", [each.get("set") for each in self.ask("GET", "/v1/sessions", 200)["sessions"]])
        self.ask("DELETE", one, 204, set="city")
        self.ask("DELETE", one, 404, set="city")
        self.ask("GET", one, 404, set="city")

    def test_changes(self):
        archive = self.send("GET", "/v1/maps/town/versions/v1/content")[2]
        put = "/v1/maps/{map}/versions/{version}"
        self.ask("PUT", "/v1/maps/{map}", 201, map="yard")
        self.ask("PUT", "/v1/maps/{map}", 200, map="yard")
        self.ask("PUT", put, 201, archive, "", "application/x-tar", map="yard", version="a")
        self.ask("PUT", put, 200, archive, "", "application/x-tar", map="yard", version="a")
        self.ask("PUT", put, 422, b"\0" * 2000, "", "application/x-tar", map="yard", version="c")
        self.ask("PUT", put, 201, archive, "", "application/x-tar", map="yard", version="b")
        self.ask("POST", "/v1/maps/{map}/rollback", 409, map="yard")
        for version in "ab":
            self.ask("POST", put + "/activate", 200, map="yard", version=version)
        self.ask("POST", "/v1/maps/{map}/rollback", 200, map="yard")
        self.ask("DELETE", put, 409, map="yard", version="a")
        self.ask("DELETE", put, 204, map="yard", version="b")
        edits = {"format": "stillmap-edits", "version": 1, "edits": [
            {"action": "keep", "object": {"centre": [1, 2, 3], "class": "car"}},
            {"action": "remove", "box": {"centre": [1, 2, 3], "size": [4, 2, 1], "yaw": 0.5}, "drive": "d",
             "scans": [1, 2], "note": "skip"}]}
        self.assertEqual(self.ask("PUT", "/v1/maps/{map}/edits", 200, edits, map="yard"), edits)
        self.assertEqual(self.ask("GET", "/v1/maps/{map}/edits", 200, map="yard"), edits)
        self.ask("PUT", "/v1/maps/{map}/edits", 400, {"edits": []}, map="yard")
        uploads = "/v1/maps/{map}/uploads"
        upload = self.ask("POST", uploads, 201, {"version": "u", "content_type": "application/x-tar"}, map="yard")["id"]
        place = {"map": "yard", "upload": upload}
        for status in (201, 200):
            self.ask("PUT", uploads + "/{upload}/parts/{part}", status, archive, "", "application/octet-stream", **place,
                     part=1)
        self.ask("GET", uploads + "/{upload}", 200, **place)
        self.ask("GET", uploads, 200, map="yard")
        for status in (201, 200):
            self.ask("POST", uploads + "/{upload}/complete", status, **place)
        self.ask("DELETE", uploads + "/{upload}", 204, **place)
        self.ask("POST", uploads, 400, {"version": "U", "content_type": "application/x-tar"}, map="yard")
        drive = self.ask("POST", "/v1/maps/{map}/drives", 201, {"name": "d"}, map="yard")["id"]
        one = "/v1/maps/{map}/drives/{drive}"
        place = {"map": "yard", "drive": drive}
        self.ask("PUT", one + "/parts/{part}", 201, b"\0" * 10240, "", "application/octet-stream", **place, part=1)
        self.ask("PUT", one + "/parts/{part}", 200, b"\0" * 10240, "", "application/octet-stream", **place, part=1)
        self.ask("GET", one, 200, **place)
        self.ask("GET", "/v1/maps/{map}/drives", 200, map="yard")
        self.ask("POST", one + "/complete", 422, **place)
        self.ask("DELETE", one, 204, **place)
        self.check_recording()
        self.ask("DELETE", "/v1/maps/{map}", 409, map="yard")
        self.ask("DELETE", "/v1/maps/{map}", 204, query="?active=true", map="yard")

    def check_recording(self):
        """A bag of two lidars: kept, asked about, chosen."""
        bag = pathlib.Path(self.temporary.name) / "bag"
        write_bag(DRIVE, bag, rear=True)
        tar = subprocess.run(["tar", "cf", "-", "-C", bag, "."], capture_output=True, check=True).stdout
        place = {"map": "yard", "drive": self.ask("POST", "/v1/maps/{map}/drives", 201, {"name": "two"}, map="yard")["id"]}
        one = "/v1/maps/{map}/drives/{drive}"
        self.ask("PUT", one + "/parts/{part}", 201, tar, "", "application/octet-stream", **place, part=1)
        asked = self.ask("POST", one + "/complete", 202, **place)
        self.assertEqual([each["choice"] for each in asked["inspection"]["choices"]],
                         ["cloud=/points", "cloud=/rear", "poses=/odom"])
        self.ask("GET", "/v1/maps/{map}/drives", 200, map="yard")
        self.ask("POST", one + "/complete", 400, {"choice": "lidar=/points"}, **place)
        self.ask("POST", one + "/complete", 202, {"choice": "cloud=/left"}, **place)
        done = self.ask("POST", one + "/complete", 200, {"choice": "cloud=/points&poses=/odom"}, **place)
        self.assertEqual((done["status"], done["inspection"]["topic"]), ("complete", "/points"))
        self.ask("POST", one + "/complete", 409, {"choice": "cloud=/rear"}, **place)
        self.ask("DELETE", one, 204, **place)

    def test_z_a_wrong_answer_is_found(self):
        status = {"$ref": "#/components/schemas/Health"}
        self.assertEqual(self.schema.faults(status, {"status": "alive", "reasons": []}), [])
        for wrong in ({"status": "alive"}, {"status": "well", "reasons": []}, {"status": "alive", "reasons": [1]},
                      {"status": "alive", "reasons": [], "more": 1}, []):
            self.assertNotEqual(self.schema.faults(status, wrong), [], wrong)


if __name__ == "__main__":
    unittest.main(argv=[sys.argv[0], *sys.argv[5:]])
