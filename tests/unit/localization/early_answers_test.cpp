// What answers from some of the points answers as all of them would.
#include "align/query.hpp"
#include "align/support.hpp"
#include "align/uncertainty.hpp"
#include "index/index_window.hpp"

#include <gtest/gtest.h>

#include <support/synthetic_world.hpp>

#include <algorithm>
#include <cmath>
#include <vector>

namespace stillmap::localization {
namespace early_answers_test {

using test::pose_at;

std::vector<Eigen::Isometry3d> drive_through() {
  std::vector<Eigen::Isometry3d> poses;
  for (double x = 40.0; x <= 80.0; x += 4.0) poses.push_back(pose_at(x, 0.0, 0.02));
  return poses;
}

TEST(ScoreAbove, IsTheScoreOfAllPointsOrNothingWhereThatIsLess) {
  const test::SyntheticWorld world = test::street(21);
  const auto index = MapIndex::build(world.mapped_from(drive_through(), {}));
  const Eigen::Isometry3d T_map_lidar = pose_at(60.0, 0.3, 0.02);
  const auto window = index->around(T_map_lidar.translation());
  const maps::PointCloud scan = world.scan(T_map_lidar, {});
  const Query query =
      query_of(picked(view_of(scan), thin_points(view_of(scan))), T_map_lidar.linear());
  Eigen::Isometry3d T_index_lidar = T_map_lidar;
  T_index_lidar.translation() -= window->origin();
  std::size_t given = 0, left_out = 0;
  for (const std::size_t stride : {1, 7}) {
    for (double off_m = -6.0; off_m <= 6.0; off_m += 0.5) {
      const Eigen::Isometry3d T = T_index_lidar * Eigen::Translation3d(off_m, 0.1 * off_m, 0.0);
      const double score = support_of(window->levels(), query, T, stride).score();
      for (const double least : {0.0, 0.3 * score, score, score + 1e-6, score + 0.2, 1.1}) {
        const double above = score_above(least, window->levels(), query, T, stride);
        if (least <= score) {
          EXPECT_EQ(above, score) << off_m << " m, at least " << least;
          ++given;
        } else {
          // All points may be needed, and then their score is known.
          EXPECT_TRUE(above == 0.0 || above == score) << off_m << " m, at least " << least;
          left_out += above == 0.0 ? 1 : 0;
        }
      }
    }
  }
  EXPECT_GT(given, 100U);
  EXPECT_GT(left_out, 100U);
}

/// Costs of 2,000 points, those at another pose higher by `rise` in the mean.
struct Costs {
  Costs(std::uint64_t seed, double rise) {
    test::Random random(seed);
    for (std::size_t i = 0; i < 2000; ++i) {
      here.push_back(static_cast<float>(random.uniform(0.0, 1.0)));
      there.push_back(std::clamp(here.back() + static_cast<float>(rise + random.uniform(-0.3, 0.3)),
                                 0.0F, 1.0F));
    }
  }
  [[nodiscard]] bool rise_in_all() const {
    double sum = 0.0, squares = 0.0;
    for (std::size_t i = 0; i < here.size(); ++i) {
      const auto difference = static_cast<double>(there[i] - here[i]);
      sum += difference;
      squares += difference * difference;
    }
    return sum > kMinProbeScore * std::sqrt(squares);
  }
  [[nodiscard]] bool rise_early() {
    return rise(here, [&](std::size_t first, std::span<float> costs) {
      std::copy_n(there.begin() + static_cast<std::ptrdiff_t>(first), costs.size(), costs.begin());
      asked += costs.size();
    });
  }

  std::vector<float> here, there;
  std::size_t asked = 0;
};

TEST(Rise, IsThatOfAllCosts) {
  std::size_t rising = 0, all = 0;
  for (std::uint64_t seed = 0; seed < 60; ++seed) {
    Costs costs(seed, 0.002 * static_cast<double>(seed % 20));
    EXPECT_EQ(costs.rise_early(), costs.rise_in_all()) << seed;
    rising += costs.rise_in_all() ? 1 : 0;
    ++all;
  }
  EXPECT_GT(rising, all / 5);
  EXPECT_LT(rising, all * 4 / 5);
}

TEST(Rise, IsSeenInAFewPointsWhereItIsLarge) {
  Costs costs(3, 0.0);
  std::fill(costs.here.begin(), costs.here.end(), 0.1F);
  std::fill(costs.there.begin(), costs.there.end(), 1.0F);
  EXPECT_TRUE(costs.rise_early());
  EXPECT_LT(costs.asked, costs.here.size() / 2);
}

TEST(Rise, IsNoneWhereNothingChangesOrThereAreNoPoints) {
  Costs costs(3, 0.0);
  costs.there = costs.here;
  EXPECT_FALSE(costs.rise_early());
  EXPECT_EQ(costs.asked, costs.here.size());
  EXPECT_FALSE(rise({}, [](std::size_t, std::span<float>) {}));
}

}  // namespace early_answers_test
}  // namespace stillmap::localization
