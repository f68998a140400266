#pragma once

#include "query.hpp"
#include "refine.hpp"

#include <stillmap/localization/aligner.hpp>
#include <stillmap/localization/options.hpp>

#include <Eigen/Geometry>

#include <optional>
#include <vector>

namespace stillmap::localization {

/// One query on its way to an answer: where it is looked for, and what was spent on it.
struct Search {
  const MapIndex& index;
  const LocalizationOptions& options;
  /// Null when the whole map is searched.
  const Prior* prior = nullptr;
  /// Thinned; deskewed on the way.
  Query query;
  /// Gauss-Newton steps so far.
  int steps = 0;
};

/// Refines each start, and keeps the places that explain about as much of the scan as the best: the
/// best first, each place once.
/// @param starts  `T_map_lidar`, at least one.
[[nodiscard]] std::vector<Candidate> rank_candidates(Search& search,
                                                     const std::vector<Eigen::Isometry3d>& starts);

/// Ranks places that look alike again, each with the motion that it implies taken out of the scan:
/// a scan that was taken on the move fits no place well as it came. Does nothing for one candidate,
/// or for a scan without times.
void rank_deskewed(Search& search, std::vector<Candidate>& candidates);

/// Among the places that fit about as well as the best, puts those first that the prior admits.
void put_admitted_first(const Search& search, std::vector<Candidate>& candidates);

/// Whether another place explains the scan about as well as the first: another candidate, or a
/// repeat of the surroundings a little farther along the direction that holds the pose least.
/// @param candidates  the final pose first.
/// @param rows        at the final pose.
/// @param degenerate  directions that are free anyway: a shift along them is no other place.
[[nodiscard]] bool is_ambiguous(const Search& search, const std::vector<Candidate>& candidates,
                                const FinalRows& rows, const std::vector<Vector6d>& degenerate);

/// How far from the prior the scan may be, as its covariance says (three deviations).
struct PriorReach {
  double radius_m = 0.0;
  double height_m = 0.0;
  double yaw_rad = 0.0;
};
/// Nothing without a covariance.
[[nodiscard]] std::optional<PriorReach> reach_of(const Prior& prior);
/// To each side of the prior: as far as the options say, or less where its covariance does.
[[nodiscard]] PriorReach window_of(const AlignerOptions& options,
                                   const std::optional<PriorReach>& reach);

}  // namespace stillmap::localization
