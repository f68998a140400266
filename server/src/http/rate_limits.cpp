#include "http/rate_limits.hpp"

#include <algorithm>
#include <functional>
#include <random>

namespace stillmap::server {

double TokenBucket::take(const RateOptions& options, Clock::time_point now) {
  if (options.requests_per_s <= 0.0) return 0.0;
  const double most = std::max(1, options.burst);
  const double passed_s = std::max(0.0, std::chrono::duration<double>(now - filled_).count());
  tokens_ = std::min(most, tokens_ + passed_s * options.requests_per_s);
  filled_ = std::max(filled_, now);
  if (tokens_ < 1.0) return (1.0 - tokens_) / options.requests_per_s;
  tokens_ -= 1.0;
  return 0.0;
}

double RateLimits::take(const std::string& key_id, const RateOptions& options,
                        Clock::time_point now) {
  const std::scoped_lock lock(mutex_);
  return buckets_[key_id].take(options, now);
}

AddressRates::AddressRates() {
  std::random_device device;
  for (int i = 0; i < 4; ++i) seed_ += std::to_string(device());
}

double AddressRates::take(const std::string& client, const RateOptions& options,
                          TokenBucket::Clock::time_point now) {
  const std::size_t at = std::hash<std::string>{}(seed_ + client) % kBuckets;
  const std::scoped_lock lock(mutex_);
  return buckets_[at].take(options, now);
}

}  // namespace stillmap::server
