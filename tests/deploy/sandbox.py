#!/usr/bin/env python3
"""Runs a command under the system call filters that a systemd unit asks for, without systemd as process 1.

usage: sandbox.py [--state FOLDER] UNIT COMMAND [ARGUMENT...]

With --state (root only) the command also sees the file system as the unit says it: only FOLDER takes writes
(ProtectSystem=strict; not even /tmp, which the unit gives), /proc shows processes alone (ProcSubset=pid).

Made as systemd makes them (its src/shared/seccomp-util.c): the same library, and the lists of `systemd-analyze syscall-filter`.
A call that is not let through ends the process by SIGSYS, also where the unit says SystemCallErrorNumber=, so that none goes
unseen. No capabilities, as the unit says. Exit code 77 where libseccomp or systemd-analyze is not there.

Understood: SystemCallFilter, MemoryDenyWriteExecute, RestrictAddressFamilies, RestrictNamespaces, RestrictRealtime,
RestrictSUIDSGID, LockPersonality, NoNewPrivileges, UMask.
"""

import ctypes
import functools
import mmap
import os
import pathlib
import socket
import subprocess
import sys

ALLOW = 0x7FFF0000  # SCMP_ACT_ALLOW
KILL = 0x80000000  # SCMP_ACT_KILL_PROCESS
NOT_EQUAL, EQUAL, MASKED_EQUAL, GREATER = 1, 4, 7, 6  # enum scmp_compare
SKIPPED = 77
# Clone flags of mount, cgroup, uts, ipc, user, pid and network namespaces.
NAMESPACES = (0x20000, 0x2000000, 0x4000000, 0x8000000, 0x10000000, 0x20000000, 0x40000000)
SHM_EXEC = 0o100000
PERSONALITY_ASK = 0xFFFFFFFF
SET_ID_BITS = (0o4000, 0o2000)
# Which argument of a call holds the mode.
MODE_ARGUMENTS = {"chmod": 1, "fchmod": 1, "fchmodat": 2, "mkdir": 1, "mkdirat": 2, "mknod": 1, "mknodat": 2}
REAL_TIME_POLICIES = (1, 2, 6)  # SCHED_FIFO, SCHED_RR, SCHED_DEADLINE


class Comparison(ctypes.Structure):
    _fields_ = [("argument", ctypes.c_uint), ("operator", ctypes.c_int), ("a", ctypes.c_uint64), ("b", ctypes.c_uint64)]


def directives(unit):
    found = {}
    for line in pathlib.Path(unit).read_text().splitlines():
        key, separator, value = line.partition("=")
        if separator and not line.startswith(("#", ";", "[")):
            found.setdefault(key.strip(), []).append(value.strip())
    return found


@functools.lru_cache(None)
def sets():
    """Lines of every set of calls by its name: calls, and sets within it."""
    text = subprocess.run(["systemd-analyze", "--no-pager", "syscall-filter"], capture_output=True, text=True, check=True).stdout
    found, lines = {}, []
    for line in text.splitlines():
        if line.startswith("@"):
            lines = found.setdefault(line.strip(), [])
        elif line.startswith(" ") and not line.strip().startswith("#"):
            lines.append(line.strip())
    return found


def calls_of(name):
    """Names of the calls of one set, sets within it included; a plain call is itself."""
    return frozenset().union(*map(calls_of, sets()[name])) if name.startswith("@") else frozenset([name])


def allowed_calls(filters):
    """Later lines add to or take from earlier ones, as in systemd.exec(5); @default is always allowed."""
    allowed = set(calls_of("@default"))
    for line in filters:
        names = frozenset().union(*(calls_of(name) for name in line.lstrip("~").split()))
        allowed = allowed - names if line.startswith("~") else allowed | names
    return allowed


class Filter:
    """One filter; the kernel lets a call through only when all loaded filters do."""

    def __init__(self, library, default):
        self.library = library
        self.context = ctypes.c_void_p(library.seccomp_init(ctypes.c_uint32(default)))

    def rule(self, action, call, *comparisons):
        number = self.library.seccomp_syscall_resolve_name(call.encode())
        if number < 0:
            return  # no such call on this architecture
        array = (Comparison * max(1, len(comparisons)))(*(Comparison(*each) for each in comparisons))
        status = self.library.seccomp_rule_add_array(self.context, ctypes.c_uint32(action), number, len(comparisons), array)
        if status < 0:
            raise OSError(-status, f"{call}: {os.strerror(-status)}")

    def load(self):
        status = self.library.seccomp_load(self.context)
        if status < 0:
            raise OSError(-status, f"seccomp_load: {os.strerror(-status)}")


