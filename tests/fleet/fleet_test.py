#!/usr/bin/env python3
"""A fleet on machines of its own (network namespaces): HAProxy, three servers, PostgreSQL with a synchronous standby, S3
(OpenStack Swift), and a Slurm cluster. Vehicles ask for poses, a map team changes maps and publishes versions, a map is
built by the cluster. Each engine is lost in turn. Prints for how long there was no pose and no change.

usage: fleet_test.py STILLMAP MAP DRIVE [--seconds N] [--overload N] [--only WORD] [--other STILLMAP]

MAP and DRIVE are those of sample_map.sh. Exit code 77: something that it needs is not installed, or this is not root.
What is asserted: no acknowledged change is lost; no answer is of an older version than one that its client has seen; no
pose is refused in the end, at least 99.9 % of them are there within a second, and all of them while PostgreSQL and S3
are both away; sealed sessions begin once and give the poses of a run without losses; maps that the cluster builds have
the digest of one process's.
"""

import argparse
import base64
import contextlib
import hashlib
import io
import json
import os
import pathlib
import shutil
import signal
import subprocess
import sys
import tarfile
import tempfile
import threading
import time

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "tests/soak"), str(ROOT / "server/clients/python/src")]
import network  # noqa: E402
import postgres_engine  # noqa: E402
import proxy_engine  # noqa: E402
import slurm_engine  # noqa: E402
import swift_engine  # noqa: E402
from serving import Server, ask  # noqa: E402
from stillmap_client import Client, Prior, Pose  # noqa: E402

NAMES = ("one", "two", "three")
POSE = "/v1/maps/town/localize?prior_t=0,0,0&prior_q=0,0,0,1"
SCAN = {"Content-Type": "application/octet-stream"}
#: Ask another server, or again.
PASSING = (429, 500, 502, 503, 504, 507)


