#!/usr/bin/env python3
"""Three servers of one folder, with their state in PostgreSQL, behind HAProxy as haproxy_config.py configures it. While
vehicles and a map team ask through the proxy without trying again, servers are killed and drained, and HAProxy is
reloaded. Prints how many requests were answered.

usage: proxy_test.py STILLMAP MAP DRIVE TOOLS [--seconds N]

MAP and DRIVE are those of sample_map.sh; TOOLS: packages as `./dev test` unpacks them. Exit code 77: PostgreSQL, HAProxy
or numpy is missing.
"""

import argparse
import concurrent.futures
import http.client
import json
import pathlib
import shutil
import signal
import socket
import ssl
import subprocess
import sys
import tempfile
import threading
import time

HERE = pathlib.Path(__file__).resolve().parent
for folder in (HERE.parent / "soak", HERE.parent / "deploy", HERE.parents[1] / "server/clients/python/src"):
    sys.path.insert(0, str(folder))
import postgres_engine  # noqa: E402
import support  # noqa: E402
from serving import Server, run  # noqa: E402

POSE = "/v1/maps/town/localize?prior_t=0,0,0&prior_q=0,0,0,1"
NAMES = ("a", "b", "c")
VEHICLES = 4


def compact_scan(drive):
    import numpy as np
    from stillmap_client import thinning
    points = np.fromfile(drive / "velodyne" / "000001.bin", "<f4").reshape(-1, 4)
    return thinning.thin_scan(points, "compact")


class Fleet:
    def __init__(self, arguments, folder, state):
        self.arguments, self.folder, self.state = arguments, folder, state
        self.store = folder / "store"
        self.ports = {name: (support.free_port(), support.free_port()) for name in NAMES}
        self.servers, self.proxy, self.other_proxy = {}, None, None
        self.port, self.other_port = support.free_port(), support.free_port()
        self.context = ssl.create_default_context()
        self.context.check_hostname, self.context.verify_mode = False, ssl.CERT_NONE

    def start(self, name):
        port, management = self.ports[name]
        server = Server(self.arguments.stillmap, self.store, self.folder / f"log-{name}", port=port,
                        options=["--state", self.state, "--workers", "1", "--management-port", str(management)])
        assert server.listen(), (self.folder / f"log-{name}").read_text()[-2000:]
        self.servers[name] = server
        server.wait_ready(60)

    def start_proxy(self):
        certificate, key = self.folder / "certificate.pem", self.folder / "key.pem"
        subprocess.run(["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes",
                        "-days", "1", "-subj", "/CN=localhost", "-keyout", key, "-out", certificate], check=True,
                       capture_output=True)
        (self.folder / "both.pem").write_text(certificate.read_text() + key.read_text())
        self.log = open(self.folder / "log-proxy", "w")
        peers = [f"{name}=127.0.0.1:{support.free_port()}" for name in ("this", "other")]
        self.proxy = self.proxy_process(self.folder, self.port, peers)
        # Another one, as in another zone. Most is asked through the first.
        (self.folder / "other").mkdir()
        shutil.copy(self.folder / "both.pem", self.folder / "other")
        self.other_proxy = self.proxy_process(self.folder / "other", self.other_port, peers[::-1])
        self.wait_state(dict.fromkeys(NAMES, "UP"))

    def proxy_process(self, folder, port, peers):
        servers = [f"{name}=127.0.0.1:{port}:{management}" for name, (port, management) in self.ports.items()]
        config = folder / "haproxy.cfg"
        config.write_text(support.haproxy_config(folder, port, servers, "--shared-state", "--shared-folder", "--local-peer",
                                                 peers[0], "--peer", peers[1]))
        return subprocess.Popen([support.tool("haproxy", self.arguments.tools), "-W", "-db", "-S", folder / "master.sock", "-f",
                                 config], stdout=self.log, stderr=self.log, env=support.tool_environment(self.arguments.tools))

    def command(self, line):
        """As an operator gives it by socat."""
        with socket.socket(socket.AF_UNIX) as control:
            control.connect(str(self.folder / "admin.sock"))
            control.sendall(line.encode() + b"\n")
            return b"".join(iter(lambda: control.recv(65536), b"")).decode()

    def statistics(self, backend):
        """Rows of the servers of a backend by name."""
        header, *lines = self.command("show stat").splitlines()
        rows = [dict(zip(header.lstrip("# ").split(","), line.split(","))) for line in lines if line]
        return {row["svname"]: row for row in rows if row["pxname"] == backend and row["svname"] in NAMES}

    def wait_state(self, wanted, backend="poses"):
        def is_so():
            try:
                rows = self.statistics(backend)
            except OSError:
                return False
            return all(rows[name]["status"].startswith(status) for name, status in wanted.items())
        support.wait(is_so, 60)

    def reload(self):
        before = self.command("show info")
        self.proxy.send_signal(signal.SIGUSR2)

        def is_other():
            try:
                return self.command("show info").split("Pid:")[1].split()[0] != before.split("Pid:")[1].split()[0]
            except OSError:
                return False
        support.wait(is_other, 30)

    def connection(self, port=None):
        return http.client.HTTPSConnection("127.0.0.1", port or self.port, timeout=30, context=self.context)

    def ask(self, method, path, body=None, port=None, **headers):
        connection = self.connection(port)
        try:
            connection.request(method, path, body, headers)
            answer = connection.getresponse()
            return answer.status, answer.read(), answer
        finally:
            connection.close()

    def end(self):
        for server in self.servers.values():
            if server.process.poll() is None:
                server.kill()
        for proxy in filter(None, (self.proxy, self.other_proxy)):
            proxy.terminate()
            proxy.wait(30)


