#include <stillmap/localization/tracker.hpp>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <support/synthetic_world.hpp>

#include <cmath>
#include <cstdint>
#include <stdexcept>

/// A tracker that goes on in a map which adjoins its own.
namespace stillmap::localization {
namespace tracker_hand_over_test {

using test::pose_at;
using ::testing::IsEmpty;
using Matrix6d = Eigen::Matrix<double, 6, 6>;

std::int64_t at_s(double seconds) {
  return std::llround(seconds * 1e9) + 1'300'000'000'000'000'000;
}

/// Off by up to some decimetres and a degree.
Matrix6d frames_off() {
  Eigen::Matrix<double, 6, 1> sigma;
  sigma << 0.1, 0.1, 0.1, 0.01, 0.01, 0.01;
  return sigma.cwiseAbs2().asDiagonal();
}

/// A street in two maps which overlap by 20 m. The frame of the second is far off and turned.
struct TwoMaps {
  test::SyntheticWorld world = test::street(21);
  Eigen::Isometry3d T_east_west = pose_at(-500.0, 200.0, 1.0, 3.0);
  std::shared_ptr<const Aligner> west = mapped(20.0, 75.0, Eigen::Isometry3d::Identity());
  std::shared_ptr<const Aligner> east = mapped(55.0, 110.0, T_east_west);

