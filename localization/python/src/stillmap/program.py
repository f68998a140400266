"""Builds, evaluations and all other commands of the program `stillmap`, as processes with progress.

They need libraries that this package does not link, so the program must be installed: it is the one that the variable
STILLMAP_PROGRAM names, else `stillmap` in PATH.
"""

from __future__ import annotations

import json
import os
import selectors
import shutil
import subprocess
import threading
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Union

from . import _native

PathText = Union[str, "os.PathLike[str]"]

#: Commands that tell their progress (`--progress json`).
_WITH_PROGRESS = ("build", "rebuild")
_WITHOUT_JSON = ("simulate",)
#: What is kept of messages [bytes].
_MOST_MESSAGE_BYTES = 65536
_KILL_AFTER_S = 10.0


@dataclass(frozen=True)
class Progress:
    """How far a command is."""

    stage: str
    #: Units of the stage, and how many there are; 0 when that is not known.
    done: int
    total: int
    #: Of everything, in [0, 1], never falling.
    fraction: float
    #: About how long everything still takes [s]; None before that can be told.
    eta_s: float | None
    message: str


class ProgramError(RuntimeError):
    """The program ended with an error; the message is the program's own."""

    def __init__(self, message: str, exit_code: int) -> None:
        super().__init__(message)
        #: 1 failed, 2 wrong usage, 3 disk full.
        self.exit_code = exit_code


class Cancelled(Exception):
    """The command was ended because `cancel` was set."""


def build(drives: PathText | Iterable[PathText], output: PathText, *,
          progress: Callable[[Progress], object] | None = None, cancel: threading.Event | None = None,
          **options: Any) -> dict[str, Any]:
    """Builds a map package of drives, as `stillmap build` does.

    output: folder of the package; must not exist. options: those of the command, with `_` for `-`: `select="::2"`,
    `movable="keep"`, `threads=1`. Returns the JSON that the command prints.
    progress: called at most some four times a second, in the calling thread. What it raises ends the build and is
    raised again; Ctrl-C and `cancel.set()` (from another thread; raises Cancelled) end it, too. The same call
    continues a build that was ended so, and the map is the same.
    Raises ProgramError with the program's message.
    """
    words = [drives] if isinstance(drives, (str, os.PathLike)) else list(drives)
    result = run("build", *words, progress=progress, cancel=cancel, output=output, **options)
    assert isinstance(result, dict)
    return result


def evaluate_localization(opened: _native.Map | PathText, drive: PathText, *, cancel: threading.Event | None = None,
                          **options: Any) -> dict[str, Any]:
    """Localizes a drive's scans in a map and compares with the drive's poses, as `stillmap evaluate localization` does.

    options: those of the command, with `_` for `-`: `prior_error=(1, 5)`, or several as `[(1, 5), (3, 10)]`.
    Returns the JSON that the command prints. Raises ProgramError with the program's message.
    """
    folder = opened.folder if isinstance(opened, _native.Map) else opened
    result = run("evaluate", "localization", folder, drive, cancel=cancel, **options)
    assert isinstance(result, dict)
    return result


def run(*words: PathText, progress: Callable[[Progress], object] | None = None,
        cancel: threading.Event | None = None, **options: Any) -> Any:
    """Runs a command of the program: `run("inspect", "my_bag")`.

    options: `name=value` becomes `--name value`, with `_` as `-`. True is a flag, None and False are left out, a tuple
    is joined with commas, a list is given value by value. Returns the JSON that the command prints; None for
    `simulate`, which prints none. For the rest see `build`.
    """
    command = [_program(), *(os.fspath(word) for word in words), *_option_words(options)]
    if words[0] not in _WITHOUT_JSON:
        command.append("--json")
    if progress is not None and words[0] not in _WITH_PROGRESS:
        raise ValueError(f"progress: found for {words[0]}, expected one of {', '.join(_WITH_PROGRESS)}")
    return _Run(command, progress, cancel).result()


