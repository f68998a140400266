#pragma once

#include <Eigen/Core>

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace stillmap::maps {

/// What an object is. All of these can move; what cannot is no object.
enum class ObjectClass {
  kCar,
  kVan,
  kTruck,
  kBus,
  kTrailer,
  kTram,
  kMotorcycle,
  kCyclist,
  kPedestrian,
  kUnknown,
};

[[nodiscard]] std::string_view name_of(ObjectClass object_class);
[[nodiscard]] std::optional<ObjectClass> object_class_from(std::string_view name);

/// An object as a box in the lidar frame of its scan.
struct Box {
  /// Centre of the box (not of its bottom face) [m].
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();
  /// Length along the heading, width, height [m], each > 0.
  Eigen::Vector3d size_m = Eigen::Vector3d::Ones();
  /// Heading, counter-clockwise from +x seen from +z [rad].
  double yaw_rad = 0.0;
  ObjectClass object_class = ObjectClass::kUnknown;
  /// Confidence in [0, 1]; labels have 1.
  double score = 1.0;
  /// Same number = same object over time; -1 when unknown.
  int track = -1;

  /// Whether a point [m, same frame] lies in the box grown by `margin_m` on every side.
  [[nodiscard]] bool contains(const Eigen::Vector3d& p, double margin_m = 0.0) const;
};

/// Boxes by scan index (the number in the label file: the drive's own scan number, from 0).
struct BoxSequence {
  std::map<std::size_t, std::vector<Box>> by_scan;
  /// Labels left out, by reason ("DontCare", "frame beyond the drive", "not finite", ...).
  std::map<std::string, std::size_t> dropped;
};

/// Reads boxes from either of two formats, told apart by content:
///  - KITTI tracking labels (`frame track type ...`, rectified camera frame), turned to the lidar
///  frame with
///    `calib.txt` in the same folder (`R0_rect`/`R_rect`, `Tr_velo_to_cam`/`Tr_velo_cam`), or else
///    the `calib_velo_to_cam.txt` and `calib_cam_to_cam.txt` of a KITTI raw date folder above it;
///  - JSON `{"format": "stillmap-boxes", "version": 1, "scans": [{"scan": 0, "boxes": [{"centre":
///  [x, y, z],
///    "size": [l, w, h], "yaw": rad, "class": "car", "score": 1, "track": 3}]}]}`, lidar frame.
/// @param scan_count  labels of frames at or beyond it are dropped and counted.
/// @throws InputError naming file, line and value; also when no calibration is found.
[[nodiscard]] BoxSequence read_boxes(const std::filesystem::path& file, std::size_t scan_count);

/// Writes the JSON format above. @throws StorageError.
void write_boxes(const std::filesystem::path& file, const BoxSequence& boxes);

}  // namespace stillmap::maps
