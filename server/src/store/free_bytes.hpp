#pragma once

#include <cstdint>
#include <filesystem>

namespace stillmap::server {

/// Of the disk that holds the folder; 0 where the disk does not say.
[[nodiscard]] std::uint64_t free_bytes(const std::filesystem::path& folder);

}  // namespace stillmap::server
