#!/usr/bin/env python3
"""A running server as its operator meets it: configuration, log, SIGHUP, the way to its end, the service manager.

usage: serve_test.py STILLMAP
"""

import contextlib
import fcntl
import hashlib
import http.client
import json
import os
import pathlib
import re
import signal
import socket
import sqlite3
import subprocess
import sys
import tempfile
import time
import unittest

PROGRAM = sys.argv[1]
TRACE = "4bf92f3577b34da6a3ce929d0e0e4736"


def run(*arguments, **environment):
    return subprocess.run([PROGRAM, "serve", *map(str, arguments)], capture_output=True, text=True, timeout=60,
                          env={**os.environ, **environment})


class FolderTest(unittest.TestCase):
    def setUp(self):
        temporary = tempfile.TemporaryDirectory()
        self.addCleanup(temporary.cleanup)
        self.folder = pathlib.Path(temporary.name)
        self.store = self.folder / "store"
        self.store.mkdir()
        self.config = self.folder / "stillmap.json"
        self.log = self.folder / "server.log"

    def write(self, **values):
        self.config.write_text("// for a test\n" + json.dumps(values))


class Configuration(FolderTest):
    def test_check_names_every_problem_and_is_2(self):
        self.write(prot=1, queue=-1, log={"level": "loud"})
        done = run("--check", "--config", self.config, STILLMAP_SERVE_WORKERS="x")
        self.assertEqual(done.returncode, 2)
        self.assertEqual(done.stdout, "")
        lines = done.stderr.splitlines()
        self.assertEqual(len(lines), 4, done.stderr)
        for line in lines:
            self.assertRegex(line, r"\Astillmap: (\S+): (\S+): found .+, expected .+\Z")
        self.assertIn("the nearest is port", done.stderr)

    def test_check_is_0_for_what_can_be_used(self):
        self.write(port=0, sessions={"max": 5})
        done = run("--check", "--config", self.config)
        self.assertEqual((done.returncode, done.stderr), (0, ""))

    def test_check_looks_at_what_is_named_and_makes_nothing(self):
        self.write(store=str(self.store), log={"file": str(self.log)})
        self.assertEqual(run("--check", "--config", self.config).returncode, 0)
        self.assertEqual((self.log.exists(), list(self.store.iterdir())), (False, []))
        self.write(store=str(self.folder / "none"))
        self.assertEqual(run("--check", "--config", self.config).returncode, 0)
        self.assertFalse((self.folder / "none").exists())
        self.write(store=str(self.folder / "none" / "store"), log={"file": str(self.folder / "logs" / "server.log")},
                   tls={"certificate_file": str(self.folder / "c.pem"), "key_file": str(self.folder / "k.pem")})
        done = run("--check", "--config", self.config)
        self.assertEqual((done.returncode, done.stdout), (2, ""))
        self.assertRegex(done.stderr, r"\A(stillmap: \S+: (store|tls.certificate_file|log.file): found .+, expected .+\n){3}\Z")

    def test_values_say_where_they_come_from_and_can_be_used_again(self):
        self.write(port=1, queue=2, workers=3)
        done = run("--print-config", "--port", "4", "--allow-remote", STILLMAP_SERVE_QUEUE="5",
                   STILLMAP_SERVE_CONFIG=str(self.config))
        self.assertEqual(done.returncode, 0, done.stderr)
        for line in ('"port": 4,  // --port', '"queue": 5,  // STILLMAP_SERVE_QUEUE', f'"workers": 3,  // {self.config}',
                     '"allow_remote": true,  // --allow-remote', '"host": "127.0.0.1",  // default'):
            self.assertIn(line, done.stdout)
        self.config.write_text(done.stdout)
        again = run("--print-config", "--config", self.config)
        without = re.compile("  // .*")
        self.assertEqual(without.sub("", again.stdout), without.sub("", done.stdout))

    def test_schema_is_one_and_flags_can_be_taken_back(self):
        self.assertEqual(json.loads(run("--print-schema").stdout)["additionalProperties"], False)
        self.write(allow_remote=True)
        done = run("--print-config", "--config", self.config, "--allow-remote=false")
        self.assertIn('"allow_remote": false,  // --allow-remote', done.stdout)

    def test_it_does_not_start_without_a_store(self):
        done = run("--port", "0")
        self.assertEqual(done.returncode, 2)
        self.assertIn("--store", done.stderr)
        none = self.folder / "none"
        done = run("--port", "0", "--store", none / "store")
        self.assertEqual((done.returncode, done.stdout), (2, ""))
        self.assertIn(f"mkdir -p {none}", done.stderr)
        self.assertFalse(none.exists())
        self.config.write_text("{}")
        done = run("--port", "0", "--store", self.config)
        self.assertEqual((done.returncode, done.stdout), (2, ""))
        self.assertIn("is no folder", done.stderr)