class Client(threading.Thread):
    """Asks one request after the other on a connection that it keeps, and never asks again."""

    def __init__(self, fleet, request):
        super().__init__()
        self.fleet, self.request, self.ended = fleet, request, False
        self.statuses, self.slowest_s = [], 0.0

    def run(self):
        connection, count = self.fleet.connection(), 0
        while not self.ended:
            count += 1
            begin = time.monotonic()
            try:
                connection.request(*self.request(count))
                answer = connection.getresponse()
                text = answer.read()
                self.statuses.append(answer.status if answer.status < 300 else f"{answer.status} {text[:300]!r}")
            except (OSError, http.client.HTTPException) as error:
                connection.close()
                self.statuses.append(repr(error))
            self.slowest_s = max(self.slowest_s, time.monotonic() - begin)
        connection.close()


class Load:
    """Vehicles, readers and a map team."""

    def __init__(self, fleet, scan, name):
        self.name = name

        def pose(vehicle):
            return lambda count: ("POST", POSE, scan, {"Content-Type": "application/vnd.stillmap.scan",
                                                       "Stillmap-Region": f"{vehicle},{count // 20}"})
        self.poses = [Client(fleet, pose(vehicle)) for vehicle in range(VEHICLES)]
        self.reads = [Client(fleet, lambda count: ("GET", "/v1/maps/town", None, {}))]
        self.changes = [Client(fleet, lambda count: ("PUT", f"/v1/maps/{name}-{count}", b"", {}))]

    def __enter__(self):
        for client in self.all():
            client.start()
        time.sleep(1.0)
        return self

    def all(self):
        return [*self.poses, *self.reads, *self.changes]

    def __exit__(self, *_):
        for client in self.all():
            client.ended = True
        for client in self.all():
            client.join()
        for kind in ("poses", "reads", "changes"):
            clients = getattr(self, kind)
            statuses = [status for client in clients for status in client.statuses]
            good = sum(status in (200, 201) for status in statuses)
            print(f"{self.name} | {kind} | {good} of {len(statuses)} | {max(client.slowest_s for client in clients):.2f} s", flush=True)

    def failures(self, clients):
        return [status for client in clients for status in client.statuses if status not in (200, 201)]


