#pragma once

#include <filesystem>

namespace stillmap::server {

/// Gives the files of a package second names, so that they stay whatever becomes of the first;
/// takes no room. Indexes come too, and nothing else that is derived.
/// @param package  a folder of `packages/` in a store.
/// @param folder   in an existing one, on the same disk; appears whole or not at all.
/// @return false where the disk allows no such names.
/// @throws InputError when there is no such package (any more), StorageError.
bool hold_package(const std::filesystem::path& package, const std::filesystem::path& folder);

}  // namespace stillmap::server
