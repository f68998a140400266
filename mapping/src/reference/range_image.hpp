#pragma once

#include "reference/directions.hpp"

#include <Eigen/Core>

#include <cstdint>
#include <vector>

namespace stillmap::mapping {

/// What a scan leaves free: an image over azimuth and elevation of the nearest range in each pixel.
class RangeImage {
 public:
  /// Without rows.
  RangeImage() = default;
  /// @param pixel_rad  edge of a pixel, in (0, pi/4]; made to fit a whole number into 360 deg.
  /// @throws std::invalid_argument when not.
  RangeImage(const std::vector<Spherical>& scan, double pixel_rad);

  [[nodiscard]] int columns() const { return columns_; }
  /// Rows between the lowest and the highest point of the scan.
  [[nodiscard]] int rows() const { return rows_; }
  /// Pixel of a direction, row by row; -1 below or above all rows.
  [[nodiscard]] int pixel_of(const Spherical& direction) const;
  /// The nearest range [m] of each pixel; 0 where the scan has no point.
  [[nodiscard]] const std::vector<float>& nearest_m() const { return nearest_m_; }
  /// The largest value of nearest_m().
  [[nodiscard]] float farthest_m() const { return max_m_; }
  /// An upper bound of nearest_m() over what a box covers: centre and half of its edges along the
  /// axes of the lidar frame [m].
  [[nodiscard]] float farthest_behind(const Eigen::Vector3f& centre,
                                      const Eigen::Vector3f& half_edge) const;

 private:
  [[nodiscard]] int row_of(float elevation_rad) const;
  [[nodiscard]] int column_of(float azimuth_rad) const;
  void bound_segments();
  /// Largest value between two rows and two columns, both ends included; columns may run over the
  /// seam.
  [[nodiscard]] float largest_in(int row_begin, int row_last, int column_begin,
                                 int column_last) const;

  int columns_ = 0;
  int first_row_ = 0;
  int rows_ = 0;
  float columns_per_rad_ = 0.0F;
  float rows_per_rad_ = 0.0F;
  std::vector<float> nearest_m_;
  /// Largest value in pieces of a row.
  int segments_ = 0;
  std::vector<float> segment_max_m_;
  float max_m_ = 0.0F;
};

/// Angle between neighbouring rings: the median of the gaps between points on top of each other.
/// @return 0.4 deg, that of an HDL-64E, when too few points are on top of each other to tell.
[[nodiscard]] double ring_spacing_rad(const std::vector<Spherical>& scan);

}  // namespace stillmap::mapping
