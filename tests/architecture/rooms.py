#!/usr/bin/env python3
"""Prints how the production code is cut into rooms, to compare a clean-up before and after.

usage: rooms.py REPOSITORY [--json FILE] [--limits]

--limits exits 1 when folders of one library include each other, two or more in a circle.

A scanner of braces, no compiler. It knows strings, raw strings, comments, character literals and initializer lists; a
lambda is part of its function; of #if ... #else it reads the first part. KNOWN lists by hand what no pattern finds;
what left its file is printed as gone, and candidates in neither KNOWN nor SEEN are printed to be read.
"""

import argparse
import bisect
import collections
import dataclasses
import json
import os
import pathlib
import re
import sys

LONGEST, MOST_PARAMETERS, USUAL_BODY = 80, 5, 3
LIBRARIES = ["maps", "localization", "mapping", "simulation", "server", "web"]
# Where a library's own includes begin, and with it its folders.
ROOTS = {"maps": ["maps/src", "maps/rawlog"], "localization": ["localization/src"], "mapping": ["mapping/src"],
         "simulation": ["mapping/simulation"], "server": ["server/src"], "web": ["web/src"]}
HELPERS = ["quoted", "described", "one_line", "seconds_between", "median", "quantile"]

# What exists more than once: kind -> (library, class or function, one word on what it is). By class and not by file,
# so that a move does not make it wrong.
KNOWN = {
    "spatial hashes": [
        ("maps", "CellTable", "table"),
        ("maps", "CellIndex", "table"),
        ("maps", "CellMap", "map"),
        ("localization", "CellBlockTable", "mapped"),
        ("localization", "CellBitsTable", "bits"),
        ("localization", "PlacesApart", "tree"),
        ("localization", "TellingVoxels", "tree"),
        ("maps", "Voxels", "sorted"),
        ("maps", "squares_of", "tree"),
        ("maps", "tiles_of_squares", "tree"),
        ("mapping", "PointCells", "sorted"),
        ("mapping", "LocalCellPoint", "sorted"),
        ("mapping", "surface_key", "sorted"),
        ("mapping", "MeansByTile", "tree"),
        ("mapping", "CubeRecord", "tree"),
        ("mapping", "Tiles", "tree"),
    ],
    "binary containers": [
        ("maps", "SectionTable", "derived"),
        ("maps", "kFatesMagic", "fates"),
        ("mapping", "BuildJournal", "log"),
    ],
    "strict JSON readers": [
        ("maps", "JsonField", "files"),
        ("server", "RequestReader", "requests"),
        ("server", "ConfigReader", "configuration"),
    ],
    "classes called Report": [
        ("mapping", "ReportPage", "page"),
    ],
    "comparisons of two maps": [
        ("maps", "MapDifference", "points"),
        ("mapping", "ConsistencyChange", "gate"),
    ],
}
# What shows that a file may hold another one.
CANDIDATE = {
    "spatial hashes": re.compile(
        r"unordered_(?:map|set)<std::uint64_t|<<\s*(?:21|42)U?\b|0x9E3779B[0-9A-F]*|struct \w*Hash\b|"
        r"std::map<std::(?:pair<(?:int|std::int\d+_t), |array<(?:int|std::int\d+_t), [23])|"
        r"(?:class|struct) \w*(?:Grid|Cells|Voxels?|Blocks|Columns)\b(?=[^;]*$)", re.M | re.I),
    "binary containers": re.compile(r"\b(?:kMagic|k\w+Magic)\b|\bcrc32c\((?!std::span<const std::byte> bytes)", re.M),
    "strict JSON readers": re.compile(r"json_sax_t|(?:is_object\(\)|\.is_number\w*\(\)).*(?:throw|refuse)", re.M),
    "classes called Report": re.compile(r"\b(?:class|struct|interface) \w*Report\b(?=[^;]*$)", re.M),
    "comparisons of two maps": re.compile(
        r"const (?:maps::)?MapPackage& \w+,\s*const (?:maps::)?MapPackage& \w+|"
        r"(?:class|struct) \w*(?:Compar|Diff)\w*\b(?=[^;]*$)", re.M),
}
# Read, and something else: grids in arrays, users of a table that is listed, numbers at random, formats of others.
SEEN = {
    "spatial hashes": [
        "localization/src/index/local_voxels.hpp", "localization/src/align/pose_search.cpp",
        "localization/src/reference/map_points.cpp", "localization/src/align/thinning.cpp",
        "localization/src/index/voxel_moments.hpp", "mapping/simulation/geometry/random.hpp",
        "mapping/simulation/scenarios/grid_plan.cpp", "mapping/src/detection/column_grid.hpp",
        "mapping/src/detection/onnx/dense_decoding.cpp", "mapping/src/detection/voxelnext/voxels.hpp",
        "mapping/src/evaluation/localization/prior_draws.cpp", "mapping/src/evaluation/report/stanford_figure.cpp",
        "mapping/src/ground/ground_fill.cpp", "mapping/src/ground/height_grid.hpp",
        "mapping/src/projection/box_columns.hpp", "mapping/src/reference/map_blocks.hpp",
        "mapping/src/stacking/tile_stack.hpp", "mapping/src/stacking/voxel_grid.hpp", "mapping/src/views/view_grid.hpp",
        "maps/src/checks/ground_plane.cpp", "maps/src/exports/occupancy_grid.hpp",
        "mapping/src/evaluation/labels/map_voxels.hpp", "mapping/src/fusion/obstacle_map.hpp",
        "mapping/src/rebuild/map_comparison.cpp", "mapping/src/stacking/normals.cpp"],
    "binary containers": [
        "localization/src/index/index_bytes.cpp", "localization/src/index/index_file.cpp", "maps/src/bags/bag.cpp",
        "maps/src/bags/mcap_bag.cpp", "maps/src/bags/mcap_records.hpp", "maps/src/bags/mcap_visitor.cpp",
        "maps/src/bags/rosbag2_database.cpp", "maps/src/bags/unpacked_bag.cpp", "maps/src/levels/glb.cpp",
        "maps/src/levels/tile_file.cpp", "maps/src/storage/layer_file.cpp",
        "web/src/compare/glb.ts"],
    "strict JSON readers": [
        "server/src/jobs/job_request.cpp",
        "server/src/bodies/pose_request_json.cpp"],
    "comparisons of two maps": [
        "mapping/include/stillmap/mapping/odometry_table.hpp", "mapping/include/stillmap/mapping/paper_evaluation.hpp",
        "mapping/include/stillmap/mapping/trajectory.hpp", "mapping/src/rebuild/held_back.cpp",
        "mapping/src/rebuild/rebuild.cpp", "mapping/src/reference/erasor.cpp",
        "mapping/src/trajectory/given_pose_errors.hpp", "mapping/src/trajectory/path_difference.hpp",
        "server/src/store/package_store.hpp", "server/src/catalog/tile_diff.hpp",
        "server/src/catalog/map_views.hpp",
        "web/src/compare/compare_scene.ts"],
}


