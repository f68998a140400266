"""pages.py on a small repository in a temporary folder: each fault is found once, and a good page has none."""

import pathlib
import tempfile
import unittest

from pages import Pages

RUN = "<!-- run by tests/integration/readme_test.py -->\n"


class PagesTest(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)
        self.root = pathlib.Path(self.folder.name)
        self.put("maps/src/scan.cpp", "")
        self.put("maps/include/stillmap/maps/scan.hpp", "")
        self.put("tests/integration/readme_test.py", "")
        self.put("tests/integration/CMakeLists.txt", "foreach(page README.md maps/README.md)")
        self.put("maps/README.md", "# Maps\n\n## What is `here`?\n")

    def put(self, name, text):
        path = self.root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)

    def faults(self, text, name="README.md"):
        self.put(name, text)
        return list(Pages(self.root).faults())

    def expect(self, text, words, name="README.md"):
        faults = self.faults(text, name)
        self.assertEqual(len(faults), 1, faults)
        self.assertIn(words, faults[0])

    def test_a_good_page(self):
        self.assertEqual(self.faults(
            "# All\n\n[maps](maps/README.md#what-is-here), [here](#all), `maps/src/scan.cpp`, `maps/scan.hpp`, `scan.cpp`,\n"
            "`maps/src/*.cpp`, `oxts/data.txt`, `build/release/x.cpp`, <https://example.org/" + "a" * 120 + ">\n\n"
            "| a table | " + "may be long " * 20 + "|\n|---|---|\n\n```text\n" + "code " * 40 + "\n```\n\n"
            "    " + "indented code " * 20 + "\n\n" + RUN + "```sh\nls\n```\n\n<!-- not run: needs root -->\n```sh\nreboot\n```\n"), [])

    def test_long_prose(self):
        self.expect("word " * 30, "README.md:1: 150 columns")
        self.expect("- an item\n  " + "word " * 30, "README.md:2: 152 columns")

    def test_links(self):
        self.expect("[gone](maps/gone.md)", "no such file or heading: maps/gone.md")
        self.expect("[gone](maps/README.md#gone)", "maps/README.md#gone")
        self.expect("[gone](#gone)", "#gone")

    def test_paths(self):
        self.expect("see `maps/src/gone`", "no such path: maps/src/gone")
        self.expect("see `gone.cpp`", "no such path: gone.cpp")

    def test_commands(self):
        self.expect("# A\n\n```sh\nls\n```\n", "README.md:3: a command that no test runs")
        self.expect("<!-- run by tests/gone.py -->\n```sh\nls\n```\n", "no such test: tests/gone.py")
        self.put("README.md", "# A\n")
        self.expect(RUN + "```sh\nls\n```\n", "maps/other.md is not among the pages", "maps/other.md")

    def test_sizes(self):
        self.expect("words\n" * 1200, "7200 bytes, at most 7000")
        self.put("README.md", "# A\n")
        self.expect("- change\n" * 61, "61 lines, at most 60", "CHANGELOG.md")


if __name__ == "__main__":
    unittest.main()
