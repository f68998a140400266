#include "drives/scan_folder.hpp"

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/pose_file.hpp>

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <string_view>
#include <system_error>

#include <stillmap/maps/text.hpp>
#include "drives/layout.hpp"
#include "drives/viewpoint_poses.hpp"

namespace stillmap::maps {
namespace {

namespace fs = std::filesystem;

constexpr std::array<std::string_view, 3> kScanExtensions{".pcd", ".ply", ".bin"};

/// Scans of one folder. @throws InputError when there is more than one kind.
std::vector<fs::path> list_scans(const fs::path& folder) {
  std::vector<fs::path> scans;
  std::string_view kind;
  for (const std::string_view extension : kScanExtensions) {
    std::vector<fs::path> files = list_files(folder, extension);
    if (files.empty()) continue;
    if (!scans.empty()) {
      throw InputError(folder.string(), fmt::format("*{} and *{}", kind, extension),
                       "scans of one kind: move the others away");
    }
    scans = std::move(files);
    kind = extension;
  }
  return scans;
}

bool holds_scans(const fs::path& folder) {
  return std::any_of(
      kScanExtensions.begin(), kScanExtensions.end(),
      [&](std::string_view extension) { return !list_files(folder, extension).empty(); });
}

/// The folder itself and the folders in it that hold scans.
std::vector<fs::path> folders_with_scans(const fs::path& root) {
  std::vector<fs::path> folders;
  if (holds_scans(root)) folders.push_back(root);
  std::error_code error;
  for (fs::directory_iterator entry(root, error), end; !error && entry != end;
       entry.increment(error)) {
    if (entry->is_directory() && holds_scans(entry->path())) folders.push_back(entry->path());
  }
  if (error) throw StorageError(root.string(), error.message());
  std::sort(folders.begin(), folders.end());
  return folders;
}

std::optional<fs::path> folder_poses(const fs::path& root, std::vector<std::string>& notes) {
  std::vector<fs::path> candidates = list_files(root, ".tum");
  if (fs::exists(root / "poses.txt")) candidates.push_back(root / "poses.txt");
  std::vector<fs::path> others = list_files(root, ".g2o");
  if (fs::exists(root / "poses.csv")) others.push_back(root / "poses.csv");
  if (candidates.empty()) candidates.swap(others);
  if (candidates.empty()) return std::nullopt;
  if (candidates.size() > 1) {
    throw InputError(
        root.string(),
        candidates.front().filename().string() + " and " + candidates.back().filename().string(),
        "one file of poses: name it with --poses FILE, or move the others away");
  }
  for (const fs::path& other : others)
    notes.push_back(fmt::format("poses are those of {}, not of {} beside it",
                                candidates.front().filename().string(), other.filename().string()));
  return candidates.front();
}

/// A stamp since the epoch from a file name: 19 digits are ns, 16 us, 10 with decimals s.
std::optional<std::int64_t> stamp_in_name(const fs::path& file) {
  const std::string name = file.stem().string();
  const std::size_t digits = std::min(name.find_first_not_of("0123456789"), name.size());
  const bool whole = digits == name.size();
  std::string seconds = name;
  if (whole && (digits == 19 || digits == 16)) {
    seconds.insert(10, ".");
  } else if (digits != 10) {
    return std::nullopt;
  }
  return parse_stamp_ns(seconds);
}

bool set_stamps_from_names(Drive::Contents& contents) {
  std::vector<std::int64_t> stamps;
  for (const fs::path& file : contents.scan_files) {
    const std::optional<std::int64_t> stamp = stamp_in_name(file);
    if (!stamp || *stamp < kFirstEpochStampNs) return false;
    stamps.push_back(*stamp);
  }
  contents.stamps_ns = std::move(stamps);
  contents.relative_clock = false;
  return true;
}

/// Scans without stamps and a path of as many poses belong together one by one.
void set_stamps_and_poses(Drive::Contents& contents, const Trajectory& trajectory,
                          const fs::path& tum_file) {
  if (trajectory.size() != contents.scan_files.size()) {
    throw InputError(tum_file.string(), fmt::format("{} poses", trajectory.size()),
                     fmt::format("{}, one for each scan, since the scans' names are no stamps (19 "
                                 "digits of ns, 16 of us, or 10 with decimals of s): give a pose "
                                 "for each scan, or name the scans by their stamps",
                                 contents.scan_files.size()));
  }
  set_position_step(contents, trajectory);
  for (const StampedPose& pose : trajectory.poses()) {
    contents.stamps_ns.push_back(pose.stamp_ns);
    contents.T_map_lidar.push_back(pose.T_map_lidar);
  }
  contents.relative_clock = contents.stamps_ns.front() < kFirstEpochStampNs;
}

}  // namespace

bool is_scan_folder(const fs::path& root) { return !folders_with_scans(root).empty(); }

Drive::Contents open_scan_folder(const fs::path& root, const PosesChoice& choice) {
  const std::vector<fs::path> folders = folders_with_scans(root);
  if (folders.size() != 1) {
    std::string found;
    for (const fs::path& folder : folders) found += ' ' + folder.filename().string() + '/';
    throw InputError(
        root.string(), folders.empty() ? "no scans" : "scans in" + found,
        "scans in the folder itself or in one folder of it: give the folder that holds them, or "
        "for several lidars write lidars.json with stillmap calibrate");
  }
  Drive::Contents contents;
  contents.layout = DriveLayout::kScanFolder;
  contents.root = root;
  contents.scan_files = list_scans(folders.front());
  set_labels(contents);
  const bool with_stamps = set_stamps_from_names(contents);
  // Beside the scans when the folder around them has none, as in an archive of a drive's folder.
  std::optional<fs::path> poses = choice.file ? choice.file : folder_poses(root, contents.notes);
  if (!poses) poses = folder_poses(folders.front(), contents.notes);
  const PoseFile read = poses ? read_pose_file(*poses) : PoseFile{};
  if (!with_stamps && read.has_stamps()) {
    set_stamps_and_poses(contents, read.stamped, *poses);
  } else {
    if (!with_stamps) assume_times(contents);
    if (poses)
      set_poses(contents, read, *poses, choice.offset_ns);
    else
      set_poses_of_viewpoints(contents, choice.points);
  }
  leave_out_unordered(contents);
  return contents;
}

}  // namespace stillmap::maps
