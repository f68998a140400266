"""Scans as the server reads them: float32, little endian, x y z i, x y z, or x y z i t."""

from __future__ import annotations

import array
import json
import sys
import uuid
from typing import Any, Dict, Mapping, Optional, Protocol, Sequence, Tuple, Union


class SupportsBuffer(Protocol):
    """Such as a numpy array (Python 3.9 has no name for the buffer protocol itself)."""

    def __array__(self, *arguments: Any, **named: Any) -> Any: ...


#: Raw bytes, anything with a contiguous float32 buffer (array.array("f"), a numpy array), or points as sequences.
Scan = Union[bytes, bytearray, memoryview, "array.array[float]", Sequence[Sequence[float]], SupportsBuffer]


class Pcd(bytes):
    """The bytes of a PCD file, to be sent as they are."""


def encoded(scan: Scan, layout: Optional[str] = None) -> Tuple[bytes, str]:
    """Bytes and layout ("xyz", "xyzi" or "xyzit") of a scan. @raises ValueError for what is none."""
    if isinstance(scan, (bytes, bytearray)):
        return _checked(bytes(scan), layout or "xyzi")
    if isinstance(scan, (list, tuple)):
        return _of_points(scan, layout)
    try:
        buffer: Any = scan
        view = memoryview(buffer)
    except TypeError:
        return _of_points(list(buffer), layout)
    if view.format in ("B", "b", "c"):
        return _checked(bytes(view), layout or "xyzi")
    if view.format not in ("f", "<f") or not view.c_contiguous:
        raise ValueError(f"scan: found a buffer of '{view.format}', expected contiguous float32")
    shaped = {3: "xyz", 4: "xyzi", 5: "xyzit"}.get(view.shape[-1]) if view.shape and view.ndim == 2 else None
    floats = array.array("f")
    floats.frombytes(bytes(view.cast("B")))
    return _checked(_little(floats), layout or shaped or "xyzi")


def _of_points(points: Sequence[Sequence[float]], layout: Optional[str]) -> Tuple[bytes, str]:
    width = len(points[0]) if points else 0
    found = {3: "xyz", 4: "xyzi", 5: "xyzit"}.get(width)
    if found is None or any(len(point) != width for point in points) or (layout or found) != found:
        raise ValueError("scan: found points of other lengths, expected x y z, x y z i or x y z i t each")
    return _little(array.array("f", [float(x) for point in points for x in point])), found


def _little(floats: "array.array[float]") -> bytes:
    if sys.byteorder != "little":
        floats.byteswap()
    return floats.tobytes()


def _checked(data: bytes, layout: str) -> Tuple[bytes, str]:
    width = {"xyz": 12, "xyzi": 16, "xyzit": 20}.get(layout)
    if width is None:
        raise ValueError(f"layout: found '{layout}', expected xyz, xyzi or xyzit")
    if len(data) % width:
        raise ValueError(f"scan: found {len(data)} bytes, expected a multiple of {width} for {layout}")
    return data, layout


def scan_request(scan: Scan, layout: Optional[str], flat: Mapping[str, str],
                 keys: Mapping[str, Any]) -> Tuple[Dict[str, str], bytes, Dict[str, str]]:
    """Query, body and headers of a scan: flat while it can be, since the server then knows all before the body."""
    kind = "application/octet-stream"
    query: Dict[str, str] = {}
    if isinstance(scan, Pcd):
        data, kind = bytes(scan), "application/vnd.pcd"
    else:
        data, found = encoded(scan, layout)
        query["layout"] = found
    if not keys:
        return {**query, **flat}, data, {"Content-Type": kind}
    boundary = uuid.uuid4().hex
    request = json.dumps({**keys, **query}).encode()
    body = b"".join([
        f'--{boundary}\r\nContent-Disposition: form-data; name="request"\r\n'
        "Content-Type: application/json\r\n\r\n".encode(), request,
        f'\r\n--{boundary}\r\nContent-Disposition: form-data; name="scan"\r\nContent-Type: {kind}\r\n\r\n'.encode(),
        data, f"\r\n--{boundary}--\r\n".encode()])
    return {}, body, {"Content-Type": f"multipart/form-data; boundary={boundary}"}
