#include <stillmap/mapping/localization_evaluation.hpp>

#include "evaluation/localization/localization_metrics.hpp"
#include "evaluation/localization/prior_draws.hpp"

#include <stillmap/mapping/map_build.hpp>
#include <stillmap/maps/frames.hpp>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <cmath>
#include <limits>
#include <memory>
#include <numbers>
#include <set>
#include <stdexcept>
#include <vector>

#include "small_drive.hpp"

namespace stillmap::mapping {
namespace localization_evaluation_test {

using localization::PoseStatus;
using ::testing::SizeIs;

constexpr double kDeg = std::numbers::pi / 180.0;

Eigen::Isometry3d some_pose() {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.translation() = Eigen::Vector3d(100.0, -30.0, 2.0);
  T.linear() = (Eigen::AngleAxisd(1.0, Eigen::Vector3d::UnitZ()) *
                Eigen::AngleAxisd(0.05, Eigen::Vector3d::UnitX()))
                   .toRotationMatrix();
  return T;
}

LocalizationRecord record(std::size_t scan, const Eigen::Vector3d& off_m, double yaw_deg = 0.0,
                          PoseStatus status = PoseStatus::kOk) {
  LocalizationRecord out;
  out.position = scan;
  out.query.scan = scan;
  out.query.status = status;
  out.T_reference_answer.translation() = off_m;
  out.T_reference_answer.linear() =
      Eigen::AngleAxisd(yaw_deg * kDeg, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  out.covariance.setIdentity();
  return out;
}

LocalizationLevel level_of(const std::vector<LocalizationRecord>& records,
                           BiasCorrection correction = BiasCorrection::kFit) {
  return level_of(judged(records, correction), {}, 1);
}

TEST(PriorDraws, AreOffByExactlyDAndA) {
  const Eigen::Isometry3d T = some_pose();
  for (std::uint64_t trial = 0; trial < 200; ++trial) {
    const Eigen::Isometry3d prior = with_prior_error(T, {2.0, 10.0}, CounterRandom(1, 5, trial));
    const Eigen::Vector3d off = prior.translation() - T.translation();
    EXPECT_NEAR(off.head<2>().norm(), 2.0, 1e-9);
    EXPECT_NEAR(std::abs(off.z()), 0.2, 1e-9);
    const Eigen::Vector3d yaw_pitch_roll =
        Eigen::Matrix3d(T.linear().transpose() * prior.linear()).eulerAngles(2, 1, 0);
    const auto folded = [](double angle) {
      return std::min(std::abs(angle), std::abs(std::numbers::pi - std::abs(angle)));
    };
    EXPECT_NEAR(folded(yaw_pitch_roll[0]), 10.0 * kDeg, 1e-9);
    EXPECT_NEAR(folded(yaw_pitch_roll[1]), 1.0 * kDeg, 1e-9);
    EXPECT_NEAR(folded(yaw_pitch_roll[2]), 1.0 * kDeg, 1e-9);
  }
}

TEST(PriorDraws, DirectionsAreUniformAndSignsFair) {
  double east = 0.0, north = 0.0, up = 0.0;
  constexpr int kDraws = 4000;
  for (std::uint64_t k = 0; k < kDraws; ++k) {
    const Eigen::Vector3d off =
        with_prior_error(Eigen::Isometry3d::Identity(), {1.0, 0.0}, CounterRandom(3, k, 0))
            .translation();
    east += off.x();
    north += off.y();
    up += off.z() / 0.1;
  }
  // Means of 4000 draws with deviation 0.71 (cosines) and 1 (signs): five deviations of the mean.
  EXPECT_LT(std::abs(east) / kDraws, 0.056);
  EXPECT_LT(std::abs(north) / kDraws, 0.056);
  EXPECT_LT(std::abs(up) / kDraws, 0.08);
}

TEST(PriorDraws, AreFixedForEverAndDifferBySeedScanAndTrial) {
  // The numbers are part of the definition: results of different versions are compared draw by
  // draw.
  EXPECT_DOUBLE_EQ(CounterRandom(1, 2, 3).uniform(0), CounterRandom(1, 2, 3).uniform(0));
  std::set<double> seen;
  for (std::uint64_t seed = 0; seed < 4; ++seed) {
    for (std::uint64_t scan = 0; scan < 4; ++scan) {
      for (std::uint64_t trial = 0; trial < 4; ++trial)
        seen.insert(CounterRandom(seed, scan, trial).uniform(0));
    }
  }
  EXPECT_THAT(seen, SizeIs(64));
}

TEST(Percentile, InterpolatesBetweenNeighbours) {
  EXPECT_DOUBLE_EQ(percentile({4.0, 1.0, 3.0, 2.0}, 0.5), 2.5);
  EXPECT_DOUBLE_EQ(percentile({1.0, 2.0, 3.0}, 0.95), 2.9);
  EXPECT_DOUBLE_EQ(percentile({7.0}, 0.95), 7.0);
  EXPECT_TRUE(std::isnan(percentile({}, 0.5)));
}

TEST(Percentile, TakesInfiniteValues) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  EXPECT_DOUBLE_EQ(percentile({1.0, 2.0, kInfinity}, 0.5), 2.0);
  EXPECT_EQ(percentile({1.0, kInfinity}, 0.5), kInfinity);
  EXPECT_EQ(percentile({kInfinity, kInfinity}, 0.5), kInfinity);
}

TEST(LocalizationMetrics, AConstantBiasIsTakenOut) {
  std::vector<LocalizationRecord> records;
  for (std::size_t scan = 0; scan < 10; ++scan)
    records.push_back(record(scan, {0.5, -0.3, 0.1}, 1.5));
  const LocalizationLevel level = level_of(records);
  EXPECT_DOUBLE_EQ(level.success_rate, 1.0);
  EXPECT_NEAR(level.translation_m.median, 0.0, 1e-9);
  EXPECT_NEAR(level.rotation_deg.p95, 0.0, 1e-9);
  EXPECT_NEAR(level.nees_mean, 0.0, 1e-9);
}

TEST(LocalizationMetrics, ErrorsLieAlongTheAxesOfTheAnswerWhateverTheBias) {
  // The map's lidar is turned by 90 degrees, and four answers in five are right.
  const Eigen::Isometry3d bias(Eigen::AngleAxisd(90.0 * kDeg, Eigen::Vector3d::UnitZ()));
  std::vector<LocalizationRecord> records;
  for (std::size_t scan = 0; scan < 20; ++scan) {
    records.push_back(record(scan, Eigen::Vector3d::Zero()));
    const bool is_off = scan % 5 == 0;
    records.back().T_reference_answer = bias * Eigen::Translation3d(is_off ? 0.3 : 0.0, 0.0, 0.0);
  }
  const std::vector<LocalizationQuery> queries = judged(records, BiasCorrection::kFit);
  EXPECT_NEAR(queries[0].error[0], 0.3, 1e-9);
  EXPECT_NEAR(queries[0].error[1], 0.0, 1e-9);
  EXPECT_NEAR(queries[1].error.norm(), 0.0, 1e-9);
}

TEST(LocalizationMetrics, AConstantBiasIsLeftInOnWish) {
  std::vector<LocalizationRecord> records;
  for (std::size_t scan = 0; scan < 10; ++scan)
    records.push_back(record(scan, {0.5, -0.3, 0.1}, 1.5));
  const LocalizationLevel level = level_of(records, BiasCorrection::kNone);
  EXPECT_DOUBLE_EQ(level.success_rate, 0.0);
  EXPECT_NEAR(level.rotation_deg.median, 1.5, 1e-9);
}

TEST(LocalizationMetrics, EachHalfIsJudgedWithTheBiasOfTheOther) {
  // Even scans are off by 0.3 m, odd ones by nothing: judged with their own bias all would be
  // perfect.
  std::vector<LocalizationRecord> records;
  for (std::size_t scan = 0; scan < 10; ++scan) {
    records.push_back(record(scan, {scan % 2 == 0 ? 0.3 : 0.0, 0.0, 0.0}));
  }
  EXPECT_NEAR(bias_of_half(records, 0)[0], 0.3, 1e-12);
  EXPECT_NEAR(bias_of_half(records, 1)[0], 0.0, 1e-12);
  const LocalizationLevel level = level_of(records);
  EXPECT_DOUBLE_EQ(level.success_rate, 0.0);
  EXPECT_NEAR(level.translation_m.median, 0.3, 1e-9);
}

TEST(LocalizationMetrics, CountsSuccessStatusAndFalseOkByHand) {
  std::vector<LocalizationRecord> records;
  for (std::size_t scan = 0; scan < 20; ++scan)
    records.push_back(record(scan, Eigen::Vector3d::Zero()));
  records[0] = record(0, {0.19, 0.0, 0.0});                                 // success
  records[2] = record(2, {0.21, 0.0, 0.0});                                 // fails, no false ok
  records[4] = record(4, {0.0, 0.6, 0.0});                                  // false ok
  records[6] = record(6, {0.0, 0.6, 0.0}, 0.0, PoseStatus::kDegraded);      // fails, honestly
  records[8] = record(8, Eigen::Vector3d::Zero(), 0.0, PoseStatus::kLost);  // fails although right
  records[10] = record(10, Eigen::Vector3d::Zero(), 2.5);                   // false ok by angle
  records[12] = record(12, Eigen::Vector3d::Zero(), 0.9, PoseStatus::kDegraded);  // success
  records[8].query.reasons = {localization::Reason::kTooFewPoints};
  const LocalizationLevel level = level_of(records);
  EXPECT_EQ(level.queries, 20U);
  EXPECT_EQ(level.ok, 17U);
  EXPECT_EQ(level.degraded, 2U);
  EXPECT_EQ(level.lost, 1U);
  EXPECT_DOUBLE_EQ(level.success_rate, 15.0 / 20.0);
  EXPECT_DOUBLE_EQ(level.false_ok_rate, 2.0 / 20.0);
  EXPECT_EQ(level.reasons.at(localization::Reason::kTooFewPoints), 1U);
  EXPECT_NEAR(level.translation_m.rmse_part,
              std::sqrt((0.19 * 0.19 + 0.21 * 0.21 + 2 * 0.36) / 19.0), 1e-9);
  EXPECT_NEAR(level.rotation_deg.rmse_part, std::sqrt((2.5 * 2.5 + 0.9 * 0.9) / 19.0), 1e-6);
}

TEST(LocalizationMetrics, NeesIsTheErrorInUnitsOfTheCovariance) {
  std::vector<LocalizationRecord> records;
  for (std::size_t scan = 0; scan < 10; ++scan)
    records.push_back(record(scan, Eigen::Vector3d::Zero()));
  records[0] = record(0, {0.4, 0.0, 0.0});
  for (LocalizationRecord& r : records) r.covariance *= 0.01;
  const LocalizationLevel level = level_of(records);
  EXPECT_NEAR(level.nees_mean, 16.0 / 10.0, 1e-9);
  EXPECT_DOUBLE_EQ(level.nees_inside_95, 0.9);
}

TEST(LocalizationMetrics, IntervalResamplesScansNotTrials) {
  // Half of the scans always succeed, half never: many trials must not make the interval narrow.
  std::vector<LocalizationRecord> few, many;
  for (std::size_t scan = 0; scan < 20; ++scan) {
    const double off = scan < 10 ? 0.0 : (scan % 4 < 2 ? 0.4 : -0.4);
    few.push_back(record(scan, {0.0, off, 0.0}));
    for (int trial = 0; trial < 50; ++trial) many.push_back(record(scan, {0.0, off, 0.0}));
  }
  const LocalizationLevel a = level_of(few);
  const LocalizationLevel b = level_of(many);
  EXPECT_DOUBLE_EQ(a.success_rate, 0.5);
  EXPECT_EQ(a.success_interval, b.success_interval);
  EXPECT_NEAR(a.success_interval[0], 0.5 - 1.96 * std::sqrt(0.25 / 20.0), 0.06);
  EXPECT_NEAR(a.success_interval[1], 0.5 + 1.96 * std::sqrt(0.25 / 20.0), 0.06);
}

TEST(LocalizationMetrics, AllLostHasNoErrorsAndIsNullInJson) {
  std::vector<LocalizationRecord> records;
  for (std::size_t scan = 0; scan < 3; ++scan) {
    records.push_back(record(scan, Eigen::Vector3d::Zero(), 0.0, PoseStatus::kLost));
  }
  LocalizationEvaluation evaluation;
  evaluation.levels.push_back(level_of(records));
  EXPECT_DOUBLE_EQ(evaluation.levels[0].success_rate, 0.0);
  EXPECT_TRUE(std::isnan(evaluation.levels[0].translation_m.median));
  const nlohmann::json json = nlohmann::json::parse(to_json(evaluation));
  EXPECT_TRUE(json["levels"][0]["translation_error_m"]["median"].is_null());
}

TEST(LocalizationJson, HasEveryKeyOfTheContract) {
  LocalizationEvaluation evaluation;
  evaluation.options.seed = std::numeric_limits<std::uint64_t>::max();
  evaluation.levels.push_back(level_of({record(0, Eigen::Vector3d::Zero())}));
  const nlohmann::json json = nlohmann::json::parse(to_json(evaluation));
  for (const char* key : {"levels", "scans", "seconds", "options"})
    EXPECT_TRUE(json.contains(key)) << key;
  for (const char* pointer : {"/prior_error_m",
                              "/prior_error_deg",
                              "/queries",
                              "/success_rate",
                              "/success_interval_95/1",
                              "/status/ok",
                              "/status/degraded",
                              "/status/lost",
                              "/false_ok_rate",
                              "/translation_error_m/median",
                              "/translation_error_m/p95",
                              "/translation_error_m/rmse_xy",
                              "/rotation_error_deg/median",
                              "/rotation_error_deg/p95",
                              "/rotation_error_deg/rmse_yaw",
                              "/cpu_ms/p50",
                              "/cpu_ms/p95",
                              "/wall_ms/p50",
                              "/wall_ms/p95",
                              "/nees/mean",
                              "/nees/inside_95",
                              "/integrity/misleading",
                              "/integrity/misleading_count",
                              "/integrity/misleading_upper_95",
                              "/integrity/hazardous",
                              "/integrity/hazardous_count",
                              "/integrity/hazardous_upper_95",
                              "/integrity/availability",
                              "/integrity/availability_lower_95",
                              "/integrity/level_over_error",
                              "/reasons"}) {
    EXPECT_TRUE(json["levels"][0].contains(nlohmann::json::json_pointer(pointer))) << pointer;
  }
  EXPECT_EQ(json["options"]["seed"], "18446744073709551615");
}

TEST(LocalizationEvaluationOptions, NamesEveryBrokenBound) {
  LocalizationEvaluationOptions options;
  EXPECT_THAT(options.violations(), SizeIs(0));
  options.prior_errors = {{-1.0, std::numeric_limits<double>::quiet_NaN()}};
  options.trials = 0;
  options.threads = -1;
  EXPECT_THAT(options.violations(), SizeIs(4));
  options.prior_errors.clear();
  EXPECT_THAT(options.violations(), SizeIs(3));
  options = {};
  options.trials = 2;
  EXPECT_THAT(options.violations(), SizeIs(0));
  options.prior = PriorSource::kPrevious;
  EXPECT_THAT(options.violations(), SizeIs(1));
}

/// Answers with the prior, and remembers it.
class PriorIsRight : public localization::Aligner {
 public:
  explicit PriorIsRight(std::vector<Eigen::Isometry3d>& priors) : priors_(priors) {}
  [[nodiscard]] localization::AlignmentResult align(
      const maps::PointCloud& /*scan*/,
      const std::optional<localization::Prior>& prior) const override {
    priors_.push_back(prior.value().T_map_lidar);
    localization::AlignmentResult answer;
    answer.status = PoseStatus::kOk;
    answer.T_map_lidar = priors_.back();
    return answer;
  }

