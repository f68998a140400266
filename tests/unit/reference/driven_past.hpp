#pragma once

#include <stillmap/mapping/cleaning.hpp>

#include "support/synthetic_world.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <map>
#include <vector>

namespace stillmap::test {

/// A drive past a wall and a parked box, while another box drives away; then its map, with what
/// every point of it is.
class DrivenPast : public mapping::ScanSource {
 public:
  enum class Kind { kGround, kWall, kParked, kMoved };

  explicit DrivenPast(std::size_t scans = 9) {
    for (std::size_t k = 0; k < scans; ++k) add_scan(k);
    make_map();
  }

  [[nodiscard]] std::size_t size() const override { return scans_.size(); }
  [[nodiscard]] Eigen::Isometry3d T_local_lidar(std::size_t scan) const override {
    return scans_.at(scan).T_local_lidar;
  }
  [[nodiscard]] mapping::PosedScan read(std::size_t scan) const override { return scans_.at(scan); }

  mapping::CleaningPoints map;
  /// One for each point of the map.
  std::vector<Kind> kinds;

  /// Share of the points of a kind that go, among those higher than this over the ground.
  [[nodiscard]] double share_gone(const std::vector<std::uint8_t>& gone, Kind kind,
                                  double above_m = -1.0) const {
    double of = 0.0;
    double lost = 0.0;
    for (std::size_t i = 0; i < gone.size(); ++i) {
      if (kinds[i] != kind || static_cast<double>(map.positions[i].z()) < above_m) continue;
      of += 1.0;
      lost += gone[i] != 0 ? 1.0 : 0.0;
    }
    return lost / of;
  }

 private:
  static constexpr double kVoxelM = 0.1;
  /// In the scans before it, the box is there.
  static constexpr std::size_t kGoneFrom = 3;

  static SyntheticWorld::Box moving_box(std::size_t k) {
    const double x = 9.0 + 2.0 * static_cast<double>(k);
    return {{x, -4.5, 0.0}, {x + 4.0, -2.7, 1.5}};
  }

  void add_scan(std::size_t k) {
    SyntheticWorld world;
    world.boxes = {{{-5.0, 8.0, 0.0}, {40.0, 9.0, 4.0}}, {{10.0, 4.0, 0.0}, {14.0, 5.8, 1.5}}};
    if (k < kGoneFrom) world.boxes.push_back(moving_box(k));
    ScanPattern pattern;
    pattern.rings = 48;
    pattern.columns = 600;
    pattern.max_range_m = 30.0;
    mapping::PosedScan scan;
    scan.T_local_lidar = pose_at(0.5 * static_cast<double>(k), 0.0, 0.02 * static_cast<double>(k));
    scan.positions = world.scan(scan.T_local_lidar, pattern).positions;
    for (const Eigen::Vector3f& p : scan.positions) {
      const Eigen::Vector3d q = scan.T_local_lidar * p.cast<double>();
      scan.is_ground.push_back(q.z() < 0.01 ? 1 : 0);
    }
    scan.in_object.assign(scan.positions.size(), 0);
    scans_.push_back(std::move(scan));
  }

  static Kind kind_of(const Eigen::Vector3d& q) {
    if (q.z() < 0.01) return Kind::kGround;
    if (q.y() > 7.0) return Kind::kWall;
    return q.y() > 0.0 ? Kind::kParked : Kind::kMoved;
  }

  void make_map() {
    struct Voxel {
      Eigen::Vector3d sum = Eigen::Vector3d::Zero();
      std::array<double, 4> points{};
      std::uint32_t scans = 0;
      std::size_t last = 0;
    };
    std::map<std::array<int, 3>, Voxel> voxels;
    for (std::size_t k = 0; k < scans_.size(); ++k) {
      for (const Eigen::Vector3f& p : scans_[k].positions) {
        const Eigen::Vector3d q = scans_[k].T_local_lidar * p.cast<double>();
        const Eigen::Array3i cell = (q / kVoxelM).array().floor().cast<int>();
        Voxel& voxel = voxels[{cell.x(), cell.y(), cell.z()}];
        voxel.sum += q;
        voxel.points[static_cast<std::size_t>(kind_of(q))] += 1.0;
        if (voxel.scans == 0 || voxel.last != k) ++voxel.scans;
        voxel.last = k;
      }
    }
    map.voxel_size_m = kVoxelM;
    for (const auto& [cell, voxel] : voxels) {
      double points = 0.0;
      for (const double some : voxel.points) points += some;
      map.positions.push_back((voxel.sum / points).cast<float>());
      map.is_ground.push_back(voxel.points[0] > 0.5 * points ? 1 : 0);
      map.scans.push_back(voxel.scans);
      const auto most = std::max_element(voxel.points.begin(), voxel.points.end());
      kinds.push_back(static_cast<Kind>(most - voxel.points.begin()));
    }
  }

  std::vector<mapping::PosedScan> scans_;
};

}  // namespace stillmap::test
