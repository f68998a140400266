#!/usr/bin/env python3
"""Jobs of two servers with folders of their own on one state in PostgreSQL, and of one that is killed.

usage: shared_jobs_test.py STILLMAP MAP DRIVE

MAP and DRIVE are those of sample_map.sh. A script takes the place of the mapper: it works as long as there is a file.
"""
import http.client
import json
import pathlib
import shutil
import sys
import tempfile
import time
import unittest

PROGRAM, MAP, DRIVE = (pathlib.Path(word).resolve() for word in sys.argv[1:4])
for folder in ("soak", "fleet"):
    sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / folder))
import postgres_engine  # noqa: E402
from serving import Server, small_cloud, tar_of, upload_drive  # noqa: E402

JSON = {"Content-Type": "application/json"}
MAPPER = """#!/bin/sh
folder={folder}
while [ $# -gt 0 ]; do
  case $1 in
  --output) out=$2 ;;
  --work) work=$2 ;;
  --json=*) report=${{1#--json=}} ;;
  --estimate) printf '{{\\n"package_bytes": 1000, "work_bytes": 5}}\\n'; exit 0 ;;
  esac
  shift
done
trap 'echo $out >> $folder/asked_to_end; exit 130' TERM
echo $out >> $folder/runs
[ -z "$work" ] || {{ mkdir -p $work; echo x >> $work/attempts; }}
[ -z "$report" ] || echo '{{"stage":"half","fraction":0.5,"eta_s":7}}' >&3
echo working
while [ -e $folder/hold ]; do sleep 0.05; done
cp -r {map} $out
[ -z "$report" ] || echo '{{"verdict": "pass", "reasons": [], "figures": {{"new_lost": 0}}}}' > $report
"""


def in_the_end(holds, what, seconds=30):
    deadline = time.time() + seconds
    while True:
        found = holds()
        if found:
            return found
        if time.time() > deadline:
            raise AssertionError(f"not within {seconds} s: {what()}" if callable(what) else f"not within {seconds} s: {what}")
        time.sleep(0.05)


