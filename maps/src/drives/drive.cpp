#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/fast_angle.hpp>
#include <stillmap/maps/imu.hpp>
#include <stillmap/maps/map_package.hpp>
#include <stillmap/maps/pose_file.hpp>
#include <stillmap/maps/recording_choice.hpp>
#include <stillmap/maps/scan_file.hpp>
#include <stillmap/maps/sensor_preset.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <numbers>
#include <stdexcept>

#include "drives/address.hpp"
#include "drives/bag_drive.hpp"
#include "drives/hdl_graph_slam.hpp"
#include "drives/joined_lidars.hpp"
#include "drives/keyframes.hpp"
#include "drives/kitti_odometry.hpp"
#include "drives/kitti_raw.hpp"
#include "drives/layout.hpp"
#include "drives/mulran.hpp"
#include "drives/points_frame.hpp"
#include "drives/rawlog_drive.hpp"
#include "drives/scan_folder.hpp"
#include "formats/bin.hpp"
#include "formats/file_bytes.hpp"

namespace stillmap::maps {
namespace {

struct LayoutReader {
  DriveLayout layout;
  bool (*recognises)(const std::filesystem::path&);
  Drive::Contents (*open)(const std::filesystem::path&, const PosesChoice&);
};

// Layouts with folders of fixed names; a plain folder of scans is what is left.
constexpr std::array<LayoutReader, 7> kNamedLayouts{{
    {DriveLayout::kKittiRaw, is_kitti_raw, open_kitti_raw},
    {DriveLayout::kKittiOdometry, is_kitti_odometry, open_kitti_odometry},
    {DriveLayout::kKeyframes, is_keyframes, open_keyframes},
    {DriveLayout::kMulran, is_mulran, open_mulran},
    {DriveLayout::kHdlGraphSlam, is_hdl_graph_slam, open_hdl_graph_slam},
    {DriveLayout::kRosbag2, is_bag, nullptr},
    {DriveLayout::kRawlog, is_rawlog, nullptr},
}};

LayoutReader reader_for(const std::filesystem::path& root) {
  std::vector<LayoutReader> found;
  for (const LayoutReader& reader : kNamedLayouts) {
    if (reader.recognises(root)) found.push_back(reader);
  }
  if (found.size() > 1) {
    throw InputError(root.string(),
                     "both " + std::string(name_of(found[0].layout)) + " and " +
                         std::string(name_of(found[1].layout)),
                     "one layout: move the files of the other away");
  }
  if (found.size() == 1) return found.front();
  if (is_glim_dump(root))
    throw InputError(root.string(), "a dump of GLIM, whose submaps are merged scans",
                     "the scans themselves: give the bag that GLIM read, with --poses " +
                         root.string() +
                         "; to take GLIM's points as they are, write them as PLY in its "
                         "offline_viewer and run stillmap import");
  if (is_scan_folder(root)) return {DriveLayout::kScanFolder, is_scan_folder, open_scan_folder};
  throw InputError(
      root.string(), "no layout that is known",
      "velodyne_points/data/*.bin (KITTI raw), velodyne/*.bin (KITTI odometry), "
      "Scans/*.pcd with optimized_poses.txt (key frames), Ouster/*.bin with "
      "global_pose.csv (MulRan), 000000/cloud.pcd with 000000/data (hdl_graph_slam), *.mcap, *.db3 "
      "or *.bag (bags), *.pcap or *.pcapng (captures of a Velodyne), *.rawlog (MRPT), or *.pcd, "
      "*.ply or *.bin");
}

/// Times of a spinning sensor's points from their azimuth, clockwise; see
/// Drive::Contents::spin_start_end_s.
///
/// That the HDL-64E of KITTI turns clockwise was measured on 2011_09_26_drive_0013_sync: points 4
/// to 30 m away and above the ground of every sixth sweep, moved by these times and the oxts twist,
/// and their nearest neighbours in the fifth sweep after it. Within 10 cm: 19998 clockwise, 18128
/// without times, 14785 counter-clockwise; and 0.1 m voxels taken by all 80 sweeps within 30 m:
/// 619301, 625996, 649496 (fewer is crisper).
void set_spin_times(PointCloud& cloud, const std::array<double, 2>& start_end_s) {
  cloud.time_offsets_s.resize(cloud.size());
  const auto start_per_rad = static_cast<float>(start_end_s[0] / std::numbers::pi);
  const auto end_per_rad = static_cast<float>(start_end_s[1] / std::numbers::pi);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const float azimuth_rad = fast_angle(cloud.positions[i].y(), cloud.positions[i].x());
    cloud.time_offsets_s[i] = azimuth_rad * (azimuth_rad > 0.0F ? start_per_rad : -end_per_rad);
  }
}

/// `imu.csv` of a folder.
void set_imu(Drive::Contents& contents) {
  const std::filesystem::path file = contents.root / "imu.csv";
  if (!std::filesystem::is_regular_file(file)) return;
  if (!has_imu_columns(file)) {
    contents.notes.push_back(
        "imu.csv is not used: its first line does not name the columns stamp_ns,wx,wy,wz,ax,ay,az");
    return;
  }
  Imu imu{.source = file.filename().string(), .readings = {}, .fit = {}};
  imu.readings = usable_readings(read_imu_csv(file), imu.source, contents.notes);
  if (imu.readings) contents.imu = std::make_shared<const Imu>(std::move(imu));
}

std::optional<PointsFrame> points_frame_in(const Address& address) {
  if (address.points.empty()) return std::nullopt;
  const auto frame = parse_points_frame(address.points);
  if (!frame)
    throw InputError(address.place.string(), "'?points=" + address.points + "'",
                     "points=map or points=sensor: the frame of the points in the files");
  return frame;
}

Drive::Contents open_place(const Address& address, const PosesChoice& poses) {
  const std::filesystem::path& place = address.place;
  const std::string& words = address.words;
  if (std::filesystem::is_directory(place)) {
    if (is_lidar_set(place)) {
      if (words.empty()) return open_lidar_set(place, poses);
      throw InputError(place.string(), "'?" + words + "' behind a drive of several lidars",
                       "its folder alone: write it behind the drive's name in lidars.json");
    }
    const LayoutReader reader = reader_for(place);
    const bool takes_imu = words != "imu=none";
    if (reader.open != nullptr && !words.empty() && takes_imu)
      throw InputError(place.string(), "'?" + words + "' behind a drive that is no bag",
                       "its folder alone, '?sensor=NAME', '?columns=xyzir', '?points=map' or "
                       "'?imu=none': leave out "
                       "the rest");
    if (reader.open != nullptr) {
      Drive::Contents contents = reader.open(place, poses);
      if (takes_imu) set_imu(contents);
      return contents;
    }
  }
  if (is_rawlog(place)) return open_rawlog_drive(place, words, poses);
  if (!std::filesystem::is_directory(place) && !is_bag(place)) {
    throw InputError(
        place.string(), std::filesystem::exists(place) ? "a file" : "nothing",
        "the folder of a drive, a bag (MCAP, SQLite of rosbag2, ROS 1, pcap) or an MRPT "
        "rawlog: check the path");
  }
  return open_bag_drive(place, words, poses);
}

/// Columns of *.bin, as they were given; without, a look at the first scan, which may be of others.
void set_bin_columns(Drive::Contents& contents, const std::string& given) {
  const bool is_bin = !contents.scan_files.empty() && contents.entries.numbers.empty() &&
                      contents.scan_files.front().extension() == ".bin";
  if (!given.empty()) {
    if (!is_bin)
      throw InputError(contents.root.string(),
                       "'columns=" + given + "' for scans that are no *.bin",
                       "none: the files name their columns themselves");
    require_bin_columns(given);
    contents.bin_columns = given;
    return;
  }
  if (!is_bin) return;
  const std::filesystem::path& first = contents.scan_files.front();
  const auto other = other_bin_columns(read_bytes(first).span());
  if (!other) return;
  throw InputError(first.string(),
                   "numbers that are not x y z intensity: they look like " +
                       std::to_string(other->size()) + " a point",
                   "float32 x y z intensity, or the columns named: give '" +
                       contents.root.string() + "?columns=" + *other + "'");
}

}  // namespace

