#!/usr/bin/env python3
"""Help, mistyped words and completion of every command of all programs.

usage: help_test.py STILLMAP
"""

import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import unittest

PROGRAM = sys.argv[1]
# Options stand for themselves; descriptions are wrapped.
WIDEST = 110
JSON = "Print the result as one JSON object instead of text; --json=FILE writes it to FILE and still prints the text"
REPORT = "Write a report with pictures to FILE, one HTML page, and print its path"


def run(*arguments):
    return subprocess.run([PROGRAM, *map(str, arguments)], capture_output=True, text=True, timeout=60)


def sections(text):
    """Each part of a help with what it lists: {"Options": {"--json[=FILE]": "Print ..."}}."""
    found, part, name = {}, None, None
    for line in text.splitlines():
        if re.fullmatch(r"\S.*:", line):
            part = found.setdefault(line[:-1], {})
        elif part is not None and (match := re.fullmatch(r"  (\S.*?)(?:  +(\S.*))?", line)):
            name = match[1]
            part[name] = match[2] or ""
        elif part is not None and line.startswith("   "):
            part[name] = (part[name] + " " + line.strip()).strip()
        elif line and not line.startswith(" "):
            part = None
    return found


def all_helps(*command):
    done = run(*command, "--help")
    yield command, done
    for name in sections(done.stdout).get("Commands", {}):
        yield from all_helps(*command, name)