class Fleet:
    def __init__(self, arguments, folder, net):
        self.arguments, self.folder, self.net = arguments, folder, net
        self.environment = {"AWS_ACCESS_KEY_ID": swift_engine.ACCESS_KEY, "AWS_SECRET_ACCESS_KEY": swift_engine.SECRET_KEY,
                            "STILLMAP_SERVE_QUOTAS_DISK_RESERVE_BYTES": str(16 << 20)}
        self.servers = dict.fromkeys(NAMES)
        self.key = ""

    def store(self, name):
        return self.folder / f"store-{name}"

    def log(self, name):
        return (self.folder / f"log-{name}").read_text()[-3000:]

    def begin(self, stack):
        """Starts all of it."""
        self.postgres = postgres_engine.PostgresPair(self.folder / "postgres", self.net, ["db1", "db2"])
        stack.callback(self.postgres.stop)
        self.swift = stack.enter_context(swift_engine.Swift(
            self.folder / "swift", self.net.address("s3"), 6600, self.net.prefix("s3")))
        status, body = self.swift.ask("PUT", "/maps")
        assert status == 200, body
        stack.callback(self.stop_servers)
        for name in NAMES:
            self.store(name).mkdir()
        # A disk that can be filled.
        subprocess.run(["mount", "-t", "tmpfs", "-o", "size=192m", "tmpfs", self.store("two")], check=True)
        stack.callback(lambda: subprocess.run(["umount", "-l", self.store("two")], check=False))
        if self.arguments.other:
            self.before_shared_seal_keys()
        self.stillmap("store", "attach", self.store("one"), self.postgres.address)
        self.key = self.stillmap("keys", "create", "team", "--store", self.store("one"), "--scope", "read", "--scope",
                                 "localize", "--scope", "write").strip()
        for name in NAMES:
            self.start(name)
        self.slurm = None
        if not slurm_engine.missing():
            self.slurm = stack.enter_context(slurm_engine.Slurm(self.folder / "slurm"))
        self.proxy = proxy_engine.Proxy(
            self.folder / "proxy", {name: (self.net.address(name), 8080, 8081) for name in NAMES},
            host=self.net.address("proxy"), prefix=self.net.prefix("proxy"))
        stack.callback(self.proxy.stop)

    def before_shared_seal_keys(self):
        """Servers of a program that looks for the key of sealed sessions in its folder have the same one there."""
        key = os.urandom(32).hex()
        for name in NAMES:
            (self.store(name) / "seal.keys").write_text(key + "\n")

    def start(self, name):
        address = self.net.address(name)
        program = self.arguments.other if self.arguments.other and name == "three" else self.arguments.stillmap
        server = Server(program, self.store(name), self.folder / f"log-{name}",
                        prefix=self.net.prefix(name), environment=self.environment, port=8080, host=address,
                        options=["--host", address, "--allow-remote", "--management-host", address,
                                 "--management-port", "8081", "--state", self.postgres.address, "--blobs",
                                 "s3://maps/fleet", "--s3-endpoint", self.swift.endpoint, "--workers", "1",
                                 # Sealed sessions stay in the first one.
                                 "--retention-versions", "0"])
        self.servers[name] = server
        assert server.listen(), self.log(name)

    def stop_servers(self):
        for server in self.servers.values():
            if server is not None and server.process.poll() is None:
                server.kill()

    def stillmap(self, *words):
        done = subprocess.run([self.arguments.stillmap, *map(str, words)], capture_output=True, text=True, check=False,
                              timeout=120, env=os.environ | self.environment)
        assert done.returncode == 0, done.stderr
        return done.stdout

    def restart(self, name):
        self.start(name)
        self.wait_ready(name)

    def wait_ready(self, name, seconds=60):
        end = time.monotonic() + seconds
        while True:
            with contextlib.suppress(OSError):
                answer = ask(self.net.address(name), 8080, "GET", "/v1/maps/town", headers=self.headers())
                if answer.status == 200 and answer.json["state"] == "ready":
                    return
            assert time.monotonic() < end, self.log(name)
            time.sleep(0.05)

    def headers(self, *others):
        return {"Authorization": f"Bearer {self.key}"} | {key: value for each in others for key, value in each.items()}

    def ask_any(self, first, method, path, body=None, headers=None, seconds=30, timeout=5):
        """As a client of several servers does: the next one after a lost connection or a refusal."""
        end = time.monotonic() + seconds
        for i in range(first, first + 1000000):
            with contextlib.suppress(OSError):
                answer = ask(self.net.address(NAMES[i % 3]), 8080, method, path, body, self.headers(headers or {}), timeout)
                if answer.status not in PASSING:
                    return answer
            if time.monotonic() > end:
                raise AssertionError(f"{method} {path}: no answer within {seconds} s")
            if i % 3 == (first + 2) % 3:
                time.sleep(0.02)

    def ask_proxy(self, method, path, body=None, headers=None, seconds=30, timeout=5):
        """As a client of one address does. @return the answer, and after how many tries."""
        end = time.monotonic() + seconds
        tries = 0
        while True:
            tries += 1
            with contextlib.suppress(OSError):
                answer = ask(self.proxy.host, self.proxy.port, method, path, body, self.headers(headers or {}), timeout,
                             self.proxy.tls)
                if answer.status not in PASSING:
                    return answer, tries
            if time.monotonic() > end:
                raise AssertionError(f"{method} {path} by the proxy: no answer within {seconds} s")
            time.sleep(0.02)


class Worker(threading.Thread):
    """Does one thing after the other until it is told to end; keeps when each was done."""

    def __init__(self, pause_s):
        super().__init__(daemon=True)
        self.pause_s, self.ended, self.failures, self.done = pause_s, threading.Event(), [], []

    def run(self):
        count = 0
        while not self.ended.wait(self.pause_s):
            count += 1
            begin = time.monotonic()
            try:
                if self.once(count):
                    self.done.append((begin, time.monotonic()))
            except Exception as error:  # noqa: BLE001 what fails is told at the end
                self.failures.append(f"{type(error).__name__}: {error}")

    def end(self):
        self.ended.set()
        self.join(60)

    def within(self, begin, end):
        """@return how many were done, the longest and how many took more than a second, the longest time without any."""
        done = [each for each in self.done if begin <= each[1] <= end]
        times = [begin] + [each[1] for each in done] + [end]
        gap = max(b - a for a, b in zip(times, times[1:]))
        took = [each[1] - each[0] for each in done]
        return len(done), max(took, default=0.0), sum(each > 1.0 for each in took), gap


