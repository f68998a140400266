#!/usr/bin/env python3
"""What variants.py writes is what it says; that targets take it is what fuzzing shows."""

import io
import itertools
import math
import random
import re
import sqlite3
import struct
import tarfile
import unittest

import bag_variants
import http_variants
import json_variants
import seeds
import variants


class Json(unittest.TestCase):
    def test_one_place_is_changed(self):
        texts = set(json_variants.changed({"a": 1, "b": [2]}))
        for expected in (b'{"a":null,"b":[2]}', b'{"a":1,"b":[null]}', b'{"b":[2]}', b'{"a":1,"b":[2],"a":1}', b'{"a":1,"b":[]}'):
            self.assertIn(expected, texts)
        self.assertNotIn(b'{"a":null,"b":[null]}', texts)

    def test_strings_are_bytes_and_need_not_be_utf8(self):
        self.assertIn(b'{"a":"\xc3("}', set(json_variants.changed({"a": 1})))

    def test_drawn_rotations_are_such(self):
        rng = random.Random(1)
        for _ in range(100):
            q = json_variants.drawn({"quaternion": [0, 0, 0, 1]}, rng, 10.0)["quaternion"]
            self.assertAlmostEqual(math.hypot(*q), 1.0)

    def test_drawn_covariances_are_symmetric_without_negative_variances(self):
        rng = random.Random(1)
        for _ in range(100):
            c = json_variants.drawn({"covariance": [0.0] * 36}, rng, 10.0)["covariance"]
            self.assertTrue(all(c[6 * i + j] == c[6 * j + i] for i in range(6) for j in range(6)))
            self.assertTrue(all(c[7 * i] >= 0 for i in range(6)))

    def test_words_stay_and_so_do_truths(self):
        self.assertEqual(json_variants.drawn({"a": "x", "b": True, "c": None}, random.Random(1), 1.0),
                         {"a": "x", "b": True, "c": None})


