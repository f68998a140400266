#include "index/index_window.hpp"

#include "index_grid.hpp"

#include <cstddef>
#include <cstdint>

namespace stillmap::localization {
namespace {

/// Where heights of the window count from: where the region in the middle has them.
std::int32_t floor_of(maps::RegionId middle, const IndexWindow::Regions& regions) {
  for (const auto& [id, region] : regions)
    if (id == middle) return region->view.floor;
  return regions.empty() ? 0 : regions.front().second->view.floor;
}

}  // namespace

IndexWindow::IndexWindow(const Eigen::Vector3d& origin_map, maps::RegionId middle, Regions regions,
                         const MapIndexOptions& options)
    : regions_(std::move(regions)), middle_(middle) {
  const std::int32_t floor = floor_of(middle, regions_);
  const Eigen::Vector2d corner = corner_of(middle);
  origin_ = origin_map + Eigen::Vector3d(corner.x(), corner.y(), kRegionM * floor);
  for (int level = 0; level < options.levels; ++level) {
    const double edge_m = edge_of_level(options, static_cast<std::size_t>(level));
    std::vector<CellBlocks::Part> parts;
    for (const auto& [id, region] : regions_) {
      parts.push_back(region->view.levels[static_cast<std::size_t>(level)]);
      parts.back().first_cell =
          cells_of_region(edge_m) *
          Eigen::Array3i(id.x - middle.x, id.y - middle.y, region->view.floor - floor);
    }
    levels_.push_back({static_cast<float>(edge_m),
                       CellBlocks(parts, tile_shift_of(edge_m), static_cast<float>(edge_m))});
  }
}

const std::vector<CellBits>& IndexWindow::place_grids() const {
  std::call_once(grids_made_, [this] {
    for (std::size_t grid = 0; grid < kPlaceGridEdgesM.size(); ++grid) {
      std::vector<CellBits::Part> parts;
      for (const auto& [id, region] : regions_) {
        parts.push_back(region->view.place_grids[grid]);
        parts.back().x = static_cast<std::uint32_t>(id.x - middle_.x + 1);
        parts.back().y = static_cast<std::uint32_t>(id.y - middle_.y + 1);
      }
      place_grids_.emplace_back(kPlaceGridEdgesM[grid], parts);
    }
  });
  return place_grids_;
}

}  // namespace stillmap::localization
