#!/usr/bin/env python3
"""The proxy examples, run: checked by the proxies themselves, then TLS in front of real servers and of stand-ins.

usage: proxy_test.py STILLMAP STORE TOOLS haproxy|nginx        TOOLS: packages as `./dev test` unpacks them
"""

import concurrent.futures
import contextlib
import http.client
import http.server
import itertools
import json
import re
import shutil
import socket
import ssl
import subprocess
import sys
import threading
import time
import unittest

import support

PROGRAM, STORE, TOOLS, KIND = sys.argv[1:5]
PROXY = support.tool(KIND, TOOLS)
MOST_CONNECTIONS = 12
HEAD_TIME_S = 3
# The time-outs and caps of the examples, shortened; each must be found.
SHORTER = {
    "haproxy": {"timeout http-request 10s": f"timeout http-request {HEAD_TIME_S}s",
                "sc0_conn_cur gt 100": f"sc0_conn_cur gt {MOST_CONNECTIONS}",
                "inter 2s fall 2": "inter 500 fall 3"},
    "nginx": {"client_header_timeout 10s": f"client_header_timeout {HEAD_TIME_S}s",
              "limit_conn addresses 100": f"limit_conn addresses {MOST_CONNECTIONS}",
              "/etc/nginx/stillmap.crt": "FOLDER/stillmap.crt", "/etc/nginx/stillmap.key": "FOLDER/stillmap.key",
              "/run/nginx.pid": "FOLDER/nginx.pid"},
}

# What either server may be asked; every other route of /openapi.json must find the first one.
POSES = {("POST", f"/v1/maps/{{map}}/{what}") for what in (
    "localize", "localize/batch", "localize/next", "versions/{version}/localize", "versions/{version}/localize/batch",
    "versions/{version}/localize/next", "tiles/diff")} | {("POST", "/v1/localize"), ("POST", "/v1/localize/next")}
READS = {("GET", f"/v1/maps/{{map}}/{what}") for what in (
    "ready", "rollout", "stats", "vehicles", "versions", "versions/{version}", "versions/{version}/content", "versions/{version}/delta",
    "versions/{version}/files/{checksum}", "versions/{version}/preview", "versions/{version}/signatures",
    "versions/{version}/trajectory", "versions/{version}/graph", "versions/{version}/layers/{layer}",
    "versions/{version}/layers/{layer}/{band}", "versions/{version}/objects", "versions/{version}/tiles",
    "versions/{version}/tiles/{level}/{x}/{y}",
    "versions/{version}/3dtiles/tileset.json", "versions/{version}/3dtiles/{level}/{x}/{y}.glb",
    "versions/{version}/3dtiles/{level}/{x}/{y}.json", "versions/{version}/difference/{other}",
    "versions/{version}/difference/{other}/{side}/{x}/{y}.glb", "tiles/{level}/{x}/{y}")} | {
    ("GET", path) for path in ("/livez", "/healthz", "/readyz", "/openapi.json", "/v1/status", "/v1/maps", "/v1/maps/{map}", "/v1/sets",
                            "/v1/sets/{set}")}
SESSIONS = {("POST", "/v1/sessions"), ("GET", "/v1/sessions"), ("GET", "/v1/sessions/{session}"),
            ("DELETE", "/v1/sessions/{session}"), ("POST", "/v1/sessions/{session}/scans"),
            ("POST", "/v1/sessions/{session}/initialize"), ("GET", "/v1/sessions/{session}/events")}


def routes():
    paths = json.loads((support.DEPLOY.parent / "openapi.json").read_text())["paths"]
    return {(method.upper(), path) for path, methods in paths.items() for method in methods if method != "parameters"}


class StandIn(http.server.BaseHTTPRequestHandler):
    """A server that says what it is told to, and counts what it was asked; its management port is itself."""

    def do_GET(self):
        length = int(self.headers.get("Content-Length", 0))
        if length:
            self.rfile.read(1)
            self.server.began.set()
            time.sleep(self.server.pause_s)
            self.rfile.read(length - 1)
        if self.path != "/readyz":
            self.server.asked.append((self.command, self.path))
            time.sleep(self.server.silence_s)
            if self.server.dies:
                self.close_connection = True
                return
        status = 200 if self.path == "/readyz" else self.server.status
        self.send_response(status)
        self.send_header("Content-Length", "0")
        self.end_headers()

    do_HEAD = do_POST = do_PUT = do_DELETE = do_GET

    def log_message(self, *_):
        pass


