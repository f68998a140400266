#!/usr/bin/env python3
"""`stillmap mirror` against a server: a copy that is killed again and again ends whole; changed bytes never come in.

usage: mirror_test.py STILLMAP STORE MIRROR_MAP [--kills 100]

MIRROR_MAP is the example of the C++ client.
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
PARSER.add_argument("mirror_map")
PARSER.add_argument("--kills", type=int, default=100)
ASKED = PARSER.parse_args()
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "server/clients/python/src"))

from stillmap_client import Client, StillmapError  # noqa: E402


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

    def spoiling_proxy(self):
        proxy = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Spoiling)
        proxy.behind = self.url
        threading.Thread(target=proxy.serve_forever, daemon=True).start()
        self.addCleanup(proxy.server_close)
        self.addCleanup(proxy.shutdown)
        return f"http://127.0.0.1:{proxy.server_port}"

    def test_refuses_changed_bytes_and_keeps_none(self):
        done = self.mirror(url=self.spoiling_proxy())
        self.assertEqual(done.returncode, 1)
        self.assertIn("other bytes than those of SHA-256", done.stderr)
        self.assertFalse([f for f in self.copy.rglob("*.part")])
        self.assertEqual(self.mirror().returncode, 0)
        self.assert_whole()

    def test_takes_only_what_a_trusted_key_has_signed(self):
        key, other = self.folder / "key", self.folder / "other"
        for each in (key, other):
            self.assertEqual(run("keys", "sign", "make", each).returncode, 0)
        trusted = f"{key}.pub"
        done = self.mirror("--trusted", trusted)
        self.assertEqual(done.returncode, 1)
        self.assertIn("0 signatures, none by a trusted key", done.stderr)

        def sign(with_key):
            done = run("keys", "sign", "version", "town", self.served["version"], "--store", self.folder / "origin",
                       "--key", with_key)
            self.assertEqual(done.returncode, 0, done.stderr)

        sign(other)
        self.assertEqual(self.mirror("--trusted", trusted).returncode, 1)
        self.assertFalse(list(self.copy.glob("packages/*")))
        sign(key)
        self.assertEqual(self.mirror("--trusted", trusted).returncode, 0)
        self.assert_whole()
        # The copy has the signatures: who trusts the key may take it from there.
        rotated = run("keys", "sign", "rotate", "--former", trusted, "--store", self.copy, "--key", other)
        self.assertIn("1 versions: signed by", rotated.stdout)

    def test_keeps_only_the_regions_around_a_place(self):
        done = self.mirror("--around", "0", "0", "50", "--json")
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertGreater(json.loads(done.stdout)["regions"], 0)
        listed = json.loads(run("store", "list", self.copy, "--json").stdout)
        self.assertIn(".part-", listed["maps"][0]["version"])
        self.assertEqual(run("store", "verify", self.copy).returncode, 0)
        self.assertEqual(self.mirror("--around", "1e6", "0", "50").returncode, 1)

    def client_mirrors(self):
        """The mirrors of both clients: a URL to a pair of digest and bytes that were fetched."""
        def python(url):
            found = Client(url, retries=0).mirror("town", self.copy)
            return found.digest, found.fetched_bytes

        def cpp(url):
            done = subprocess.run([ASKED.mirror_map, url, "town", self.copy], capture_output=True, text=True, timeout=60)
            if done.returncode != 0:
                raise StillmapError(done.stderr)
            return done.stdout.split()[1], int(done.stdout.split()[2])
        return {"python": python, "cpp": cpp}

    def test_clients_keep_a_copy_that_is_whole(self):
        for name, mirror in self.client_mirrors().items():
            with self.subTest(name):
                spoiling = self.spoiling_proxy()
                with self.assertRaisesRegex(StillmapError, "other bytes than those of SHA-256"):
                    mirror(spoiling)
                self.assertFalse((self.copy / "current").exists())
                digest, fetched = mirror(self.url)
                self.assertEqual(digest, self.served["digest"])
                self.assertEqual(run("inspect", self.copy / "current").returncode, 0)
                found = json.loads(run("inspect", self.copy / "current", "--json").stdout)
                self.assertEqual(found["digest"], digest)
                self.assertEqual(mirror(self.url), (digest, 0))
                # As if it were another version, whose files are the same.
                before = "0" * 64
                (self.copy / digest).rename(self.copy / before)
                (self.copy / "current").unlink()
                (self.copy / "current").symlink_to(before)
                pack = next((self.copy / before / "packs").iterdir())
                damaged = pack.read_bytes()[:-1] + b"\0\0"
                pack.unlink()
                pack.write_bytes(damaged)
                digest, again = mirror(self.url)
                self.assertLess(again, fetched)
                self.assertGreater(again, pack.stat().st_size // 2, "the damaged file is fetched again")
                self.assertEqual(sorted(x.name for x in self.copy.iterdir()), sorted([before, digest, "current"]))
                shutil.rmtree(self.copy)

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
