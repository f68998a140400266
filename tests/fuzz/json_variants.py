"""Variants of a JSON text: each of its values by each awkward one, members and elements left out, twice, renamed, and all
of its numbers drawn anew. For variants.py."""

import copy
import hashlib
import itertools
import json
import math
import random

DRAWS = 3000  # of all numbers of a text

NUMBERS = """0 -0 1 -1 2 3 4 5 7 10 99 100 255 256 1000 1001 4096 65535 65536 0.5 -0.5 1.5 0.00001 1e5 1E+5 1e-5 1e6 1e8 1e15 1e16
  1e17 1e21 1e22 1e23 1e39 1e308 -1e308 1.7976931348623157e308 1.7976931348623159e308 1e309 1e400 -1e400 1e6000000000 1e-308
  5e-324 2.4703282292062327e-324 1e-400 1e-99999999999 2.2250738585072011e-308 2.2250738585072014e-308 3.4028235e38 3.5e38
  2147483647 2147483648 -2147483648 -2147483649 4294967295 4294967296 9007199254740993 9007199254740993.0
  1125899906842624 1125899906842625 9223372036854775807 9223372036854775808 -9223372036854775808 -9223372036854775809
  18446744073709551615 18446744073709551616 123456789012345678901234567890 1.00000000000000000000000000000000000001
  0.1234567890123456789012345678901234567890 01 1. .5 1e 1e+ 1e- 0x1 +1 - -- -a 1a 1.a 0e0 0e NaN Infinity
  3.141592653589793 90 90.1 180 -180 180.1 360 600000 600001 0.6 0.8""".split()
OTHERS = """null true false nul nulll True [] {} [[]] [{}] [null] [true] [1e999] [0] [0,0] [0,0,0] [1,2,3] [1,2,3,4] [0,0,0,1]
  [0,0,0,0] [1,2,"a"] [1,2,3,4,5,6] [1,] [,1] {"a":1} {"a"} {"a":} {"a":1,} {,} {1:2}""".split() + ["[1 2]", "[ ]", "{ }"]
# What JSON's grammar and UTF-8 tell apart in a string; latin-1 stands for bytes.
STRINGS = [f'"{text}"' for text in [
    "", "a", "1", "-1", "00", "+1", " 1", "1 ", "1.5", "1e3", "9223372036854775807", "9223372036854775808",
    "-9223372036854775809", "99999999999999999999999", r"\u0000", r"a\u0000b", r"\u0041", r"\u00e9", r"\u20ac",
    r"\ud83d\ude00", r"\ud83d", r"\ude00", r"\ud83d\u0041", r"\ud83dx", r"\ud83d\n", r"\uZZZZ", r"\u12", r"\uABCD", r"\x",
    r"\"\\\/\b\f\n\r\t", "\t", "\n", "\0", "\x01\x1f", "\x7f", "\xc3\xa9", "\xe2\x82\xac", "\xf0\x9f\x98\x80",
    "\xe0\xa0\x80", "\xed\x9f\xbf", "\xee\x80\x80", "\xf1\x80\x80\x80", "\xf4\x8f\xbf\xbf", "\xc0\x80", "\xc3(", "\xe0\x80\x80",
    "\xe2(", "\xe2\x82(", "\xed\xa0\x80", "\xed(", "\xee(", "\xee\x80(", "\xf0\x80\x80\x80", "\xf0\x9f(", "\xf0\x9f\x98(",
    "\xf1(", "\xf1\x80(", "\xf1\x80\x80(", "\xf4\x90\x80\x80", "\xf4\x80(", "\xf4\x80\x80(", "\xf8", "\xff", "\x80",
    "x" * 15, "x" * 16, "x" * 64, "x" * 300, "x" * 3000, "ab/" * 100, "../a", "/a", "a/../b", "a//b", "./a", "a/", ".", "..",
    "<>&", hashlib.sha256(b"").hexdigest(), hashlib.sha256(b"").hexdigest().upper()]] + ['"', r'"\"', '"\xc3', '"\xe2\x82']
DEEP = [form * n + "1" * closed + end * n * closed for form, end in (("[", "]"), ('{"a":', "}"))
        for n in (10, 33, 65, 130, 600) for closed in (0, 1)]
MANY = ["[" + ",".join([each] * n) + "]" for each in ("0", "[0,0,0]") for n in (36, 37, 100, 257, 1001)]
MANY += ["{" + ",".join(f'"k{i}":0' for i in range(n)) + "}" for n in (10, 65, 300)]
VALUES = NUMBERS + OTHERS + STRINGS + DEEP + MANY