@contextlib.contextmanager
def stand_in(status):
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), StandIn)
    server.status, server.asked, server.silence_s, server.pause_s, server.began = status, [], 0, 0, threading.Event()
    server.dies = False
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.05})
    thread.start()
    try:
        yield server
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


class Proxy(support.FolderTest):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.context = ssl.create_default_context()
        cls.context.check_hostname = False
        cls.context.verify_mode = ssl.CERT_NONE

    def proxy(self, *servers, also=None, options=()):
        """Starts the proxy before servers, each (port, management port). `also`: further changes of the example, `options`
        of what prints that of HAProxy."""
        certificate, key = self.folder / "stillmap.crt", self.folder / "stillmap.key"
        subprocess.run(["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes", "-days",
                        "1", "-subj", "/CN=localhost", "-keyout", key, "-out", certificate], check=True, capture_output=True)
        (self.folder / "both.pem").write_text(certificate.read_text() + key.read_text())
        self.port = support.free_port()
        changes = {**SHORTER[KIND], **(also or {})}
        if KIND == "haproxy":
            named = [f"{name}=127.0.0.1:{port}:{management}" for name, (port, management) in zip(("one", "two", "three"), servers)]
            text = support.haproxy_config(self.folder, self.port, named, *options)
        else:
            text = (support.DEPLOY / "proxy/nginx.conf").read_text()
            changes["listen 443"] = f"listen 127.0.0.1:{self.port}"
            for address, (port, _) in zip(("10.0.0.11", "10.0.0.12"), servers):
                changes[f"{address}:8080"] = f"127.0.0.1:{port}"
        for old, new in changes.items():
            self.assertTrue(old in text, f"the configuration has no '{old}'")
            text = text.replace(old, new.replace("FOLDER", str(self.folder)))
        config = self.folder / f"{KIND}.conf"
        config.write_text(text)
        self.run_proxy(config)

    def run_proxy(self, config):
        if KIND == "haproxy":
            check, serve = ["-c", "-f", config], ["-db", "-f", config]
        else:
            (self.folder / "logs").mkdir()
            # Its temporary files beside the test; its state is Debian's folders else.
            for name in ("client_body", "proxy", "fastcgi", "uwsgi", "scgi"):
                text = config.read_text().replace("http {\n", f"http {{\n  {name}_temp_path {self.folder}/{name};\n", 1)
                config.write_text(text)
            common = ["-p", self.folder, "-e", "stderr", "-c", config]
            check, serve = ["-t", *common], [*common, "-g", "daemon off;"]
        environment = support.tool_environment(TOOLS)
        done = subprocess.run([PROXY, *map(str, check)], capture_output=True, text=True, env=environment)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertNotIn("[WARNING]", done.stderr)
        self.assertNotIn("[warn]", done.stderr)
        self.log = (self.folder / "proxy.log").open("w")
        self.addCleanup(self.log.close)
        self.start([PROXY, *serve], env=environment, stdout=self.log, stderr=self.log)
        support.wait(lambda: self.reaches("/readyz"))

    def reaches(self, path):
        with contextlib.suppress(OSError):
            return self.ask("GET", path)[0] == 200

    def connection(self):
        return http.client.HTTPSConnection("127.0.0.1", self.port, timeout=20, context=self.context)

    def ask(self, method, path, body=None, **headers):
        connection = self.connection()
        try:
            connection.request(method, path, body, headers)
            answer = connection.getresponse()
            return answer.status, answer.read().decode(errors="replace"), answer
        finally:
            connection.close()

    def secure_socket(self):
        return self.context.wrap_socket(socket.create_connection(("127.0.0.1", self.port), timeout=20))


