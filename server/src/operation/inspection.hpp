#pragma once

#include <stillmap/maps/cloud_file.hpp>
#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/drive_check.hpp>
#include <stillmap/maps/map_package.hpp>
#include <stillmap/maps/pose_disagreement.hpp>

#include <Eigen/Geometry>

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace stillmap::server {

/// What a map package holds.
struct MapSummary {
  std::string digest;
  /// `maps::content_digest`, where it was asked for.
  std::optional<std::string> content_digest;
  maps::MapManifest manifest;
  std::uint64_t points = 0;
  /// In the map frame [m].
  Eigen::AlignedBox3d bounds_map;
  std::size_t objects = 0;
  std::size_t poses = 0;
  double path_length_m = 0.0;
  /// Nothing where the package does not say.
  std::optional<maps::BentPlaces> bent;
};

/// The IMU of a drive.
struct ImuSummary {
  /// Topic or file.
  std::string source;
  std::size_t readings = 0;
  double rate_hz = 0.0;
  double longest_gap_s = 0.0;
  /// First reading against the first scan, and last against the last, by their stamps [s]: < 0 is
  /// earlier.
  double first_s = 0.0;
  double last_s = 0.0;
};

/// What a drive holds.
struct DriveSummary {
  maps::DriveLayout layout = maps::DriveLayout::kScanFolder;
  std::size_t scans = 0;
  double duration_s = 0.0;
  /// Scans a second over the duration; 0 with one scan.
  double rate_hz = 0.0;
  bool relative_clock = true;
  bool has_poses = false;
  /// Of the first scan.
  bool has_point_times = false;
  bool has_labels = false;
  /// Of recordings: topic (or label) of the scans, frame of their points and columns of the first.
  std::string topic;
  std::string frame_id;
  std::vector<std::string> fields;
  double path_length_m = 0.0;
  std::optional<maps::GeodeticOrigin> origin;
  /// Of the first scan, in its lidar frame [m].
  std::size_t first_scan_points = 0;
  maps::DropCounts first_scan_dropped;
  /// What the scans may be of, by name.
  std::vector<std::string> sensors;
  Eigen::AlignedBox3d first_scan_bounds;
  std::optional<ImuSummary> imu;
  std::vector<std::string> notes;
  maps::DriveCheck check;
};

/// What a file of points holds: a scan, or a map from elsewhere.
struct CloudFileSummary {
  /// By its extension: pcd, ply, las or bin.
  std::string format;
  std::uint64_t bytes = 0;
  maps::CloudSummary cloud;
  /// In the file's own coordinates.
  Eigen::AlignedBox3d bounds;
  /// Lowest and highest.
  std::array<float, 2> intensities{};
  std::vector<maps::DriveFinding> findings;
};

/// What a file of poses holds.
struct TrajectorySummary {
  /// kitti or tum.
  std::string format;
  std::size_t poses = 0;
  /// Of tum.
  double duration_s = 0.0;
  double path_length_m = 0.0;
  Eigen::AlignedBox3d bounds;
};

/// Whether a folder is a map package rather than a drive.
[[nodiscard]] bool is_map_package(const std::filesystem::path& folder);

[[nodiscard]] MapSummary summarize(const maps::MapPackage& package);
/// What is known of a drive before a scan of it is read.
[[nodiscard]] DriveSummary summarize_unread(const maps::Drive& drive);
/// Reads the first scan and those of `maps::check_drive`. @throws as `maps::Drive::read`.
[[nodiscard]] DriveSummary summarize(const maps::Drive& drive);
/// Reads the whole file, in pieces. @throws maps::InputError, maps::StorageError.
[[nodiscard]] CloudFileSummary summarize_cloud(const std::filesystem::path& file);
/// Told apart by the numbers a line. @throws maps::InputError, maps::StorageError.
[[nodiscard]] TrajectorySummary summarize_trajectory(const std::filesystem::path& file);

}  // namespace stillmap::server
