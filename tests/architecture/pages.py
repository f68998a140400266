#!/usr/bin/env python3
"""Checks the pages (*.md): prose of at most 120 columns, sizes, links and paths that exist, commands that are run.

usage: pages.py REPOSITORY

A block ```sh is preceded by `<!-- run by FILE -->` or `<!-- served by FILE -->` (a test that runs it), or by
`<!-- not run: REASON -->`. Synopses with placeholders are ```text. A path in backticks that begins with a folder of the
repository, and a source file's name, must exist. Exit code 1 with one line for each fault: FILE:LINE: what, what to do.
"""

import glob
import os
import pathlib
import re
import sys

COLUMNS, README_BYTES, CHANGELOG_LINES = 120, 7000, 60
FOLDERS = ("cmake", "localization", "mapping", "maps", "server", "tests", "web")
SKIPPED = ("node_modules", "build", ".git")
SOURCES = (".hpp", ".cpp", ".py", ".sh", ".mjs", ".ts", ".tsx", ".md")
RUNNER = "tests/integration/readme_test.py"
LINK = re.compile(r"\]\(([^()\s]+)\)")
SPAN = re.compile(r"`([^`\n]+)`")
PATH = re.compile(r"[\w.*-]+(?:/[\w.*-]+)+/?")
MARK = re.compile(r"<!-- (?:(?:run|served) by (\S+)|not run: .+) -->")


def visible(line):
    """A line without what cannot be broken: targets of links, addresses."""
    return re.sub(r"<https?:[^>]*>|https?:\S+", "", LINK.sub("]", line))


def without_code(text):
    """(lines, lines of code): the first with code blocks blanked, so that numbers stay."""
    lines, inside, fence = [], False, False
    for line in text.split("\n"):
        if line.lstrip().startswith("```"):
            fence = not fence
            lines.append("")
            continue
        blank_before = not lines or not lines[-1].strip()
        inside = not fence and line.startswith("    ") and (inside or blank_before) and not re.match(r"\s+([-*]|\d+\.) ", line)
        lines.append("" if fence or inside else line)
    return lines


def anchor_of(heading):
    """As GitHub makes them."""
    text = re.sub(r"[^\w\s-]", "", re.sub(r"\]\([^)]*\)|[`\[]", "", heading).strip().lower())
    return text.replace(" ", "-")


def anchors_of(page):
    seen = {}
    for line in without_code(page.read_text()):
        match = re.match(r"#{1,6} (.*)", line)
        if match:
            name = anchor_of(match.group(1))
            seen[name] = seen.get(name, -1) + 1
            if seen[name]:
                seen[f"{name}-{seen[name]}"] = 0
    return set(seen)


class Pages:
    def __init__(self, root):
        self.root = root
        self.pages, self.names = [], set()
        for folder, folders, files in os.walk(root):
            folders[:] = sorted(name for name in folders if name not in SKIPPED)
            self.names.update(files)
            self.pages += [pathlib.Path(folder) / name for name in sorted(files) if name.endswith(".md")]
        lists = root / "tests/integration/CMakeLists.txt"
        self.listed = lists.read_text().split() if lists.exists() else []

    def faults(self):
        for page in self.pages:
            name = page.relative_to(self.root).as_posix()
            text = page.read_text()
            if name == "README.md" and len(text.encode()) > README_BYTES:
                yield f"{name}: {len(text.encode())} bytes, at most {README_BYTES}: move what is not for the first two minutes"
            if name == "CHANGELOG.md" and text.count("\n") > CHANGELOG_LINES:
                yield f"{name}: {text.count(chr(10))} lines, at most {CHANGELOG_LINES}: keep what a user of a release must know"
            for number, fault in [*self.of_prose(page, text), *self.of_commands(name, text)]:
                yield f"{name}:{number}: {fault}"

    def of_prose(self, page, text):
        for number, line in enumerate(without_code(text), 1):
            for target in LINK.findall(line):
                if not self.link_exists(page, target):
                    yield number, f"no such file or heading: {target}; correct the link"
            for span in SPAN.findall(line):
                if not self.path_exists(page, span):
                    yield number, f"no such path: {span}; correct it, or name the folder"
            if not line.lstrip().startswith(("|", "![", "<!--", "#")) and len(visible(line)) > COLUMNS:
                yield number, f"{len(line)} columns, at most {COLUMNS}: break the line"

    def link_exists(self, page, target):
        if re.match(r"[a-z]+:", target):
            return True
        path, _, anchor = target.partition("#")
        file = page.parent / path if path else page
        if not file.exists():
            return False
        return not anchor or file.suffix != ".md" or anchor in anchors_of(file)

    def path_exists(self, page, span):
        if "/" not in span:
            return not (re.fullmatch(r"[\w-]+(\.[\w-]+)*", span) and span.endswith(SOURCES)) or span in self.names
        first = span.split("/")[0]
        if not PATH.fullmatch(span) or first not in FOLDERS:
            return True
        below = "/".join(span.split("/")[1:])
        places = [self.root / span, page.parent / span, self.root / first / "include/stillmap" / first / below,
                  self.root / "mapping/include/stillmap" / span]
        return any(glob.glob(str(place)) for place in places)

    def of_commands(self, name, text):
        lines = text.split("\n")
        for number, line in enumerate(lines, 1):
            if line.strip() != "```sh":
                continue
            before = [other for other in lines[max(0, number - 3):number - 1] if other.strip()]
            mark = MARK.fullmatch(before[-1].strip()) if before else None
            if not mark:
                yield number, "a command that no test runs: put '<!-- run by FILE -->' or '<!-- not run: REASON -->' before it"
            elif mark.group(1) and not (self.root / mark.group(1)).exists():
                yield number, f"no such test: {mark.group(1)}"
            elif mark.group(1) == RUNNER and not any(word.strip("()") == name for word in self.listed):
                yield number, f"{name} is not among the pages that tests/integration/CMakeLists.txt gives to {RUNNER}; add it"


def main():
    faults = list(Pages(pathlib.Path(sys.argv[1]).resolve()).faults())
    print(*faults, sep="\n")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
