#!/usr/bin/env python3
"""The inputs that fuzzing starts from, for each target: small whole ones, made here, in bag_seeds.py and in
archive_seeds.py, and the committed ones in corpus/, each of which broke something once. Needs the tools lz4 and zstd.

usage: tests/fuzz/seeds.py FOLDER    writes FOLDER/TARGET/NAME; other files of FOLDER/TARGET are removed
"""

import base64
import collections
import gzip
import hashlib
import json
import math
import pathlib
import shutil
import struct
import sys

import archive_seeds
import bag_seeds

HERE = pathlib.Path(__file__).resolve().parent
CORPUS = HERE / "corpus"
CONFIG_SCHEMA = HERE.parent.parent / "server" / "config.schema.json"
LONGEST_INPUT = 4096  # run.sh tries no longer one
POINTS = [(1.0 + 0.5 * i, -2.0 + i, 0.25 * i, 0.125 * i) for i in range(8)]
POSE = {"position": [1, 2, 0.5], "quaternion": [0, 0, 0.6, 0.8]}
COVARIANCE = [(0.5 if row == column else 0.0) for row in range(6) for column in range(6)]
SEPARATOR = b"\x1e"


def floats(rows, columns=4):
    return b"".join(struct.pack(f"<{columns}f", *row[:columns]) for row in rows)


def pcd(data, fields=("x", "y", "z", "intensity"), sizes=None, types=None, body=b""):
    sizes = sizes or [4] * len(fields)
    types = types or ["F"] * len(fields)
    return ("# .PCD v0.7\nVERSION 0.7\nFIELDS " + " ".join(fields) + "\nSIZE " + " ".join(map(str, sizes)) +
            "\nTYPE " + " ".join(types) + "\nCOUNT " + " ".join("1" for _ in fields) +
            f"\nWIDTH {len(POINTS)}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {len(POINTS)}\nDATA {data}\n").encode() + body


def lzf_literals(data):
    """LZF without a match: runs of up to 32 bytes as they are."""
    return b"".join(bytes([len(data[i:i + 32]) - 1]) + data[i:i + 32] for i in range(0, len(data), 32))


def make_scans(put):
    def put_cloud(form, name, content):
        put(form, name, content)
        # The same as a map, which is handed on in pieces.
        put("cloud", f"{form}_{name}", content)

    text = "\n".join(" ".join(map(str, p)) for p in POINTS).encode() + b"\n"
    planes = b"".join(struct.pack("<8f", *column) for column in zip(*POINTS))
    # The second half once more, as a match of 8 bytes at distance 1.
    packed = lzf_literals(planes)
    put("scan_body", "xyzi", b"\0" + floats(POINTS))
    put("scan_body", "xyz", b"\1" + floats(POINTS, 3))
    n = len(POINTS)
    for name, profile, step, payload in (("exact", 0, 0.0, floats(POINTS, 3)), ("compact", 1, 0.01, bytes(range(6 * n)))):
        header = struct.pack("<4sBBBBIIIIffffI", b"SMTS", 1, profile, 0, 0, n, n, n, 0, 0.5, 2.7, step, 0.0, 0)
        put("scan_body", "thin_" + name, b"\4" + header + payload)
    put("scan_body", "pcd", b"\2" + pcd("binary", body=floats(POINTS)))
    put_cloud("pcd", "ascii", pcd("ascii", body=text))
    put_cloud("pcd", "binary", pcd("binary", body=floats(POINTS)))
    put_cloud("pcd", "compressed", pcd("binary_compressed", body=struct.pack("<II", len(packed), len(planes)) + packed))
    run = b"\0\x01" + b"\xe0\x76\x00"  # one byte, then 127 times the one before
    put_cloud("pcd", "run", pcd("binary_compressed", body=struct.pack("<II", len(run), 128) + run))
    timed = b"".join(struct.pack("<3dHI", *p[:3], 7, i * 1000) for i, p in enumerate(POINTS))
    put_cloud("pcd", "timed", pcd("binary", ("x", "y", "z", "reflectivity", "t"), [8, 8, 8, 2, 4],
                                  ["F", "F", "F", "U", "U"], timed))
    head = (f"element vertex {len(POINTS)}\nproperty float x\nproperty float y\nproperty float z\n"
            "property float intensity\nend_header\n").encode()
    put_cloud("ply", "ascii", b"ply\nformat ascii 1.0\ncomment by hand\n" + head + text)
    put_cloud("ply", "little", b"ply\nformat binary_little_endian 1.0\n" + head + floats(POINTS))
    put_cloud("ply", "big", b"ply\nformat binary_big_endian 1.0\n" + head +
        b"".join(struct.pack(">4f", *p) for p in POINTS))
    listed = (b"ply\nformat ascii 1.0\nelement face 1\nproperty list uchar int vertex_indices\nelement vertex 1\n"
              b"property double x\nproperty double y\nproperty double z\nproperty list uchar float extra\n"
              b"property uint t\nend_header\n3 0 1 2\n1 2 3 2 0.5 0.25 100\n")
    put_cloud("ply", "lists", listed)


