#include "ground/kerb_run.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <numbers>

namespace stillmap::mapping {
namespace kerb_run_test {

using Height = std::function<double(const Eigen::Vector2d& p_local)>;
using Keep = std::function<bool(const Eigen::Vector2d& p_local)>;

/// A street along a direction, pavement and kerb on its left; a row of cars stands on the kerb.
class KerbRun : public ::testing::Test {
 protected:
  static constexpr double kTurn = 0.6;

  [[nodiscard]] static Eigen::Vector2d along() { return {std::cos(kTurn), std::sin(kTurn)}; }
  [[nodiscard]] static double left_of_kerb(const Eigen::Vector2d& p) {
    return along().x() * p.y() - along().y() * p.x();
  }
  [[nodiscard]] static double street(const Eigen::Vector2d& p) {
    const double left = left_of_kerb(p);
    return 0.05 * along().dot(p) + (left > 0.0 ? 0.13 + 0.02 * left : 0.03 * left);
  }

  /// @param at_m  along the street; every other car heads the other way.
  [[nodiscard]] static GroundFootprint car(double at_m, bool back = false) {
    GroundFootprint footprint;
    footprint.centre.head<2>() = at_m * along();
    footprint.half_m = {2.2, 0.9};
    footprint.heading = back ? Eigen::Vector2d(-along()) : along();
    return footprint;
  }

  [[nodiscard]] static FittedFootprint fitted(const GroundFootprint& footprint, const Keep& keep,
                                              const Height& height = street) {
    FittedFootprint fit;
    for (double y = -3.875; y < 4.0; y += 0.25) {
      for (double x = -5.125; x < 5.2; x += 0.25) {
        const Eigen::Vector2d p(x, y);
        if (std::abs(x) < 2.2 && std::abs(y) < 0.9) continue;
        const Eigen::Vector2d h = footprint.heading;
        const Eigen::Vector2d p_local =
            footprint.centre.head<2>() + x * h + y * Eigen::Vector2d(-h.y(), h.x());
        if (keep(p_local)) fit.samples.push_back({p, height(p_local), 1.0});
      }
    }
    fit.planes = fit_stepped_plane(fit.samples, {.half_m = {2.45, 1.15}});
    return fit;
  }

  [[nodiscard]] static double z_at(const GroundFootprint& footprint, const FittedFootprint& fit,
                                   const Eigen::Vector2d& p_local) {
    return fit.planes->z_at(footprint.inside(p_local));
  }

  /// Largest error under a car, a quarter metre around the kerb left out.
  [[nodiscard]] static double worst(const GroundFootprint& footprint, const FittedFootprint& fit) {
    double error = 0.0;
    for (double along_m = -2.0; along_m <= 2.0; along_m += 0.5) {
      for (const double across_m : {-0.8, -0.5, 0.5, 0.8}) {
        const Eigen::Vector2d h = footprint.heading;
        const Eigen::Vector2d p_local =
            footprint.centre.head<2>() + along_m * h + across_m * Eigen::Vector2d(-h.y(), h.x());
        error = std::max(error, std::abs(z_at(footprint, fit, p_local) - street(p_local)));
      }
    }
    return error;
  }
};

bool everywhere(const Eigen::Vector2d& /*p*/) { return true; }

TEST_F(KerbRun, GoesOnUnderTheNextCarsWhosePavementIsHidden) {
  const Keep road = [](const Eigen::Vector2d& p) { return left_of_kerb(p) < -0.9; };
  const std::vector<GroundFootprint> cars = {car(0.0), car(6.0, true), car(12.0), car(40.0)};
  std::vector<FittedFootprint> fits = {fitted(cars[0], everywhere), fitted(cars[1], road),
                                       fitted(cars[2], road), fitted(cars[3], road)};
  ASSERT_TRUE(fits[0].planes->has_step);
  for (const std::size_t i : {1, 2, 3}) EXPECT_FALSE(fits[i].planes->has_step);
  continue_kerbs(cars, fits);
  for (const std::size_t i : {0, 1, 2}) {
    EXPECT_TRUE(fits[i].planes->has_step) << i;
    EXPECT_LT(worst(cars[i], fits[i]), 0.025) << i;
  }
  // Out of reach of any kerb that was seen, and of those that went on.
  EXPECT_FALSE(fits[3].planes->has_step);
}

TEST_F(KerbRun, EndsWhereTheGroundBeyondIsSeenToBeFlat) {
  const Height flat = [](const Eigen::Vector2d& p) {
    return 0.05 * along().dot(p) + 0.03 * left_of_kerb(p);
  };
  const std::vector<GroundFootprint> cars = {car(0.0), car(6.0)};
  std::vector<FittedFootprint> fits = {fitted(cars[0], everywhere),
                                       fitted(cars[1], everywhere, flat)};
  continue_kerbs(cars, fits);
  EXPECT_FALSE(fits[1].planes->has_step);
}

TEST_F(KerbRun, PassesByACarThatStandsBesideItsLine) {
  const Keep road = [](const Eigen::Vector2d& p) { return left_of_kerb(p) < -0.9; };
  GroundFootprint beside = car(6.0);
  beside.centre.head<2>() += 2.5 * Eigen::Vector2d(along().y(), -along().x());
  const std::vector<GroundFootprint> cars = {car(0.0), beside};
  std::vector<FittedFootprint> fits = {fitted(cars[0], everywhere), fitted(beside, road)};
  continue_kerbs(cars, fits);
  EXPECT_FALSE(fits[1].planes->has_step);
}

TEST_F(KerbRun, StartsFromNoKerbWhosePlaceIsAGuess) {
  const Keep hidden = [](const Eigen::Vector2d& p) { return std::abs(left_of_kerb(p)) > 1.4; };
  const GroundFootprint here = car(0.0);
  EXPECT_TRUE(seen_kerb(here, fitted(here, everywhere)));
  EXPECT_FALSE(seen_kerb(here, fitted(here, hidden)));
}

TEST_F(KerbRun, TellsAKerbInTheLocalFrame) {
  for (const bool back : {false, true}) {
    const GroundFootprint here = car(3.0, back);
    const auto kerb = seen_kerb(here, fitted(here, everywhere));
    ASSERT_TRUE(kerb);
    EXPECT_NEAR(left_of_kerb(kerb->foot), 0.0, 0.13);
    EXPECT_NEAR(std::abs(kerb->normal.dot(along())), 0.0, 1e-6);
    const double left = -along().y() * kerb->normal.x() + along().x() * kerb->normal.y();
    EXPECT_NEAR(kerb->rise * left, 0.13, 0.01);
    EXPECT_NEAR(kerb->slopes[0].dot(along()), 0.05, 0.005);
  }
}

TEST_F(KerbRun, OfNothingIsNothing) {
  std::vector<FittedFootprint> none;
  continue_kerbs({}, none);
  EXPECT_TRUE(none.empty());
  const std::vector<GroundFootprint> cars = {car(0.0)};
  std::vector<FittedFootprint> unknown(1);
  continue_kerbs(cars, unknown);
  EXPECT_FALSE(unknown[0].planes);
}

}  // namespace kerb_run_test
}  // namespace stillmap::mapping
