#pragma once

#include "voxel.hpp"
#include "voxel_table.hpp"

#include <Eigen/Core>

#include <cstdint>
#include <vector>

namespace stillmap::localization {

/// Sums of the points of one cell, relative to the origin of its grid.
struct Moments {
  std::uint64_t key = 0;
  std::uint32_t count = 0;
  double weight = 0.0;
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  Eigen::Matrix3d outer = Eigen::Matrix3d::Zero();

  void add(const Eigen::Vector3d& p, double point_weight) {
    ++count;
    weight += point_weight;
    sum += point_weight * p;
    outer += point_weight * p * p.transpose();
  }
  void add(const Moments& other) {
    count += other.count;
    weight += other.weight;
    sum += other.sum;
    outer += other.outer;
  }
};

/// Cells in the order in which they were first met.
struct MomentGrid {
  VoxelTable table;
  std::vector<Moments> cells;

  Moments& at(std::uint64_t key) {
    const auto [index, inserted] = table.insert(key);
    if (inserted) {
      cells.emplace_back();
      cells.back().key = key;
    }
    return cells[index];
  }
};

/// Cells of twice the edge.
[[nodiscard]] MomentGrid coarser(const MomentGrid& fine);

/// The points of a cell as a normal distribution. @param moments  of two points or more.
/// @param corner  that the voxel's mean counts from, as the moments count [m].
[[nodiscard]] Voxel voxel_of(const Moments& moments, double edge_m,
                             const Eigen::Vector3d& corner = Eigen::Vector3d::Zero());

}  // namespace stillmap::localization
