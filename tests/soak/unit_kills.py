#!/usr/bin/env python3
"""Builds a map by the units of a plan, several processes at a time, kills processes at random instants and gives their
commands again, and looks whether the map has the digest that one process gives it.

usage: unit_kills.py --program STILLMAP --drive DRIVE --runs N [--units 1,2,3,7] [--kills 4] [--first 1] [-- OPTION...]

A run decides by its number how many shares there are and about when processes die. Its first process always dies. OPTION
goes to `stillmap build`.
"""

import argparse
import json
import pathlib
import random
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time

WORKERS = 3
# No build is done so soon.
FIRST_LIFE_S = 0.1


class Killer:
    """Runs the commands of a step; while there are kills left, processes die after a while."""

    def __init__(self, chance, kills, longest_s):
        self.chance, self.left, self.longest_s = chance, kills, longest_s
        self.killed = 0
        self.is_first = True

    def life_s(self):
        if self.is_first and self.left > 0:
            self.is_first = False
            return FIRST_LIFE_S
        if self.left > 0 and self.chance.random() < 0.5:
            return self.chance.uniform(0.0, self.longest_s)
        return None

    def run(self, commands):
        waiting, running = list(commands), []
        while waiting or running:
            while waiting and len(running) < WORKERS:
                command = waiting.pop(0)
                life_s = self.life_s()
                process = subprocess.Popen(["sh", "-c", "exec " + command.split(" && ", 1)[1]], stdout=subprocess.DEVNULL,
                                           stderr=subprocess.PIPE, text=True)
                running.append((command, process, None if life_s is None else time.monotonic() + life_s))
            time.sleep(0.01)
            for each in list(running):
                command, process, dies = each
                if process.poll() is None:
                    if dies is not None and time.monotonic() > dies and self.left > 0:
                        process.kill()
                    continue
                running.remove(each)
                errors = process.stderr.read()
                process.stderr.close()
                if process.returncode == -signal.SIGKILL:
                    self.left -= 1
                    self.killed += 1
                    waiting.append(command)
                elif process.returncode != 0:
                    raise AssertionError(f"{command}\nended with {process.returncode}: {errors}")


def digest(map_folder):
    return subprocess.run(["sha256sum", map_folder / "manifest.json"], capture_output=True, text=True, check=True).stdout[:64]


def steps_of(plan):
    return [block.splitlines() for block in plan.read_text().split("\n\n") if block.strip()]


def one_run(arguments, number, folder, expected, longest_s):
    chance = random.Random(number)
    units = chance.choice(arguments.units)
    target, plan = folder / "map", folder / "plan.txt"
    subprocess.run([arguments.program, "build", arguments.drive, "-o", target, *arguments.options, "--threads", "1", "--units",
                    str(units), "--plan", plan], check=True)
    killer = Killer(chance, arguments.kills, longest_s)
    for step in steps_of(plan):
        killer.run(step)
    assert killer.killed > 0 or arguments.kills == 0, f"run {number}: no process was killed"
    # As after a kill between the map and its report.
    report = folder / "report.json"
    subprocess.run(["sh", "-c", f"{steps_of(plan)[-1][0]} --json={shlex.quote(str(report))}"], check=True,
                   stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    said = json.loads(report.read_text())
    assert said["digest"] == expected and said["points"]["in"] > 0, f"run {number}: {said}"
    report.unlink()
    found = digest(target)
    left = sorted(each.name for each in folder.iterdir() if each.name not in ("map", "plan.txt", "whole"))
    assert found == expected, f"run {number}, {units} units: digest {found}, expected {expected}"
    assert not left, f"run {number}: left behind: {left}"
    shutil.rmtree(target)
    return units, killer.killed


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--program", required=True, type=pathlib.Path)
    parser.add_argument("--drive", required=True, type=pathlib.Path)
    parser.add_argument("--runs", type=int, default=1)
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--kills", type=int, default=4)
    parser.add_argument("--units", type=lambda text: [int(each) for each in text.split(",")], default=[1, 2, 3, 7])
    parser.add_argument("--whole", type=pathlib.Path, help="the map that one process made")
    parser.add_argument("options", nargs="*")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        whole = arguments.whole or folder / "whole"
        began = time.monotonic()
        if not arguments.whole:
            subprocess.run([arguments.program, "build", arguments.drive, "-o", whole, *arguments.options], check=True,
                           stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        longest_s = max(1.0, time.monotonic() - began)
        expected = digest(whole)
        for number in range(arguments.first, arguments.first + arguments.runs):
            began = time.monotonic()
            units, killed = one_run(arguments, number, folder, expected, longest_s)
            print(json.dumps({"run": number, "units": units, "killed": killed, "seconds": round(time.monotonic() - began, 1)}),
                  flush=True)
    print(f"{arguments.runs} runs: the digest of one process, {expected}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
