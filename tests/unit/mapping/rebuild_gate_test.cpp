#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/mapping/rebuild_gate.hpp>
#include <stillmap/maps/error.hpp>

#include <limits>
#include <string>
#include <vector>

#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::mapping {
namespace rebuild_gate_test {

using test::ThrowsSaying;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

MapConsistency consistency(double walls_m, double entropy) {
  MapConsistency consistency;
  consistency.mean_map_entropy = entropy;
  consistency.entropy_points = 5000;
  consistency.walls = {.cells = 900, .planar_cells = 600, .median_m = walls_m, .p95_m = 0.06};
  return consistency;
}

GateFigures good() {
  GateFigures figures;
  figures.queries = 200;
  figures.found = 199;
  figures.found_in_keep = 200;
  figures.static_loss = 0.001;
  figures.previous = {.ok = 190,
                      .new_lost = 0,
                      .driven_coverage = 0.99,
                      .ground_coverage = 0.97,
                      .consistency_before = consistency(0.03, -3.9),
                      .consistency_now = consistency(0.031, -3.85)};
  return figures;
}

GateFigures first_good() {
  GateFigures figures = good();
  figures.previous.reset();
  return figures;
}

/// Names of the checks that did not pass.
std::vector<std::string> failed(const GateFigures& figures, const GateLimits& limits = {}) {
  const GateVerdict verdict = decide(figures, limits);
  std::vector<std::string> names;
  for (const GateCheck& check : verdict.checks) {
    if (!check.passed) names.push_back(check.name);
  }
  EXPECT_EQ(verdict.passed, names.empty());
  EXPECT_EQ(verdict.reasons.size(), names.size());
  return names;
}

TEST(RebuildGate, PassesAMapThatIsAsGoodAsTheOneThatKeepsEverything) {
  EXPECT_THAT(failed(good()), IsEmpty());
  EXPECT_THAT(failed(first_good()), IsEmpty());
}

TEST(RebuildGate, AllowsOnePercentagePointBelowTheKeepMapAndNotOneScanMore) {
  for (const std::size_t keep : {100U, 150U, 197U, 200U}) {
    GateFigures figures = good();
    figures.found_in_keep = keep;
    figures.found = keep - 2;
    EXPECT_THAT(failed(figures), IsEmpty()) << keep;
    figures.found = keep - 3;
    EXPECT_THAT(failed(figures), ElementsAre("found_below_keep")) << keep;
  }
}

TEST(RebuildGate, DoesNotMindBeingBetterThanTheKeepMap) {
  GateFigures figures = good();
  figures.found_in_keep = 150;
  EXPECT_THAT(failed(figures), IsEmpty());
}

TEST(RebuildGate, AllowsNoScanThatIsLostNewly) {
  GateFigures figures = good();
  figures.previous->new_lost = 1;
  EXPECT_THAT(failed(figures), ElementsAre("new_lost"));
  EXPECT_THAT(failed(figures, {.new_lost = 1}), IsEmpty());
}

TEST(RebuildGate, TakesAFigureAtItsLimit) {
  GateFigures figures = good();
  figures.static_loss = GateLimits{}.static_loss;
  figures.previous->driven_coverage = GateLimits{}.driven_coverage;
  figures.previous->ground_coverage = GateLimits{}.ground_coverage;
  EXPECT_THAT(failed(figures), IsEmpty());
  figures.static_loss += 1e-6;
  figures.previous->driven_coverage -= 1e-6;
  figures.previous->ground_coverage -= 1e-6;
  EXPECT_THAT(failed(figures), ElementsAre("static_loss", "driven_coverage", "ground_coverage"));
}

TEST(RebuildGate, DoesNotPassWhatWasNotMeasured) {
  GateFigures figures = good();
  figures.static_loss = kNaN;
  figures.previous->driven_coverage = kNaN;
  figures.previous->ground_coverage = kNaN;
  EXPECT_THAT(failed(figures), ElementsAre("static_loss", "driven_coverage", "ground_coverage"));
  EXPECT_THAT(decide(figures, {}).reasons.front(), HasSubstr("not measured"));
}

TEST(RebuildGate, ALeastShareOfNothingAsksForNothing) {
  GateFigures figures = good();
  figures.previous->driven_coverage = kNaN;
  EXPECT_THAT(failed(figures, {.driven_coverage = 0.0}), IsEmpty());
}

TEST(RebuildGate, DoesNotPassWallsThatAreAQuarterThicker) {
  GateFigures figures = good();
  const auto thick = [&](double before_m, double now_m) {
    figures.previous->consistency_before.walls.median_m = before_m;
    figures.previous->consistency_now.walls.median_m = now_m;
    return failed(figures);
  };
  EXPECT_THAT(thick(0.04, 0.05), IsEmpty());
  EXPECT_THAT(thick(0.04, 0.0501), ElementsAre("wall_thickening"));
  EXPECT_THAT(thick(0.04, 0.02), IsEmpty());
  // Of a sensor without noise half a centimetre is much, and says little.
  EXPECT_THAT(thick(0.001, 0.006), IsEmpty());
  EXPECT_THAT(thick(0.001, 0.0061), ElementsAre("wall_thickening"));
  EXPECT_THAT(failed(figures, {.wall_thickening = 0.5}), IsEmpty());
}

TEST(RebuildGate, DoesNotPassAnEntropyThatIsClearlyHigher) {
  GateFigures figures = good();
  figures.previous->consistency_now.mean_map_entropy = -3.7;
  EXPECT_THAT(failed(figures), IsEmpty());
  figures.previous->consistency_now.mean_map_entropy = -3.69;
  EXPECT_THAT(failed(figures), ElementsAre("entropy_rise"));
  EXPECT_THAT(failed(figures, {.entropy_rise = 0.3}), IsEmpty());
  EXPECT_THAT(
      decide(figures, {}).reasons,
      ElementsAre("mean map entropy is -3.69 nat, -3.90 nat in the previous version: higher "
                  "by 0.21, at most 0.2; check the poses of the new drives (`given_poses` in the "
                  "report says how far they are off)"));
  figures.previous->consistency_now.mean_map_entropy = -5.0;
  EXPECT_THAT(failed(figures), IsEmpty());
}

TEST(RebuildGate, SaysThatTooFewCellsAreInBothVersions) {
  GateFigures figures = good();
  for (MapConsistency* each :
       {&figures.previous->consistency_before, &figures.previous->consistency_now}) {
    each->walls.planar_cells = 49;
    each->entropy_points = 0;
    each->mean_map_entropy = kNaN;
  }
  figures.previous->consistency_now.walls.median_m = 0.2;
  EXPECT_THAT(failed(figures), IsEmpty());
  std::vector<std::string> words;
  for (const GateCheck& check : decide(figures, {}).checks) words.push_back(check.words);
  EXPECT_THAT(words, Contains(HasSubstr("49 cells are in both versions, too few")));
  EXPECT_THAT(words, Contains(HasSubstr("0 cells are in both versions, too few")));
}

TEST(RebuildGate, NeedsScansToJudgeBy) {
  GateFigures none;
  none.static_loss = 0.0;
  EXPECT_THAT(failed(none), ElementsAre("least_queries", "least_found_in_keep", "found_below_keep",
                                        "first_found"));
  GateFigures few = first_good();
  few.queries = few.found = few.found_in_keep = 19;
  EXPECT_THAT(failed(few), ElementsAre("least_queries"));
  few.queries = few.found = few.found_in_keep = 20;
  EXPECT_THAT(failed(few), IsEmpty());
}

TEST(RebuildGate, DoesNotBelieveScansThatNoMapKnows) {
  GateFigures figures = good();
  figures.found = figures.found_in_keep = 3;
  EXPECT_THAT(failed(figures), ElementsAre("least_found_in_keep"));
}

TEST(RebuildGate, HoldsAFirstVersionToAnAbsoluteLimit) {
  GateFigures figures = first_good();
  figures.found = figures.found_in_keep = 180;
  EXPECT_THAT(failed(figures), IsEmpty());
  figures.found = figures.found_in_keep = 179;
  EXPECT_THAT(failed(figures), ElementsAre("first_found"));
  figures.previous = good().previous;
  EXPECT_THAT(failed(figures), IsEmpty());
}

TEST(RebuildGate, SaysInWordsWhatFailed) {
  GateFigures figures = good();
  figures.found = 190;
  EXPECT_THAT(decide(figures, {}).reasons,
              ElementsAre("held-back scans found less than in the map that keeps what can move: "
                          "5 %, at most 1 %"));
}

TEST(RebuildGate, RefusesLimitsAndCountsThatCannotBe) {
  for (const double bad : {-0.1, 1.1, kNaN}) {
    EXPECT_THROW((void)decide(good(), {.static_loss = bad}), std::invalid_argument) << bad;
  }
  EXPECT_THROW((void)decide(good(), {.least_queries = 0}), std::invalid_argument);
  EXPECT_THROW((void)decide(good(), {.wall_thickening = 1.1}), std::invalid_argument);
  for (const double bad : {-0.1, 10.1, kNaN})
    EXPECT_THROW((void)decide(good(), {.entropy_rise = bad}), std::invalid_argument) << bad;
  GateFigures figures = good();
  figures.found = 201;
  EXPECT_THROW((void)decide(figures, {}), std::invalid_argument);
  figures = good();
  figures.previous->new_lost = 191;
  EXPECT_THROW((void)decide(figures, {}), std::invalid_argument);
}

TEST(RebuildGate, ReadsLimitsFromAFile) {
  const test::TemporaryFolder folder;
  folder.write(
      "gate.json",
      R"({"static_loss": 0.05, "new_lost": 2, "wall_thickening": 0.5, "entropy_rise": 1.5})");
  const GateLimits limits = read_gate_limits(folder.path() / "gate.json");
  EXPECT_EQ(limits.static_loss, 0.05);
  EXPECT_EQ(limits.new_lost, 2U);
  EXPECT_EQ(limits.wall_thickening, 0.5);
  EXPECT_EQ(limits.entropy_rise, 1.5);
  EXPECT_EQ(limits.found_below_keep, GateLimits{}.found_below_keep);
}

TEST(RebuildGate, RefusesAFileOfOtherThingsByName) {
  const test::TemporaryFolder folder;
  const std::vector<std::pair<std::string, std::string>> cases{
      {"", "no JSON"},
      {"[]", "an object"},
      {"{", "no JSON"},
      {R"({"static_los": 0.05})", "unknown key \"static_los\""},
      {R"({"static_loss": "0.05"})", ".static_loss"},
      {R"({"static_loss": 1.5})", "1.5"},
      {R"({"wall_thickening": 2})", "from 0.0 to 1.0"},
      {R"({"entropy_rise": 11})", "from 0.0 to 10.0"},
      {R"({"new_lost": -1})", ".new_lost"},
      {R"({"new_lost": 0.5})", ".new_lost"},
      {R"({"least_queries": 0})", ".least_queries"},
      {"{\"static_loss\": " + std::string(70'000, ' ') + "0}", "at most 65536"}};
  for (const auto& [text, says] : cases) {
    folder.write("gate.json", text);
    EXPECT_THAT([&] { (void)read_gate_limits(folder.path() / "gate.json"); },
                ThrowsSaying<maps::InputError>({"gate.json", says}))
        << text.substr(0, 40);
  }
  EXPECT_THAT([&] { (void)read_gate_limits(folder.path() / "none.json"); },
              ThrowsSaying<maps::StorageError>({"none.json"}));
}

}  // namespace rebuild_gate_test
}  // namespace stillmap::mapping
