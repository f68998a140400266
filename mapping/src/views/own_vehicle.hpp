#pragma once

#include "views/range_view.hpp"

#include <stillmap/maps/cell_table.hpp>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <cstddef>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

namespace stillmap::mapping {

/// Where in the lidar frame something travels with the sensor: a trailer, a load, the vehicle.
///
/// In cubes of 0.25 m within 12 m of the sensor that three of four samples have points in. A wall
/// or a guard rail beside a straight road looks the same from every scan; but it is still there in
/// a scan taken 10 m before, while the place of a trailer is free. So a cube belongs to the vehicle
/// when earlier views saw its points' places free and next to none hit them. Cubes that touch one
/// which belongs, and are taken now and then (a trailer that turns), belong under the same rule.
class OwnVehicle {
 public:
  /// A scan, and a view of the same road from before.
  struct Sample {
    /// Of what is not ground, lidar frame [m]: between the rings of a view ground looks free.
    std::vector<Eigen::Vector3f> positions;
    RangeView before;
    Eigen::Isometry3d T_before_lidar;
  };

  /// Nothing.
  OwnVehicle() = default;
  explicit OwnVehicle(std::span<const Sample> samples);

  /// Which scans make samples: some twelve, spread over the way, each with one 10 m before.
  /// @return pairs (scan, before); none for a drive shorter than 40 m.
  [[nodiscard]] static std::vector<std::pair<std::size_t, std::size_t>> choose_samples(
      std::span<const Eigen::Isometry3d> T_local_lidar);

  [[nodiscard]] bool empty() const { return cubes_.size() == 0; }
  /// @param p  lidar frame [m].
  [[nodiscard]] bool holds(const Eigen::Vector3f& p) const;

 private:
  maps::CellTable cubes_;
};

}  // namespace stillmap::mapping
