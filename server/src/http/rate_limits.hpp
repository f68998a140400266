#pragma once

#include <stillmap/server/server_options.hpp>

#include <chrono>
#include <cstddef>
#include <limits>
#include <map>
#include <mutex>
#include <string>
#include <vector>

namespace stillmap::server {

/// Fills with time, and is emptied by requests. Full at first. One thread at a time.
class TokenBucket {
 public:
  using Clock = std::chrono::steady_clock;

  /// Takes a token. @return 0, or after how many seconds there will be one.
  [[nodiscard]] double take(const RateOptions& options, Clock::time_point now);

 private:
  double tokens_ = std::numeric_limits<double>::infinity();
  Clock::time_point filled_;
};

/// A token bucket for each key. Safe from several threads.
class RateLimits {
 public:
  using Clock = TokenBucket::Clock;

  /// Takes a token. @return 0, or after how many seconds there will be one.
  [[nodiscard]] double take(const std::string& key_id, const RateOptions& options,
                            Clock::time_point now = Clock::now());

 private:
  std::mutex mutex_;
  /// As many as there were keys: they are few, and their ids are the store's.
  std::map<std::string, TokenBucket> buckets_;
};

/// Token buckets for addresses, of which anybody may have many: they share a fixed number of
/// buckets, in an order that nobody outside knows. Safe from several threads.
class AddressRates {
 public:
  static constexpr std::size_t kBuckets = 4096;

  AddressRates();
  /// @param client  as `IpAddress::client_network`. @return as `TokenBucket::take`.
  [[nodiscard]] double take(const std::string& client, const RateOptions& options,
                            TokenBucket::Clock::time_point now = TokenBucket::Clock::now());

 private:
  std::string seed_;
  std::mutex mutex_;
  std::vector<TokenBucket> buckets_{kBuckets};
};

}  // namespace stillmap::server
