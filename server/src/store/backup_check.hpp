#pragma once

#include "store/disk_calls.hpp"

#include <cstddef>
#include <filesystem>

namespace stillmap::server {

/// Recomputes the checksums of the packages of an earlier backup and takes those out of it that are
/// damaged, so that the next `PackageStore::backup` brings them again; slow: reads everything.
/// @param backup  nothing happens where there is none yet.
/// @return how many were damaged. @throws StorageError.
std::size_t drop_damaged_of_backup(const std::filesystem::path& backup,
                                   DiskCalls& calls = DiskCalls::real());

}  // namespace stillmap::server
