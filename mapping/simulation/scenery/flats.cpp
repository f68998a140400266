#include <algorithm>
#include <cmath>

#include "scenery/building_body.hpp"

namespace stillmap::simulation {
namespace {

enum class Column { kPlain, kBalcony, kBay };

struct FlatsPlan {
  bool shop;
  int columns, door_column;
  double plinth_m, out_m;
  bool awnings, solid_balconies, string_courses;
  std::vector<Column> kinds;
};

FlatsPlan draw_plan(const BuildingShape& shape, Random& random) {
  FlatsPlan plan;
  plan.shop = shape.kind == BuildingKind::kShop;
  const double spacing = plan.shop ? random.uniform(3.2, 4.2) : random.uniform(2.6, 3.4);
  plan.columns = std::max(2, static_cast<int>(std::lround(shape.width / spacing)));
  const auto count = static_cast<std::size_t>(plan.columns);
  plan.door_column = static_cast<int>(random.index(count));
  plan.plinth_m = random.uniform(0.3, 0.8);
  plan.out_m = random.uniform(0.9, 1.4);
  plan.awnings = random.chance(0.5);
  plan.solid_balconies = random.chance(0.3);
  plan.string_courses = random.chance(0.5);
  plan.kinds.assign(count, Column::kPlain);
  const double u = random.uniform();
  if (u < 0.45) plan.kinds[random.index(count)] = Column::kBalcony;
  if (u < 0.25) plan.kinds[random.index(count)] = Column::kBalcony;
  if (u > 0.7) plan.kinds[random.index(count)] = Column::kBay;
  return plan;
}

void add_ground_floor(const BuildingBody& body, const FlatsPlan& plan, Random& random) {
  const double step = body.width / plan.columns;
  for (int column = 0; column < plan.columns; ++column) {
    const WallRect piece = body.piece(0, column * step, (column + 1) * step);
    if (column == plan.door_column) {
      const WallRect door = add_entrance(body.front, piece, body.floor_z(0), body.style, random);
      add_plinth(body, piece.left, door.left, plan.plinth_m);
      add_plinth(body, door.right, piece.right, plan.plinth_m);
    } else if (plan.shop) {
      add_shop_window(body.front, piece, body.style, plan.awnings && random.chance(0.7), random);
    } else {
      const WallRect edge = window_edge(piece, body.floor_z(0), body.style);
      add_window(body.front, piece, edge, body.style, true, random);
      add_plinth(body, piece.left, piece.right, plan.plinth_m);
    }
  }
}

void add_upper_piece(const BuildingBody& body, const FlatsPlan& plan, int floor, int column,
                     Random& random) {
  const double step = body.width / plan.columns;
  const WallRect piece = body.piece(floor, column * step, (column + 1) * step);
  const double floor_z = body.floor_z(floor);
  const Column kind = plan.kinds[static_cast<std::size_t>(column)];
  if (kind == Column::kBay)
    return add_bay(body.front, piece, floor_z, std::min(0.8, plan.out_m - 0.4), body.style, random);
  WallRect edge = window_edge(piece, floor_z, body.style);
  if (kind == Column::kBalcony) {
    edge.low = floor_z + 0.05;
    add_balcony(body.front, {piece.left + 0.15, piece.right - 0.15, floor_z, floor_z}, plan.out_m,
                plan.solid_balconies, body.style);
  }
  add_window(body.front, piece, edge, body.style, true, random);
}

void add_courses(const BuildingBody& body, const FlatsPlan& plan, Random& random) {
  constexpr double kHeight = 0.12;
  for (int floor = 1; floor < body.floors() && plan.string_courses; ++floor) {
    const double z = body.floor_z(floor);
    body.front.ledge({0.0, body.width, z - kHeight, z}, 0.05, body.style.trim);
  }
  const double high = random.uniform(0.2, 0.4);
  body.front.ledge({0.0, body.width, body.top_z() - high, body.top_z()}, random.uniform(0.08, 0.2),
                   body.style.trim);
}

void add_top(const BuildingBody& body, const FlatsPlan& plan, Random& random) {
  const RoofKind kind = random.chance(0.3) ? RoofKind::kFlat : RoofKind::kGable;
  const RoofShape roof{kind,
                       body.width,
                       body.depth,
                       body.top_z(),
                       random.uniform(0.55, 1.0),
                       random.uniform(0.25, 0.5),
                       0.0};
  add_roof(body.front, roof, body.style);
  const auto chimneys = static_cast<int>(1 + random.index(3));
  for (int i = 0; i < chimneys; ++i) add_chimney(body.front, roof, random);
  if (kind == RoofKind::kFlat || !random.chance(0.5)) return;
  const double step = body.width / plan.columns;
  for (int column = 0; column < plan.columns; ++column) {
    if (random.chance(0.6)) add_dormer(body.front, roof, (column + 0.5) * step, body.style, random);
  }
}

}  // namespace

void add_flats(const WallPlane& front, const BuildingShape& shape, Random& random) {
  const FlatsPlan plan = draw_plan(shape, random);
  const FacadeStyle style = draw_style(Surface::kWall, random);
  const FloorHeights heights =
      plan.shop ? FloorHeights{random.uniform(0.05, 0.15), random.uniform(3.6, 4.2),
                               random.uniform(2.7, 3.1)}
                : FloorHeights{random.uniform(0.1, 0.5), random.uniform(2.8, 3.5),
                               random.uniform(2.7, 3.1)};
  const WallPlane own(front.with(style.wall).moved({-0.5 * shape.width, 0.0, 0.0}));
  const BuildingBody body{own, shape.width, shape.depth, floor_levels(heights, shape.floors),
                          style};
  add_ground_floor(body, plan, random);
  for (int floor = 1; floor < body.floors(); ++floor)
    for (int column = 0; column < plan.columns; ++column)
      add_upper_piece(body, plan, floor, column, random);
  add_courses(body, plan, random);
  // Most side walls are party walls.
  add_other_walls(
      body,
      {random.chance(0.4) ? 0.4 : 0.0, random.chance(0.4) ? 0.4 : 0.0, random.uniform(0.4, 0.8)},
      random);
  add_rooms(body, random);
  add_top(body, plan, random);
  add_rain_pipe(body.front, random.chance(0.5) ? 0.15 : body.width - 0.15, body.top_z() - 0.2,
                style);
}

}  // namespace stillmap::simulation
