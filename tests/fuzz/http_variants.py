"""Requests for each route of the contract, with usual and odd names, queries, headers and bodies, also
seeds of other targets. For variants.py."""

import itertools
import json
import pathlib
import random
import re
import struct
import urllib.parse

import json_variants
import seeds

CONTRACT = pathlib.Path(__file__).resolve().parents[2] / "server" / "openapi.json"


def request(method, path, headers="", content_type=None, body=b""):
    lines = f"{method} {path} HTTP/1.1\r\nHost: localhost\r\n{headers}"
    if content_type:
        lines += f"Content-Type: {content_type}\r\n"
    if body or method in ("POST", "PUT", "DELETE"):
        lines += f"Content-Length: {len(body)}\r\n"
    return lines.encode("latin-1") + b"\r\n" + body


# What a route's parameters stand for in the target's store, then what is not there or no name.
NAMES = {"map": ["town", "nomap", "a/b", "%2e%2e", "TOWN"], "version": ["v1", "v0", "v2", "x%00"], "level": ["0", "30", "-1", "a"],
         "x": ["0", "-1", "99999999999"], "y": ["0", "1", "x"], "layer": ["coverage", "localizability", "x"],
         "other": ["v0", "v1", "v2"], "part": ["1", "0", "-1", "10001"],
         "side": ["version", "other", "x"], "band": ["height", "observations", "x"]}
# Names that the server gives out, as the target fills them in, and one that it did not.
GIVEN_OUT = ["{id}", "0123456789abcdef"]
NEXT_CONNECTION = b"\x1e"
QUERIES = ["", "?layout=xyz&prior_t=0,0,0&prior_q=0,0,0,1&prior_sigma=1,0.1&stamp_ns=1500000000123456789&deadline_ms=500",
           "?layout=xyzi", "?gnss=49,8.4,110", "?new_frame=true", "?limit=10&before=5", "?limit=0", "?status=failed&map=town",
           "?active=true", "?tolerance_m=0.2", "?odom_since_ns=1&odom_t=0,0,0&odom_q=0,0,0,1&odom_sigma=0.1,0.01&stamp_ns=2",
           "?method=icp", "?a=b&c", "?%00=%", "?layout=xyz&layout=xyz"]
HEADERS = [each + "\r\n" for each in [
    "Range: bytes=0-1", "Range: bytes=5-", "Range: bytes=-5", "Range: bytes=0-1,2-3", "Range: bytes=9999999-", "Range: bytes=a",
    "Range: lines=1-2", "If-None-Match: *", 'If-None-Match: "a", W/"b"', 'If-Match: "1"', "If-Match: *", "If-Match: 0",
    "Idempotency-Key: abc", "Idempotency-Key: " + "a" * 300, "Last-Event-ID: 1", "Last-Event-ID: x", "Authorization: Bearer abc",
    "Authorization: Bearer {key}",
    "Authorization: Basic YQ==", "Accept-Encoding: gzip", "Accept: text/html", "X-Request-Id: abc", "X-Request-Id: " + "z" * 300,
    "traceparent: 00-0af7651916cd43dd8448eb211c80319c-b7ad6b7169203331-01", "traceparent: ff-",
    "Content-Digest: sha-256=:47DEQpj8HBSa+/TImW+5JCeuQeRkm5NMpJWZG3hSuFU=:", "Content-Digest: sha-512=:a:",
    "Content-Digest: x", "Expect: 100-continue", "Connection: close", "Content-Encoding: gzip", "Transfer-Encoding: chunked",
    "Origin: http://a", "Host: b\r\nHost: c", "X-Forwarded-For: 1.2.3.4", "Content-Length: 5", "Content-Length: -1",
    "Content-Length: 99999999999999999999", "A: " + "b" * 2000, "\r\n".join(f"H{i}: x" for i in range(150))]]


def bodies_of_all_kinds():
    yield None, b""
    for content_type in ("application/octet-stream", "text/plain"):
        yield content_type, struct.pack("<24f", *range(24))
    yield "application/vnd.pcd", seeds.seed("pcd", "ascii")
    yield "application/ply", seeds.seed("ply", "ascii")
    yield "application/vnd.las", seeds.seed("las", "wkt")
    for content_type in ("application/x-tar", "application/gzip"):
        yield content_type, seeds.seed("archive", "gzip")[1:]
    yield 'multipart/form-data; boundary="xYz"', seeds.seed("pose_multipart", "raw").split(b"\n", 1)[1]
    yield "application/json", b"{"
    yield "application/json", b"{}"
    yield "application/json", b"[]"


# Texts that only some words fit.
TEXTS = {"map": "town", "version": "v1", "stamp_ns": "15", "deadline_ms": "500", "action": "keep", "drive": "d"}


