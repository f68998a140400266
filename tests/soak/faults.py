#!/usr/bin/env python3
"""Lets each system call of uploading, activating, rolling back, removing, making keys, importing and rebuilding (in the server
and in the process of the job) fail once, by libfiu, and looks at what is there afterwards: all that was acknowledged, nothing
half, jobs that have ended, in words if they failed, a server that goes on or has said why not.

usage: faults.py --program STILLMAP --packages TINY_PACKAGES --injector NTH_CALL.SO [--sample N] [--seed 1]
       [--part 1/1]

Without --sample every call is failed in every way. Jobs take longer and are done when named alone: --operation import, rebuild,
"short rebuild", which is one of few scans in a frame of its own, so that all its calls can be failed. --part 2/3 is the second
third of them; the three may run at once.
"""

import argparse
import collections
import errno
import itertools
import json
import mmap
import pathlib
import random
import shutil
import struct
import subprocess
import sys
import tempfile
import time

from serving import LOCALIZE, Server, leftovers, left_of_jobs, make_key, make_packages, run, small_cloud, tar_of, upload_drive
from store_model import MapModel

POSIX_PRELOAD = "/usr/lib/fiu/fiu_posix_preload.so"
# As in nth_call.cpp. What a call may fail with; 0 for a short one.
POINTS = [
    ("posix/io/oc/open", (errno.EIO, errno.ENOSPC)), ("posix/io/rw/pwrite", (errno.EIO, errno.ENOSPC)),
    ("posix/io/rw/pwrite/reduce", (0,)), ("posix/io/rw/write", (errno.EIO, errno.ENOSPC)),
    ("posix/io/rw/write/reduce", (0,)), ("posix/io/rw/ftruncate", (errno.EIO,)),
    ("posix/io/sync/fsync", (errno.EIO, errno.ENOSPC)), ("posix/io/sync/fdatasync", (errno.EIO, errno.ENOSPC)),
    ("posix/io/dir/rename", (errno.EIO, errno.ENOSPC)), ("posix/io/dir/unlink", (errno.EIO,)),
    ("posix/io/dir/opendir", (errno.EIO,)), ("posix/io/rw/pread", (errno.EIO,)), ("posix/io/rw/read", (errno.EIO,)),
    ("posix/mm/mmap", (errno.ENOMEM,)), ("stillmap/mkdir", (errno.EIO, errno.ENOSPC)), ("stillmap/rmdir", (errno.EIO,)),
    ("stillmap/linkat", (errno.EIO,)), ("stillmap/renameat2", (errno.EIO, errno.ENOSPC))]
# In place of an error: the process is killed before the call.
KILLED = -1
# Those that a process of its own does for the server, and their maps, which nothing else changes.
JOBS = {"import": "yard", "rebuild": "street", "short rebuild": "lane"}
SHORT_SCANS = 4
OPERATIONS = ["add", "activate", "roll_back", "remove", "mend", "add by command", "activate by command", "make a key", "start",
              *JOBS]
READY_WITHIN_S = 10.0
NOTICED_WITHIN_S = 10.0
# Looking at hundreds of jobs takes more requests than a key has.
UNBOUNDED = ("--rate-requests-per-s", "0")
# A job; a minute of it is what the server waits for an estimate that says nothing.
ENDS_WITHIN_S = 120.0


class Wrong(Exception):
    """The store or the server is not as it must be."""


def expect(condition, *what):
    if not condition:
        raise Wrong(" ".join(str(each) for each in what))


def first_scans(drive, folder, count):
    """A folder with the first so many scans of a drive. @return it"""
    folder.mkdir()
    for i in range(count):
        shutil.copy(drive / f"{i}.bin", folder)
    poses = (drive / "poses.tum").read_text().splitlines(keepends=True)
    (folder / "poses.tum").write_text("".join(poses[:count]))
    return folder


