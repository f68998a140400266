#!/usr/bin/env python3
"""The Python client against a server that fails on purpose, and its parts by themselves.

usage: python_client_faults_test.py PACKAGE
"""

import array
import contextlib
import errno
import http.client
import http.server
import importlib.util
import io
import json
import pathlib
import socket
import sys
import tarfile
import tempfile
import threading
import time
import unittest
import unittest.mock

PACKAGE = pathlib.Path(sys.argv[1]).resolve()
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "server/clients/python/src"))

from stillmap_client import (Client, ConnectionLost, NeedsChoice, Problem, Query, SessionStream,  # noqa: E402
                             StillmapError)
from stillmap_client.archive import Archive  # noqa: E402
from stillmap_client.scan import encoded  # noqa: E402


class Faults(unittest.TestCase):
    """A server of the test's own that fails as it is told."""

    def serve(self, *answers, idle_s=None):
        """@param idle_s  after which it ends a connection."""
        seen, script = [], list(answers)

        class Handler(http.server.BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"
            timeout = idle_s

            def log_message(self, *_):
                pass

            def handle_any(self):
                self.rfile.read(int(self.headers.get("Content-Length", 0)))
                seen.append((self.command, self.path, dict(self.headers), time.monotonic()))
                answer = script.pop(0)
                if answer is None:
                    self.close_connection = True
                    return
                status, headers, body = answer
                time.sleep(float(headers.get("X-Sleep", 0)))
                self.send_response(status)
                for key, value in headers.items():
                    self.send_header(key, value)
                if "Content-Length" not in headers:
                    self.send_header("Content-Length", str(len(body)))
                self.end_headers()
                self.wfile.write(body)
                if headers.get("Connection") == "close":
                    self.close_connection = True

            do_GET = do_POST = do_PUT = do_DELETE = handle_any

        server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        server.daemon_threads = True
        threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True).start()
        self.addCleanup(server.server_close)
        self.addCleanup(server.shutdown)
        return f"http://127.0.0.1:{server.server_port}", seen

    BUSY = (503, {"Retry-After": "1"}, b'{"code": "Busy", "detail": "later"}')
    MAPS = (200, {}, b'{"maps": [], "refused": []}')

    def test_busy_is_tried_again_after_what_the_server_says(self):
        url, seen = self.serve(self.BUSY, self.MAPS)
        self.assertEqual(Client(url).maps(), [])
        self.assertGreaterEqual(seen[1][3] - seen[0][3], 0.99)

    def test_retries_end(self):
        url, seen = self.serve(self.BUSY, self.BUSY)
        with self.assertRaises(Problem) as raised:
            Client(url, retries=1).maps()
        self.assertEqual((raised.exception.code, raised.exception.retry_after_s, len(seen)), ("Busy", 1.0, 2))

    def test_a_superseded_scan_is_not_sent_again(self):
        url, seen = self.serve((429, {}, b'{"code": "Superseded"}'), self.MAPS)
        with self.assertRaises(Problem):
            Client(url).maps()
        self.assertEqual(len(seen), 1)

    def test_a_lost_connection_is_met_by_another_only_when_that_does_no_harm(self):
        url, seen = self.serve(None, self.MAPS)
        self.assertEqual(Client(url).maps(), [])
        url, seen = self.serve(None, (202, {}, b"{}"))
        with self.assertRaises(ConnectionLost):
            Client(url).roll_back("town")
        self.assertEqual(len(seen), 1)

    def test_events_go_on_after_the_last_that_came(self):
        first = b"id: 7\nevent: status\ndata: {\"a\": 1}\n\n:\n\nevent: end\ndata: {\"reason\": \"stopping\"}\n\n"
        second = b"event: gap\ndata: {\"missed\": 2}\n\nid: 10\nevent: closed\ndata: {}\n\n"
        session = b'{"id": "s", "map": {"name": "a", "version": "b", "digest": "c"}, "idle_limit_s": 1}'
        kind = {"Content-Type": "text/event-stream", "Connection": "close"}
        url, seen = self.serve((201, {}, session), (200, kind, first), (200, kind, second))
        events = list(Client(url).open_session("a").events())
        self.assertEqual([(e.id, e.type) for e in events], [(7, "status"), (None, "gap"), (10, "closed")])
        self.assertNotIn("Last-Event-ID", seen[1][2])
        self.assertEqual(seen[2][2]["Last-Event-ID"], "7")

    SESSION = (201, {}, b'{"id": "s", "map": {"name": "a", "version": "b", "digest": "c"}, "idle_limit_s": 1}')
    POSE = (200, {}, json.dumps({
        "status": "lost", "reasons": [], "pose": None, "covariance": None, "inlier_ratio": 0.0, "rmse_m": 0.0,
        "covariance_order": [], "movable_points": 0, "no_returns": 0, "degenerate_directions": [], "prior_to_pose": None,
        "iterations": 0, "stamp_ns": "1", "warnings": [], "request_id": "r",
        "map": {"name": "a", "version": "b", "digest": "c"}, "timing_ms": {},
        "protection": dict.fromkeys(("longitudinal_m", "lateral_m", "vertical_m", "yaw_rad"))}).encode())
    PAGE = b"<html>moved</html>"
    #: What no server of ours would say, and whether the same scan is sent again.
    WRONG = [((301, {"Location": "https://x/", "Content-Type": "text/html"}, PAGE), False),
             ((200, {"Content-Type": "text/html"}, PAGE), False),
             ((200, {}, b"{}"), False), ((200, {}, b"[]"), False),
             ((200, {"Content-Length": "100", "Connection": "close"}, b'{"status": '), True),
             ((500, {"Content-Length": "100", "Connection": "close"}, b'{"code": '), True),
             ((503, {"Retry-After": "\u00b2"}, b"[1]"), True), (None, True)]

    def test_a_stream_outlives_whatever_an_answer_is(self):
        for wrong, again in self.WRONG:
            with self.subTest(answer=wrong):
                url, seen = self.serve(self.SESSION, wrong, self.POSE, self.POSE, (204, {}, b""))
                answers, errors = [], []
                with SessionStream(Client(url), "a", on_answer=lambda stamp, _: answers.append(stamp),
                                   on_error=lambda stamp, error: errors.append((stamp, error))) as stream:
                    for stamp in (1, 2):
                        stream.put(bytes(32), stamp)
                        self.assertTrue(stream.drain(10), "the sending thread has ended")
                self.assertEqual([stamp for stamp, _ in errors], [1])
                self.assertIsInstance(errors[0][1], StillmapError)
                self.assertEqual(answers, [1, 2] if again else [2])

    @unittest.skipUnless(importlib.util.find_spec("numpy"), "numpy is not installed: scans are sent whole")
    def test_a_server_that_refuses_thin_scans_gets_whole_ones(self):
        scan = array.array("f", [10.0, 2.0, 3.0, 0.5] * 600)
        thin, whole = "application/vnd.stillmap.scan", "application/octet-stream"
        for status, code in ((400, b"InvalidScan"), (415, b"UnsupportedMediaType")):
            refusal = (status, {}, b'{"code": "%s"}' % code)
            url, seen = self.serve(refusal, self.POSE, self.POSE, self.SESSION, self.POSE)
            client = Client(url)
            self.assertEqual([client.localize("a", scan).status for _ in range(2)], ["lost", "lost"])
            client.open_session("a").track(scan, 1)
            self.assertEqual([each[2].get("Content-Type") for each in seen],
                             [thin, whole, whole, "application/json", whole])
        # The scan itself is at fault: the next one is thinned again.
        url, seen = self.serve(refusal, refusal, self.POSE)
        client = Client(url)
        with self.assertRaises(Problem):
            client.localize("a", scan)
        client.localize("a", scan)
        self.assertEqual([each[2]["Content-Type"] for each in seen], [thin, whole, thin])
        batch = {"answers": [{"status": 400, "problem": {"code": "InvalidScan"}}]}
        taken = {"answers": [{"status": 200, "answer": json.loads(self.POSE[2])}]}
        url, seen = self.serve((200, {}, json.dumps(batch).encode()), (200, {}, json.dumps(taken).encode()), self.POSE)
        client = Client(url)
        self.assertEqual(client.localize_batch("a", [Query(scan)])[0].status, "lost")
        client.localize("a", scan)
        self.assertEqual(seen[-1][2]["Content-Type"], whole)

    def test_a_stream_does_not_wait_for_errors_that_it_did_not_wait_after(self):
        bad = [(502, {}, b"<html>")] * 10
        url, _ = self.serve(self.SESSION, *bad, None, self.POSE, (204, {}, b""))
        answers = []
        with SessionStream(Client(url), "a", on_answer=lambda stamp, _: answers.append(stamp)) as stream:
            for stamp in range(11):
                stream.put(bytes(32), stamp)
                self.assertTrue(stream.drain(10))
        self.assertEqual((answers, stream.failed), ([10], 11))

    def test_a_stream_whose_session_cannot_be_opened_tells_why(self):
        url, _ = self.serve((301, {"Location": "https://x/"}, self.PAGE), self.SESSION, self.POSE, (204, {}, b""))
        answers, errors = [], []
        with SessionStream(Client(url), "a", on_answer=lambda stamp, _: answers.append(stamp),
                           on_error=lambda _, error: errors.append(error)) as stream:
            for stamp in (1, 2):
                stream.put(bytes(32), stamp)
                self.assertTrue(stream.drain(10))
        self.assertEqual((answers, errors[0].status), ([2], 301))
        self.assertIn("https://x/", str(errors[0]))

    def test_what_is_no_scan_is_refused_before_it_is_sent(self):
        url, _ = self.serve(self.SESSION, self.POSE, (204, {}, b""))
        answers = []
        with SessionStream(Client(url), "a", on_answer=lambda stamp, _: answers.append(stamp)) as stream:
            for wrong in (b"123", [(1, 2)], array.array("d", [1, 2, 3, 4])):
                with self.assertRaises(ValueError):
                    stream.put(wrong, 1)
            changed = bytearray(32)
            stream.put(changed, 2)
            self.assertTrue(stream.drain(10))
        self.assertEqual(answers, [2])

    def test_callbacks_that_raise_change_nothing(self):
        def fail(*_):
            raise RuntimeError("of the caller's")

        url, seen = self.serve(self.SESSION, self.POSE, (404, {}, b'{"code": "UnknownMap"}'), self.POSE, (204, {}, b""))
        with self.assertLogs("stillmap_client", "ERROR") as logged, \
                SessionStream(Client(url), "a", on_answer=fail, on_error=fail) as stream:
            for stamp in range(3):
                stream.put(bytes(32), stamp)
                self.assertTrue(stream.drain(10))
        self.assertEqual((stream.answered, stream.failed, len(logged.records)), (2, 1, 3))

    @staticmethod
    def map_at(version, revision):
        return 200, {}, json.dumps({"name": "town", "version": version, "previous_version": None,
                                    "revision": revision}).encode()

    CHANGED = (412, {}, b'{"code": "RevisionChanged"}')
    CUT_POST = (200, {"Content-Length": "100", "Connection": "close"}, b"{")

    def test_an_activation_whose_answer_is_lost_is_looked_for(self):
        new, before, others = self.map_at("v2", 4), self.map_at("v1", 3), self.map_at("v3", 4)
        gone = (502, {}, b"<html>")
        for script, asked, wanted in (
                ((self.CUT_POST, new), "POST GET", "v2"), ((gone, new), "POST GET", "v2"),
                ((None, before, new), "POST GET POST", "v2"),
                # Done between the look and the second try, by the first.
                ((None, before, self.CHANGED, new), "POST GET POST GET", "v2"),
                ((None, others), "POST GET POST", None), ((self.CHANGED,), "POST", None)):
            with self.subTest(script=script):
                url, seen = self.serve(*script, self.CHANGED, others)
                if wanted is None:
                    with self.assertRaises(Problem) as raised:
                        Client(url).activate("town", "v2", if_revision=3)
                    self.assertEqual(raised.exception.code, "RevisionChanged")
                else:
                    self.assertEqual(Client(url).activate("town", "v2", if_revision=3).version, wanted)
                self.assertEqual(" ".join(each[0] for each in seen[:asked.count(" ") + 1]), asked)

    def test_a_roll_back_is_asked_once(self):
        url, seen = self.serve(None, self.CHANGED)
        with self.assertRaises(ConnectionLost):
            Client(url).roll_back("town", if_revision=3)
        self.assertEqual(len(seen), 1)

    def test_a_drive_whose_completion_is_lost_is_looked_for(self):
        with tempfile.TemporaryDirectory() as name:
            (pathlib.Path(name) / "a").write_bytes(b"y")

            def upload(*answers):
                url, seen = self.serve((200, {}, b'{"parts": []}'), (201, {}, b"{}"), *answers)
                return Client(url, timeout_s=0.5, slow_timeout_s=2.0), seen

            is_open, is_complete = (200, {}, b'{"status": "open"}'), (200, {}, b'{"status": "complete"}')
            for answers, asked in (((None, is_complete), ["POST", "GET"]),
                                   ((None, is_open, (200, {}, b"{}")), ["POST", "GET", "POST"])):
                client, seen = upload(*answers)
                self.assertEqual(client.upload_drive("town", name, drive=7), 7)
                self.assertEqual([each[0] for each in seen[2:]], asked)
            # Slower than the usual time-out.
            client, seen = upload((200, {"X-Sleep": "1"}, b"{}"))
            self.assertEqual(client.upload_drive("town", name, drive=7), 7)
            self.assertEqual(len(seen), 3)
            # Slower than any: told, and nobody else waits in the server.
            client, seen = upload((200, {"X-Sleep": "4"}, b"{}"), is_open)
            with self.assertRaises(ConnectionLost):
                client.upload_drive("town", name, drive=7)
            self.assertEqual([each[0] for each in seen[2:]], ["POST", "GET"])

    def test_a_recording_that_needs_a_choice_is_said_with_its_choices(self):
        with tempfile.TemporaryDirectory() as name:
            (pathlib.Path(name) / "a").write_bytes(b"y")
            asks = json.dumps({"status": "needs_choice", "error": "clouds on /a, /b",
                               "inspection": {"choices": [{"choice": "cloud=/a"}, {"choice": "cloud=/b"}]}}).encode()
            url, seen = self.serve((200, {}, b'{"parts": []}'), (201, {}, b"{}"), (202, {}, asks))
            with self.assertRaisesRegex(NeedsChoice, "clouds on /a, /b") as caught:
                Client(url).upload_drive("town", name, drive=7)
            self.assertEqual((caught.exception.drive, caught.exception.choices), (7, ["cloud=/a", "cloud=/b"]))

    def test_a_choice_that_is_still_applied_is_not_said_to_be_missing(self):
        with tempfile.TemporaryDirectory() as name:
            (pathlib.Path(name) / "a").write_bytes(b"y")
            asks = json.dumps({"status": "needs_choice", "error": "clouds on /a, /b",
                               "inspection": {"choices": [{"choice": "cloud=/a"}]}}).encode()
            url, seen = self.serve((200, {}, b'{"parts": []}'), (201, {}, b"{}"), (504, {}, b"<html>"), (200, {}, asks))
            with self.assertRaises(Problem) as raised:
                Client(url).upload_drive("town", name, drive=7, choice="cloud=/a")
            self.assertEqual((raised.exception.status, [each[0] for each in seen]), (504, ["GET", "PUT", "POST", "GET"]))

    def test_a_version_is_not_sent_again_after_long_silence(self):
        with tempfile.TemporaryDirectory() as name:
            (pathlib.Path(name) / "a").write_bytes(b"y")
            url, seen = self.serve((200, {"X-Sleep": "2"}, b"{}"), (200, {}, b"{}"))
            with self.assertRaises(ConnectionLost):
                Client(url, slow_timeout_s=0.5).upload_version("a", "b", name)
            self.assertEqual(len(seen), 1)

    @staticmethod
    def fails_once(owner, name, error):
        """`name` of `owner` raises `error`, and does afterwards what it did before. An answer is waited for in vain."""
        real, errors = getattr(owner, name), [error]

        def first_fails(*arguments, **named):
            if errors and name == "getresponse":
                real(*arguments, **named).close()
            if errors:
                raise errors.pop()
            return real(*arguments, **named)

        return unittest.mock.patch.object(owner, name, first_fails)

    def test_a_server_that_is_gone_is_not_silent(self):
        made = (201, {}, b'{"version": "b", "digest": "d", "bytes": 1, "created_ns": "1"}')
        old, new = self.map_at("v1", 3), self.map_at("v2", 4)
        for owner, name, error in ((socket, "create_connection", socket.timeout("timed out")),
                                   (http.client.HTTPConnection, "getresponse", OSError(errno.ETIMEDOUT, "gone"))):
            with self.subTest(at=name), tempfile.TemporaryDirectory() as folder:
                (pathlib.Path(folder) / "a").write_bytes(b"y")
                sent = [] if name == "create_connection" else [made]  # of the answer that nobody reads
                url, _ = self.serve(*sent, made)
                with self.fails_once(owner, name, error):
                    self.assertEqual(Client(url).upload_version("a", "b", folder).name, "b")
                url, seen = self.serve(*(new for _ in sent), *(old for _ in sent), new)
                with self.fails_once(owner, name, error):
                    self.assertEqual(Client(url).activate("town", "v2").version, "v2")
                self.assertEqual([each[0] for each in seen], ["POST", "GET", "POST"] if sent else ["POST"])

    def test_what_was_never_sent_is_tried_again(self):
        url, seen = self.serve(self.map_at("v1", 4))
        with self.fails_once(socket, "create_connection", socket.timeout("timed out")):
            self.assertEqual(Client(url).roll_back("town").version, "v1")
        self.assertEqual(len(seen), 1)

    def test_who_takes_nothing_of_a_version_is_left_after_the_usual_time(self):
        with tempfile.TemporaryDirectory() as name, socket.create_server(("127.0.0.1", 0)) as server:
            with (pathlib.Path(name) / "a").open("wb") as file:
                file.truncate(32 << 20)
            began = time.monotonic()
            with self.assertRaises(ConnectionLost):
                Client(f"http://127.0.0.1:{server.getsockname()[1]}", timeout_s=0.5, slow_timeout_s=20.0,
                       retries=1).upload_version("a", "b", name)
            self.assertLess(time.monotonic() - began, 15)
            server.settimeout(1)
            for _ in range(2):
                server.accept()[0].close()

    def test_a_connection_that_idled_is_not_used_after_a_slow_call(self):
        new = self.map_at("v2", 1)
        url, seen = self.serve(self.MAPS, (new[0], {"X-Sleep": "1.5"}, new[2]), self.SESSION, idle_s=1.0)
        client = Client(url)
        client.maps()
        client.activate("town", "v2")
        # Not sent again: on the connection that the server has ended meanwhile it would be lost.
        self.assertEqual(client.open_session("town").id, "s")

    def test_a_deadline_is_waited_for(self):
        url, seen = self.serve((200, {"X-Sleep": "1"}, self.POSE[2]))
        Client(url, timeout_s=0.5).localize("a", bytes(32), deadline_ms=2000)
        self.assertEqual(len(seen), 1)

    def test_calls_raise_what_they_promise(self):
        cut = {"Content-Length": "100", "Connection": "close"}
        url, seen = self.serve((200, cut, b"{"), self.MAPS)
        self.assertEqual(Client(url).maps(), [])
        url, seen = self.serve((202, cut, b"{"))
        with self.assertRaises(ConnectionLost):
            Client(url).roll_back("town")
        for status in (200, 301, 304):
            url, seen = self.serve((status, {"Content-Type": "text/html"}, b"" if status == 304 else self.PAGE))
            with self.assertRaises(Problem) as raised:
                Client(url).maps()
            self.assertEqual(raised.exception.status, status)

    def test_json_of_another_shape_is_a_problem(self):
        asked = {
            "maps": lambda client: client.maps(), "map": lambda client: client.map("a"),
            "create_map": lambda client: client.create_map("a"), "versions": lambda client: client.versions("a"),
            "activate": lambda client: client.activate("a", "b"), "roll_back": lambda client: client.roll_back("a"),
            "localize": lambda client: client.localize("a", bytes(32)), "open_session": lambda client: client.open_session("a"),
            "drives": lambda client: client.drives("a"),
            "upload_version": lambda client: client.upload_version("a", "b", PACKAGE),
            "upload_drive": lambda client: client.upload_drive("a", PACKAGE), "job": lambda client: client.job(1),
            "wait_for_job": lambda client: client.wait_for_job(1)}
        for name, ask in asked.items():
            for body in (b"{}", b"[]", b"null", b'{"maps": [1], "versions": {"a": 1}, "id": null, "drives": 1, "name": 1}'):
                with self.subTest(asked=name, body=body):
                    url, seen = self.serve((200, {}, body), (200, {}, body))
                    with self.assertRaises(Problem) as raised:
                        ask(Client(url))
                    self.assertEqual(raised.exception.status, 200)
                    self.assertIn("another answer than expected", str(raised.exception))
                    self.assertEqual(len(seen), 1)
        for name in ("status", "stats", "cancel_job"):
            url, _ = self.serve((200, {}, b"[]"))
            with self.subTest(asked=name), self.assertRaises(Problem):
                getattr(Client(url), name)(*([] if name == "status" else ["1"]))

    def test_a_download_that_breaks_goes_on(self):
        data = bytes(range(256)) * 1000
        whole = {"ETag": '"e"', "Content-Length": str(len(data)), "Connection": "close"}
        rest = {"ETag": '"e"', "Content-Length": str(len(data) - 100_000)}
        url, seen = self.serve((200, whole, data[:100_000]), (206, rest, data[100_000:]))
        with tempfile.TemporaryDirectory() as folder:
            target = pathlib.Path(folder) / "map.tar"
            Client(url).download_version("a", "b", target)
            self.assertEqual(target.read_bytes(), data)
        self.assertEqual(seen[1][2]["Range"], "bytes=100000-")


