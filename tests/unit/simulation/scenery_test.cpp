#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <numbers>
#include <optional>
#include <string>
#include <vector>

#include "scenery/furniture.hpp"
#include "scenery/plants.hpp"

namespace stillmap::simulation {
namespace scenery_test {

using Eigen::Vector3d;

/// Range to the first triangle on the ray, met as a solid; none if it meets nothing up to `far_m`.
std::optional<double> first_hit(const Mesh& mesh, const Vector3d& from, const Vector3d& way,
                                double far_m) {
  std::optional<double> nearest;
  for (const auto& triangle : mesh.triangles) {
    const Vector3d a = mesh.vertices[triangle[0]].cast<double>();
    const Vector3d u = mesh.vertices[triangle[1]].cast<double>() - a;
    const Vector3d v = mesh.vertices[triangle[2]].cast<double>() - a;
    // Moeller and Trumbore, "Fast, minimum storage ray/triangle intersection", 1997.
    const Vector3d p = way.cross(v);
    const double det = u.dot(p);
    if (std::abs(det) < 1e-12) continue;
    const Vector3d t = from - a;
    const double b = t.dot(p) / det;
    const Vector3d q = t.cross(u);
    const double c = way.dot(q) / det;
    const double range_m = v.dot(q) / det;
    if (b < 0.0 || c < 0.0 || b + c > 1.0 || range_m < 0.0 || range_m > far_m) continue;
    if (!nearest || range_m < *nearest) nearest = range_m;
  }
  return nearest;
}

struct Thing {
  std::string name;
  std::function<Mesh(Random&)> make;
  double lowest_m, highest_m;
  /// Largest size along x and y.
  double widest_m;
};

Thing tree(const std::string& name, TreeKind kind, double lowest_m, double highest_m) {
  return {name, [kind](Random& r) { return make_tree(kind, 1.0, Random(r.bits())); }, lowest_m,
          highest_m, 13.0};
}

Thing border(const std::string& name, BorderKind kind, double height_m) {
  return {name, [=](Random& r) { return make_border_piece(kind, 2.0, height_m, r); },
          height_m - 0.02, height_m + 0.001, 2.001};
}

std::vector<Thing> all_things() {
  return {{"lamp", make_lamp, 5.0, 10.0, 3.5},
          {"sign", make_traffic_sign, 2.3, 4.6, 1.1},
          {"light", make_traffic_light, 3.2, 6.2, 5.0},
          {"bollard", make_bollard, 0.8, 1.1, 0.2},
          {"bin", make_bin, 0.8, 1.3, 1.0},
          {"bench", make_bench, 0.8, 1.0, 2.0},
          {"shelter", make_bus_shelter, 2.3, 2.6, 5.0},
          {"cabinet", make_cabinet, 0.9, 1.4, 1.5},
          {"pole", make_utility_pole, 7.0, 10.0, 1.7},
          {"gantry", [](Random& r) { return make_gantry(12.0, r); }, 6.0, 9.0, 13.0},
          {"containers", make_container_stack, 2.5, 8.8, 12.4},
          {"site", make_building_site, 1.9, 2.7, 12.5},
          {"bush", [](Random& r) { return make_bush(1.0, Random(r.bits())); }, 0.4, 2.05, 2.6},
          {"tuft", [](Random& r) { return make_tuft(1.0, Random(r.bits())); }, 0.18, 0.51, 1.0},
          tree("street", TreeKind::kStreet, 4.5, 8.1),
          tree("large", TreeKind::kLarge, 9.0, 18.1),
          tree("slim", TreeKind::kSlim, 5.5, 12.1),
          tree("conifer", TreeKind::kConifer, 6.0, 14.1),
          tree("young", TreeKind::kYoung, 2.7, 4.6),
          border("wall", BorderKind::kWall, 1.2),
          border("hedge", BorderKind::kHedge, 1.5),
          border("pickets", BorderKind::kPicketFence, 1.0),
          border("railing", BorderKind::kRailing, 1.1),
          border("mesh_fence", BorderKind::kMeshFence, 1.4),
          border("guard_rail", BorderKind::kGuardRail, 0.75),
          border("noise_wall", BorderKind::kNoiseWall, 3.5)};
}

class SceneryThing : public testing::TestWithParam<Thing> {};

TEST_P(SceneryThing, IsAWholeMesh) {
  for (std::uint64_t key = 0; key < 8; ++key) {
    Random random(key);
    const Mesh mesh = GetParam().make(random);
    ASSERT_GT(mesh.triangles.size(), 0U);
    EXPECT_EQ(mesh.materials.size(), mesh.triangles.size());
    EXPECT_LE(mesh.triangles.size(), 7000U);
    for (const Eigen::Vector3f& vertex : mesh.vertices) ASSERT_TRUE(vertex.allFinite());
    for (const auto& triangle : mesh.triangles) {
      for (const std::uint32_t index : triangle) ASSERT_LT(index, mesh.vertices.size());
    }
  }
}

TEST_P(SceneryThing, KeepsToItsSize) {
  for (std::uint64_t key = 0; key < 30; ++key) {
    Random random(key);
    const Eigen::AlignedBox3f box = GetParam().make(random).bounds();
    EXPECT_GE(box.max().z(), GetParam().lowest_m) << key;
    EXPECT_LE(box.max().z(), GetParam().highest_m) << key;
    EXPECT_GE(box.min().z(), -0.41) << key;
    EXPECT_LE(box.min().z(), 0.15) << key;
    EXPECT_LE(box.sizes().head<2>().maxCoeff(), GetParam().widest_m) << key;
  }
}

TEST_P(SceneryThing, FollowsFromItsKey) {
  Random one(7);
  Random two(7);
  const Mesh a = GetParam().make(one);
  const Mesh b = GetParam().make(two);
  EXPECT_EQ(a.vertices, b.vertices);
  EXPECT_EQ(a.triangles, b.triangles);
}

INSTANTIATE_TEST_SUITE_P(All, SceneryThing, testing::ValuesIn(all_things()),
                         [](const auto& thing) { return thing.param.name; });

constexpr TreeKind kTrees[] = {TreeKind::kStreet, TreeKind::kLarge, TreeKind::kSlim,
                               TreeKind::kConifer, TreeKind::kYoung};

TEST(Plants, TreesHaveSomeThousandLeaves) {
  for (const TreeKind kind : kTrees) {
    for (std::uint64_t key = 0; key < 10; ++key) {
      const std::size_t count = make_tree(kind, 1.0, Random(key)).triangles.size();
      EXPECT_GE(count, 2500U) << static_cast<int>(kind);
      EXPECT_LE(count, 6500U) << static_cast<int>(kind);
    }
  }
}

TEST(Plants, FewerLeavesAreTheFirstOnesOfAll) {
  for (const TreeKind kind : kTrees) {
    const Mesh full = make_tree(kind, 1.0, Random(3));
    const Mesh thin = make_tree(kind, 0.8, Random(3));
    ASSERT_LT(thin.triangles.size(), full.triangles.size());
    for (std::size_t i = 0; i < thin.triangles.size(); ++i)
      ASSERT_EQ(thin.triangles[i], full.triangles[i]);
    for (std::size_t i = 0; i < thin.vertices.size(); ++i)
      ASSERT_EQ(thin.vertices[i], full.vertices[i]);
  }
}

TEST(Plants, StreetTreesHaveNoLeavesWherePeopleWalk) {
  for (std::uint64_t key = 0; key < 20; ++key) {
    const Mesh mesh = make_tree(TreeKind::kStreet, 1.0, Random(key));
    float lowest = 100.0F;
    for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
      if (mesh.materials[i].surface != Surface::kLeaf) continue;
      for (const std::uint32_t index : mesh.triangles[i])
        lowest = std::min(lowest, mesh.vertices[index].z());
    }
    EXPECT_GE(lowest, 2.0F) << key;
    EXPECT_LE(lowest, 2.9F) << key;
  }
}

/// Share of level rays towards the middle of the crown that meet it at most 2 m inside.
double share_stopped(TreeKind kind) {
  int stopped = 0;
  int all = 0;
  for (std::uint64_t key = 0; key < 6; ++key) {
    const Mesh mesh = make_tree(kind, 1.0, Random(key));
    Eigen::AlignedBox3d crown;
    for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
      if (mesh.materials[i].surface != Surface::kLeaf) continue;
      crown.extend(mesh.vertices[mesh.triangles[i][0]].cast<double>());
    }
    const double radius_m = 0.25 * (crown.sizes().x() + crown.sizes().y());
    Random random(key);
    for (int i = 0; i < 200; ++i, ++all) {
      const double angle_rad = random.uniform(0.0, 2.0 * std::numbers::pi);
      const Vector3d way(std::cos(angle_rad), std::sin(angle_rad), 0.0);
      const Vector3d aside = random.uniform(-0.3, 0.3) * radius_m * Vector3d::UnitZ().cross(way);
      const double z = crown.center().z() + random.uniform(-0.25, 0.25) * crown.sizes().z();
      const Vector3d from =
          Vector3d(crown.center().x(), crown.center().y(), z) + aside - radius_m * way;
      if (first_hit(mesh, from, way, 2.0)) ++stopped;
    }
  }
  return static_cast<double>(stopped) / all;
}

