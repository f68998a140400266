"""Reads a map package of schema 2 with numpy, from maps/package.md alone: a second reader beside the program's.

    map = MapPackage(folder)
    for tile in map.tiles(): tile.position (N x 3 float64, map frame), tile.intensity, tile.observations, tile.kind,
        tile.object, tile.normal, tile.planarity, tile.first_scan, tile.last_scan (numbers over all
        drives; object plus 1), tile.evidence_drive, tile.free, tile.hit (drives x 20 x 20 x 8)

Checks what the page lets a reader check: digests, sizes, order; ValueError says what is wrong.
"""

import dataclasses
import hashlib
import json
import pathlib
import re
import struct

import numpy as np

TILE_M, REGION_TILES = 20.0, 32
ROW = np.dtype([("xy", "u1", 2), ("pack", "<u2"), ("points", "<u4"), ("offset", "<u8"), ("bytes", "<u4"),
                ("base_m", "<i4"), ("min_xy", "<u2", 2), ("max_xy", "<u2", 2), ("z", "<i4", 2), ("sha256", "u1", 32)])
PACK = np.dtype([("bytes", "<u8"), ("sha256", "u1", 32)])


@dataclasses.dataclass
class Tile:
    x: int
    y: int
    position: np.ndarray
    intensity: np.ndarray
    observations: np.ndarray
    kind: np.ndarray
    object: np.ndarray
    normal: np.ndarray = None
    planarity: np.ndarray = None
    first_scan: np.ndarray = None
    last_scan: np.ndarray = None
    evidence_base_m: int = 0
    evidence_drive: np.ndarray = None
    free: np.ndarray = None
    hit: np.ndarray = None


def require(holds, what):
    if not holds:
        raise ValueError(what)


class Columns:
    """The columns of a tile, one behind the other."""

    def __init__(self, data, at):
        self.data, self.at = data, at

    def take(self, kind, count, width=1):
        values = np.frombuffer(self.data, kind, count * width, self.at)
        self.at += -(-values.nbytes // 8) * 8
        return values.reshape(count, width) if width > 1 else values


def decode_tile(data, x, y, origin, drives):
    points, flags, base_m, tall, of_objects, scans, named, seen = struct.unpack_from("<IIiIIIII", data)
    columns, has_history = Columns(data, 32), bool(flags & 1)

    def over_all(rows, counted):
        drive, number = columns.take("<u4", rows), columns.take("<u4", rows)
        return np.concatenate([[0], np.cumsum([each[counted] for each in drives])]).astype(np.int64)[drive] + number

    steps = np.stack([columns.take("<u2", points).astype(np.int64) for _ in range(3)])
    intensity = columns.take("<f2", points).astype(np.float32)
    observations, kind = columns.take("<u2", points), columns.take("u1", points)
    index = columns.take("<u4", tall)
    steps[2, index] = columns.take("<i4", tall)
    objects = np.zeros(points, np.uint32)
    index = columns.take("<u4", of_objects)
    row = columns.take("<u4" if flags & 4 else "<u2", of_objects)
    objects[index] = over_all(named, "objects")[row] + 1
    position = np.stack([TILE_M * x + (steps[0] + 0.5) * TILE_M / 65536, TILE_M * y + (steps[1] + 0.5) * TILE_M / 65536,
                         base_m + (steps[2] + 0.5) / 2048], axis=1) + origin
    tile = Tile(x, y, position, intensity, observations, kind, objects)
    if has_history:
        tile.normal, tile.planarity = columns.take("i1", points, 3), columns.take("u1", points)
        number = over_all(scans, "scans")
        width = "<u4" if flags & 2 else "<u2"
        tile.first_scan, tile.last_scan = (number[columns.take(width, points)] for _ in range(2))
    tile.evidence_base_m = int(columns.take("<i4", 1)[0]) if seen else 0
    tile.evidence_drive = columns.take("<u4", seen)
    tile.free, tile.hit = (np.unpackbits(columns.take("u1", 400 * seen), bitorder="little").reshape(seen, 20, 20, 8).astype(bool)
                           for _ in range(2))
    require(columns.at == len(data), f"tile {x}, {y}: {len(data)} bytes, expected {columns.at}")
    return tile


class MapPackage:
    def __init__(self, folder):
        self.folder = pathlib.Path(folder)
        self.manifest = json.loads((self.folder / "manifest.json").read_text())
        require(self.manifest["schema"] == 2, f"schema {self.manifest['schema']}, expected 2")
        self.origin = np.array(self.manifest["origin"])

    def tiles(self):
        """By x, then y within each region; regions by x, then y."""
        extent, count, points = self.manifest["extent"], 0, 0
        for tile in self._tiles():
            count, points = count + 1, points + len(tile.kind)
            inside = (tile.position >= self.origin + extent["min"] - 1e-6) & (tile.position <= self.origin + extent["max"] + 1e-6)
            require(inside.all(), f"tile {tile.x}, {tile.y}: points outside of the extent")
            yield tile
        require((count, points) == (extent["tiles"], extent["points"]), f"{count} tiles with {points} points, not {extent}")

    def _tiles(self):
        numbers = [re.fullmatch(r"regions/(-?\d+)_(-?\d+)\.node", path) for path in self.manifest["files"]]
        for x, y in sorted((int(match[1]), int(match[2])) for match in numbers if match):
            yield from self.region(x, y)

    def region(self, region_x, region_y):
        name = f"regions/{region_x}_{region_y}.node"
        data = (self.folder / name).read_bytes()
        require(hashlib.sha256(data).hexdigest() == self.manifest["files"][name]["sha256"], f"{name}: another digest")
        require(data[:8] == b"smregio1", f"{name}: no region")
        packs, tiles = struct.unpack_from("<II", data, 8)
        require(len(data) == 16 + packs * PACK.itemsize + tiles * ROW.itemsize, f"{name}: {len(data)} bytes")
        pack_rows = np.frombuffer(data, PACK, packs, 16)
        files = [(self.folder / "packs" / (bytes(row["sha256"]).hex() + ".pack")).read_bytes() for row in pack_rows]
        for file, row in zip(files, pack_rows):
            require(hashlib.sha256(file).digest() == bytes(row["sha256"]), f"{name}: a pack has another digest")
        for row in np.frombuffer(data, ROW, tiles, 16 + packs * PACK.itemsize):
            begin = int(row["offset"])
            tile = files[row["pack"]][begin:begin + int(row["bytes"])]
            x, y = (REGION_TILES * region + int(within) for region, within in zip((region_x, region_y), row["xy"]))
            require(hashlib.sha256(tile).digest() == bytes(row["sha256"]), f"tile {x}, {y}: another digest")
            decoded = decode_tile(tile, x, y, self.origin, self.manifest["drives"])
            require(len(decoded.kind) == row["points"], f"tile {x}, {y}: {len(decoded.kind)} points")
            yield decoded
