#include <algorithm>
#include <cmath>

#include "scenery/building_body.hpp"

namespace stillmap::simulation {
namespace {

/// Strip of windows under the eaves.
void add_high_windows(const BuildingBody& body, const WallRect& piece, Random& random) {
  const double high = piece.high - random.uniform(0.5, 0.8);
  add_window(body.front, piece, {piece.left + 0.4, piece.right - 0.4, high - 1.0, high}, body.style,
             false, random);
}

void add_hall_front(const BuildingBody& body, Random& random) {
  const int panels = std::max(2, static_cast<int>(std::lround(body.width / 5.0)));
  const double step = body.width / panels;
  const auto door_panel = static_cast<int>(random.index(static_cast<std::size_t>(panels)));
  const bool windows = random.chance(0.6);
  const double gate_high = std::min(random.uniform(3.2, 4.5), body.top_z() - 1.0);
  for (int panel = 0; panel < panels; ++panel) {
    const WallRect piece{panel * step, (panel + 1) * step, kFoundationZ, body.top_z()};
    if (panel == door_panel) {
      add_entrance(body.front, piece, body.floor_z(0), body.style, random);
    } else if (random.chance(0.4)) {
      const double half = std::min(random.uniform(1.6, 2.2), 0.5 * step - 0.3);
      add_gate(body.front, piece, {piece.middle() - half, piece.middle() + half, 0.02, gate_high},
               body.style, random);
    } else if (windows) {
      add_high_windows(body, piece, random);
    } else {
      body.front.upright(piece, 0.0, body.style.wall);
    }
  }
}

/// Posts between the panels and rails along them.
void add_relief(const BuildingBody& body, Random& random) {
  const int panels = std::max(2, static_cast<int>(std::lround(body.width / 5.0)));
  const double out_m = random.uniform(0.05, 0.15);
  constexpr double kHalf = 0.15;
  for (int i = 0; i <= panels; ++i) {
    const double x = std::clamp(i * body.width / panels, kHalf, body.width - kHalf);
    body.front.box({x - kHalf, -out_m, kFoundationZ}, {x + kHalf, -0.001, body.top_z()},
                   body.style.trim);
  }
  body.front.ledge({0.0, body.width, body.top_z() - 0.1, body.top_z() + 0.5}, 0.2, body.style.trim);
}

}  // namespace

void add_hall(const WallPlane& front, const BuildingShape& shape, Random& random) {
  FacadeStyle style = draw_style(Surface::kHall, random);
  style.curtains = 0.0;
  style.shutters = 0.0;
  const double height = random.uniform(5.5, 7.5) + 3.0 * (std::clamp(shape.floors, 1, 3) - 1);
  const WallPlane own = front.with(style.wall).moved({-0.5 * shape.width, 0.0, 0.0});
  const BuildingBody body{
      own, shape.width, shape.depth, {random.uniform(0.05, 0.2), height}, style};
  add_hall_front(body, random);
  add_relief(body, random);
  add_other_walls(body, {0.0, 0.0, 0.3}, random);
  add_rooms(body, random);
  const RoofShape roof{RoofKind::kFlat, body.width, body.depth, body.top_z(), 0.0, 0.0, 0.0};
  add_roof(body.front, roof, style);
  add_rain_pipe(body.front, 0.45, body.top_z() - 0.2, style);
  add_rain_pipe(body.front, body.width - 0.45, body.top_z() - 0.2, style);
}

}  // namespace stillmap::simulation
