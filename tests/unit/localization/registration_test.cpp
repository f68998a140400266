#include "align/registration.hpp"
#include "index/index_window.hpp"

#include <stillmap/maps/frames.hpp>

#include <gtest/gtest.h>

#include <random>

#include <support/synthetic_world.hpp>

namespace stillmap::localization {
namespace registration_test {

using test::pose_at;

constexpr float kKernelM = 0.3F;

Eigen::Isometry3d tilted_pose() {
  Eigen::Isometry3d T = pose_at(3.0, -2.0, 0.7, 1.1);
  T.linear() = T.linear() *
               Eigen::AngleAxisd(0.3, Eigen::Vector3d(1, 2, -1).normalized()).toRotationMatrix();
  return T;
}

/// Rows about as far from their surfaces as real ones are at the start.
ResidualRows random_rows(std::size_t count, const Eigen::Isometry3d& T_index_lidar) {
  std::mt19937 random(7);
  std::uniform_real_distribution<float> unit(-1.0F, 1.0F);
  const auto vector = [&] {
    const float x = unit(random), y = unit(random), z = unit(random);
    return Eigen::Vector3f(x, y, z);
  };
  ResidualRows rows;
  rows.clear(T_index_lidar.translation() + Eigen::Vector3d(0.4, -0.3, 0.2));
  for (std::size_t i = 0; i < count; ++i) {
    const Eigen::Vector3f point = 30.0F * vector();
    const Eigen::Vector3f normal = vector().normalized();
    const Eigen::Vector3f placed =
        (T_index_lidar * point.cast<double>() - rows.centre).cast<float>();
    rows.add(point, normal, normal.dot(placed) + 0.2F * unit(random), 0.01F + 0.01F * unit(random));
  }
  rows.pad();
  return rows;
}

TEST(ResidualRows, JacobianIsTheNumericDerivativeForAPerturbationOnTheRight) {
  const Eigen::Isometry3d T = tilted_pose();
  const ResidualRows rows = random_rows(20, T);
  constexpr double kStep = 1e-6;
  for (std::size_t row = 0; row < rows.count; ++row) {
    const Vector6d J = axis_residual(rows, row, T).jacobian;
    for (Eigen::Index k = 0; k < 6; ++k) {
      const Vector6d step = kStep * Vector6d::Unit(k);
      const double ahead = axis_residual(rows, row, T * maps::exp_se3(step)).residual_m;
      const double behind = axis_residual(rows, row, T * maps::exp_se3(-step)).residual_m;
      EXPECT_NEAR(J[k], (ahead - behind) / (2.0 * kStep), 1e-6) << "row " << row << ", " << k;
    }
  }
}

// 1 to 40 rows: every remainder of every vector length.
TEST(ResidualRows, VectorSumsAreTheSumsOfTheRows) {
  const Eigen::Isometry3d T = tilted_pose();
  for (std::size_t count = 1; count <= 40; ++count) {
    const ResidualRows rows = random_rows(count, T);
    NormalEquations expected;
    for (std::size_t i = 0; i < count; ++i) {
      const auto [r, J] = axis_residual(rows, i, T);
      const double kernel = static_cast<double>(kKernelM);
      const double weight = robust_weight(r * r, kernel) /
                            (static_cast<double>(rows.variance_m2[i]) + kernel_variance_m2(kernel));
      expected.H += weight * J * J.transpose();
      expected.gradient += weight * r * J;
      expected.cost += kernel * kernel * r * r / (kernel * kernel + r * r);
    }
    const NormalEquations sums = linearize(rows, T, kKernelM);
    EXPECT_LT((sums.H - expected.H).norm(), 1e-5 * expected.H.norm()) << count;
    EXPECT_LT((sums.gradient - expected.gradient).norm(), 1e-4 * expected.gradient.norm()) << count;
    // Residuals are floats: some micrometres at 50 m, twice 0.2 m of them in the cost.
    EXPECT_NEAR(sums.cost, expected.cost, 1e-5 * expected.cost + 1e-6) << count;
  }
}

TEST(ResidualRows, NoRowsSumToNothing) {
  ResidualRows rows;
  rows.clear(Eigen::Vector3d::Zero());
  rows.pad();
  const NormalEquations sums = linearize(rows, tilted_pose(), kKernelM);
  EXPECT_EQ(sums.H.norm(), 0.0);
  EXPECT_EQ(sums.cost, 0.0);
}

struct MatchedStreet {
  test::SyntheticWorld world = test::street(31);
  std::shared_ptr<const MapIndex> index =
      MapIndex::build(world.mapped_from({pose_at(50.0, 0.0), pose_at(53.0, 0.0), pose_at(56.0, 0.0),
                                         pose_at(59.0, 0.0), pose_at(62.0, 0.0)},
                                        pattern(50)));
  Eigen::Isometry3d T_index_lidar = pose_at(57.0, 0.0);
  maps::PointCloud scan = world.scan(T_index_lidar, pattern(13));

  std::shared_ptr<const IndexWindow> window = index->around(T_index_lidar.translation());

  MatchedStreet() { T_index_lidar = window->from_map(T_index_lidar); }
  static test::ScanPattern pattern(std::uint64_t seed) {
    test::ScanPattern out;
    out.noise_m = 0.02;
    out.seed = seed;
    return out;
  }
  [[nodiscard]] const MapIndex::Level& level() const { return window->levels().back(); }
};

TEST(Registration, GradientPointsUphillAndHIsSymmetricPositive) {
  const MatchedStreet street;
  Eigen::Isometry3d T = street.T_index_lidar;
  T.translation() += Eigen::Vector3d(0.0, 0.05, 0.02);
  Matches matches(street.level(), street.scan.positions, 5);
  const ResidualRows& rows = matches.at(T, kKernelM);
  EXPECT_GT(rows.count, 1000U);
  const NormalEquations system = linearize(rows, T, kKernelM);
  EXPECT_LT((system.H - system.H.transpose()).norm(), 1e-9 * system.H.norm());
  EXPECT_GT(system.H.diagonal().minCoeff(), 0.0);
  const Vector6d uphill = 1e-3 * system.gradient.normalized();
  EXPECT_GT(linearize(rows, T * maps::exp_se3(uphill), kKernelM).cost,
            linearize(rows, T * maps::exp_se3(-uphill), kKernelM).cost);
}

TEST(Registration, RefineComesBackFromHalfAMetre) {
  const MatchedStreet street;
  Eigen::Isometry3d T = street.T_index_lidar;
  T.translation() += Eigen::Vector3d(0.25, -0.4, 0.1);
  const int steps = refine(street.level(), street.scan.positions,
                           {.first_kernel_m = 0.5F, .last_kernel_m = 0.15F, .max_rounds = 10}, T);
  EXPECT_GT(steps, 2);
  EXPECT_LT((T.translation() - street.T_index_lidar.translation()).norm(), 0.02);
}

TEST(Registration, RefineLeavesThePoseAloneWhereNothingMatches) {
  const MatchedStreet street;
  Eigen::Isometry3d T = street.T_index_lidar;
  T.translation().z() += 300.0;
  const Eigen::Isometry3d before = T;
  EXPECT_EQ(refine(street.level(), street.scan.positions, {}, T), 0);
  EXPECT_TRUE(T.isApprox(before));
}

}  // namespace registration_test
}  // namespace stillmap::localization
