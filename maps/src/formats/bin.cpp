#include "formats/bin.hpp"

#include <stillmap/maps/error.hpp>

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <vector>

#include "formats/point_table.hpp"

namespace stillmap::maps {

static_assert(std::endian::native == std::endian::little, "scans are copied as they lie in files");

namespace {

constexpr std::size_t kMostColumns = 32;
/// Points of a file that are looked at to tell its columns.
constexpr std::size_t kSampledPoints = 4000;
constexpr std::size_t kFewestSampled = 1000;

float number_at(std::span<const std::byte> bytes, std::size_t number) {
  float value = 0.0F;
  std::memcpy(&value, &bytes[number * sizeof(float)], sizeof(float));
  return value;
}

void require_times(const PointCloud& cloud, const std::string& name) {
  for (std::size_t i = 0; i < cloud.time_offsets_s.size(); ++i) {
    if (std::abs(cloud.time_offsets_s[i]) <= kMaxTimeOffsetS) continue;
    throw InputError(
        name, fmt::format("point {} at {} s", cloud.file_index(i), cloud.time_offsets_s[i]),
        fmt::format("within {} s of the scan's stamp: write times that count from this stamp",
                    kMaxTimeOffsetS));
  }
}

/// Values of each column of points spread over the file, sorted; empty for a size of no whole
/// number of points, or one with numbers that are no coordinates.
std::vector<std::vector<float>> sorted_columns(std::span<const std::byte> bytes,
                                               std::size_t columns) {
  const std::size_t point_bytes = columns * sizeof(float);
  const std::size_t points = bytes.size() / point_bytes;
  if (bytes.size() % point_bytes != 0 || points < kFewestSampled) return {};
  std::vector<std::vector<float>> values(columns);
  const std::size_t step = std::max<std::size_t>(points / kSampledPoints, 1);
  for (std::size_t k = 0; k < points / step; ++k) {
    // Not every `step`th: a multiple of the right number of columns would see one phase of them.
    const std::size_t point = k * step + k % step;
    for (std::size_t c = 0; c < columns; ++c) {
      const float value = number_at(bytes, point * columns + c);
      if (std::isfinite(value)) values[c].push_back(value);
    }
  }
  for (std::vector<float>& column : values) {
    if (column.size() < kFewestSampled / 2) return {};
    std::sort(column.begin(), column.end());
  }
  return values;
}

/// Kolmogorov and Smirnov's distance of two samples, sorted: the most by which their shares below a
/// value differ.
double distance_between(const std::vector<float>& a, const std::vector<float>& b) {
  double most = 0.0;
  for (std::size_t i = 0, j = 0; i < a.size() && j < b.size();) {
    const float value = std::min(a[i], b[j]);
    while (i < a.size() && a[i] == value) ++i;
    while (j < b.size() && b[j] == value) ++j;
    most = std::max(most, std::abs(static_cast<double>(i) / static_cast<double>(a.size()) -
                                   static_cast<double>(j) / static_cast<double>(b.size())));
  }
  return most;
}

/// How far any two columns differ, in [0, 1]; 0 where there are none.
double difference_of(const std::vector<std::vector<float>>& columns) {
  double most = 0.0;
  for (std::size_t a = 0; a < columns.size(); ++a)
    for (std::size_t b = a + 1; b < columns.size(); ++b)
      most = std::max(most, distance_between(columns[a], columns[b]));
  return most;
}

/// What a sorted column beyond x y z intensity may be.
char letter_of(const std::vector<float>& column) {
  constexpr float kMostRings = 256.0F;
  const bool is_whole = std::ranges::all_of(column, [](float v) { return v == std::floor(v); });
  if (is_whole && column.front() >= 0.0F && column.back() < kMostRings) return 'r';
  const float span = column.back() - column.front();
  const bool is_time = std::abs(column.front()) <= kMaxTimeOffsetS &&
                       std::abs(column.back()) <= kMaxTimeOffsetS && span > 0.02F && span < 0.25F;
  return is_time ? 't' : '_';
}

std::string named(const std::vector<std::vector<float>>& columns) {
  std::string letters = std::string("xyzi").substr(0, std::min<std::size_t>(columns.size(), 4));
  for (std::size_t c = 4; c < columns.size(); ++c) {
    const char letter = letter_of(columns[c]);
    letters += letter == 't' && letters.find('t') != std::string::npos ? '_' : letter;
  }
  return letters;
}

std::string expected_size(std::string_view columns) {
  std::string names;
  for (const char c : columns)
    names += std::string(" ") + (c == 'i'   ? "intensity"
                                 : c == 't' ? "time"
                                 : c == 'r' ? "ring"
                                            : std::string(1, c));
  return fmt::format("a multiple of {} (float32{})", columns.size() * sizeof(float), names);
}

}  // namespace

void require_bin_columns(const std::string& columns) {
  const auto count = [&](char letter) { return std::ranges::count(columns, letter); };
  const bool is_known = columns.find_first_not_of("xyzitr_") == std::string::npos;
  if (is_known && columns.size() <= kMostColumns && count('x') == 1 && count('y') == 1 &&
      count('z') == 1 && count('i') <= 1 && count('t') <= 1)
    return;
  throw InputError(
      "columns", "'" + columns.substr(0, 64) + "'",
      "a letter for each float32 of a point: x, y and z once each, i (intensity) and t "
      "(time) at most once, r (ring) or _ for what is left out, as in columns=xyzir");
}

DecodedScan decode_bin(std::span<const std::byte> bytes, std::string_view columns,
                       const std::string& name, std::size_t max_points) {
  const std::size_t stride = columns.size() * sizeof(float);
  if (bytes.size() % stride != 0) {
    const auto other = other_bin_columns(bytes);
    throw InputError(name, std::to_string(bytes.size()) + " bytes",
                     expected_size(columns) +
                         (other ? fmt::format(": these look like {} numbers a point; write x y z "
                                              "intensity, or give a folder as "
                                              "'FOLDER?columns={}'",
                                              other->size(), *other)
                                : ": copy the file again, or check which numbers it holds"));
  }
  DecodedScan scan;
  scan.points_in_file = bytes.size() / stride;
  check_point_count(scan.points_in_file, max_points, name);
  scan.cloud.positions.resize(scan.points_in_file);
  const auto take = [&](std::size_t column, const auto& set) {
    const std::byte* number = bytes.data() + column * sizeof(float);
    for (std::size_t i = 0; i < scan.points_in_file; ++i, number += stride) {
      float value;
      std::memcpy(&value, number, sizeof(float));
      set(i, value);
    }
  };
  for (std::size_t c = 0; c < columns.size(); ++c) {
    const char letter = columns[c];
    if (letter == 'i') {
      scan.cloud.intensities.resize(scan.points_in_file);
      take(c, [&](std::size_t i, float value) { scan.cloud.intensities[i] = value; });
    } else if (letter == 't') {
      scan.cloud.time_offsets_s.resize(scan.points_in_file);
      take(c, [&](std::size_t i, float value) { scan.cloud.time_offsets_s[i] = value; });
    } else if (letter >= 'x' && letter <= 'z') {
      take(c, [&](std::size_t i, float value) { scan.cloud.positions[i][letter - 'x'] = value; });
    }
  }
  scan.dropped = drop_invalid(scan.cloud);
  require_times(scan.cloud, name);
  return scan;
}

std::optional<std::string> other_bin_columns(std::span<const std::byte> bytes) {
  // A mixture of columns differs from another mixture at most as much as the columns do.
  constexpr double kSurelyMore = 0.25;
  constexpr double kAsGood = 0.15;
  constexpr std::array<std::size_t, 7> kOthers{3, 5, 6, 7, 8, 9, 10};
  std::array<std::vector<std::vector<float>>, kOthers.size()> columns;
  std::array<double, kOthers.size()> differences{};
  for (std::size_t i = 0; i < kOthers.size(); ++i) {
    columns[i] = sorted_columns(bytes, kOthers[i]);
    differences[i] = difference_of(columns[i]);
  }
  const double most = std::ranges::max(differences);
  if (most - difference_of(sorted_columns(bytes, 4)) < kSurelyMore) return std::nullopt;
  const auto best =
      std::ranges::find_if(differences, [&](double d) { return d >= most - kAsGood; });
  return named(columns[static_cast<std::size_t>(best - differences.begin())]);
}

}  // namespace stillmap::maps