class Vehicle(Worker):
    """Asks for poses without a session."""

    def __init__(self, fleet, scan, by_proxy):
        super().__init__(0.03)
        self.fleet, self.scan, self.by_proxy = fleet, scan, by_proxy
        self.revision, self.newest, self.older, self.versions, self.again = "", 0, 0, set(), 0

    def once(self, count):
        headers = SCAN | ({"Stillmap-Revision": self.revision} if self.revision else {})
        if self.by_proxy:
            answer, tries = self.fleet.ask_proxy("POST", POSE, self.scan, headers)
            self.again += tries > 1
        else:
            answer = self.fleet.ask_any(count, "POST", POSE, self.scan, headers)
        assert answer.status == 200 and answer.json["pose"] is not None, answer.body[:500]
        version = answer.json["map"]["version"]
        number = int(version[1:])
        self.older += number < self.newest
        self.newest = max(self.newest, number)
        self.versions.add(version)
        self.revision = str(max(int(self.revision or 0), int(answer.headers.get("Stillmap-Revision", 0))))
        return True


class SealedVehicle(Worker):
    """Drives along the scans of the drive again and again, each time with a new session whose seals go to any server."""

    def __init__(self, fleet, drive):
        super().__init__(0.05)
        self.scans = [each.read_bytes() for each in sorted((drive / "velodyne").glob("*.bin"))[:20]]
        self.stamps = [round(1e9 * float(line)) for line in (drive / "times.txt").read_text().split()][:len(self.scans)]
        self.clients = [Client(f"http://{fleet.net.address(name)}:8080", fleet.key, timeout_s=5.0, retries=40, thin=None)
                        for name in NAMES]
        self.session, self.at, self.begun, self.rounds = None, 0, 0, 0
        self.poses, self.differing = {}, 0

    def once(self, count):
        if self.session is None:
            self.session = self.clients[0].sealed_session(
                "town", version="v1", prior=Prior(Pose((0, 0, 0), (0, 0, 0, 1)), sigma=(0.5, 0.05)), others=self.clients[1:])
            self.at = 0
        answer = self.session.track(self.scans[self.at], self.stamps[self.at])
        pose = None if answer.pose is None else (answer.pose.position, answer.pose.quaternion)
        self.differing += self.poses.setdefault(self.at, pose) != pose
        self.at += 1
        if self.at == len(self.scans):
            self.begun += self.session.begun
            self.rounds += 1
            self.session = None
        return True


class Team(Worker):
    """Makes maps, and remembers what was acknowledged."""

    def __init__(self, fleet):
        super().__init__(0.1)
        self.fleet, self.acknowledged = fleet, []

    def once(self, count):
        try:
            answer = self.fleet.ask_any(count, "PUT", f"/v1/maps/m{count}", seconds=1)
        except AssertionError:
            return False
        if answer.status in (200, 201):
            self.acknowledged.append(f"m{count}")
        return answer.status in (200, 201)


class Builder(Worker):
    """Builds the map of the drive in the cluster, again and again."""

    OPTIONS = ["--threads", "1", "--detector", "geometric"]

    def __init__(self, fleet, drive):
        super().__init__(0.1)
        self.fleet, self.drive, self.digests = fleet, drive, []
        self.expected = self.build(fleet.folder / "whole")

    def build(self, package, *options):
        environment = self.fleet.slurm.environment if options else None
        done = subprocess.run([self.fleet.arguments.stillmap, "build", self.drive, "-o", package, *self.OPTIONS, *options],
                              capture_output=True, text=True, check=False, timeout=300, env=environment)
        assert done.returncode == 0, done.stderr[-2000:]
        return hashlib.sha256((package / "manifest.json").read_bytes()).hexdigest()

    def once(self, count):
        digest = self.build(self.fleet.folder / f"built-{count}", "--executor", "slurm", "--units", "3",
                            "--slurm-option=--mem=500M")
        assert digest == self.expected, f"build {count}: {digest}, of one process {self.expected}"
        self.digests.append(digest)
        return True


class Publisher(Worker):
    """Publishes a version and makes it active; every second one has all but a file of the one before."""

    def __init__(self, fleet, packages):
        super().__init__(2.0)
        self.fleet, self.packages, self.published, self.active = fleet, packages, [], [(1, "v1")]

    def once(self, count):
        name = f"v{count + 1}"
        body, headers = self.packages[count % 2]
        seconds = 120
        put = self.fleet.ask_any(count, "PUT", f"/v1/maps/town/versions/{name}", body, headers, seconds, timeout=30)
        assert put.status in (200, 201), put.body
        self.published.append(name)
        # What is active already stays so, and asking twice does no harm.
        active = self.fleet.ask_any(count, "POST", f"/v1/maps/town/versions/{name}/activate?new_frame=true", None, None,
                                    seconds, timeout=30)
        assert active.status == 200, active.body
        self.active.append((active.json["revision"], name))
        return True


