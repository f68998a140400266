#include "reference/evidence.hpp"

#include <stillmap/maps/small_matrices.hpp>

#include "index/voxel_table.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace stillmap::localization {
namespace {

/// Half the thickness of a surface as a drive's wandering poses draw it [m].
constexpr double kSurfaceM = 0.2;
/// Where there is no surface (foliage), centroids of neighbouring cells are about twice this apart
/// [m].
constexpr double kScatterM = 0.3;
constexpr double kBlockM = 4.0;
constexpr double kOpenDirectionM = 10.0;
/// Mean squared cosine between normals and a direction, below which noise of the normals alone may
/// have made it.
constexpr double kMinInformation = 0.01;
/// As for the default: how many independent surfaces a scan is worth when the map itself is bent,
/// and what all points of a scan share.
constexpr double kIndependentSurfaces = 5.0;
constexpr double kFloorM = 0.01;
constexpr double kFloorRad = 5e-4;

/// Distance across the surface at a map point, or to the point where it has none [m]; infinite
/// beyond what counts as on the map.
double distance_m(const MapPoints::Point& point, const Eigen::Vector3d& offset) {
  constexpr double kFar = std::numeric_limits<double>::infinity();
  if (point.sharp_axes == 0) return offset.norm() < kScatterM ? offset.norm() : kFar;
  double squares = 0.0;
  for (int k = 0; k < point.sharp_axes; ++k) {
    const double across = point.axes[static_cast<std::size_t>(k)].cast<double>().dot(offset);
    squares += across * across;
  }
  return squares < kSurfaceM * kSurfaceM ? std::sqrt(squares) : kFar;
}

std::uint64_t block_of(const Eigen::Vector3d& p_lidar) {
  const Eigen::Array3i cell =
      (p_lidar / kBlockM).array().floor().cast<std::int32_t>() + kCellsPerAxis / 2;
  return cell_key(cell.x(), cell.y(), cell.z());
}

/// Sums of one linearisation, with rotations over the lever.
struct Sums {
  Matrix6d H = Matrix6d::Zero();
  double weight = 0.0;
  /// Weights, and weighted squares of the distances [m^2], of what lies on its surface.
  double surface_weight = 0.0;
  double squares = 0.0;
  /// Gradients by block.
  std::vector<Vector6d> gradients;
};

Sums sums_of(const std::vector<Term>& terms, const Eigen::Isometry3d& T) {
  Sums sums;
  VoxelTable blocks;
  for (const Term& term : terms) {
    const auto [block, inserted] = blocks.insert(block_of(term.p_lidar));
    if (inserted) sums.gradients.emplace_back(Vector6d::Zero());
    const Eigen::Vector3d pull = term.weight * (T.linear().transpose() * term.residual);
    Vector6d gradient;
    gradient << pull, term.p_lidar.cross(pull) / kLeverM;
    sums.gradients[block] += gradient;
    for (int k = 0; k < term.point->sharp_axes; ++k) {
      AxisResidual axis =
          axis_residual(term.point->axes[static_cast<std::size_t>(k)].cast<double>(),
                        term.point->position.cast<double>(), T, term.p_lidar);
      axis.jacobian.tail<3>() /= kLeverM;
      sums.H += term.weight * axis.jacobian * axis.jacobian.transpose();
      sums.weight += term.weight;
      if (!(std::abs(axis.residual_m) < kSurfaceM)) continue;
      sums.surface_weight += term.weight;
      sums.squares += term.weight * axis.residual_m * axis.residual_m;
    }
  }
  return sums;
}

}  // namespace

Support support_at(const MapPoints& map, const std::vector<Eigen::Vector3f>& points_lidar,
                   const std::vector<char>& stands, const Eigen::Isometry3d& T_local_lidar) {
  std::size_t inliers = 0, standing = 0, known = 0, standing_inliers = 0;
  double squares = 0.0;
  for (std::size_t i = 0; i < points_lidar.size(); ++i) {
    const Eigen::Vector3d p = T_local_lidar * points_lidar[i].cast<double>();
    const MapPoints::Point* point = map.nearest(p.cast<float>(), kMaxPairDistanceM);
    if (stands[i] != 0) ++standing;
    if (point == nullptr) continue;
    if (stands[i] != 0) ++known;
    const double distance = distance_m(*point, p - point->position.cast<double>());
    if (!std::isfinite(distance)) continue;
    ++inliers;
    if (stands[i] != 0) ++standing_inliers;
    squares += distance * distance;
  }
  const auto share = [](std::size_t part, std::size_t whole) {
    return whole == 0 ? 0.0 : static_cast<double>(part) / static_cast<double>(whole);
  };
  Support support;
  support.inlier_ratio = share(inliers, points_lidar.size());
  support.rmse_m = inliers == 0 ? 0.0 : std::sqrt(squares / static_cast<double>(inliers));
  support.known_standing = known;
  support.known_ratio = share(known, standing);
  support.standing_ratio = share(standing_inliers, known);
  return support;
}

Uncertainty uncertainty_of(const std::vector<Term>& terms, const Eigen::Isometry3d& T_local_lidar) {
  const Sums sums = sums_of(terms, T_local_lidar);
  Matrix6d spread = Matrix6d::Zero();
  for (const Vector6d& g : sums.gradients) spread += g * g.transpose();
  const double weight = std::max(sums.weight, 1.0);
  const maps::SymmetricEigen<6> eigen = maps::eigen_of(Matrix6d(sums.H / weight));
  const Matrix6d& directions = eigen.vectors;
  // What is open is not divided by; its variance is set below.
  const Vector6d inverses = eigen.values.unaryExpr(
      [](double value) { return value > kMinInformation ? 1.0 / value : 0.0; });
  const Matrix6d inverse = directions * inverses.asDiagonal() * directions.transpose();
  Matrix6d covariance =
      inverse * spread * inverse / (weight * weight) +
      sums.squares / std::max(sums.surface_weight, 1.0) / kIndependentSurfaces * inverse;
  Uncertainty out;
  for (Eigen::Index k = 0; k < 6; ++k) {
    if (inverses[k] > 0.0) continue;
    out.degenerate.emplace_back(directions.col(k));
    covariance +=
        kOpenDirectionM * kOpenDirectionM * directions.col(k) * directions.col(k).transpose();
  }
  covariance = out_of_metres(covariance);
  covariance.diagonal().head<3>().array() += kFloorM * kFloorM;
  covariance.diagonal().tail<3>().array() += kFloorRad * kFloorRad;
  out.covariance = 0.5 * (covariance + covariance.transpose());
  return out;
}

}  // namespace stillmap::localization
