"""HTTP to one server: kept connections, retries, problems as exceptions."""

from __future__ import annotations

import http.client
import io
import json
import math
import random
import socket
import ssl
import threading
import time
import urllib.parse
from contextlib import contextmanager, suppress
from typing import Any, BinaryIO, Callable, Dict, Iterator, Mapping, Optional, Sequence, Tuple, TypeVar, Union

from .errors import ConnectionLost, Problem

#: Bytes, or something that opens a stream of the given length anew for each try.
Body = Union[None, bytes, Tuple[int, Callable[[], BinaryIO]]]
_Read = TypeVar("_Read")

#: What Advanced has over Basic-Quaternion is the time.
GEOPOSE = "application/geopose+json; version=1.0; profile=advanced"

#: The server ends connections that idled for 2 s: older ones are not used again.
_KEPT_S = 1.0
#: Longest wait between two tries.
_MAX_WAIT_S = 30.0
_BLOCK = 1 << 16
#: Of answers about a map's active version; the newest goes with what is asked next, so that no server that is behind
#: another answers with an older one.
REVISION = "Stillmap-Revision"
#: About where a vehicle is: a proxy sends poses of one region to one server.
REGION = "Stillmap-Region"
_REGION_M = 500.0
#: Refusals that the same request would meet again.
_FINAL = frozenset({"Superseded", "MapUnusable"})


class Response:
    """Status, headers (lower case) and the body, which may be read in pieces."""

    def __init__(self, raw: http.client.HTTPResponse) -> None:
        self.status = raw.status
        self.headers = {name.lower(): value for name, value in raw.getheaders()}
        self.raw = raw
        self._data: Optional[bytes] = None

    def read(self) -> bytes:
        """All of the body; again the same."""
        if self._data is None:
            self._data = self.raw.read()
        return self._data

    def json(self, read: Callable[[Any], _Read]) -> _Read:
        """What `read` makes of it. @raises Problem for what is no JSON, or is not what `read` looks for: a proxy or
        another program has answered."""
        try:
            found = json.loads(self.read())
        except ValueError as error:
            raise Problem(self.status, {"detail": self._found("application/json")}) from error
        try:
            return read(found)
        except (LookupError, TypeError, ValueError, AttributeError) as error:
            detail = f"found another answer than expected: {type(error).__name__}: {error}"
            raise Problem(self.status, {"detail": detail}) from error

    def _found(self, expected: str) -> str:
        leads = f" that leads to {self.headers['location']}" if "location" in self.headers else ""
        return f"found {self.headers.get('content-type', 'no content type')}{leads}, expected {expected}"

    def problem(self) -> Problem:
        body: Any = None
        with suppress(ValueError):
            body = json.loads(self.read())
        if not isinstance(body, dict):
            body = {"detail": self._found("application/problem+json")}
        after = self.headers.get("retry-after", "")
        problem = Problem(self.status, body, float(after) if after.isdecimal() else None)
        problem.seal = self.headers.get("stillmap-seal")
        return problem


def region_of(position: Sequence[float]) -> Dict[str, str]:
    """The header for a place in the map frame."""
    if not all(abs(value) < 1e9 for value in position):
        return {}
    return {REGION: ",".join(str(math.floor(value / _REGION_M)) for value in position[:2])}


class Revisions:
    """The newest of each map that was seen. Safe from several threads."""

    def __init__(self) -> None:
        self._newest: Dict[str, int] = {}
        self._lock = threading.Lock()

    def header(self, map: str) -> Dict[str, str]:
        with self._lock:
            return {REVISION: str(self._newest[map])} if map in self._newest else {}

    def note(self, map: str, response: Response) -> None:
        found = response.headers.get(REVISION.lower(), "")
        if found.isdecimal():
            with self._lock:
                self._newest[map] = max(int(found), self._newest.get(map, 0))


