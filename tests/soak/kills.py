#!/usr/bin/env python3
"""Kills a server at random instants, and the processes of its jobs, while clients publish, activate, roll back and remove
versions, have clouds imported, and make and revoke keys, and looks at what is there afterwards: all that was acknowledged, nothing half, ready within 5 s.

usage: kills.py --program STILLMAP --packages TINY_PACKAGES --seeds FIRST[-LAST] [--kills 50] [--results FOLDER]

A seed decides what is asked for and after how many answers a server dies, not at which instruction. With --results each seed
leaves a file there, and one that has its file is not run again.
"""

import argparse
import json
import os
import pathlib
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time

from serving import LOCALIZE, Server, leftovers, make_key, make_packages, run, small_cloud
from store_model import MapModel, Refused

READY_WITHIN_S = 5.0
CLIENTS = 3
PACKAGES = 6
MOST_VERSIONS = 5
# Of one server's life.
MOST_ANSWERS = 16
MOST_LIFE_S = 3.0


class Wrong(Exception):
    """The store is not as it must be."""


def expect(condition, *what):
    if not condition:
        raise Wrong(" ".join(str(each) for each in what))


class Journal:
    """What was asked and acknowledged, for people who look for the cause of a loss."""

    def __init__(self, file):
        self.file = open(file, "a", buffering=1)
        self.lock = threading.Lock()

    def note(self, *what):
        with self.lock:
            self.file.write(f"{time.monotonic():.4f} {' '.join(map(str, what))}\n")


class MapClient:
    """Changes one map, one request after the other."""

    def __init__(self, name, packages, headers, journal):
        self.model, self.packages, self.headers, self.journal = MapModel(name), packages, headers, journal
        self.pending = None  # a change that was asked for and not answered
        self.acknowledged = 0

    def choose(self, random):
        """@return the change, and method, path, body and headers that ask for it."""
        model, base = self.model, f"/v1/maps/{self.model.name}"
        names = sorted(model.versions)
        kinds = ["add"] * 4 + ["activate"] * 3 + ["roll_back"] * 2 + ["remove"] * (4 if len(names) > MOST_VERSIONS else 2)
        kind = random.choice(kinds) if names else "add"
        if kind == "add":
            package = random.choice(self.packages)
            version = random.choice(names) if names and random.random() < 0.2 else f"v{random.randrange(100)}"
            tar, headers = package.tar, package.headers
            others = [each for each in self.packages if each.digest in model.versions.values()]
            if others and random.random() < 0.5:
                tar, headers = package.beside(random.choice(others))
            return ("add", version, package.digest), ("PUT", f"{base}/versions/{version}", tar, headers)
        if kind == "roll_back":
            return ("roll_back",), ("POST", f"{base}/rollback?new_frame=true", None, self.matching(random))
        version = random.choice(names)
        if kind == "remove":
            return ("remove", version), ("DELETE", f"{base}/versions/{version}", None, {})
        return ("activate", version), ("POST", f"{base}/versions/{version}/activate?new_frame=true", None, self.matching(random))

    def matching(self, random):
        length = {"Content-Length": "0"}
        return {**length, "If-Match": f'"{self.model.revision}"'} if random.random() < 0.5 else length

    def step(self, server, random):
        change, (method, path, body, headers) = self.choose(random)
        try:
            after, code = self.model.after(change), None
        except Refused as refused:
            after, code = self.model, str(refused)
        self.pending = change
        self.journal.note("ask", self.model.name, *change)
        response = server.ask(method, path, body, {**headers, **self.headers})
        self.journal.note("got", self.model.name, *change, response.status)
        found = response.json["code"] if response.json and "code" in response.json else None
        expect(found == code, change, "was answered", response.status, response.body[:300], "and should be", code)
        self.model, self.pending = after, None
        self.acknowledged += 1

    def check(self, server):
        """Takes what the store holds for true when it is what was acknowledged, or that with the pending change."""
        response = server.ask("GET", f"/v1/maps/{self.model.name}/versions", headers=self.headers)
        found = MapModel.facts_of(response.json) if response.status == 200 else None
        expect(found is not None or response.json["code"] == "UnknownMap", response.body)
        allowed = [self.model]
        if self.pending:
            try:
                allowed.append(self.model.after(self.pending))
            except Refused:
                pass
        for model in allowed:
            if found == model.facts():
                self.model, self.pending = model, None
                return
        raise Wrong(f"{self.model.name} holds {found}, expected {[model.facts() for model in allowed]}")


