#pragma once

#include <Eigen/Core>

#include <stillmap/maps/cell_table.hpp>

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

namespace stillmap::mapping {

/// How high the ground of a map is, by cells of 1 m; from its ground points alone. Where roads or
/// storeys lie over each other a cell has several heights.
class GroundLevels {
 public:
  /// Ground this far away still tells the height of a point [m].
  static constexpr double kReachM = 4.0;

  /// @param positions  N points [m]. @param is_ground  N flags.
  GroundLevels(std::span<const Eigen::Vector3f> positions, std::span<const std::uint8_t> is_ground);

  /// Height of the ground that a point stands over (or is just below), in the nearest cell with
  /// ground less than kReachM away; nothing without one. Cells in which all ground is a storey
  /// above the point count only when there are no others.
  [[nodiscard]] std::optional<float> below(const Eigen::Vector3f& p) const;

 private:
  /// Points of a cell between which there is no gap of a storey in height.
  struct Level {
    float lowest = 0.0F;
    float highest = 0.0F;
    double sum = 0.0;
    std::uint32_t count = 0;

    [[nodiscard]] float mean() const { return static_cast<float>(sum / count); }
  };
  using Cell = std::vector<Level>;

  static void add(float z, Cell& cell);
  /// Keeps the levels of two storeys or more, from low to high; else all is one.
  static void settle(Cell& cell);
  /// Of the levels that are not above the height the highest, else the lowest of all.
  [[nodiscard]] static const Level& level_under(float z, const Cell& cell);

  maps::CellMap<Cell> cells_;
};

}  // namespace stillmap::mapping