std::string_view name_of(DriveLayout layout) {
  switch (layout) {
    case DriveLayout::kKittiRaw:
      return "kitti_raw";
    case DriveLayout::kKittiOdometry:
      return "kitti_odometry";
    case DriveLayout::kKeyframes:
      return "keyframes";
    case DriveLayout::kScanFolder:
      return "scan_folder";
    case DriveLayout::kMcap:
      return "mcap";
    case DriveLayout::kRosbag2:
      return "rosbag2";
    case DriveLayout::kRosbag1:
      return "rosbag1";
    case DriveLayout::kPcap:
      return "pcap";
    case DriveLayout::kMulran:
      return "mulran";
    case DriveLayout::kHdlGraphSlam:
      return "hdl_graph_slam";
    case DriveLayout::kRawlog:
      return "rawlog";
  }
  throw std::invalid_argument("name_of: unknown layout");
}

Drive Drive::open(const std::filesystem::path& root,
                  const std::optional<std::filesystem::path>& poses_file,
                  std::int64_t pose_offset_ns) {
  const Address address = address_of(root);
  const PosesChoice choice{poses_file, pose_offset_ns, points_frame_in(address)};
  Contents contents = open_place(address, choice);
  set_bin_columns(contents, address.columns);
  if (!contents.lidars.empty() && !address.sensor.empty())
    throw InputError(root.string(), "'sensor=" + address.sensor + "' for several lidars",
                     "a sensor for each: write ?sensor=NAME behind each drive in lidars.json");
  if (pose_offset_ns != 0 && !contents.poses_have_stamps && !contents.T_map_lidar.empty()) {
    if (contents.points_from_map)
      throw InputError(root.string(),
                       "--pose-time-offset for VIEWPOINTs of points in the frame of the map",
                       "no offset, since each file has the pose of its points: leave it out");
    shift_poses_of_scans(contents, pose_offset_ns);
  }
  if (choice.points == PointsFrame::kMap && !contents.points_from_map)
    read_points_from_map(contents);
  Drive drive(std::move(contents));
  return address.sensor.empty() ? drive : with_sensor(drive, sensor_preset(address.sensor));
}