class BeforeStandIns(Proxy):
    def test_slow_answers_are_waited_for(self):
        slow = [("POST", "/v1/maps/a/drives/1/complete"), ("POST", "/v1/maps/a/uploads/1/complete"), ("POST", "/v1/maps/a/rollback"),
                ("POST", "/v1/maps/a/versions/b/activate"), ("PUT", "/v1/maps/a/versions/b"), ("PUT", "/v1/maps/a/uploads/1/parts/1"),
                ("PUT", "/v1/maps/a/drives/1/parts/1"), ("PUT", "/v1/maps/a/rollout")]
        if KIND == "haproxy":  # before stores whose packages are in S3
            slow.append(("GET", "/v1/maps/a/versions/b/tiles"))
        others = [("GET", "/v1/maps/a"), ("GET", "/v1/jobs"), ("POST", "/v1/maps/a/localize")]
        shorter = {"haproxy": {"timeout client 60s": "timeout client 2s", "timeout server 60s": "timeout server 2s"},
                   "nginx": {"proxy_read_timeout 60s": "proxy_read_timeout 2s", "proxy_send_timeout 60s": "proxy_send_timeout 2s"}}[KIND]
        with stand_in(200) as first, stand_in(200) as second:
            self.proxy((first.server_port, first.server_port), (second.server_port, second.server_port), also=shorter)
            first.silence_s = second.silence_s = 5
            with concurrent.futures.ThreadPoolExecutor(len(slow + others)) as asking:
                found = dict(zip(slow + others, asking.map(lambda each: self.ask(*each)[0], slow + others)))
            self.assertEqual(found, {**dict.fromkeys(slow, 200), **dict.fromkeys(others, 504)})
            # A server that takes nothing for as long: more than the buffers on the way hold.
            first.silence_s, first.pause_s = 0, 5
            self.assertEqual(self.ask("PUT", "/v1/maps/a/versions/b", bytes(32 << 20))[0], 200)

    def test_what_lives_in_one_store_finds_the_same_server(self):
        with stand_in(200) as first, stand_in(200) as second:
            self.proxy((first.server_port, first.server_port), (second.server_port, second.server_port))
            either = POSES | READS | SESSIONS
            self.assertEqual(either - routes(), set())
            for method, route in sorted(routes()):
                first.asked.clear(), second.asked.clear()
                # So many that the hashes of some fall to the second server.
                for number in range(16 if "{" in route else 2):
                    path = re.sub(r"\{\w+\}", f"a{number}", route)
                    self.assertEqual(self.ask(method, path)[0], 200, path)
                if (method, route) not in either:
                    self.assertEqual(second.asked, [], route)
                elif "{map}" in route:
                    self.assertTrue(first.asked and second.asked, f"{method} {route} is not balanced")
            for name, asked, other in (("one", first, second), ("two", second, first)):
                first.asked.clear(), second.asked.clear()
                for method, path in (("POST", "/v1/keys"), ("PUT", "/v1/maps/a/versions/b"), ("GET", "/v1/maps/a"), ("GET", "/")):
                    self.ask(method, path, Host=f"{name}.maps.example")
                self.assertEqual((len(asked.asked), other.asked), (4, []))

    def test_uploads_pass_as_they_come_and_nothing_else_is_large(self):
        uploads = ["/v1/maps/a/versions/b", "/v1/maps/a/drives/1/parts/1", "/v1/maps/a/uploads/1/parts/1"]
        with stand_in(200) as first, stand_in(200) as second:
            self.proxy((first.server_port, first.server_port), (second.server_port, second.server_port))
            for path in uploads:
                self.assertEqual(self.ask("PUT", path, bytes(65 << 20))[0], 200, path)
                first.began.clear()
                connection = self.connection()
                self.addCleanup(connection.close)
                connection.putrequest("PUT", path)
                connection.putheader("Content-Length", str(1 << 20))
                connection.endheaders(bytes(1 << 16))
                self.assertTrue(first.began.wait(10), f"{path} waits for its end")
                connection.send(bytes((1 << 20) - (1 << 16)))
                self.assertEqual(connection.getresponse().status, 200)
            for path in ("/v1/maps/a/localize", "/v1/maps/a/versions/b/localize", "/v1/maps/a/versions/b/activate", "/v1/keys"):
                self.assertEqual(self.ask("POST", path, **{"Content-Length": str(65 << 20)})[0], 413, path)

    def test_only_what_may_be_asked_twice_is(self):
        with stand_in(503) as first, stand_in(200) as second:
            self.proxy((first.server_port, first.server_port), (second.server_port, second.server_port))
            first.asked.clear(), second.asked.clear()
            # So many that each server keeps some, whatever the ports make of the hash.
            paths = [f"/v1/maps/town{number}" for number in range(24)]
            self.assertEqual({self.ask("GET", path)[0] for path in paths}, {200})
            refused = {path for _, path in first.asked}
            kept = set(paths) - refused
            self.assertTrue(refused, "no map is kept by the first server")
            self.assertTrue(kept, "no map is kept by the second server")
            first.asked.clear(), second.asked.clear()
            for path, status in ((min(refused), 503), (min(kept), 200)):
                self.assertEqual(self.ask("POST", path + "/tiles/diff", b"x")[0], status)
            self.assertEqual((len(first.asked), len(second.asked)), (1, 1))
            if KIND == "haproxy":
                self.assertEqual({self.ask("POST", path + "/localize", b"x")[0] for path in paths}, {200})
            first.asked.clear(), second.asked.clear()
            # Nothing that is of one store is asked of the other, however the first one fails.
            others = [("GET", "/v1/jobs/1"), ("PUT", "/v1/maps/a"), ("DELETE", "/v1/keys/a"), ("POST", "/v1/maps/a/rebuild")]
            self.assertEqual([self.ask(*each)[0] for each in others], [503] * len(others))
            self.assertEqual((first.asked, second.asked), (others, []))


