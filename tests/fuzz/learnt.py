"""What fuzzing has learnt, small enough for the repository: learnt/NAME.zip, which soak.py starts from and
replay.cpp gives to its target."""

import os
import pathlib
import shutil
import subprocess
import zipfile

MOST_BYTES = 200_000
LONGEST_INPUT = 4096  # of what libFuzzer tries
SAME_TIME = (1980, 1, 1, 0, 0, 0)


def unpack(archive, corpus):
    if not archive.exists():
        return
    with zipfile.ZipFile(archive) as packed:
        for name in packed.namelist():
            if not (corpus / name).exists():
                (corpus / name).write_bytes(packed.read(name))


def inputs(archive):
    with zipfile.ZipFile(archive) as packed:
        return [packed.read(name) for name in packed.namelist()]


def merged(program, corpus, into, options=()):
    """The fewest inputs of `corpus` that reach what all of it reaches, in the folder `into`, made anew."""
    shutil.rmtree(into, ignore_errors=True)
    into.mkdir()
    # All inputs pass one process here, and what AddressSanitizer holds back of each adds up: no 512 MiB as for one.
    subprocess.run([program, "-set_cover_merge=1", "-rss_limit_mb=2048", "-timeout=5", f"-max_len={LONGEST_INPUT}", *options, into, corpus],
                   stderr=subprocess.DEVNULL, check=True, env=os.environ | {"ASAN_OPTIONS": "detect_leaks=0"})
    return into


def pack(files, archive):
    """Small ones first. @return how many fit"""
    packed = 0
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as out:
        for file in sorted(files, key=lambda path: (path.stat().st_size, path.name)):
            info = zipfile.ZipInfo(file.name, SAME_TIME)
            info.compress_type = zipfile.ZIP_DEFLATED
            out.writestr(info, file.read_bytes())
            # Its end lists every file once more.
            packed += 1
            if out.fp.tell() + 100 * packed > MOST_BYTES:
                break
    return packed


def keep(program, folder, archive):
    """@return what was kept, in words"""
    corpus, partial = folder / "corpus", folder / "merged"
    before = len(list(corpus.iterdir()))
    merged(program, corpus, partial)
    shutil.rmtree(corpus)
    partial.rename(corpus)
    # An edge once, however often it is passed.
    few = list(merged(program, corpus, folder / "few", ["-use_counters=0"]).iterdir())
    archive.parent.mkdir(exist_ok=True)
    packed = pack(few, archive)
    return f"{before} inputs, {len(list(corpus.iterdir()))} left, {packed} of {len(few)} packed"