bool Drive::is_at(const std::filesystem::path& root) {
  const std::filesystem::path place = address_of(root).place;
  return std::filesystem::is_directory(place) || is_bag(place) || is_rawlog(place);
}

bool takes_recording_choice(const std::filesystem::path& place) {
  return !is_lidar_set(place) && (is_bag(place) || is_rawlog(place));
}

bool Drive::is_in(const std::filesystem::path& folder) {
  const auto recognises = [&](const LayoutReader& reader) { return reader.recognises(folder); };
  return is_lidar_set(folder) ||
         std::any_of(kNamedLayouts.begin(), kNamedLayouts.end(), recognises) ||
         is_scan_folder(folder);
}

std::string Drive::Contents::scan_name(std::size_t index) const {
  std::string name = scan_files.at(index).filename().string();
  if (!entries.numbers.empty())
    name += (entries.topic.empty() ? "" : ' ' + entries.topic) + ' ' +
            std::to_string(entries.numbers.at(index));
  // Scans that are read otherwise are called otherwise: what was found in them is not taken over.
  if (points_from_map) name += " from map";
  return name;
}

Drive::Drive(Contents contents) : contents_(std::move(contents)) {
  const std::size_t scans = contents_.scan_files.size();
  const auto none_or_all = [scans](const auto& values) {
    return values.empty() || values.size() == scans;
  };
  if (contents_.stamps_ns.size() != scans || !none_or_all(contents_.T_map_lidar) ||
      !none_or_all(contents_.entries.numbers) || !none_or_all(contents_.spin_start_end_s) ||
      !none_or_all(contents_.label_files)) {
    throw std::invalid_argument("Drive: not one stamp, pose, spin and label file for each of " +
                                std::to_string(scans) + " scans");
  }
}