  [[nodiscard]] std::shared_ptr<const Aligner> mapped(double from_m, double to_m,
                                                      const Eigen::Isometry3d& T_map_world) const {
    test::ScanPattern pattern;
    pattern.noise_m = 0.02;
    pattern.seed = 100;
    std::vector<Eigen::Isometry3d> poses;
    for (double x = from_m; x <= to_m; x += 3.0) poses.push_back(pose_at(x, 0.0));
    std::vector<Eigen::Vector3d> points = world.mapped_from(poses, pattern);
    for (Eigen::Vector3d& point : points) point = T_map_world * point;
    for (Eigen::Isometry3d& T : poses) T = T_map_world * T;
    return make_aligner("default", MapIndex::build(points), poses);
  }
};

const TwoMaps& two_maps() {
  static const TwoMaps built;
  return built;
}

TEST(TrackerHandOver, DrivesBackAndForthOverABorderWithoutAGap) {
  const TwoMaps& maps = two_maps();
  // What is said of the frames is off by some centimetres.
  const Eigen::Isometry3d T_east_west_said = maps.T_east_west * pose_at(0.06, -0.05, 0.003, 0.02);
  Tracker tracker(maps.west);
  bool in_east = false;
  int crossings = 0;
  const auto truth = [](double seconds) { return pose_at(65.0 - 8.0 * std::cos(seconds), 0.4); };
  tracker.initialize(truth(0.0), 0.25 * Matrix6d::Identity());
  test::ScanPattern pattern;
  pattern.columns = 360;
  pattern.noise_m = 0.02;
  for (int k = 0; k < 70; ++k) {
    const double seconds = 0.2 * k;
    const Eigen::Isometry3d T_world_lidar = truth(seconds);
    const bool wants_east = T_world_lidar.translation().x() > 65.0;
    if (wants_east != in_east) {
      tracker = tracker.continued_in(wants_east ? maps.east : maps.west, {},
                                     wants_east ? T_east_west_said : T_east_west_said.inverse(),
                                     frames_off());
      in_east = wants_east;
      ++crossings;
    }
    pattern.seed = 1000 + static_cast<std::uint64_t>(k);
    const TrackedPose answer =
        tracker.track(at_s(seconds), maps.world.scan(T_world_lidar, pattern));
    EXPECT_EQ(answer.result.status, PoseStatus::kOk) << k;
    EXPECT_THAT(names_of(answer.result.reasons), IsEmpty()) << k;
    EXPECT_EQ(answer.searched_from, k == 0 ? SearchedFrom::kGiven : SearchedFrom::kVelocity) << k;
    const Eigen::Isometry3d T_map_world =
        in_east ? maps.T_east_west : Eigen::Isometry3d::Identity();
    const Eigen::Isometry3d off =
        (T_map_world * T_world_lidar).inverse() * answer.result.T_map_lidar;
    EXPECT_LE(std::abs(off.translation().x()), answer.result.protection.longitudinal_m) << k;
    EXPECT_LE(std::abs(off.translation().y()), answer.result.protection.lateral_m) << k;
  }
  EXPECT_EQ(crossings, 4);
}

TEST(TrackerHandOver, LeavesTheTrackerAsItIsAndAnswersLateScansInTheOtherMap) {
  const TwoMaps& maps = two_maps();
  test::ScanPattern pattern;
  pattern.columns = 360;
  Tracker west(maps.west);
  EXPECT_FALSE(west.believed_T_map_lidar());
  const auto truth = [](double seconds) { return pose_at(60.0 + 10.0 * seconds, 0.0); };
  west.initialize(truth(0.0), 0.01 * Matrix6d::Identity());
  EXPECT_TRUE(west.believed_T_map_lidar()->isApprox(truth(0.0)));
  for (const double seconds : {0.0, 0.1, 0.2, 0.4})
    (void)west.track(at_s(seconds), maps.world.scan(truth(seconds), pattern));
  Tracker east = west.continued_in(maps.east, {}, maps.T_east_west, frames_off());
  EXPECT_EQ(east.newest_ns(), west.newest_ns());
  const auto late = maps.world.scan(truth(0.3), pattern);
  for (const bool in_east : {true, false}) {
    const TrackedPose answer = (in_east ? east : west).track(at_s(0.3), late);
    EXPECT_EQ(answer.result.status, PoseStatus::kOk);
    EXPECT_EQ(answer.searched_from, SearchedFrom::kInterpolation);
    const Eigen::Isometry3d T = in_east ? maps.T_east_west * truth(0.3) : truth(0.3);
    EXPECT_LT((answer.result.T_map_lidar.translation() - T.translation()).norm(), 0.1);
  }
}

TEST(TrackerHandOver, KnowsItsPlaceUntilItIsLostOrForgotten) {
  const TwoMaps& maps = two_maps();
  test::ScanPattern pattern;
  pattern.columns = 360;
  const auto scan = [&](double x) { return maps.world.scan(pose_at(x, 0.0), pattern); };
  Tracker found(maps.west);
  EXPECT_FALSE(found.knows_place_at(at_s(0.0)));
  EXPECT_EQ(found.track(at_s(0.0), scan(60.0)).result.status, PoseStatus::kDegraded);
  EXPECT_FALSE(found.knows_place_at(at_s(0.1))) << "it is not confirmed";
  EXPECT_EQ(found.track(at_s(0.1), scan(61.0)).result.status, PoseStatus::kOk);
  EXPECT_TRUE(found.knows_place_at(at_s(0.2)));
  EXPECT_FALSE(found.knows_place_at(at_s(30.0))) << "it may be far by then";
  EXPECT_TRUE(found.knows_place_at(at_s(0.05))) << "a late scan";

  Tracker copy = found;
  copy.forget_place();
  EXPECT_TRUE(found.knows_place_at(at_s(0.2)));
  EXPECT_FALSE(copy.knows_place_at(at_s(0.2)));
  EXPECT_FALSE(copy.believed_T_map_lidar());
  EXPECT_EQ(copy.newest_ns(), found.newest_ns());
  EXPECT_EQ(copy.track(at_s(0.05), scan(60.5)).result.status, PoseStatus::kLost);
  EXPECT_EQ(copy.track(at_s(0.2), scan(62.0)).searched_from, SearchedFrom::kEverywhere);
  EXPECT_EQ(found.track(at_s(0.2), scan(62.0)).searched_from, SearchedFrom::kVelocity);

  Tracker given(maps.west);
  given.initialize(pose_at(60.0, 0.0), 0.01 * Matrix6d::Identity());
  EXPECT_TRUE(given.knows_place_at(at_s(0.0)));
}

TEST(TrackerHandOver, GoesOnFromAPoseThatWasOnlyGiven) {
  const TwoMaps& maps = two_maps();
  Tracker west(maps.west);
  west.initialize(pose_at(70.0, 0.0), 0.01 * Matrix6d::Identity());
  const Tracker east = west.continued_in(maps.east, {}, maps.T_east_west, frames_off());
  EXPECT_TRUE(east.believed_T_map_lidar()->isApprox(maps.T_east_west * pose_at(70.0, 0.0)));
  EXPECT_THROW((void)west.continued_in(maps.east, {}, maps.T_east_west, Matrix6d::Zero()),
               std::invalid_argument);
  EXPECT_THROW((void)west.continued_in(nullptr, {}, maps.T_east_west, frames_off()),
               std::invalid_argument);
}

}  // namespace tracker_hand_over_test
}  // namespace stillmap::localization
