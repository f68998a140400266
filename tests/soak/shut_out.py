#!/usr/bin/env python3
"""Attackers who want to shut others out of a server, and what others still get beside them.

usage: shut_out.py --program STILLMAP --sample FOLDER [--part poses|connections] [--seconds 30]

FOLDER is that of tests/integration/sample_map.sh. Two parts:

poses        24 connections of one key send the costliest JSON below the key's rate; another key asks for a pose twice a second.
connections  500 and then 2,000 clients without a key ask for a file of the page again and again and read nothing. Beside them a
             client loads a map over a link that adds 25 ms each way, and health is asked on the management port.
             It makes network namespaces, so it needs root.
"""

import argparse
import gzip
import http.client
import json
import os
import pathlib
import re
import resource
import selectors
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time

from delayed_link import NEAR, DelayedLink, unshare_network
from serving import Server, make_key, run

MOST_QUEUED_BYTES = 128 << 20
LEAST_MBIT_PER_S = 50.0
MOST_HEALTH_S = 0.25
DELAY_S = 0.025


def expect(condition, text):
    print(("ok      " if condition else "WRONG   ") + text, flush=True)
    return condition


def scan_request(sample):
    """@return path and body of a query that is answered with a pose."""
    pose = [float(word) for word in (sample / "map" / "trajectory.tum").read_text().splitlines()[1].split()]
    scan = sample / "drive" / "velodyne" / "000002.bin"  # the map is of the even ones
    place, turn = (",".join(map(str, part)) for part in (pose[1:4], pose[4:8]))
    return f"/v1/maps/town/localize?prior_t={place}&prior_q={turn}", scan.read_bytes()


