#!/usr/bin/env python3
"""Many vehicles with sealed sessions over several servers that are killed in turn, beside the same vehicles without kills:
none may be searched for everywhere after a kill, no pose may differ, and no `ok` pose may be beyond its levels more often.

usage: sealed_kills.py --program STILLMAP --store STORE --drive DRIVE [--vehicles 200] [--hz 5] [--seconds 60] [--servers 3]
                       [--kill-every 5] [--workers 1] [--json FILE]

DRIVE is in KITTI's odometry layout with exact poses, as `stillmap simulate` writes it, and STORE has a map `town` of it.
Each vehicle drives a stretch of DRIVE with the drive's own stamps, and sends the next scan 1 / HZ seconds after the one
before, or as soon as that is answered: none is left out. A vehicle at its end begins anew at its start, with a prior.
Exit code 77: numpy is not installed.
"""

import argparse
import json
import pathlib
import shutil
import sys
import tempfile
import threading
import time

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "server/clients/python/src"))

try:
    import numpy as np
except ImportError:
    sys.exit(77)
from serving import Server  # noqa: E402
from stillmap_client import Client, Pose, Prior, StillmapError  # noqa: E402
from stillmap_client.thinning import OWN_VEHICLE_M, Thinning  # noqa: E402

STRETCH = 120  # scans of a vehicle
LEVELS = ("longitudinal_m", "lateral_m", "vertical_m")


class Drive:
    """Scans, stamps, and the true T_map_lidar of each."""

    def __init__(self, folder):
        self.scans = sorted((folder / "velodyne").glob("*.bin"))
        self.stamps_ns = [round(1e9 * float(line)) for line in (folder / "times.txt").read_text().split()][:len(self.scans)]
        lines = (folder / "calib.txt").read_text().splitlines()
        T_camera_lidar = self._matrix(next(line for line in lines if line.startswith("Tr:"))[3:])
        self.truth = [np.linalg.inv(T_camera_lidar) @ self._matrix(line) @ T_camera_lidar
                      for line in (folder / "poses.txt").read_text().splitlines()]

    @staticmethod
    def _matrix(text):
        return np.vstack([np.array(text.split(), float).reshape(3, 4), [0, 0, 0, 1]])

    def prior(self, index):
        T = self.truth[index]
        w = 0.5 * np.sqrt(max(1e-12, 1.0 + np.trace(T[:3, :3])))
        R = T[:3, :3]
        q = [(R[2, 1] - R[1, 2]) / (4 * w), (R[0, 2] - R[2, 0]) / (4 * w), (R[1, 0] - R[0, 1]) / (4 * w), w]
        return Prior(Pose(tuple(T[:3, 3]), tuple(np.array(q) / np.linalg.norm(q))), sigma=(0.3, 0.03))

    def beyond_levels(self, index, answer):
        """Whether an error of an `ok` pose exceeds its level, along the axes of the lidar."""
        x, y, z, w = answer.pose.quaternion
        R = np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                      [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                      [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]])
        error = R.T @ (self.truth[index][:3, 3] - np.array(answer.pose.position))
        levels = [getattr(answer.protection, name) for name in LEVELS]
        return any(level is not None and abs(value) > level for value, level in zip(error, levels))


class ThinnedOnce(Thinning):
    """Thins each scan once, however many vehicles send it."""

    def __init__(self):
        super().__init__("compact", OWN_VEHICLE_M)
        self.known, self.lock = {}, threading.Lock()

    def body(self, raw, columns):
        with self.lock:
            if raw not in self.known:
                self.known[raw] = super().body(raw, columns)
            return self.known[raw]


