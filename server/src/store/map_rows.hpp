#pragma once

#include "store/store_state.hpp"

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "store/database.hpp"

namespace stillmap::server {

/// Rows of maps and versions, for those who hold the connection.

[[nodiscard]] std::string in_quotes(std::string_view name);
[[nodiscard]] std::vector<StoredMap> all_maps(Database& database);
/// @throws StoreRefusal kUnknownMap.
[[nodiscard]] StoredMap known_map(Database& database, std::string_view name);
/// Oldest first.
[[nodiscard]] std::vector<StoredVersion> versions_of(Database& database, std::string_view map);
[[nodiscard]] std::optional<StoredVersion> find_version(Database& database, std::string_view map,
                                                        std::string_view name);
/// @throws StoreRefusal kUnknownVersion.
[[nodiscard]] StoredVersion known_version(Database& database, std::string_view map,
                                          std::string_view name);
/// Whether any version of any map holds this package.
[[nodiscard]] bool is_used(Database& database, std::string_view digest);
/// As `StoreState::current_digest`.
[[nodiscard]] std::string current_digest(Database& database, std::string_view digest);
/// Notes it for removal when no version holds it.
void condemn_unused(Database& database, std::string_view digest);

/// Notes the files of a package, unless that was done. @param version  of which no files are known
/// counts as one file.
void add_files(Database& database, const StoredVersion& version);
/// Of packages and drives; of the whole store when the map is nothing.
[[nodiscard]] std::uint64_t bytes_of(Database& database, const std::optional<std::string>& map);
/// Bytes that are to come into a map.
struct Arrival {
  std::string_view map;
  std::uint64_t bytes = 0;
  /// When it is a version, which may have files that are there already: its bytes are counted.
  const StoredVersion* version = nullptr;
  WaitingBytes waiting{};
};
/// As `StoreState::check_quota`.
void refuse_over_quota(Database& database, const StoreQuota& quota, const Arrival& arrival);

}  // namespace stillmap::server