TEST(Plants, CrownsLetSomeRaysThrough) {
  for (const TreeKind kind : kTrees) {
    const double share = share_stopped(kind);
    RecordProperty("stopped" + std::to_string(static_cast<int>(kind)), std::to_string(share));
    EXPECT_GE(share, 0.25) << static_cast<int>(kind);
    EXPECT_LE(share, kind == TreeKind::kStreet ? 0.6 : 0.8) << static_cast<int>(kind);
  }
}

TEST(Borders, ReachFromEndToEnd) {
  for (const BorderKind kind :
       {BorderKind::kWall, BorderKind::kHedge, BorderKind::kPicketFence, BorderKind::kRailing,
        BorderKind::kMeshFence, BorderKind::kGuardRail, BorderKind::kNoiseWall}) {
    for (const double length_m : {2.0, 4.0}) {
      Random random(5);
      const Eigen::AlignedBox3f box = make_border_piece(kind, length_m, 1.2, random).bounds();
      EXPECT_NEAR(box.min().x(), 0.0, 1e-3) << static_cast<int>(kind);
      EXPECT_NEAR(box.max().x(), length_m, 1e-3) << static_cast<int>(kind);
      EXPECT_NEAR(box.min().z(), -0.4, 1e-3) << static_cast<int>(kind);
      EXPECT_GE(box.min().y(), -0.001) << static_cast<int>(kind);
      EXPECT_LE(box.max().y(), 0.85) << static_cast<int>(kind);
    }
  }
}

