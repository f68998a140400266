"""A map of a drive's even scans, asked with its odd ones."""

import pathlib
import shutil
import subprocess
import sys

import answers
import scans


def run(program, *arguments):
    done = subprocess.run([program, *map(str, arguments)], capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"stillmap {' '.join(map(str, arguments))}: exit {done.returncode}\n{done.stderr}")


class Asker:
    def __init__(self, program, folder, drive, map_=None, method="default"):
        """@param map_  another map than that of the even scans."""
        self.program, self.folder, self.drive, self.method = program, pathlib.Path(folder), pathlib.Path(drive), method
        self.folder.mkdir(parents=True, exist_ok=True)
        self.map = map_ or self.folder / "map"
        if not self.map.exists():
            run(program, "build", drive, "-o", self.map, "--select", "::2")

    def ask(self, name, change, prior, select="1::2", trials=1, seed=1, poses_file=None):
        """Answers for the chosen scans, each changed. @param poses_file  that errors and priors are about."""
        begin, _, step = select.split(":")
        files = scans.scan_files(self.drive)
        chosen = set(range(int(begin or 0), len(files), int(step or 1)))
        derived = scans.derive(self.drive, self.folder / f"drive_{name}",
                               lambda records, index: change(records, index, lambda i: scans.read(files[i])[1]), chosen)
        file = self.folder / f"{name}.csv"
        run(self.program, "evaluate", "localization", self.map, derived, "--select", select, "--prior-error", prior,
            "--trials", trials, "--seed", seed, "--bias", "none", "--csv", file, "--method", self.method,
            *(["--poses", poses_file] if poses_file else []))
        shutil.rmtree(derived)
        return answers.read(file)