class SharedJobs(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        if postgres_engine.is_missing():
            print("no PostgreSQL: skipped")
            sys.exit(77)
        cls.folder = pathlib.Path(tempfile.mkdtemp())
        cls.folder.chmod(0o755)
        cls.addClassCleanup(shutil.rmtree, cls.folder)
        cls.postgres = postgres_engine.Postgres(cls.folder / "postgres")
        cls.addClassCleanup(cls.postgres.kill)
        cls.postgres.wait()
        (cls.folder / "bin").mkdir()
        cls.program = shutil.copy(PROGRAM, cls.folder / "bin")
        mapper = cls.folder / "bin" / "stillmap-mapper"
        mapper.write_text(MAPPER.format(folder=cls.folder, map=MAP))
        mapper.chmod(0o755)
        cls.servers = {}
        cls.addClassCleanup(lambda: [server.kill(group=True) for server in cls.servers.values()])
        for name in ("a", "b"):
            (cls.folder / name).mkdir()
            cls.start(name)
        cls.a_packed = tar_of(DRIVE)
        cls.ask("a", "PUT", "/v1/maps/town")
        cls.drive = upload_drive(cls.servers["a"], "town", cls.a_packed, {})
        cls.versions = 0

    @classmethod
    def start(cls, name, *options):
        server = Server(cls.program, cls.folder / name, cls.folder / f"{name}.log",
                        options=["--state", cls.postgres.address, *options])
        assert server.listen(), (cls.folder / f"{name}.log").read_text()
        cls.servers[name] = server

    @classmethod
    def ask(cls, name, method, path, body=None, headers=None):
        return cls.servers[name].ask(method, path, body, headers, timeout=60)

    def setUp(self):
        for name in ("asked_to_end", "runs"):
            (self.folder / name).unlink(missing_ok=True)
        self.hold()

    def tearDown(self):
        self.let_go()

    def hold(self):
        (self.folder / "hold").touch()

    def let_go(self):
        (self.folder / "hold").unlink(missing_ok=True)

    def server_name(self, name):
        return (self.folder / name / "jobs" / ".server").read_text()

    def rebuild(self, name, **more):
        type(self).versions += 1
        asked = {"drives": [self.drive], "version": f"r{self.versions}", "new_frame": True, **more}
        answer = self.ask(name, "POST", "/v1/maps/town/rebuild", json.dumps(asked), JSON)
        self.assertEqual(answer.status, 202, answer.body)
        return answer.json

    def job(self, name, job):
        return self.ask(name, "GET", f"/v1/jobs/{job['id']}").json

    def wait(self, name, job, holds, seconds=60):
        def found():
            now = self.job(name, job)
            return now if holds(now) else None
        return in_the_end(found, lambda: f"{self.job(name, job)}\n{self.log_texts()}", seconds)

    def log_texts(self):
        return "\n".join((self.folder / f"{name}.log").read_text()[-2000:] for name in self.servers)

    def wait_runs(self, name, job):
        return self.wait(name, job, lambda now: now["status"] == "processing" and now["stage"] == "half")

    def wait_end(self, name, job, status="succeeded"):
        end = self.wait(name, job, lambda now: now["status"] not in ("enqueued", "processing"))
        self.assertEqual(end["status"], status, end)
        return end

    def waits_for_a(self, job, what="drives"):
        return job["status"] == "enqueued" and job["stage"] == f"waits for server {self.server_name('a')}, which has its {what}"

    def test_a_rebuild_runs_where_its_drives_are(self):
        first = self.rebuild("a")
        self.wait_runs("a", first)
        second = self.rebuild("b")
        self.assertTrue(self.waits_for_a(second), second)
        third = self.rebuild("a")
        self.assertEqual(third["stage"], "")
        time.sleep(3)
        self.assertTrue(self.waits_for_a(self.job("b", third)), self.job("b", third))
        self.let_go()
        for job in (first, second, third):
            self.assertEqual(self.wait_end("b", job)["attempts"], 1)

    def test_files_wait_for_the_server_that_got_them(self):
        first = self.rebuild("a")
        self.wait_runs("a", first)
        jobs = []
        for number in (1, 2):
            answer = self.ask("a", "PUT", f"/v1/maps/town/versions/cloud{number}", small_cloud(number),
                              {"Content-Type": "application/vnd.pcd"})
            self.assertEqual(answer.status, 202, answer.body)
            jobs.append(answer.json)
        time.sleep(3)
        for job in jobs:
            self.assertTrue(self.waits_for_a(self.job("b", job), "file"), self.job("b", job))
        self.let_go()
        for job in (first, *jobs):
            self.wait_end("b", job)

    def test_one_whose_server_is_killed_waits_for_it(self):
        job = self.rebuild("a")
        self.wait_runs("a", job)
        self.servers["a"].kill(group=True)
        waits = self.wait("b", job, lambda now: now["status"] == "enqueued")
        self.assertTrue(self.waits_for_a(waits), waits)
        self.assertIn("silent", waits["error"])
        time.sleep(2)
        self.assertTrue(self.waits_for_a(self.job("b", job)))
        self.start("a")
        self.wait_runs("a", job)
        self.let_go()
        self.assertEqual(self.wait_end("b", job)["attempts"], 2)

    def test_one_that_is_cancelled_at_another_server_ends(self):
        job = self.rebuild("a")
        self.wait_runs("a", job)
        self.assertEqual(self.ask("b", "POST", f"/v1/jobs/{job['id']}/cancel").status, 202)
        self.wait_end("b", job, "canceled")
        self.assertIn(f"/{job['id']}/", (self.folder / "asked_to_end").read_text())

    def test_every_server_tells_how_far_it_is_and_what_it_came_to(self):
        job = self.rebuild("a")
        path = f"/v1/jobs/{job['id']}"
        now = self.wait("b", job, lambda found: found["progress"] == 0.5)
        self.assertEqual((now["stage"], now["eta_s"]), ("half", 7))
        connection = http.client.HTTPConnection("127.0.0.1", self.servers["b"].port, timeout=60)
        self.addCleanup(connection.close)
        connection.request("GET", f"{path}/events")
        events = connection.getresponse()
        said = b""
        while b'"progress":0.5' not in said:
            line = events.readline()
            self.assertTrue(line, said)
            said += line
        self.let_go()
        said += events.read()
        self.assertEqual(said.count(b"event: end"), 1, said)
        results = [self.wait_end(name, job)["result"] for name in ("a", "b")]
        self.assertEqual(results[0], results[1])
        self.assertEqual(results[1]["gate"]["verdict"], "pass", results)
        self.assertIn(results[1]["digest"].encode(), said)
        self.assertIn(b"working", self.ask("a", "GET", f"{path}/log").body)
        elsewhere = self.ask("b", "GET", f"{path}/log")
        self.assertEqual((elsewhere.status, elsewhere.json["code"]), (409, "OtherServer"), elsewhere.body)
        self.assertIn(self.server_name("a"), elsewhere.json["detail"])

    def test_one_that_ends_its_server_again_and_again_fails(self):
        job = self.rebuild("a")
        for _ in range(3):
            self.wait_runs("a", job)
            self.servers["a"].kill(group=True)
            self.start("a")
        end = self.wait_end("b", job, "failed")
        self.assertIn("its server ended while it worked on it, 3 times: ask again", end["error"])

    def test_what_is_at_another_server_is_refused_with_its_name(self):
        place = "/v1/maps/town/drives"
        opened = self.ask("a", "POST", place, '{"name": "half"}', JSON).json["id"]
        for method, path in (("PUT", f"{place}/{opened}/parts/1"), ("POST", f"{place}/{opened}/complete")):
            refused = self.ask("b", method, path, b"x" if method == "PUT" else None)
            self.assertEqual((refused.status, refused.json["code"]), (409, "OtherServer"), refused.body)
            self.assertIn(self.server_name("a"), refused.json["detail"])
        self.assertEqual(self.ask("a", "DELETE", f"{place}/{opened}").status, 204)
        at_b = upload_drive(self.servers["b"], "town", self.a_packed, {})
        refused = self.ask("b", "POST", "/v1/maps/town/rebuild", json.dumps({"drives": [self.drive, at_b]}), JSON)
        self.assertEqual((refused.status, refused.json["code"]), (409, "OtherServer"), refused.body)
        self.let_go()
        self.wait_end("a", self.rebuild("a", drives=[at_b]))


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
