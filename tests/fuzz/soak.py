#!/usr/bin/env python3
"""Runs libFuzzer's programs and keeps what they found and how long they ran.

usage: soak.py PROGRAMS STATE [--seconds N | --soak] [--jobs N] [TARGET...]

--seconds N  each target for N seconds, 60 by default
--soak       each target until it has run a million inputs, and 30 CPU-minutes since its last new edge; continues a run that
             was interrupted
--jobs N     targets at a time, 1 by default

STATE/NAME/seeds is written by seeds.py; STATE/NAME/corpus holds the inputs that reached something new, with --soak also of
those that variants.py makes; STATE/NAME/state.json counts, anew when the program is another; STATE/NAME/edges.log tells where
in the sources new edges lie; STATE/NAME/found/ holds inputs that broke something. An input may take 5 s and 512 MiB. Ends with
1 when anything was found.
"""

import argparse
import concurrent.futures
import hashlib
import json
import math
import os
import pathlib
import re
import shutil
import subprocess
import sys

import seeds
import variants

HERE = pathlib.Path(__file__).resolve().parent
QUIET_CPU_S = 30 * 60
LEAST_INPUTS = 1_000_000
# A scan is aligned with each of its inputs: half an hour for all variants, which are patches to bytes as any.
SLOW = {"index"}
# Threads of their own go on behind an input, and LeakSanitizer before LLVM 20 now and then overlooks one and takes what it
# holds for lost (llvm/llvm-project#112807): looked for at the end of a run alone, when they have been joined.
WITH_THREADS = {"http"}
# A fresh process sheds what a leak check defers, but first reads its whole corpus: that of `http` for over a minute.
SLICE_S = 900
LEAST_SLICE_S = 60
# AddressSanitizer keeps freed memory, by default half of what is allowed in all.
ENVIRONMENT = {"ASAN_OPTIONS": "quarantine_size_mb=32:detect_leaks=1", "UBSAN_OPTIONS": "print_stacktrace=1"}
if SYMBOLIZER := shutil.which("llvm-symbolizer-16"):
    ENVIRONMENT["ASAN_SYMBOLIZER_PATH"] = SYMBOLIZER
LINE = re.compile(r"^#(\d+)\s+\w+\s+cov: (\d+)")
# Printed for what the inputs that are kept did not reach when they were read.
EDGE = re.compile(r"^\s*NEW_PC: (0x[0-9a-f]+)(.*)")
# Without it an edge has another address in each run, and is not known again: as in a container that forbids it.
NO_RANDOM_ADDRESSES = ["setarch", "-R"]
if subprocess.run([*NO_RANDOM_ADDRESSES, "true"], stderr=subprocess.DEVNULL, check=False).returncode != 0:
    NO_RANDOM_ADDRESSES = []


