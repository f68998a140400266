"""Reads and writes safetensors files with numpy alone (Debian 12 packages no library for them).

The format: 8 bytes, little-endian, the length of a JSON header; the header, {name: {dtype, shape, data_offsets}}
and "__metadata__" with texts; then the tensors' bytes, one behind the other. See
https://github.com/huggingface/safetensors, "Format". The C++ reader of the same files is
mapping/src/detection/voxelnext/safetensors.cpp; both refuse what the other refuses.
"""

import json
import os
import pathlib
import struct

import numpy as np

DTYPES = {"F32": np.dtype("<f4"), "F16": np.dtype("<f2")}
MAX_HEADER_BYTES = 1 << 20


class SafetensorsError(ValueError):
    """Names the file, what was found and what was expected."""


def save(path, tensors, metadata):
    """Writes a file whole or not at all; equal input gives equal bytes.

    @param tensors {name: float32 or float16 array}.
    @param metadata {name: text}.
    """
    path = pathlib.Path(path)
    partial = path.with_name(path.name + ".partial")
    with open(partial, "wb") as stream:
        stream.write(to_bytes(tensors, metadata))
        stream.flush()
        os.fsync(stream.fileno())
    os.replace(partial, path)


def to_bytes(tensors, metadata):
    header = {"__metadata__": dict(sorted(metadata.items()))}
    parts = []
    begin = 0
    for name, array in sorted(tensors.items()):
        dtype = {"f4": "F32", "f2": "F16"}.get(np.asarray(array).dtype.str[1:])
        if dtype is None:
            raise SafetensorsError(f"tensor {name}: found {np.asarray(array).dtype}, expected float32 or float16")
        data = np.ascontiguousarray(array, DTYPES[dtype]).tobytes()
        header[name] = {"dtype": dtype, "shape": list(np.shape(array)), "data_offsets": [begin, begin + len(data)]}
        parts.append(data)
        begin += len(data)
    text = json.dumps(header, separators=(",", ":"), ensure_ascii=False).encode()
    text += b" " * (-len(text) % 8)  # the tensors begin at a multiple of 8, as other writers have it
    if len(text) > MAX_HEADER_BYTES:
        raise SafetensorsError(f"found a header of {len(text)} bytes, expected at most {MAX_HEADER_BYTES}")
    return struct.pack("<Q", len(text)) + text + b"".join(parts)


def load(path):
    """@return (tensors {name: array of its own dtype}, metadata {name: text})."""
    return from_bytes(pathlib.Path(path).read_bytes(), str(path))


def from_bytes(data, name):
    header, body = _split(data, name)
    metadata = header.pop("__metadata__", {})
    if not isinstance(metadata, dict) or not all(isinstance(text, str) for text in metadata.values()):
        raise SafetensorsError(f"{name} at __metadata__: expected an object of texts")
    tensors = {}
    ranges = []
    for tensor, entry in header.items():
        dtype, shape, begin, end = _entry(entry, len(body), f"{name} at tensor {tensor!r:.70}")
        tensors[tensor] = np.frombuffer(body[begin:end], DTYPES[dtype]).reshape(shape).copy()
        ranges.append((begin, end))
    covered = 0
    for begin, end in sorted(ranges):
        if begin != covered:
            raise SafetensorsError(f"{name}: found a tensor that begins at byte {begin}, expected {covered}")
        covered = end
    if covered != len(body):
        raise SafetensorsError(f"{name}: found {len(body)} bytes after the header, expected {covered}")
    return tensors, metadata


def _split(data, name):
    if len(data) < 8:
        raise SafetensorsError(f"{name}: found {len(data)} bytes, expected at least 8")
    (length,) = struct.unpack("<Q", data[:8])
    if length > min(MAX_HEADER_BYTES, len(data) - 8):
        raise SafetensorsError(f"{name}: found a header of {length} bytes in a file of {len(data)}, expected "
                               f"at most {MAX_HEADER_BYTES} and all of them there")
    try:
        header = json.loads(data[8 : 8 + length].decode(), object_pairs_hook=_no_key_twice)
    except (ValueError, RecursionError) as error:
        raise SafetensorsError(f"{name} in its header: found no JSON ({error})") from error
    if not isinstance(header, dict):
        raise SafetensorsError(f"{name}: found {type(header).__name__}, expected an object as header")
    return header, memoryview(data)[8 + length :]


def _no_key_twice(pairs):
    members = dict(pairs)
    if len(members) != len(pairs):
        raise ValueError("a key twice")
    return members


def _whole(values):
    return isinstance(values, list) and all(type(value) is int and value >= 0 for value in values)


def _entry(entry, size, at):
    if not isinstance(entry, dict) or set(entry) != {"dtype", "shape", "data_offsets"}:
        raise SafetensorsError(f"{at}: expected an object with dtype, shape and data_offsets")
    dtype, shape, offsets = entry["dtype"], entry["shape"], entry["data_offsets"]
    if not isinstance(dtype, str) or dtype not in DTYPES:
        raise SafetensorsError(f"{at}: found dtype {dtype!r}, expected F32 or F16")
    if not _whole(shape) or len(shape) > 8:
        raise SafetensorsError(f"{at}: found shape {shape!r:.70}, expected at most 8 whole numbers")
    if not _whole(offsets) or len(offsets) != 2 or not offsets[0] <= offsets[1] <= size:
        raise SafetensorsError(f"{at}: found data_offsets {offsets!r:.70}, expected a range within {size} bytes")
    needed = DTYPES[dtype].itemsize
    for count in shape:
        needed *= count
    if needed != offsets[1] - offsets[0]:
        raise SafetensorsError(f"{at}: found {offsets[1] - offsets[0]} bytes, expected {needed} by shape and dtype")
    return dtype, shape, offsets[0], offsets[1]
