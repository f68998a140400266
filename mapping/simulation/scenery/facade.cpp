#include "scenery/facade.hpp"

#include <algorithm>
#include <cmath>

namespace stillmap::simulation {
namespace {

void add_bars(const WallPlane& plane, const WallRect& edge, const FacadeStyle& style) {
  constexpr double kHalfBar = 0.035;
  const double y = style.window_depth_m - 0.03;
  const double x = edge.middle();
  if (edge.width() > 0.8)
    plane.upright({x - kHalfBar, x + kHalfBar, edge.low, edge.high}, y, style.frame);
  if (!style.has_transom) return;
  const double z = edge.high - 0.3 * (edge.high - edge.low);
  plane.upright({edge.left, edge.right, z - kHalfBar, z + kHalfBar}, y, style.frame);
}

/// A curtain over the whole window, or drawn aside.
void add_curtain(const WallPlane& plane, const WallRect& edge, double glass_y, Random& random) {
  const double y = glass_y + random.uniform(0.1, 0.4);
  const Material cloth(Surface::kCurtain, random.uniform(0.7, 1.4));
  constexpr double kBeyond = 0.08;
  WallRect rect{edge.left - kBeyond, edge.right + kBeyond, edge.low, edge.high};
  if (random.chance(0.4)) return plane.upright(rect, y, cloth);
  const double share = random.uniform(0.15, 0.4);
  plane.upright({rect.left, rect.left + share * rect.width(), rect.low, rect.high}, y, cloth);
  plane.upright({rect.right - share * rect.width(), rect.right, rect.low, rect.high}, y, cloth);
}

void add_steps(const WallPlane& plane, const WallRect& door, double floor_z, const Material& m) {
  constexpr double kRise = 0.17;
  constexpr double kGoing = 0.28;
  constexpr double kBeside = 0.15;
  const int count = static_cast<int>(std::ceil(floor_z / kRise)) - 1;
  for (int i = 0; i < count; ++i) {
    const double high = floor_z - (i + 1) * floor_z / (count + 1);
    plane.box({door.left - kBeside, -kGoing * (i + 1), kFoundationZ},
              {door.right + kBeside, -kGoing * i - 0.002, high}, m);
  }
}

/// Cloth on two arms; its lower edge stays above the heads.
void add_awning(const WallPlane& plane, const WallRect& window, const FacadeStyle& style,
                Random& random) {
  const double out_m = random.uniform(0.8, 1.4);
  const double top = window.high + 0.1;
  const double low = std::max(2.5, top - random.uniform(0.35, 0.6));
  const Material cloth(Surface::kWall, random.uniform(0.5, 1.6));
  const double left = window.left - 0.1;
  const double right = window.right + 0.1;
  plane.quad({left, -0.05, top}, {right, -0.05, top}, {right, -out_m, low}, {left, -out_m, low},
             cloth);
  plane.upright({left, right, low - 0.15, low}, -out_m, cloth);
  for (const double x : {left + 0.1, right - 0.1})
    plane.pipe({x, 0.0, 2.4}, {x, -out_m + 0.03, low - 0.03}, 0.015, style.metal);
}

}  // namespace

FacadeStyle draw_style(Surface wall, Random& random) {
  const double brightness = random.uniform(0.55, 1.6);
  const auto near = [&](double spread) {
    return brightness * random.uniform(1.0 - spread, 1.0 + spread);
  };
  return {.wall = Material(wall, brightness),
          .trim = Material(Surface::kWall, near(0.3)),
          .plinth = Material(Surface::kWall, random.uniform(0.4, 0.9)),
          .frame = Material(Surface::kDoor, random.uniform(0.5, 1.9)),
          .metal = Material(Surface::kDoor, random.uniform(0.5, 1.5)),
          .door = Material(Surface::kDoor, random.uniform(0.4, 1.8)),
          .roof = Material(Surface::kRoof, random.uniform(0.6, 1.5)),
          .window_width_m = random.uniform(0.9, 1.5),
          .window_height_m = random.uniform(1.2, 1.7),
          .window_depth_m = random.uniform(0.10, 0.25),
          .door_depth_m = random.uniform(0.20, 0.40),
          .has_transom = random.chance(0.4),
          .curtains = random.uniform(0.3, 0.8),
          .shutters = random.chance(0.5) ? random.uniform(0.1, 0.5) : 0.0};
}

WallRect window_edge(const WallRect& piece, double floor_z, const FacadeStyle& style) {
  constexpr double kParapet = 0.9;
  const double half = 0.5 * std::min(style.window_width_m, piece.width() - 0.4);
  const double low = floor_z + kParapet;
  const double high = std::min(low + style.window_height_m, piece.high - 0.2);
  return {piece.middle() - half, piece.middle() + half, low, high};
}

void add_window(const WallPlane& plane, const WallRect& piece, const WallRect& edge,
                const FacadeStyle& style, bool fine, Random& random) {
  const double y = style.window_depth_m;
  plane.pierced(piece, edge, y);
  plane.upright(edge, y, Surface::kWindow);
  if (fine) {
    add_bars(plane, edge, style);
    plane.ledge({edge.left - 0.05, edge.right + 0.05, edge.low - 0.05, edge.low}, 0.05, style.trim);
  }
  if (random.chance(style.curtains)) add_curtain(plane, edge, y, random);
  if (!random.chance(style.shutters)) return;
  const double down = random.uniform(0.2, 1.0) * (edge.high - edge.low);
  plane.upright({edge.left, edge.right, edge.high - down, edge.high}, y - 0.05, style.frame);
}

WallRect add_entrance(const WallPlane& plane, const WallRect& piece, double floor_z,
                      const FacadeStyle& style, Random& random) {
  const double half = random.uniform(0.5, 0.8);
  const double high = std::min(floor_z + random.uniform(2.1, 2.5), piece.high - 0.1);
  const WallRect door{piece.middle() - half, piece.middle() + half, floor_z, high};
  plane.pierced(piece, door, style.door_depth_m);
  plane.upright(door, style.door_depth_m, style.door);
  // The panels and the handle give it some relief.
  const double x = door.left + 0.12;
  plane.box({x, style.door_depth_m - 0.08, floor_z + 1.0},
            {x + 0.03, style.door_depth_m - 0.01, floor_z + 1.15}, style.metal);
  add_steps(plane, door, floor_z, style.plinth);
  return door;
}

void add_gate(const WallPlane& plane, const WallRect& piece, const WallRect& edge,
              const FacadeStyle& style, Random& random) {
  const double y = style.door_depth_m;
  plane.pierced(piece, edge, y);
  plane.upright(edge, y, style.door);
  // Sections of the gate, seen as ribs.
  const int ribs = static_cast<int>(std::lround((edge.high - edge.low) / random.uniform(0.5, 0.8)));
  for (int i = 1; i < ribs; ++i) {
    const double z = edge.low + i * (edge.high - edge.low) / ribs;
    plane.upright({edge.left, edge.right, z - 0.04, z + 0.04}, y - 0.03, style.door);
  }
}

void add_shop_window(const WallPlane& plane, const WallRect& piece, const FacadeStyle& style,
                     bool has_awning, Random& random) {
  const double side = random.uniform(0.15, 0.3);
  const WallRect pane{piece.left + side, piece.right - side, random.uniform(0.25, 0.6),
                      std::min(random.uniform(2.6, 2.9), piece.high - 0.6)};
  const double y = style.window_depth_m;
  plane.pierced(piece, pane, y);
  plane.upright(pane, y, Surface::kWindow);
  add_bars(plane, pane, style);
  // Goods or the back of the display.
  const double goods = random.uniform(0.3, 0.9) * pane.width();
  const double left = pane.left + random.uniform() * (pane.width() - goods);
  const double behind = y + random.uniform(0.3, 0.9);
  plane.box({left, behind, pane.low}, {left + goods, behind + 0.4, random.uniform(0.8, 1.6)},
            Material(Surface::kCurtain, random.uniform(0.5, 1.8)));
  const double board = random.uniform(0.35, 0.5);
  plane.ledge({pane.left, pane.right, pane.high + 0.12, pane.high + 0.12 + board},
              random.uniform(0.05, 0.2), Material(Surface::kWall, random.uniform(0.3, 1.9)));
  if (has_awning) add_awning(plane, pane, style, random);
}

}  // namespace stillmap::simulation
