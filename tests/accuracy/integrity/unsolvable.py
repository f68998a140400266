"""Scans that were not taken where the map is: no answer may be `ok`."""

import dataclasses

import numpy as np

from asking import Asker
from batches import Batch
import changes

FIRST_SEED = 41000
# Worlds of other drives in the same frame.
OTHER_SEED = 500
SENSORS = ["vlp16", "os1-64"]
FOREIGN_SCANS = 120
# Farther from every mapped pose than this a scan is beyond the map [m].
BEYOND_M = 80.0
NEAR, FAR, NONE = "1,5", "5,20", "none"
NOISE = {"noise_ball": changes.ball, "noise_ranges": changes.scaled_ranges, "noise_azimuths": changes.shuffled_azimuths}


@dataclasses.dataclass(frozen=True)
class World:
    seed: int
    scenario: str
    sensor: str
    scans: int
    queries: int

    @property
    def name(self):
        return f"{self.scenario}-{self.seed}-{self.sensor}"


def worlds(options):
    """Every fourth is a depot, whose halls and rows look alike everywhere."""
    return [World(FIRST_SEED + i, "depot" if i % 4 == 3 else "town", SENSORS[(i // 2 + i // 4) % 2], options.scans,
                  max(1, round(options.queries / options.seeds)))
            for i in range(options.seeds)]


def ask_foreign(asker, world, map_, random, kind, scenario, shares):
    """Scans of another world, from priors on this map's roads and without."""
    drive = asker.program.simulate(asker.scratch / kind, scenario, world.seed + OTHER_SEED,
                                   min(FOREIGN_SCANS, world.scans), world.sensor)
    for prior, share in shares.items():
        trials = 1 if prior == NONE else 2
        scans = drive.spaced(range(len(drive)), asker.count(share, trials))
        around = None if prior == NONE else map_.somewhere(len(scans), random)
        asker(kind, map_, drive, scans, prior, trials, around, solvable=False)
    drive.remove()


def ask_unmapped(asker, mapped, scratch):
    """Scans from farther down the road than the map goes, from their true pose and from the last mapped one."""
    map_ = asker.program.build(mapped, scratch / "begun", f":{len(mapped) // 3}:2")
    beyond = np.flatnonzero(map_.distances_m(mapped.T_map_lidar) > BEYOND_M)
    if len(beyond) == 0:
        return
    scans = mapped.spaced(beyond, asker.count(0.1, 2))
    asker("unmapped", map_, mapped, scans, NEAR, 2)
    scans = mapped.spaced(beyond, asker.count(0.06, 2))
    asker("unmapped_lost_way", map_, mapped, scans, NEAR, 2, np.array([map_.T_map_lidar[-1]] * len(scans)))


def ask_noise(asker, world, map_, mapped):
    for kind, change in NOISE.items():
        change = changes.keyed(change, world.seed)
        asker(kind, map_, mapped, mapped.spaced(range(len(mapped)), asker.count(0.04, 2)), NEAR, 2, change=change,
              solvable=False)
        asker(kind, map_, mapped, mapped.spaced(range(len(mapped)), asker.count(0.025, 1)), NONE, change=change,
              solvable=False)


def ask(program, world, scratch):
    random = np.random.default_rng(world.seed)
    asker = Asker(program, scratch, world.seed, world.queries)
    mapped = program.simulate(scratch / "mapped", world.scenario, world.seed, world.scans, world.sensor)
    map_ = program.build(mapped, scratch / "map", "::2")
    ask_noise(asker, world, map_, mapped)
    if world.scenario == "town":
        ask_unmapped(asker, mapped, scratch)
    mapped.remove()
    wrong = [kind for kind in ("town", "highway", "depot") if kind != world.scenario]
    ask_foreign(asker, world, map_, random, f"other_{world.scenario}", world.scenario,
                {NEAR: 0.16, FAR: 0.12, NONE: 0.12})
    for scenario in wrong:
        ask_foreign(asker, world, map_, random, f"{scenario}_in_{world.scenario}", scenario, {NEAR: 0.08, NONE: 0.05})
    return asker.answers()


def batches(program, options):
    return [Batch(world.name, dataclasses.asdict(world), lambda scratch, world=world: ask(program, world, scratch))
            for world in worlds(options)]