def pose_object(**more):
    return {"prior": POSE, "stamp_ns": "1500000000123456789", "deadline_ms": 500, "method": "default", **more}


def make_seals(put):
    def motion(stamp_ns):
        turn = [0.6, -0.8, 0, 0.8, 0.6, 0, 0, 0, 1]
        return struct.pack("<q91di", stamp_ns, *turn, 1, 2, 0.5, *COVARIANCE, 9, 0, 0, 0, 0, 0.1, *COVARIANCE, 0.25, 3)

    def state(mode, flags, *motions, matched_ns=900):
        return struct.pack("<BBBqqiii", 1, mode, flags, 1000, matched_ns, 2, 1, 0) + b"".join(motions)
    put("tracker_state", "tracked", b"\xff" + state(0, 31, motion(1000), matched_ns=1000))
    put("tracker_state", "coasting", b"\x15" + state(0, 23, motion(900), motion(1000)))
    put("tracker_state", "wide", b"\0" + state(1, 3, motion(900)))
    put("tracker_state", "nowhere", b"\x81" + state(2, 0))
    put("seal", "short", b"AQEB\nv1\ntruck 7\n" + state(2, 0))
    put("seal", "long", base64.b64encode(b"\1" * 200) + b"\n" + b"v" * 63 + b"\n" + b"t" * 64 + b"\n" +
        state(0, 23, motion(900), motion(1000)))
    put("seal", "too_long", b"\n\n\n" + b"\xff" * 2000)


def make_requests(put):
    points = [list(p[:3]) for p in POINTS]
    box = {"centre": [1, 2, 3], "size": [4, 2, 1.5], "yaw": 0.5}
    put("pose_json", "plain", json.dumps({"points": points}))
    put("pose_json", "full", json.dumps(pose_object(
        points=points, T_base_lidar=POSE, movable=[box, box], prior={**POSE, "covariance": COVARIANCE})))
    put("pose_json", "beside", json.dumps({"layout": "xyz", "stamp_ns": -5}))
    put("pose_json", "wrong", json.dumps({"points": [[1, 2]], "prior": {"position": ["a", None, True]}}))
    def parts(request, scan, kind):
        return (b"multipart/form-data; boundary=\"xYz\"\n--xYz\r\nContent-Disposition: form-data; name=\"request\"\r\n"
                b"Content-Type: application/json\r\n\r\n" + json.dumps(request).encode() +
                b"\r\n--xYz\r\nContent-Disposition: form-data; name=scan; filename=\"a\"\r\nContent-Type: " + kind +
                b"\r\n\r\n" + scan + b"\r\n--xYz--\r\n")
    put("pose_multipart", "raw", parts(pose_object(layout="xyzi"), floats(POINTS), b"application/octet-stream"))
    put("pose_multipart", "pcd", parts(pose_object(), pcd("binary", body=floats(POINTS)), b"application/vnd.pcd"))
    query = ("prior_t=1,2,0.5&prior_q=0,0,0.6,0.8&prior_sigma=0.5,0.05&stamp_ns=15&method=icp&deadline_ms=500&layout=xyz")
    put("query", "full", query + "\nmultipart/form-data; boundary=\"xYz\"; charset=utf-8\nrequest-1._-\n"
        "/v1/maps/town/versions/0123456789ab/tiles/0/-1/2")
    put("query", "short", "prior_t=nan,inf,-1e9&prior_q=0,0,0,1\ntext/HTML ; name = plain \n\x01\n/v1/maps/town")
    put("query", "proxy_1", "a=b\n198.51.100.1, [2001:db8::1]:80 ,10.0.0.0/8,10.0.0.2:5\n\nPROXY TCP4 192.0.2.1 192.0.2.2 5000 443\r\n")
    put("query", "proxy_2", "a=b\n::1\n\n\r\n\r\n\0\r\nQUIT\n\x21\x11\0\x0cabcdefghijkl")
    put("query", "post", "stamp_ns=-9223372036854775808\n;;=;\n\n/v1/maps/town/localize")
    put("prior", "usual", struct.pack("<50d", 1, 2, 3, 0, 0, 0.6, 0.8, *COVARIANCE, 1, 2, 3, 4, 2, 1.5, 0.5))
    tight = [(1e-18 if row == column else 0.0) for row in range(6) for column in range(6)]
    put("prior", "tight", struct.pack("<50d", -1e8, 1e8, 0, 0, 0, 0, 1, *tight, 1e5, 2, 3, 100, 1e-9, 1, math.pi))