def _program() -> str:
    named = os.environ.get("STILLMAP_PROGRAM")
    found = named or shutil.which("stillmap")
    if not found:
        raise FileNotFoundError("stillmap: not found in PATH; install stillmap's Debian package, or let "
                                "STILLMAP_PROGRAM name the program")
    return found


def _option_words(options: dict[str, Any]) -> list[str]:
    words: list[str] = []
    for name, value in options.items():
        option = "--" + name.replace("_", "-")
        if value is None or value is False:
            continue
        if value is True:
            words.append(option)
            continue
        # "--name=value", so that a value may begin with a dash.
        words += [f"{option}={_text_of(each)}" for each in (value if isinstance(value, list) else [value])]
    return words


def _text_of(value: Any) -> str:
    if isinstance(value, Sequence) and not isinstance(value, str):
        return ",".join(_text_of(each) for each in value)
    return str(value)


class _Run:
    """One process: its result, its messages and its progress are read as they come, none can block another."""

    def __init__(self, command: list[str], progress: Callable[[Progress], object] | None,
                 cancel: threading.Event | None) -> None:
        self._progress, self._cancel, self._has_json = progress, cancel, "--json" in command
        self._output, self._messages, self._lines = bytearray(), bytearray(), bytearray()
        read_end, write_end = os.pipe()
        if progress is not None:
            command += ["--progress=json", f"--progress-fd={write_end}"]
        self._read_end = read_end
        try:
            # In a session of its own, so that Ctrl-C reaches this process, which then ends the other.
            self._process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                                             stderr=subprocess.PIPE, pass_fds=[write_end], start_new_session=True)
        except BaseException:
            os.close(read_end)
            raise
        finally:
            os.close(write_end)

    def result(self) -> Any:
        try:
            self._read_all()
            code = self._process.wait()
        except BaseException:
            self._end()
            raise
        finally:
            os.close(self._read_end)
            for stream in (self._process.stdout, self._process.stderr):
                assert stream is not None
                stream.close()
        # `localize` ends with 1 when no pose is found, `rebuild` with 4 when the gate refuses; both print their answer.
        if code != 0 and not (code in (1, 4) and self._output):
            raise ProgramError(self._messages.decode(errors="replace").strip() or f"exit code {code}", code)
        return json.loads(self._output) if self._has_json else None

    def _read_all(self) -> None:
        assert self._process.stdout is not None and self._process.stderr is not None
        takes: dict[int, Callable[[bytes], None]] = {
            self._process.stdout.fileno(): self._output.extend,
            self._process.stderr.fileno(): self._take_message,
            self._read_end: self._take_lines,
        }
        with selectors.DefaultSelector() as selector:
            for descriptor in takes:
                selector.register(descriptor, selectors.EVENT_READ)
            while selector.get_map():
                if self._cancel is not None and self._cancel.is_set():
                    raise Cancelled("cancelled")
                for key, _ in selector.select(timeout=0.1):
                    piece = os.read(key.fd, 65536)
                    if piece:
                        takes[key.fd](piece)
                    else:
                        selector.unregister(key.fd)

    def _take_message(self, piece: bytes) -> None:
        self._messages += piece
        del self._messages[:-_MOST_MESSAGE_BYTES]

    def _take_lines(self, piece: bytes) -> None:
        self._lines += piece
        *whole, rest = self._lines.split(b"\n")
        self._lines = bytearray(rest)
        for line in whole:
            fields = json.loads(line)
            if self._progress is not None and "outcome" not in fields:
                self._progress(Progress(fields["stage"], fields["done"], fields["total"], fields["fraction"],
                                        fields["eta_s"], fields["message"]))

    def _end(self) -> None:
        """A command that is told to end does so within two seconds."""
        self._process.terminate()
        try:
            self._process.wait(timeout=_KILL_AFTER_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