class Parts(unittest.TestCase):
    def test_a_folder_is_a_tar_that_is_read_from_any_place(self):
        with tempfile.TemporaryDirectory() as name:
            folder = pathlib.Path(name)
            (folder / "sub").mkdir()
            (folder / "sub" / ("long" * 40)).write_bytes(b"x" * 700)
            (folder / "empty").write_bytes(b"")
            (folder / "a").write_bytes(b"y" * 512)
            archive = Archive(folder)
            data = archive.read(0, archive.size)
            self.assertEqual(len(data), archive.size)
            with tarfile.open(fileobj=io.BytesIO(data)) as tar:
                self.assertEqual({m.name: m.size for m in tar}, {"sub/" + "long" * 40: 700, "empty": 0, "a": 512})
            for offset in (0, 1, 511, 512, 1000, archive.size - 3, archive.size, archive.size + 9):
                self.assertEqual(archive.read(offset, 1500), data[offset:offset + 1500])
            with archive.open(700, 900) as part:
                self.assertEqual(part.read(), data[700:1600])

    def test_scans_of_every_kind_are_the_same_bytes(self):
        floats = array.array("f", [1, 2, 3, 4, 5, 6])
        self.assertEqual(encoded(floats, "xyz"), (floats.tobytes(), "xyz"))
        self.assertEqual(encoded([[1, 2, 3, 0.5, -0.05]]), (array.array("f", [1, 2, 3, 0.5, -0.05]).tobytes(), "xyzit"))
        self.assertEqual(encoded([(1, 2, 3), (4, 5, 6)]), (floats.tobytes(), "xyz"))
        self.assertEqual(encoded(memoryview(floats.tobytes()), "xyz"), (floats.tobytes(), "xyz"))
        with contextlib.suppress(ImportError):
            import numpy
            self.assertEqual(encoded(numpy.array([[1, 2, 3], [4, 5, 6]], numpy.float32)), (floats.tobytes(), "xyz"))
        for wrong in (b"123", array.array("d", [1, 2, 3, 4]), [(1, 2)], [(1, 2, 3), (1, 2, 3, 4)], []):
            with self.assertRaises(ValueError):
                encoded(wrong)

    def test_addresses_that_are_none_are_refused(self):
        for url in ("127.0.0.1:8080", "ftp://a", "http://"):
            with self.assertRaises(ValueError):
                Client(url)


if __name__ == "__main__":
    unittest.main(argv=[sys.argv[0], *sys.argv[2:]])
