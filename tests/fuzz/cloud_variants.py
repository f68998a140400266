"""Point clouds drawn at random, PCD, PLY and LAS, of columns of all types in any order and in any coordinate system. Those
that are not taken are refused for one thing. For variants.py."""

import random
import struct

import seeds
from bag_variants import COLUMNS, drawn_number, rarely

DRAWS = 6000
PCD_TYPES = {("F", 4): "f", ("F", 8): "d", ("U", 1): "B", ("U", 2): "H", ("U", 4): "I", ("U", 8): "Q", ("I", 1): "b",
             ("I", 2): "h", ("I", 4): "i", ("I", 8): "q"}
PLY_TYPES = {"char": "b", "int8": "b", "uchar": "B", "uint8": "B", "short": "h", "int16": "h", "ushort": "H", "uint16": "H",
             "int": "i", "int32": "i", "uint": "I", "uint32": "I", "float": "f", "float32": "f", "double": "d", "float64": "d"}
WKT_NAMES = ("WGS 84", "WGS 84 / UTM zone 32N", "UTM zone 10, Northern Hemisphere", "ETRS89 / UTM zone 61", "NAD83 / UTM zone 17S",
             "false_easting", "False easting", "EPSG", "metre", "up", "")
WKT_WITHIN = {"PROJCS": ("GEOGCS", "PARAMETER", "UNIT", "AUTHORITY", "AXIS"), "GEOGCS": ("UNIT", "AUTHORITY"), "CS": ("UNIT",),
              "PROJCRS": ("CS", "LENGTHUNIT", "ID", "AXIS", "PARAMETER"), "GEOGCRS": ("ID",), "LOCAL_CS": ("UNIT",),
              "COMPD_CS": ("PROJCS", "VERT_CS"), "COMPOUNDCRS": ("PROJCRS", "VERTCRS"), "VERT_CS": ("UNIT", "AXIS", "AUTHORITY"),
              "VERTCRS": ("CS", "AXIS", "LENGTHUNIT"), "ENGCRS": ("CS", "LENGTHUNIT"), "AXIS": ("LENGTHUNIT", "UNIT")}


def names(rng):
    chosen = ["x", "y", "z", *rng.sample(COLUMNS, rng.randrange(4))]
    if rng.random() < 0.2:
        rng.shuffle(chosen)
    return rarely(rng, [name or "_" for name in chosen], (chosen[1:], chosen + ["x"]), 0.05)


def rows_of(rng, columns, points):
    """Of (name, letter, count), the numbers of each point."""
    return [[drawn_number(rng, letter, name, 0) for name, letter, count in columns for _ in range(count)] for _ in range(points)]


def text_of(rows):
    return "".join(" ".join(map(repr, row)) + "\n" for row in rows).encode()


def binary_of(rows, columns, order="<"):
    letters = order + "".join(letter * count for _, letter, count in columns)
    return b"".join(struct.pack(letters, *row) for row in rows)


def by_columns(rows, columns):
    return b"".join(struct.pack(f"<{len(rows) * count}{letter}", *[value for row in rows for value in row[at:at + count]])
                    for (_, letter, count), at in zip(columns, [sum(c for *_, c in columns[:i]) for i in range(len(columns))]))


