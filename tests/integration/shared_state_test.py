#!/usr/bin/env python3
"""Two servers on one state in PostgreSQL, which goes away and comes back.

usage: shared_state_test.py STILLMAP MAP DRIVE

MAP and DRIVE are those of sample_map.sh.
"""
import json
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile
import time
import unittest

PROGRAM, MAP, DRIVE = (pathlib.Path(word).resolve() for word in sys.argv[1:4])
for folder in ("soak", "fleet"):
    sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / folder))
import postgres_engine  # noqa: E402
from serving import Server  # noqa: E402


def run(*words):
    return subprocess.run([str(PROGRAM), *map(str, words)], check=True, capture_output=True, text=True).stdout


def ask(server, method, path, body=None, key=None):
    headers = {"Authorization": f"Bearer {key}"} if key else {}
    if isinstance(body, dict):
        body, headers["Content-Type"] = json.dumps(body), "application/json"
    elif body:
        headers["Content-Type"] = "application/octet-stream"
    return server.ask(method, path, body, headers, timeout=60)


def in_the_end(holds, what, seconds=30):
    deadline = time.time() + seconds
    while not holds():
        if time.time() > deadline:
            raise AssertionError(f"not within {seconds} s: {what}")
        time.sleep(0.05)


class SharedState(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        if postgres_engine.is_missing():
            print("no PostgreSQL: skipped")
            sys.exit(77)
        cls.folder = pathlib.Path(tempfile.mkdtemp())
        cls.folder.chmod(0o755)
        cls.postgres = postgres_engine.Postgres(cls.folder / "postgres")
        cls.store = cls.folder / "store"
        run("store", "add", cls.store, "town", "v1", MAP, "--activate")
        in_the_end(lambda: subprocess.run([str(PROGRAM), "store", "copy", str(cls.store), "--to", cls.postgres.address],
                                          check=False, capture_output=True).returncode == 0, "the state is moved", 60)
        cls.servers = [Server(PROGRAM, cls.store, cls.folder / "log", options=options)
                       for options in (["--state", cls.postgres.address], [])]
        for server in cls.servers:
            assert server.listen(), (cls.folder / "log").read_text()
        cls.scan = (DRIVE / "velodyne" / "000001.bin").read_bytes()

    @classmethod
    def tearDownClass(cls):
        for server in cls.servers:
            server.stop()
        cls.postgres.kill()
        shutil.rmtree(cls.folder)

    def localize(self, server, key=None):
        return ask(server, "POST", "/v1/maps/town/localize?prior_t=0,0,0&prior_q=0,0,0,1", self.scan, key)

    def test_1_what_one_changes_the_other_serves(self):
        first, second = self.servers
        for server in self.servers:
            in_the_end(lambda s=server: ask(s, "GET", "/readyz").status == 200, "ready")
        self.assertEqual(ask(first, "PUT", "/v1/maps/depot").status, 201)
        self.assertEqual(ask(second, "GET", "/v1/maps/depot").status, 200)
        self.assertIn("state.db.moved", os.listdir(self.store))

    def transactions_in(self, seconds):
        count = "SELECT xact_commit FROM pg_stat_database WHERE datname = current_database()"
        begun = int(self.postgres.sql(count))
        time.sleep(seconds)
        return int(self.postgres.sql(count)) - begun

    def test_21_idle_servers_ask_no_more_with_more_maps(self):
        of_one_map = self.transactions_in(6)
        for i in range(20):
            run("store", "add", self.store, f"copy{i}", "v1", MAP, "--activate")
        for server in self.servers:
            in_the_end(lambda s=server: ask(s, "GET", "/readyz").status == 200 and
                       ask(s, "GET", "/v1/status").json["maps"] == 21, "all maps are served", 60)
        time.sleep(12)  # PostgreSQL counts what a connection did up to 10 s later
        self.assertLess(self.transactions_in(6), 2 * of_one_map)

    def test_2_a_revoked_key_counts_everywhere(self):
        first, second = self.servers
        admin = json.loads(run("keys", "create", "admin", "--store", self.store, "--json",
                               *(word for scope in ("read", "localize", "write", "admin") for word in ("--scope", scope))))
        in_the_end(lambda: ask(second, "GET", "/v1/maps", key=admin["key"]).status == 200 and
                   ask(second, "GET", "/v1/maps").status == 401, "the other asks for the key", 5)
        car = ask(second, "POST", "/v1/keys", {"name": "car", "scopes": ["read"]}, admin["key"]).json
        in_the_end(lambda: ask(first, "GET", "/v1/maps", key=car["key"]).status == 200, "the key counts", 5)
        self.assertEqual(ask(second, "DELETE", f"/v1/keys/{car['id']}", key=admin["key"]).status, 200)
        in_the_end(lambda: ask(first, "GET", "/v1/maps", key=car["key"]).status == 401, "it is refused", 5)
        type(self).key = admin["key"]

    def test_3_poses_go_on_while_the_state_is_away(self):
        before = [self.localize(server, self.key) for server in self.servers]
        self.assertEqual([answer.status for answer in before], [200, 200], before[0].body)
        self.postgres.kill()
        for server, known in zip(self.servers, before):
            for _ in range(20):
                answer = self.localize(server, self.key)
                self.assertEqual(answer.status, 200, answer.body)
                self.assertEqual(answer.json["pose"], known.json["pose"])
            refused = ask(server, "PUT", "/v1/maps/other", key=self.key)
            self.assertEqual((refused.status, refused.json["code"]), (503, "StateAway"))
            self.assertEqual(refused.getheader("Retry-After"), "1")
            self.assertEqual(ask(server, "GET", "/livez").status, 200)
        self.postgres.start()
        for server in self.servers:
            in_the_end(lambda s=server: ask(s, "PUT", "/v1/maps/other", key=self.key).status in (200, 201),
                       "changes are taken again")
            self.assertEqual(self.localize(server, self.key).status, 200)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
