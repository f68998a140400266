#include "patching/seam.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

namespace stillmap::mapping {
namespace seam_test {

/// What a place says that tells of some directions to 2 mm.
SeamFit fit(const Eigen::Vector3d& middle, const Eigen::Vector3d& off_m,
            const Eigen::Vector3d& told = Eigen::Vector3d::Ones()) {
  SeamFit fit;
  fit.middle = middle;
  fit.off_m = off_m;
  fit.sigma_m = 0.002;
  fit.told = told.asDiagonal();
  return fit;
}

const Eigen::Vector3d kOff(0.0, 0.05, 0.0);

std::vector<SeamFit> by_x(std::vector<SeamFit> fits) {
  std::ranges::sort(fits, {}, [](const SeamFit& each) { return each.middle.x(); });
  return fits;
}

TEST(SharedShift, IsThatOfPlacesThatMovedTogether) {
  std::vector<SeamFit> fits;
  for (int i = 0; i < 5; ++i) fits.push_back(fit({10.0 * i, 0.0, 0.0}, kOff));
  for (const SeamFit& place : fits)
    EXPECT_NEAR((shared_shift_m(place, fits) - Eigen::Vector3d(0.0, 0.044, 0.0)).norm(), 0.0, 1e-9)
        << "5 cm less three deviations";
}

TEST(SharedShift, IsNotThatOfHedgesBetweenWallsThatStand) {
  const SeamFit hedge = fit({0.0, 0.0, 0.0}, kOff), other = fit({5.0, 0.0, 0.0}, kOff);
  const std::vector<SeamFit> fits =
      by_x({hedge, other, fit({0.0, 9.0, 0.0}, {0.0, 0.001, 0.0}),
            fit({5.0, 9.0, 0.0}, {0.0, -0.001, 0.0}), fit({9.0, 9.0, 0.0}, {0.0, 0.0, 0.0})});
  EXPECT_LT(shared_shift_m(hedge, fits).norm(), 0.0011);
  EXPECT_LT(shared_shift_m(other, fits).norm(), 0.0011);
}

TEST(SharedShift, AsksThoseWhoTellOfItsDirection) {
  // Ground tells of heights alone: it does not speak for walls.
  const Eigen::Vector3d up(0.0, 0.0, 1.0);
  const SeamFit wall = fit({0.0, 0.0, 0.0}, kOff);
  std::vector<SeamFit> fits = {wall, fit({5.0, 0.0, 0.0}, kOff)};
  for (int i = 0; i < 6; ++i) fits.push_back(fit({2.0 * i, 2.0, 0.0}, {0.0, 0.0, 0.0}, up));
  EXPECT_NEAR(shared_shift_m(wall, by_x(fits)).y(), 0.044, 1e-9);
  // Nor do those who know it badly.
  for (int i = 0; i < 6; ++i) {
    fits.push_back(fit({2.0 * i, 2.0, 0.0}, {0.0, 0.0, 0.0}));
    fits.back().sigma_m = 0.02;
  }
  EXPECT_NEAR(shared_shift_m(wall, by_x(fits)).y(), 0.044, 1e-9);
}

TEST(SharedShift, IsNothingAtAPlaceThatIsAlone) {
  const std::vector<SeamFit> fits = {fit({0.0, 0.0, 0.0}, kOff), fit({16.0, 0.0, 0.0}, kOff)};
  EXPECT_EQ(shared_shift_m(fits[0], fits), Eigen::Vector3d::Zero());
  const std::vector<SeamFit> unsure = {fit({0.0, 0.0, 0.0}, {0.005, 0.0, 0.0}),
                                       fit({1.0, 0.0, 0.0}, {0.005, 0.0, 0.0})};
  EXPECT_EQ(shared_shift_m(unsure[0], unsure), Eigen::Vector3d::Zero()) << "within the deviations";
}

}  // namespace seam_test
}  // namespace stillmap::mapping
