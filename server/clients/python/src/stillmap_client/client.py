"""The client: poses, sessions, maps, drives and jobs of one server."""

from __future__ import annotations

import base64
import itertools
import json
import os
import pathlib
import ssl
import time
import uuid
from http.client import HTTPException
from typing import Any, Callable, Dict, Iterator, List, Mapping, Optional, Sequence, Tuple, TypeVar, Union

from . import events
from .archive import Archive
from .errors import ConnectionLost, DownloadChanged, NeedsChoice, Problem
from .mirror import Mirrored, mirrored
from .scan import Scan, multipart, scan_part, scan_request
from .sealed import SealedSession
from .session import Session
from .thinning import OWN_VEHICLE_M, Thinning, refuses_thin
from .transport import GEOPOSE, Body, Response, Transport, as_object, region_of, wait_s
from .types import (Event, GeoPose, Gnss, MapInfo, MovableBox, Pose, PoseAnswer, Prior, Query, SessionInfo, Version)

Path = Union[str, "os.PathLike[str]"]
_Found = TypeVar("_Found")
_PART_BYTES = 64 << 20
_FINISHED = frozenset({"succeeded", "failed", "canceled"})


def _job(json: Any) -> Dict[str, Any]:
    """A job that can be waited for. @raises TypeError, KeyError."""
    found = as_object(json)
    for name in ("status", "stage", "progress"):
        found[name]
    return found


def _place(map: Optional[str], version: Optional[str]) -> str:
    if map is None:
        if version is not None:
            raise ValueError("version: found a version without a map, expected the map too")
        return "/v1"
    return f"/v1/maps/{map}" + ("" if version is None else f"/versions/{version}")


def _parameters(query: Query) -> Dict[str, Any]:
    """As JSON, without what says how the scan is sent."""
    keys: Dict[str, Any] = {}
    for name, value in (("prior", query.prior), ("gnss", query.gnss), ("T_base_lidar", query.T_base_lidar)):
        if value is not None:
            keys[name] = value.to_json()
    if query.movable:
        keys["movable"] = [box.to_json() for box in query.movable]
    if query.stamp_ns is not None:
        keys["stamp_ns"] = str(query.stamp_ns)
    if query.method is not None:
        keys["method"] = query.method
    return keys


def _of_vehicle(vehicle: Optional[str]) -> Dict[str, str]:
    return {} if vehicle is None else {"vehicle": vehicle}


def _in_set(map: Optional[str], set: Optional[str]) -> Dict[str, str]:
    if map is not None and set is not None:
        raise ValueError("set: found a map beside it, expected one of the two")
    return {} if set is None else {"set": set}


def _may_thin(query: Query) -> bool:
    """Which points lie in boxes is asked of the whole scan; other methods thin in their own way."""
    return not query.movable and query.method in (None, "default")


def _is_thin_refused(answers: Sequence[Union[PoseAnswer, Problem]]) -> bool:
    return any(isinstance(each, Problem) and refuses_thin(each) for each in answers)


def _csv(values: Sequence[float]) -> str:
    return ",".join(repr(float(x)) for x in values)


def _digest(sha256: bytes) -> str:
    return f"sha-256=:{base64.b64encode(sha256).decode()}:"


