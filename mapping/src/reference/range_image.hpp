#pragma once

#include <Eigen/Core>

#include <cstdint>
#include <vector>

namespace stillmap::mapping {

/// A direction from the sensor and the distance along it.
struct Spherical {
  /// Counter-clockwise from +x, in [-pi, pi].
  float azimuth_rad = 0.0F;
  /// Upward from the x-y plane, in [-pi/2, pi/2].
  float elevation_rad = 0.0F;
  float range_m = 0.0F;
};

/// Angles within 1e-6 rad. @param p lidar frame [m].
[[nodiscard]] Spherical spherical_of(const Eigen::Vector3f& p);

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
  /// The nearest range [m] of each pixel, eq. (2); 0 where the scan has no point.
  [[nodiscard]] const std::vector<float>& nearest_m() const { return nearest_m_; }
  /// An upper bound of nearest_m() over what a sphere around `centre` [m, lidar frame] covers.
  [[nodiscard]] float farthest_behind(const Eigen::Vector3f& centre, float radius_m) const;

 private:
  [[nodiscard]] int row_of(float elevation_rad) const;
  [[nodiscard]] int column_of(float azimuth_rad) const;
  void bound_tiles();

  int columns_ = 0;
  int first_row_ = 0;
  int rows_ = 0;
  float columns_per_rad_ = 0.0F;
  float rows_per_rad_ = 0.0F;
  std::vector<float> nearest_m_;
  /// Largest value in tiles of kTile x kTile pixels.
  int tile_columns_ = 0;
  std::vector<float> tile_max_m_;
  float max_m_ = 0.0F;
};

/// Angle between neighbouring rings: the median of the gaps between points on top of each other.
/// @return 0.4 deg, that of an HDL-64E, when too few points are on top of each other to tell.
[[nodiscard]] double ring_spacing_rad(const std::vector<Spherical>& scan);

}  // namespace stillmap::mapping