class Contract:
    def __init__(self):
        self.document = json.loads(CONTRACT.read_text())

    def resolved(self, schema):
        while "$ref" in schema:
            found = self.document
            for key in schema["$ref"].split("/")[1:]:
                found = found[key]
            schema = found
        return schema

    def example(self, schema, name=""):
        """A value of this schema, with all members that it knows."""
        schema = self.resolved(schema)
        if "properties" in schema:
            return {key: self.example(each, key) for key, each in schema["properties"].items()}
        if "enum" in schema or "oneOf" in schema:
            return schema["enum"][0] if "enum" in schema else self.example(schema["oneOf"][0], name)
        if schema.get("type") == "array":
            count = 36 if name == "covariance" else max(1, schema.get("minItems", 2))
            return [self.example(schema["items"]) for _ in range(count)]
        usual = {"string": TEXTS.get(name, "a"), "boolean": True, "integer": schema.get("minimum", 1), "number": 0.5}
        return [0, 0, 0.6, 0.8] if name == "quaternion" else usual[schema["type"]]

    def json_bodies(self):
        """@return (method, path template, example) of each route that takes JSON"""
        for template, operations in self.document["paths"].items():
            for method, operation in operations.items():
                content = self.resolved(operation.get("requestBody", {})).get("content", {}) if isinstance(operation, dict) else {}
                if "application/json" in content:
                    yield method.upper(), template, self.example(content["application/json"]["schema"])


def paths_of(template):
    """@return the usual one, and those with one name changed"""
    names = re.findall(r"{(\w+)}", template)
    usual = {name: NAMES.get(name, GIVEN_OUT)[0] for name in names}
    changed = [template.format(**usual | {name: other}) for name in names for other in NAMES.get(name, GIVEN_OUT)[1:]]
    return template.format(**usual), changed


def asked_before(template):
    """What a route needs on the connections before: somebody gives out the name in it, and has parts to complete."""
    def post(path, document):
        return request("POST", path, "", "application/json", json.dumps(document).encode()) + NEXT_CONNECTION

    def conversion():
        return request("PUT", "/v1/maps/town/versions/v2", "", "application/ply", seeds.seed("ply", "ascii")) + NEXT_CONNECTION

    def part(kind):
        path = f"/v1/maps/town/{kind}/{{id}}/parts/1"
        body = seeds.seed("archive", "gzip")[1:]
        return request("PUT", path, "", "application/octet-stream", body) + NEXT_CONNECTION

    asked = {"{session}": lambda: post("/v1/sessions", {"map": "town"}),
             "{upload}": lambda: post("/v1/maps/town/uploads", {"version": "v2", "content_type": "application/gzip"}),
             "{drive}": lambda: post("/v1/maps/town/drives", {"name": "d"}),
             "{job}": conversion,
             "{key}": lambda: request("POST", "/v1/keys", "Authorization: Bearer {key}\r\n", "application/json",
                                      json.dumps({"name": "a", "scopes": ["read", "localize", "write", "admin"]}).encode()) + NEXT_CONNECTION,
             "uploads/{upload}/complete": lambda: part("uploads"),
             "drives/{drive}/complete": lambda: part("drives")}
    return b"".join(ask() for words, ask in asked.items() if words in template)


def changed_bodies(contract):
    told = set()
    for method, template, example in contract.json_bodies():
        before, (usual, _), text = asked_before(template), paths_of(template), json.dumps(example)
        yield before + request(method, usual, "", "application/json", text.encode())
        if text in told:
            continue
        told.add(text)
        # `edits`, `pose_json` and `prior` take more of what is within.
        texts = itertools.chain(json_variants.changed(example), json_variants.drawn_anew(example))
        for body in itertools.islice(texts, 0, None, 5):
            yield before + request(method, usual, "", "application/json", body)


def requests_of_routes(contract):
    bodies = list(bodies_of_all_kinds())
    for template, operations in contract.document["paths"].items():
        before, (usual, changed) = asked_before(template), paths_of(template)
        for method, path in itertools.product(("GET", "HEAD", "POST", "PUT", "DELETE", "PATCH", "OPTIONS"), [usual, *changed]):
            yield before + request(method, path)
        for method in (name.upper() for name in operations if name in ("get", "put", "post", "delete")):
            written = bodies if method in ("PUT", "POST") else bodies[:1]
            for path, body in itertools.product(changed, written):
                yield before + request(method, path, "", *body)
            for body in written:
                for query in QUERIES:
                    yield before + request(method, usual + query, "", *body)
                for headers in HEADERS:
                    yield before + request(method, usual, headers, *body)


def with_checksums(tar):
    """Right in every block that says that it is a header."""
    blocks = [tar[at:at + 512] for at in range(0, len(tar), 512)]
    for i, block in enumerate(blocks):
        if block[257:262] == b"ustar":
            total = sum(block[:148]) + sum(block[156:]) + 8 * ord(" ")
            blocks[i] = block[:148] + b"%06o\0 " % total + block[156:]
    return b"".join(blocks)


