#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/mapping/localization_evaluation.hpp>
#include <stillmap/mapping/map_build.hpp>
#include <stillmap/maps/frames.hpp>

#include <cmath>
#include <limits>
#include <mutex>
#include <nlohmann/json.hpp>
#include <numbers>
#include <optional>
#include <sstream>

#include "small_drive.hpp"

namespace stillmap::mapping {
namespace localization_queries_test {

using localization::PoseStatus;
using ::testing::ElementsAre;
using ::testing::SizeIs;

/// Answers with the prior, so that the error is the prior's; without one it is lost.
class Echo : public localization::Aligner {
 public:
  [[nodiscard]] localization::AlignmentResult align(
      const maps::PointCloud& /*scan_lidar*/,
      const std::optional<localization::Prior>& prior) const override {
    localization::AlignmentResult answer;
    answer.covariance.setIdentity();
    answer.inlier_ratio = 0.5;
    if (prior) {
      answer.status = PoseStatus::kOk;
      answer.T_map_lidar = prior->T_map_lidar;
    } else {
      answer.reasons = {localization::Reason::kNeedsPrior, localization::Reason::kTooFewPoints};
    }
    return answer;
  }
};

/// A drive of four scans along x, 1 m and 0.02 rad apart, and a map of it.
class EvaluateLocalization : public ::testing::Test {
 protected:
  EvaluateLocalization() : drive_(small_.write(folder_)) {
    MapBuildOptions options;
    options.given_poses = GivenPosesUse::kExact;
    (void)build_map({drive_}, folder_.path() / "map", options, {}, cancel_);
  }
  [[nodiscard]] LocalizationEvaluation evaluate() const {
    return evaluate_localization(
        *maps::MapPackage::open(folder_.path() / "map"), maps::Drive::open(drive_), options_,
        [](const maps::MapPackage&) { return std::make_unique<Echo>(); }, {}, cancel_);
  }

