#include "odometry/hidden_scan.hpp"
#include "odometry/hidden_gaps.hpp"
#include "odometry/run_odometry.hpp"

#include <stillmap/mapping/odometry.hpp>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <support/synthetic_world.hpp>

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>
#include <random>
#include <vector>

namespace stillmap::mapping {
namespace hidden_scan_test {

using test::pose_at;
using ::testing::ElementsAre;
using ::testing::IsEmpty;
using Scans = std::vector<maps::Scan>;

constexpr std::int64_t kStepNs = 100'000'000;

/// Seen along a street by a sensor that drives at 8 m/s and more from scan to scan.
class HiddenScan : public ::testing::Test {
 protected:
  static constexpr std::size_t kScans = 32;

  HiddenScan() {
    for (std::size_t i = 0; i < kScans; ++i) {
      const auto s = static_cast<double>(i);
      truth_.push_back(pose_at(20.0 + 0.8 * s + 0.005 * s * s, 1.2 * std::sin(0.06 * s),
                               0.09 * std::cos(0.06 * s)));
      scans_.push_back(scan_from(world_, truth_.back(), i));
    }
  }

  static maps::Scan scan_from(const test::SyntheticWorld& world, const Eigen::Isometry3d& T,
                              std::size_t index) {
    test::ScanPattern pattern;
    pattern.rings = 20;
    pattern.columns = 360;
    pattern.noise_m = 0.02;
    pattern.seed = index + 1;
    maps::Scan scan;
    scan.index = index;
    scan.stamp_ns = kStepNs * static_cast<std::int64_t>(index);
    scan.source = "scan " + std::to_string(index);
    scan.cloud = world.scan(T, pattern);
    return scan;
  }

  /// Points in the same directions at other ranges. @param range_m  of the true one.
  void replace(std::size_t index, const std::function<double(double)>& range_m) {
    for (Eigen::Vector3f& p : scans_[index].cloud.positions)
      p *= static_cast<float>(range_m(p.cast<double>().norm())) / p.norm();
  }
  void cover(std::size_t index, double radius_m, double noise_m) {
    std::normal_distribution<double> noise(radius_m, noise_m);
    replace(index, [&](double) { return noise(random_); });
  }
  /// Of a mean depth [m]. A third of the rays get through five metres to the nearest ground.
  void fill_with_dust(std::size_t index, double depth_m = 2.5) {
    std::exponential_distribution<double> depth(1.0 / depth_m);
    replace(index, [&](double true_m) { return std::clamp(depth(random_), 0.3, true_m); });
  }

  [[nodiscard]] std::vector<OdometryPose> run(bool expects_given = false,
                                              const std::string& method = "default") const {
    maps::Drive::Contents contents;
    for (const maps::Scan& scan : scans_) {
      contents.scan_files.emplace_back(scan.source);
      contents.stamps_ns.push_back(scan.stamp_ns);
    }
    if (expects_given) contents.T_map_lidar.assign(truth_.begin(), truth_.end());
    const maps::Drive drive(contents);
    const FollowedDrive followed{.drive = drive,
                                 .begin = 0,
                                 .end = scans_.size(),
                                 .method = method,
                                 .expects_given_poses = expects_given,
                                 .read = [&](std::size_t i) { return scans_[i]; }};
    return run_odometry(followed, 1, {}, CancelFlag{false});
  }
  static std::vector<std::size_t> hidden_in(const std::vector<OdometryPose>& poses) {
    std::vector<std::size_t> hidden;
    for (std::size_t i = 0; i < poses.size(); ++i) {
      if (!poses[i].hidden) continue;
      hidden.push_back(i);
      EXPECT_EQ(poses[i].status, OdometryStatus::kPredicted) << i;
    }
    return hidden;
  }
  [[nodiscard]] double off_m(const std::vector<OdometryPose>& poses, std::size_t from,
                             std::size_t to) const {
    const Eigen::Isometry3d T_found = poses[from].T_odom_lidar.inverse() * poses[to].T_odom_lidar;
    return ((truth_[from].inverse() * truth_[to]).inverse() * T_found).translation().norm();
  }

