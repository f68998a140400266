#!/usr/bin/env python3
"""How many servers, and how much of all else, a fleet needs: from figures that are measured on a machine of yours.

    sizing.py measure STILLMAP MAP DRIVE > measured.json
    sizing.py compute measured.json --km 1000 --vehicles 1000 --hz 1 --zones 3

MAP is a map package, DRIVE a drive through it whose scans are DRIVE/velodyne/*.bin (float32 x y z i). `measure` starts a
server of its own on 127.0.0.1 and sends it thin scans, as the Python client does (with numpy; else whole ones). Use a
machine of the kind that will serve, with nothing else to do.
"""

import argparse
import contextlib
import http.client
import json
import math
import os
import pathlib
import socket
import ssl
import subprocess
import sys
import tempfile
import time

HERE = pathlib.Path(__file__).resolve().parent
VERSION = "/v1/maps/town/versions/v1"
LOCALIZE = "/v1/maps/town/localize"
GIB = 2**30


# --- measure -----------------------------------------------------------------------------------------------------------


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def run(*command):
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"sizing.py: {' '.join(map(str, command))}: {done.stderr.strip()}")
    return done.stdout


class Connection:
    """Counts what goes over it, heads included."""

    def __init__(self, port, context=None):
        self.http = (http.client.HTTPSConnection("127.0.0.1", port, timeout=120, context=context) if context else
                     http.client.HTTPConnection("127.0.0.1", port, timeout=120))
        self.bytes_in, self.bytes_out, self.used_s = 0, 0, 0.0

    def ask(self, method, path, body=b"", headers=None):
        """@return status, body and headers; a busy server is asked again."""
        if time.monotonic() > self.used_s + 1:
            self.http.close()  # the server ends idle connections; `request` opens a new one
        for _ in range(600):
            self.http.request(method, path, body, headers or {})
            answer = self.http.getresponse()
            text = answer.read()
            self.used_s = time.monotonic()
            if answer.status != 503:
                break
            time.sleep(0.1)
        head = sum(len(name) + len(value) + 4 for name, value in (headers or {}).items())
        self.bytes_in += len(body) + head + len(method) + len(path) + 60
        self.bytes_out += len(text) + sum(len(name) + len(value) + 4 for name, value in answer.getheaders()) + 20
        return answer.status, text, answer.headers


class Server:
    def __init__(self, program, store, options):
        self.management = free_port()
        self.process = subprocess.Popen([program, "serve", "--store", store, "--port", "0", "--management-port",
                                         str(self.management), *options], stdout=subprocess.PIPE,
                                        stderr=subprocess.DEVNULL, text=True)
        line = self.process.stdout.readline()
        if "listening on" not in line:
            sys.exit("sizing.py: the server did not start: run `stillmap serve` by hand to see why")
        self.port = int(line.rsplit(":", 1)[1].rstrip("/\n"))
        while self.get("/readyz")[0] != 200:
            time.sleep(0.05)

    def get(self, path):
        connection = http.client.HTTPConnection("127.0.0.1", self.management, timeout=20)
        connection.request("GET", path)
        answer = connection.getresponse()
        return answer.status, answer.read().decode()

    def cpu_s(self):
        """Threads that have ended count, too."""
        fields = pathlib.Path(f"/proc/{self.process.pid}/stat").read_text().rsplit(")", 1)[1].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def memory_bytes(self):
        lines = pathlib.Path(f"/proc/{self.process.pid}/smaps_rollup").read_text().splitlines()
        return next(1024 * int(line.split()[1]) for line in lines if line.startswith("Anonymous:"))


def cpu_s_of_threads(pid):
    """Finer than the ticks of `stat`, for a process whose threads stay."""
    return sum(int(file.read_text().split()[0]) for file in pathlib.Path(f"/proc/{pid}/task").glob("*/schedstat")) / 1e9


