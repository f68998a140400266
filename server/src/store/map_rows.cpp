#include "store/map_rows.hpp"

#include "store/store_refusal.hpp"

#include <algorithm>
#include <sstream>

namespace stillmap::server {
namespace {

using Reason = StoreRefusal::Reason;

constexpr const char* kMapColumns =
    "SELECT name, active, previous, revision, created_ns FROM maps ";
constexpr const char* kVersionColumns =
    "SELECT versions.name, versions.digest, versions.bytes, versions.created_ns, migrated.former"
    " FROM versions LEFT JOIN migrated ON migrated.digest = versions.digest ";

StoredMap map_of(const Statement& row) {
  return {row.text(0), row.optional_text(1), row.optional_text(2), row.integer(3), row.integer(4)};
}

/// A version has a row for each of its former digests, or one row.
std::vector<StoredVersion> versions_in(Statement& row) {
  std::vector<StoredVersion> versions;
  while (row.step()) {
    if (versions.empty() || versions.back().name != row.text(0))
      versions.push_back(
          {row.text(0), row.text(1), static_cast<std::uint64_t>(row.integer(2)), row.integer(3)});
    if (const auto former = row.optional_text(4)) versions.back().former_digests.push_back(*former);
  }
  return versions;
}

bool has_package(Database& database, std::string_view map, std::string_view digest) {
  Statement row(database, "SELECT 1 FROM versions WHERE map = ? AND digest = ?");
  return row.bind(map).bind(digest).step();
}

FileBytes files_of(const StoredVersion& version) {
  return version.files.empty() ? FileBytes{{version.digest, version.bytes}} : version.files;
}

/// Bytes of the files that no version of a map has.
std::uint64_t new_bytes(Database& database, std::string_view map, const StoredVersion& version) {
  std::uint64_t bytes = 0;
  for (const auto& [sha256, size] : files_of(version)) {
    Statement row(database,
                  "SELECT 1 FROM package_files f JOIN versions v ON v.digest = f.package"
                  " WHERE f.sha256 = ? AND v.map = ?");
    if (!row.bind(sha256).bind(map).step()) bytes += size;
  }
  return bytes;
}

void refuse_over(std::optional<std::uint64_t> limit, std::uint64_t used, std::uint64_t more,
                 const std::string& whose) {
  if (!limit || (used <= *limit && more <= *limit - used)) return;
  throw StoreRefusal(Reason::kOverQuota,
                     whose + " holds " + std::to_string(used) + " bytes and may hold " +
                         std::to_string(*limit) + "; there is no room for " + std::to_string(more) +
                         " more: remove versions or drives, or raise the quota");
}

}  // namespace

std::string in_quotes(std::string_view name) { return "'" + std::string(name) + "'"; }

std::vector<StoredMap> all_maps(Database& database) {
  Statement row(database, std::string(kMapColumns) + "ORDER BY name");
  std::vector<StoredMap> maps;
  while (row.step()) maps.push_back(map_of(row));
  return maps;
}

StoredMap known_map(Database& database, std::string_view name) {
  Statement row(database, std::string(kMapColumns) + "WHERE name = ?");
  if (!row.bind(name).step())
    throw StoreRefusal(Reason::kUnknownMap, "there is no map " + in_quotes(name));
  return map_of(row);
}

std::vector<StoredVersion> versions_of(Database& database, std::string_view map) {
  Statement row(database,
                std::string(kVersionColumns) +
                    "WHERE versions.map = ? ORDER BY versions.created_ns, versions.name, former");
  row.bind(map);
  return versions_in(row);
}

std::optional<StoredVersion> find_version(Database& database, std::string_view map,
                                          std::string_view name) {
  Statement row(database, std::string(kVersionColumns) +
                              "WHERE versions.map = ? AND versions.name = ? ORDER BY former");
  row.bind(map).bind(name);
  std::vector<StoredVersion> found = versions_in(row);
  if (found.empty()) return std::nullopt;
  return std::move(found.front());
}

StoredVersion known_version(Database& database, std::string_view map, std::string_view name) {
  const std::optional<StoredVersion> found = find_version(database, map, name);
  if (!found)
    throw StoreRefusal(Reason::kUnknownVersion,
                       "map " + in_quotes(map) + " has no version " + in_quotes(name));
  return *found;
}

bool is_used(Database& database, std::string_view digest) {
  return Statement(database, "SELECT 1 FROM versions WHERE digest = ?").bind(digest).step();
}

std::string current_digest(Database& database, std::string_view digest) {
  Statement row(database, "SELECT digest FROM migrated WHERE former = ?");
  return row.bind(digest).step() ? row.text(0) : std::string(digest);
}

void condemn_unused(Database& database, std::string_view digest) {
  if (is_used(database, digest)) return;
  Statement(database, "INSERT INTO condemned (digest) VALUES (?) ON CONFLICT DO NOTHING")
      .bind(digest)
      .step();
  for (const char* sql :
       {"DELETE FROM package_files WHERE package = ?", "DELETE FROM signatures WHERE package = ?"})
    Statement(database, sql).bind(digest).step();
}

void add_files(Database& database, const StoredVersion& version) {
  Statement known(database, "SELECT 1 FROM package_files WHERE package = ?");
  if (known.bind(version.digest).step()) return;
  for (const auto& [sha256, bytes] : files_of(version))
    Statement(database, "INSERT INTO package_files (package, sha256, bytes) VALUES (?, ?, ?)")
        .bind(version.digest)
        .bind(sha256)
        .bind(static_cast<std::int64_t>(bytes))
        .step();
}

std::uint64_t bytes_of(Database& database, const std::optional<std::string>& map) {
  // Several versions may share one package, and versions of one map share files. A package of
  // several maps lies there once.
  Statement sum(
      database,
      "SELECT (SELECT coalesce(sum(bytes), 0) FROM (SELECT DISTINCT v.map,"
      "        coalesce(f.sha256, v.digest), coalesce(f.bytes, v.bytes) AS bytes FROM"
      "        (SELECT min(map) AS map, digest, max(bytes) AS bytes FROM versions"
      "         WHERE ?1 IS NULL OR map = ?1 GROUP BY digest) v"
      "        LEFT JOIN package_files f ON f.package = v.digest) files)"
      " + (SELECT coalesce(sum(p.bytes), 0) FROM drive_parts p JOIN drives d ON d.id = p.drive"
      "    WHERE (?1 IS NULL OR d.map = ?1) AND (d.version IS NULL OR d.status <> 'complete'))");
  sum.bind(map).step();
  return static_cast<std::uint64_t>(sum.integer(0));
}

void refuse_over_quota(Database& database, const StoreQuota& quota, const Arrival& arrival) {
  const std::string_view map = arrival.map;
  const StoredVersion* const version = arrival.version;
  const std::string digest = version ? current_digest(database, version->digest) : "";
  const std::uint64_t bytes = version ? new_bytes(database, map, *version) : arrival.bytes;
  if (quota.map_bytes && !has_package(database, map, digest))
    refuse_over(quota.map_bytes, bytes_of(database, std::string(map)) + arrival.waiting.of_map,
                bytes, "map " + in_quotes(map));
  if (quota.store_bytes && !is_used(database, digest))
    refuse_over(quota.store_bytes, bytes_of(database, {}) + arrival.waiting.of_store, bytes,
                "the store");
}

}  // namespace stillmap::server
