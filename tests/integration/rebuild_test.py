"""rebuild_test.py STILLMAP DRIVE: `stillmap rebuild` as a server runs it: progress lines, kills in every stage, cancels,
limits of memory. DRIVE is the drive of sample_map.sh."""

import json
import os
import pathlib
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import unittest

PROGRAM, DRIVE = sys.argv[1], sys.argv[2]
# What may differ between two runs.
OF_THE_RUN = ("stage_seconds", "resumed_stages", "peak_rss_mib", "work_bytes")


class Rebuild(unittest.TestCase):
    def setUp(self):
        self.folder = pathlib.Path(tempfile.mkdtemp(prefix="stillmap-rebuild-"))
        self.addCleanup(shutil.rmtree, self.folder, ignore_errors=True)
        self.map, self.work, self.report = (self.folder / name for name in ("map", "work", "report.json"))

    def start(self, *more, **popen):
        """A rebuild that writes its progress to a pipe of its own: the process and the pipe's end to read."""
        reader, writer = os.pipe()
        program = subprocess.Popen(
            [PROGRAM, "rebuild", DRIVE, "-o", self.map, "--work", self.work, f"--json={self.report}", "--select", ":24",
             "--held-back-every", "3", "--detector", "geometric", "--gate", self.gate(), "--threads", "2", "--progress", "json",
             "--progress-fd", str(writer), *map(str, more)],
            pass_fds=[writer], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, **popen)
        os.close(writer)
        return program, os.fdopen(reader)

    def gate(self):
        file = self.folder / "gate.json"
        file.write_text('{"least_queries": 5}')
        return file

    def finish(self, program, reader):
        lines = [json.loads(line) for line in reader]
        errors = program.stderr.read()
        program.stderr.close()
        reader.close()
        return program.wait(timeout=60), lines, errors

    def result(self):
        report = json.loads(self.report.read_text())
        return {key: value for key, value in report.items() if key not in OF_THE_RUN}, report

    def wait_for(self, reader, stage):
        """Until the first line of a stage."""
        for line in reader:
            if json.loads(line)["stage"].startswith(stage):
                return True
        return False

    def test_goes_on_from_a_kill_in_every_stage_to_the_same_map_and_report(self):
        code, lines, errors = self.finish(*self.start())
        self.assertEqual(code, 0, errors)
        whole, report = self.result()
        self.assertEqual(report["resumed_stages"], [])
        self.assertEqual(whole["figures"]["map"]["queries"], 7)
        self.check_progress(lines)
        shutil.rmtree(self.map)
        shutil.rmtree(self.work)
        self.report.unlink()
        for stage in ("map: survey", "map: place", "map: tiles", "map: publish", "keep: resume", "keep: place", "keep: tiles",
                      "localize map", "localize keep", "compare keep"):
            program, reader = self.start()
            self.assertTrue(self.wait_for(reader, stage), stage)
            program.kill()
            code, _, _ = self.finish(program, reader)
            self.assertEqual(code, -signal.SIGKILL, stage)
            self.assertFalse(self.map.exists(), stage)
            self.assertFalse(self.report.exists(), stage)
        code, _, errors = self.finish(*self.start())
        self.assertEqual(code, 0, errors)
        again, report = self.result()
        self.assertEqual(again, whole)
        self.assertIn("map", report["resumed_stages"])
        self.assertEqual(sorted(each.name for each in self.folder.iterdir()), ["gate.json", "map", "report.json", "work"])

    def check_progress(self, lines):
        fractions = [line["fraction"] for line in lines]
        self.assertEqual(fractions, sorted(fractions))
        self.assertEqual((fractions[-1], lines[-1]["outcome"]), (1.0, "succeeded"))
        for line in lines[:-1]:
            self.assertEqual(list(line), ["stage", "done", "total", "fraction", "eta_s", "message"])

    def test_ends_within_two_seconds_of_a_cancel_and_goes_on_later(self):
        for stage, number in (("map: survey", signal.SIGTERM), ("map: fuse", signal.SIGINT), ("localize", signal.SIGTERM)):
            program, reader = self.start()
            self.assertTrue(self.wait_for(reader, stage), stage)
            began = time.monotonic()
            program.send_signal(number)
            code, lines, errors = self.finish(program, reader)
            self.assertLess(time.monotonic() - began, 2.0, stage)
            self.assertEqual(code, 130, stage)
            self.assertIn(f"stillmap: cancelled; finished work is kept in {self.work}; the same command goes on from there", errors)
            self.assertEqual(lines[-1]["outcome"], "cancelled")
        code, _, errors = self.finish(*self.start())
        self.assertEqual(code, 0, errors)
        self.assertIn("keep", self.result()[1]["resumed_stages"])

    def test_ends_in_words_without_memory_and_goes_on_with_more(self):
        program, reader = self.start()
        self.assertTrue(self.wait_for(reader, "map: place"))
        status = pathlib.Path(f"/proc/{program.pid}/status").read_text()
        used = 1024 * int(next(line.split()[1] for line in status.splitlines() if line.startswith("VmSize")))
        resource.prlimit(program.pid, resource.RLIMIT_AS, (used, used))
        code, _, errors = self.finish(program, reader)
        # By an exception; or by a library that cannot go on.
        self.assertNotEqual(code, 0)
        self.assertFalse(self.map.exists())
        program, reader = self.start()
        self.assertTrue(self.wait_for(reader, "map: resume"))
        code, _, errors = self.finish(program, reader)
        self.assertEqual(code, 0, errors)

    def test_fails_in_words_on_its_pipe_too(self):
        self.work.mkdir()
        (self.work / "thesis.tex").write_text("do not lose")
        code, lines, errors = self.finish(*self.start())
        self.assertEqual(code, 1)
        self.assertEqual(lines[-1]["outcome"], "failed")
        self.assertIn("other things", lines[-1]["message"])
        self.assertIn("other things", errors)
        self.assertTrue((self.work / "thesis.tex").exists())

    def test_estimates_what_it_needs_on_the_disk_and_makes_nothing(self):
        done = subprocess.run([PROGRAM, "rebuild", DRIVE, "--estimate", "--json"], capture_output=True, text=True)
        self.assertEqual(done.returncode, 0, done.stderr)
        estimate = json.loads(done.stdout)
        self.assertEqual(estimate["bytes"], estimate["package_bytes"] + estimate["work_bytes"])
        self.assertEqual(estimate["scans"], len(list((pathlib.Path(DRIVE) / "velodyne").iterdir())))
        self.assertGreater(estimate["points"], 1000 * estimate["scans"])
        self.assertEqual(list(self.folder.iterdir()), [])

    def test_a_map_that_does_not_pass_the_gate_is_made_and_ends_with_4(self):
        # More queries than scans are held back.
        gate = self.folder / "strict.json"
        gate.write_text('{"least_queries": 1000}')
        self.gate = lambda: gate
        code, lines, errors = self.finish(*self.start())
        self.assertEqual((code, errors), (4, ""))
        self.assertEqual(lines[-1]["outcome"], "succeeded")
        self.assertNotEqual(json.loads(self.report.read_text())["verdict"], "pass")
        self.assertTrue((self.map / "manifest.json").exists())

    def test_asks_for_what_is_missing(self):
        done = subprocess.run([PROGRAM, "rebuild", DRIVE, "--work", self.work], capture_output=True, text=True)
        self.assertEqual(done.returncode, 2)
        self.assertIn("--output", done.stderr)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
