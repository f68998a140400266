#include "pipeline/tile_window.hpp"

#include "core/ordered_pipeline.hpp"

#include <utility>

namespace stillmap::mapping {

Eigen::AlignedBox2f area_of(maps::TileId id) {
  constexpr auto kSide = static_cast<float>(maps::kTileSizeM);
  const Eigen::Vector2f corner(static_cast<float>(id.x) * kSide, static_cast<float>(id.y) * kSide);
  return {corner, corner + Eigen::Vector2f::Constant(kSide)};
}

void TileWindow::move_to(std::int32_t x, int threads) {
  std::erase_if(open_, [x](const auto& each) { return each.first.x < x - 1; });
  std::vector<maps::TileId> wanted;
  for (; passed_ < tiles_.size() && tiles_[passed_].x <= x + 1; ++passed_)
    if (tiles_[passed_].x >= x - 1) wanted.push_back(tiles_[passed_]);
  const CancelFlag never(false);
  process_in_order(
      wanted.size(), threads,
      [&](std::size_t i) {
        OpenTile tile;
        tile.sums = kept_.contains(wanted[i]) ? stack_.read(wanted[i]) : stack_.take(wanted[i]);
        tile.points = cleaning_points(grid_, wanted[i], tile.sums, tile.numbers);
        return std::pair(wanted[i], std::move(tile));
      },
      [&](std::pair<maps::TileId, OpenTile> tile) { open_.insert(std::move(tile)); }, never);
}

CleaningPoints TileWindow::with_rim(maps::TileId id, double rim_m) const {
  CleaningPoints all = open_.at(id).points;
  Eigen::AlignedBox2f wanted = area_of(id);
  wanted.min().array() -= static_cast<float>(rim_m);
  wanted.max().array() += static_cast<float>(rim_m);
  for (int step = 0; step < 9; ++step) {
    const auto neighbour = open_.find({id.level, id.x + step % 3 - 1, id.y + step / 3 - 1});
    if (step == 4 || neighbour == open_.end()) continue;
    const CleaningPoints& points = neighbour->second.points;
    for (std::size_t i = 0; i < points.positions.size(); ++i) {
      if (!wanted.contains(Eigen::Vector2f(points.positions[i].head<2>()))) continue;
      all.positions.push_back(points.positions[i]);
      all.is_ground.push_back(points.is_ground[i]);
      all.scans.push_back(points.scans[i]);
    }
  }
  return all;
}

}  // namespace stillmap::mapping
