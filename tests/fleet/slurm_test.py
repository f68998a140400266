#!/usr/bin/env python3
"""Builds maps as jobs of a real Slurm that is killed meanwhile, and so is what follows the jobs.

usage: slurm_test.py STILLMAP DRIVE [TEST...]

Exit code 77: Slurm is not installed.
"""

import copy
import hashlib
import json
import os
import pathlib
import shutil
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / "soak"))
import slurm_engine  # noqa: E402
from serving import Server, make_key, tar_of, upload_drive  # noqa: E402
from slurm_engine import wait_until  # noqa: E402

SKIPPED = 77
CANCELLED = 130
# The network's detector: units that last for some seconds can be killed meanwhile.
OPTIONS = ["--threads", "1"]
FAST = ["--threads", "1", "--detector", "geometric"]
# Of the drive, for what needs no long units, and for what does.
FEW_SCANS, MANY_SCANS = 12, 24


class Build:
    """A build in Slurm, followed by a process that may be killed and started again."""

    def __init__(self, slurm, program, drive, folder, name, options, units=2, environment=None):
        self.slurm, self.folder, self.map = slurm, folder, folder / name
        self.environment = environment or slurm.environment
        self.jobs = folder / f".{name}.slurm"
        self.log = folder / f"{name}.log"
        self.command = [program, "build", str(drive), "-o", str(self.map), "--executor", "slurm", "--units", str(units),
                        "--slurm-option=--mem=500M", *options]
        self.drive, self.process = drive, None

    def follow(self, log=None):
        self.log = log or self.log
        with open(self.log, "ab") as log:
            self.process = subprocess.Popen(self.command, cwd=self.folder, env=self.environment,
                                            stdin=subprocess.DEVNULL, stdout=log, stderr=log)
        return self

    def queue(self):
        """@return {(step, task): (job, state)}"""
        rows = self.slurm.ask("squeue", "-h", "-r", "-O", "Comment:|,ArrayTaskID:|,ArrayJobID:|,State:|").splitlines()
        return {(step, task): (job, state)
                for step, task, job, state in (row.split("|")[:4] for row in rows)}

    def running(self, step):
        """@return a task of the step whose unit is at work, as Slurm names it."""
        for (of, task), (job, state) in self.queue().items():
            unit = f"{step}_{task}" if task != "N/A" else step
            if of == step and state == "RUNNING" and (self.jobs / f"{unit}.progress").exists():
                return job + (f"_{task}" if task != "N/A" else "")
        return None

    def wait_running(self, step):
        return wait_until(lambda: self.running(step) or (self.process.poll() is not None and self.text()), 180,
                          lambda: f"no unit of {step} runs: {self.text()}\n{self.whole_state()}")

    def whole_state(self):
        return (self.slurm.ask("squeue", "-r", "-O", "ArrayJobID:8,ArrayTaskID:8,Comment:8,State:12,RestartCnt:4,Reason:60")
                + self.slurm.ask("sinfo", "-N", "-o", "%N %T %E"))

    def text(self):
        return self.log.read_text(errors="replace")

    def end(self, seconds=200):
        code = self.process.wait(seconds)
        return code, self.text()


def digest_of(package):
    return hashlib.sha256((package / "manifest.json").read_bytes()).hexdigest()


def whole(program, drive, package, options):
    subprocess.run([program, "build", str(drive), "-o", str(package), *options], check=True, capture_output=True)
    return digest_of(package)


