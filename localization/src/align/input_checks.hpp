#pragma once

#include <stillmap/localization/aligner.hpp>

#include <Eigen/Geometry>

namespace stillmap::localization {

/// @throws std::invalid_argument if a coordinate is not finite, there are times but not one a
/// point, or one is 10 s and more off the stamp.
void require_usable(const maps::PointCloud& scan_lidar);
/// @throws std::invalid_argument also if it was thinned for a vehicle of another size.
void require_usable(const ThinScan& scan_lidar, const AlignerOptions& options);
/// @throws std::invalid_argument if the prior is not finite, its rotation none, or its covariance
/// not symmetric and positive definite.
void require_usable(const Prior& prior);
/// Of a symmetric, finite matrix. Eigen's decomposition alone calls it a success when an overflow
/// has made it NaN.
[[nodiscard]] bool is_positive_definite(const Eigen::Matrix<double, 6, 6>& covariance);
/// Whether the prior's covariance and the result's together leave the result less than one chance
/// in a thousand; never without a covariance of the prior.
[[nodiscard]] bool contradicts(const Prior& prior, const AlignmentResult& result);
/// A result that is `kLost` for one reason.
[[nodiscard]] AlignmentResult lost(
    Reason reason, const Eigen::Isometry3d& T_map_lidar = Eigen::Isometry3d::Identity());

}  // namespace stillmap::localization
