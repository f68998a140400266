#pragma once

#include <vector>

#include "scenery/buildings.hpp"
#include "scenery/roof.hpp"

namespace stillmap::simulation {

/// Box of walls that a building is made of. Its frame starts at the left end of its front.
struct BuildingBody {
  WallPlane front;
  double width, depth;
  /// Heights of the floors, and last the height of the walls' top [m].
  std::vector<double> levels;
  FacadeStyle style;

  [[nodiscard]] int floors() const { return static_cast<int>(levels.size()) - 1; }
  [[nodiscard]] double floor_z(int floor) const { return levels[static_cast<std::size_t>(floor)]; }
  [[nodiscard]] double top_z() const { return levels.back(); }
  /// The piece of a wall that one floor takes; the lowest reaches into the ground.
  [[nodiscard]] WallRect piece(int floor, double left, double right) const {
    return {left, right, floor == 0 ? kFoundationZ : floor_z(floor), floor_z(floor + 1)};
  }
};

struct FloorHeights {
  double base_m, ground_floor_m, upper_floor_m;
};
[[nodiscard]] std::vector<double> floor_levels(const FloorHeights& heights, int floors);

/// Floors, and the walls behind the rooms at the front and at the back: what rays that pass a
/// window come back from.
void add_rooms(const BuildingBody& body, Random& random);

/// Share of the pieces of a wall that have a window.
struct WindowShares {
  double left, right, back;
};
/// Walls other than the front.
void add_other_walls(const BuildingBody& body, const WindowShares& shares, Random& random);

/// Strip at the foot of the front, between doors.
void add_plinth(const BuildingBody& body, double left, double right, double height_m);

void add_house(const WallPlane& front, const BuildingShape& shape, Random& random);
/// Flats, over shops or not.
void add_flats(const WallPlane& front, const BuildingShape& shape, Random& random);
void add_hall(const WallPlane& front, const BuildingShape& shape, Random& random);

}  // namespace stillmap::simulation
