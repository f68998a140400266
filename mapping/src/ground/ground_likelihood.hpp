#pragma once

#include "ground/plane_fit.hpp"

#include <array>
#include <deque>
#include <span>
#include <vector>

namespace stillmap::mapping {

/// What ground likelihood estimation says of a patch.
enum class PatchVerdict {
  /// Too few points for a plane.
  kUnknown,
  kGround,
  /// Steep, facing away, or neither low nor flat enough.
  kRefused,
};

/// A fitted patch in levelled coordinates (heights over the plane under the sensor).
struct LikelihoodInput {
  PlaneFit plane;
  int ring = 0;
};

/// Adaptive ground likelihood estimation and temporal ground revert.
///
/// In the rings nearest to the sensor a patch is ground when it is upright and either low or flat:
/// its mean height below e_m, or its flatness below f_m, with e_m = mean(E_m) + a_m stdev(E_m) and
/// f_m = mean(F_m) + b_m stdev(F_m) over the heights and flatnesses of ground seen before. Patches
/// that are neither are taken back as ground when they are nearly as flat as the ground of their
/// own ring in the same scan and no mere line (revert).
///
/// Departures: what is learned stays as it is while scans are judged, so that scans can be judged
/// in any order, and in parallel, with equal results; until ring m has learned from 20 patches the
/// fixed thresholds of Patchwork stand in (the authors' program starts from zero, that is, from the
/// sensor's own height); heights are over the plane under the sensor.
/// @see Patchwork++, IROS 2022, adaptive ground likelihood estimation and temporal ground revert;
/// Patchwork, RA-L 2021, ground likelihood estimation.
class GroundLikelihood {
 public:
  static constexpr int kRingsOfInterest = 4;

  GroundLikelihood();

  /// @param patches          any order.
  /// @param sensor_height_m  of the sensor over the plane.
  /// @return a verdict for each.
  [[nodiscard]] std::vector<PatchVerdict> judge(std::span<const LikelihoodInput> patches,
                                                double sensor_height_m) const;
  /// Adds a scan's low upright patches to what is known, and sets the thresholds anew. The last
  /// 1000 of each ring count.
  void learn(std::span<const LikelihoodInput> patches);

  [[nodiscard]] double elevation_threshold_m(int ring) const {
    return elevation_[static_cast<std::size_t>(ring)];
  }
  [[nodiscard]] double flatness_threshold_m2(int ring) const {
    return flatness_[static_cast<std::size_t>(ring)];
  }

 private:
  [[nodiscard]] bool is_low(const LikelihoodInput& patch) const;

  std::array<double, kRingsOfInterest> elevation_;
  std::array<double, kRingsOfInterest> flatness_;
  std::array<std::deque<double>, kRingsOfInterest> seen_elevation_;
  std::array<std::deque<double>, kRingsOfInterest> seen_flatness_;
};

}  // namespace stillmap::mapping
