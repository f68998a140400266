#!/usr/bin/env python3
"""Blobs against a real S3 engine, OpenStack Swift, that is killed meanwhile.

usage: swift_test.py UNIT_SERVER
"""

import os
import subprocess
import sys
import tempfile
import time

import swift_engine

SKIPPED = 77


def run(program, cases, endpoint, **variables):
    environment = os.environ | {"STILLMAP_TEST_S3": endpoint} | variables
    return subprocess.Popen([program, f"--gtest_filter={cases}", "--gtest_brief=1"], env=environment)


def kill_in_turn(swift, is_over):
    """@return how often."""
    kills = 0
    while not is_over():
        time.sleep(0.8 + 0.23 * (kills % 5))
        server = ("proxy", "object", "proxy", "container")[kills % 4]
        swift.kill(server)
        swift.restart(server)
        kills += 1
    return kills


def main():
    if swift_engine.missing():
        print(f"skipped, not installed: {' '.join(swift_engine.missing())} (`./dev fleet` installs them)")
        sys.exit(SKIPPED)
    unit_server = sys.argv[1]
    with tempfile.TemporaryDirectory() as folder, swift_engine.Swift(os.path.join(folder, "swift")) as swift:
        status, body = swift.ask("PUT", "/maps")
        assert status == 200, body
        if run(unit_server, "S3EngineTest.*", swift.endpoint).wait() != 0:
            sys.exit(1)
        killed = run(unit_server, "S3EngineTest.KillsHarmNothing", swift.endpoint, STILLMAP_TEST_S3_ROUNDS="40")
        kills = kill_in_turn(swift, lambda: killed.poll() is not None)
        print(f"killed {kills} times")
        if killed.wait() != 0 or kills < 5:
            sys.exit(1)


if __name__ == "__main__":
    main()
