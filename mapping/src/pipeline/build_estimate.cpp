#include <stillmap/mapping/build_estimate.hpp>

#include "pipeline/opened_drives.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <stdexcept>

namespace stillmap::mapping {
namespace {

/// Bytes of the disk for a point of the drive. How many points fall into one voxel depends on the
/// drive (its speed, the sensor's range); these hold for a car in a street with some room to spare:
/// measured at 0.1 m were 8.5 for package and index, 6.5 for the journal (mapping/rebuild.md).
constexpr double kPackageBytes = 12.0;
constexpr double kJournalBytes = 8.0;
/// A voxel lies on a surface, so there are four times as many of half the edge; at most one a
/// point, of 36 bytes and its share of the index.
constexpr double kMeasuredVoxelM = 0.1;
constexpr double kMostPackageBytes = 40.0;
/// Scratch files: views, flags, ground and tiles.
constexpr double kScratchBytes = 20.0;

/// What a build has in memory whatever its length: voxels of tiles, network, windows.
constexpr double kMemoryBytes = 1.0e9;
/// A scan's boxes, poses and places.
constexpr double kMemoryBytesOfScan = 30e3;

/// Scans of a drive that are read to know how many points one has.
constexpr std::size_t kLookedAt = 8;

std::string gigabytes(std::uint64_t bytes) {
  return fmt::format("{:.1f} GB", 1e-9 * static_cast<double>(bytes));
}

}  // namespace

BuildEstimate estimate_build(std::uint64_t scans, std::uint64_t points, double voxel_size_m) {
  if (!(voxel_size_m > 0.0)) throw std::invalid_argument("voxel_size_m: expected > 0");
  BuildEstimate estimate{.drives = 1, .scans = scans, .points = points};
  const auto bytes = [](double value) { return static_cast<std::uint64_t>(std::ceil(value)); };
  const auto all = static_cast<double>(points);
  const double finer = kMeasuredVoxelM / voxel_size_m;
  estimate.memory_bytes = bytes(kMemoryBytes + kMemoryBytesOfScan * static_cast<double>(scans));
  estimate.package_bytes = bytes(std::min(kMostPackageBytes, kPackageBytes * finer * finer) * all);
  estimate.work_bytes = bytes((kJournalBytes + kScratchBytes) * all);
  return estimate;
}

BuildEstimate estimate_build(const std::vector<std::filesystem::path>& folders,
                             const MapBuildOptions& options) {
  return estimate_build(open_drives(folders, options), options);
}

BuildEstimate estimate_build(const std::vector<maps::Drive>& drives,
                             const MapBuildOptions& options) {
  std::uint64_t scans = 0;
  double points = 0.0;
  for (const maps::Drive& drive : drives) {
    const std::vector<std::size_t> selected = options.selection.indices(drive.size());
    if (selected.empty()) continue;
    const std::size_t looked_at = std::min(kLookedAt, selected.size());
    double sum = 0.0;
    for (std::size_t i = 0; i < looked_at; ++i)
      sum +=
          static_cast<double>(drive.read(selected[i * selected.size() / looked_at]).points_in_file);
    points += sum / static_cast<double>(looked_at) * static_cast<double>(selected.size());
    scans += selected.size();
  }
  BuildEstimate estimate =
      estimate_build(scans, static_cast<std::uint64_t>(std::llround(points)), options.voxel_size_m);
  estimate.drives = drives.size();
  return estimate;
}

std::vector<std::string> shortages_of(const BuildEstimate& estimate, std::uint64_t memory_bytes,
                                      std::uint64_t disk_bytes) {
  std::vector<std::string> words;
  const std::string what =
      fmt::format("a map of {} drives with {} scans", estimate.drives, estimate.scans);
  if (estimate.memory_bytes > memory_bytes)
    words.push_back(fmt::format(
        "{} may need {} of memory, and there are {}; build it on a larger machine, or in parts "
        "(--select)",
        what, gigabytes(estimate.memory_bytes), gigabytes(memory_bytes)));
  const std::uint64_t disk = estimate.package_bytes + estimate.work_bytes;
  if (disk > disk_bytes)
    words.push_back(fmt::format(
        "{} may need {} of the disk, and {} are free; free some, or build it in parts (--select)",
        what, gigabytes(disk), gigabytes(disk_bytes)));
  return words;
}

std::string to_json(const BuildEstimate& estimate) {
  return nlohmann::ordered_json{{"drives", estimate.drives},
                                {"scans", estimate.scans},
                                {"points", estimate.points},
                                {"memory_bytes", estimate.memory_bytes},
                                {"package_bytes", estimate.package_bytes},
                                {"work_bytes", estimate.work_bytes}}
      .dump(2);
}

}  // namespace stillmap::mapping
