#pragma once

#include <stillmap/maps/box.hpp>

#include <Eigen/Core>

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string_view>
#include <vector>

namespace stillmap::maps {

/// What is known of an object's motion while it was seen.
enum class ObjectMotion { kUnknown, kParked, kMoving };
[[nodiscard]] std::string_view name_of(ObjectMotion motion);
[[nodiscard]] std::optional<ObjectMotion> object_motion_from(std::string_view name);

/// An object that was removed from a map: one, however often it was seen.
struct MapObject {
  /// Where it stood; map frame.
  struct Placement {
    /// Ordinal of the scan, over all drives of the map.
    std::size_t scan = 0;
    /// Centre of the box [m].
    Eigen::Vector3d centre_map = Eigen::Vector3d::Zero();
    double yaw_rad = 0.0;
  };
  ObjectClass object_class = ObjectClass::kUnknown;
  /// Length along the heading, width, height [m].
  Eigen::Vector3d size_m = Eigen::Vector3d::Ones();
  /// Probability that it was there, in [0, 1].
  double score = 1.0;
  ObjectMotion motion = ObjectMotion::kUnknown;
  /// Drive it was seen in, from 0.
  std::size_t drive = 0;
  /// First and last scan that it was removed from, and their stamps.
  std::size_t first_scan = 0, last_scan = 0;
  std::int64_t first_stamp_ns = 0, last_stamp_ns = 0;
  /// Scans that it was detected in; in the others it was filled in.
  std::size_t detections = 0;
  /// One for an object that stood still, else one a scan, in their order; at least one.
  std::vector<Placement> placements;
  std::uint64_t points_removed = 0;
};

}  // namespace stillmap::maps