def deny_arguments(denied, unit):
    def says(key):
        return unit.get(key, ["no"])[-1] in ("yes", "true", "1")

    if says("MemoryDenyWriteExecute"):
        both = mmap.PROT_WRITE | mmap.PROT_EXEC
        denied.rule(KILL, "mmap", (2, MASKED_EQUAL, both, both))
        denied.rule(KILL, "mprotect", (2, MASKED_EQUAL, mmap.PROT_EXEC, mmap.PROT_EXEC))
        denied.rule(KILL, "pkey_mprotect", (2, MASKED_EQUAL, mmap.PROT_EXEC, mmap.PROT_EXEC))
        denied.rule(KILL, "shmat", (2, MASKED_EQUAL, SHM_EXEC, SHM_EXEC))
    if "RestrictAddressFamilies" in unit:
        families = {int(getattr(socket, name)) for line in unit["RestrictAddressFamilies"] for name in line.split()}
        for family in range(max(families)):
            if family not in families:
                denied.rule(KILL, "socket", (0, EQUAL, family, 0))
        denied.rule(KILL, "socket", (0, GREATER, max(families), 0))
    if says("RestrictNamespaces"):
        denied.rule(KILL, "setns")
        for flag in NAMESPACES:
            denied.rule(KILL, "unshare", (0, MASKED_EQUAL, flag, flag))
            denied.rule(KILL, "clone", (0, MASKED_EQUAL, flag, flag))
    if says("RestrictRealtime"):
        for policy in REAL_TIME_POLICIES:
            denied.rule(KILL, "sched_setscheduler", (1, EQUAL, policy, 0))
    if says("RestrictSUIDSGID"):
        for call, argument in MODE_ARGUMENTS.items():
            for bit in SET_ID_BITS:
                denied.rule(KILL, call, (argument, MASKED_EQUAL, bit, bit))
    if says("LockPersonality"):
        denied.rule(KILL, "personality", (0, NOT_EQUAL, PERSONALITY_ASK, 0))


def confine(unit):
    """Puts this process, and all that it starts, under the unit's filters."""
    try:
        library = ctypes.CDLL("libseccomp.so.2")
    except OSError as error:
        raise FileNotFoundError(str(error)) from error
    library.seccomp_init.restype = ctypes.c_void_p
    denied = Filter(library, ALLOW)
    deny_arguments(denied, unit)
    allowed = Filter(library, KILL)
    calls = allowed_calls(unit["SystemCallFilter"])
    if os.geteuid() == 0:
        calls.add("fchown")  # SQLite's for a new file, as root alone; the service has a user of its own
    for call in sorted(calls):
        allowed.rule(ALLOW, call)
    # clone3 hides its flags behind a pointer: systemd answers ENOSYS, and glibc then takes clone.
    if unit.get("RestrictNamespaces", ["no"])[-1] == "yes":
        hidden = Filter(library, ALLOW)
        hidden.rule(0x00050000 | 38, "clone3")
        hidden.load()
    if os.geteuid() == 0:
        drop_capabilities()
    os.umask(int(unit.get("UMask", ["0022"])[-1], 8))
    denied.load()
    allowed.load()  # last: it need not let seccomp itself through for the other


def drop_capabilities():
    PR_CAPBSET_DROP, more_than_there_are = 24, 64
    libc = ctypes.CDLL(None)
    for capability in range(more_than_there_are):
        libc.prctl(PR_CAPBSET_DROP, capability, 0, 0, 0)


def mount(source, target, kind, flags, options=None):
    libc = ctypes.CDLL(None, use_errno=True)
    encoded = [each and str(each).encode() for each in (source, target, kind)]
    if libc.mount(*encoded, ctypes.c_ulong(flags), options and options.encode()) != 0:
        number = ctypes.get_errno()
        raise PermissionError(number, f"mount {target}: {os.strerror(number)}")


def own_mounts():
    """From here on mounts are seen by this process and its children alone."""
    CLONE_NEWNS, MS_REC, MS_PRIVATE = 0x20000, 16384, 1 << 18
    if ctypes.CDLL(None).unshare(CLONE_NEWNS) != 0:
        raise PermissionError("unshare: not permitted")
    mount(None, "/", None, MS_REC | MS_PRIVATE)


def narrow_file_system(state):
    MS_RDONLY, MS_REMOUNT, MS_BIND = 1, 32, 4096
    own_mounts()
    mount(state, state, None, MS_BIND)
    mount(None, "/", None, MS_REMOUNT | MS_BIND | MS_RDONLY)
    mount("proc", "/proc", "proc", 0, "subset=pid,hidepid=2")
    os.chdir(state)


def main():
    state = sys.argv[2] if sys.argv[1] == "--state" else None
    if state:
        del sys.argv[1:3]
    unit = directives(sys.argv[1])
    try:
        sets()  # asked before /proc changes
        if state:
            narrow_file_system(state)
        confine(unit)
    except (FileNotFoundError, PermissionError) as error:
        print(f"skipped: {error}", file=sys.stderr)
        sys.exit(SKIPPED)
    os.execvp(sys.argv[2], sys.argv[2:])


if __name__ == "__main__":
    main()
