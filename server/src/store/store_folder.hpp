#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

namespace stillmap::server {

/// Names in a store's folder (server/store.md), and how they are looked up.

constexpr const char* kStateName = "state.db";
/// Where the state is in PostgreSQL: its address stands here, and there is no `kStateName`.
constexpr const char* kStateAddressName = "state.address";
/// What is left of a state that was moved there.
constexpr const char* kMovedStateName = "state.db.moved";
constexpr const char* kLockName = ".lock";
/// Room on the disk, for removals when it is full.
constexpr const char* kBallastName = ".ballast";
/// What seals the sessions of the store's vehicles (sealing/seal_keys.hpp).
constexpr const char* kSealKeysName = "seal.keys";
constexpr const char* kPackagesName = "packages";
/// In a backup, so that nobody takes it for a store or a store for it.
constexpr const char* kBackupMark = ".stillmap-backup";
constexpr const char* kIncoming = ".incoming-";
constexpr const char* kRemoved = ".removed-";
/// What is derived from a package lies in these folders of it.
constexpr const char* kIndexFolder = "index";
constexpr std::array<const char*, 4> kDerivedFolders = {kIndexFolder, "levels", "differences",
                                                        "layers"};

/// Since the Unix epoch.
[[nodiscard]] std::int64_t now_ns();
/// 64 hex digits.
[[nodiscard]] bool is_digest(std::string_view name);
/// Names of the folders in it, sorted; links are none. @throws StorageError.
[[nodiscard]] std::vector<std::string> folders_in(const std::filesystem::path& folder);
/// Whether there is anything, a broken link too. @throws StorageError when that cannot be told.
[[nodiscard]] bool is_there(const std::filesystem::path& path);

}  // namespace stillmap::server
