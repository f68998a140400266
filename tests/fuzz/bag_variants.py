"""Bags drawn at random whose messages can mostly be read: what frames, topics, times and columns mean is told apart only
behind readers that hardly any changed byte gets through. Those that open as no drive are refused for what they mean. For
variants.py."""

import math
import random
import sqlite3
import struct
import zlib

import bag_seeds as bags

DRAWS = 4000
FRAMES = ["lidar", "/lidar", "base_link", "odom", "map", "world", "earth", "utm", "robot/map", "camera", "", "x" * 70]
COLUMNS = ["x", "y", "z", "intensity", "reflectivity", "t", "time", "timestamp", "time_stamp", "ring", "rgb", "X", "_", ""]
SIZES = {1: "b", 2: "B", 3: "h", 4: "H", 5: "i", 6: "I", 7: "f", 8: "d"}


def rarely(rng, usual, others, share=0.04):
    return rng.choice(others) if rng.random() < share else usual


def drawn_columns(rng):
    """@return (name, datatype, count)"""
    axis = rng.choice((7, 7, 7, 8, 5, 3))
    columns = [(name, rarely(rng, axis, (0, 1, 6, 9, 255)), rarely(rng, 1, (0, 2))) for name in "xyz"]
    columns += [(name, rng.choice(range(1, 9)), rarely(rng, 1, (0, 3))) for name in rng.sample(COLUMNS, rng.randrange(5))]
    if rng.random() < 0.1:
        rng.shuffle(columns)
    return rarely(rng, columns, (columns[1:], [], columns * 2))


def drawn_number(rng, kind, name, stamp_s):
    if kind in "fd":
        time = name.startswith("t") and (stamp_s + rng.random() * 0.1, 1e9 * stamp_s, 1e6 * stamp_s, rng.random() * 0.1)
        usual = rng.choice(time) if time else rng.gauss(0, 20)
        return rarely(rng, usual, (math.nan, math.inf, 0.0, 1e30, -3e38, 1e-30))
    low, high = (-(1 << 8 * struct.calcsize(kind) - 1), (1 << 8 * struct.calcsize(kind) - 1) - 1) if kind.islower() else (
        0, (1 << 8 * struct.calcsize(kind)) - 1)
    return rarely(rng, rng.randrange(max(low, -100), min(high, 10**8)), (low, high, 0))


