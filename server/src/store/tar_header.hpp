#pragma once

#include <cstdint>
#include <string>

namespace stillmap::server {

constexpr std::uint64_t kTarBlock = 512;
/// What so many bytes take in a tar: whole blocks.
[[nodiscard]] constexpr std::uint64_t in_tar_blocks(std::uint64_t bytes) {
  return (bytes + kTarBlock - 1) / kTarBlock * kTarBlock;
}

/// The header blocks of a regular file, made by libarchive: ustar, or pax where that is too small.
/// Equal arguments give equal bytes: owner, group and time are 0, and the mode is 0644.
[[nodiscard]] std::string tar_header(const std::string& path, std::uint64_t bytes);
/// Its size, without making it where that can be told.
[[nodiscard]] std::uint64_t tar_header_bytes(const std::string& path, std::uint64_t bytes);

}  // namespace stillmap::server