@unittest.skipUnless(KIND == "haproxy", "of HAProxy")
class BeforeSharedState(Proxy):
    """Three stand-ins that share a state."""

    def setUp(self):
        super().setUp()
        with contextlib.ExitStack() as stack:
            self.servers = [stack.enter_context(stand_in(200)) for _ in range(3)]
            self.addCleanup(stack.pop_all().close)
        self.proxy(*((server.server_port, server.server_port) for server in self.servers), options=["--shared-state"])
        self.forget()

    def forget(self):
        for server in self.servers:
            server.asked.clear()

    def asked(self):
        """How many of the servers were asked."""
        return sum(bool(server.asked) for server in self.servers)

    def test_every_server_takes_what_is_no_upload(self):
        uploads = [each for each in routes() if re.search(r"/(drives|uploads|rebuild)\b", each[1])]
        self.assertGreater(len(uploads), 12)
        for method, route in sorted(routes()):
            self.forget()
            for number in range(16):
                path = re.sub(r"\{map\}", f"town{number}", route)
                self.assertEqual(self.ask(method, re.sub(r"\{\w+\}", f"a{number}", path))[0], 200)
            if "{map}" in route:
                self.assertEqual(self.asked(), 3, f"{method} {route} is not balanced")
        # All of one map's uploads, and what is made of them, find one server.
        self.forget()
        for method, route in uploads:
            self.ask(method, re.sub(r"\{map\}", "town", re.sub(r"\{(drive|upload|part)\}", "7", route)))
        self.assertEqual(self.asked(), 1)
        # And no other one, even if it refuses: another one has not got the files.
        for server in self.servers:
            server.status = 503 if server.asked else 200
        self.forget()
        self.assertEqual(self.ask("GET", "/v1/maps/town/drives")[0], 503)
        self.assertEqual((self.asked(), self.ask("GET", "/v1/maps/town")[0]), (1, 200))

    def test_poses_of_a_region_or_else_a_vehicle_find_one_server(self):
        def servers_of(requests):
            self.forget()
            for path, headers in requests:
                self.assertEqual(self.ask("POST", path, b"x", **headers)[0], 200)
            return self.asked()

        town = "/v1/maps/town/localize/next"
        self.assertEqual(servers_of([(f"{town}?vehicle=v{i}", {"Stillmap-Region": "3,-4"}) for i in range(12)]), 1)
        self.assertEqual(servers_of([(town, {"Stillmap-Region": f"{i},-4"}) for i in range(24)]), 3)
        # The first number alone, as the second: commas part no values here.
        self.assertEqual(servers_of([(town, {"Stillmap-Region": f"3,{i}"}) for i in range(24)]), 3)
        self.assertEqual(servers_of([(f"{town}?vehicle=v1&stamp_ns={i}", {}) for i in range(12)]), 1)
        self.assertEqual(servers_of([(f"{town}?vehicle=v{i}", {}) for i in range(24)]), 3)
        self.assertEqual(servers_of([(town, {"Stillmap-Seal": f"seal{i}"}) for i in range(12)]), 1)
        in_set = "/v1/localize/next?set=city"
        self.assertEqual(servers_of([(in_set, {"Stillmap-Region": f"{i},-4"}) for i in range(24)]), 3)
        both = [(in_set, {"Stillmap-Region": "3,-4"}), ("/v1/localize?set=city", {"Stillmap-Region": "3,-4"})]
        self.assertEqual(servers_of(both * 6), 1)
        self.assertEqual(servers_of([(f"/v1/localize?set=city{i}", {"Stillmap-Region": "3,-4"}) for i in range(24)]), 3)

    def test_a_change_is_sent_once_and_a_pose_again(self):
        self.servers[0].dies = True
        for number in range(12):
            self.forget()
            self.assertEqual(self.ask("POST", f"/v1/maps/town{number}/localize", bytes(200000))[0], 200)
            self.assertEqual(self.ask("GET", f"/v1/maps/town{number}")[0], 200)
        answers = []
        for number in range(12):
            for method, path in (("PUT", "versions/v1"), ("PUT", ""), ("POST", "versions/v1/activate"), ("DELETE", ""), ("POST", "drives"),
                                 ("POST", "rebuild")):
                self.forget()
                answers.append(self.ask(method, f"/v1/maps/town{number}/{path}".rstrip("/"), b"x")[0])
                self.assertEqual(sum(len(server.asked) for server in self.servers), 1, f"{method} {path}")
        self.assertEqual(set(answers), {200, 502})
        # A session's scan is no change of the store, but its tracker has seen it.
        for number in range(6):
            self.forget()
            self.ask("POST", f"/v1/sessions/s{number}/scans", b"x")
            self.assertEqual(sum(len(server.asked) for server in self.servers), 1)

    def test_dashboard_and_alerts_name_what_it_tells_prometheus(self):
        monitoring = support.DEPLOY / "monitoring"
        dashboard = (monitoring / "grafana/stillmap.json").read_text() + (monitoring / "stillmap.rules.yml").read_text()
        port = re.search(r"frontend metrics\n  bind 127.0.0.1:(\d+)", (self.folder / "haproxy.conf").read_text())[1]
        status, told = support.get(int(port), "/metrics")
        self.assertEqual((status, support.get(int(port), "/")[0]), (200, 403))
        names = set(re.findall(r"haproxy_\w+", dashboard))
        self.assertGreater(len(names), 5)
        for name in names:
            self.assertRegex(told, rf'(?m)^{name}{{proxy="poses"')

    def test_without_any_server_the_answer_says_when_to_ask_again(self):
        for server in self.servers:
            server.status = 503
        self.assertEqual(self.ask("POST", "/v1/maps/town/localize", b"x")[0], 503)
        for server in self.servers:
            server.shutdown()
            server.server_close()
        for method, path in (("POST", "/v1/maps/town/localize"), ("GET", "/v1/maps")):
            status, text, answer = self.ask(method, path)
            self.assertEqual((status, answer.getheader("Retry-After"), json.loads(text)["status"]), (503, "1", 503))
            self.assertEqual(answer.getheader("Content-Type"), "application/problem+json")


