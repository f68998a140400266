#pragma once

#include <stillmap/maps/fast_angle.hpp>

#include <Eigen/Core>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace stillmap::mapping {

/// The directions of a range view: columns of azimuth all around, rows of elevation from straight
/// down to straight up.
///
/// Bins of 0.35 x 0.35 degrees: two to four shots of the usual spinning sensors share one, so that
/// gaps between shots do not show as holes, and a bin is 12 cm wide at 20 m.
struct ViewGrid {
  static constexpr int kColumns = 1024;
  static constexpr int kRows = 512;
  static constexpr float kColumnRad = 2.0F * std::numbers::pi_v<float> / kColumns;
  static constexpr float kRowRad = std::numbers::pi_v<float> / kRows;

  [[nodiscard]] static float azimuth(const Eigen::Vector3f& p) {
    return maps::fast_angle(p.y(), p.x());
  }
  [[nodiscard]] static float elevation(const Eigen::Vector3f& p) {
    return maps::fast_angle(p.z(), std::sqrt(p.x() * p.x() + p.y() * p.y()));
  }

  /// Column before wrapping; may be negative or beyond the last.
  [[nodiscard]] static int column_of(float azimuth_rad) {
    return static_cast<int>(
        std::floor((azimuth_rad + std::numbers::pi_v<float>)*(1.0F / kColumnRad)));
  }
  [[nodiscard]] static int wrapped(int column) { return column & (kColumns - 1); }
  /// Row, in [0, kRows).
  [[nodiscard]] static int row_of(float elevation_rad) {
    const float row = (elevation_rad + 0.5F * std::numbers::pi_v<float>)*(1.0F / kRowRad);
    return std::min(kRows - 1, std::max(0, static_cast<int>(row)));
  }
  [[nodiscard]] static double azimuth_of(int column) {
    return (column + 0.5) * static_cast<double>(kColumnRad) - std::numbers::pi;
  }
  [[nodiscard]] static double elevation_of(int row) {
    return (row + 0.5) * static_cast<double>(kRowRad) - 0.5 * std::numbers::pi;
  }
};

static_assert((ViewGrid::kColumns & (ViewGrid::kColumns - 1)) == 0, "wrapped() masks");

}  // namespace stillmap::mapping
