"""Following one vehicle whose session travels with its scans, so that any server of a store goes on with it."""

from __future__ import annotations

import time
from typing import Any, Dict, Mapping, Optional, Sequence, Tuple

from .errors import ConnectionLost, Problem
from .scan import Scan, scan_request
from .thinning import Thinning
from .transport import GEOPOSE, Response, Transport, is_passing, region_of, wait_s
from .types import GeoPose, Gnss, LastPlace, MovableBox, Odometry, Pose, PoseAnswer, Prior

#: Refusals after which a seal is of no more use.
_SPENT = frozenset({"InvalidSeal", "SealExpired", "SealedVersionGone"})

_BAD_PLACE = frozenset({"InvalidPrior", "NoGeodeticOrigin"})


class SealedSession:
    """One vehicle in one version of a map, or in the maps of a set; made by `Client.sealed_session`. No server keeps
    anything of it: each answer brings a seal, which the next scan takes back. A scan whose answer was lost is sent again with the same
    seal, to the next of the servers if there are several. When a seal cannot be used any more (older than 60 s, its
    version removed) the scan is sent again without it, and searched for everywhere; in a set of maps, around the last
    place.

    One thread at a time."""

    def __init__(self, servers: Sequence[Tuple[Transport, Thinning]], place: str, prior: Optional[Prior], gnss: Optional[Gnss],
                 label: Optional[str], seal: Optional[str], in_set: Mapping[str, str],
                 active_of: Optional[str]) -> None:
        self._servers = list(servers)
        self._path, self._in_set = place + "/localize/next", in_set
        self._active_of = active_of
        for transport, _ in self._servers:
            transport.revisions = self._servers[0][0].revisions
        self._prior, self._gnss, self._label = prior, gnss, label
        #: The newest one; None before the session begins. Another process goes on from it.
        self.seal = seal
        #: How often a session began.
        self.begun = 0
        self._region: Dict[str, str] = {} if prior is None else region_of(prior.pose.position)
        self._last = LastPlace()

    def track(self, scan: Scan, stamp_ns: int, *, layout: Optional[str] = None, odometry: Optional[Odometry] = None,
              deadline_ms: Optional[int] = None, T_base_lidar: Optional[Pose] = None,
              movable: Sequence[MovableBox] = (), retries: Optional[int] = None) -> PoseAnswer:
        """The next scan, newer than the one before. @param odometry  since the scan of the newest answer.
        @raises Problem (`ScanNotNewer`), ConnectionLost when no server answers."""
        answer = self._send(scan, stamp_ns, layout, odometry, deadline_ms, T_base_lidar, movable, retries,
                            None).json(PoseAnswer.of)
        place = answer.T_set_lidar or answer.pose
        if place is not None:
            self._region = region_of(place.position)
        self._last.note(answer)
        return answer

    def track_geopose(self, scan: Scan, stamp_ns: int, *, layout: Optional[str] = None,
                      odometry: Optional[Odometry] = None, deadline_ms: Optional[int] = None,
                      T_base_lidar: Optional[Pose] = None, movable: Sequence[MovableBox] = (),
                      retries: Optional[int] = None) -> GeoPose:
        """As `track`, for maps with a place on the Earth.
        @raises Problem `NoPose` when the scan is lost, and `NotAcceptable` when the map has no place."""
        response = self._send(scan, stamp_ns, layout, odometry, deadline_ms, T_base_lidar, movable, retries, GEOPOSE)
        return response.json(lambda json: GeoPose.of(json, response.headers))

    def initialize(self, prior: Optional[Prior] = None, *, gnss: Optional[Gnss] = None) -> None:
        """Forgets where the vehicle was: the next scan begins a session. Without prior and gnss it may be anywhere."""
        self.seal, self._prior, self._gnss = None, prior, gnss
        self._last = LastPlace()
        self._region = {} if prior is None else region_of(prior.pose.position)

    def close(self) -> None:
        """There is nothing to end on a server."""
        self.seal = None

    def _send(self, scan: Scan, stamp_ns: int, layout: Optional[str], odometry: Optional[Odometry],
              deadline_ms: Optional[int], T_base_lidar: Optional[Pose], movable: Sequence[MovableBox],
              retries: Optional[int], accept: Optional[str]) -> Response:
        flat: Dict[str, str] = {"stamp_ns": str(stamp_ns)}
        if deadline_ms is not None:
            flat["deadline_ms"] = str(deadline_ms)
        keys: Dict[str, Any] = {}
        if odometry is not None:
            keys["odometry"] = odometry.to_json()
        if T_base_lidar is not None:
            keys["T_base_lidar"] = T_base_lidar.to_json()
        if movable:
            keys["movable"] = [box.to_json() for box in movable]

        def send() -> Response:
            return self._call(scan, layout, flat, keys, not movable, deadline_ms, retries, accept)

        try:
            return send()
        except Problem as problem:
            if problem.code in _BAD_PLACE:  # else no session would ever begin
                self._prior = self._gnss = None
            if self.seal is None or problem.code not in _SPENT:
                raise
        self.seal, self._prior = None, self._last.prior()
        return send()

    def _call(self, scan: Scan, layout: Optional[str], flat: Dict[str, str], keys: Dict[str, Any], may_thin: bool,
              deadline_ms: Optional[int], retries: Optional[int], accept: Optional[str]) -> Response:
        """To the server that answered last; after a lost connection, or where it is busy, to the next one."""
        start: Dict[str, Any] = {}
        if self.seal is None:
            for name, place in (("prior", self._prior), ("gnss", self._gnss)):
                if place is not None:
                    start[name] = place.to_json()
        wanted = {**keys, **start}
        most = len(self._servers) + (self._servers[0][0].retries if retries is None else retries)
        tries = 0
        while True:
            tries += 1
            transport, thinning = self._servers[0]

            def send(thin: Optional[Thinning]) -> Response:
                query, body, headers = scan_request(scan, layout, thin, flat, {**flat, **wanted} if wanted else {})
                if accept is not None:
                    headers["Accept"] = accept
                headers.update(self._region)
                if self.seal is not None:
                    headers["Stillmap-Seal"] = self.seal
                if self._label is not None:
                    query["vehicle"] = self._label
                query.update(self._in_set)
                return transport.call("POST", self._path, query=query, body=body, headers=headers, retries=0,
                                      active_of=self._active_of, timeout_s=transport.patience_s(deadline_ms))

            try:
                response = thinning.or_whole(may_thin, send)
                self._take(response.headers.get("stillmap-seal"))
                return response
            except (Problem, ConnectionLost) as error:
                problem = error if isinstance(error, Problem) else None
                if problem is not None:
                    self._take(problem.seal)
                if tries >= most or problem is not None and not is_passing(problem):
                    raise
                self._servers.append(self._servers.pop(0))
                if tries % len(self._servers) == 0:
                    time.sleep(wait_s(tries // len(self._servers), problem))

    def _take(self, seal: Optional[str]) -> None:
        if seal is None:
            return
        if self.seal is None:
            self.begun += 1
        # Where it was at first says nothing of a later session.
        self.seal, self._prior, self._gnss = seal, None, None
