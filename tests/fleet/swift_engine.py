#!/usr/bin/env python3
"""OpenStack Swift with its S3 interface on this machine: a real S3 engine for tests, in one folder, gone at the end.

usage: swift_engine.py FOLDER [--host ADDRESS] [--port PORT] [--seconds N]

Prints its address when it answers, and ends after N seconds, at the end of its input, or with this process. Other tests
use the class; PREFIX may be ["ip", "netns", "exec", NAME]. Needs swift-proxy, swift-account, swift-container,
swift-object, python3-swift and memcached, and Debian's own Python; no service of them needs to run. One replica, no
auditors.
"""

import argparse
import configparser
import ctypes
import datetime
import hashlib
import hmac
import http.client
import os
import pathlib
import pwd
import select
import shutil
import signal
import socket
import subprocess
import sys
import time

ACCESS_KEY, SECRET_KEY = "test:tester", "testing"
SERVERS = ("account", "container", "object", "proxy")
PROXY_FILTERS = {
    "catch_errors": {}, "proxy-logging": {"use": "egg:swift#proxy_logging"},
    "cache": {"use": "egg:swift#memcache"}, "s3api": {"s3_acl": "false", "location": "us-east-1"},
    "tempauth": {"user_test_tester": f"{SECRET_KEY} .admin"}, "slo": {}, "dlo": {}}
PIPELINE = "catch_errors proxy-logging cache s3api tempauth slo dlo proxy-logging proxy-server"


def sha256_of(content):
    return hashlib.sha256(content).hexdigest()


def missing():
    """Programs that are not installed."""
    programs = [f"swift-{server}-server" for server in SERVERS] + ["memcached"]
    return [program for program in programs if shutil.which(program) is None]


def free_ports(count, host):
    """Ports on which nobody listens just now."""
    sockets = [socket.socket() for _ in range(count)]
    try:
        for each in sockets:
            each.bind((host, 0))
        return [each.getsockname()[1] for each in sockets]
    finally:
        for each in sockets:
            each.close()


def answers(host, port, timeout=1.0):
    try:
        socket.create_connection((host, port), timeout).close()
        return True
    except OSError:
        return False


