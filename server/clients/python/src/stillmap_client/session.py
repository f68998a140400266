"""Following one vehicle: each scan in turn, or the newest one while the vehicle is faster than the server."""

from __future__ import annotations

import json
import logging
import threading
from typing import TYPE_CHECKING, Any, Callable, Dict, Iterator, Mapping, Optional, Sequence, Tuple, Union

from . import events
from .errors import ConnectionLost, Problem, StillmapError
from .scan import Pcd, Scan, encoded, scan_request
from .sealed import SealedSession
from .thinning import Thinning
from .transport import GEOPOSE, Response, Transport, wait_s
from .types import Event, GeoPose, Gnss, LastPlace, MapReference, MovableBox, Odometry, Pose, PoseAnswer, Prior, SessionInfo

if TYPE_CHECKING:
    from .client import Client

#: Bytes as they are sent, their layout, stamp_ns, odometry, boxes.
_Item = Tuple[bytes, Optional[str], int, Optional[Odometry], Sequence[MovableBox]]


class Session:
    """One vehicle in one version of a map, or in the maps of a set, where `map` is the first one; made by
    `Client.open_session`. Ends with `close`, or when it is not used for `idle_limit_s`. As a context manager it
    closes itself."""

    def __init__(self, transport: Transport, thinning: Thinning, json: Mapping[str, Any]) -> None:
        self._transport, self._thinning = transport, thinning
        self.id = str(json["id"])
        self.map = MapReference(json["map"]["name"], json["map"]["version"], json["map"]["digest"])
        self.idle_limit_s = float(json["idle_limit_s"])
        self._path = f"/v1/sessions/{self.id}"

    def __enter__(self) -> "Session":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def track(self, scan: Scan, stamp_ns: int, *, layout: Optional[str] = None, odometry: Optional[Odometry] = None,
              deadline_ms: Optional[int] = None, T_base_lidar: Optional[Pose] = None,
              movable: Sequence[MovableBox] = (), retries: Optional[int] = None) -> PoseAnswer:
        """The next scan. Not sent again after a lost connection: the server may have counted it.
        @raises Problem (`Superseded` when a newer scan, or `initialize`, came meanwhile), ConnectionLost."""
        return self._send(scan, stamp_ns, layout, odometry, deadline_ms, T_base_lidar, movable, retries,
                          None).json(PoseAnswer.of)

    def track_geopose(self, scan: Scan, stamp_ns: int, *, layout: Optional[str] = None,
                      odometry: Optional[Odometry] = None, deadline_ms: Optional[int] = None,
                      T_base_lidar: Optional[Pose] = None, movable: Sequence[MovableBox] = (),
                      retries: Optional[int] = None) -> GeoPose:
        """As `track`, for maps with a place on the Earth.
        @raises Problem `NoPose` when the scan is lost, and `NotAcceptable` when the map has no place."""
        response = self._send(scan, stamp_ns, layout, odometry, deadline_ms, T_base_lidar, movable, retries, GEOPOSE)
        return response.json(lambda json: GeoPose.of(json, response.headers))

    def _send(self, scan: Scan, stamp_ns: int, layout: Optional[str], odometry: Optional[Odometry],
              deadline_ms: Optional[int], T_base_lidar: Optional[Pose], movable: Sequence[MovableBox],
              retries: Optional[int], accept: Optional[str]) -> Response:
        flat: Dict[str, str] = {"stamp_ns": str(stamp_ns)}
        keys: Dict[str, Any] = {}
        if deadline_ms is not None:
            flat["deadline_ms"] = str(deadline_ms)
        if odometry is not None or T_base_lidar is not None or movable:
            keys = dict(flat)
            if odometry is not None:
                keys["odometry"] = odometry.to_json()
            if T_base_lidar is not None:
                keys["T_base_lidar"] = T_base_lidar.to_json()
            if movable:
                keys["movable"] = [box.to_json() for box in movable]

        def send(thinning: Optional[Thinning]) -> Response:
            query, body, headers = scan_request(scan, layout, thinning, flat, keys)
            if accept is not None:
                headers["Accept"] = accept
            return self._transport.call("POST", self._path + "/scans", query=query, body=body, headers=headers,
                                        idempotent=False, retries=retries,
                                        timeout_s=self._transport.patience_s(deadline_ms))

        return self._thinning.or_whole(not movable, send)

    def initialize(self, prior: Optional[Prior] = None, *, gnss: Optional[Gnss] = None,
                   retries: Optional[int] = None) -> None:
        """Forgets where the vehicle was. Without prior and gnss it may be anywhere."""
        wanted: Dict[str, Any] = {}
        if prior is not None:
            wanted["prior"] = prior.to_json()
        if gnss is not None:
            wanted["gnss"] = gnss.to_json()
        self._transport.call("POST", self._path + "/initialize", body=json.dumps(wanted).encode(),
                             headers={"Content-Type": "application/json"}, retries=retries)

    def info(self) -> SessionInfo:
        return self._transport.call("GET", self._path).json(SessionInfo.of)

    def events(self, *, last_id: Optional[int] = None, patience_s: float = 60.0) -> Iterator[Event]:
        """`status`, `version_activated`, `gap`, up to `closed`. Goes on after lost connections."""
        return events.stream(self._transport, self._path + "/events", "closed", last_id, patience_s)

    def close(self) -> None:
        """Also when it has ended already."""
        try:
            self._transport.call("DELETE", self._path)
        except Problem as problem:
            if problem.code != "UnknownSession":
                raise
        except ConnectionLost:
            pass  # it expires


