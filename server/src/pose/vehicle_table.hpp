#pragma once

#include "pose/halt_rule.hpp"

#include <cstdint>
#include <list>
#include <map>
#include <mutex>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace stillmap::server {

/// Which vehicle asked which version of a map, in memory: the newest 10,000 over all maps, and of
/// more that one leaves which was not seen for longest. Safe from several threads.
class VehicleTable {
 public:
  static constexpr std::size_t kMost = 10'000;

  struct Vehicle {
    std::string label{};
    /// That it was told of, or answered from, last.
    std::string version{};
    std::int64_t last_seen_ns = 0;
    AnswerCounts answers{};
  };

  /// @param label  empty: nothing is noted. @param status  of a pose; empty when it asked only
  /// which version it gets.
  void seen(const std::string& map, const std::string& label, const std::string& version,
            std::string_view status, std::int64_t now_ns);
  /// Sorted by label. @param after  labels above this one. @param most  so many at most.
  [[nodiscard]] std::vector<Vehicle> list(const std::string& map, const std::string& after,
                                          std::size_t most) const;
  /// The map was removed.
  void forget(const std::string& map);

 private:
  using Key = std::pair<std::string, std::string>;  // map, label
  struct Entry {
    Vehicle vehicle;
    std::list<Key>::iterator place;
  };
  mutable std::mutex mutex_;
  /// The one that was seen last is the first.
  std::list<Key> order_;
  std::map<Key, Entry> vehicles_;
};

}  // namespace stillmap::server
