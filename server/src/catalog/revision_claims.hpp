#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <iterator>
#include <map>
#include <mutex>
#include <set>
#include <string>
#include <string_view>
#include <utility>

#include "store/store_state.hpp"

namespace stillmap::server {

/// Revisions of maps that clients say they have seen, and that are newer than what is served.
/// Either another server serves them already, or the store was restored to an earlier time since:
/// then all clients say so for good. What the store had after a client said it first tells one from
/// the other, so no request has to ask the store. Safe from several threads.
class RevisionClaims {
 public:
  /// Of a map, newer than what is served.
  /// @return whether the store has been read since this was said first, and had none so new. Not
  /// before: then the next reading finds out. A number that the store comes to have later is found
  /// with the reading after that.
  [[nodiscard]] bool is_refuted(std::string_view map, std::int64_t revision) {
    const Claim claim(map, revision);
    const std::scoped_lock lock(mutex_);
    if (refuted_.contains(claim)) return true;
    said_.insert(claim);
    shrink(said_);
    return false;
  }
  /// Before the store is read, by one thread at a time.
  void begin_reading() {
    const std::scoped_lock lock(mutex_);
    reading_.merge(said_);
    said_.clear();
  }
  /// @param maps  as read. When reading fails, the next one does for both.
  void end_reading(const std::map<std::string, StoredMap, std::less<>>& maps) {
    const std::scoped_lock lock(mutex_);
    std::erase_if(reading_, [&](const Claim& claim) {
      const auto found = maps.find(claim.first);
      return found == maps.end() || found->second.revision >= claim.second;
    });
    shrink(reading_);
    refuted_ = reading_;
  }

 private:
  using Claim = std::pair<std::string, std::int64_t>;
  static void shrink(std::set<Claim>& claims) {
    constexpr std::size_t kMost = 10'000;
    while (claims.size() > kMost) claims.erase(std::prev(claims.end()));
  }

  std::mutex mutex_;
  std::set<Claim> said_, reading_, refuted_;
};

}  // namespace stillmap::server