  test::SyntheticWorld world_ = test::street(41);
  std::vector<Eigen::Isometry3d> truth_;
  Scans scans_;
  std::mt19937_64 random_{7};
};

TEST_F(HiddenScan, NoneOfACleanDrive) {
  EXPECT_THAT(hidden_in(run()), IsEmpty());
  EXPECT_THAT(hidden_in(run(true)), IsEmpty());
}

TEST_F(HiddenScan, AShellIsPlacedByMotionAndForgotten) {
  const Scans clean = scans_;
  const std::vector<OdometryPose> without = run();
  for (const double radius_m : {0.2, 0.5, 1.0, 2.0, 4.0, 8.0}) {
    scans_ = clean;
    cover(16, radius_m, 0.05);
    const std::vector<OdometryPose> poses = run();
    EXPECT_THAT(hidden_in(poses), ElementsAre(16)) << radius_m;
    EXPECT_LT(off_m(poses, 0, 16), 0.05) << radius_m;
    for (std::size_t i = 17; i < kScans; ++i)
      EXPECT_LT(
          (poses[i].T_odom_lidar.translation() - without[i].T_odom_lidar.translation()).norm(),
          0.02)
          << radius_m << ", scan " << i;
  }
}

TEST_F(HiddenScan, AShellIsPlacedByMotionByLoamToo) {
  const std::vector<OdometryPose> without = run(false, "loam");
  cover(16, 2.0, 0.02);
  const std::vector<OdometryPose> poses = run(false, "loam");
  EXPECT_THAT(hidden_in(poses), ElementsAre(16));
  for (std::size_t i = 16; i < kScans; ++i)
    EXPECT_LT((poses[i].T_odom_lidar.translation() - without[i].T_odom_lidar.translation()).norm(),
              0.05)
        << i;
}

TEST_F(HiddenScan, OneOfASensorThatLooksToOneSideToo) {
  // A shell that is none by its shape alone.
  for (maps::Scan& scan : scans_) {
    test::ScanPattern pattern;
    pattern.rings = 40;
    pattern.columns = 1440;
    pattern.noise_m = 0.02;
    pattern.seed = scan.index + 1;
    scan.cloud = world_.scan(truth_[scan.index], pattern);
    std::vector<std::uint8_t> keep;
    for (const Eigen::Vector3f& p : scan.cloud.positions)
      keep.push_back(p.x() > p.norm() * 0.5F ? 1 : 0);
    scan.cloud.keep_only(keep);
  }
  EXPECT_THAT(hidden_in(run()), IsEmpty());
  const Scans clean = scans_;
  for (const double radius_m : {1.5, 3.0, 6.0}) {
    scans_ = clean;
    cover(16, radius_m, 0.02);
    EXPECT_THAT(hidden_in(run()), ElementsAre(16)) << radius_m;
  }
}

TEST_F(HiddenScan, TenOnEndAreBridged) {
  const Scans clean = scans_;
  const auto expect_bridged = [&](const char* what) {
    const std::vector<OdometryPose> poses = run();
    EXPECT_THAT(hidden_in(poses), ElementsAre(11, 12, 13, 14, 15, 16, 17, 18, 19, 20)) << what;
    double variance_m2 = 0.0;
    for (std::size_t i = 11; i <= 20; ++i) {
      variance_m2 += poses[i].covariance(0, 0);
      EXPECT_LT(off_m(poses, 10, i), 3.0 * std::sqrt(variance_m2)) << what << ' ' << i;
      EXPECT_LT(off_m(poses, 10, i), 0.15) << what << ' ' << i;
    }
    for (std::size_t i = 21; i < kScans; ++i) {
      EXPECT_FALSE(poses[i].begins_anew) << what;
      EXPECT_LT(off_m(poses, 10, i), 0.05) << what << ' ' << i;
    }
  };
  for (std::size_t i = 11; i <= 20; ++i) cover(i, 3.0, 0.01);
  expect_bridged("shell");
  scans_ = clean;
  for (std::size_t i = 11; i <= 20; ++i) fill_with_dust(i, 5.0);
  expect_bridged("dust");
  scans_ = clean;
  for (std::size_t i = 11; i <= 20; ++i) scans_[i].cloud = scans_[10].cloud;
  expect_bridged("the same frame");
}

TEST_F(HiddenScan, AFrameThatIsSentAgain) {
  scans_[16].cloud = scans_[15].cloud;
  const std::vector<OdometryPose> poses = run();
  EXPECT_THAT(hidden_in(poses), ElementsAre(16));
  EXPECT_LT(off_m(poses, 15, 16), 0.05);
  EXPECT_LT(off_m(poses, 15, kScans - 1), 0.05);
}

TEST_F(HiddenScan, WhoStandsInAQueueSeesTheSameAndIsNotHidden) {
  for (std::size_t i = 0; i < kScans; ++i) scans_[i] = scan_from(world_, truth_[10], i);
  EXPECT_THAT(hidden_in(run()), IsEmpty());
  // Even without noise, while nothing says that it moves.
  for (std::size_t i = 20; i < kScans; ++i) scans_[i].cloud = scans_[19].cloud;
  EXPECT_THAT(hidden_in(run()), IsEmpty());
}

// From its middle the walls look like a shell. The sensor has seen them from beside before.
TEST_F(HiddenScan, ARoundTankThatWasSeenFromBesideIsNone) {
  test::SyntheticWorld tank;
  for (int k = 0; k < 72; ++k) {
    const double azimuth = k * std::numbers::pi / 36.0;
    const double radius_m = 6.0 + 0.1 * (7 * k % 4);
    tank.cylinders.push_back(
        {{30.0 + radius_m * std::cos(azimuth), radius_m * std::sin(azimuth)}, 0.4, 9.0});
  }
  tank.boxes = {{{29.5, 5.0, 0.0}, {30.5, 6.0, 2.0}}};
  test::ScanPattern pattern{
      .rings = 20, .columns = 360, .lowest_rad = -0.2, .highest_rad = 0.1, .noise_m = 0.02};
  for (std::size_t i = 0; i < kScans; ++i) {
    truth_[i] = pose_at(25.5 + 0.25 * static_cast<double>(i), 0.0);
    pattern.seed = i + 1;
    scans_[i].cloud = tank.scan(truth_[i], pattern);
  }
  const auto shells = std::ranges::count_if(
      scans_, [](const maps::Scan& scan) { return is_shell(scan.cloud.positions); });
  EXPECT_GE(shells, 2);
  EXPECT_THAT(hidden_in(run()), IsEmpty());
}

TEST_F(HiddenScan, TheFirstOfADrive) {
  const Scans clean = scans_;
  const auto expect_first = [&](const char* what) {
    const std::vector<OdometryPose> poses = run();
    EXPECT_THAT(hidden_in(poses), ElementsAre(0)) << what;
    EXPECT_LT(off_m(poses, 1, 0), 0.1) << what;
    for (std::size_t i = 2; i < kScans; ++i) EXPECT_LT(off_m(poses, 1, i), 0.06) << what << i;
  };
  cover(0, 0.5, 0.05);
  expect_first("shell");
  scans_ = clean;
  fill_with_dust(0);
  expect_first("dust");
  // The last one of those that tell how the drive starts.
  scans_ = clean;
  fill_with_dust(5);
  EXPECT_THAT(hidden_in(run()), ElementsAre(5));
}

TEST_F(HiddenScan, GivenPosesSayWhereItWasTaken) {
  cover(16, 4.0, 0.02);
  fill_with_dust(17);
  const std::vector<OdometryPose> poses = run(true);
  EXPECT_THAT(hidden_in(poses), ElementsAre(16, 17));
  EXPECT_LT(off_m(poses, 15, 16), 0.02);
  EXPECT_LT(off_m(poses, 15, 17), 0.02);
}

TEST_F(HiddenScan, AnotherPlaceAfterThemIsBegunAnewAndSaid) {
  // Carried, covered, into a hall in which nothing is as in the street.
  test::SyntheticWorld hall;
  hall.boxes = {{{-6.0, -4.0, -3.0}, {-5.5, 4.0, 3.0}}, {{5.5, -4.0, -3.0}, {6.0, 4.0, 3.0}},
                {{-6.0, 3.5, -3.0}, {6.0, 4.0, 3.0}},   {{-6.0, -4.0, -3.0}, {6.0, -3.5, 3.0}},
                {{2.0, 1.0, 0.0}, {3.0, 2.0, 3.0}},     {{-3.0, -2.5, 0.0}, {-2.4, -2.0, 3.0}},
                {{-6.0, -4.0, 2.9}, {6.0, 4.0, 3.4}}};
  for (std::size_t i = 12; i < 16; ++i) cover(i, 0.3, 0.01);
  for (std::size_t i = 16; i < kScans; ++i) {
    truth_[i] = pose_at(-4.0 + 0.2 * static_cast<double>(i - 16), 0.0);
    scans_[i] = scan_from(hall, truth_[i], i);
  }
  const auto expect_anew = [&](const std::vector<OdometryPose>& poses, std::size_t before) {
    const auto anew = std::ranges::find_if(poses, &OdometryPose::begins_anew);
    ASSERT_NE(anew, poses.end());
    EXPECT_FALSE(anew->hidden);
    EXPECT_EQ(anew->status, OdometryStatus::kPredicted);
    const auto first = static_cast<std::size_t>(anew - poses.begin());
    EXPECT_LT(first, before);
    for (std::size_t i = first + 1; i < kScans; ++i) {
      EXPECT_EQ(poses[i].status, OdometryStatus::kMatched) << i;
      EXPECT_LT(off_m(poses, first, i), 0.05) << i;
    }
  };
  expect_anew(run(), 24);
  // Two more that are covered, on the way there.
  cover(18, 0.3, 0.01);
  cover(19, 0.3, 0.01);
  expect_anew(run(), 26);
}

TEST(IsShell, IsAllAroundOrWithinAMetre) {
  const auto ball = [](auto range_of, bool half) {
    std::vector<Eigen::Vector3f> points;
    for (int i = 0; i < 60; ++i) {
      for (int k = -10; k <= 10; ++k) {
        const float azimuth = (half ? 0.01F : 0.1047F) * static_cast<float>(i);
        const float elevation = 0.04F * static_cast<float>(k);
        const Eigen::Vector3f d(std::cos(elevation) * std::cos(azimuth),
                                std::cos(elevation) * std::sin(azimuth), std::sin(elevation));
        points.emplace_back(range_of(d) * d);
      }
    }
    return points;
  };
  const auto at = [](float radius_m) { return [=](const Eigen::Vector3f&) { return radius_m; }; };
  const auto wall = [](const Eigen::Vector3f& d) { return 3.0F / std::max(d.x(), 0.1F); };
  EXPECT_TRUE(is_shell(ball(at(0.2F), false)));
  EXPECT_TRUE(is_shell(ball(at(8.0F), false)));
  EXPECT_TRUE(is_shell(ball(at(0.4F), true)));
  EXPECT_FALSE(is_shell(ball(at(4.0F), true))) << "a wall may be";
  EXPECT_FALSE(is_shell(ball(wall, true)));
  EXPECT_FALSE(is_shell(ball(wall, false)));
  EXPECT_FALSE(is_shell({}));
}

/// Of scans at these times and places along x, at 10 m/s where they are seen.
std::vector<OdometryPose> joined(const std::vector<double>& t_s, const std::vector<double>& x_m,
                                 const std::vector<std::size_t>& hidden) {
  std::vector<OdometryPose> poses(t_s.size());
  std::vector<std::int64_t> stamps_ns;
  for (std::size_t i = 0; i < poses.size(); ++i) {
    stamps_ns.push_back(std::llround(1e9 * t_s[i]));
    poses[i].T_odom_lidar = pose_at(x_m[i], 0.0);
    poses[i].twist_lidar[0] = 10.0;
    poses[i].hidden = std::ranges::count(hidden, i) > 0;
    poses[i].status = poses[i].hidden ? OdometryStatus::kPredicted : OdometryStatus::kMatched;
  }
  interpolate_hidden(stamps_ns, poses);
  return poses;
}

TEST(InterpolateHidden, OverAPauseMotionIsEven) {
  for (const bool stands : {false, true}) {
    const auto poses = stands ? joined({0.0, 0.1, 60.1, 120.1, 120.2}, {0, 1, 31, 1, 1}, {2})
                              : joined({0.0, 0.1, 60.1, 120.1}, {0, 1, 31, 1}, {2});
    EXPECT_NEAR(poses[2].T_odom_lidar.translation().x(), 1.0, 1e-6) << stands;
    EXPECT_NEAR(poses[2].twist_lidar[0], 0.0, 1e-6) << stands;
  }
}

TEST(InterpolateHidden, AtTheEndAndWhereAllAreHiddenNothingMoves) {
  const auto end = joined({0.0, 0.1, 0.2, 0.3}, {0, 1, 2, 7}, {2, 3});
  EXPECT_DOUBLE_EQ(end[2].T_odom_lidar.translation().x(), 2.0);
  EXPECT_DOUBLE_EQ(end[3].T_odom_lidar.translation().x(), 7.0);
  const auto all = joined({0.0, 0.1, 0.2}, {0, 5, 2}, {0, 1, 2});
  EXPECT_DOUBLE_EQ(all[1].T_odom_lidar.translation().x(), 5.0);
}

TEST(InterpolateHidden, LeadsToTheScanAfterThemAndBackFromTheFirstOnes) {
  // From 10 m/s on with 2 m/s^2, but predicted at 10 m/s from scan 2 on.
  std::vector<OdometryPose> poses(8);
  std::vector<std::int64_t> stamps_ns;
  const auto x_m = [](double t_s) {
    return 10.0 * t_s + (t_s > 0.2 ? std::pow(t_s - 0.2, 2) : 0.0);
  };
  for (std::size_t i = 0; i < poses.size(); ++i) {
    const double t_s = 0.1 * static_cast<double>(i);
    stamps_ns.push_back(kStepNs * static_cast<std::int64_t>(i));
    poses[i].hidden = i < 1 || (i > 2 && i < 7);
    poses[i].status = poses[i].hidden ? OdometryStatus::kPredicted : OdometryStatus::kMatched;
    poses[i].T_odom_lidar = pose_at(poses[i].hidden ? 10.0 * t_s : x_m(t_s), 0.0);
    poses[i].twist_lidar[0] = 10.0;
  }
  poses[0].T_odom_lidar = pose_at(0.7, 0.3);
  const double z_m = poses[1].T_odom_lidar.translation().z();
  interpolate_hidden(stamps_ns, poses);
  for (std::size_t i = 0; i < poses.size(); ++i)
    EXPECT_LT((poses[i].T_odom_lidar.translation() -
               Eigen::Vector3d(x_m(0.1 * static_cast<double>(i)), 0.0, z_m))
                  .norm(),
              0.03)
        << i;
}

}  // namespace hidden_scan_test
}  // namespace stillmap::mapping