 private:
  std::vector<Eigen::Isometry3d>& priors_;
};

TEST(LocalizationEvaluation, AsksOnlyForSelectedScansThatTheReferenceHasPosesOf) {
  const test::TemporaryFolder folder;
  const maps::Drive drive = maps::Drive::open(test::SmallDrive().write(folder));
  MapBuildOptions build;
  (void)build_map({drive.contents().root}, folder.path() / "map", build, {}, CancelFlag(false));
  const auto map = maps::MapPackage::open(folder.path() / "map");
  LocalizationEvaluationOptions options;
  options.selection = maps::Selection::parse("1:");
  options.prior_errors = {{0.0, 0.0}};
  options.reference.resize(drive.size());
  options.reference[0] = some_pose();
  options.reference[2] = some_pose() * Eigen::Translation3d(1.0, 0.0, 0.0);
  std::vector<Eigen::Isometry3d> priors;
  const auto evaluate = [&] {
    return evaluate_localization(
        *map, drive, options,
        [&](const maps::MapPackage&) { return std::make_unique<PriorIsRight>(priors); }, {},
        CancelFlag(false));
  };
  EXPECT_EQ(evaluate().scans, 1U);
  ASSERT_THAT(priors, SizeIs(1));
  EXPECT_TRUE(priors[0].isApprox(*options.reference[2]));
  options.reference[2].reset();
  EXPECT_THROW((void)evaluate(), std::invalid_argument);
  options.reference.resize(2);
  EXPECT_THROW((void)evaluate(), std::invalid_argument);
}

}  // namespace localization_evaluation_test
}  // namespace stillmap::mapping
