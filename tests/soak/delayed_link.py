"""A network namespace beside this one, over a link that delays every packet: the kernel has no netem everywhere.

The link is two TUN devices and a process that carries packets between them, in order, each after its delay.
"""

import collections
import ctypes
import fcntl
import os
import select
import signal
import socket
import struct
import subprocess
import time

CLONE_NEWNET = 0x40000000
NEAR, FAR = "10.99.0.1", "10.99.0.2"
# What a link of 1 Gbit/s with 200 ms of buffers would hold; beyond it packets are dropped.
MOST_PACKETS = 16_000


def unshare_network():
    if ctypes.CDLL(None, use_errno=True).unshare(CLONE_NEWNET) != 0:
        raise OSError(ctypes.get_errno(), "a network namespace cannot be made; run this as root")


def open_tun(name, address, peer):
    TUNSETIFF, IFF_TUN, IFF_NO_PI = 0x400454CA, 0x0001, 0x1000
    tun = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
    fcntl.ioctl(tun, TUNSETIFF, struct.pack("16sH", name.encode(), IFF_TUN | IFF_NO_PI))
    for command in (f"link set {name} txqueuelen 10000 up", f"addr add {address} peer {peer} dev {name}"):
        subprocess.run(["ip", *command.split()], check=True)
    return tun


def carry(ends, delay_s):
    """Carries packets between two TUN devices until it is killed."""
    waiting = {end: collections.deque() for end in ends}
    other = {ends[0]: ends[1], ends[1]: ends[0]}
    poll = select.poll()
    for end in ends:
        poll.register(end, select.POLLIN)
    while True:
        due = [queue[0][0] for queue in waiting.values() if queue]
        timeout_ms = max(0, (min(due) - time.monotonic()) * 1e3) if due else 1000
        poll.poll(timeout_ms)
        for end in ends:
            queue = waiting[end]
            try:
                while True:
                    packet = os.read(end, 2048)
                    if len(queue) < MOST_PACKETS:
                        queue.append((time.monotonic() + delay_s, packet))
            except BlockingIOError:
                pass
        now = time.monotonic()
        for end in ends:
            while waiting[end] and waiting[end][0][0] <= now:
                try:
                    os.write(other[end], waiting[end].popleft()[1])
                except OSError:
                    break  # its device is full: as on a wire, the packet is gone


class DelayedLink:
    """Between NEAR in this namespace and FAR in one of its own, where `command` runs programs."""

    def __init__(self, delay_s):
        self.near = open_tun("near0", NEAR, FAR)
        ours, theirs = socket.socketpair()
        self.holder = os.fork()
        if self.holder == 0:
            try:
                ours.close()
                unshare_network()
                subprocess.run(["ip", "link", "set", "lo", "up"], check=True)
                socket.send_fds(theirs, [b"tun"], [open_tun("far0", FAR, NEAR)])
                signal.pause()
            finally:
                os._exit(1)
        theirs.close()
        _, files, _, _ = socket.recv_fds(ours, 16, 1)
        if not files:
            raise RuntimeError("the far end of the link could not be made")
        self.carrier = os.fork()
        if self.carrier == 0:
            try:
                carry((self.near, files[0]), delay_s)
            finally:
                os._exit(1)
        os.close(files[0])

    def command(self, arguments):
        """@return a command line that runs `arguments` at the far end."""
        return ["nsenter", f"--net=/proc/{self.holder}/ns/net", *arguments]

    def end(self):
        for process in (self.carrier, self.holder):
            os.kill(process, signal.SIGKILL)
            os.waitpid(process, 0)
