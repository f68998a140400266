#include "odometry/direct/lost_directions.hpp"

#include "odometry/direct/directions.hpp"

#include <stillmap/maps/median.hpp>

#include <utility>

namespace stillmap::mapping {
namespace {

/// A direction that was lost is told again once so many scans in a row say so.
constexpr std::size_t kToldAgainScans = 3;
/// Along a direction that gets lost the speed stays the median of as many scans that told it: the
/// last one sees little, and by a wrong speed of it all that follow would go astray.
constexpr std::size_t kSteadyScans = 5;

/// Of each component.
LostDirections::Twist median_of(const std::deque<LostDirections::Twist>& twists) {
  LostDirections::Twist median;
  for (Eigen::Index k = 0; k < 6; ++k) {
    std::vector<double> values;
    for (const LostDirections::Twist& twist : twists) values.push_back(twist[k]);
    median[k] = maps::median(std::move(values));
  }
  return median;
}

}  // namespace

void LostDirections::start_with(const Twist& twist_lidar) {
  steady_.assign(kSteadyScans, twist_lidar);
}

std::vector<LostDirections::Twist> LostDirections::untold(const localization::LocalAlignment& match,
                                                          bool is_expected) {
  if (steady_.size() < kSteadyScans && !is_expected) return {};
  if (!match.degenerate_directions.empty()) {
    lost_ = match.degenerate_directions;
    told_again_ = 0;
  } else if (!lost_.empty() && ++told_again_ >= kToldAgainScans) {
    lost_.clear();
  }
  return lost_;
}

void LostDirections::learn(const Twist& twist_lidar) {
  steady_.push_back(twist_lidar);
  if (steady_.size() > kSteadyScans) steady_.pop_front();
}

LostDirections::Twist LostDirections::steadied(const Twist& twist_lidar) const {
  if (steady_.empty()) return twist_lidar;
  const Twist steady = median_of(steady_);
  return steady + without(twist_lidar - steady, lost_);
}

}  // namespace stillmap::mapping
