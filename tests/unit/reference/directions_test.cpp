#include "reference/directions.hpp"

#include "support/synthetic_world.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <vector>

namespace stillmap::mapping {
namespace directions_test {

TEST(Spherical, AgreesWithTheFormula) {
  test::Random random(3);
  for (int i = 0; i < 2000; ++i) {
    const Eigen::Vector3d p(random.normal(), random.normal(), random.normal());
    const Spherical direction = spherical_of(p.cast<float>());
    EXPECT_NEAR(direction.azimuth_rad, std::atan2(p.y(), p.x()), 1e-6);
    EXPECT_NEAR(direction.elevation_rad, std::atan2(p.z(), p.head<2>().norm()), 1e-6);
    EXPECT_NEAR(direction.range_m, p.norm(), 1e-6 * p.norm());
  }
}

TEST(Spherical, IsRightOnTheAxes) {
  constexpr float kPi = std::numbers::pi_v<float>;
  EXPECT_NEAR(spherical_of({2.0F, 0.0F, 0.0F}).azimuth_rad, 0.0F, 1e-6F);
  EXPECT_NEAR(spherical_of({0.0F, 2.0F, 0.0F}).azimuth_rad, 0.5F * kPi, 1e-6F);
  EXPECT_NEAR(spherical_of({0.0F, -2.0F, 0.0F}).azimuth_rad, -0.5F * kPi, 1e-6F);
  EXPECT_NEAR(std::abs(spherical_of({-2.0F, 0.0F, 0.0F}).azimuth_rad), kPi, 1e-6F);
  EXPECT_NEAR(spherical_of({0.0F, 0.0F, -2.0F}).elevation_rad, -0.5F * kPi, 1e-6F);
  EXPECT_EQ(spherical_of({0.0F, 0.0F, 0.0F}).range_m, 0.0F);
}

TEST(Directions, AreThoseOfThePointsOneByOne) {
  test::Random random(4);
  Eigen::Isometry3f T = Eigen::Isometry3f::Identity();
  T.linear() = Eigen::AngleAxisf(0.7F, Eigen::Vector3f(1, 2, 9).normalized()).toRotationMatrix();
  T.translation() = Eigen::Vector3f(3, -2, 1);
  for (const std::size_t count :
       {std::size_t{0}, std::size_t{1}, std::size_t{7}, Directions::kMost}) {
    std::vector<Eigen::Vector3f> points;
    for (std::size_t i = 0; i < count; ++i) {
      points.emplace_back(
          Eigen::Vector3d(random.normal(), random.normal(), random.normal()).cast<float>());
    }
    Directions directions;
    directions.set(T, points.data(), count);
    for (std::size_t i = 0; i < count; ++i) {
      const Spherical one = spherical_of(T * points[i]);
      EXPECT_NEAR(directions[i].azimuth_rad, one.azimuth_rad, 1e-6F);
      EXPECT_NEAR(directions[i].elevation_rad, one.elevation_rad, 1e-6F);
      EXPECT_NEAR(directions[i].range_m, one.range_m, 1e-5F);
    }
  }
}

TEST(Directions, AreTheSameBitsInAnyCompany) {
  test::Random random(5);
  std::vector<Eigen::Vector3f> points;
  for (int i = 0; i < 37; ++i) {
    points.emplace_back(
        Eigen::Vector3d(random.normal(), random.normal(), random.normal()).cast<float>());
  }
  Directions all;
  all.set(Eigen::Isometry3f::Identity(), points.data(), points.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Spherical one = spherical_of(points[i]);
    EXPECT_EQ(all[i].azimuth_rad, one.azimuth_rad);
    EXPECT_EQ(all[i].elevation_rad, one.elevation_rad);
    EXPECT_EQ(all[i].range_m, one.range_m);
  }
}

}  // namespace directions_test
}  // namespace stillmap::mapping