@dataclasses.dataclass
class Function:
    name: str
    file: str
    line: int
    lines: int  # 0 = a declaration
    parameters: int
    anonymous: bool = False  # in an anonymous namespace
    member: bool = False
    body: int = 0  # lines of the body that are not empty


# ------------------------------------------------------------------------------------------- C++

TOKEN = re.compile(
    r"""(?P<comment>//(?:\\\n|[^\n])*|/\*.*?(?:\*/|\Z))
      |(?P<raw>(?:u8|[uUL])?R"(?P<mark>[^()\\\s]{0,16})\(.*?\)(?P=mark)")
      |(?P<text>(?:u8|[uUL])?"(?:\\.|[^"\\\n])*"|(?:u8|[uUL])?'(?:\\.|[^'\\\n])+')
      |\.?\d(?:'?[\w.])*   # a number: 1'000 begins no character
      |[A-Za-z_]\w*""", re.S | re.X)
DIRECTIVE = re.compile(r"^[ \t]*#[ \t]*(\w+)?(?:\\\n|[^\n])*", re.M)
NAME = re.compile(r"((?:\w+(?:<[^()]*>)?\s*::\s*)*"
                  r"(?:~\s*\w+|operator\s*(?:[^\s\w(]+|\(\s*\)|[\w:\s&*<>]+)|\w+))\s*$")
