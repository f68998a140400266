#!/usr/bin/env python3
"""Kills a server that rebuilds a map at random instants, and the processes that rebuild, and looks at what is there
afterwards: each rebuild ends, in words if it fails, and is published and activated once; equal rebuilds make equal maps,
however often they were killed; nobody outlives a server; nothing is half there; ready within 5 s.

usage: rebuild_kills.py --program STILLMAP --packages TINY_PACKAGES --seeds FIRST[-LAST] [--kills 20] [--results FOLDER]

A seed decides what is asked for and about when a server dies, not at which instruction. With --results each seed leaves a
file there, and one that has its file is not run again.
"""

import collections
import json
import os
import pathlib
import random
import shutil
import signal
import sys
import tempfile
import threading
import time

from kills import Journal, MapClient, Wrong, expect, run_seeds
from serving import LOCALIZE, Server, left_of_jobs, leftovers, make_key, make_packages, run, tar_of, upload_drive

READY_WITHIN_S = 5.0
GONE_WITHIN_S = 5.0
ENDS_WITHIN_S = 120.0
# Of one server's life, to its kill; one that is to die at the end of a job may take a few of them.
MOST_LIFE_S = 3.0
AT_THE_END_WITHIN_S = 12.0
# As often as the server starts one again that was killed, or lost with its server; beyond that it has failed.
RETRIES = 6
PACKAGES = 2


class Order:
    """A rebuild that was asked for."""

    def __init__(self, number, random):
        self.version = f"r{number}"
        self.options = {"detector": "geometric", "voxel": random.choice([0.1, 0.2]),
                        "movable": random.choice(["project", "delete"])}
        self.new_frame = random.random() < 0.3
        self.activate = random.random() < 0.6
        self.job = None
        self.kills = 0  # of its processes and its servers, at most
        self.cancels = False
        self.previous = None  # digest of the active version when it was asked for

    def request(self, drive, held_back):
        return json.dumps({"drives": [drive], "held_back": held_back, "version": self.version, "options": self.options,
                           "activate": self.activate, "new_frame": self.new_frame})

    def content(self):
        """Rebuilds of equal content make equal maps."""
        return json.dumps(self.options), None if self.new_frame else self.previous


class Rebuilds:
    """Has one map rebuilt again and again, and knows what must be there."""

    MAP = "town"

    def __init__(self, headers, journal, first):
        self.headers, self.journal = headers, journal
        self.drives = []
        self.versions = {"v1": first}  # name -> digest
        self.active, self.revision = "v1", 1
        self.digests = {}  # Order.content() -> digest
        self.ended = {}  # job -> status
        self.order, self.made = None, 0
        self.acknowledged = 0
        self.ends = collections.Counter()

    def ask(self, server, method, path, body=None, **headers):
        names = {name.replace("_", "-"): value for name, value in headers.items()}
        return server.ask(method, path, body, {**names, **self.headers}, timeout=60)

    # What is asked for while a server lives

    def step(self, server, random):
        if self.order is None:
            self.made += 1
            self.order = Order(self.made, random)
            self.order.previous = self.versions[self.active]
        if self.order.job is None:
            self.enqueue(server)
        else:
            self.look(server)
            time.sleep(0.02)

    def enqueue(self, server):
        order = self.order
        self.journal.note("ask", order.version, order.request(*self.drives))
        response = self.ask(server, "POST", f"/v1/maps/{self.MAP}/rebuild", order.request(*self.drives),
                            content_type="application/json", idempotency_key=order.version)
        self.journal.note("got", order.version, response.status, response.body[:200])
        if response.status >= 500 and order.kills > 0:  # of what it is asked for first: the room that it needs
            expect(response.json["code"] in ("Busy", "InternalError"), response.body[:300])
            return
        expect(response.status == 202, order.version, "is answered", response.status, response.body[:300])
        expect(response.json["request"]["version"] == order.version, "another's job:", response.body[:300])
        order.job = response.json["id"]
        expect(order.job not in self.ended, "job", order.job, "twice")
        self.acknowledged += 1

    def look(self, server):
        """@return the job's stage; empty when it has ended."""
        order = self.order
        response = self.ask(server, "GET", f"/v1/jobs/{order.job}")
        expect(response.status == 200, "job", order.job, "is lost:", response.body[:300])
        job = response.json
        if job["status"] in ("enqueued", "processing"):
            return job["stage"]
        self.journal.note("ended", order.version, response.body)
        if job["status"] == "succeeded":
            self.succeeded(job)
        elif job["status"] == "failed":
            expect(order.kills > RETRIES and ("signal 9" in job["error"] or "its server ended" in job["error"]),
                   "it failed, killed", order.kills, "times:", job["error"])
        else:
            expect(job["status"] == "canceled" and order.cancels, "job", order.job, "is", job["status"])
        self.ended[order.job] = job["status"]
        self.ends[job["status"]] += 1
        self.order = None
        return ""

    def succeeded(self, job):
        order, result = self.order, job["result"]
        expect(result and result["version"] == order.version, "no result:", job)
        expect(result["gate"]["verdict"] in ("pass", "fail"), "no verdict:", result)
        digest = self.digests.setdefault(order.content(), result["digest"])
        expect(result["digest"] == digest, order.version, "differs from one that was made the same way:", result["digest"], digest)
        self.versions[order.version] = digest
        expect(order.activate or not result["activated"], "activated unasked:", result)
        expect(not order.activate or result["activated"] == (result["gate"]["verdict"] == "pass"), "the gate says otherwise:", result)
        if result["activated"]:
            self.active, self.revision = order.version, self.revision + 1

    def kill_process(self, store):
        for process in mappers_of(store):
            if self.order:
                self.order.kills += 1
            self.journal.note("kill the process", process)
            try:
                os.kill(process, signal.SIGKILL)
            except ProcessLookupError:
                pass

    def note_death(self):
        """To be called when a server was killed."""
        if self.order:
            self.order.kills += 1

    def cancel(self, server):
        order = self.order
        if order is None or order.job is None:
            return
        order.cancels = True
        response = self.ask(server, "POST", f"/v1/jobs/{order.job}/cancel")
        self.journal.note("cancel", order.version, response.status)
        expect(response.status in (200, 202) or response.json["code"] == "JobFinished", response.body[:300])

    # What must be there when it starts again

    def check(self, server):
        if self.order and self.order.job:
            self.look(server)
        listed = self.ask(server, "GET", f"/v1/maps/{self.MAP}/versions").json
        found = {each["version"]: each["digest"] for each in listed["versions"]}
        under_way = self.order.version if self.order else None
        expect({name: digest for name, digest in found.items() if name != under_way} == self.versions,
               "versions are", found, "expected", self.versions, "and perhaps", under_way)
        facts = (listed["version"], listed["revision"])
        allowed = [(self.active, self.revision)]
        if under_way in found and self.order.activate:
            allowed.append((under_way, self.revision + 1))
        expect(facts in allowed, "active and revision are", facts, "expected one of", allowed)
        for job, status in self.ended.items():
            response = self.ask(server, "GET", f"/v1/jobs/{job}")
            expect(response.status == 200 and response.json["status"] == status, "job", job, "had", status, response.body[:300])
            expect(status != "succeeded" or response.json["result"], "job", job, "has lost its result")

    def check_folders(self, store):
        """Logs of jobs that have ended, and what the one under way works with."""
        left = [each for each in left_of_jobs(store, self.ended) if not self.is_under_way(each.name)]
        expect(not left, "left of jobs:", left)

    def is_under_way(self, job):
        """Also one that was asked for and never answered."""
        return self.order is not None and job.isdigit() and self.order.job in (None, int(job))


