#include <stillmap/localization/tracker.hpp>

#include <stillmap/maps/frames.hpp>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <support/synthetic_world.hpp>

#include <cmath>
#include <functional>
#include <limits>
#include <stdexcept>

namespace stillmap::localization {
namespace tracker_test {

using test::pose_at;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::IsEmpty;
using Matrix6d = Eigen::Matrix<double, 6, 6>;

constexpr double kSpeedM = 10.0;
const Matrix6d kMatchCovariance = 4e-4 * Matrix6d::Identity();

std::int64_t at_s(double seconds) {
  return std::llround(seconds * 1e9) + 1'300'000'000'000'000'000;
}
/// Where the vehicle of these tests is: along x at 10 m/s.
Eigen::Isometry3d truth_at(double seconds) { return pose_at(kSpeedM * seconds, 0.0); }

AlignmentResult found_at(const Eigen::Isometry3d& T_map_lidar, PoseStatus status = PoseStatus::kOk,
                         std::vector<Reason> reasons = {}) {
  AlignmentResult result;
  result.status = status;
  result.reasons = std::move(reasons);
  result.T_map_lidar = T_map_lidar;
  result.covariance = kMatchCovariance;
  result.inlier_ratio = 0.9;
  if (status == PoseStatus::kOk) result.protection = protection_levels(kMatchCovariance);
  return result;
}
AlignmentResult lost(Reason reason = Reason::kLowInlierRatio) {
  AlignmentResult result;
  result.reasons = {reason};
  return result;
}

/// Answers what the test tells it to, and remembers what it was asked.
class ScriptedAligner : public Aligner {
 public:
  [[nodiscard]] AlignmentResult align(const maps::PointCloud& scan_lidar,
                                      const std::optional<Prior>& prior) const override {
    ++calls;
    last_prior = prior;
    last_scan = scan_lidar;
    return answer(prior);
  }
  std::function<AlignmentResult(const std::optional<Prior>&)> answer;
  mutable int calls = 0;
  mutable std::optional<Prior> last_prior;
  mutable maps::PointCloud last_scan;
};

class TrackerTest : public ::testing::Test {
 protected:
  std::shared_ptr<ScriptedAligner> aligner = std::make_shared<ScriptedAligner>();
  Tracker tracker{aligner};