def packages_of(folder, other):
    """The map, and another with the same content but for a word of its manifest, as bodies of requests."""
    shutil.copytree(folder, other)
    manifest = json.loads((other / "manifest.json").read_text())
    manifest["software_version"] = "0.0.1"
    (other / "manifest.json").write_text(json.dumps(manifest))
    bodies = []
    for each in (folder, other):
        packed = io.BytesIO()
        with tarfile.open(fileobj=packed, mode="w") as tar:
            for file in sorted(each.rglob("*")):
                if file.is_file():
                    tar.add(file, arcname=str(file.relative_to(each)))
        body = packed.getvalue()
        digest = base64.b64encode(hashlib.sha256(body).digest()).decode()
        bodies.append((body, {"Content-Type": "application/x-tar", "Content-Digest": f"sha-256=:{digest}:"}))
    return bodies


def losses(fleet):
    """(name, lose it, bring it back)."""
    net, swift, postgres = fleet.net, fleet.swift, fleet.postgres
    for name in NAMES:
        yield f"server {name}", lambda name=name: fleet.servers[name].kill(), lambda name=name: fleet.restart(name)
    yield "link of server three", lambda: net.cut("three"), lambda: net.mend("three")

    def fill():
        with contextlib.suppress(OSError), open(fleet.store("two") / "filler", "wb") as file:
            while True:
                file.write(bytes(1 << 20))

    yield "disk of server two (full)", fill, lambda: (fleet.store("two") / "filler").unlink()
    yield "HAProxy (reload)", fleet.proxy.reload, lambda: None
    yield "PostgreSQL, primary", lambda: postgres.primary.kill(), lambda: postgres.primary.start()
    yield "PostgreSQL, standby", lambda: postgres.standby.kill(), lambda: postgres.standby.start()
    yield "PostgreSQL, primary (hangs)", lambda: postgres.primary.freeze(), lambda: postgres.primary.thaw()
    yield "PostgreSQL, standby (hangs)", lambda: postgres.standby.freeze(), lambda: postgres.standby.thaw()
    yield "PostgreSQL, primary; standby promoted", postgres.fail_over, postgres.add_standby
    yield "link of PostgreSQL's primary", lambda: net.cut(postgres.names[0]), lambda: net.mend(postgres.names[0])
    yield "S3", lambda: swift.kill("proxy"), lambda: swift.restart("proxy")

    def both():
        postgres.primary.kill()
        swift.kill("proxy")

    def both_back():
        postgres.primary.start()
        swift.restart("proxy")

    yield "PostgreSQL and S3", both, both_back
    if fleet.slurm is None:
        return
    yield "slurmctld", lambda: fleet.slurm.kill("slurmctld"), fleet.slurm.start_controller

    def node():
        fleet.slurm.kill("n2")
        for daemon in fleet.slurm.step_daemons("n2"):
            os.kill(daemon, signal.SIGKILL)

    yield "a node of the cluster, with its jobs", node, lambda: fleet.slurm.start_node("n2")


def run_losses(fleet, vehicles, team):
    """@return a row for each loss."""
    rows = []
    print("| lost | poses | later than 1 s | slowest [s] | longest without a pose [s] | changes | longest without a change [s] |\n"
          "|---|---|---|---|---|---|---|")
    for name, lose, bring_back in losses(fleet):
        if fleet.arguments.only and fleet.arguments.only not in name:
            continue
        time.sleep(0.5)
        begin = time.monotonic()
        lose()
        time.sleep(fleet.arguments.seconds)
        back = time.monotonic()
        bring_back()
        end = time.monotonic() + 60
        while not any(done > back for _, done in team.done[-3:]):
            assert time.monotonic() < end, f"no change is taken after {name} is back"
            time.sleep(0.05)
        now = time.monotonic()
        figures = [vehicle.within(begin, now) for vehicle in vehicles]
        changes = team.within(begin, now)
        rows.append({"lost": name, "poses": sum(each[0] for each in figures), "late": sum(each[2] for each in figures),
                     "slowest_s": max(each[1] for each in figures), "pose_gap_s": max(each[3] for each in figures),
                     "changes": changes[0], "change_gap_s": changes[3]})
        row = rows[-1]
        print(f"| {name} | {row['poses']} | {row['late']} | {row['slowest_s']:.2f} | {row['pose_gap_s']:.2f} | {row['changes']} | "
              f"{row['change_gap_s']:.2f} |", flush=True)
        assert all(each[0] > 0 for each in figures), f"{name}: a vehicle had no pose"
    return rows


