#!/usr/bin/env python3
"""Looks whether what a reader takes grows faster than its input: each piece of each seed of a target is repeated, and four
times as often, and the processor time of both is compared.

usage: tests/fuzz/growth.py FOLDER_OF_PROGRAMS FOLDER_OF_SEEDS [TARGET]...

A piece is a line of text, an element or member of JSON, or a part of binary data. What takes less than LEAST_S is not judged.
What seems to grow too fast is run five times in turns, small and large, so that what else the machine does meets both; the
median of the ratios counts.
"""

import json
import os
import pathlib
import re
import statistics
import struct
import subprocess
import sys
import tempfile

MOST_BYTES = 1 << 18
LEAST_S = 0.05
MOST_GROWTH = 6.0
RUNS = 5
# More would be the same in other words.
MOST_PIECES = 10
# Else the first use of each page counts, and large inputs are given fresh ones.
KEEP_MEMORY = {"MALLOC_TRIM_THRESHOLD_": "4000000000", "MALLOC_MMAP_THRESHOLD_": "4000000000"}
TINY = ["{}", "[]", '""', "0", '{"a":{}}', "[[[[]]]]"]
TAR_BLOCK = 512


def json_within(seed):
    """The longest JSON object in it. @return its start, its end and its value; None where there is none"""
    text, decoder, found = seed.decode("latin-1"), json.JSONDecoder(), None
    at = text.find("{")
    while at >= 0:
        try:
            value, end = decoder.raw_decode(text, at)
        except json.JSONDecodeError:
            value, end = None, at + 1
        if value and (found is None or end - at > found[1] - found[0]):
            found = (at, end, value)
        at = text.find("{", end)
    return found


def put_in(seed, start, end, text):
    """`text` instead of these bytes. Corrects the length that stands before them in weights, tars and HTTP requests."""
    head = seed[:start]
    if start >= 8 and struct.unpack("<Q", head[-8:])[0] == end - start:
        head = head[:-8] + struct.pack("<Q", len(text))
    longer = len(text) - (end - start)
    if head[257 - TAR_BLOCK:][:5] == b"ustar":
        digits = len(head) - TAR_BLOCK + 124
        head = head[:digits] + b"%011o" % len(text) + head[digits + 11:]
        text += bytes(-len(text) % TAR_BLOCK)
        end += (start - end) % TAR_BLOCK
    head = re.sub(rb"(Content-Length: )(\d+)", lambda m: m[1] + str(max(0, int(m[2]) + longer)).encode(), head)
    return head + text + seed[end:]


def pieces_of_json(value):
    """@return texts that may stand more often in it: (what is replaced, by what, with {} for the repeated part)."""
    found = []

    def walk(node, path):
        if isinstance(node, list):
            found.extend((path, json.dumps(element)) for element in node[-1:])
            found.extend((path, tiny) for tiny in TINY)
        if isinstance(node, dict):
            found.append((path, None))
        for key, child in node.items() if isinstance(node, dict) else enumerate(node[:1]) if isinstance(node, list) else ():
            walk(child, [*path, key])

    walk(value, [])
    return found