class Tally:
    """What the vehicles were answered."""

    def __init__(self):
        self.lock = threading.Lock()
        self.seconds, self.status = [], {"ok": 0, "degraded": 0, "lost": 0}
        self.everywhere = self.beyond = self.errors = self.begun = self.drives = self.late = 0
        self.poses = {}  # by first scan and scan: the pose as it was answered
        self.differing = 0

    def add(self, drive, first, index, answer, seconds, late):
        with self.lock:
            self.seconds.append(seconds)
            self.late += late
            self.status[answer.status] += 1
            self.everywhere += answer.searched_from == "everywhere"
            if answer.status == "ok":
                self.beyond += drive.beyond_levels(index, answer)
            pose = None if answer.pose is None else (answer.pose.position, answer.pose.quaternion)
            self.differing += self.poses.setdefault((first, index), pose) != pose

    def result(self):
        taken = sorted(self.seconds)
        answers = len(taken)
        return {"answers": answers, **self.status, "errors": self.errors, "searched_everywhere": self.everywhere,
                "beyond_levels": self.beyond, "poses_that_differ": self.differing, "drives_begun": self.drives,
                "sessions_begun": self.begun, "late_share": round(self.late / max(1, answers), 3),
                **{f"p{share}_ms": round(1e3 * taken[min(answers - 1, answers * share // 100)], 1) if taken else None
                   for share in (50, 95, 99, 100)}}


class Fleet:
    """Vehicles, a thread each, that follow their stretch until they are told to stop."""

    def __init__(self, urls, drive, vehicles, hz, map_name="town"):
        self.urls, self.drive, self.vehicles, self.period_s, self.map = urls, drive, vehicles, 1.0 / hz, map_name
        self.thinning = ThinnedOnce()
        self.bodies = [scan.read_bytes() for scan in drive.scans]
        for body in self.bodies:
            self.thinning.body(body, 4)

    def run(self, seconds, tally):
        """Lets them drive. @param tally  may hold the poses of a run before, to compare with."""
        self.end = time.monotonic() + seconds
        threads = [threading.Thread(target=self._drive, args=(number, tally)) for number in range(self.vehicles)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        return tally

    def _drive(self, number, tally):
        stretch = min(STRETCH, len(self.bodies))
        first = (number * 7) % (len(self.bodies) - stretch + 1)
        clients = [Client(url, retries=8, timeout_s=20.0) for url in self.urls]
        for client in clients:
            client.thinning = self.thinning
        # Each vehicle has another server to begin with.
        clients = clients[number % len(clients):] + clients[:number % len(clients)]
        due = time.monotonic() + self.period_s * number / self.vehicles
        while time.monotonic() < self.end:
            session = clients[0].sealed_session(self.map, prior=self.drive.prior(first), others=clients[1:])
            with tally.lock:
                tally.drives += 1
            for index in range(first, first + stretch):
                time.sleep(max(0.0, due - time.monotonic()))
                if time.monotonic() >= self.end:
                    break
                began = time.monotonic()
                try:
                    answer = session.track(self.bodies[index], self.drive.stamps_ns[index])
                except StillmapError as error:
                    with tally.lock:
                        tally.errors += 1
                    print(f"vehicle {number}, scan {index}: {error}", file=sys.stderr)
                    break
                now = time.monotonic()
                due += self.period_s
                tally.add(self.drive, first, index, answer, now - began, now > due)
                due = max(due, now)
            with tally.lock:
                tally.begun += session.begun
        for client in clients:
            client.close()


class Replicas:
    """Servers on copies of one store that keep their ports."""

    def __init__(self, program, store, folder, count, options=()):
        self.program, self.folder, self.options, self.servers, self.kills = program, folder, options, [], 0
        for number in range(count):
            shutil.copytree(store, folder / f"store-{number}")
            if number > 0:
                shutil.copy2(folder / "store-0" / "seal.keys", folder / f"store-{number}" / "seal.keys")
            self.servers.append(self._start(number, 0))

    def urls(self):
        return [f"http://127.0.0.1:{server.port}" for server in self.servers]

    def _start(self, number, port):
        server = Server(self.program, self.folder / f"store-{number}", self.folder / f"log-{number}", options=self.options,
                        port=port)
        if not server.listen():
            raise RuntimeError(f"server {number} does not listen: {(self.folder / f'log-{number}').read_text()[-500:]}")
        server.wait_ready(60.0)
        return server

    def kill_in_turn(self, every_s, until):
        """Until a time, kills one after the other and starts it again."""
        while (wait := min(every_s, until - time.monotonic())) > 0:
            time.sleep(wait)
            if time.monotonic() >= until - 1.0:
                return
            number = self.kills % len(self.servers)
            port = self.servers[number].port
            self.servers[number].kill()
            self.kills += 1
            self.servers[number] = self._start(number, port)

    def stop(self):
        for server in self.servers:
            if server.process.poll() is None:
                server.kill()


def main():
    parser = argparse.ArgumentParser(usage=__doc__)
    for name in ("program", "store", "drive"):
        parser.add_argument(f"--{name}", type=pathlib.Path, required=True)
    parser.add_argument("--vehicles", type=int, default=200)
    parser.add_argument("--hz", type=float, default=5.0)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--servers", type=int, default=3)
    parser.add_argument("--kill-every", type=float, default=5.0)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--json", type=pathlib.Path)
    arguments = parser.parse_args()
    # All vehicles come from one address, without keys.
    options = ("--workers", str(arguments.workers), "--queue", "400", "--connections", "1024", "--address-share", "1",
               "--rate-requests-per-s", "100000", "--rate-burst", "100000", "--max-requests", "1024")
    drive = Drive(arguments.drive)
    with tempfile.TemporaryDirectory() as folder:
        replicas = Replicas(arguments.program, arguments.store, pathlib.Path(folder), arguments.servers, options)
        try:
            fleet = Fleet(replicas.urls(), drive, arguments.vehicles, arguments.hz)
            calm = fleet.run(arguments.seconds, Tally())
            killed = Tally()
            killed.poses = calm.poses
            killer = threading.Thread(target=replicas.kill_in_turn,
                                      args=(arguments.kill_every, time.monotonic() + arguments.seconds))
            killer.start()
            fleet.run(arguments.seconds, killed)
            killer.join()
        finally:
            replicas.stop()
    result = {"vehicles": arguments.vehicles, "hz": arguments.hz, "seconds": arguments.seconds, "kills": replicas.kills,
              "without_kills": calm.result(), "with_kills": killed.result()}
    print(json.dumps(result, indent=1))
    if arguments.json:
        arguments.json.write_text(json.dumps(result))
    rate = [tally.beyond / max(1, tally.status["ok"]) for tally in (calm, killed)]
    wrong = {
        "no server was killed": replicas.kills == 0,
        "few answers": len(killed.seconds) < arguments.vehicles,
        "scans without an answer": killed.errors + calm.errors > 0,
        "searched everywhere": killed.everywhere + calm.everywhere > 0,
        "sessions that began within a drive": killed.begun > killed.drives or calm.begun > calm.drives,
        "poses that differ": killed.differing + calm.differing > 0,
        "beyond the levels more often": rate[1] > rate[0] + 1e-3,
    }
    print("\n".join(f"WRONG: {what}" for what, is_so in wrong.items() if is_so) or "as it must be")
    return 1 if any(wrong.values()) else 0


if __name__ == "__main__":
    sys.exit(main())
