#include "bodies/hull.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

namespace stillmap::simulation {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

/// (y, z) of the outline's points on the left, from the underside up.
using Section = std::array<Vector2d, kHullStrips + 1>;

double height_on(const std::vector<Vector2d>& line, double x) {
  if (x <= line.front().x()) return line.front().y();
  for (std::size_t i = 0; i + 1 < line.size(); ++i) {
    const Vector2d& a = line[i];
    const Vector2d& b = line[i + 1];
    if (x > b.x()) continue;
    return a.y() + (b.y() - a.y()) * (x - a.x()) / std::max(b.x() - a.x(), 1e-9);
  }
  return line.back().y();
}

/// 1 at the end of a hull, 0 from its reach on.
double nearness(double way_m, const HullEnd& end) {
  return std::clamp(1.0 - way_m / end.reach_m, 0.0, 1.0);
}

double half_width_at(const Hull& hull, double x) {
  const double front = nearness(hull.front_x() - x, hull.front);
  const double rear = nearness(x - hull.rear_x(), hull.rear);
  // Quarter of an ellipse in plan.
  const auto loss = [](double t, double all) { return all * (1.0 - std::sqrt(1.0 - t * t)); };
  return hull.half_width_m - loss(front, hull.front.narrowing_m) -
         loss(rear, hull.rear.narrowing_m);
}

/// Lower edge of the side: the sill, or the arch where there is one.
double sill_at(const Hull& hull, double x) {
  double sill = hull.clearance_m + 0.03;
  for (const WheelArch& arch : hull.arches) {
    const double square = arch.radius_m * arch.radius_m - (x - arch.x_m) * (x - arch.x_m);
    if (square >= 0.0) sill = std::max(sill, arch.hub_height_m + std::sqrt(square));
  }
  return sill;
}

void fill_side(const Hull& hull, double x, Section& section) {
  const double w = half_width_at(hull, x);
  const double low = hull.clearance_m;
  const double sill = sill_at(hull, x);
  const double belt = std::max(hull.belt_at(x), sill + 0.03);
  section[0] = {0.0, low};
  section[1] = {w - hull.well_m, low};
  section[2] = {w - hull.well_m, sill > low + 0.04 ? sill : low};
  section[3] = {w - 0.03, sill};
  section[4] = {w, sill + 0.35 * (belt - sill)};
  section[5] = {w - 0.005, sill + 0.75 * (belt - sill)};
  section[6] = {w - 0.03, belt};
}

void fill_top(const Hull& hull, double x, Section& section) {
  const double w = section[6].x();
  const double belt = section[6].y();
  const double top = std::max(hull.top_at(x), belt + 0.03);
  const double crown = std::min(hull.crown_m, 0.6 * (top - belt));
  const double glass = top - crown - belt;
  // Panes are bent: outward by up to 1.5 cm in their middle.
  const auto side = [&](double share) {
    const double bow = std::min(0.015, 0.1 * glass) * 4.0 * share * (1.0 - share);
    return Vector2d(w - hull.tumblehome * share * glass + bow, belt + share * glass);
  };
  section[7] = side(hull.pane_middle);
  section[8] = side(hull.pane_top);
  section[9] = side(1.0);
  const double edge = section[9].x();
  section[10] = {0.88 * edge, top - 0.55 * crown};
  section[11] = {0.45 * edge, top - 0.10 * crown};
  section[12] = {0.0, top};
}

Section section_at(const Hull& hull, double x) {
  Section section;
  fill_side(hull, x, section);
  fill_top(hull, x, section);
  return section;
}

/// How far a point of an end lies behind the middle of its bumper.
double set_back(const Hull& hull, const HullEnd& end, double end_top, const Vector2d& yz) {
  const double across = std::min(std::abs(yz.x()) / hull.half_width_m, 1.0);
  const double above = (yz.y() - hull.bumper_height_m) / (end_top - hull.bumper_height_m);
  const double below = (hull.bumper_height_m - yz.y()) / (hull.bumper_height_m - hull.clearance_m);
  return end.bulge_m * across * across * across +
         end.lean_m * std::pow(std::clamp(above, 0.0, 1.0), 1.5) +
         end.chin_m * std::pow(std::clamp(below, 0.0, 1.0), 2.0);
}

Vector3d placed(const Hull& hull, double x, const Vector2d& yz) {
  const double front = nearness(hull.front_x() - x, hull.front);
  const double rear = nearness(x - hull.rear_x(), hull.rear);
  double moved = x;
  if (front > 0.0) moved -= front * front * set_back(hull, hull.front, hull.top.back().y(), yz);
  if (rear > 0.0) moved += rear * rear * set_back(hull, hull.rear, hull.top.front().y(), yz);
  return {moved, yz.x(), yz.y()};
}

/// Places along x with a cross section: where a line bends, a material changes or an end is round.
std::vector<double> stations_of(const Hull& hull) {
  std::vector<double> xs = hull.cuts;
  for (const Vector2d& knot : hull.top) xs.push_back(knot.x());
  for (const WheelArch& arch : hull.arches)
    for (const double share : {-1.02, -0.99, -0.72, -0.28, 0.28, 0.72, 0.99, 1.02})
      xs.push_back(arch.x_m + share * arch.radius_m);
  for (const double share : {0.06, 0.25, 0.6}) {
    xs.push_back(hull.front_x() - share * hull.front.reach_m);
    xs.push_back(hull.rear_x() + share * hull.rear.reach_m);
  }
  std::sort(xs.begin(), xs.end());
  std::vector<double> kept{hull.rear_x()};
  for (const double x : xs) {
    const bool inside = x > kept.back() + 0.005 && x < hull.front_x() - 0.005;
    if (inside) kept.push_back(x);
  }
  kept.push_back(hull.front_x());
  return kept;
}

Vector2d mirrored(const Vector2d& yz, double share) { return {share * yz.x(), yz.y()}; }

void add_side(Mesh& mesh, const Hull& hull, const HullMaterials& materials) {
  const std::vector<double> xs = stations_of(hull);
  for (std::size_t i = 0; i + 1 < xs.size(); ++i) {
    const Section here = section_at(hull, xs[i]);
    const Section next = section_at(hull, xs[i + 1]);
    for (int strip = 0; strip < kHullStrips; ++strip) {
      const double middle = 0.5 * (xs[i] + xs[i + 1]);
      const auto low = static_cast<std::size_t>(strip);
      for (const double side : {1.0, -1.0})
        mesh.add_quad(placed(hull, xs[i], mirrored(here.at(low), side)),
                      placed(hull, xs[i + 1], mirrored(next.at(low), side)),
                      placed(hull, xs[i + 1], mirrored(next.at(low + 1), side)),
                      placed(hull, xs[i], mirrored(here.at(low + 1), side)),
                      materials.side(middle, strip, side));
    }
  }
}

void add_end(Mesh& mesh, const Hull& hull, double x,
             const std::function<Surface(double share, int strip)>& surface) {
  constexpr std::array<double, 6> kShares{-1.0, -0.7, -0.3, 0.3, 0.7, 1.0};
  const Section section = section_at(hull, x);
  for (int strip = kLowerSide; strip < kHullStrips; ++strip) {
    const auto low = static_cast<std::size_t>(strip);
    for (std::size_t i = 0; i + 1 < kShares.size(); ++i) {
      const double a = kShares.at(i);
      const double b = kShares.at(i + 1);
      mesh.add_quad(placed(hull, x, mirrored(section.at(low), a)),
                    placed(hull, x, mirrored(section.at(low), b)),
                    placed(hull, x, mirrored(section.at(low + 1), b)),
                    placed(hull, x, mirrored(section.at(low + 1), a)),
                    surface(0.5 * std::abs(a + b), strip));
    }
  }
}

}  // namespace

double Hull::top_at(double x) const { return height_on(top, x); }
double Hull::belt_at(double x) const { return std::min(height_on(belt, x), top_at(x) - 0.06); }

void add_hull(Mesh& mesh, const Hull& hull, const HullMaterials& materials) {
  add_side(mesh, hull, materials);
  add_end(mesh, hull, hull.front_x(), materials.front);
  add_end(mesh, hull, hull.rear_x(), materials.rear);
}

void append_arc(std::vector<Vector2d>& line, const Vector2d& end, double rise_m, int parts) {
  const Vector2d start = line.back();
  for (int i = 1; i <= parts; ++i) {
    const double t = static_cast<double>(i) / parts;
    line.emplace_back(start + t * (end - start) + Vector2d(0.0, 4.0 * rise_m * t * (1.0 - t)));
  }
}

}  // namespace stillmap::simulation
