"""One kind of question to a map, asked with scans of a drive."""

import numpy as np

import answers


class Asker:
    def __init__(self, program, scratch, seed, queries):
        self.program, self.scratch, self.seed, self.queries = program, scratch, seed, queries
        self.tables = []

    def count(self, share, trials):
        """Scans for `share` of the drive's queries."""
        return max(1, round(share * self.queries / trials))

    def __call__(self, kind, map_, drive, scans, prior, trials=1, around=None, change=None, solvable=True):
        """Asks for `scans` of `drive`; for `prior` and `around` (as many poses as scans) see `Program.ask`."""
        asked = drive.derived(self.scratch / f"{kind}-{len(self.tables)}", scans, change)
        table = self.program.ask(map_, asked, prior, trials, self.seed, around)
        asked.remove()
        table["scan"] = np.asarray(scans, float)[table["scan"].astype(int)]
        table = answers.of_kind(table, kind)
        self.tables.append(table if solvable else answers.without_truth(table))

    def answers(self):
        return answers.joined(self.tables)
