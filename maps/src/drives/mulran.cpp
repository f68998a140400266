#include "drives/mulran.hpp"

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/geodesy.hpp>
#include <stillmap/maps/map_package.hpp>
#include <stillmap/maps/scan_file.hpp>

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <numbers>
#include <set>

#include <stillmap/maps/text.hpp>
#include "drives/layout.hpp"
#include "formats/pose_line.hpp"

namespace stillmap::maps {
namespace {

namespace fs = std::filesystem;

/// An OS1-64 at 10 turns of 1024 columns a second.
constexpr std::size_t kRows = 64, kColumns = 1024;
constexpr double kTurnS = 0.1;
/// Of Daejeon and Sejong, where all of MulRan was recorded.
constexpr UtmZone kZone{52, true};
constexpr double kLeastEastingM = 166'000.0, kMostEastingM = 834'000.0;
constexpr double kLeastNorthingM = 3'600'000.0, kMostNorthingM = 4'300'000.0;
constexpr double kMostHeightM = 10'000.0;

/// MulRan's calibration of the Ouster on its vehicle: x y z [m], roll pitch yaw [deg].
Eigen::Isometry3d T_base_lidar() {
  constexpr double kRadPerDeg = std::numbers::pi / 180.0;
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = (Eigen::AngleAxisd(179.6654 * kRadPerDeg, Eigen::Vector3d::UnitZ()) *
                Eigen::AngleAxisd(0.0003 * kRadPerDeg, Eigen::Vector3d::UnitY()) *
                Eigen::AngleAxisd(0.0001 * kRadPerDeg, Eigen::Vector3d::UnitX()))
                   .toRotationMatrix();
  T.translation() = Eigen::Vector3d(1.7042, -0.021, 1.8047);
  return T;
}

/// Where the file player has a sensor's files, or where the download has them.
fs::path place_of(const fs::path& root, const char* name) {
  const fs::path ordered = root / "sensor_data" / name;
  return fs::exists(ordered) ? ordered : root / name;
}

/// A table whose fields are parted by commas, as one parted by blanks.
std::string read_csv(const fs::path& file) {
  std::string text = read_text(file);
  std::replace(text.begin(), text.end(), ',', ' ');
  return text;
}

std::optional<std::int64_t> stamp_of(std::string_view digits) {
  const std::optional<std::uint64_t> count = parse_count(digits);
  if (!count || *count > static_cast<std::uint64_t>(INT64_MAX)) return std::nullopt;
  return static_cast<std::int64_t>(*count);
}

std::int64_t stamp_in(const fs::path& file, const NumberLine& line) {
  const std::optional<std::int64_t> stamp = stamp_of(line.fields.front());
  if (!stamp)
    throw InputError(place(file, line.line), "'" + std::string(line.fields.front()) + "'",
                     "nanoseconds");
  return *stamp;
}

/// A scan's file with the times of its points, where it holds every shot of the turn, with or
/// without return, column by column.
DecodedScan read_scan(const fs::path& file) {
  DecodedScan scan = read_scan_file(file);
  if (scan.points_in_file != kRows * kColumns) return scan;
  scan.cloud.time_offsets_s.resize(scan.cloud.size());
  for (std::size_t i = 0; i < scan.cloud.size(); ++i) {
    const auto column = static_cast<double>(scan.cloud.file_index(i) / kRows);
    scan.cloud.time_offsets_s[i] = static_cast<float>(kTurnS * (column / kColumns - 0.5));
  }
  return scan;
}

void set_scans(Drive::Contents& contents) {
  contents.scan_files = list_files(place_of(contents.root, "Ouster"), ".bin");
  for (const fs::path& file : contents.scan_files) {
    const std::optional<std::int64_t> stamp = stamp_of(file.stem().native());
    if (!stamp)
      throw InputError(file.string(), "its name",
                       "nanoseconds, as MulRan names its scans: keep MulRan's names");
    contents.stamps_ns.push_back(*stamp);
  }
  contents.relative_clock = contents.stamps_ns.front() < kFirstEpochStampNs;
  contents.entries.topic = "ouster";
  for (std::size_t i = 0; i < contents.scan_files.size(); ++i)
    contents.entries.numbers.push_back(i);
  contents.entries.read = [files = contents.scan_files](std::size_t i) {
    return read_scan(files.at(i));
  };
  contents.entries.sha256 = [files = contents.scan_files](std::size_t i) {
    return sha256_of_file(files.at(i));
  };
}

void note_missing_stamps(Drive::Contents& contents) {
  const fs::path file = place_of(contents.root, "ouster_front_stamp.csv");
  if (!fs::exists(file)) return;
  const std::string text = read_csv(file);
  const std::set<std::int64_t> there(contents.stamps_ns.begin(), contents.stamps_ns.end());
  std::size_t missing = 0;
  for (const NumberLine& line : number_lines(text))
    missing += 1 - there.count(stamp_in(file, line));
  if (missing > 0)
    contents.notes.push_back(
        fmt::format("{} scans of {} missing on disk", missing, file.filename().string()));
}

/// By stamp, of equal ones the first.
std::map<std::int64_t, Eigen::Isometry3d> read_poses(const fs::path& file) {
  const std::string text = read_csv(file);
  std::map<std::int64_t, Eigen::Isometry3d> poses;
  for (NumberLine& line : number_lines(text)) {
    const std::int64_t stamp_ns = stamp_in(file, line);
    line.fields.erase(line.fields.begin());
    poses.emplace(stamp_ns, parse_kitti_pose(file, line));
  }
  if (poses.empty()) throw InputError(file.string(), "no poses", "ns and 12 numbers a line");
  return poses;
}

bool is_of_zone(const Eigen::Vector3d& p) {
  return p.x() >= kLeastEastingM && p.x() <= kMostEastingM && p.y() >= kLeastNorthingM &&
         p.y() <= kMostNorthingM && std::abs(p.z()) <= kMostHeightM;
}

/// Takes poses out of the grid of UTM into east-north-up at `origin`.
class FromUtm {
 public:
  explicit FromUtm(const GeodeticOrigin& origin) : projection_(origin, kZone) {}

