#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/mapping/trajectory.hpp>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/frames.hpp>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "small_drive.hpp"
#include "support/synthetic_world.hpp"
#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::mapping {
namespace trajectory_estimate_test {

using maps::InputError;
using test::ThrowsSaying;

/// A block of houses with a street around it: two drives, the first once around and on along its
/// first side, the second the other way round from elsewhere.
class AroundTheBlock : public ::testing::Test {
 protected:
  static constexpr double kSideM = 24.0;

  static void SetUpTestSuite() {
    folder_ = new test::TemporaryFolder();
    test::Random random(5);
    test::SyntheticWorld world;
    // Houses of unlike widths and set-backs inside and outside of the street, with poles before
    // them.
    for (const double side : {-1.0, 1.0}) {
      for (double at = -40.0; at < 40.0;) {
        const double width_m = random.uniform(5.0, 11.0);
        const double set_back_m = random.uniform(0.0, 3.0);
        const double outer = kSideM / 2 + 6.0 + set_back_m;
        const double height_m = random.uniform(3.0, 9.0);
        const auto add = [&](double x0, double x1, double y0, double y1) {
          world.boxes.push_back({{std::min(x0, x1), std::min(y0, y1), 0.0},
                                 {std::max(x0, x1), std::max(y0, y1), height_m}});
        };
        add(at, at + width_m - 1.0, side * outer, side * (outer + 5.0));
        add(side * outer, side * (outer + 5.0), at, at + width_m - 1.0);
        world.cylinders.push_back({{at, side * (outer - 1.5)}, 0.15, 4.0});
        world.cylinders.push_back({{side * (outer - 1.5), at + 2.0}, 0.15, 4.0});
        at += width_m;
      }
    }
    world.boxes.push_back({{-7.0, -5.0, 0.0}, {6.0, 7.0, 8.0}});
    write(world, "first", 0.0, 1.0, 1.25);
    write(world, "second", 50.0, -1.0, 0.6);
  }
  static void TearDownTestSuite() {
    delete folder_;
    folder_ = nullptr;
  }

  /// Pose after so many metres along the street, corners rounded by a circle.
  static Eigen::Isometry3d along(double way_m) {
    const double radius_m = 6.0;
    const double straight_m = kSideM - 2 * radius_m;
    const double arc_m = radius_m * std::numbers::pi / 2;
    double left = std::fmod(way_m + 8 * (straight_m + arc_m), 4 * (straight_m + arc_m));
    Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
    T.translation() = Eigen::Vector3d(-straight_m / 2, -kSideM / 2, 1.8);
    while (true) {
      const double on_straight = std::min(left, straight_m);
      T.translate(Eigen::Vector3d(on_straight, 0.0, 0.0));
      left -= on_straight;
      const double on_arc = std::min(left, arc_m);
      const double angle = on_arc / radius_m;
      T.translate(Eigen::Vector3d(radius_m * std::sin(angle), radius_m * (1 - std::cos(angle)), 0));
      T.rotate(Eigen::AngleAxisd(angle, Eigen::Vector3d::UnitZ()));
      left -= on_arc;
      if (left <= 0.0) return T;
    }
  }

  static void write(const test::SyntheticWorld& world, const std::string& name, double from_m,
                    double direction, double rounds) {
    const double round_m = 4 * (kSideM - 12.0) + 12.0 * std::numbers::pi;
    test::ScanPattern pattern{.rings = 24, .columns = 300, .noise_m = 0.01};
    std::string poses;
    const auto scans = static_cast<std::size_t>(rounds * round_m);
    for (std::size_t i = 0; i < scans; ++i) {
      Eigen::Isometry3d T = along(from_m + direction * static_cast<double>(i));
      if (direction < 0) T.rotate(Eigen::AngleAxisd(std::numbers::pi, Eigen::Vector3d::UnitZ()));
      pattern.seed = i + 1;
      folder_->write(fmt::format("{}/{:06}.bin", name, i), test::bin_of(world.scan(T, pattern)));
      poses += test::kitti_line(T);
    }
    folder_->write(name + "/poses.txt", poses);
  }

