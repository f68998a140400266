#!/usr/bin/env python3
"""The example of the C++ client streams a drive through a session of a real server.

usage: cpp_client_test.py STILLMAP STORE DRIVE PACKAGE STREAM_DRIVE
"""

import contextlib
import http.server
import json
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import threading
import time
import unittest
import urllib.request

PROGRAM, STORE, DRIVE, _, EXAMPLE = (pathlib.Path(x).resolve() for x in sys.argv[1:6])


PAGE = b"<html>moved</html>"
#: Status, type, further headers and body of what no server of ours would say.
WRONG = [(301, "text/html", {"Location": "https://x/"}, PAGE), (200, "text/html", {}, PAGE),
         (200, "application/json", {}, b"{}"), (200, "application/json", {}, b"[1]"),
         (500, "application/json", {}, b'{"code": 7}'), (200, "application/json", {"Content-Length": "100"}, b'{"status": ')]
POSE = json.dumps({
    "status": "lost", "reasons": [], "pose": None, "covariance": None, "covariance_order": [],
    "protection": dict.fromkeys(("longitudinal_m", "lateral_m", "vertical_m", "yaw_rad")), "inlier_ratio": 0.0,
    "rmse_m": 0.0, "movable_points": 0, "no_returns": 0, "degenerate_directions": [], "prior_to_pose": None, "iterations": 0,
    "map": {"name": "a", "version": "b", "digest": "c"}, "stamp_ns": "1",
    "timing_ms": {"wait": 0.0, "decode": 0.0, "align": 0.0, "total": 0.0}, "warnings": [], "request_id": "r"}).encode()


@contextlib.contextmanager
def fake():
    """Port of a server that gives each of the wrong answers to an opening and to a scan before it gives good ones."""
    script = {"/v1/sessions": list(WRONG), "scans": list(WRONG)}

    class Handler(http.server.BaseHTTPRequestHandler):
        def do_POST(self):
            self.rfile.read(int(self.headers.get("Content-Length", 0)))
            opens = self.path == "/v1/sessions"
            good = (201, "application/json", {}, b'{"id": "s"}') if opens else (200, "application/json", {}, POSE)
            wrong = script["/v1/sessions" if opens else "scans"]
            status, kind, headers, body = wrong.pop() if wrong else good
            self.send_response(status)
            for name, value in {"Content-Type": kind, "Content-Length": str(len(body)), **headers}.items():
                self.send_header(name, value)
            self.end_headers()
            self.wfile.write(body)

        do_DELETE = do_POST

        def log_message(self, *_):
            pass

    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    server.daemon_threads = True
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield server.server_port
    finally:
        server.shutdown()
        server.server_close()