NO_FUNCTION = {"if", "for", "while", "switch", "catch", "return", "alignas", "noexcept", "decltype", "requires",
               "explicit", "static_assert", "sizeof", "throw", "__attribute__", "defined", "operator", "co_await"}


def spaces(text):
    return re.sub(r"[^\n]", " ", text)


def blank(text):
    """C++ without comments, strings, directives and second branches of #if; every place stays where it is."""
    text = TOKEN.sub(lambda m: spaces(m[0]) if m["comment"] is not None else
                     '"' + spaces(m[0][1:-1]) + '"' if m["raw"] or m["text"] else m[0], text)
    pieces, at, skipping = [], 0, []
    for match in DIRECTIVE.finditer(text):
        between = text[at:match.start()]
        pieces += [spaces(between) if any(skipping) else between, spaces(match[0])]
        at = match.end()
        if (match[1] or "").startswith("if"):
            skipping.append(False)
        elif match[1] in ("else", "elif", "elifdef") and skipping:
            skipping[-1] = True
        elif match[1] == "endif" and skipping:
            skipping.pop()
    return "".join(pieces) + text[at:]


def matching(text, at):
    """Behind the bracket that closes the one at `at`."""
    depth = 0
    for match in re.compile(r"[()\[\]{}]").finditer(text, at):
        depth += 1 if match[0] in "([{" else -1
        if depth == 0:
            return match.end()
    return len(text)


def template_end(text, at):
    """Behind the > of the < at `at`; `at` + 1 where it is a comparison."""
    depth, i = 0, at
    while i < len(text):
        letter = text[i]
        if letter in "([{":
            i = matching(text, i)
            continue
        if letter in ";)]}":
            break
        depth += letter == "<"
        if letter == ">" and text[i - 1] != "-":
            depth -= 1
            if depth == 0:
                return i + 1
        i += 1
    return at + 1


def signature(head):
    """(name, where the parameters' bracket begins) of a function whose text before the body is `head`, else None."""
    i = 0
    while i < len(head):
        letter = head[i]
        if letter == "=" and not re.search(r"\boperator\s*[=!<>+*/%&|^-]*$", head[:i]):
            return None
        if letter == "<" and not re.search(r"\boperator\s*<?$", head[:i]):
            i = template_end(head, i)
        elif letter in "[{":
            i = matching(head, i)
        elif letter == "(":
            if re.search(r"\boperator\s*$", head[:i]):
                i += head[i:].index(")") + 1
                continue
            name = NAME.search(head[:i])
            if name and re.sub(r"\W.*", "", name[1].lstrip("~")) not in NO_FUNCTION - {"operator"}:
                before = head[:name.start()].strip()
                return (re.sub(r"<[^()]*>(?=\s*::)|\s", "", name[1]), i, before)
            i = matching(head, i)
        else:
            i += 1
    return None


def count_parameters(text):
    """Of what stands between the brackets."""
    if text.strip() in ("", "void"):
        return 0
    count, i = 1, 0
    while i < len(text):
        if text[i] in "([{":
            i = matching(text, i)
        elif text[i] == "<":
            i = template_end(text, i)
        else:
            count += text[i] == ","
            i += 1
    return count


class Lines:
    def __init__(self, text):
        self.ends = [m.start() for m in re.finditer("\n", text)]

    def at(self, place):
        return bisect.bisect_left(self.ends, place) + 1


