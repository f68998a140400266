#!/usr/bin/env python3
"""What a map holds, against a digest that was recorded before: a change of the code that is to leave maps as they are
must not change it.

usage: map_content.py STILLMAP NAME [MAP]
(NAME: a line of map_content.txt; `kitti` and `mulran` take the MAP that real_drives.py has built, `town` makes its own:
simulate town --seed 1 --scans 60, built by default)

The last bits of a map depend on the processor, so a digest counts where the words of its column CPU are all said of this
one (/proc/cpuinfo). Measured by taking instruction sets away, 2026-11-27:
- Maps of given drives whose poses are kept (mulran): the same with AVX2, AVX-512 and VNNI, with any number of threads
  and other kernels of OpenBLAS; others without FMA, which glibc's libm uses where it finds it.
- Maps whose poses are refined (kitti): since 2026-11-28 others with AVX-512 than without, with AVX2 the same for any
  kernel of OpenBLAS that runs there. OpenBLAS has a kernel for small matrices with AVX-512 alone; that this is the cause
  was not shown.
- Simulated drives: Embree rounds otherwise with SSE, AVX2 and AVX-512, and its approximate reciprocals (rcpps) are the
  vendor's own. So `town` counts on the vendor and family that it was recorded on.

Without such a line, without STILLMAP_REAL_DATA for real drives, or with another libm the test is skipped (exit code 77).
"""

import os
import pathlib
import platform
import subprocess
import sys
import tempfile

SKIPPED = 77
RECORDED_LIBC = ("glibc", "2.36")


def skip(why):
    print(f"skipped: {why}")
    sys.exit(SKIPPED)


def run(program, *arguments):
    done = subprocess.run([program, *map(str, arguments)], capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"stillmap {' '.join(map(str, arguments))}: exit {done.returncode}\n{done.stderr}")
    return done.stdout


def words_of_cpu():
    """Vendor, family and flags of the first core."""
    words = set()
    for line in pathlib.Path("/proc/cpuinfo").read_text().split("\n\n")[0].splitlines():
        key, _, value = line.partition(":")
        if key.strip() in ("vendor_id", "cpu family", "flags"):
            words.update(value.split())
    return words


def recorded(name):
    lines = pathlib.Path(__file__).with_suffix(".txt").read_text().splitlines()
    known = [line.split() for line in lines if not line.startswith("#")]
    of_name = [(cpu, digest) for found, cpu, digest in known if found == name]
    if not of_name:
        sys.exit(f"map_content.txt: no line {name}")
    if platform.libc_ver() != RECORDED_LIBC:
        skip(f"{' '.join(platform.libc_ver())} is not the libm that it was recorded with, {' '.join(RECORDED_LIBC)}")
    for cpu, digest in of_name:
        words = cpu.split(",")
        if all((word.lstrip("!") in words_of_cpu()) != word.startswith("!") for word in words):
            return digest
    skip(f"nothing was recorded on such a processor, only on {' and '.join(cpu for cpu, _ in of_name)}")


def main():
    program, name = sys.argv[1:3]
    if name != "town" and not os.environ.get("STILLMAP_REAL_DATA"):
        skip("STILLMAP_REAL_DATA is not set")
    expected = recorded(name)
    with tempfile.TemporaryDirectory() as temporary:
        if name == "town":
            drive, built = pathlib.Path(temporary) / "drive", pathlib.Path(temporary) / "map"
            run(program, "simulate", "town", "-o", drive, "--seed", 1, "--scans", 60)
            run(program, "build", drive, "-o", built)
        else:
            built = pathlib.Path(sys.argv[3])
        found = run(program, "inspect", built, "--content").strip()
    print(f"content of {name}: {found}")
    if found == expected:
        return 0
    print(f"recorded:{' ' * (len(name) + 2)}{expected}\n"
          "The map holds something else than before. If that is meant, write the new digest into "
          "tests/accuracy/map_content.txt and say in the commit why it changed.")
    return 1


if __name__ == "__main__":
    sys.exit(main())
