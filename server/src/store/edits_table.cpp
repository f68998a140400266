#include "store/edits_table.hpp"

#include <stillmap/maps/edits.hpp>
#include <stillmap/maps/map_package.hpp>

#include <stdexcept>

#include "store/map_rows.hpp"
#include "store/store_database.hpp"

namespace stillmap::server {
namespace {

using Reading = StoreDatabase::Reading;
using Reason = StoreRefusal::Reason;
using Writing = StoreDatabase::Writing;

SavedEdits known_edits(Database& database, std::string_view map) {
  (void)known_map(database, map);
  Statement row(database, "SELECT text, sha256, saved_ns, saver FROM saved_edits WHERE map = ?");
  if (!row.bind(map).step())
    return {.text = std::string(maps::kNoEdits), .sha256 = maps::sha256_of(maps::kNoEdits)};
  return {
      .text = row.text(0), .sha256 = row.text(1), .saved_ns = row.integer(2), .saver = row.text(3)};
}

}  // namespace

SavedEdits EditsTable::of_map(std::string_view map) const {
  const Reading reading(*database_);
  return known_edits(reading.database(), map);
}

SavedEdits EditsTable::save(std::string_view map, std::string_view text, std::string_view saver,
                            std::int64_t now_ns, const std::optional<std::string>& before) {
  if (text.size() > kMostBytes)
    throw std::invalid_argument("edits: " + std::to_string(text.size()) + " bytes, at most " +
                                std::to_string(kMostBytes) + " expected");
  Writing writing(*database_);
  Database& database = writing.database();
  const SavedEdits known = known_edits(database, map);
  if (before && *before != known.sha256)
    throw StoreRefusal(Reason::kOtherRevision,
                       "the corrections of map " + in_quotes(map) + " were changed meanwhile");
  Statement(database,
            "INSERT INTO saved_edits (map, text, sha256, saved_ns, saver) VALUES (?, ?, ?, ?, ?)"
            " ON CONFLICT (map) DO UPDATE SET text = excluded.text, sha256 = excluded.sha256,"
            " saved_ns = excluded.saved_ns, saver = excluded.saver")
      .bind(map)
      .bind(text)
      .bind(maps::sha256_of(text))
      .bind(now_ns)
      .bind(saver)
      .step();
  writing.commit();
  return {.text = std::string(text),
          .sha256 = maps::sha256_of(text),
          .saved_ns = now_ns,
          .saver = std::string(saver)};
}

}  // namespace stillmap::server