def points(count):
    """A PCD file: a job makes a version of it."""
    rows = "".join(f"{x % 20} {x // 20} {x % 3} 0\n" for x in range(count))
    return ("VERSION 0.7\nFIELDS x y z intensity\nSIZE 4 4 4 4\nTYPE F F F F\nCOUNT 1 1 1 1\n"
            f"WIDTH {count}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {count}\nDATA ascii\n{rows}").encode()


class TheExample(unittest.TestCase):
    @unittest.skipUnless(KIND == "haproxy", "of HAProxy")
    def test_it_is_what_its_first_lines_print(self):
        example = (support.DEPLOY / "proxy/haproxy.cfg").read_text()
        command = re.search(r"^#   (haproxy_config.py .*)$", example, re.MULTILINE)[1].split()
        self.assertEqual(support.print_haproxy_config(*command[1:]), example)

    @unittest.skipUnless(KIND == "haproxy", "of HAProxy")
    def test_arguments_that_cannot_be_used_are_refused_in_words(self):
        for arguments, words in ((["one=10.0.0.11"], "expected NAME=HOST:PORT[:MANAGEMENT_PORT]"), (["poses=a:1"], "choose another one"),
                                 (["a=h:1", "A=h:2"], "a name of its own"), (["a=h:1", "--shared-folder"], "--shared-state"),
                                 (["a=h:1", "--peer", "b"], "expected NAME=HOST:PORT")):
            done = subprocess.run([sys.executable, support.HAPROXY_CONFIG, *arguments], capture_output=True, text=True)
            self.assertEqual((done.returncode, words in done.stderr), (2, True), done.stderr)


