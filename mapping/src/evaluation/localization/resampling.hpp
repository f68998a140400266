#pragma once

#include <stillmap/mapping/localization_evaluation.hpp>

#include <cstddef>
#include <cstdint>
#include <functional>
#include <vector>

namespace stillmap::mapping {

/// How often something happened on one scan, and how often it could have.
struct ScanCount {
  std::size_t count = 0;
  std::size_t of = 0;
};

/// One for each scan with a query that `among` holds of, in the order of scans.
[[nodiscard]] std::vector<ScanCount> counts_by_scan(
    const std::vector<LocalizationQuery>& queries,
    const std::function<bool(const LocalizationQuery&)>& happened,
    const std::function<bool(const LocalizationQuery&)>& among);

/// The rate in 2,000 sets of as many scans, drawn with replacement: queries of one scan stay
/// together, because they share what makes them hard. Empty without scans.
[[nodiscard]] std::vector<double> resampled_rates(const std::vector<ScanCount>& scans,
                                                  std::uint64_t seed);

/// Largest rate in [0, 1] at which at most `count` of `whole` are seen with probability 5 %; some
/// 3 / whole for none. NaN when whole = 0.
/// @see Clopper, Pearson, "The use of confidence or fiducial limits", Biometrika 26 (1934).
[[nodiscard]] double binomial_upper_95(std::size_t count, std::size_t whole);

/// The rate with its 95 % upper bound: the larger one of the resampled bound and the binomial one
/// of as many independent queries as there are scans, since resampling sees nothing of what never
/// happened.
[[nodiscard]] BoundedRate bounded_rate(const std::vector<ScanCount>& scans, std::uint64_t seed);

}  // namespace stillmap::mapping
