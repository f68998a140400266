#pragma once

#include <Eigen/Core>

#include <vector>

namespace stillmap::mapping {

inline constexpr int kContextRings = 20;
inline constexpr int kContextSectors = 60;
inline constexpr double kContextReachM = 80.0;

/// What a place looks like from a sensor, by Scan Context: the plane around the sensor in rings
/// and sectors, and in each bin how high its highest point is.
///
/// @see Kim, Kim, "Scan Context: Egocentric Spatial Descriptor for Place Recognition within 3D
/// Point Cloud Map", IROS 2018, section III-A: a_ij = max z of the points in ring i, sector j.
///
/// Departs from it in the heights: they count from the ground around the sensor, never below it,
/// along the vertical of the drive, not along the sensor's own axis. So a bin of bare road is as
/// empty as one without a point, and neither the mount's height nor its tilt matters.
struct ScanContext {
  /// [m], ring by sector; sector j covers azimuths from j steps of 6 deg on, counter-clockwise
  /// from straight backwards.
  Eigen::Matrix<float, kContextRings, kContextSectors> heights_m =
      Eigen::Matrix<float, kContextRings, kContextSectors>::Zero();

  /// Sectors with anything standing in them.
  [[nodiscard]] int seen_sectors() const;
};

/// @param points_level  [m], relative to the sensor, z up; finite; may be empty.
[[nodiscard]] ScanContext describe(const std::vector<Eigen::Vector3f>& points_level);

/// Turning the sensor leaves it as it is, so that places are looked up by it (section III-C).
/// Departs from the paper, which takes the share of bins in a ring that are not empty: the mean
/// height of the ring tells more, as the authors' own program has it.
using RingKey = Eigen::Matrix<float, kContextRings, 1>;
[[nodiscard]] RingKey ring_key(const ScanContext& context);

struct ContextDistance {
  /// In [0, 1]; 1 as well where one of the two sees nothing.
  double distance = 1.0;
  /// Sectors by which `a` has to be turned counter-clockwise to look most like `b`, in [0, 60).
  int shift = 0;
};
/// D(a, b) = min over n of d(a turned by n, b), d the mean over the sectors of one less the cosine
/// between their columns (section III-B); the first of equal shifts.
///
/// Departs from the paper, which leaves open what an empty column is: one that is empty in both
/// says nothing and does not count, one that is empty in one alone differs wholly. All sixty
/// shifts are tried, as one product of matrices; turned down: the authors' later guess of the
/// shift by a sector key, which saves microseconds and can miss.
[[nodiscard]] ContextDistance distance_between(const ScanContext& a, const ScanContext& b);

}  // namespace stillmap::mapping