class Text(str):
    """JSON that is written as it stands."""


class Members(list):
    """Pairs, so that a key may come twice."""


def json_of(value):
    if isinstance(value, Text):
        return str(value)
    if isinstance(value, dict):
        value = Members(value.items())
    if isinstance(value, Members):
        return "{" + ",".join(f"{json_of(key)}:{json_of(each)}" for key, each in value) + "}"
    if isinstance(value, list):
        return "[" + ",".join(map(json_of, value)) + "]"
    return json.dumps(value)


def places(value, path=()):
    """Not all of what is long: its members are of one kind."""
    yield path
    inside = itertools.islice(value.items(), 20) if isinstance(value, dict) else ()
    if isinstance(value, list):
        inside = enumerate(value[:4])
    for key, each in inside:
        yield from places(each, (*path, key))


def with_at(value, path, new):
    if not path:
        return new
    value = copy.copy(value)
    value[path[0]] = with_at(value[path[0]], path[1:], new)
    return value


def variants_of_members(members):
    for i, (key, value) in enumerate(members):
        before, after = members[:i], members[i + 1:]
        yield before + after
        yield [*members, (key, value)]
        for other in (key + "x", "", Text(r'"\u0000"')):
            yield [*before, (other, value), *after]
    for text in STRINGS:
        yield [*members, (Text(text), 1)]
    yield members[::-1]


def variants_of_elements(elements):
    yield elements[:-1]
    yield elements[1:]
    yield elements[::-1]
    for times in (2, 3, 5, 10):
        yield elements * times
    for text in NUMBERS + OTHERS:
        yield [*elements, Text(text)]
        yield [Text(text)] * len(elements)


def changed(document):
    for path in places(document):
        value = document
        for key in path:
            value = value[key]
        others = map(Text, VALUES)
        if isinstance(value, dict):
            others = itertools.chain(others, map(Members, variants_of_members(list(value.items()))))
        elif isinstance(value, list):
            others = itertools.chain(others, variants_of_elements(value))
        for other in others:
            yield json_of(with_at(document, path, other)).encode("latin-1", "replace")


def is_number(value):
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def drawn(value, rng, scale, key=""):
    """`value` with other numbers. Rotations and covariances stay such, else hardly one in a million would be taken."""
    if isinstance(value, dict):
        return {name: drawn(each, rng, scale, name) for name, each in value.items()}
    if isinstance(value, list) and len(value) == 36 and key == "covariance":
        columns = [[rng.gauss(0, scale ** rng.choice((0, 1))) for _ in range(6)] for _ in range(rng.choice((3, 6, 6)))]
        floor = rng.choice((0, 1e-6, 0.1))
        return [sum(c[i] * c[j] for c in columns) + floor * (i == j) for i in range(6) for j in range(6)]
    if isinstance(value, list) and len(value) == 4 and key == "quaternion":
        # Next to none, half a turn about any axis, anything.
        size, w = rng.choice(((10 ** rng.uniform(-9, 0), 1), (1, 0), (1, rng.gauss(0, 0.1)), (1, rng.gauss(0, 1))))
        parts = [rng.gauss(0, size) * rng.choice((1, 1, 1e-6)) for _ in range(3)] + [w]
        return [each / math.hypot(*parts) for each in parts]
    if isinstance(value, list):
        return [drawn(each, rng, scale) for each in value]
    if not is_number(value) or rng.random() < 0.3:
        return value
    if isinstance(value, int):
        return rng.choice((rng.randrange(4), rng.randrange(1000), round(rng.gauss(0, scale))))
    return rng.choice((rng.gauss(0, scale), rng.uniform(0, 1), round(rng.gauss(0, scale), 2), -0.0))


def thinned(value, rng, share=0.15):
    """Without some members, since some exclude each other."""
    if isinstance(value, dict):
        return {name: thinned(each, rng, share) for name, each in value.items() if rng.random() > share}
    return [thinned(each, rng, share) for each in value] if isinstance(value, list) else value


def drawn_anew(document):
    rng = random.Random(1)
    for _ in range(DRAWS):
        left = thinned(document, rng) if rng.random() < 0.4 else document
        yield json_of(drawn(left, rng, 10 ** rng.uniform(-6, 9))).encode()
