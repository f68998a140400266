#!/usr/bin/env python3
"""Kills `stillmap store migrate` at drawn system calls and looks at the store afterwards: every package is as it was or migrated,
all else as it was. The same command then goes on to the end.

usage: migration_kills.py --program STILLMAP --packages TINY_PACKAGES --injector NTH_CALL.SO [--kills 60] [--seed 1]
"""

import argparse
import hashlib
import json
import os
import pathlib
import random
import shutil
import signal
import sqlite3
import subprocess
import sys
import tempfile

from faults import Injector, KILLED
from serving import LOCALIZE, Server, leftovers, make_key, make_packages, run, tar_of, upload_drive

# What a migration may change besides the packages.
CHANGED_TABLES = ("versions", "migrated", "condemned", "package_files")


class Wrong(Exception):
    """The store is not as it must be."""


def expect(condition, *what):
    if not condition:
        raise Wrong(" ".join(str(each) for each in what))


def make_store(program, folder, packages, drive):
    """Two maps with versions that share a package, one removed, and a drive, corrections, keys and an audit log."""
    store = folder / "template"
    for map_name, version, package in (("town", "a", 0), ("town", "b", 1), ("town", "copy", 0), ("depot", "a", 2),
                                       ("depot", "gone", 1)):
        done = run(program, "store", "add", store, map_name, version, packages[package].folder)
        expect(done.returncode == 0, done.stderr)
    for version in ("a", "b"):
        expect(run(program, "store", "activate", store, "town", version).returncode == 0, version)
    expect(run(program, "store", "remove", store, "depot", "gone").returncode == 0)
    headers = {"Authorization": "Bearer " + make_key(program, store)}
    server = Server(program, store, folder / "server.log")
    expect(server.listen(), "the server did not listen")
    server.wait_ready(10.0)
    upload_drive(server, "town", tar_of(drive), headers)
    saved = server.ask("PUT", "/v1/maps/town/edits", json.dumps({"edits": [], "format": "stillmap-edits", "version": 1}),
                       {"Content-Type": "application/json", **headers})
    expect(saved.status == 200, saved.body)
    busy = run(program, "store", "migrate", store)
    expect(busy.returncode == 1 and "stop the server" in busy.stderr, "beside a server:", busy.stderr)
    expect(server.stop() == 0)
    return store, headers


def rows_of(store):
    """Every row that stays; opened as a copy, so that nothing is changed."""
    with tempfile.TemporaryDirectory() as copy:
        for file in store.glob("state.db*"):
            shutil.copy(file, copy)
        database = sqlite3.connect(pathlib.Path(copy) / "state.db")
        tables = [name for (name,) in database.execute("SELECT name FROM sqlite_schema WHERE type = 'table' ORDER BY name")]
        rows = {name: sorted(map(repr, database.execute(f"SELECT * FROM {name}"))) for name in tables
                if name not in CHANGED_TABLES}
        database.close()
    return rows


def files_of(store):
    """Drives and files of jobs, by their bytes."""
    return {str(file.relative_to(store)): hashlib.sha256(file.read_bytes()).hexdigest()
            for folder in ("drives", "jobs") for file in sorted((store / folder).rglob("*")) if file.is_file()}


def versions_of(program, store):
    """@return the versions of the maps by the digests that their packages went by at first, and the digests of now."""
    done = run(program, "store", "list", store, "--json")
    expect(done.returncode == 0, done.stderr)
    maps, now = json.loads(done.stdout)["maps"], {}
    for version in (version for each in maps for version in each["versions"]):
        now[(version.pop("former_digests") or [version["digest"]])[0]] = version["digest"]
        version["digest"] = {new: old for old, new in now.items()}[version["digest"]]
        del version["bytes"]
    for each in maps:
        del each["bytes"]
    return maps, now


def schemas_of(store, digests):
    return sorted(json.loads((store / "packages" / digest / "manifest.json").read_text())["schema"] for digest in digests)


