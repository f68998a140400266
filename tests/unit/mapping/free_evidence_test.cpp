#include "cleaning/free_evidence.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <memory>
#include <vector>

#include "cleaning/ground_levels.hpp"
#include "cleaning/moved_cells.hpp"
#include "cleaning/thin_upright.hpp"
#include "support/synthetic_world.hpp"

namespace stillmap::mapping {
namespace free_evidence_test {

using test::pose_at;

TEST(Keyframes, AreTakenByDistanceTurnAndTime) {
  std::vector<Eigen::Isometry3d> poses;
  for (int i = 0; i < 10; ++i) poses.push_back(pose_at(0.25 * i, 0.0));
  for (int i = 1; i <= 3; ++i) poses.push_back(pose_at(2.25, 0.0, 0.2 * i));
  for (int i = 0; i < 45; ++i) poses.push_back(pose_at(2.25, 0.0, 0.6));
  std::vector<std::size_t> scans;
  for (const Keyframe& keyframe : select_keyframes(poses)) scans.push_back(keyframe.scan);
  EXPECT_THAT(scans, testing::ElementsAre(0, 3, 6, 9, 10, 11, 12, 32, 52));
  EXPECT_TRUE(select_keyframes({}).empty());
}

TEST(Keyframes, OfOnePlaceCountLess) {
  const std::vector<Eigen::Isometry3d> poses(60, pose_at(3.0, 4.0));
  const std::vector<Keyframe> keyframes = select_keyframes(poses);
  ASSERT_EQ(keyframes.size(), 3U);
  EXPECT_FLOAT_EQ(keyframes[0].weight, 1.0F);
  for (const Keyframe& keyframe : keyframes) EXPECT_EQ(keyframe.place, 0U);
  EXPECT_LT(keyframes[1].weight, 0.5F);
}

/// Views of a wall at y = 10 from (k, 0), with a board at y = 5 in some of them.
struct Board {
  std::vector<RangeView> kept;
  PosedViews views;
  std::vector<Keyframe> keyframes;

