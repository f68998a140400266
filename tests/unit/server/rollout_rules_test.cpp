// Which vehicles are in a roll-out, and when it is halted.
#include "catalog/rollout_group.hpp"
#include "pose/halt_rule.hpp"
#include "pose/rollout_counts.hpp"
#include "pose/vehicle_table.hpp"

#include <gmock/gmock.h>

#include <cmath>
#include <random>
#include <set>
#include <string>

namespace stillmap::server {
namespace rollout_rules_test {

using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

constexpr int kLabels = 10'000;

std::set<int> group_of(const Rollout& rollout) {
  std::set<int> group;
  for (int i = 0; i < kLabels; ++i)
    if (is_in_group(rollout, "truck-" + std::to_string(i))) group.insert(i);
  return group;
}

TEST(RolloutGroup, HasItsShareOfTheLabels) {
  for (const double share : {0.01, 0.1, 0.5}) {
    const auto found =
        static_cast<double>(group_of({.map = "town", .version = "v2", .share = share}).size());
    const double deviation = std::sqrt(kLabels * share * (1.0 - share));
    EXPECT_NEAR(found, kLabels * share, 3.0 * deviation);
  }
  EXPECT_THAT(group_of({.map = "town", .version = "v2", .share = 0.0}), IsEmpty());
  EXPECT_EQ(group_of({.map = "town", .version = "v2", .share = 1.0}).size(), kLabels);
}

TEST(RolloutGroup, KeepsItsVehiclesWhenItGrows) {
  const std::set<int> small = group_of({.map = "town", .version = "v2", .share = 0.1});
  const std::set<int> large = group_of({.map = "town", .version = "v2", .share = 0.2});
  EXPECT_TRUE(std::includes(large.begin(), large.end(), small.begin(), small.end()));
}

/// Else the same vehicles would try every version of every map.
TEST(RolloutGroup, IsAnotherOneOfAnotherVersionOrMap) {
  const std::set<int> group = group_of({.map = "town", .version = "v2", .share = 0.1});
  for (const Rollout& other : {Rollout{.map = "town", .version = "v3", .share = 0.1},
                               Rollout{.map = "city", .version = "v2", .share = 0.1}}) {
    std::set<int> both;
    for (const int each : group_of(other))
      if (group.contains(each)) both.insert(each);
    EXPECT_NEAR(static_cast<double>(both.size()), 100.0, 40.0);
  }
}

TEST(RolloutGroup, IsTheSameOnEveryServer) {
  // SHA-256 of "truck-1\ntown\nv2" begins with 224e.
  Rollout rollout{.map = "town", .version = "v2"};
  rollout.share = 0x224e / 65536.0;
  EXPECT_FALSE(is_in_group(rollout, "truck-1"));
  rollout.share = 0x224f / 65536.0;
  EXPECT_TRUE(is_in_group(rollout, "truck-1"));
}

TEST(RolloutGroup, HasWhoIsNamedAndNobodyWithoutALabel) {
  const Rollout rollout{
      .map = "town", .version = "v2", .share = 0.0, .vehicles = {"depot-*", "truck 17"}};
  EXPECT_TRUE(is_in_group(rollout, "depot-3"));
  EXPECT_TRUE(is_in_group(rollout, "truck 17"));
  EXPECT_FALSE(is_in_group(rollout, "truck 170"));
  EXPECT_FALSE(is_in_group({.map = "town", .version = "v2", .share = 1.0, .vehicles = {"*"}}, ""));
}

AnswerCounts counts(std::int64_t ok, std::int64_t degraded, std::int64_t lost) {
  return {.ok = ok, .degraded = degraded, .lost = lost};
}

TEST(HaltRule, HaltsWhatIsWorseThanTheOthers) {
  const HaltOptions options{.least_answers = 200, .most_rise = 0.05};
  // 12 % against 4 %: z = 0.08 / sqrt(0.08 * 0.92 * (1/300 + 1/300)) = 3.6.
  const std::string reason =
      reason_to_halt({.rollout = counts(264, 20, 16), .others = counts(288, 6, 6)}, options);
  EXPECT_THAT(reason, HasSubstr("36 of the 300 answers in the new version are degraded or lost"));
  EXPECT_THAT(reason, HasSubstr("12 of 300 of the others in the same time (4.0 %)"));
  // The same shares of 200: z = 2.9.
  EXPECT_THAT(
      reason_to_halt({.rollout = counts(176, 14, 10), .others = counts(192, 4, 4)}, options),
      IsEmpty());
  // Certain, but small: 4 % of 20,000 against 1 %.
  EXPECT_THAT(reason_to_halt({.rollout = counts(19'200, 800, 0), .others = counts(19'800, 200, 0)},
                             options),
              IsEmpty());
  EXPECT_THAT(reason_to_halt({.rollout = counts(0, 0, 199), .others = counts(900, 0, 0)}, options),
              IsEmpty())
      << "too few answers";
}

TEST(HaltRule, ComparesLostAlone) {
  // Both have 20 % that are not ok.
  const RolloutFigures figures{.rollout = counts(240, 20, 40), .others = counts(240, 60, 0)};
  EXPECT_THAT(reason_to_halt(figures, {}), HasSubstr("40 of the 300 answers in the new version are "
                                                     "lost (13.3 %), 0 of 300 of the others"));
}

TEST(HaltRule, WithoutOthersComparesWithTheTimeBefore) {
  const AnswerCounts bad = counts(270, 30, 0);
  const AnswerCounts few = counts(20, 0, 0);
  EXPECT_THAT(reason_to_halt({.rollout = bad, .others = few, .before = counts(900, 100, 0)}, {}),
              IsEmpty())
      << "as it was";
  EXPECT_THAT(reason_to_halt({.rollout = bad, .others = few, .before = counts(990, 10, 0)}, {}),
              HasSubstr("10 of 1000 of the active version before"));
  EXPECT_THAT(reason_to_halt({.rollout = bad, .others = few}, {}), HasSubstr("none is expected"));
  EXPECT_THAT(reason_to_halt({.rollout = counts(290, 10, 0), .others = few}, {}), IsEmpty());
}

TEST(HaltRule, DoesNotHaltByChance) {
  std::mt19937 random(1);
  int halted = 0;
  constexpr int kRuns = 300;
  for (int run = 0; run < kRuns; ++run) {
    RolloutFigures figures;
    bool halts = false;
    for (int i = 0; i < 4000 && !halts; ++i) {
      const auto status = [&] { return random() % 10 == 0 ? "degraded" : "ok"; };
      figures.others.add(status());
      figures.rollout.add(status());
      halts = !reason_to_halt(figures, {}).empty();
    }
    halted += halts ? 1 : 0;
  }
  // It looks after each answer, so more often than once in 740 runs.
  EXPECT_LE(halted, kRuns / 20);
}

TEST(RolloutCountsTest, CountBothGroupsSinceItBegan) {
  using Group = RolloutCounts::Group;
  RolloutCounts counted;
  for (int i = 0; i < 3; ++i) EXPECT_EQ(counted.answered("town", "v1", "ok", {}), Group::kNone);
  Rollout rollout{.map = "town", .version = "v2", .begun_ns = 7, .active = "v1"};
  EXPECT_EQ(counted.answered("town", "v2", "lost", rollout), Group::kRollout);
  EXPECT_EQ(counted.answered("town", "v1", "degraded", rollout), Group::kOthers);
  EXPECT_EQ(counted.answered("town", "v0", "lost", rollout), Group::kNone) << "an old session";
  const RolloutFigures figures = counted.figures(rollout);
  EXPECT_EQ(figures.rollout, counts(0, 0, 1));
  EXPECT_EQ(figures.others, counts(0, 1, 0));
  EXPECT_EQ(figures.before, counts(3, 0, 0));
  rollout.halted = true;
  EXPECT_EQ(counted.answered("town", "v1", "ok", rollout), Group::kNone);
  EXPECT_EQ(counted.figures(rollout).others, counts(0, 1, 0)) << "as it was when it was halted";
  rollout = {.map = "town", .version = "v2", .begun_ns = 8, .active = "v1"};
  EXPECT_EQ(counted.answered("town", "v2", "ok", rollout), Group::kRollout);
  EXPECT_EQ(counted.figures(rollout).rollout, counts(1, 0, 0)) << "anew";
}

TEST(VehicleTableTest, KnowsTheNewestByLabel) {
  VehicleTable table;
  table.seen("town", "b", "v1", "ok", 1);
  table.seen("town", "a", "v1", "lost", 2);
  table.seen("town", "b", "v2", "", 3);
  table.seen("town", "", "v1", "ok", 4);
  table.seen("city", "c", "v1", "ok", 5);
  const auto found = table.list("town", "", 10);
  ASSERT_EQ(found.size(), 2U);
  EXPECT_EQ(found[0].label, "a");
  EXPECT_EQ(found[0].answers, counts(0, 0, 1));
  EXPECT_EQ(found[1].version, "v2");
  EXPECT_EQ(found[1].last_seen_ns, 3);
  EXPECT_EQ(found[1].answers, counts(1, 0, 0)) << "who asks for the version alone gets no pose";
  EXPECT_EQ(table.list("town", "a", 10).size(), 1U);
  EXPECT_EQ(table.list("town", "", 1).size(), 1U);
  for (std::size_t i = 0; i + 1 < VehicleTable::kMost; ++i)
    table.seen("city", "x" + std::to_string(i), "v1", "ok", 6);
  EXPECT_THAT(table.list("town", "", 10), IsEmpty()) << "those were not seen for longest";
  EXPECT_THAT(table.list("city", "", 10), Not(IsEmpty()));
  table.forget("city");
  EXPECT_THAT(table.list("city", "", 10), IsEmpty());
}

}  // namespace rollout_rules_test
}  // namespace stillmap::server
