#include "bodies/person_bodies.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <string>

#include "bodies/two_wheeler_bodies.hpp"

namespace stillmap::simulation {
namespace person_bodies_test {

/// A kind of body, and what it may measure [m].
struct Case {
  std::string name;
  Body (*make)(Random&);
  BodyKind kind;
  maps::ObjectClass object_class;
  Eigen::Vector3f smallest;
  Eigen::Vector3f largest;
  std::size_t postures;
  double least_stride_m;
  double longest_stride_m;
};

class PersonBodies : public testing::TestWithParam<Case> {
 protected:
  template <typename Check>
  static void for_many_bodies(Check check) {
    for (std::uint64_t key = 0; key < 100; ++key) {
      SCOPED_TRACE(key);
      Random random(key_of({key}));
      check(GetParam().make(random));
    }
  }
};

TEST_P(PersonBodies, HaveSoundMeshes) {
  for_many_bodies([](const Body& body) {
    for (const Mesh& mesh : body.postures) {
      ASSERT_FALSE(mesh.triangles.empty());
      EXPECT_LT(mesh.triangles.size(), 2700U);
      EXPECT_EQ(mesh.materials.size(), mesh.triangles.size());
      EXPECT_TRUE(std::ranges::all_of(mesh.vertices, [](const auto& v) { return v.allFinite(); }));
      for (const auto& triangle : mesh.triangles)
        ASSERT_LT(std::ranges::max(triangle), mesh.vertices.size());
    }
  });
}

TEST_P(PersonBodies, StandOnTheGroundInTheMiddle) {
  for_many_bodies([](const Body& body) {
    const Eigen::AlignedBox3f first = body.postures.front().bounds();
    EXPECT_NEAR(first.center().x(), 0.0, 0.001);
    EXPECT_NEAR(first.center().y(), 0.0, 0.001);
    for (const Mesh& mesh : body.postures) EXPECT_NEAR(mesh.bounds().min().z(), 0.0, 0.001);
  });
}

TEST_P(PersonBodies, MeasureWhatTheirKindDoes) {
  for_many_bodies([](const Body& body) {
    const Eigen::Vector3f size = body.postures.front().bounds().sizes();
    for (int axis = 0; axis < 3; ++axis) {
      EXPECT_GE(size[axis], GetParam().smallest[axis]) << "axis " << axis;
      EXPECT_LE(size[axis], GetParam().largest[axis]) << "axis " << axis;
    }
  });
}

TEST_P(PersonBodies, AreOfTheirKindAndClass) {
  for_many_bodies([](const Body& body) {
    EXPECT_EQ(body.kind, GetParam().kind);
    EXPECT_EQ(body.object_class, GetParam().object_class);
    EXPECT_EQ(body.postures.size(), GetParam().postures);
    EXPECT_GE(body.stride_m, GetParam().least_stride_m);
    EXPECT_LE(body.stride_m, GetParam().longest_stride_m);
  });
}

TEST_P(PersonBodies, AreAboutAsHighAndInPlaceInEveryPosture) {
  for_many_bodies([](const Body& body) {
    const Eigen::AlignedBox3f first = body.postures.front().bounds();
    for (const Mesh& mesh : body.postures) {
      const Eigen::AlignedBox3f box = mesh.bounds();
      // Who gets off the saddle to stop stands lower or higher than sitting.
      EXPECT_NEAR(box.max().z(), first.max().z(), 0.12 * first.max().z());
      EXPECT_NEAR(box.center().x(), first.center().x(), 0.15);
      EXPECT_NEAR(box.center().y(), first.center().y(), 0.15);
    }
  });
}

TEST_P(PersonBodies, FollowFromTheirKey) {
  for (std::uint64_t key = 0; key < 100; ++key) {
    Random one(key);
    Random same(key);
    Random other(key + 1000);
    const Body body = GetParam().make(one);
    const Body twin = GetParam().make(same);
    ASSERT_EQ(body.postures.size(), twin.postures.size());
    for (std::size_t i = 0; i < body.postures.size(); ++i)
      EXPECT_EQ(body.postures[i].vertices, twin.postures[i].vertices);
    EXPECT_NE(body.postures[0].vertices, GetParam().make(other).postures[0].vertices);
  }
}

INSTANTIATE_TEST_SUITE_P(Kinds, PersonBodies,
                         testing::Values(Case{"Pedestrian",
                                              make_pedestrian,
                                              BodyKind::kPedestrian,
                                              maps::ObjectClass::kPedestrian,
                                              {0.15F, 0.30F, 1.10F},
                                              {0.80F, 0.95F, 1.96F},
                                              9,
                                              0.8,
                                              1.8},
                                         Case{"Motorcycle",
                                              make_motorcycle,
                                              BodyKind::kMotorcycle,
                                              maps::ObjectClass::kMotorcycle,
                                              {1.7F, 0.55F, 1.00F},
                                              {2.4F, 1.10F, 1.50F},
                                              1,
                                              0.0,
                                              0.0},
                                         Case{"Motorcyclist",
                                              make_motorcyclist,
                                              BodyKind::kMotorcyclist,
                                              maps::ObjectClass::kMotorcycle,
                                              {1.7F, 0.60F, 1.45F},
                                              {2.4F, 1.10F, 2.00F},
                                              1,
                                              0.0,
                                              0.0},
                                         Case{"Bicycle",
                                              make_bicycle,
                                              BodyKind::kBicycle,
                                              maps::ObjectClass::kCyclist,
                                              {1.6F, 0.40F, 0.85F},
                                              {1.95F, 0.80F, 1.30F},
                                              1,
                                              0.0,
                                              0.0},
                                         Case{"Cyclist",
                                              make_cyclist,
                                              BodyKind::kCyclist,
                                              maps::ObjectClass::kCyclist,
                                              {1.6F, 0.45F, 1.40F},
                                              {1.95F, 1.05F, 2.00F},
                                              7,
                                              4.5,
                                              5.6}),
                         [](const auto& kind) { return kind.param.name; });

TEST(Pedestrian, WalksOnTheGround) {
  for (std::uint64_t key = 0; key < 100; ++key) {
    Random random(key);
    const Body body = make_pedestrian(random);
    const Eigen::AlignedBox3f standing = body.postures.front().bounds();
    float longest_step = 0.0F;
    for (std::size_t i = 1; i < body.postures.size(); ++i) {
      const Mesh& mesh = body.postures[i];
      // One foot carries: there is a sole within 2 cm of the ground, and none below it.
      EXPECT_NEAR(mesh.bounds().min().z(), 0.0, 0.02);
      float back = 1e9F;
      float front = -1e9F;
      for (const Eigen::Vector3f& vertex : mesh.vertices) {
        if (vertex.z() > 0.02F) continue;
        back = std::min(back, vertex.x());
        front = std::max(front, vertex.x());
      }
      longest_step = std::max(longest_step, front - back);
    }
    // Where both feet are down they are most of a step apart.
    EXPECT_GT(longest_step, 0.35 * body.stride_m) << key;
    EXPECT_LT(longest_step, 0.8 * body.stride_m) << key;
    EXPECT_NEAR(body.stride_m, 1.4 * standing.sizes().z() / 1.72, 0.15) << key;
  }
}

TEST(Cyclist, TurnsTheCranksOnceInAStride) {
  Random random(7);
  const Body body = make_cyclist(random);
  for (std::size_t i = 1; i < body.postures.size(); ++i)
    EXPECT_NE(body.postures[i].vertices, body.postures[i % 6 + 1].vertices);
}

TEST(Bicycle, LetsRaysThroughItsWheels) {
  // Seen from the side, tyre, rim and spokes fill a small part of a wheel's disc.
  Random random(3);
  const Body body = make_bicycle(random);
  double area = 0.0;
  for (std::size_t i = 0; i < body.postures[0].triangles.size(); ++i) {
    const auto& [a, b, c] = body.postures[0].triangles[i];
    const auto& v = body.postures[0].vertices;
    area += 0.5 * std::abs((v[b] - v[a]).cross(v[c] - v[a]).y());
  }
  // Both sides of every part are counted: the area seen is at most half of it.
  const Eigen::Vector3f size = body.postures[0].bounds().sizes();
  EXPECT_LT(0.5 * area, 0.35 * size.x() * size.z());
}

}  // namespace person_bodies_test
}  // namespace stillmap::simulation