class Inputs(unittest.TestCase):
    def test_each_target_has_seeds(self):
        targets = {file.stem for file in seeds.HERE.glob("*.cpp")} - {"replay"}
        self.assertEqual(targets, set(seeds.of_all_targets()))

    def test_the_longest_text_is_found_within_others(self):
        start, end, document = variants.json_within(b'x{"a":1}\x1e{"b":[1,2,3]}{')
        self.assertEqual((start, end, document), (9, 22, {"b": [1, 2, 3]}))
        self.assertIsNone(variants.json_within(b"{no json}"))

    def test_lengths_before_a_text_follow_it(self):
        whole = seeds.seed("voxelnext_weights", "whole")
        start, end, _ = variants.json_within(whole)
        changed = variants.put_in(whole, start, end, b"{}")
        self.assertEqual(struct.unpack("<Q", changed[:8])[0], 2)
        self.assertEqual(changed[8:], b"{}" + whole[end:])
        request = http_variants.request("POST", "/", "", "application/json", b'{"a": 1}')
        self.assertIn(b"Content-Length: 2\r\n", variants.put_in(request, len(request) - 8, len(request), b"{}"))

    def test_a_tar_stays_one(self):
        small = seeds.seed("archive", "small")
        start, end, _ = variants.json_within(small)
        for text in (b"{}", b" " * 511, b" " * 512, b" " * 513):
            changed = variants.put_in(small, start, end, text)[1:]
            # Checksums are made right by the target.
            with tarfile.open(fileobj=io.BytesIO(http_variants.with_checksums(changed) + bytes(1024))) as tar:
                self.assertEqual(tar.getnames(), ["manifest.json", "tiles/0_0_0.bin"])
                self.assertEqual(tar.extractfile("manifest.json").read(), text)

    def test_each_target_has_some_and_they_are_the_same_again(self):
        for target in seeds.of_all_targets():
            with self.subTest(target):
                first, again = (list(itertools.islice(variants.variants(target), 50)) for _ in range(2))
                self.assertEqual(first, again)
                self.assertEqual(len(first), 50)

    def test_examples_have_what_their_schemas_ask_for(self):
        examples = {template: example for _, template, example in http_variants.Contract().json_bodies()}
        self.assertEqual(examples["/v1/sessions"]["map"], "town")
        self.assertEqual(len(examples["/v1/sessions"]["prior"]["covariance"]), 36)
        self.assertEqual(examples["/v1/maps/{map}/edits"]["format"], "stillmap-edits")

    def test_each_route_is_asked_for(self):
        contract = http_variants.Contract()
        asked, paths = b"".join(http_variants.requests_of_routes(contract)), contract.document["paths"]
        self.assertGreater(len(paths), 40)
        for template in paths:
            self.assertIn(http_variants.paths_of(template)[0].encode() + b" HTTP/1.1", asked)

    def test_seeds_of_other_targets_are_bodies_of_their_length_and_parts_are_completed(self):
        asked = list(http_variants.requests_with_seeds_as_bodies())
        alone = [each for each in asked if each.startswith((b"POST /v1/maps/town/localize", b"PUT /v1/maps/town/versions/v2"))]
        self.assertGreater(len(alone), 40)
        for head, _, body in (each.partition(b"\r\n\r\n") for each in alone):
            self.assertIn(f"Content-Length: {len(body)}\r\n".encode() if body else b"", head + b"\r\n")
        archives = list(http_variants.seed_bodies("archive"))
        self.assertEqual(sum(b"/{id}/complete HTTP/1.1" in each for each in asked), 2 * len(archives))

    def test_drawn_sequences_are_whole_requests_that_one_input_holds(self):
        for asked in itertools.islice(http_variants.drawn_sequences(http_variants.Contract()), 200):
            requests = re.split(rb"\x1e(?=(?:GET|PUT|POST|DELETE) /)", asked)
            self.assertTrue(2 <= len(requests) <= 16)
            self.assertTrue(all(b" HTTP/1.1\r\nHost: localhost\r\n" in each for each in requests))

    def test_names_that_are_given_out_are_asked_for_before(self):
        """And of a name that the server answers to: it refuses others where there are no keys."""
        for template in http_variants.Contract().document["paths"]:
            connections = (http_variants.asked_before(template) + http_variants.request("GET", template)).split(b"\x1e")
            self.assertTrue(all(b"\r\nHost: localhost\r\n" in each for each in connections))
            named = any("{" + name + "}" in template for name in ("session", "upload", "drive", "job", "key"))
            self.assertEqual(len(connections) > 1, named, template)

    def test_frames_that_are_drawn_lead_from_the_sensor_to_one_above_all(self):
        for number in range(100):
            above = {child: parent for parent, child in bag_variants.drawn_chain(random.Random(number))}
            frame = "lidar"
            for _ in range(len(above)):
                frame = above.get(frame, frame)
            self.assertIn(frame, ("map", "odom", "a"))

    def test_drawn_bags_are_databases_with_the_tables_of_rosbag2_and_files_of_mcap(self):
        rng = random.Random(1)
        for _ in range(50):
            messages = bag_variants.drawn_messages(rng, False)
            bag = sqlite3.connect(":memory:")
            database = bag_variants.drawn_rosbag2(rng, messages)
            if int.from_bytes(database[28:32], "big") * int.from_bytes(database[16:18], "big") == len(database):  # not cut off
                bag.deserialize(database)
                self.assertTrue(all(bag.execute("SELECT count(*) FROM messages").fetchone()))
            bag.close()
            file = bag_variants.drawn_mcap(rng, messages, "cdr")
            self.assertTrue(file.startswith(b"\x89MCAP0\r\n\x01") and file.endswith(b"\x89MCAP0\r\n"))

    def test_bags_of_another_kind_are_taken_under_the_name_of_a_database(self):
        begins = {each[:5] for each in itertools.islice(variants.variants("rosbag2"), 1000)}
        self.assertLessEqual({b"\x89MCAP", b"SQLit"}, begins)


if __name__ == "__main__":
    unittest.main()
