#pragma once

#include <stillmap/server/server_options.hpp>

#include <chrono>
#include <map>
#include <mutex>
#include <string>

namespace stillmap::server {

/// A token bucket for each key. Safe from several threads.
class RateLimits {
 public:
  using Clock = std::chrono::steady_clock;

  /// Takes a token. @return 0, or after how many seconds there will be one.
  [[nodiscard]] double take(const std::string& key_id, const RateOptions& options,
                            Clock::time_point now = Clock::now());

 private:
  struct Bucket {
    double tokens = 0.0;
    Clock::time_point filled;
  };
  std::mutex mutex_;
  /// As many as there were keys: they are few, and their ids are the store's.
  std::map<std::string, Bucket> buckets_;
};

}  // namespace stillmap::server
