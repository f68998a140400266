#include "scenery/building_body.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace stillmap::simulation {
namespace {

/// One of the walls that are not the front: plain windows, wall in one sheet where there are none.
void add_other_wall(const WallPlane& wall, double length_m, const BuildingBody& body, double share,
                    Random& random) {
  if (share <= 0.0)
    return wall.upright({0.0, length_m, kFoundationZ, body.top_z()}, 0.0, wall.material());
  constexpr double kSpacing = 3.6;
  const int columns = std::max(1, static_cast<int>(std::lround(length_m / kSpacing)));
  const double step = length_m / columns;
  for (int floor = 0; floor < body.floors(); ++floor) {
    double blank = 0.0;
    for (int column = 0; column < columns; ++column) {
      if (!random.chance(share)) continue;
      const WallRect piece = body.piece(floor, column * step, (column + 1) * step);
      wall.upright({blank, piece.left, piece.low, piece.high}, 0.0, wall.material());
      const WallRect edge = window_edge(piece, body.floor_z(floor), body.style);
      add_window(wall, piece, edge, body.style, false, random);
      blank = piece.right;
    }
    wall.upright(body.piece(floor, blank, length_m), 0.0, wall.material());
  }
}

}  // namespace

std::vector<double> floor_levels(const FloorHeights& heights, int floors) {
  std::vector<double> levels{heights.base_m};
  for (int floor = 0; floor < floors; ++floor)
    levels.push_back(levels.back() + (floor == 0 ? heights.ground_floor_m : heights.upper_floor_m));
  return levels;
}

void add_rooms(const BuildingBody& body, Random& random) {
  const Material paint(Surface::kWall, random.uniform(0.8, 1.6));
  const double room = std::min(random.uniform(2.5, 4.0), 0.4 * body.depth);
  for (const double z : body.levels)
    body.front.level(0.01, body.width - 0.01, 0.01, body.depth - 0.01, z, paint);
  for (int floor = 0; floor < body.floors(); ++floor) {
    for (const double y : {room, body.depth - room}) {
      body.front.upright({0.01, body.width - 0.01, body.floor_z(floor), body.floor_z(floor + 1)}, y,
                         paint);
    }
  }
}

void add_other_walls(const BuildingBody& body, const WindowShares& shares, Random& random) {
  constexpr double kQuarter = 0.5 * std::numbers::pi;
  const WallPlane& front = body.front;
  add_other_wall(front.moved({0.0, body.depth, 0.0}, -kQuarter), body.depth, body, shares.left,
                 random);
  add_other_wall(front.moved({body.width, 0.0, 0.0}, kQuarter), body.depth, body, shares.right,
                 random);
  add_other_wall(front.moved({body.width, body.depth, 0.0}, 2.0 * kQuarter), body.width, body,
                 shares.back, random);
}

void add_plinth(const BuildingBody& body, double left, double right, double height_m) {
  constexpr double kOut = 0.045;
  if (right - left < 0.05) return;
  body.front.ledge({left, right, kFoundationZ, height_m}, kOut, body.style.plinth);
}

}  // namespace stillmap::simulation
