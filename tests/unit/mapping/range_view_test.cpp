#include "views/range_view.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>
#include <span>
#include <stdexcept>

#include "support/synthetic_world.hpp"
#include "support/throws.hpp"

namespace stillmap::mapping {
namespace range_view_test {

using test::pose_at;
using test::ScanPattern;
using test::SyntheticWorld;
using test::ThrowsSaying;

constexpr float kCellM = 0.06F;
constexpr double kDegree = std::numbers::pi / 180.0;

/// 64 rings of 0.4 degrees, a shot every 0.18: about an HDL-64E.
ScanPattern dense() {
  ScanPattern pattern;
  pattern.rings = 64;
  pattern.columns = 2000;
  pattern.lowest_rad = -0.42;
  pattern.highest_rad = 0.035;
  return pattern;
}

/// 16 rings of 2 degrees, a shot every 0.2.
ScanPattern sixteen() {
  ScanPattern pattern;
  pattern.rings = 16;
  pattern.columns = 1800;
  pattern.lowest_rad = -15.0 * kDegree;
  pattern.highest_rad = 15.0 * kDegree;
  return pattern;
}

RangeView view_of(const maps::PointCloud& cloud, const Eigen::Isometry3d& T_world_lidar) {
  std::vector<std::uint8_t> is_ground;
  for (const Eigen::Vector3f& p : cloud.positions)
    is_ground.push_back((T_world_lidar * p.cast<double>()).z() < 0.03 ? 1 : 0);
  return {cloud.positions, is_ground};
}

/// A world seen from a pose.
struct Seen {
  Eigen::Isometry3d T_world_lidar;
  RangeView view;
  Seen(const SyntheticWorld& world, const ScanPattern& pattern,
       const Eigen::Isometry3d& T = pose_at(0, 0))
      : T_world_lidar(T), view(view_of(world.scan(T, pattern), T)) {}
  [[nodiscard]] Sight at(double x, double y, double z) const {
    const Eigen::Vector3d p = T_world_lidar.inverse() * Eigen::Vector3d(x, y, z);
    return view.look(p.cast<float>(), kCellM).sight;
  }
};

SyntheticWorld wall_ahead() {
  SyntheticWorld world;
  world.boxes = {{{20.0, -15.0, 0.0}, {20.5, 15.0, 6.0}}};
  return world;
}

TEST(RangeView, TellsBeforeOnAndBehindAWall) {
  const Seen seen(wall_ahead(), dense());
  EXPECT_EQ(seen.at(10.0, 1.0, 1.5), Sight::kFree);
  EXPECT_EQ(seen.at(20.0, 1.0, 1.5), Sight::kHit);
  EXPECT_EQ(seen.at(25.0, 1.0, 1.5), Sight::kHidden);
}

TEST(RangeView, DirectionsWithoutAReturnAreUnknown) {
  const Seen seen(wall_ahead(), dense());
  EXPECT_EQ(seen.at(-10.0, 0.0, 2.0), Sight::kUnknown) << "sky";
  EXPECT_EQ(seen.at(5.0, 0.0, 7.0), Sight::kUnknown) << "above all rings";
  EXPECT_EQ(seen.at(0.0, 0.0, 0.5), Sight::kUnknown) << "own vehicle";
  const RangeView nothing(std::span<const Eigen::Vector3f>{}, {});
  EXPECT_EQ(nothing.look({10.0F, 0.0F, 0.0F}, kCellM).sight, Sight::kUnknown);
  EXPECT_EQ(nothing.look({0.0F, 0.0F, 0.0F}, kCellM).sight, Sight::kUnknown);
}

TEST(RangeView, SeesAcrossTheSeamOfAzimuth) {
  SyntheticWorld world;
  world.boxes = {{{-20.5, -15.0, 0.0}, {-20.0, 15.0, 6.0}}};
  const Seen seen(world, dense());
  for (const double y : {-0.02, 0.0, 0.02}) EXPECT_EQ(seen.at(-10.0, y, 1.5), Sight::kFree) << y;
}

TEST(RangeView, KeepsAGuardAroundAPole) {
  SyntheticWorld world = wall_ahead();
  world.cylinders = {{{10.0, 0.0}, 0.05, 4.0}};
  const Seen seen(world, dense());
  EXPECT_EQ(seen.at(9.95, 0.0, 1.5), Sight::kHit);
  EXPECT_EQ(seen.at(10.0, 0.15, 1.5), Sight::kMixed) << "a pose that is off by 3 cm and 0.1 degree";
  EXPECT_EQ(seen.at(10.0, 0.5, 1.5), Sight::kFree);
}

TEST(RangeView, GroundBeforeAndUnderACellSaysNothing) {
  const Seen seen(wall_ahead(), dense());
  EXPECT_EQ(seen.at(12.0, 0.0, 0.3), Sight::kFree);
  EXPECT_EQ(seen.at(12.0, 0.0, 0.0), Sight::kHit) << "but on the ground it does";
}

TEST(RangeView, NeverSeesASolidFree) {
  for (const std::uint64_t seed : {1U, 2U}) {
    const SyntheticWorld world = test::street(seed, 60.0);
    test::Random random(seed);
    for (const ScanPattern& pattern : {dense(), sixteen()}) {
      const Seen seen(world, pattern, pose_at(30.0, random.uniform(-1.5, 1.5), 0.3));
      for (const SyntheticWorld::Box& box : world.boxes) {
        for (int n = 0; n < 200; ++n) {
          Eigen::Vector3d p;
          // A decimetre from the edges: half of a cell on an edge is free.
          for (Eigen::Index a = 0; a < 3; ++a)
            p[a] = random.uniform(box.min[a] + 0.1, box.max[a] - 0.1);
          // Half of them on the side that the street sees.
          if (n % 2 == 0) p.y() = box.min.y() > 0.0 ? box.min.y() : box.max.y();
          ASSERT_NE(seen.at(p.x(), p.y(), p.z()), Sight::kFree) << p.transpose();
        }
      }
      for (const SyntheticWorld::Cylinder& pole : world.cylinders) {
        for (double z = 0.3; z < 3.0; z += 0.1)
          ASSERT_NE(seen.at(pole.centre.x(), pole.centre.y(), z), Sight::kFree);
      }
    }
  }
}

TEST(RangeView, AWallAtAGrazingAngleIsNeverFree) {
  SyntheticWorld world;
  world.boxes = {{{2.0, 2.0, 0.0}, {38.0, 2.5, 3.0}}, {{45.0, -20.0, 0.0}, {46.0, 20.0, 6.0}}};
  for (const double shift : {0.0, 0.01, 0.02}) {
    const Seen seen(world, dense(), pose_at(0.0, 0.5, shift));
    for (double x = 2.0; x < 38.0; x += 0.05) {
      for (const double z : {0.5, 1.5})
        ASSERT_NE(seen.at(x, 2.0, z), Sight::kFree) << "at " << x << " m";
    }
  }
}

TEST(RangeView, BetweenSparseRingsNothingIsKnown) {
  const Seen seen(wall_ahead(), sixteen());
  EXPECT_EQ(seen.at(10.0, 0.0, 1.8 + 10.0 * std::tan(1.0 * kDegree)), Sight::kFree) << "on a ring";
  EXPECT_EQ(seen.at(10.0, 0.0, 1.8 + 10.0 * std::tan(2.0 * kDegree)), Sight::kUnknown);
}

TEST(RangeView, CountsTheRaysThatSpeakForFreeSpace) {
  const auto rays = [](const ScanPattern& pattern) {
    const Seen seen(wall_ahead(), pattern);
    return seen.view.look({10.0F, 0.0F, static_cast<float>(10.0 * std::tan(1.0 * kDegree))}, kCellM)
        .rays;
  };
  EXPECT_GT(rays(dense()), 3 * rays(sixteen()));
  EXPECT_GT(rays(sixteen()), 0);
}

TEST(RangeView, WorksWithAPatternThatNeverRepeats) {
  const SyntheticWorld world = wall_ahead();
  test::Random random(5);
  maps::PointCloud cloud;
  for (int n = 0; n < 20000; ++n) {
    const double azimuth = random.uniform(-0.6, 0.6), elevation = random.uniform(-0.6, 0.6);
    const Eigen::Vector3d direction(std::cos(elevation) * std::cos(azimuth),
                                    std::cos(elevation) * std::sin(azimuth), std::sin(elevation));
    const double range = world.cast({0.0, 0.0, 1.8}, direction);
    if (std::isfinite(range)) cloud.positions.push_back((range * direction).cast<float>());
  }
  const RangeView view = view_of(cloud, pose_at(0, 0));
  int free = 0;
  for (int n = 0; n < 1000; ++n) {
    const auto y = static_cast<float>(random.uniform(-4.0, 4.0));
    const auto z = static_cast<float>(random.uniform(-1.0, 3.0));
    if (view.look({10.0F, 0.5F * y, 0.5F * z}, kCellM).sight == Sight::kFree) ++free;
    EXPECT_NE(view.look({20.0F, y, z}, kCellM).sight, Sight::kFree);
  }
  EXPECT_GT(free, 300);
}

TEST(RangeView, RoundTripsThroughBytes) {
  const Seen seen(test::street(3), dense());
  const std::string bytes = seen.view.to_bytes();
  EXPECT_LT(bytes.size(), 200'000U);
  EXPECT_EQ(RangeView::from_bytes(bytes), seen.view);
  const RangeView nothing(std::span<const Eigen::Vector3f>{}, {});
  EXPECT_EQ(RangeView::from_bytes(nothing.to_bytes()), nothing);
}

TEST(RangeView, RefusesBytesOfSomethingElse) {
  const std::string bytes = Seen(wall_ahead(), sixteen()).view.to_bytes();
  const auto parse = [](const std::string& text) {
    return [text] { static_cast<void>(RangeView::from_bytes(text)); };
  };
  using Error = std::invalid_argument;
  EXPECT_THAT(parse(""), ThrowsSaying<Error>({"head"}));
  EXPECT_THAT(parse(std::string(40, '\xFF')), ThrowsSaying<Error>({"rows"}));
  EXPECT_THAT(parse(bytes.substr(0, bytes.size() - 1)), ThrowsSaying<Error>({"too early"}));
  EXPECT_THAT(parse(bytes + "x"), ThrowsSaying<Error>({"head"}));
}

/// Points in the frame of a lidar at the origin: of it, then of one elsewhere.
maps::PointCloud of_two(const maps::PointCloud& first, const maps::PointCloud& second,
                        const Eigen::Vector3f& origin) {
  maps::PointCloud both;
  both.positions = first.positions;
  both.lidars.assign(first.size(), 0);
  for (const Eigen::Vector3f& p : second.positions) both.positions.push_back(p + origin);
  both.lidars.resize(both.size(), 1);
  both.lidar_origins = {Eigen::Vector3f::Zero(), origin};
  return both;
}

TEST(RangeView, RaysOfTwoLidarsBeginWhereEachStands) {
  // A wall hides from one lidar what lies beyond it; the other one stands there.
  SyntheticWorld world = wall_ahead();
  world.boxes.push_back({{40.0, -15.0, 0.0}, {40.5, 15.0, 6.0}});
  const Eigen::Vector3f origin(24.0F, 0.0F, 0.0F);
  const maps::PointCloud first = world.scan(pose_at(0, 0), dense());
  const maps::PointCloud second = world.scan(pose_at(24, 0), dense());
  const RangeView alone = view_of(first, pose_at(0, 0)), there = view_of(second, pose_at(24, 0));
  const maps::PointCloud both = of_two(first, second, origin);
  std::vector<std::uint8_t> is_ground;
  for (const Eigen::Vector3f& p : both.positions) is_ground.push_back(p.z() < -1.77F ? 1 : 0);
  const RangeView view(both, is_ground);

  const Eigen::Vector3f beyond(30.0F, 1.0F, -0.3F), on_wall(20.0F, 1.0F, -0.3F);
  EXPECT_EQ(alone.look(beyond, kCellM).sight, Sight::kHidden);
  EXPECT_EQ(view.look(beyond, kCellM).sight, Sight::kFree);
  EXPECT_EQ(view.look(beyond, kCellM).rays, there.look(beyond - origin, kCellM).rays);
  EXPECT_EQ(view.look(on_wall, kCellM).sight, Sight::kHit);
  maps::Box box;
  box.centre = {30.0, 1.0, -0.7};
  box.size_m = {2.0, 2.0, 1.6};
  EXPECT_EQ(alone.count(box).through, 0U);
  EXPECT_GT(alone.count(box).before, 0U);
  EXPECT_EQ(view.count(box).before, alone.count(box).before);
  EXPECT_GT(view.count(box).through, 0U);
  EXPECT_EQ(RangeView::from_bytes(view.to_bytes()), view);
}

TEST(RangeView, RefusesFlagsThatAreNotOneAPoint) {
  const std::vector<Eigen::Vector3f> two(2, Eigen::Vector3f::Ones());
  const std::vector<std::uint8_t> one(1);
  EXPECT_THROW(RangeView(two, one), std::invalid_argument);
}

maps::Box box_at(const Eigen::Vector3d& centre, double yaw_rad = 0.0) {
  maps::Box box;
  box.centre = centre;
  box.size_m = {4.2, 1.8, 1.5};
  box.yaw_rad = yaw_rad;
  return box;
}

TEST(BoxRays, EndInACarAndPassWhereNoneStands) {
  SyntheticWorld world = wall_ahead();
  world.boxes.push_back({{7.9, 2.1, 0.2}, {12.1, 3.9, 1.5}});
  const Seen seen(world, dense());
  const BoxRays car = seen.view.count(box_at({10.0, 3.0, -1.05}));
  EXPECT_GT(car.inside, 300U);
  EXPECT_LT(car.through, car.inside / 20);
  const BoxRays gap = seen.view.count(box_at({10.0, -3.0, -1.05}));
  EXPECT_GT(gap.through, 300U);
  EXPECT_EQ(gap.inside, 0U);
  EXPECT_EQ(gap.before, 0U);
}

TEST(BoxRays, EndBeforeABoxThatIsHidden) {
  const BoxRays rays = Seen(wall_ahead(), dense()).view.count(box_at({28.0, 0.0, 0.0}));
  EXPECT_GT(rays.before, 20U);
  EXPECT_EQ(rays.inside, 0U);
  EXPECT_EQ(rays.through, 0U);
}

TEST(BoxRays, ThatPassUnderACarDoNotSayItLeft) {
  SyntheticWorld world = wall_ahead();
  world.boxes.push_back({{7.9, -0.9, 0.3}, {12.1, 0.9, 1.5}});
  const BoxRays rays = Seen(world, dense()).view.count(box_at({10.0, 0.0, -1.05}));
  EXPECT_GT(rays.inside, 300U);
  EXPECT_LT(rays.through, rays.inside / 20);
}

TEST(BoxRays, FollowABoxAllAround) {
  const Seen seen(SyntheticWorld{}, dense());
  const BoxRays ahead = seen.view.count(box_at({9.0, 0.0, -1.05}));
  ASSERT_GT(ahead.through, 100U);
  for (double azimuth = 0.0; azimuth < 6.3; azimuth += 0.7) {
    const BoxRays there =
        seen.view.count(box_at({9.0 * std::cos(azimuth), 9.0 * std::sin(azimuth), -1.05}, azimuth));
    EXPECT_NEAR(static_cast<double>(there.through), static_cast<double>(ahead.through),
                0.1 * static_cast<double>(ahead.through))
        << azimuth;
    EXPECT_EQ(there.inside, 0U);
  }
}

TEST(BoxRays, AreNoneForABoxThatIsBrokenOrHoldsTheSensor) {
  const Seen seen(wall_ahead(), dense());
  const auto all = [&](const maps::Box& box) {
    const BoxRays rays = seen.view.count(box);
    return rays.inside + rays.through + rays.before;
  };
  EXPECT_EQ(all(box_at({0.0, 0.0, 0.0})), 0U);
  EXPECT_EQ(all(box_at({10.0, 0.0, -1.0}, std::nan(""))), 0U);
  EXPECT_EQ(all(box_at({std::numeric_limits<double>::infinity(), 0.0, 0.0})), 0U);
  maps::Box flat = box_at({10.0, 0.0, -1.0});
  flat.size_m.z() = 0.0;
  EXPECT_EQ(all(flat), 0U);
}

}  // namespace range_view_test
}  // namespace stillmap::mapping