class Swift:
    def __init__(self, folder, host="127.0.0.1", port=0, prefix=(), reachable=answers):
        """@param reachable  how to see that a port answers; another one where `prefix` leads elsewhere."""
        self.folder = pathlib.Path(folder).resolve()
        self.host, self.prefix, self.reachable = host, list(prefix), reachable
        root = os.geteuid() == 0
        self.user = pwd.getpwnam("swift") if root else pwd.getpwuid(os.getuid())
        # In another namespace nothing is free or taken here.
        ports = [port + i for i in range(5)] if port else free_ports(5, "127.0.0.1")
        self.ports = dict(zip(("proxy", "account", "container", "object", "memcached"), ports))
        self.processes = {}

    @property
    def endpoint(self):
        return f"http://{self.host}:{self.ports['proxy']}"

    def start(self):
        self.configure()
        for server in ("memcached", "account", "container", "object", "proxy"):
            self.launch(server)
        for server in SERVERS:
            self.wait(server)
        return self

    def launch(self, server):
        if server == "memcached":
            command = ["memcached", "-l", self.host, "-p", str(self.ports[server]), "-m", "32"]
        else:
            command = [f"swift-{server}-server", str(self.folder / f"{server}-server.conf")]
        with open(self.folder / f"{server}.log", "ab") as log:
            self.processes[server] = subprocess.Popen(self.prefix + command, stdin=subprocess.DEVNULL, stdout=log,
                                                      stderr=log, preexec_fn=self.become_user)

    def become_user(self):
        if os.geteuid() == 0 and not self.prefix:
            os.setgroups([])
            os.setgid(self.user.pw_gid)
            os.setuid(self.user.pw_uid)
        # After the change of user, which would undo it: ends with this process.
        ctypes.CDLL(None).prctl(1, signal.SIGKILL)

    def wait(self, server, seconds=60):
        end = time.monotonic() + seconds
        while not self.reachable(self.host, self.ports[server]):
            if self.processes[server].poll() is not None or time.monotonic() > end:
                log = (self.folder / f"{server}.log").read_text(errors="replace")
                raise RuntimeError(f"swift's {server} server does not answer: {log[-2000:]}")
            time.sleep(0.05)

    def kill(self, server="proxy"):
        self.processes[server].kill()
        self.processes[server].wait()

    def restart(self, server="proxy"):
        self.launch(server)
        self.wait(server)

    def stop(self):
        for process in self.processes.values():
            process.kill()
        for process in self.processes.values():
            process.wait()

    def __enter__(self):
        try:
            return self.start()
        except BaseException:
            self.stop()
            raise

    def __exit__(self, *_):
        self.stop()

    def configure(self):
        for name in (".", "node/d1", "cache"):
            (self.folder / name).mkdir(parents=True, exist_ok=True)
        self.write("swift.conf", {"swift-hash": {"swift_hash_path_suffix": "stillmap",
                                                 "swift_hash_path_prefix": "stillmap"}})
        for server in ("account", "container", "object"):
            self.make_ring(server)
            self.write(f"{server}-server.conf", {
                "DEFAULT": self.common(server) | {"devices": str(self.folder / "node"), "mount_check": "false",
                                                  "recon_cache_path": str(self.folder / "cache")},
                "pipeline:main": {"pipeline": f"{server}-server"},
                f"app:{server}-server": {"use": f"egg:swift#{server}"}})
        filters = {f"filter:{name}": {"use": f"egg:swift#{name}"} | settings
                   for name, settings in PROXY_FILTERS.items()}
        filters["filter:cache"]["memcache_servers"] = f"{self.host}:{self.ports['memcached']}"
        self.write("proxy-server.conf", {
            "DEFAULT": self.common("proxy"), "pipeline:main": {"pipeline": PIPELINE},
            "app:proxy-server": {"use": "egg:swift#proxy", "account_autocreate": "true"}} | filters)
        if os.geteuid() == 0:
            # Its user must reach the folder, whoever made it.
            os.chmod(self.folder.parent, self.folder.parent.stat().st_mode | 0o011)
            for path in (self.folder, *self.folder.rglob("*")):
                os.chown(path, self.user.pw_uid, self.user.pw_gid)

    def make_ring(self, server):
        # By Swift's own module: its program takes a second for each of three steps.
        from swift.common.ring import RingBuilder
        builder = RingBuilder(6, 1, 1)
        builder.add_dev({"region": 1, "zone": 1, "ip": self.host, "port": self.ports[server], "device": "d1",
                         "weight": 100.0})
        builder.rebalance()
        builder.get_ring().save(str(self.folder / f"{server}.ring.gz"))

    def common(self, server):
        return {"bind_ip": self.host, "bind_port": str(self.ports[server]), "swift_dir": str(self.folder),
                "workers": "0", "user": self.user.pw_name, "log_address": "/dev/null"}

    def write(self, name, sections):
        text = configparser.RawConfigParser(default_section=None)
        text.read_dict(sections)
        with open(self.folder / name, "w") as file:
            text.write(file)

    # A second signer, so that tests do not look at the engine through the code under test.
    def ask(self, method, path, query="", body=b""):
        """@return status, body. @param query  encoded and sorted."""
        time_text = datetime.datetime.now(datetime.timezone.utc).strftime("%Y%m%dT%H%M%SZ")
        date, body_hash = time_text[:8], sha256_of(body)
        host = f"{self.host}:{self.ports['proxy']}"
        headers = {"host": host, "x-amz-content-sha256": body_hash, "x-amz-date": time_text}
        names = ";".join(sorted(headers))
        lines = "".join(f"{name}:{headers[name]}\n" for name in sorted(headers))
        scope = f"{date}/us-east-1/s3/aws4_request"
        canonical = "\n".join([method, path, query, lines, names, body_hash])
        text = "\n".join(["AWS4-HMAC-SHA256", time_text, scope, sha256_of(canonical.encode())])
        key = ("AWS4" + SECRET_KEY).encode()
        for part in (*scope.split("/"), text):
            key = hmac.new(key, part.encode(), hashlib.sha256).digest()
        headers["authorization"] = (f"AWS4-HMAC-SHA256 Credential={ACCESS_KEY}/{scope}, SignedHeaders={names}, "
                                    f"Signature={key.hex()}")
        connection = http.client.HTTPConnection(host, timeout=20)
        try:
            connection.request(method, path + ("?" + query if query else ""), body, headers)
            answer = connection.getresponse()
            return answer.status, answer.read()
        finally:
            connection.close()


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder")
    parser.add_argument("--host", default="127.0.0.1")
    parser.add_argument("--port", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=3600)
    arguments = parser.parse_args()
    if missing():
        sys.exit(f"not installed: {' '.join(missing())}")
    with Swift(arguments.folder, arguments.host, arguments.port) as swift:
        print(swift.endpoint, flush=True)
        end = time.monotonic() + arguments.seconds
        while time.monotonic() < end:
            if select.select([sys.stdin], [], [], max(0.0, end - time.monotonic()))[0] and not sys.stdin.readline():
                break


if __name__ == "__main__":
    main()
