#!/usr/bin/env python3
"""`stillmap export --format 3dtiles` as others read it: the schemas of 3D Tiles 1.1, and Khronos' glTF validator.

usage: tileset_test.py STILLMAP MAP SCHEMAS WEB

SCHEMAS is tests/data/3dtiles, WEB the folder whose node_modules hold gltf-validator. What is not installed (jsonschema,
node, the validator) is skipped; 77 when nothing is left.
"""

import json
import pathlib
import shutil
import subprocess
import sys
import tempfile
import urllib.parse
import warnings

try:
    import jsonschema
except ImportError:
    jsonschema = None

# Debian 12's jsonschema knows no other way to find what a schema refers to.
warnings.filterwarnings("ignore", category=DeprecationWarning, module=__name__)
SCHEMAS_AT = "https://schemas.invalid/"
VALIDATE = """
import { createRequire } from "node:module";
import { readFileSync } from "node:fs";
const [web, ...files] = process.argv.slice(1);
const validator = createRequire(web + "/package.json")("gltf-validator");
let faults = 0;
for (const file of files) {
  const report = await validator.validateBytes(new Uint8Array(readFileSync(file)), { uri: file, maxIssues: 10 });
  const { numErrors, numWarnings, messages } = report.issues;
  faults += numErrors + numWarnings;
  if (numErrors + numWarnings > 0) console.log(file, JSON.stringify(messages));
  const points = report.info.totalVertexCount;
  if (!(points > 0)) { console.log(file, "has", points, "points"); faults += 1; }
}
console.log(files.length, "files,", faults, "errors and warnings");
process.exit(faults === 0 ? 0 : 1);
"""


def schemas(folder):
    """By address. Their own names are flat but their references are not, so these are made absolute."""

    def absolute(value, place):
        if isinstance(value, dict):
            return {key: urllib.parse.urljoin(place, each) if key == "$ref" else absolute(each, place)
                    for key, each in value.items() if key != "$id"}
        return [absolute(each, place) for each in value] if isinstance(value, list) else value

    store = {}
    for file in folder.rglob("*.schema.json"):
        place = SCHEMAS_AT + file.relative_to(folder).as_posix()
        store[place] = absolute(json.loads(file.read_text()), place)
    return store


def check_schema(folder, tilesets):
    store = schemas(folder)
    root = store[SCHEMAS_AT + "tileset.schema.json"]
    resolver = jsonschema.RefResolver(SCHEMAS_AT, root, store=store)
    validator = jsonschema.Draft202012Validator(root, resolver=resolver)
    # The check itself must be able to fail.
    if not list(validator.iter_errors({"asset": {"version": "1.1"}, "geometricError": -1})):
        sys.exit("the schema takes a tileset without a root")
    for tileset in tilesets:
        for error in validator.iter_errors(json.loads(tileset.read_text())):
            sys.exit(f"{tileset}: {'/'.join(map(str, error.absolute_path))}: {error.message}")
    print(len(tilesets), "tilesets fit the schema of 3D Tiles 1.1")


def check_tree(folder):
    """Every file is named once, and what is named is there."""
    named = set()

    def walk(tile, base):
        if "content" in tile:
            file = (base / tile["content"]["uri"]).resolve()
            if file in named or not file.is_file():
                sys.exit(f"{file}: named twice, or not there")
            named.add(file)
            if file.suffix == ".json":
                walk(json.loads(file.read_text())["root"], file.parent)
        for child in tile.get("children", []):
            walk(child, base)

    walk(json.loads((folder / "tileset.json").read_text())["root"], folder)
    there = {file.resolve() for file in folder.rglob("*") if file.is_file()} - {(folder / "tileset.json").resolve()}
    if named != there or not named:
        sys.exit(f"named, or there, alone: {sorted(named ^ there)[:5]}")


def main():
    program, package, schema_folder, web = (pathlib.Path(x).resolve() for x in sys.argv[1:5])
    has_validator = shutil.which("node") and (web / "node_modules/gltf-validator").is_dir()
    with tempfile.TemporaryDirectory() as temporary:
        out = pathlib.Path(temporary) / "tiles"
        subprocess.run([program, "export", package, "--format", "3dtiles", "-o", out], check=True)
        check_tree(out)
        if jsonschema:
            check_schema(schema_folder, [out / "tileset.json", *out.rglob("[0-9]*/*/*.json")])
        else:
            print("python3-jsonschema is not installed")
        if has_validator:
            files = sorted(out.rglob("*.glb"))
            subprocess.run(["node", "--input-type=module", "-e", VALIDATE, "--", web, *files], check=True)
        else:
            print("node or gltf-validator is not installed")
    return 0 if jsonschema or has_validator else 77


if __name__ == "__main__":
    sys.exit(main())
