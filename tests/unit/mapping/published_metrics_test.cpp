#include "evaluation/published_metrics.hpp"

#include "support/synthetic_world.hpp"

#include <gtest/gtest.h>

#include <tbb/global_control.h>

#include <cmath>
#include <limits>

namespace stillmap::mapping {
namespace published_metrics_test {

struct Truth {
  std::vector<Eigen::Vector3f> positions;
  std::vector<std::uint8_t> is_dynamic;
  Eigen::Vector3f sensor{5.0F, 5.0F, 0.0F};

  Truth& add(float x, float y, float z, bool dynamic) {
    positions.emplace_back(x, y, z);
    is_dynamic.push_back(dynamic ? 1 : 0);
    return *this;
  }
  [[nodiscard]] TruthScan scan() const { return {sensor, positions, is_dynamic}; }
};

TEST(PublishedMetrics, CallsATruthPointStaticUpToFiveCentimetresFromAMapPoint) {
  PublishedMetrics metrics({{0.0F, 0.0F, 0.0F}});
  // Two of three static points kept, one of two dynamic points removed.
  metrics.add_scan(Truth()
                       .add(0.0F, 0.0F, 0.0499F, false)
                       .add(-0.02F, 0.0F, 0.0F, false)
                       .add(0.0F, 0.0501F, 0.0F, false)
                       .add(0.049F, 0.0F, 0.0F, true)
                       .add(0.03F, 0.05F, 0.0F, true)
                       .scan());
  const BenchmarkScores scores = metrics.benchmark();
  EXPECT_EQ(scores.truth_static, 3U);
  EXPECT_EQ(scores.static_kept, 2U);
  EXPECT_EQ(scores.truth_dynamic, 2U);
  EXPECT_EQ(scores.dynamic_removed, 1U);
  EXPECT_DOUBLE_EQ(scores.SA, 2.0 / 3.0);
  EXPECT_DOUBLE_EQ(scores.DA, 0.5);
  EXPECT_DOUBLE_EQ(scores.AA, std::sqrt(1.0 / 3.0));
  EXPECT_DOUBLE_EQ(scores.HA, 2.0 * (1.0 / 3.0) / (2.0 / 3.0 + 0.5));
}

TEST(PublishedMetrics, LeavesTruthBeyondFiftyMetresOutOfTheBenchmarkOnly) {
  PublishedMetrics metrics({{0.0F, 0.0F, 0.0F}});
  Truth truth;
  truth.sensor = {0.0F, 0.0F, 0.0F};
  metrics.add_scan(truth.add(49.9F, 0.0F, 0.0F, false).add(50.1F, 0.0F, 0.0F, false).scan());
  EXPECT_EQ(metrics.benchmark().truth_static, 1U);
  EXPECT_EQ(metrics.erasor().truth_static, 2U);
}

TEST(PublishedMetrics, LeavesTheCarBodyOutOfErasorOnly) {
  PublishedMetrics metrics({{0.0F, 0.0F, 0.0F}});
  Truth truth;
  truth.sensor = {0.0F, 0.0F, 0.0F};
  metrics.add_scan(truth.add(2.6F, 0.0F, -5.0F, false).add(2.8F, 0.0F, 0.0F, false).scan());
  EXPECT_EQ(metrics.benchmark().truth_static, 2U);
  EXPECT_EQ(metrics.erasor().truth_static, 1U);
}

TEST(PublishedMetrics, AddsUpScans) {
  PublishedMetrics metrics({{0.0F, 0.0F, 0.0F}});
  for (int k = 0; k < 3; ++k) {
    metrics.add_scan(Truth().add(0.01F, 0.01F, 0.01F, false).add(1.0F, 0.0F, 0.0F, true).scan());
  }
  EXPECT_EQ(metrics.benchmark().truth_static, 3U);
  EXPECT_EQ(metrics.benchmark().dynamic_removed, 3U);
  // Voxels, not points.
  EXPECT_EQ(metrics.erasor().truth_static, 1U);
  EXPECT_EQ(metrics.erasor().truth_dynamic, 1U);
}

TEST(PublishedMetrics, CountsVoxelsOfTwentyCentimetres) {
  // Voxels: static {0.01, 0.19}, mean 0.1; static {0.3}; dynamic {0.5}; dynamic {0.7}. The map
  // holds the first two and the last.
  PublishedMetrics metrics({{0.1F, 0.1F, 0.1F}, {0.3F, 0.1F, 0.1F}, {0.7F, 0.1F, 0.1F}});
  metrics.add_scan(Truth()
                       .add(0.01F, 0.1F, 0.1F, false)
                       .add(0.19F, 0.1F, 0.1F, false)
                       .add(0.3F, 0.1F, 0.1F, false)
                       .add(0.5F, 0.1F, 0.1F, true)
                       .add(0.7F, 0.1F, 0.1F, true)
                       .scan());
  const ErasorScores scores = metrics.erasor();
  EXPECT_EQ(scores.truth_static, 2U);
  EXPECT_EQ(scores.truth_dynamic, 2U);
  EXPECT_EQ(scores.static_kept, 2U);
  EXPECT_EQ(scores.dynamic_kept, 1U);
  EXPECT_DOUBLE_EQ(scores.PR, 1.0);
  EXPECT_DOUBLE_EQ(scores.RR, 0.5);
  EXPECT_DOUBLE_EQ(scores.F1, 2.0 / 3.0);
}

TEST(PublishedMetrics, KeepsAVoxelUpToHalfItsDiagonal) {
  const auto kept_at = [](float distance_m) {
    PublishedMetrics metrics({{0.01F + distance_m, 0.1F, 0.1F}});
    metrics.add_scan(Truth().add(0.01F, 0.1F, 0.1F, false).scan());
    return metrics.erasor().static_kept == 1;
  };
  EXPECT_TRUE(kept_at(0.1731F));
  EXPECT_FALSE(kept_at(0.1733F));
}

TEST(PublishedMetrics, AMapVoxelKeepsOnlyTruthOfItsOwnLabel) {
  // The ground below a car that is gone does not keep the car, although it is near.
  PublishedMetrics metrics({{0.1F, 0.1F, 0.15F}});
  metrics.add_scan(Truth().add(0.1F, 0.1F, 0.15F, false).add(0.1F, 0.1F, 0.25F, true).scan());
  EXPECT_EQ(metrics.erasor().static_kept, 1U);
  EXPECT_EQ(metrics.erasor().dynamic_kept, 0U);
  EXPECT_DOUBLE_EQ(metrics.erasor().RR, 1.0);
}

TEST(PublishedMetrics, AVoxelHasTheLabelOfThePointNearestToItsMean) {
  // Mean x of {0.02, 0.10, 0.18} is 0.10: the dynamic one in the middle decides for all.
  PublishedMetrics metrics({});
  metrics.add_scan(Truth()
                       .add(0.02F, 0.1F, 0.1F, false)
                       .add(0.10F, 0.1F, 0.1F, true)
                       .add(0.18F, 0.1F, 0.1F, false)
                       .scan());
  EXPECT_EQ(metrics.erasor().truth_dynamic, 1U);
  EXPECT_EQ(metrics.erasor().truth_static, 0U);
}

TEST(PublishedMetrics, AnEmptyMapLosesAllAndRemovesAll) {
  PublishedMetrics metrics({});
  metrics.add_scan(Truth().add(0.0F, 0.0F, 0.0F, false).add(1.0F, 0.0F, 0.0F, true).scan());
  EXPECT_EQ(metrics.benchmark().SA, 0.0);
  EXPECT_EQ(metrics.benchmark().DA, 1.0);
  EXPECT_EQ(metrics.benchmark().AA, 0.0);
  EXPECT_EQ(metrics.benchmark().HA, 0.0);
  EXPECT_EQ(metrics.erasor().PR, 0.0);
  EXPECT_EQ(metrics.erasor().RR, 1.0);
  EXPECT_EQ(metrics.erasor().F1, 0.0);
}

TEST(PublishedMetrics, IsNotANumberWithoutTruth) {
  const PublishedMetrics metrics({{0.0F, 0.0F, 0.0F}});
  EXPECT_TRUE(std::isnan(metrics.benchmark().SA));
  EXPECT_TRUE(std::isnan(metrics.benchmark().HA));
  EXPECT_TRUE(std::isnan(metrics.erasor().RR));
  EXPECT_TRUE(std::isnan(metrics.erasor().F1));
}

TEST(PublishedMetrics, RefusesBadInput) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  EXPECT_THROW(PublishedMetrics({{nan, 0.0F, 0.0F}}), std::invalid_argument);
  PublishedMetrics metrics({});
  EXPECT_THROW(metrics.add_scan(Truth().add(nan, 0.0F, 0.0F, false).scan()), std::invalid_argument);
  Truth flags_missing = Truth().add(0.0F, 0.0F, 0.0F, false);
  flags_missing.is_dynamic.clear();
  EXPECT_THROW(metrics.add_scan(flags_missing.scan()), std::invalid_argument);
}

TEST(PublishedMetrics, IsTheSameForAnyNumberOfThreads) {
  const auto judged_with = [](std::size_t threads) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    test::Random random(4);
    const auto point = [&random]() -> Eigen::Vector3f {
      return Eigen::Vector3d(random.uniform(0, 2), random.uniform(0, 2), random.uniform(0, 2))
          .cast<float>();
    };
    std::vector<Eigen::Vector3f> map(3000);
    for (Eigen::Vector3f& p : map) p = point();
    PublishedMetrics metrics(map);
    Truth truth;
    for (int i = 0; i < 4000; ++i) {
      const Eigen::Vector3f p = point();
      truth.add(p.x(), p.y(), p.z(), random.uniform() < 0.3);
    }
    metrics.add_scan(truth.scan());
    return std::array{metrics.benchmark().SA, metrics.benchmark().DA, metrics.erasor().PR,
                      metrics.erasor().RR};
  };
  EXPECT_EQ(judged_with(1), judged_with(2));
}

