#pragma once

#include "errors/api_error.hpp"

#include <atomic>
#include <memory>
#include <string>

namespace stillmap::server {

/// Places for uploads that are under way, since each holds a connection, a buffer and the disk, and
/// for whatever else must not run in any number at once. Safe from several threads.
class UploadPlaces {
 public:
  UploadPlaces() = default;
  UploadPlaces(const UploadPlaces&) = delete;
  UploadPlaces& operator=(const UploadPlaces&) = delete;

  /// A place until it is let go; this outlives it.
  /// @param most  at one time, this one included. @param what  takes them, for the refusal.
  /// @throws ApiError kBusy.
  [[nodiscard]] std::shared_ptr<void> take(int most, const std::string& what = "uploads") {
    if (taken_.fetch_add(1) >= most) {
      --taken_;
      throw ApiError(ErrorCode::kBusy,
                     std::to_string(most) + " " + what + " are under way, and no more are taken")
          .with_header("Retry-After", "5");
    }
    return {this, [](void* self) { --static_cast<UploadPlaces*>(self)->taken_; }};
  }

 private:
  std::atomic<int> taken_ = 0;
};

}  // namespace stillmap::server
