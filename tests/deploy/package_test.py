#!/usr/bin/env python3
"""The Debian package: made, judged by lintian, installed into a folder of its own, upgraded, removed, purged.

usage: package_test.py BUILD_FOLDER
"""

import os
import pathlib
import subprocess
import sys
import tempfile
import unittest

import support

BUILD = pathlib.Path(sys.argv[1])
# Of the first version there is no bug to close; more is not let pass.
KNOWN_WARNINGS = {"initial-upload-closes-no-bugs"}
UNIT = "etc/systemd/system/multi-user.target.wants/stillmap.service"
CONFIG = "etc/stillmap/stillmap.json"


def run(command, **options):
    return subprocess.run(list(map(str, command)), capture_output=True, text=True, timeout=200, **options)


class Package(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        temporary = tempfile.TemporaryDirectory()
        cls.addClassCleanup(temporary.cleanup)
        cls.folder = pathlib.Path(temporary.name)
        cls.package = support.make_package(BUILD, cls.folder)

    def setUp(self):
        temporary = tempfile.TemporaryDirectory(dir=self.folder)
        self.addCleanup(temporary.cleanup)
        self.root = pathlib.Path(temporary.name)
        for name in ("var/lib/dpkg/updates", "var/lib/dpkg/info", "etc", "tmp"):
            (self.root / name).mkdir(parents=True)
        (self.root / "var/lib/dpkg/status").touch()

    def dpkg(self, *arguments):
        """Maintainer scripts run, told by DPKG_ROOT where; what they depend on is this machine's."""
        fake = [] if os.geteuid() == 0 else ["fakeroot"]
        done = run([*fake, "dpkg", f"--root={self.root}", f"--log={self.root}/dpkg.log", "--force-depends",
                    "--force-script-chrootless", "--force-confold", *arguments])
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        return done.stderr

    def left(self):
        return [str(path.relative_to(self.root)) for path in self.root.rglob("*") if "stillmap" in str(path.relative_to(self.root))]

    def test_lintian_finds_no_error(self):
        done = run(["lintian", "--allow-root", "--fail-on", "error", self.package])
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        warned = {line.split()[2] for line in done.stdout.splitlines() if line.startswith("W:")}
        self.assertLessEqual(warned, KNOWN_WARNINGS, done.stdout)

    def test_installed_it_serves(self):
        self.dpkg("-i", self.package)
        self.assertIn("stillmap:", (self.root / "etc/passwd").read_text())
        self.assertTrue((self.root / UNIT).is_symlink())
        program, store = self.root / "usr/bin/stillmap", self.root / "var/lib/stillmap"
        store.mkdir()
        server = self.root / "tmp/server.log"
        with server.open("w") as log:
            process = subprocess.Popen([program, "serve", "--config", self.root / CONFIG, "--store", store, "--port", "0",
                                        "--management-port", "0", "--drain-delay-s", "0"], stdout=subprocess.PIPE, stderr=log,
                                       text=True)
        try:
            port = int(process.stdout.readline().rsplit(":", 1)[1].rstrip("/\n"))
            self.assertEqual(support.get(port, "/livez")[0], 200)
            if (self.root / "usr/share/stillmap/web/index.html").exists():
                self.assertEqual(support.get(port, "/")[0], 200)
        finally:
            process.terminate()
            process.communicate(timeout=30)
        self.assertEqual(process.returncode, 0, server.read_text())
        mapper = run([program, "build", "--help"])
        self.assertEqual(mapper.returncode, 0, mapper.stderr)
        for file, shell in (("bash-completion/completions/stillmap", "bash"), ("zsh/vendor-completions/_stillmap", "zsh")):
            self.assertEqual((self.root / "usr/share" / file).read_text(), run([program, "completion", shell]).stdout)

    def test_an_upgrade_keeps_what_the_operator_changed(self):
        self.dpkg("-i", self.package)
        (self.root / CONFIG).write_text('{"store": "/srv"}\n')
        self.dpkg("-i", self.package)
        self.assertEqual((self.root / CONFIG).read_text(), '{"store": "/srv"}\n')
        self.dpkg("-r", "stillmap")
        self.assertTrue((self.root / CONFIG).exists())
        self.assertFalse((self.root / "usr/bin/stillmap").exists())

    def test_a_purge_leaves_nothing_but_maps(self):
        self.dpkg("-i", self.package)
        store = self.root / "var/lib/stillmap"
        store.mkdir()
        (store / "state.db").touch()
        self.assertIn("stay", self.dpkg("-P", "stillmap"))
        self.assertEqual(sorted(self.left()), ["var/lib/stillmap", "var/lib/stillmap/state.db"])
        (store / "state.db").unlink()
        self.dpkg("-i", self.package)
        self.dpkg("-P", "stillmap")
        self.assertEqual(self.left(), [])


if __name__ == "__main__":
    for name in ("cpack", "lintian", "systemd-sysusers", *([] if os.geteuid() == 0 else ["fakeroot"])):
        support.tool(name)
    unittest.main(argv=sys.argv[:1])