def scans_of(drive, every, most):
    """(stamp_ns, body, content type) of each scan."""
    files = sorted((drive / "velodyne").glob("*.bin"))[::every][:most]
    if not files:
        sys.exit(f"sizing.py: {drive}/velodyne: no *.bin: give a drive of float32 scans (stillmap simulate makes one)")
    times = [float(line) for line in (drive / "times.txt").read_text().split()] if (drive / "times.txt").is_file() else []
    sys.path.insert(0, str(HERE.parent / "clients/python/src"))
    try:
        import numpy as np
        from stillmap_client.thinning import thin_scan
    except ImportError:
        thin_scan = None
        print("sizing.py: numpy or the Python client is missing, so whole scans are sent", file=sys.stderr)
    for file in files:
        # A drive without times is one of 10 Hz.
        stamp_s = times[int(file.stem)] if times else 0.1 * int(file.stem)
        body, kind = file.read_bytes(), "application/octet-stream"
        if thin_scan:
            body, kind = thin_scan(np.frombuffer(body, "<f4").reshape(-1, 4), "compact"), "application/vnd.stillmap.scan"
        yield round(1e9 * stamp_s), body, kind


def flat_prior(pose):
    """Half a metre off."""
    x, y, z = pose["position"]
    return f"prior_t={x + 0.4},{y - 0.3},{z}&prior_q={','.join(map(str, pose['quaternion']))}&prior_sigma=0.5,0.05"