class Transport:
    """Safe from several threads: each keeps a connection of its own.

    A refusal (429, 503) comes before anything was done, so it is tried again whatever the method, after what
    `Retry-After` says; a lost connection only when the request is idempotent, or was never sent.
    """

    def __init__(self, url: str, key: Optional[str], timeout_s: float, retries: int,
                 context: Optional[ssl.SSLContext]) -> None:
        parts = urllib.parse.urlsplit(url)
        if parts.scheme not in ("http", "https") or not parts.hostname:
            raise ValueError(f"url: found '{url}', expected http://HOST[:PORT] or https://...")
        if key is not None and not key.isascii():
            raise ValueError("key: found other characters, expected ASCII")
        self._host, self._port, self._prefix = parts.hostname, parts.port, parts.path.rstrip("/")
        self._tls = (context or ssl.create_default_context()) if parts.scheme == "https" else None
        self._key, self._timeout_s, self.retries = key, timeout_s, retries
        self._local = threading.local()
        self.revisions = Revisions()

    def call(self, method: str, path: str, *, query: Optional[Mapping[str, str]] = None, body: Body = None,
             headers: Optional[Mapping[str, str]] = None, idempotent: bool = True,
             retries: Optional[int] = None, timeout_s: Optional[float] = None,
             active_of: Optional[str] = None) -> Response:
        """The whole answer, of a status 2xx: nobody follows redirections here.
        @param active_of  the map whose active version is asked. @raises Problem, ConnectionLost."""
        if active_of is not None:
            headers = {**(headers or {}), **self.revisions.header(active_of)}
        with self.open(method, path, query=query, body=body, headers=headers, idempotent=idempotent,
                       retries=retries, timeout_s=timeout_s, whole=True) as response:
            if active_of is not None:
                self.revisions.note(active_of, response)
            return response

    def patience_s(self, deadline_ms: Optional[int]) -> Optional[float]:
        """Silence to bear until a deadline of the server's, where that is longer than the usual."""
        wanted = 0.0 if deadline_ms is None else 1e-3 * deadline_ms + 5.0
        return wanted if wanted > self._timeout_s else None

    @contextmanager
    def open(self, method: str, path: str, *, query: Optional[Mapping[str, str]] = None, body: Body = None,
             headers: Optional[Mapping[str, str]] = None, idempotent: bool = True, retries: Optional[int] = None,
             timeout_s: Optional[float] = None, whole: bool = False) -> Iterator[Response]:
        """An answer that is read piece by piece, unless it is wanted `whole`: then its body is part of each try.
        With a `timeout_s` (of waiting for the answer, not of connecting and sending) it has a connection of its own, so
        that other requests of the thread may run meanwhile."""
        target = self._prefix + urllib.parse.quote(path, safe="/")
        if query:
            target += "?" + urllib.parse.urlencode(query, safe=",")
        left = self.retries if retries is None else retries
        waited = 0
        while True:
            connection = self._connection() if timeout_s is None else self._new()
            connected, sent = connection.sock is not None, False
            try:
                if not connected:
                    connection.connect()
                    connected = True
                if timeout_s is not None:
                    _probe(connection.sock)
                self._send(connection, method, target, body, headers or {})
                sent = True
                if timeout_s is not None:
                    connection.sock.settimeout(timeout_s)
                response = Response(connection.getresponse())
                if 200 <= response.status < 300:
                    if whole:
                        response.read()
                    break
                problem = response.problem()
                self._keep(connection, response)
            except (OSError, http.client.HTTPException) as error:
                self._forget(connection)
                lost = ConnectionLost(f"{method} {path}: {error or type(error).__name__}")
                # Whoever was given so long may still be at it, and another would wait beside it.
                lost.silent = sent and timeout_s is not None and _is_timeout(error)
                if left <= 0 or lost.silent or connected and not idempotent:
                    raise lost from error
                problem = None
            if problem is not None and (left <= 0 or not is_passing(problem)):
                raise problem
            left -= 1
            waited += 1
            time.sleep(wait_s(waited, problem))
        try:
            yield response
        finally:
            self._keep(connection, response)

    def drop(self) -> None:
        """Ends the calling thread's connection."""
        kept = getattr(self._local, "connection", None)
        if kept is not None:
            self._forget(kept)

    def _forget(self, connection: http.client.HTTPConnection) -> None:
        if getattr(self._local, "connection", None) is connection:
            self._local.connection = None
        connection.close()

    def _keep(self, connection: http.client.HTTPConnection, response: Response) -> None:
        """For the next request, if the answer was read to its end and the server allows it."""
        ours = getattr(self._local, "connection", None) is connection
        if not ours or response.raw.will_close or not response.raw.isclosed():
            self._forget(connection)
        if ours:
            self._local.used = time.monotonic()

    def _new(self) -> http.client.HTTPConnection:
        if self._tls is None:
            return http.client.HTTPConnection(self._host, self._port, timeout=self._timeout_s)
        return http.client.HTTPSConnection(self._host, self._port, timeout=self._timeout_s, context=self._tls)

    def _connection(self) -> http.client.HTTPConnection:
        kept: Optional[http.client.HTTPConnection] = getattr(self._local, "connection", None)
        if kept is not None and time.monotonic() - self._local.used < _KEPT_S:
            return kept
        self.drop()
        self._local.connection = connection = self._new()
        return connection

    def _send(self, connection: http.client.HTTPConnection, method: str, target: str, body: Body,
              headers: Mapping[str, str]) -> None:
        sent: Dict[str, str] = dict(headers)
        if self._key is not None:
            sent["Authorization"] = f"Bearer {self._key}"
        size, opened = _opener(body)
        if body is not None or method in ("POST", "PUT"):
            sent["Content-Length"] = str(size)
        connection.putrequest(method, target, skip_accept_encoding=True)
        for name, value in sent.items():
            connection.putheader(name, value)
        try:
            connection.endheaders()
            with opened() as stream:
                while block := stream.read(_BLOCK):
                    connection.send(block)
        except (BrokenPipeError, ConnectionResetError):
            # Refused before all of the body was sent: the answer is there, if anything is.
            pass


def _is_timeout(error: Exception) -> bool:
    """Nothing came; with an errno it is the probes that found nobody. 3.9 knows no TimeoutError here."""
    return isinstance(error, socket.timeout) and error.errno is None


def _probe(connection: socket.socket) -> None:
    """Probes tell a silent server from one that is gone, and keep the connection in the tables of what is between."""
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    for name, value in (("TCP_KEEPIDLE", 60), ("TCP_KEEPINTVL", 15), ("TCP_KEEPCNT", 4)):
        if hasattr(socket, name):
            connection.setsockopt(socket.IPPROTO_TCP, getattr(socket, name), value)


def as_object(json: Any) -> Dict[str, Any]:
    """To be read by the caller. @raises TypeError."""
    if not isinstance(json, dict):
        raise TypeError(f"{type(json).__name__}, expected an object")
    return json


def _opener(body: Body) -> Tuple[int, Callable[[], BinaryIO]]:
    if isinstance(body, tuple):
        return body
    data = body or b""
    return len(data), lambda: io.BytesIO(data)


def is_passing(problem: Problem) -> bool:
    """Whether the same request may be answered later."""
    return problem.status in (429, 503) and problem.code not in _FINAL


def wait_s(tries: int, problem: Optional[Problem]) -> float:
    """What the server asks for, else doubling from 0.1 s; both with chance, so that clients do not come at once."""
    asked = problem.retry_after_s if problem is not None else None
    base = asked if asked is not None else 0.1 * 2.0 ** min(tries - 1, 10)
    return min(_MAX_WAIT_S, base * random.uniform(1.0, 1.25))
