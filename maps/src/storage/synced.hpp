#pragma once
#include <filesystem>

namespace stillmap::maps {

/// Waits until a file or folder is on the disk. @throws StorageError.
void sync(const std::filesystem::path& path);

/// Whether the open file or folder is still the one of that name: another process may have
/// published or removed it between our open and our lock.
bool is_same(int descriptor, const std::filesystem::path& path);

}  // namespace stillmap::maps