class Target:
    def __init__(self, program, folder):
        self.name = program.name.removeprefix("fuzz_")
        self.program, self.folder = program, folder
        self.state_file, self.edges_file = folder / "state.json", folder / "edges.log"
        self.state = {"inputs": 0, "cpu_s": 0.0, "cpu_s_at_last_edge": 0.0, "edges": 0}
        if self.state_file.exists():
            self.state |= json.loads(self.state_file.read_text())
        for each in ("corpus", "found"):
            (folder / each).mkdir(parents=True, exist_ok=True)

    def begin(self):
        """What was counted of another program says nothing of this one."""
        digest = hashlib.sha256(self.program.read_bytes()).hexdigest()
        if self.state.get("program") != digest:
            self.state |= {"inputs": 0, "cpu_s": 0.0, "cpu_s_at_last_edge": 0.0, "edges": 0, "program": digest,
                           "variants": False}
            self.edges_file.unlink(missing_ok=True)
        seeds.write(self.name, self.folder / "seeds")

    def quiet_s(self):
        return self.state["cpu_s"] - self.state["cpu_s_at_last_edge"]

    def is_done(self):
        return self.quiet_s() >= QUIET_CPU_S and self.state["inputs"] >= LEAST_INPUTS

    def slice_s(self):
        """Until it is done, as far as that can be told: a new edge or too few inputs make it longer."""
        left_s = QUIET_CPU_S - self.quiet_s() if self.state["inputs"] >= LEAST_INPUTS else SLICE_S
        return min(max(math.ceil(left_s), LEAST_SLICE_S), SLICE_S)

    def findings(self):
        return sorted(path.name for path in (self.folder / "found").iterdir())

    def command(self, seconds):
        words = HERE / f"{self.name}.dict"
        options = [f"-max_total_time={seconds}", "-rss_limit_mb=512", "-timeout=5", f"-max_len={seeds.LONGEST_INPUT}",
                   "-print_final_stats=1", "-print_pcs=1", "-reload=0", f"-artifact_prefix={self.folder}/found/"]
        options += [f"-dict={words}"] if words.exists() else []
        options += ["-detect_leaks=0"] if self.name in WITH_THREADS else []
        return [*NO_RANDOM_ADDRESSES, self.program, *options, self.folder / "corpus", self.folder / "seeds"]

    def take_variants(self):
        """Once a program: what of them reaches something new joins the corpus. @return whether nothing was found"""
        if self.state.get("variants") or self.name in SLOW:
            return True
        before, folder = self.findings(), self.folder / "variants"
        variants.write(self.name, folder)
        # All inputs pass one process here, and what AddressSanitizer holds back of each adds up: no 512 MiB as for one.
        subprocess.run([self.program, "-merge=1", "-rss_limit_mb=2048", "-timeout=5", f"-max_len={seeds.LONGEST_INPUT}",
                        f"-artifact_prefix={self.folder}/found/", self.folder / "corpus", folder], check=True,
                       stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                       env=os.environ | {"ASAN_OPTIONS": "detect_leaks=0"})
        shutil.rmtree(folder)
        self.state["variants"] = True
        self.save()
        return self.findings() == before

    def run(self, seconds):
        """@return whether nothing was found"""
        before_s, before_inputs = self.state["cpu_s"], self.state["inputs"]
        process = subprocess.Popen(self.command(seconds), stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True,
                                   errors="replace", env=os.environ | ENVIRONMENT)
        last = []
        for line in process.stderr:
            last = [*last[-60:], line]
            self.state["cpu_s"] = max(self.state["cpu_s"], before_s + cpu_s(process.pid))
            if edge := EDGE.match(line):
                self.take_edge(*edge.groups())
            match = LINE.match(line)
            if not match:
                continue
            self.state["inputs"] = before_inputs + int(match[1])
            self.state["edges"] = max(self.state["edges"], int(match[2]))
            # So that little is lost when it is cut off.
            self.save()
        # The kernel's last word on it; /proc was last looked at when it printed a line.
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        self.state["cpu_s"] = before_s + usage.ru_utime + usage.ru_stime
        ok = process.returncode == 0
        self.save()
        if not ok:
            (self.folder / "last.log").write_text("".join(last))
            print(f"{self.name}: see {self.folder}/last.log and {self.folder}/found/", file=sys.stderr)
        return ok

    def take_edge(self, address, place):
        """New is what no run of this program has reached: some edges depend on what ran before, not on the input alone."""
        self.edges_file.touch()
        if address in {line.split(" ")[0] for line in self.edges_file.read_text().splitlines()}:
            return
        self.state["cpu_s_at_last_edge"] = self.state["cpu_s"]
        with self.edges_file.open("a") as log:
            log.write(f"{address} at {self.state['cpu_s'] / 60:.1f} CPU-minutes{place}\n")
        # Known from now on, so that a run that is killed must not forget when it was new.
        self.save()

    def save(self):
        partial = self.state_file.with_suffix(".partial")
        partial.write_text(json.dumps(self.state, indent=1))
        partial.rename(self.state_file)

    def line(self):
        return (f"{self.name}: {self.state['inputs']:,} inputs, {self.state['edges']} edges, "
                f"{self.state['cpu_s'] / 60:.1f} CPU-minutes, {self.quiet_s() / 60:.1f} since the last new edge"
                f"{', done' if self.is_done() else ''}")


def cpu_s(pid):
    try:
        fields = pathlib.Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except (FileNotFoundError, ProcessLookupError):
        return 0.0
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def run_once(target, asked):
    """@return its name when something was found"""
    ok = (not asked.soak or target.take_variants()) and target.run(target.slice_s() if asked.soak else asked.seconds)
    print(target.line(), flush=True)
    return None if ok else target.name


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("programs", type=pathlib.Path)
    parser.add_argument("state", type=pathlib.Path)
    parser.add_argument("--seconds", type=int, default=60)
    parser.add_argument("--soak", action="store_true")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("targets", nargs="*")
    asked = parser.parse_intermixed_args()
    programs = sorted(path for path in asked.programs.glob("fuzz_*") if os.access(path, os.X_OK))
    known = [path.name.removeprefix("fuzz_") for path in programs]
    for name in asked.targets:
        if name not in known:
            sys.exit(f"{name}: expected one of {' '.join(known)}")
    targets = [Target(path, asked.state / name) for name, path in zip(known, programs)
               if not asked.targets or name in asked.targets]
    for target in targets:
        target.begin()
    broken = set()
    # Turn by turn, so that all have run when time is short.
    while left := [t for t in targets if t.name not in broken and not (asked.soak and t.is_done())]:
        with concurrent.futures.ThreadPoolExecutor(asked.jobs) as pool:
            broken |= set(pool.map(lambda target: run_once(target, asked), left)) - {None}
        if not asked.soak:
            break
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