class Trial:
    def __init__(self, program, template, injector):
        self.program, self.template, self.injector = program, template, injector
        self.environment = {**os.environ, **injector.environment}
        self.rows, self.files = rows_of(template), files_of(template)
        self.versions = versions_of(program, template)[0]

    def migrate(self, store, environment=None):
        return subprocess.run([self.program, "store", "migrate", str(store)], capture_output=True, text=True, timeout=120,
                              env=environment)

    def check(self, store):
        """@return the digests of now."""
        # Opening it clears what a killed writer left.
        verified = run(self.program, "store", "verify", store)
        expect(verified.returncode == 0, "verify:", verified.stdout, verified.stderr)
        versions, now = versions_of(self.program, store)
        expect(versions == self.versions, "found", versions, "expected", self.versions)
        expect(rows_of(store) == self.rows, "rows have changed:", rows_of(store))
        expect(files_of(store) == self.files, "files of drives or jobs have changed")
        return now

    def calls(self, folder):
        """Calls that a migration makes, of each point."""
        store = folder / "counted"
        shutil.copytree(self.template, store)
        self.injector.disarm()
        done = self.migrate(store, self.environment)
        expect(done.returncode == 0, done.stderr)
        made, _ = self.injector.disarm()
        now = self.check(store)
        expect(schemas_of(store, now.values()) == [2, 2, 2], "not all is migrated")
        return [(point, n) for point, count in enumerate(made) for n in range(count)], now

    def kill(self, store, call):
        """@return whether it was killed."""
        point, n = call
        self.injector.arm(point, KILLED, n)
        done = self.migrate(store, self.environment)
        self.injector.disarm()
        expect(done.returncode in (0, -signal.SIGKILL), done.returncode, done.stderr)
        return done.returncode != 0

    def until_the_end(self, store, calls, dice, end):
        """Kills a migration once or twice, then lets it end. @return how often it was killed, and after how many packages."""
        kills, between = 0, set()
        for _ in range(dice.choice((1, 1, 2))):
            kills += self.kill(store, dice.choice(calls))
            between.add(sum(old != new for old, new in self.check(store).items()))
        done = self.migrate(store)
        expect(done.returncode == 0, "did not go on:", done.stderr)
        expect(self.check(store) == end, "ended otherwise than undisturbed")
        expect(not leftovers(store), "left", leftovers(store))
        names = {each.name for each in (store / "packages").iterdir()}
        expect(names == set(end.values()), "packages", names)
        return kills, between


def expect_served(program, store, log, headers, scan):
    server = Server(program, store, log)
    expect(server.listen(), "the server does not start on the migrated store")
    server.wait_ready(10.0)
    found = server.ask("POST", f"/v1/maps/town/localize?{LOCALIZE}", scan,
                       {"Content-Type": "application/octet-stream", **headers})
    expect(found.status == 200 and found.json["status"] == "ok", found.body[:300])
    expect(server.stop() == 0)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    for name in ("--program", "--packages", "--injector"):
        parser.add_argument(name, required=True)
    parser.add_argument("--kills", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    dice = random.Random(arguments.seed)
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        packages, scan = make_packages(arguments.packages, folder / "packages", 3, schema=1)
        template, headers = make_store(arguments.program, folder, packages, folder / "packages" / "drive")
        trial = Trial(arguments.program, template, Injector(folder / "nth_call", arguments.injector))
        calls, end = trial.calls(folder)
        kills, seen = 0, set()
        while kills < arguments.kills:
            store = folder / "store"
            shutil.copytree(template, store)
            killed, between = trial.until_the_end(store, calls, dice, end)
            kills, seen = kills + killed, seen | between
            if kills >= arguments.kills:
                expect_served(arguments.program, store, folder / "server.log", headers, scan)
            shutil.rmtree(store)
        print(f"{kills} kills at {len(calls)} calls, after {sorted(seen)} packages; nothing lost")


if __name__ == "__main__":
    try:
        main()
    except Wrong as wrong:
        sys.exit(f"migration_kills: {wrong}")
