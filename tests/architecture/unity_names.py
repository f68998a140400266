#!/usr/bin/env python3
"""In sources that are compiled together no function of one file can be called by mistake for another's.

usage: unity_names.py COMPILE_COMMANDS_JSON

Equal functions do not compile. But put(std::string&, std::uint32_t) of one file would silently be called for the
put(std::string&, std::uint64_t) of another, which lies beside it only where both are compiled together.
"""

import collections
import json
import pathlib
import re
import sys

FUNCTION = re.compile(r"^(?!using|namespace|#|//|return)[A-Za-z_\[][^;={}()#]*?[\s&*](\w+)\(([^()]*)\)", re.M)
NUMBER = re.compile(r"(?:std::)?(?:u?int\d*_t|size_t|ptrdiff_t|int|unsigned|long|float|double|bool|char)")
TEXT = re.compile(r"(?:std::)?(?:string|string_view|filesystem::path)|fs::path|char\*")


def kind(parameter):
    """The type of a parameter; what converts into each other is one kind."""
    plain = re.sub(r"\bconst\b|&|\s*=.*", "", parameter).split()
    type_ = "".join(plain[:-1] or plain)
    if "&" in parameter and "const" not in parameter:
        return type_ + "&"
    return "number" if NUMBER.fullmatch(type_) else "text" if TEXT.fullmatch(type_) else type_


def functions(source):
    """(name, kinds of its parameters) of each function in an anonymous namespace of the file."""
    for part in re.findall(r"^namespace \{\n(.*?)^\}  // namespace$", pathlib.Path(source).read_text(), re.M | re.S):
        for name, parameters in FUNCTION.findall(part):
            yield name, tuple(kind(p) for p in re.split(r",(?![^<]*>)", parameters) if p.strip())


def main():
    wrong = 0
    for unit in sorted(c["file"] for c in json.loads(pathlib.Path(sys.argv[1]).read_text()) if "_unity/" in c["file"]):
        files = collections.defaultdict(set)
        for source in re.findall(r'#include "(.*)"', pathlib.Path(unit).read_text()):
            for function in functions(pathlib.Path(unit).parent / source):
                files[function].add(pathlib.Path(source).name)
        for (name, _), sources in sorted(files.items()):
            if len(sources) > 1:
                wrong += 1
                print(f"{name}: found in {' and '.join(sorted(sources))} with parameters that convert into each other, "
                      "expected one name each: rename one")
    print("no function can be called for another" if wrong == 0 else f"{wrong} found")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
