#include "detection/rectangle_fit.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "support/matchers.hpp"

namespace stillmap::mapping {
namespace rectangle_fit_test {

using test::IsNearVector;
using Points = std::vector<Eigen::Vector2d>;
constexpr double kDegree = std::numbers::pi / 180.0;

/// The two sides of a 4 x 2 m rectangle that meet in `corner`, turned about it.
Points corner_at(const Eigen::Vector2d& corner, double yaw_rad) {
  const Eigen::Vector2d along(std::cos(yaw_rad), std::sin(yaw_rad));
  const Eigen::Vector2d across(-along.y(), along.x());
  Points points;
  for (int i = 0; i <= 40; ++i) points.emplace_back(corner + 0.1 * i * along);
  for (int i = 1; i <= 20; ++i) points.emplace_back(corner + 0.1 * i * across);
  return points;
}

TEST(RectangleFit, FindsACornerExactlyAtAWholeStep) {
  const Rectangle r = fit_rectangle(corner_at({7.0, -3.0}, 24.0 * kDegree));
  EXPECT_NEAR(r.yaw_rad, 24.0 * kDegree, 1e-9);
  EXPECT_THAT(r.size(), IsNearVector(Eigen::Vector2d(4.0, 2.0), 1e-9));
  EXPECT_THAT(r.to_frame(r.min), IsNearVector(Eigen::Vector2d(7.0, -3.0), 1e-9));
  EXPECT_DOUBLE_EQ(r.outline_share, 1.0);
}

TEST(RectangleFit, FindsACornerBetweenStepsToHalfAStep) {
  const Rectangle r = fit_rectangle(corner_at({7.0, -3.0}, 30.9 * kDegree));
  EXPECT_NEAR(r.yaw_rad, 30.9 * kDegree, 1.01 * kDegree);
  EXPECT_THAT(r.size(), IsNearVector(Eigen::Vector2d(4.0, 2.0), 0.08));
}

TEST(RectangleFit, TurnsByAQuarterToTheSameRectangleWithItsSidesSwapped) {
  const Rectangle r = fit_rectangle(corner_at({7.0, -3.0}, 100.0 * kDegree));
  EXPECT_NEAR(r.yaw_rad, 10.0 * kDegree, 1e-9);
  EXPECT_THAT(r.size(), IsNearVector(Eigen::Vector2d(2.0, 4.0), 1e-9));
}

TEST(RectangleFit, TellsFilledFromOutlined) {
  Points filled;
  for (int i = 0; i <= 40; ++i) {
    for (int j = 0; j <= 20; ++j) filled.emplace_back(0.1 * i, 0.1 * j);
  }
  const Rectangle r = fit_rectangle(filled);
  EXPECT_THAT(r.size(), IsNearVector(Eigen::Vector2d(4.0, 2.0), 1e-9));
  EXPECT_LT(r.outline_share, 0.4);
}

TEST(RectangleFit, OfOneOrEqualPointsHasNoExtent) {
  for (const std::size_t count : {std::size_t{1}, std::size_t{50}}) {
    const Rectangle r = fit_rectangle(Points(count, Eigen::Vector2d(3.0, 4.0)));
    EXPECT_THAT(r.size(), IsNearVector(Eigen::Vector2d(0.0, 0.0), 1e-12));
    EXPECT_THAT(r.to_frame(r.min), IsNearVector(Eigen::Vector2d(3.0, 4.0), 1e-12));
    EXPECT_DOUBLE_EQ(r.outline_share, 1.0);
  }
}

}  // namespace rectangle_fit_test
}  // namespace stillmap::mapping
