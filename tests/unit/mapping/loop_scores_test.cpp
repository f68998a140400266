#include "evaluation/odometry/loop_scores.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <stdexcept>

#include "evaluation/odometry/trajectory_errors.hpp"

namespace stillmap::mapping {
namespace loop_scores_test {

using Poses = std::vector<Eigen::Isometry3d>;

/// 100 m straight on, there and back on the other lane, a keyframe a metre.
Poses there_and_back() {
  Poses path;
  for (int i = 0; i <= 100; ++i) {
    path.emplace_back(Eigen::Translation3d(i, 0.0, 0.0));
  }
  for (int i = 100; i >= 0; --i) {
    path.push_back(Eigen::Translation3d(i, 3.0, 0.0) *
                   Eigen::AngleAxisd(std::numbers::pi, Eigen::Vector3d::UnitZ()) *
                   Eigen::Isometry3d::Identity());
  }
  return path;
}

EvaluatedLoop loop(const Poses& path, std::size_t from, std::size_t to, double off_m = 0.0,
                   double off_deg = 0.0) {
  EvaluatedLoop found{.from = from, .to = to};
  found.T_from_to = path[from].inverse() * path[to] * Eigen::Translation3d(0.0, off_m, 0.0) *
                    Eigen::AngleAxisd(off_deg * std::numbers::pi / 180.0, Eigen::Vector3d::UnitX());
  return found;
}

LoopScores score(const Poses& path, const std::vector<EvaluatedLoop>& loops) {
  return score_loops(path, ways_m(path), loops);
}

TEST(LoopScores, ARevisitIsAPlaceSeenFiftyMetresOfPathBefore) {
  // Back at x, 100 - x out and 3 m across and as far back: 50 m are reached at x = 76, and to some
  // place within 5 m (4 m along) at x = 79: 2 (100 - x) + 3 + 4 >= 50.
  const Poses path = there_and_back();
  const LoopScores scores = score(path, {});
  EXPECT_EQ(scores.revisits, 79U);
  EXPECT_EQ(scores.revisits_found, 0U);
  EXPECT_TRUE(std::isnan(scores.precision));
  EXPECT_DOUBLE_EQ(scores.recall, 0.0);
}

TEST(LoopScores, WithoutRevisitsThereIsNothingToRecall) {
  EXPECT_TRUE(std::isnan(score({}, {}).recall));
  Poses out = there_and_back();
  out.resize(101);
  EXPECT_EQ(score(out, {}).revisits, 0U);
  EXPECT_TRUE(std::isnan(score(out, {}).recall));
}

TEST(LoopScores, ALoopHoldsTheKeyframesWithinFiveMetresOfPath) {
  const Poses path = there_and_back();
  // Keyframe 151 is back at x = 50.
  const LoopScores scores = score(path, {loop(path, 50, 151)});
  EXPECT_EQ(scores.found, 1U);
  EXPECT_EQ(scores.right, 1U);
  EXPECT_EQ(scores.revisits_found, 11U);
  EXPECT_DOUBLE_EQ(scores.precision, 1.0);
  EXPECT_DOUBLE_EQ(scores.recall, 11.0 / 79.0);
}

TEST(LoopScores, ALoopIsRightWithinHalfAMetreAndTwoDegrees) {
  const Poses path = there_and_back();
  const LoopScores scores =
      score(path, {loop(path, 50, 151, 0.49, 1.9), loop(path, 50, 151, 0.51, 0.0),
                   loop(path, 50, 151, 0.0, 2.1)});
  ASSERT_EQ(scores.loops.size(), 3U);
  EXPECT_TRUE(scores.loops[0].right);
  EXPECT_FALSE(scores.loops[1].right);
  EXPECT_FALSE(scores.loops[2].right);
  EXPECT_NEAR(scores.loops[0].translation_error_m, 0.49, 1e-9);
  EXPECT_NEAR(scores.loops[2].rotation_error_deg, 2.1, 1e-9);
  EXPECT_NEAR(scores.precision, 1.0 / 3.0, 1e-12);
}

TEST(LoopScores, AWrongLoopFindsNothing) {
  const Poses path = there_and_back();
  const LoopScores scores = score(path, {loop(path, 50, 151, 3.0)});
  EXPECT_EQ(scores.revisits_found, 0U);
  EXPECT_DOUBLE_EQ(scores.precision, 0.0);
}

TEST(LoopScores, ALoopThatIsNotANumberIsWrong) {
  const Poses path = there_and_back();
  EvaluatedLoop broken = loop(path, 50, 151);
  broken.T_from_to.translation().x() = std::nan("");
  EXPECT_FALSE(score(path, {broken}).loops[0].right);
}

TEST(LoopScores, RejectsKeyframesThatAreNotThere) {
  const Poses path = there_and_back();
  EvaluatedLoop outside;
  outside.to = path.size();
  EXPECT_THROW((void)score(path, {outside}), std::invalid_argument);
  EXPECT_THROW((void)score_loops(path, std::vector<double>{1.0}, {}), std::invalid_argument);
}

}  // namespace loop_scores_test
}  // namespace stillmap::mapping
