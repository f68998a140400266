#pragma once

#include <chrono>
#include <optional>

namespace stillmap::server {

/// How often, and after which pauses, a request is sent again that may pass at another time. The
/// defaults outlast the restart of a server.
struct RetryPolicy {
  /// Tries of one request, the first included.
  int attempts = 12;
  /// The first pause; each is twice the one before.
  std::chrono::milliseconds first_pause{200};
  std::chrono::milliseconds longest_pause{5'000};
  /// No try begins later than this after the first one.
  std::chrono::milliseconds within{30'000};

  /// The pause before the next try; nothing when there is none.
  /// @param failed    tries so far, at least 1. @param spent  since the first one began.
  /// @param chance    in [0, 1): the pause is the half of its length and a random part of the other
  ///                  half, so that many clients do not come back at once.
  /// @param wished    by the server (`Retry-After`); a longer one than ours counts.
  [[nodiscard]] std::optional<std::chrono::milliseconds> pause(
      int failed, std::chrono::milliseconds spent, double chance,
      std::chrono::milliseconds wished = {}) const;
};

}  // namespace stillmap::server
