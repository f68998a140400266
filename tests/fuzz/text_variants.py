"""Text of the same words with other numbers. For variants.py."""

import math
import random
import re

DRAWS = 2000
NUMBER = re.compile(rb"(?<![\w.])[-+]?\d+\.?\d*(?:[eE][-+]?\d+)?(?![\w.])")
ODD = [b"nan", b"-inf", b"1e308", b"1e-320", b"-0", b"0", b"1e39", b"9223372036854775808", b"-1", b"4294967296", b"007", b"1e9"]


def rotation(rng):
    """@return a unit quaternion x y z w and its matrix by rows"""
    parts = [rng.gauss(0, 1) for _ in range(4)]
    x, y, z, w = (each / math.hypot(*parts) for each in parts)
    rows = [[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]]
    return [x, y, z, w], rows


def drawn_number(rng, old):
    value = float(old)
    if rng.random() < 0.05 or math.isinf(value):
        return rng.choice(ODD)
    if b"." in old or rng.random() < 0.3:
        near = (value + rng.gauss(0, 1), value * (1 + rng.gauss(0, 1e-9)), round(value, 1))
        return repr(rng.choice((*near, rng.gauss(0, 100)))).encode()
    return str(round(rng.choice((value + rng.randrange(-3, 4), rng.gauss(0, 1000), rng.randrange(10))))).encode()


def drawn_line(rng, line):
    """Poses, a line of 8 or 12 numbers and maybe a stamp before the 12, keep a rotation: any other is refused."""
    numbers = [match.span() for match in NUMBER.finditer(line)]
    new = [drawn_number(rng, line[a:b]) if rng.random() < 0.4 else line[a:b] for a, b in numbers]
    if rng.random() < 0.9:
        quaternion, rows = rotation(rng)
        if len(new) == 8:
            new[4:] = [repr(each).encode() for each in quaternion]
        elif len(new) in (12, 13):
            for row in range(3):
                at = len(new) - 12 + 4 * row
                new[at:at + 3] = [repr(each).encode() for each in rows[row]]
    for (a, b), text in reversed(list(zip(numbers, new))):
        line = line[:a] + text + line[b:]
    return line


def drawn_anew(seed):
    if not NUMBER.search(seed):
        return
    rng = random.Random(1)
    lines = re.split(rb"([\n\x1e])", seed)
    for _ in range(DRAWS):
        drawn = [drawn_line(rng, line) for line in lines]
        if rng.random() < 0.3:  # a line twice, or not at all
            at = 2 * rng.randrange((len(drawn) + 1) // 2)
            drawn[at:at + 2] = drawn[at:at + 2] * rng.choice((0, 2))
        yield b"".join(drawn)
