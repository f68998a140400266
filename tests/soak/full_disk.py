#!/usr/bin/env python3
"""Fills a small disk of its own (an ext4 image on a loop device; needs root) and looks that keys are revoked and everything is
removed there all the same, by the server and by the command line, while poses are answered.

usage: full_disk.py --program STILLMAP --packages TINY_PACKAGES
"""

import argparse
import contextlib
import json
import os
import pathlib
import subprocess
import sys
import tempfile
import time

from serving import LOCALIZE, Server, make_packages, run

DISK_BYTES = 64 << 20
# What the documentation says of so small a disk.
RESERVE_SHARE = 0.1
READY_WITHIN_S = 20
SKIPPED = 77


def expect(condition, *what):
    if not condition:
        raise AssertionError(" ".join(map(str, what)))


@contextlib.contextmanager
def small_disk(folder):
    """A mounted file system. Yields its place, or None where this machine lets nobody mount one."""
    image, place = folder / "image", folder / "disk"
    place.mkdir()
    image.write_bytes(b"")
    os.truncate(image, DISK_BYTES)
    # Nothing is kept for root, who runs this test.
    subprocess.run(["mkfs.ext4", "-q", "-m", "0", image], check=True, timeout=60)
    if subprocess.run(["mount", "-o", "loop", image, place], capture_output=True, timeout=60).returncode != 0:
        yield None
        return
    try:
        yield place
    finally:
        subprocess.run(["umount", "-l", place], check=True, timeout=60)


class Life:
    def __init__(self, program, packages, scan, disk):
        self.program, self.packages, self.scan = program, packages, scan
        self.disk, self.store, self.filler = disk, disk / "store", disk / "filler"
        self.log = disk.parent / "server.log"
        self.server = None
        for version, package in enumerate(packages, 1):
            self.command("store", "add", self.store, "street", f"v{version}", package.folder)
        self.command("store", "activate", self.store, "street", "v1")
        self.admin = self.make_key("admin", "admin", "read", "localize", "write")
        self.writer = self.make_key("writer", "write")
        self.thief = self.make_key("thief", "localize")

    def command(self, *arguments):
        done = run(self.program, *arguments)
        expect(done.returncode == 0, arguments, done.returncode, done.stderr)
        return done.stdout.strip()

    def make_key(self, name, *allowed):
        given = [argument for scope in allowed for argument in ("--scope", scope)]
        return self.command("keys", "create", name, "--store", self.store, *given)

    def ask(self, method, path, body=None, key=None, kind="application/octet-stream"):
        return self.server.ask(method, path, body, {"Authorization": f"Bearer {key or self.admin}", "Content-Type": kind})

    def start(self):
        """With the ballast that a server makes while there is room."""
        self.filler.unlink(missing_ok=True)
        if self.server:
            expect(self.server.stop() == 0, "the server ended badly")
        self.server = Server(self.program, self.store, self.log)
        expect(self.server.listen(), "no server", self.log.read_text())
        self.server.wait_ready(READY_WITHIN_S)
        end = time.monotonic() + READY_WITHIN_S
        while not (self.store / ".ballast").exists():
            expect(time.monotonic() < end, "no ballast")
            time.sleep(0.01)

    def fill(self):
        with open(self.filler, "ab", buffering=0) as file:
            for size in (1 << 20, 4096, 512):
                with contextlib.suppress(OSError):
                    while True:
                        os.pwrite(file.fileno(), b"x" * size, os.fstat(file.fileno()).st_size)
                        os.fsync(file.fileno())
        # The log of the database may have some room of its own.
        for _ in range(5000):
            if self.ask("POST", "/v1/maps/street/drives", "{}", kind="application/json").status == 507:
                return
        expect(False, "rows find room still")

    def localizes(self, key=None):
        return self.ask("POST", f"/v1/maps/street/localize?{LOCALIZE}", self.scan, key).status

    def new_drive(self, parts=1):
        drive = self.ask("POST", "/v1/maps/street/drives", '{"name": "a"}', kind="application/json").json["id"]
        place = f"/v1/maps/street/drives/{drive}"
        for part in range(1, parts + 1):
            expect(self.ask("PUT", f"{place}/parts/{part}", b"x" * 4096).status == 201, "no part")
        return place


