#pragma once

#include "support/synthetic_world.hpp"

#include <stillmap/mapping/cleaning.hpp>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <cstddef>
#include <cstdint>
#include <vector>

namespace stillmap::test {

/// Scans for a cleaner to read.
class ScansInMemory : public mapping::ScanSource {
 public:
  std::vector<mapping::PosedScan> scans;

  [[nodiscard]] std::size_t size() const override { return scans.size(); }
  [[nodiscard]] Eigen::Isometry3d T_local_lidar(std::size_t scan) const override {
    return scans.at(scan).T_local_lidar;
  }
  [[nodiscard]] mapping::PosedScan read(std::size_t scan) const override { return scans.at(scan); }

  /// Points of the lidar frame, none of them ground.
  void add(const Eigen::Isometry3d& T_local_lidar, std::vector<Eigen::Vector3f> positions) {
    mapping::PosedScan scan;
    scan.T_local_lidar = T_local_lidar;
    scan.is_ground.assign(positions.size(), 0);
    scan.in_object.assign(positions.size(), 0);
    scan.positions = std::move(positions);
    scans.push_back(std::move(scan));
  }

  /// A world, whose ground is told by its height, seen from a place.
  void add(const SyntheticWorld& world, const Eigen::Vector3d& sensor, const ScanPattern& pattern) {
    Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
    T.translation() = sensor;
    add(T, world.scan(T, pattern).positions);
    mapping::PosedScan& scan = scans.back();
    for (std::size_t i = 0; i < scan.positions.size(); ++i) {
      scan.is_ground[i] = scan.positions[i].z() + sensor.z() < 1e-3 ? 1 : 0;
    }
  }

  /// Every point of every scan, as it lies in the map.
  [[nodiscard]] mapping::CleaningPoints points() const {
    mapping::CleaningPoints points;
    for (const mapping::PosedScan& scan : scans) {
      for (std::size_t i = 0; i < scan.positions.size(); ++i) {
        add_point(points, (scan.T_local_lidar * scan.positions[i].cast<double>()).cast<float>(),
                  scan.is_ground[i]);
      }
    }
    return points;
  }

  static void add_point(mapping::CleaningPoints& points, const Eigen::Vector3f& p,
                        std::uint8_t is_ground = 0) {
    points.positions.push_back(p);
    points.is_ground.push_back(is_ground);
    points.scans.push_back(1);
  }

  /// Lifts everything, so that the ground of a synthetic world lies in the middle of a voxel.
  void shift(const Eigen::Vector3d& by) {
    for (mapping::PosedScan& scan : scans) scan.T_local_lidar.pretranslate(by);
  }
};

}  // namespace stillmap::test
