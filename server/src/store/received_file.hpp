#pragma once

#include "store/archive.hpp"
#include "store/disk_calls.hpp"

#include <cstdint>
#include <filesystem>
#include <string>

namespace stillmap::server {

/// Copies exactly so many bytes into a new file, synced; its folder is not.
/// @param file  must not exist. @param name  what messages call it.
/// @return their SHA-256, lower-case hex.
/// @throws InputError when there are fewer or more, StorageError; half a file may be left then.
std::string receive_file(const ByteSource& source, std::uint64_t bytes,
                         const std::filesystem::path& file, const std::string& name,
                         DiskCalls& calls = DiskCalls::real());

}  // namespace stillmap::server