def functions_of_cpp(text, file="", declarations=True):
    """All functions of a file, those within a function apart. The declarations too, with `lines` 0."""
    code = blank(text)
    lines, found = Lines(code), []

    def add(head_at, head, name_and_bracket, scope, anonymous, end):
        name, bracket, before = name_and_bracket
        if end is None and not (before or scope) or before.endswith(("return", "new", "goto")):
            return  # a call, or a variable
        begin = head_at + len(head) - len(head.lstrip())
        close = matching(head, bracket)
        body_at = head_at + len(head)
        found.append(Function(
            "::".join([*scope, name]), file, lines.at(begin),
            lines.at(end - 1) - lines.at(begin) + 1 if end else 0, count_parameters(head[bracket + 1:close - 1]),
            anonymous, bool(scope) or "::" in name,
            sum(bool(line.strip()) for line in code[body_at + 1:end - 1].split("\n")) if end else 0))

    def scan(begin, end, scope, anonymous):
        head_at = i = begin
        while i < end:
            letter = code[i]
            if letter in "([":
                i = matching(code, i)
                continue
            head = code[head_at:i]
            if letter == ":" and re.fullmatch(r"\s*(public|private|protected)\s*", head):
                head_at = i + 1
            elif letter in ";}":
                if letter == ";" and declarations and (known := signature(head)):
                    add(head_at, head, known, scope, anonymous, None)
                head_at = i + 1
            elif letter == "{":
                close = matching(code, i)
                plain = re.sub(r"\b(alignas|__attribute__)\s*\(.*?\)|\[\[.*?\]\]", " ", head)
                plain = re.sub(r"template\s*<[^{}]*?>\s*(?=\b(class|struct|union)\b)", "", plain)
                kind = re.search(r"\b(class|struct|union)\s+([\w:]+)[^()]*$", plain)
                if re.search(r"\bnamespace\b[^=;]*$", head) or re.fullmatch(r'\s*extern\s*"\s*"\s*', head):
                    nameless = re.search(r"\bnamespace\s*$", head) is not None
                    scan(i + 1, close - 1, scope, anonymous or nameless)
                    head_at = close
                elif re.search(r"\benum\b[^()]*$", head):
                    pass
                elif known := signature(head):
                    behind = head[matching(head, known[1]):]
                    if re.search(r"(?<!:):(?!:)", behind) and re.search(r"[\w>]\s*$", behind):
                        i = close  # initializes a member
                        continue
                    add(head_at, head, known, scope, anonymous, close)
                    head_at = close
                elif kind and "=" not in plain[:kind.start()]:
                    scan(i + 1, close - 1, [*scope, kind[2]], anonymous)
                i = close
                continue
            i += 1

    scan(0, len(code), [], False)
    return found


# ------------------------------------------------------------------------------------- TypeScript

TS_TOKEN = re.compile(
    r"""(?P<comment>//[^\n]*|/\*.*?(?:\*/|\Z))
      |(?P<text>"(?:\\.|[^"\\\n])*"|'(?:\\.|[^'\\\n])*')
      |(?P<regex>(?<=[(,=:\[!&|?{};])\s*/(?![/*])(?:\\.|\[(?:\\.|[^\]\\\n])*\]|[^/\\\n\[])+/[a-z]*)
      |(?P<template>`(?:\\.|[^`\\])*`)""", re.S | re.X)
TS_FUNCTION = re.compile(
    r"\bfunction\b\s*\*?\s*(?P<function>\w*)\s*(?:<[^()]*>)?\("
    r"|\b(?:const|let)\s+(?P<arrow>\w+)\s*(?::[^=;]*)?=\s*(?:async\s*)?(?:<[^()]*>)?\("
    r"|^[ \t]*(?:(?:public|private|protected|static|async|override|readonly|get|set)\s+)*"
    r"\*?(?P<method>#?\w+)\s*(?:<[^()]*>)?\(", re.M)


def blank_ts(text):
    return TS_TOKEN.sub(lambda m: spaces(m[0]) if m["comment"] is not None else
                        re.sub(r"[^\n\s]", "_", m[0]), text)