TEST(ErasorTruth, ScoresDoNotDependOnWhereItsTilesLie) {
  // Points on exact fractions, so that a shift of 10 m moves voxels as they are; tiles are 20 m.
  const auto scores_at = [](float shift) {
    test::Random random(8);
    const auto point = [&]() -> Eigen::Vector3f {
      const auto grid = [&](double low, double high) {
        return static_cast<float>(std::floor(random.uniform(low, high) * 1024.0) / 1024.0);
      };
      return {grid(14.0, 26.0) + shift, grid(14.0, 26.0) + shift, grid(0.0, 0.6)};
    };
    std::vector<Eigen::Vector3f> positions(20000), map(9000);
    std::vector<std::uint8_t> kinds(positions.size());
    for (std::size_t i = 0; i < positions.size(); ++i) {
      positions[i] = point();
      kinds[i] = static_cast<std::uint8_t>(random.uniform(0.0, 3.0));
    }
    for (Eigen::Vector3f& p : map) p = point();
    ErasorTruth truth;
    truth.add_scan({100.0F, 100.0F, 0.0F}, positions, kinds);
    std::array<std::uint8_t, 256> dynamic{};
    dynamic[2] = 1;
    return truth.scores(erasor_voxel_means(map), dynamic);
  };
  const ErasorScores across = scores_at(0.0F);
  const ErasorScores inside = scores_at(10.0F);
  EXPECT_GT(across.truth_static, 4000U);
  EXPECT_GT(across.truth_dynamic, 1500U);
  EXPECT_EQ(across.truth_static, inside.truth_static);
  EXPECT_EQ(across.truth_dynamic, inside.truth_dynamic);
  EXPECT_EQ(across.static_kept, inside.static_kept);
  EXPECT_EQ(across.dynamic_kept, inside.dynamic_kept);
}

TEST(ErasorTruth, SaysForEachMapWhichKindsAreDynamic) {
  ErasorTruth truth;
  const std::vector<Eigen::Vector3f> positions{
      {0.1F, 0.1F, 0.1F}, {5.1F, 0.1F, 0.1F}, {9.1F, 0.1F, 0.1F}};
  truth.add_scan({100.0F, 0.0F, 0.0F}, positions, std::vector<std::uint8_t>{1, 2, 3});
  std::array<std::uint8_t, 256> moving{}, movable{};
  moving[3] = movable[2] = movable[3] = 1;
  const std::vector<Eigen::Vector3f> map{{0.1F, 0.1F, 0.1F}, {5.1F, 0.1F, 0.1F}};
  EXPECT_EQ(truth.scores(map, moving).PR, 1.0);
  EXPECT_EQ(truth.scores(map, moving).RR, 1.0);
  EXPECT_EQ(truth.scores(map, movable).PR, 1.0);
  EXPECT_EQ(truth.scores(map, movable).RR, 0.5);
  EXPECT_EQ(truth.scores({}, movable).PR, 0.0);
}

}  // namespace published_metrics_test
}  // namespace stillmap::mapping
