#pragma once

#include "index/index_window.hpp"
#include "index/map_level.hpp"

#include <Eigen/Core>

#include <algorithm>
#include <memory>
#include <tuple>
#include <vector>

namespace stillmap::test {

/// A voxel of a level, and where it lies in its window.
struct FoundVoxel {
  Eigen::Array3i cell;
  Eigen::Vector3f mean;
  const localization::Voxel* voxel = nullptr;
};

/// All voxels of a level, by their cells.
inline std::vector<FoundVoxel> voxels_of(const localization::MapIndex::Level& level) {
  constexpr int kFar = 1 << 24;
  std::vector<FoundVoxel> voxels;
  level.cells.for_each_near(Eigen::Array2i::Constant(-kFar), Eigen::Array2i::Constant(kFar),
                            [&](const Eigen::Array3i& cell, const localization::Voxel& voxel,
                                const localization::CellBlocks::TileView& tile) {
                              voxels.push_back({cell, voxel.mean + tile.corner, &voxel});
                            });
  std::sort(voxels.begin(), voxels.end(), [](const FoundVoxel& a, const FoundVoxel& b) {
    return std::tuple(a.cell.x(), a.cell.y(), a.cell.z()) <
           std::tuple(b.cell.x(), b.cell.y(), b.cell.z());
  });
  return voxels;
}

/// Of a small map near its origin.
inline std::shared_ptr<const localization::IndexWindow> window_of(
    const localization::MapIndex& index) {
  return index.around(index.origin());
}

}  // namespace stillmap::test