class Load(Worker):
    """One pose after the other by the proxy, without a second try."""

    def __init__(self, fleet, scan):
        super().__init__(0.0)
        self.fleet, self.scan, self.refused, self.without_retry_after, self.lost = fleet, scan, 0, 0, 0

    def once(self, count):
        try:
            answer = ask(self.fleet.proxy.host, self.fleet.proxy.port, "POST", POSE + "&deadline_ms=1000", self.scan,
                         self.fleet.headers(SCAN), 10, self.fleet.proxy.tls)
        except OSError:
            self.lost += 1
            return False
        if answer.status == 200:
            return True
        self.refused += 1
        self.without_retry_after += answer.status == 503 and "Retry-After" not in answer.headers
        time.sleep(0.05)
        return False


def overload(fleet, scan, seconds):
    """Goodput with as many clients as there are workers, and with three times as many while a server is lost."""
    def goodput(clients, during=lambda: None):
        workers = [Load(fleet, scan) for _ in range(clients)]
        for each in workers:
            each.start()
        time.sleep(1.0)
        begin = time.monotonic()
        during()
        time.sleep(seconds)
        end = time.monotonic()
        for each in workers:
            each.end()
        refused = sum(each.refused for each in workers)
        assert not sum(each.without_retry_after for each in workers), "503 without Retry-After"
        return sum(each.within(begin, end)[0] for each in workers) / (end - begin), refused, sum(each.lost for each in workers)

    peak = max(goodput(clients)[0] for clients in (3, 6))
    good, refused, lost = goodput(18, lambda: fleet.servers["one"].kill())
    fleet.restart("one")
    print(f"overload: {good:.1f} poses/s of {peak:.1f} ({100 * good / peak:.0f} %) with 18 clients while a server is lost; "
          f"{refused} refused, {lost} connections lost")
    return good / peak


def revoke(fleet):
    """@return seconds until no server takes a key that one of them revoked."""
    key = fleet.stillmap("keys", "create", "gone", "--store", fleet.store("one"), "--scope", "read").strip()
    listed = json.loads(fleet.stillmap("keys", "list", "--store", fleet.store("one"), "--json"))
    listed = listed["keys"] if isinstance(listed, dict) else listed
    number = next(each["id"] for each in listed if each["name"] == "gone")

    def status(name):
        return ask(fleet.net.address(name), 8080, "GET", "/v1/maps", headers={"Authorization": f"Bearer {key}"}).status

    end = time.monotonic() + 5
    while any(status(name) != 200 for name in NAMES):
        assert time.monotonic() < end, "a new key is not taken"
    fleet.stillmap("keys", "revoke", number, "--store", fleet.store("one"))
    begin = time.monotonic()
    while any(status(name) == 200 for name in NAMES):
        assert time.monotonic() < begin + 5, "a revoked key is taken after 5 s"
    return time.monotonic() - begin


