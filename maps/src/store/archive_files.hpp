#pragma once

#include <stillmap/maps/map_package.hpp>
#include <stillmap/maps/store/archive.hpp>

#include <map>
#include <set>
#include <string>

#include "store/durable_files.hpp"

namespace stillmap::maps {

/// What was unpacked into a folder, by path relative to it. SHA-256 only where asked for.
struct ArchiveFiles {
  std::map<std::string, MapManifest::File> files;
  std::set<std::string> folders;
  ExtractedArchive archive;
};

/// Unpacks into an empty folder as `extract_archive` does. Files are synced, folders are not; what
/// is there when it throws stays.
ArchiveFiles unpack_archive(const ByteSource& source, const std::string& name,
                            const std::filesystem::path& empty, const ArchiveLimits& limits,
                            const DurableFiles& disk, bool hashed);

}  // namespace stillmap::maps
