#include <stillmap/localization/tracker.hpp>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <support/synthetic_world.hpp>

#include <cmath>
#include <cstdint>

/// Sessions with the real aligner in synthetic worlds.
namespace stillmap::localization {
namespace tracker_in_worlds_test {

using test::pose_at;
using ::testing::Contains;
using Matrix6d = Eigen::Matrix<double, 6, 6>;

std::int64_t at_s(double seconds) {
  return std::llround(seconds * 1e9) + 1'300'000'000'000'000'000;
}

struct Street {
  test::SyntheticWorld world = test::street(21);
  std::shared_ptr<const Aligner> aligner;
  Street() {
    test::ScanPattern pattern;
    pattern.noise_m = 0.02;
    pattern.seed = 100;
    std::vector<Eigen::Isometry3d> poses;
    for (double x = 20.0; x <= 110.0; x += 3.0) poses.push_back(pose_at(x, 0.0));
    aligner = make_aligner("default", MapIndex::build(world.mapped_from(poses, pattern)), poses);
  }
};

const Street& street() {
  static const Street built;
  return built;
}

/// Along the street at 10 m/s, swaying.
Eigen::Isometry3d street_truth(double seconds) {
  return pose_at(25.0 + 10.0 * seconds, 0.8 * std::sin(seconds), 0.08 * std::cos(seconds));
}

maps::PointCloud rubbish(std::uint64_t seed) {
  test::Random random(seed);
  maps::PointCloud scan;
  for (int i = 0; i < 5000; ++i) {
    scan.positions.emplace_back(static_cast<float>(random.uniform(-30, 30)),
                                static_cast<float>(random.uniform(-30, 30)),
                                static_cast<float>(random.uniform(-2, 5)));
  }
  return scan;
}

TEST(TrackerOnAStreet, FollowsThroughBlockedAndGarbageScansAndIsNeverConfidentlyWrong) {
  Tracker tracker(street().aligner);
  test::ScanPattern pattern;
  pattern.columns = 360;
  pattern.noise_m = 0.02;
  int ok = 0;
  int degraded = 0;
  for (int k = 0; k < 40; ++k) {
    const double seconds = 0.1 * k;
    const Eigen::Isometry3d T = street_truth(seconds);
    pattern.seed = 1000 + static_cast<std::uint64_t>(k);
    maps::PointCloud scan = street().world.scan(T, pattern);
    const bool garbage = k >= 20 && k < 24;
    const bool blocked = k >= 30 && k < 33;
    if (garbage) scan = rubbish(pattern.seed);
    if (blocked) scan.positions.resize(20);
    const TrackedPose answer = tracker.track(at_s(seconds), scan);
    const double error_m = (answer.result.T_map_lidar.translation() - T.translation()).norm();
    if (answer.result.status == PoseStatus::kOk) {
      ++ok;
      EXPECT_LT(error_m, 0.1) << k;
    } else if (answer.result.status == PoseStatus::kDegraded && (garbage || blocked)) {
      ++degraded;
      EXPECT_THAT(answer.result.reasons, Contains(Reason::kCoasting)) << k;
      EXPECT_LT(error_m, 3.0 * std::sqrt(answer.result.covariance.diagonal().head<3>().sum()));
    }
  }
  EXPECT_EQ(ok, 40 - 7 - 1);  // the first is unconfirmed
  EXPECT_EQ(degraded, 7);
}

TEST(TrackerOnAStreet, FindsAVehicleThatWasCarriedAway) {
  TrackerOptions options;
  options.max_coast_s = 1.0;
  Tracker tracker(street().aligner, options);
  tracker.initialize(street_truth(0.0), 0.25 * Matrix6d::Identity());
  test::ScanPattern pattern;
  pattern.columns = 360;
  pattern.noise_m = 0.02;
  int recovered = -1;
  for (int k = 0; k < 30; ++k) {
    const double seconds = 0.1 * k;
    const Eigen::Isometry3d T = street_truth(k < 5 ? seconds : seconds + 5.0);
    pattern.seed = 2000 + static_cast<std::uint64_t>(k);
    const TrackedPose answer = tracker.track(at_s(seconds), street().world.scan(T, pattern));
    if (answer.result.status != PoseStatus::kOk) continue;
    EXPECT_LT((answer.result.T_map_lidar.translation() - T.translation()).norm(), 0.1) << k;
    if (k >= 5 && recovered < 0) recovered = k;
  }
  EXPECT_GE(recovered, 7);
  EXPECT_LE(recovered, 29);
}

TEST(TrackerInATerrace, IsNeverOkInFrontOfANeighboursHouse) {
  // Equal houses, one every 6 m.
  test::SyntheticWorld world;
  for (int k = 0; k < 30; ++k) {
    world.boxes.push_back({{6.0 * k, 8.0, 0.0}, {6.0 * k + 4.5, 16.0, 7.0}});
    world.boxes.push_back({{6.0 * k, -16.0, 0.0}, {6.0 * k + 4.5, -8.0, 7.0}});
    world.boxes.push_back({{6.0 * k + 4.5, 11.0, 0.0}, {6.0 * k + 6.0, 12.0, 7.0}});
    world.boxes.push_back({{6.0 * k + 4.5, -12.0, 0.0}, {6.0 * k + 6.0, -11.0, 7.0}});
  }
  test::ScanPattern pattern;
  pattern.columns = 360;
  pattern.noise_m = 0.02;
  pattern.max_range_m = 40.0;
  pattern.seed = 100;
  std::vector<Eigen::Isometry3d> poses;
  for (double x = 20.0; x <= 160.0; x += 3.0) poses.push_back(pose_at(x, 0.0));
  const std::shared_ptr<const Aligner> aligner =
      make_aligner("default", MapIndex::build(world.mapped_from(poses, pattern)), poses);
  struct Given {
    double off_m, sigma;
    bool tells_the_house;
  };
  for (const auto& [off_m, sigma, tells_the_house] :
       {Given{-4.0, 2.0, false}, Given{-2.0, 2.0, false}, Given{0.5, 2.0, false},
        Given{3.0, 2.0, false}, Given{4.0, 2.0, false}, Given{0.2, 0.3, true},
        Given{-0.2, 0.3, true}}) {
    Tracker tracker(aligner);
    const auto truth = [](int k) { return pose_at(70.0 + 0.5 * k, 0.5); };
    tracker.initialize(pose_at(70.0 + off_m, 0.5), sigma * sigma * Matrix6d::Identity());
    int ok = 0;
    for (int k = 0; k < 20; ++k) {
      std::optional<OdometryStep> odometry;
      if (k > 0) {
        odometry = OdometryStep{at_s(0.1 * (k - 1)), pose_at(0.5, 0.0, 0.0, 0.0),
                                1e-4 * Matrix6d::Identity()};
      }
      pattern.seed = 3000 + static_cast<std::uint64_t>(k);
      const AlignmentResult result =
          tracker.track(at_s(0.1 * k), world.scan(truth(k), pattern), odometry).result;
      if (result.status != PoseStatus::kOk) continue;
      ++ok;
      EXPECT_LT((result.T_map_lidar.translation() - truth(k).translation()).norm(), 0.3)
          << off_m << " " << k;
    }
    if (tells_the_house) {
      EXPECT_EQ(ok, 20) << off_m;
    }
  }
}

}  // namespace tracker_in_worlds_test
}  // namespace stillmap::localization
