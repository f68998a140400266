// Reference poses for `stillmap evaluate localization --poses` that our own method takes no part
// in.
//
//   reference_poses DRIVE [--poses FILE] --select 1::2 -o REFERENCE.tum [--json FILE]
//
// Each selected scan is aligned by PCL's point-to-plane ICP, started from the drive's pose, to a
// map of the scans that are not selected (deskewed as a build does, stacked by the drive's poses).
//
// How far to trust it: two more alignments of each scan that share no measured point. The first
// takes every other scan of the map, every other point of the query and a start that is off to one
// side; the second takes the other halves and the opposite start. What they differ by holds the
// noise of points, of where beams fell, of single poses of the map and of starts. It does not hold
// what both maps share: where the drive's poses slide over many scans, both slide. Scans where the
// two differ by more than 3 cm, or where one of the three did not come to rest, are dropped and
// counted; they are the harder ones, so what is measured on the rest flatters every method.

#include "accuracy/point_to_plane.hpp"
#include "drives/drive_set.hpp"
#include "evaluation/localization/localization_metrics.hpp"

#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/frames.hpp>
#include <stillmap/maps/trajectory.hpp>

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include <array>
#include <cmath>
#include <exception>
#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <numbers>
#include <optional>
#include <set>
#include <stdexcept>
#include <string>
#include <vector>

namespace stillmap::test {
namespace {

constexpr double kMaxDifferenceM = 0.03;
/// Where the two halves start from: to either side of the drive's pose.
constexpr double kStartOffM = 0.15;
constexpr double kStartOffRad = 0.5 * std::numbers::pi / 180.0;
constexpr double kRadToDeg = 180.0 / std::numbers::pi;

maps::PointCloud deskewed(const maps::Drive& drive, std::size_t index) {
  const mapping::MapBuildOptions options;
  std::map<std::string, std::uint64_t> counts;
  return mapping::read_deskewed(drive, index, {options.min_range_m, options.max_range_m}, counts)
      .cloud;
}

/// A map of some scans, or of every second of them.
PointToPlaneReference map_of(const maps::Drive& drive, const std::vector<std::size_t>& scans,
                             std::size_t first, std::size_t step) {
  std::vector<Eigen::Vector3d> points_map;
  for (std::size_t k = first; k < scans.size(); k += step) {
    const Eigen::Isometry3d& T_map_lidar = drive.T_map_lidar(scans[k]);
    for (const Eigen::Vector3f& p : deskewed(drive, scans[k]).positions)
      points_map.emplace_back(T_map_lidar * p.cast<double>());
  }
  return PointToPlaneReference(points_map);
}

std::vector<Eigen::Vector3f> every_second(const std::vector<Eigen::Vector3f>& points,
                                          std::size_t first) {
  std::vector<Eigen::Vector3f> half;
  for (std::size_t i = first; i < points.size(); i += 2) half.push_back(points[i]);
  return half;
}

/// The drive's pose moved forward, left and about the vertical, or the opposite way.
Eigen::Isometry3d start_beside(const Eigen::Isometry3d& T_map_lidar, double side) {
  Eigen::Matrix<double, 6, 1> twist;
  twist << side * kStartOffM, side * kStartOffM, 0.0, 0.0, 0.0, side * kStartOffRad;
  return T_map_lidar * maps::exp_se3(twist);
}

struct Summary {
  maps::Trajectory reference;
  std::size_t scans = 0, not_at_rest = 0, too_different = 0;
  /// Between the two halves, of all scans where both came to rest.
  std::vector<double> difference_m, difference_deg;
  /// Between the reference and the drive's pose.
  std::vector<double> moved_m;
};

class ReferenceMaps {
 public:
  ReferenceMaps(const maps::Drive& drive, const std::vector<std::size_t>& scans)
      : drive_(drive),
        all_(map_of(drive, scans, 0, 1)),
        halves_{map_of(drive, scans, 0, 2), map_of(drive, scans, 1, 2)} {}

  /// Adds what came out for one scan, and its reference when the two halves agree.
  void align(std::size_t index, Summary& out, std::vector<maps::StampedPose>& reference) const {
    const Eigen::Isometry3d& T_map_lidar = drive_.T_map_lidar(index);
    const std::vector<Eigen::Vector3f> points = deskewed(drive_, index).positions;
    const auto whole = all_.align(points, T_map_lidar);
    const auto a = halves_[0].align(every_second(points, 0), start_beside(T_map_lidar, 1.0));
    const auto b = halves_[1].align(every_second(points, 1), start_beside(T_map_lidar, -1.0));
    if (!whole || !a || !b) {
      ++out.not_at_rest;
      return;
    }
    const Eigen::Isometry3d T_a_b = a->inverse() * *b;
    out.difference_m.push_back(T_a_b.translation().norm());
    out.difference_deg.push_back(maps::rotation_angle_rad(T_a_b.linear()) * kRadToDeg);
    if (!(out.difference_m.back() <= kMaxDifferenceM)) {
      ++out.too_different;
      return;
    }
    out.moved_m.push_back((whole->translation() - T_map_lidar.translation()).norm());
    reference.push_back({drive_.stamp_ns(index), *whole});
  }

