#!/usr/bin/env python3
"""Runs the blocks of the Python package's tutorial in one session, from top to bottom, and compares what they print with
the page, and their figures with those of the command line.

usage: tutorial_test.py STILLMAP PAGE [--write]

The module is found by PYTHONPATH. --write puts what the blocks print into the page.
"""

import contextlib
import io
import json
import os
import pathlib
import re
import subprocess
import sys
import tempfile

BLOCK = re.compile(r"<!-- run by tests/python/tutorial_test\.py -->\n```python\n(.*?)```\n\n```text\n(.*?)```", re.S)


def run_blocks(text, names, write):
    def run(match):
        code, expected = match.groups()
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed):
            exec(compile(code, "tutorial", "exec"), names)
        if not write and printed.getvalue() != expected:
            sys.exit(f"{code}\nprinted\n{printed.getvalue()}\nexpected\n{expected}")
        return match[0].removesuffix(expected + "```") + printed.getvalue() + "```"

    return BLOCK.sub(run, text)


def command_line(program, *words):
    said = subprocess.run([program, *words], capture_output=True, text=True, check=True).stdout
    return json.loads(said)


def check_against_command_line(program, names):
    subprocess.run([program, "build", "drive", "-o", "other", "--select", "::2"], check=True, capture_output=True)
    assert pathlib.Path("other/manifest.json").read_bytes() == pathlib.Path("yard/manifest.json").read_bytes()
    for result, prior in ((names["result"], []), (names["near_result"], ["--prior", "0,0,0,3"])):
        answer = command_line(program, "localize", "yard", "drive/velodyne/000001.bin", "--json", *prior)
        assert answer["pose"] == {"position": list(result.position), "quaternion": list(result.quaternion)}, answer
        assert answer["covariance"] == list(result.covariance.ravel()), answer
        assert answer["status"] == result.status and answer["rmse_m"] == result.rmse_m, answer
    report = command_line(program, "evaluate", "localization", "yard", "drive", "--select", "1::2", "--prior-error",
                          "1,5", "--trials", "2", "--seed", "1", "--json")
    for ours, theirs in zip(names["report"]["levels"], report["levels"], strict=True):
        for key in theirs:
            if not key.endswith("_ms"):
                assert ours[key] == theirs[key], (key, ours[key], theirs[key])


def main():
    program, page = (pathlib.Path(x).resolve() for x in sys.argv[1:3])
    write = "--write" in sys.argv
    os.environ["STILLMAP_PROGRAM"] = str(program)
    text = page.read_text()
    if text.count("```python") != len(BLOCK.findall(text)):
        sys.exit(f"{page}: found python blocks without the mark or without what they print, expected both for each")
    names = {}
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        text = run_blocks(text, names, write)
        check_against_command_line(program, names)
    if write:
        page.write_text(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