Drive Drive::with_poses(std::vector<Eigen::Isometry3d> T_map_lidar,
                        const std::optional<GeodeticOrigin>& origin) const {
  for (const Eigen::Isometry3d& T : T_map_lidar) {
    if (!T.matrix().allFinite())
      throw std::invalid_argument("Drive::with_poses: a pose is not finite");
  }
  if (T_map_lidar.size() != size())
    throw std::invalid_argument("Drive::with_poses: " + std::to_string(T_map_lidar.size()) +
                                " poses for " + std::to_string(size()) + " scans");
  Contents contents = contents_;
  contents.T_map_lidar = std::move(T_map_lidar);
  contents.path.reset();
  contents.position_step_m.setZero();
  contents.origin = origin;
  return Drive(std::move(contents));
}

Drive Drive::with_imu(std::shared_ptr<const Imu> imu) const {
  Contents contents = contents_;
  contents.imu = std::move(imu);
  return Drive(std::move(contents));
}

void Drive::require_own_numbers(const std::filesystem::path& file) const {
  if (!contents_.counts_from_first_pose) return;
  throw InputError(
      contents_.root.string(),
      "first scans without a pose, which are left out, so that the numbers of scans in " +
          file.string() + " fit no longer",
      "poses from the first scan on");
}

Scan Drive::read(std::size_t index) const {
  const std::filesystem::path& file = contents_.scan_files.at(index);
  const bool is_entry = !contents_.entries.numbers.empty();
  DecodedScan decoded = is_entry ? contents_.entries.read(contents_.entries.numbers[index])
                                 : read_scan_file(file, file_hints(contents_, index));
  Scan scan;
  scan.index = index;
  scan.stamp_ns = contents_.stamps_ns[index];
  scan.source =
      is_entry ? (file.parent_path() / contents_.scan_name(index)).string() : file.string();
  scan.cloud = std::move(decoded.cloud);
  scan.dropped = decoded.dropped;
  scan.points_in_file = decoded.points_in_file;
  scan.times_note = std::move(decoded.times_note);
  if (!contents_.spin_start_end_s.empty()) {
    set_spin_times(scan.cloud, contents_.spin_start_end_s[index]);
  }
  if (contents_.imu && contents_.imu->fit)
    scan.cloud.turn = turn_of(scan, *contents_.imu->readings, *contents_.imu->fit);
  return scan;
}

std::string Drive::sha256(std::size_t index) const {
  if (contents_.entries.numbers.empty()) return sha256_of_file(contents_.scan_files.at(index));
  return contents_.entries.sha256(contents_.entries.numbers.at(index));
}

std::vector<std::uint32_t> Drive::read_labels(std::size_t index) const {
  const std::filesystem::path& scan_file = contents_.scan_files.at(index);
  if (contents_.label_files.empty() || contents_.label_files[index].empty()) return {};
  const std::filesystem::path& file = contents_.label_files[index];
  const FileBytes bytes = read_bytes(file);
  const std::size_t points = read_scan_file(scan_file, file_hints(contents_, index)).points_in_file;
  if (bytes.span().size() != points * sizeof(std::uint32_t)) {
    throw InputError(file.string(), std::to_string(bytes.span().size()) + " bytes",
                     std::to_string(points * sizeof(std::uint32_t)) + ", 4 for each point of " +
                         scan_file.filename().string());
  }
  std::vector<std::uint32_t> labels(points);
  if (points > 0) std::memcpy(labels.data(), bytes.span().data(), bytes.span().size());
  return labels;
}

std::optional<std::vector<std::optional<Eigen::Isometry3d>>> poses_of_some_scans(
    const Drive& drive, const std::filesystem::path& poses_file) {
  const Trajectory trajectory = read_pose_file(poses_file).stamped;
  if (trajectory.empty()) return std::nullopt;
  if (trajectory.size() >= drive.size()) return std::nullopt;
  const std::vector<std::int64_t>& stamps = drive.contents().stamps_ns;
  std::vector<std::optional<Eigen::Isometry3d>> poses(drive.size());
  for (const StampedPose& pose : trajectory.poses()) {
    const auto scan = std::lower_bound(stamps.begin(), stamps.end(), pose.stamp_ns);
    if (scan == stamps.end() || *scan != pose.stamp_ns) return std::nullopt;
    poses[static_cast<std::size_t>(scan - stamps.begin())] = pose.T_map_lidar;
  }
  return poses;
}

}  // namespace stillmap::maps