class WithKeys(Proxy):
    """Two servers with the same keys and maps: the second store is restored of a backup of the first."""

    def setUp(self):
        super().setUp()
        shutil.copytree(STORE, self.folder / "store0")
        scopes = itertools.chain(*(("--scope", scope) for scope in ("read", "localize", "write", "admin")))
        self.key = self.stillmap("keys", "create", "all", "--store", self.folder / "store0", *scopes).strip()
        self.stillmap("store", "backup", self.folder / "store0", "-o", self.folder / "backup")
        self.stillmap("store", "restore", self.folder / "backup", "-o", self.folder / "store1")
        self.processes, servers = [], []
        for number in range(2):
            management = support.free_port()
            port, process = self.start_server(PROGRAM, self.folder / f"store{number}", "--management-port", management)
            support.wait(lambda: support.get(management, "/readyz")[0] == 200)
            self.processes.append(process), servers.append((port, management))
        self.proxy(*servers)

    def stillmap(self, *arguments):
        return subprocess.run([PROGRAM, *map(str, arguments)], check=True, capture_output=True, text=True).stdout

    def ask_json(self, method, path, body=None, **headers):
        data = json.dumps(body).encode() if isinstance(body, dict) else body
        headers = {"Authorization": f"Bearer {self.key}", "Content-Type": "application/json", **headers}
        status, text, answer = self.ask(method, path, data, **headers)
        return status, json.loads(text) if text else None, answer

    def test_keys_and_jobs_are_found_where_they_were_made(self):
        for number in range(4):
            status, key, _ = self.ask_json("POST", "/v1/keys", {"name": f"key{number}", "scopes": ["read"]})
            self.assertEqual(status, 201, key)
            self.assertIn(key["id"], [each["id"] for each in self.ask_json("GET", "/v1/keys")[1]["keys"]])
            self.assertEqual(self.ask_json("DELETE", f"/v1/keys/{key['id']}")[0], 200)
        for number in range(6):
            status, _, answer = self.ask_json("PUT", f"/v1/maps/town{number}/versions/v1", points(400),
                                              **{"Content-Type": "application/vnd.pcd"})
            self.assertEqual(status, 202)
            status, job, _ = self.ask_json("GET", answer.getheader("Location"))
            self.assertEqual((status, job["map"]), (200, f"town{number}"))
        self.assertEqual(self.ask_json("GET", "/v1/jobs", Host="two.localhost")[1]["jobs"], [])

    def test_a_key_opens_both_servers(self):
        self.assertEqual(self.ask("GET", "/v1/maps/town")[0], 401)
        for host in ("one.localhost", "two.localhost"):
            self.assertEqual(self.ask_json("GET", "/v1/maps/town", Host=host)[0], 200)
        self.processes[0].terminate()
        self.processes[0].wait(20)
        for _ in range(5):
            self.assertEqual(self.ask_json("GET", "/v1/maps/town")[0], 200)
        self.assertIn(self.ask("GET", "/v1/jobs")[0], (502, 503))