def measure_serving(server, scans):
    """CPU for each kind of pose, and what goes over the network."""
    connection, found, begun = Connection(server.port), {}, server.cpu_s()
    searched = scans[:: max(1, len(scans) // 8)][:8]
    for _, body, kind in searched:
        assert connection.ask("POST", LOCALIZE, body, {"Content-Type": kind})[0] == 200
    found["cpu_s_per_search"] = (server.cpu_s() - begun) / len(searched)

    def sealed():
        """One vehicle's way. @return its poses, lost ones as None, and how many were ok."""
        seal, poses, good = None, [], 0
        for stamp_ns, body, kind in scans:
            headers = {"Content-Type": kind, **({"Stillmap-Seal": seal} if seal else {})}
            status, text, answer = connection.ask("POST", f"{LOCALIZE}/next?stamp_ns={stamp_ns}", body, headers)
            assert status == 200, text
            seal, pose = answer["Stillmap-Seal"], json.loads(text)
            poses.append(pose["pose"])
            good += pose["status"] == "ok"
        return poses, good

    poses, good = sealed()  # once before it is measured: then the parts of the map are in memory
    begun, connection.bytes_in, connection.bytes_out = server.cpu_s(), 0, 0
    sealed()
    found.update(cpu_s_per_sealed_scan=(server.cpu_s() - begun) / len(scans), ok_share=good / len(scans),
                 bytes_in_per_scan=connection.bytes_in / len(scans), bytes_out_per_scan=connection.bytes_out / len(scans))
    near = [(body, kind, pose) for (_, body, kind), pose in zip(scans, poses) if pose]
    begun = server.cpu_s()
    for body, kind, pose in near:
        assert connection.ask("POST", f"{LOCALIZE}?{flat_prior(pose)}", body, {"Content-Type": kind})[0] == 200
    found["cpu_s_per_pose_near_prior"] = (server.cpu_s() - begun) / max(1, len(near))
    found.update(scans=len(scans), memory_bytes=server.memory_bytes())
    return found


def measure_map(server, store):
    connection = Connection(server.port)
    info = json.loads(connection.ask("GET", "/v1/maps/town")[1])
    poses = json.loads(connection.ask("GET", f"{VERSION}/trajectory")[1])["poses"]
    steps = [math.dist(a["position"], b["position"]) for a, b in zip(poses, poses[1:]) if a["drive"] == b["drive"]]
    km = sum(step for step in steps if step < 50) / 1000
    files = [file for file in (store / "packages").rglob("*") if file.is_file()]
    on_disk = sum(file.stat().st_size for file in files)
    index = sum(file.stat().st_size for file in files if "index" in file.parts)
    return {"km": km, "scans": len(poses), "package_bytes": info["bytes"], "disk_bytes": on_disk, "index_bytes": index}


def measure_build(program, drive, options):
    """A build of the drive. The estimate bounds memory and disk; CPU is what it took."""
    estimate = json.loads(run(program, "build", drive, "--estimate", "--json", *options))
    with tempfile.TemporaryDirectory() as folder:
        child = subprocess.Popen([program, "build", drive, "-o", f"{folder}/map", *options], stdout=subprocess.DEVNULL,
                                 stderr=subprocess.DEVNULL)
        _, status, usage = os.wait4(child.pid, 0)
        if status != 0:
            sys.exit("sizing.py: the build failed: run `stillmap build` by hand to see why")
        scans = json.loads(pathlib.Path(f"{folder}/map/manifest.json").read_text())["counts"]["scans"]
    return {"scans": scans, "cpu_s_per_scan": (usage.ru_utime + usage.ru_stime) / scans,
            "peak_memory_bytes": 1024 * usage.ru_maxrss, "estimated_memory_bytes": estimate["memory_bytes"],
            "work_bytes_per_scan": (estimate["work_bytes"] + estimate["package_bytes"]) / estimate["scans"]}


def measure_state(program, address, psql, map_folder, scans):
    """What a server asks of PostgreSQL, and what a change leaves there. The database must be empty."""
    def number(query):
        return int(run(psql, address, "-Atc", query))

    def transactions():
        time.sleep(12)  # PostgreSQL counts what a connection did up to 10 s later
        return number("SELECT xact_commit FROM pg_stat_database WHERE datname = current_database()")

    with tempfile.TemporaryDirectory() as folder:
        run(program, "store", "attach", folder, address)
        run(program, "store", "add", folder, "town", "v1", map_folder, "--activate")
        server = Server(program, folder, [])
        try:
            begun, begun_s = transactions(), time.monotonic()
            time.sleep(20)
            idle = (transactions() - begun - 1) / (time.monotonic() - begun_s)
            connection, count = Connection(server.port), 500
            connection.ask("PUT", "/v1/maps/before")
            bytes_before, begun, begun_s = number("SELECT pg_database_size(current_database())"), transactions(), time.monotonic()
            for i in range(count):
                assert connection.ask("PUT", f"/v1/maps/m{i}")[0] == 201
            changed = transactions() - begun - 1 - idle * (time.monotonic() - begun_s)
            bytes_after = number("SELECT pg_database_size(current_database())")
            begun, begun_s = transactions(), time.monotonic()
            for _, body, kind in scans:
                connection.ask("POST", f"{LOCALIZE}?prior_t=0,0,0&prior_q=0,0,0,1", body, {"Content-Type": kind})
            asked = transactions() - begun - 1 - idle * (time.monotonic() - begun_s)
        finally:
            server.process.terminate()
            server.process.wait(60)
    return {"transactions_per_s_of_a_server": idle, "transactions_per_change": changed / count,
            "transactions_per_pose": max(0, asked / len(scans)), "bytes_per_change": (bytes_after - bytes_before) / count}


def measure_proxy(haproxy, server, scans):
    """CPU of HAProxy for a scan that comes by TLS."""
    with tempfile.TemporaryDirectory() as folder:
        run("openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes", "-days", "1",
            "-subj", "/CN=localhost", "-keyout", f"{folder}/key", "-out", f"{folder}/certificate")
        pem = [pathlib.Path(folder, name).read_text() for name in ("certificate", "key")]
        pathlib.Path(f"{folder}/both").write_text("".join(pem))
        port = free_port()
        config = run(sys.executable, HERE.parent / "deploy/proxy/haproxy_config.py", "--shared-state", "--user", "", "--bind",
                     f"127.0.0.1:{port}", "--certificate", f"{folder}/both", "--socket", f"{folder}/admin.sock", "--metrics",
                     f"127.0.0.1:{free_port()}", "--local-peer", f"this=127.0.0.1:{free_port()}",
                     f"a=127.0.0.1:{server.port}:{server.management}")
        pathlib.Path(f"{folder}/haproxy.cfg").write_text(config)
        process = subprocess.Popen([haproxy, "-db", "-f", f"{folder}/haproxy.cfg"], stdout=subprocess.DEVNULL,
                                   stderr=subprocess.DEVNULL)
        try:
            context = ssl.create_default_context()
            context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
            end = time.monotonic() + 20
            while True:
                connection = Connection(port, context)
                with contextlib.suppress(OSError):
                    if connection.ask("GET", "/readyz")[0] == 200:
                        break
                if time.monotonic() > end:
                    sys.exit("sizing.py: HAProxy did not start: run it by hand to see why")
                time.sleep(0.1)
            begun = cpu_s_of_threads(process.pid)
            for _, body, kind in scans:  # all from one place: what the server finds does not matter here
                connection.ask("POST", f"{LOCALIZE}?prior_t=0,0,0&prior_q=0,0,0,1", body, {"Content-Type": kind})
            return {"cpu_s_per_scan": (cpu_s_of_threads(process.pid) - begun) / len(scans)}
        finally:
            process.terminate()
            process.wait(60)


def openssl_speed():
    """Tells machines apart."""
    with contextlib.suppress(OSError, IndexError, ValueError):
        done = subprocess.run(["openssl", "speed", "-seconds", "1", "-bytes", "16384", "sha256"], capture_output=True, text=True)
        return 1000 * float(done.stdout.split()[-1].rstrip("k"))
    return None


def measure(arguments):
    scans = list(scans_of(arguments.drive, arguments.every, arguments.scans))
    found = {"format": "stillmap-sizing-1", "command": " ".join(["sizing.py", *sys.argv[1:]]),
             "date": time.strftime("%Y-%m-%d"), "machine": {"cores": os.cpu_count(), "sha256_bytes_per_s": openssl_speed()}}
    with tempfile.TemporaryDirectory() as folder:
        store = pathlib.Path(folder, "store")
        run(arguments.stillmap, "store", "add", store, "town", "v1", arguments.map, "--activate")
        server = Server(arguments.stillmap, store, [])
        try:
            found["serving"] = measure_serving(server, scans)
            found["map"] = measure_map(server, store)
            if arguments.haproxy:
                found["proxy"] = measure_proxy(arguments.haproxy, server, scans)
        finally:
            server.process.terminate()
            server.process.wait(60)
    if arguments.state:
        found["state"] = measure_state(arguments.stillmap, arguments.state, arguments.psql, arguments.map, scans)
    if not arguments.no_build:
        found["build"] = measure_build(arguments.stillmap, arguments.drive, arguments.build_option)
    print(json.dumps(found, indent=1))


# --- compute -----------------------------------------------------------------------------------------------------------


def size(number):
    for unit, factor in (("TB", 1e12), ("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if number >= factor:
            return f"{number / factor:.3g} {unit}"
    return f"{number:.0f} bytes"


def rows_of(measured, wanted):
    """(what, value, how it was computed)"""
    yield from rows_of_serving(measured, wanted)
    yield from rows_of_bytes(measured, wanted)
    if "state" in measured:
        yield from rows_of_state(measured["state"], wanted, servers_of(measured["serving"], wanted)[0])
    if "build" in measured:
        yield from rows_of_build(measured["build"], measured["map"], wanted)


def busy_cores(serving, wanted):
    searches_per_s = wanted.vehicles * wanted.starts_per_hour / 3600
    return wanted.vehicles * wanted.hz * serving["cpu_s_per_sealed_scan"] + searches_per_s * serving["cpu_s_per_search"]


def servers_of(serving, wanted):
    """How many, and why."""
    cores = busy_cores(serving, wanted) / wanted.utilization
    if wanted.zones > 1:
        each = math.ceil(cores / (wanted.zones - 1) / wanted.server_cores)
        return each * wanted.zones, f"{each} in each of {wanted.zones} zones: enough without one zone"
    return math.ceil(cores / wanted.server_cores) + 1, "enough without one server"


def rows_of_serving(measured, wanted):
    serving, rate = measured["serving"], wanted.vehicles * wanted.hz
    scan_ms, search_ms = 1000 * serving["cpu_s_per_sealed_scan"], 1000 * serving["cpu_s_per_search"]
    busy = busy_cores(serving, wanted)
    yield "scans", f"{rate:g} /s", f"{wanted.vehicles} vehicles x {wanted.hz:g} Hz"
    yield ("cores that are busy", f"{busy:.1f}",
           f"{rate:g} /s x {scan_ms:.1f} ms of CPU (measured, sealed scans); {wanted.starts_per_hour:g} search(es) of each "
           f"vehicle in an hour x {search_ms:.0f} ms (measured)")
    yield "cores", f"{busy / wanted.utilization:.0f}", f"busy for {100 * wanted.utilization:.0f} % at most (--utilization)"
    servers, why = servers_of(serving, wanted)
    yield "servers", f"{servers}", f"{wanted.server_cores} cores each (--server-cores); {why}"
    if "proxy" in measured:
        of_proxy = measured["proxy"]["cpu_s_per_scan"]
        yield ("cores of all proxies", f"{max(1, rate * of_proxy / wanted.utilization):.1f}",
               f"{rate:g} /s x {1000 * of_proxy:.2f} ms of CPU (measured, with TLS), busy as above")
        yield "proxies", f"{max(2, wanted.zones)}", "one in each zone, at least two"


def rows_of_bytes(measured, wanted):
    serving, of_map, rate = measured["serving"], measured["map"], wanted.vehicles * wanted.hz
    package, disk, index = (of_map[name] / of_map["km"] for name in ("package_bytes", "disk_bytes", "index_bytes"))
    least = serving["memory_bytes"] + GIB
    yield "active versions, as sent", size(wanted.km * package), f"{wanted.km:g} km x {size(package)} (measured)"
    yield ("memory of a server, least", size(least),
           f"{size(serving['memory_bytes'])} (measured), and 1 GiB for the system and an index that is made")
    yield ("memory of a server, all in memory", size(least + wanted.km * index),
           f"and the index, {wanted.km:g} km x {size(index)} (measured). Where only parts are driven, these parts")
    yield ("disk of a server (`cache_bytes`)", size(2 * wanted.km * disk),
           f"active versions and one more of each, {size(disk)} a km with index and levels (measured)")
    yield "S3", size(wanted.versions * wanted.km * package), f"{wanted.versions} versions (--versions), if they share nothing"
    for name, way in (("bytes_in_per_scan", "in"), ("bytes_out_per_scan", "out")):
        yield f"network, {way}", f"{8 * rate * serving[name] / 1e6:.3g} Mbit/s", f"{rate:g} /s x {size(serving[name])} (measured)"


def rows_of_state(state, wanted, servers):
    idle, of_change = state["transactions_per_s_of_a_server"], state["transactions_per_change"]
    of_poses = wanted.vehicles * wanted.hz * state["transactions_per_pose"]
    changes = f"{wanted.changes_per_day} changes a day (--changes-per-day)"
    yield ("PostgreSQL, transactions", f"{servers * idle + wanted.changes_per_day / 86400 * of_change + of_poses:.0f} /s",
           f"{servers} servers x {idle:.1f} /s (measured, idle); {changes} x {of_change:.1f} (measured); "
           f"poses x {state['transactions_per_pose']:.2f} (measured)")
    yield ("PostgreSQL, size after a year", size(365 * wanted.changes_per_day * state["bytes_per_change"]),
           f"{changes} x {size(state['bytes_per_change'])} (measured, with the audit record)")


def rows_of_build(build, of_map, wanted):
    of_km = of_map["scans"] / of_map["km"]
    scans = wanted.km * wanted.passes * of_km
    hours = scans * build["cpu_s_per_scan"] / 3600
    yield ("build of all", f"{hours:.0f} core-hours",
           f"{wanted.km:g} km x {wanted.passes:g} pass(es) x {of_km:.0f} scans in a km of the map x "
           f"{build['cpu_s_per_scan']:.3f} s of CPU (measured)")
    yield "cores for it in a night", f"{math.ceil(hours / 8)}", "8 hours"
    yield ("disk for it", size(scans * build["work_bytes_per_scan"]),
           f"{size(build['work_bytes_per_scan'])} a scan (`stillmap build --estimate`), all at one time")


def compute(arguments):
    measured = json.loads(arguments.measured.read_text())
    if measured.get("format") != "stillmap-sizing-1":
        sys.exit(f"sizing.py: {arguments.measured}: found format {measured.get('format')!r}, expected stillmap-sizing-1: "
                 "measure again")
    rows = list(rows_of(measured, arguments))
    if arguments.json:
        print(json.dumps([dict(zip(("what", "value", "from"), row)) for row in rows], indent=1))
        return
    print("| what | value | from |\n|---|---|---|")
    for row in rows:
        print("| " + " | ".join(row) + " |")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    command = commands.add_parser("measure", help="print measured figures as JSON")
    for name in ("stillmap", "map", "drive"):
        command.add_argument(name, type=pathlib.Path)
    command.add_argument("--every", type=int, default=1, metavar="N", help="send every N-th scan of the drive")
    command.add_argument("--scans", type=int, default=200, metavar="N", help="send so many at most")
    command.add_argument("--no-build", action="store_true", help="do not build a map of the drive")
    command.add_argument("--build-option", action="append", default=[], metavar="TEXT",
                         help="option of the build: --build-option=--select=::2")
    command.add_argument("--state", metavar="ADDRESS", help="an empty database of PostgreSQL, to measure what servers ask of it")
    command.add_argument("--psql", default="psql", metavar="PROGRAM", help="for --state")
    command.add_argument("--haproxy", metavar="PROGRAM", help="HAProxy, to measure what it costs")
    command.set_defaults(run=measure)
    command = commands.add_parser("compute", help="print what a fleet needs")
    command.add_argument("measured", type=pathlib.Path)
    command.add_argument("--km", type=float, required=True, help="of streets that are mapped")
    command.add_argument("--vehicles", type=int, required=True, help="that drive at one time")
    command.add_argument("--hz", type=float, default=1.0, help="scans/s that a vehicle sends")
    command.add_argument("--zones", type=int, default=3, help="one of them may be lost; 1: one server may be lost")
    command.add_argument("--server-cores", type=int, default=16, metavar="N", help="of one server")
    command.add_argument("--utilization", type=float, default=0.6, metavar="SHARE",
                         help="of the cores, at most; at 0.72 some 0.5 %% of the scans were late (performance.md)")
    command.add_argument("--starts-per-hour", type=float, default=1.0, metavar="N",
                         help="how often a vehicle begins without a place")
    command.add_argument("--versions", type=int, default=10, metavar="N", help="of a map that are kept (retention.versions)")
    command.add_argument("--changes-per-day", type=int, default=1000, metavar="N", help="uploads, activations, keys, jobs")
    command.add_argument("--passes", type=float, default=1.0, metavar="N", help="how often a street is driven for the map")
    command.add_argument("--json", action="store_true", help="print JSON")
    command.set_defaults(run=compute)
    arguments = parser.parse_args()
    arguments.run(arguments)


if __name__ == "__main__":
    main()
