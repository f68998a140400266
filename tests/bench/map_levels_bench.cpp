// What levels of detail of a map cost, beside reading its tiles once.
//
//   map_levels_bench MAP [--repeat N] [--other MAP]
//
// MAP is a package of one's own: its folder `levels/` is written. Prints points, tiles and bytes of
// each level, the time of a checksum over all tiles (every byte read once, from memory), of making
// the levels with one thread and with all, and of opening them, each the fastest of the repeats on
// the wall and of the processor. With --other the difference of the two is timed too.

#include <stillmap/maps/crc32c.hpp>
#include <stillmap/maps/map_difference.hpp>
#include <stillmap/maps/map_levels.hpp>
#include <stillmap/maps/tileset.hpp>

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include <sys/resource.h>

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <ctime>
#include <exception>
#include <filesystem>
#include <functional>
#include <limits>
#include <span>
#include <thread>
#include <vector>

namespace stillmap::maps {
namespace {

struct Seconds {
  double wall = std::numeric_limits<double>::infinity();
  double cpu = std::numeric_limits<double>::infinity();
};

Seconds fastest(int repeat, const std::function<void()>& work) {
  Seconds best;
  for (int i = 0; i < repeat; ++i) {
    const auto begin = std::chrono::steady_clock::now();
    const std::clock_t cpu = std::clock();
    work();
    const std::chrono::duration<double> wall = std::chrono::steady_clock::now() - begin;
    best.wall = std::min(best.wall, wall.count());
    best.cpu = std::min(best.cpu, static_cast<double>(std::clock() - cpu) / CLOCKS_PER_SEC);
  }
  return best;
}

void print(const char* what, const Seconds& seconds, const Seconds& reading) {
  fmt::print("{:<28} {:8.3f} s wall {:8.3f} s cpu {:8.1f} x reading\n", what, seconds.wall,
             seconds.cpu, seconds.cpu / reading.cpu);
}

void print_levels(const MapPackage& map, const MapLevels& levels) {
  std::vector<std::uint64_t> points(levels.top() + 1);
  std::vector<std::size_t> tiles(levels.top() + 1);
  const auto count = [&](const TileEntry& tile) {
    points.at(tile.id.level) += tile.points;
    ++tiles.at(tile.id.level);
  };
  for (const TileEntry& tile : map.tiles()) count(tile);
  for (const TileEntry& tile : levels.tiles()) count(tile);
  for (std::size_t level = 0; level < points.size(); ++level) {
    fmt::print("level {:>2} {:>12} points {:>6} tiles {:>14} bytes\n", level, points[level],
               tiles[level], points[level] * sizeof(MapPoint));
  }
}

void run(const std::filesystem::path& folder, const std::filesystem::path& other, int repeat) {
  const auto map = MapPackage::open(folder);
  std::uint32_t sum = 0;
  const Seconds reading = fastest(repeat, [&] {
    for (const TileEntry& tile : map->tiles()) {
      const std::vector<MapPoint> points = map->tile(tile.id).points_from(corner_of(tile.id));
      sum ^= crc32c(std::as_bytes(std::span(points)));
    }
  });
  std::filesystem::path file;
  const Seconds one = fastest(repeat, [&] { file = MapLevels::make(*map); });
  const Seconds all = fastest(repeat, [&] {
    MapLevels::make(*map,
                    {.threads = std::max(1U, std::thread::hardware_concurrency()), .go_on = {}});
  });
  const Seconds opening = fastest(repeat, [&] { (void)Tileset(*map, *MapLevels::open(*map)); });
  const auto levels = MapLevels::open(*map);
  print_levels(*map, *levels);
  fmt::print("levels.tiles {} bytes, tileset.json {} bytes (sum of checksums {:08x})\n",
             std::filesystem::file_size(file), Tileset(*map, *levels).text().size(), sum);
  print("reading every tile once", reading, reading);
  print("levels, one thread", one, reading);
  print("levels, all threads", all, reading);
  print("opening levels and tileset", opening, reading);
  if (!other.empty()) {
    const auto second = MapPackage::open(other);
    const double tolerance_m = MapDifference::usual_tolerance_m(*map, *second);
    print("difference, one thread",
          fastest(repeat, [&] { MapDifference::make(*map, *second, tolerance_m); }), reading);
  }
  struct rusage usage {};
  ::getrusage(RUSAGE_SELF, &usage);
  fmt::print("most memory {} MiB\n", usage.ru_maxrss / 1024);
}

}  // namespace
}  // namespace stillmap::maps

int main(int argc, char** argv) {
  CLI::App app("What levels of detail of a map cost");
  std::filesystem::path map, other;
  int repeat = 3;
  app.add_option("MAP", map)->required()->check(CLI::ExistingDirectory);
  app.add_option("--other", other)->check(CLI::ExistingDirectory);
  app.add_option("--repeat", repeat)->check(CLI::PositiveNumber);
  CLI11_PARSE(app, argc, argv);
  try {
    stillmap::maps::run(map, other, repeat);
  } catch (const std::exception& error) {
    fmt::print(stderr, "map_levels_bench: {}\n", error.what());
    return 1;
  }
  return 0;
}
