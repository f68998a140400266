#include "pose/gnss_prior.hpp"

#include <gmock/gmock.h>

#include <cmath>
#include <numbers>
#include <vector>

#include "support/matchers.hpp"

namespace stillmap::server {
namespace gnss_prior_test {

const maps::GeodeticOrigin kOrigin{
    .latitude_deg = 48.0, .longitude_deg = 11.0, .altitude_m = 500.0};

Eigen::Isometry3d pose_at(double x, double y, double z, double roll_rad) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.translation() = Eigen::Vector3d(x, y, z);
  T.linear() = Eigen::AngleAxisd(roll_rad, Eigen::Vector3d::UnitX()).toRotationMatrix();
  return T;
}

/// On the WGS 84 ellipsoid a second of latitude at 48 degrees is 30.885 m, one of longitude 20.744
/// m.
TEST(GnssPrior, IsEastAndNorthOfTheOrigin) {
  const GnssFix fix{.latitude_deg = 48.0 + 1.0 / 3600.0,
                    .longitude_deg = 11.0 + 2.0 / 3600.0,
                    .altitude_m = 503.0,
                    .sigma_m = 5.0};
  const localization::Prior prior = prior_from(fix, kOrigin, {});
  EXPECT_THAT(Eigen::Vector3d(prior.T_map_lidar.translation()),
              test::IsNearVector(Eigen::Vector3d(41.49, 30.885, 3.0), 0.03));
}

TEST(GnssPrior, KnowsThePlaceButNoHeading) {
  const GnssFix fix{
      .latitude_deg = 48.0, .longitude_deg = 11.0, .altitude_m = 500.0, .sigma_m = 4.0};
  const localization::Prior prior = prior_from(fix, kOrigin, {});
  ASSERT_TRUE(prior.covariance);
  EXPECT_DOUBLE_EQ((*prior.covariance)(0, 0), 16.0);
  EXPECT_DOUBLE_EQ((*prior.covariance)(1, 1), 16.0);
  EXPECT_DOUBLE_EQ((*prior.covariance)(2, 2), 36.0);
  EXPECT_DOUBLE_EQ(std::sqrt((*prior.covariance)(5, 5)), std::numbers::pi);
}

TEST(GnssPrior, WithoutAnAltitudeItStandsWhereTheMapWasDriven) {
  const std::vector<Eigen::Isometry3d> seen = {pose_at(-50.0, 0.0, 9.0, 0.0),
                                               pose_at(3.0, 4.0, 1.5, 0.25)};
  const GnssFix fix{
      .latitude_deg = 48.0, .longitude_deg = 11.0, .altitude_m = std::nullopt, .sigma_m = 4.0};
  const localization::Prior prior = prior_from(fix, kOrigin, seen);
  EXPECT_THAT(Eigen::Vector3d(prior.T_map_lidar.translation()),
              test::IsNearVector(Eigen::Vector3d(0.0, 0.0, 1.5), 1e-6));
  // Mounted as on the mapping vehicle.
  EXPECT_TRUE(prior.T_map_lidar.linear().isApprox(seen[1].linear()));
  EXPECT_NEAR((*prior.covariance)(2, 2), 16.0, 1e-9);
}

TEST(GnssPrior, DoesNotKnowTheHeadingOfATiltedLidarEither) {
  const std::vector<Eigen::Isometry3d> seen = {pose_at(0.0, 0.0, 1.5, 0.5)};
  const GnssFix fix{
      .latitude_deg = 48.0, .longitude_deg = 11.0, .altitude_m = 501.5, .sigma_m = 0.1};
  const localization::Prior prior = prior_from(fix, kOrigin, seen);
  const Eigen::Matrix3d R = prior.T_map_lidar.linear();
  const auto deviations = [&](const Eigen::Vector3d& of_map, int block) {
    const Eigen::Vector3d of_lidar = R.transpose() * of_map;
    const Eigen::Matrix3d covariance = prior.covariance->block<3, 3>(block, block);
    return std::sqrt(of_lidar.dot(covariance.inverse() * of_lidar));
  };
  // Turned about the vertical by half a turn; and up by three deviations.
  EXPECT_NEAR(deviations({0.0, 0.0, std::numbers::pi}, 3), 1.0, 1e-9);
  EXPECT_NEAR(deviations({0.2, 0.0, 0.0}, 3), 1.0, 1e-9);
  EXPECT_NEAR(deviations({0.0, 0.0, 0.45}, 0), 3.0, 1e-9);
  EXPECT_NEAR(deviations({0.3, 0.0, 0.0}, 0), 3.0, 1e-9);
}

}  // namespace gnss_prior_test
}  // namespace stillmap::server
