#pragma once

#include "index/index_bytes.hpp"

#include <cstddef>
#include <filesystem>
#include <span>

namespace stillmap::localization {

/// `index/FORMAT-OPTIONS.idx` inside the package, where OPTIONS is a checksum of them: indices of
/// several formats and options lie side by side, and go with the map when it is moved or removed.
[[nodiscard]] std::filesystem::path index_file_of(const std::filesystem::path& package,
                                                  const MapIndexOptions& options);

/// Puts bytes at `file`, whole or not at all, and flushes them to the disk; makes its folder.
/// Several processes and threads may do so at once.
/// @throws maps::StorageError if that is not possible, also when another one is just doing it.
void publish_file(const std::filesystem::path& file, std::span<const std::byte> bytes);

}  // namespace stillmap::localization