class Client:
    """Speaks to one server. Safe from several threads.

    url          such as "http://127.0.0.1:8080"
    key          API key, when the server has any ("stillmap_...")
    timeout_s    of connecting, of a server that takes nothing of what is sent, and of silence within an answer
    slow_timeout_s  of silence where the server says nothing until it is done: a version or drive that was sent is
                 unpacked and brought to the disk, a version that is activated gets its index
    retries      further tries of refused requests (429, 503, after `Retry-After`) and of idempotent ones whose
                 connection was lost
    thin         of a raw scan only what is matched is sent: "exact" (same answer, 180 kB), "compact" (at most 48 kB,
                 some mm away) or None (the whole scan). With boxes of `movable`, with another method than the default
                 and without numpy the whole scan is sent. So it is from then on to a server that refuses thin ones
    own_vehicle_m  for `thin`: as the server's option of this name
    """

    def __init__(self, url: str, key: Optional[str] = None, *, timeout_s: float = 30.0,
                 slow_timeout_s: float = 3600.0, retries: int = 4, context: Optional[ssl.SSLContext] = None,
                 thin: Optional[str] = "exact", own_vehicle_m: float = OWN_VEHICLE_M) -> None:
        self._transport = Transport(url, key, timeout_s, retries, context)
        self._slow_timeout_s = slow_timeout_s
        self.thinning = Thinning(thin, own_vehicle_m)

    def close(self) -> None:
        """Closes the calling thread's connection; those of other threads end with them."""
        self._transport.drop()

    # --- poses -------------------------------------------------------------------------------------------

    def localize(self, map: Optional[str], scan: Scan, prior: Optional[Prior] = None, *, version: Optional[str] = None,
                 layout: Optional[str] = None, gnss: Optional[Gnss] = None, stamp_ns: Optional[int] = None,
                 method: Optional[str] = None, deadline_ms: Optional[int] = None, T_base_lidar: Optional[Pose] = None,
                 movable: Sequence[MovableBox] = (), vehicle: Optional[str] = None,
                 set: Optional[str] = None) -> PoseAnswer:
        """Where a scan was taken; the status is `lost` when that cannot be said. Without prior and gnss the whole
        map is searched. @param vehicle  label of the vehicle that asks: a roll-out may have another version for it.
        @param map  None: the map of a set that the scan is in; the prior is then in the frame of the set. @param set
        None: the only one; with gnss all maps with a place on the Earth.
        @raises Problem, ConnectionLost, ValueError for what is no scan."""
        query = Query(scan, prior, layout, gnss, stamp_ns, method, T_base_lidar, movable)
        return self._localize(map, version, query, deadline_ms, None, vehicle, set).json(PoseAnswer.of)

    def localize_geopose(self, map: Optional[str], scan: Scan, prior: Optional[Prior] = None, *, version: Optional[str] = None,
                         layout: Optional[str] = None, gnss: Optional[Gnss] = None, stamp_ns: Optional[int] = None,
                         method: Optional[str] = None, deadline_ms: Optional[int] = None,
                         T_base_lidar: Optional[Pose] = None, movable: Sequence[MovableBox] = (),
                         vehicle: Optional[str] = None, set: Optional[str] = None) -> GeoPose:
        """As `localize`, for maps with a place on the Earth.
        @raises Problem `NoPose` when the scan is lost, and `NotAcceptable` when the map has no place."""
        query = Query(scan, prior, layout, gnss, stamp_ns, method, T_base_lidar, movable)
        response = self._localize(map, version, query, deadline_ms, GEOPOSE, vehicle, set)
        return response.json(lambda json: GeoPose.of(json, response.headers))

    def localize_batch(self, map: str, queries: Sequence[Query], *, version: Optional[str] = None,
                       deadline_ms: Optional[int] = None,
                       vehicle: Optional[str] = None) -> List[Union[PoseAnswer, Problem]]:
        """Several scans in one request. @return for each, in their order, its answer or why it was refused."""
        def read(json: Any) -> List[Union[PoseAnswer, Problem]]:
            return [PoseAnswer.of(each["answer"]) if each["status"] == 200
                    else Problem(int(each["status"]), each["problem"]) for each in json["answers"]]

        def send(thinning: Optional[Thinning]) -> List[Union[PoseAnswer, Problem]]:
            wanted, scans = [], []
            for i, query in enumerate(queries):
                part, of_scan = scan_part(f"scan-{i}", query.scan, query.layout, thinning if _may_thin(query) else None)
                wanted.append({**_parameters(query), **of_scan})
                scans.append(part)
            request: Dict[str, Any] = {"queries": wanted}
            if deadline_ms is not None:
                request["deadline_ms"] = deadline_ms
            body, headers = multipart(request, scans)
            return self._transport.call("POST", _place(map, version) + "/localize/batch", query=_of_vehicle(vehicle),
                                        body=body, headers=headers, active_of=map if version is None else None,
                                        timeout_s=self._transport.patience_s(deadline_ms)).json(read)

        return self.thinning.or_whole(True, send, _is_thin_refused)

    def _localize(self, map: Optional[str], version: Optional[str], query: Query, deadline_ms: Optional[int],
                  accept: Optional[str], vehicle: Optional[str], set: Optional[str]) -> Response:
        prior, gnss = query.prior, query.gnss
        flat: Dict[str, str] = {}
        keys: Dict[str, Any] = {}
        for name, value in (("stamp_ns", query.stamp_ns), ("method", query.method), ("deadline_ms", deadline_ms)):
            if value is not None:
                flat[name] = str(value)
        if query.T_base_lidar is not None or query.movable or (prior is not None and prior.covariance is not None):
            keys = {**flat, **_parameters(query)}
        if prior is not None:
            flat.update(prior_t=_csv(prior.pose.position), prior_q=_csv(prior.pose.quaternion))
            if prior.sigma is not None:
                flat["prior_sigma"] = _csv(prior.sigma)
        if gnss is not None:
            altitude = "" if gnss.altitude_m is None else _csv([gnss.altitude_m])
            flat["gnss"] = ",".join((_csv([gnss.latitude_deg, gnss.longitude_deg]), altitude, _csv([gnss.sigma_m])))

        def send(thinning: Optional[Thinning]) -> Response:
            parameters, body, headers = scan_request(query.scan, query.layout, thinning, flat, keys)
            if accept is not None:
                headers["Accept"] = accept
            if prior is not None:
                headers.update(region_of(prior.pose.position))
            parameters = {**parameters, **_of_vehicle(vehicle), **_in_set(map, set)}
            return self._transport.call("POST", _place(map, version) + "/localize", query=parameters, body=body,
                                        headers=headers, active_of=map if version is None else None,
                                        timeout_s=self._transport.patience_s(deadline_ms))

        return self.thinning.or_whole(_may_thin(query), send)

    def open_session(self, map: Optional[str], *, version: Optional[str] = None, prior: Optional[Prior] = None,
                     gnss: Optional[Gnss] = None, label: Optional[str] = None,
                     retries: Optional[int] = None, set: Optional[str] = None) -> Session:
        """Follows one vehicle. A prior needs its sigma or covariance. @param label  what operators see, and by which
        roll-outs know the vehicle. @param map  None: through the maps of a set. @param set  None: the only one."""
        wanted: Dict[str, Any] = dict(_in_set(map, set))
        for name, value in (("map", map), ("version", version), ("label", label), ("prior", prior and prior.to_json()),
                            ("gnss", gnss and gnss.to_json())):
            if value is not None:
                wanted[name] = value
        return self._read(lambda json: Session(self._transport, self.thinning, json), "POST", "/v1/sessions", wanted, idempotent=False,
                          retries=retries, active_of=map if version is None else None)

    def sealed_session(self, map: Optional[str], *, version: Optional[str] = None, prior: Optional[Prior] = None,
                       gnss: Optional[Gnss] = None, label: Optional[str] = None, seal: Optional[str] = None,
                       others: "Sequence[Client]" = (), set: Optional[str] = None) -> SealedSession:
        """Follows one vehicle, with nothing kept on a server. @param map, set  as for `open_session`.
        @param seal  of a session to go on with. @param others
        clients of further servers of the same store, that are asked when this one does not answer; behind a load
        balancer there is no need of them."""
        servers = [(each._transport, each.thinning) for each in (self, *others)]
        return SealedSession(servers, _place(map, version), prior, gnss, label, seal, _in_set(map, set),
                             map if version is None else None)

    def sessions(self, map: Optional[str] = None) -> List[SessionInfo]:
        """Those of the key; of all keys with the scope admin. @param map  only those of this map."""
        query = None if map is None else {"map": map}
        return self._transport.call("GET", "/v1/sessions", query=query).json(
            lambda json: [SessionInfo.of(each) for each in json["sessions"]])

    # --- the server and its maps -------------------------------------------------------------------------

    def is_ready(self) -> bool:
        """Whether all maps are loaded; False also when nobody answers."""
        try:
            self._transport.call("GET", "/readyz", retries=0)
        except (Problem, ConnectionLost):
            return False
        return True

    def status(self) -> Dict[str, Any]:
        return self._json("GET", "/v1/status")

    def maps(self) -> List[MapInfo]:
        return self._read(lambda json: [MapInfo.of(each) for each in json["maps"]], "GET", "/v1/maps")

    def map(self, name: str) -> MapInfo:
        return self._read(MapInfo.of, "GET", f"/v1/maps/{name}")

    def create_map(self, name: str) -> MapInfo:
        return self._read(MapInfo.of, "PUT", f"/v1/maps/{name}")

    def delete_map(self, name: str, *, active: bool = False) -> None:
        """@param active  also when a version of it is served."""
        self._transport.call("DELETE", f"/v1/maps/{name}", query={"active": "true"} if active else None)

    def sets(self) -> Dict[str, Dict[str, Pose]]:
        """The sets of maps: of each its maps, with T_set_map."""
        def read(json: Any) -> Dict[str, Dict[str, Pose]]:
            return {each["name"]: {member["map"]: Pose.of(member) for member in each["maps"]} for each in json["sets"]}

        return self._read(read, "GET", "/v1/sets")

    def put_set(self, name: str, maps: Mapping[str, Optional[Pose]]) -> None:
        """Makes a set, or changes it. @param maps  with T_set_map; None: the map's frame is that of the set."""
        members = [{"map": map, **({} if T is None else T.to_json())} for map, T in maps.items()]
        self._json("PUT", f"/v1/sets/{name}", {"maps": members})

    def delete_set(self, name: str) -> None:
        """Its maps stay."""
        self._transport.call("DELETE", f"/v1/sets/{name}")

    def stats(self, name: str) -> Dict[str, Any]:
        return self._json("GET", f"/v1/maps/{name}/stats")

    def versions(self, name: str) -> List[Version]:
        return self._read(lambda json: [Version.of(each) for each in json["versions"]], "GET", f"/v1/maps/{name}/versions")

    def activate(self, map: str, version: str, *, if_revision: Optional[int] = None, new_frame: bool = False) -> MapInfo:
        """When the answer is lost the map is looked at, so a proxy of two servers must be called by the name of one.
        @param if_revision  only while the map is at it; else Problem `RevisionChanged`."""
        def look() -> Optional[MapInfo]:
            found = self.map(map)
            # The revision stays when the version was active already.
            since = 0 if if_revision is None else found.revision - if_revision
            return found if found.version == version and (if_revision is None or since in (0, 1)) else None

        return self._settled(
            lambda: self._change(f"/v1/maps/{map}/versions/{version}/activate", if_revision, new_frame), look)

    def roll_back(self, map: str, *, if_revision: Optional[int] = None, new_frame: bool = False) -> MapInfo:
        # Twice is back where it began, or refused by its revision: a lost answer is the caller's to look into.
        return self._change(f"/v1/maps/{map}/rollback", if_revision, new_frame)

    def delete_version(self, map: str, version: str) -> None:
        self._transport.call("DELETE", f"/v1/maps/{map}/versions/{version}")

    def upload_version(self, map: str, version: str, path: Path) -> Version:
        """Stores a map package as a version: a folder, or its tar (plain, gzip, zstd), streamed with its SHA-256."""
        archive = Archive(pathlib.Path(path))
        headers = {"Content-Type": "application/octet-stream", "Content-Digest": _digest(archive.sha256().digest())}
        return self._transport.call("PUT", f"/v1/maps/{map}/versions/{version}", headers=headers,
                                    body=(archive.size, archive.open), timeout_s=self._slow_timeout_s).json(Version.of)

    def download_version(self, map: str, version: str, path: Path, *, from_digest: str = "") -> int:
        """Writes the package's tar to `path` and goes on where an earlier try ended. @param from_digest  of another
        version of the map, whose files are left out. @return its bytes."""
        query = {"from": from_digest} if from_digest else None
        return self._download(_place(map, version) + "/content", query, pathlib.Path(path))

    def mirror(self, map: str, folder: Path, *, vehicle: Optional[str] = None) -> Mirrored:
        """Keeps a copy of the version that the server serves as FOLDER/current, a map package that other programs may
        read meanwhile. Fetches only files that the copy before does not have; each is compared with its SHA-256. Call
        it again after an interruption, or to follow the server. No signature is checked: for that there is
        `stillmap mirror --trusted`. @param vehicle  label of the vehicle that asks: a roll-out may have another
        version for it. @raises DownloadChanged for bytes that are not what the version's digest says; ValueError for a
        package with paths outside itself."""
        info = self._transport.call("GET", f"/v1/maps/{map}", query=_of_vehicle(vehicle)).json(MapInfo.of)
        if info.version is None:
            raise ValueError(f"map {map!r}: no version is active; activate one")
        place = _place(map, info.version)
        return mirrored(info.version, str(info.raw["digest"]), pathlib.Path(folder),
                        lambda sha256, target: self._download(f"{place}/files/{sha256}", None, target))

    def _download(self, url: str, query: Optional[Dict[str, str]], target: pathlib.Path) -> int:
        part, tag = target.with_name(target.name + ".part"), target.with_name(target.name + ".etag")
        tries = 0
        while True:
            try:
                size = self._fetch(url, query, part, tag)
                break
            except (OSError, HTTPException, ConnectionLost) as error:
                tries += 1
                if tries > self._transport.retries:
                    raise ConnectionLost(f"{url}: {error}") from error
                time.sleep(wait_s(tries, None))
        part.replace(target)
        tag.unlink()
        return size

    def _fetch(self, url: str, query: Optional[Dict[str, str]], part: pathlib.Path, tag: pathlib.Path) -> int:
        have = part.stat().st_size if part.exists() and tag.exists() else 0
        headers = {"Range": f"bytes={have}-"} if have else {}
        try:
            with self._transport.open("GET", url, query=query, headers=headers) as response:
                if have and response.headers.get("etag") != tag.read_text():
                    raise DownloadChanged(f"{part}: found part of something else, expected part of {url}")
                have = have if response.status == 206 else 0
                tag.write_text(response.headers.get("etag", ""))
                length = int(response.headers["content-length"])
                with part.open("r+b" if have else "wb") as file:
                    file.seek(have)
                    got = _copied(response, file.write)
                if got != length:
                    raise ConnectionLost(f"{url}: found {got} bytes, expected {length}")
                return have + got
        except Problem as problem:
            if problem.status == 416 and have:
                return self._whole(url, query, part, tag, have)
            raise

    def _whole(self, url: str, query: Optional[Dict[str, str]], part: pathlib.Path, tag: pathlib.Path,
               have: int) -> int:
        """All bytes were there already."""
        with self._transport.open("HEAD", url, query=query) as response:
            same = response.headers.get("etag") == tag.read_text()
            if same and int(response.headers["content-length"]) == have:
                return have
        raise DownloadChanged(f"{part}: found {have} bytes of something else")

    # --- drives and jobs ---------------------------------------------------------------------------------

    def drives(self, map: str) -> List[Dict[str, Any]]:
        return self._read(lambda json: list(json["drives"]), "GET", f"/v1/maps/{map}/drives")

    def upload_drive(self, map: str, path: Path, *, name: str = "", drive: Optional[int] = None,
                     part_bytes: int = _PART_BYTES, on_part: Optional[Callable[[int, int], None]] = None,
                     choice: str = "") -> int:
        """Sends a drive (a folder, or its tar) in parts. @param drive  id of an upload that was cut: parts that
        are there are not sent again. @param on_part  told how many of how many bytes are there.
        @param choice  of a recording: "cloud=/front&poses=/odom". @return its id.
        @throws NeedsChoice when a recording leaves a choice: call again with its `drive` and a `choice`."""
        archive = Archive(pathlib.Path(path))
        if drive is None:
            drive = self._read(lambda json: int(json["id"]), "POST", f"/v1/maps/{map}/drives", {"name": name},
                               idempotent=False)
        url = f"/v1/maps/{map}/drives/{drive}"
        there = self._read(lambda json: {int(part["n"]): str(part["sha256"]) for part in json["parts"]}, "GET", url)
        for n, offset in enumerate(range(0, archive.size, part_bytes), start=1):
            size = min(part_bytes, archive.size - offset)
            sha256 = archive.sha256(offset, size)
            if there.get(n) != sha256.hexdigest():
                self._transport.call("PUT", f"{url}/parts/{n}", body=(size, lambda: archive.open(offset, size)),
                                     headers={"Content-Type": "application/octet-stream",
                                              "Content-Digest": _digest(sha256.digest())})
            if on_part is not None:
                on_part(offset + size, archive.size)

        # While the server applies a choice, the drive still shows that it needs one.
        ends = ("complete",) if choice else ("complete", "needs_choice")

        def look() -> Optional[Dict[str, Any]]:
            return self._read(lambda json: as_object(json) if json["status"] in ends else None, "GET", url)

        done = self._settled(lambda: self._json("POST", f"{url}/complete", {"choice": choice} if choice else None,
                                                idempotent=False, timeout_s=self._slow_timeout_s), look)
        if done.get("status") == "needs_choice":
            raise NeedsChoice(drive, str(done["error"]), [str(each["choice"]) for each in done["inspection"]["choices"]])
        return drive

    def delete_drive(self, map: str, drive: int) -> None:
        self._transport.call("DELETE", f"/v1/maps/{map}/drives/{drive}")

    def rebuild(self, map: str, drives: Sequence[int], **wanted: Any) -> Dict[str, Any]:
        """Asks for a new version. @param wanted  options, version, activate, ... (server/reference.md). @return the job."""
        response = self._transport.call(
            "POST", f"/v1/maps/{map}/rebuild", body=json.dumps({"drives": list(drives), **wanted}).encode(),
            headers={"Content-Type": "application/json", "Idempotency-Key": uuid.uuid4().hex})
        return response.json(as_object)

    def job(self, job: int) -> Dict[str, Any]:
        return self._read(_job, "GET", f"/v1/jobs/{job}")

    def cancel_job(self, job: int) -> Dict[str, Any]:
        return self._json("POST", f"/v1/jobs/{job}/cancel")

    def job_events(self, job: int, *, last_id: Optional[int] = None, patience_s: float = 60.0) -> Iterator[Event]:
        """What happens to it, up to its end; goes on after lost connections."""
        return events.stream(self._transport, f"/v1/jobs/{job}/events", "end", last_id, patience_s)

    def wait_for_job(self, job: int, *, timeout_s: Optional[float] = None,
                     on_change: Optional[Callable[[Mapping[str, Any]], None]] = None) -> Dict[str, Any]:
        """The job once it has ended, however it did. @raises TimeoutError."""
        end = None if timeout_s is None else time.monotonic() + timeout_s
        pause_s, before = 0.1, None
        while True:
            found = self.job(job)
            shown = (found["status"], found["stage"], found["progress"])
            if on_change is not None and shown != before:
                on_change(found)
            before = shown
            if found["status"] in _FINISHED:
                return found
            if end is not None and time.monotonic() + pause_s > end:
                raise TimeoutError(f"job {job}: still {found['status']} after {timeout_s:g} s")
            time.sleep(pause_s)
            pause_s = min(2.0, 1.5 * pause_s)

    # --- in general --------------------------------------------------------------------------------------

    def _json(self, method: str, path: str, body: Optional[Mapping[str, Any]] = None, *,
              idempotent: bool = True, timeout_s: Optional[float] = None) -> Dict[str, Any]:
        return self._read(as_object, method, path, body, idempotent=idempotent, timeout_s=timeout_s)

    def _read(self, read: Callable[[Any], _Found], method: str, path: str, body: Optional[Mapping[str, Any]] = None, *,
              idempotent: bool = True, retries: Optional[int] = None, timeout_s: Optional[float] = None,
              active_of: Optional[str] = None) -> _Found:
        headers = {} if body is None else {"Content-Type": "application/json"}
        data: Body = None if body is None else json.dumps(body).encode()
        return self._transport.call(method, path, body=data, headers=headers, idempotent=idempotent, retries=retries,
                                    timeout_s=timeout_s, active_of=active_of).json(read)

    def _change(self, path: str, if_revision: Optional[int], new_frame: bool) -> MapInfo:
        headers = {} if if_revision is None else {"If-Match": f'"{if_revision}"'}
        query = {"new_frame": "true"} if new_frame else None
        return self._transport.call("POST", path, query=query, headers=headers, idempotent=False,
                                    timeout_s=self._slow_timeout_s).json(MapInfo.of)

    def _settled(self, ask: Callable[[], _Found], look: Callable[[], Optional[_Found]]) -> _Found:
        """What `ask` answers. When that is lost the server may have done it, or be at it: it is asked again only when
        `look` finds it undone, and not after silence, since each that asks waits in the server."""
        lost = False
        for tries in itertools.count(1):
            try:
                return ask()
            except (ConnectionLost, Problem) as error:
                again = _is_lost(error)
                lost = lost or again
                # A refusal after a lost answer may be of what that one has done.
                found = look() if lost else None
                if found is not None:
                    return found
                if not again or _is_silence(error) or tries > self._transport.retries:
                    raise
            time.sleep(wait_s(tries, None))
        raise AssertionError("unreachable")


def _is_lost(error: Exception) -> bool:
    """Whether the server may have done what was asked; 502 and 504 are said by proxies."""
    return isinstance(error, ConnectionLost) or isinstance(error, Problem) and error.status in (502, 504)


def _is_silence(error: Exception) -> bool:
    return isinstance(error, ConnectionLost) and error.silent or isinstance(error, Problem) and error.status == 504


def _copied(response: Response, write: Callable[[bytes], int]) -> int:
    got = 0
    while block := response.raw.read(1 << 16):
        write(block)
        got += len(block)
    return got