  explicit Board(const std::vector<int>& present) {
    for (std::size_t k = 0; k < present.size(); ++k) {
      test::SyntheticWorld world;
      world.boxes = {{{-50.0, 10.0, 0.0}, {50.0, 10.5, 6.0}}};
      if (present[k] != 0) world.boxes.push_back({{2.0, 5.0, 0.0}, {6.0, 5.1, 2.5}});
      const Eigen::Isometry3d T = pose_at(static_cast<double>(k), 0.0);
      const test::ScanPattern pattern{
          .rings = 24, .columns = 900, .lowest_rad = -0.25, .highest_rad = 0.1};
      kept.emplace_back(world.scan(T, pattern).positions, std::vector<std::uint8_t>{});
      views.T_local_lidar.push_back(T);
      keyframes.push_back({k, static_cast<std::uint32_t>(k), 1.0F});
    }
    views.read = [this](std::size_t k) { return std::make_shared<const RangeView>(kept[k]); };
  }
  [[nodiscard]] FreeEvidence evidence() const {
    const std::vector<Eigen::Vector3f> cell = {{4.0F, 5.0F, 1.5F}};
    return find_free_evidence(cell, 0.06F, views, keyframes).front();
  }
};

TEST(FreeEvidence, IsTheLongestRunAgainstAllThatSpeak) {
  const Board board({1, 1, 0, 0, 0, 0, 0, 0});
  const FreeEvidence evidence = board.evidence();
  EXPECT_FLOAT_EQ(evidence.hits, 2.0F);
  EXPECT_NEAR(evidence.score, 6.0 / (2.0 + 8.0), 0.02) << "dense rays weigh nearly one";
}

TEST(FreeEvidence, CountsMoreForOneRunThanForSightsInBetween) {
  const double run = Board({1, 1, 1, 1, 0, 0, 0, 0}).evidence().score;
  const double between = Board({1, 0, 1, 0, 1, 0, 1, 0}).evidence().score;
  EXPECT_GT(run, 0.35);
  EXPECT_LT(between, 0.11) << "no run from two places";
}

TEST(FreeEvidence, IsNoneWithoutAnOpenView) {
  EXPECT_EQ(Board({1, 1, 1, 1, 1, 1, 1, 1}).evidence().score, 0.0F);
  EXPECT_EQ(Board({}).evidence().score, 0.0F);
}

TEST(FreeEvidence, IsNoneFromAViewWhosePoseIsInDoubtOfSomethingNear) {
  // The board stands 0.8 m behind the cell.
  Board board({1, 1, 1, 1, 1, 1});
  const std::vector<Eigen::Vector3f> cell = {{4.0F, 4.2F, 1.5F}};
  const auto score = [&] {
    return find_free_evidence(cell, 0.06F, board.views, board.keyframes).front().score;
  };
  const float believed = score();
  EXPECT_GT(believed, 0.5F);
  board.views.doubts.assign(6, {.m = 0.2F, .rad = 0.0F});
  EXPECT_EQ(score(), 0.0F);
  // Five metres away a hundredth of a radian is little.
  board.views.doubts.assign(6, {.m = 0.0F, .rad = 0.001F});
  EXPECT_NEAR(score(), believed, 0.01F);
}

std::vector<Eigen::Vector3f> row_of(std::size_t count, float step_m) {
  std::vector<Eigen::Vector3f> row;
  for (std::size_t i = 0; i < count; ++i)
    row.emplace_back(step_m * static_cast<float>(i), 0.0F, 1.0F);
  return row;
}

TEST(FreeEvidence, CountsLessAgainstWhatSeveralPassesHit) {
  Board board({1, 1, 1, 0, 0, 0});
  const float one_pass = board.evidence().score;
  for (std::size_t k = 2; k < board.keyframes.size(); ++k) board.keyframes[k].place += 100;
  EXPECT_NEAR(board.evidence().score, 0.5F * one_pass, 1e-6F);
}

/// Cells on a vertical line.
std::vector<Eigen::Vector3f> pole_of(double height_m) {
  std::vector<Eigen::Vector3f> pole;
  for (double z = 0.2; z < height_m; z += 0.1) pole.emplace_back(2.0F, 3.0F, static_cast<float>(z));
  return pole;
}

TEST(ThinUpright, ArePolesAndNeitherWallsNorBushesNorStumps) {
  const auto share = [](const std::vector<Eigen::Vector3f>& cells) {
    const std::vector<std::uint8_t> all(cells.size(), 1);
    const auto thin = thin_upright(cells, all);
    return static_cast<double>(std::count(thin.begin(), thin.end(), 1)) /
           static_cast<double>(cells.size());
  };
  EXPECT_EQ(share(pole_of(2.5)), 1.0);
  EXPECT_EQ(share(pole_of(0.7)), 0.0);
  std::vector<Eigen::Vector3f> wall;
  for (int x = 0; x < 30; ++x)
    for (const Eigen::Vector3f& p : pole_of(2.5))
      wall.emplace_back(p + Eigen::Vector3f(0.1F * static_cast<float>(x), 0.0F, 0.0F));
  EXPECT_EQ(share(wall), 0.0);
  test::Random random(3);
  std::vector<Eigen::Vector3f> bush;
  for (int i = 0; i < 400; ++i)
    bush.emplace_back(static_cast<float>(random.uniform(0.0, 1.5)),
                      static_cast<float>(random.uniform(0.0, 1.5)),
                      static_cast<float>(random.uniform(0.2, 2.0)));
  EXPECT_LT(share(bush), 0.02);
  // Only those that are asked for.
  std::vector<std::uint8_t> some(pole_of(2.5).size());
  some[4] = 1;
  const auto thin = thin_upright(pole_of(2.5), some);
  EXPECT_EQ(thin[4], 1);
  EXPECT_EQ(std::count(thin.begin(), thin.end(), 1), 1);
}

TEST(MovedCells, OfAPoleNeedMoreAgainstThem) {
  const std::vector<Eigen::Vector3f> pole = pole_of(2.5);
  const auto moved = [&](float score) {
    return moved_cells(pole, std::vector<FreeEvidence>(pole.size(), {score, 3.0F}), 0.3F);
  };
  EXPECT_THAT(moved(0.3F), testing::Each(0));
  EXPECT_THAT(moved(0.7F), testing::Each(1)) << "somebody who stood there and went";
  const std::vector<Eigen::Vector3f> row = row_of(20, 0.1F);
  EXPECT_THAT(moved_cells(row, std::vector<FreeEvidence>(row.size(), {0.3F, 3.0F}), 0.3F),
              testing::Each(1));
}

TEST(MovedCells, GoTogetherWhenMostOfThemGo) {
  std::vector<FreeEvidence> evidence(9, {0.6F, 1.0F});
  evidence[4] = {0.0F, 4.0F};
  EXPECT_THAT(moved_cells(row_of(9, 0.1F), evidence, 0.3F), testing::Each(1));
}

TEST(MovedCells, StayAmongThoseThatStay) {
  std::vector<FreeEvidence> evidence(9, {0.0F, 20.0F});
  evidence[4] = {0.9F, 1.0F};
  EXPECT_THAT(moved_cells(row_of(9, 0.1F), evidence, 0.3F), testing::Each(0));
}

TEST(MovedCells, GrowOverWhatNoViewSpeaksOfButNotOverWhatManyHit) {
  std::vector<FreeEvidence> evidence(8, {0.8F, 0.0F});
  evidence[6] = evidence[7] = {0.0F, 0.0F};
  const auto grown = moved_cells(row_of(8, 0.1F), evidence, 0.3F);
  EXPECT_EQ(grown[7], 1);
  for (std::size_t i = 4; i < 8; ++i) evidence[i] = {0.0F, 30.0F};
  const auto kept = moved_cells(row_of(8, 0.1F), evidence, 0.3F);
  EXPECT_EQ(kept[0], 1);
  EXPECT_EQ(kept[7], 0);
}

TEST(MovedCells, DependOnWhatIsNearOnly) {
  test::Random random(2);
  std::vector<Eigen::Vector3f> near, all;
  std::vector<FreeEvidence> evidence_near, evidence_all;
  for (int i = 0; i < 3000; ++i) {
    const Eigen::Vector3f p(static_cast<float>(random.uniform(0.0, 6.0)),
                            static_cast<float>(random.uniform(0.0, 2.0)),
                            static_cast<float>(random.uniform(0.0, 1.0)));
    const FreeEvidence evidence{static_cast<float>(random.uniform(0.0, 0.3)), 0.0F};
    all.push_back(p);
    evidence_all.push_back(evidence);
    if (p.x() > 1.0F + 0.3F * kMovedReachBalls) continue;
    near.push_back(p);
    evidence_near.push_back(evidence);
  }
  const auto part = moved_cells(near, evidence_near, 0.3F);
  const auto whole = moved_cells(all, evidence_all, 0.3F);
  std::size_t compared = 0;
  for (std::size_t i = 0, k = 0; i < all.size(); ++i) {
    if (all[i].x() > 1.0F + 0.3F * kMovedReachBalls) continue;
    if (all[i].x() < 1.0F) {
      ASSERT_EQ(part[k], whole[i]);
      ++compared;
    }
    ++k;
  }
  EXPECT_GT(compared, 300U);
}

TEST(MovedCells, RefuseWhatDoesNotFit) {
  const std::vector<FreeEvidence> one(1);
  EXPECT_THROW(static_cast<void>(moved_cells(row_of(2, 0.1F), one, 0.3F)), std::invalid_argument);
  EXPECT_THROW(static_cast<void>(moved_cells(row_of(1, 0.1F), one, std::nanf(""))),
               std::invalid_argument);
  EXPECT_TRUE(moved_cells({}, {}, 0.3F).empty());
}

TEST(GroundLevels, TellTheNearestGroundsHeight) {
  const std::vector<Eigen::Vector3f> points = {
      {0.5F, 0.5F, 1.0F}, {0.6F, 0.4F, 2.0F}, {-2.5F, 0.5F, 4.0F}, {0.5F, 0.5F, 99.0F}};
  const std::vector<std::uint8_t> is_ground = {1, 1, 1, 0};
  const GroundLevels ground(points, is_ground);
  EXPECT_FLOAT_EQ(*ground.below({0.1F, 0.9F, 7.0F}), 1.5F);
  EXPECT_FLOAT_EQ(*ground.below({-1.5F, 0.5F, 7.0F}), 4.0F);
  EXPECT_FLOAT_EQ(*ground.below({3.5F, 0.5F, 7.0F}), 1.5F);
  EXPECT_FALSE(ground.below({4.5F, 0.5F, 7.0F}).has_value());
  EXPECT_THROW(GroundLevels(points, {}), std::invalid_argument);
}

TEST(GroundLevels, TellStoreysApart) {
  // Two decks 3 m apart; beyond x = 1 only the upper one was seen.
  std::vector<Eigen::Vector3f> points;
  for (int i = 0; i < 10; ++i) {
    for (const float z : {3.1F, 0.1F, 2.9F, -0.1F}) points.emplace_back(0.5F, 0.5F, z);
    points.emplace_back(1.5F, 0.5F, 3.0F);
  }
  const GroundLevels ground(points, std::vector<std::uint8_t>(points.size(), 1));
  for (const float x : {0.5F, 1.5F}) {
    EXPECT_NEAR(*ground.below({x, 0.5F, -0.1F}), 0.0F, 1e-6F) << x;
    EXPECT_NEAR(*ground.below({x, 0.5F, 0.9F}), 0.0F, 1e-6F) << x;
    EXPECT_NEAR(*ground.below({x, 0.5F, 2.9F}), 3.0F, 1e-6F) << x;
    EXPECT_NEAR(*ground.below({x, 0.5F, 4.5F}), 3.0F, 1e-6F) << x;
  }
  // Nothing but ground above: it is what there is.
  EXPECT_NEAR(*ground.below({4.4F, 0.5F, 0.5F}), 3.0F, 1e-6F);
}

TEST(GroundLevels, AreOneWhereLittleElseWasTakenForGround) {
  std::vector<Eigen::Vector3f> points(90, {0.5F, 0.5F, 0.0F});
  points.resize(99, {0.5F, 0.5F, 2.75F});
  const GroundLevels ground(points, std::vector<std::uint8_t>(points.size(), 1));
  for (const float z : {0.5F, 3.0F}) EXPECT_FLOAT_EQ(*ground.below({0.5F, 0.5F, z}), 0.25F);
}

TEST(GroundLevels, AreOneWhereGroundIsSteepWithoutAGap) {
  std::vector<Eigen::Vector3f> points;
  for (const float z : {0.0F, 4.0F, 2.0F, 1.0F, 3.0F}) points.emplace_back(0.5F, 0.5F, z);
  const GroundLevels ground(points, std::vector<std::uint8_t>(points.size(), 1));
  EXPECT_FLOAT_EQ(*ground.below({0.5F, 0.5F, 4.0F}), 2.0F);
  EXPECT_FLOAT_EQ(*ground.below({0.5F, 0.5F, 1.0F}), 2.0F);
}

}  // namespace free_evidence_test
}  // namespace stillmap::mapping
