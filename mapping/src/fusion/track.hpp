#pragma once

#include "fusion/motion_filter.hpp"
#include "fusion/object_fusion.hpp"

#include <stillmap/maps/box.hpp>

#include <Eigen/Core>

#include <cstddef>
#include <vector>

namespace stillmap::mapping {

/// A box of one scan, brought to the map.
struct Hit {
  /// Ordinal of the scan.
  std::size_t scan = 0;
  /// Map frame.
  maps::Box box;
  /// The sensor's place, from above [m].
  Eigen::Vector2d sensor = Eigen::Vector2d::Zero();
};

/// Boxes of one drive that belong together, in the scans' order.
struct Track {
  std::size_t drive = 0;
  /// Joined by numbers that came with the boxes.
  bool given = false;
  std::vector<Hit> hits;
};

/// People and two-wheelers: small, and as likely to be one another as not.
[[nodiscard]] bool is_small(maps::ObjectClass object_class);
/// Whether two boxes may be one object: a vehicle is no person, a bus may be a truck.
[[nodiscard]] bool may_be_one(maps::ObjectClass a, maps::ObjectClass b);
[[nodiscard]] MotionNoise motion_noise_of(maps::ObjectClass object_class);
/// Deviation of a detected centre: which corner was seen moves it [m].
[[nodiscard]] double centre_sigma_m(maps::ObjectClass object_class);

/// Joins the boxes of scans that follow each other, drive by drive: those with a number by it, the
/// others by where a track should be by now, best pairs first.
/// @return in the order of their first box.
[[nodiscard]] std::vector<Track> tracks_of(const std::vector<DetectedScan>& scans);

}  // namespace stillmap::mapping
