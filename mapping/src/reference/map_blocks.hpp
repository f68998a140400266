#pragma once

#include <Eigen/Core>

#include <cstdint>
#include <vector>

namespace stillmap::mapping {

/// Points of a map in cubes, each with its bounding box, so that a scan meets only the cubes
/// that matter to it.
struct MapBlocks {
  struct Block {
    Eigen::Vector3f centre = Eigen::Vector3f::Zero();
    /// Half of the edges of the box around its points [m].
    Eigen::Vector3f half_edge = Eigen::Vector3f::Zero();
    std::uint32_t begin = 0;
    std::uint32_t end = 0;
  };

  /// Points [m], sorted by block.
  std::vector<Eigen::Vector3f> positions;
  /// Where each of them was in the points as they were given.
  std::vector<std::uint32_t> given_index;
  std::vector<Block> blocks;

  /// @param points  finite [m]. @param edge_m  of a cube, > 0.
  /// @throws std::invalid_argument as PointCells does.
  [[nodiscard]] static MapBlocks of(const std::vector<Eigen::Vector3f>& points, double edge_m);
  /// Those whose flag is set; flags in the order of the points as they were given.
  [[nodiscard]] MapBlocks subset(const std::vector<std::uint8_t>& keep) const;
};

}  // namespace stillmap::mapping