class Streaming(unittest.TestCase):
    def setUp(self):
        temporary = tempfile.TemporaryDirectory()
        self.addCleanup(temporary.cleanup)
        self.store, self.port, self.server = pathlib.Path(temporary.name) / "store", 0, None
        shutil.copytree(STORE, self.store)
        self.addCleanup(self.stop)

    def start(self, *options):
        self.server = subprocess.Popen([PROGRAM, "serve", "--store", self.store, "--port", str(self.port), *options],
                                       stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        self.port = int(re.search(r"127\.0\.0\.1:(\d+)", self.server.stdout.readline()).group(1))

    def stop(self):
        if self.server is not None:
            self.server.terminate()
            self.server.communicate(timeout=30)
            self.server = None

    def stream(self, rate, **environment):
        done = subprocess.run([EXAMPLE, f"http://127.0.0.1:{self.port}", "town", DRIVE, str(rate)],
                              capture_output=True, text=True, timeout=150, env=environment)
        counts = re.search(r"(\d+) answered, (\d+) replaced by newer ones, (\d+) failed, (\d+) sessions", done.stdout)
        self.assertTrue(counts, done.stdout + done.stderr)
        lines = [line.split() for line in done.stdout.splitlines()[:-1]]
        return done, [int(x) for x in counts.groups()], lines

    def wait_for_session(self):
        for _ in range(100):
            time.sleep(0.1)
            with urllib.request.urlopen(f"http://127.0.0.1:{self.port}/v1/maps/town/stats", timeout=10) as answer:
                if sum(json.load(answer)["queries"].values()) > 1:
                    return

    def test_a_slow_vehicle_has_every_scan_answered_a_fast_one_its_newest(self):
        self.start()
        scans = len(list((DRIVE / "velodyne").glob("*.bin")))
        done, (answered, replaced, failed, sessions), lines = self.stream(1000)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertEqual((answered + replaced + failed, sessions), (scans, 1))
        self.assertGreater(replaced, 0)
        stamps = [float(line[0]) for line in lines]
        self.assertEqual(stamps, sorted(stamps))
        self.assertAlmostEqual(stamps[-1], (scans - 1) / 1000.0)

    def test_the_stream_goes_on_with_a_server_started_anew(self):
        self.start()
        restarting = threading.Thread(target=lambda: (self.wait_for_session(), self.stop(), time.sleep(0.5), self.start()))
        restarting.start()
        done, (answered, _, failed, sessions), lines = self.stream(8)
        restarting.join()
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertEqual(sessions, 2, done.stdout + done.stderr)
        self.assertGreater(failed, 0)
        self.assertNotEqual(lines[-1][1], "lost", done.stdout)

    def test_a_server_for_another_vehicle_gets_whole_scans(self):
        options = self.store.parent / "options"
        options.mkdir()
        (options / "town.json").write_text('{"aligner": {"own_vehicle_m": 0.6}}')
        self.start("--localization-options-dir", str(options))
        done, (answered, *_), _ = self.stream(20)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertGreater(answered, 0)
        # Others may fail while the server still loads the map.
        self.assertNotIn("InvalidScan", done.stderr)

    def test_a_key_is_sent_and_missed(self):
        self.start()
        key = subprocess.run([PROGRAM, "keys", "create", "vehicle", "--scope", "localize", "--store", self.store],
                             check=True, capture_output=True, text=True).stdout.strip()
        done, (answered, *_), _ = self.stream(1000)
        self.assertEqual((done.returncode, answered), (1, 0))
        self.assertIn("401 MissingKey", done.stderr)
        done, (answered, *_), _ = self.stream(1000, STILLMAP_KEY=key)
        self.assertEqual(done.returncode, 0, done.stderr)

    def test_a_stream_outlives_whatever_an_answer_is(self):
        with fake() as self.port:
            # Slow enough that scans are left for the good answers on a busy machine.
            done, (answered, _, failed, sessions), _ = self.stream(20)
            self.assertEqual(done.returncode, 0, done.stderr)
            self.assertGreater(answered, 0)
            self.assertGreaterEqual(failed, len(WRONG))
            for text in ("301 : found 'text/html' that leads to https://x/, expected application/problem+json",
                         "200 : found 'text/html', expected application/json", "200 : found another answer than expected",
                         "500 : found 'application/json'", "no answer"):
                self.assertIn(text, done.stderr)

    def test_the_page_tells_how_to_compile(self):
        root = pathlib.Path(__file__).resolve().parents[2]
        page = (root / "server/clients/README.md").read_text()
        command = re.search(r"^g\+\+ .*?[^\\]\n", page, re.M | re.S).group(0)
        with tempfile.TemporaryDirectory() as folder:
            made = pathlib.Path(folder) / "stream_drive"
            subprocess.run(command.replace("-o stream_drive", f"-o {made}").replace("-O2", "-O0"), shell=True, check=True, cwd=root)
            self.assertEqual(subprocess.run([made], capture_output=True).returncode, 2)

    def test_wrong_usage_is_2(self):
        self.assertEqual(subprocess.run([EXAMPLE], capture_output=True).returncode, 2)


if __name__ == "__main__":
    unittest.main(argv=[sys.argv[0], *sys.argv[6:]])