def test_kill(fleet, scan):
    with Load(fleet, scan, "killed") as load:
        for name in NAMES:
            fleet.servers[name].kill()
            time.sleep(fleet.arguments.seconds)
            fleet.start(name)
            fleet.wait_state({name: "UP"})
    assert not load.failures(load.poses), load.failures(load.poses)[:3]
    # What read nothing is not asked twice after a lost answer: a change may be lost with its server, once each time.
    assert not load.failures(load.reads), load.failures(load.reads)[:3]
    assert len(load.failures(load.changes)) <= len(NAMES), load.failures(load.changes)


def test_drain(fleet, scan):
    with Load(fleet, scan, "drained") as load:
        for name in NAMES:
            assert fleet.command(f"set server poses/{name} state drain").strip() == ""
            for backend in ("poses", "maps", "sessions"):
                fleet.wait_state({name: "DRAIN"}, backend)
            support.wait(lambda: all(row[name]["scur"] == "0" for row in map(fleet.statistics, ("poses", "maps"))), 20)
            before = fleet.statistics("poses")[name]["stot"]
            time.sleep(1.0)
            assert fleet.statistics("poses")[name]["stot"] == before, f"{name} is asked although it is drained"
            assert fleet.servers[name].stop() == 0
            fleet.start(name)
            fleet.wait_state({name: "DRAIN"})
            fleet.command(f"set server poses/{name} state ready")
            fleet.wait_state({name: "UP"})
    assert not load.failures(load.all()), load.failures(load.all())[:3]


def test_stop_without_drain(fleet, scan):
    """The server's own way to end: it answers what it has, and connections that come later are not taken."""
    with Load(fleet, scan, "stopped") as load:
        for name in NAMES:
            assert fleet.servers[name].stop() == 0
            time.sleep(fleet.arguments.seconds)
            fleet.start(name)
            fleet.wait_state({name: "UP"})
    assert not load.failures(load.all()), load.failures(load.all())[:3]


def test_reload(fleet, scan):
    """Comes late: a proxy that has just started tells the next one of sessions only after some 10 s."""
    status, text, _ = fleet.ask("POST", "/v1/sessions", b'{"map": "town"}', **{"Content-Type": "application/json"})
    assert status == 201, text
    session = "/v1/sessions/" + json.loads(text)["id"]
    with Load(fleet, scan, "reloaded") as load:
        for _ in range(3):
            fleet.reload()
            time.sleep(1.0)
            # So many that another server would be asked if the new process did not know where the session is.
            assert [fleet.ask("GET", session)[0] for _ in range(6)] == [200] * 6
    assert [fleet.ask("GET", session, port=fleet.other_port)[0] for _ in range(6)] == [200] * 6
    assert not load.failures(load.all()), load.failures(load.all())[:3]


def test_hash(fleet, scan):
    def asked_of(requests, at_once):
        before = {name: int(row["stot"]) for name, row in fleet.statistics("poses").items()}
        with concurrent.futures.ThreadPoolExecutor(at_once) as pool:
            statuses = set(pool.map(lambda headers: fleet.ask("POST", POSE, scan, **{
                "Content-Type": "application/vnd.stillmap.scan", **headers})[0], requests))
        assert statuses == {200}, statuses
        after = {name: int(row["stot"]) for name, row in fleet.statistics("poses").items()}
        return {name: after[name] - before[name] for name in NAMES if after[name] > before[name]}

    by_region = [asked_of([{"Stillmap-Region": f"{region},0"}] * 6, 1) for region in range(8)]
    # A request that came while the one before was ending goes elsewhere: that is the bound of the load.
    assert all(max(servers.values()) >= 5 for servers in by_region), by_region
    assert len({name for servers in by_region for name in servers}) > 1, by_region
    spilt = asked_of([{"Stillmap-Region": "0,0"}] * 60, 8)
    print(f"one region, one request at a time: {by_region[0]}; 8 at a time: {spilt}")
    assert len(spilt) > 1, spilt


