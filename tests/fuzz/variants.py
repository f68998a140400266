#!/usr/bin/env python3
"""Writes variants of a target's seeds, one change each, which bytes changed at random become late or never: wherever an
input holds a JSON text, each of its values by each awkward one, members and elements left out, twice, renamed, and all of
its numbers drawn anew; each byte by a few others; the input cut at each byte. For `http` also a request for each route of
the contract.

usage: tests/fuzz/variants.py TARGET FOLDER
"""

import copy
import hashlib
import itertools
import json
import math
import pathlib
import random
import re
import struct
import sys

HERE = pathlib.Path(__file__).resolve().parent
CONTRACT = HERE.parent.parent / "server" / "openapi.json"
MOST_BYTES = 4096  # as soak.py tells libFuzzer
SHORT_BYTES = 700  # longer seeds are changed at fewer of their bytes
DRAWS = 3000  # of all numbers of a JSON text

NUMBERS = """0 -0 1 -1 2 3 4 5 7 10 99 100 255 256 1000 1001 4096 65535 65536 0.5 -0.5 1.5 0.00001 1e5 1E+5 1e-5 1e6 1e8 1e15 1e16
  1e17 1e21 1e22 1e23 1e39 1e308 -1e308 1.7976931348623157e308 1.7976931348623159e308 1e309 1e400 -1e400 1e6000000000 1e-308
  5e-324 2.4703282292062327e-324 1e-400 1e-99999999999 2.2250738585072011e-308 2.2250738585072014e-308 3.4028235e38 3.5e38
  2147483647 2147483648 -2147483648 -2147483649 4294967295 4294967296 9007199254740993 9007199254740993.0
  1125899906842624 1125899906842625 9223372036854775807 9223372036854775808 -9223372036854775808 -9223372036854775809
  18446744073709551615 18446744073709551616 123456789012345678901234567890 1.00000000000000000000000000000000000001
  0.1234567890123456789012345678901234567890 01 1. .5 1e 1e+ 1e- 0x1 +1 - -- -a 1a 1.a 0e0 0e NaN Infinity
  3.141592653589793 90 90.1 180 -180 180.1 360 600000 600001 0.6 0.8""".split()
OTHERS = """null true false nul nulll True [] {} [[]] [{}] [null] [true] [1e999] [0] [0,0] [0,0,0] [1,2,3] [1,2,3,4] [0,0,0,1]
  [0,0,0,0] [1,2,"a"] [1,2,3,4,5,6] [1,] [,1] {"a":1} {"a"} {"a":} {"a":1,} {,} {1:2}""".split() + ["[1 2]", "[ ]", "{ }"]
# What JSON's grammar and UTF-8 tell apart in a string; latin-1 stands for bytes.
STRINGS = [f'"{text}"' for text in [
    "", "a", "1", "-1", "00", "+1", " 1", "1 ", "1.5", "1e3", "9223372036854775807", "9223372036854775808",
    "-9223372036854775809", "99999999999999999999999", r"\u0000", r"a\u0000b", r"\u0041", r"\u00e9", r"\u20ac",
    r"\ud83d\ude00", r"\ud83d", r"\ude00", r"\ud83d\u0041", r"\ud83dx", r"\ud83d\n", r"\uZZZZ", r"\u12", r"\uABCD", r"\x",
    r"\"\\\/\b\f\n\r\t", "\t", "\n", "\0", "\x01\x1f", "\x7f", "\xc3\xa9", "\xe2\x82\xac", "\xf0\x9f\x98\x80",
    "\xe0\xa0\x80", "\xed\x9f\xbf", "\xee\x80\x80", "\xf1\x80\x80\x80", "\xf4\x8f\xbf\xbf", "\xc0\x80", "\xc3(", "\xe0\x80\x80",
    "\xe2(", "\xe2\x82(", "\xed\xa0\x80", "\xed(", "\xee(", "\xee\x80(", "\xf0\x80\x80\x80", "\xf0\x9f(", "\xf0\x9f\x98(",
    "\xf1(", "\xf1\x80(", "\xf1\x80\x80(", "\xf4\x90\x80\x80", "\xf4\x80(", "\xf4\x80\x80(", "\xf8", "\xff", "\x80",
    "x" * 15, "x" * 16, "x" * 64, "x" * 300, "x" * 3000, "ab/" * 100, "../a", "/a", "a/../b", "a//b", "./a", "a/", ".", "..",
    "<>&", hashlib.sha256(b"").hexdigest(), hashlib.sha256(b"").hexdigest().upper()]] + ['"', r'"\"', '"\xc3', '"\xe2\x82']
