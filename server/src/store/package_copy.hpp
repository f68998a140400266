#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>

#include <stillmap/maps/map_package.hpp>
#include "store/durable_files.hpp"

namespace stillmap::server {

/// build.json is made by us and small; the limit is against something else in its place.
inline constexpr std::uint64_t kLargestBuildJson = 16U << 20U;

/// Copies a regular file and syncs the copy. @param most  more bytes than this are refused before
/// they fill the disk. @return what was written. @throws InputError, StorageError.
maps::MapManifest::File copy_file(const std::filesystem::path& from,
                                  const std::filesystem::path& to, std::uint64_t most,
                                  const DurableFiles& files);

struct CopiedPackage {
  std::string digest;
  /// Of the listed files and the manifest.
  std::uint64_t bytes = 0;
};

/// Copies what a package's manifest lists, the manifest and build.json into an empty folder, and
/// syncs all of it. Sizes and checksums are those of the bytes written, so that nobody can change
/// them in between.
/// @param before_each  is called before each file; what it throws ends the copy.
/// @throws InputError naming the file that is missing, no regular file, or not what the manifest
/// says; StorageError.
CopiedPackage copy_package(const std::filesystem::path& package, const std::filesystem::path& empty,
                           const DurableFiles& files,
                           const std::function<void()>& before_each = {});

/// The same by hard links, which take no room; nothing is read, so the checksums are the caller's.
/// @return false where the disk does not allow links; the folder is then in any state.
/// @throws InputError, StorageError.
bool link_package(const std::filesystem::path& package, const std::filesystem::path& empty,
                  const DurableFiles& files);

}  // namespace stillmap::server
