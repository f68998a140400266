#pragma once

#include "odometry/loam/rings.hpp"

#include <stillmap/maps/imu.hpp>

#include <Eigen/Core>

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace stillmap::mapping::loam {

/// Points on either side that eq. (1) looks at.
inline constexpr std::size_t kNeighbours = 5;
/// A ring is cut into so many equal parts, so that features come from all around. The paper cuts
/// half a turn into four; the authors' code, and this, a whole turn into six.
inline constexpr std::size_t kSectors = 6;
/// Features of a part: the sharpest and flattest ones, which look for correspondences (as in the
/// paper), and less sharp ones, which only are found (as in the authors' code).
inline constexpr std::size_t kEdgesPerSector = 2;
inline constexpr std::size_t kPlanesPerSector = 4;
inline constexpr std::size_t kLessSharpPerSector = 20;

struct Feature {
  /// [m], lidar frame at `time_s`.
  Eigen::Vector3f position = Eigen::Vector3f::Zero();
  /// Relative to the scan's stamp [s].
  float time_s = 0.0F;
  std::uint32_t ring = 0;
  /// In the axes of the lidar at the stamp, as a gyroscope tells: only the way is to be removed.
  bool is_turned = false;
};

/// Features of a sweep, ring by ring in order of the turn.
struct Features {
  /// At most 2 and 4 a sector and ring: E and H of the paper.
  std::vector<Feature> edges, planes;
  /// At most 20 a sector, `edges` among them; and smooth points thinned along the ring.
  std::vector<Feature> less_sharp, less_flat;
};

/// Smoothness c of a ring's points, eq. (1):
///   c = |sum over j in S of (X_i - X_j)| / (|S| |X_i|), S the five points on either side.
/// @return one value a point; NaN for the five at either end.
[[nodiscard]] std::vector<float> smoothness(std::span<const Eigen::Vector3f> ring);

/// Which points of a ring make good features (Fig. 4 of the paper): not on a surface that is nearly
/// parallel to the beam, and without a point of S that hides what is behind it, i.e. lies nearer
/// beyond a gap along the beam.
[[nodiscard]] std::vector<std::uint8_t> reliable(std::span<const Eigen::Vector3f> ring);

/// @param rings  of `cloud`.
[[nodiscard]] Features find_features(const maps::PointCloud& cloud, const Rings& rings);

/// Turns features to the lidar's axes at the stamp. @param turn  null leaves them as they are.
void turn_to_stamp(Features& features, const maps::SweepTurn* turn);

/// The first feature of each voxel, in their order.
[[nodiscard]] std::vector<Feature> thinned(const std::vector<Feature>& features, double voxel_m);

}  // namespace stillmap::mapping::loam
