"""Server-sent events that go on after a lost connection."""

from __future__ import annotations

import http.client
import json
import time
from typing import Iterator, Optional

from .errors import ConnectionLost, Problem
from .transport import Response, Transport, wait_s
from .types import Event

#: The server sends a comment every 15 s.
_SILENCE_S = 45.0


def parsed(response: Response) -> Iterator[Optional[Event]]:
    """Events of one connection (WHATWG HTML, 9.2.6, as far as this server uses it), and None for each comment."""
    number, kind, data = None, "message", []
    for line in iter(response.raw.readline, b""):
        text = line.decode("utf-8", "replace").rstrip("\r\n")
        if text:
            name, _, value = text.partition(":")
            value = value[1:] if value.startswith(" ") else value
            if name == "id" and value.isdecimal():
                number = int(value)
            elif name == "event":
                kind = value
            elif name == "data":
                data.append(value)
        elif data:
            yield Event(number, kind, json.loads("\n".join(data)))
            number, kind, data = None, "message", []
        else:
            yield None
            number, kind = None, "message"


def stream(transport: Transport, path: str, last: str, last_id: Optional[int], patience_s: float) -> Iterator[Event]:
    """Yields events up to the one of type `last`. Connects again with Last-Event-ID when the connection or the
    server goes, for `patience_s` without one that holds. @raises ConnectionLost, Problem."""
    tries = 0
    lost_since = time.monotonic()
    while True:
        problem, heard = None, False
        try:
            headers = {"Accept": "text/event-stream", **({} if last_id is None else {"Last-Event-ID": str(last_id)})}
            with transport.open("GET", path, headers=headers, retries=0, timeout_s=_SILENCE_S) as response:
                if response.status == 204:
                    return
                for event in parsed(response):
                    tries, heard = 0, True
                    if event is None:
                        continue
                    if event.type == "end" and event.id is None:
                        break  # the server stops; another may start
                    last_id = event.id if event.id is not None else last_id
                    yield event
                    if event.type == last:
                        return
        except Problem as error:
            if error.status not in (429, 503):
                raise
            problem = error
        except (ConnectionLost, OSError, http.client.HTTPException):
            pass
        if heard:
            lost_since = time.monotonic()
        if time.monotonic() - lost_since > patience_s:
            raise problem or ConnectionLost(f"GET {path}: no connection that holds for {patience_s:g} s")
        tries += 1
        time.sleep(wait_s(tries, problem))
