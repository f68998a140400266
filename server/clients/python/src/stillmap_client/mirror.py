"""A copy of a map on this disk.

FOLDER/current             link to the package of the version that was fetched last
FOLDER/<digest>/           that package, and the one before
FOLDER/<digest>.incoming/  what has come of a version that is not complete
"""

import dataclasses
import hashlib
import json
import os
import pathlib
import shutil
from typing import Callable, Dict

from .errors import DownloadChanged


@dataclasses.dataclass(frozen=True)
class Mirrored:
    version: str
    digest: str
    #: Folder of the map package.
    package: pathlib.Path
    #: Whether it came now.
    is_new: bool
    fetched_bytes: int


def mirrored(version: str, digest: str, folder: pathlib.Path, fetch: Callable[[str, pathlib.Path], int]) -> Mirrored:
    """@param fetch  writes the file of a SHA-256 to a path and returns its bytes."""
    folder.mkdir(parents=True, exist_ok=True)
    package, current = folder / digest, folder / "current"
    fetched = 0
    is_new = not package.is_dir()
    if is_new:
        fetched = _fetch_package(digest, folder, fetch)
    if not (current.is_symlink() and os.readlink(current) == digest):
        before = os.readlink(current) if current.is_symlink() else ""
        link = folder / "current.new"
        link.unlink(missing_ok=True)
        link.symlink_to(digest)
        link.replace(current)
        _sync(folder)
        for other in folder.iterdir():
            if other.is_dir() and not other.is_symlink() and other.name not in (digest, before):
                shutil.rmtree(other)
    return Mirrored(version, digest, package, is_new, fetched)


def _fetch_package(digest: str, folder: pathlib.Path, fetch: Callable[[str, pathlib.Path], int]) -> int:
    incoming, fetched = folder / f"{digest}.incoming", 0
    incoming.mkdir(exist_ok=True)

    def take(sha256: str, target: pathlib.Path) -> None:
        nonlocal fetched
        if target.exists() and _sha256(target) == sha256:
            return
        target.unlink(missing_ok=True)
        fetched += fetch(sha256, target)
        if _sha256(target) != sha256:
            target.unlink()
            raise DownloadChanged(f"{target}: found other bytes than those of SHA-256 {sha256}; nothing of them was "
                                  "kept: look at the connection and try again")

    manifest = incoming / "manifest.json"
    take(digest, manifest)
    known = _known(folder / "current")
    for path, file in json.loads(manifest.read_bytes())["files"].items():
        target = incoming / _checked(path)
        target.parent.mkdir(parents=True, exist_ok=True)
        old = known.get(file["sha256"])
        if old is not None and not target.exists() and _sha256(old) == file["sha256"]:
            try:
                os.link(old, target)
            except OSError:
                pass  # a disk without hard links: it is fetched
        take(file["sha256"], target)
    # What has a package's name is whole, also after a power cut.
    for path in (*incoming.rglob("*"), incoming):
        _sync(path)
    incoming.replace(folder / digest)
    _sync(folder)
    return fetched


def _sync(path: pathlib.Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _known(package: pathlib.Path) -> Dict[str, pathlib.Path]:
    """Files of the copy before, by SHA-256; they may be damaged."""
    try:
        files = json.loads((package / "manifest.json").read_bytes())["files"]
    except (OSError, ValueError, KeyError):
        return {}
    return {file["sha256"]: package / path for path, file in files.items() if (package / path).is_file()}


def _checked(path: str) -> pathlib.PurePosixPath:
    parts = pathlib.PurePosixPath(path)
    if parts.is_absolute() or ".." in parts.parts or "\\" in path or not path:
        raise ValueError(f"manifest.json: found the path {path!r}, expected one in the package: this is no map package")
    return parts


def _sha256(file: pathlib.Path) -> str:
    digest = hashlib.sha256()
    with file.open("rb") as stream:
        while block := stream.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()
