#!/usr/bin/env python3
"""The programs as a shell meets them: exit codes, errors of one line, output for machines, a clean Ctrl-C.

usage: command_line_test.py STILLMAP MAP DRIVE
"""

import http.client
import json
import os
import pathlib
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import unittest

PROGRAM, MAP, STORE, DRIVE = sys.argv[1:5]
SCAN = pathlib.Path(DRIVE) / "velodyne/000001.bin"


def run(*arguments):
    return subprocess.run([PROGRAM, *map(str, arguments)], capture_output=True, text=True, timeout=60)


class CommandLine(unittest.TestCase):
    def setUp(self):
        self.temporary = tempfile.TemporaryDirectory()
        self.folder = pathlib.Path(self.temporary.name)
        self.addCleanup(self.temporary.cleanup)

    def fails(self, code, text, *arguments):
        done = run(*arguments)
        self.assertEqual(done.returncode, code, done.stderr)
        self.assertRegex(done.stderr, r"\Astillmap: [^\n]*\n\Z")
        self.assertIn(text, done.stderr)
        self.assertEqual(done.stdout, "")

    def test_full_disks_are_3(self):
        cloud = self.folder / "one.ply"
        axes = "".join(f"property float {axis}\n" for axis in "xyz")
        cloud.write_text(f"ply\nformat ascii 1.0\nelement vertex 1\n{axes}end_header\n1 2 3\n")
        done = run("import", cloud, "-o", self.folder / "map", "--json=/dev/full")
        self.assertEqual(done.returncode, 3, done.stderr)
        self.assertIn("No space left", done.stderr)

    def test_help_lists_every_command(self):
        text = run("--help").stdout
        for command in ("build", "rebuild", "import", "export", "calibrate", "simulate", "evaluate", "localize", "serve", "inspect", "store", "keys", "audit"):
            self.assertRegex(text, rf"(?m)^  {command}\b")
            of_command = run(command, "--help")
            self.assertEqual(of_command.returncode, 0, command)
            self.assertIn(of_command.stdout.splitlines()[0].strip(), " ".join(text.split()), command)
        for what in ("localization", "map", "detector", "odometry", "paper", "paper-odometry"):
            self.assertIn("--json", run("evaluate", what, "--help").stdout)

    def test_usage_errors_are_2_and_name_the_value(self):
        new = self.folder / "map"
        self.fails(2, "frobnicate", "frobnicate")
        self.fails(2, "DRIVE", "build")
        self.fails(2, "nowhere", "build", "nowhere", "-o", new)
        self.fails(2, "a:b", "build", DRIVE, "-o", new, "--select", "a:b")
        self.fails(2, "eat", "build", DRIVE, "-o", new, "--movable", "eat")
        self.fails(2, "magic", "build", DRIVE, "-o", new, "--detector", "magic")
        self.fails(2, "voxel_size_m", "build", DRIVE, "-o", new, "--voxel", "nan")
        self.fails(2, "no_folder", "build", DRIVE, "-o", new, f"--json={self.folder / 'no_folder/a.json'}")
        self.fails(2, "--edits needs --fusion on", "build", DRIVE, "-o", new, "--preset", "paper", "--edits", SCAN)
        self.fails(2, "--fill", "build", DRIVE, "-o", new, "--fusion", "off", "--fill", "on")
        self.fails(2, "--fill", "build", DRIVE, "-o", new, "--movable", "delete", "--fill", "on")
        self.fails(2, "magic", "build", DRIVE, "-o", new, "--odometry", "magic")
        self.fails(2, "--pose-sigma", "build", DRIVE, "-o", new, "--odometry", "default", "--pose-sigma", "1")
        self.fails(2, "found given beside", "build", DRIVE, "-o", new, "--odometry", "given", "--gnss-sigma", "1")
        self.fails(2, "gnss_sigma_m", "build", DRIVE, "-o", new, "--gnss-sigma", "-1")
        self.fails(2, "'1,2'", "localize", MAP, SCAN, "--prior", "1,2")
        self.fails(2, "'1'", "evaluate", "localization", MAP, DRIVE, "--prior-error", "1")
        self.fails(2, "--query-detector", "evaluate", "localization", MAP, DRIVE, "--query-detector", "geometric")
        self.fails(2, "magic", "evaluate", "detector", DRIVE, "--detector", "magic")
        self.fails(2, "max_range_m", "evaluate", "detector", DRIVE, "--max-range", "nan")
        self.fails(2, "magic", "evaluate", "localization", MAP, DRIVE, "--query-movable", "delete", "--query-detector",
                   "magic")
        work = self.folder / "work"
        self.fails(2, "3 drives", "evaluate", "paper", "--drives", DRIVE, DRIVE, DRIVE, "--work", work)
        self.fails(2, "no effect with --drives", "evaluate", "paper", "--drives", DRIVE, DRIVE, "--scans", "9")
        self.fails(2, "scans: 2", "evaluate", "paper", "--scans", "2", "--work", work)
        self.fails(2, "magic", "evaluate", "paper", "--maps", "none,magic")
        self.fails(2, "magic", "evaluate", "paper", "--methods", "magic")
        self.fails(2, "--mount needs 6 values: X,Y,Z,ROLL,PITCH,YAW", "simulate", "-o", new, "--mount", "1,2,3")
        self.fails(2, "too many arguments", "calibrate", DRIVE, *[DRIVE] * 16)
        self.fails(2, "0.0.0.0", "serve", "--store", self.folder, "--host", "0.0.0.0")
        self.assertEqual(list(self.folder.iterdir()), [])

    def test_broken_input_is_1_and_names_file_found_and_expected(self):
        broken = self.folder / "broken.bin"
        broken.write_bytes(b"x" * 1001)
        self.fails(1, "broken.bin: found 1001 bytes, expected", "localize", MAP, broken, "--prior", "0,0,0,0")
        self.fails(1, "expected", "inspect", self.folder)
        self.fails(1, "existing path", "build", DRIVE, "-o", MAP)

    def test_reports_are_written_into_links_and_pipes_not_over_them(self):
        link, pipe = self.folder / "link.json", self.folder / "pipe.json"
        link.symlink_to(self.folder / "report.json")
        os.mkfifo(pipe)
        reader = subprocess.Popen(["cat", pipe], stdout=subprocess.PIPE)
        for number, report in enumerate((link, pipe)):
            done = run("build", DRIVE, "-o", self.folder / str(number), "--select", ":1", f"--json={report}")
            self.assertEqual(done.returncode, 0, done.stderr)
        self.assertTrue(link.is_symlink())
        self.assertTrue(pipe.is_fifo())
        self.assertEqual(json.loads(link.read_text())["scans"], 1)
        self.assertEqual(json.loads(reader.communicate(timeout=10)[0])["scans"], 1)

    def test_calibrate_takes_links_and_opens_all_drives_before_it_begins(self):
        for name in ("front", "rear"):
            (self.folder / name).symlink_to(DRIVE)
        (self.folder / "side").mkdir()
        lidars = self.folder / "lidars.json"
        self.fails(1, "side: found no layout", "calibrate", self.folder / "front/", self.folder / "rear", self.folder / "side",
                   "-o", lidars)
        self.fails(1, "links to them", "calibrate", DRIVE, self.folder / "rear", "-o", lidars)

    def test_build_leaves_nothing_when_a_scan_is_broken(self):
        drive = self.folder / "drive"
        drive.mkdir()
        for i in range(3):
            (drive / f"{i}.bin").write_bytes(SCAN.read_bytes() if i < 2 else b"123")
        (self.folder / "poses.txt").write_text("1 0 0 0 0 1 0 0 0 0 1 0\n" * 3)
        self.fails(1, "2.bin: found 3 bytes", "build", drive, "-o", self.folder / "map", "--poses",
                   self.folder / "poses.txt")
        self.assertEqual(sorted(each.name for each in self.folder.iterdir()), ["drive", "poses.txt"])

    def test_a_killed_build_goes_on_to_the_same_bytes(self):
        whole, killed = self.folder / "whole", self.folder / "killed"
        result = self.folder / "result.json"
        options = ["--select", ":12", f"--json={result}"]
        run("build", DRIVE, "-o", whole, *options)
        digest = json.loads(result.read_text())["digest"]
        journal = self.folder / ".killed.partial/journal/survey.journal"
        for threads in ("1", "2"):
            program = subprocess.Popen([PROGRAM, "build", DRIVE, "-o", killed, *map(str, options), "--threads", threads],
                                       stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
            # From where the last one was killed, some scans more.
            enough = (journal.stat().st_size if journal.exists() else 0) + 300_000
            while program.poll() is None and not (journal.exists() and journal.stat().st_size > enough):
                time.sleep(0.002)
            program.kill()
            self.assertEqual(program.wait(timeout=30), -signal.SIGKILL)
        done = run("build", DRIVE, "-o", killed, *options)
        self.assertEqual(done.returncode, 0, done.stderr)
        report = json.loads(result.read_text())
        self.assertEqual((report["digest"], report["warnings"]), (digest, []))
        self.assertGreater(report["resumed_scans"], 0)
        self.assertIn("of these resumed", done.stdout)
        self.assertEqual(sorted(each.name for each in self.folder.iterdir()), ["killed", "result.json", "whole"])

    def test_a_cancelled_build_says_what_is_kept_and_goes_on_from_there(self):
        target, result = self.folder / "map", self.folder / "result.json"
        journal = self.folder / ".map.partial/journal"
        command = [PROGRAM, "build", DRIVE, "-o", target, "--select", ":12"]
        program = subprocess.Popen([*map(str, command)], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        survey = journal / "survey.journal"
        while program.poll() is None and not (survey.exists() and survey.stat().st_size > 300_000):
            time.sleep(0.002)
        program.send_signal(signal.SIGINT)
        _, errors = program.communicate(timeout=30)
        self.assertEqual(program.returncode, 130, errors)
        self.assertEqual(errors.splitlines()[-1], f"stillmap: cancelled; finished work is kept in {journal}; the same command "
                         "goes on from there")
        self.assertTrue(journal.exists())
        done = run(*command[1:], f"--json={result}")
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertGreater(json.loads(result.read_text())["resumed_scans"], 0)

    def test_standard_output_holds_json_alone(self):
        page = self.folder / "page.html"
        done = run("evaluate", "detector", DRIVE, "--select", ":2", "--json", "--report", page)
        self.assertEqual((done.returncode, done.stderr), (0, f"report: {page}\n"))
        self.assertEqual(json.loads(done.stdout)["scans"], 2)
        self.assertIn("stillmap evaluate detector", page.read_text())
        done = run("evaluate", "detector", DRIVE, "--select", ":2", "--report", page)
        self.assertTrue(done.stdout.endswith(f"report: {page}\n"))
        done = run("build", DRIVE, "-o", self.folder / "map", "--select", ":1", "--json")
        self.assertEqual(json.loads(done.stdout)["scans"], 1)
        with open("/dev/full", "w") as full:
            done = subprocess.run([PROGRAM, "inspect", MAP, "--json"], stdout=full, stderr=subprocess.PIPE, text=True)
        self.assertEqual((done.returncode, done.stderr), (3, "stillmap: standard output: No space left on device; send it to a disk with free space\n"))

    def test_work_of_a_killed_build_with_other_options_is_thrown_away_in_words(self):
        target, journal = self.folder / "map", self.folder / ".map.partial/journal/survey.journal"
        program = subprocess.Popen([PROGRAM, "build", DRIVE, "-o", target, "--voxel", "0.3"], stderr=subprocess.DEVNULL)
        while program.poll() is None and not (journal.exists() and journal.stat().st_size > 100_000):
            time.sleep(0.002)
        program.kill()
        program.wait(timeout=30)
        done = run("build", DRIVE, "-o", target, "--select", ":2")
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("warning: work of a killed build was thrown away", done.stdout)
        self.assertNotIn("resumed", done.stdout)
        self.assertEqual([each.name for each in self.folder.iterdir()], ["map"])

    def test_a_drive_without_poses_becomes_a_map_in_which_it_is_found(self):
        drive, new, path = self.folder / "drive", self.folder / "map", self.folder / "path.tum"
        shutil.copytree(DRIVE, drive)
        (drive / "poses.txt").unlink()
        self.fails(1, "a drive without poses", "build", drive, "-o", new, "--odometry", "given")
        done = run("build", drive, "-o", new, "--select", ":16", "--detector", "geometric", f"--json={self.folder / 'b.json'}")
        self.assertEqual(done.returncode, 0, done.stderr)
        counts = json.loads((self.folder / "b.json").read_text())["trajectory"]
        self.assertEqual(counts["scans_predicted"], 0)
        self.assertGreater(counts["key_frames"], 1)
        options = json.loads((new / "manifest.json").read_text())["options"]
        self.assertEqual((options["odometry"], options["loops"]), ("default", "on"))
        # The drive's true poses say what the map's are worth.
        done = run("evaluate", "odometry", DRIVE, "--select", ":16", "--loops", "off", "--trajectory", path,
                   f"--json={self.folder / 'o.json'}")
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertLess(json.loads((self.folder / "o.json").read_text())["ate_rmse_m"], 0.05)
        done = run("evaluate", "localization", new, drive, "--poses", path, "--select", "5:16:5", "--prior-error", "1,5",
                   f"--json={self.folder / 'l.json'}")
        self.assertEqual(done.returncode, 0, done.stderr)
        (level,) = json.loads((self.folder / "l.json").read_text())["levels"]
        self.assertEqual(level["success_rate"], 1.0)

    def test_localize_answers_like_the_server(self):
        answer = json.loads(run("localize", MAP, SCAN, "--prior", "0,0,0,5", "--json").stdout)
        self.assertEqual(answer["status"], "ok")
        self.assertEqual(len(answer["covariance"]), 36)
        by_quaternion = json.loads(run("localize", MAP, SCAN, "--prior",
                                       "0,0,0,0,0,0.04361938736533600,0.99904822158185780", "--json").stdout)
        for a, b in zip(answer["pose"]["position"], by_quaternion["pose"]["position"]):
            self.assertAlmostEqual(a, b, places=6)

    def test_localize_leaves_out_what_boxes_hold(self):
        boxes = self.folder / "boxes.json"

        def write(scan, size):
            box = {"centre": [0, 0, 0], "size": size, "yaw": 0.5, "class": "car"}
            scans = [{"scan": scan, "boxes": [box]}]
            boxes.write_text(json.dumps({"format": "stillmap-boxes", "version": 1, "scans": scans}))

        write(0, [20, 4, 6])
        answer = json.loads(run("localize", MAP, SCAN, "--prior", "0,0,0,5", "--boxes", boxes, "--json").stdout)
        self.assertGreater(answer["movable_points"], 0)
        self.assertNotEqual(answer["status"], "lost")
        counts = json.loads(run("localize", MAP, DRIVE, "--select", ":1", "--boxes", boxes, "--json").stdout)
        self.assertGreater(counts["movable_points"], 0)
        write(1, [20, 4, 6])
        self.fails(1, "boxes.json: found no boxes of scan 0", "localize", MAP, SCAN, "--boxes", boxes)
        write(0, [200, 4, 6])
        self.fails(2, "box 0: found size 200", "localize", MAP, SCAN, "--boxes", boxes)

    def test_localize_follows_a_drive(self):
        poses, counts = self.folder / "poses.tum", self.folder / "counts.json"
        done = run("localize", MAP, DRIVE, "--select", "1::4", "-o", poses, f"--json={counts}")
        self.assertEqual(done.returncode, 0, done.stderr)
        result = json.loads(counts.read_text())
        self.assertEqual(sum(result["status"].values()), result["scans"])
        self.assertEqual(result["status"]["lost"], 0)
        self.assertGreater(result["status"]["ok"], result["scans"] // 2)
        for key in ("reasons", "seconds", "options", "version", "ms", "map"):
            self.assertIn(key, result)
        self.assertEqual([len(line.split()) for line in poses.read_text().splitlines()], [8] * result["scans"])
        self.assertEqual(sorted(each.name for each in self.folder.iterdir()), ["counts.json", "poses.tum"])
        first = run("localize", MAP, DRIVE, "--select", ":2", "--prior", "0,0,0,0").stdout.splitlines()
        self.assertEqual([line.split()[2] for line in first], ["ok", "ok"])
        self.assertEqual(json.loads(run("localize", MAP, DRIVE, "--select", ":2", "--json").stdout)["scans"], 2)

    def test_localize_writes_nothing_when_nothing_is_found_or_it_is_cancelled(self):
        poses = self.folder / "poses.tum"
        done = run("localize", MAP, DRIVE, "--select", ":1", "--prior", "900,0,0,0", "-o", poses)
        self.assertEqual(done.returncode, 1, done.stderr)
        self.fails(2, "selects none", "localize", MAP, DRIVE, "--select", "5:5", "-o", poses)
        self.fails(2, "are for drives", "localize", MAP, SCAN, "-o", poses)
        program = subprocess.Popen([PROGRAM, "localize", MAP, DRIVE], stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                                   text=True)
        program.stdout.readline()
        program.send_signal(signal.SIGINT)
        _, errors = program.communicate(timeout=30)
        self.assertEqual((program.returncode, errors), (130, "stillmap: cancelled; nothing was written; the same command starts anew\n"))
        self.assertEqual(list(self.folder.iterdir()), [])

    def test_lost_is_1_and_has_no_pose(self):
        done = run("localize", MAP, SCAN, "--prior", "900,0,0,0", "--json")
        self.assertEqual(done.returncode, 1)
        self.assertEqual(json.loads(done.stdout)["pose"], None)

    def test_export_says_what_it_wrote_and_what_it_takes(self):
        out = self.folder / "tiles"
        report = json.loads(run("export", MAP, "--format", "3dtiles", "-o", out, "--without", "projected,filled", "--json").stdout)
        self.assertEqual(report["format"], "3dtiles")
        self.assertEqual(report["files"], sum(file.is_file() for file in out.rglob("*")))
        self.fails(1, "an existing path", "export", MAP, "--format", "3dtiles", "-o", out)
        self.fails(2, "--format", "export", MAP, "--format", "shp", "-o", self.folder / "shp")
        self.fails(2, "--without", "export", MAP, "--format", "3dtiles", "-o", self.folder / "a", "--without", "cars")
        self.assertIn("3dtiles", run("export", "--help").stdout)

    def test_inspect_tells_maps_from_drives(self):
        self.assertEqual(json.loads(run("inspect", MAP, "--json").stdout)["kind"], "map")
        drive = json.loads(run("inspect", DRIVE, "--json").stdout)
        self.assertEqual((drive["kind"], drive["layout"], drive["has_poses"]), ("drive", "kitti_odometry", True))

    def test_content_is_the_same_of_maps_that_hold_the_same(self):
        for name, options in (("one", []), ("other", ["--threads", 1]), ("less", ["--max-range", 20])):
            done = run("build", DRIVE, "-o", self.folder / name, "--select", ":1", *options)
            self.assertEqual(done.returncode, 0, done.stderr)
        one, other, less = (run("inspect", self.folder / name, "--content").stdout for name in ("one", "other", "less"))
        self.assertRegex(one, r"\A[0-9a-f]{64}\n\Z")
        self.assertEqual(one, other)
        self.assertNotEqual(one, less)
        summary = json.loads(run("inspect", self.folder / "one", "--content", "--json").stdout)
        self.assertEqual((summary["kind"], summary["content_digest"]), ("map", one.strip()))
        self.assertNotIn("content_digest", json.loads(run("inspect", self.folder / "one", "--json").stdout))
        self.fails(2, "is for map packages", "inspect", DRIVE, "--content")

    def test_build_ends_with_what_it_made_and_what_to_do_next(self):
        made, report = self.folder / "the map", self.folder / "report.json"
        done = run("build", DRIVE, "-o", made, "--select", ":1", f"--json={report}")
        self.assertEqual(done.returncode, 0, done.stderr)
        last = [line.split(None, 1) for line in done.stdout.splitlines()[-4:]]
        self.assertEqual(last, [["made", str(made)], ["picture", str(made / "preview.png")], ["result", str(report)],
                                ["next", f"{PROGRAM} serve '{made}'"]])
        self.assertTrue((made / "preview.png").exists())

    def test_evaluate_writes_its_keys(self):
        file = self.folder / "result.json"
        done = run("evaluate", "localization", MAP, DRIVE, "--select", "1::8", "--prior-error", "0.5,2", "--prior-error",
                   "1,5", f"--json={file}")
        self.assertEqual(done.returncode, 0, done.stderr)
        result = json.loads(file.read_text())
        self.assertEqual([level["prior_error_m"] for level in result["levels"]], [0.5, 1])
        self.assertEqual(result["levels"][0]["queries"], 5)
        for key in ("scans", "seconds", "options", "version"):
            self.assertIn(key, result)

    def test_evaluate_map_measures_without_truth_what_the_build_reported(self):
        made, report, file = self.folder / "made", self.folder / "build.json", self.folder / "result.json"
        build = run("build", DRIVE, "-o", made, "--select", ":4", "--detector", "geometric", f"--json={report}")
        self.assertEqual(build.returncode, 0, build.stderr)
        built = json.loads(report.read_text())
        done = run("evaluate", "map", made, f"--json={file}")
        self.assertEqual(done.returncode, 0, done.stderr)
        result = json.loads(file.read_text())
        self.assertEqual(list(result), ["consistency", "version", "options"])
        self.assertEqual(result["consistency"], built["consistency"])
        self.assertEqual(result["consistency"], json.loads((made / "build.json").read_text())["consistency"])
        self.assertGreater(result["consistency"]["walls"]["planar_cells"], 100)
        for line in ("mean map entropy", "thickness of walls, median", "thickness of ground, median"):
            self.assertIn(line, build.stdout)
            self.assertIn(line, done.stdout)
        done = run("evaluate", "map", made, "--truth", DRIVE, f"--json={file}")
        self.assertEqual(done.returncode, 0, done.stderr)
        judged = json.loads(file.read_text())
        self.assertEqual(judged["consistency"], built["consistency"])
        self.assertIn("static_loss", judged)
        self.assertIn("thickness of walls, median", done.stdout)
        for option in (["--boxes", SCAN], ["--poses", SCAN], ["--truth-classes", "moving"], ["--pictures", "p"],
                       ["--report", self.folder / "page.html"]):
            self.fails(2, "--truth", "evaluate", "map", made, *option)

    def test_evaluate_localization_without_movable_objects(self):
        file = self.folder / "result.json"
        done = run("evaluate", "localization", MAP, DRIVE, "--select", "1::16", "--query-movable", "delete", f"--json={file}")
        self.assertEqual(done.returncode, 0, done.stderr)
        result = json.loads(file.read_text())
        self.assertGreater(result["points"]["deleted"], 0)
        self.assertEqual(result["options"]["query_movable"], "delete")

    def test_evaluate_detector_writes_its_keys_and_a_page(self):
        file, page = self.folder / "result.json", self.folder / "page.html"
        done = run("evaluate", "detector", DRIVE, "--select", "::16", f"--json={file}", "--report", page)
        self.assertEqual(done.returncode, 0, done.stderr)
        result = json.loads(file.read_text())
        for key in ("AP", "recall_centre_1_5m", "false_boxes_per_scan", "points", "ms_per_scan", "scans", "seconds", "options",
                    "version"):
            self.assertIn(key, result)
        self.assertIn("vehicle", result["AP"])
        self.assertNotIn("<script", page.read_text())

    def test_the_papers_table_is_made_once_and_read_again(self):
        files = [self.folder / name for name in ("first.json", "second.json")]
        page = self.folder / "page.html"
        work = self.folder / "work"
        kept = []
        for file in files:
            done = run("evaluate", "paper", "--seeds", "1", "--scans", "4", "--sensor", "vlp16", "--maps", "none,deletion",
                       "--methods", "icp", "--work", work, f"--json={file}", "--report", page)
            self.assertEqual(done.returncode, 0, done.stderr)
            self.assertIn("deletion - none", done.stdout)
            kept.append({each: each.stat().st_mtime_ns for each in work.rglob("*")})
        self.assertEqual(kept[0], kept[1])
        first, second = (json.loads(file.read_text()) for file in files)
        del first["seconds"], second["seconds"]
        self.assertEqual(first, second)
        self.assertEqual([(row["query"], row["map"]) for row in first["table"]],
                         [("raw", "none"), ("raw", "deletion"), ("removed", "none"), ("removed", "deletion")])
        self.assertEqual([row["queries"] for row in first["table"]], [3] * 4)
        self.assertEqual(len(first["differences"]), 2)
        self.assertNotIn("<script", page.read_text())
        for key in ("scans", "options", "version"):
            self.assertIn(key, first)

    def test_interrupt_leaves_nothing(self):
        program = subprocess.Popen([PROGRAM, "simulate", "town", "-o", self.folder / "drive", "--scans", "10000"],
                                   stderr=subprocess.PIPE, text=True)
        deadline = time.monotonic() + 20
        while not list(self.folder.iterdir()) and time.monotonic() < deadline:
            time.sleep(0.02)
        program.send_signal(signal.SIGINT)
        _, errors = program.communicate(timeout=30)
        self.assertEqual(program.returncode, 130, errors)
        self.assertIn("stillmap: cancelled; nothing was written; the same command starts anew", errors)
        self.assertEqual(list(self.folder.iterdir()), [])

    def test_serve_says_its_address_and_ends_on_sigterm(self):
        program = subprocess.Popen([PROGRAM, "serve", "--store", STORE, "--port", "0"],
                                   stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        line = program.stdout.readline()
        self.assertTrue(re.fullmatch(r"listening on http://127\.0\.0\.1:\d+/\n", line), line)
        program.send_signal(signal.SIGTERM)
        rest, _ = program.communicate(timeout=30)
        self.assertEqual((program.returncode, rest), (0, ""))


class ServesOneMap(unittest.TestCase):
    def setUp(self):
        temporary = tempfile.TemporaryDirectory()
        self.addCleanup(temporary.cleanup)
        self.folder = pathlib.Path(temporary.name)
        self.temporary = self.folder / "tmp"
        self.temporary.mkdir()
        self.map = self.folder / "My Yard"
        shutil.copytree(MAP, self.map)

    def serve(self, *arguments):
        environment = {key: value for key, value in os.environ.items() if not key.startswith("STILLMAP_SERVE_")}
        return subprocess.Popen([PROGRAM, "serve", *map(str, arguments), "--port", "0"], stdout=subprocess.PIPE,
                                stderr=subprocess.PIPE, text=True,
                                env={**environment, "TMPDIR": str(self.temporary)})

    def refused(self, text, *arguments):
        program = self.serve(*arguments)
        out, errors = program.communicate(timeout=30)
        self.assertEqual((program.returncode in (1, 2), out), (True, ""), errors)
        self.assertIn(text, errors)
        self.assertEqual(list(self.temporary.iterdir()), [])

    def send(self, method, path, body=None, **headers):
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=30)
        connection.request(method, path, body, headers)
        answer = connection.getresponse()
        text = answer.read()
        connection.close()
        return answer.status, text

    def test_poses_and_tiles_come_from_the_folder_and_changes_are_refused(self):
        files = sorted(file.relative_to(self.map) for file in self.map.rglob("*") if "index" not in file.parts)
        program = self.serve(self.map)
        self.addCleanup(program.kill)
        line = program.stdout.readline()
        self.port = int(re.fullmatch(r"listening on http://127\.0\.0\.1:(\d+)/\n", line)[1])
        for _ in range(300):
            if self.send("GET", "/readyz")[0] == 200:
                break
            time.sleep(0.1)
        (served,) = json.loads(self.send("GET", "/v1/maps")[1])["maps"]
        self.assertEqual((served["name"], served["version"], served["state"]), ("my-yard", "v1", "ready"))
        status, page = self.send("GET", "/")
        self.assertEqual((status, b"<!doctype html>" in page.lower()), (200, True))
        status, answer = self.send("POST", "/v1/maps/my-yard/localize?prior_t=0,0,0&prior_q=0,0,0,1", SCAN.read_bytes(),
                                   **{"Content-Type": "application/octet-stream"})
        self.assertEqual((status, json.loads(answer)["status"]), (200, "ok"))
        self.assertEqual(served["digest"], json.loads(run("inspect", MAP, "--json").stdout)["digest"])
        status, archive = self.send("GET", "/v1/maps/my-yard/versions/v1/content")
        self.assertEqual(status, 200)
        for method, path, body in (("PUT", "/v1/maps/my-yard/versions/v2", archive), ("DELETE", "/v1/maps/my-yard", None),
                                   ("POST", "/v1/keys", "{}"), ("POST", "/v1/maps/my-yard/rebuild", "{}")):
            status, answer = self.send(method, path, body)
            self.assertEqual((status, json.loads(answer)["code"]), (403, "ReadOnly"), path)
            self.assertIn("stillmap serve --store", json.loads(answer)["detail"])
        self.assertEqual(len(list(self.temporary.iterdir())), 1)
        program.send_signal(signal.SIGTERM)
        _, errors = program.communicate(timeout=30)
        self.assertEqual(program.returncode, 0, errors)
        self.assertIn("for reading only", errors)
        self.assertEqual(list(self.temporary.iterdir()), [])
        # Nothing of the map has gone; what is derived from it is kept for the next time.
        self.assertLessEqual(set(files), {file.relative_to(self.map) for file in self.map.rglob("*")})
        self.assertTrue((self.map / "index").is_dir())

    def test_what_is_no_map_is_refused_and_nothing_stays(self):
        self.refused("stillmap build", self.folder / "none")
        self.refused("unpack", SCAN)
        self.refused("manifest.json", DRIVE)
        self.refused("--store", STORE)
        self.refused("cannot both be served", self.map, "--store", STORE)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
