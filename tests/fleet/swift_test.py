#!/usr/bin/env python3
"""Blobs and packages in a real S3 engine, OpenStack Swift, that is killed meanwhile.

usage: swift_test.py UNIT_SERVER STILLMAP PACKAGE

PACKAGE is a map package. Exit code 77: Swift is not installed.
"""

import json
import os
import pathlib
import random
import re
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.request

import swift_engine

SKIPPED = 77
BUCKET = "s3://maps/"


def kill_in_turn(swift, is_over):
    """@return how often."""
    kills = 0
    while not is_over():
        time.sleep(0.8 + 0.23 * (kills % 5))
        server = ("proxy", "object", "proxy", "container")[kills % 4]
        swift.kill(server)
        swift.restart(server)
        kills += 1
    return kills


def test_client(swift, unit_server):
    def run(cases, **variables):
        environment = os.environ | {"STILLMAP_TEST_S3": swift.endpoint} | variables
        return subprocess.Popen([unit_server, f"--gtest_filter={cases}", "--gtest_brief=1"], env=environment)

    assert run("S3EngineTest.*").wait() == 0
    killed = run("S3EngineTest.KillsHarmNothing", STILLMAP_TEST_S3_ROUNDS="24")
    kills = kill_in_turn(swift, lambda: killed.poll() is not None)
    print(f"killed {kills} times while objects were put and got")
    assert killed.wait() == 0 and kills >= 5


class Fleet:
    """Stores with their packages in Swift."""

    def __init__(self, swift, program, package, folder):
        self.swift, self.program, self.package, self.folder = swift, program, package, folder
        self.environment = os.environ | {"AWS_ACCESS_KEY_ID": swift_engine.ACCESS_KEY,
                                         "AWS_SECRET_ACCESS_KEY": swift_engine.SECRET_KEY}
        self.said = ""

    def stillmap(self, *arguments, code=0, **variables):
        done = subprocess.run([self.program, *map(str, arguments)], capture_output=True, text=True, timeout=120,
                              env=self.environment | variables)
        self.said += done.stdout + done.stderr
        assert done.returncode == code, (arguments, done.returncode, done.stdout, done.stderr)
        return done.stdout + done.stderr

    def place(self, prefix):
        return ["--blobs", BUCKET + prefix, "--s3-endpoint", self.swift.endpoint]

    def serve(self, store, prefix, cache):
        return Served(self, ["--store", store, *self.place(prefix), "--cache", str(self.folder / cache)])

    def keys(self, prefix):
        status, body = self.swift.ask("GET", "/maps", f"list-type=2&prefix={prefix}%2F")
        assert status == 200, body
        return set(re.findall(r"<Key>([^<]*)</Key>", body.decode()))

    def expected_keys(self, prefix):
        manifest = self.package / "manifest.json"
        files = json.loads(manifest.read_text())["files"]
        listed = [file["sha256"] for file in (files.values() if isinstance(files, dict) else files)]
        return {f"{prefix}/blobs/{sha256}" for sha256 in [*listed, swift_engine.sha256_of(manifest.read_bytes())]}


class Served:
    """A server that runs."""

    def __init__(self, fleet, arguments):
        self.fleet = fleet
        self.process = subprocess.Popen([fleet.program, "serve", "--port", "0", *map(str, arguments)],
                                        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
                                        env=fleet.environment)
        line = self.process.stdout.readline()
        if "listening on" not in line:
            raise RuntimeError(self.process.communicate(timeout=30)[1])
        self.url = line.split()[-1]

    def is_ready(self):
        """Whether the map is served."""
        try:
            with urllib.request.urlopen(self.url + "v1/maps/town", timeout=10) as answer:
                return json.load(answer)["state"] == "ready"
        except urllib.error.HTTPError as error:
            error.close()
            return False

    def wait_ready(self, seconds=60):
        end = time.monotonic() + seconds
        while not self.is_ready():
            assert time.monotonic() < end, "the server did not become ready"
            time.sleep(0.1)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.terminate()
        self.fleet.said += "".join(self.process.communicate(timeout=60))
        assert self.process.returncode == 0, self.fleet.said[-3000:]