 private:
  const maps::Drive& drive_;
  PointToPlaneReference all_;
  std::array<PointToPlaneReference, 2> halves_;
};

Summary make_reference(const maps::Drive& drive, const maps::Selection& selection) {
  if (!drive.has_poses()) {
    throw std::invalid_argument(drive.contents().root.string() +
                                ": found no poses, expected one a scan");
  }
  const std::vector<std::size_t> queries = selection.indices(drive.size());
  const std::set<std::size_t> asked(queries.begin(), queries.end());
  std::vector<std::size_t> others;
  for (std::size_t i = 0; i < drive.size(); ++i) {
    if (!asked.contains(i)) others.push_back(i);
  }
  if (queries.empty() || others.size() < 2) {
    throw std::invalid_argument(
        fmt::format("selection: {} of {} scans, expected some to align and "
                    "at least two to make a map of",
                    queries.size(), drive.size()));
  }
  const ReferenceMaps maps_of_others(drive, others);
  Summary summary;
  summary.scans = queries.size();
  std::vector<maps::StampedPose> reference;
  for (const std::size_t index : queries) maps_of_others.align(index, summary, reference);
  summary.reference = maps::Trajectory(std::move(reference));
  return summary;
}

nlohmann::ordered_json to_json(const Summary& summary) {
  using mapping::percentile;
  return {
      {"scans", summary.scans},
      {"kept", summary.reference.size()},
      {"dropped", {{"over_3_cm", summary.too_different}, {"not_at_rest", summary.not_at_rest}}},
      {"repeatability_m",
       {{"median", percentile(summary.difference_m, 0.5)},
        {"p95", percentile(summary.difference_m, 0.95)}}},
      {"repeatability_deg",
       {{"median", percentile(summary.difference_deg, 0.5)},
        {"p95", percentile(summary.difference_deg, 0.95)}}},
      {"moved_from_drive_m",
       {{"median", percentile(summary.moved_m, 0.5)}, {"p95", percentile(summary.moved_m, 0.95)}}}};
}

void print_for_people(const Summary& summary) {
  using mapping::percentile;
  fmt::print(
      "reference for {} of {} scans; dropped: {} whose halves differ by over 3 cm, {} that "
      "did not come to rest\n",
      summary.reference.size(), summary.scans, summary.too_different, summary.not_at_rest);
  fmt::print("repeatability (median, 95 %): {:.1f}, {:.1f} cm and {:.3f}, {:.3f} deg\n",
             100 * percentile(summary.difference_m, 0.5),
             100 * percentile(summary.difference_m, 0.95), percentile(summary.difference_deg, 0.5),
             percentile(summary.difference_deg, 0.95));
  fmt::print("away from the drive's poses (median, 95 %): {:.1f}, {:.1f} cm\n",
             100 * percentile(summary.moved_m, 0.5), 100 * percentile(summary.moved_m, 0.95));
}

int run(int argc, char** argv) {
  CLI::App app("Reference poses by PCL's point-to-plane ICP on a map of the scans not selected");
  std::filesystem::path drive, output, json;
  std::optional<std::filesystem::path> poses;
  std::string select = "1::2";
  app.add_option("DRIVE", drive, "Drive with poses")->required()->check(CLI::ExistingDirectory);
  app.add_option("--poses", poses, "Poses instead of the drive's own: KITTI or TUM, T_map_lidar");
  app.add_option("--select", select, "Scans to align, begin:end:step")->capture_default_str();
  app.add_option("-o,--output", output, "TUM file to write")->required();
  app.add_option("--json", json, "Write the summary there");
  CLI11_PARSE(app, argc, argv);
  const Summary summary =
      make_reference(maps::Drive::open(drive, poses), maps::Selection::parse(select));
  maps::write_tum_trajectory(output, summary.reference);
  if (!json.empty() && !(std::ofstream(json) << to_json(summary).dump(2) << '\n'))
    throw std::runtime_error(json.string() + ": cannot be written");
  print_for_people(summary);
  return 0;
}

}  // namespace
}  // namespace stillmap::test

int main(int argc, char** argv) {
  try {
    return stillmap::test::run(argc, argv);
  } catch (const std::exception& error) {
    fmt::print(stderr, "reference_poses: {}\n", error.what());
    return 1;
  }
}