def make_http(put):
    scan = floats(POINTS)
    localize = b"POST /v1/maps/town/localize?prior_t=0,0,0&prior_q=0,0,0,1 HTTP/1.1\r\nHost: localhost\r\n"
    raw = b"Content-Type: application/octet-stream\r\nContent-Length: " + str(len(scan)).encode() + b"\r\n\r\n" + scan
    put("http", "get", b"GET /v1/maps HTTP/1.1\r\nHost: localhost\r\nAccept-Encoding: gzip, br\r\nX-Request-Id: a-1\r\n\r\n"
        b"HEAD /livez HTTP/1.1\r\n\r\nGET /v1/maps/town HTTP/1.1\r\nRange: bytes=0-1\r\nConnection: close\r\n\r\n")
    put("http", "localize", localize + raw + b"GET /readyz HTTP/1.1\r\n\r\n")
    body = json.dumps(pose_object(points=[list(p[:3]) for p in POINTS])).encode()
    put("http", "json", b"POST /v1/maps/town/localize HTTP/1.1\r\nContent-Type: application/json\r\nExpect: 100-continue\r\n"
        b"Content-Length: " + str(len(body)).encode() + b"\r\n\r\n" + body)
    put("http", "chunked", localize + b"Transfer-Encoding: chunked\r\n\r\n4\r\nabcd\r\n0\r\n\r\n")
    put("http", "huge_range", b"GET /v1/maps HTTP/1.1\r\nRange: bytes=99999999999999999999-\r\n\r\n")
    put("http", "odd", b"PUT /v1/%6daps/../x?a=%00&b HTTP/1.0\r\nRange: bytes=1-2,3-4\r\nContent-Length: 1\r\n\r\nx"
        b"OPTIONS * HTTP/1.1\r\n\r\n")


def make_heads(put):
    def head(*fields, line="GET /v1/maps HTTP/1.1"):
        return "\r\n".join([line, "Host: localhost", *fields, "", ""]).encode()

    put("request_head", "range", head("Range: bytes=5-9", 'If-None-Match: "b", W/"a"', "Connection: close"))
    put("request_head", "last_bytes", head("Range: bytes=-5", "If-None-Match: *", line="HEAD http://a/b HTTP/1.0"))
    put("request_head", "digest", head("Content-Digest: sha-256=:47DEQpj8HBSa+/TImW+5JCeuQeRkm5NMpJWZG3hSuFU=:",
                                       "Content-Length: 12", line="PUT /v1/maps/town/versions/v1 HTTP/1.1"))
    put("request_head", "trace", head("traceparent: 00-0af7651916cd43dd8448eb211c80319c-b7ad6b7169203331-01"))
    packed = gzip.compress(b"0123456789" * 5, mtime=0)
    put("request_head", "gzip", head("Content-Encoding: gzip", f"Content-Length: {len(packed)}",
                                     line="POST /v1/maps/town/localize HTTP/1.1") + packed)


