#pragma once

#include <stillmap/localization/local_map.hpp>

#include <algorithm>
#include <cstddef>

namespace stillmap::mapping {

/// What matches of a drive's scans usually explain, and which explain less.
class UsualMatch {
 public:
  using Match = localization::LocalAlignment;

  /// A match is doubted, and looked for farther away, when of the points that fall where the map
  /// knows anything less than this share of the usual lie on it, or of those that stand above the
  /// ground. Wrong places explain 0.75 to 0.9 of the usual, since ground fits nearly everywhere.
  static constexpr double kKnown = 0.93;
  static constexpr double kStanding = 0.8;
  /// Below it there is no match.
  static constexpr double kLeastInliers = 0.45;
  /// Weight of the newest value in a running mean.
  static constexpr double kNewestShare = 0.15;

  /// Whether it explains as much as usual, else better ones are looked for.
  [[nodiscard]] bool explains(const Match& match) const {
    return match.known_inlier_ratio >= std::max(kLeastInliers, kKnown * known_) &&
           match.standing_ratio >= kStanding * standing_;
  }
  /// Whether it explains enough for a scan that is not hidden.
  [[nodiscard]] bool is_likely(const Match& match) const;
  void learn(const Match& match);
  /// Matches that it learned from.
  [[nodiscard]] std::size_t matched() const { return matched_; }
  /// Whether the last one lay on surfaces.
  [[nodiscard]] bool on_surfaces() const { return on_surfaces_; }

 private:
  std::size_t matched_ = 0;
  double known_ = 0.0;
  double standing_ = 0.0;
  double fit_ = 0.0;
  bool on_surfaces_ = false;
};

}  // namespace stillmap::mapping
