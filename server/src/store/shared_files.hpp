#pragma once

#include "store/durable_files.hpp"

#include <cstdint>
#include <filesystem>
#include <map>
#include <string>

namespace stillmap::server {

/// Files of packages that lie in a store, by their SHA-256 (lower-case hex). They may be damaged.
using KnownFiles = std::map<std::string, std::filesystem::path>;

/// Adds what a package's manifest lists; nothing of one that cannot be read.
void add_files_of(const std::filesystem::path& package, KnownFiles& known);

/// Lets a package that is not published yet have known files in place of its own: hard links, so
/// that what two versions have in common takes room once. Bytes are compared before, so that a
/// damaged file is not taken. Does nothing where the disk does not allow links.
/// @return bytes that are not taken twice. @throws InputError, StorageError for the package.
std::uint64_t share_files(const std::filesystem::path& package, const KnownFiles& known,
                          const DurableFiles& files);

}  // namespace stillmap::server