class Injector:
    """What nth_call.cpp reads: which call of which point fails."""

    LAYOUT = f"{4 + len(POINTS)}q"

    def __init__(self, file, library):
        file.write_bytes(bytes(struct.calcsize(self.LAYOUT)))
        with open(file, "r+b") as opened:
            self.shared = mmap.mmap(opened.fileno(), 0)
        self.environment = {"STILLMAP_NTH_CALL": str(file), "LD_PRELOAD": f"{library}:{POSIX_PRELOAD}"}
        self.arm()

    def arm(self, point=len(POINTS), error=0, n=0):
        self.shared[:] = struct.pack(self.LAYOUT, n, 0, error, point, *[0] * len(POINTS))

    def disarm(self):
        """@return calls made of each point and whether one failed, since it was armed."""
        _, failed, _, _, *made = struct.unpack(self.LAYOUT, self.shared)
        self.arm()
        return made, failed == 1


class Trials:
    def __init__(self, arguments, folder):
        self.program = arguments.program
        self.packages, self.scan = make_packages(arguments.packages, folder / "packages", 3)
        drive = folder / "packages" / "drive"
        self.drive, self.short_drive = tar_of(drive), tar_of(first_scans(drive, folder / "short", SHORT_SCANS))
        self.store, self.log = folder / "store", folder / "server.log"
        self.store.mkdir()
        self.injector = Injector(folder / "nth_call", arguments.injector)
        self.headers = {"Authorization": "Bearer " + make_key(self.program, self.store)}
        self.keys = {"soak"}
        self.model = MapModel("town")
        self.models = {"town": self.model}
        self.drives, self.job = {}, None  # of a rebuild: those that it is made from and judged by
        self.jobs = {}  # id -> status, of those that have ended
        self.made_by = {}  # operation -> digest of what its job makes
        self.made = itertools.count(1)
        self.ends = collections.Counter()
        self.now = None
        self.server = None
        self.restart()

    # The server

    def restart(self):
        """Kills the server and starts another, which must find everything."""
        if self.server and self.server.process.poll() is None:
            self.server.kill()
        self.log_begin = self.log.stat().st_size if self.log.exists() else 0
        self.server = Server(self.program, self.store, self.log, environment=self.injector.environment, options=UNBOUNDED)
        expect(self.server.listen(), "did not listen:", self.last_words())
        self.server.wait_ready(READY_WITHIN_S)

    def last_words(self):
        return self.log.read_text()[-600:]

    def change(self, change):
        """Asks for a change over HTTP. @return the answer's status; 0 when none came."""
        base, kind = f"/v1/maps/{self.model.name}", change[0]
        method, path, body, headers = {
            "add": lambda: ("PUT", f"{base}/versions/{change[1]}", self.package(change[2]).tar,
                            self.package(change[2]).headers),
            "activate": lambda: ("POST", f"{base}/versions/{change[1]}/activate?new_frame=true", b"", {}),
            "roll_back": lambda: ("POST", f"{base}/rollback?new_frame=true", b"", {}),
            "remove": lambda: ("DELETE", f"{base}/versions/{change[1]}", None, {})}[kind]()
        try:
            response = self.server.ask(method, path, body, {**headers, **self.headers})
        except OSError:
            return 0
        if response.status >= 400:
            expect(response.json and response.json.get("code"), change, "was refused without words:", response.body)
            expect(response.status >= 500, change, "was refused:", response.body)
        return response.status

    def package(self, digest):
        return next(each for each in self.packages if each.digest == digest)

    # What must be there for an operation to be possible

    def make(self, *change):
        status = self.change(change)
        expect(status in (200, 201, 204), change, "without any fault is answered", status, self.last_words())
        self.model = self.model.after(change)

    def prepare(self, operation):
        """@return the change that the operation is to make, or nothing."""
        self.models[self.model.name] = self.model
        name = JOBS.get(operation, "town")
        self.model = self.models.get(name, MapModel(name))
        model = self.model
        if operation in ("make a key", "start"):
            return None
        if operation in JOBS:
            return self.prepare_job(operation)
        if "add" in operation:
            digest = self.packages[2].digest
            for version in [name for name in model.versions if model.versions[name] == digest]:
                if version == self.model.active:
                    self.make("activate", next(name for name in model.versions if model.versions[name] != digest))
                self.make("remove", version)
            return ("add", f"v{next(self.made)}", digest)
        while len(self.model.versions) < 2:
            self.make("add", f"v{next(self.made)}", self.packages[len(self.model.versions)].digest)
        if self.model.active is None:
            self.make("activate", min(self.model.versions))
        other = next(name for name in sorted(self.model.versions) if name != self.model.active)
        if operation == "roll_back" and self.model.previous is None:
            self.make("activate", other)
        if operation == "remove" and len(self.model.versions) < 3:
            other = f"v{next(self.made)}"
            self.make("add", other, self.packages[2].digest)
        if operation == "mend":
            tile = next((self.store / "packages" / self.model.versions[other] / "packs").iterdir())
            tile.write_bytes(bytes(tile.stat().st_size))
            return ("add", other, self.model.versions[other])
        return (operation.split()[0], other) if operation != "roll_back" else ("roll_back",)

    def prepare_job(self, operation):
        """What it makes must be new to the store: else its files are not copied."""
        if "rebuild" in operation and operation not in self.drives:
            self.make("add", "v1", self.packages[0].digest)
            self.make("activate", "v1")
            self.drives[operation] = [upload_drive(self.server, self.model.name, each, self.headers)
                                      for each in (self.short_drive if "short" in operation else self.drive, self.drive)]
        version = f"j{next(self.made)}"
        if operation not in self.made_by:
            expect(self.perform_job(operation, version), operation, "failed without any fault:", self.last_words())
            self.made_by[operation] = self.versions()[version]
            self.model = self.model.after(("add", version, self.made_by[operation]))
            version = f"j{next(self.made)}"
        for name in [name for name, digest in self.model.versions.items() if digest == self.made_by[operation]]:
            self.make("remove", name)
        return ("add", version, self.made_by[operation])

    def versions(self):
        response = self.server.ask("GET", f"/v1/maps/{self.model.name}/versions", headers=self.headers)
        return {each["version"]: each["digest"] for each in response.json["versions"]}

    def perform_job(self, operation, version):
        """@return whether its job succeeded."""
        base, self.job = f"/v1/maps/{self.model.name}", None
        if operation == "import":
            method, path, body, kind = "PUT", f"{base}/versions/{version}", small_cloud(1), "application/vnd.pcd"
        else:
            made_from, judged_by = self.drives[operation]
            method, path, body, kind = "POST", f"{base}/rebuild", json.dumps({
                "drives": [made_from], "held_back": judged_by, "version": version, "new_frame": "short" in operation,
                "options": {"detector": "geometric"}}), "application/json"
        try:
            response = self.server.ask(method, path, body, {"Content-Type": kind, **self.headers}, timeout=ENDS_WITHIN_S)
        except OSError:
            return False
        if response.status != 202:
            expect(response.json and response.json.get("code"), operation, "was refused without words:", response.body)
            expect(response.status >= 500, operation, "was refused:", response.body)
            return False
        self.job = response.json["id"]
        return self.job_ends() == "succeeded"

    def job_ends(self):
        """@return how; nothing when the server does, or cannot go on."""
        end = time.monotonic() + ENDS_WITHIN_S
        while self.server.process.poll() is None:
            try:
                response = self.server.ask("GET", f"/v1/jobs/{self.job}", headers=self.headers)
            except OSError:
                continue
            expect(response.status in (200, 500), "job", self.job, "is answered", response.status, response.body[:300])
            found = response.json if response.status == 200 else {"status": None}
            if found["status"] in ("succeeded", "failed"):
                expect(found["status"] == "succeeded" or found["error"], "failed without words:", response.body)
                self.jobs[self.job] = found["status"]
                return found["status"]
            expect(found["status"] in (None, "enqueued", "processing"), "job", self.job, "is", found)
            # Then nothing can be kept before the next start.
            if "an earlier sync failed" in self.log.read_text()[self.log_begin:]:
                return None
            expect(time.monotonic() < end, "job", self.job, "does not end:", found, self.last_words())
            time.sleep(0.05)
        return None

    def check_jobs(self):
        """Each that was acknowledged is there, has ended as it was told, and has left nothing but what it said."""
        if self.job and self.job not in self.jobs:
            expect(self.job_ends(), "job", self.job, "has not ended after a start:", self.last_words())
        listed = self.listed_jobs()
        for job, status in self.jobs.items():
            found = listed.get(job)
            expect(found and found["status"] == status, "job", job, "had", status, found)
            expect(status != "succeeded" or found["result"], "job", job, "has lost its result")
        end = time.monotonic() + READY_WITHIN_S
        while left_of_jobs(self.store, self.jobs | self.refused_jobs()) and time.monotonic() < end:
            time.sleep(0.02)
        left = left_of_jobs(self.store, self.jobs | self.refused_jobs())
        expect(not left, "left of jobs:", left)

    def listed_jobs(self):
        """@return all that the server knows, by id."""
        jobs, place = {}, "/v1/jobs?limit=1000"
        while place:
            response = self.server.ask("GET", place, headers=self.headers)
            expect(response.status == 200, "jobs are answered", response.status, response.body[:300])
            jobs |= {each["id"]: each for each in response.json["jobs"]}
            place = response.json["next"] and f"/v1/jobs?limit=1000&before={response.json['next']}"
        return jobs

    def refused_jobs(self):
        """Jobs that were refused and show after the start all the same, as documented, by id with how they ended."""
        found = {}
        for folder in (self.store / "jobs").iterdir():
            if not folder.name.isdigit() or int(folder.name) in self.jobs:
                continue
            response = self.server.ask("GET", f"/v1/jobs/{folder.name}", headers=self.headers)
            if response.status == 200 and response.json["status"] in ("succeeded", "failed"):
                found[int(folder.name)] = response.json["status"]
        return found

    def command(self, *arguments):
        """Runs the command line under the injector. @return whether it did what it was asked for."""
        done = run(self.program, *arguments, env={**self.injector.environment, "PATH": "/usr/bin:/bin"})
        if done.returncode != 0:
            expect(done.returncode in (1, 3) and done.stderr.startswith("stillmap: "), arguments, done.returncode, done.stderr)
        return done.returncode == 0

    def perform(self, operation, change):
        """@return whether it was acknowledged."""
        if operation == "make a key":
            name = f"key {next(self.made)}"
            done = self.command("keys", "create", name, "--store", self.store, "--scope", "read")
            listed = run(self.program, "keys", "list", "--store", self.store).stdout
            expect(not done or name in listed, "a key is lost")
            return done
        if operation == "start":
            self.server.kill()
            self.server = Server(self.program, self.store, self.log, environment=self.injector.environment, options=UNBOUNDED)
            if self.server.listen():
                time.sleep(0.1)
                return True
            expect(self.server.end() == 1, "ended with", self.server.process.returncode, self.last_words())
            expect("stillmap: " in self.last_words(), "ended without words:", self.last_words())
            return False
        if operation in JOBS:
            return self.perform_job(operation, change[1])
        if operation == "add by command":
            return self.command("store", "add", self.store, self.model.name, change[1], self.package(change[2]).folder)
        if operation == "activate by command":
            return self.command("store", "activate", self.store, self.model.name, change[1])
        return 200 <= self.change(change) < 300

    # One trial

    def count(self, operation):
        """@return how many calls of each point the operation makes when nothing fails."""
        self.restart()
        change = self.prepare(operation)
        self.injector.arm()
        done = self.perform(operation, change)
        made, _ = self.injector.disarm()
        expect(done, operation, "failed without any fault:", self.last_words())
        self.settle(change, done)
        return made

    def fail(self, operation, point, error, n):
        """@return whether the operation came to the call."""
        self.now = f"{operation}, call {n} of {POINTS[point][0]}, {errno.errorcode.get(error, 'short')}"
        change = self.prepare(operation)
        self.injector.arm(point, error, n)
        done = self.perform(operation, change)
        _, failed = self.injector.disarm()
        if not failed:
            self.settle(change, done)
            return False
        ended = self.server.process.poll() is not None
        self.ends["done all the same" if done else "ended in words" if ended else "refused in words"] += 1
        # As it goes on, and as the next one finds it: what was not acknowledged may show only then.
        before = self.model
        self.settle(change, done)
        self.restart()
        self.check_jobs()
        self.model = self.model if done else before
        self.settle(None if done else change, done)
        if operation == "mend" and not done:
            self.make(*change)
        expect(not leftovers(self.store), "half packages:", leftovers(self.store))
        verified = run(self.program, "store", "verify", self.store)
        expect(verified.returncode == 0, "verify:", verified.stdout, verified.stderr)
        # Two versions may be one package: what was mended is noticed "within two seconds".
        self.check_pose(NOTICED_WITHIN_S if operation == "mend" else 0.0)
        return True

    def settle(self, change, done):
        """Compares the store with what was acknowledged; what was not may have happened or not."""
        if self.server.process.poll() is not None:
            expect("stillmap: " in self.last_words(), "the server ended without words:", self.last_words())
            self.restart()
        response = self.server.ask("GET", f"/v1/maps/{self.model.name}/versions", headers=self.headers)
        found = MapModel.facts_of(response.json) if response.status == 200 else None
        allowed = [] if change and done else [self.model]
        if change:
            allowed.append(self.model.after(change))
        for model in allowed:
            if found == model.facts():
                self.model = model
                return
        raise Wrong(f"the store holds {found}, expected {[model.facts() for model in allowed]}, {response.body[:300]}")

    def check_pose(self, within_s):
        if not self.model.active:
            return
        end = time.monotonic() + within_s
        while (response := self.localize()).status == 503 and time.monotonic() < end:
            time.sleep(0.05)
        expect(response.status == 200 and response.json["status"] == "ok", "no pose:", response.status, response.body[:300])
        expect(response.json["map"]["version"] == self.model.active, "served:", response.json["map"])

    def localize(self):
        return self.server.ask("POST", f"/v1/maps/{self.model.name}/localize?{LOCALIZE}", self.scan,
                               {"Content-Type": "application/octet-stream", **self.headers})


