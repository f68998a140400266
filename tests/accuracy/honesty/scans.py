"""Drives whose scans are changed: the files of a drive, with some scans rewritten and all else linked.

Reads `.bin` files of x y z intensity (float32) and binary `.pcd` files, keeps all their fields.
"""

import os
import pathlib
import shutil

import numpy as np

KITTI = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4")])
PCD_TYPES = {"F": "f", "U": "u", "I": "i"}


def read(file):
    """Header (empty for .bin) and records with fields x, y, z [m, lidar frame]."""
    raw = pathlib.Path(file).read_bytes()
    if file.suffix == ".bin":
        return b"", np.frombuffer(raw, KITTI).copy()
    end = raw.index(b"DATA binary\n") + len(b"DATA binary\n")
    rows = dict(line.split(maxsplit=1) for line in raw[:end].decode().splitlines() if line and line[0] != "#")
    names, sizes, types = (rows[key].split() for key in ("FIELDS", "SIZE", "TYPE"))
    counts = rows.get("COUNT", " ".join("1" for _ in names)).split()
    fields = [(name if name != "_" else f"_{i}", f"<{PCD_TYPES[kind]}{size}", int(count))
              for i, (name, size, kind, count) in enumerate(zip(names, sizes, types, counts))]
    return raw[:end], np.frombuffer(raw, np.dtype([each if each[2] > 1 else each[:2] for each in fields]),
                                    count=int(rows["POINTS"]), offset=end).copy()


def write(file, header, records):
    if header:
        lines = header.decode().splitlines()
        size = {"WIDTH": f"WIDTH {len(records)}", "HEIGHT": "HEIGHT 1", "POINTS": f"POINTS {len(records)}"}
        header = "".join(size.get(line.split(" ")[0], line) + "\n" for line in lines).encode()
    file.write_bytes(header + records.tobytes())


def positions(records):
    return np.c_[records["x"], records["y"], records["z"]].astype(float)


def with_positions(records, points):
    changed = records.copy()
    for axis, name in enumerate("xyz"):
        changed[name] = points[:, axis]
    return changed


def scan_files(folder):
    """In their order; labels and maps of a drive are no scans."""
    found = [path for path in pathlib.Path(folder).rglob("*") if path.suffix in (".bin", ".pcd") and path.is_file()]
    if not found:
        raise ValueError(f"{folder}: no .bin or .pcd scans")
    return sorted(found)


def derive(folder, target, change, chosen):
    """A copy of the drive in which the scans of the indices `chosen` are `change(records, index)`."""
    folder, target = pathlib.Path(folder), pathlib.Path(target)
    shutil.rmtree(target, ignore_errors=True)
    number = {file: i for i, file in enumerate(scan_files(folder))}
    target.mkdir(parents=True)
    for path in folder.parent.glob("calib_*.txt"):  # KITTI raw
        shutil.copy(path, target.parent / path.name)
    for path in sorted(folder.rglob("*")):
        copy = target / path.relative_to(folder)
        copy.parent.mkdir(parents=True, exist_ok=True)
        if path.is_dir():
            copy.mkdir(exist_ok=True)
        elif number.get(path) in chosen:
            header, records = read(path)
            write(copy, header, change(records, number[path]))
        else:
            os.symlink(path.resolve(), copy)
    return target