def json_repeated(value, path, element, size):
    """The text of `value` where the list or object at `path` has as many elements as `size` bytes hold."""
    marker = "\x1f"
    value = json.loads(json.dumps(value))
    node, parent, last = value, None, None
    for key in path:
        parent, last, node = node, key, node[key]
    if parent is None:
        value = marker
    else:
        parent[last] = marker
    if element is None:
        member = json.dumps(next(iter(node.values()), 0))
        count = max(1, size // (len(member) + 10))
        text = "{" + ",".join(f'"k{i}":{member}' for i in range(count)) + "}"
    else:
        text = "[" + ",".join([element] * max(1, size // (len(element) + 1))) + "]"
    return json.dumps(value).replace(json.dumps(marker), text).encode("latin-1", "replace")


def repetitions(seed):
    """@return functions that make an input of about so many bytes."""
    found = []
    within = json_within(seed)
    if within:
        start, end, value = within
        for path, element in pieces_of_json(value):
            found.append(lambda size, p=path, e=element: put_in(seed, start, end, json_repeated(value, p, e, size)))
        return found
    lines = list(re.finditer(rb"[^\n]*\n", seed))
    if len(lines) > 1:
        spans = [match.span() for match in lines]
    else:
        step = max(1, len(seed) // MOST_PIECES)
        spans = [(at, min(len(seed), at + width)) for at in range(0, len(seed), step) for width in (step, 512)]
    spans = spans[::max(1, len(spans) // MOST_PIECES)]
    for begin, end in spans:
        piece = seed[begin:end]
        if piece:
            found.append(lambda size, b=begin, p=piece: seed[:b] + p * (size // len(p)) + seed[b:])
            number = re.search(rb"\d+", piece) if len(lines) > 1 else None
            if number:  # as stamps that rise
                first, last = number.span()
                found.append(lambda size, b=begin, p=piece, f=first, l=last: seed[:b] + b"".join(
                    p[:f] + str(10 + i).encode() + p[l:] for i in range(size // (len(p) + 5))) + seed[b:])
            words = piece.split()
            if len(lines) > 1 and words:  # the longest line
                found.append(lambda size, b=begin, p=piece, w=words[-1]: seed[:b] + p.rstrip(b"\n") +
                             (b" " + w) * (size // (len(w) + 1)) + seed[b + len(p) - 1:])
    return found


def seconds(program, folder):
    """@return the processor time of each file of the folder by its name."""
    done = subprocess.run([program, folder], capture_output=True, text=True, timeout=600, env={**os.environ, **KEEP_MEMORY})
    taken = {pathlib.Path(name).name: float(time) for time, name in re.findall(r"^(\S+) s (\S+)$", done.stdout, re.M)}
    if done.returncode != 0 or len(taken) != sum(1 for _ in pathlib.Path(folder).iterdir()):
        raise RuntimeError(f"{program} ended with {done.returncode}: {done.stderr[-500:]}")
    return taken


def grows(program, make):
    """@return growth at four times the bytes, and the least seconds of the larger."""
    with tempfile.TemporaryDirectory() as folder:
        for i in range(RUNS):
            # Files are taken in the order of their names.
            (pathlib.Path(folder) / f"{i}large").write_bytes(make(MOST_BYTES))
            (pathlib.Path(folder) / f"{i}small").write_bytes(make(MOST_BYTES // 4))
        taken = seconds(program, folder)
    ratios = [taken[f"{i}large"] / max(taken[f"{i}small"], 1e-9) for i in range(RUNS)]
    return statistics.median(ratios), min(taken[f"{i}large"] for i in range(RUNS))


def judge(program, seeds):
    """@return lines for what grows too fast, and how many inputs were tried."""
    makers = {}
    with tempfile.TemporaryDirectory() as folder:
        for seed in sorted(seeds.iterdir()):
            for i, make in enumerate(repetitions(seed.read_bytes())):
                name = f"{re.sub('[^A-Za-z0-9_.-]', '_', seed.name)}.{i}"
                makers[name] = make
                (pathlib.Path(folder) / name).write_bytes(make(MOST_BYTES))
        taken = seconds(program, folder) if makers else {}
    wrong = []
    for name, time in sorted(taken.items(), key=lambda item: -item[1]):
        if time < LEAST_S:
            break
        growth, least = grows(program, makers[name])
        if least >= LEAST_S and growth > MOST_GROWTH:
            wrong.append(f"{name}: {growth:.1f} times at four times the bytes, {least:.2f} s for {MOST_BYTES} bytes")
    return wrong, len(makers), max(taken.values(), default=0.0)


def main():
    programs, seeds = map(pathlib.Path, sys.argv[1:3])
    targets = sys.argv[3:] or sorted(folder.name for folder in seeds.iterdir())
    failed = False
    for target in targets:
        wrong, tried, longest = judge(programs / f"fuzz_{target}", seeds / target)
        print(f"{target}: {tried} inputs, {longest:.2f} s at most", *wrong, sep="\n  ", flush=True)
        failed |= bool(wrong)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
