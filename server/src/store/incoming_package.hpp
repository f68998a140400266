#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "signing/map_signature.hpp"
#include "store/archive_files.hpp"
#include "store/durable_files.hpp"
#include "store/package_copy.hpp"
#include "store/shared_files.hpp"

namespace stillmap::server {

struct IncomingPackage {
  /// The folder that was unpacked into, or the one in it that holds the package.
  std::filesystem::path folder;
  CopiedPackage package;
  /// That came beside its manifest.
  std::vector<MapSignature> signatures{};
};

/// Finds a file of these bytes that lies in the store; nothing where there is none.
using FindFile =
    std::function<std::optional<std::filesystem::path>(const maps::MapManifest::File& file)>;

/// Makes a package of what was unpacked (with SHA-256): finds its manifest, compares every listed
/// file with it, drops what is not listed, but build.json, and syncs all of it. Signatures are read
/// and dropped. A listed file that was not sent is taken from the known ones, by a link or a copy.
/// @param name  of the archive, for messages.
/// @throws InputError naming the file that is missing or not what the manifest says; StorageError.
IncomingPackage keep_package(const std::filesystem::path& unpacked, const ArchiveFiles& found,
                             const std::string& name, const DurableFiles& disk,
                             const FindFile& known = {});

}  // namespace stillmap::server
