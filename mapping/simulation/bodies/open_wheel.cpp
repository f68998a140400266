#include "bodies/open_wheel.hpp"

#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>

#include "bodies/body_shapes.hpp"

namespace stillmap::simulation {
namespace {

using Eigen::Vector3d;

Vector3d on_circle(const Vector3d& axle, double radius_m, double y, double angle_rad) {
  return axle + Vector3d(radius_m * std::cos(angle_rad), y, radius_m * std::sin(angle_rad));
}

void add_tyre_and_rim(Mesh& mesh, const Vector3d& axle, const OpenWheel& w) {
  constexpr int kSectors = 20;
  struct Corner {
    double radius_m, y;
  };
  const double inner = w.radius_m - 1.7 * w.tyre_m;
  const std::array<Corner, 5> section{{{inner, -0.7 * w.tyre_m},
                                       {w.radius_m - 0.7 * w.tyre_m, -w.tyre_m},
                                       {w.radius_m, 0.0},
                                       {w.radius_m - 0.7 * w.tyre_m, w.tyre_m},
                                       {inner, 0.7 * w.tyre_m}}};
  const auto at = [&](const Corner& corner, int sector) {
    const double angle = 2.0 * std::numbers::pi * sector / kSectors - 0.5 * std::numbers::pi;
    return on_circle(axle, corner.radius_m, corner.y, angle);
  };
  const auto add_band = [&](const Corner& a, const Corner& b, Surface surface) {
    for (int s = 0; s < kSectors; ++s)
      mesh.add_quad(at(a, s), at(b, s), at(b, s + 1), at(a, s + 1), surface);
  };
  for (std::size_t i = 0; i + 1 < section.size(); ++i)
    add_band(section.at(i), section.at(i + 1), Surface::kTyre);
  const Corner well{inner - w.rim_depth_m, 0.0};
  add_band(section.front(), well, Surface::kChrome);
  add_band(well, section.back(), Surface::kChrome);
}

}  // namespace

void add_open_wheel(Mesh& mesh, const Vector3d& axle, const OpenWheel& w) {
  add_tyre_and_rim(mesh, axle, w);
  const double rim = w.radius_m - 1.7 * w.tyre_m - 0.5 * w.rim_depth_m;
  for (int i = 0; i < w.spokes; ++i) {
    const double angle = 2.0 * std::numbers::pi * i / w.spokes - w.turn_rad;
    // Spokes come from the left and the right end of the hub in turn.
    const double y = (i % 2 == 0 ? 0.35 : -0.35) * w.hub_width_m;
    add_limb(mesh,
             {{on_circle(axle, 0.8 * w.hub_radius_m, y, angle), w.spoke_radius_m},
              {on_circle(axle, rim, 0.0, angle), w.spoke_radius_m}},
             Surface::kChrome, 3);
  }
  const Vector3d half(0.0, 0.5 * w.hub_width_m, 0.0);
  add_limb(mesh, {{axle - half, w.hub_radius_m}, {axle + half, w.hub_radius_m}}, Surface::kChrome,
           6);
}

void add_mudguard(Mesh& mesh, const Vector3d& axle, const Mudguard& g, Material material) {
  constexpr int kParts = 8;
  const double part = (g.to_rad - g.from_rad) / kParts;
  for (int i = 0; i < kParts; ++i) {
    const double a = g.from_rad + part * i;
    const double y = g.half_width_m;
    // A roof: highest along the middle.
    const double low = g.radius_m - 0.4 * y;
    for (const double side : {y, -y})
      mesh.add_quad(on_circle(axle, g.radius_m, 0.0, a), on_circle(axle, low, side, a),
                    on_circle(axle, low, side, a + part),
                    on_circle(axle, g.radius_m, 0.0, a + part), material);
  }
}

Eigen::Isometry3d steered(const Vector3d& pivot, const Vector3d& axis, double angle_rad) {
  return Eigen::Translation3d(pivot) * Eigen::AngleAxisd(angle_rad, axis.normalized()) *
         Eigen::Translation3d(-pivot);
}

}  // namespace stillmap::simulation
