#include "store/rollout_table.hpp"

#include <sstream>

#include "store/map_rows.hpp"
#include "store/store_database.hpp"

namespace stillmap::server {
namespace {

using Reading = StoreDatabase::Reading;
using Reason = StoreRefusal::Reason;
using Writing = StoreDatabase::Writing;

constexpr const char* kRolloutColumns =
    "SELECT map, version, share, vehicles, least_answers, most_rise, halted, reason, begun_ns,"
    " maps.active FROM rollouts JOIN maps ON maps.name = map ";

/// A label has no line feeds.
std::vector<std::string> lines_of(const std::string& text) {
  std::istringstream lines(text);
  std::vector<std::string> each;
  for (std::string line; std::getline(lines, line);) each.push_back(line);
  return each;
}

Rollout rollout_of(const Statement& row) {
  return {.map = row.text(0),
          .version = row.text(1),
          .share = row.real(2),
          .vehicles = lines_of(row.text(3)),
          .halt = {.least_answers = row.integer(4), .most_rise = row.real(5)},
          .halted = row.integer(6) != 0,
          .reason = row.text(7),
          .begun_ns = row.integer(8),
          .active = row.optional_text(9).value_or("")};
}

std::optional<Rollout> find_rollout(Database& database, std::string_view map) {
  Statement row(database, std::string(kRolloutColumns) + "WHERE map = ?");
  if (!row.bind(map).step()) return std::nullopt;
  return rollout_of(row);
}

}  // namespace

std::vector<Rollout> RolloutTable::list() const {
  const Reading reading(*database_);
  Statement row(reading.database(), std::string(kRolloutColumns) + "ORDER BY map");
  std::vector<Rollout> rollouts;
  while (row.step()) rollouts.push_back(rollout_of(row));
  return rollouts;
}

Rollout RolloutTable::put(const Rollout& rollout) {
  Writing writing(*database_);
  Database& database = writing.database();
  const StoredMap map = known_map(database, rollout.map);
  (void)known_version(database, rollout.map, rollout.version);
  if (map.active == rollout.version)
    throw StoreRefusal(Reason::kActive, "version " + in_quotes(rollout.version) + " of map " +
                                            in_quotes(rollout.map) +
                                            " is active already: roll out another one");
  Rollout kept = rollout;
  kept.halted = false;
  kept.reason.clear();
  kept.active = map.active.value_or("");
  const std::optional<Rollout> before = find_rollout(database, rollout.map);
  if (before && !before->halted && before->version == rollout.version)
    kept.begun_ns = before->begun_ns;
  Statement(database, "DELETE FROM rollouts WHERE map = ?").bind(rollout.map).step();
  std::string vehicles;
  for (const std::string& pattern : rollout.vehicles) vehicles += pattern + "\n";
  Statement(database,
            "INSERT INTO rollouts (map, version, share, vehicles, least_answers, most_rise,"
            " halted, reason, begun_ns) VALUES (?, ?, ?, ?, ?, ?, 0, '', ?)")
      .bind(kept.map)
      .bind(kept.version)
      .bind_real(kept.share)
      .bind(vehicles)
      .bind(kept.halt.least_answers)
      .bind_real(kept.halt.most_rise)
      .bind(kept.begun_ns)
      .step();
  writing.commit();
  return kept;
}

bool RolloutTable::halt(const Rollout& rollout, std::string_view reason) {
  return database_->even_when_full([&] {
    Writing writing(*database_);
    Database& database = writing.database();
    Statement(database,
              "UPDATE rollouts SET halted = 1, reason = ? WHERE map = ? AND begun_ns = ?"
              " AND halted = 0")
        .bind(reason)
        .bind(rollout.map)
        .bind(rollout.begun_ns)
        .step();
    const bool was_running = database.changes() > 0;
    writing.commit();
    return was_running;
  });
}

bool RolloutTable::remove(std::string_view map) {
  return database_->even_when_full([&] {
    Writing writing(*database_);
    Database& database = writing.database();
    (void)known_map(database, map);
    Statement(database, "DELETE FROM rollouts WHERE map = ?").bind(map).step();
    const bool was_there = database.changes() > 0;
    writing.commit();
    return was_there;
  });
}

}  // namespace stillmap::server
