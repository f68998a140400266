#pragma once

#include "errors/api_error.hpp"

#include <algorithm>
#include <map>
#include <memory>
#include <mutex>
#include <string>

namespace stillmap::server {

/// Places for what must not run in any number at once, such as uploads and event streams, each of
/// which holds a connection. Safe from several threads.
class SharedPlaces {
 public:
  SharedPlaces() = default;
  SharedPlaces(const SharedPlaces&) = delete;
  SharedPlaces& operator=(const SharedPlaces&) = delete;

  /// A place until it is let go; this outlives it.
  /// @param most    at one time, this one included. @param key_id  of whoever asks: one key may
  /// hold its share of them, at least one; without one, all. @param what  takes them, for the
  /// refusal. @param share  in (0, 1]. @param full  what the refusal says when all are taken.
  /// @throws ApiError `full`, kTooManyRequests.
  [[nodiscard]] std::shared_ptr<void> take(int most, const std::string& key_id,
                                           const std::string& what = "uploads", double share = 0.5,
                                           ErrorCode full = ErrorCode::kBusy) {
    const std::scoped_lock lock(mutex_);
    if (taken_ >= most) {
      throw ApiError(full,
                     std::to_string(most) + " " + what + " are under way, and no more are taken")
          .with_header("Retry-After", "5");
    }
    const int most_of_one = std::max(1, static_cast<int>(share * most));
    const auto own = taken_by_.find(key_id);
    if (!key_id.empty() && own != taken_by_.end() && own->second >= most_of_one) {
      throw ApiError(ErrorCode::kTooManyRequests, "this key has " + std::to_string(most_of_one) +
                                                      " " + what + " under way, its share")
          .with_header("Retry-After", "5");
    }
    ++taken_;
    ++taken_by_[key_id];
    return {this, [key_id](void* self) { static_cast<SharedPlaces*>(self)->let_go(key_id); }};
  }

 private:
  void let_go(const std::string& key_id) {
    const std::scoped_lock lock(mutex_);
    --taken_;
    if (--taken_by_[key_id] == 0) taken_by_.erase(key_id);
  }

  std::mutex mutex_;
  int taken_ = 0;
  /// Of keys that hold any.
  std::map<std::string, int> taken_by_;
};

}  // namespace stillmap::server
