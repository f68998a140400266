#!/usr/bin/env python3
"""`stillmap store` and `stillmap keys` as a shell meets them.

usage: store_commands_test.py STILLMAP MAP
"""

import hashlib
import json
import pathlib
import re
import struct
import subprocess
import sys
import tempfile
import unittest

PROGRAM, MAP = sys.argv[1:3]


def run(*arguments):
    return subprocess.run([PROGRAM, *map(str, arguments)], capture_output=True, text=True, timeout=60)


def package_of_schema_1(folder):
    """A map of one tile with two points. @return its digest."""
    tile = b"".join(struct.pack("<4fHBB", x, 2.0, 0.5, 1.0, 1, 0, 0) for x in (1.0, 3.0))
    (folder / "tiles").mkdir(parents=True)
    (folder / "tiles" / "0_0_0.bin").write_bytes(tile)
    manifest = json.dumps({
        "schema": 1, "frame_id": "map", "origin": [5.0, 7.0, 0.0], "voxel_size_m": 0.1, "relative_clock": True,
        "software_version": "0", "options": {}, "counts": {}, "sources": {},
        "tiles": [{"level": 0, "x": 0, "y": 0, "points": 2, "min": [1.0, 2.0, 0.5], "max": [3.0, 2.0, 0.5]}],
        "files": {"tiles/0_0_0.bin": {"bytes": len(tile), "sha256": hashlib.sha256(tile).hexdigest()}}})
    (folder / "manifest.json").write_text(manifest)
    return hashlib.sha256(manifest.encode()).hexdigest()


