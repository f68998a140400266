#include <stillmap/mapping/build_estimate.hpp>
#include <stillmap/mapping/rebuild.hpp>

#include <cmath>

namespace stillmap::mapping {
namespace {

/// The keep map is a little larger than the map, and lies beside it.
constexpr double kKeepOverPackage = 1.5;

RebuildEstimate two_maps(const BuildEstimate& one) {
  const double keep = kKeepOverPackage * static_cast<double>(one.package_bytes);
  return {.scans = one.scans,
          .points = one.points,
          .package_bytes = one.package_bytes,
          .work_bytes = one.work_bytes + static_cast<std::uint64_t>(std::ceil(keep))};
}

}  // namespace

RebuildEstimate estimate_rebuild(std::uint64_t scans, std::uint64_t points, double voxel_size_m) {
  return two_maps(estimate_build(scans, points, voxel_size_m));
}

RebuildEstimate estimate_rebuild(const RebuildOptions& options) {
  return two_maps(estimate_build(options.drives, options.build));
}

}  // namespace stillmap::mapping