def test_kills(slurm, program, folder):
    expected = whole(program, folder / "long", folder / "whole", [])
    began = time.monotonic()

    def tell(what):
        print(f"{time.monotonic() - began:5.1f} s: {what}", flush=True)

    build = Build(slurm, program, folder / "long", folder, "town", OPTIONS, units=4).follow()
    task = build.wait_running("survey")
    submitted = {job for job, _ in build.queue().values()}
    build.process.kill()
    build.process.wait()
    build.follow()
    tell("what follows the jobs killed, and started again")
    slurm.ask("scontrol", "requeue", task)
    tell(f"task {task} put back into the queue")
    time.sleep(3)
    assert {job for job, _ in build.queue().values()} <= submitted, "submitted again what was in the queue"
    slurm.kill("slurmctld")
    tell("controller killed")
    time.sleep(3)
    slurm.start_controller()
    build.wait_running("survey")
    slurm.kill("n2")
    daemons = slurm.step_daemons("n2")
    for daemon in daemons:
        os.kill(daemon, signal.SIGKILL)
    tell(f"node n2 killed with {len(daemons)} daemons of jobs")
    time.sleep(slurm_engine.NODE_TIMEOUT)
    slurm.start_node("n2")
    tell("node n2 started")
    build.wait_running("finish")
    for node in slurm_engine.NODES:
        for daemon in slurm.step_daemons(node)[:1]:
            os.kill(daemon, signal.SIGKILL)
            tell(f"a daemon of a job killed on {node}")
    code, said = build.end()
    tell("done")
    assert code == 0, said
    assert digest_of(build.map) == expected and expected in said, (expected, said)
    left = [path.name for path in folder.iterdir() if path.name.startswith(".town")]
    assert not left, left
    wait_until(lambda: not build.queue(), 20, "jobs are left")


def shorter(drive, folder, scans):
    """The first scans of a drive."""
    (folder / "velodyne").mkdir(parents=True)
    for name in ("calib.txt", "poses.txt", "times.txt"):
        lines = (drive / name).read_text().splitlines(keepends=True)
        (folder / name).write_text("".join(lines if name == "calib.txt" else lines[:scans]))
    for i in range(scans):
        shutil.copy(drive / f"velodyne/{i:06}.bin", folder / "velodyne")
    return folder


def with_program(slurm, place, name, script):
    """@return an environment with a shell script in place of one of Slurm's programs, which it has as "$real"."""
    place.mkdir()
    real = shutil.which(name, path=slurm.environment["PATH"])
    (place / name).write_text(f"#!/bin/sh\nreal={real}\n{script}")
    (place / name).chmod(0o755)
    return slurm.environment | {"PATH": f"{place}:{slurm.environment['PATH']}"}


def test_cancel(slurm, program, folder):
    # It has more to do than there is time for, and says something then.
    environment = with_program(slurm, folder / "slow", "scancel", """
sleep 1.5
echo 'Job/step already completing' >&2
exec "$real" "$@"
""")
    build = Build(slurm, program, folder / "short", folder, "small", FAST, environment=environment).follow()
    build.wait_running("survey")
    build.process.send_signal(signal.SIGTERM)
    code, said = build.end(5)
    assert code == CANCELLED and "goes on from there" in said, (code, said)
    wait_until(lambda: not build.queue(), 20, "jobs were not cancelled")
    assert not build.map.exists() and (folder / ".small.units").exists()
    check_attempts(build.jobs / "unit.sh", folder / "attempts")


def check_attempts(script, folder):
    """A second attempt of a unit waits for the first one, which Slurm has lost, and breaks none of its files."""
    folder.mkdir()

    def begin(command, *arguments):
        return subprocess.Popen(["sh", script, folder, "merge", "merge", "finish", "0", "sh", "-c", command, *arguments],
                                env=os.environ | {"PATH": f"{folder}:{os.environ['PATH']}"})

    first = begin(f"echo first; until [ -e '{folder}/end' ]; do sleep 0.1; done; exit 0")
    wait_until((folder / "merge.progress").exists, 10, "the first attempt did not begin")
    os.kill(first.pid, signal.SIGKILL)
    first.wait()
    second = begin("echo second; exit 9")
    time.sleep(1)
    (folder / "end").touch()
    assert second.wait(20) == 9 and (folder / "merge.failed").read_text() == "9\n"
    assert not (folder / "merge.out").exists(), "what an attempt that failed has printed"
    assert begin("echo third").wait(20) == 0 and (folder / "merge.out").read_text() == "third\n"
    assert begin("echo fourth; exit 9").wait(20) == 9 and (folder / "merge.out").read_text() == "third\n"
    # A sign of life that could not be written is followed by others.
    (folder / "merge.alive").unlink()
    (folder / "merge.alive").mkdir()
    (folder / "sleep").write_text("#!/bin/sh\nexec /bin/sleep 0.1\n")
    (folder / "sleep").chmod(0o755)
    fifth = begin("for i in $(seq 100); do [ ! -f \"$0\" ] || exit 0; sleep; done; exit 9", folder / "merge.alive")
    time.sleep(1)
    (folder / "merge.alive").rmdir()
    assert fifth.wait(20) == 0


