#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/maps/geodesy.hpp>

#include <cmath>
#include <limits>
#include <stdexcept>

namespace stillmap::maps {
namespace geodesy_test {

using ::testing::IsEmpty;
using ::testing::SizeIs;

constexpr GeodeticOrigin kKarlsruhe{49.011212804408, 8.4228850417969, 112.834923};

TEST(Geodesy, MgrsSquaresHaveTheirCorners) {
  // By the letters: zone 54 begins its columns with S (3rd: 300 km), even zones their rows with F
  // (E is the 20th: 1,900 km, and band S lies above 2,000 km).
  const MgrsSquare square = mgrs_square("54SUE");
  EXPECT_EQ(square.zone, (UtmZone{54, true}));
  EXPECT_EQ(square.corner, Eigen::Vector2d(300'000.0, 3'900'000.0));
  EXPECT_EQ(mgrs_name({386'128.0, 3'943'002.0, 10.0}, {54, true}), "54SUE");
  // The Sydney Opera House is in 56HLH.
  EXPECT_EQ(mgrs_name({334'900.0, 6'252'300.0, 0.0}, {56, false}), "56HLH");
  EXPECT_EQ(mgrs_square("56HLH").corner, Eigen::Vector2d(300'000.0, 6'200'000.0));
  for (const char* const name : {"", "54", "54SUE1234", "61SUE", "54IUE", "ZAH", "INVALID"})
    EXPECT_THROW((void)mgrs_square(name), std::invalid_argument) << name;
  EXPECT_THROW((void)mgrs_name({-5e6, 0.0, 0.0}, {54, true}), std::invalid_argument);
}

TEST(Geodesy, GridsAtAPlaceHaveTheirZeroThere) {
  // On the ellipsoid; above it lengths shrink with the height.
  const GeodeticOrigin place{kKarlsruhe.latitude_deg, kKarlsruhe.longitude_deg, 0.0};
  const GridProjection projection(place, grid_at(place, 0.9996));
  EXPECT_LT(projection.to_grid(Eigen::Vector3d::Zero()).norm(), 1e-6);
  // Along the meridian and across it lengths are those of the scale.
  EXPECT_NEAR(projection.to_grid({0.0, 100.0, 0.0}).y(), 99.96, 1e-4);
  EXPECT_NEAR(projection.to_grid({100.0, 0.0, 0.0}).x(), 99.96, 1e-4);
  const Eigen::Vector3d p(812.5, -1711.0, 44.0);
  EXPECT_LT((projection.to_map(projection.to_grid(p)) - p).norm(), 1e-6);
}

TEST(Geodesy, PlacesComeBackFromAPointOfAnEnuFrame) {
  // Beside the frame's origin, 100 km away, over the antimeridian, at and across the poles.
  const GeodeticOrigin far{49.9, 8.5, -40.0};
  const GeodeticOrigin before{-17.0, 179.99, 10.0}, behind{-17.0, -179.99, 20.0};
  const GeodeticOrigin north{89.999, 120.0, 0.0}, beyond{89.9995, -60.0, 5.0};
  for (const auto& [origin, place] :
       {std::pair{kKarlsruhe, far}, std::pair{before, behind}, std::pair{behind, before},
        std::pair{north, beyond}, std::pair{kKarlsruhe, kKarlsruhe}}) {
    const GeodeticOrigin found = place_in_enu(T_enu_enu(origin, place).translation(), origin);
    EXPECT_NEAR(found.latitude_deg, place.latitude_deg, 1e-11);
    EXPECT_NEAR(found.longitude_deg, place.longitude_deg,
                1e-6 / std::cos(place.latitude_deg * 0.017453));
    EXPECT_NEAR(found.altitude_m, place.altitude_m, 1e-6);
  }
  const GeodeticOrigin pole = place_in_enu({0.0, 0.0, 7.0}, {-90.0, 0.0, 0.0});
  EXPECT_NEAR(pole.latitude_deg, -90.0, 1e-11);
  EXPECT_TRUE(violations(pole).empty());
  EXPECT_NEAR(pole.altitude_m, 7.0, 1e-6);
}

TEST(Geodesy, UtmOfKnownPlaces) {
  // The equator on a central meridian has the false origin by definition.
  const GeodeticOrigin equator{0.0, 9.0, 0.0};
  EXPECT_EQ(utm_zone_of(equator), (UtmZone{32, true}));
  const Eigen::Vector3d origin = UtmProjection(equator, {32, true}).to_utm(Eigen::Vector3d::Zero());
  EXPECT_NEAR((origin - Eigen::Vector3d(500'000.0, 0.0, 0.0)).norm(), 0.0, 1e-6);
  // The CN Tower, as published: 17T 630084 m east, 4833438 m north.
  const GeodeticOrigin tower{43.0 + 38.0 / 60 + 33.24 / 3600, -(79.0 + 23.0 / 60 + 13.7 / 3600),
                             76.0};
  ASSERT_EQ(utm_zone_of(tower), (UtmZone{17, true}));
  const Eigen::Vector3d p = UtmProjection(tower, {17, true}).to_utm(Eigen::Vector3d::Zero());
  EXPECT_NEAR(p.x(), 630'084.0, 1.0);
  EXPECT_NEAR(p.y(), 4'833'438.0, 1.0);
  EXPECT_NEAR(p.z(), 76.0, 1e-6);
}

TEST(Geodesy, SouthIsCountedFromTheFalseNorthing) {
  const GeodeticOrigin sydney{-33.8568, 151.2153, 10.0};
  ASSERT_EQ(utm_zone_of(sydney), (UtmZone{56, false}));
  const Eigen::Vector3d p = UtmProjection(sydney, {56, false}).to_utm(Eigen::Vector3d::Zero());
  EXPECT_NEAR(p.y(), 6'252'000.0, 1000.0);
  EXPECT_EQ((UtmZone{56, false}).epsg(), 32756);
}

TEST(Geodesy, UtmAndBackIsTheSamePoint) {
  const UtmProjection projection(kKarlsruhe, {32, true});
  for (const Eigen::Vector3d& p :
       {Eigen::Vector3d(0, 0, 0), Eigen::Vector3d(1234.5, -987.25, 30.125),
        Eigen::Vector3d(-20'000, 15'000, -40)}) {
    EXPECT_LT((projection.to_map(projection.to_utm(p)) - p).norm(), 1e-6);
  }
}

TEST(Geodesy, UtmKeepsLengthsToItsScale) {
  const UtmProjection projection(kKarlsruhe, {32, true});
  const Eigen::Vector3d a = projection.to_utm(Eigen::Vector3d::Zero());
  const Eigen::Vector3d b = projection.to_utm(Eigen::Vector3d(1000.0, 0.0, 0.0));
  // 42 km from the central meridian: 0.9996 (1 + (42 / 6380)^2 / 2), at 113 m of height.
  EXPECT_NEAR((b - a).head<2>().norm(), 1000.0 * 0.99960, 0.05);
  // The Earth curves away below the plane: d^2 / 2 R.
  EXPECT_NEAR(b.z() - a.z(), 1000.0 * 1000.0 / (2 * 6.38e6), 0.001);
}

TEST(Geodesy, PlaceOfUtmIsWhereItCameFrom) {
  const Eigen::Vector3d p = UtmProjection(kKarlsruhe, {32, true}).to_utm(Eigen::Vector3d::Zero());
  const GeodeticOrigin back = geodetic_of(p, {32, true});
  EXPECT_NEAR(back.latitude_deg, kKarlsruhe.latitude_deg, 1e-11);
  EXPECT_NEAR(back.longitude_deg, kKarlsruhe.longitude_deg, 1e-11);
  EXPECT_NEAR(back.altitude_m, kKarlsruhe.altitude_m, 1e-6);
  EXPECT_THROW(static_cast<void>(geodetic_of({5e7, 0, 0}, {32, true})), std::invalid_argument);
  EXPECT_THROW(static_cast<void>(geodetic_of({std::nan(""), 0, 0}, {32, true})),
               std::invalid_argument);
}

TEST(Geodesy, CodesOfZones) {
  EXPECT_EQ(utm_zone_of_epsg(32632), (UtmZone{32, true}));
  EXPECT_EQ(utm_zone_of_epsg(32760), (UtmZone{60, false}));
  EXPECT_EQ(utm_zone_of_epsg(25832), (UtmZone{32, true}));
  EXPECT_EQ(utm_zone_of_epsg(26917), (UtmZone{17, true}));
  for (const int other : {4326, 32600, 32661, 25827, 26924, 31467, 0, -32632})
    EXPECT_EQ(utm_zone_of_epsg(other), std::nullopt) << other;
  EXPECT_EQ(utm_zone_of({85.0, 0.0, 0.0}), std::nullopt);
}

TEST(Geodesy, PlacesOffTheEarthAreNamed) {
  EXPECT_THAT(violations(kKarlsruhe), IsEmpty());
  EXPECT_THAT(violations({91.0, 181.0, std::nan("")}), SizeIs(3));
}

}  // namespace geodesy_test
}  // namespace stillmap::maps
