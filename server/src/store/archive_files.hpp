#pragma once

#include <stillmap/maps/map_package.hpp>
#include "store/archive.hpp"

#include <map>
#include <set>
#include <string>

#include "store/durable_files.hpp"

namespace stillmap::server {

/// What was unpacked into a folder, by path relative to it. SHA-256 only where asked for.
struct ArchiveFiles {
  std::map<std::string, maps::MapManifest::File> files;
  std::set<std::string> folders;
  ExtractedArchive archive;
};

/// Unpacks into an empty folder as `extract_archive` does. What is there when it throws stays.
/// Folders are not synced.
/// @param hashed  whether the files' SHA-256 is taken. Then they are not synced either: whoever
/// looks at the hashes knows which files stay (`keep_package`).
ArchiveFiles unpack_archive(const IncomingArchive& archive, const std::filesystem::path& empty,
                            const DurableFiles& disk, bool hashed);

}  // namespace stillmap::server