def functions_of_ts(text, file=""):
    """Functions, methods and arrows with a name; roughly, since a type may stand before the body."""
    code, found = blank_ts(text), []
    lines = Lines(code)
    for match in TS_FUNCTION.finditer(code):
        name = match["function"] or match["arrow"] or match["method"]
        if match["method"] in NO_FUNCTION | {"function", "super", "await", "new"}:
            continue
        close = matching(code, match.end() - 1)
        kind = r"\s*(?::\s*(?:\{[^{}]*\}|[^;{}=\n]|=>(?!\s*\{))*)?" + (r"=>\s*\{" if match["arrow"] else r"\{")
        body = re.compile(kind).match(code, close)
        if not body:
            continue
        end = matching(code, body.end() - 1)
        begin = match.start() + len(match[0]) - len(match[0].lstrip())
        found.append(Function(name or "function", file, lines.at(begin), lines.at(end - 1) - lines.at(begin) + 1,
                              count_parameters(re.sub(r",\s*$", "", code[match.end():close - 1])), member=True))
    return found


# ------------------------------------------------------------------------------------- repository

def files_below(folder, endings):
    for at, folders, names in os.walk(folder):
        folders[:] = sorted(name for name in folders if name != "node_modules" and not name.startswith("."))
        yield from (pathlib.Path(at, name) for name in sorted(names) if name.endswith(endings))


def library_of(path):
    return "simulation" if path.startswith("mapping/simulation/") else path.split("/")[0]


def production(repository):
    """{path: text} of the code that is built into programs and the page."""
    texts = {}
    for folder in ("maps", "localization", "mapping", "server"):
        for file in files_below(repository / folder, (".cpp", ".hpp")):
            texts[str(file.relative_to(repository))] = file.read_text()
    for file in files_below(repository / "web/src", (".ts", ".tsx")):
        if file.name != "schema.d.ts" and not re.search(r"\.(test|spec)\.tsx?$", file.name):  # made of openapi.json
            texts[str(file.relative_to(repository))] = file.read_text()
    return texts


def folder_of(path):
    """The first folder below the library's root; '.' for files in the root itself, None outside of it."""
    for root in ROOTS[library_of(path)]:
        if path.startswith(root + "/"):
            rest = path[len(root) + 1:].split("/")
            return rest[0] if len(rest) > 1 else "."
    return None


CPP_INCLUDE = re.compile(r'^[ \t]*#[ \t]*include[ \t]*"(?P<name>[^"]+)"', re.M)
# `import ... from`, `export ... from`, `import 'x.js'`, and import('x.js') in code and in types. A relative name that
# ends in .js is the .ts or .tsx beside it.
TS_IMPORT = re.compile(r"""(?:\bfrom|^[ \t]*import|\bimport\()\s*["'](?P<name>\.[^"']+)["']""", re.M)


def includes_of(path, text, known):
    """(line, path) of each private file of the same library that `path` includes or imports."""
    ts = path.startswith("web/")
    lines = Lines(text)
    for match in (TS_IMPORT if ts else CPP_INCLUDE).finditer(text):
        name = match["name"]
        tries = [os.path.normpath(os.path.join(os.path.dirname(path), name))]
        if ts:
            tries = [re.sub(r"\.jsx?$", "", tries[0]) + end for end in ("", ".ts", ".tsx", "/index.ts", "/index.tsx")]
        else:
            tries += [f"{root}/{name}" for root in ROOTS[library_of(path)]]
        target = next((each for each in tries if each in known), None)
        if target:
            yield lines.at(match.end() - 1), target


def folder_pairs(edges):
    """[(library, folder, folder, include, include)]: one example each way."""
    first = {}
    for source, line, target in edges:
        library, folders = library_of(source), (folder_of(source), folder_of(target))
        if None not in folders and folders[0] != folders[1] and library == library_of(target):
            first.setdefault((library, *folders), f"{source}:{line} -> {target}")
    return [(library, a, b, example, first[library, b, a]) for (library, a, b), example in sorted(first.items())
            if a < b and (library, b, a) in first]


