#pragma once

#include "store/package_store.hpp"
#include "store/store_backup.hpp"
#include "store/store_migration.hpp"
#include "store/store_upkeep.hpp"

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace stillmap::server {

/// What was made from a package again.
struct MadeAnew {
  std::string digest;
  /// Why it lies nowhere; empty when it was written.
  std::string index_not_written_because;
  std::string levels_not_written_because;

  [[nodiscard]] bool is_whole() const {
    return index_not_written_because.empty() && levels_not_written_because.empty();
  }
};
/// A version that went.
struct RemovedVersion {
  std::string map, version;
};

/// A map of the store with all its versions, oldest first.
struct MapWithVersions {
  StoredMap map;
  std::vector<StoredVersion> versions;
  /// Of its packages and drives.
  std::uint64_t bytes = 0;
};

/// What `stillmap store` and `stillmap keys` print with --json (server/operation.md).
[[nodiscard]] std::string problems_json(const std::vector<StoreProblem>& problems);
/// @param bytes  of the whole store.
[[nodiscard]] std::string store_list_json(const std::vector<MapWithVersions>& maps,
                                          std::uint64_t bytes);
[[nodiscard]] std::string cleared_json(const ClearedPackages& cleared,
                                       const std::vector<RemovedVersion>& removed);
[[nodiscard]] std::string sent_json(std::size_t packages);
/// @param package_gone  as of `PackageStore::remove`.
[[nodiscard]] std::string removed_json(const RemovedVersion& removed, bool package_gone);
[[nodiscard]] std::string made_anew_json(const std::vector<MadeAnew>& all);
/// @param free_bytes  of the disk.
[[nodiscard]] std::string migration_plan_json(const MigrationPlan& plan, std::uint64_t free_bytes);
[[nodiscard]] std::string migration_json(const Migration& migration);
[[nodiscard]] std::string backup_json(const BackedUp& done);
/// @param state  where it is, without a password.
[[nodiscard]] std::string attached_json(const std::string& state);
[[nodiscard]] std::string restored_json(std::size_t packages);
[[nodiscard]] std::string added_json(const std::string& map, const PackageStore::Added& added);
/// With the secret, which is told once.
[[nodiscard]] std::string created_key_json(const KeyTable::Created& created);
[[nodiscard]] std::string key_json(const ApiKey& key);
[[nodiscard]] std::string keys_json(const std::vector<ApiKey>& keys);

}  // namespace stillmap::server
