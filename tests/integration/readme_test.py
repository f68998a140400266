#!/usr/bin/env python3
"""Runs the README's first request word for word against a server of the sample map, and looks at the answer.

usage: readme_test.py STILLMAP README STORE DRIVE MAP

The README speaks of 127.0.0.1:8080 and build/demo/drive; the server here sits on a port of its own, so curl is told by
its own configuration file (CURL_HOME) to connect there, and program, drive and map are linked to where the README has
them. The store is a copy, since some requests change it; what makes a key comes last, since others then need one.
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

MARK = "<!-- run by tests/integration/readme_test.py -->"


def marked_blocks(readme):
    pattern = re.escape(MARK) + r"\s*```sh\n(.*?)```"
    return re.findall(pattern, readme.read_text(), re.S)


def start(program, store):
    server = subprocess.Popen([program, "serve", "--store", store, "--port", "0"], stdout=subprocess.PIPE,
                              stderr=subprocess.DEVNULL, text=True)
    line = server.stdout.readline()
    match = re.search(r"127\.0\.0\.1:(\d+)", line)
    if not match:
        server.kill()
        sys.exit(f"serve printed {line!r}, expected its address")
    return server, int(match.group(1))


def wait_ready(port):
    """The README's reader has a server that is ready; here it may still be loading the map."""
    for _ in range(200):
        try:
            with urllib.request.urlopen(f"http://127.0.0.1:{port}/readyz", timeout=5):
                return
        except urllib.error.HTTPError:
            time.sleep(0.1)
    sys.exit("the server was not ready within 20 s")


def run_block(block, home):
    run = subprocess.run(["bash", "-euo", "pipefail", "-c", block], cwd=home, capture_output=True, text=True,
                         env={**os.environ, "CURL_HOME": str(home)})
    if run.returncode != 0:
        sys.exit(f"{block}\nexit {run.returncode}: {run.stderr}")
    answer = json.loads(run.stdout)
    if "code" in answer or ("localize" in block and "keys create" not in block and answer.get("status") != "ok"):
        sys.exit(f"{block}\nanswered {answer}")
    print(block.strip(), "->", run.stdout[:200])


def main():
    program, readme, store, drive, package = (pathlib.Path(x).resolve() for x in sys.argv[1:])
    blocks = sorted(marked_blocks(readme), key=lambda block: "keys create" in block)
    if not blocks:
        sys.exit(f"{readme}: found no block after '{MARK}', expected one")
    with tempfile.TemporaryDirectory() as folder:
        home = pathlib.Path(folder)
        (home / "build/demo").mkdir(parents=True)
        (home / "build/release").mkdir()
        (home / "build/release/stillmap").symlink_to(program)
        (home / "build/demo/drive").symlink_to(drive)
        (home / "build/demo/map").symlink_to(package)
        shutil.copytree(store, home / "build/demo/store")
        server, port = start(program, home / "build/demo/store")
        try:
            wait_ready(port)
            (home / ".curlrc").write_text(f'connect-to = "127.0.0.1:8080:127.0.0.1:{port}"\nmax-time = 30\n')
            for block in blocks:
                run_block(block, home)
        finally:
            server.terminate()
            server.wait(timeout=20)
    return 0


if __name__ == "__main__":
    sys.exit(main())
