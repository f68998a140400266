#include <stillmap/localization/tracker.hpp>

#include <stillmap/maps/error.hpp>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <support/synthetic_world.hpp>

#include <cmath>
#include <cstring>
#include <set>
#include <stdexcept>

/// A tracker that goes on elsewhere, from the bytes of its state.
namespace stillmap::localization {
namespace tracker_state_test {

using Matrix6d = Eigen::Matrix<double, 6, 6>;

/// Answers by the scan's number and the prior alone, in every way that an aligner answers.
class MoodyAligner : public Aligner {
 public:
  [[nodiscard]] AlignmentResult align(const maps::PointCloud& scan_lidar,
                                      const std::optional<Prior>& prior) const override {
    const auto number = static_cast<std::uint64_t>(scan_lidar.positions.front().x());
    test::Random random(number);
    AlignmentResult result;
    const double mood = random.uniform() + (number / 40 % 2 == 1 ? 0.35 : 0.0);
    if (mood > 0.9) return result;
    result.status = mood > 0.75 ? PoseStatus::kDegraded : PoseStatus::kOk;
    if (mood > 0.82) result.reasons = {Reason::kAmbiguous};
    const double x = 0.9 * static_cast<double>(number) + (mood < 0.02 ? 40.0 : 0.0);
    result.T_map_lidar = test::pose_at(x + 0.02 * random.normal(), 0.02 * random.normal(),
                                       0.01 * random.normal(), 0.0);
    if (prior) result.T_map_lidar.translation().z() = 0.01 * prior->T_map_lidar.translation().z();
    result.covariance = 4e-4 * Matrix6d::Identity();
    if (result.status == PoseStatus::kDegraded)
      result.degenerate_directions = {Eigen::Matrix<double, 6, 1>::Unit(0)};
    return result;
  }
};

maps::PointCloud scan_of(int number) {
  maps::PointCloud scan;
  scan.positions.emplace_back(static_cast<float>(number), 1.0F, 0.0F);
  return scan;
}

std::int64_t stamp_of(int number) {
  return 1'300'000'000'000'000'000 + 100'000'000 * std::int64_t{number};
}

std::string bits_of(const TrackedPose& pose) {
  std::string bits;
  const auto add = [&](const double* values, Eigen::Index count) {
    bits.append(reinterpret_cast<const char*>(values),
                sizeof(double) * static_cast<std::size_t>(count));
  };
  const AlignmentResult& result = pose.result;
  add(result.T_map_lidar.matrix().data(), 16);
  add(result.covariance.data(), 36);
  add(&result.protection.lateral_m, 1);
  for (const Reason reason : result.reasons) bits += static_cast<char>(reason);
  bits += static_cast<char>('a' + static_cast<int>(result.status));
  return bits + std::string(name_of(pose.searched_from));
}

/// Odometry of a vehicle that drives along x, where the scan comes with any.
std::optional<OdometryStep> odometry_to(int number, std::int64_t since_ns) {
  if (number / 25 % 2 == 0) return std::nullopt;
  const double seconds = 1e-9 * static_cast<double>(stamp_of(number) - since_ns);
  // Some of it so vague that a few scans without a match lead astray.
  const double variance = number / 50 % 2 == 0 ? 1e-3 : 4.0;
  return OdometryStep{since_ns, test::pose_at(9.0 * seconds, 0.0), variance * Matrix6d::Identity()};
}

TEST(TrackerState, ARestoredTrackerAnswersWithTheSameBits) {
  const auto aligner = std::make_shared<MoodyAligner>();
  Tracker kept(aligner);
  Tracker carried(aligner);
  kept.initialize(test::pose_at(0.0, 0.0), 0.01 * Matrix6d::Identity());
  carried.initialize(test::pose_at(0.0, 0.0), 0.01 * Matrix6d::Identity());
  std::set<std::string> ways;
  std::size_t most = 0;
  int number = 0;
  test::Random random(1);
  for (int k = 0; k < 600; ++k) {
    // Now and then a gap, which ends the tracking.
    number += random.uniform() < 0.02 ? 45 : 1 + static_cast<int>(2.0 * random.uniform());
    const auto since_ns = kept.newest_ns();
    const auto odometry = since_ns ? odometry_to(number, *since_ns) : std::nullopt;
    const TrackedPose expected = kept.track(stamp_of(number), scan_of(number), odometry);
    const TrackedPose found = carried.track(stamp_of(number), scan_of(number), odometry);
    ASSERT_EQ(bits_of(found), bits_of(expected)) << "scan " << number;
    ways.insert(std::string(name_of(found.searched_from)) + " " +
                std::string(name_of(found.result.status)));
    const std::string state = carried.state();
    most = std::max(most, state.size());
    carried = Tracker::restored(aligner, {}, state);
    ASSERT_EQ(carried.state(), state) << "scan " << number;
    ASSERT_EQ(carried.newest_ns(), stamp_of(number));
  }
  // All branches of the state machine were taken.
  EXPECT_GE(ways.size(), 8U) << testing::PrintToString(ways);
  EXPECT_LE(most, kMaxTrackerStateBytes);
  EXPECT_GT(most, 1400U);
}

TEST(TrackerState, OneWithoutAnyMatchGoesOnSearching) {
  const auto aligner = std::make_shared<MoodyAligner>();
  Tracker tracker(aligner);
  EXPECT_THROW((void)tracker.state(), std::logic_error);
  EXPECT_FALSE(tracker.newest_ns());
  int lost = 0;
  for (int number = 1; number < 400; ++number) {
    Tracker fresh(aligner);
    const TrackedPose first = fresh.track(-number, scan_of(number));
    if (first.result.status != PoseStatus::kLost) continue;
    ++lost;
    Tracker again = Tracker::restored(aligner, {}, fresh.state());
    EXPECT_EQ(again.newest_ns(), -number);
    EXPECT_EQ(again.track(1, scan_of(number)).searched_from, SearchedFrom::kEverywhere);
  }
  EXPECT_GT(lost, 10);
}

TEST(TrackerState, OdometryFromBeforeTheNewestScanGivesWayToTheVelocity) {
  const auto aligner = std::make_shared<MoodyAligner>();
  Tracker tracker(aligner);
  tracker.initialize(test::pose_at(0.9, 0.0), 0.01 * Matrix6d::Identity());
  for (int number = 1; number < 10; ++number)
    (void)tracker.track(stamp_of(number), scan_of(number));
  Tracker again = Tracker::restored(aligner, {}, tracker.state());
  const OdometryStep step{stamp_of(8), test::pose_at(1.8, 0.0), 1e-3 * Matrix6d::Identity()};
  EXPECT_EQ(tracker.track(stamp_of(10), scan_of(10), step).searched_from, SearchedFrom::kOdometry);
  EXPECT_EQ(again.track(stamp_of(10), scan_of(10), step).searched_from, SearchedFrom::kVelocity);
}

TEST(TrackerState, OtherBytesAreRefused) {
  const auto aligner = std::make_shared<MoodyAligner>();
  Tracker tracker(aligner);
  tracker.initialize(test::pose_at(0.9, 0.0), 0.01 * Matrix6d::Identity());
  for (int number = 1; number < 10; ++number)
    (void)tracker.track(stamp_of(number), scan_of(number));
  const std::string state = tracker.state();
  const auto refused = [&](const std::string& bytes) {
    EXPECT_THROW((void)Tracker::restored(aligner, {}, bytes), maps::InputError);
  };
  for (std::size_t size = 0; size < state.size(); ++size) refused(state.substr(0, size));
  refused(state + '\0');
  const auto with = [&](std::size_t at, const auto& value) {
    std::string bytes = state;
    std::memcpy(bytes.data() + at, &value, sizeof(value));
    return bytes;
  };
  refused(with(0, '\x02'));             // format
  refused(with(1, '\x03'));             // mode
  refused(with(2, '\x40'));             // flags
  refused(with(2, '\x10'));             // the newest without its state
  refused(with(11, stamp_of(1000)));    // a match in the future
  refused(with(19, std::int32_t{-1}));  // counts
  refused(with(31, stamp_of(1000)));    // an anchor in the future
  refused(with(39, 7.0));               // no rotation
  refused(with(39, std::numeric_limits<double>::quiet_NaN()));
  refused(with(31 + 8 + 96 + 288, std::numeric_limits<double>::infinity()));  // twist
}

}  // namespace tracker_state_test
}  // namespace stillmap::localization
