#include "drives/kitti_raw.hpp"

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/frames.hpp>

#include <fmt/format.h>

#include <memory>
#include <utility>

#include "drives/calibration.hpp"
#include "drives/kitti360.hpp"
#include "drives/layout.hpp"
#include "drives/oxts.hpp"

namespace stillmap::maps {
namespace {

namespace fs = std::filesystem;

// Half a turn takes 50 ms at 10 Hz and 100 ms at the sensor's slowest.
constexpr double kMaxHalfTurnS = 0.15;

double seconds(std::int64_t from_ns, std::int64_t to_ns) {
  return 1e-9 * static_cast<double>(to_ns - from_ns);
}

/// Stamps of the scans by the number in their names, which are the lines of the stamps (from 0);
/// nothing where the line is blank.
std::vector<std::optional<std::int64_t>> stamps_of(const std::vector<fs::path>& scan_files,
                                                   const fs::path& stamps_file) {
  const std::vector<std::optional<std::int64_t>> lines = read_kitti_stamps(stamps_file);
  std::vector<std::optional<std::int64_t>> stamps;
  for (const fs::path& file : scan_files) {
    const std::optional<std::size_t> number = number_of(file);
    if (!number || *number >= lines.size()) {
      throw InputError(
          file.string(), fmt::format("no stamp for it among {} lines", lines.size()),
          "its number as a line (from 0) of " + stamps_file.string() + ": copy the whole file");
    }
    stamps.push_back(lines[*number]);
  }
  return stamps;
}

/// Scans whose line is blank have no time, and are left out.
void set_kitti_stamps(Drive::Contents& contents, const fs::path& stamps_file) {
  const auto stamps = stamps_of(contents.scan_files, stamps_file);
  std::vector<fs::path> files;
  for (std::size_t i = 0; i < stamps.size(); ++i) {
    if (!stamps[i]) continue;
    files.push_back(contents.scan_files[i]);
    contents.stamps_ns.push_back(*stamps[i]);
  }
  const std::size_t without = stamps.size() - files.size();
  if (files.empty())
    throw InputError(stamps_file.string(), "blank lines for all scans",
                     "a stamp for each scan: copy the file again");
  contents.scan_files = std::move(files);
  contents.relative_clock = false;
  if (without > 0)
    contents.notes.push_back(fmt::format("{} scans left out, whose lines of {} are blank", without,
                                         stamps_file.filename().string()));
}

void note_missing_numbers(Drive::Contents& contents) {
  std::size_t expected = 0;
  for (const fs::path& file : contents.scan_files) {
    const std::size_t number = number_of(file).value_or(expected);
    if (number > expected) {
      contents.notes.push_back(fmt::format("{} scans missing on disk: {} to {}", number - expected,
                                           expected, number - 1));
    }
    expected = number + 1;
  }
}

void set_spin(Drive::Contents& contents, const fs::path& velodyne) {
  const fs::path start_file = velodyne / "timestamps_start.txt";
  const fs::path end_file = velodyne / "timestamps_end.txt";
  if (!fs::exists(start_file) || !fs::exists(end_file)) {
    contents.notes.emplace_back(
        "no timestamps_start.txt and timestamps_end.txt: points have no times of their own");
    return;
  }
  const auto starts = stamps_of(contents.scan_files, start_file);
  const auto ends = stamps_of(contents.scan_files, end_file);
  std::size_t implausible = 0;
  for (std::size_t i = 0; i < starts.size(); ++i) {
    const std::int64_t stamp = contents.stamps_ns[i];
    std::array<double, 2> spin{0.0, 0.0};
    if (starts[i] && ends[i]) spin = {seconds(stamp, *starts[i]), seconds(stamp, *ends[i])};
    if (!(spin[0] >= -kMaxHalfTurnS && spin[0] < 0.0 && spin[1] > 0.0 &&
          spin[1] <= kMaxHalfTurnS)) {
      spin = {0.0, 0.0};
      ++implausible;
    }
    contents.spin_start_end_s.push_back(spin);
  }
  if (implausible > 0) {
    contents.notes.push_back(
        fmt::format("{} sweeps have no start or end, or one over {} s from their stamp: their "
                    "points count as taken at once",
                    implausible, kMaxHalfTurnS));
  }
}

/// Poses of a file; those of KITTI-360 are brought from its IMU or camera to the lidar.
void set_kitti_poses(Drive::Contents& contents, const fs::path& file, std::int64_t offset_ns) {
  set_poses(contents, file, offset_ns);
  const auto T_pose_lidar = lidar_of_kitti360_poses(file);
  if (!T_pose_lidar) return;
  for (Eigen::Isometry3d& T : contents.T_map_lidar) T = renormalized(T * *T_pose_lidar);
  if (!contents.path) return;
  std::vector<StampedPose> path = contents.path->poses();
  for (StampedPose& pose : path) pose.T_map_lidar = renormalized(pose.T_map_lidar * *T_pose_lidar);
  contents.path = std::make_shared<const Trajectory>(std::move(path));
}

void set_oxts_poses(Drive::Contents& contents, std::int64_t offset_ns) {
  const fs::path oxts = contents.root / "oxts";
  if (const auto poses = kitti360_poses(contents.root); poses && !fs::exists(oxts)) {
    contents.notes.push_back("poses are those of KITTI-360: " + poses->string());
    return set_kitti_poses(contents, *poses, offset_ns);
  }
  if (!fs::exists(oxts)) {
    contents.notes.emplace_back("no oxts folder: a drive without poses");
    return;
  }
  const fs::path calibration = fs::canonical(contents.root).parent_path() / "calib_imu_to_velo.txt";
  const Eigen::Isometry3d T_imu_lidar = read_T_velo_imu(calibration).inverse();
  OxtsPath path = read_oxts(oxts);
  for (StampedPose& pose : path.T_map_imu) pose.T_map_lidar = pose.T_map_lidar * T_imu_lidar;
  contents.notes.insert(contents.notes.end(), path.notes.begin(), path.notes.end());
  contents.origin = path.origin;
  contents.counts_from_first_pose =
      set_poses_at_stamps(contents, Trajectory(std::move(path.T_map_imu)), oxts, offset_ns);
}

}  // namespace

bool is_kitti_raw(const fs::path& root) { return fs::is_directory(root / "velodyne_points"); }

Drive::Contents open_kitti_raw(const fs::path& root, const PosesChoice& choice) {
  const fs::path velodyne = root / "velodyne_points";
  Drive::Contents contents;
  contents.layout = DriveLayout::kKittiRaw;
  contents.root = root;
  contents.scan_files = list_files(velodyne / "data", ".bin");
  if (contents.scan_files.empty()) {
    throw InputError((velodyne / "data").string(), "no *.bin files",
                     "the scans of a synced drive: copy them there");
  }
  note_missing_numbers(contents);
  set_kitti_stamps(contents, velodyne / "timestamps.txt");
  set_spin(contents, velodyne);
  set_labels(contents);
  if (choice.file) {
    set_kitti_poses(contents, *choice.file, choice.offset_ns);
  } else {
    set_oxts_poses(contents, choice.offset_ns);
  }
  leave_out_unordered(contents);
  return contents;
}

}  // namespace stillmap::maps
