#include "evaluation/labels/voxel_means.hpp"

#include <cmath>
#include <stdexcept>

namespace stillmap::mapping {

VoxelMeans::VoxelMeans(double edge_m) : edge_m_(edge_m), inverse_edge_(1.0 / edge_m) {
  if (!(edge_m > 0.0)) throw std::invalid_argument("voxel means: edge, expected > 0");
}

void VoxelMeans::add(const Eigen::Vector3f& position) {
  const Eigen::Array3d p = position.cast<double>().array();
  const Eigen::Array3d cell = (p * inverse_edge_).floor();
  const std::uint64_t key =
      maps::signed_cell_key(static_cast<std::int64_t>(cell[0]), static_cast<std::int64_t>(cell[1]),
                            static_cast<std::int64_t>(cell[2]));
  const auto [number, is_new] =
      index_.insert(key, [this](std::uint32_t of) { return sums_[of].key; });
  if (is_new) sums_.push_back({.key = key});
  Sum& sum = sums_[number];
  sum.offset += (p - cell * edge_m_).cast<float>().matrix();
  ++sum.points;
}

std::vector<Eigen::Vector3f> VoxelMeans::take() {
  std::vector<Eigen::Vector3f> means;
  means.reserve(sums_.size());
  for (const Sum& sum : sums_) {
    const auto cell = maps::signed_cell_of_key(sum.key);
    const Eigen::Array3d low = Eigen::Array3d(cell[0], cell[1], cell[2]) * edge_m_;
    const Eigen::Array3d mean = sum.offset.cast<double>().array() / static_cast<double>(sum.points);
    means.push_back((low + mean).cast<float>().matrix());
  }
  sums_.clear();
  index_ = maps::CellIndex();
  return means;
}

}  // namespace stillmap::mapping
