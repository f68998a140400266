#pragma once

#include "pose/halt_rule.hpp"

#include <map>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>

namespace stillmap::server {

/// Answers of the versions of each map, and of each roll-out's group and the others since it began.
/// In memory: they begin anew with the server. Safe from several threads.
class RolloutCounts {
 public:
  enum class Group { kNone, kRollout, kOthers };

  /// An answer of a version that the request did not name.
  /// @param rollout  of its map, if there is one. @return where it counts.
  Group answered(const std::string& map, const std::string& version, std::string_view status,
                 const std::optional<Rollout>& rollout);
  [[nodiscard]] RolloutFigures figures(const Rollout& rollout) const;
  /// The map was removed: a new one of that name begins anew.
  void forget(const std::string& map);

 private:
  struct OfMap {
    std::map<std::string, AnswerCounts> by_version;
    /// Of the roll-out that began then.
    std::int64_t begun_ns = 0;
    RolloutFigures figures;
  };
  static void begin(OfMap& counts, const Rollout& rollout);

  mutable std::mutex mutex_;
  std::map<std::string, OfMap> maps_;
};

}  // namespace stillmap::server
