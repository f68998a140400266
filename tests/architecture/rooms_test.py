#!/usr/bin/env python3
"""rooms.py counts functions, parameters and includes right in code that is hard to scan."""

import pathlib
import subprocess
import sys
import tempfile
import unittest

import rooms


def found(text):
    """{name: (first line, lines, parameters)} of what is defined."""
    return {f.name: (f.line, f.lines, f.parameters) for f in rooms.functions_of_cpp(text) if f.lines}


class Cpp(unittest.TestCase):
    def test_braces_in_text_open_nothing(self):
        self.assertEqual(found('''
void text() {
  call("{ \\" {", '{', '\\'', 1'000'000, u8"{");
  // { it's
  /* {{ "
  */
  call(R"({ " {)", R"x(}}} )" ")x");
}
int after(int a) { return a; }
'''), {"text": (2, 7, 0), "after": (9, 1, 1)})

    def test_constructors_with_initializers(self):
        self.assertEqual(found('''
struct Options {
  std::vector<int> sizes{1, 2};
  std::function<void(int, int)> done = [](int, int) { return; };
  Options() = default;
  explicit Options(int a, std::map<int, int> b = {{1, 2}})
      : sizes{a, 3},
        Base<int>{b},
        other_(b) {
    run();
  }
  ~Options() {}
};
Grid::Grid(const Options& options) : options_(options), cells_{} {}
'''), {"Options::Options": (6, 6, 2), "Options::~Options": (12, 1, 0), "Grid::Grid": (14, 1, 1)})

    def test_lambdas_belong_to_their_function(self):
        self.assertEqual(found('''
int outer() {
  const auto inner = [&](int a, int b, int c, int d, int e, int f) {
    if (a < b) { return c; }
    return d;
  };
  return inner(1, 2, 3, 4, 5, 6);
}
const auto kTable = [] { return 1; }();
'''), {"outer": (2, 7, 0)})

    def test_parameters(self):
        self.assertEqual({name: count for name, (_, _, count) in found('''
template <typename Key, int kMost = 3>
  requires std::is_integral_v<Key>
std::pair<Key, std::map<int, int>> templates(std::map<int, std::vector<int>> a,
                                             const std::function<void(int, int)>& b, int c = f(1, 2)) { return {}; }
void none(void) {}
[[nodiscard]] auto trailing(int a, int b) -> std::vector<std::pair<int, int>> { return {}; }
bool operator<(const A& a, const A& b) { return a.x < b.x; }
struct Call {
  int operator()(int a) const noexcept { return a; }
  bool operator==(const Call&) const = default;
  explicit operator bool() const { return true; }
};
extern "C" { int old(char* a, ...) { return 0; } }
''').items()}, {"templates": 3, "none": 0, "trailing": 2, "operator<": 2, "Call::operator()": 1,
                "Call::operatorbool": 0, "old": 2})

    def test_declarations_count_once(self):
        declared = rooms.functions_of_cpp("class A {\n  void set(int a, int b,\n int c, int d, int e, int f);\n};",
                                          "maps/a.hpp")
        defined = rooms.functions_of_cpp("void A::set(int a, int b, int c, int d, int e, int f) {\n}", "maps/a.cpp")
        self.assertEqual([(f.file, f.name, f.parameters) for f in rooms.once(declared + defined)],
                         [("maps/a.cpp", "A::set", 6)])

    def test_what_is_no_function(self):
        self.assertEqual(rooms.functions_of_cpp('''
#define MACRO(a, b) void a() { b
enum class E : std::uint8_t { kA = 1, kB = f(2) };
constexpr std::array<int, 2> kA{{1, 2}};
using F = std::function<void(int)>;
static_assert(sizeof(int) == 4, "four (");
struct alignas(64) Line { int a[3]{}; union { int b; float c; }; };
'''), [])

    def test_second_branches_are_left_out(self):
        self.assertEqual(found('#if A\nvoid f() {\n#else\nvoid f(int a) {\n#endif\n}\nvoid g() {}\n'),
                         {"f": (2, 5, 0), "g": (7, 1, 0)})

    def test_anonymous_namespaces(self):
        text = "namespace a::b {\nnamespace {\nvoid f() {\n  g();\n\n  g();\n  g();\n}\n}  // {\nvoid h() {}\n}\n"
        self.assertEqual([(f.name, f.anonymous, f.body) for f in rooms.functions_of_cpp(text)],
                         [("f", True, 3), ("h", False, 0)])


