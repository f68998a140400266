#!/usr/bin/env python3
"""Three servers with folders of their own, their state in PostgreSQL, their packages in S3 (OpenStack Swift). Each of
these is killed in turn while vehicles ask for poses and a map team changes things. Prints how long what was not
answered.

usage: servers_test.py STILLMAP MAP DRIVE [--seconds N]

MAP and DRIVE are those of sample_map.sh. Exit code 77: PostgreSQL or Swift is not installed.
"""

import argparse
import json
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile
import threading
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / "soak"))
import postgres_engine  # noqa: E402
import swift_engine  # noqa: E402
from serving import Server  # noqa: E402

POSE = "/v1/maps/town/localize?prior_t=0,0,0&prior_q=0,0,0,1"


class Fleet:
    def __init__(self, arguments, folder, swift, postgres):
        self.arguments, self.folder, self.swift, self.postgres = arguments, folder, swift, postgres
        self.environment = {"AWS_ACCESS_KEY_ID": swift_engine.ACCESS_KEY, "AWS_SECRET_ACCESS_KEY": swift_engine.SECRET_KEY}
        self.servers = [None, None, None]

    def store(self, i):
        return self.folder / f"store-{i}"

    def start(self, i):
        server = Server(self.arguments.stillmap, self.store(i), self.folder / f"log-{i}", environment=self.environment,
                        options=["--state", self.postgres.address, "--blobs", "s3://maps/fleet", "--s3-endpoint",
                                 self.swift.endpoint, "--workers", "1"])
        assert server.listen(), (self.folder / f"log-{i}").read_text()[-2000:]
        self.servers[i] = server

    def stillmap(self, *words):
        done = subprocess.run([self.arguments.stillmap, *map(str, words)], capture_output=True, text=True, check=False,
                              timeout=120, env=os.environ | self.environment)
        assert done.returncode == 0, done.stderr
        return done.stdout

    def ask_any(self, first, method, path, body=None, headers=None, seconds=30):
        """As a client does: the next server after a lost connection or 503. @return the answer and its server."""
        end = time.monotonic() + seconds
        for i in range(first, first + 1000000):
            server = self.servers[i % 3]
            try:
                answer = server.ask(method, path, body, headers, timeout=10)
                if answer.status != 503:
                    return answer
            except OSError:
                pass
            if time.monotonic() > end:
                raise AssertionError(f"{method} {path}: no answer within {seconds} s")
            if i % 3 == first % 3:
                time.sleep(0.02)

    def wait_ready(self, i, seconds=60):
        end = time.monotonic() + seconds
        while True:
            try:
                answer = self.servers[i].ask("GET", "/v1/maps/town")
                if answer.status == 200 and answer.json["state"] == "ready":
                    return
            except OSError:
                pass
            assert time.monotonic() < end, (self.folder / f"log-{i}").read_text()[-2000:]
            time.sleep(0.05)


class Vehicles(threading.Thread):
    """Asks for one pose after the other, each first of the next server."""

    def __init__(self, fleet, scan):
        super().__init__()
        self.fleet, self.scan, self.ended = fleet, scan, False
        self.answers, self.slowest_s, self.late, self.older, self.failures = 0, 0.0, 0, 0, []
        self.newest = ""

    def run(self):
        count = 0
        while not self.ended:
            count += 1
            begin = time.monotonic()
            try:
                answer = self.fleet.ask_any(count, "POST", POSE, self.scan, {"Content-Type": "application/octet-stream"})
                if answer.status != 200:
                    self.failures.append((answer.status, answer.body))
                    continue
            except AssertionError as error:
                self.failures.append((0, str(error)))
                continue
            took = time.monotonic() - begin
            self.answers += 1
            self.late += took > 1.0
            self.slowest_s = max(self.slowest_s, took)
            version = answer.json["map"]["version"]
            self.older += version < self.newest
            self.newest = max(self.newest, version)

    def take(self):
        """@return what happened since the last call."""
        figures = (self.answers, self.late, self.slowest_s)
        self.answers, self.late, self.slowest_s = 0, 0, 0.0
        return figures


class Team(threading.Thread):
    """Changes something again and again, and remembers what was acknowledged."""

    def __init__(self, fleet):
        super().__init__()
        self.fleet, self.ended, self.acknowledged = fleet, False, []

    def run(self):
        count = 0
        while not self.ended:
            count += 1
            try:
                answer = self.fleet.ask_any(count, "PUT", f"/v1/maps/m{count}", seconds=5)
            except AssertionError:
                continue
            if answer.status in (200, 201):
                self.acknowledged.append(f"m{count}")
            time.sleep(0.05)


