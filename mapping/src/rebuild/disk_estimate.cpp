#include <stillmap/mapping/rebuild.hpp>

#include "pipeline/opened_drives.hpp"

#include <algorithm>
#include <cmath>
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
/// The keep map is a little larger than the map, and scratch files lie beside it.
constexpr double kKeepOverPackage = 1.5;

/// Scans of a drive that are read to know how many points one has.
constexpr std::size_t kLookedAt = 8;

}  // namespace

RebuildEstimate estimate_rebuild(std::uint64_t scans, std::uint64_t points, double voxel_size_m) {
  if (!(voxel_size_m > 0.0)) throw std::invalid_argument("voxel_size_m: expected > 0");
  RebuildEstimate estimate{.scans = scans, .points = points};
  const auto bytes = [](double value) { return static_cast<std::uint64_t>(std::ceil(value)); };
  const auto all = static_cast<double>(points);
  const double finer = kMeasuredVoxelM / voxel_size_m;
  const double package = std::min(kMostPackageBytes, kPackageBytes * finer * finer);
  estimate.package_bytes = bytes(package * all);
  estimate.work_bytes = bytes((kJournalBytes + kKeepOverPackage * package) * all);
  return estimate;
}

RebuildEstimate estimate_rebuild(const RebuildOptions& options) {
  std::uint64_t scans = 0;
  double points = 0.0;
  for (const maps::Drive& drive : open_drives(options.drives, options.build)) {
    const std::vector<std::size_t> selected = options.build.selection.indices(drive.size());
    if (selected.empty()) continue;
    const std::size_t looked_at = std::min(kLookedAt, selected.size());
    double sum = 0.0;
    for (std::size_t i = 0; i < looked_at; ++i)
      sum +=
          static_cast<double>(drive.read(selected[i * selected.size() / looked_at]).points_in_file);
    points += sum / static_cast<double>(looked_at) * static_cast<double>(selected.size());
    scans += selected.size();
  }
  return estimate_rebuild(scans, static_cast<std::uint64_t>(std::llround(points)),
                          options.build.voxel_size_m);
}

}  // namespace stillmap::mapping