class TypeScript(unittest.TestCase):
    def test_functions_methods_and_arrows(self):
        text = '''
export function one(a: number, { b, c }: Options = {}): { d: number } {
  return { d: `}${a}` }; // }
}
interface Shape {
  area(scale: number): number
}
class Scene {
  private async draw(a: string): Promise<void> {
    if (a) { call("{"); }
  }
}
const arrow = async (a: number, b = "}"): Promise<number[]> => {
  return a.replace(/[{"']/g, b);
};
'''
        self.assertEqual([(f.name, f.line, f.lines, f.parameters) for f in rooms.functions_of_ts(text)],
                         [("one", 2, 3, 2), ("draw", 9, 3, 1), ("arrow", 13, 3, 2)])


class Includes(unittest.TestCase):
    FILES = {
        "maps/src/a/one.hpp": '#include "b/two.hpp"\n',
        "maps/src/b/two.hpp": "",
        "maps/src/b/two.cpp": '#include "two.hpp"\n// comment\n#include "a/one.hpp"\n',
        "maps/src/c/three.cpp": '#include "a/one.hpp"\n#include "d/four.hpp"\n',
        "maps/src/d/four.hpp": '#include "c/five.hpp"\n',
        "maps/src/c/five.hpp": "",
        "web/src/x/a.ts": 'import {\n  b,\n} from "../y/b";\n',
        "web/src/y/b.tsx": 'export { a } from "../x/a";\n',
    }

    def edges(self):
        return [(path, line, target) for path, text in self.FILES.items()
                for line, target in rooms.includes_of(path, text, self.FILES)]

    def test_pairs_of_folders_and_files(self):
        self.assertEqual([pair[:3] for pair in rooms.folder_pairs(self.edges())],
                         [("maps", "a", "b"), ("maps", "c", "d"), ("web", "x", "y")])
        self.assertEqual(rooms.folder_pairs(self.edges())[0][3:],
                         ("maps/src/a/one.hpp:1 -> maps/src/b/two.hpp", "maps/src/b/two.cpp:3 -> maps/src/a/one.hpp"))
        self.assertEqual(rooms.folder_circles(self.edges()), [("maps", ["a", "b"]), ("maps", ["c", "d"]),
                                                              ("web", ["x", "y"])])
        self.assertEqual(rooms.file_pairs(self.edges()), [("web/src/x/a.ts", "web/src/y/b.tsx")])

    def test_imports_of_the_page(self):
        files = {"web/src/a/a.ts": "", "web/src/a/b.tsx": "", "web/src/c/index.tsx": ""}
        text = """import './d.css';
import { useState } from 'preact/hooks';
import type { A } from '../a/a.js';
import '../a/b.js';
const later = () => import('../c/index.js');
function f(x: import('../a/a.js').A) {}
export {
  b,
} from '../a/b.js';
// what comes from '../a'
"""
        self.assertEqual(list(rooms.includes_of("web/src/c/e.ts", text, files)), [
            (3, "web/src/a/a.ts"), (4, "web/src/a/b.tsx"), (5, "web/src/c/index.tsx"), (6, "web/src/a/a.ts"),
            (9, "web/src/a/b.tsx")])

    def test_headers_with_one_user(self):
        lonely, headers = rooms.lonely_headers(self.edges(), self.FILES)
        self.assertEqual(headers, 4)
        self.assertEqual(lonely, {"maps/src/b/two.hpp": ["maps/src/a/one.hpp"],
                                  "maps/src/c/five.hpp": ["maps/src/d/four.hpp"],
                                  "maps/src/d/four.hpp": ["maps/src/c/three.cpp"]})

    def test_limits(self):
        with tempfile.TemporaryDirectory() as folder:
            for name, text in self.FILES.items():
                path = pathlib.Path(folder, name)
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_text(text)
            program = [sys.executable, rooms.__file__, folder, "--json", f"{folder}/figures.json"]
            self.assertEqual(subprocess.run(program, capture_output=True).returncode, 0)
            self.assertEqual(subprocess.run([*program, "--limits"], capture_output=True).returncode, 1)
            self.assertIn('"folder pairs"', pathlib.Path(folder, "figures.json").read_text())


if __name__ == "__main__":
    unittest.main()