def test_packages(fleet):
    store = fleet.folder / "store"
    add = ["store", "add", store, "town", "1", fleet.package, "--activate"]
    with fleet.serve(store, "fleet", "cache") as first:
        fleet.stillmap(*add)
        first.wait_ready()
        assert fleet.keys("fleet") == fleet.expected_keys("fleet")
        # Another server, with nothing in its cache.
        with fleet.serve(store, "fleet", "other") as second:
            second.wait_ready()
    print("two servers answered from one bucket")

    fleet.swift.kill()
    with fleet.serve(store, "fleet", "other") as warm:
        warm.wait_ready()
    with fleet.serve(store, "fleet", "empty") as cold:
        time.sleep(1)
        assert not cold.is_ready()
        fleet.swift.restart()
        cold.wait_ready()
    print("without S3 the cached version was served, and the other one when S3 was back")

    assert "every package is as it was added" in fleet.stillmap("store", "verify", store)
    said = fleet.stillmap("store", "verify", store, code=1, AWS_SECRET_ACCESS_KEY="not-the-secret")
    assert "SignatureDoesNotMatch: check the access key" in said, said
    assert "not-the-secret" not in said
    lost = sorted(fleet.keys("fleet"))[0]
    assert fleet.swift.ask("DELETE", f"/maps/{lost}")[0] == 204
    assert "missing" in fleet.stillmap("store", "verify", store, code=1)
    fleet.stillmap(*add)
    fleet.stillmap("store", "verify", store)
    print("a lost object was found and put back")


def test_kills(fleet, rounds=12):
    """Publishing is killed, or S3 meanwhile: what was acknowledged is whole."""
    store, random_ = fleet.folder / "kills", random.Random(1)
    with fleet.serve(store, "kills", "kills-cache"):
        pass
    acknowledged = 0
    for number in range(rounds):
        version = str(number)
        adding = subprocess.Popen([fleet.program, "store", "add", store, "town", version, fleet.package],
                                  env=fleet.environment, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        time.sleep(random_.uniform(0.0, 0.4))
        if number % 2:
            adding.kill()
        else:
            fleet.swift.kill()
            time.sleep(random_.uniform(0.0, 1.0))
            fleet.swift.restart()
        said = adding.communicate(timeout=120)[1]
        assert adding.returncode == 0 or number % 2, said
        listed = json.loads(fleet.stillmap("store", "list", store, "--json"))
        versions = [each["name"] if "name" in each else each["version"]
                    for each_map in listed["maps"] for each in each_map["versions"]]
        assert adding.returncode != 0 or version in versions, (version, versions)
        acknowledged += adding.returncode == 0
        fleet.stillmap("store", "verify", store)
        if version in versions:
            fleet.stillmap("store", "remove", store, "town", version)
            assert not fleet.keys("kills"), fleet.keys("kills")
    print(f"{rounds} kills while versions were added, {acknowledged} acknowledged")


def test_move(fleet):
    store = fleet.folder / "moved"
    fleet.stillmap("store", "add", store, "town", "1", fleet.package, "--activate")
    said = fleet.stillmap("serve", "--store", store, *fleet.place("moved"), code=1)
    assert "to-s3" in said, said
    fleet.stillmap("store", "to-s3", store, *fleet.place("moved"))
    assert fleet.keys("moved") == fleet.expected_keys("moved")
    assert not (store / "packages").exists()
    fleet.stillmap("store", "verify", store)
    backup = fleet.folder / "backup"
    fleet.stillmap("store", "backup", store, "-o", backup)
    fleet.stillmap("store", "restore", backup, "-o", fleet.folder / "restored")
    fleet.stillmap("store", "verify", fleet.folder / "restored")
    said = fleet.stillmap("serve", "--store", store, *fleet.place("elsewhere"), code=1)
    assert "moved" in said, said
    print("a store was moved to S3, backed up and restored")


def main():
    if swift_engine.missing():
        print(f"skipped, not installed: {' '.join(swift_engine.missing())} (`./dev fleet` installs them)")
        sys.exit(SKIPPED)
    unit_server, program, package = sys.argv[1:4]
    with tempfile.TemporaryDirectory() as name, swift_engine.Swift(os.path.join(name, "swift")) as swift:
        status, body = swift.ask("PUT", "/maps")
        assert status == 200, body
        test_client(swift, unit_server)
        fleet = Fleet(swift, program, pathlib.Path(package), pathlib.Path(name))
        test_packages(fleet)
        test_kills(fleet)
        test_move(fleet)
        assert swift_engine.SECRET_KEY not in fleet.said and "not-the-secret" not in fleet.said


if __name__ == "__main__":
    main()