class Help(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.helps = dict(all_helps())

    def test_lists_every_command(self):
        commands = {" ".join(command) for command in self.helps}
        for name in ("build", "rebuild", "import", "export", "calibrate", "simulate", "localize", "serve", "inspect", "completion",
                     "store list", "store add", "store activate", "store rollback", "store remove", "store verify", "store gc",
                     "store reindex", "store migrate", "store backup", "store restore", "store rotate-seal-key", "keys create", "keys list", "keys revoke",
                     "audit verify", "audit export", "evaluate localization", "evaluate map", "evaluate detector",
                     "evaluate odometry", "evaluate paper", "evaluate paper-odometry"):
            self.assertIn(name, commands)
        self.assertNotIn("check-poses", commands)

    def test_is_plain_text_that_fits_a_terminal(self):
        for command, done in self.helps.items():
            with self.subTest(command=command):
                self.assertEqual((done.returncode, done.stderr), (0, ""))
                self.assertNotRegex(done.stdout, r"[^\n -~]")
                for line in done.stdout.splitlines():
                    self.assertLessEqual(len(line), WIDEST, line)
                    self.assertEqual(line, line.rstrip())

    def test_describes_every_command_argument_and_option(self):
        for command, done in self.helps.items():
            for part, entries in sections(done.stdout).items():
                for name, description in entries.items():
                    with self.subTest(command=command, name=name):
                        self.assertGreater(len(description), 3, part)

    def test_json_and_report_are_the_same_everywhere(self):
        having = {"json": set(), "report": set()}
        for command, done in self.helps.items():
            for name, description in sections(done.stdout).get("Options", {}).items():
                if name.startswith("--json"):
                    self.assertEqual((name, description), ("--json[=FILE]", JSON), command)
                    having["json"].add(" ".join(command))
                if name.startswith("--report"):
                    self.assertEqual((name, description.split(" (needs ")[0]), ("--report FILE", REPORT), command)
                    having["report"].add(" ".join(command))
        for name in ("build", "rebuild", "import", "export", "localize", "inspect", "store list", "keys list", "audit verify"):
            self.assertIn(name, having["json"])
        evaluations = {" ".join(command) for command in self.helps if len(command) == 2 and command[0] == "evaluate"}
        self.assertEqual(having["report"], evaluations)
        self.assertLessEqual(evaluations, having["json"])

    def test_exit_codes_are_documented(self):
        self.assertIn("4 the map of a rebuild did not", self.helps[()].stdout)
        self.assertIn("4 the map was made and did not pass", self.helps[("rebuild",)].stdout)


class Mistyped(unittest.TestCase):
    def says(self, text, *arguments):
        done = run(*arguments)
        self.assertEqual((done.returncode, done.stdout), (2, ""))
        self.assertEqual(done.stderr, f"stillmap: {text}\n")

    def test_commands(self):
        self.says("no command 'bild'; did you mean 'build'? See stillmap --help.", "bild")
        self.says("no command 'exprot'; did you mean 'export'? See stillmap --help.", "exprot")
        self.says("no command 'eval'; did you mean 'evaluate'? See stillmap --help.", "eval")
        self.says("no command 'frobnicate'. See stillmap --help.", "frobnicate")
        self.says("no command 'lst'; did you mean 'list'? See stillmap store --help.", "store", "lst", "/tmp")
        self.says("no command 'mpa'; did you mean 'map'? See stillmap evaluate --help.", "evaluate", "mpa", "x")

    def test_options(self):
        self.says("no option '--jsn'; did you mean '--json'? See stillmap inspect --help.", "inspect", "/tmp", "--jsn")
        self.says("no option '--ouptut'; did you mean '--output'? See stillmap build --help.", "build", "d", "--ouptut", "m")
        self.says("no option '--thr'; did you mean '--threads'? See stillmap rebuild --help.", "rebuild", "--thr", "2")
        self.says("no option '--reprot'; did you mean '--report'? See stillmap evaluate paper --help.", "evaluate", "paper",
                  "--reprot=x")
        self.says("no option '--vresion'; did you mean '--version'? See stillmap --help.", "--vresion")
        self.says("no option '-q'. See stillmap inspect --help.", "inspect", "-q")

    def test_values(self):
        self.says("--odometry: 'laom' is not a choice; did you mean 'loam'? Choose one of: default, loam", "evaluate",
                  "odometry", ".", "--odometry", "laom")

        self.says("--voxel: 'abc' is not a number; see stillmap build --help", "build", ".", "-o", "m", "--voxel", "abc")
        self.says("SCAN: nowhere does not exist; give a scan file or drive that does", "localize", ".", "nowhere")
        self.says("STORE: /none/x cannot be made: there is no folder /none; make it with mkdir -p /none", "store", "add",
                  "/none/x", "town", "v1", ".")
        self.says("--geo-origin: '1,2' is not LATITUDE,LONGITUDE,ALTITUDE; give three numbers, for example 48.1,11.5,520",
                  "import", PROGRAM, "-o", "m", "--geo-origin", "1,2")

    def test_what_is_missing_or_too_much(self):
        self.says("DRIVE is missing; see stillmap build --help", "build")
        self.says("stillmap keys needs a command: one of create, list, revoke, sign; see stillmap keys --help", "keys")
        self.says("--scope needs a value; see stillmap keys create --help", "keys", "create", "a", "--store", ".", "--scope")
        self.says("too many arguments: out.json; see stillmap inspect --help; to write JSON to out.json, give --json=out.json",
                  "inspect", ".", "--json", "out.json")


class Completion(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        temporary = tempfile.TemporaryDirectory()
        cls.addClassCleanup(temporary.cleanup)
        cls.folder = pathlib.Path(temporary.name)
        for shell in ("bash", "zsh"):
            done = run("completion", shell)
            assert done.returncode == 0, done.stderr
            (cls.folder / shell).write_text(done.stdout)
        (cls.folder / "here").mkdir()
        (cls.folder / "here/a drive").mkdir()
        (cls.folder / "here/poses.tum").touch()

    def complete(self, *words):
        """What bash offers for the last word; words as bash splits them."""
        script = 'source ../bash; COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1)); _stillmap; printf "%s\\n" "${COMPREPLY[@]}"'
        done = subprocess.run(["bash", "-uc", script, "bash", "stillmap", *words], capture_output=True, text=True, timeout=60,
                              cwd=self.folder / "here")
        self.assertEqual((done.returncode, done.stderr), (0, ""))
        return sorted(filter(None, done.stdout.splitlines()))

    def test_commands(self):
        self.assertEqual(self.complete("re"), ["rebuild"])
        self.assertEqual(self.complete("store", "re"), ["reindex", "remove", "restore"])
        self.assertEqual(self.complete("evaluate", ""), ["detector", "localization", "map", "odometry", "paper", "paper-odometry"])
        self.assertIn("serve", self.complete(""))
        self.assertNotIn("check-poses", self.complete(""))

    def test_options(self):
        self.assertEqual(self.complete("build", "x", "--pose"), ["--pose-sigma", "--pose-time-offset", "--poses"])
        self.assertIn("--select", self.complete("evaluate", "detector", "-"))
        self.assertIn("--management-port", self.complete("serve", "--man"))

    def test_values(self):
        self.assertEqual(self.complete("build", "--loops", ""), ["off", "on"])
        self.assertEqual(self.complete("build", "--loops", "=", "o"), ["off", "on"])
        self.assertEqual(self.complete("build", "--poses", ""), ["a drive", "poses.tum"])
        self.assertEqual(self.complete("build", "--poses", "p"), ["poses.tum"])
        self.assertEqual(self.complete("build", "--register-to", ""), ["a drive"])
        self.assertEqual(self.complete("build", "a"), ["a drive"])
        self.assertEqual(self.complete("localize", "map", "p"), ["poses.tum"])
        self.assertEqual(self.complete("store", "list", "--json", "="), ["a drive", "poses.tum"])
        self.assertEqual(self.complete("store", "list", "--json", "=", "p"), ["poses.tum"])
        self.assertEqual(self.complete("store", "list", "--json", ""), ["a drive"])
        self.assertEqual(self.complete("completion", ""), ["bash", "zsh"])
        self.assertEqual(self.complete("store", "list", ""), ["a drive"])
        self.assertEqual(self.complete("build", "--voxel", ""), [])

    def test_zsh_reads_its_script(self):
        text = (self.folder / "zsh").read_text()
        self.assertTrue(text.startswith("#compdef stillmap\n"))
        if shutil.which("zsh") is None:
            self.skipTest("zsh is not installed")
        done = subprocess.run(["zsh", "-fc", "autoload -Uz compinit; compinit -D; source ../zsh; print $_comps[stillmap]"],
                              capture_output=True, text=True, cwd=self.folder / "here", timeout=60)
        self.assertEqual((done.stdout, done.stderr), ("_stillmap\n", ""))


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