def sampled(trials, operations, count, seed):
    """Fails so many calls of all that there are, chosen by the seed. @return how many failed."""
    plan = [(operation, point, error, n) for operation in operations
            for point, made in enumerate(trials.count(operation)) for error in POINTS[point][1] for n in range(made)]
    chosen = random.Random(seed).sample(plan, min(count, len(plan)))
    print(f"{len(chosen)} of {len(plan)} calls", flush=True)
    return sum(trials.fail(*each) for each in chosen)


def part_of(text):
    """@return 2 and 3 of 2/3. Raises ValueError."""
    part, parts = map(int, text.split("/"))
    if not 1 <= part <= parts:
        raise ValueError(text)
    return part, parts


def every_one(trials, operations, part, parts):
    """Fails each call in each way, of every `parts` the `part`th. @return how many failed."""
    done = 0
    for operation, (point, (name, errors)) in itertools.product(operations, enumerate(POINTS)):
        for error in errors:
            failed = sum(1 for _ in itertools.takewhile(
                lambda n, call=(operation, point, error): trials.fail(*call, n), itertools.count(part - 1, parts)))
            done += failed
            print(f"{operation}, {name}, {errno.errorcode.get(error, 'short')}: {failed} calls" + (f" of part {part}" if parts > 1 else ""),
                  flush=True)
    return done