  [[nodiscard]] Eigen::Isometry3d operator()(const Eigen::Isometry3d& T_utm_base) const {
    const Eigen::Vector3d p_utm = T_utm_base.translation();
    Eigen::Isometry3d T_map_base = Eigen::Isometry3d::Identity();
    T_map_base.translation() = projection_.to_map(p_utm);
    // Grid north is not north: the convergence, by a step along it.
    constexpr double kStepM = 100.0;
    const Eigen::Vector3d north =
        projection_.to_map(p_utm + kStepM * Eigen::Vector3d::UnitY()) - T_map_base.translation();
    const double turn_rad = std::atan2(-north.x(), north.y());
    T_map_base.linear() = Eigen::AngleAxisd(turn_rad, Eigen::Vector3d::UnitZ()).toRotationMatrix() *
                          T_utm_base.linear();
    return T_map_base;
  }

 private:
  UtmProjection projection_;
};

/// The vehicle's poses in the map frame.
Trajectory path_in_map(const fs::path& file, Drive::Contents& contents) {
  std::map<std::int64_t, Eigen::Isometry3d> poses = read_poses(file);
  auto first = poses.lower_bound(contents.stamps_ns.front());
  if (first == poses.end()) first = poses.begin();
  const Eigen::Vector3d start = first->second.translation();
  std::vector<Eigen::Isometry3d> as_written;
  for (const auto& [stamp_ns, T] : poses) as_written.push_back(T);
  set_position_step(contents, as_written);
  std::vector<StampedPose> path;
  if (is_of_zone(start)) {
    contents.origin = geodetic_of(start, kZone);
    const FromUtm from_utm(*contents.origin);
    for (const auto& [stamp_ns, T] : poses) {
      if (!is_of_zone(T.translation()))
        throw InputError(file.string(),
                         fmt::format("a pose at {}, {}, {} among others in UTM zone 52N",
                                     T.translation().x(), T.translation().y(), T.translation().z()),
                         "all in one frame: take out the poses of the other frame");
      path.push_back({stamp_ns, from_utm(T)});
    }
  } else {
    contents.notes.push_back(fmt::format(
        "poses of {} are not in UTM zone 52N: taken as local metres", file.filename().string()));
    for (const auto& [stamp_ns, T] : poses) path.push_back({stamp_ns, T});
  }
  return Trajectory(std::move(path));
}

void set_own_poses(Drive::Contents& contents, std::int64_t offset_ns) {
  const fs::path file = contents.root / "global_pose.csv";
  if (!fs::exists(file)) {
    contents.notes.emplace_back("no global_pose.csv: a drive without poses");
    return;
  }
  set_poses_at_stamps(contents, path_in_map(file, contents), file, offset_ns);
  for (Eigen::Isometry3d& T : contents.T_map_lidar) T = T * T_base_lidar();
  std::vector<StampedPose> path = contents.path->poses();
  for (StampedPose& pose : path) pose.T_map_lidar = pose.T_map_lidar * T_base_lidar();
  contents.path = std::make_shared<const Trajectory>(std::move(path));
}

}  // namespace

bool is_mulran(const fs::path& root) {
  if (!list_files(root / "sensor_data" / "Ouster", ".bin").empty()) return true;
  const bool says_so =
      fs::exists(root / "global_pose.csv") || fs::exists(root / "ouster_front_stamp.csv");
  return says_so && !list_files(root / "Ouster", ".bin").empty();
}

Drive::Contents open_mulran(const fs::path& root, const PosesChoice& choice) {
  Drive::Contents contents;
  contents.layout = DriveLayout::kMulran;
  contents.root = root;
  set_scans(contents);
  note_missing_stamps(contents);
  if (choice.file) {
    set_poses(contents, *choice.file, choice.offset_ns);
  } else {
    set_own_poses(contents, choice.offset_ns);
  }
  leave_out_unordered(contents);
  return contents;
}

}  // namespace stillmap::maps
