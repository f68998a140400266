"""Work in pieces that survive being killed: a piece that is done leaves its answers and a mark."""

import concurrent.futures
import dataclasses
import json
import pathlib
import shutil
import sys
import threading
import time
from typing import Callable

import answers
from program import write_json


@dataclasses.dataclass(frozen=True)
class Batch:
    """One drive's queries. `work(scratch)` gives a table of answers; what it writes in `scratch` is deleted."""

    name: str
    # What the answers depend on besides the program; a batch with another one is done again.
    spec: dict
    work: Callable

    def done(self, folder, digest):
        try:
            mark = json.loads((folder / self.name / "done.json").read_text())
        except FileNotFoundError:
            return False
        return mark["spec"] == self.spec and mark["program"] == digest

    def table(self, folder):
        return answers.read(folder / self.name / "answers.csv")

    def run(self, folder, digest):
        scratch, result = folder / f"{self.name}.scratch", folder / self.name
        for left_over in (scratch, result):
            shutil.rmtree(left_over, ignore_errors=True)
        scratch.mkdir(parents=True)
        result.mkdir()
        start = time.monotonic()
        try:
            answers.write(result / "answers.csv", self.work(scratch))
        finally:
            shutil.rmtree(scratch)
        write_json(result / "done.json",
                   {"spec": self.spec, "program": digest, "seconds": round(time.monotonic() - start, 1)})


class Progress:
    def __init__(self, what, whole, jobs):
        self.what, self.whole, self.jobs, self.count = what, whole, jobs, 0
        self.start, self.lock = time.monotonic(), threading.Lock()

    def __call__(self, name):
        with self.lock:
            self.count += 1
            seconds = (time.monotonic() - self.start) / self.count * (self.whole - self.count)
            print(f"{self.what} {self.count}/{self.whole} {name}, about {seconds / 60.0:.1f} min left", file=sys.stderr,
                  flush=True)


def run_all(what, batches, folder, digest, jobs):
    """Runs what is not done yet, `jobs` at a time. @return the tables by the names of the batches."""
    folder = pathlib.Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    left = [batch for batch in batches if not batch.done(folder, digest)]
    if len(left) < len(batches):
        print(f"{what}: {len(batches) - len(left)} of {len(batches)} were done before", file=sys.stderr)
    progress = Progress(what, len(left), jobs)

    def run(batch):
        batch.run(folder, digest)
        progress(batch.name)

    with concurrent.futures.ThreadPoolExecutor(jobs) as pool:
        running = [pool.submit(run, batch) for batch in left]
        try:
            for future in concurrent.futures.as_completed(running):
                future.result()
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    return {batch.name: batch.table(folder) for batch in batches}
