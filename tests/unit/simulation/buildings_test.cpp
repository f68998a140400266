#include "scenery/buildings.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <string>

namespace stillmap::simulation {
namespace buildings_test {

using Eigen::Vector3d;

constexpr std::uint64_t kKeys = 50;

Mesh make(const BuildingShape& shape, std::uint64_t key) {
  Mesh mesh;
  Random random(key);
  add_building(mesh, Eigen::Isometry3d::Identity(), shape, random);
  return mesh;
}

/// Shape as the plans of the drives draw it.
BuildingShape draw_shape(BuildingKind kind, std::uint64_t key) {
  Random random(scrambled(key));
  switch (kind) {
    case BuildingKind::kHouse:
      return {kind, random.uniform(8.0, 13.0), random.uniform(8.0, 11.0),
              1 + static_cast<int>(random.index(2))};
    case BuildingKind::kHall:
      return {kind, random.uniform(15.0, 40.0), random.uniform(12.0, 30.0), 1};
    default:
      return {kind, random.uniform(9.0, 22.0), random.uniform(9.0, 13.0),
              2 + static_cast<int>(random.index(5))};
  }
}

Vector3d corner(const Mesh& mesh, std::size_t triangle, std::size_t i) {
  return mesh.vertices[mesh.triangles[triangle][i]].cast<double>();
}

/// Distance along the ray to the triangle (Moeller and Trumbore, Journal of Graphics Tools 1997).
std::optional<double> meet(const Mesh& mesh, std::size_t triangle, const Vector3d& from,
                           const Vector3d& direction) {
  const Vector3d a = corner(mesh, triangle, 0);
  const Vector3d ab = corner(mesh, triangle, 1) - a;
  const Vector3d ac = corner(mesh, triangle, 2) - a;
  const Vector3d p = direction.cross(ac);
  const double determinant = ab.dot(p);
  if (std::abs(determinant) < 1e-12) return std::nullopt;
  const Vector3d s = from - a;
  const double u = s.dot(p) / determinant;
  const Vector3d q = s.cross(ab);
  const double v = direction.dot(q) / determinant;
  constexpr double kEdge = 1e-6;
  if (u < -kEdge || v < -kEdge || u + v > 1.0 + kEdge) return std::nullopt;
  const double t = ac.dot(q) / determinant;
  return t > 0.0 ? std::optional(t) : std::nullopt;
}

/// Point that the ray meets first of what lets nothing through, or of everything.
std::optional<Vector3d> first_hit(const Mesh& mesh, const Vector3d& from, const Vector3d& direction,
                                  bool opaque_only) {
  double nearest = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    if (opaque_only && properties_of(mesh.materials[i].surface).transmission > 0.0) continue;
    nearest = std::min(nearest, meet(mesh, i, from, direction).value_or(nearest));
  }
  if (!std::isfinite(nearest)) return std::nullopt;
  return from + nearest * direction;
}

class Buildings : public testing::TestWithParam<BuildingKind> {};

TEST_P(Buildings, AreSoundMeshes) {
  for (std::uint64_t key = 0; key < kKeys; ++key) {
    const Mesh mesh = make(draw_shape(GetParam(), key), key);
    ASSERT_EQ(mesh.materials.size(), mesh.triangles.size());
    ASSERT_FALSE(mesh.triangles.empty());
    for (const auto& v : mesh.vertices) ASSERT_TRUE(v.allFinite()) << key;
    for (const auto& triangle : mesh.triangles)
      for (const std::uint32_t i : triangle) ASSERT_LT(i, mesh.vertices.size()) << key;
    for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
      const Vector3d a = corner(mesh, i, 0);
      EXPECT_GT((corner(mesh, i, 1) - a).cross(corner(mesh, i, 2) - a).norm(), 1e-8)
          << "key " << key << ", triangle " << i << " at " << a.transpose();
    }
  }
}

TEST_P(Buildings, FollowFromTheirKey) {
  for (std::uint64_t key = 0; key < kKeys; ++key) {
    const BuildingShape shape = draw_shape(GetParam(), key);
    const Mesh one = make(shape, key);
    const Mesh same = make(shape, key);
    EXPECT_EQ(one.vertices, same.vertices);
    EXPECT_EQ(one.triangles, same.triangles);
    EXPECT_NE(one.vertices, make(shape, key + kKeys).vertices);
    for (std::size_t i = 0; i < one.materials.size(); ++i) {
      ASSERT_EQ(one.materials[i].surface, same.materials[i].surface);
      ASSERT_EQ(one.materials[i].brightness, same.materials[i].brightness);
    }
  }
}

TEST_P(Buildings, KeepToTheirPlot) {
  for (std::uint64_t key = 0; key < kKeys; ++key) {
    const BuildingShape shape = draw_shape(GetParam(), key);
    const Eigen::AlignedBox3f box = make(shape, key).bounds();
    EXPECT_GE(box.min().x(), -0.5 * shape.width - 1e-3) << key;
    EXPECT_LE(box.max().x(), 0.5 * shape.width + 1e-3) << key;
    EXPECT_GE(box.min().y(), -1.5) << key;
    EXPECT_GE(box.max().y(), shape.depth - 1e-3) << key;
    EXPECT_LE(box.max().y(), shape.depth + 1.0) << key;
    EXPECT_NEAR(box.min().z(), -1.5, 1e-3) << key;
    EXPECT_GE(box.max().z(), 2.5 * shape.floors) << key;
    EXPECT_LE(box.max().z(), 4.0 * shape.floors + 9.0) << key;
  }
}

