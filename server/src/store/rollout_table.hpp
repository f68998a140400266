#pragma once

#include "store/store_refusal.hpp"

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace stillmap::server {

class StoreDatabase;

/// When a roll-out is halted: see `reason_to_halt`.
struct HaltOptions {
  /// Answers of the group before it is judged, >= 1.
  std::int64_t least_answers = 200;
  /// Share of answers by which the group may be worse than the others, in [0, 1].
  double most_rise = 0.05;
  auto operator<=>(const HaltOptions&) const = default;
};

/// A version that some vehicles get before it is activated for all.
struct Rollout {
  std::string map{};
  std::string version{};
  /// Of the vehicles with a label, in [0, 1].
  double share = 0.0;
  /// Patterns of labels, as of `matches_pattern`, that are in the group beside the share.
  std::vector<std::string> vehicles{};
  HaltOptions halt{};
  bool halted = false;
  /// Why it was halted, for people.
  std::string reason{};
  /// Tells it from other roll-outs of its map.
  std::int64_t begun_ns = 0;
  /// The active version of the map, which all others get.
  std::string active{};
  auto operator<=>(const Rollout&) const = default;
};

/// The roll-outs of a store, one a map. One ends when any version of its map is activated, and goes
/// with its map. Safe from several threads. Throws StorageError when the disk fails.
class RolloutTable {
 public:
  /// Sorted by map.
  [[nodiscard]] std::vector<Rollout> list() const;
  /// Begins one, which takes the place of the one before. A running one of the same version goes
  /// on: it is still begun when it was.
  /// @param rollout  `halted`, `reason` and `active` are not looked at. @return as it is kept.
  /// @throws StoreRefusal kUnknownMap, kUnknownVersion; kActive for the active version.
  Rollout put(const Rollout& rollout);
  /// @return false when it was halted or ended before.
  bool halt(const Rollout& rollout, std::string_view reason);
  /// @return whether there was one. @throws StoreRefusal kUnknownMap.
  bool remove(std::string_view map);

 private:
  friend class StoreState;
  explicit RolloutTable(StoreDatabase& database) : database_(&database) {}
  StoreDatabase* database_;
};

}  // namespace stillmap::server
