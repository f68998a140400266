#include "evaluation/localization/integrity.hpp"

#include "evaluation/localization/resampling.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>

namespace stillmap::mapping {
namespace integrity_test {

using localization::PoseStatus;

constexpr double kDeg = std::numbers::pi / 180.0;
constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// An `ok` answer with levels of 0.2 m and 0.3 deg.
LocalizationQuery answer(std::size_t scan, double x_m = 0.01, double y_m = 0.0, double z_m = 0.0,
                         double yaw_deg = 0.0) {
  LocalizationQuery query;
  query.scan = scan;
  query.status = PoseStatus::kOk;
  query.error << x_m, y_m, z_m, 0.0, 0.0, yaw_deg * kDeg;
  query.protection = {0.2, 0.2, 0.2, 0.3 * kDeg};
  return query;
}

TEST(Integrity, AnErrorBeyondItsLevelMisleadsOnEveryAxisAndInBothDirections) {
  EXPECT_FALSE(is_misleading(answer(0, 0.19, -0.19, 0.19, -0.29)));
  EXPECT_TRUE(is_misleading(answer(0, -0.21)));
  EXPECT_TRUE(is_misleading(answer(0, 0.0, 0.21)));
  EXPECT_TRUE(is_misleading(answer(0, 0.0, 0.0, -0.21)));
  EXPECT_TRUE(is_misleading(answer(0, 0.0, 0.0, 0.0, 0.31)));
}

TEST(Integrity, OnlyAnOkAnswerMisleads) {
  LocalizationQuery query = answer(0, 5.0);
  query.status = PoseStatus::kDegraded;
  EXPECT_FALSE(is_misleading(query));
  EXPECT_FALSE(is_hazardous(query));
  EXPECT_FALSE(is_available(query));
}

TEST(Integrity, AnOkAnswerWithoutAFiniteErrorMisleads) {
  LocalizationQuery query = answer(0);
  query.error.setConstant(std::numeric_limits<double>::quiet_NaN());
  EXPECT_TRUE(is_misleading(query));
  EXPECT_TRUE(is_hazardous(query));
}

TEST(Integrity, AnErrorBeyondTheAlertLimitIsHazardousWhenItsOwnLevelIsInside) {
  EXPECT_FALSE(is_hazardous(answer(0, 0.28)));
  EXPECT_TRUE(is_hazardous(answer(0, 0.30)));
  EXPECT_TRUE(is_hazardous(answer(0, 0.0, -0.30)));
  EXPECT_TRUE(is_hazardous(answer(0, 0.0, 0.0, 0.0, -0.51)));
  // A street has no alert limit for heights.
  EXPECT_FALSE(is_hazardous(answer(0, 0.0, 0.0, 0.5)));
  // Misleading, but the level says itself that the answer is not good enough.
  LocalizationQuery query = answer(0, 0.5);
  query.protection.longitudinal_m = 0.4;
  EXPECT_TRUE(is_misleading(query));
  EXPECT_FALSE(is_hazardous(query));
}

TEST(Integrity, AvailableNeedsEveryLevelInsideItsAlertLimit) {
  EXPECT_TRUE(is_available(answer(0)));
  for (const auto member :
       {&localization::ProtectionLevels::longitudinal_m, &localization::ProtectionLevels::lateral_m,
        &localization::ProtectionLevels::yaw_rad}) {
    LocalizationQuery query = answer(0);
    query.protection.*member = 0.3;
    EXPECT_FALSE(is_available(query));
  }
  LocalizationQuery query = answer(0);
  query.protection.vertical_m = 3.0;
  EXPECT_TRUE(is_available(query));
}

TEST(Integrity, CountsByHand) {
  std::vector<LocalizationQuery> queries;
  for (std::size_t scan = 0; scan < 10; ++scan) queries.push_back(answer(scan));
  queries[1] = answer(1, 0.25);               // misleading
  queries[2] = answer(2, 0.0, 0.35);          // misleading and hazardous
  queries[3].status = PoseStatus::kDegraded;  // not available
  queries[4] = LocalizationQuery();           // lost
  queries[4].scan = 4;
  queries[5].protection = {kInfinity, 0.2, 0.2, 0.005};  // ok, but without a bound
  const Integrity integrity = integrity_of(queries, 1);
  EXPECT_EQ(integrity.misleading.count, 2U);
  EXPECT_EQ(integrity.misleading.of, 8U);
  EXPECT_DOUBLE_EQ(integrity.misleading.rate, 0.25);
  EXPECT_EQ(integrity.hazardous.count, 1U);
  EXPECT_DOUBLE_EQ(integrity.hazardous.rate, 0.125);
  EXPECT_EQ(integrity.availability.count, 7U);
  EXPECT_DOUBLE_EQ(integrity.availability.rate, 0.7);
  EXPECT_LT(integrity.availability_lower_95, 0.7);
  EXPECT_GT(integrity.availability_lower_95, 0.3);
  // In order: those off by 0.35 and 0.25 m, five at 0.2 sqrt(2) / 0.01, one infinite.
  EXPECT_NEAR(integrity.level_over_error, 0.2 * std::sqrt(2.0) / 0.01, 1e-9);
}

TEST(Integrity, AMethodWithoutLevelsIsNeverAvailableAndItsRatioIsInfinite) {
  std::vector<LocalizationQuery> queries{answer(0), answer(1)};
  for (LocalizationQuery& query : queries) query.protection = {};
  const Integrity integrity = integrity_of(queries, 1);
  EXPECT_EQ(integrity.misleading.count, 0U);
  EXPECT_EQ(integrity.availability.count, 0U);
  EXPECT_EQ(integrity.level_over_error, kInfinity);
}

TEST(BoundedRate, OfNothingThatHappenedIsSomeThreeByTheNumberOfScans) {
  EXPECT_NEAR(bounded_rate(std::vector<ScanCount>(1000, {0, 1}), 1).upper_95, 3.0 / 1000, 2e-5);
  // Ten queries a scan are not ten times the evidence.
  EXPECT_NEAR(bounded_rate(std::vector<ScanCount>(1000, {0, 10}), 1).upper_95, 3.0 / 1000, 2e-5);
  EXPECT_TRUE(std::isnan(bounded_rate({}, 1).upper_95));
}

TEST(BoundedRate, IsThatOfTheBinomialForIndependentQueries) {
  // Tables of Clopper and Pearson, one-sided 95 %: 1 of 20 below 21.6 %, 5 of 10 below 77.8 %.
  EXPECT_NEAR(binomial_upper_95(1, 20), 0.2161, 1e-4);
  EXPECT_NEAR(binomial_upper_95(5, 10), 0.7776, 1e-4);
  EXPECT_NEAR(binomial_upper_95(0, 10), 1.0 - std::pow(0.05, 0.1), 1e-12);
  EXPECT_DOUBLE_EQ(binomial_upper_95(10, 10), 1.0);
  std::vector<ScanCount> scans(20, {0, 1});
  scans[3].count = 1;
  EXPECT_NEAR(bounded_rate(scans, 1).upper_95, 0.2161, 1e-4);
}

TEST(BoundedRate, GrowsWhenTheSameEventsComeFromFewerScans) {
  std::vector<ScanCount> spread(100, {0, 10});
  std::vector<ScanCount> together = spread;
  for (std::size_t i = 0; i < 30; ++i) spread[i].count = 1;
  for (std::size_t i = 0; i < 3; ++i) together[i].count = 10;
  const BoundedRate a = bounded_rate(spread, 1);
  const BoundedRate b = bounded_rate(together, 1);
  EXPECT_DOUBLE_EQ(a.rate, b.rate);
  EXPECT_GE(b.upper_95, a.upper_95);
  EXPECT_GT(b.upper_95, 0.05);
}

}  // namespace integrity_test
}  // namespace stillmap::mapping
