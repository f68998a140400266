// What it costs to load a map for localization: package, index and aligner.
//
//   map_load_bench MAP
//
// MAP is a package whose index is made when there is none. Prints the shortest of nine loads, with
// the files in the system's cache, and the anonymous memory that the last one and a query take.

#include <stillmap/localization/aligner.hpp>
#include <stillmap/maps/map_package.hpp>

#include <fmt/format.h>

#include <malloc.h>

#include <algorithm>
#include <chrono>
#include <exception>
#include <fstream>
#include <limits>
#include <memory>
#include <string>

namespace {

using namespace stillmap;

struct Loaded {
  explicit Loaded(const std::string& folder)
      : map(maps::MapPackage::open(folder)), aligner(localization::make_aligner("default", *map)) {}
  std::shared_ptr<const maps::MapPackage> map;
  std::unique_ptr<localization::Aligner> aligner;
};

long anonymous_kb() {
  malloc_trim(0);
  std::ifstream in("/proc/self/smaps_rollup");
  long kb = 0;
  for (std::string word; in >> word;)
    if (word == "Anonymous:") in >> kb;
  return kb;
}

/// A pattern of points around the sensor: what it is answered does not matter.
maps::PointCloud some_scan() {
  maps::PointCloud scan;
  for (int k = 0; k < 4000; ++k)
    scan.positions.emplace_back(0.01F * static_cast<float>(k % 997) - 5.0F,
                                0.013F * static_cast<float>(k % 701) - 4.0F,
                                0.001F * static_cast<float>(k % 1999) - 1.0F);
  return scan;
}

void measure(const std::string& folder) {
  { const Loaded first(folder); }
  const long before_kb = anonymous_kb();
  double best_ms = std::numeric_limits<double>::infinity();
  std::unique_ptr<Loaded> last;
  for (int i = 0; i < 9; ++i) {
    last.reset();
    const auto begin = std::chrono::steady_clock::now();
    last = std::make_unique<Loaded>(folder);
    const std::chrono::duration<double, std::milli> took = std::chrono::steady_clock::now() - begin;
    best_ms = std::min(best_ms, took.count());
  }
  fmt::print("load {:.3f} ms, anonymous memory {} kB", best_ms, anonymous_kb() - before_kb);
  const auto places = localization::seen_from(*last->map);
  if (!places.empty()) {
    localization::Prior prior;
    prior.T_map_lidar = places[places.size() / 2];
    (void)last->aligner->align(some_scan(), prior);
    fmt::print(", after a query {} kB", anonymous_kb() - before_kb);
  }
  fmt::print("\n");
}

}  // namespace

int main(int count, char** arguments) {
  if (count != 2) {
    fmt::print(stderr, "usage: map_load_bench MAP\n");
    return 2;
  }
  try {
    measure(arguments[1]);
  } catch (const std::exception& error) {
    fmt::print(stderr, "{}\n", error.what());
    return 1;
  }
  return 0;
}