def mappers_of(store):
    """Processes that rebuild for the servers of this store."""
    found = []
    for folder in pathlib.Path("/proc").iterdir():
        if not folder.name.isdigit():
            continue
        try:
            words = (folder / "cmdline").read_bytes().split(b"\0")
        except OSError:
            continue
        if words[0].endswith(b"stillmap-mapper") and any(word.startswith(bytes(store) + b"/") for word in words):
            found.append(int(folder.name))
    return found


def wait_for(holds, most_s, *what):
    """Until it raises no Wrong."""
    end = time.monotonic() + most_s
    while True:
        try:
            return holds()
        except Wrong as wrong:
            if time.monotonic() > end:
                raise Wrong(*what, wrong) from wrong
        time.sleep(0.02)


class Session:
    """One store and its servers, each of which is killed."""

    def __init__(self, arguments, folder, seed):
        self.program, self.random = arguments.program, random.Random(seed)
        packages, self.scan = make_packages(arguments.packages, folder / "packages", PACKAGES)
        self.store, self.log = folder / "store", folder / "server.log"
        self.store.mkdir()
        self.journal = Journal(folder / "journal")
        self.headers = {"Authorization": "Bearer " + make_key(self.program, self.store)}
        done = run(self.program, "store", "add", self.store, Rebuilds.MAP, "v1", packages[0].folder, "--activate")
        expect(done.returncode == 0, done.stderr)
        self.rebuilds = Rebuilds(self.headers, self.journal, packages[0].digest)
        self.publisher = MapClient("other", packages, self.headers, self.journal)
        self.ready_s, self.poses, self.wrong, self.stages = [], 0, [], collections.Counter()
        server = self.start()
        try:
            expect(server.listen(), "did not listen:", self.last_words())
            server.wait_ready(READY_WITHIN_S)
            packed = tar_of(folder / "packages" / "drive")
            self.rebuilds.drives = [upload_drive(server, Rebuilds.MAP, packed, self.headers) for _ in range(2)]
        finally:
            server.stop()

    def last_words(self):
        return self.log.read_text()[-600:]

    def start(self):
        return Server(self.program, self.store, self.log, options=("--jobs-retries", str(RETRIES)))

    def one_kill(self):
        server = self.start()
        try:
            if self.random.random() < 0.1:
                # While it opens the store and takes the jobs over.
                time.sleep(self.random.uniform(0.0, 0.15))
                return
            expect(server.listen(), "did not listen:", self.last_words())
            self.ready_s.append(server.wait_ready(READY_WITHIN_S))
            self.check(server)
            self.work(server)
            if self.wrong:
                raise Wrong(self.wrong[0])
        finally:
            if server.process.poll() is None:
                server.kill()
            self.rebuilds.note_death()
            self.journal.note("killed")
            wait_for(self.no_mapper, GONE_WITHIN_S, "outlives its server:")

    def no_mapper(self):
        found = mappers_of(self.store)
        expect(not found, "processes", found)

    def work(self, server):
        dead = threading.Event()
        steps = [lambda chance: self.rebuilds.step(server, chance), lambda chance: self.publisher.step(server, chance)]
        threads = [threading.Thread(target=self.until_dead, args=(step, random.Random(self.random.random()), dead))
                   for step in steps]
        for thread in threads:
            thread.start()
        try:
            self.live(server)
        finally:
            dead.set()
            server.kill()
            for thread in threads:
                thread.join()

    def live(self, server):
        """Returns at the instant of the kill: any, or about when a job's result is published."""
        chance = self.random.random()
        if chance < 0.35:
            self.until_published()
            time.sleep(self.random.uniform(0.0, 0.05))
            return
        life_s = self.random.uniform(0.0, MOST_LIFE_S)
        if chance < 0.65:
            # In the midst of it the process that works, or its job is cancelled.
            before = self.random.uniform(0.0, life_s)
            time.sleep(before)
            life_s -= before
            if chance < 0.58:
                self.rebuilds.kill_process(self.store)
            else:
                self.rebuilds.cancel(server)
        time.sleep(life_s)

    def until_published(self):
        """Looks for the map that the mapper has left, since the stage of that name is short."""
        end = time.monotonic() + AT_THE_END_WITHIN_S
        while time.monotonic() < end and not self.wrong:
            order = self.rebuilds.order
            if order and order.job and (self.store / "jobs" / str(order.job) / "scratch" / "report.json").exists():
                return
            time.sleep(0.001)

    def until_dead(self, step, chance, dead):
        try:
            while not dead.is_set():
                step(chance)
        except OSError as error:
            if not dead.is_set():
                self.wrong.append(f"before the kill: {error!r}")
        except Wrong as error:
            self.wrong.append(str(error))
        except Exception as error:  # it must reach the main thread, whatever it is
            self.wrong.append(repr(error))

    def check(self, server):
        expect(not leftovers(self.store), "half packages:", leftovers(self.store))
        self.publisher.check(server)
        self.rebuilds.check(server)
        wait_for(lambda: self.rebuilds.check_folders(self.store), GONE_WITHIN_S, "folders:")
        verified = run(self.program, "store", "verify", self.store)
        expect(verified.returncode == 0, "verify:", verified.stdout, verified.stderr)
        response = server.ask("POST", f"/v1/maps/{Rebuilds.MAP}/localize?{LOCALIZE}", self.scan,
                              {"Content-Type": "application/octet-stream", **self.headers})
        expect(response.status == 200 and response.json["status"] == "ok", response.status, response.body[:300])
        self.poses += 1

    def finish(self):
        """The last one must end, and all is as it was acknowledged."""
        server = self.start()
        expect(server.listen(), "did not listen")
        server.wait_ready(READY_WITHIN_S)
        wait_for(lambda: self.last_ends(server), ENDS_WITHIN_S, "the last job")
        self.check(server)
        expect(server.stop() == 0, "ended with", server.process.returncode)
        self.no_mapper()

    def last_ends(self, server):
        rebuilds = self.rebuilds
        if rebuilds.order and rebuilds.order.job:
            rebuilds.look(server)
        expect(rebuilds.order is None or rebuilds.order.job is None, "has not ended:", rebuilds.order and rebuilds.order.job)

    def result(self, kills):
        return {"kills": kills, "rebuilds": dict(self.rebuilds.ends), "contents": len(self.rebuilds.digests),
                "acknowledged": self.rebuilds.acknowledged + self.publisher.acknowledged, "poses": self.poses,
                "ready_worst_s": round(max(self.ready_s, default=0.0), 3)}


def run_seed(arguments, seed):
    folder = pathlib.Path(tempfile.mkdtemp(prefix=f"rebuild-kills-{seed}-"))
    session, kills = None, 0
    try:
        session = Session(arguments, folder, seed)
        while kills < arguments.kills:
            session.one_kill()
            kills += 1
        session.finish()
    except (Wrong, TimeoutError, OSError) as error:
        print(f"seed {seed}, after {kills} kills: {error}\nstore, journal and log are in {folder}", file=sys.stderr)
        return None
    shutil.rmtree(folder)
    return session.result(kills)


if __name__ == "__main__":
    sys.exit(run_seeds(__doc__, run_seed, kills=20))