def make_request_json(put):
    prior = {**POSE, "covariance": COVARIANCE}
    gnss = {"latitude_deg": 49, "longitude_deg": 8.4, "altitude_m": 110, "sigma_m": 3}
    box = {"action": "remove", "box": {"centre": [1, 2, 3], "size": [4, 2, 1.5], "yaw": 0.5}}
    of_drive = {**box, "drive": "a", "scans": [1, 2], "note": "b"}
    whole = {**pose_object(prior=prior, gnss=gnss, T_base_lidar=POSE, movable=[box["box"], box["box"]], layout="xyz"),
             "points": [[1, 2, 3], [4, 5, 6]], "odometry": {"since_ns": "5", **prior}}
    scans = [{"prior": POSE, "points": [[1, 2, 3], [4, 5, 6]]}, {"gnss": gnss, "points": [[1, 2]]}]
    beside = [{**pose_object(layout="xyzi"), "prior": prior}, {"layout": "xyz", "gnss": gnss}]
    texts = [{"name": "a", "scopes": ["read", "localize", "write", "admin"], "expires_days": 30},
             {"drives": [1, 2], "held_back": 3, "version": "v2", "activate": True, "new_frame": False,
              "options": {"preset": "paper", "odometry": "loam", "movable": "delete", "clean": "removert", "fusion": "on",
                          "detector": "geometric", "fill": "off", "loops": "on", "voxel": 0.1, "sensor-height": 1.73,
                          "edits": {"format": "stillmap-edits", "version": 1, "edits": [box, of_drive]}}},
             {"name": "a drive"},
             {"version": "v2", "content_type": "application/gzip"},
             {"center": [10, -20.5], "radius_m": 100, "level": 2, "cached_ids": ["a", "b"]},
             {"map": "town", "version": "v1", "label": "car 1", "prior": prior},
             {"gnss": gnss},
             {"queries": scans, "deadline_ms": 500},
             {"queries": beside},
             {"queries": [{"prior": POSE, "stamp_ns": "15"}, whole]}]
    for i, text in enumerate(texts):
        put("request_json", str(i), bytes([i]) + json.dumps(text).encode())
    put("request_json", "all", b"\7" + json.dumps({"queries": [whole, whole], "deadline_ms": 500}).encode())
    put("request_json", "two_places", b"\5" + json.dumps({"map": "town", "prior": prior, "gnss": gnss}).encode())
    put("request_json", "session_at_gnss", b"\5" + json.dumps({"map": "town", "gnss": gnss}).encode())
    put("request_json", "no_edits", b"\1" + json.dumps({"drives": [7], "options": {"edits": None}}).encode())