class Running(FolderTest):
    def start(self, *arguments, **environment):
        self.program = subprocess.Popen(
            [PROGRAM, "serve", "--config", self.config, *map(str, arguments)], stdout=subprocess.PIPE,
            stderr=subprocess.PIPE, text=True, env={**os.environ, **environment})
        self.addCleanup(self.end)
        line = self.program.stdout.readline()
        self.assertRegex(line, r"\Alistening on http://(127\.0\.0\.1|0\.0\.0\.0):\d+/\n\Z")
        self.port = int(line.split(":")[2].rstrip("/\n"))

    def end(self):
        if self.program.poll() is None:
            self.program.kill()
        self.program.communicate()

    def configure(self, log=None, **values):
        self.write(port=0, store=str(self.store), log={"format": "json", "file": str(self.log), **(log or {})}, **values)

    def get(self, path, port=None, **headers):
        connection = http.client.HTTPConnection("127.0.0.1", port or self.port, timeout=10)
        connection.request("GET", path, headers=headers)
        answer = connection.getresponse()
        text = answer.read()
        connection.close()
        return answer.status, text

    def lines(self, file=None):
        return [json.loads(line) for line in (file or self.log).read_text().splitlines()]

    def wait(self, what, timeout=20):
        end = time.monotonic() + timeout
        while time.monotonic() < end:
            found = what()
            if found:
                return found
            time.sleep(0.02)
        self.fail(f"did not come in {timeout} s; log:\n{self.log.read_text() if self.log.exists() else ''}")

    def message(self, text, file=None):
        return self.wait(lambda: [line for line in self.lines(file) if text in line["message"]])[0]

    def finish(self, number=signal.SIGTERM):
        self.program.send_signal(number)
        self.program.communicate(timeout=30)
        return self.program.returncode

    def test_requests_are_logged_by_route_with_ids_and_no_secret(self):
        self.configure()
        self.start()
        self.get("/v1/maps/town?key=hush1", **{"X-Request-Id": "mine", "traceparent": f"00-{TRACE}-00f067aa0ba902b7-01",
                                               "Authorization": "Bearer hush2"})
        self.get("/livez")
        self.get("/v1/maps/%0a%7b%22level%22:%22error%22%7d", **{"traceparent": "00-x"})
        requests = self.wait(lambda: [line for line in self.lines() if line["message"] == "request"][1:] and
                             [line for line in self.lines() if line["message"] == "request"])
        self.assertEqual(len(requests), 2, requests)
        first = requests[0]
        self.assertEqual((first["request_id"], first["trace_id"], first["method"], first["route"]),
                         ("mine", TRACE, "GET", "/v1/maps/{map}"))
        self.assertRegex(first["span_id"], r"\A[0-9a-f]{16}\Z")
        self.assertNotEqual(first["span_id"], "00f067aa0ba902b7")
        self.assertRegex(first["time"], r"\A\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z\Z")
        self.assertNotIn("trace_id", requests[1])
        self.assertNotIn("hush", self.log.read_text())
        self.assertEqual(self.finish(), 0)

    def test_refused_requests_are_logged_with_route_source_and_key(self):
        made = subprocess.run([PROGRAM, "keys", "create", "display", "--store", self.store, "--scope", "read", "--json"],
                              check=True, capture_output=True, text=True)
        key = json.loads(made.stdout)
        bearer = {"Authorization": f"Bearer {key['key']}"}
        wrong = {"Authorization": f"Bearer {key['key'][:-1]}{'1' if key['key'][-1] == '0' else '0'}"}
        # One request is refused for its scope and counts too.
        self.configure(rate={"requests_per_s": 0.001, "burst": 3})
        self.start()
        for path, headers in (("/v1/audit", {}), ("/v1/audit", wrong), ("/v1/audit", bearer),
                              ("/v1/maps", bearer), ("/v1/maps", bearer), ("/v1/maps", bearer)):
            self.get(path, **headers)
        subprocess.run([PROGRAM, "keys", "revoke", key["id"], "--store", self.store], check=True, capture_output=True)
        self.get("/v1/maps", **bearer)
        self.get("/v1/nothing", **bearer)
        requests = self.wait(lambda: [line for line in self.lines() if line["message"] == "request"][7:] and
                             [line for line in self.lines() if line["message"] == "request"])
        self.assertEqual([(line["status"], line.get("route"), line.get("key_id")) for line in requests],
                         [(401, "/v1/audit", None), (401, "/v1/audit", None), (403, "/v1/audit", key["id"]),
                          (200, "/v1/maps", key["id"]), (200, "/v1/maps", key["id"]), (429, "/v1/maps", key["id"]),
                          (401, "/v1/maps", key["id"]), (404, None, None)])
        self.assertEqual({line["source"] for line in requests}, {"127.0.0.1"})
        self.assertEqual(self.finish(), 0)

    def test_a_client_s_request_id_that_comes_twice_is_told_apart(self):
        key = subprocess.run([PROGRAM, "keys", "create", "boss", "--store", self.store, "--scope", "admin"],
                             check=True, capture_output=True, text=True).stdout.strip()
        self.configure()
        self.start()
        for name in ("mine", "mine", "no id"):
            connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=10)
            connection.request("DELETE", "/v1/keys/none", headers={"Authorization": f"Bearer {key}", "X-Request-Id": name})
            answered = connection.getresponse().getheader("X-Request-Id")
            connection.close()
            self.assertEqual(answered == name, name == "mine")
        records = json.loads(self.get("/v1/audit", Authorization=f"Bearer {key}")[1])["records"]
        self.assertEqual([record["request_id"] for record in records], [answered, "mine", "mine"])
        self.assertEqual(records[0]["server_request_id"], answered)
        self.assertEqual(len({record["server_request_id"] for record in records}), 3)
        self.assertEqual({record["source"] for record in records}, {"127.0.0.1"})
        lines = [line for line in self.lines() if line.get("request_id") == "mine"]
        self.assertEqual([line["server_request_id"] for line in lines], [record["server_request_id"] for record in records[:0:-1]])
        self.assertEqual(self.finish(), 0)
        self.check_audit(len(records))

    def check_audit(self, count):
        """The chain as server/store.md describes it."""
        def audit(*arguments):
            return subprocess.run([PROGRAM, "audit", *arguments, "--store", self.store], capture_output=True, text=True)

        records = [json.loads(line) for line in audit("export").stdout.splitlines()]
        self.assertEqual(len(records), count)
        before = "0" * 64
        for record in records:
            fields = ("id", "time_ns", "request_id", "server_request_id", "source", "key_id", "method", "route", "subject", "status")
            text = "".join(f"{len(str(record[name]).encode())}:{record[name]}\n" for name in fields)
            self.assertEqual(record["previous_sha256"], before)
            before = hashlib.sha256(f"{before}\n{text}".encode()).hexdigest()
            self.assertEqual(record["sha256"], before)
        done = audit("verify", "--json")
        self.assertEqual((done.returncode, json.loads(done.stdout)),
                         (0, {"records": count, "newest_id": count, "newest_sha256": before, "first_wrong_id": None}))
        self.assertIn(before, audit("verify").stdout)
        with contextlib.closing(sqlite3.connect(self.store / "state.db")) as database, database:
            database.execute("DELETE FROM audit WHERE id = 2")
        done = audit("verify")
        self.assertEqual(done.returncode, 1)
        self.assertIn("record 3 does not fit", done.stdout)

    def test_sighup_reloads_and_says_what_needs_a_restart(self):
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            management = {"port": free.getsockname()[1]}
        self.configure(queue=3, management=management)
        self.start()
        self.configure(queue=4, log={"level": "debug"}, management=management)
        self.program.send_signal(signal.SIGHUP)
        self.assertIn("log.level", self.message("configuration reloaded")["message"])
        self.assertIn("queue", self.message("need a restart")["message"])
        self.get("/livez")
        self.wait(lambda: [line for line in self.lines() if line.get("route") == "/livez"])
        self.config.write_text('{"log": {"level": "loud"}}')
        self.program.send_signal(signal.SIGHUP)
        self.assertIn("log.level", self.message("not reloaded")["message"])
        counted = ['stillmap_reloads_total{result="ok"} 1\n', 'stillmap_reloads_total{result="failed"} 1\n']
        self.wait(lambda: all(each in self.get("/metrics", port=management["port"])[1].decode() for each in counted))
        self.assertEqual(self.get("/livez")[0], 200)
        self.assertEqual(self.finish(), 0)

    def test_a_sighup_that_fails_changes_nothing_but_opens_the_log_again(self):
        self.configure(batch={"max_scans": 5})
        self.start()
        self.configure(batch={"max_scans": 6}, log={"file": str(self.folder / "none" / "log")})
        self.log.rename(self.folder / "server.log.1")
        self.program.send_signal(signal.SIGHUP)
        self.wait(self.log.exists)
        self.assertIn("none/log", self.message("nothing has changed")["message"])
        self.assertEqual(json.loads(self.get("/v1/status")[1])["limits"]["max_batch"], 5)
        self.configure(batch={"max_scans": 6})
        self.program.send_signal(signal.SIGHUP)
        self.assertIn("batch.max_scans", self.message("configuration reloaded")["message"])
        self.assertEqual(json.loads(self.get("/v1/status")[1])["limits"]["max_batch"], 6)
        self.assertEqual(self.finish(), 0)

    def test_a_rotated_log_is_opened_again(self):
        self.configure()
        self.start()
        self.get("/v1/status")
        old = self.folder / "server.log.1"
        self.log.rename(old)
        self.program.send_signal(signal.SIGHUP)
        self.wait(self.log.exists)
        self.message("configuration reloaded")
        self.assertEqual(self.finish(), 0)

    def test_a_missing_folder_becomes_a_store(self):
        self.store = self.folder / "new"
        self.configure()
        self.start()
        self.assertIn(str(self.store), self.message("made the folder")["message"])
        self.assertEqual(json.loads(self.get("/v1/maps")[1])["maps"], [])
        self.assertEqual(self.finish(), 0)
        self.assertTrue((self.store / "state.db").exists())

    def test_it_warns_where_other_machines_need_no_key(self):
        self.configure(host="0.0.0.0", allow_remote=True, allow_without_keys=True)
        self.start()
        warning = self.message("can read, change and delete everything")
        self.assertEqual(warning["level"], "warning")
        self.assertIn(f"0.0.0.0:{self.port}", warning["message"])
        self.assertIn(f"stillmap keys create NAME --store {self.store} --scope admin", warning["message"])
        self.assertEqual(self.finish(), 0)
        subprocess.run([PROGRAM, "keys", "create", "boss", "--store", self.store, "--scope", "admin"], check=True, capture_output=True)
        self.log.unlink()
        self.start()
        self.message("serves")
        self.assertNotIn("delete everything", self.log.read_text())
        self.assertEqual(self.finish(), 0)

    def test_the_log_tells_of_the_start_and_the_end(self):
        self.configure()
        self.start()
        self.assertIn(f"127.0.0.1:{self.port}", self.message("serves")["message"])
        self.assertEqual(self.finish(), 0)
        self.assertEqual(self.lines()[-1]["message"], "stopped")

    def test_the_end_is_announced_before_connections_are_refused(self):
        self.configure(drain={"delay_s": 2})
        self.start()
        self.wait(lambda: self.get("/readyz")[0] == 200)
        self.program.send_signal(signal.SIGTERM)
        self.wait(lambda: self.get("/readyz")[0] == 503)
        self.assertEqual(self.get("/livez")[0], 200)
        self.program.communicate(timeout=30)
        self.assertEqual(self.program.returncode, 0)

    def test_a_second_signal_ends_at_once(self):
        self.configure(drain={"delay_s": 600})
        self.start()
        self.program.send_signal(signal.SIGTERM)
        self.message("stopping")
        started = time.monotonic()
        self.assertEqual(self.finish(signal.SIGINT), 130)
        self.assertLess(time.monotonic() - started, 20)

    def test_a_second_signal_ends_a_job_that_holds_up_the_end(self):
        self.configure(drain={"timeout_s": 600})
        self.start()
        # As long as somebody else changes the store, a job cannot publish.
        with open(self.store / ".lock", "w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            floor = "".join(f"{x / 4} {y / 4} 0\n" for x in range(80) for y in range(80))
            cloud = ("ply\nformat ascii 1.0\nelement vertex 6400\nproperty float x\nproperty float y\n"
                     f"property float z\nend_header\n{floor}")
            connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=30)
            connection.request("PUT", "/v1/maps/town/versions/v1", cloud, {"Content-Type": "application/ply"})
            self.assertEqual(connection.getresponse().status, 202)
            connection.close()
            self.wait(lambda: json.loads(self.get("/v1/jobs/1")[1])["stage"] == "publish", timeout=60)
            self.program.send_signal(signal.SIGTERM)
            self.message("stopping")
            time.sleep(0.5)
            self.assertIsNone(self.program.poll())
            started = time.monotonic()
            self.assertEqual(self.finish(signal.SIGINT), 130)
            self.assertLess(time.monotonic() - started, 20)

    def test_what_never_ends_is_cut(self):
        self.configure(drain={"timeout_s": 1}, stall_timeout_s=60, transfer_timeout_s=60)
        self.start()
        with socket.create_connection(("127.0.0.1", self.port)) as slow:
            slow.sendall(b"POST /v1/maps/town/localize HTTP/1.1\r\nHost: localhost\r\nContent-Le")
            time.sleep(0.3)
            self.assertEqual(self.finish(), 0)

    def test_the_service_manager_hears_of_every_step(self):
        name = f"\0stillmap-serve-test-{os.getpid()}"
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
            manager.bind(name)
            manager.settimeout(20)

            def heard(text):
                while True:
                    datagram = manager.recv(4096).decode()
                    if datagram.startswith(text):
                        return datagram

            self.configure()
            self.start(NOTIFY_SOCKET="@" + name[1:], WATCHDOG_USEC="1000000")
            self.assertIn(f"STATUS=listening on http://127.0.0.1:{self.port}/", heard("READY=1"))
            heard("WATCHDOG=1")
            heard("WATCHDOG=1")
            self.program.send_signal(signal.SIGHUP)
            self.assertRegex(heard("RELOADING=1"), r"MONOTONIC_USEC=\d+")
            heard("READY=1")
            self.program.send_signal(signal.SIGSTOP)
            time.sleep(0.5)
            manager.setblocking(False)
            while True:
                try:
                    manager.recv(4096)
                except BlockingIOError:
                    break
            time.sleep(1.0)
            with self.assertRaises(BlockingIOError):
                manager.recv(4096)
            self.program.send_signal(signal.SIGCONT)
            manager.settimeout(20)
            self.program.send_signal(signal.SIGTERM)
            heard("STOPPING=1")
            self.program.communicate(timeout=30)
            self.assertEqual(self.program.returncode, 0)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
