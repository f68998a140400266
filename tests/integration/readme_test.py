#!/usr/bin/env python3
"""Runs the commands of a page word for word, from top to bottom, and looks at what they answer.

usage: readme_test.py STILLMAP PAGE STORE DRIVE MAP

A marked `sh` block is run in a folder that has what the page speaks of: the demo's drive, map and store in build/demo,
the programs in build/release and in PATH, DRIVE as a drive, my_bag and next_bag as bags, scan.pcd, and yard as a map
unless the page builds it.
The page speaks of 127.0.0.1:8080. Here a server of the demo's store has a port of its own, and curl's configuration file
(CURL_HOME) connects there. A block that is marked as served takes that server's place.
What makes a key comes last, because others then need one. tests/architecture/pages.py checks that no block is unmarked.
"""

import json
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.request

from small_bag import write_bag, write_pcd

BLOCK = re.compile(r"<!-- (run|served) by tests/integration/readme_test\.py -->\n+```sh\n(.*?)```", re.S)


def folder_of(home, text, program, store, drive, package):
    """What the page speaks of."""
    (home / "build/demo").mkdir(parents=True)
    (home / "build/release").mkdir()
    for name in ("stillmap", "stillmap-mapper", "stillmap-evaluate"):
        (home / "build/release" / name).symlink_to(program.with_name(name))
    (home / "build/demo/drive").symlink_to(drive)
    (home / "build/demo/map").symlink_to(package)
    (home / "DRIVE").symlink_to(drive)
    shutil.copytree(store, home / "build/demo/store")
    write_bag(drive, home / "my_bag")
    (home / "next_bag").symlink_to(home / "my_bag")
    if "-o yard " not in text:
        shutil.copytree(package, home / "yard")
    write_pcd(drive / "velodyne/000001.bin", home / "scan.pcd")


class Server:
    """The one that curl reaches as 127.0.0.1:8080."""

    def __init__(self, home):
        self.home, self.process = home, None
        self.environment = {**os.environ, "CURL_HOME": str(home), "STILLMAP_SERVE_PORT": "0",
                            "PATH": f"{home / 'build/release'}:{os.environ['PATH']}"}

    def start(self, command):
        self.stop()
        self.process = subprocess.Popen(["bash", "-c", f"exec {command.strip()}"], cwd=self.home, env=self.environment,
                                        stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        line = self.process.stdout.readline()
        match = re.search(r"127\.0\.0\.1:(\d+)", line)
        if not match:
            sys.exit(f"{command}\nprinted {line!r}, expected its address")
        self.wait_ready(match.group(1))
        (self.home / ".curlrc").write_text(f'connect-to = "127.0.0.1:8080:127.0.0.1:{match.group(1)}"\nmax-time = 200\n')

    def wait_ready(self, port):
        """The page's reader has a server that is ready; here it may still be loading the map."""
        for _ in range(200):
            try:
                with urllib.request.urlopen(f"http://127.0.0.1:{port}/readyz", timeout=5):
                    return
            except urllib.error.HTTPError:
                time.sleep(0.1)
        sys.exit("the server was not ready within 20 s")

    def stop(self):
        if self.process:
            self.process.terminate()
            self.process.wait(timeout=20)
            self.process = None


def check(block, output):
    if "curl" not in block:
        return
    if "/events" in block:
        if '"status":"succeeded"' not in output.replace(" ", ""):
            sys.exit(f"{block}\nanswered {output}, expected a job that succeeds")
        return
    answer = json.loads(output)
    if "code" in answer or ("localize" in block and "keys create" not in block and answer.get("status") != "ok"):
        sys.exit(f"{block}\nanswered {answer}")


def run_block(block, server):
    run = subprocess.run(["bash", "-euo", "pipefail", "-c", block], cwd=server.home, capture_output=True, text=True,
                         env=server.environment)
    if run.returncode != 0:
        sys.exit(f"{block}\nexit {run.returncode}: {run.stderr}")
    check(block, run.stdout)
    print(block.strip(), "->", run.stdout[:200], flush=True)


def main():
    program, page, store, drive, package = (pathlib.Path(x).resolve() for x in sys.argv[1:])
    text = page.read_text()
    blocks = sorted(BLOCK.findall(text), key=lambda block: "keys create" in block[1])
    if not blocks:
        sys.exit(f"{page}: found no marked block, expected one")
    with tempfile.TemporaryDirectory() as folder:
        home = pathlib.Path(folder)
        folder_of(home, text, program, store, drive, package)
        server = Server(home)
        try:
            server.start("stillmap serve --store build/demo/store")
            for kind, block in blocks:
                if kind == "served":
                    server.start(block)
                else:
                    run_block(block, server)
        finally:
            server.stop()
    return 0


if __name__ == "__main__":
    sys.exit(main())