def uploads_keep_the_reserve(life):
    drive = life.new_drive()
    answers = [life.ask("PUT", f"{drive}/parts/{part}", os.urandom(4 << 20), life.writer) for part in range(2, 30)]
    statuses = {answer.status for answer in answers}
    expect(statuses == {201, 507}, statuses)
    expect(answers[-1].json["code"] == "DiskFull" and "remove versions or drives" in answers[-1].json["detail"], answers[-1].body)
    seen = os.statvfs(life.disk)
    expect(seen.f_bavail >= RESERVE_SHARE * seen.f_blocks, "only", seen.f_bavail, "of", seen.f_blocks, "blocks are free")
    expect(life.ask("DELETE", drive).status == 204, "the drive stays")


def removals(life):
    """Each on a disk that is full anew."""
    thief, writer = (key.split("_")[1] for key in (life.thief, life.writer))
    yield "DELETE of a drive", lambda place: expect(life.ask("DELETE", place).status == 204, place)
    yield "DELETE of a key", lambda _: expect(life.ask("DELETE", f"/v1/keys/{writer}").status == 200, writer)
    yield "keys revoke", lambda _: life.command("keys", "revoke", thief, "--store", life.store)
    yield "DELETE of a version", lambda _: expect(life.ask("DELETE", "/v1/maps/street/versions/v2").status == 204, "v2")
    yield "store remove", lambda _: life.command("store", "remove", life.store, "street", "v3")
    yield "store gc", lambda _: life.command("store", "gc", life.store, "--keep", "0")


def lives_on_a_full_disk(life):
    for what, remove in list(removals(life)):
        life.start()
        place = life.new_drive()
        life.fill()
        began = life.ask("PUT", f"{place}/parts/9", b"x" * 9000)
        expect(began.status == 507, "a part was taken of a full disk:", began.status)
        expect(life.localizes() == 200, "no pose on a full disk")
        expect("reserve" in json.dumps(life.ask("GET", "/readyz").json["reasons"]), "/readyz does not name the disk")
        try:
            remove(place)
        except AssertionError as error:
            raise AssertionError(f"{what} on a full disk: {error}\n{life.log.read_text()[-3000:]}") from None
        expect(life.localizes() == 200, "no pose after", what)
        if what.startswith("DELETE"):
            row = life.ask("GET", "/v1/audit?limit=1").json["records"][0]
            expect(row["method"] == "DELETE" and row["status"] < 300, what, "is not in the audit log:", row)
        print(f"{what}: done")
    expect(life.localizes(life.thief) == 401, "a revoked key is good")
    life.start()
    expect(life.localizes(life.thief) == 401, "a revoked key is good after a restart")
    versions = life.ask("GET", "/v1/maps/street/versions").json["versions"]
    expect([version["version"] for version in versions] == ["v1"], versions)
    life.server.stop()
    life.command("store", "verify", life.store)


def main():
    parser = argparse.ArgumentParser(usage=__doc__)
    parser.add_argument("--program", required=True)
    parser.add_argument("--packages", required=True)
    arguments = parser.parse_args()
    if os.geteuid() != 0:
        print("needs root")
        return SKIPPED
    os.environ.pop("STILLMAP_SERVE_QUOTAS_DISK_RESERVE_BYTES", None)  # the reserve of a server that is told nothing
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        (folder / "packages").mkdir()
        packages, scan = make_packages(arguments.packages, folder / "packages", 4)
        with small_disk(folder) as disk:
            if disk is None:
                print("this machine mounts no image")
                return SKIPPED
            life = Life(arguments.program, packages, scan, disk)
            try:
                life.start()
                uploads_keep_the_reserve(life)
                lives_on_a_full_disk(life)
            finally:
                if life.server and life.server.process.poll() is None:
                    life.server.kill()
    return 0


if __name__ == "__main__":
    sys.exit(main())
