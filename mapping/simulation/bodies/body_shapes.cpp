#include "bodies/body_shapes.hpp"

#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>

namespace stillmap::simulation {
namespace {

using Eigen::Vector3d;

double angle_of(int part, int parts) { return 2.0 * std::numbers::pi * part / parts; }

Vector3d point_on(const Ring& ring, int part, int parts) {
  const double angle = angle_of(part, parts);
  return ring.centre + std::cos(angle) * ring.u + std::sin(angle) * ring.v;
}

/// Direction of the tube at a joint: the mean of the directions before and after it.
Vector3d direction_at(const std::vector<Joint>& joints, std::size_t i) {
  Vector3d direction = Vector3d::Zero();
  if (i > 0) direction += (joints[i].centre - joints[i - 1].centre).normalized();
  if (i + 1 < joints.size()) direction += (joints[i + 1].centre - joints[i].centre).normalized();
  return direction.norm() > 1e-6 ? direction.normalized() : Vector3d::UnitZ();
}

/// Points of a wheel's profile: share of the radius (of the rim's for the first two) and how far
/// in from the outer face, as share of the width; after the lip of the rim comes rubber, and
/// behind the tread the dark inner side.
struct ProfilePoint {
  double radius_m;
  double depth_m;
};

std::array<ProfilePoint, 6> profile_of(const Wheel& wheel) {
  const double r = wheel.radius_m;
  const double w = wheel.width_m;
  return {{{0.0, 0.15 * w},
           {wheel.rim_radius_m, 0.08 * w},
           {0.92 * r, 0.0},
           {r, 0.12 * w},
           {r, 0.88 * w},
           {0.92 * r, w}}};
}

Surface surface_of(const Wheel& wheel, std::size_t band, int sector) {
  if (band > 0) return Surface::kTyre;
  return wheel.spokes && sector % 2 == 1 ? Surface::kTrim : Surface::kChrome;
}

}  // namespace

void add_tube(Mesh& mesh, const std::vector<Ring>& rings, Material material, int sides) {
  for (std::size_t i = 0; i + 1 < rings.size(); ++i)
    for (int s = 0; s < sides; ++s)
      mesh.add_quad(point_on(rings[i], s, sides), point_on(rings[i], s + 1, sides),
                    point_on(rings[i + 1], s + 1, sides), point_on(rings[i + 1], s, sides),
                    material);
  for (const Ring* end : {&rings.front(), &rings.back()}) {
    for (int s = 0; s < sides; ++s)
      mesh.add_triangle(point_on(*end, s, sides), point_on(*end, s + 1, sides), end->centre,
                        material);
  }
}

void add_limb(Mesh& mesh, const std::vector<Joint>& joints, Material material, int sides) {
  std::vector<Ring> rings;
  Vector3d u = direction_at(joints, 0).unitOrthogonal();
  for (std::size_t i = 0; i < joints.size(); ++i) {
    const Vector3d direction = direction_at(joints, i);
    // Carried on from ring to ring, so that the tube does not twist.
    u -= u.dot(direction) * direction;
    u = u.norm() > 1e-6 ? u.normalized() : direction.unitOrthogonal();
    rings.push_back(
        {joints[i].centre, joints[i].radius_m * u, joints[i].radius_m * direction.cross(u)});
  }
  add_tube(mesh, rings, material, sides);
}

void add_ball(Mesh& mesh, const Vector3d& centre, const Vector3d& radii, Material material,
              int sides) {
  std::vector<Ring> rings;
  constexpr int kBands = 6;
  for (int i = 0; i <= kBands; ++i) {
    const double polar = std::numbers::pi * i / kBands;
    const double share = std::sin(polar);
    rings.push_back({centre - Vector3d(0.0, 0.0, radii.z() * std::cos(polar)),
                     Vector3d(radii.x() * share, 0.0, 0.0), Vector3d(0.0, radii.y() * share, 0.0)});
  }
  add_tube(mesh, rings, material, sides);
}

void add_block(Mesh& mesh, const Vector3d& low, const Vector3d& high, Material material) {
  mesh.add_box(Eigen::Isometry3d::Identity(), low, high, material);
}

void add_wheel(Mesh& mesh, const Vector3d& face, double side, const Wheel& wheel) {
  constexpr int kSectors = 14;
  const auto profile = profile_of(wheel);
  const auto at = [&](std::size_t i, int sector) {
    const double angle = angle_of(sector, kSectors);
    const double r = profile.at(i).radius_m;
    return Vector3d(face.x() + r * std::sin(angle), face.y() - side * profile.at(i).depth_m,
                    face.z() - r * std::cos(angle));
  };
  const Vector3d back = face - Vector3d(0.0, side * wheel.width_m, 0.0);
  for (int s = 0; s < kSectors; ++s) {
    mesh.add_triangle(at(0, s), at(1, s), at(1, s + 1), surface_of(wheel, 0, s));
    for (std::size_t i = 1; i + 1 < profile.size(); ++i)
      mesh.add_quad(at(i, s), at(i, s + 1), at(i + 1, s + 1), at(i + 1, s), Surface::kTyre);
    mesh.add_triangle(at(profile.size() - 1, s), at(profile.size() - 1, s + 1), back,
                      Surface::kTrim);
  }
}

void settle(Mesh& mesh) {
  const Eigen::AlignedBox3f box = mesh.bounds();
  const Eigen::Vector3f middle(box.center().x(), box.center().y(), box.min().z());
  for (Eigen::Vector3f& vertex : mesh.vertices) vertex -= middle;
}

}  // namespace stillmap::simulation
