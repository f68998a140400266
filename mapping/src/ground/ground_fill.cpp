#include "ground/ground_fill.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <stdexcept>

namespace stillmap::mapping {
namespace {

constexpr double kMinConfidence = 0.05;
/// A point this far from the surface is no ground of it [m]; also what completeness is judged by.
constexpr double kOnGroundM = 0.05;

/// The columns of voxels of one tile.
class Columns {
 public:
  Columns(maps::TileId tile, double voxel_m) : voxel_m_(voxel_m) {
    const auto first = [&](std::int32_t index) {
      // The first column whose middle is not left of the border.
      return static_cast<std::int64_t>(std::ceil(index * maps::kTileSizeM / voxel_m - 0.5));
    };
    first_ = {first(tile.x), first(tile.y)};
    counts_ = {first(tile.x + 1) - first_[0], first(tile.y + 1) - first_[1]};
    heights_.assign(static_cast<std::size_t>(counts_[0] * counts_[1]),
                    std::numeric_limits<float>::quiet_NaN());
    taken_.assign(heights_.size(), 0);
  }

  /// Notes the height of the ground in all columns of a footprint.
  void cover(const GroundFootprint& footprint, const FusedGround& ground) {
    const Eigen::Vector2d reach = footprint.reach(0.0);
    const Eigen::Vector2d low = footprint.centre.head<2>() - reach;
    const Eigen::Vector2d high = footprint.centre.head<2>() + reach;
    for (std::int64_t y = clamped(low.y(), 1); y < clamped(high.y() + voxel_m_, 1); ++y) {
      for (std::int64_t x = clamped(low.x(), 0); x < clamped(high.x() + voxel_m_, 0); ++x) {
        const Eigen::Vector2d p = middle(x, y);
        float& height = heights_[number(x, y)];
        if (!std::isnan(height) || !footprint.covers(p)) continue;
        const auto sample = ground.at(p.x(), p.y(), footprint.centre.z());
        if (sample && sample->confidence >= kMinConfidence) height = static_cast<float>(sample->z);
      }
    }
  }

  void take(const Eigen::Vector3d& p, maps::PointKind kind) {
    if (kind != maps::PointKind::kGround && kind != maps::PointKind::kProjected) return;
    const std::int64_t x = column_of(p.x(), 0);
    const std::int64_t y = column_of(p.y(), 1);
    constexpr std::array<std::array<int, 2>, 5> kCross = {
        {{0, 0}, {-1, 0}, {1, 0}, {0, -1}, {0, 1}}};
    for (const auto& [dx, dy] : kCross) {
      if (!inside(x + dx, y + dy)) continue;
      const std::size_t n = number(x + dx, y + dy);
      // NaN, no footprint, fails.
      if (std::abs(p.z() - heights_[n]) <= kOnGroundM) taken_[n] = 1;
    }
  }

  [[nodiscard]] std::vector<Eigen::Vector3d> open() const {
    std::vector<Eigen::Vector3d> points;
    for (std::int64_t y = 0; y < counts_[1]; ++y) {
      for (std::int64_t x = 0; x < counts_[0]; ++x) {
        const std::size_t n = number(x, y);
        if (taken_[n] != 0 || std::isnan(heights_[n])) continue;
        const Eigen::Vector2d p = middle(x, y);
        points.emplace_back(p.x(), p.y(), heights_[n]);
      }
    }
    return points;
  }

 private:
  /// Of a place, not clamped: points beside the tile reach into it.
  [[nodiscard]] std::int64_t column_of(double value, std::size_t axis) const {
    return static_cast<std::int64_t>(std::floor(value / voxel_m_)) - first_[axis];
  }
  [[nodiscard]] std::int64_t clamped(double value, std::size_t axis) const {
    const double column = std::floor(value / voxel_m_) - static_cast<double>(first_[axis]);
    return static_cast<std::int64_t>(std::clamp(column, 0.0, static_cast<double>(counts_[axis])));
  }
  [[nodiscard]] bool inside(std::int64_t x, std::int64_t y) const {
    return x >= 0 && y >= 0 && x < counts_[0] && y < counts_[1];
  }
  [[nodiscard]] std::size_t number(std::int64_t x, std::int64_t y) const {
    return static_cast<std::size_t>(y * counts_[0] + x);
  }
  [[nodiscard]] Eigen::Vector2d middle(std::int64_t x, std::int64_t y) const {
    return voxel_m_ * Eigen::Vector2d(static_cast<double>(first_[0] + x) + 0.5,
                                      static_cast<double>(first_[1] + y) + 0.5);
  }

  double voxel_m_;
  std::array<std::int64_t, 2> first_{};
  std::array<std::int64_t, 2> counts_{};
  /// Of the ground, NaN where there is nothing to fill.
  std::vector<float> heights_;
  std::vector<std::uint8_t> taken_;
};

[[nodiscard]] bool meets(const GroundFootprint& footprint, maps::TileId tile) {
  const Eigen::Vector2d reach = footprint.reach(0.0);
  const Eigen::Vector2d low = maps::kTileSizeM * Eigen::Vector2d(tile.x, tile.y);
  const Eigen::Vector2d at = footprint.centre.head<2>() - low;
  return ((at + reach).array() >= 0.0).all() && ((at - reach).array() <= maps::kTileSizeM).all();
}

}  // namespace

std::vector<Eigen::Vector3d> fill_ground(maps::TileId tile, const maps::MapTile& points,
                                         std::span<const GroundFootprint> footprints,
                                         const FusedGround& ground, double voxel_m) {
  if (tile.level != 0 || !(voxel_m > 0.0)) {
    throw std::invalid_argument(fmt::format(
        "fill: tile of level {}, voxel {}; expected level 0, above 0", tile.level, voxel_m));
  }
  std::vector<GroundFootprint> here;
  std::copy_if(footprints.begin(), footprints.end(), std::back_inserter(here),
               [&](const GroundFootprint& footprint) { return meets(footprint, tile); });
  if (here.empty()) return {};
  Columns columns(tile, voxel_m);
  for (const GroundFootprint& footprint : here) columns.cover(footprint, ground);
  for (const maps::MapPoint& p : points) columns.take(points.from_origin(p), p.kind);
  return columns.open();
}

}  // namespace stillmap::mapping
