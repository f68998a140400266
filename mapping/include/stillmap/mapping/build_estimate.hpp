#pragma once

#include <stillmap/mapping/map_build.hpp>

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace stillmap::mapping {

/// What a build in one process needs at most, roughly. Measured on drives of a car
/// (mapping/measured.md).
struct BuildEstimate {
  std::uint64_t drives = 0;
  std::uint64_t scans = 0;
  /// By the mean of some scans.
  std::uint64_t points = 0;
  /// In RAM.
  std::uint64_t memory_bytes = 0;
  /// With its index.
  std::uint64_t package_bytes = 0;
  /// Beside the package, while it works.
  std::uint64_t work_bytes = 0;
};

/// Reads a few scans. @throws as `build_map`.
[[nodiscard]] BuildEstimate estimate_build(const std::vector<std::filesystem::path>& drives,
                                           const MapBuildOptions& options);
/// The same of drives that are open. @param drives  as `options` open them.
[[nodiscard]] BuildEstimate estimate_build(const std::vector<maps::Drive>& drives,
                                           const MapBuildOptions& options);
/// The same from numbers. @throws std::invalid_argument for a voxel that is not > 0 m.
[[nodiscard]] BuildEstimate estimate_build(std::uint64_t scans, std::uint64_t points,
                                           double voxel_size_m);

/// What a build would lack, in words with what to do; empty where it fits.
/// @param memory_bytes, disk_bytes  that there are.
[[nodiscard]] std::vector<std::string> shortages_of(const BuildEstimate& estimate,
                                                    std::uint64_t memory_bytes,
                                                    std::uint64_t disk_bytes);

/// The object of `--json`.
[[nodiscard]] std::string to_json(const BuildEstimate& estimate);

}  // namespace stillmap::mapping
