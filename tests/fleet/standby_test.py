#!/usr/bin/env python3
"""What server/docs/runbooks.md says of PostgreSQL, done: a primary and two standbys of which one must have each change.
One standby is lost, then the other hangs, then both are lost, then the primary hangs for good, and a standby is promoted.
A vehicle asks for poses all the time.

usage: standby_test.py STILLMAP MAP DRIVE

MAP and DRIVE are those of sample_map.sh. Exit code 77: PostgreSQL is not installed, or this is not root.
"""

import argparse
import os
import pathlib
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time

HERE = pathlib.Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent / "soak"), str(HERE.parent / "deploy")]
import support  # noqa: E402
from postgres_engine import signal_all  # noqa: E402
from serving import Server, run  # noqa: E402

POSE = "/v1/maps/town/localize?prior_t=0,0,0&prior_q=0,0,0,1"
# PostgreSQL does not run as root.
AS = ["setpriv", "--reuid", "nobody", "--regid", "nogroup", "--clear-groups", "--pdeathsig", "SIGQUIT"]


class Cluster:
    def __init__(self, folder, programs):
        self.folder, self.programs = folder, programs
        self.ports = {name: support.free_port() for name in ("one", "two", "three")}
        self.processes = {}
        self.call("initdb", "-D", folder / "one", "-A", "trust", "-U", "postgres", "--no-sync", "-E", "UTF8", "--locale", "C")
        with open(folder / "one" / "postgresql.conf", "a") as config:
            config.write(f"listen_addresses='127.0.0.1'\nunix_socket_directories='{folder}'\nwal_level=replica\nhot_standby=on\n"
                         "fsync=off\nmax_wal_size=256MB\n")
        self.start("one")
        for name in ("two", "three"):
            self.call("pg_basebackup", "-D", folder / name, "-R", "-X", "stream", "-C", "-S", name, "--checkpoint=fast", "-d",
                      f"host=127.0.0.1 port={self.ports['one']} user=postgres application_name={name}")
            self.start(name)

    def call(self, program, *words):
        done = subprocess.run([*AS, self.programs / program, *map(str, words)], capture_output=True, text=True, cwd=self.folder)
        assert done.returncode == 0, f"{program}: {done.stderr}"
        return done.stdout.strip()

    def start(self, name):
        (self.folder / name / "postmaster.pid").unlink(missing_ok=True)
        self.processes[name] = subprocess.Popen(
            [*AS, self.programs / "postgres", "-D", self.folder / name, "-p", str(self.ports[name])], cwd=self.folder,
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True)
        end = time.monotonic() + 60
        while True:
            try:
                return self.sql(name, "SELECT 1")
            except AssertionError:
                assert time.monotonic() < end
                time.sleep(0.1)

    def sql(self, name, text):
        return self.call("psql", f"postgres://postgres@127.0.0.1:{self.ports[name]}/postgres", "-Atc", text)

    def wait(self, name, text, wanted):
        support.wait(lambda: self.sql(name, text) == wanted, 30)

    def timers(self, name):
        """Of its connections, as the system has them."""
        return subprocess.run(["ss", "-Htno", f"sport = :{self.ports[name]}"], capture_output=True, text=True, check=True).stdout

    def kill(self, name):
        signal_all(self.processes[name], signal.SIGKILL)
        self.processes[name].wait()

    def end(self):
        for process in self.processes.values():
            if process.poll() is None:
                signal_all(process, signal.SIGCONT)
                process.send_signal(signal.SIGQUIT)
                process.wait(30)

    @property
    def address(self):
        return "postgres://postgres@" + ",".join(f"127.0.0.1:{port}" for port in self.ports.values()) + "/postgres"


class Vehicle(threading.Thread):
    def __init__(self, server, scan):
        super().__init__()
        self.server, self.scan, self.ended, self.statuses, self.slowest_s = server, scan, False, [], 0.0

    def run(self):
        while not self.ended:
            begin = time.monotonic()
            self.statuses.append(self.server.ask("POST", POSE, self.scan, {"Content-Type": "application/octet-stream"}).status)
            self.slowest_s = max(self.slowest_s, time.monotonic() - begin)