def folder_circles(edges):
    """[(library, [folders])]: sets of folders of which each reaches each other one by includes."""
    reached = collections.defaultdict(set)
    for source, _, target in edges:
        a, b = (library_of(source), folder_of(source)), (library_of(target), folder_of(target))
        if a[0] == b[0] and None not in (a[1], b[1]):
            reached[a].add(b)
    for through in list(reached):
        for found in reached.values():
            if through in found:
                found |= reached[through]
    circles = {frozenset(b for b in found if a in reached.get(b, ())) for a, found in reached.items()}
    return sorted((min(c)[0], sorted(name for _, name in c)) for c in circles if len(c) > 1)


def file_pairs(edges):
    pairs = {(a, b) for a, _, b in edges}
    return sorted((a, b) for a, b in pairs if a < b and (b, a) in pairs)


def lonely_headers(edges, texts):
    """{header: its users} of the private headers with at most one besides their own source."""
    users = {path: set() for path in texts if path.endswith(".hpp") and "/include/" not in path and folder_of(path)}
    for source, _, target in edges:
        if target in users and source.rpartition(".")[0] != target.rpartition(".")[0]:
            users[target].add(source)
    return {header: sorted(found) for header, found in sorted(users.items()) if len(found) < 2}, len(users)


def stem(path):
    """A header and its source are one, and so is a file that was moved."""
    return re.sub(r"\.\w+$", "", path.rpartition("/")[2])


def definition(name):
    """Finds where a class, an alias, a function or a constant of this name is defined."""
    return re.compile(rf"\b(?:class|struct|using)\s+{name}\b\s*(?:final\b)?[^;{{]*?[={{]|^\w[^;{{\n]*?\b{name}\([^;]*?{{|"
                      rf"\bconstexpr\b[^;=]*\b{name}\b\s*[={{]", re.M)


def known_and_candidates(kind, texts):
    there, gone = [], []
    for library, name, word in KNOWN[kind]:
        found = [path for path, text in texts.items() if library_of(path) == library and definition(name).search(text)]
        if found:
            there.append((found[0], name, word))
        else:
            gone.append((library, name, word))
    looked_at = {stem(path) for path in [*(path for path, _, _ in there), *SEEN.get(kind, ())]}
    candidates = []
    for path, text in texts.items():
        if stem(path) not in looked_at and (match := CANDIDATE[kind].search(text)):
            candidates.append(f"{path}:{Lines(text).at(match.start())}: {match[0].strip()}")
    return there, gone, candidates


def once(functions):
    """Each C++ function once: its definition where there is one."""
    best = {}
    for each in functions:
        alone = each.anonymous or each.file.startswith("web/")
        key = (library_of(each.file), each.name, each.parameters, each.file if alone else "")
        if key not in best or best[key].lines < each.lines:
            best[key] = each
    return sorted(best.values(), key=lambda f: (f.file, f.line))


def same_names(functions):
    files = collections.defaultdict(set)
    helpers = collections.defaultdict(set)
    for each in functions:
        if each.lines and each.anonymous and not each.member and each.body >= USUAL_BODY:
            files[each.name].add(each.file)
        name = each.name.rpartition("::")[2]
        if each.lines and name in HELPERS:
            helpers[name].add(f"{each.file}:{each.line}")
    return ({name: sorted(found) for name, found in sorted(helpers.items()) if len(found) > 1},
            {name: sorted(found) for name, found in sorted(files.items()) if len(found) > 2})


