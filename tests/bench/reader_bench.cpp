// Reading the formats of scans and of maps, beside reading their bytes: MB/s by the time of the
// CPU, best of some rounds, all files in the page cache. usage: reader_bench FOLDER [--points N]
//
// FOLDER gets the files, which stay: scans of 120,000 points in every format of scans, read by
// `read_scan_file` over and over as a drive is, and one map of N points in every format of maps, by
// `read_cloud_file`.
#include "support/las_bytes.hpp"

#include <stillmap/maps/cloud_file.hpp>
#include <stillmap/maps/scan_file.hpp>

#include <fcntl.h>
#include <fmt/core.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "unit/maps/scan_bytes.hpp"

namespace {

using namespace stillmap;
namespace fs = std::filesystem;

constexpr std::size_t kScanPoints = 120'000;
constexpr double kLeastBytesARound = 100e6;
constexpr int kRounds = 5;

/// Of this process: who shares the cores does not count.
double now_cpu_s() {
  timespec now{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

using Point = std::array<float, 4>;

/// A sweep over a street, so that text and compression meet digits as they come.
std::vector<Point> make_points(std::size_t count) {
  std::vector<Point> points(count);
  for (std::size_t i = 0; i < count; ++i) {
    const auto ring = static_cast<float>(i % 64);
    const auto turn = 6.2831853F * static_cast<float>(i) / static_cast<float>(count);
    const float range_m = 3.0F + static_cast<float>(i * 2654435761U % 40'000U) * 0.001F;
    points[i] = {range_m * std::cos(turn), range_m * std::sin(turn), -1.7F + 0.05F * ring,
                 static_cast<float>(i * 7919U % 256U) / 255.0F};
  }
  return points;
}

std::string pcd(const std::vector<Point>& points, const std::string& encoding,
                const std::string& body) {
  return fmt::format(
             "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z intensity\nSIZE 4 4 4 4\nTYPE F F F F\n"
             "COUNT 1 1 1 1\nWIDTH {0}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {0}\nDATA {1}\n",
             points.size(), encoding) +
         body;
}

std::string rows(const std::vector<Point>& points) {
  return {reinterpret_cast<const char*>(points.data()), points.size() * sizeof(Point)};
}

std::string columns(const std::vector<Point>& points) {
  std::string bytes;
  for (std::size_t column = 0; column < 4; ++column)
    for (const Point& point : points) test::append(bytes, point[column]);
  return bytes;
}

/// LZF with a reference to the last place of the same three bytes, as quick writers do.
std::string lzf(const std::string& in) {
  std::string out;
  std::vector<std::size_t> last(std::size_t{1} << 16U, in.size());
  std::string literals;
  const auto flush = [&] {
    if (literals.empty()) return;
    out += static_cast<char>(literals.size() - 1);
    out += literals;
    literals.clear();
  };
  for (std::size_t i = 0; i < in.size();) {
    std::size_t length = 0, from = in.size();
    if (i + 3 <= in.size()) {
      std::uint32_t next = 0;
      std::memcpy(&next, &in[i], 3);
      from = std::exchange(last[next * 2654435761U >> 16U], i);
      const std::size_t most = std::min<std::size_t>(264, in.size() - i);
      if (from < i && i - from <= 8192)
        while (length < most && in[from + length] == in[i + length]) ++length;
    }
    if (length < 3) {
      literals += in[i++];
      if (literals.size() == 32) flush();
      continue;
    }
    flush();
    const std::size_t distance = i - from - 1, code = length - 2;
    out += static_cast<char>(std::min<std::size_t>(code, 7) << 5U | distance >> 8U);
    if (code >= 7) out += static_cast<char>(code - 7);
    out += static_cast<char>(distance & 255U);
    i += length;
  }
  flush();
  return out;
}

std::string compressed(const std::string& unpacked) {
  const std::string packed = lzf(unpacked);
  std::string body;
  test::append(body, static_cast<std::uint32_t>(packed.size()));
  test::append(body, static_cast<std::uint32_t>(unpacked.size()));
  return body + packed;
}

std::string text_rows(const std::vector<Point>& points) {
  std::string text;
  for (const Point& point : points)
    text += fmt::format("{} {} {} {}\n", point[0], point[1], point[2], point[3]);
  return text;
}

std::string ply(const std::vector<Point>& points, const std::string& encoding,
                const std::string& body) {
  return fmt::format(
             "ply\nformat {} 1.0\nelement vertex {}\nproperty float x\nproperty float y\n"
             "property float z\nproperty float intensity\nend_header\n",
             encoding, points.size()) +
         body;
}

std::string las(const std::vector<Point>& points) {
  test::LasBytes bytes;
  bytes.minor = 4;
  bytes.format = 6;
  for (const Point& point : points)
    bytes.points.push_back({static_cast<std::int32_t>(point[0] * 1000.0F),
                            static_cast<std::int32_t>(point[1] * 1000.0F),
                            static_cast<std::int32_t>(point[2] * 1000.0F),
                            static_cast<std::uint16_t>(point[3] * 65535.0F)});
  return bytes.bytes();
}

struct Case {
  std::string name;
  std::function<std::string(const std::vector<Point>&)> bytes;
};

std::vector<Case> cases(bool scans) {
  using Points = std::vector<Point>;
  std::vector<Case> all{
      {"binary.pcd", [](const Points& p) { return pcd(p, "binary", rows(p)); }},
      {"ascii.pcd", [](const Points& p) { return pcd(p, "ascii", text_rows(p)); }},
      {"compressed.pcd",
       [](const Points& p) { return pcd(p, "binary_compressed", compressed(columns(p))); }},
      {"binary.ply", [](const Points& p) { return ply(p, "binary_little_endian", rows(p)); }},
      {"ascii.ply", [](const Points& p) { return ply(p, "ascii", text_rows(p)); }}};
  if (scans) all.insert(all.begin(), {"scan.bin", rows});
  if (!scans) all.push_back({"map.las", las});
  return all;
}

fs::path made(const fs::path& file, const Case& of, const std::vector<Point>& points) {
  if (!fs::exists(file)) {
    std::ofstream stream(file, std::ios::binary);
    stream << of.bytes(points);
    if (!stream.flush()) throw std::runtime_error("cannot write " + file.string());
  }
  return file;
}

/// As FileBytes does it: into memory that is not set first.
void read_bytes(const fs::path& file) {
  const int descriptor = ::open(file.c_str(), O_RDONLY | O_CLOEXEC);
  const auto size = static_cast<std::size_t>(fs::file_size(file));
  const auto bytes = std::make_unique_for_overwrite<char[]>(size);
  if (::read(descriptor, bytes.get(), size) != static_cast<ssize_t>(size))
    throw std::runtime_error("cannot read " + file.string());
  ::close(descriptor);
}

/// MB/s of the best round.
double rate(const fs::path& file, const std::function<void(const fs::path&)>& read) {
  const auto bytes = static_cast<double>(fs::file_size(file));
  const int times = std::max(1, static_cast<int>(kLeastBytesARound / bytes));
  double best_s = 1e9;
  for (int round = 0; round < kRounds; ++round) {
    const double begin_s = now_cpu_s();
    for (int i = 0; i < times; ++i) read(file);
    best_s = std::min(best_s, (now_cpu_s() - begin_s) / times);
  }
  return bytes * 1e-6 / best_s;
}

void print_rates(const fs::path& file, std::size_t points,
                 const std::function<void(const fs::path&)>& read) {
  const double alone = rate(file, read_bytes);
  const double with_points = rate(file, read);
  const double point_mb =
      static_cast<double>(fs::file_size(file)) / static_cast<double>(points) * 1e-6;
  fmt::print("{:22} {:8.1f} MB {:8.0f} MB/s {:8.0f} alone {:8.1f} million points/s\n",
             file.filename().string(), static_cast<double>(fs::file_size(file)) * 1e-6, with_points,
             alone, with_points / point_mb * 1e-6);
}

}  // namespace

int main(int count, char** words) {
  fs::path folder;
  std::size_t map_points = 2'000'000;
  CLI::App app("Speed of reading scans and point clouds");
  app.add_option("FOLDER", folder)->required();
  app.add_option("--points", map_points, "of a map")->capture_default_str();
  CLI11_PARSE(app, count, words);
  fs::create_directories(folder);
  const std::vector<Point> scan = make_points(kScanPoints), map = make_points(map_points);
  std::size_t taken = 0;
  fmt::print("scans of {} points\n", kScanPoints);
  for (const Case& each : cases(true))
    print_rates(made(folder / ("scan_" + each.name), each, scan), scan.size(),
                [&](const fs::path& file) { taken += maps::read_scan_file(file).cloud.size(); });
  fmt::print("maps of {} points\n", map_points);
  for (const Case& each : cases(false))
    print_rates(made(folder / ("map_" + each.name), each, map), map.size(),
                [&](const fs::path& file) {
                  (void)maps::read_cloud_file(
                      file, [&](std::span<const maps::CloudPoint> some) { taken += some.size(); });
                });
  return taken > 0 ? 0 : 1;
}
