#!/usr/bin/env python3
"""The units: judged by systemd's own tools, and their commands and a mapping run under their filters.

usage: systemd_test.py STILLMAP DRIVE STORE
"""

import functools
import os
import shlex
import shutil
import signal
import socket
import subprocess
import sys
import unittest

import sandbox
import support

PROGRAM, DRIVE, STORE = sys.argv[1:4]
UNIT = support.DEPLOY / "systemd" / "stillmap.service"
BACKUP = UNIT.with_name("stillmap-backup.service")
CONFIG = support.DEPLOY / "stillmap.json"
HIGHEST_EXPOSURE = 1.5


def analyze(*arguments):
    return subprocess.run(["systemd-analyze", "--no-pager", *map(str, arguments)], capture_output=True, text=True, timeout=60)


def confined(command, state=None, unit=UNIT):
    """Under the unit's filters; with `state` also in its view of the file system."""
    narrow = ["--state", state] if state else []
    return [sys.executable, support.HERE / "sandbox.py", *narrow, unit, *command]


@functools.lru_cache(None)
def may_mount(folder):
    """Only root of a whole machine, or of a container that lets it mount, can make that view."""
    return os.geteuid() == 0 and subprocess.run(list(map(str, confined(["true"], folder)))).returncode == 0


class Judged(support.FolderTest):
    def test_little_is_left_open(self):
        for unit in (UNIT, BACKUP):
            done = analyze("security", "--offline=true", f"--threshold={round(HIGHEST_EXPOSURE * 10)}", unit)
            self.assertEqual(done.returncode, 0, done.stdout[-2000:])

    def test_systemd_understands_every_line(self):
        copies = [self.folder / unit.name for unit in UNIT.parent.iterdir()]
        for copy in copies:
            copy.write_text((UNIT.parent / copy.name).read_text().replace("/usr/bin/stillmap", PROGRAM))
        done = analyze("verify", "--man=no", *copies)
        self.assertEqual((done.returncode, done.stderr.strip()), (0, ""))

    def test_its_end_waits_for_the_drain(self):
        drain = support.without_comments(CONFIG)["drain"]
        stop_s = int(sandbox.directives(UNIT)["TimeoutStopSec"][-1])
        self.assertGreater(stop_s, drain["delay_s"] + drain["timeout_s"] + 4)


class Confined(support.FolderTest):
    def run_confined(self, *command, state=None):
        return subprocess.run(list(map(str, confined(command, state))), capture_output=True, text=True, timeout=100)

    def test_what_no_server_does_is_stopped(self):
        for command in (["chroot", "/", "true"], ["unshare", "-U", "true"], ["mount", "--bind", "/", "/"],
                        ["chmod", "4755", self.folder],
                        [sys.executable, "-c", "import mmap; mmap.mmap(-1, 4096, prot=7)"],
                        [sys.executable, "-c", "import socket; socket.socket(socket.AF_NETLINK, socket.SOCK_RAW)"]):
            with self.subTest(command=command):
                self.assertEqual(self.run_confined(*command).returncode, -signal.SIGSYS)

    def test_a_job_may_be_put_below_the_server(self):
        done = self.run_confined("nice", "-n", "10", "taskset", "1", "prlimit", "--as=1000000000", "sh", "-c", "echo a | cat")
        self.assertEqual((done.returncode, done.stdout), (0, "a\n"), done.stderr)

    def test_a_map_is_built(self):
        state = self.folder if may_mount(self.folder) else None
        if state is None:
            print("not root: only the system call filters, not the view of the file system", file=sys.stderr)
        made = self.folder / "map"
        done = self.run_confined("nice", "-n", "10", PROGRAM, "build", DRIVE, "-o", made, "--select", "::16", state=state)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertTrue((made / "manifest.json").exists())


class ExecutedByHand(support.FolderTest):
    def test_a_store_is_backed_up(self):
        state, backup = self.folder / "store", self.folder / "backup"
        shutil.copytree(STORE, state)
        backup.mkdir()
        line = sandbox.directives(BACKUP)["ExecStart"][0]
        for name, folder in (("/var/lib/stillmap-backup", backup), ("/var/lib/stillmap", state)):
            self.assertIn(name, line)
            line = line.replace(name, str(folder), 1) if name.endswith("backup") else line.replace(name + " ", f"{folder} ")
        command = [PROGRAM, *shlex.split(line)[1:]]
        for _ in range(2):
            done = subprocess.run(list(map(str, confined(command, self.folder if may_mount(self.folder) else None, BACKUP))),
                                  capture_output=True, text=True, timeout=60)
            self.assertEqual(done.returncode, 0, done.stderr)
        done = subprocess.run([PROGRAM, "store", "restore", backup, "-o", self.folder / "again"], capture_output=True, text=True)
        self.assertEqual(done.returncode, 0, done.stderr)

    def test_its_life_under_a_service_manager(self):
        unit = sandbox.directives(UNIT)
        command = shlex.split(unit["ExecStart"][0].replace("/etc/stillmap", str(CONFIG.parent)))
        command[0] = PROGRAM
        state = self.folder / "state"
        state.mkdir()
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
            manager.bind(str(self.folder / "notify"))
            manager.settimeout(30)

            def heard(text):
                while True:
                    datagram = manager.recv(4096).decode()
                    if datagram.startswith(text):
                        return datagram

            environment = {**os.environ, "NOTIFY_SOCKET": str(self.folder / "notify"), "WATCHDOG_USEC": "1000000",
                           "STILLMAP_SERVE_STORE": str(state), "STILLMAP_SERVE_PORT": "0", "STILLMAP_SERVE_DRAIN_DELAY_S": "0",
                           "STILLMAP_SERVE_MANAGEMENT_PORT": "0"}
            server = self.start(confined(command, state if may_mount(self.folder) else None), env=environment,
                                stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
            port = int(heard("READY=1").split("127.0.0.1:")[1].split("/")[0])
            heard("WATCHDOG=1")
            heard("WATCHDOG=1")
            self.assertEqual(support.get(port, "/livez")[0], 200)
            self.assertEqual(unit["ExecReload"][0], "/bin/kill -HUP $MAINPID")
            server.send_signal(signal.SIGHUP)
            heard("RELOADING=1")
            heard("READY=1")
            server.send_signal(signal.SIGTERM)
            heard("STOPPING=1")
            server.communicate(timeout=30)
            self.assertEqual(server.returncode, 0)


if __name__ == "__main__":
    support.tool("systemd-analyze")
    try:
        import ctypes
        ctypes.CDLL("libseccomp.so.2")
    except OSError as error:
        support.skip_program(error)
    unittest.main(argv=sys.argv[:1])
