"""rawlog_test.py STILLMAP MAKE_RAWLOG DRIVE: a drive as an MRPT rawlog through the command line. What is said of it, and the map made of
it, is that of the same drive as a folder."""

import gzip
import json
import pathlib
import subprocess
import sys
import tempfile
import unittest

PROGRAM, MAKE, DRIVE = sys.argv[1], sys.argv[2], pathlib.Path(sys.argv[3])
# What tells a map from another; the sources have names and checksums of their own.
OF_THE_MAP = ("regions", "packs", "trajectory.tum", "fates.bin")


def run(*words):
    return subprocess.run([PROGRAM, *map(str, words)], capture_output=True, text=True, timeout=240)


def contents(package):
    found = {}
    for name in OF_THE_MAP:
        place = package / name
        for file in sorted(place.rglob("*")) if place.is_dir() else [place]:
            if file.is_file():
                found[str(file.relative_to(package))] = file.read_bytes()
    return found


class Rawlog(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.temporary = tempfile.TemporaryDirectory()
        cls.addClassCleanup(cls.temporary.cleanup)
        cls.folder = pathlib.Path(cls.temporary.name)
        cls.rawlog = cls.folder / "drive.rawlog"
        subprocess.run([MAKE, DRIVE, cls.rawlog], check=True)

    def test_inspect_says_the_same(self):
        ours, folder = (json.loads(run("inspect", place, "--json").stdout) for place in (self.rawlog, DRIVE))
        self.assertEqual(ours["layout"], "rawlog")
        self.assertEqual(ours["notes"], ["poses are those of robot_pose"])
        for name in ("scans", "rate_hz", "has_poses", "relative_clock", "findings", "intensities", "sensors"):
            self.assertEqual(ours[name], folder[name], name)
        self.assertAlmostEqual(ours["path_length_m"], folder["path_length_m"], delta=1e-6)

    def test_build_makes_the_same_map(self):
        poses = self.folder / "poses.tum"
        poses.write_text("".join(f"{0.05 * i:.2f} {0.5 * i} 0 1.7 0 0 0 1\n" for i in range(100)))
        for place, name in ((self.rawlog, "a"), (DRIVE, "b")):
            done = run("build", place, "-o", self.folder / name, "--poses", poses, "--select", ":4", "--detector", "geometric")
            self.assertEqual(done.returncode, 0, done.stderr)
        a, b = contents(self.folder / "a"), contents(self.folder / "b")
        self.assertEqual(sorted(a), sorted(b))
        self.assertGreater(len(a), 1)
        for name in a:
            self.assertEqual(a[name], b[name], name)
        simplemap = self.folder / "a.simplemap"
        done = run("export", self.folder / "a", "--format", "simplemap", "-o", simplemap, "--json")
        self.assertEqual(done.returncode, 0, done.stderr)
        report = json.loads(done.stdout)
        self.assertGreater(report["counts"]["keyframes"], 1)
        self.assertIn(b"CSimpleMap", gzip.decompress(simplemap.read_bytes())[:64])

    def test_cut_off_is_read_as_far_as_it_goes(self):
        cut = self.folder / "cut.rawlog"
        cut.write_bytes(self.rawlog.read_bytes()[:self.rawlog.stat().st_size // 2])
        done = run("inspect", cut)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertRegex(done.stdout, r"could not be read to its end: .*; \d+ scans could")
        cut.write_bytes(self.rawlog.read_bytes()[:200])
        done = run("inspect", cut)
        self.assertEqual(done.returncode, 1)
        self.assertRegex(done.stderr, r"\Astillmap: [^\n]*no clouds; the rawlog could not be read to its end[^\n]*\n\Z")

    def test_memory_and_leftovers(self):
        left = set(pathlib.Path(tempfile.gettempdir()).glob("stillmap_rawlog_*"))
        run("inspect", self.rawlog)
        self.assertEqual(set(pathlib.Path(tempfile.gettempdir()).glob("stillmap_rawlog_*")) - left, set())


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
