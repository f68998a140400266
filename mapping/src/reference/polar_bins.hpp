#pragma once

#include <Eigen/Core>

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

namespace stillmap::mapping {

/// The volume of interest of ERASOR around a vehicle, and its bins: rings and sectors seen from
/// above. Frame: origin on the ground below the sensor, axes of the lidar.
struct PolarBins {
  static constexpr float kMaxRangeM = 80.0F;
  static constexpr int kRings = 20;
  static constexpr int kSectors = 108;
  static constexpr float kMinHeightM = -1.3F;
  static constexpr float kMaxHeightM = 3.0F;
  static constexpr std::size_t kBins = static_cast<std::size_t>(kRings * kSectors);

  /// Bin of a point [m]; -1 outside of the volume.
  [[nodiscard]] static int bin_of(const Eigen::Vector3f& p);
  /// Whether a sphere [m] may touch a bin whose flag is set.
  [[nodiscard]] static bool touches(const Eigen::Vector3f& centre, float radius_m,
                                    const std::array<std::uint8_t, kBins>& flags);
};

/// What is in a bin: how many points, and between which heights.
struct PseudoOccupancy {
  std::uint32_t points = 0;
  float lowest_m = std::numeric_limits<float>::max();
  float highest_m = std::numeric_limits<float>::lowest();

  void add(float z_m);
  /// Delta h of the paper; 0 without points.
  [[nodiscard]] float height_m() const { return points == 0 ? 0.0F : highest_m - lowest_m; }
};

/// The ratio of the paper's scan ratio test, of two bins: the smaller pseudo occupancy over the
/// larger one, NaN when both are 0.
[[nodiscard]] float scan_ratio(const PseudoOccupancy& a, const PseudoOccupancy& b);

}  // namespace stillmap::mapping