/// Walkers and parked cars need the room in front; only steps may take it.
TEST_P(Buildings, LeaveThePavementFree) {
  constexpr double kStepZ = 0.5;
  for (std::uint64_t key = 0; key < kKeys; ++key) {
    for (const auto& v : make(draw_shape(GetParam(), key), key).vertices) {
      const bool at_walkers = v.z() > kStepZ && v.z() < 2.299F;
      EXPECT_TRUE(!at_walkers || v.y() >= -0.36F) << key << " " << v.transpose();
      EXPECT_TRUE(v.z() > kStepZ || v.y() >= -0.9F) << key << " " << v.transpose();
    }
  }
}

TEST_P(Buildings, HaveWindowsThatAreSetBack) {
  std::size_t count = 0;
  for (std::uint64_t key = 0; key < kKeys; ++key) {
    const Mesh mesh = make(draw_shape(GetParam(), key), key);
    for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
      if (mesh.materials[i].surface != Surface::kWindow) continue;
      ++count;
      const Vector3d middle = (corner(mesh, i, 0) + corner(mesh, i, 1) + corner(mesh, i, 2)) / 3.0;
      EXPECT_GT(middle.y(), -0.85) << key;
      const bool on_the_front = std::abs(middle.y()) < 0.03;
      const bool across = std::abs(corner(mesh, i, 0).x() - corner(mesh, i, 1).x()) > 1e-4;
      EXPECT_FALSE(on_the_front && across) << key << " " << middle.transpose();
    }
  }
  EXPECT_GT(count, kKeys);
}

/// From the street rays against the front meet something, also past all glass and curtains, and no
/// deeper than the building reaches. A ray in a thousand may pass a porch, or a room at a slant.
TEST_P(Buildings, AreClosed) {
  constexpr int kRays = 150;
  int missed = 0;
  int missed_opaque = 0;
  for (std::uint64_t key = 0; key < kKeys; ++key) {
    const BuildingShape shape = draw_shape(GetParam(), key);
    const Mesh mesh = make(shape, key);
    Random random(scrambled(key) + 1);
    for (int ray = 0; ray < kRays; ++ray) {
      const Vector3d from(random.uniform(-1.0, 1.0) * shape.width, random.uniform(-12.0, -3.0),
                          random.uniform(1.6, 2.2));
      // Houses stand a little inside their width, and a garage is lower.
      const bool house = shape.kind == BuildingKind::kHouse;
      const Vector3d to(random.uniform(-0.5, 0.5) * (shape.width - (house ? 2.4 : 0.02)), 0.0,
                        random.uniform(-1.4, house ? 2.4 : 2.7 * shape.floors));
      for (const bool opaque_only : {false, true}) {
        const auto hit = first_hit(mesh, from, (to - from).normalized(), opaque_only);
        EXPECT_TRUE(!hit || hit->y() <= shape.depth + 1e-6);
        (opaque_only ? missed_opaque : missed) += hit ? 0 : 1;
      }
    }
  }
  EXPECT_LE(missed, kKeys * kRays / 1000);
  EXPECT_LE(missed_opaque, kKeys * kRays * 3 / 1000);
}

TEST_P(Buildings, StayWithinTheirBudget) {
  for (std::uint64_t key = 0; key < kKeys; ++key) {
    BuildingShape shape = draw_shape(GetParam(), key);
    std::size_t most = 800;
    if (shape.kind == BuildingKind::kFlats || shape.kind == BuildingKind::kShop) {
      shape.width = 15.0;
      shape.floors = 5;
      most = 3500;
    }
    EXPECT_LE(make(shape, key).triangles.size(), most) << key;
  }
}

std::string name_of(const testing::TestParamInfo<BuildingKind>& info) {
  constexpr std::array<const char*, 4> kNames{"House", "Flats", "Shop", "Hall"};
  return kNames.at(static_cast<std::size_t>(info.param));
}

INSTANTIATE_TEST_SUITE_P(Kinds, Buildings,
                         testing::Values(BuildingKind::kHouse, BuildingKind::kFlats,
                                         BuildingKind::kShop, BuildingKind::kHall),
                         name_of);

TEST(Balconies, LetRaysThroughTheirRailings) {
  // Of all railings of 50 houses some let a ray through to what is behind them.
  std::size_t between = 0;
  std::size_t on_a_bar = 0;
  for (std::uint64_t key = 0; key < kKeys; ++key) {
    const Mesh mesh = make({BuildingKind::kFlats, 15.0, 11.0, 3}, key);
    if (mesh.bounds().min().y() > -0.85F) continue;
    for (double x = -7.0; x < 7.0; x += 0.037) {
      const auto hit = first_hit(mesh, {x, -10.0, 3.9}, Vector3d::UnitY(), false);
      ASSERT_TRUE(hit);
      (hit->y() < -0.8 ? on_a_bar : between) += 1;
    }
  }
  EXPECT_GT(on_a_bar, 20U);
  EXPECT_GT(between, on_a_bar);
}

}  // namespace buildings_test
}  // namespace stillmap::simulation
