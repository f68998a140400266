#pragma once

#include "store/package_store.hpp"

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

namespace stillmap::server {

/// Packages of schema 1 become packages of schema 2, for an operator (server/store.md says how).

/// A package and those who hold it.
struct PackageOfVersions {
  std::string digest;
  /// "town/1, depot/1"
  std::string versions;
  std::uint64_t bytes = 0;
};
/// What there is to do.
struct MigrationPlan {
  /// Of schema 1, in the order of maps and versions.
  std::vector<PackageOfVersions> packages;
  /// That the disk must have free at the beginning, an estimate from above. A former package goes
  /// when its successor is there, unless a backup has links to its files.
  std::uint64_t room_bytes = 0;
};
/// @throws StorageError.
[[nodiscard]] MigrationPlan plan_migration(const PackageStore& store);

struct MigratedPackage {
  PackageOfVersions former;
  std::string digest;
  std::uint64_t bytes = 0;
};
/// What stays as it was, and why.
struct PackageLeft {
  PackageOfVersions package;
  std::string why;
};
struct Migration {
  std::vector<MigratedPackage> migrated;
  std::vector<PackageLeft> left;
};
/// Told often. Returns false to stop. @param package  the one that is converted.
using MigrationProgress = std::function<bool(std::uint64_t done_bytes, std::uint64_t total_bytes,
                                             const PackageOfVersions& package)>;

/// Converts the packages of a plan one after the other. Killed at any instant, it has lost nothing,
/// and a later call goes on with the packages that remain. A package that is damaged, or that
/// schema 2 has no place for, is left and served as before.
/// @throws InputError while a server or another migration uses the store; DiskFull before anything
/// is changed when the disk has less room than planned; maps::WorkStopped between two steps;
/// StorageError.
Migration migrate_store(PackageStore& store, const MigrationPlan& plan,
                        const MigrationProgress& progress = {});

}  // namespace stillmap::server