class KeyClient:
    """Makes and revokes keys by the command line, as an operator beside the running server."""

    def __init__(self, program, store, journal):
        self.program, self.store, self.journal = program, store, journal
        self.keys = {}  # name -> [id, text, revoked]
        self.pending = None
        self.acknowledged = 0
        self.made = 0
        self.process = None
        self.unread = set()  # keys whose text was never read: nobody can use them

    def ask(self, *arguments):
        self.process = subprocess.Popen([self.program, "keys", *arguments, "--store", str(self.store), "--json"],
                                        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        answer, error = self.process.communicate(timeout=60)
        if self.process.returncode < 0:
            raise ConnectionError("killed")
        expect(self.process.returncode == 0, arguments, "failed:", error)
        return json.loads(answer)

    def step(self, random):
        good = [name for name, key in self.keys.items() if not key[2]]
        if good and random.random() < 0.4:
            name = random.choice(good)
            self.pending = ("revoke", name)
            self.ask("revoke", self.keys[name][0])
            self.keys[name][2] = True
        else:
            self.made += 1
            name = f"key {self.made}"
            self.pending = ("create", name)
            made = self.ask("create", name, "--scope", "read")
            self.keys[name] = [made["id"], made["key"], False]
        self.journal.note("got", *self.pending)
        self.pending = None
        self.acknowledged += 1

    def check(self, server, random):
        listed = {key["name"]: key for key in self.ask("list")["keys"]}
        kind, name = self.pending or (None, None)
        for known, (identity, _, revoked) in self.keys.items():
            expect(known in listed and listed[known]["id"] == identity, known, "is lost")
            found = listed[known]["revoked_ns"] is not None
            expect(found == revoked or (kind == "revoke" and name == known), known, "revoked:", found)
            self.keys[known][2] = found
        more = set(listed) - set(self.keys) - {"soak"}
        expect(more <= ({name} if kind == "create" else set()) | self.unread, "keys that nobody made:", more)
        self.unread |= more
        self.pending = None
        for known in random.sample(sorted(self.keys), min(3, len(self.keys))):
            _, text, revoked = self.keys[known]
            status = server.ask("GET", "/v1/maps", headers={"Authorization": f"Bearer {text}"}).status
            expect(status == (401 if revoked else 200), known, "is answered", status)


class JobClient:
    """Sends point clouds, each of which a job of its own process makes a version of; kills such processes too."""

    MAP = "imported"

    def __init__(self, headers, journal):
        self.headers, self.journal = headers, journal
        self.jobs = {}  # id -> [version, succeeded]
        self.version, self.waiting, self.was_killed = 0, None, False
        self.acknowledged = 0

    def step(self, server, random):
        if self.waiting is None:
            # What was asked for and not answered is asked for again.
            path = f"/v1/maps/{self.MAP}/versions/v{self.version}"
            response = server.ask("PUT", path, small_cloud(self.version), {"Content-Type": "application/vnd.pcd", **self.headers})
            expect(response.status in (200, 202), path, "is answered", response.status, response.body[:300])
            if response.status == 200:  # asked for before a kill took the answer away, and done since
                self.version += 1
                return
            self.waiting, self.was_killed = response.json["id"], False
            self.jobs[self.waiting] = [f"v{self.version}", False]
            self.acknowledged += 1
            return
        if random.random() < 0.1:
            self.kill_job(server)
        self.look(server, self.waiting)
        time.sleep(0.02)

    def kill_job(self, server):
        children = pathlib.Path(f"/proc/{server.process.pid}/task").glob("*/children")
        for child in {pid for each in children for pid in each.read_text().split()}:
            self.was_killed = True
            self.journal.note("killed job's process", child)
            os.kill(int(child), signal.SIGKILL)

    def look(self, server, job):
        response = server.ask("GET", f"/v1/jobs/{job}", headers=self.headers)
        expect(response.status == 200, "job", job, "is lost:", response.body[:300])
        status, (version, succeeded) = response.json["status"], self.jobs[job]
        expect(not succeeded or status == "succeeded", "job", job, "had succeeded and is", status)
        if status == "succeeded":
            listed = server.ask("GET", f"/v1/maps/{self.MAP}/versions", headers=self.headers).json
            expect(version in MapModel.facts_of(listed)["versions"], "job", job, "has no version:", listed)
            self.jobs[job][1] = True
        expect(status in ("enqueued", "processing", "succeeded") or (status == "failed" and self.was_killed),
               "job", job, "is", response.json)
        if status in ("succeeded", "failed") and job == self.waiting:
            self.waiting, self.version = None, self.version + 1

    def check(self, server, random):
        for job in random.sample(sorted(self.jobs), min(3, len(self.jobs))):
            if job == self.waiting or self.jobs[job][1]:
                self.look(server, job)


class Session:
    """One store and its servers, each of which is killed."""

    def __init__(self, arguments, folder, seed, packages, scan):
        self.program, self.random, self.scan = arguments.program, random.Random(seed), scan
        self.store, self.log = folder / "store", folder / "server.log"
        self.store.mkdir()
        self.journal = Journal(folder / "journal")
        self.headers = {"Authorization": "Bearer " + make_key(self.program, self.store)}
        self.clients = [MapClient(f"town-{i}", packages, self.headers, self.journal) for i in range(CLIENTS)]
        self.keys = KeyClient(self.program, self.store, self.journal)
        # Where the program that the jobs run in is not built, there are none.
        has_mapper = pathlib.Path(self.program).with_name("stillmap-mapper").exists()
        self.jobs = JobClient(self.headers, self.journal) if has_mapper else None
        self.ready_s, self.poses, self.wrong = [], 0, []

    def start(self):
        return Server(self.program, self.store, self.log)

    def one_kill(self):
        server = self.start()
        try:
            if self.random.random() < 0.15:
                # While it opens the store and clears what the one before left.
                time.sleep(self.random.uniform(0.0, 0.1))
                return
            expect(server.listen(), "did not listen:", self.log.read_text()[-500:])
            self.ready_s.append(server.wait_ready(READY_WITHIN_S))
            self.check(server)
            self.work(server)
            if self.wrong:
                raise Wrong(self.wrong[0])
        finally:
            if server.process.poll() is None:
                # With what it started, or leaving it behind.
                server.kill(group=self.random.random() < 0.5)
            if self.jobs:
                self.jobs.was_killed = True
            self.journal.note("killed")

    def work(self, server):
        """Lets all clients work for a while and kills the server, and half of the time the key's program, under them."""
        dead = threading.Event()
        changing = [*self.clients, *([self.jobs] if self.jobs else [])]
        steps = [lambda chance, client=client: client.step(server, chance) for client in changing] + [self.keys.step]
        seeds = [self.random.random() for _ in steps]
        threads = [threading.Thread(target=self.until_dead, args=(step, random.Random(seed), dead))
                   for step, seed in zip(steps, seeds)]
        for thread in threads:
            thread.start()
        # So many answers later and at any instant then, however fast the machine is.
        enough, end = self.acknowledged() + self.random.randrange(MOST_ANSWERS), time.monotonic() + MOST_LIFE_S
        while self.acknowledged() < enough and time.monotonic() < end and not self.wrong:
            time.sleep(0.002)
        time.sleep(self.random.uniform(0.0, 0.04))
        dead.set()
        process = self.keys.process
        if self.random.random() < 0.5 and process and process.poll() is None:
            process.kill()
        server.kill(group=self.random.random() < 0.5)
        for thread in threads:
            thread.join()

    def until_dead(self, step, chance, dead):
        try:
            while not dead.is_set():
                step(chance)
        except OSError as error:
            if not dead.is_set():
                self.wrong.append(f"before the kill: {error!r}")
        except Exception as error:  # it must reach the main thread, whatever it is
            self.wrong.append(repr(error))

    def check(self, server):
        expect(not leftovers(self.store), "half packages:", leftovers(self.store))
        for client in self.clients:
            client.check(server)
        self.keys.check(server, self.random)
        if self.jobs:
            self.jobs.check(server, self.random)
        verified = run(self.program, "store", "verify", self.store)
        expect(verified.returncode == 0, "verify:", verified.stdout, verified.stderr)
        for client in self.clients:
            if client.model.active:
                response = server.ask("POST", f"/v1/maps/{client.model.name}/localize?{LOCALIZE}", self.scan,
                                      {"Content-Type": "application/octet-stream", **self.headers})
                expect(response.status == 200 and response.json["status"] == "ok", response.status, response.body[:300])
                expect(response.json["map"]["version"] == client.model.active, response.json["map"])
                self.poses += 1

    def finish(self):
        server = self.start()
        expect(server.listen(), "did not listen")
        server.wait_ready(READY_WITHIN_S)
        self.check(server)
        expect(server.stop() == 0, "ended with", server.process.returncode)

    def acknowledged(self):
        return sum(each.acknowledged for each in [*self.clients, self.keys, *([self.jobs] if self.jobs else [])])

    def result(self, kills):
        return {"kills": kills, "acknowledged": self.acknowledged(),
                "jobs": sum(each[1] for each in self.jobs.jobs.values()) if self.jobs else 0, "poses": self.poses, "ready_worst_s": round(max(self.ready_s, default=0.0), 3),
                "ready_median_s": round(sorted(self.ready_s)[len(self.ready_s) // 2], 3) if self.ready_s else 0.0}


def run_seed(arguments, seed):
    folder = pathlib.Path(tempfile.mkdtemp(prefix=f"kills-{seed}-"))
    packages, scan = make_packages(arguments.packages, folder / "packages", PACKAGES)
    session = Session(arguments, folder, seed, packages, scan)
    kills = 0
    try:
        while kills < arguments.kills:
            session.one_kill()
            kills += 1
        session.finish()
    except (Wrong, TimeoutError, OSError) as error:
        print(f"seed {seed}, after {kills} kills: {error}\nstore, journal and log are in {folder}", file=sys.stderr)
        return None
    shutil.rmtree(folder)
    return session.result(kills)


def run_seeds(usage, run_seed, kills):
    """Runs those that the command line asks for. @return the program's exit code."""
    parser = argparse.ArgumentParser(usage=usage)
    parser.add_argument("--program", required=True)
    parser.add_argument("--packages", required=True)
    parser.add_argument("--seeds", default="1")
    parser.add_argument("--kills", type=int, default=kills)
    parser.add_argument("--results", type=pathlib.Path)
    arguments = parser.parse_args()
    first, _, last = arguments.seeds.partition("-")
    for seed in range(int(first), int(last or first) + 1):
        file = arguments.results / f"{seed}.json" if arguments.results else None
        if file and file.exists():
            continue
        started = time.monotonic()
        result = run_seed(arguments, seed)
        if result is None:
            return 1
        result["seconds"] = round(time.monotonic() - started, 1)
        print(f"seed {seed}:", json.dumps(result), flush=True)
        if file:
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(json.dumps(result))
    return 0


if __name__ == "__main__":
    sys.exit(run_seeds(__doc__, run_seed, kills=50))
