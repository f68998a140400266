#pragma once

#include "store/rollout_table.hpp"

#include <cstdint>
#include <string>
#include <string_view>

namespace stillmap::server {

/// Poses by status.
struct AnswerCounts {
  std::int64_t ok = 0;
  std::int64_t degraded = 0;
  std::int64_t lost = 0;

  [[nodiscard]] std::int64_t all() const { return ok + degraded + lost; }
  /// @param status  `ok`, `degraded` or `lost`.
  void add(std::string_view status);
  auto operator<=>(const AnswerCounts&) const = default;
};

/// What the answers of a roll-out's group are compared with.
struct RolloutFigures {
  AnswerCounts rollout{};
  /// Of the active version, in the same time.
  AnswerCounts others{};
  /// Of the active version, on this server before the roll-out began.
  AnswerCounts before{};
};

/// Why a roll-out must be halted, for people; empty when it may go on. It is halted when its group
/// has enough answers and a larger share of them is `degraded` or `lost`, or `lost` alone, than of
/// the others: by more than `most_rise`, and by more than chance explains (two proportions, z > 3).
/// Where the others have fewer answers than that, they are compared with those of the active
/// version before the roll-out; without these either, with none that is not `ok`.
[[nodiscard]] std::string reason_to_halt(const RolloutFigures& figures, const HaltOptions& options);

}  // namespace stillmap::server
