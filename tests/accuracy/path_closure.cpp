// Whether a path that returns to its start closes, by a method that has no part in it.
//
//   path_closure DRIVE PATH.tum [--scans 20] [--json FILE]
//
// The first scans of the drive are put together in the lidar frame of the first one, the last ones
// in that of the last one, each by the path itself; PCL's GICP aligns the second cloud with the
// first, from where the path has it. Printed is by how much the path's own relative pose of first
// and last scan differs, and how far GICP's two answers differ when it starts 0.2 m to either side.

#include "reference/pcl_gicp.hpp"

#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/frames.hpp>
#include <stillmap/maps/trajectory.hpp>

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include <algorithm>
#include <exception>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <numbers>
#include <optional>
#include <string>
#include <vector>

namespace stillmap::test {
namespace {

constexpr double kRadToDeg = 180.0 / std::numbers::pi;
constexpr double kStartOffM = 0.2;
constexpr double kLeafM = 0.1;
constexpr double kMaxPairM = 1.0;
/// Farther points are left out: PCL's voxel grid counts its cells with 32 bits [m].
constexpr float kMaxRangeM = 50.0F;

struct Arguments {
  std::filesystem::path drive;
  std::filesystem::path path;
  std::size_t scans = 20;
  std::optional<std::filesystem::path> json;
};

/// Points of the scans [begin, end) in the lidar frame of `anchor`.
maps::PointCloud put_together(const maps::Drive& drive, std::size_t begin, std::size_t end,
                              std::size_t anchor) {
  maps::PointCloud cloud;
  for (std::size_t i = begin; i < end; ++i) {
    const Eigen::Isometry3f T =
        (drive.T_map_lidar(anchor).inverse() * drive.T_map_lidar(i)).cast<float>();
    for (const Eigen::Vector3f& p : drive.read(i).cloud.positions) {
      if (p.norm() < kMaxRangeM) cloud.positions.push_back(T * p);
    }
  }
  return cloud;
}

Eigen::Isometry3d aligned(const mapping::PclGicpAligner& aligner, const maps::PointCloud& last,
                          const Eigen::Isometry3d& T_first_last, double off_m) {
  localization::Prior prior;
  prior.T_map_lidar = T_first_last;
  prior.T_map_lidar.translation().x() += off_m;
  return aligner.align(last, prior).T_map_lidar;
}

int run(const Arguments& arguments) {
  const maps::Drive drive = maps::Drive::open(arguments.drive, arguments.path);
  const std::size_t count = std::min(arguments.scans, drive.size() / 2);
  if (count == 0)
    throw maps::InputError(arguments.drive.string(), fmt::format("{} scans", drive.size()),
                           "2 or more");
  const maps::PointCloud first = put_together(drive, 0, count, 0);
  const maps::PointCloud last =
      put_together(drive, drive.size() - count, drive.size(), drive.size() - 1);
  std::vector<Eigen::Vector3d> points;
  for (const Eigen::Vector3f& p : first.positions) points.push_back(p.cast<double>());
  const mapping::PclGicpAligner aligner(points,
                                        {.leaf_m = kLeafM, .max_pair_distance_m = kMaxPairM});

  const Eigen::Isometry3d T_first_last =
      drive.T_map_lidar(0).inverse() * drive.T_map_lidar(drive.size() - 1);
  const Eigen::Isometry3d T_by_gicp = aligned(aligner, last, T_first_last, 0.0);
  const Eigen::Isometry3d off = T_first_last.inverse() * T_by_gicp;
  const double spread_m = (aligned(aligner, last, T_first_last, kStartOffM).translation() -
                           aligned(aligner, last, T_first_last, -kStartOffM).translation())
                              .norm();
  const double off_deg = kRadToDeg * maps::rotation_angle_rad(off.linear());
  fmt::print(
      "first to last scan {:.3f} m apart; the path is off by {:.3f} m, {:.3f} deg "
      "(GICP from two starts: {:.3f} m)\n",
      T_by_gicp.translation().norm(), off.translation().norm(), off_deg, spread_m);
  if (arguments.json) {
    std::ofstream(*arguments.json) << nlohmann::json{
        {"off_m", off.translation().norm()},
        {"off_deg", off_deg},
        {"gicp_spread_m", spread_m}}.dump(2);
  }
  return 0;
}

}  // namespace
}  // namespace stillmap::test

int main(int argc, char** argv) {
  CLI::App app("Compare first and last scan of a path by PCL's GICP");
  stillmap::test::Arguments arguments;
  app.add_option("DRIVE", arguments.drive)->required();
  app.add_option("PATH", arguments.path, "TUM, a pose a scan")->required();
  app.add_option("--scans", arguments.scans, "Put together at each end")->capture_default_str();
  app.add_option("--json", arguments.json);
  CLI11_PARSE(app, argc, argv);
  try {
    return stillmap::test::run(arguments);
  } catch (const std::exception& error) {
    fmt::print(stderr, "path_closure: {}\n", error.what());
    return 1;
  }
}
