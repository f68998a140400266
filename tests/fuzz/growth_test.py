#!/usr/bin/env python3
"""growth.py repeats a piece of JSON within an input whose lengths stay right: else readers refuse it early, and nothing is
measured. That the targets take the inputs is not tested here."""

import struct
import unittest

import growth
import seeds


class Growth(unittest.TestCase):
    def test_the_longest_json_is_found(self):
        self.assertEqual(growth.json_within(b'x{"a":1}\x1e{"b":[1,2,3]}{'), (9, 22, {"b": [1, 2, 3]}))
        self.assertIsNone(growth.json_within(b"{no json}"))

    def test_the_length_before_a_text_follows_it(self):
        whole = seeds.of_all_targets()["voxelnext_weights"]["seed_whole"]
        start, end, _ = growth.json_within(whole)
        self.assertEqual(growth.put_in(whole, start, end, b"{}"), struct.pack("<Q", 2) + b"{}" + whole[end:])
        self.assertEqual(growth.put_in(b"Content-Length: 8\r\n\r\n{\"a\": 1}", 21, 29, b"{}"), b"Content-Length: 2\r\n\r\n{}")

    def test_a_tar_has_the_size_of_its_file_and_whole_blocks(self):
        small = seeds.of_all_targets()["archive"]["seed_small"]  # one byte, then the head of manifest.json
        start, end, _ = growth.json_within(small)
        for size in (2, 511, 512, 513):
            changed = growth.put_in(small, start, end, b" " * size)
            self.assertEqual(int(changed[1 + 124:1 + 135], 8), size)
            self.assertEqual((len(changed) - 1) % 512, 0)


if __name__ == "__main__":
    unittest.main()