class BeforeServers(Proxy):
    def setUp(self):
        super().setUp()
        self.processes = {}
        self.servers = [self.server(number) for number in range(2)]
        self.proxy(*self.servers)

    def server(self, number):
        store = self.folder / f"store{number}"
        shutil.copytree(STORE, store)
        management = support.free_port()
        port, process = self.start_server(PROGRAM, store, "--management-port", management)
        self.processes[management] = process
        support.wait(lambda: support.get(port, "/readyz")[0] == 200)
        return port, management

    def asked(self, management, route):
        lines = support.get(management, "/metrics")[1].splitlines()
        return sum(float(line.split()[-1]) for line in lines
                   if line.startswith("stillmap_http_requests_total") and f'route="{route}"' in line)

    def test_requests_sessions_and_events_pass(self):
        for _ in range(6):
            self.assertEqual(self.ask("GET", "/v1/maps/town")[0], 200)
        self.assertEqual(sorted(self.asked(management, "/v1/maps/{map}") for _, management in self.servers), [0, 6])
        scan = bytes(64 * 1024 * 16)
        self.assertEqual(self.ask("POST", "/v1/maps/town/localize", scan, **{"Content-Type": "application/octet-stream"})[0], 422)
        self.assertEqual(self.ask("POST", "/v1/maps/town/localize", **{"Content-Length": str(65 << 20)})[0], 413)
        status, text, answer = self.ask("POST", "/v1/sessions", b'{"map": "town"}', **{"Content-Type": "application/json"})
        self.assertEqual(status, 201, text)
        session = answer.getheader("Location")
        for _ in range(6):
            self.assertEqual(self.ask("GET", session)[0], 200)
        self.events_come_at_once(session)

    def events_come_at_once(self, session):
        connection = self.connection()
        self.addCleanup(connection.close)
        connection.request("GET", session + "/events")
        stream = connection.getresponse()
        self.assertEqual(stream.getheader("Content-Type"), "text/event-stream")
        self.assertEqual(self.ask("DELETE", session)[0], 204)
        begun = time.monotonic()
        self.assertIn("closed", stream.readline().decode() + stream.readline().decode())
        self.assertLess(time.monotonic() - begun, 10)

    def test_slow_heads_are_cut_and_connections_are_capped(self):
        begun = time.monotonic()
        with self.secure_socket() as slow:
            slow.sendall(b"GET /readyz HTTP/1.1\r\nHost: x\r\n")
            end = begun + 30
            with contextlib.suppress(OSError):
                while time.monotonic() < end:
                    slow.sendall(b"X")
                    slow.settimeout(0.2)
                    with contextlib.suppress(TimeoutError):
                        if not slow.recv(4096):
                            break
            took = time.monotonic() - begun
            self.assertGreater(took, HEAD_TIME_S - 0.5)
            self.assertLess(took, 20)
        self.cap()

    def cap(self):
        """Streams of events hold connections; past the cap a further client of the same address is refused."""
        with contextlib.ExitStack() as held:
            location = self.ask("POST", "/v1/sessions", b'{"map": "town"}',
                                **{"Content-Type": "application/json"})[2].getheader("Location")
            for _ in range(MOST_CONNECTIONS):
                stream = held.enter_context(contextlib.closing(self.connection()))
                stream.request("GET", location + "/events")
                self.assertEqual(stream.getresponse().status, 200)
            try:
                self.assertEqual(self.ask("GET", "/livez")[0], 429)
            except OSError:
                pass  # HAProxy ends the connection before TLS
        support.wait(lambda: self.reaches("/livez"))

    @unittest.skipIf(KIND == "nginx", "nginx cannot ask /readyz")
    def test_a_server_that_ends_is_left(self):
        route = "/v1/maps/{map}"
        self.ask("GET", "/v1/maps/town")
        asked, other = sorted((management for _, management in self.servers), key=lambda port: -self.asked(port, route))
        self.processes[asked].terminate()
        for _ in range(20):
            self.assertEqual(self.ask("GET", "/v1/maps/town")[0], 200)
            time.sleep(0.05)
        self.assertGreater(self.asked(other, route), 0)


if __name__ == "__main__":
    support.tool("openssl")
    unittest.main(argv=sys.argv[:1])
