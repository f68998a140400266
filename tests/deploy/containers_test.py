#!/usr/bin/env python3
"""The image of server/deploy/containers, built by podman and run with the options of server/deploy/README.md.

usage: containers_test.py BUILD_FOLDER TOOLS

TOOLS holds podman and its parts unpacked, and a small Debian 12 (debian.tar) as the image to start from: ./dev test gets
both. This process alone sees the tools, over /usr, and what podman writes into /etc, /run and /var, in a mount namespace of
its own. That needs root.
"""

import json
import os
import pathlib
import re
import shlex
import subprocess
import sys
import tempfile
import time
import unittest

import sandbox
import support

TOOLS = pathlib.Path(sys.argv[2])
DEBIAN = TOOLS / "debian.tar"
# What apt says where it reaches no mirror.
OFFLINE = ("Temporary failure resolving", "Could not connect", "Cannot initiate the connection", "Unable to locate package")
PAGE = (support.DEPLOY / "README.md").read_text().replace("\\\n", "")
# The options and the command that the page has: of the server, and of what makes a key.
SERVER = shlex.split(re.search(r"docker run --detach --name stillmap (.*?) -p ", PAGE)[1])
KEY = shlex.split(re.search(r"docker run --rm (.*)", PAGE)[1])
# What this test must do without: a network, control groups, timers of systemd.
HERE = ["--network", "none", "--cgroups", "disabled", "--health-interval", "disable",
        "--ulimit", "nofile=1024:1024", "--ulimit", "nproc=1024:1024"]


def own_view():
    """Lays the unpacked packages over /usr, and folders that end with this process over those that podman writes into."""
    if os.geteuid() != 0:
        support.skip_program("only root can mount what the containers need")
    for needed in (TOOLS / "usr/bin/podman", DEBIAN):
        if not needed.exists():
            support.skip_program(f"no {needed}: ./dev test gets it")
    try:
        sandbox.own_mounts()
        sandbox.mount("overlay", "/usr", "overlay", 0, f"lowerdir={TOOLS.resolve()}/usr:/usr")
        # crun refuses control groups of both versions side by side.
        sandbox.mount("none", "/sys/fs/cgroup", "cgroup2", 0)
        sandbox.mount("none", "/mnt", "tmpfs", 0)
        for name in ("etc", "run", "var", "dev/shm"):
            upper, work = pathlib.Path("/mnt", name, "upper"), pathlib.Path("/mnt", name, "work")
            upper.mkdir(parents=True)
            work.mkdir()
            sandbox.mount("overlay", f"/{name}", "overlay", 0, f"lowerdir=/{name},upperdir={upper},workdir={work}")
    except OSError as error:
        support.skip_program(str(error))


class Containers(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        temporary = tempfile.TemporaryDirectory()
        cls.addClassCleanup(temporary.cleanup)
        cls.folder = pathlib.Path(temporary.name)
        cls.addClassCleanup(cls.podman, "system", "reset", "--force")
        settings = cls.folder / ".config" / "containers"
        settings.mkdir(parents=True)
        (settings / "policy.json").write_text(json.dumps({"default": [{"type": "insecureAcceptAnything"}]}))
        cls.must("import", DEBIAN, "docker.io/library/debian:12-slim")
        support.make_package(pathlib.Path(sys.argv[1]), cls.folder / "package")
        built = cls.podman("build", "--isolation", "chroot", "--layers=false", "--format", "docker", "-t", "stillmap",
                           "-f", support.DEPLOY / "containers" / "Dockerfile", cls.folder / "package")
        said = built.stdout + built.stderr
        if built.returncode != 0 and any(words in said for words in OFFLINE):
            cls.doClassCleanups()
            support.skip_program("Debian's mirror cannot be reached")
        assert built.returncode == 0, said

    @classmethod
    def podman(cls, *arguments):
        state = cls.folder / "state"
        return subprocess.run(["podman", "--root", state / "root", "--runroot", state / "run", "--tmpdir", state / "tmp",
                               "--cgroup-manager", "cgroupfs", "--events-backend", "none", "--runtime", "crun",
                               *map(str, arguments)], capture_output=True, text=True, timeout=240,
                              env={**os.environ, "HOME": str(cls.folder), "TMPDIR": str(cls.folder)})

    @classmethod
    def must(cls, *arguments):
        done = cls.podman(*arguments)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout.strip()

    def ask(self, path, *options):
        return self.podman("exec", "server", "curl", "-sS", "-o", "/dev/null", "-w", "%{http_code}", *options,
                           f"http://127.0.0.1:8080{path}").stdout

    def test_it_wants_a_key_then_serves_is_healthy_and_ends_when_told(self):
        refused = self.podman("run", "--rm", *HERE, *SERVER, "stillmap")
        self.assertEqual(refused.returncode, 2, refused.stderr)
        self.assertIn("a store without keys", refused.stderr)
        made = self.podman("run", "--rm", *HERE, *KEY)
        self.assertEqual(made.returncode, 0, made.stderr)
        self.must("run", "--detach", "--name", "server", *HERE, *SERVER, "stillmap")
        support.wait(lambda: self.podman("healthcheck", "run", "server").returncode == 0)
        self.assertEqual(self.ask("/v1/keys"), "401")
        self.assertEqual(self.ask("/v1/keys", "-H", f"Authorization: Bearer {made.stdout.strip()}"), "200")
        self.assertEqual(self.ask("/"), "200" if self.has_page() else "404")
        self.assertEqual(self.must("exec", "server", "id", "-u"), "10001")
        self.assertNotEqual(self.podman("exec", "server", "touch", "/var/lib/other").returncode, 0)
        begin = time.monotonic()
        self.must("stop", "server")
        self.assertLess(time.monotonic() - begin, 40)
        self.assertEqual(self.must("inspect", "--format", "{{.State.ExitCode}}", "server"), "0")

    def has_page(self):
        return self.podman("exec", "server", "test", "-e", "/usr/share/stillmap/web/index.html").returncode == 0


if __name__ == "__main__":
    own_view()
    unittest.main(argv=sys.argv[:1])
