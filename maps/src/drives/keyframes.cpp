#include "drives/keyframes.hpp"

#include <stillmap/maps/error.hpp>

#include "drives/layout.hpp"

namespace stillmap::maps {
namespace {

namespace fs = std::filesystem;

std::optional<fs::path> keyframe_poses(const fs::path& root) {
  for (const char* name : {"optimized_poses.txt", "odom_poses.txt"}) {
    if (fs::exists(root / name)) return root / name;
  }
  return std::nullopt;
}

std::vector<fs::path> keyframe_scans(const fs::path& root) {
  const std::vector<fs::path> upper = list_files(root / "Scans", ".pcd");
  const std::vector<fs::path> lower = list_files(root / "scans", ".pcd");
  // One folder under two names where the file system ignores case.
  std::error_code ignored;
  if (!upper.empty() && !lower.empty() &&
      !fs::equivalent(root / "Scans", root / "scans", ignored)) {
    throw InputError(root.string(), "both Scans/ and scans/ with *.pcd",
                     "one of them: move the other away");
  }
  return upper.empty() ? lower : upper;
}

}  // namespace

bool is_keyframes(const fs::path& root) {
  return keyframe_poses(root) && (!list_files(root / "Scans", ".pcd").empty() ||
                                  !list_files(root / "scans", ".pcd").empty());
}

Drive::Contents open_keyframes(const fs::path& root, const PosesChoice& choice) {
  Drive::Contents contents;
  contents.layout = DriveLayout::kKeyframes;
  contents.root = root;
  contents.scan_files = keyframe_scans(root);
  if (fs::exists(root / "times.txt")) {
    set_times(contents, root / "times.txt");
  } else {
    assume_times(contents);
  }
  const fs::path poses = choice.file ? *choice.file : keyframe_poses(root).value();
  if (!choice.file && poses.filename() != "optimized_poses.txt") {
    contents.notes.emplace_back("no optimized_poses.txt: poses are those of odometry");
  }
  set_poses(contents, poses, choice.offset_ns);
  leave_out_unordered(contents);
  return contents;
}

}  // namespace stillmap::maps
