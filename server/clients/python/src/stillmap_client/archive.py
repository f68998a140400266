"""A folder as a tar that is read from any place without being written: equal folders give equal bytes."""

from __future__ import annotations

import bisect
import hashlib
import io
import pathlib
import tarfile
from typing import BinaryIO, List, Tuple, Union

_BLOCK = 512


class Archive:
    """The bytes of an upload: a file as it is, or the tar of a folder (plain, owners and times 0)."""

    def __init__(self, path: pathlib.Path) -> None:
        self._starts: List[int] = []
        self._pieces: List[Union[bytes, Tuple[pathlib.Path, int]]] = []
        self.size = 0
        if path.is_dir():
            self._add_folder(path)
        elif path.is_file():
            self._add((path, path.stat().st_size))
        else:
            raise FileNotFoundError(f"{path}: found nothing, expected an archive or a folder")

    def _add(self, piece: Union[bytes, Tuple[pathlib.Path, int]]) -> None:
        length = len(piece) if isinstance(piece, bytes) else piece[1]
        if length == 0:
            return
        self._starts.append(self.size)
        self._pieces.append(piece)
        self.size += length

    def _add_folder(self, folder: pathlib.Path) -> None:
        for file in sorted(x for x in folder.rglob("*") if x.is_file()):
            info = tarfile.TarInfo(file.relative_to(folder).as_posix())
            info.size = file.stat().st_size
            self._add(info.tobuf(format=tarfile.PAX_FORMAT))
            self._add((file, info.size))
            self._add(b"\0" * (-info.size % _BLOCK))
        self._add(b"\0" * (2 * _BLOCK))

    def read(self, offset: int, size: int) -> bytes:
        """Fewer bytes than asked for only at the end."""
        found: List[bytes] = []
        i = bisect.bisect_right(self._starts, offset) - 1
        while size > 0 and 0 <= i < len(self._pieces):
            piece, skip = self._pieces[i], offset - self._starts[i]
            if isinstance(piece, bytes):
                data = piece[skip:skip + size]
            else:
                data = self._read_file(piece[0], skip, min(size, piece[1] - skip))
            found.append(data)
            offset, size, i = offset + len(data), size - len(data), i + 1
        return b"".join(found)

    @staticmethod
    def _read_file(path: pathlib.Path, offset: int, size: int) -> bytes:
        with path.open("rb") as file:
            file.seek(offset)
            data = file.read(size)
        if len(data) != size:
            raise OSError(f"{path}: it became shorter while it was sent")
        return data

    def open(self, offset: int = 0, size: int = -1) -> BinaryIO:
        end = self.size if size < 0 else min(self.size, offset + size)
        return io.BufferedReader(_Part(self, offset, end), buffer_size=1 << 16)

    def sha256(self, offset: int = 0, size: int = -1) -> "hashlib._Hash":
        digest = hashlib.sha256()
        with self.open(offset, size) as stream:
            while block := stream.read(1 << 20):
                digest.update(block)
        return digest


class _Part(io.RawIOBase):
    def __init__(self, archive: Archive, begin: int, end: int) -> None:
        self._archive, self._at, self._end = archive, begin, end

    def readable(self) -> bool:
        return True

    def readinto(self, buffer) -> int:  # type: ignore[no-untyped-def]
        data = self._archive.read(self._at, min(len(buffer), self._end - self._at))
        buffer[:len(data)] = data
        self._at += len(data)
        return len(data)
