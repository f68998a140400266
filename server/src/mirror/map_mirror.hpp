#pragma once

#include "mirror/mirror_source.hpp"
#include "store/package_store.hpp"

#include <Eigen/Core>

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>

namespace stillmap::server {

struct MirrorOptions {
  std::string map;
  /// Most bytes a second, in the mean; none: as fast as it goes.
  std::optional<std::uint64_t> bytes_a_second{};
  /// A version of more bytes is refused before it is fetched.
  std::optional<std::uint64_t> most_bytes{};
  /// A version that none of these keys has signed is refused before it is fetched; nothing: all are
  /// taken.
  std::optional<PublicKeys> trusted{};
  /// Only regions that reach into a circle; nothing: all of the map.
  struct Around {
    /// x, y in the map frame.
    Eigen::Vector2d place_map_m;
    double radius_m = 0.0;
  };
  std::optional<Around> around{};
};

struct MirrorResult {
  std::string version, digest;
  /// Of the part that was asked for; of the whole the name and digest above are.
  std::size_t regions = 0;
  /// False where the store had it, and it was active.
  bool is_new = false;
  /// Of all files of the version, and of those that were fetched now.
  std::uint64_t bytes = 0, bytes_fetched = 0;
};

/// Told of bytes that are there, and of all that are missing.
using MirrorProgress = std::function<void(std::uint64_t done, std::uint64_t total)>;

/// Makes the version that a server serves of a map the active one of a store, which other programs
/// may serve and localize in meanwhile. Fetches only files that the store's versions of the map do
/// not have, each compared with its SHA-256; the digest of the version stands for all of them. What
/// was fetched lies in the store's folder `mirror/` until the version is published, so that the
/// next call goes on from there, whatever ended this one. Versions but the active one and the one
/// before are removed.
/// A part of a map is a version of its own, whose name ends with `.part-` and digits of its digest:
/// a package of some regions, cut from what was compared with the whole's manifest.
/// @throws MirrorSourceError; maps::InputError for bytes that are not what their checksum says, and
/// a version of more than `most_bytes` or that is not signed as it must be; StoreRefusal;
/// maps::StorageError.
/// @return nothing when it was cancelled.
std::optional<MirrorResult> mirror_map(PackageStore& store, MirrorSource& source,
                                       const MirrorOptions& options, const MirrorProgress& progress,
                                       const std::atomic<bool>& cancel);

}  // namespace stillmap::server
