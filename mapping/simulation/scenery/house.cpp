#include <algorithm>
#include <cmath>
#include <numbers>

#include "scenery/building_body.hpp"

namespace stillmap::simulation {
namespace {

// Room for the eaves beside the walls, which must stay on the plot.
constexpr double kInset = 0.45;

void add_house_front(const BuildingBody& body, Random& random) {
  const double plinth = random.uniform(0.3, 0.8);
  const int columns = std::clamp(static_cast<int>(std::lround(body.width / 2.8)), 2, 4);
  const double step = body.width / columns;
  const auto door_column = static_cast<int>(random.index(static_cast<std::size_t>(columns)));
  const int bay_column = random.chance(0.35) ? (door_column + 1) % columns : -1;
  for (int floor = 0; floor < body.floors(); ++floor) {
    for (int column = 0; column < columns; ++column) {
      const WallRect piece = body.piece(floor, column * step, (column + 1) * step);
      const double floor_z = body.floor_z(floor);
      if (floor == 0 && column == door_column) {
        const WallRect door = add_entrance(body.front, piece, floor_z, body.style, random);
        add_plinth(body, piece.left, door.left, plinth);
        add_plinth(body, door.right, piece.right, plinth);
        if (random.chance(0.7))
          add_canopy(body.front, piece.middle(), std::max(door.high + 0.1, 2.35), body.style,
                     random);
        continue;
      }
      if (floor == 0) add_plinth(body, piece.left, piece.right, plinth);
      if (column == bay_column && floor == 0) {
        add_bay(body.front, piece, floor_z, 0.28, body.style, random);
      } else {
        add_window(body.front, piece, window_edge(piece, floor_z, body.style), body.style, true,
                   random);
      }
    }
  }
}

/// Garage beside the house, lower than it.
void add_garage(const WallPlane& corner, double width, double depth, const FacadeStyle& style,
                Random& random) {
  const double top = random.uniform(2.5, 2.9);
  const WallRect front{0.0, width, kFoundationZ, top};
  const double half = std::min(1.25, 0.5 * width - 0.2);
  add_gate(corner, front, {0.5 * width - half, 0.5 * width + half, 0.02, 2.15}, style, random);
  for (const double x : {0.0, width}) {
    corner.quad({x, 0, kFoundationZ}, {x, depth, kFoundationZ}, {x, depth, top}, {x, 0, top},
                style.wall);
  }
  corner.upright(front, depth, style.wall);
  corner.level(0.0, width, -0.15, depth, top, style.roof);
  corner.ledge({0.0, width, top - 0.2, top}, 0.15, style.trim);
}

void add_house_top(const BuildingBody& body, Random& random) {
  const double slope = random.uniform(0.5, 0.95);
  const double u = random.uniform();
  const double out = random.uniform(0.2, 0.3);
  RoofShape roof{RoofKind::kGable, body.width, body.depth, body.top_z(), slope, out, out};
  WallPlane frame = body.front;
  const bool turned = u < 0.5 ? body.width < body.depth && u > 0.35 : body.width < body.depth;
  if (turned) {
    // The ridge runs away from the street.
    frame = frame.moved({body.width, 0.0, 0.0}, 0.5 * std::numbers::pi);
    std::swap(roof.width, roof.depth);
  }
  if (u >= 0.6) roof.kind = RoofKind::kHip;
  add_roof(frame, roof, body.style);
  add_chimney(frame, roof, random);
  if (!turned && roof.kind == RoofKind::kGable && random.chance(0.5))
    add_dormer(frame, roof, random.uniform(0.3, 0.7) * roof.width, body.style, random);
}

}  // namespace

void add_house(const WallPlane& front, const BuildingShape& shape, Random& random) {
  const FacadeStyle style = draw_style(Surface::kWall, random);
  const FloorHeights heights{random.uniform(0.1, 0.5), random.uniform(2.6, 2.9),
                             random.uniform(2.5, 2.8)};
  const bool garage = shape.width > 10.0 && random.chance(0.5);
  const bool garage_left = random.chance(0.5);
  const double garage_width = garage ? random.uniform(3.0, 3.4) : 0.0;
  const double width = shape.width - 2.0 * kInset - garage_width;
  const double left = -0.5 * shape.width + kInset;
  const WallPlane own = front.with(style.wall);
  const BuildingBody body{own.moved({left + (garage_left ? garage_width : 0.0), 0.0, 0.0}), width,
                          shape.depth, floor_levels(heights, std::min(shape.floors, 2)), style};
  add_house_front(body, random);
  add_other_walls(body, {0.4, 0.4, 0.6}, random);
  add_rooms(body, random);
  add_house_top(body, random);
  add_rain_pipe(body.front, random.chance(0.5) ? 0.1 : width - 0.1, body.top_z() - 0.2, style);
  if (!garage) return;
  const double setting_back = random.uniform(0.0, 0.6);
  add_garage(own.moved({garage_left ? left : left + width, setting_back, 0.0}), garage_width,
             random.uniform(5.0, 6.5), style, random);
}

}  // namespace stillmap::simulation