def drawn_header(rng, message, tenths, frame):
    if message.ros1:
        message.put("I", 7)
    seconds = rarely(rng, bags.START_S + tenths // 10, (0, 1, -1, 2**31 - 1, -2**31) if not message.ros1 else (0, 2**32 - 1))
    return message.put("I" if message.ros1 else "i", seconds).put(
        "I", rarely(rng, tenths % 10 * 100_000_000, (0, 999_999_999, 2**32 - 1))).text(frame)


def drawn_cloud(rng, tenths, order, ros1, frame, columns):
    message = drawn_header(rng, bags.Message(order, ros1), tenths, frame)
    height, width = rng.choice(((1, 3), (1, 3), (2, 2), (3, 1), (1, 0), (1, 20)))
    offsets, step = [], 0
    for _, kind, count in columns:
        size = struct.calcsize(SIZES.get(kind, "f"))
        offsets.append(step)
        step += size * max(1, count)
    step += rng.choice((0, 0, 4))
    row_step = width * step + rarely(rng, 0, (8, -1), 0.1) if width * step else 0
    message.put("I", rarely(rng, height, (0, 2**32 - 1))).put("I", rarely(rng, width, (0, 2**16, 2**32 - 1)))
    message.put("I", len(columns))
    for (name, kind, count), offset in zip(columns, offsets):
        message.text(name).put("I", rarely(rng, offset, (step, 2**32 - 1), 0.01)).put("B", kind).put("I", count)
    big = rng.random() < 0.2
    points = bytearray(max(0, height * row_step))
    for i in range(height * width):
        for (name, kind, _), offset in zip(columns, offsets):
            letter = SIZES.get(kind, "f")
            at = i // width * row_step + i % width * step + offset
            if at + struct.calcsize(letter) <= len(points):
                struct.pack_into((">" if big else "<") + letter, points, at,
                                 drawn_number(rng, letter, name, bags.START_S + tenths // 10))
    message.put("B", big).put("I", rarely(rng, step, (0, 2**32 - 1))).put("I", rarely(rng, row_step, (0, 1)))
    message.put("I", rarely(rng, len(points), (len(points) + 1, 2**32 - 1), 0.01)).bytes += points
    return message.put("B", 1).bytes


def put_rigid(rng, message, place=None):
    parts = [rng.gauss(0, 1) * rng.choice((1e-9, 1e-3, 1)) for _ in range(3)] + [1.0]
    length = math.hypot(*parts) * rarely(rng, 1, (0.999, 1.1, 1e-300))
    place = place or [rarely(rng, rng.gauss(0, 5), (math.nan, 1e9, -1e300, 0.0), 0.02) for _ in range(3)]
    return message.put("d", *place, *[each / length for each in parts])


def drawn_pose(rng, tenths, order, ros1, frames, odometry, place=None):
    message = drawn_header(rng, bags.Message(order, ros1), tenths, frames[0])
    if odometry:
        message.text(frames[1])
    # The covariances and the twist behind it are not read.
    return put_rigid(rng, message, place).bytes


def drawn_fix(rng, tenths, order, ros1, frame, east_m):
    message = drawn_header(rng, bags.Message(order, ros1), tenths, frame)
    message.put("b", rarely(rng, 0, (-1, 2, -128))).put("H", 1)
    place = (48.1, 11.5 + east_m / 74_300, 519.0)
    message.put("d", *[rarely(rng, each, (math.nan, math.inf, -91.0, 1e300, 0.0), 0.02) for each in place])
    return message.put("d", *[0.0] * 9).put("B", rng.randrange(4)).bytes


def drawn_tf(rng, tenths, ros1, pairs):
    message = bags.Message(ros1=ros1).put("I", rarely(rng, len(pairs), (0, 9, 2**32 - 1), 0.02))
    for parent, child in pairs:
        put_rigid(rng, drawn_header(rng, message, tenths, parent).text(child))
    return message.bytes


def drawn_chain(rng):
    """@return (parent, child) of many frames, mostly one above the other, and the sensor below"""
    frames = [rng.choice(("map", "odom", "a")), *[f"f{i}" for i in range(rng.randrange(2, 8))], "lidar"]
    return [(frames[rarely(rng, i, range(i + 1), 0.15)], frames[i + 1]) for i in range(len(frames) - 1)]


def drawn_others(rng, kinds, order, ros1, columns):
    """Topics that a drive does not need, some of them by a name that others have too."""
    for _ in range(rng.randrange(2, 12)):
        topic, tenths, frames = f"/{rng.randrange(20)}", rng.randrange(9), rng.choices(FRAMES, k=2)
        bodies = {0: lambda: drawn_cloud(rng, tenths, order, ros1, frames[0], columns),
                  1: lambda: drawn_pose(rng, tenths, order, ros1, frames, True),
                  2: lambda: drawn_pose(rng, tenths, order, ros1, frames, False),
                  3: lambda: drawn_tf(rng, tenths, ros1, [frames]),
                  4: lambda: drawn_fix(rng, tenths, order, ros1, frames[0], 0.0)}
        kind = rng.choice(list(bodies))
        yield topic, kinds[kind], bodies[kind]()


def drawn_messages(rng, ros1):
    kinds = [kind.replace("/msg/", "/") if ros1 else kind for kind in bags.KINDS]
    order = rarely(rng, "<", (">",), 0.1) if not ros1 else "<"
    frame, columns = rarely(rng, "lidar", FRAMES, 0.2), drawn_columns(rng)
    pairs = [(rng.choice(FRAMES), rng.choice(FRAMES)) for _ in range(rng.randrange(3))]
    odometry = [rarely(rng, usual, FRAMES, 0.2) for usual in ("odom", "base_link")]
    has = {name: rng.random() < share
           for name, share in (("rigid", 0.7), ("odom", 0.5), ("pose", 0.2), ("tf", 0.5), ("two", 0.15), ("fix", 0.15),
                               ("chain", 0.2), ("others", 0.2))}
    if has["fix"]:
        has |= {"rigid": False, "odom": False, "tf": False, "pose": True}
    long_chain = drawn_chain(rng)
    split = rng.randrange(len(long_chain) + 1)
    messages = list(drawn_others(rng, kinds, order, ros1, columns)) if has["others"] else []
    if has["rigid"]:
        rigid = long_chain[split:] if has["chain"] else [("base_link", "lidar"), *pairs[:1]]
        messages.append(("/tf_static", kinds[3], drawn_tf(rng, 0, ros1, rigid)))
    for scan in range(rng.choice((3, 4)) if has["fix"] else rng.choice((1, 2, 3, 6))):
        tenths = rarely(rng, scan, (0, scan + 40, 7), 0.1)
        messages.append(("/points", kinds[0], drawn_cloud(rng, tenths, order, ros1, frame, columns)))
        if has["two"]:
            messages.append(("/other", kinds[rarely(rng, 0, (1, 3))],
                             drawn_cloud(rng, tenths, order, ros1, rng.choice(FRAMES), columns)))
        if has["odom"]:
            messages.append(("/odom", kinds[1], drawn_pose(rng, tenths, order, ros1, odometry, True)))
        if has["pose"]:
            place = [20.0 * scan, 1, 2] if has["fix"] else None
            messages.append(("/pose", kinds[2], drawn_pose(rng, tenths, order, ros1, odometry, False, place)))
        for _ in range(4 if has["fix"] else 0):
            antenna = rng.choice(("lidar", "gps"))
            messages.append((bags.FIXES, kinds[4], drawn_fix(rng, tenths, order, ros1, antenna, 20.0 * scan)))
        if has["tf"]:
            chain = rng.choice(([("map", "base_link")], [("map", "odom"), ("odom", "base_link")], [("odom", "lidar")],
                                [("earth", "map"), ("map", "base_link")], pairs))
            messages.append(("/tf", kinds[3], drawn_tf(rng, tenths, ros1, long_chain[:split] if has["chain"] else chain)))
    if rng.random() < 0.2:
        rng.shuffle(messages)
    return messages


def drawn_records(rng, messages, encoding):
    """@return those of MCAP without magic bytes and index, each channel told before its first message, mostly"""
    topics = sorted({(topic, kind) for topic, kind, _ in messages})
    channels = dict(zip(topics, rng.sample(range(1, 300), len(topics))))
    one_schema_a_kind, told, records = rng.random() < 0.5, set(), []

    def tell(topic, channel):
        schema = 1 + bags.KINDS.index(topic[1]) if one_schema_a_kind and topic[1] in bags.KINDS else channel
        schema = rarely(rng, schema, (0, 500), 0.02)
        if rng.random() < 0.97:
            records.append(bags.record(3, struct.pack("<H", schema) + bags.text(topic[1]) + bags.text("ros2msg") + bags.text("")))
        values = rarely(rng, bags.text(""), (bags.text("x" * 9), b"", struct.pack("<I", 99)), 0.05)
        records.append(bags.record(4, struct.pack("<HH", channel, schema) + bags.text(topic[0]) + bags.text(encoding) + values))

    if rng.random() < 0.5:
        for topic, channel in channels.items():
            told.add(channel)
            tell(topic, channel)
    for topic, kind, body in messages:
        channel = channels[topic, kind]
        if channel not in told or rng.random() < 0.03:
            told.add(channel)
            tell((topic, kind), channel)
        channel = rarely(rng, channel, (*channels.values(), 700), 0.03)
        if rng.random() < 0.03:  # the same topic by another channel
            channels[topic, kind] = rng.randrange(300, 600)
        records.append(bags.record(5, struct.pack("<HIQQ", channel, 0, 1, 1) + rarely(rng, body, (body[:9], b""), 0.02)))
        if rng.random() < 0.05:  # an attachment, metadata, an index of messages, private
            records.append(bags.record(rng.choice((9, 12, 7, 0x80, 0)), bytes(rng.randrange(30))))
    return records, len(channels)


def drawn_mcap(rng, messages, encoding):
    """Records in chunks of any number and beside them; an index that may not tell all."""
    records, channels = drawn_records(rng, messages, encoding)
    file, indexes, loose = b"\x89MCAP0\r\n" + bags.record(1, bags.text("ros2") + bags.text("")), [], rng.random() * 0.3
    while records:
        count = rng.choice((1, 2, 5, 20, 100))
        part, records = b"".join(records[:count]), records[count:]
        if rng.random() < loose:
            file += part
            continue
        compression = rng.choice(("lz4", "zstd")) if rng.random() < 0.02 else ""
        body = bags.packed(part, compression)
        size = rarely(rng, len(part), (0, len(part) - 1, len(part) + 1, 2**40), 0.02)
        chunk = bags.record(6, struct.pack("<QQQI", 1, 1, size, rarely(rng, zlib.crc32(part), (0, 0, 1), 0.2)) +
                            bags.text(rarely(rng, compression, ("zstd", "x"), 0.01)) + struct.pack("<Q", len(body)) + body)
        at = rarely(rng, len(file), (0, len(file) + 1), 0.01)
        channel_bytes = rarely(rng, 0, (10, 99), 0.05)
        indexes.append(bags.record(8, struct.pack("<QQQQIQ", 1, 1, at, len(chunk), channel_bytes, 0) + bags.text(compression) +
                                   struct.pack("<QQ", len(body), size)))
        file += chunk
    file += bags.record(15, bytes(4))
    names = [] if rng.random() < 0.2 else drawn_records(rng, messages, encoding)[0]
    names = [each for each in names if each[0] in (3, 4)]
    indexes = rarely(rng, indexes, (indexes[1:], indexes * 2, indexes[::-1], []), 0.15)
    statistics = struct.pack("<QHIIIIQQ", len(messages), channels, rarely(rng, channels, (0, 9), 0.1), 0, 0,
                             rarely(rng, len(indexes), (0, 9), 0.1), 1, 1) + bytes(4)
    summary = b"".join(names + indexes + [bags.record(11, statistics)] * (rng.random() < 0.5))
    footer = struct.pack("<BQQQ", 2, 20, len(file) if rng.random() < 0.8 else 0, 0)
    crc = rarely(rng, zlib.crc32(summary + footer), (0, 1), 0.2)
    return file + summary + footer + struct.pack("<I", crc) + b"\x89MCAP0\r\n"


def mcap_bags():
    rng = random.Random(1)
    for _ in range(DRAWS):
        yield drawn_mcap(rng, drawn_messages(rng, False), rarely(rng, "cdr", ("", "json")))
        ros1 = rng.random() < 0.15
        chunks = rng.random() < 0.5
        # Packed by the tools is a process each.
        compression = rng.choice(("lz4", "zstd")) if chunks and rng.random() < 0.05 else None
        yield bags.mcap(drawn_messages(rng, ros1), compression, chunks and rng.random() < 0.7, chunks,
                        rarely(rng, "ros1" if ros1 else "cdr", ("", "json", "cdr")))


def drawn_rosbag2(rng, messages):
    """Tables of every schema, some of which hold or are something else."""
    topics = sorted({(topic, kind) for topic, kind, _ in messages})
    ids = dict(zip(topics, rng.sample(range(1, 99), len(topics))))
    columns = rarely(rng, "id INTEGER PRIMARY KEY, name, type, serialization_format", (
        "id, name, type, serialization_format, offered_qos_profiles", "id INTEGER PRIMARY KEY, name, type",
        "serialization_format, type, name, id INTEGER PRIMARY KEY, type_description_hash",
        "id INTEGER PRIMARY KEY, name, type, serialization_format AS (type)",
        "id INTEGER PRIMARY KEY, name, type, serialization_format) WITHOUT ROWID; --"), 0.1)
    bag = sqlite3.connect(":memory:")
    bag.executescript(f"PRAGMA page_size={rarely(rng, 512, (1024,), 0.2)}; CREATE TABLE topics({columns});\n"
                      "CREATE TABLE rows(id INTEGER PRIMARY KEY, topic_id, timestamp, data);")
    version = rarely(rng, rng.randrange(1, 5), (0, 5, -1, "four", None), 0.2)
    if rng.random() < 0.3:
        bag.execute("CREATE TABLE schema(schema_version, ros_distro)")
        bag.executemany("INSERT INTO schema VALUES (?, 'a')", [(version,)] * rng.randrange(3))
    for (name, kind), number in ids.items():
        usual = (number, name, kind, rarely(rng, "cdr", ("", "cbor")))
        kept = rarely(rng, usual, ((number, None, 7, b"cdr"), (None, name, "x" * 1025, "")))
        if "serialization_format" in columns and " AS " not in columns:
            bag.execute("INSERT OR IGNORE INTO topics (id, name, type, serialization_format) VALUES (?, ?, ?, ?)", kept)
        else:
            bag.execute("INSERT OR IGNORE INTO topics (id, name, type) VALUES (?, ?, ?)", kept[:3])
    row = rng.choice((1, -5, 10**12))
    for topic, kind, body in messages:
        body = bags.packed(body, "zstd") if rng.random() < 0.02 else body
        body = rarely(rng, body, (None, 7, "text", b"", body[:9], b"\x28\xb5\x2f\xfd", b"\x28\xb5\x2f\xfdxxx"), 0.03)
        bag.execute("INSERT INTO rows VALUES (?, ?, 1, ?)", (row, rarely(rng, ids[topic, kind], (None, "x", 100), 0.02), body))
        row += rarely(rng, 1, (2, 1000), 0.1)
    bag.execute(rarely(rng, "ALTER TABLE rows RENAME TO messages", ("CREATE VIEW messages AS SELECT * FROM rows",)))
    if rng.random() < 0.03:
        bag.execute("DELETE FROM topics WHERE id % 2")
    bag.commit()
    file = bag.serialize()
    bag.close()
    return rarely(rng, file, (file[:rng.randrange(len(file))],), 0.03)


def rosbag2_files():
    rng = random.Random(2)
    for _ in range(DRAWS):
        yield drawn_rosbag2(rng, drawn_messages(rng, False))


def ros_messages():
    """As ros_message.cpp has them: the first byte's lowest bit says ROS 1, the others what it is."""
    rng = random.Random(3)
    for _ in range(5 * DRAWS):
        ros1, order = rng.random() < 0.3, rng.choice("<<>")
        order = "<" if ros1 else order
        kind, frames = rng.randrange(5), rng.choices(FRAMES, k=2)
        if kind == 0:
            body = drawn_cloud(rng, rng.randrange(30), order, ros1, frames[0], drawn_columns(rng))
        elif kind == 3:
            body = drawn_tf(rng, rng.randrange(30), ros1, [rng.choices(FRAMES, k=2) for _ in range(rng.randrange(4))])
        elif kind == 4:
            body = drawn_fix(rng, rng.randrange(30), order, ros1, frames[0], rng.gauss(0, 100))
        else:
            body = drawn_pose(rng, rng.randrange(30), order, ros1, frames, kind == 1)
        yield bytes([kind << 1 | ros1]) + body


DRAWN = {"mcap": mcap_bags, "ros_message": ros_messages}
