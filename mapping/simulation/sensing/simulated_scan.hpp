#pragma once

#include <stillmap/maps/box.hpp>

#include <Eigen/Geometry>

#include <cstdint>
#include <functional>
#include <vector>

namespace stillmap::simulation {

inline constexpr unsigned kInstanceShift = 16;

/// Points of one kind, N of each.
struct LabelledPoints {
  /// In the lidar frame at the point's own time, as the sensor measures them [m].
  std::vector<Eigen::Vector3f> positions;
  /// In [0, 1].
  std::vector<float> intensities;
  /// SemanticKITTI class in the lower 16 bits (252 to 259 for what moves), track in the upper ones
  /// (0 = what cannot move).
  std::vector<std::uint32_t> labels;
  /// Relative to the stamp [s].
  std::vector<float> time_offsets_s;
  std::vector<std::uint16_t> rings;

  [[nodiscard]] std::size_t size() const { return positions.size(); }
};

/// One sweep, with what only a simulator knows.
struct SimulatedScan {
  /// Of the drive's clock, 0 = its start [s].
  double stamp_s = 0.0;
  LabelledPoints points;
  /// What those rays would have met that met an object or were lost on it, had no object been
  /// there.
  LabelledPoints behind;
  /// True boxes of the objects that have points, in the lidar frame as measured: at the mean time
  /// of the object's points. `track` is the label's.
  std::vector<maps::Box> boxes;
  /// The same boxes as they lie in the lidar frame at the stamp.
  std::vector<maps::Box> boxes_at_stamp;
};

/// The vehicle's true path: `T_world_lidar` at any time of the drive [s], and a bit beyond. World:
/// x east, y north, z up.
using TruePath = std::function<Eigen::Isometry3d(double time_s)>;

}  // namespace stillmap::simulation
