#include <cmath>
#include <numbers>

#include "scenery/facade.hpp"

namespace stillmap::simulation {
namespace {

constexpr double kRailing = 0.95;

/// Flat bars from (0, 0) along x; the rays go between them.
void add_railing(const WallPlane& side, double length_m, double foot_z, const FacadeStyle& style) {
  constexpr double kSpacing = 0.13;
  constexpr double kHalfBar = 0.007;
  const int count = static_cast<int>(length_m / kSpacing);
  for (int i = 0; i <= count; ++i) {
    const double x = kHalfBar + i * (length_m - 2.0 * kHalfBar) / count;
    side.upright({x - kHalfBar, x + kHalfBar, foot_z + 0.08, foot_z + kRailing - 0.04}, 0.0,
                 style.metal);
  }
  side.upright({0.0, length_m, foot_z + 0.06, foot_z + 0.09}, 0.0, style.metal);
  side.ledge({0.0, length_m, foot_z + kRailing - 0.04, foot_z + kRailing}, 0.04, style.metal);
}

}  // namespace

void add_balcony(const WallPlane& plane, const WallRect& place, double out_m, bool solid,
                 const FacadeStyle& style) {
  constexpr double kSlab = 0.16;
  constexpr double kQuarter = 0.5 * std::numbers::pi;
  const double foot = place.low;
  plane.box({place.left, -out_m, foot - kSlab}, {place.right, -0.001, foot}, style.trim);
  const double y = -out_m + 0.04;
  if (solid) {
    plane.box({place.left, y, foot}, {place.right, y + 0.06, foot + kRailing}, style.trim);
    for (const double x : {place.left, place.right - 0.06})
      plane.box({x, y, foot}, {x + 0.06, -0.001, foot + kRailing}, style.trim);
    return;
  }
  add_railing(plane.moved({place.left, y, 0.0}), place.width(), foot, style);
  add_railing(plane.moved({place.left + 0.04, 0.0, 0.0}, -kQuarter), out_m - 0.04, foot, style);
  add_railing(plane.moved({place.right - 0.04, y, 0.0}, kQuarter), out_m - 0.04, foot, style);
}

void add_bay(const WallPlane& plane, const WallRect& piece, double floor_z, double out_m,
             const FacadeStyle& style, Random& random) {
  constexpr double kQuarter = 0.5 * std::numbers::pi;
  constexpr double kInner = 0.15;
  const WallRect bay{piece.left + 0.35, piece.right - 0.35, piece.low, piece.high};
  plane.pierced(piece, {bay.left + kInner, bay.right - kInner, floor_z + 0.05, bay.high - 0.1},
                kInner);
  const WallPlane front = plane.moved({bay.left, -out_m, 0.0});
  const WallRect face{0.0, bay.width(), bay.low, bay.high};
  add_window(front, face, window_edge(face, floor_z, style), style, true, random);
  const WallRect cheek{0.0, out_m, bay.low, bay.high};
  const WallRect pane = window_edge(face, floor_z, style);
  for (const bool left : {true, false}) {
    const WallPlane side = left ? plane.moved({bay.left, 0.0, 0.0}, -kQuarter)
                                : plane.moved({bay.right, -out_m, 0.0}, kQuarter);
    if (out_m < 0.5) {
      side.upright(cheek, 0.0, style.wall);
      continue;
    }
    side.pierced(cheek, {0.15, out_m - 0.12, pane.low, pane.high}, 0.1);
    side.upright({0.15, out_m - 0.12, pane.low, pane.high}, 0.1, Surface::kWindow);
  }
  for (const double z : {bay.low, bay.high})
    plane.level(bay.left, bay.right, -out_m, 0.0, z, style.trim);
}

void add_canopy(const WallPlane& plane, double middle_x, double z, const FacadeStyle& style,
                Random& random) {
  const double half = random.uniform(0.8, 1.2);
  const double out_m = random.uniform(0.8, 1.3);
  const double left = middle_x - half;
  const double right = middle_x + half;
  const double high = z + 0.15 + 0.3 * out_m;
  plane.quad({left, -out_m, z + 0.15}, {right, -out_m, z + 0.15}, {right, 0.0, high},
             {left, 0.0, high}, style.roof);
  plane.upright({left, right, z, z + 0.15}, -out_m, style.trim);
  plane.level(left, right, -out_m, 0.0, z, style.trim);
  for (const double x : {left, right})
    plane.quad({x, 0.0, z}, {x, -out_m, z}, {x, -out_m, z + 0.15}, {x, 0.0, high}, style.trim);
}

void add_rain_pipe(const WallPlane& plane, double x, double top_z, const FacadeStyle& style) {
  constexpr double kRadius = 0.05;
  plane.pipe({x, -0.09, 0.0}, {x, -0.09, top_z}, kRadius, style.metal);
}

}  // namespace stillmap::simulation
