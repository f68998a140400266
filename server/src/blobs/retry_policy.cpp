#include "blobs/retry_policy.hpp"

#include <algorithm>
#include <cmath>

namespace stillmap::server {

std::optional<std::chrono::milliseconds> RetryPolicy::pause(
    int failed, std::chrono::milliseconds spent, double chance,
    std::chrono::milliseconds wished) const {
  if (failed >= attempts) return std::nullopt;
  // Below 2^30, so that it stays a number of milliseconds.
  const double doubled =
      static_cast<double>(first_pause.count()) * std::exp2(std::min(failed - 1, 30));
  const double whole = std::min(doubled, static_cast<double>(longest_pause.count()));
  const auto own = std::chrono::milliseconds(std::llround(whole * (0.5 + 0.5 * chance)));
  const auto pause = std::max(own, wished);
  if (spent + pause > within) return std::nullopt;
  return pause;
}

}  // namespace stillmap::server