def test_backup(fleet, scan):
    """Both ways of docs/scale.md: what was acknowledged is there, and the pose is the same."""
    def found(server):
        pose = server.ask("POST", POSE, scan, {"Content-Type": "application/vnd.stillmap.scan"}).json
        return pose["pose"], sorted(each["name"] for each in server.ask("GET", "/v1/maps").json["maps"])

    def served(store, *options):
        server = Server(fleet.arguments.stillmap, store, fleet.folder / "log-restored", options=options)
        assert server.listen(), (fleet.folder / "log-restored").read_text()[-2000:]
        try:
            server.wait_ready(60)
            return found(server)
        finally:
            server.stop()

    def call(program, *words):
        done = run(program, *words)
        assert done.returncode == 0, f"{words}: {done.stderr}"

    before = found(fleet.servers["a"])
    (bin_folder,) = list(pathlib.Path("/usr/lib/postgresql").glob("*/bin"))[:1] or [None]
    call(bin_folder / "psql", fleet.state, "-c", "CREATE DATABASE again")
    call(bin_folder / "psql", fleet.state, "-c", "CREATE DATABASE other")
    again, other = (fleet.state.replace("/postgres?", f"/{name}?") for name in ("again", "other"))
    # The backup that every store has.
    stillmap = fleet.arguments.stillmap
    call(stillmap, "store", "backup", fleet.store, "-o", fleet.folder / "backup")
    call(stillmap, "store", "restore", fleet.folder / "backup", "-o", fleet.folder / "restored")
    call(stillmap, "store", "copy", fleet.folder / "restored", "--to", again)
    assert served(fleet.folder / "restored") == before
    # PostgreSQL's own, and the packages.
    call(bin_folder / "pg_dump", fleet.state, "-n", "stillmap", "-Fc", "-f", fleet.folder / "state.dump")
    call(bin_folder / "pg_restore", "-d", other, fleet.folder / "state.dump")
    call(stillmap, "store", "attach", fleet.folder / "by-dump", other)
    shutil.copytree(fleet.store / "packages", fleet.folder / "by-dump" / "packages", dirs_exist_ok=True)
    call(stillmap, "store", "verify", fleet.folder / "by-dump")
    assert served(fleet.folder / "by-dump") == before


def test(fleet):
    assert run(fleet.arguments.stillmap, "store", "add", fleet.store, "town", "v1", fleet.arguments.map,
               "--activate").returncode == 0
    for name in NAMES:
        fleet.start(name)
    fleet.start_proxy()
    scan = compact_scan(fleet.arguments.drive)
    print("servers or proxy | requests | answered | slowest")
    for each in (test_hash, test_kill, test_drain, test_stop_without_drain, test_reload, test_backup):
        each(fleet, scan)


def attach(arguments, folder, address):
    end = time.monotonic() + 60
    while True:  # until PostgreSQL answers
        done = run(arguments.stillmap, "store", "attach", folder / "store", address)
        if done.returncode == 0:
            return
        assert time.monotonic() < end, done.stderr
        time.sleep(0.2)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    for name in ("stillmap", "map", "drive", "tools"):
        parser.add_argument(name, type=pathlib.Path)
    parser.add_argument("--seconds", type=float, default=3.0, help="how long each is away")
    arguments = parser.parse_args()
    support.tool("haproxy", arguments.tools)
    try:
        import numpy  # noqa: F401
    except ImportError:
        support.skip_program("python3-numpy is not installed")
    if postgres_engine.is_missing():
        support.skip_program("PostgreSQL is not installed")
    folder = pathlib.Path(tempfile.mkdtemp())
    folder.chmod(0o755)
    try:
        postgres = postgres_engine.Postgres(folder / "postgres")
        fleet = Fleet(arguments, folder, postgres.address)
        try:
            fleet.store.mkdir()
            attach(arguments, folder, postgres.address)
            test(fleet)
        except BaseException:
            print((folder / "log-proxy").read_text()[-3000:] if (folder / "log-proxy").exists() else "", file=sys.stderr)
            raise
        finally:
            fleet.end()
            postgres.kill()
    finally:
        shutil.rmtree(folder, ignore_errors=True)


if __name__ == "__main__":
    main()
