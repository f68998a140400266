"""Requests in JSON drawn at random, several of whose members are others, awkward or left out at once: what is refused for one
of two reasons, names of all lengths and letters, words of other members. For variants.py."""

import json
import pathlib
import random
import re

import json_variants
import seeds

HERE = pathlib.Path(__file__).resolve().parent
DRAWS = 40_000
LETTERS, OTHERS = "az09-_.", "AZ/ ~`{@[:\x7f\x1f\xe9"
LENGTHS = (1, 2, 3, 4, 5, 6, 7, 8, 9, 12, 16, 62, 63, 64, 65, 100, 101, 200, 201)


def words():
    text = (HERE / "request_json.dict").read_text()
    return [each for each in re.findall(r'"\\"(.*)\\""', text) if "\\" not in each]


def drawn_name(rng):
    letters = [rng.choice(LETTERS) for _ in range(rng.choice(LENGTHS))]
    letters[0] = rng.choice("az09")
    if rng.random() < 0.6:
        letters[rng.randrange(len(letters))] = rng.choice(OTHERS)
    return "".join(letters)


def changed(value, rng, known):
    if isinstance(value, dict):
        members = {key: changed(each, rng, known) for key, each in value.items()}
        return members | ({rng.choice(known): 1} if rng.random() < 0.03 else {})
    if isinstance(value, list):
        elements = [changed(each, rng, known) for each in value]
        draw = rng.random()
        if draw < 0.1:
            return rng.sample(elements, rng.randint(0, len(elements)))
        if draw < 0.15:
            return elements + [rng.choice([*elements, "x", None, 1]) for _ in range(rng.choice((1, 5, 100)))]
        return elements
    if isinstance(value, str) and rng.random() < 0.4:
        return rng.choice((drawn_name(rng), rng.choice(known)))
    return value


def requests():
    rng, known = random.Random(1), words()
    for _ in range(DRAWS):
        seed = rng.choice(seeds.of("request_json"))
        left = json_variants.thinned(json.loads(seed[1:]), rng, rng.choice((0, 0.1, 0.2, 0.4)))
        document = changed(left, rng, known)
        if rng.random() < 0.5:
            document = json_variants.drawn(document, rng, 10 ** rng.uniform(-3, 5))
        for _ in range(rng.choice((0, 0, 1, 1, 2))):
            path = rng.choice(list(json_variants.places(document)))
            document = json_variants.with_at(document, path, json_variants.Text(rng.choice(json_variants.VALUES)))
            if not path:
                break
        yield seed[:1] + json_variants.json_of(document).encode("latin-1", "replace")
