"""Scans as the server reads them: float32, little endian, x y z i, x y z, or x y z i t."""

from __future__ import annotations

import array
import json
import sys
import uuid
from typing import Any, Dict, Mapping, Optional, Protocol, Sequence, Tuple, Union

from .thinning import CONTENT_TYPE, Thinning


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


class Part:
    """A part of a multipart body."""

    def __init__(self, name: str, kind: str, data: bytes) -> None:
        self.name, self.kind, self.data = name, kind, data


def scan_part(name: str, scan: Scan, layout: Optional[str], thinning: Optional[Thinning]) -> Tuple[Part, Dict[str, str]]:
    """A scan as a part, and what its parameters must say of it. @param thinning  None: whole."""
    if isinstance(scan, Pcd):
        return Part(name, "application/vnd.pcd", bytes(scan)), {}
    data, found = encoded(scan, layout)
    thin = thinning.body(data, len(found)) if thinning else None
    if thin is not None:
        return Part(name, CONTENT_TYPE, thin), {}
    return Part(name, "application/octet-stream", data), {"layout": found}


def multipart(request: Mapping[str, Any], scans: Sequence[Part]) -> Tuple[bytes, Dict[str, str]]:
    """Body and headers of parameters as JSON and of scans beside them."""
    boundary = uuid.uuid4().hex
    pieces = []
    for part in (Part("request", "application/json", json.dumps(request).encode()), *scans):
        pieces.append(f'--{boundary}\r\nContent-Disposition: form-data; name="{part.name}"\r\n'
                      f"Content-Type: {part.kind}\r\n\r\n".encode())
        pieces += [part.data, b"\r\n"]
    pieces.append(f"--{boundary}--\r\n".encode())
    return b"".join(pieces), {"Content-Type": f"multipart/form-data; boundary={boundary}"}


def scan_request(scan: Scan, layout: Optional[str], thinning: Optional[Thinning], flat: Mapping[str, str],
                 keys: Mapping[str, Any]) -> Tuple[Dict[str, str], bytes, Dict[str, str]]:
    """Query, body and headers of a scan: flat while it can be, since the server then knows all before the body.

    flat    parameters for the query
    keys    the same and more as JSON, when the query cannot hold them; empty when it can
    """
    part, of_scan = scan_part("scan", scan, layout, thinning)
    if not keys:
        return {**of_scan, **flat}, part.data, {"Content-Type": part.kind}
    body, headers = multipart({**keys, **of_scan}, [part])
    return {}, body, headers
