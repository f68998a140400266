#!/usr/bin/env python3
"""What a request costs grows as its bytes do: every route that takes JSON gets the largest body of every repeated element.

usage: request_growth_test.py STILLMAP STORE

The server's processor time is compared at a quarter of the bytes and at all of them: above 6 times it grows faster than the
input. What does not hold is asked up to three times, and the least counts. The routes are those of the OpenAPI document.
"""

import functools
import gzip
import http.client
import json
import math
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import time
import unittest

PROGRAM, STORE = sys.argv[1:3]
MOST_BYTES = 8 * 1024 * 1024
ELEMENTS = ["{}", "[]", '""', "0", "null", '{"a":{}}', "[0,0,0]", '{"a":1,"b":[{}]}', "[[[[[]]]]]", '"' + 200 * "x" + '"']
# Below this, fresh pages and clock ticks of 10 ms count for as much.
LEAST_S = 0.1
MOST_GROWTH = 6.0
MOST_S = 1.0


@functools.cache
def repeated(key, element, size):
    count = max(1, (size - len(key) - 6) // (len(element) + 1))
    return ('{"' + key + '":[' + ",".join([element] * count) + "]}").encode()


@functools.cache
def members(size):
    return ("{" + ",".join(f'"k{i}":0' for i in range(size // 12)) + "}").encode()


def nested(size):
    return (b"[" * (size // 2)) + b"]" * (size // 2)


class Growth(unittest.TestCase):
    def setUp(self):
        temporary = tempfile.TemporaryDirectory()
        self.addCleanup(temporary.cleanup)
        store = pathlib.Path(temporary.name) / "store"
        shutil.copytree(STORE, store)
        self.server = subprocess.Popen([PROGRAM, "serve", "--store", str(store), "--port", "0"], text=True,
                                       stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
        self.addCleanup(self.end)
        self.port = int(re.search(r":(\d+)/", self.server.stdout.readline())[1])
        self.connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=120)
        while self.ask("GET", "/readyz")[0] != 200:
            time.sleep(0.05)

    def end(self):
        self.connection.close()
        self.server.kill()
        self.server.wait()
        self.server.stdout.close()

    def ask(self, method, path, body=None, headers=None):
        try:
            self.connection.request(method, path, body, headers or {})
            answer = self.connection.getresponse()
            return answer.status, answer.read()
        except (http.client.HTTPException, OSError):
            self.connection.close()  # it was told 413 before it had sent everything
            return 0, b""

    def cpu_s(self):
        text = pathlib.Path(f"/proc/{self.server.pid}/stat").read_text()
        fields = text[text.rindex(")") + 2:].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def cost_s(self, route, body, headers):
        begin = self.cpu_s()
        status, _ = self.ask(*route, body, {"Content-Type": "application/json", **headers})
        return self.cpu_s() - begin, status

    def routes(self):
        paths = json.loads(self.ask("GET", "/openapi.json")[1])["paths"]
        values = {"map": "town", "version": "v1"}
        for path, methods in paths.items():
            for method, operation in methods.items():
                if "application/json" in operation.get("requestBody", {}).get("content", {}):
                    yield method.upper(), re.sub(r"{(\w+)}", lambda found: values.get(found[1], "1"), path)

    def grows_as_bytes(self, route, made, size, headers=None, packed=False):
        pack = gzip.compress if packed else bytes
        small, large = pack(made(size // 4)), pack(made(size))
        quarter = whole = math.inf
        for _ in range(3):
            quarter = min(quarter, self.cost_s(route, small, headers or {})[0])
            cost, status = self.cost_s(route, large, headers or {})
            whole = min(whole, cost)
            self.assertNotIn(status, (0, 500, 503, 504), route)
            most = min(MOST_S, MOST_GROWTH * max(quarter, LEAST_S))
            if whole < most:
                return whole
        self.fail(f"{route}: {quarter:.2f} s for a quarter, then {whole:.2f} s, at most {most:.2f}")

    def test_every_route_and_element(self):
        routes = list(self.routes())
        self.assertGreater(len(routes), 6)
        worst = (0.0, "", 0)
        for route in routes:
            # The largest that the route takes: its own limit may be below the server's.
            size = MOST_BYTES - 100
            while size > 4096 and self.cost_s(route, repeated("points", "0", size), {})[1] in (0, 413):
                size //= 2
            key = {"batch": "queries", "edits": "edits", "rebuild": "drives"}.get(route[1].split("/")[-1], "points")
            makers = [lambda n, e=element: repeated(key, e, n) for element in ELEMENTS] + [members, nested]
            for number, made in enumerate(makers):
                with self.subTest(route=route, made=number):
                    worst = max(worst, (self.grows_as_bytes(route, made, size), " ".join(route), number))
        print(f"the costliest: {worst[0]:.2f} s of processor time, {worst[1]}, element {worst[2]}")

    def test_packed(self):
        for element in ("{}", "[]", "[0,0,0]"):
            with self.subTest(element=element):
                self.grows_as_bytes(("POST", "/v1/maps/town/localize"), lambda n, e=element: repeated("points", e, n),
                                    MOST_BYTES - 100, {"Content-Encoding": "gzip"}, packed=True)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
