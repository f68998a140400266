#pragma once

#include <cstdint>
#include <optional>

namespace stillmap::server {

/// Most bytes that packages and drives may take, each package once, and how much of the disk they
/// leave free; nothing: no limit.
struct StoreQuota {
  std::optional<std::uint64_t> map_bytes{};
  std::optional<std::uint64_t> store_bytes{};
  /// Bytes of the store's disk that stay free, so that keys can be revoked and versions removed.
  std::optional<std::uint64_t> disk_reserve{};
};

/// Bytes that no table of the store knows of: of files that wait to become packages.
struct WaitingBytes {
  std::uint64_t of_map = 0;
  std::uint64_t of_store = 0;
};

}  // namespace stillmap::server
