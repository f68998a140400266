"""What a vehicle meets every day: a map of one day, scans of another, priors off by 1 m and 5 deg."""

import dataclasses

import answers
from batches import Batch

FIRST_SEED = 40000
SENSORS = ["hdl64", "os1-64", "vlp16", "hdl64", "os1-64", "os1-128"]
# Farther from every mapped pose than this the way was not driven on the map's day [m].
MAX_FROM_MAP_M = 4.0
TRIALS = 4


@dataclasses.dataclass(frozen=True)
class Street:
    """A world, its two days and the sensor."""

    seed: int
    scenario: str
    sensor: str
    day: int
    change: bool
    scans: int
    queried_scans: int

    @property
    def name(self):
        return f"{self.scenario}-{self.seed}-{self.sensor}"


def streets(options):
    """Every sixth is a depot; every other one has building sites and fences changed as well."""
    queried = max(1, round(options.queries / options.seeds / TRIALS))
    return [Street(FIRST_SEED + i, "depot" if i % 6 == 4 else "town", SENSORS[i % len(SENSORS)], 2 + i % 3, i % 2 == 1,
                   options.scans, queried)
            for i in range(options.seeds)]


def queried_scans(drive, map_, count):
    on_map = [i for i, d in enumerate(map_.distances_m(drive.T_map_lidar)) if d <= MAX_FROM_MAP_M]
    return drive.spaced(on_map, count)


def ask(program, street, scratch):
    mapped = program.simulate(scratch / "mapped", street.scenario, street.seed, street.scans, street.sensor)
    map_ = program.build(mapped, scratch / "map", "::2")
    mapped.remove()
    other = program.simulate(scratch / "other", street.scenario, street.seed, street.scans, street.sensor, street.day,
                             street.change)
    asked = other.derived(scratch / "asked", queried_scans(other, map_, street.queried_scans))
    trials = -(-street.queried_scans * TRIALS // len(asked))
    return answers.of_kind(program.ask(map_, asked, "1,5", trials, street.seed), "nominal")


def batches(program, options):
    return [Batch(street.name, dataclasses.asdict(street), lambda scratch, street=street: ask(program, street, scratch))
            for street in streets(options)]
