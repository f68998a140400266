#include "bags/place_on_earth.hpp"

#include <gtest/gtest.h>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/geodesy.hpp>

#include <cmath>
#include <random>

#include "support/throws.hpp"

namespace stillmap::maps {
namespace place_on_earth_test {

using test::ThrowsSaying;

const GeodeticOrigin kPlace{48.137, 11.575, 519.0};

GeodeticOrigin place_at(const Eigen::Vector3d& p_enu) {
  const UtmZone zone = utm_zone_of(kPlace).value();
  return geodetic_of(UtmProjection(kPlace, zone).to_utm(p_enu), zone);
}

Eigen::Isometry3d turned_and_shifted(double turn_rad, const Eigen::Vector3d& shift) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = Eigen::AngleAxisd(turn_rad, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  T.translation() = shift;
  return T;
}

/// A bend of a road, up a slope.
std::vector<Eigen::Vector3d> path(int count) {
  std::vector<Eigen::Vector3d> points;
  for (int i = 0; i < count; ++i) {
    const double s = 3.0 * i / count;
    points.emplace_back(150.0 * std::sin(s), 80.0 * (1.0 - std::cos(s)), 2.0 * s);
  }
  return points;
}

const Eigen::Isometry3d kTruth = turned_and_shifted(2.2, {12.0, -31.0, 4.0});

std::vector<FixOnPath> fixes_along(const std::vector<Eigen::Vector3d>& points) {
  std::vector<FixOnPath> fixes;
  for (const Eigen::Vector3d& p_map : points) fixes.push_back({place_at(kTruth * p_map), p_map});
  return fixes;
}

/// Farthest that a point of the path lies from its place [m].
double error_m(const PlaceOnEarth& found, const std::vector<Eigen::Vector3d>& points) {
  double worst = 0.0;
  for (const Eigen::Vector3d& p_map : points)
    worst = std::max(
        worst, (T_enu_enu(kPlace, found.origin) * found.T_enu_map * p_map - kTruth * p_map).norm());
  return worst;
}

TEST(PlaceOnEarth, IsThatOfExactFixesWhereverThePathsFrameLies) {
  const auto points = path(200);
  const PlaceOnEarth found = place_on_earth(fixes_along(points), "drive");
  EXPECT_LT(error_m(found, points), 0.005);  // the Earth is no plane: 150 m bend by 2 mm
  EXPECT_LT(found.residual_m, 0.001);
  // Coordinates of a grid: far from zero, and turned by another angle.
  const Eigen::Isometry3d T_grid_map = turned_and_shifted(-0.7, {691'000.0, 5'334'000.0, 500.0});
  std::vector<FixOnPath> in_grid = fixes_along(points);
  for (FixOnPath& fix : in_grid) fix.p_map = T_grid_map * fix.p_map;
  PlaceOnEarth of_grid = place_on_earth(in_grid, "drive");
  of_grid.T_enu_map = of_grid.T_enu_map * T_grid_map;
  EXPECT_LT(error_m(of_grid, points), 0.005);
}

TEST(PlaceOnEarth, IsNotPulledByFixesThatAreFarOff) {
  const auto points = path(300);
  std::vector<FixOnPath> fixes = fixes_along(points);
  std::mt19937 random(1);
  std::normal_distribution<double> noise(0.0, 0.5);
  for (std::size_t i = 0; i < fixes.size(); ++i) {
    Eigen::Vector3d off(noise(random), noise(random), noise(random));
    if (i < 60) off += Eigen::Vector3d(25.0, 10.0, 60.0);  // under a bridge
    if (i == 0) off.x() += 5000.0;
    fixes[i].place = place_at(kTruth * fixes[i].p_map + off);
  }
  const PlaceOnEarth found = place_on_earth(fixes, "drive");
  EXPECT_LT(error_m(found, points), 0.6);  // all counted alike, they are refused: 18 m off
  EXPECT_NEAR(found.residual_m, 0.7, 0.2);
}

TEST(PlaceOnEarth, RefusesWhatTellsNoHeading) {
  const auto points = path(200);
  const std::vector<FixOnPath> fixes = fixes_along(points);
  EXPECT_THAT(
      [&] {
        (void)place_on_earth({fixes.begin(), fixes.begin() + 9}, "drive");
      },
      ThrowsSaying<InputError>({"drive: found 9 fixes", "at least 10"}));
  std::vector<FixOnPath> standing(20, fixes[3]);
  EXPECT_THAT([&] { (void)place_on_earth(standing, "drive"); },
              ThrowsSaying<InputError>({"reach 0.0 m", "10 m and more"}));
  std::vector<FixOnPath> mirrored = fixes;
  for (FixOnPath& fix : mirrored) fix.p_map.y() *= -1.0;
  EXPECT_THAT([&] { (void)place_on_earth(mirrored, "drive"); },
              ThrowsSaying<InputError>({"off the poses at the median", "at most 2 %"}));
}

}  // namespace place_on_earth_test
}  // namespace stillmap::maps
