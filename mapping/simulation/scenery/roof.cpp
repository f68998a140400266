#include "scenery/roof.hpp"

#include <algorithm>
#include <numbers>

namespace stillmap::simulation {
namespace {

constexpr double kBoard = 0.14;

/// Board, underside and gutter along an edge of the roof; `frame` has that edge's wall on y = 0.
void add_eave(const WallPlane& frame, double left, double right, const RoofShape& roof,
              const FacadeStyle& style) {
  const double out = roof.eave_out;
  const double z = roof.eave_z - out * roof.slope;
  frame.upright({left, right, z - kBoard, z}, -out, style.trim);
  frame.level(left, right, -out, 0.0, z - kBoard, style.trim);
  constexpr double kGutter = 0.12;
  frame.moved({0.0, -out, 0.0}).ledge({left, right, z - 0.11, z - 0.02}, kGutter, style.metal);
}

void add_gable(const WallPlane& frame, const RoofShape& roof, const FacadeStyle& style) {
  const double middle = 0.5 * roof.depth;
  const double left = -roof.verge_out;
  const double right = roof.width + roof.verge_out;
  const double low = roof.eave_z - roof.eave_out * roof.slope;
  for (const double y : {-roof.eave_out, roof.depth + roof.eave_out}) {
    frame.quad({left, y, low}, {right, y, low}, {right, middle, roof.ridge_z()},
               {left, middle, roof.ridge_z()}, style.roof);
    // Edge boards give the roof its thickness at the gables.
    for (const double x : {left, right}) {
      frame.quad({x, y, low}, {x, y, low - kBoard}, {x, middle, roof.ridge_z() - kBoard},
                 {x, middle, roof.ridge_z()}, style.trim);
    }
  }
  for (const double x : {0.0, roof.width}) {
    frame.triangle({x, 0, roof.eave_z}, {x, roof.depth, roof.eave_z}, {x, middle, roof.ridge_z()},
                   style.wall);
  }
  add_eave(frame, left, right, roof, style);
  add_eave(frame.moved({roof.width, roof.depth, 0.0}, std::numbers::pi), left, right, roof, style);
}

void add_hip(const WallPlane& frame, const RoofShape& roof, const FacadeStyle& style) {
  const double out = roof.eave_out;
  const double low = roof.eave_z - out * roof.slope;
  const double middle = 0.5 * roof.depth;
  const Eigen::Vector3d a(-out, -out, low);
  const Eigen::Vector3d b(roof.width + out, -out, low);
  const Eigen::Vector3d c(roof.width + out, roof.depth + out, low);
  const Eigen::Vector3d d(-out, roof.depth + out, low);
  // All four slopes alike; the ridge is what is left between the two hips.
  const double hip = std::min(middle, 0.5 * roof.width);
  const Eigen::Vector3d left(hip, middle, roof.ridge_z());
  const Eigen::Vector3d right(roof.width - hip, middle, roof.ridge_z());
  frame.quad(a, b, right, left, style.roof);
  frame.quad(c, d, left, right, style.roof);
  frame.triangle(d, a, left, style.roof);
  frame.triangle(b, c, right, style.roof);
  constexpr double kQuarter = 0.5 * std::numbers::pi;
  add_eave(frame, -out, roof.width + out, roof, style);
  add_eave(frame.moved({roof.width, roof.depth, 0.0}, 2.0 * kQuarter), -out, roof.width + out, roof,
           style);
  add_eave(frame.moved({roof.width, 0.0, 0.0}, kQuarter), -out, roof.depth + out, roof, style);
  add_eave(frame.moved({0.0, roof.depth, 0.0}, -kQuarter), -out, roof.depth + out, roof, style);
}

void add_flat(const WallPlane& frame, const RoofShape& roof, const FacadeStyle& style) {
  constexpr double kParapet = 0.5;
  constexpr double kThick = 0.25;
  const double z = roof.eave_z;
  const double w = roof.width;
  const double d = roof.depth;
  frame.level(0.0, w, 0.0, d, z, style.roof);
  frame.box({0, 0, z}, {w, kThick, z + kParapet}, style.wall);
  frame.box({0, d - kThick, z}, {w, d, z + kParapet}, style.wall);
  frame.box({0, kThick, z}, {kThick, d - kThick, z + kParapet}, style.wall);
  frame.box({w - kThick, kThick, z}, {w, d - kThick, z + kParapet}, style.wall);
}

}  // namespace

void add_roof(const WallPlane& frame, const RoofShape& roof, const FacadeStyle& style) {
  if (roof.kind == RoofKind::kGable) return add_gable(frame, roof, style);
  if (roof.kind == RoofKind::kHip) return add_hip(frame, roof, style);
  add_flat(frame, roof, style);
}

void add_chimney(const WallPlane& frame, const RoofShape& roof, Random& random) {
  const double x = random.uniform(0.25, 0.75) * roof.width;
  const double y = 0.5 * roof.depth + random.uniform(-1.0, 1.0);
  const double half = random.uniform(0.25, 0.45);
  const double top =
      (roof.kind == RoofKind::kFlat ? roof.eave_z : roof.ridge_z()) + random.uniform(0.5, 1.2);
  frame.box({x - half, y - 0.3, roof.eave_z}, {x + half, y + 0.3, top},
            Material(Surface::kWall, random.uniform(0.4, 0.9)));
}

void add_dormer(const WallPlane& frame, const RoofShape& roof, double middle_x,
                const FacadeStyle& style, Random& random) {
  constexpr double kHalf = 0.75;
  constexpr double kOver = 0.12;
  const double y = random.uniform(0.4, 0.9);
  const double low = roof.eave_z + y * roof.slope;
  const double high = std::min(low + random.uniform(1.3, 1.6), roof.ridge_z() - 0.2);
  const double y_back = (high - roof.eave_z) / roof.slope;
  if (high - low < 0.9) return;
  const WallPlane front = frame.moved({middle_x - kHalf, y, 0.0});
  const WallRect face{0.0, 2.0 * kHalf, low, high};
  add_window(front, face, {0.2, 2.0 * kHalf - 0.2, low + 0.15, high - 0.15}, style, false, random);
  front.level(0.0, 2.0 * kHalf, 0.0, y_back - y, low, style.wall);
  for (const double x : {0.0, 2.0 * kHalf})
    front.triangle({x, 0.0, low}, {x, 0.0, high}, {x, y_back - y, high}, style.wall);
  front.box({-kOver, -kOver, high}, {2.0 * kHalf + kOver, y_back - y, high + 0.1}, style.roof);
}

}  // namespace stillmap::simulation