def pcd(rng):
    usual = rng.choice((("F", 4), ("F", 4), ("F", 8), ("I", 4)))
    chosen = names(rng)
    kinds = [usual if name in "xyz" else rng.choice(list(PCD_TYPES)) for name in chosen]
    columns = [(name, PCD_TYPES[kind], rarely(rng, 1, (2, 3), 0.05)) for name, kind in zip(chosen, kinds)]
    points = rng.choice((1, 2, 5, 20))
    rows, data = rows_of(rng, columns, points), rng.choice(("ascii", "binary", "binary_compressed"))
    body = text_of(rows) if data == "ascii" else binary_of(rows, columns)
    if data == "binary_compressed":
        planes = by_columns(rows, columns)
        packed = seeds.lzf_literals(planes)
        body = struct.pack("<II", rarely(rng, len(packed), (0, 2**31)), rarely(rng, len(planes), (0, 5, 2**31))) + packed
    height = rng.choice((1, 1, 1, points))
    turned = rarely(rng, "0 0 0 1 0 0 0", ("1 2 3 0.6 0 0 0.8", "0 0 0 0 0 0 0", "0 0 0 2 0 0 0", "1 2", "nan 0 0 1 0 0 0"), 0.2)
    lines = [("VERSION", rarely(rng, "0.7", (".7", "0.5", "1"))), ("FIELDS", " ".join(name for name, *_ in columns)),
             ("SIZE", " ".join(str(size) for _, size in kinds)), ("TYPE", " ".join(letter for letter, _ in kinds)),
             ("COUNT", " ".join(str(count) for *_, count in columns)), ("WIDTH", points // height), ("HEIGHT", height),
             ("VIEWPOINT", turned), ("POINTS", rarely(rng, points, (0, points + 1, 2**31, 2**63)))]
    if rng.random() < 0.1:
        lines.pop(rng.randrange(len(lines)))
    end = rarely(rng, "\n", ("\r\n",), 0.1)
    return "".join(f"{word} {value}{end}" for word, value in [*lines, ("DATA", data)]).encode() + body


def ply(rng):
    usual = rng.choice(("float", "float32", "double", "float64", "int"))
    columns = [(name, usual if name in "xyz" else rng.choice(list(PLY_TYPES))) for name in names(rng)]
    letters = [(name, PLY_TYPES[kind], 1) for name, kind in columns]
    points = rng.choice((1, 2, 5, 20))
    rows, form = rows_of(rng, letters, points), rng.choice(("ascii", "binary_little_endian", "binary_big_endian"))
    order = ">" if form.endswith("big_endian") else "<"
    body = text_of(rows) if form == "ascii" else binary_of(rows, letters, order)
    vertices = [f"element vertex {rarely(rng, points, (0, points + 1, 2**32))}",
                *[f"property {kind} {name}" for name, kind in columns]]
    faces, face = [], b""
    if rng.random() < 0.3:
        count = rng.choice(("uchar", "int", "uint8", "float"))
        faces = ["element face 1", f"property list {count} int vertex_indices"]
        face = b"2 0 1\n" if form == "ascii" else struct.pack(f"{order}{PLY_TYPES[count]}2i", 2, 0, 1)
    first = rng.random() < 0.5
    lines = ["ply", f"format {form} 1.0", "comment x", *(faces + vertices if first else vertices + faces), "end_header"]
    if rng.random() < 0.05:
        lines.pop(rng.randrange(len(lines)))
    return "\n".join(lines).encode() + b"\n" + (face + body if first else body + face)


def drawn_code(rng):
    """Of a projected system: zones of UTM under their four hundreds and the numbers about them, others, none."""
    return rarely(rng, 100 * rng.choice((326, 327, 258, 269)) + rng.randrange(100), (2154, 4326, 0, 32767, 65535), 0.1)


def drawn_wkt(rng, word="PROJCS"):
    """A node and those within it; what can stand there mostly does."""
    values = [f'"{rng.choice(WKT_NAMES)}"']
    if word in ("AUTHORITY", "ID"):
        code = drawn_code(rng)
        values = [rarely(rng, '"EPSG"', ('"ESRI"', '""')), str(code) if word == "ID" else f'"{code}"']
    elif word == "PARAMETER":
        values = [rng.choice(('"false_easting"', '"False easting"', '"scale"')), rng.choice(("500000", "32500000", "0", "x"))]
    elif word in ("UNIT", "LENGTHUNIT"):
        values = ['"metre"', rarely(rng, "1", ("0.3048", "0", "-1", "nan", "x", "1e300"), 0.3)]
    inner = WKT_WITHIN.get(word, ())
    for each in rng.sample(inner, rng.randint(0, len(inner))):
        values.append(drawn_wkt(rng, rarely(rng, each, tuple(WKT_WITHIN), 0.05)))
    begin, end = rarely(rng, "[]", ("()", "[ ", "[)"), 0.1)
    written, comma = rarely(rng, word, (word.lower(), word.title(), "X"), 0.05), rarely(rng, ",", (", ", ";"), 0.1)
    return written + begin + comma.join(values) + end


def las(rng):
    minor = rng.choice((2, 3, 4))
    kind = rng.choice((0, 1, 2, 3, 4, 5) if minor < 4 else range(0, 11))
    sizes = (20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67)
    keys = [1, 1, 0, 0]
    for key, value in rng.sample([(1024, 1), (1024, 2), (1024, 3), (3072, drawn_code(rng)), (3072, drawn_code(rng)), (3076, 9001),
                                  (3076, 9003), (4099, rng.choice((9001, 9002, 9003, 9036, 0))), (4096, 5703), (2048, 4326)],
                                 rng.randrange(4)):
        keys += [key, rarely(rng, 0, (34737,)), 1, value]
        keys[3] += 1
    keys[3] = rarely(rng, keys[3], (0, keys[3] + 1, 65535))
    words = drawn_wkt(rng, rng.choice(("PROJCS", "PROJCRS", "COMPD_CS", "COMPOUNDCRS", "LOCAL_CS", "ENGCRS", "GEOGCS")))
    words = rarely(rng, words, (words[:rng.randrange(len(words))], words + words, "", "[" * 40, "\0" + words), 0.1)
    records = [(34735, struct.pack(f"<{len(keys)}H", *keys))] * rng.randrange(2)
    records += [(2112, words.encode() + b"\0")] * rng.randrange(2)
    cloud = bytearray(seeds.las(minor, kind, sizes[kind] + rng.choice((0, 0, 3)), records, rng.choice((0, 16))))
    scales = [rarely(rng, 10 ** rng.uniform(-4, 0), (0, -1, float("nan"), 1e300)) for _ in range(3)]
    offsets = [rarely(rng, rng.gauss(0, 1e5), (448000, 5427000, 1e300)) for _ in range(3)]
    struct.pack_into("<6d", cloud, 131, *scales, *offsets)
    if rng.random() < 0.3:
        at = rng.randrange(4, min(len(cloud), 375))
        cloud[at] = rng.randrange(256)
    for at in range(len(cloud) - rng.randrange(100), len(cloud)):
        cloud[at] = rng.randrange(256)
    return bytes(cloud)


def drawn(*makers):
    def draws():
        rng = random.Random(1)
        for _ in range(DRAWS):
            yield rng.choice(makers)(rng)
    return draws


def scan_bodies():
    rng = random.Random(1)
    for _ in range(DRAWS):
        kind = rng.randrange(4)
        columns = (4, 3, 0, 5)[kind]
        numbers = [drawn_number(rng, "f", "x", 0) for _ in range(columns * rng.choice((1, 2, 5, 50)))]
        yield bytes([kind]) + (struct.pack(f"<{len(numbers)}f", *numbers) if columns else pcd(rng))


DRAWN = {"pcd": drawn(pcd), "ply": drawn(ply), "cloud": drawn(pcd, ply), "las": drawn(las), "scan_body": scan_bodies}