def test(cluster, server, log):
    made, count = [], 0

    def put(name):
        return server.ask("PUT", f"/v1/maps/{name}", timeout=60).status

    def change():
        nonlocal count
        count += 1
        status = put(f"m{count}")
        if status == 201:
            made.append(f"m{count}")
        return status

    streaming = "SELECT count(*) FROM pg_stat_replication WHERE state = 'streaming'"
    cluster.wait("one", streaming, "2")
    cluster.sql("one", "ALTER SYSTEM SET synchronous_standby_names = 'ANY 1 (two, three)'")
    cluster.sql("one", "SELECT pg_reload_conf()")
    cluster.wait("one", "SELECT count(*) FROM pg_stat_replication WHERE sync_state = 'quorum'", "2")
    assert change() == 201
    cluster.kill("two")
    cluster.wait("one", streaming, "1")
    assert change() == 201, "one standby is enough"
    assert re.search(r"keepalive,[\d.]+m?s", cluster.timers("one")), "a machine that was cut off holds its locks for hours"
    signal_all(cluster.processes["three"], signal.SIGSTOP)
    assert change() == 503
    assert put(f"m{count}") == 503, "no standby has it"
    assert server.ask("GET", "/v1/maps", timeout=5).status == 200
    signal_all(cluster.processes["three"], signal.SIGCONT)
    support.wait(lambda: change() == 201, 30)
    cluster.kill("three")
    cluster.wait("one", streaming, "0")
    assert change() == 503
    assert "its synchronous standby is away" in log.read_text()
    cluster.start("two")
    cluster.wait("one", streaming, "1")
    support.wait(lambda: change() == 201, 30)
    signal_all(cluster.processes["one"], signal.SIGSTOP)
    assert change() == 503
    support.wait(lambda: "is away" in server.ask("GET", "/readyz").body.decode(), 30)
    assert server.ask("GET", "/v1/maps", timeout=5).status == 503
    begin = time.monotonic()
    cluster.call("pg_ctl", "promote", "-D", cluster.folder / "two", "-w")
    cluster.sql("two", "ALTER SYSTEM SET synchronous_standby_names = ''")
    cluster.sql("two", "SELECT pg_reload_conf()")
    support.wait(lambda: change() == 201, 30)
    cluster.kill("one")
    print(f"the first change {time.monotonic() - begin:.1f} s after the promotion began")
    listed = {each["name"] for each in server.ask("GET", "/v1/maps").json["maps"]}
    assert set(made) <= listed, set(made) - listed
    print(f"{len(made)} of {count} changes acknowledged, none lost")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    for name in ("stillmap", "map", "drive"):
        parser.add_argument(name, type=pathlib.Path)
    arguments = parser.parse_args()
    programs = sorted(pathlib.Path("/usr/lib/postgresql").glob("*/bin"))
    if not programs or os.getuid() != 0:
        support.skip_program("PostgreSQL is not installed, or this is not root")
    folder = pathlib.Path(tempfile.mkdtemp())
    shutil.chown(folder, "nobody")
    folder.chmod(0o755)
    cluster = server = None
    try:
        cluster = Cluster(folder, programs[-1])
        store = pathlib.Path(tempfile.mkdtemp(dir=folder))
        for words in (("attach", store, cluster.address), ("add", store, "town", "v1", arguments.map, "--activate")):
            done = run(arguments.stillmap, "store", *words)
            assert done.returncode == 0, done.stderr
        server = Server(arguments.stillmap, store, folder / "log")
        assert server.listen(), (folder / "log").read_text()
        server.wait_ready(60)
        vehicle = Vehicle(server, (arguments.drive / "velodyne" / "000001.bin").read_bytes())
        vehicle.start()
        try:
            test(cluster, server, folder / "log")
        finally:
            vehicle.ended = True
            vehicle.join()
        assert set(vehicle.statuses) == {200}, set(vehicle.statuses)
        print(f"{len(vehicle.statuses)} poses answered, the slowest after {vehicle.slowest_s:.2f} s")
    finally:
        if server is not None:
            server.kill()
        if cluster is not None:
            cluster.end()
        shutil.rmtree(folder, ignore_errors=True)


if __name__ == "__main__":
    main()
