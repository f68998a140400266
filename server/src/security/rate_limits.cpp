#include "security/rate_limits.hpp"

#include <algorithm>

namespace stillmap::server {

double RateLimits::take(const std::string& key_id, const RateOptions& options,
                        Clock::time_point now) {
  if (options.requests_per_s <= 0.0) return 0.0;
  const double most = std::max(1, options.burst);
  const std::scoped_lock lock(mutex_);
  const auto [found, is_new] = buckets_.try_emplace(key_id, Bucket{most, now});
  Bucket& bucket = found->second;
  const double passed_s = std::max(0.0, std::chrono::duration<double>(now - bucket.filled).count());
  bucket.tokens = std::min(most, bucket.tokens + passed_s * options.requests_per_s);
  bucket.filled = std::max(bucket.filled, now);
  if (bucket.tokens < 1.0) return (1.0 - bucket.tokens) / options.requests_per_s;
  bucket.tokens -= 1.0;
  return 0.0;
}

}  // namespace stillmap::server