def figures_of(repository):
    texts = production(repository)
    functions = []
    for path, text in texts.items():
        functions += functions_of_ts(text, path) if path.startswith("web/") else functions_of_cpp(text, path)
    edges = [(path, line, target) for path, text in texts.items() for line, target in includes_of(path, text, texts)]
    lonely, headers = lonely_headers(edges, texts)
    helpers, names = same_names(functions)
    sizes = {library: [0, 0] for library in LIBRARIES}
    for path, text in texts.items():
        sizes[library_of(path)][0] += 1
        sizes[library_of(path)][1] += text.count("\n")
    long = sorted((f for f in functions if f.lines > LONGEST), key=lambda f: -f.lines)
    wide = sorted((f for f in once(functions) if f.parameters > MOST_PARAMETERS), key=lambda f: -f.parameters)
    figures = {
        "files and lines": {**sizes, "all": [sum(s[0] for s in sizes.values()), sum(s[1] for s in sizes.values())]},
        "long functions": [[f"{f.file}:{f.line}", f.name, f.lines] for f in long],
        "functions of many parameters": [[f"{f.file}:{f.line}", f.name, f.parameters] for f in wide],
        "folder pairs": folder_pairs(edges),
        "circles of folders": folder_circles(edges),
        "page files that import each other": file_pairs([e for e in edges if e[0].startswith("web/")]),
        "private headers": headers,
        "headers of one user": {h: u[0] for h, u in lonely.items() if u},
        "headers of no user": [h for h, u in lonely.items() if not u],
        "helpers": helpers, "anonymous functions": names,
        "kinds": {kind: dict(zip(("there", "gone", "candidates"), known_and_candidates(kind, texts)))
                  for kind in KNOWN},
    }
    return figures


def report(figures):
    def title(text, count):
        print(f"\n{text}: {count}")

    print(f"{'library':14}{'files':>7}{'lines':>9}")
    for library, (files, lines) in figures["files and lines"].items():
        print(f"{library:14}{files:7}{lines:9}")
    title(f"functions over {LONGEST} lines", len(figures["long functions"]))
    for place, name, lines in figures["long functions"]:
        print(f"  {lines:4} {place} {name}")
    title(f"functions with more than {MOST_PARAMETERS} parameters", len(figures["functions of many parameters"]))
    for place, name, count in figures["functions of many parameters"]:
        print(f"  {count:4} {place} {name}")
    title("pairs of folders that include each other", len(figures["folder pairs"]))
    for library, a, b, there, back in figures["folder pairs"]:
        print(f"  {library}: {a} <-> {b}\n    {there}\n    {back}")
    title("circles of folders", len(figures["circles of folders"]))
    for library, folders in figures["circles of folders"]:
        print(f"  {library}: {' '.join(folders)}")
    title("files of the page that import each other", len(figures["page files that import each other"]))
    for a, b in figures["page files that import each other"]:
        print(f"  {a} <-> {b}")
    title(f"private headers with one user, of {figures['private headers']}", len(figures["headers of one user"]))
    for header, user in figures["headers of one user"].items():
        print(f"  {header} <- {user}")
    title("private headers with no user but their own source", len(figures["headers of no user"]))
    for header in figures["headers of no user"]:
        print(f"  {header}")
    for kind, lists in figures["kinds"].items():
        title(kind, len(lists["there"]))
        for file, name, word in lists["there"]:
            print(f"  {word}: {file} {name}")
        for file, name, _ in lists["gone"]:
            print(f"  gone: {file} {name}")
        for candidate in lists["candidates"]:
            print(f"  candidate, not in the list: {candidate}")
    title("helper functions that exist more than once", len(figures["helpers"]))
    for name, places in figures["helpers"].items():
        print(f"  {name}: {', '.join(places)}")
    title(f"functions of one name in anonymous namespaces of three or more files, {USUAL_BODY}+ lines",
          len(figures["anonymous functions"]))
    for name, files in figures["anonymous functions"].items():
        print(f"  {name} ({len(files)}): {', '.join(files)}")


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("repository", type=pathlib.Path)
    parser.add_argument("--json", type=pathlib.Path)
    parser.add_argument("--limits", action="store_true", help="exit 1 when folders include each other")
    arguments = parser.parse_args()
    figures = figures_of(arguments.repository)
    report(figures)
    if arguments.json:
        arguments.json.write_text(json.dumps(figures, indent=1) + "\n")
    return 1 if arguments.limits and (figures["folder pairs"] or figures["circles of folders"]) else 0


if __name__ == "__main__":
    sys.exit(main())
