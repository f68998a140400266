#include "evaluation/paper/paper_figures.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "support/synthetic_world.hpp"

namespace stillmap::mapping {
namespace paper_figures_test {

using localization::PoseStatus;

PaperAnswer answer(std::size_t scan, double xy_m, double yaw_rad,
                   PoseStatus status = PoseStatus::kOk) {
  return {.scan = scan,
          .status = status,
          .xy_m = xy_m,
          .yaw_rad = yaw_rad,
          .success = status != PoseStatus::kLost && xy_m < 0.2};
}

PaperRow row_of(const std::string& map, const std::vector<std::vector<PaperAnswer>>& streets) {
  PaperRow row;
  row.method = "icp";
  row.query = "raw";
  row.map = map;
  for (const std::vector<PaperAnswer>& scans : streets) {
    row.streets.emplace_back();
    row.streets.back().scans = scans;
  }
  return row;
}

PaperEvaluation judged_rows(const std::vector<PaperRow>& rows) {
  PaperEvaluation evaluation;
  evaluation.rows = rows;
  for (std::size_t i = 0; i < rows.front().streets.size(); ++i)
    evaluation.streets.push_back("seed " + std::to_string(i + 1));
  judge(evaluation);
  return evaluation;
}

TEST(PaperFigures, RmseIsOverAllScansOfAllStreets) {
  const PaperEvaluation result = judged_rows(
      {row_of("none", {{answer(1, 0.3, 0.01), answer(2, 0.4, 0.01)}, {answer(1, 0.0, 0.02)}})});
  const PaperRow& row = result.rows[0];
  EXPECT_NEAR(row.rmse_xy_m.value, std::sqrt((0.09 + 0.16) / 3.0), 1e-12);
  EXPECT_NEAR(row.rmse_yaw_rad.value, std::sqrt((1e-4 + 1e-4 + 4e-4) / 3.0), 1e-12);
  EXPECT_NEAR(street_rmse_xy_m(row.streets[0]), std::sqrt(0.125), 1e-12);
  EXPECT_NEAR(street_rmse_yaw_rad(row.streets[1]), 0.02, 1e-12);
  EXPECT_EQ(row.queries, 3U);
  EXPECT_NEAR(row.success_rate.value, 1.0 / 3.0, 1e-12);
  EXPECT_EQ(result.scans, 3U);
}

TEST(PaperFigures, ALostAnswerCountsWithItsPriorsErrorAndIsCounted) {
  const PaperEvaluation result =
      judged_rows({row_of("none", {{answer(1, 0.1, 0.0), answer(2, 0.7, 0.1, PoseStatus::kLost),
                                    answer(3, 0.1, 0.0, PoseStatus::kDegraded)}})});
  const PaperRow& row = result.rows[0];
  EXPECT_EQ(row.lost, 1U);
  EXPECT_EQ(row.degraded, 1U);
  EXPECT_NEAR(row.rmse_xy_m.value, std::sqrt((0.01 + 0.49 + 0.01) / 3.0), 1e-12);
  EXPECT_NEAR(row.answered_rmse_xy_m, 0.1, 1e-12);
  EXPECT_EQ(row.answered_rmse_yaw_rad, 0.0);
}

TEST(PaperFigures, NothingAnsweredHasNoRmseOfAnswers) {
  const PaperEvaluation result =
      judged_rows({row_of("none", {{answer(1, 0.5, 0.1, PoseStatus::kLost)}})});
  EXPECT_TRUE(std::isnan(result.rows[0].answered_rmse_xy_m));
  const nlohmann::json json = nlohmann::json::parse(to_json(result));
  EXPECT_TRUE(json["table"][0]["answered"]["rmse_xy_m"].is_null());
  EXPECT_EQ(json["table"][0]["rmse_xy_m"], 0.5);
}

/// Three streets of 40 scans; errors that all maps share, times what the map is worth.
std::vector<std::vector<PaperAnswer>> streets_of(double worth, std::uint64_t own_seed) {
  std::vector<std::vector<PaperAnswer>> streets(3);
  test::Random shared(5), own(own_seed);
  for (auto& street : streets) {
    for (std::size_t scan = 0; scan < 40; ++scan) {
      const double common = 0.1 * std::abs(shared.normal());
      const double error = worth * common + 0.002 * std::abs(own.normal());
      street.push_back(answer(scan, error, 0.01 * error));
    }
  }
  return streets;
}

TEST(PaperFigures, WhatIsHardForEveryMapCancelsInTheirDifference) {
  const PaperEvaluation result =
      judged_rows({row_of("none", streets_of(1.0, 1)), row_of("paper", streets_of(0.9, 2))});
  ASSERT_EQ(result.differences.size(), 1U);
  const PaperDifference& difference = result.differences[0];
  EXPECT_EQ(difference.map, "paper");
  EXPECT_EQ(difference.against, "none");
  EXPECT_LT(difference.rmse_xy_m.high, 0.0);
  EXPECT_LT(difference.rmse_yaw_rad.high, 0.0);
  EXPECT_NEAR(difference.rmse_xy_m.value, -0.1 * result.rows[0].rmse_xy_m.value, 2e-3);
  EXPECT_EQ(difference.better_xy, 3U);
  EXPECT_EQ(difference.streets, 3U);
  // Each alone is too uncertain to tell.
  EXPECT_GT(result.rows[1].rmse_xy_m.high, result.rows[0].rmse_xy_m.low);
}

TEST(PaperFigures, EqualMapsDifferByNothing) {
  const PaperEvaluation result =
      judged_rows({row_of("none", streets_of(1.0, 1)), row_of("ours", streets_of(1.0, 1))});
  EXPECT_EQ(result.differences[0].rmse_xy_m.value, 0.0);
  EXPECT_EQ(result.differences[0].rmse_xy_m.low, 0.0);
  EXPECT_EQ(result.differences[0].rmse_xy_m.high, 0.0);
  EXPECT_EQ(result.differences[0].better_xy, 0U);
}

TEST(PaperFigures, ProjectionIsComparedWithWhatDiffersByItAlone) {
  const auto streets = streets_of(1.0, 1);
  const PaperEvaluation result =
      judged_rows({row_of("none", streets), row_of("deletion", streets), row_of("paper", streets),
                   row_of("ours", streets), row_of("ours-all", streets)});
  std::vector<std::string> pairs;
  for (const PaperDifference& each : result.differences)
    pairs.push_back(each.map + " - " + each.against);
  EXPECT_THAT(pairs,
              ::testing::ElementsAre("deletion - none", "paper - none", "ours - none",
                                     "ours-all - none", "paper - deletion", "ours-all - ours"));
}

TEST(PaperFigures, WhatNeverFailedIsNotCertain) {
  const PaperEvaluation result = judged_rows({row_of("none", streets_of(0.1, 1))});
  EXPECT_EQ(result.rows[0].success_rate.value, 1.0);
  // 12 blocks: 1 - 0.05^(1 / 12).
  EXPECT_NEAR(result.rows[0].success_rate.low, std::pow(0.05, 1.0 / 12.0), 1e-6);
}

TEST(PaperFigures, RefusesRowsThatWereAskedWithDifferentScans) {
  PaperEvaluation evaluation;
  EXPECT_THROW(judge(evaluation), std::invalid_argument);
  evaluation.rows = {row_of("none", {{answer(1, 0.1, 0.0)}}),
                     row_of("paper", {{answer(2, 0.1, 0.0)}})};
  EXPECT_THROW(judge(evaluation), std::invalid_argument);
  evaluation.rows[1] = row_of("paper", {{answer(1, 0.1, 0.0)}, {answer(1, 0.1, 0.0)}});
  EXPECT_THROW(judge(evaluation), std::invalid_argument);
}

TEST(PaperReport, IsOnePageWithoutScriptsAndEscapesWhatItIsTold) {
  PaperEvaluation result =
      judged_rows({row_of("none", streets_of(1.0, 1)), row_of("paper", streets_of(0.9, 2))});
  result.options.detector = "<b>";
  const std::string page = to_html(result, "stillmap evaluate paper --work 'a&b'");
  EXPECT_EQ(page.find("<script"), std::string::npos);
  EXPECT_NE(page.find("&lt;b&gt;"), std::string::npos);
  EXPECT_NE(page.find("a&amp;b"), std::string::npos);
  EXPECT_NE(page.find("<svg"), std::string::npos);
  EXPECT_NE(page.find("3 of 3"), std::string::npos);
  EXPECT_EQ(page, to_html(result, "stillmap evaluate paper --work 'a&b'"));
}

}  // namespace paper_figures_test
}  // namespace stillmap::mapping
