#pragma once

#include <stillmap/localization/aligner.hpp>
#include <stillmap/mapping/localization_evaluation.hpp>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <cstdint>
#include <string>
#include <vector>

namespace stillmap::mapping {

using Vector6d = Eigen::Matrix<double, 6, 1>;

/// One query and its answer before it is judged: `query` lacks `error` and `nees`.
struct LocalizationRecord {
  LocalizationQuery query;
  /// Position of the scan among those asked for, from 0.
  std::size_t position = 0;
  Eigen::Isometry3d T_reference_answer = Eigen::Isometry3d::Identity();
  Eigen::Matrix<double, 6, 6> covariance = Eigen::Matrix<double, 6, 6>::Zero();
};

/// Medians of the six components of log(T_reference_answer) over answers that are not lost, of the
/// scans with an even (0) or odd (1) position; zero when there is none.
[[nodiscard]] Vector6d bias_of_half(const std::vector<LocalizationRecord>& records,
                                    std::size_t half);

/// The queries with their errors, each half of the scans corrected by the bias of the other.
[[nodiscard]] std::vector<LocalizationQuery> judged(const std::vector<LocalizationRecord>& records,
                                                    BiasCorrection correction);

/// Not lost, and within 0.2 m and 1 deg. @param query  judged.
[[nodiscard]] bool is_success(const LocalizationQuery& query);

/// Value below which the share `q` in [0, 1] lies, linear between neighbours (as NumPy's default);
/// NaN when empty. @param values  may be infinite.
[[nodiscard]] double percentile(std::vector<double> values, double q);

/// All figures of one level. @param seed  of the resampling.
[[nodiscard]] LocalizationLevel level_of(const std::vector<LocalizationQuery>& queries,
                                         const PriorError& prior_error, std::uint64_t seed);

}  // namespace stillmap::mapping
