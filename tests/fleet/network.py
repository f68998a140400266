"""Machines of a test's own: network namespaces on one bridge, in which programs run and whose links can be cut.

Needs root and iproute2. Nothing of it reaches the network of this machine.
"""

import ctypes
import os
import pathlib
import re
import shutil
import subprocess

NET = "10.77.0"
_CLONE_NEWNET = 0x40000000


def ip(*words):
    subprocess.run(["ip", *map(str, words)], check=True, capture_output=True, text=True)


def missing():
    """Why there can be no namespaces here; empty when there can."""
    if os.geteuid() != 0:
        return "network namespaces need root"
    if shutil.which("ip") is None:
        return "iproute2 is not installed"
    name = f"stillmap-{os.getpid()}-try"
    try:
        ip("netns", "add", name)
        ip("netns", "delete", name)
    except subprocess.CalledProcessError as error:
        return f"no network namespace can be made: {error.stderr.strip()}"
    return ""


class Network:
    """@param names  of the machines. The calling process, and the threads that it starts, run on the first one."""

    def __init__(self, names):
        self.names = list(names)
        self.switch = self._namespace("switch")

    def __enter__(self):
        self._remove_left()
        self._home = open("/proc/self/ns/net")
        try:
            ip("netns", "add", self.switch)
            ip("-n", self.switch, "link", "add", "bridge", "type", "bridge")
            ip("-n", self.switch, "link", "set", "bridge", "up")
            for i, name in enumerate(self.names):
                space = self._namespace(name)
                ip("netns", "add", space)
                ip("-n", self.switch, "link", "add", f"port{i}", "type", "veth", "peer", "name", "eth0", "netns", space)
                ip("-n", self.switch, "link", "set", f"port{i}", "master", "bridge", "up")
                ip("-n", space, "addr", "add", f"{self.address(name)}/24", "dev", "eth0")
                for link in ("lo", "eth0"):
                    ip("-n", space, "link", "set", link, "up")
            with open(f"/run/netns/{self._namespace(self.names[0])}") as space:
                self._enter(space)
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_):
        self._enter(self._home)
        self._home.close()
        for name in ("switch", *self.names):
            subprocess.run(["ip", "netns", "delete", self._namespace(name)], check=False, capture_output=True)

    def address(self, name):
        return f"{NET}.{self.names.index(name) + 10}"

    def prefix(self, name):
        """Words before a command that is to run there."""
        return ["ip", "netns", "exec", self._namespace(name)]

    def cut(self, name):
        """Nothing reaches it, and nobody is told."""
        ip("-n", self.switch, "link", "set", f"port{self.names.index(name)}", "down")

    def mend(self, name):
        ip("-n", self.switch, "link", "set", f"port{self.names.index(name)}", "up")

    @staticmethod
    def _namespace(name):
        return f"stillmap-{os.getpid()}-{name}"

    @staticmethod
    def _enter(space):
        if ctypes.CDLL(None, use_errno=True).setns(space.fileno(), _CLONE_NEWNET) != 0:
            raise OSError(ctypes.get_errno(), "setns")

    @staticmethod
    def _remove_left():
        """Of tests that were killed."""
        spaces = pathlib.Path("/run/netns")
        for each in spaces.iterdir() if spaces.exists() else []:
            owner = re.fullmatch(r"stillmap-(\d+)-\w+", each.name)
            if owner and not pathlib.Path(f"/proc/{owner[1]}").exists():
                subprocess.run(["ip", "netns", "delete", each.name], check=False, capture_output=True)