def make_packages(put):
    tiles = [("tiles/0_0_0.bin", 40), ("tiles/0_0_0.history", 32), ("tiles/0_-1_0.bin", 20), ("trajectory.tum", 32),
             ("objects.json", 16)]
    assert len("1 0 0 0 0 0 0 1\n2 1 0 0 0 0 0 1\n") == 32 and len('{"objects": []}\n') == 16
    digest = hashlib.sha256(b"").hexdigest()
    manifest = {"schema": 1, "frame_id": "map", "origin": [10.5, -2, 0], "voxel_size_m": 0.1, "relative_clock": False,
                "software_version": "0.1.0", "options": {"movable": "project"}, "counts": {"in": 3},
                "sources": {"drive": digest},
                "geodetic_origin": {"latitude_deg": 49.0, "longitude_deg": 8.4, "altitude_m": 110.0},
                "tiles": [{"level": 0, "x": x, "y": 0, "points": n, "min": [0, 0, 0], "max": [1, 2, 3]}
                          for x, n in ((0, 2), (-1, 1))],
                "files": {name: {"bytes": size, "sha256": digest} for name, size in tiles}}
    put("manifest", "whole", json.dumps(manifest, indent=1))
    put("manifest", "registered", json.dumps({**manifest, "registration": {
        "previous_digest": digest, "T_previous_map": POSE, "T_map_poses": POSE, "residual_m": 0.01, "residual_rad": 0.001,
        "scans_used": 3, "scans_asked": 4}}))
    second = {**manifest, "schema": 2, "drives": [{"scans": 5, "objects": 0}],
              "extent": {"tiles": 2, "points": 3, "area_m2": 2.5, "min": [-1, 0, 0], "max": [1, 2, 3]},
              "files": {"regions/-1_0.node": {"bytes": 88, "sha256": digest}}}
    del second["tiles"]
    put("manifest", "second", json.dumps(second))
    bare = {**manifest, "tiles": [], "files": {}}
    del bare["geodetic_origin"]
    put("manifest", "bare", json.dumps(bare))
    car = {"class": "car", "size": [4.5, 1.8, 1.5], "score": 0.75, "motion": "parked", "drive": 0, "first_scan": 0,
           "last_scan": 4, "first_stamp_ns": "1500000000000000000", "last_stamp_ns": "1500000000400000000",
           "detections": 3, "points_removed": 12, "placements": [{"scan": 0, "centre": [1, 2, 3], "yaw": 0.5}]}
    objects = json.dumps({"objects": [car]})
    tile = b"".join(struct.pack("<4fHBB", 0.1 * (i % 5), 0.1 * (i // 5), 0.01 * i, 0.5, 3, i % 4, 0) for i in range(30))
    put("map_points", "plane", tile)
    # Two points, the second tall and of an object, seen by one scan; a region of one tile.
    columns = [struct.pack("<IIiIIIII", 2, 1, -1, 1, 1, 1, 1, 1), struct.pack("<2H", 5, 65535), struct.pack("<2H", 7, 8),
               struct.pack("<2H", 100, 0), struct.pack("<2e", 0.5, 0.25), struct.pack("<2H", 3, 4), bytes([0, 2]),
               struct.pack("<I", 1), struct.pack("<i", 70000), struct.pack("<I", 1), struct.pack("<H", 0),
               struct.pack("<I", 0), struct.pack("<I", 9),
               struct.pack("<6b", 0, 0, 127, 1, 2, 3), bytes([255, 0]), struct.pack("<I", 0), struct.pack("<I", 12),
               struct.pack("<2H", 0, 0), struct.pack("<2H", 0, 0), struct.pack("<i", -2), struct.pack("<I", 0),
               bytes(range(100)) * 4, bytes(400)]
    put("tile", "tall", b"\0" + b"".join(column + bytes(-len(column) % 8) for column in columns))
    put("tile", "region", b"\1smregio1" + struct.pack("<II", 1, 1) + struct.pack("<Q", 200) + bytes(32) +
        struct.pack("<BBHIQIi4H2i", 3, 4, 0, 2, 96, 104, -1, 5, 7, 65535, 8, 100, 70000) + bytes(32))
    put("map_points", "far", tile[:200] + struct.pack("<4fHBB", 3e5, -2e4, 1e9, 0, 1, 0, 0) + tile[200:])
    history = b"".join(struct.pack("<III3bB", 0, 1, 0, 0, 0, 127, 200) for _ in range(30))
    # Scan 0: 5 kept; scan 1: 2 projected of object 1, 1 dropped.
    runs = [bytes([5, 5 << 3]), bytes([3, 2 << 3 | 2, 1, 1 << 3 | 4])]
    fates = b"smfates1" + b"".join(runs) + struct.pack("<QQQQ", 8, 8 + len(runs[0]), 8 + len(runs[0]) + len(runs[1]), 2)
    tum = "# stamp x y z qx qy qz qw\n1500000000.100000001 1 2 3 0 0 0.6 0.8\n1.5e9 1 1 1 0 0 0 1\n"
    good_tum = "1500000000.1 1 2 3 0 0 0.6 0.8\n1500000000.2 2 2 3 0 0 0 1\n"
    parts = [tile[:80], history[:64], good_tum.encode(), objects.encode(), fates]
    assert SEPARATOR not in b"".join(parts)
    put("package_files", "whole", SEPARATOR.join(parts))
    put("package_files", "empty", SEPARATOR.join([b"", b"", b"", b"{\"objects\": []}", b""]))
    put("boxes", "objects", objects)
    boxes = {"format": "stillmap-boxes", "version": 1, "scans": [{"scan": 3, "boxes": [
        {"centre": [1, 2, 3], "size": [4, 2, 1.5], "yaw": 0.5, "class": "car", "score": 1, "track": 3}]}]}
    put("boxes", "json", json.dumps(boxes))
    put("boxes", "kitti", "0 1 Car 0 0 -1.5 100 120 200 220 1.5 1.8 4.5 2.0 1.6 12.5 -1.57\n"
        "0 -1 DontCare -1 -1 -10 10 20 30 40 -1 -1 -1 -1000 -1000 -1000 -10\n1 1 Van 0 0 0 1 2 3 4 1 1 1 0 1 5 0 0.9\n")
    put("trajectory", "tum", good_tum)
    put("trajectory", "unordered", tum)
    put("trajectory", "kitti", "1 0 0 0 0 1 0 0 0 0 1 0\n0.8 -0.6 0 1.5 0.6 0.8 0 2e-1 0 0 1 -3\n")
    put("trajectory", "times", "0.0\n1.036000e-01\n0.2\n")
    put("trajectory", "csv", "timestamp_ns,x,y,z,qw,qx,qy,qz\n1700000000123456789,1,2,3,1,0,0,0\n")
    put("trajectory", "angles", "frame;x;y;z;roll_deg;pitch_deg;yaw_deg\n3;1;2;3;0;5;90\n")
    put("trajectory", "header_of_fewer", "# x y z roll pitch yaw\n1700000010 0 0 0 0 0 0\n")
    put("trajectory", "header_of_more", "# x y z qx qy qz qw\n1 2\n")
    put("trajectory", "units", "# time [s] tx [m] ty [m] tz [m] qw [-] qx [-] qy [-] qz [-]\n1 1 2 3 1 0 0 0\n")
    put("trajectory", "two_stamps", "header.stamp.sec,header.stamp.nanosec,x,y,z,qx,qy,qz,qw,note\n17,5,1,2,3,0,0,0,1,\n")
    put("trajectory", "kitti360", "7 1 0 0 0 0 1 0 0 0 0 1 0\n9 0.8 -0.6 0 1.5 0.6 0.8 0 2e-1 0 0 1 -3 0 0 0 1\n")
    put("trajectory", "g2o", "VERTEX_SE3:QUAT 0 1 2 3 0 0 0 1\nEDGE_SE3:QUAT 0 1 0 0 0 0 0 0 1\n")
    put("trajectory", "imu", "stamp_ns,wx,wy,wz,ax,ay,az\n1700000000000000000,0.1,-0.2,0.3,0,0,9.8\n"
        "1700000000010000000,0.1,-0.2,0.3,0,0,9.8\n")
    put("trajectory", "hdl", "stamp 1700000000 5\nestimate\n1 0 0 4\n0 1 0 5\n0 0 1 6\n0 0 0 1\nid 7\n")
    put("imu", "plain", "stamp_ns,wx,wy,wz,ax,ay,az\n1700000000123456789,0.1,-0.2,3e-1,0,0,9.8\n-5,0,0,0,0,0,1\n")
    put("imu", "other_order", "\ufeffaz,ay,ax,temperature,wz,wy,wx,stamp_ns\r\n9.8,0,0,40,nan,0,0,7\r\n\r\n1,0,0,40,0,0,0,8\r\n")
    put("trajectory", "nmea", "$GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,*47\n"
        "$GPRMC,123519,A,4807.038,N,01131.000,E,022.4,084.4,230394,003.1,W*6A\n")
    edits = {"format": "stillmap-edits", "version": 1, "edits": [
        {"action": "keep", "object": {"centre": [3, 4, 0.5], "class": "car"}, "note": "stands for years"},
        {"action": "remove", "box": {"centre": [-1.5, 2, 0], "size": [4, 2, 3], "yaw": 0.25}, "drive": "north",
         "scans": [120, 180]}]}
    put("edits", "both", json.dumps(edits))
    put("edits", "none", json.dumps({**edits, "edits": []}))
    put("graph", "small", json.dumps({"format": "stillmap-graph", "version": 1, "key_frames": [0, 2, 3],
                                      "loops": [{"from": 3, "to": 0, "weight": 0.75}]}))
    stamps = "2011-09-26 13:10:51.158069617\n2011-09-26 13:10:51.168069617\n"
    oxts = "49.015 8.434 116.4 0.03 0.01 -1.1 " + " ".join(["0.5"] * 19) + " 4 9 0 0 0\n"
    put("kitti_text", "oxts", stamps.encode() + SEPARATOR + oxts.encode())
    put("kitti_text", "imu", stamps.encode() + SEPARATOR +
        b"calib_time: 25-May-2012 16:47:16\nR: 1 0 0 0 1 0 0 0 1\nT: -0.8 0.3 -0.8\n")
    for name, x, y in (("utm", 353000.5, 4026586.25), ("local", 1.5, -2.5)):
        lines = "".join(f"{1561000444380857630 + i * 10**8},1,0,0,{x},0,1,0,{y + i},0,0,1,40\n" for i in range(4))
        put("mulran", name, b"1561000444390857630\n1561000444490857630\n" + SEPARATOR + lines.encode())
    put("kitti_text", "tracking", SEPARATOR + b"P2: 721.5377 0 609.5593 44.85728 0 721.5377 172.854 0.2163791 0 0 1 "
        b"0.002745884\nR_rect 1 0 0 0 1 0 0 0 1\nTr_velo_cam 0 -1 0 0 0 0 -1 -0.08 1 0 0 -0.27\n"
        b"S_rect_02: 1242 375\n")


def make_index(put):
    for name, first in (("looked_up", 0), ("damaged", 1), ("aligned", 2), ("searched", 4)):
        put("index", name, bytes([first]))
    # Into the header, the section table, and a voxel.
    put("index", "patched", b"\0" + bytes([8, 0, 0, 3]) + b"\x02\0\0\0" + bytes([200, 0, 0, 7]) + b"\xff" * 8)
    put("index", "voxel", b"\2" + bytes([0, 0, 1, 3]) + struct.pack("<f", math.nan))


def network():
    """The least network: @return its config and its tensors' shapes"""
    config = {"name": "a", "range_m": [-1, -1, -1, 1, 1, 1], "voxel_m": [0.1, 0.1, 0.1], "z": "ground", "sensor_height_m": 0,
              "features": ["x"], "stages": [{"channels": 1, "blocks": 0, "kernel": 1}] * 6, "pruning": [0] * 5,
              "neck_channels": 1, "head_kernel": 1, "heads": [{"classes": ["car"]}], "yaw": "axis",
              "branches": ["hm", "center", "center_z", "dim", "rot"], "iou_rectifier": [0], "calibration": [[1, 0]],
              "nms": "fitted", "nms_iou": 0.2, "score_threshold": 0.2}
    layers = {"input": (27, 1, 1), **{f"stage{i}.down": (1, 1, 1) for i in range(2, 7)}, "neck.out": (9, 1, 1),
              "neck.shared": (9, 1, 1)}
    for branch, out in (("hm", 1), ("center", 2), ("center_z", 1), ("dim", 3), ("rot", 2)):
        layers |= {f"head0.{branch}.0": (1, 1, 1), f"head0.{branch}.1": (1, 1, out)}
    return config, layers


def safetensors(config, layers, kind="F16"):
    header, data, size = {"__metadata__": {"format": "stillmap-voxelnext", "version": "1",
                                           "config": json.dumps(config, separators=(",", ":"))}}, b"", {"F16": 2, "F32": 4}[kind]
    for name, shape in layers.items():
        for tensor, sizes in ((f"{name}.weight", shape), (f"{name}.bias", shape[-1:])):
            numbers = struct.pack(f"<{math.prod(sizes)}{'e' if size == 2 else 'f'}", *([0.5] * math.prod(sizes)))
            header[tensor] = {"dtype": kind, "shape": sizes, "data_offsets": [len(data), len(data) + len(numbers)]}
            data += numbers
    text = json.dumps(header, separators=(",", ":")).encode()
    return struct.pack("<Q", len(text)) + text + data


def make_weights(put):
    config, layers = network()
    whole = safetensors(config, layers)
    assert len(whole) <= LONGEST_INPUT
    put("voxelnext_weights", "whole", whole)
    put("voxelnext_weights", "file", safetensors(config, {"input": (2, 2, 1)}, "F32"))
    put("voxelnext_weights", "header", safetensors({"name": "a"}, {"input": (2, 2, 1)}, "F32")[8:-20])
    put("voxelnext_weights", "config", json.dumps(config))


def las(minor, point_format, point_bytes, records, wkt_bit=0):
    header_bytes = {2: 227, 3: 235, 4: 375}[minor]
    body = b"".join(struct.pack("<H16sHH32s", 0, b"LASF_Projection", number, len(content), b"") + content
                    for number, content in records)
    points = b"".join(struct.pack("<3iHBBB", *[int(1000 * c) for c in p[:3]], 7, 0x11, 0, 2).ljust(point_bytes, b"\0")
                      for p in POINTS)
    head = bytearray(header_bytes)
    struct.pack_into("<4sHH16sBB", head, 0, b"LASF", 0, wkt_bit, b"", 1, minor)
    struct.pack_into("<HIIBHI", head, 94, header_bytes, header_bytes + len(body), len(records), point_format, point_bytes,
                     len(POINTS) if minor < 4 else 0)
    struct.pack_into("<6d", head, 131, 0.001, 0.001, 0.001, 448000, 5427000, 100)
    if minor == 4:
        struct.pack_into("<QIQ", head, 235, 0, 0, len(POINTS))
    return bytes(head) + body + points


def defaults_of(schema):
    """An object of this JSON schema, with the default of each of its members."""
    if "properties" in schema:
        return {name: defaults_of(each) for name, each in schema["properties"].items()}
    return schema["default"]


def make_config(put):
    put("config", "whole", json.dumps(defaults_of(json.loads(CONFIG_SCHEMA.read_text()))))
    put("config", "usual", '// a comment\n{"host": "127.0.0.1", "port": 8080, "workers": 2, "log": {"format": "json", "requests": false}}\n')
    put("config", "numbers", '{"gate": {"min_coverage": 0.5, "max_new_lost": 1e2}, "uploads": {"max_package_bytes": 1e9}, '
        '"rate": {"requests_per_s": 1.5}}')
    put("config", "wrong", '{"prot": 1, "port": "x", "jobs": {"nice": 20, "nice": [{}]}, "log": null, "log.level": 1, '
        '"tls": {"a": {"b": 1}}}')


def make_las(put):
    keys = struct.pack("<12H", 1, 1, 0, 2, 1024, 0, 1, 1, 3072, 0, 1, 32632)
    wkt = b'PROJCS["WGS 84 / UTM zone 32N",GEOGCS["WGS 84"],UNIT["metre",1],AUTHORITY["EPSG","32632"]]\0'
    put("las", "geo_keys", las(2, 0, 20, [(34735, keys)]))
    put("las", "format_3", las(3, 3, 36, []))
    put("las", "wkt", las(4, 6, 30, [(2112, wkt)], 16))


def of_all_targets():
    """@return for each target the content of each seed by its name"""
    seeds = collections.defaultdict(dict)

    def put(target, name, content):
        seeds[target][f"seed_{name}"] = content.encode() if isinstance(content, str) else content

    for make in (make_config, make_las, make_scans, make_requests, make_seals, make_http, make_heads, make_request_json, make_packages,
                 make_index, make_weights, bag_seeds.make_all, archive_seeds.make_all):
        make(put)
    for file in CORPUS.glob("*/*"):
        seeds[file.parent.name][file.name] = file.read_bytes()
    return seeds


def main():
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    for target, of_target in of_all_targets().items():
        folder = pathlib.Path(sys.argv[1]) / target
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        for name, content in of_target.items():
            (folder / name).write_bytes(content)


if __name__ == "__main__":
    main()
