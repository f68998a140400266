"""What goes wrong between a client and its server."""

from __future__ import annotations

from typing import Any, List, Mapping, Optional, Sequence


class StillmapError(Exception):
    """Everything that this package raises about a server."""


class ConnectionLost(StillmapError):
    """The server could not be reached, or went away within an answer, also after the retries."""

    #: All was sent and nothing came for as long as was agreed: the server may still be at it.
    silent = False


class Problem(StillmapError):
    """The server refused the request or failed at it (RFC 9457). Branch on `code`, which is stable."""

    #: That came with `NoPose`: the session goes on.
    seal: Optional[str] = None

    def __init__(self, status: int, body: Mapping[str, Any], retry_after_s: Optional[float] = None) -> None:
        self.status = status
        self.code = str(body.get("code", ""))
        self.title = str(body.get("title", ""))
        self.detail = str(body.get("detail", ""))
        self.request_id = str(body.get("request_id", ""))
        self.errors: Sequence[Mapping[str, Any]] = body.get("errors") or []
        self.retry_after_s = retry_after_s
        super().__init__(f"{status} {self.code or 'without a code'}: {self.detail or self.title}")


class DownloadChanged(StillmapError):
    """What lies there already is part of something else, or its digest is wrong."""


class NeedsChoice(StillmapError):
    """A recording of which it must be said what is used. It is kept as `drive`; `choices` are texts for `choice`."""

    def __init__(self, drive: int, detail: str, choices: List[str]) -> None:
        self.drive, self.choices = drive, choices
        super().__init__(f"drive {drive}: {detail}; choices are {', '.join(choices)}")