def losses(fleet):
    """(name, kill, bring back)."""
    def kill(i):
        fleet.servers[i].kill()

    def restart(i):
        fleet.start(i)
        fleet.wait_ready(i)

    for i in range(3):
        yield f"server {i + 1}", lambda i=i: kill(i), lambda i=i: restart(i)
    yield "PostgreSQL", fleet.postgres.kill, fleet.postgres.start
    yield "S3", lambda: fleet.swift.kill("proxy"), lambda: fleet.swift.restart("proxy")

    def both():
        fleet.postgres.kill()
        fleet.swift.kill("proxy")

    def both_back():
        fleet.postgres.start()
        fleet.swift.restart("proxy")

    yield "PostgreSQL and S3", both, both_back


def test(fleet):
    arguments = fleet.arguments
    for i in range(3):
        fleet.store(i).mkdir()
    end = time.monotonic() + 60
    while True:  # until PostgreSQL answers
        try:
            fleet.stillmap("store", "attach", fleet.store(0), fleet.postgres.address)
            break
        except AssertionError:
            assert time.monotonic() < end
            time.sleep(0.2)
    fleet.start(0)
    for i in (1, 2):
        shutil.copy(fleet.store(0) / "seal.keys", fleet.store(i))
        fleet.start(i)
    fleet.stillmap("store", "add", fleet.store(0), "town", "v1", arguments.map, "--activate")
    for i in range(3):
        fleet.wait_ready(i)
    scan = (arguments.drive / "velodyne" / "000001.bin").read_bytes()
    poses = [fleet.servers[i].ask("POST", POSE, scan, {"Content-Type": "application/octet-stream"}).json for i in range(3)]
    assert poses[0]["pose"] is not None and all(pose["pose"] == poses[0]["pose"] for pose in poses), poses
    # Another version with the same content but for its notes, published by the second server.
    other = fleet.folder / "other"
    shutil.copytree(arguments.map, other)
    manifest = json.loads((other / "manifest.json").read_text())
    manifest["software_version"] = "0.0.1"
    (other / "manifest.json").write_text(json.dumps(manifest))

    vehicles, team = Vehicles(fleet, scan), Team(fleet)
    for thread in (vehicles, team):
        thread.start()
    print("lost | poses answered | later than 1 s | slowest [s] | changes acknowledged")
    versions = 1
    try:
        for name, kill, bring_back in losses(fleet):
            time.sleep(1.0)
            vehicles.take()
            before = len(team.acknowledged)
            kill()
            time.sleep(arguments.seconds)
            answers, late, slowest_s = vehicles.take()
            print(f"{name} | {answers} | {late} | {slowest_s:.2f} | {len(team.acknowledged) - before}", flush=True)
            assert answers > 0, name
            if name.startswith("server"):
                # A version is published and made active while it is away.
                versions += 1
                fleet.stillmap("store", "add", fleet.store(0), "town", f"v{versions}", other if versions % 2 == 0 else
                               arguments.map, "--activate")
            bring_back()
            end = time.monotonic() + 60
            since = len(team.acknowledged)
            while len(team.acknowledged) == since:
                assert time.monotonic() < end, f"no change is taken after {name} is back"
                time.sleep(0.05)
    finally:
        for thread in (vehicles, team):
            thread.ended = True
            thread.join()
    assert not vehicles.failures, vehicles.failures[:3]
    listed = {each["name"] for each in fleet.ask_any(0, "GET", "/v1/maps").json["maps"]}
    lost = [name for name in team.acknowledged if name not in listed]
    assert not lost, f"{len(lost)} of {len(team.acknowledged)} acknowledged changes are lost: {lost[:5]}"
    print(f"{len(team.acknowledged)} changes acknowledged, none lost; an older version than one seen: {vehicles.older}")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("stillmap", type=pathlib.Path)
    parser.add_argument("map", type=pathlib.Path)
    parser.add_argument("drive", type=pathlib.Path)
    parser.add_argument("--seconds", type=float, default=2.0, help="how long each is away")
    arguments = parser.parse_args()
    if postgres_engine.is_missing() or swift_engine.missing():
        print("skipped: PostgreSQL or Swift is not installed (`./dev fleet` installs them)")
        sys.exit(77)
    folder = pathlib.Path(tempfile.mkdtemp())
    folder.chmod(0o755)
    fleet = None
    try:
        postgres = postgres_engine.Postgres(folder / "postgres")
        with swift_engine.Swift(folder / "swift") as swift:
            status, body = swift.ask("PUT", "/maps")
            assert status == 200, body
            fleet = Fleet(arguments, folder, swift, postgres)
            try:
                test(fleet)
            finally:
                for server in fleet.servers:
                    if server is not None and server.process.poll() is None:
                        server.kill()
                postgres.kill()
    finally:
        shutil.rmtree(folder, ignore_errors=True)


if __name__ == "__main__":
    main()
