"""Small tars of each kind, each behind the byte that archive.cpp explains. For seeds.py."""

import gzip
import hashlib
import io
import json
import tarfile

MEND, END, PIECES = 1, 2, 4


def entry(name, kind=tarfile.REGTYPE, size=0, **headers):
    info = tarfile.TarInfo(name)
    info.type, info.size = kind, size
    for key, value in headers.items():
        setattr(info, key, value)
    return info


def tar(entries, form=tarfile.USTAR_FORMAT):
    """Of (TarInfo, bytes), without the padding to 10 KiB."""
    body = io.BytesIO()
    for info, content in entries:
        body.write(info.tobuf(form))
        body.write(content + bytes(-len(content) % 512))
    return body.getvalue() + bytes(1024)


def files(contents):
    return [(entry(name, size=len(content)), content) for name, content in contents.items()]


def package(prefix="", others=True):
    listed = {"tiles/0_0_0.bin": bytes(20)} | ({"notes.txt": b"notes"} if others else {})
    not_listed = {"build.json": b"{}", "stray/a": b"x"} if others else {}
    manifest = {"schema": 1, "frame_id": "map", "origin": [0, 0, 0], "voxel_size_m": 0.1, "relative_clock": True,
                "software_version": "1", "options": {}, "counts": {}, "sources": {},
                "tiles": [{"level": 0, "x": 0, "y": 0, "points": 1, "min": [0, 0, 0], "max": [0, 0, 0]}],
                "files": {name: {"bytes": len(content), "sha256": hashlib.sha256(content).hexdigest()}
                          for name, content in listed.items()}}
    text = json.dumps(manifest, separators=(",", ":")).encode()
    return files({prefix + name: content for name, content in
                  {"manifest.json": text, **not_listed, **listed}.items()})


def make_all(put_input):
    def put(name, flags, content):
        put_input("archive", name, bytes([flags]) + content)

    put("package", MEND, tar(package()))
    put("package_in_folder", PIECES, tar([(entry("town", tarfile.DIRTYPE), b"")] + package("town/")))
    # Short enough for the inputs that fuzzing tries.
    put("small", MEND | END, tar(package(others=False)).removesuffix(bytes(1024)))
    put("gzip", 0, gzip.compress(tar(package()), mtime=0))
    # zstd's own magic and one raw block, since Python 3.11 has no zstd.
    body = tar(files({"a": b"x"}))
    put("zstd", 0, bytes.fromhex("28b52ffd") + b"\xa0" + len(body).to_bytes(4, "little") +
        (len(body) << 3 | 1).to_bytes(3, "little") + body)
    long_name = "p" * 60 + "/" + "n" * 120
    put("pax", MEND, tar([(entry(long_name, size=1, pax_headers={"comment": "c"}), b"x")], tarfile.PAX_FORMAT))
    put("gnu", MEND | END, tar([(entry(long_name, size=1), b"x")], tarfile.GNU_FORMAT))
    put("links", MEND, tar([(entry("hard", tarfile.LNKTYPE, linkname="a"), b""),
                            (entry("soft", tarfile.SYMTYPE, linkname="/etc"), b"")]))
    put("sparse", MEND, tar([(entry("s", size=6, pax_headers={"GNU.sparse.major": "1", "GNU.sparse.minor": "0",
                                                              "GNU.sparse.realsize": "9"}), b"1\n0\n1\n")],
                            tarfile.PAX_FORMAT))
    put("devices", MEND, tar([(entry("c", tarfile.CHRTYPE), b""), (entry("p", tarfile.FIFOTYPE), b"")]))
    put("twice", MEND, tar(files({"a": b"x", "./a": b"y", "a/b": b"z"})))