  test::TemporaryFolder folder_;
  test::SmallDrive small_;
  std::filesystem::path drive_;
  LocalizationEvaluationOptions options_;
  CancelFlag cancel_{false};
};

TEST_F(EvaluateLocalization, StartsFromTheTruePoseOfTheScanBefore) {
  options_.prior = PriorSource::kPrevious;
  options_.bias = BiasCorrection::kNone;
  const LocalizationEvaluation result = evaluate();
  // The first scan has none before it.
  EXPECT_EQ(result.scans, 3U);
  ASSERT_THAT(result.queries, SizeIs(1));
  ASSERT_THAT(result.queries[0], SizeIs(3));
  for (std::size_t i = 0; i < 3; ++i) {
    const LocalizationQuery& query = result.queries[0][i];
    EXPECT_EQ(query.scan, i + 1);
    const maps::Drive drive = maps::Drive::open(drive_);
    const Eigen::Matrix<double, 6, 1> expected =
        maps::log_se3(drive.T_map_lidar(i + 1).inverse() * drive.T_map_lidar(i));
    EXPECT_LT((query.error - expected).norm(), 1e-9);
    EXPECT_NEAR(query.prior_error.metres, 1.0, 1e-6);
    EXPECT_NEAR(query.prior_error.degrees, 0.02 * 180.0 / std::numbers::pi, 1e-6);
  }
  // One metre along x and 0.02 rad of yaw, with nothing taken out.
  ASSERT_THAT(result.levels, SizeIs(1));
  EXPECT_NEAR(result.levels[0].translation_m.rmse_part, 1.0, 1e-3);
  EXPECT_NEAR(result.levels[0].rotation_deg.rmse_part, 0.02 * 180.0 / std::numbers::pi, 1e-3);
  EXPECT_NEAR(result.levels[0].prior_error.metres, 1.0, 1e-6);
}

TEST_F(EvaluateLocalization, RefusesADriveInWhichNoScanHasOneBefore) {
  options_.prior = PriorSource::kPrevious;
  options_.selection = maps::Selection::parse("0:1");
  EXPECT_THROW((void)evaluate(), std::invalid_argument);
}

TEST_F(EvaluateLocalization, AsksWithoutAPrior) {
  options_.prior = PriorSource::kNone;
  const LocalizationEvaluation result = evaluate();
  ASSERT_THAT(result.levels, SizeIs(1));
  EXPECT_EQ(result.levels[0].queries, 4U);
  EXPECT_EQ(result.levels[0].lost, 4U);
  const nlohmann::json json = nlohmann::json::parse(to_json(result));
  EXPECT_TRUE(json["levels"][0]["prior_error_m"].is_null());
  EXPECT_EQ(json["options"]["prior"], "none");
}

TEST_F(EvaluateLocalization, KeepsEveryQueryInTheOrderOfScansAndTrials) {
  options_.prior_errors = {{0.5, 2.0}, {1.0, 5.0}};
  options_.trials = 2;
  options_.bias = BiasCorrection::kNone;
  options_.selection = maps::Selection::parse("1::2");
  options_.threads = 2;
  const LocalizationEvaluation result = evaluate();
  ASSERT_THAT(result.queries, SizeIs(2));
  for (std::size_t level = 0; level < 2; ++level) {
    std::vector<std::pair<std::size_t, int>> order;
    for (const LocalizationQuery& query : result.queries[level]) {
      order.emplace_back(query.scan, query.trial);
      EXPECT_NEAR(query.error.head<3>().norm(),
                  options_.prior_errors[level].metres * std::hypot(1.0, 0.1), 0.02);
    }
    EXPECT_THAT(
        order, ElementsAre(std::pair(1U, 0), std::pair(1U, 1), std::pair(3U, 0), std::pair(3U, 1)));
  }
}

std::vector<std::string> fields(const std::string& line) {
  std::vector<std::string> out;
  std::istringstream stream(line + ",");
  for (std::string field; std::getline(stream, field, ',');) out.push_back(field);
  return out;
}

std::vector<std::string> lines_of(const std::string& text) {
  std::vector<std::string> out;
  std::istringstream stream(text);
  for (std::string line; std::getline(stream, line);) out.push_back(line);
  return out;
}

TEST(LocalizationCsv, HasOneLineAQueryUnderTheNamesOfTheColumns) {
  LocalizationQuery query;
  query.scan = 7;
  query.trial = 2;
  query.prior_error = {1.0, 5.0};
  query.status = PoseStatus::kDegraded;
  query.reasons = {localization::Reason::kAmbiguous, localization::Reason::kLargeCovariance};
  query.error << 0.1, -0.2, 0.3, 0.01, -0.02, 0.03;
  query.protection = {0.25, 0.125, 0.5, 0.0078125};
  query.nees = 5.5;
  query.inlier_ratio = 0.75;
  query.cpu_ms = 20.5;
  query.wall_ms = 21.5;
  LocalizationEvaluation evaluation;
  evaluation.queries = {{query}, {query, query}};
  const std::vector<std::string> lines = lines_of(to_csv(evaluation));
  ASSERT_THAT(lines, SizeIs(4));
  EXPECT_EQ(lines[0],
            "scan,trial,prior_error_m,prior_error_deg,status,reasons,"
            "error_x_m,error_y_m,error_z_m,error_roll_rad,error_pitch_rad,error_yaw_rad,"
            "level_longitudinal_m,level_lateral_m,level_vertical_m,level_yaw_rad,"
            "nees,inlier_ratio,cpu_ms,wall_ms");
  EXPECT_EQ(lines[1],
            "7,2,1,5,degraded,ambiguous|large_covariance,0.1,-0.2,0.3,0.01,-0.02,0.03,"
            "0.25,0.125,0.5,0.0078125,5.5,0.75,20.5,21.5");
  EXPECT_EQ(lines[3], lines[1]);
}

TEST(LocalizationCsv, LeavesAFieldEmptyWhereThereIsNoNumber) {
  LocalizationQuery query;
  query.prior_error = {std::numeric_limits<double>::quiet_NaN(),
                       std::numeric_limits<double>::quiet_NaN()};
  LocalizationEvaluation evaluation;
  evaluation.queries = {{query}};
  const std::vector<std::string> lines = lines_of(to_csv(evaluation));
  ASSERT_THAT(lines, SizeIs(2));
  EXPECT_EQ(lines[1], "0,0,,,lost,,,,,,,,,,,,,0,0,0");
  EXPECT_EQ(fields(lines[1]).size(), fields(lines[0]).size());
}

}  // namespace localization_queries_test
}  // namespace stillmap::mapping