TEST(Borders, HedgesAreMadeOfFewTriangles) {
  Random random(1);
  EXPECT_LE(make_border_piece(BorderKind::kHedge, 2.0, 1.6, random).triangles.size(), 260U);
}

/// Share of level rays across the piece that meet nothing.
double share_through(BorderKind kind) {
  Random random(2);
  const Mesh mesh = make_border_piece(kind, 2.0, 1.2, random);
  int through = 0;
  constexpr int kRays = 2000;
  for (int i = 0; i < kRays; ++i) {
    const Vector3d from(random.uniform(0.0, 2.0), -1.0, random.uniform(0.1, 1.0));
    if (!first_hit(mesh, from, Vector3d::UnitY(), 3.0)) ++through;
  }
  return static_cast<double>(through) / kRays;
}

TEST(Borders, OnlyFencesAndRailingsLetRaysThrough) {
  EXPECT_THAT(share_through(BorderKind::kPicketFence),
              testing::AllOf(testing::Gt(0.2), testing::Lt(0.5)));
  EXPECT_THAT(share_through(BorderKind::kRailing),
              testing::AllOf(testing::Gt(0.65), testing::Lt(0.95)));
  EXPECT_EQ(share_through(BorderKind::kWall), 0.0);
  EXPECT_EQ(share_through(BorderKind::kNoiseWall), 0.0);
  EXPECT_EQ(share_through(BorderKind::kHedge), 0.0);
}

TEST(Furniture, SignsShowTheirFrontToTrafficThatDrivesAlongX) {
  for (std::uint64_t key = 0; key < 10; ++key) {
    Random random(key);
    const Mesh mesh = make_traffic_sign(random);
    Eigen::AlignedBox3f front;
    Eigen::AlignedBox3f back;
    for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
      for (const std::uint32_t index : mesh.triangles[i]) {
        if (mesh.materials[i].surface == Surface::kSign) front.extend(mesh.vertices[index]);
        if (mesh.materials[i].surface == Surface::kSignBack) back.extend(mesh.vertices[index]);
      }
    }
    ASSERT_FALSE(front.isEmpty());
    EXPECT_NEAR(back.min().x() - front.max().x(), 0.005F, 1e-4F);
    EXPECT_LT(front.max().x(), -0.03F);
    EXPECT_GE(front.min().z(), 1.95F);
  }
}

TEST(Furniture, NothingHangsTooLowOverTheCarriageway) {
  for (std::uint64_t key = 0; key < 20; ++key) {
    Random random(key);
    for (const Mesh& mesh : {make_lamp(random), make_gantry(11.0, random)}) {
      for (const Eigen::Vector3f& vertex : mesh.vertices) {
        const bool over = vertex.y() < -0.5F && vertex.y() > -10.5F;
        EXPECT_TRUE(!over || vertex.z() > 4.7F);
      }
    }
  }
}

}  // namespace scenery_test
}  // namespace stillmap::simulation
