"""Scans whose pose can be told, but not easily: much is hidden, gone, alike or far from the prior."""

import dataclasses

import numpy as np

from asking import Asker
from batches import Batch
import changes
import nominal

FIRST_SEED = 42000
SENSORS = ["vlp16", "os1-64"]
# The town is driven in rounds: the street beside the first one comes after three of its blocks.
ROUND = 2.5
NEAR, FAR, NONE, EXACT = "1,5", "5,20", "none", "0,0"
LATE_S = {"late_0.5s": 0.5, "late_2s": 2.0}


@dataclasses.dataclass(frozen=True)
class World:
    seed: int
    scenario: str
    sensor: str
    day: int
    mapped_scans: int
    scans: int
    queries: int

    @property
    def name(self):
        return f"{self.scenario}-{self.seed}-{self.sensor}"


def worlds(options):
    """Of six, four are towns, one is a depot and one a highway."""
    found = []
    for i in range(options.seeds):
        scenario = {1: "highway", 4: "depot"}.get(i % 6, "town")
        # Half of the towns are driven far enough to have a street beside the one that is asked for.
        sensor = SENSORS[(i + i // 6) % 2]
        long = scenario == "town" and sensor == "vlp16"
        found.append(World(FIRST_SEED + i, scenario, sensor, 2 + i % 3,
                           round(options.scans * (ROUND if long else 1.0)), options.scans,
                           max(1, round(options.queries / options.seeds))))
    return found


def ask_parallel(asker, map_, other, scans):
    """From a prior one block aside: `right` is the true pose, or not to be `ok`."""
    found = {scan: changes.parallel_street(map_, other.T_map_lidar[scan]) for scan in scans}
    beside = [scan for scan, T in found.items() if T is not None]
    if beside:
        asker("parallel_street", map_, other, beside, NEAR, 2, np.array([found[scan] for scan in beside]))


def ask_late(asker, map_, other, scans):
    """From the true pose of some time before."""
    times_s = np.loadtxt(other.folder / "times.txt")
    for kind, late_s in LATE_S.items():
        before = np.searchsorted(times_s, times_s[scans] - late_s)
        known = times_s[scans] >= late_s
        asker(kind, map_, other, scans[known], EXACT, 1, other.T_map_lidar[before[known]])


def ask_town(asker, world, mapped, map_, other):
    def scans(share, trials):
        return nominal.queried_scans(other, map_, asker.count(share, trials))

    for kind, change in {"half_missing": changes.without_half, "half_behind_wall": changes.behind_wall}.items():
        asker(kind, map_, other, scans(0.17, 2), NEAR, 2, change=changes.keyed(change, world.seed))
    asker("building_gone", map_, other, scans(0.17, 2), NEAR, 2, change=changes.BuildingsGone(other, world.seed))
    ask_late(asker, map_, other, scans(0.1, 1))
    ask_parallel(asker, map_, other, scans(0.12, 2))
    half_built = mapped.derived(asker.scratch / "half_built", range(0, len(mapped), 2),
                                changes.BuildingsGone(mapped, world.seed))
    new_buildings = asker.program.build(half_built, asker.scratch / "half_built_map")
    half_built.remove()
    asker("building_new", new_buildings, other, scans(0.17, 2), NEAR, 2)


def ask_alike(asker, kind, map_, other, shares):
    for prior, share in shares.items():
        trials = 1 if prior == NONE else 2
        asker(kind, map_, other, nominal.queried_scans(other, map_, asker.count(share, trials)), prior, trials)


def ask(program, world, scratch):
    asker = Asker(program, scratch, world.seed, world.queries)
    mapped = program.simulate(scratch / "mapped", world.scenario, world.seed, world.mapped_scans, world.sensor)
    map_ = program.build(mapped, scratch / "map", "::2")
    other = program.simulate(scratch / "other", world.scenario, world.seed, world.scans, world.sensor, world.day)
    if world.scenario == "town":
        ask_town(asker, world, mapped, map_, other)
    elif world.scenario == "highway":
        ask_alike(asker, "corridor", map_, other, {NEAR: 1.0})
    else:
        ask_alike(asker, "symmetric", map_, other, {NEAR: 0.4, FAR: 0.4, NONE: 0.2})
    return asker.answers()


def batches(program, options):
    return [Batch(world.name, dataclasses.asdict(world), lambda scratch, world=world: ask(program, world, scratch))
            for world in worlds(options)]
