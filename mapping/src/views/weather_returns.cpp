#include "views/weather_returns.hpp"

#include "views/view_grid.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <iterator>

namespace stillmap::mapping {
namespace {

/// Drops farther away than this return too little [m].
constexpr float kWeatherReachM = 25.0F;
/// Rain is told from clear weather by what is nearer than this [m], where drops are most.
constexpr float kWeatherNearM = 15.0F;
constexpr double kWeatherShare = 0.01;

/// Bins around a return's own, to each side: a degree.
constexpr int kAround = 3;
constexpr int kFewestNear = 2;
constexpr int kFewestBeyond = 8;
/// Of one surface are returns whose ranges differ by less than this.
constexpr float kSameRangeM = 0.2F;
constexpr float kSameRangePerM = 0.02F;

/// Nearest and farthest return of each direction.
class NeighbourRanges {
 public:
  explicit NeighbourRanges(std::span<const Eigen::Vector3f> positions)
      : bin_of_(positions.size()), range_m_(positions.size()) {
    int lowest = ViewGrid::kRows, highest = -1;
    std::vector<std::uint16_t> rows(positions.size());
    for (std::size_t i = 0; i < positions.size(); ++i) {
      const int row = ViewGrid::row_of(ViewGrid::elevation(positions[i]));
      rows[i] = static_cast<std::uint16_t>(row);
      lowest = std::min(lowest, row);
      highest = std::max(highest, row);
    }
    // A margin of empty rows, so that no window ends at a border.
    const int count = std::max(0, highest - lowest + 1) + 2 * kAround;
    bins_.resize(static_cast<std::size_t>(count) * ViewGrid::kColumns);
    for (std::size_t i = 0; i < positions.size(); ++i) {
      const int column = ViewGrid::wrapped(ViewGrid::column_of(ViewGrid::azimuth(positions[i])));
      bin_of_[i] = (rows[i] - lowest + kAround) * ViewGrid::kColumns + column;
      range_m_[i] = positions[i].norm();
      Bin& bin = bins_[static_cast<std::size_t>(bin_of_[i])];
      bin.nearest = bin.farthest > 0.0F ? std::min(bin.nearest, range_m_[i]) : range_m_[i];
      bin.farthest = std::max(bin.farthest, range_m_[i]);
    }
  }

  [[nodiscard]] float range_m(std::size_t i) const { return range_m_[i]; }

  /// Directions around a return with another one near its range, counted up to `kFewestNear`, and
  /// those with one beyond.
  struct Count {
    int near = 0, beyond = 0;
    [[nodiscard]] bool alone() const { return near < kFewestNear; }
    [[nodiscard]] bool passed() const { return alone() && beyond >= kFewestBeyond; }
  };
  [[nodiscard]] Count around(std::size_t i) const {
    const float range = range_m_[i];
    const float same = kSameRangeM + kSameRangePerM * range;
    const int row = bin_of_[i] / ViewGrid::kColumns, column = bin_of_[i] % ViewGrid::kColumns;
    Count count;
    // From the inside out: most points meet their neighbours at once.
    for (const int dy : kFromInside) {
      for (const int dx : kFromInside) {
        const Bin& b = bins_[static_cast<std::size_t>((row + dy) * ViewGrid::kColumns +
                                                      ViewGrid::wrapped(column + dx))];
        if (b.farthest <= 0.0F) continue;
        if (b.farthest > range + same) ++count.beyond;
        if (dx == 0 && dy == 0) continue;
        if (std::abs(b.nearest - range) > same && std::abs(b.farthest - range) > same) continue;
        if (++count.near >= kFewestNear) return count;
      }
    }
    return count;
  }

 private:
  static constexpr int kFromInside[] = {0, -1, 1, -2, 2, -3, 3};
  static_assert(std::size(kFromInside) == 2 * kAround + 1);
  struct Bin {
    float nearest = 0.0F, farthest = 0.0F;
  };

  std::vector<int> bin_of_;
  std::vector<float> range_m_;
  std::vector<Bin> bins_;
};

}  // namespace

std::vector<bool> find_weather_returns(std::span<const Eigen::Vector3f> positions) {
  const NeighbourRanges neighbours(positions);
  std::vector<bool> flags(positions.size());
  std::size_t near = 0, passed = 0;
  for (std::size_t i = 0; i < positions.size(); ++i) {
    if (neighbours.range_m(i) > kWeatherReachM) continue;
    const NeighbourRanges::Count count = neighbours.around(i);
    flags[i] = count.alone();
    if (neighbours.range_m(i) > kWeatherNearM) continue;
    ++near;
    passed += count.passed() ? 1 : 0;
  }
  if (static_cast<double>(passed) <= kWeatherShare * static_cast<double>(near)) return {};
  return flags;
}

std::vector<bool> find_weather_of_lidars(const maps::PointCloud& cloud) {
  if (cloud.lidars.empty()) return find_weather_returns(cloud.positions);
  std::vector<bool> all;
  for (std::size_t lidar = 0; lidar < cloud.lidar_origins.size(); ++lidar) {
    const std::vector<bool> weather = find_weather_returns(cloud.of_lidar(lidar).positions);
    if (weather.empty()) continue;
    all.resize(cloud.size());
    auto next = weather.begin();
    for (std::size_t i = 0; i < cloud.size(); ++i) {
      if (cloud.lidars[i] == lidar) all[i] = *next++;
    }
  }
  return all;
}

}  // namespace stillmap::mapping