DEEP = [form * n + "1" * closed + end * n * closed for form, end in (("[", "]"), ('{"a":', "}"))
        for n in (10, 33, 65, 130, 600) for closed in (0, 1)]
MANY = ["[" + ",".join([each] * n) + "]" for each in ("0", "[0,0,0]") for n in (36, 37, 100, 257, 1001)]
MANY += ["{" + ",".join(f'"k{i}":0' for i in range(n)) + "}" for n in (10, 65, 300)]
VALUES = NUMBERS + OTHERS + STRINGS + DEEP + MANY


class Text(str):
    """JSON that is written as it stands."""


class Members(list):
    """Pairs, so that a key may come twice."""


def json_of(value):
    if isinstance(value, Text):
        return str(value)
    if isinstance(value, dict):
        value = Members(value.items())
    if isinstance(value, Members):
        return "{" + ",".join(f"{json_of(key)}:{json_of(each)}" for key, each in value) + "}"
    if isinstance(value, list):
        return "[" + ",".join(map(json_of, value)) + "]"
    return json.dumps(value)


def places(value, path=()):
    """Not all of what is long: its members are of one kind."""
    yield path
    inside = itertools.islice(value.items(), 20) if isinstance(value, dict) else ()
    if isinstance(value, list):
        inside = enumerate(value[:4])
    for key, each in inside:
        yield from places(each, (*path, key))


def with_at(value, path, new):
    if not path:
        return new
    value = copy.copy(value)
    value[path[0]] = with_at(value[path[0]], path[1:], new)
    return value


def variants_of_members(members):
    for i, (key, value) in enumerate(members):
        before, after = members[:i], members[i + 1:]
        yield before + after
        yield [*members, (key, value)]
        for other in (key + "x", "", Text(r'"\u0000"')):
            yield [*before, (other, value), *after]
    for text in STRINGS:
        yield [*members, (Text(text), 1)]
    yield members[::-1]


def variants_of_elements(elements):
    yield elements[:-1]
    yield elements[1:]
    yield elements[::-1]
    for times in (2, 3, 5, 10):
        yield elements * times
    for text in NUMBERS + OTHERS:
        yield [*elements, Text(text)]
        yield [Text(text)] * len(elements)


def json_variants(document):
    for path in places(document):
        value = document
        for key in path:
            value = value[key]
        others = map(Text, VALUES)
        if isinstance(value, dict):
            others = itertools.chain(others, map(Members, variants_of_members(list(value.items()))))
        elif isinstance(value, list):
            others = itertools.chain(others, variants_of_elements(value))
        for other in others:
            yield json_of(with_at(document, path, other)).encode("latin-1", "replace")


def is_number(value):
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def drawn(value, rng, scale, key=""):
    """`value` with other numbers. Rotations and covariances stay such, else hardly one in a million would be taken."""
    if isinstance(value, dict):
        return {name: drawn(each, rng, scale, name) for name, each in value.items()}
    if isinstance(value, list) and len(value) == 36 and key == "covariance":
        columns = [[rng.gauss(0, scale ** rng.choice((0, 1))) for _ in range(6)] for _ in range(rng.choice((3, 6, 6)))]
        floor = rng.choice((0, 1e-6, 0.1))
        return [sum(c[i] * c[j] for c in columns) + floor * (i == j) for i in range(6) for j in range(6)]
    if isinstance(value, list) and len(value) == 4 and key == "quaternion":
        parts = [rng.gauss(0, 10 ** rng.uniform(-9, 0)) for _ in range(3)] + [rng.choice((1, rng.gauss(0, 1)))]
        return [each / math.hypot(*parts) for each in parts]
    if isinstance(value, list):
        return [drawn(each, rng, scale) for each in value]
    if not is_number(value) or rng.random() < 0.3:
        return value
    if isinstance(value, int):
        return rng.choice((rng.randrange(4), rng.randrange(1000), round(rng.gauss(0, scale))))
    return rng.choice((rng.gauss(0, scale), rng.uniform(0, 1), round(rng.gauss(0, scale), 2), -0.0))


