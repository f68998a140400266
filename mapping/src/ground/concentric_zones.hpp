#pragma once

#include <array>

namespace stillmap::mapping {

/// The concentric zone model: rings of sectors around the sensor, in four zones whose patches grow
/// with the range, so that each holds enough points.
/// @see Lim, Oh, Myung, "Patchwork", RA-L 2021, concentric zone model; its bounds and numbers.
class ConcentricZones {
 public:
  static constexpr int kZones = 4;
  static constexpr std::array<int, kZones> kRings = {2, 4, 4, 4};
  static constexpr std::array<int, kZones> kSectors = {16, 32, 54, 32};
  static constexpr double kMinRangeM = 2.7;
  static constexpr double kMaxRangeM = 80.0;
  /// Lower bounds of the zones [m], and the upper one of the last.
  static constexpr std::array<double, kZones + 1> kBoundsM = {
      kMinRangeM, (7.0 * kMinRangeM + kMaxRangeM) / 8.0, (3.0 * kMinRangeM + kMaxRangeM) / 4.0,
      (kMinRangeM + kMaxRangeM) / 2.0, kMaxRangeM};
  static constexpr int kRingCount = 14;
  static constexpr int kPatchCount = 2 * 16 + 4 * 32 + 4 * 54 + 4 * 32;

  /// Patch of a place, numbered ring by ring from the sensor outward and counter-clockwise from
  /// the x axis within each; -1 outside of the model, as is NaN.
  [[nodiscard]] static int patch_of(double x, double y);
  /// Ring of a patch, counted through all zones from 0.
  [[nodiscard]] static int ring_of(int patch);
};

}  // namespace stillmap::mapping