class SessionStream:
    """Feeds a session from a sensor that does not wait: `put` never blocks, one thread sends, and of the scans
    that come while it does only the newest is kept.

    Refusals and lost connections are met by going on with the newest scan after the time that the server asked
    for. A session that is gone (the server was started anew, or it expired) is opened again, and searched for
    everywhere.

    on_answer    told (stamp_ns, PoseAnswer), in the sending thread
    on_error     told (stamp_ns, error) of each scan that got no pose, whatever the reason
    prior, gnss  where the vehicle is at first; at most one of the two
    label        what operators see
    T_base_lidar, layout, deadline_ms  of all scans
    sealed       the session travels with the scans (`Client.sealed_session`), and outlives any server
    others       clients of further servers, of a sealed session
    map, set     as of `Client.open_session`
    What these raise is logged and changes nothing.
    """

    def __init__(self, client: "Client", map: Optional[str], *, on_answer: Callable[[int, PoseAnswer], None],
                 on_error: Optional[Callable[[int, StillmapError], None]] = None, prior: Optional[Prior] = None,
                 gnss: Optional[Gnss] = None, version: Optional[str] = None, label: Optional[str] = None,
                 T_base_lidar: Optional[Pose] = None, deadline_ms: Optional[int] = None,
                 layout: Optional[str] = None, sealed: bool = False, others: "Sequence[Client]" = (),
                 set: Optional[str] = None) -> None:
        self._sealed, self._others, self._set = sealed, others, set
        self._client, self._map, self._prior, self._gnss = client, map, prior, gnss
        self._on_answer, self._on_error = on_answer, on_error
        self._version, self._label, self._T_base_lidar = version, label, T_base_lidar
        self._deadline_ms, self._layout = deadline_ms, layout
        self._changed = threading.Condition()
        self._waiting: Optional[_Item] = None
        self._start: Optional[Prior] = None
        self._busy = False
        self._closed = False
        #: Counters: scans sent and answered, replaced by a newer one before they were sent, failed; sessions.
        self.answered = self.superseded = self.failed = self.sessions = 0
        self._session: Optional[Union[Session, SealedSession]] = None
        self._last = LastPlace()
        self._thread = threading.Thread(target=self._work, name="stillmap-session", daemon=True)
        self._thread.start()

    def __enter__(self) -> "SessionStream":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def put(self, scan: Scan, stamp_ns: int, odometry: Optional[Odometry] = None,
            movable: Sequence[MovableBox] = ()) -> None:
        """Takes the place of a scan that waits. @raises ValueError for what is no scan."""
        # Here, where the caller sees it, and so that the scan may be changed afterwards.
        data, layout = (scan, None) if isinstance(scan, Pcd) else encoded(scan, self._layout)
        with self._changed:
            if self._closed:
                raise RuntimeError("the stream is closed")
            if self._waiting is not None:
                self.superseded += 1
            self._waiting = (data, layout, stamp_ns, odometry, movable)
            self._changed.notify_all()

    def initialize(self, prior: Prior) -> None:
        """Says where the vehicle is: the session begins anew there, before the next scan is sent."""
        with self._changed:
            self._start = prior

    def drain(self, timeout_s: Optional[float] = None) -> bool:
        """Waits until nothing waits or is under way. @return whether that came in time."""
        with self._changed:
            return self._changed.wait_for(lambda: self._waiting is None and not self._busy, timeout_s)

    def close(self) -> None:
        """What waits is dropped, what is under way is waited for; ends the session."""
        with self._changed:
            self._closed = True
            self._waiting = None
            self._changed.notify_all()
        self._thread.join()
        if self._session is not None:
            self._session.close()
            self._session = None

    def _work(self) -> None:
        tries = 0
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._waiting is not None or self._closed)
                if self._closed:
                    return
                assert self._waiting is not None
                item, self._waiting, self._busy = self._waiting, None, True
            error = self._send(*item)
            if error is None or _is_final(error):
                tries = 0
            else:
                tries += 1
                self._wait_and_keep(item, wait_s(tries, error if isinstance(error, Problem) else None))
            with self._changed:
                self._busy = False
                self._changed.notify_all()

    def _send(self, scan: bytes, layout: Optional[str], stamp_ns: int, odometry: Optional[Odometry],
              movable: Sequence[MovableBox]) -> Optional[StillmapError]:
        try:
            self._begin()
            if self._session is None:
                self._session = self._open()
            answer = self._session.track(scan, stamp_ns, odometry=odometry, movable=movable, layout=layout,
                                         T_base_lidar=self._T_base_lidar, deadline_ms=self._deadline_ms, retries=0)
        except Exception as error:  # whatever comes, the thread must be there for the next scan
            if isinstance(error, Problem) and error.code == "UnknownSession":
                self._session, self._prior = None, self._last.prior()
            self.failed += 1
            told = error if isinstance(error, StillmapError) else StillmapError(f"{type(error).__name__}: {error}")
            self._tell(self._on_error, stamp_ns, told)
            return told
        self.answered += 1
        self._last.note(answer)
        if isinstance(self._session, SealedSession):
            self.sessions = self._session.begun
        self._tell(self._on_answer, stamp_ns, answer)
        return None

    def _begin(self) -> None:
        """Where `initialize` said. After a refusal that may pass, the next scan tries again."""
        with self._changed:
            prior, self._start = self._start, None
        if prior is None:
            return
        if self._session is None:
            self._prior, self._gnss = prior, None
            return
        if isinstance(self._session, SealedSession):
            self._session.initialize(prior)
            return
        try:
            self._session.initialize(prior, retries=0)
        except StillmapError as error:
            with self._changed:
                if not _is_final(error) and self._start is None:
                    self._start = prior
            raise

    def _open(self) -> Union[Session, SealedSession]:
        if self._sealed:
            return self._client.sealed_session(self._map, prior=self._prior, gnss=self._gnss, version=self._version,
                                               label=self._label, others=self._others, set=self._set)
        try:
            session = self._client.open_session(self._map, prior=self._prior, gnss=self._gnss, version=self._version,
                                                label=self._label, retries=0, set=self._set)
        except Problem as error:
            if error.status == 422:  # else no scan would ever be sent
                self._prior = None
            raise
        self._prior = self._gnss = None  # where it was at first says nothing of a later session
        self.sessions += 1
        return session

    @staticmethod
    def _tell(whom: Optional[Callable[[int, Any], None]], stamp_ns: int, what: Any) -> None:
        try:
            if whom is not None:
                whom(stamp_ns, what)
        except Exception:
            logging.getLogger("stillmap_client").exception("stamp_ns %d: a callback raised", stamp_ns)

    def _wait_and_keep(self, item: _Item, pause_s: float) -> None:
        """The scan is tried again unless a newer one came meanwhile."""
        with self._changed:
            self._changed.wait_for(lambda: self._closed, pause_s)
            if self._waiting is None and not self._closed:
                self._waiting = item


def _is_final(error: StillmapError) -> bool:
    """Whether the same scan would be refused again."""
    if not isinstance(error, Problem):
        return not isinstance(error, ConnectionLost)
    return error.status not in (429, 503) and error.code != "UnknownSession" or error.code == "Superseded"
