#include "store/set_table.hpp"

#include <stdexcept>

#include "store/map_rows.hpp"
#include "store/store_database.hpp"

namespace stillmap::server {
namespace {

using Reading = StoreDatabase::Reading;
using Writing = StoreDatabase::Writing;

Eigen::Isometry3d pose_of(const Statement& row, int first) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.translation() = Eigen::Vector3d(row.real(first), row.real(first + 1), row.real(first + 2));
  T.linear() = Eigen::Quaterniond(row.real(first + 6), row.real(first + 3), row.real(first + 4),
                                  row.real(first + 5))
                   .normalized()
                   .toRotationMatrix();
  return T;
}

}  // namespace

std::vector<MapSet> SetTable::list() const {
  const Reading reading(*database_);
  Statement row(reading.database(),
                "SELECT name, map, x, y, z, qx, qy, qz, qw FROM map_sets ORDER BY name, map");
  std::vector<MapSet> sets;
  while (row.step()) {
    if (sets.empty() || sets.back().name != row.text(0))
      sets.push_back({.name = row.text(0), .maps = {}});
    sets.back().maps.push_back({.map = row.text(1), .T_set_map = pose_of(row, 2)});
  }
  return sets;
}

bool SetTable::put(const MapSet& set) {
  if (set.maps.empty()) throw std::invalid_argument("set: no map, at least one expected");
  Writing writing(*database_);
  Database& database = writing.database();
  Statement(database, "DELETE FROM map_sets WHERE name = ?").bind(set.name).step();
  const bool is_new = database.changes() == 0;
  for (const auto& [map, T_set_map] : set.maps) {
    (void)known_map(database, map);
    const Eigen::Vector3d t = T_set_map.translation();
    const Eigen::Quaterniond q(T_set_map.linear());
    Statement into(database,
                   "INSERT INTO map_sets (name, map, x, y, z, qx, qy, qz, qw)"
                   " VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)");
    into.bind(set.name).bind(map);
    for (const double value : {t.x(), t.y(), t.z(), q.x(), q.y(), q.z(), q.w()})
      into.bind_real(value);
    into.step();
  }
  writing.commit();
  return is_new;
}

bool SetTable::remove(std::string_view name) {
  return database_->even_when_full([&] {
    Writing writing(*database_);
    Database& database = writing.database();
    Statement(database, "DELETE FROM map_sets WHERE name = ?").bind(name).step();
    const bool was_there = database.changes() > 0;
    writing.commit();
    return was_there;
  });
}

}  // namespace stillmap::server
