#!/usr/bin/env python3
"""`stillmap mirror` against a server: a copy that is killed again and again ends whole; changed bytes never come in.

usage: mirror_test.py STILLMAP STORE [--kills 100]
"""

import argparse
import http.server
import json
import pathlib
import random
import re
import shutil
import subprocess
import sys
import tempfile
import threading
import time
import unittest
import urllib.request

PARSER = argparse.ArgumentParser()
PARSER.add_argument("program")
PARSER.add_argument("store", type=pathlib.Path)
PARSER.add_argument("--kills", type=int, default=100)
ASKED = PARSER.parse_args()


def run(*arguments):
    return subprocess.run([ASKED.program, *map(str, arguments)], capture_output=True, text=True, timeout=120)


class Spoiling(http.server.BaseHTTPRequestHandler):
    """Passes on what a server says, and flips a bit in the middle of large files."""

    def do_GET(self):
        asked = urllib.request.Request(self.server.behind + self.path)
        for name in ("Range",):
            if self.headers.get(name):
                asked.add_header(name, self.headers[name])
        with urllib.request.urlopen(asked, timeout=30) as answer:
            body = bytearray(answer.read())
            if len(body) > 20000 and "/files/" in self.path:
                body[len(body) // 2] ^= 1
            self.send_response(answer.status)
            self.send_header("Content-Length", str(len(body)))
            self.send_header("Content-Type", answer.headers["Content-Type"])
            self.end_headers()
            self.wfile.write(bytes(body))

    def log_message(self, *_):
        pass


class Mirror(unittest.TestCase):
    def setUp(self):
        self.folder = pathlib.Path(tempfile.mkdtemp())
        self.addCleanup(shutil.rmtree, self.folder)
        shutil.copytree(ASKED.store, self.folder / "origin")
        self.server = subprocess.Popen([ASKED.program, "serve", "--store", self.folder / "origin", "--port", "0"],
                                       stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        self.addCleanup(self.server.stdout.close)
        self.addCleanup(self.server.wait)
        self.addCleanup(self.server.terminate)
        port = re.search(r"127\.0\.0\.1:(\d+)", self.server.stdout.readline()).group(1)
        self.url = f"http://127.0.0.1:{port}"
        for _ in range(200):
            try:
                with urllib.request.urlopen(f"{self.url}/readyz", timeout=5):
                    break
            except OSError:
                time.sleep(0.05)
        with urllib.request.urlopen(f"{self.url}/v1/maps/town", timeout=5) as answer:
            self.served = json.load(answer)
        self.copy = self.folder / "copy"

    def mirror(self, *options, url=None):
        return run("mirror", url or self.url, "town", "-o", self.copy, *options)

    def assert_whole(self):
        listed = json.loads(run("store", "list", self.copy, "--json").stdout)
        active = [version for m in listed["maps"] for version in m["versions"] if version.get("active")]
        self.assertEqual([version["digest"] for version in active], [self.served["digest"]], listed)
        verified = run("store", "verify", self.copy)
        self.assertEqual(verified.returncode, 0, verified.stdout + verified.stderr)

    def test_is_a_store_that_can_be_served_and_knows_when_it_is_current(self):
        done = self.mirror("--json")
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertTrue(json.loads(done.stdout)["is_new"])
        self.assert_whole()
        again = json.loads(self.mirror("--json").stdout)
        self.assertEqual((again["is_new"], again["bytes_fetched"]), (False, 0))

    def test_ends_whole_however_often_it_is_killed(self):
        draw = random.Random(1)
        killed = ended = 0
        while killed < ASKED.kills:
            # While it fetches, and while it publishes.
            rate = ["--rate", "20"] if draw.random() < 0.5 else []
            process = subprocess.Popen([ASKED.program, "mirror", self.url, "town", "-o", self.copy, *rate],
                                       stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
            try:
                process.wait(draw.uniform(0.0, 0.15))
                ended += 1
                self.assert_whole()
                shutil.rmtree(self.copy)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
                killed += 1
        print(f"killed {killed} times; ended {ended} times between", flush=True)
        self.assertEqual(self.mirror().returncode, 0)
        self.assert_whole()

    def test_refuses_changed_bytes_and_keeps_none(self):
        proxy = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Spoiling)
        proxy.behind = self.url
        threading.Thread(target=proxy.serve_forever, daemon=True).start()
        self.addCleanup(proxy.server_close)
        self.addCleanup(proxy.shutdown)
        done = self.mirror(url=f"http://127.0.0.1:{proxy.server_port}")
        self.assertEqual(done.returncode, 1)
        self.assertIn("other bytes than those of SHA-256", done.stderr)
        self.assertFalse([f for f in self.copy.rglob("*.part")])
        self.assertEqual(self.mirror().returncode, 0)
        self.assert_whole()

    def test_a_damaged_file_of_the_server_never_comes_in(self):
        pack = next((self.folder / "origin" / "packages" / self.served["digest"] / "packs").iterdir())
        with pack.open("r+b") as file:
            file.seek(pack.stat().st_size // 2)
            byte = file.read(1)
            file.seek(-1, 1)
            file.write(bytes([byte[0] ^ 1]))
        done = self.mirror()
        self.assertEqual(done.returncode, 1)
        self.assertIn("damaged", done.stderr)

    def test_says_what_is_wrong(self):
        for arguments, words in ((("http://127.0.0.1:1", "town"), "go on"), (("nonsense", "town"), ""),
                                 ((self.url, "village"), "404")):
            done = run("mirror", *arguments, "-o", self.copy)
            self.assertNotEqual(done.returncode, 0)
            self.assertIn(words, done.stderr)
            self.assertEqual(len(done.stderr.strip().splitlines()), 1, done.stderr)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