def test_failure(slurm, program, folder):
    """A unit that says no ends the build, and is named with its log."""
    build = Build(slurm, program, folder / "short", folder, "other", FAST)
    subprocess.run([program, "build", build.drive, "-o", str(build.map), *FAST, "--units", "2", "--unit", "poses",
                    "--loops", "off"], check=True, capture_output=True)
    code, said = build.follow().end()
    log = build.jobs / "poses.log"
    assert code == 1 and "the unit poses failed with exit code 1" in said and str(log) in said, (code, said)
    assert "another build" in log.read_text() and "another build" in said, said
    wait_until(lambda: not build.queue(), 20, "jobs are left")


def test_refusal(slurm, program, folder):
    """What Slurm will not take is an error, not a wait."""
    build = Build(slurm, program, folder / "short", folder, "none", [*FAST, "--slurm-option=--partition=none"]).follow()
    code, said = build.end(60)
    assert code == 1 and "partition" in said and "--slurm-option" in said, (code, said)


def test_hidden(slurm, program, folder):
    """Jobs that squeue does not list are not submitted again and again."""
    environment = with_program(slurm, folder / "hiding", "squeue", "exec \"$real\" \"$@\" --name=none\n")
    build = Build(slurm, program, folder / "short", folder, "hidden", [*FAST, "--slurm-option=--hold"],
                  environment=environment).follow()
    code, said = build.end(60)
    assert code == 1 and "does not list the job" in said, (code, said)
    wait_until(lambda: not build.queue(), 20, "jobs are left")


def test_limits(slurm, program, folder):
    """What Slurm takes later, such as a job above a user's limit, ends no build that has begun."""
    reached = folder / "reached"
    environment = with_program(slurm, folder / "limits", "sbatch", f"""
[ ! -e '{reached}' ] || {{ echo >>'{reached}'; echo 'job submit limit' >&2; exit 1; }}
exec "$real" "$@"
""")
    # Habits of the user are not ours.
    environment |= {"SQUEUE_STATES": "RUNNING", "SLURM_CLUSTERS": "none", "SBATCH_WAIT": "1"}
    build = Build(slurm, program, folder / "short", folder, "limited", FAST, environment=environment).follow()
    task = build.wait_running("survey")
    other = copy.copy(build).follow(folder / "other_follower.log")
    assert len({job for job, _ in build.queue().values()}) <= 5, build.queue()
    reached.touch()
    slurm.ask("scancel", "--full", task)
    wait_until(lambda: len(reached.read_text()) >= 3, 60, f"not asked again: {build.text()}")
    reached.unlink()
    code, said = build.end()
    assert code == 0 and said.count("job submit limit") == 1, (code, said)
    # It has waited, and tells of the same map.
    code, said = other.end(20)
    assert code == 0 and "waits for another process" in said and digest_of(build.map) in said, (code, said)


def test_other_options(slurm, program, folder):
    """Jobs of other options have ended before those of this build begin: they share a folder."""
    def names():
        return set(slurm.ask("squeue", "-h", "-o", "%j").split())

    build = Build(slurm, program, folder / "short", folder, "changed", FAST).follow()
    build.wait_running("survey")
    build.process.kill()
    build.process.wait()
    before = names()
    environment = with_program(slurm, folder / "failing", "scancel", f"""
[ -e '{folder}/failed' ] || {{ touch '{folder}/failed'; exit 1; }}
exec "$real" "$@"
""")
    build = Build(slurm, program, folder / "short", folder, "changed", FAST, units=3, environment=environment).follow()
    first = wait_until(lambda: names() != before and names(), 60, f"nothing is submitted: {build.text()}")
    assert not first & before, (first, before)
    build.process.send_signal(signal.SIGTERM)
    assert build.end(5)[0] == CANCELLED, build.text()
    wait_until(lambda: not build.queue(), 20, "jobs were not cancelled")


