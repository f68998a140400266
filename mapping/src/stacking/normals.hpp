#pragma once

#include <Eigen/Core>

#include <cstdint>
#include <vector>

namespace stillmap::mapping {

/// The surface around a point.
struct SurfaceNormal {
  /// Unit, or zero where there is no surface.
  Eigen::Vector3f normal = Eigen::Vector3f::Zero();
  /// (middle - least) / middle of the eigenvalues of the covariance, times 255.
  std::uint8_t planarity = 0;
};

/// Normals of the points of a tile by the covariance of what lies in the 0.6 m cube around each
/// (27 cells of 0.2 m; one normal a cell, so a tile takes milliseconds).
/// @param positions   N points [m].
/// @param seen_from   N points: normals look there.
/// @return N normals; none for a point with fewer than 6 points around it.
[[nodiscard]] std::vector<SurfaceNormal> estimate_normals(
    const std::vector<Eigen::Vector3f>& positions, const std::vector<Eigen::Vector3f>& seen_from);

}  // namespace stillmap::mapping