def costly_bodies():
    """@return (path, headers, body) of requests that cost as much as their bounds allow."""
    listed = lambda element, size: (b'{"points":[' + element * (size // len(element)) + element[:-1] + b"]}")
    bodies = []
    for element in (b"{},", b"[],", b'{"a":{}},', b"[0,0,0],"):
        bodies.append(("/v1/maps/town/localize", "application/json", listed(element, 8 << 20)))
        text = listed(element, (256 << 10) - 100)
        part = b'--b\r\nContent-Disposition: form-data; name="%s"\r\n\r\n%s\r\n'
        bodies.append(("/v1/maps/town/localize", "multipart/form-data; boundary=b",
                       part % (b"request", text) + part % (b"scan", bytes(1600)) + b"--b--\r\n"))
        bodies.append(("/v1/maps/town/localize/batch", "application/json",
                       b'{"queries":[' + listed(element, 7 << 20) + b"]}"))
    return [(path, {"Content-Type": type, "Content-Encoding": "gzip"}, gzip.compress(body)) for path, type, body in bodies]


def poses(options, store):
    """@return whether every request of the victim is answered."""
    attacker, victim = (make_key(options.program, store, name) for name in ("attacker", "victim"))
    server = Server(options.program, store, options.log)
    try:
        server.listen()
        server.wait_ready(30)
        return poses_beside(server, attacker, victim, options)
    finally:
        server.stop()


def poses_beside(server, attacker, victim, options):
    stop = threading.Event()
    bodies, counts, lock = costly_bodies(), {}, threading.Lock()

    def attack(number):
        connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=60)
        for i in range(number, 10**9):
            if stop.wait(24 / 180):  # 180 a second together, below the rate of the key
                return
            path, headers, body = bodies[i % len(bodies)]
            try:
                connection.request("POST", path, body, {**headers, "Authorization": f"Bearer {attacker}"})
                response = connection.getresponse()
                response.read()
                status = response.status
            except (OSError, http.client.HTTPException):
                connection.close()
                status = "cut"
            with lock:
                counts[status] = counts.get(status, 0) + 1

    threads = [threading.Thread(target=attack, args=(i,), daemon=True) for i in range(24)]
    for thread in threads:
        thread.start()
    path, body = scan_request(options.sample)
    answered, asked, longest_s = 0, 2 * options.seconds, 0.0
    begin = time.monotonic()
    for i in range(asked):
        time.sleep(max(0.0, begin + 0.5 * i - time.monotonic()))
        sent = time.monotonic()
        answer = server.ask("POST", path, body, {"Content-Type": "application/octet-stream", "Authorization": f"Bearer {victim}"})
        longest_s = max(longest_s, time.monotonic() - sent)
        answered += answer.status == 200
        if answer.status != 200:
            print(f"        {answer.status} {answer.body[:200]}")
    stop.set()
    for thread in threads:
        thread.join()
    print(f"        attackers got {counts}; the victim waited {longest_s:.2f} s at most")
    return expect(answered == asked, f"{answered} of {asked} poses beside 24 attackers")


def attack_connections(port, path, count):
    """Keeps `count` connections open that ask and read nothing, until it is killed."""
    resource.setrlimit(resource.RLIMIT_NOFILE, (count + 100, count + 100))
    # On loopback, where an address has no share of the connections of its own.
    asks = (f"GET {path} HTTP/1.1\r\nHost: localhost\r\n\r\n" * 50).encode()
    selector = selectors.DefaultSelector()
    opened = 0

    def open_one():
        one = socket.socket()
        one.setblocking(False)
        one.connect_ex(("127.0.0.1", port))
        selector.register(one, selectors.EVENT_WRITE)
        return 1

    while True:
        while opened < count:
            opened += open_one()
        for key, _ in selector.select(0.1):
            one = key.fileobj
            try:
                if key.events == selectors.EVENT_WRITE:
                    one.send(asks)
                    selector.modify(one, 0x8)  # told of its end alone
                    continue
                one.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
            except OSError:
                pass
            selector.unregister(one)
            one.close()
            opened -= 1


# Runs at the far end of the link: loads the map again and again, and says how many megabits came in a second. As every client
# of HTTP it opens another connection where an idle one was closed, or is told to come again.
DOWNLOAD = """
import http.client, sys, time
host, port, path, seconds = sys.argv[1], int(sys.argv[2]), sys.argv[3], float(sys.argv[4])
connection = http.client.HTTPConnection(host, port, timeout=20)
got, begin, again = 0, time.monotonic(), 0
while time.monotonic() < begin + seconds:
    try:
        connection.request("GET", path)
        response = connection.getresponse()
        if response.status != 200: raise ConnectionError(response.status)
        while piece := response.read(1 << 18): got += len(piece)
    except (OSError, http.client.HTTPException):
        connection.close()
        again += 1
        time.sleep(0.05)
print(8e-6 * got / (time.monotonic() - begin), again)
"""


def queued_bytes(port):
    """What the kernel holds for the peers of a local port, connections that nobody owns any more included."""
    text = subprocess.run(["ss", "-tmnaH", f"sport = :{port}"], capture_output=True, text=True, check=True).stdout
    return sum(int(found) for found in re.findall(r"skmem:\([^)]*?\bw(\d+)", text))


def percentile(values, share):
    return sorted(values)[min(len(values) - 1, int(share * len(values)))] if values else float("inf")


def beside(options, link, server, management, path, count):
    """@return whether what is promised holds beside `count` attackers."""
    content = "/v1/maps/town/versions/v1/content"
    download = subprocess.Popen(
        link.command([sys.executable, "-c", DOWNLOAD, NEAR, str(server.port), content, str(options.seconds)]),
        stdout=subprocess.PIPE, text=True)
    time.sleep(0.5)
    attacker = os.fork() if count > 0 else 0
    if count > 0 and attacker == 0:
        attack_connections(server.port, path, count)
    most_queued, health_s = 0, []
    until = time.monotonic() + options.seconds - 0.5
    while time.monotonic() < until:
        sent = time.monotonic()
        connection = http.client.HTTPConnection("127.0.0.1", management, timeout=20)
        connection.request("GET", "/livez")
        connection.getresponse().read()
        connection.close()
        health_s.append(time.monotonic() - sent)
        most_queued = max(most_queued, queued_bytes(server.port))
        time.sleep(0.05)
    speed, again = map(float, download.communicate(timeout=60)[0].split())
    if count > 0:
        os.kill(attacker, signal.SIGKILL)
        os.waitpid(attacker, 0)
    name = f"beside {count} attackers: "
    good = expect(most_queued <= MOST_QUEUED_BYTES, f"{name}{most_queued / 2**20:.1f} MiB in send queues")
    good &= expect(speed >= LEAST_MBIT_PER_S, f"{name}a client over 50 ms loads {speed:.0f} Mbit/s, asking again {again:.0f} times")
    worst = percentile(health_s, 0.99)
    return good & expect(worst <= MOST_HEALTH_S, f"{name}/livez p99 {1e3 * worst:.0f} ms of {len(health_s)}")


def free_port():
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


def connections(options, store):
    unshare_network()
    subprocess.run(["ip", "link", "set", "lo", "up"], check=True)
    link = DelayedLink(DELAY_S)
    management = free_port()
    server = Server(options.program, store, options.log, options=[
        "--host", "0.0.0.0", "--allow-remote", "--allow-without-keys", "--management-port", str(management)])
    try:
        server.listen()
        server.wait_ready(30)
        page = server.ask("GET", "/").body.decode()
        path = re.search(r"/assets/index-[^\"]*\.js", page)[0]
        return all([beside(options, link, server, management, path, count) for count in (0, 500, 2000)])
    finally:
        server.stop()
        link.end()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--program", required=True)
    parser.add_argument("--sample", required=True, type=pathlib.Path)
    parser.add_argument("--part", choices=["poses", "connections"])
    parser.add_argument("--seconds", type=int, default=30)
    options = parser.parse_args()
    good = True
    for part in (poses, connections):
        if options.part not in (None, part.__name__):
            continue
        with tempfile.TemporaryDirectory() as folder:
            store = pathlib.Path(folder) / "store"
            shutil.copytree(options.sample / "store", store)
            options.log = pathlib.Path(folder) / "log"
            good &= part(options, store)
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
