#pragma once

#include "sealing/seal_keys.hpp"

#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <string_view>
#include <unordered_map>

namespace stillmap::server {

/// Seals and opens the sessions of one store by the clock, and knows the seals that this process
/// has gone on from. Safe from several threads.
class SessionSeals {
 public:
  /// @param now_ns  since 1970; for tests.
  explicit SessionSeals(std::unique_ptr<SealKeySource> keys,
                        std::function<std::int64_t()> now_ns = {});

  /// A session that begins, with a new id.
  [[nodiscard]] SealedSession begin() const;
  /// @throws ApiError kInvalidSeal for what is no seal of this owner, kSealExpired for one that was
  /// made too long ago.
  [[nodiscard]] SealedSession open(std::string_view text, const SealOwner& owner) const;
  /// The seal that follows: stamped, and counted as the newest of its session.
  /// @param session  its count is that of the seal before it; 0 when there is none.
  /// @return the text. @param is_replay  set when this process has made such a seal before: the
  /// seal before it came twice.
  [[nodiscard]] std::string next(SealedSession session, const SealOwner& owner, bool& is_replay);

 private:
  /// Newest count by id. What is older than `kSealLife`, or more than `kMost`, is forgotten.
  using Counts = std::unordered_map<std::string, std::uint64_t>;
  bool note(const std::string& id, std::uint64_t count, std::int64_t now_ns);

  std::unique_ptr<SealKeySource> keys_;
  std::function<std::int64_t()> now_ns_;
  std::mutex mutex_;
  Counts young_, old_;
  std::int64_t young_since_ns_ = 0;
};

}  // namespace stillmap::server
