#pragma once

#include <stillmap/mapping/ground.hpp>
#include <stillmap/maps/scan.hpp>

#include <Eigen/Core>

#include <cstdint>
#include <vector>

namespace stillmap::mapping {

/// A point above the ground.
struct RaisedPoint {
  Eigen::Vector3f p_lidar;
  /// Over the ground [m].
  float height_m = 0.0F;
  /// Of the lidar that took it [m].
  Eigen::Vector2f lidar = Eigen::Vector2f::Zero();
};

/// Points above the ground in square columns around the sensor.
class ColumnGrid {
 public:
  static constexpr float kCellM = 0.25F;
  static constexpr int kSide = 400;  ///< 50 m to each side
  /// Lowest height of an object's points; below it kerbs and grass [m].
  static constexpr float kMinHeightM = 0.3F;
  /// Highest point of interest; tree crowns and bridges above it [m].
  static constexpr float kMaxHeightM = 6.0F;

  ColumnGrid(const maps::PointCloud& cloud, const GroundResult& ground);

  /// Points sorted by column.
  [[nodiscard]] const std::vector<RaisedPoint>& points() const { return points_; }
  /// First point of a column; `first(column + 1)` is one past its last.
  [[nodiscard]] std::uint32_t first(int column) const {
    return starts_[static_cast<std::size_t>(column)];
  }
  [[nodiscard]] bool empty(int column) const { return first(column) == first(column + 1); }
  /// @return -1 outside.
  [[nodiscard]] static int column_of(float x, float y);

  /// Clusters of columns for which `member` holds, neighbours up to `reach` columns away joined.
  /// Only clusters of 2 or more points; columns in increasing order.
  [[nodiscard]] std::vector<std::vector<int>> clusters(const std::vector<std::uint8_t>& member,
                                                       int reach) const;

 private:
  std::vector<RaisedPoint> points_;
  std::vector<std::uint32_t> starts_;
};

}  // namespace stillmap::mapping
