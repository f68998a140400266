#include "evaluation/paper/street_draws.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <stdexcept>

#include "support/synthetic_world.hpp"

namespace stillmap::mapping {
namespace street_draws_test {

using Weights = StreetDraws::Weights;

double root_mean(const std::vector<double>& squares, Weights weights) {
  double sum = 0.0, count = 0.0;
  for (std::size_t i = 0; i < squares.size(); ++i) {
    sum += weights[i] * squares[i];
    count += weights[i];
  }
  return std::sqrt(sum / count);
}

/// Squared errors of deviation 1 in the long run. @param shared  correlation of neighbours.
std::vector<double> squares_of(std::size_t streets, std::size_t scans, double shared,
                               test::Random& random) {
  std::vector<double> squares;
  for (std::size_t street = 0; street < streets; ++street) {
    double error = random.normal();
    for (std::size_t i = 0; i < scans; ++i) {
      squares.push_back(error * error);
      error = shared * error + std::sqrt(1.0 - shared * shared) * random.normal();
    }
  }
  return squares;
}

Interval interval_of(const std::vector<double>& squares, const StreetDraws& draws) {
  return draws.interval([&](Weights weights) { return root_mean(squares, weights); });
}

/// Share of the intervals that hold the true deviation.
double coverage(std::size_t streets, std::size_t scans, double shared) {
  constexpr int kTrials = 40;
  test::Random random(7);
  const StreetDraws draws(std::vector<std::size_t>(streets, scans), 1);
  int held = 0;
  for (int trial = 0; trial < kTrials; ++trial) {
    const Interval interval = interval_of(squares_of(streets, scans, shared, random), draws);
    if (interval.low <= 1.0 && 1.0 <= interval.high) ++held;
  }
  return static_cast<double>(held) / kTrials;
}

TEST(StreetDraws, IntervalsHoldTheTruthOfNormalErrors) {
  EXPECT_GE(coverage(3, 60, 0.0), 0.9);
  EXPECT_GE(coverage(1, 120, 0.0), 0.85);
}

TEST(StreetDraws, IntervalsHoldTheTruthWhenNeighboursShareTheirErrors) {
  EXPECT_GE(coverage(3, 60, 0.8), 0.9);
  EXPECT_GE(coverage(1, 120, 0.8), 0.75);
}

TEST(StreetDraws, NeighboursThatShareTheirErrorsAreLessEvidence) {
  test::Random random(1);
  const StreetDraws draws({120}, 1);
  const Interval apart = interval_of(squares_of(1, 120, 0.0, random), draws);
  const Interval together = interval_of(squares_of(1, 120, 0.9, random), draws);
  EXPECT_GT(together.high - together.low, 1.5 * (apart.high - apart.low));
}

TEST(StreetDraws, EveryDrawHasAsManyScansOfTheStreetsItDrew) {
  const StreetDraws draws({20, 20, 20}, 1);
  EXPECT_EQ(draws.scans(), 60U);
  EXPECT_EQ(draws.blocks(), 6U);
  const Interval scans = draws.interval([](Weights weights) {
    double sum = 0.0;
    for (const std::uint16_t weight : weights) sum += weight;
    return sum;
  });
  EXPECT_EQ(scans.low, 60.0);
  EXPECT_EQ(scans.high, 60.0);
}

TEST(StreetDraws, ScansOfABlockComeTogether) {
  const StreetDraws draws({10, 10}, 1);
  // A block of all scans of a street: each of them as often as the next one.
  const Interval odd = draws.interval([](Weights weights) {
    double differences = 0.0;
    for (std::size_t i = 0; i + 1 < 10; ++i) differences += std::abs(weights[i] - weights[i + 1]);
    return differences;
  });
  EXPECT_EQ(odd.high, 0.0);
}

TEST(StreetDraws, FewStreetsGiveWideIntervals) {
  EXPECT_NEAR(stretch_of(2), std::sqrt(2.0) * 12.706 / 1.96, 1e-3);
  EXPECT_NEAR(stretch_of(3), std::sqrt(1.5) * 4.303 / 1.96, 1e-3);
  // Student's t for 10 and 30 degrees of freedom.
  EXPECT_NEAR(stretch_of(11), std::sqrt(1.1) * 2.228 / 1.96, 2e-3);
  EXPECT_NEAR(stretch_of(31), std::sqrt(31.0 / 30.0) * 2.042 / 1.96, 2e-3);
  EXPECT_THROW((void)stretch_of(1), std::invalid_argument);
}

TEST(StreetDraws, OneBlockTellsOfNoDeviation) {
  const Interval interval = interval_of({1.0, 1.0, 1.0}, StreetDraws({3}, 1));
  EXPECT_EQ(interval.value, 1.0);
  EXPECT_TRUE(std::isnan(interval.low));
  EXPECT_TRUE(std::isnan(interval.high));
}

TEST(StreetDraws, RefusesWhatHasNoScans) {
  EXPECT_THROW(StreetDraws({}, 1), std::invalid_argument);
  EXPECT_THROW(StreetDraws({3, 0}, 1), std::invalid_argument);
}

}  // namespace street_draws_test
}  // namespace stillmap::mapping
