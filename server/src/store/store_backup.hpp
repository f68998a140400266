#pragma once

#include "store/disk_calls.hpp"
#include "store/package_store.hpp"

#include <cstddef>
#include <filesystem>

namespace stillmap::server {

struct BackedUp {
  /// Packages that came, and those that an earlier backup had brought.
  std::size_t copied = 0;
  std::size_t kept = 0;
};
/// Writes the state as of one instant and the packages that it names into a folder, while others
/// may read and write the store. On one disk packages are linked, else copied, and their checksums
/// recomputed; those of an earlier backup are kept, and those that are not named any more go. A
/// crash leaves the earlier backup or the new one. Drives are not in it, so jobs that have not
/// finished are failed in it.
/// @param folder  new, empty or an earlier backup.
/// @throws InputError when it is something else; or names what is broken, once all else is saved;
/// StorageError.
BackedUp back_up_store(const PackageStore& store, const std::filesystem::path& folder);

/// Recomputes the checksums of the packages of an earlier backup and takes those out of it that are
/// damaged, so that the next `back_up_store` brings them again; slow: reads everything.
/// @param backup  nothing happens where there is none yet.
/// @return how many were damaged. @throws StorageError.
std::size_t drop_damaged_of_backup(const std::filesystem::path& backup,
                                   DiskCalls& calls = DiskCalls::real());

/// Makes a store of a backup, with copies of its packages, whose checksums are recomputed.
/// @param folder  new or empty. @return how many packages.
/// @throws InputError when it holds anything or the backup is none or broken; or names versions
/// whose package was broken when it was made, once all else is restored; StorageError.
std::size_t restore_store(const std::filesystem::path& backup, const std::filesystem::path& folder,
                          DiskCalls& calls = DiskCalls::real());

}  // namespace stillmap::server
