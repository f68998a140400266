#pragma once

#include "store/store_refusal.hpp"

#include <Eigen/Geometry>

#include <string>
#include <string_view>
#include <vector>

namespace stillmap::server {

class StoreDatabase;

/// Maps that adjoin, or lie anywhere, and are asked as one.
struct MapSet {
  struct Member {
    std::string map{};
    /// Takes points of the map frame to the set's frame.
    Eigen::Isometry3d T_set_map = Eigen::Isometry3d::Identity();
  };
  /// As a map's.
  std::string name{};
  /// By name, each once.
  std::vector<Member> maps{};
};

/// The sets of a store. A map that a set names cannot be removed. Safe from several threads. Throws
/// StorageError when the disk fails.
class SetTable {
 public:
  /// Sorted by name.
  [[nodiscard]] std::vector<MapSet> list() const;
  /// Takes the place of the set of that name. @return whether it is new.
  /// @throws StoreRefusal kUnknownMap; std::invalid_argument for a set of no map.
  bool put(const MapSet& set);
  /// @return whether there was one.
  bool remove(std::string_view name);

 private:
  friend class StoreState;
  explicit SetTable(StoreDatabase& database) : database_(&database) {}
  StoreDatabase* database_;
};

}  // namespace stillmap::server