def main():
    parser = argparse.ArgumentParser(usage=__doc__)
    parser.add_argument("--program", required=True)
    parser.add_argument("--packages", required=True)
    parser.add_argument("--injector", required=True)
    parser.add_argument("--sample", type=int)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--part", type=part_of, default=(1, 1), metavar="K/N")
    parser.add_argument("--operation", choices=OPERATIONS, action="append")
    arguments = parser.parse_args()
    if arguments.sample and arguments.part != (1, 1):
        parser.error("found --part with --sample, expected one of them")
    operations = arguments.operation or [each for each in OPERATIONS if each not in JOBS]
    folder = pathlib.Path(tempfile.mkdtemp(prefix="faults-"))
    trials = Trials(arguments, folder)
    try:
        done = sampled(trials, operations, arguments.sample, arguments.seed) if arguments.sample else every_one(
            trials, operations, *arguments.part)
    except (Wrong, TimeoutError, OSError, subprocess.SubprocessError) as error:
        print(f"{trials.now}: {error}\nstore and log are in {folder}", file=sys.stderr)
        return 1
    finally:
        if trials.server.process.poll() is None:
            trials.server.kill()
    print(f"{done} calls failed, nothing was lost:", dict(trials.ends))
    shutil.rmtree(folder)
    return 0


if __name__ == "__main__":
    sys.exit(main())
