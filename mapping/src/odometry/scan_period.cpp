#include "odometry/scan_period.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <stdexcept>

namespace stillmap::mapping {
namespace {

/// Weight of the newest step in the usual one, and how many times the usual one it counts at most,
/// so that one pause does not change it.
constexpr double kNewestPeriod = 0.15;
constexpr double kMostOfUsual = 2.0;
/// A shorter step, as a share of the usual one, is one of the stamps alone.
constexpr double kLeastOfUsual = 0.5;

}  // namespace

std::optional<ScanPeriod::Step> ScanPeriod::step_to(std::int64_t stamp_ns,
                                                    const std::string& source) {
  if (!last_ns_) {
    last_ns_ = stamp_ns;
    return std::nullopt;
  }
  if (stamp_ns <= *last_ns_) {
    throw std::invalid_argument(fmt::format("{}: found stamp {} ns, expected one after {} ns",
                                            source, stamp_ns, *last_ns_));
  }
  const double told_s = 1e-9 * (static_cast<double>(stamp_ns) - static_cast<double>(*last_ns_));
  const Step step{std::max(told_s, kLeastOfUsual * usual_s_), told_s > kMaxGapS};
  usual_s_ += kNewestPeriod * (std::min(told_s, kMostOfUsual * usual_s_) - usual_s_);
  last_ns_ = stamp_ns;
  return step;
}

}  // namespace stillmap::mapping