  TrackedPose track(double seconds, const AlignmentResult& answer,
                    const std::optional<OdometryStep>& odometry = std::nullopt) {
    aligner->answer = [answer](const auto&) { return answer; };
    return tracker.track(at_s(seconds), {}, odometry);
  }
  TrackedPose follow(double seconds) { return track(seconds, found_at(truth_at(seconds))); }
  /// Drives to `seconds` with every scan matched.
  void drive_to(double seconds) {
    tracker.initialize(truth_at(0.0), 0.01 * Matrix6d::Identity());
    for (int k = 0; 0.1 * k < seconds + 1e-6; ++k) {
      ASSERT_EQ(follow(0.1 * k).result.status, PoseStatus::kOk) << k;
    }
  }
  [[nodiscard]] double prior_deviation_m() const {
    return std::sqrt(aligner->last_prior->covariance->diagonal().head<3>().maxCoeff());
  }
};

TEST_F(TrackerTest, FirstScanIsLookedForAroundTheGivenPose) {
  tracker.initialize(pose_at(3.0, 1.0), 0.04 * Matrix6d::Identity());
  const TrackedPose answer = track(0.0, found_at(pose_at(3.1, 1.0)));
  EXPECT_EQ(answer.searched_from, SearchedFrom::kGiven);
  EXPECT_EQ(answer.result.status, PoseStatus::kOk);
  EXPECT_TRUE(aligner->last_prior->T_map_lidar.isApprox(pose_at(3.0, 1.0)));
  EXPECT_TRUE(aligner->last_prior->covariance->isApprox(0.04 * Matrix6d::Identity()));
}

TEST_F(TrackerTest, AGivenPoseThatNothingConfirmsIsNoAnswer) {
  tracker.initialize(pose_at(3.0, 1.0), 0.04 * Matrix6d::Identity());
  EXPECT_EQ(track(0.0, lost()).result.status, PoseStatus::kLost);
  const TrackedPose against = track(0.1, found_at(pose_at(50.0, 1.0)));
  EXPECT_EQ(against.result.status, PoseStatus::kLost);
  EXPECT_THAT(against.result.reasons, Contains(Reason::kContradictsMotion));
}

TEST_F(TrackerTest, PredictsByConstantVelocity) {
  drive_to(1.0);
  const TrackedPose answer = follow(1.1);
  EXPECT_EQ(answer.searched_from, SearchedFrom::kVelocity);
  EXPECT_LT((aligner->last_prior->T_map_lidar.translation() - truth_at(1.1).translation()).norm(),
            0.01);
  EXPECT_LT(prior_deviation_m(), 0.1);
}

TEST_F(TrackerTest, AnswerKeepsTheMatchsOwnPoseAndCovariance) {
  drive_to(1.0);
  const Eigen::Isometry3d T = pose_at(11.05, 0.03);
  const TrackedPose answer = track(1.1, found_at(T));
  EXPECT_TRUE(answer.result.T_map_lidar.matrix() == T.matrix());
  EXPECT_TRUE(answer.result.covariance == kMatchCovariance);
  EXPECT_TRUE(std::isfinite(answer.result.protection.lateral_m));
}

TEST_F(TrackerTest, PredictsByOdometryWhenItIsSent) {
  drive_to(1.0);
  // The vehicle braked and turned between two scans; its wheels know.
  const OdometryStep odometry{at_s(1.0), pose_at(0.2, 0.0, 0.1, 0.0), 1e-4 * Matrix6d::Identity()};
  const Eigen::Isometry3d T = truth_at(1.0) * odometry.T_since_lidar;
  const TrackedPose answer = track(1.5, found_at(T), odometry);
  EXPECT_EQ(answer.searched_from, SearchedFrom::kOdometry);
  EXPECT_EQ(answer.result.status, PoseStatus::kOk);
  EXPECT_LT((aligner->last_prior->T_map_lidar.translation() - T.translation()).norm(), 0.01);
  EXPECT_LT(prior_deviation_m(), 0.05);
}

TEST_F(TrackerTest, OdometrySinceAnUnknownStampIsNotUsedAndTheAnswerSaysSo) {
  drive_to(1.0);
  const OdometryStep odometry{at_s(0.95), pose_at(7.0, 0.0, 0.0, 0.0), Matrix6d::Identity()};
  EXPECT_EQ(track(1.1, found_at(truth_at(1.1)), odometry).searched_from, SearchedFrom::kVelocity);
}

TEST_F(TrackerTest, AMatchThatContradictsTheMotionIsNotBelieved) {
  drive_to(1.0);
  const TrackedPose answer = track(1.1, found_at(pose_at(11.0, 1.5)));
  EXPECT_EQ(answer.result.status, PoseStatus::kDegraded);
  EXPECT_THAT(answer.result.reasons, ElementsAre(Reason::kContradictsMotion, Reason::kCoasting));
  EXPECT_LT((answer.result.T_map_lidar.translation() - truth_at(1.1).translation()).norm(), 0.01);
  EXPECT_TRUE(std::isinf(answer.result.protection.lateral_m));
  EXPECT_EQ(follow(1.2).result.status, PoseStatus::kOk);
}

TEST_F(TrackerTest, WhatTheAlignerHoldsAgainstThePriorIsSaidOnce) {
  drive_to(1.0);
  const TrackedPose answer =
      track(1.1, found_at(pose_at(11.0, 1.5), PoseStatus::kDegraded, {Reason::kContradictsPrior}));
  EXPECT_THAT(answer.result.reasons, ElementsAre(Reason::kContradictsMotion, Reason::kCoasting));
}

TEST_F(TrackerTest, BrakingAtOnceIsNoContradiction) {
  drive_to(1.0);
  double x = 10.0;
  double speed = kSpeedM;
  for (int k = 1; k <= 12; ++k) {
    speed = std::max(0.0, speed - 0.9);  // 9 m/s^2
    x += 0.1 * speed;
    EXPECT_EQ(track(1.0 + 0.1 * k, found_at(pose_at(x, 0.0))).result.status, PoseStatus::kOk) << k;
  }
}

TEST_F(TrackerTest, CoastsWithGrowingCovarianceAndTakesTheNextMatch) {
  drive_to(1.0);
  double last = kMatchCovariance(0, 0);
  for (int k = 1; k <= 8; ++k) {
    const double t = 1.0 + 0.1 * k;
    const TrackedPose answer = track(t, lost());
    EXPECT_EQ(answer.result.status, PoseStatus::kDegraded);
    EXPECT_THAT(answer.result.reasons, ElementsAre(Reason::kLowInlierRatio, Reason::kCoasting));
    EXPECT_LT((answer.result.T_map_lidar.translation() - truth_at(t).translation()).norm(), 0.05);
    EXPECT_GT(answer.result.covariance(0, 0), last);
    last = answer.result.covariance(0, 0);
  }
  EXPECT_EQ(follow(1.9).result.status, PoseStatus::kOk);
  EXPECT_LT(track(2.0, lost()).result.covariance(0, 0), 0.05);
}

TEST_F(TrackerTest, CoastingEndsInAWideSearchThenInOneOfTheWholeMap) {
  drive_to(1.0);
  double t = 1.0;
  while (track(t += 0.1, lost()).result.status == PoseStatus::kDegraded) {
    ASSERT_TRUE(aligner->last_prior);
    ASSERT_LT(t, 4.2);
  }
  EXPECT_GT(t, 2.0);
  EXPECT_TRUE(aligner->last_prior);
  EXPECT_GT(prior_deviation_m(), 2.0);
  int wide = 1;
  for (; wide < 10; ++wide) {
    const TrackedPose answer = track(t += 0.1, lost());
    EXPECT_EQ(answer.result.status, PoseStatus::kLost);
    EXPECT_THAT(answer.result.reasons, ElementsAre(Reason::kLowInlierRatio, Reason::kNotTracked));
    if (!aligner->last_prior) {
      EXPECT_EQ(answer.searched_from, SearchedFrom::kEverywhere);
      break;
    }
  }
  EXPECT_EQ(wide, 3);
}

TEST_F(TrackerTest, GoodOdometryCoastsForTheWholeTimeAllowed) {
  drive_to(1.0);
  double last = 0.0;
  for (int k = 1; k <= 29; ++k) {
    const double t = 1.0 + 0.1 * k;
    const OdometryStep odometry{at_s(t - 0.1), pose_at(1.0, 0.0, 0.0, 0.0),
                                1e-4 * Matrix6d::Identity()};
    const TrackedPose answer = track(t, lost(), odometry);
    ASSERT_EQ(answer.result.status, PoseStatus::kDegraded) << k;
    EXPECT_GT(answer.result.covariance(0, 0), last);
    last = answer.result.covariance(0, 0);
  }
  EXPECT_LT(last, 1.0);
  EXPECT_EQ(track(4.2, lost()).result.status, PoseStatus::kLost);
}

TEST_F(TrackerTest, OdometryThatIsLongIsNotBelievedToTheEndOfACorridor) {
  tracker.initialize(truth_at(0.0), 1e-4 * Matrix6d::Identity());
  follow(0.0);
  // Odometry tells one part in a hundred too much, as its covariance admits; 600 m of corridor.
  const auto step = [](int k) {
    return OdometryStep{at_s(0.1 * (k - 1)), pose_at(1.01, 0.0, 0.0, 0.0),
                        1e-4 * Matrix6d::Identity()};
  };
  for (int k = 1; k <= 600; ++k) {
    AlignmentResult match =
        found_at(pose_at(1.01 * k, 0.0), PoseStatus::kDegraded, {Reason::kUnobservableDirection});
    match.covariance(0, 0) = 100.0;
    match.degenerate_directions = {Eigen::Matrix<double, 6, 1>::Unit(0)};
    EXPECT_THAT(track(0.1 * k, match, step(k)).result.reasons,
                ElementsAre(Reason::kUnobservableDirection))
        << k;
  }
  EXPECT_GT(prior_deviation_m(), 5.5);
  EXPECT_LT(prior_deviation_m(), 6.5);
  EXPECT_EQ(track(60.1, found_at(truth_at(60.1)), step(601)).result.status, PoseStatus::kOk);
  EXPECT_EQ(track(60.2, found_at(truth_at(60.2)), step(602)).result.status, PoseStatus::kOk);
  EXPECT_LT(prior_deviation_m(), 0.1);
}

TEST_F(TrackerTest, MatchesThatGoOnContradictingMakeTheMotionDoubtful) {
  drive_to(1.0);
  int believed = 0;
  for (int k = 1; k <= 8; ++k) {
    const double t = 1.0 + 0.1 * k;
    const TrackedPose answer = track(t, found_at(pose_at(10.0 * t, 5.0)));
    if (answer.result.status == PoseStatus::kOk) {
      believed = k;
      break;
    }
    EXPECT_THAT(answer.result.reasons,
                k <= 5 ? Contains(Reason::kContradictsMotion) : Contains(Reason::kUnconfirmed));
  }
  EXPECT_EQ(believed, 7);
}

TEST_F(TrackerTest, FoundWithoutAPriorIsOkOnlyWhenTheNextScanAgrees) {
  const TrackedPose first = follow(0.0);
  EXPECT_EQ(first.searched_from, SearchedFrom::kEverywhere);
  EXPECT_EQ(first.result.status, PoseStatus::kDegraded);
  EXPECT_THAT(first.result.reasons, ElementsAre(Reason::kUnconfirmed));
  EXPECT_TRUE(std::isinf(first.result.protection.lateral_m));
  EXPECT_TRUE(first.result.T_map_lidar.isApprox(truth_at(0.0)));
  const TrackedPose second = follow(0.1);
  EXPECT_EQ(second.searched_from, SearchedFrom::kEverywhere);
  EXPECT_EQ(second.result.status, PoseStatus::kOk);
  EXPECT_THAT(second.result.reasons, IsEmpty());
  EXPECT_EQ(follow(0.2).searched_from, SearchedFrom::kVelocity);
}

TEST_F(TrackerTest, ScansFarApartAreSearchedForButStayConfirmed) {
  // After a second nothing is known of where a vehicle of unknown speed is; the map knows.
  EXPECT_EQ(follow(0.0).result.status, PoseStatus::kDegraded);
  EXPECT_EQ(follow(1.0).result.status, PoseStatus::kOk);
  for (const double seconds : {4.0, 7.0, 9.5}) {
    const TrackedPose answer = follow(seconds);
    EXPECT_EQ(answer.result.status, PoseStatus::kOk) << seconds;
    EXPECT_EQ(answer.searched_from, SearchedFrom::kEverywhere) << seconds;
  }
  // What was seen a minute ago agrees with every place, so it confirms none.
  EXPECT_EQ(follow(70.0).result.status, PoseStatus::kDegraded);
  EXPECT_EQ(follow(70.1).result.status, PoseStatus::kOk);
}

TEST_F(TrackerTest, AWrongRelocationIsNotBelieved) {
  // Two wrong places far apart, then the right one: only the fourth answer has been agreed with.
  EXPECT_EQ(track(0.0, found_at(pose_at(200.0, 0.0))).result.status, PoseStatus::kDegraded);
  const TrackedPose second = track(0.1, found_at(pose_at(-90.0, 40.0)));
  EXPECT_EQ(second.result.status, PoseStatus::kDegraded);
  EXPECT_THAT(second.result.reasons, ElementsAre(Reason::kContradictsMotion, Reason::kUnconfirmed));
  EXPECT_EQ(follow(0.2).result.status, PoseStatus::kDegraded);
  EXPECT_EQ(follow(0.3).result.status, PoseStatus::kOk);
}

TEST_F(TrackerTest, AnAmbiguousPlaceConfirmsNothing) {
  follow(0.0);
  const TrackedPose answer =
      track(0.1, found_at(truth_at(0.1), PoseStatus::kDegraded, {Reason::kAmbiguous}));
  EXPECT_THAT(answer.result.reasons, ElementsAre(Reason::kAmbiguous, Reason::kUnconfirmed));
  EXPECT_EQ(follow(0.2).result.status, PoseStatus::kOk);
}

TEST_F(TrackerTest, AnAmbiguousPlaceLeavesTheGivenPoseAsVagueAsItWas) {
  // Two places fit, 6 m apart; the given pose admits both, and a scan later on tells them apart.
  tracker.initialize(pose_at(4.0, 0.0), 4.0 * Matrix6d::Identity());
  const Matrix6d step = 1e-4 * Matrix6d::Identity();
  for (int k = 0; k < 20; ++k) {
    std::optional<OdometryStep> odometry;
    if (k > 0) odometry = OdometryStep{at_s(0.1 * (k - 1)), pose_at(1.0, 0.0, 0.0, 0.0), step};
    const Eigen::Isometry3d wrong = pose_at(6.0 + k, 0.0);
    const TrackedPose answer =
        track(0.1 * k, found_at(wrong, PoseStatus::kDegraded, {Reason::kAmbiguous}), odometry);
    EXPECT_THAT(answer.result.reasons, ElementsAre(Reason::kAmbiguous)) << k;
    EXPECT_GT(prior_deviation_m(), 1.9) << k;
  }
  for (int k = 20; k < 22; ++k) {
    const OdometryStep odometry{at_s(0.1 * (k - 1)), pose_at(1.0, 0.0, 0.0, 0.0), step};
    EXPECT_EQ(track(0.1 * k, found_at(truth_at(0.1 * k)), odometry).result.status, PoseStatus::kOk);
  }
  EXPECT_LT(prior_deviation_m(), 0.1);
}

TEST_F(TrackerTest, AnAmbiguousPlaceOfAVehicleWhosePlaceIsKnownIsBelieved) {
  drive_to(1.0);
  for (int k = 1; k <= 60; ++k) {
    const double t = 1.0 + 0.1 * k;
    const TrackedPose answer =
        track(t, found_at(truth_at(t), PoseStatus::kDegraded, {Reason::kAmbiguous}));
    EXPECT_THAT(answer.result.reasons, ElementsAre(Reason::kAmbiguous)) << k;
    EXPECT_LT(prior_deviation_m(), 0.15) << k;
  }
}

TEST_F(TrackerTest, AGivenPoseThatWasOffIsNoMotion) {
  // Standing, given 1.5 m off with a deviation of 0.2 m.
  tracker.initialize(pose_at(1.5, 0.0), 0.04 * Matrix6d::Identity());
  EXPECT_EQ(track(0.0, found_at(pose_at(0.0, 0.0))).result.status, PoseStatus::kLost);
  for (int k = 1; k <= 10; ++k) {
    const TrackedPose answer = track(0.1 * k, found_at(pose_at(0.0, 0.0)));
    EXPECT_EQ(answer.result.status, PoseStatus::kOk) << k;
    if (k > 1) {
      EXPECT_LT(aligner->last_prior->T_map_lidar.translation().head<2>().norm(), 0.1) << k;
    }
  }
}

TEST_F(TrackerTest, AnUnconfirmedPlaceIsForgottenWhenNothingAgreesForLong) {
  follow(0.0);
  for (int k = 1; k <= 3; ++k) EXPECT_EQ(track(0.1 * k, lost()).result.status, PoseStatus::kLost);
  EXPECT_EQ(follow(0.4).result.status, PoseStatus::kDegraded);
}

TEST_F(TrackerTest, RecoversAfterBeingLostAndDoesNotInterpolateAcrossTheJump) {
  drive_to(1.0);
  for (double t = 1.1; t < 6.0; t += 0.1) (void)track(t, lost());
  const Eigen::Isometry3d T = pose_at(400.0, 100.0);
  EXPECT_EQ(track(6.1, found_at(T)).result.status, PoseStatus::kDegraded);
  EXPECT_EQ(track(6.2, found_at(T)).result.status, PoseStatus::kOk);
  EXPECT_THAT(track(5.55, found_at(T)).result.reasons, ElementsAre(Reason::kTooOld));
  EXPECT_EQ(track(6.15, found_at(T)).result.status, PoseStatus::kDegraded);  // unconfirmed then
  EXPECT_EQ(track(6.3, found_at(T)).result.status, PoseStatus::kOk);
  EXPECT_EQ(track(6.25, found_at(T)).result.status, PoseStatus::kOk);
}

TEST_F(TrackerTest, AWeakMatchDoesNotWidenWhatTheMotionTells) {
  drive_to(1.0);
  AlignmentResult weak =
      found_at(pose_at(11.4, 0.0), PoseStatus::kDegraded, {Reason::kUnobservableDirection});
  weak.covariance(0, 0) = 100.0;
  const TrackedPose answer = track(1.1, weak);
  EXPECT_EQ(answer.result.status, PoseStatus::kDegraded);
  EXPECT_THAT(answer.result.reasons, ElementsAre(Reason::kUnobservableDirection));
  EXPECT_DOUBLE_EQ(answer.result.covariance(0, 0), 100.0);
  follow(1.2);
  EXPECT_LT(prior_deviation_m(), 0.5);
  EXPECT_LT((aligner->last_prior->T_map_lidar.translation() - truth_at(1.2).translation()).norm(),
            0.1);
}

TEST_F(TrackerTest, AWeakMatchIsBelievedWhereAGivenPoseKnewNoHeading) {
  Matrix6d covariance = 0.04 * Matrix6d::Identity();
  covariance.diagonal().head<3>().setConstant(25.0);
  covariance(5, 5) = 9.8;
  const Eigen::Isometry3d T_given = pose_at(3.0, 1.0, -1.2);
  tracker.initialize(T_given, covariance);
  const Eigen::Isometry3d T = pose_at(6.0, -2.0, 1.7);
  AlignmentResult weak = found_at(T, PoseStatus::kDegraded, {Reason::kUnobservableDirection});
  weak.degenerate_directions = {Eigen::Matrix<double, 6, 1>::Unit(0)};
  (void)track(0.0, weak);
  (void)track(0.001, found_at(T));
  // Along the corridor it is where it was given, across it where it was found.
  const Eigen::Isometry3d error = T.inverse() * aligner->last_prior->T_map_lidar;
  EXPECT_NEAR(error.translation().x(), (T.inverse() * T_given).translation().x(), 0.05);
  EXPECT_NEAR(error.translation().y(), 0.0, 0.05);
  EXPECT_LT(maps::rotation_angle_rad(error.linear()), 0.02);
}

TEST_F(TrackerTest, AMatchThatKnowsNoHeadingTakesNoneFromAGivenPose) {
  Matrix6d covariance = 0.01 * Matrix6d::Identity();
  covariance(5, 5) = 0.09;
  tracker.initialize(pose_at(3.0, 1.0, 0.2), covariance);
  AlignmentResult weak =
      found_at(pose_at(3.0, 1.0, 0.9), PoseStatus::kDegraded, {Reason::kUnobservableDirection});
  weak.degenerate_directions = {Eigen::Matrix<double, 6, 1>::Unit(5)};
  (void)track(0.0, weak);
  (void)track(0.001, found_at(pose_at(3.0, 1.0, 0.2)));
  const Eigen::Isometry3d& T = aligner->last_prior->T_map_lidar;
  EXPECT_NEAR(std::atan2(T(1, 0), T(0, 0)), 0.2, 0.02);
}

TEST_F(TrackerTest, ALateScanIsAnsweredFromItsTimeAndMovesNothing) {
  drive_to(2.0);
  const TrackedPose late = track(1.23, found_at(truth_at(1.23)));
  EXPECT_EQ(late.result.status, PoseStatus::kOk);
  EXPECT_EQ(late.searched_from, SearchedFrom::kInterpolation);
  EXPECT_LT((aligner->last_prior->T_map_lidar.translation() - truth_at(1.23).translation()).norm(),
            0.01);
  EXPECT_LT(prior_deviation_m(), 0.1);
  follow(2.1);
  EXPECT_LT((aligner->last_prior->T_map_lidar.translation() - truth_at(2.1).translation()).norm(),
            0.01);
}

TEST_F(TrackerTest, ALateScanThatDoesNotMatchIsInterpolated) {
  drive_to(2.0);
  for (const AlignmentResult& match : {lost(), found_at(pose_at(12.0, 2.0))}) {
    const double t = match.status == PoseStatus::kLost ? 1.23 : 1.24;
    const TrackedPose late = track(t, match);
    EXPECT_EQ(late.result.status, PoseStatus::kDegraded);
    EXPECT_THAT(late.result.reasons, Contains(Reason::kInterpolated));
    EXPECT_LT((late.result.T_map_lidar.translation() - truth_at(t).translation()).norm(), 0.01);
  }
}

TEST_F(TrackerTest, OlderThanTheHistoryIsTooOldAndCostsNoSearch) {
  drive_to(7.0);
  const int calls = aligner->calls;
  const TrackedPose old = track(1.05, found_at(truth_at(1.05)));
  EXPECT_EQ(old.result.status, PoseStatus::kLost);
  EXPECT_THAT(old.result.reasons, ElementsAre(Reason::kTooOld));
  EXPECT_EQ(old.searched_from, SearchedFrom::kNowhere);
  EXPECT_EQ(aligner->calls, calls);
  EXPECT_THAT(track(-1e6, found_at(truth_at(0))).result.reasons, ElementsAre(Reason::kTooOld));
}

TEST_F(TrackerTest, AStampFarAheadCostsFourScans) {
  drive_to(1.0);
  (void)track(3600.0, found_at(truth_at(1.1)));
  for (int k = 2; k <= 5; ++k) {
    EXPECT_THAT(follow(1.0 + 0.1 * k).result.reasons, ElementsAre(Reason::kTooOld)) << k;
  }
  const TrackedPose anew = follow(1.6);
  EXPECT_EQ(anew.searched_from, SearchedFrom::kEverywhere);
  EXPECT_THAT(anew.result.reasons, ElementsAre(Reason::kUnconfirmed, Reason::kClockSetBack));
  EXPECT_EQ(follow(1.7).result.status, PoseStatus::kOk);
  EXPECT_EQ(follow(1.8).searched_from, SearchedFrom::kVelocity);
}

TEST_F(TrackerTest, AFailedCallSetsNoClockBack) {
  drive_to(7.0);
  for (int k = 1; k <= 4; ++k) (void)follow(0.1 * k);
  aligner->answer = [](const auto&) -> AlignmentResult { throw std::bad_alloc(); };
  EXPECT_THROW((void)tracker.track(at_s(0.5), {}), std::bad_alloc);
  EXPECT_EQ(follow(7.1).searched_from, SearchedFrom::kVelocity);
}

TEST_F(TrackerTest, OldScansAmongNewOnesAndTheSameOneAgainSetNoClockBack) {
  drive_to(7.0);
  for (int k = 1; k <= 12; ++k) {
    EXPECT_THAT(follow(0.01 * k).result.reasons, ElementsAre(Reason::kTooOld)) << k;
    if (k % 4 == 0) {
      EXPECT_EQ(follow(7.0 + 0.05 * k).result.status, PoseStatus::kOk) << k;
    }
  }
  for (int k = 1; k <= 12; ++k) {
    EXPECT_THAT(follow(0.5).result.reasons, ElementsAre(Reason::kTooOld)) << k;
  }
}

TEST_F(TrackerTest, TheSameStampIsAnsweredTheSameAgain) {
  drive_to(1.0);
  const int calls = aligner->calls;
  const TrackedPose again = track(0.5, lost());
  EXPECT_EQ(again.result.status, PoseStatus::kOk);
  EXPECT_TRUE(again.result.T_map_lidar.isApprox(truth_at(0.5)));
  const TrackedPose newest = track(1.0, lost());
  EXPECT_TRUE(newest.result.T_map_lidar.isApprox(truth_at(1.0)));
  EXPECT_EQ(aligner->calls, calls);
  EXPECT_EQ(follow(1.1).result.status, PoseStatus::kOk);
}

TEST_F(TrackerTest, AScansTimesAreTakenOutWithThePredictedVelocity) {
  drive_to(1.0);
  maps::PointCloud scan;
  scan.positions = {{5.0F, 0.0F, 0.0F}, {5.0F, 1.0F, 0.0F}};
  scan.time_offsets_s = {-0.05F, 0.05F};
  aligner->answer = [](const auto&) { return found_at(truth_at(1.1)); };
  (void)tracker.track(at_s(1.1), scan);
  EXPECT_NEAR(aligner->last_scan.positions[0].x(), 4.5, 0.02);
  EXPECT_NEAR(aligner->last_scan.positions[1].x(), 5.5, 0.02);
}

TEST_F(TrackerTest, AFailedCallChangesNothing) {
  drive_to(1.0);
  aligner->answer = [](const auto&) -> AlignmentResult { throw std::invalid_argument("scan"); };
  EXPECT_THROW((void)tracker.track(at_s(1.1), {}), std::invalid_argument);
  EXPECT_EQ(follow(1.1).result.status, PoseStatus::kOk);
  tracker.initialize(truth_at(0.0), 0.01 * Matrix6d::Identity());
  aligner->answer = [](const auto&) -> AlignmentResult { throw std::invalid_argument("scan"); };
  EXPECT_THROW((void)tracker.track(at_s(0.0), {}), std::invalid_argument);
  EXPECT_EQ(follow(0.0).searched_from, SearchedFrom::kGiven);
}

TEST_F(TrackerTest, RefusesTimesThatDoNotGoWithThePoints) {
  drive_to(1.0);
  maps::PointCloud scan;
  scan.positions = {{5.0F, 0.0F, 0.0F}, {5.0F, 1.0F, 0.0F}};
  scan.time_offsets_s = {0.0F};
  EXPECT_THROW((void)tracker.track(at_s(1.1), scan), std::invalid_argument);
  EXPECT_EQ(follow(1.1).result.status, PoseStatus::kOk);
}

TEST_F(TrackerTest, WhatAWideSearchFindsAgainstTheMotionSaysSo) {
  TrackerOptions options;
  options.agreeing_answers = 1;
  tracker = Tracker(aligner, options);
  drive_to(1.0);
  double t = 1.0;
  while (track(t += 0.1, lost()).result.status == PoseStatus::kDegraded) ASSERT_LT(t, 4.2);
  ASSERT_TRUE(aligner->last_prior);
  const Eigen::Isometry3d T = pose_at(truth_at(t).translation().x(), 60.0);
  const TrackedPose answer =
      track(t + 0.1, found_at(T, PoseStatus::kDegraded, {Reason::kContradictsPrior}));
  EXPECT_EQ(answer.result.status, PoseStatus::kDegraded);
  EXPECT_THAT(answer.result.reasons, ElementsAre(Reason::kContradictsMotion));
}

TEST_F(TrackerTest, RefusesWhatIsNoMotion) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  Eigen::Isometry3d broken = pose_at(0, 0);
  broken.translation().x() = nan;
  EXPECT_THROW(tracker.initialize(broken, Matrix6d::Identity()), std::invalid_argument);
  broken = pose_at(0, 0);
  broken.linear() *= nan;
  EXPECT_THROW(tracker.initialize(broken, Matrix6d::Identity()), std::invalid_argument);
  EXPECT_THROW(tracker.initialize(pose_at(0, 0), -Matrix6d::Identity()), std::invalid_argument);
  EXPECT_THROW(tracker.initialize(pose_at(0, 0), nan * Matrix6d::Identity()),
               std::invalid_argument);
  drive_to(1.0);
  OdometryStep odometry{at_s(1.0), pose_at(1e6, 0.0), Matrix6d::Identity()};
  EXPECT_THROW((void)track(1.1, lost(), odometry), std::invalid_argument);
  odometry = {at_s(1.1), pose_at(1.0, 0.0), Matrix6d::Identity()};
  EXPECT_THROW((void)track(1.1, lost(), odometry), std::invalid_argument);
  odometry = {at_s(1.0), pose_at(1.0, 0.0), Matrix6d::Zero()};
  EXPECT_THROW((void)track(1.1, lost(), odometry), std::invalid_argument);
  TrackerOptions options;
  options.max_coast_s = nan;
  EXPECT_THROW(Tracker(aligner, options), std::invalid_argument);
  EXPECT_THROW(Tracker(nullptr), std::invalid_argument);
}

TEST_F(TrackerTest, StampsAtBothEndsOfTimeAreAnswered) {
  aligner->answer = [](const auto&) { return found_at(pose_at(0, 0)); };
  (void)tracker.track(std::numeric_limits<std::int64_t>::min(), {});
  const TrackedPose last = tracker.track(std::numeric_limits<std::int64_t>::max(), {});
  EXPECT_THAT(last.result.reasons, ElementsAre(Reason::kContradictsMotion, Reason::kUnconfirmed));
  EXPECT_THAT(tracker.track(0, {}).result.reasons, ElementsAre(Reason::kTooOld));
}

}  // namespace tracker_test
}  // namespace stillmap::localization
