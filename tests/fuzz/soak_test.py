#!/usr/bin/env python3
"""What soak.py counts of a program that prints what libFuzzer would."""

import json
import pathlib
import tempfile
import unittest

import soak

# Half a second of processor in silence, then an edge.
PROGRAM = """#!/usr/bin/env python3
import sys, time
while time.process_time() < 0.5: pass
print("\\tNEW_PC: 0x5555deadbeef in read_it /src/reader.cpp:7:1\\n#12\\tNEW    cov: 3 ft: 4", file=sys.stderr)
sys.exit({status})
"""


class Counting(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)

    def target(self, status=0):
        program = self.folder / "fuzz_pcd"
        program.write_text(PROGRAM.format(status=status))
        program.chmod(0o700)
        return soak.Target(program, self.folder / "pcd")

    def test_an_edge_counts_from_when_it_was_reached(self):
        target = self.target()
        self.assertTrue(target.run(1))
        self.assertGreater(target.state["cpu_s_at_last_edge"], 0.4)
        self.assertEqual((target.state["inputs"], target.state["edges"]), (12, 3))
        self.assertIn("reader.cpp:7", target.edges_file.read_text())

    def test_an_edge_that_a_run_had_seen_is_not_new(self):
        target = self.target()
        target.run(1)
        last = target.state["cpu_s_at_last_edge"]
        target.run(1)
        self.assertEqual(target.state["cpu_s_at_last_edge"], last)
        self.assertGreater(target.quiet_s(), 0.4)

    def test_a_killed_run_does_not_forget_its_edge(self):
        target = self.target()
        target.take_edge("0x1", " in f")
        self.assertIn("cpu_s_at_last_edge", json.loads(target.state_file.read_text()))

    def test_a_slice_ends_when_the_target_is_done(self):
        target = self.target()
        self.assertEqual(target.slice_s(), soak.SLICE_S)
        target.state |= {"inputs": soak.LEAST_INPUTS, "cpu_s": soak.QUIET_CPU_S + 99.5, "cpu_s_at_last_edge": 199.0}
        self.assertEqual(target.slice_s(), 100)
        target.state["cpu_s"] += 98.0
        self.assertEqual(target.slice_s(), soak.LEAST_SLICE_S)
        target.state["inputs"] = 0
        self.assertEqual(target.slice_s(), soak.SLICE_S)

    def test_counts_and_edges_of_another_program_say_nothing(self):
        target = self.target()
        target.begin()
        target.run(1)
        target.save()
        other = self.target(status=1)
        other.begin()
        self.assertEqual((other.state["inputs"], other.state["cpu_s"], other.edges_file.exists()), (0, 0.0, False))
        self.assertFalse(other.run(1))


if __name__ == "__main__":
    unittest.main()
