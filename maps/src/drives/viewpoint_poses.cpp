#include "drives/viewpoint_poses.hpp"

#include <fmt/format.h>

#include <vector>

#include "drives/layout.hpp"
#include "formats/pcd.hpp"

namespace stillmap::maps {
namespace {

/// One a scan; empty where one has none, or where no two differ.
std::vector<Eigen::Isometry3d> differing_viewpoints(const Drive::Contents& contents) {
  constexpr double kSame = 1e-6;
  std::vector<Eigen::Isometry3d> viewpoints;
  bool differ = false;
  for (const std::filesystem::path& file : contents.scan_files) {
    const auto viewpoint = read_pcd_viewpoint(file);
    if (!viewpoint) return {};
    viewpoints.push_back(*viewpoint);
    differ = differ || !viewpoint->isApprox(viewpoints.front(), kSame);
  }
  return differ ? viewpoints : std::vector<Eigen::Isometry3d>{};
}

}  // namespace

void set_poses_of_viewpoints(Drive::Contents& contents, const std::optional<PointsFrame>& points) {
  if (contents.scan_files.front().extension() != ".pcd") return;
  std::vector<Eigen::Isometry3d> viewpoints = differing_viewpoints(contents);
  if (viewpoints.empty()) return;
  std::optional<PointsFrame> frame = points;
  std::string shares = "as was chosen";
  if (!frame) {
    const auto overlap = overlap_by_points_frame(contents, viewpoints);
    if (!overlap) return;
    shares = fmt::format(
        "scans overlap by {:.0f} % with points of the sensor, by {:.0f} % with points of the map, "
        "by {:.0f} % without poses",
        100.0 * overlap->as_sensor, 100.0 * overlap->as_map, 100.0 * overlap->without);
    frame = overlap->frame();
    if (!frame || (frame == PointsFrame::kSensor && overlap->as_sensor <= overlap->without)) {
      contents.notes.push_back(fmt::format("VIEWPOINTs are not taken as poses: {}", shares));
      return;
    }
  }
  set_position_step(contents, viewpoints);
  contents.T_map_lidar = std::move(viewpoints);
  if (frame == PointsFrame::kMap) read_points_from_map(contents);
  contents.notes.push_back(
      fmt::format("poses are the VIEWPOINTs, points are in the frame of the {}: {}",
                  frame == PointsFrame::kMap ? "map" : "sensor", shares));
}

}  // namespace stillmap::maps
