#pragma once

#include <stillmap/server/server_options.hpp>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <span>
#include <string_view>

#include "store/disk_calls.hpp"
#include "store/package_store.hpp"

namespace stillmap::server {

/// Where a store's packages are, when not in its folder, is noted in the folder, in `blobs.json`:
/// the options `blobs`, `cache`, `cache_bytes` and `s3` of `stillmap serve`. So every command finds
/// them.

/// Opens a store with its packages where its `blobs.json` says, or in its folder.
/// @throws also maps::InputError for a file that cannot be read.
[[nodiscard]] PackageStore open_store(const std::filesystem::path& folder);
/// The same for a server. Options that name blobs are noted; the place of the packages must be as
/// it was. @throws also maps::InputError for another place, and when packages are in the folder.
[[nodiscard]] PackageStore open_store(const std::filesystem::path& folder,
                                      const ServerOptions& options);

/// Keys of the options that are noted.
[[nodiscard]] std::span<const std::string_view> place_keys();

/// Told of packages that are sent, and of all.
using SendProgress = std::function<void(std::size_t done, std::size_t total)>;
/// Sends all packages of a store, whose folder has them, to S3, notes that they are there, and
/// removes them from the folder. May be called again after any failure.
/// @return how many. @throws maps::InputError while a server runs on the store, and for a damaged
/// package; std::invalid_argument for options.
std::size_t move_to_s3(const std::filesystem::path& folder, const ServerOptions& options,
                       const SendProgress& progress = {});

}  // namespace stillmap::server
