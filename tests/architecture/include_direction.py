#!/usr/bin/env python3
"""Checks that includes go maps <- localization <- mapping <- server, that a layer has only the public headers of another,
and that public headers stay clean.

usage: include_direction.py REPOSITORY
"""

import pathlib
import re
import sys

LAYERS = ["maps", "localization", "mapping", "server"]
# The simulator is a library of its own inside mapping/.
OWN = {"maps": {"maps"}, "localization": {"localization"}, "mapping": {"mapping", "simulation"}, "server": {"server"}}
# No foreign type in a public header but Eigen's.
HTTPLIB_USERS = ("server/src/http/http_answer.cpp", "server/src/http/http_exchange.cpp", "server/src/mirror/http_source.cpp",
                 "server/clients/cpp/stillmap_client.hpp")
FORBIDDEN_IN_PUBLIC = re.compile(r'[<"](pcl|mrpt|nlohmann|httplib|tbb|oneapi|embree3?|openssl|png|spdlog|CLI|fmt)[/.>]')
INCLUDE = re.compile(r'^\s*#\s*include\s*([<"])([^>"]+)[>"]')
# Where a header in quotes is looked for, beside the folder of the file itself.
PRIVATE_FOLDERS = ("clients/cpp", "examples/vehicle", "src", "simulation", "training")


def allowed(layer):
    names = set()
    for lower in LAYERS[: LAYERS.index(layer) + 1]:
        names |= OWN[lower]
    return names


def is_own(root, layer, file, name):
    """Whether a private header is one of this layer."""
    folders = [file.parent, *(root / layer / folder for folder in PRIVATE_FOLDERS)]
    return any((folder / name).is_file() for folder in folders)


def faults_of(root):
    files = 0
    for layer in LAYERS:
        for file in sorted((root / layer).rglob("*.[ch]pp")):
            if "node_modules" in file.parts:
                continue
            files += 1
            relative = file.relative_to(root)
            public = "include" in relative.parts
            for number, line in enumerate(file.read_text().splitlines(), 1):
                match = INCLUDE.match(line)
                if not match:
                    continue
                name = match.group(2)
                if match.group(1) == '"' and not is_own(root, layer, file, name):
                    yield f"{relative}:{number}: {name} is no header of {layer}; include a public one in <>"
                parts = name.split("/")
                if parts[0] == "stillmap" and parts[1] not in allowed(layer):
                    yield f"{relative}:{number}: {layer} includes {name}, which is above it"
                if parts[0] == ".." or "/../" in name:
                    yield f"{relative}:{number}: {name} climbs out of its folder"
                if public and FORBIDDEN_IN_PUBLIC.search(line):
                    yield f"{relative}:{number}: {name} in a public header"
                if "httplib.h" in name and str(relative) not in HTTPLIB_USERS:
                    yield f"{relative}:{number}: httplib.h belongs to {' and '.join(HTTPLIB_USERS)} alone"
                if parts[0] == "pcl" and not str(relative).startswith("mapping/src/reference/"):
                    yield f"{relative}:{number}: PCL belongs to mapping/src/reference/ alone"
    if files < 20:
        yield f"only {files} sources found under {root}"


def main():
    faults = list(faults_of(pathlib.Path(sys.argv[1])))
    print("\n".join(faults) or "includes point the right way")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