def test_server(slurm, program, folder):
    """Jobs of a server that is killed: the next one follows them; a job that is cancelled cancels them."""
    store = folder / "store"
    whole(program, folder / "short", folder / "first", FAST)
    subprocess.run([program, "store", "add", store, "town", "v0", folder / "first"], check=True, capture_output=True)
    headers = {"Authorization": f"Bearer {make_key(program, store)}"}

    def start(executor):
        server = Server(program, store, folder / "server.log", environment=slurm.environment, options=[
            "--jobs-executor", executor, "--jobs-slurm-units", "2", "--jobs-slurm-options=--mem=500M --time=10",
            "--jobs-cores", "1"])
        assert server.listen(), (folder / "server.log").read_text()[-2000:]
        return server

    def rebuild(server, version):
        asked = json.dumps({"drives": [1], "version": version, "new_frame": True, "options": {"detector": "geometric"}})
        answer = server.ask("POST", "/v1/maps/town/rebuild", asked, {"Content-Type": "application/json", **headers})
        assert answer.status == 202, answer.body
        return f"/v1/jobs/{answer.json['id']}"

    def wait_end(server, job):
        def ended():
            found = server.ask("GET", job, headers=headers).json
            return found if found["status"] not in ("enqueued", "processing") else None
        return wait_until(ended, 150, f"{job} has no end")

    def wait_jobs(step):
        def jobs():
            rows = [row.split("|") for row in slurm.ask("squeue", "-h", "-O", "Comment:|,State:|,ArrayJobID:|").splitlines()]
            return {row[2] for row in rows} if [step, "RUNNING"] in [row[:2] for row in rows] else None
        return wait_until(jobs, 60, f"no unit of {step} runs")

    server = start("slurm")
    upload_drive(server, "town", tar_of(folder / "short"), headers)
    job = rebuild(server, "v1")
    submitted = wait_jobs("survey")
    server.kill()
    assert slurm.ask("squeue", "-h").strip(), "a server that was killed took its jobs in the cluster with it"
    server = start("slurm")
    time.sleep(4)
    left = {row.strip() for row in slurm.ask("squeue", "-h", "-O", "ArrayJobID").splitlines()}
    assert left and left <= submitted, (left, submitted)
    clustered = wait_end(server, job)
    assert clustered["status"] == "succeeded", clustered
    job = rebuild(server, "v2")
    wait_jobs("poses")
    answer = server.ask("POST", f"{job}/cancel", headers=headers)
    assert answer.status // 100 == 2, answer.body
    assert wait_end(server, job)["status"] == "canceled"
    wait_until(lambda: not slurm.ask("squeue", "-h").strip(), 20, "jobs were not cancelled")
    # Cancelled while its server is away, as at another one.
    job = rebuild(server, "canceled")
    submitted = wait_jobs("survey")
    server.kill()
    state = sqlite3.connect(store / "state.db")
    with state:
        state.execute("UPDATE jobs SET status = 'canceled', finished_ns = started_ns WHERE status = 'processing'")
    state.close()
    assert slurm.ask("squeue", "-h").strip(), "nothing goes on in the cluster"
    server = start("slurm")
    wait_until(lambda: not slurm.ask("squeue", "-h").strip(), 20, "jobs of one that was cancelled go on")
    ends = [word for each in submitted for word in slurm.ask("scontrol", "show", "job", each).split() if "JobState=" in word]
    assert "JobState=CANCELLED" in ends and "JobState=FAILED" not in ends, ends
    assert server.stop() == 0
    server = start("process")
    alone = wait_end(server, rebuild(server, "v3"))
    assert alone["status"] == "succeeded", alone
    assert alone["result"]["digest"] == clustered["result"]["digest"], (alone, clustered)
    assert server.stop() == 0


def main():
    program, drive = (pathlib.Path(word).resolve() for word in sys.argv[1:3])
    if slurm_engine.missing():
        print(f"not installed: {' '.join(slurm_engine.missing())}; ./dev fleet installs them")
        return SKIPPED
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        folder.chmod(0o755)
        (folder / "maps").mkdir()
        shorter(drive, folder / "maps" / "short", FEW_SCANS)
        shorter(drive, folder / "maps" / "long", MANY_SCANS)
        with slurm_engine.Slurm(folder / "slurm") as slurm:
            for test in (test_cancel, test_failure, test_refusal, test_hidden, test_limits, test_other_options,
                         test_server, test_kills):
                if sys.argv[3:] and test.__name__ not in sys.argv[3:]:
                    continue
                began = time.monotonic()
                test(slurm, program, folder / "maps")
                print(f"{test.__name__}: {time.monotonic() - began:.1f} s", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
