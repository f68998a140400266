#include "build/object_census.hpp"
#include "build/package.hpp"
#include "build/scan_pipeline.hpp"
#include "build/scan_stack.hpp"
#include "build/scan_stages.hpp"

#include <fmt/format.h>
#include <sys/resource.h>
#include <stillmap/mapping/map_build.hpp>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/map_package.hpp>

#include <algorithm>
#include <chrono>
#include <stdexcept>

namespace stillmap::mapping {
namespace {

using Clock = std::chrono::steady_clock;

maps::Drive open_with_poses(const std::filesystem::path& folder, const MapBuildOptions& options) {
  maps::Drive drive = maps::Drive::open(folder, options.poses_file);
  if (!drive.has_poses()) {
    throw maps::InputError(folder.string(), "a drive without poses",
                           "poses in its layout or a file given with --poses");
  }
  return drive;
}

std::vector<std::size_t> selected_scans(const std::filesystem::path& folder,
                                        const maps::Drive& drive,
                                        const maps::Selection& selection) {
  std::vector<std::size_t> indices = selection.indices(drive.size());
  if (indices.empty())
    throw maps::InputError(folder.string(), fmt::format("{} scans, none selected", drive.size()),
                           "at least one selected scan");
  return indices;
}

/// Whole metres, so that the same place gets the same origin from slightly different poses.
Eigen::Vector3d origin_of(const maps::Drive& drive, std::size_t first) {
  return drive.T_map_lidar(first).translation().array().round().matrix() +
         Eigen::Vector3d::Zero();  // turns -0 into 0
}

double peak_rss_mib() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<double>(usage.ru_maxrss) / 1024.0;
}

MapBuildReport report_of(const ScanStack& stack, const Detector& detector, std::uint64_t map_points,
                         Clock::time_point began) {
  MapBuildReport report;
  report.scans = stack.poses().size();
  report.points = stack.counts();
  report.points["static"] = map_points;
  const ObjectCensus census = census_of(stack.objects());
  report.objects = {{"parked", census.parked},
                    {"moving", census.moving},
                    {"brief", census.brief},
                    {"boxes", stack.objects().size()}};
  for (const auto& [reason, count] : detector.dropped())
    report.objects["dropped: " + reason] = count;
  report.stage_seconds = stack.stage_seconds();
  report.seconds = std::chrono::duration<double>(Clock::now() - began).count();
  report.scans_per_second = static_cast<double>(report.scans) / std::max(report.seconds, 1e-9);
  report.peak_rss_mib = peak_rss_mib();
  return report;
}

}  // namespace

std::vector<std::string> MapBuildOptions::violations() const {
  std::vector<std::string> broken = projection.violations();
  const auto check = [&](const char* name, double value, double least, double most) {
    if (!(value >= least && value <= most))
      broken.push_back(fmt::format("{}: {}, expected in [{}, {}]", name, value, least, most));
  };
  check("voxel_size_m", voxel_size_m, 0.02, 2.0);
  check("min_range_m", min_range_m, 0.0, 20.0);
  check("max_range_m", max_range_m, 5.0, 300.0);
  check("threads", threads, 0, 256);
  if (!(max_range_m > min_range_m))
    broken.push_back(
        fmt::format("max_range_m: {}, expected > min_range_m ({})", max_range_m, min_range_m));
  return broken;
}

MapBuildReport build_map(const std::filesystem::path& folder, const std::filesystem::path& target,
                         const MapBuildOptions& options, const ProgressCallback& progress,
                         const CancelFlag& cancel) {
  if (const auto broken = options.violations(); !broken.empty())
    throw std::invalid_argument("build options: " + broken.front());
  const Clock::time_point began = Clock::now();
  const maps::Drive drive = open_with_poses(folder, options);
  const std::vector<std::size_t> indices = selected_scans(folder, drive, options.selection);
  maps::MapPackageWriter writer(target);
  const ScanStages stages(drive, options);
  const Eigen::Vector3d origin = origin_of(drive, indices.front());
  ScanStack stack(drive, origin, options.voxel_size_m);
  process_in_order(
      indices, options.threads, [&](std::size_t index) { return stages.process(index); },
      [&](const ProcessedScan& scan) {
        stack.add(scan);
        if (progress) progress("scans", stack.poses().size(), indices.size());
      },
      cancel);
  if (stack.map().size() == 0)
    throw maps::InputError(folder.string(), "no usable point in any selected scan",
                           "at least one scan with points in range");
  if (cancel) throw Cancelled();
  if (progress) progress("package", 0, 1);
  const std::uint64_t map_points = write_contents(writer, stack);
  MapBuildReport report = report_of(stack, stages.detector(), map_points, began);
  report.digest =
      writer.publish(manifest_of({folder, drive, options}, origin, report), to_json(report));
  if (progress) progress("package", 1, 1);
  return report;
}

}  // namespace stillmap::mapping
