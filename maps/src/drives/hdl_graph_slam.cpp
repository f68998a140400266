#include "drives/hdl_graph_slam.hpp"

#include <stillmap/maps/error.hpp>

#include <utility>
#include <vector>

#include "formats/hdl_keyframe.hpp"

namespace stillmap::maps {

namespace fs = std::filesystem;

bool is_hdl_graph_slam(const fs::path& root) { return !hdl_keyframe_folders(root).empty(); }

Drive::Contents open_hdl_graph_slam(const fs::path& root, const PosesChoice& choice) {
  Drive::Contents contents;
  contents.layout = DriveLayout::kHdlGraphSlam;
  contents.root = root;
  std::vector<Eigen::Isometry3d> estimates;
  for (const HdlKeyframe& keyframe : read_hdl_keyframes(root)) {
    contents.scan_files.push_back(keyframe.folder / "cloud.pcd");
    contents.stamps_ns.push_back(keyframe.pose.stamp_ns);
    estimates.push_back(keyframe.pose.T_map_lidar);
  }
  contents.relative_clock = contents.stamps_ns.front() < kFirstEpochStampNs;
  // All files have one name: scans are told apart by their numbers.
  set_entries_of_files(contents);
  if (choice.file) {
    set_poses(contents, *choice.file, choice.offset_ns);
  } else {
    set_position_step(contents, estimates);
    contents.T_map_lidar = std::move(estimates);
    contents.notes.emplace_back("poses are the estimates of hdl_graph_slam's key frames");
    if (fs::exists(root / "zero_utm"))
      contents.notes.emplace_back(
          "zero_utm is not taken: it names no zone; the map stays where the poses are");
  }
  leave_out_unordered(contents);
  return contents;
}

bool is_glim_dump(const fs::path& root) {
  const fs::path first = root / "000000";
  return fs::exists(first / "data.txt") &&
         (fs::exists(first / "points_compact.bin") || fs::exists(first / "points.bin"));
}

}  // namespace stillmap::maps
