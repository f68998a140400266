#include "odometry/direct/usual_match.hpp"

namespace stillmap::mapping {
namespace {

/// With fewer matched scans the map is too thin for these tests: half of a sparse sensor's second
/// scan falls on no voxel.
constexpr std::size_t kThinScans = 3;
/// A scan is hidden when less than this share of the usual of its points lie on the map, of those
/// that fall where the map knows anything: in clean drives it is 0.78 and more (0.9 once there is a
/// map), of dust and shells 0.3 to 0.55.
constexpr double kHiddenOfUsual = 0.65;
/// Or when its fit, and in the geometric mean of both also those of its points that stand and lie
/// on the map, are less than these shares of the usual. The mean is 0.36 and more, also where a
/// sparse sensor that turns misses a scan; of dust 0.26 and less.
constexpr double kHiddenFitOfUsual = 0.6;
constexpr double kHiddenMeanOfUsual = 0.3;
/// The latter is not asked where less than this share of what stands usually lies on the map.
constexpr double kStandingTells = 0.3;
/// On surfaces points fit, as a share of those that lie there, better than this: 0.58 and more. In
/// dust the map has cells full of points and no surfaces: 0.35 and less.
constexpr double kFitOfInliers = 0.5;

}  // namespace

bool UsualMatch::is_likely(const Match& match) const {
  if (matched_ >= kThinScans) {
    if (match.matched < Match::kMinMatched ||
        match.known_inlier_ratio < std::max(kLeastInliers, kHiddenOfUsual * known_))
      return false;
    const double fit = match.fit / fit_, standing = match.standing_ratio / standing_;
    if (standing_ >= kStandingTells && fit < kHiddenFitOfUsual &&
        fit * standing < kHiddenMeanOfUsual * kHiddenMeanOfUsual)
      return false;
  }
  return true;
}

void UsualMatch::learn(const Match& match) {
  on_surfaces_ = match.fit >= kFitOfInliers * match.inlier_ratio;
  ++matched_;
  // The mean of all until there are many, so that the first ones are not doubted less than others.
  const double share = std::max(kNewestShare, 1.0 / static_cast<double>(matched_));
  known_ += share * (match.known_inlier_ratio - known_);
  standing_ += share * (match.standing_ratio - standing_);
  fit_ += share * (match.fit - fit_);
}

}  // namespace stillmap::mapping