def drawn_variants(document):
    rng = random.Random(1)
    for _ in range(DRAWS):
        yield json_of(drawn(document, rng, 10 ** rng.uniform(-6, 9))).encode()


def json_within(seed):
    """The longest JSON object of it. @return its start, its end and what it says; None where there is none"""
    text, decoder, found = seed.decode("latin-1"), json.JSONDecoder(), None
    at = text.find("{")
    while at >= 0:
        try:
            value, end = decoder.raw_decode(text, at)
        except json.JSONDecodeError:
            value, end = None, at + 1
        if value and (found is None or end - at > found[1] - found[0]):
            found = (at, end, value)
        at = text.find("{", end)
    return found


def put_in(seed, start, end, text):
    """`text` for these bytes, with the length that some formats give before it made right."""
    head = seed[:start]
    if start >= 8 and struct.unpack("<Q", head[-8:])[0] == end - start:
        head = head[:-8] + struct.pack("<Q", len(text))
    longer = len(text) - (end - start)
    head = re.sub(rb"(Content-Length: )(\d+)", lambda m: m[1] + str(max(0, int(m[2]) + longer)).encode(), head)
    return head + text + seed[end:]


def byte_variants(seed):
    for i in range(0, len(seed), max(1, len(seed) // SHORT_BYTES)):
        yield seed[:i]
        yield seed[:i] + seed[i + 1:]
        for byte in b"\x00\x01\x7f\x80\xff \n\r\t0-.,:;\"'{}[]\\/#%=ne":
            yield seed[:i] + bytes([byte]) + seed[i + 1:]
        for byte in b" \n,:\"{}[]0\x00":
            yield seed[:i] + bytes([byte]) + seed[i:]
        for bit in range(8):
            yield seed[:i] + bytes([seed[i] ^ 1 << bit]) + seed[i + 1:]
    for words in (b"\xef\xbb\xbf", b"\xef\xbb", b"\xff\xfe", b" ", b"\r\n", b"/*x*/", b"\0"):
        yield words + seed
        yield seed + words
    yield seed + seed


def http_request(method, path, headers="", content_type=None, body=b""):
    lines = f"{method} {path} HTTP/1.1\r\nHost: a\r\n{headers}"
    if content_type:
        lines += f"Content-Type: {content_type}\r\n"
    if body or method in ("POST", "PUT", "DELETE"):
        lines += f"Content-Length: {len(body)}\r\n"
    return lines.encode("latin-1") + b"\r\n" + body


# What a route's parameters stand for in the target's store, then what is not there or no name.
NAMES = {"map": ["town", "nomap", "a/b", "%2e%2e", "TOWN"], "version": ["v1", "v2", "x%00"], "level": ["0", "30", "-1", "a"],
         "x": ["0", "-1", "99999999999"], "y": ["0", "1", "x"], "layer": ["coverage", "localizability", "x"],
         "other": ["v1", "v2"], "part": ["0", "1", "-1"]}
QUERIES = ["", "?layout=xyz&prior_t=0,0,0&prior_q=0,0,0,1&prior_sigma=1,0.1&stamp_ns=1500000000123456789&deadline_ms=500",
           "?layout=xyzi", "?gnss=49,8.4,110", "?new_frame=true", "?limit=10&before=5", "?limit=0", "?status=failed&map=town",
           "?active=true", "?tolerance_m=0.2", "?odom_since_ns=1&odom_t=0,0,0&odom_q=0,0,0,1&odom_sigma=0.1,0.01&stamp_ns=2",
           "?method=icp", "?a=b&c", "?%00=%", "?layout=xyz&layout=xyz"]
HEADERS = [each + "\r\n" for each in [
    "Range: bytes=0-1", "Range: bytes=5-", "Range: bytes=-5", "Range: bytes=0-1,2-3", "Range: bytes=9999999-", "Range: bytes=a",
    "Range: lines=1-2", "If-None-Match: *", 'If-None-Match: "a", W/"b"', 'If-Match: "1"', "If-Match: *", "If-Match: 0",
    "Idempotency-Key: abc", "Idempotency-Key: " + "a" * 300, "Last-Event-ID: 1", "Last-Event-ID: x", "Authorization: Bearer abc",
    "Authorization: Basic YQ==", "Accept-Encoding: gzip", "Accept: text/html", "X-Request-Id: abc", "X-Request-Id: " + "z" * 300,
    "traceparent: 00-0af7651916cd43dd8448eb211c80319c-b7ad6b7169203331-01", "traceparent: ff-",
    "Content-Digest: sha-256=:47DEQpj8HBSa+/TImW+5JCeuQeRkm5NMpJWZG3hSuFU=:", "Content-Digest: sha-512=:a:",
    "Content-Digest: x", "Expect: 100-continue", "Connection: close", "Content-Encoding: gzip", "Transfer-Encoding: chunked",
    "Origin: http://a", "Host: b\r\nHost: c", "X-Forwarded-For: 1.2.3.4", "Content-Length: 5", "Content-Length: -1",
    "Content-Length: 99999999999999999999", "A: " + "b" * 2000, "\r\n".join(f"H{i}: x" for i in range(150))]]


def http_bodies():
    def corpus(target, name):
        return (HERE / "corpus" / target / f"seed_{name}").read_bytes()

    yield None, b""
    for content_type in ("application/octet-stream", "text/plain"):
        yield content_type, struct.pack("<24f", *range(24))
    yield "application/vnd.pcd", corpus("pcd", "ascii")
    yield "application/vnd.ply", corpus("ply", "ascii")
    for content_type in ("application/x-tar", "application/gzip"):
        yield content_type, corpus("archive", "gzip")[1:]
    yield 'multipart/form-data; boundary="xYz"', corpus("pose_multipart", "raw").split(b"\n", 1)[1]
    pose = json.loads(corpus("pose_json", "full"))
    for value in ({}, [], pose, {"scans": [pose, pose]}, {"prior": pose["prior"]}, pose["prior"],
                  json.loads(corpus("edits", "both")), {"map": "town"}, {"drives": ["d"], "options": {}},
                  {"map": "town", "version": "v1", "label": "car 7", "method": "default"},
                  {"drives": [], "version": "v3", "activate": True}, {"center": [0, 0], "radius": 10, "cached_ids": ["0/0/0"]},
                  {"center": [0, 0, 0], "radius": 1e9, "cached_ids": []}, {"scopes": ["read", "localize"], "name": "x"},
                  {"name": "d", "files": []}):
        yield "application/json", json.dumps(value).encode()
    yield "application/json", b"{"


def paths_of(template):
    """@return the usual one, and those with one name changed"""
    names = re.findall(r"{(\w+)}", template)
    usual = {name: NAMES.get(name, ["0123456789abcdef", "x"])[0] for name in names}
    changed = [template.format(**usual | {name: other})
               for name in names for other in NAMES.get(name, ["0123456789abcdef", "x"])[1:]]
    return template.format(**usual), changed


def http_variants():
    bodies = list(http_bodies())
    for template, operations in json.loads(CONTRACT.read_text())["paths"].items():
        usual, changed = paths_of(template)
        for method, path in itertools.product(("GET", "HEAD", "POST", "PUT", "DELETE", "PATCH", "OPTIONS"), [usual, *changed]):
            yield http_request(method, path)
        for method in (name.upper() for name in operations if name in ("get", "put", "post", "delete")):
            written = bodies if method in ("PUT", "POST") else bodies[:1]
            for path, body in itertools.product(changed, written):
                yield http_request(method, path, "", *body)
            for body in written:
                for query in QUERIES:
                    yield http_request(method, usual + query, "", *body)
                for headers in HEADERS:
                    yield http_request(method, usual, headers, *body)


def variants(target):
    if target == "http":
        yield from http_variants()
    for file in sorted((HERE / "corpus" / target).iterdir()):
        seed = file.read_bytes()
        yield from byte_variants(seed)
        if found := json_within(seed):
            start, end, document = found
            for text in itertools.chain(json_variants(document), drawn_variants(document)):
                yield put_in(seed, start, end, text)


def write(target, folder):
    """@return how many"""
    folder.mkdir(parents=True, exist_ok=True)
    written = set()
    for each in variants(target):
        name = hashlib.sha1(each).hexdigest()
        if len(each) <= MOST_BYTES and name not in written:
            (folder / name).write_bytes(each)
            written.add(name)
    return len(written)


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    print(f"{write(sys.argv[1], pathlib.Path(sys.argv[2]))} variants")