def test(fleet):
    arguments = fleet.arguments
    packages = packages_of(arguments.map, fleet.folder / "other")
    put = fleet.ask_any(0, "PUT", "/v1/maps/town/versions/v1", packages[0][0], packages[0][1], timeout=30)
    assert put.status == 201, put.body
    active = fleet.ask_any(0, "POST", "/v1/maps/town/versions/v1/activate", timeout=30)
    assert active.status == 200, active.body
    for name in NAMES:
        fleet.wait_ready(name)
    scan = (arguments.drive / "velodyne" / "000001.bin").read_bytes()
    vehicles = [Vehicle(fleet, scan, False), Vehicle(fleet, scan, True)]
    sealed, team, publisher = SealedVehicle(fleet, arguments.drive), Team(fleet), Publisher(fleet, packages)
    # Without losses: what sealed sessions answer then.
    sealed.start()
    end = time.monotonic() + 60
    while sealed.rounds < 1:
        assert time.monotonic() < end and not sealed.failures, sealed.failures
        time.sleep(0.05)
    workers = [*vehicles, team, publisher]
    if fleet.slurm is not None:
        workers.append(Builder(fleet, arguments.drive))
    for each in workers:
        each.start()
    try:
        rows = run_losses(fleet, vehicles, team)
    finally:
        for each in [sealed, *workers]:
            each.end()
    for each in [*vehicles, sealed, *workers]:
        assert not each.failures, (type(each).__name__, each.failures[:3])
    check(fleet, rows, vehicles, sealed, team, publisher)
    if fleet.slurm is not None:
        print(f"{len(workers[-1].digests)} maps built by the cluster, all with the digest of one process's")
    print(f"a revoked key is refused everywhere after {revoke(fleet):.2f} s")
    if arguments.overload > 0:
        share = overload(fleet, scan, arguments.overload)
        assert share >= 0.8, f"goodput under overload is {share:.2f} of the peak"


def check(fleet, rows, vehicles, sealed, team, publisher):
    listed = {each["name"] for each in fleet.ask_any(0, "GET", "/v1/maps").json["maps"]}
    lost = [name for name in team.acknowledged if name not in listed]
    assert not lost, f"{len(lost)} of {len(team.acknowledged)} acknowledged maps are lost: {lost[:5]}"
    versions = {each["version"] for each in fleet.ask_any(0, "GET", "/v1/maps/town/versions").json["versions"]}
    lost = [name for name in publisher.published if name not in versions]
    assert not lost, f"acknowledged versions are lost: {lost}"
    town = fleet.ask_any(0, "GET", "/v1/maps/town").json
    assert (town["revision"], town["version"]) >= publisher.active[-1], (town["revision"], publisher.active[-1])
    older, answers = sum(each.older for each in vehicles), sum(len(each.done) for each in vehicles)
    # What is cut off without a word is noticed by time alone: by HAProxy after its checks, by PostgreSQL's clients later.
    kills = [each for each in rows if not each["lost"].startswith("link")]
    late = sum(each["late"] for each in kills)
    poses = sum(each["poses"] for each in kills)
    print(f"{len(team.acknowledged)} maps and {len(publisher.published)} versions acknowledged, none lost; of {answers} poses "
          f"{older} of an older version than one seen; by HAProxy {vehicles[1].again} of {len(vehicles[1].done)} needed a "
          f"second try; {sealed.rounds} sealed sessions of {len(sealed.scans)} scans: {sealed.begun - sealed.rounds} began "
          f"anew, {sealed.differing} poses differ")
    assert older == 0 or fleet.arguments.other
    assert sealed.begun == sealed.rounds and sealed.differing == 0
    both = [each for each in rows if each["lost"] == "PostgreSQL and S3"]
    assert all(each["late"] == 0 for each in both)
    assert late <= max(1, 0.001 * poses), f"{late} of {poses} poses were later than a second"


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("stillmap", type=pathlib.Path)
    parser.add_argument("map", type=pathlib.Path)
    parser.add_argument("drive", type=pathlib.Path)
    parser.add_argument("--seconds", type=float, default=2.0, help="how long each is away")
    parser.add_argument("--overload", type=float, default=0.0, help="seconds of overload; 0: none")
    parser.add_argument("--other", type=pathlib.Path, help="an older program, for server three")
    parser.add_argument("--only", default="", help="only what has this in its name is lost")
    arguments = parser.parse_args()
    arguments.stillmap = arguments.stillmap.resolve()
    arguments.other = arguments.other and arguments.other.resolve()
    why = network.missing() or proxy_engine.missing()
    if postgres_engine.is_missing() or swift_engine.missing():
        why = why or "PostgreSQL or Swift is not installed (`./dev fleet` installs them)"
    if why:
        print(f"skipped: {why}")
        sys.exit(77)
    folder = pathlib.Path(tempfile.mkdtemp())
    folder.chmod(0o755)
    with contextlib.ExitStack() as stack:
        stack.callback(lambda: shutil.rmtree(folder, ignore_errors=True))
        net = stack.enter_context(network.Network(["client", *NAMES, "db1", "db2", "s3", "proxy"]))
        fleet = Fleet(arguments, folder, net)
        fleet.begin(stack)
        test(fleet)


if __name__ == "__main__":
    main()