class StoreCommands(unittest.TestCase):
    def setUp(self):
        temporary = tempfile.TemporaryDirectory()
        self.addCleanup(temporary.cleanup)
        self.folder = pathlib.Path(temporary.name)
        self.store = self.folder / "store"
        self.store.mkdir()

    def does(self, *arguments):
        done = run(*arguments)
        self.assertEqual((done.returncode, done.stderr), (0, ""), arguments)
        return done.stdout

    def json(self, *arguments):
        return json.loads(self.does(*arguments, "--json"))

    def fails(self, code, text, *arguments):
        done = run(*arguments)
        self.assertEqual(done.returncode, code, done.stderr)
        self.assertRegex(done.stderr, r"\Astillmap: [^\n]*\n\Z")
        self.assertIn(text, done.stderr)
        self.assertEqual(done.stdout, "")

    def publish(self, version="1"):
        return self.json("store", "add", self.store, "town", version, MAP, "--activate")

    def tile(self, digest):
        return next((self.store / "packages" / digest / "packs").iterdir())

    def test_a_package_becomes_the_active_version(self):
        added = self.publish()
        self.assertRegex(added["digest"], r"\A[0-9a-f]{64}\Z")
        self.assertTrue(added["is_new"])
        self.assertFalse(self.publish()["is_new"])
        self.does("store", "add", self.store, "town", "2", MAP)
        active = self.json("store", "activate", self.store, "town", "2")
        self.assertEqual((active["version"], active["previous_version"], active["revision"]), ("2", "1", 2))
        self.fails(1, "no version '3'", "store", "activate", self.store, "town", "3")
        self.fails(2, "'Town'", "store", "add", self.store, "Town", "1", MAP)

    def test_list_names_maps_versions_and_what_is_active(self):
        digest = self.publish("1")["digest"]
        self.publish("2")
        self.does("store", "add", self.store, "yard", "a", MAP)
        listed = self.json("store", "list", self.store)
        town, yard = listed["maps"]
        self.assertEqual([(each["name"], each["version"], each["previous_version"], each["revision"]) for each in (town, yard)],
                         [("town", "2", "1", 2), ("yard", None, None, 0)])
        self.assertEqual([(each["version"], each["active"], each["digest"]) for each in town["versions"]],
                         [("1", False, digest), ("2", True, digest)])
        # The package is the same one, so that it counts once.
        self.assertEqual({listed["bytes"], town["bytes"], yard["bytes"], yard["versions"][0]["bytes"]}, {listed["bytes"]})
        self.assertGreater(listed["bytes"], 1000)
        self.assertEqual(self.json("store", "list", self.store, "yard")["maps"], [yard])
        lines = [line.split() for line in self.does("store", "list", self.store).splitlines()]
        self.assertEqual([line[:3] for line in lines[1:4]],
                         [["town", "1", "previous"], ["town", "2", "active"], ["yard", "a", lines[3][2]]])
        self.fails(1, "no map 'none'", "store", "list", self.store, "none")

    def test_rollback_goes_back_to_the_version_before(self):
        self.publish("1")
        self.fails(1, "town", "store", "rollback", self.store, "town")
        self.publish("2")
        self.assertIn("town 1 is active again", self.does("store", "rollback", self.store, "town"))
        self.assertEqual(self.json("store", "rollback", self.store, "town")["version"], "2")

    def test_a_missing_store_is_made_in_a_folder_that_exists(self):
        for name, command in (("a", ("store", "add", self.folder / "a", "town", "1", MAP)),
                              ("b", ("keys", "create", "bob", "--scope", "read", "--store", self.folder / "b"))):
            self.assertEqual(run(*command).returncode, 0)
            self.assertTrue((self.folder / name / "state.db").exists())
        nowhere = self.folder / "none" / "store"
        self.fails(2, f"mkdir -p {nowhere.parent}", "store", "add", nowhere, "town", "1", MAP)
        self.fails(2, f"mkdir -p {nowhere.parent}", "keys", "create", "bob", "--scope", "read", "--store", nowhere)
        # What looks into a store makes none.
        self.fails(2, "does not exist", "store", "verify", self.folder / "c")
        self.assertEqual(sorted(each.name for each in self.folder.iterdir()), ["a", "b", "store"])

    def test_verify_names_the_broken_file_and_fails(self):
        digest = self.publish()["digest"]
        self.assertEqual(self.json("store", "verify", self.store), {"problems": []})
        tile = self.tile(digest)
        tile.write_bytes(bytes(b ^ 255 for b in tile.read_bytes()))
        done = run("store", "verify", self.store, "--json")
        self.assertEqual(done.returncode, 1)
        (problem,) = json.loads(done.stdout)["problems"]
        self.assertEqual((problem["map"], problem["version"]), ("town", "1"))
        self.assertIn(tile.name, problem["what"])

    def test_migrate_turns_old_packages_into_new_ones(self):
        self.publish()
        former = package_of_schema_1(self.folder / "old")
        for version in ("old", "copy"):
            self.does("store", "add", self.store, "town", version, self.folder / "old")
        plan = self.json("store", "migrate", self.store, "--dry-run")
        self.assertEqual([(each["digest"], each["versions"]) for each in plan["packages"]], [(former, "town/old, town/copy")])
        self.assertTrue(0 < plan["room_bytes"] < plan["free_bytes"])
        self.assertIn("1 packages of schema 1", self.does("store", "migrate", self.store, "--dry-run"))
        done = self.json("store", "migrate", self.store)
        self.assertEqual(([each["former"]["digest"] for each in done["migrated"]], done["left"]), ([former], []))
        (town,) = self.json("store", "list", self.store)["maps"]
        found = {each["version"]: (each["digest"], each["former_digests"]) for each in town["versions"]}
        self.assertEqual(found["old"], (done["migrated"][0]["digest"], [former]))
        self.assertEqual(found["copy"], found["old"])
        self.assertEqual((found["1"][1], town["version"], town["revision"]), ([], "1", 1))
        self.assertEqual(self.json("store", "verify", self.store), {"problems": []})
        self.assertEqual(self.does("store", "migrate", self.store), "0 packages migrated, 0 left\n")
        self.assertEqual(self.does("store", "migrate", self.store, "--dry-run"), "every package is of schema 2\n")
        # The package as it was is still this version.
        self.assertIn("as before", self.does("store", "add", self.store, "town", "old", self.folder / "old"))

    def test_migrate_leaves_a_damaged_package_and_fails(self):
        former = package_of_schema_1(self.folder / "old")
        self.does("store", "add", self.store, "town", "old", self.folder / "old")
        tile = self.store / "packages" / former / "tiles" / "0_0_0.bin"
        tile.write_bytes(bytes(b ^ 1 for b in tile.read_bytes()))
        done = run("store", "migrate", self.store, "--json")
        self.assertEqual(done.returncode, 1, done.stderr)
        (left,) = json.loads(done.stdout)["left"]
        self.assertEqual((left["digest"], left["versions"]), (former, "town/old"))
        self.assertIn("tiles/0_0_0.bin", left["why"])

    def test_gc_keeps_so_many_versions(self):
        for version in "12345":
            self.publish(version)
        self.assertEqual(self.json("store", "gc", self.store), {"versions": [], "packages": [], "leftovers": 0})
        removed = self.json("store", "gc", self.store, "--keep", "1")["versions"]
        self.assertEqual([each["version"] for each in removed], ["1", "2"])

    def test_remove_takes_a_version_that_is_not_active(self):
        self.publish("2")
        digest = self.publish("1")["digest"]
        self.fails(1, "is active", "store", "remove", self.store, "town", "1")
        self.fails(1, "no version 'v9'", "store", "remove", self.store, "town", "v9")
        self.assertEqual(self.json("store", "remove", self.store, "town", "2"),
                         {"map": "town", "version": "2", "package_removed": False})
        self.assertTrue((self.store / "packages" / digest).exists())
        self.assertEqual(self.json("store", "verify", self.store), {"problems": []})

    def test_adding_again_mends(self):
        digest = self.publish()["digest"]
        tile = self.tile(digest)
        tile.write_bytes(bytes(tile.stat().st_size))
        self.assertEqual(run("store", "verify", self.store).returncode, 1)
        self.assertIn("as before", self.does("store", "add", self.store, "town", "1", MAP))
        self.assertEqual(self.json("store", "verify", self.store), {"problems": []})

    def test_reindex_makes_the_same_index_and_levels_again(self):
        digest = self.publish()["digest"]
        self.assertEqual(self.json("store", "reindex", self.store)["indexes"],
                         [{"digest": digest, "not_written_because": "", "levels_not_written_because": ""}])
        for folder in ("index", "levels"):
            made = list((self.store / "packages" / digest / folder).iterdir())
            whole = [each.read_bytes() for each in made]
            for each in made:
                each.write_bytes(b"broken")
            self.does("store", "reindex", self.store)
            self.assertEqual([each.read_bytes() for each in made], whole)
        self.assertEqual(self.json("store", "verify", self.store), {"problems": []})

    def test_reindex_leaves_what_a_damaged_package_has_and_goes_on(self):
        digest = self.publish()["digest"]
        self.does("store", "reindex", self.store)
        index = list((self.store / "packages" / digest / "index").iterdir())
        tile = self.tile(digest)
        tile.write_bytes(bytes(tile.stat().st_size))
        done = run("store", "reindex", self.store, "--json")
        self.assertEqual(done.returncode, 1)
        (made,) = json.loads(done.stdout)["indexes"]
        self.assertIn(tile.name, made["not_written_because"])
        self.assertTrue(all(each.exists() for each in index))

    def test_a_backup_becomes_a_store_again(self):
        digest = self.publish()["digest"]
        key = self.does_key("car")
        backup, again = self.folder / "backup", self.folder / "again"
        self.assertEqual(self.json("store", "backup", self.store, "-o", backup)["packages"], {"copied": 1, "kept": 0})
        self.assertEqual(self.json("store", "backup", self.store, "-o", backup)["packages"], {"copied": 0, "kept": 1})
        self.assertEqual(self.json("store", "restore", backup, "-o", again), {"packages": 1})
        self.assertEqual(self.json("store", "verify", again), {"problems": []})
        self.assertTrue((again / "packages" / digest / "manifest.json").exists())
        self.assertIn(key.split("_")[1], self.does("keys", "list", "--store", again))
        self.fails(1, "with content", "store", "restore", backup, "-o", again)
        self.fails(1, "something else", "store", "backup", self.store, "-o", again)
        self.fails(1, "no finished backup", "store", "restore", again, "-o", self.folder / "third")
        self.fails(1, "a backup of a store", "store", "add", backup, "town", "2", MAP)

    def does_key(self, name, *options):
        done = run("keys", "create", name, "--store", self.store, "--scope", "read", *options)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertRegex(done.stdout, r"\Astillmap_[0-9a-f]{16}_[0-9a-f]{64}\n\Z")
        self.assertNotIn(done.stdout.strip(), done.stderr)
        return done.stdout.strip()

    def test_a_key_is_shown_once(self):
        key = self.does_key("car 7", "--expires-days", "30")
        secret = key.split("_")[2]
        (listed,) = self.json("keys", "list", "--store", self.store)["keys"]
        self.assertEqual((listed["id"], listed["name"], listed["scopes"]), (key.split("_")[1], "car 7", ["read"]))
        days = (int(listed["expires_ns"]) - int(listed["created_ns"])) / 86.4e12
        self.assertEqual(days, 30)
        for output in (self.does("keys", "list", "--store", self.store), json.dumps(listed)):
            self.assertNotIn(secret, output)
        for file in self.store.iterdir():
            if file.is_file():
                self.assertNotIn(secret.encode(), file.read_bytes(), file)
        created = self.json("keys", "create", "map team", "--store", self.store, "--scope", "write", "--scope", "read")
        self.assertEqual(created["scopes"], ["read", "write"])
        self.assertTrue(created["key"].startswith("stillmap_" + created["id"]))

    def test_a_key_is_limited_to_maps(self):
        made = self.json("keys", "create", "car", "--store", self.store, "--scope", "localize", "--map", "town-*", "--map", "b")
        self.assertEqual(made["maps"], ["town-*", "b"])
        self.assertIn("car (localize) for maps town-* b, made", self.does("keys", "list", "--store", self.store))
        self.fails(2, "leave out the scope admin", "keys", "create", "x", "--store", self.store, "--scope", "admin", "--map", "*")
        self.fails(2, "'Town'", "keys", "create", "x", "--store", self.store, "--scope", "read", "--map", "Town")

    def test_a_key_is_revoked_for_good(self):
        identity = self.does_key("car").split("_")[1]
        revoked = self.json("keys", "revoke", identity, "--store", self.store)
        again = self.json("keys", "revoke", identity, "--store", self.store)
        self.assertIsNotNone(revoked["revoked_ns"])
        self.assertEqual(revoked, again)
        self.assertRegex(self.does("keys", "list", "--store", self.store), re.escape(identity) + r".*revoked 20")
        self.fails(1, "no key 'nobody'", "keys", "revoke", "nobody", "--store", self.store)

    def test_wrong_usage_is_2_and_makes_nothing(self):
        self.fails(2, "fly", "keys", "create", "car", "--store", self.store, "--scope", "fly")
        self.fails(2, "--scope", "keys", "create", "car", "--store", self.store)
        self.fails(2, "nowhere", "store", "verify", "nowhere")
        self.fails(2, "0", "keys", "create", "car", "--store", self.store, "--scope", "read", "--expires-days", "0")
        for command in (["store", "verify", self.store], ["store", "gc", self.store], ["store", "reindex", self.store],
                        ["store", "migrate", self.store], ["store", "migrate", self.store, "--dry-run"],
                        ["store", "backup", self.store, "-o", self.folder / "new"],
                        ["store", "activate", self.store, "town", "1"], ["store", "list", self.store],
                        ["store", "rollback", self.store, "town"], ["store", "remove", self.store, "town", "1"],
                        ["keys", "list", "--store", self.store],
                        ["keys", "revoke", "x", "--store", self.store]):
            self.fails(1, "no state.db", *command)
        self.assertEqual(list(self.store.iterdir()), [])
        self.assertEqual([each.name for each in self.folder.iterdir()], ["store"])


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
