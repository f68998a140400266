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
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

GateFigures good() {
  GateFigures figures;
  figures.queries = 200;
  figures.found = 199;
  figures.found_in_keep = 200;
  figures.static_loss = 0.001;
  figures.previous = {.ok = 190, .new_lost = 0, .driven_coverage = 0.99, .ground_coverage = 0.97};
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
  GateFigures figures = good();
  figures.found = 201;
  EXPECT_THROW((void)decide(figures, {}), std::invalid_argument);
  figures = good();
  figures.previous->new_lost = 191;
  EXPECT_THROW((void)decide(figures, {}), std::invalid_argument);
}

TEST(RebuildGate, ReadsLimitsFromAFile) {
  const test::TemporaryFolder folder;
  folder.write("gate.json", R"({"static_loss": 0.05, "new_lost": 2})");
  const GateLimits limits = read_gate_limits(folder.path() / "gate.json");
  EXPECT_EQ(limits.static_loss, 0.05);
  EXPECT_EQ(limits.new_lost, 2U);
  EXPECT_EQ(limits.found_below_keep, GateLimits{}.found_below_keep);
}

TEST(RebuildGate, RefusesAFileOfOtherThingsByName) {
  const test::TemporaryFolder folder;
  const std::vector<std::pair<std::string, std::string>> cases{
      {"", "nothing"},
      {"[]", "JSON object"},
      {"{", "JSON object"},
      {R"({"static_los": 0.05})", "static_los"},
      {R"({"static_loss": "0.05"})", ".static_loss"},
      {R"({"static_loss": 1.5})", "1.5"},
      {R"({"new_lost": -1})", ".new_lost"},
      {R"({"new_lost": 0.5})", ".new_lost"},
      {R"({"least_queries": 0})", ".least_queries"},
      {"{\"static_loss\": " + std::string(70'000, ' ') + "0}", "64 KiB"}};
  for (const auto& [text, says] : cases) {
    folder.write("gate.json", text);
    EXPECT_THAT([&] { (void)read_gate_limits(folder.path() / "gate.json"); },
                ThrowsSaying<maps::InputError>({"gate.json", says}))
        << text.substr(0, 40);
  }
  EXPECT_THAT([&] { (void)read_gate_limits(folder.path() / "none.json"); },
              ThrowsSaying<maps::InputError>({"none.json"}));
}

}  // namespace rebuild_gate_test
}  // namespace stillmap::mapping