def seed_bodies(target):
    """@return (query, content type, body) of each seed of another target that reads bytes of a client too"""
    for text in seeds.of(target):
        first, _, rest = text.partition(b"\n")
        if target == "scan_body" and text:
            kinds = [("", "application/octet-stream"), ("?layout=xyz", "application/octet-stream"), ("", "application/vnd.pcd"),
                     ("?layout=xyzit", "application/octet-stream")]
            yield *kinds[text[0] % 4], text[1:]
        elif target == "archive":
            yield "", "application/x-tar", with_checksums(text[1:]) if text and text[0] & 1 else text[1:]
        elif target == "pose_multipart":
            yield "", first.decode("latin-1"), rest
        elif target == "query":
            pairs = "&".join("=".join(urllib.parse.quote(word) for word in pair.split(b"=", 1)) for pair in first.split(b"&"))
            yield "?" + pairs, "application/octet-stream", struct.pack("<3f", 1, 2, 3)
        elif target == "cloud":
            yield "", "application/ply" if text.startswith(b"ply") else "application/vnd.pcd", text
        else:
            types = {"pcd": "application/vnd.pcd", "ply": "application/ply", "las": "application/vnd.las"}
            yield "", types.get(target, "application/json"), text


POSES = [("POST", "/v1/maps/{map}/localize"), ("POST", "/v1/sessions/{session}/scans")]
VERSIONS = [("PUT", "/v1/maps/{map}/versions/{version}")]
PARTS = [("PUT", "/v1/maps/{map}/uploads/{upload}/parts/{part}"), ("PUT", "/v1/maps/{map}/drives/{drive}/parts/{part}")]
ROUTES_OF_TARGETS = {
    "scan_body": POSES, "pose_json": POSES, "pose_multipart": POSES, "query": POSES, "pcd": POSES + VERSIONS, "ply": VERSIONS,
    "las": VERSIONS, "cloud": VERSIONS, "archive": VERSIONS + PARTS, "edits": [("PUT", "/v1/maps/{map}/edits")]}


def requests_with_seeds_as_bodies():
    for target, routes in ROUTES_OF_TARGETS.items():
        for (method, template), (query, content_type, body) in itertools.product(routes, seed_bodies(target)):
            path, whole = paths_of(template)[0], template.replace("/parts/{part}", "/complete")
            if template == VERSIONS[0][1]:
                path = path.replace("/v1/maps/town/versions/v1", "/v1/maps/town/versions/v2")
            asked = asked_before(template) + request(method, path + query, "", content_type, body)
            yield asked if whole == template else asked + NEXT_CONNECTION + request("POST", paths_of(whole)[0])


def usual_requests(contract, rng):
    """@return for each route some that it takes, of which those of sessions tell other times each"""
    bodies = {(method, template): ("application/json", json.dumps(example).encode())
              for method, template, example in contract.json_bodies()}
    archive = ("application/x-tar", with_checksums(seeds.seed("archive", "small")[1:]) + bytes(1024))
    scan = ("application/octet-stream", struct.pack("<24f", *range(24)))
    for template, operations in contract.document["paths"].items():
        for method in (name.upper() for name in operations if name in ("get", "put", "post", "delete")):
            path = paths_of(template)[0].replace("/versions/v1", rng.choice(["/versions/v0", "/versions/v1", "/versions/v2"]))
            body = bodies.get((method, template), ())
            if template.endswith(("/localize", "/scans")):
                stamp_ns = rng.choice([1, 2, 10, 100, 2000]) * rng.choice([100_000_000, 1_000_000_000])
                path += f"?layout=xyz&prior_t=0,0,0&prior_q=0,0,0,1&prior_sigma=1,0.1&stamp_ns={stamp_ns}"
                body = scan
            elif method == "PUT" and not body:
                body = rng.choice([archive, ("application/ply", seeds.seed("ply", "ascii"))])
            if not template.endswith("/events"):
                yield request(method, path, "", *body)


def drawn_sequences(contract):
    """What only shows when several have been: a session that goes on, jobs beside each other, versions beyond two."""
    rng = random.Random(1)
    for _ in range(120):
        asked = list(usual_requests(contract, rng))
        kinds = [[each for each in asked if words in each.split(b"\r\n")[0]]
                 for words in (b"sessions", b"jobs", b"uploads", b"drives", b"keys", b"versions", b"maps", b"")]
        for kind in kinds:
            for _ in range(8):
                sequence = [*rng.choices(kind, k=rng.randint(2, 8)), rng.choice(asked)]
                makes = [each for each in kind if each.startswith(b"POST")]
                yield NEXT_CONNECTION.join([rng.choice(makes)] * bool(makes) + sequence)


def requests():
    contract = Contract()
    yield from drawn_sequences(contract)
    yield from requests_with_seeds_as_bodies()
    yield from changed_bodies(contract)
    yield from requests_of_routes(contract)
