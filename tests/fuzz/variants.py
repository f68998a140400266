#!/usr/bin/env python3
"""Writes variants of a target's seeds, one change each, which bytes changed at random become late or never: wherever an
input holds a JSON text, what json_variants.py makes of it; other numbers in its lines; each byte by a few others; the
input cut at each byte. For `http` also a request for each route of the contract, seeds of other targets as bodies, and drawn
sequences of requests, for `request_json` several changes at once, for bags and clouds such with other messages, columns and
points, for `rosbag2` the seeds of `mcap` and `rawlog`, for `archive` packages with the manifests of `manifest`.

usage: tests/fuzz/variants.py TARGET FOLDER
"""

import hashlib
import itertools
import json
import pathlib
import re
import struct
import sys

import bag_variants
import cloud_variants
import http_variants
import json_variants
import request_variants
import seeds
import text_variants

MOST_PLACES = 300  # of a seed where its bytes are changed, about
TAR_BLOCK = 512


def json_within(seed):
    """The longest JSON object of it. @return its start, its end and what it says; None where there is none"""
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
    """`text` for these bytes, with the length that some formats give before it made right."""
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


def archives():
    seed = seeds.seed("archive", "small")
    start, end, _ = json_within(seed)
    for manifest in seeds.of("manifest"):
        yield put_in(seed, start, end, manifest)


def bags_of_rosbag2():
    for other in ("mcap", "rawlog"):  # told by their first bytes, whatever a file is called
        yield from seeds.of(other)
    yield from bag_variants.rosbag2_files()


DRAWN = bag_variants.DRAWN | cloud_variants.DRAWN | {
    "archive": archives, "http": http_variants.requests, "request_json": request_variants.requests,
    "rosbag2": bags_of_rosbag2}


def byte_variants(seed):
    for i in range(0, len(seed), max(1, len(seed) // MOST_PLACES)):
        yield seed[:i]
        yield seed[:i] + seed[i + 1:]
        for byte in b"\x00\x01\x7f\x80\xff \n\r\t0-.,:;\"'{}[]\\/#%=ne":
            yield seed[:i] + bytes([byte]) + seed[i + 1:]
        for byte in b" \n,:\"{}[]0\x00":
            yield seed[:i] + bytes([byte]) + seed[i:]
        for bit in range(8):
            yield seed[:i] + bytes([seed[i] ^ 1 << bit]) + seed[i + 1:]
    for words in (b"\xef\xbb\xbf", b"\xef\xbb", b"\xff\xfe", b" ", b"\r\n", b"/*x*/", b"\0"):
        yield words + seed
        yield seed + words
    yield seed + seed


def variants(target):
    if target in DRAWN:
        yield from DRAWN[target]()
    for seed in seeds.of(target):
        yield from byte_variants(seed)
        if found := json_within(seed):
            start, end, document = found
            for text in itertools.chain(json_variants.changed(document), json_variants.drawn_anew(document)):
                yield put_in(seed, start, end, text)
        else:
            yield from text_variants.drawn_anew(seed)


def write(target, folder):
    """@return how many"""
    folder.mkdir(parents=True, exist_ok=True)
    written = set()
    for each in variants(target):
        name = hashlib.sha1(each).hexdigest()
        if len(each) <= seeds.LONGEST_INPUT and name not in written:
            (folder / name).write_bytes(each)
            written.add(name)
    return len(written)


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    print(f"{write(sys.argv[1], pathlib.Path(sys.argv[2]))} variants")
