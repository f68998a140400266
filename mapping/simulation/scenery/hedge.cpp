#include "scenery/hedge.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <vector>

#include "scenery/parts.hpp"

namespace stillmap::simulation {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr double kHedgeGround_m = -0.4;
/// The leaves reach this far out of the body.
constexpr double kCoat_m = 0.09;
constexpr double kBump_m = 0.05;
constexpr int kLeavesPerMetre = 84;
constexpr int kLeavesPerClump = 8;

/// Point on the hedge's outline and the way out from there, both in the plane across it (y, z).
struct OutlinePoint {
  Vector2d at, out;
};

/// Outline of the body from the front's foot over the top to the back's foot; a little narrower on
/// top, with the edges trimmed round.
std::vector<OutlinePoint> outline_of(double height_m) {
  const double width_m = std::clamp(0.4 * height_m, 0.45, 0.8);
  const double low = kCoat_m;
  const double high = width_m - kCoat_m;
  const double top = height_m - kCoat_m;
  return {{{low + 0.04, kHedgeGround_m}, {-1.0, 0.0}},
          {{low + 0.02, 0.15}, {-1.0, 0.0}},
          {{low, 0.5 * top}, {-1.0, 0.0}},
          {{low + 0.03, top - 0.12}, {-1.0, 0.2}},
          {{low + 0.12, top}, {-0.3, 1.0}},
          {{high - 0.12, top}, {0.3, 1.0}},
          {{high - 0.03, top - 0.12}, {1.0, 0.2}},
          {{high, 0.5 * top}, {1.0, 0.0}},
          {{high - 0.02, 0.15}, {1.0, 0.0}},
          {{high - 0.04, kHedgeGround_m}, {1.0, 0.0}}};
}

Vector3d lifted(double x, const Vector2d& across) { return {x, across.x(), across.y()}; }

/// @returns the sections along x, each with the outline's points moved out or in by the bumps.
std::vector<std::vector<Vector3d>> draw_body(const std::vector<OutlinePoint>& outline,
                                             double length_m, Random& random) {
  const int steps = std::max(2, static_cast<int>(std::lround(length_m / 0.5)));
  std::vector<std::vector<Vector3d>> sections;
  for (int i = 0; i <= steps; ++i) {
    std::vector<Vector3d>& section = sections.emplace_back();
    for (const OutlinePoint& point : outline) {
      const double bump_m = random.uniform(-kBump_m, kBump_m);
      section.push_back(lifted(length_m * i / steps, point.at + bump_m * point.out.normalized()));
    }
  }
  return sections;
}

void add_body(Mesh& mesh, const std::vector<std::vector<Vector3d>>& sections, Random& random) {
  for (std::size_t i = 0; i + 1 < sections.size(); ++i) {
    for (std::size_t k = 0; k + 1 < sections[i].size(); ++k) {
      mesh.add_quad(sections[i][k], sections[i][k + 1], sections[i + 1][k + 1], sections[i + 1][k],
                    {Surface::kHedge, random.uniform(0.6, 0.9)});
    }
  }
  for (const auto* end : {&sections.front(), &sections.back()}) {
    for (std::size_t k = 0; k < end->size() / 2 - 1; ++k) {
      mesh.add_quad((*end)[k], (*end)[k + 1], (*end)[end->size() - 2 - k],
                    (*end)[end->size() - 1 - k], {Surface::kHedge, 0.7});
    }
  }
}

/// A place on the outline, even over its length above the ground.
OutlinePoint draw_place(const std::vector<OutlinePoint>& outline, Random& random) {
  double total_m = 0.0;
  for (std::size_t k = 1; k + 2 < outline.size(); ++k)
    total_m += (outline[k + 1].at - outline[k].at).norm();
  double left_m = random.uniform(0.0, total_m);
  for (std::size_t k = 1; k + 2 < outline.size(); ++k) {
    const double edge_m = (outline[k + 1].at - outline[k].at).norm();
    if (left_m <= edge_m) {
      const double t = left_m / edge_m;
      return {(1.0 - t) * outline[k].at + t * outline[k + 1].at,
              (1.0 - t) * outline[k].out + t * outline[k + 1].out};
    }
    left_m -= edge_m;
  }
  return outline[outline.size() / 2];
}

/// @param room  the piece's own room, which no leaf leaves.
void add_leaf(Mesh& mesh, const Vector3d& middle, double size_m, const Eigen::AlignedBox3d& room,
              Random& random) {
  const Vector3d u = draw_direction(random);
  const Vector3d v = u.cross(draw_direction(random)).normalized();
  std::array<Vector3d, 3> corners{middle - size_m * (0.5 * u + 0.4 * v),
                                  middle + size_m * (0.5 * u - 0.4 * v), middle + 0.4 * size_m * v};
  for (Vector3d& corner : corners) corner = corner.cwiseMax(room.min()).cwiseMin(room.max());
  mesh.add_triangle(corners[0], corners[1], corners[2],
                    {Surface::kHedge, random.uniform(0.75, 1.3)});
}

}  // namespace

Mesh make_hedge(double length_m, double height_m, Random& random) {
  const std::vector<OutlinePoint> outline = outline_of(height_m);
  Mesh mesh;
  add_body(mesh, draw_body(outline, length_m, random), random);
  const double width_m = outline.back().at.x() + 0.04 + kCoat_m;
  const Eigen::AlignedBox3d room(Vector3d(0.0, 0.0, kHedgeGround_m),
                                 Vector3d(length_m, width_m, height_m));
  // The number of leaves is the same for all heights, so those of high hedges are larger.
  const double leaf_m = 0.13 * std::sqrt(std::max(0.5, height_m));
  const int clumps = static_cast<int>(std::lround(kLeavesPerMetre * length_m / kLeavesPerClump));
  for (int i = 0; i < clumps; ++i) {
    const OutlinePoint place = draw_place(outline, random);
    const Vector3d middle = lifted(random.uniform(0.0, length_m), place.at);
    const Vector3d out = lifted(0.0, place.out.normalized());
    for (int k = 0; k < kLeavesPerClump; ++k) {
      const Vector3d aside = random.uniform(0.03, 0.16) * draw_direction(random);
      // Rather out of the body than into it.
      const Vector3d at = middle + aside + 0.5 * std::abs(aside.dot(out)) * out;
      add_leaf(mesh, at, leaf_m * random.uniform(0.7, 1.2), room, random);
    }
  }
  return mesh;
}

}  // namespace stillmap::simulation
