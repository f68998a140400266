#pragma once

#include "errors/api_error.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cstddef>
#include <map>
#include <memory>
#include <mutex>
#include <string>

namespace stillmap::server {

/// Places for event streams, each of which holds a connection for as long as its client likes. Safe
/// from several threads.
class EventPlaces {
 public:
  /// @param most   open at one time.
  /// @param share  of them that one key may hold, in (0, 1]; at least one.
  EventPlaces(std::size_t most, double share)
      : most_(most),
        most_of_one_(std::max<std::size_t>(
            1, static_cast<std::size_t>(share * static_cast<double>(most)))) {}
  EventPlaces(const EventPlaces&) = delete;
  EventPlaces& operator=(const EventPlaces&) = delete;

  /// A place until it is let go; this outlives it.
  /// @param key_id  of whoever asks; empty = without keys, no share.
  /// @throws ApiError kTooManyStreams, kTooManyRequests, with Retry-After.
  [[nodiscard]] std::shared_ptr<void> take(const std::string& key_id) {
    const std::scoped_lock lock(mutex_);
    if (taken_ >= most_) {
      throw ApiError(ErrorCode::kTooManyStreams,
                     fmt::format("{} event streams are open, and no more are taken", most_))
          .with_header("Retry-After", "5");
    }
    const auto own = taken_by_.find(key_id);
    if (!key_id.empty() && own != taken_by_.end() && own->second >= most_of_one_) {
      throw ApiError(
          ErrorCode::kTooManyRequests,
          fmt::format("{} event streams of this key are open, which is its share", own->second))
          .with_header("Retry-After", "5");
    }
    ++taken_;
    ++taken_by_[key_id];
    return {this, [key_id](void* self) { static_cast<EventPlaces*>(self)->let_go(key_id); }};
  }

 private:
  void let_go(const std::string& key_id) {
    const std::scoped_lock lock(mutex_);
    --taken_;
    if (--taken_by_[key_id] == 0) taken_by_.erase(key_id);
  }

  std::size_t most_;
  std::size_t most_of_one_;
  std::mutex mutex_;
  std::size_t taken_ = 0;
  /// Of keys that hold any.
  std::map<std::string, std::size_t> taken_by_;
};

}  // namespace stillmap::server
