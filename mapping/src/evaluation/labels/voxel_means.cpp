#include "evaluation/labels/voxel_means.hpp"

#include <bit>
#include <cmath>
#include <stdexcept>

namespace stillmap::mapping {
namespace {

constexpr std::int64_t kHalf = 1 << 20;
constexpr std::uint64_t kAxis = 0x1FFFFF;

}  // namespace

VoxelMeans::VoxelMeans(double edge_m) : edge_m_(edge_m), inverse_edge_(1.0 / edge_m) {
  if (!(edge_m > 0.0)) throw std::invalid_argument("voxel means: edge, expected > 0");
  slots_.assign(1024, 0);
}

std::size_t VoxelMeans::slot_of(std::uint64_t key) const {
  // Fibonacci hashing: the high bits of the product depend on all bits of the key.
  std::size_t slot = (key * 0x9E3779B97F4A7C15ULL) >>
                     (64U - static_cast<unsigned>(std::countr_zero(slots_.size())));
  while (slots_[slot] != 0 && sums_[slots_[slot] - 1].key != key)
    slot = (slot + 1) & (slots_.size() - 1);
  return slot;
}

void VoxelMeans::grow() {
  slots_.assign(2 * slots_.size(), 0);
  for (std::size_t i = 0; i < sums_.size(); ++i)
    slots_[slot_of(sums_[i].key)] = static_cast<std::uint32_t>(i) + 1;
}

void VoxelMeans::add(const Eigen::Vector3f& position) {
  const Eigen::Array3d p = position.cast<double>().array();
  const Eigen::Array3d cell = (p * inverse_edge_).floor();
  std::uint64_t key = 0;
  for (Eigen::Index axis = 0; axis < 3; ++axis)
    key = (key << 21U) |
          (static_cast<std::uint64_t>(static_cast<std::int64_t>(cell[axis]) + kHalf) & kAxis);
  std::size_t slot = slot_of(key);
  if (slots_[slot] == 0) {
    if (3 * (sums_.size() + 1) > 2 * slots_.size()) {
      grow();
      slot = slot_of(key);
    }
    sums_.push_back({.key = key});
    slots_[slot] = static_cast<std::uint32_t>(sums_.size());
  }
  Sum& sum = sums_[slots_[slot] - 1];
  sum.offset += (p - cell * edge_m_).cast<float>().matrix();
  ++sum.points;
}

std::vector<Eigen::Vector3f> VoxelMeans::take() {
  slots_ = {};
  std::vector<Eigen::Vector3f> means;
  means.reserve(sums_.size());
  for (const Sum& sum : sums_) {
    Eigen::Array3d low;
    for (Eigen::Index axis = 0; axis < 3; ++axis) {
      const auto cell =
          static_cast<std::int64_t>(sum.key >> (21U * static_cast<unsigned>(2 - axis)) & kAxis);
      low[axis] = static_cast<double>(cell - kHalf) * edge_m_;
    }
    const Eigen::Array3d mean = sum.offset.cast<double>().array() / static_cast<double>(sum.points);
    means.push_back((low + mean).cast<float>().matrix());
  }
  sums_.clear();
  slots_.assign(1024, 0);
  return means;
}

}  // namespace stillmap::mapping
