#include "reference/map_blocks.hpp"

#include "core/point_cells.hpp"

#include <algorithm>

namespace stillmap::mapping {
namespace {

void bound(const std::vector<Eigen::Vector3f>& positions, MapBlocks::Block& block) {
  Eigen::Vector3f low = positions[block.begin];
  Eigen::Vector3f high = low;
  for (std::uint32_t i = block.begin; i < block.end; ++i) {
    low = low.cwiseMin(positions[i]);
    high = high.cwiseMax(positions[i]);
  }
  block.centre = 0.5F * (low + high);
  // Rounding must not leave a point outside.
  block.half_edge = (0.5001F * (high - low)).array() + 1e-4F;
}

}  // namespace

MapBlocks MapBlocks::of(const std::vector<Eigen::Vector3f>& points, double edge_m) {
  const PointCells cells(points, edge_m);
  MapBlocks result;
  result.positions = cells.in_cell_order();
  result.given_index = cells.given_index();
  result.blocks.resize(cells.cells());
  for (std::size_t cell = 0; cell < cells.cells(); ++cell) {
    result.blocks[cell].begin = cells.cell(cell).begin;
    result.blocks[cell].end = cells.cell(cell).end;
    bound(result.positions, result.blocks[cell]);
  }
  return result;
}

MapBlocks MapBlocks::subset(const std::vector<std::uint8_t>& keep) const {
  MapBlocks result;
  for (const Block& block : blocks) {
    Block kept;
    kept.begin = static_cast<std::uint32_t>(result.positions.size());
    for (std::uint32_t i = block.begin; i < block.end; ++i) {
      if (keep[given_index[i]] == 0) continue;
      result.positions.push_back(positions[i]);
      result.given_index.push_back(given_index[i]);
    }
    kept.end = static_cast<std::uint32_t>(result.positions.size());
    if (kept.begin == kept.end) continue;
    bound(result.positions, kept);
    result.blocks.push_back(kept);
  }
  return result;
}

}  // namespace stillmap::mapping