  static maps::Drive open(const std::string& name) {
    return maps::Drive::open(folder_->path() / name);
  }
  TrajectoryEstimate estimate(const std::vector<maps::Drive>& drives) {
    const test::TemporaryFolder scratch;
    return estimate_trajectories(drives, options_, scratch.path(), {}, cancel_);
  }
  /// Largest distance of an estimate to the truth, both from the first scan of the first drive on.
  static double worst_m(const TrajectoryEstimate& estimate,
                        const std::vector<maps::Drive>& drives) {
    const Eigen::Isometry3d T_truth_map =
        drives[0].T_map_lidar(0) * estimate.drives[0].T_map_lidar[0].inverse();
    double worst = 0.0;
    for (std::size_t d = 0; d < drives.size(); ++d) {
      for (std::size_t i = 0; i < drives[d].size(); ++i)
        worst = std::max(worst, (T_truth_map * estimate.drives[d].T_map_lidar[i].translation() -
                                 drives[d].T_map_lidar(i).translation())
                                    .norm());
    }
    return worst;
  }

  static test::TemporaryFolder* folder_;
  TrajectoryOptions options_;
  CancelFlag cancel_{false};
};
test::TemporaryFolder* AroundTheBlock::folder_ = nullptr;

TEST_F(AroundTheBlock, ADriveFindsItsWayAndTheStreetItHasDrivenBefore) {
  const std::vector<maps::Drive> drives{open("first")};
  const TrajectoryEstimate found = estimate(drives);
  EXPECT_LT(worst_m(found, drives), 0.15);
  EXPECT_FALSE(found.loops.empty());
  const Eigen::Isometry3d& first = found.drives[0].T_map_lidar[0];
  EXPECT_NEAR(first.translation().z(), 1.8, 0.05) << "z is the height over the ground";
  EXPECT_NEAR(first.translation().x(), 0.0, 1e-9);
}

TEST_F(AroundTheBlock, DrivesWithoutCommonPosesAreJoinedByWhatBothSaw) {
  const std::vector<maps::Drive> drives{open("first"), open("second")};
  const TrajectoryEstimate found = estimate(drives);
  EXPECT_LT(worst_m(found, drives), 0.25);
  EXPECT_TRUE(std::any_of(found.loops.begin(), found.loops.end(), [](const EstimatedLoop& loop) {
    return loop.from_drive != loop.to_drive;
  }));
}

TEST_F(AroundTheBlock, SeveralDrivesWithoutLoopsOrPosesAreRefusedAtOnce) {
  options_.loops = false;
  cancel_ = true;
  EXPECT_THAT(
      [&] {
        (void)estimate({open("first"), open("second")});
      },
      ThrowsSaying<std::invalid_argument>({"loops: found off", "expected on"}));
}

TEST_F(AroundTheBlock, DrivesThatShareNothingAreRefusedByName) {
  // Too few scans for loops that confirm each other.
  options_.end = 3;
  EXPECT_THAT(
      [&] {
        (void)estimate({open("first"), open("second")});
      },
      ThrowsSaying<InputError>({"second", "no place that the other drives have seen"}));
}

TEST_F(AroundTheBlock, SameBitsForAnyNumberOfThreads) {
  const std::vector<maps::Drive> drives{open("first")};
  options_.threads = 1;
  const TrajectoryEstimate one = estimate(drives);
  options_.threads = 3;
  const TrajectoryEstimate three = estimate(drives);
  for (std::size_t i = 0; i < drives[0].size(); ++i)
    ASSERT_EQ(one.drives[0].T_map_lidar[i].matrix(), three.drives[0].T_map_lidar[i].matrix()) << i;
}

TEST_F(AroundTheBlock, GnssPutsTheMapWhereItsPositionsAre) {
  maps::Drive drive = open("first");
  // East-north-up somewhere else, positions off by half a metre at random, some by 30 m.
  Eigen::Isometry3d T_enu_world = Eigen::Isometry3d::Identity();
  T_enu_world.translation() = Eigen::Vector3d(500.0, -300.0, 40.0);
  T_enu_world.linear() = Eigen::AngleAxisd(2.1, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  std::vector<Eigen::Isometry3d> measured, truth;
  test::Random random(3);
  for (std::size_t i = 0; i < drive.size(); ++i) {
    truth.push_back(T_enu_world * drive.T_map_lidar(i));
    Eigen::Isometry3d T = truth.back();
    for (double& value : T.translation()) value += 0.3 * random.normal();
    if (i % 40 == 20) T.translation().x() += 30.0;
    measured.push_back(T);
  }
  const maps::GeodeticOrigin origin{48.0, 9.0, 200.0};
  options_.gnss_sigma_m = 0.3;
  const TrajectoryEstimate found = estimate({drive.with_poses(measured, origin)});
  ASSERT_TRUE(found.origin);
  EXPECT_DOUBLE_EQ(found.origin->latitude_deg, 48.0);
  double sum = 0.0;
  for (std::size_t i = 0; i < truth.size(); ++i)
    sum += (found.drives[0].T_map_lidar[i].translation() - truth[i].translation()).norm();
  EXPECT_LT(sum / static_cast<double>(truth.size()), 0.35);
}

TEST_F(AroundTheBlock, PosesThatAreTrustedToTheMillimetreAreKept) {
  const maps::Drive drive = open("first");
  options_.loops = false;
  options_.prior = {.sigma_m = 1e-3, .sigma_rad = 1e-4};
  const TrajectoryEstimate found = estimate({drive});
  for (std::size_t i = 0; i < drive.size(); i += 7)
    EXPECT_LT(
        (found.drives[0].T_map_lidar[i].translation() - drive.T_map_lidar(i).translation()).norm(),
        0.05);
}

/// Given poses that are off, and what becomes of them.
class GivenPosesAround : public AroundTheBlock {
 protected:
  GivenPosesAround() { options_.refine_given = true; }

  /// Errors in every direction: of each pose on its own, or waves of some 15 m of way.
  static maps::Drive disturbed(const maps::Drive& drive, double sigma_m, double sigma_rad,
                               bool smooth) {
    test::Random random(11);
    Eigen::Matrix<double, 6, 1> phases;
    for (double& phase : phases) phase = random.uniform(0.0, 2.0 * std::numbers::pi);
    std::vector<Eigen::Isometry3d> poses;
    for (std::size_t i = 0; i < drive.size(); ++i) {
      Eigen::Matrix<double, 6, 1> error;
      for (Eigen::Index k = 0; k < 6; ++k)
        error[k] = smooth ? std::numbers::sqrt2 * std::sin(0.4 * static_cast<double>(i) + phases[k])
                          : random.normal();
      error.head<3>() *= sigma_m;
      error.tail<3>() *= sigma_rad;
      poses.push_back(drive.T_map_lidar(i) * maps::exp_se3(error));
    }
    return drive.with_poses(poses, std::nullopt);
  }
  /// What scans three metres apart are off from each other, at most. The very first, which have no
  /// map to be found in yet, tell no more than their given poses.
  static double worst_near_m(const std::vector<Eigen::Isometry3d>& poses,
                             const maps::Drive& truth) {
    double worst = 0.0;
    for (std::size_t i = 8; i < poses.size(); ++i) {
      const Eigen::Isometry3d T_true = truth.T_map_lidar(i - 3).inverse() * truth.T_map_lidar(i);
      worst = std::max(
          worst, (T_true.inverse() * (poses[i - 3].inverse() * poses[i])).translation().norm());
    }
    return worst;
  }
  static Eigen::Vector3d mean_offset_m(const std::vector<Eigen::Isometry3d>& poses,
                                       const maps::Drive& truth) {
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    for (std::size_t i = 0; i < poses.size(); ++i)
      sum += poses[i].translation() - truth.T_map_lidar(i).translation();
    return sum / static_cast<double>(poses.size());
  }
};

TEST_F(GivenPosesAround, NeighboursAreBroughtTogetherAndTheFrameStays) {
  const maps::Drive truth = open("first");
  for (const bool smooth : {false, true}) {
    const maps::Drive given = disturbed(truth, 0.1, 0.002, smooth);
    ASSERT_GT(worst_near_m(given.contents().T_map_lidar, truth), 0.25);
    const TrajectoryEstimate found = estimate({given});
    const auto& poses = found.drives[0].T_map_lidar;
    EXPECT_LT(worst_near_m(poses, truth), 0.035) << smooth;
    EXPECT_LT(mean_offset_m(poses, truth).norm(), 0.06) << smooth;
    ASSERT_TRUE(found.given_errors);
    // Half a wave apart errors of waves are twice as far apart as their own size.
    EXPECT_NEAR(found.given_errors->sigma_m, 0.1, smooth ? 0.06 : 0.03);
    EXPECT_EQ(found.given_errors->denied, 0U) << smooth;
    EXPECT_FALSE(found.loops.empty());
  }
}

TEST_F(GivenPosesAround, PosesThatAreRightStay) {
  const maps::Drive truth = open("first");
  const TrajectoryEstimate found = estimate({truth});
  for (std::size_t i = 0; i < truth.size(); ++i)
    ASSERT_LT(
        (found.drives[0].T_map_lidar[i].translation() - truth.T_map_lidar(i).translation()).norm(),
        0.025)
        << i;
  EXPECT_LT(found.given_errors->sigma_m, 0.02);
  EXPECT_FALSE(GivenPoseErrors{}.agree()) << "nothing tells";
}

TEST_F(GivenPosesAround, AJumpIsDenied) {
  const maps::Drive truth = open("first");
  std::vector<Eigen::Isometry3d> poses = truth.contents().T_map_lidar;
  // Some of them are asked: one key frame in ten metres.
  for (std::size_t i = 30; i < 45; ++i) poses[i].translation() += Eigen::Vector3d(3.0, -2.0, 0.5);
  const TrajectoryEstimate found = estimate({truth.with_poses(poses, std::nullopt)});
  EXPECT_LT(worst_near_m(found.drives[0].T_map_lidar, truth), 0.035);
  EXPECT_LT(mean_offset_m(found.drives[0].T_map_lidar, truth).norm(), 0.03);
  EXPECT_GE(found.given_errors->denied, 1U);
}

TEST_F(GivenPosesAround, DrivesOfTwoDaysAreJoinedWhereTheirFramesAreApart) {
  const maps::Drive first = open("first"), second = open("second");
  std::vector<Eigen::Isometry3d> poses = second.contents().T_map_lidar;
  for (Eigen::Isometry3d& T : poses) T.translation() += Eigen::Vector3d(0.4, -0.3, 0.1);
  const TrajectoryEstimate found = estimate({first, second.with_poses(poses, std::nullopt)});
  ASSERT_TRUE(std::any_of(found.loops.begin(), found.loops.end(), [](const EstimatedLoop& loop) {
    return loop.from_drive != loop.to_drive;
  }));
  const Eigen::Vector3d apart = mean_offset_m(found.drives[1].T_map_lidar, second) -
                                mean_offset_m(found.drives[0].T_map_lidar, first);
  EXPECT_LT(apart.norm(), 0.06);
}

TEST_F(GivenPosesAround, AreNoPriorOfAnotherKindToo) {
  options_.prior = {.sigma_m = 0.1, .sigma_rad = 0.1};
  EXPECT_THAT([&] { (void)estimate({open("first")}); },
              ThrowsSaying<std::invalid_argument>({"refine_given", "expected one of them"}));
}

TEST_F(AroundTheBlock, AskingForPosesThatAreNotThereIsRefused) {
  maps::Drive::Contents contents = open("first").contents();
  contents.T_map_lidar.clear();
  options_.gnss_sigma_m = 1.0;
  EXPECT_THAT([&] { (void)estimate({maps::Drive(contents)}); },
              ThrowsSaying<InputError>({"first", "a drive without poses"}));
}

TEST_F(AroundTheBlock, ACancelledEstimateEnds) {
  cancel_ = true;
  EXPECT_THROW((void)estimate({open("first")}), Cancelled);
}

TEST(TrajectoryOptions, NameWhatIsOutOfBounds) {
  TrajectoryOptions options;
  EXPECT_TRUE(options.violations().empty());
  options.prior = {.sigma_m = 0.0, .sigma_rad = std::nan("")};
  options.gnss_sigma_m = -1.0;
  options.threads = 1000;
  EXPECT_EQ(options.violations().size(), 5U);
}

}  // namespace trajectory_estimate_test
}  // namespace stillmap::mapping
