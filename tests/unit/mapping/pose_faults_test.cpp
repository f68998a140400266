#include "trajectory/pose_faults.hpp"
#include "trajectory/drive_pose_faults.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstddef>
#include <functional>
#include <numbers>
#include <random>
#include <vector>

namespace stillmap::mapping {
namespace {

using Pose = SmoothPath::Pose;
using ::testing::AllOf;
using ::testing::HasSubstr;

constexpr double kDegree = std::numbers::pi / 180.0;
constexpr double kScanS = 0.1;

Eigen::Isometry3d isometry(const Eigen::Vector3d& roll_pitch_yaw, const Eigen::Vector3d& p) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = (Eigen::AngleAxisd(roll_pitch_yaw.z(), Eigen::Vector3d::UnitZ()) *
                Eigen::AngleAxisd(roll_pitch_yaw.y(), Eigen::Vector3d::UnitY()) *
                Eigen::AngleAxisd(roll_pitch_yaw.x(), Eigen::Vector3d::UnitX()))
                   .toRotationMatrix();
  T.translation() = p;
  return T;
}

/// A vehicle that speeds up, brakes, turns and nods, at any time in [0, 130] s.
class Street {
 public:
  struct Motion {
    double speed_mps = 8.0, change_mps = 4.0, turn_radps = 0.3, nod_rad = 0.02;
    /// Other times of the drive, so that it is another one.
    double phase = 0.0;
  };

  explicit Street(const Motion& motion) {
    Eigen::Vector3d p(412'345.0, 5'812'345.0, 30.0);
    double yaw = 0.3;
    for (double t_s = 0.0; t_s <= 130.0; t_s += kStepS) {
      const double pitch = motion.nod_rad * std::sin(0.9 * t_s);
      const double roll = motion.nod_rad * std::sin(0.7 * t_s + 1.0);
      path_.push_back(isometry({roll, pitch, yaw}, p));
      const double speed = motion.speed_mps + motion.change_mps * std::sin(0.37 * t_s) *
                                                  std::cos(0.11 * t_s + 0.4 + motion.phase);
      p += kStepS * speed * path_.back().linear().col(0);
      yaw += kStepS * motion.turn_radps * std::sin(0.29 * t_s + motion.phase) *
             std::sin(0.073 * t_s + 0.2 + 3.0 * motion.phase);
    }
  }
  Street() : Street(Motion{}) {}

  [[nodiscard]] Eigen::Isometry3d at(double t_s) const {
    return path_.at(static_cast<std::size_t>(std::lround(t_s / kStepS)));
  }

 private:
  static constexpr double kStepS = 1e-3;
  std::vector<Eigen::Isometry3d> path_;
};

/// Errors of 0.1 m and 0.1 deg in each direction, of each pose on its own or slowly changing.
class Noise {
 public:
  Noise(bool smooth, std::uint32_t seed) : smooth_(smooth), random_(seed) {
    std::uniform_real_distribution<double> any(0.0, 1.0);
    for (Wave& wave : waves_)
      wave = {2.0 + 8.0 * any(random_), 2.0 * std::numbers::pi * any(random_),
              std::sqrt(2.0 / kWaves) * normal_(random_)};
  }
  [[nodiscard]] Eigen::Isometry3d at(double t_s) {
    Eigen::Matrix<double, 6, 1> errors;
    for (std::size_t k = 0; k < 6; ++k) {
      double error = 0.0;
      for (std::size_t i = 0; i < kWaves; ++i) {
        const Wave& wave = waves_.at(k * kWaves + i);
        error += wave.size * std::sin(2.0 * std::numbers::pi * t_s / wave.period_s + wave.phase);
      }
      errors[static_cast<Eigen::Index>(k)] = smooth_ ? error : normal_(random_);
    }
    return isometry(0.1 * kDegree * errors.tail<3>(), 0.1 * errors.head<3>());
  }

 private:
  struct Wave {
    double period_s, phase, size;
  };
  static constexpr std::size_t kWaves = 24;
  bool smooth_;
  std::mt19937 random_;
  std::normal_distribution<double> normal_;
  std::array<Wave, 6 * kWaves> waves_{};
};

/// What odometry and a recorder of poses would say of a drive; changed by the tests.
struct Recorded {
  Street street{};
  double begin_s = 20.0, end_s = 80.0;
  /// Of the poses' path, which may begin earlier and end later.
  double pose_begin_s = 20.0, pose_end_s = 80.0, pose_step_s = 0.1;
  /// Stamps of poses are so much too early, of those at that time.
  std::function<double(double)> early_s = [](double) { return 0.0; };
  double scale = 1.0;
  double step_m = 0.0;
  /// Place of the lidar in the frame of the poses.
  Eigen::Isometry3d T_given_lidar = Eigen::Isometry3d::Identity();
  Eigen::Matrix3d axes = Eigen::Matrix3d::Identity();
  Noise* noise = nullptr;

  [[nodiscard]] PathPair paths() const {
    PathPair paths;
    const Eigen::Isometry3d T_start = lidar_at(begin_s);
    Eigen::Affine3d mirror = Eigen::Affine3d::Identity();
    mirror.linear() = axes;
    const auto scans = std::lround((end_s - begin_s) / kScanS);
    for (long i = 0; i <= scans; ++i) {
      const double t_s = begin_s + kScanS * static_cast<double>(i);
      const Eigen::Isometry3d T = T_start.inverse() * lidar_at(t_s);
      paths.odometry.push_back({t_s, Eigen::Isometry3d((mirror * T * mirror).matrix())});
    }
    const auto poses = std::lround((pose_end_s - pose_begin_s) / pose_step_s);
    for (long i = 0; i <= poses; ++i) {
      const double t_s = pose_begin_s + pose_step_s * static_cast<double>(i);
      Eigen::Isometry3d T = street.at(t_s);
      if (noise != nullptr) T = T * noise->at(t_s);
      T.translation() *= scale;
      paths.given.push_back({t_s - early_s(t_s), T});
    }
    return paths;
  }
  [[nodiscard]] PoseFaults faults() const {
    return pose_faults(paths(), [&]() -> std::optional<GroundSeen> {
      const double t_s = 0.5 * (begin_s + end_s);
      const Eigen::Vector3d up = lidar_at(t_s).linear().transpose() * Eigen::Vector3d::UnitZ();
      return GroundSeen{street.at(t_s).linear(), axes * up};
    });
  }

 private:
  [[nodiscard]] Eigen::Isometry3d lidar_at(double t_s) const {
    return street.at(t_s) * T_given_lidar;
  }
};

void expect_none(const PoseFaults& faults, const std::string& what) {
  for (const maps::DriveFinding& finding : findings_of(faults))
    ADD_FAILURE() << what << ": " << finding.what;
}

void expect_offset(const PoseFaults& faults, double offset_s) {
  ASSERT_TRUE(faults.offset_s);
  EXPECT_NEAR(*faults.offset_s, offset_s, 0.005);
}

TEST(PoseFaults, NothingIsSaidOfPosesThatAreRight) {
  expect_none(Recorded{}.faults(), "exact");
  Recorded with_far_ends;
  with_far_ends.pose_begin_s = 0.0;
  with_far_ends.pose_end_s = 125.0;
  with_far_ends.pose_step_s = 0.01;
  expect_none(with_far_ends.faults(), "a path at 100 Hz that reaches beyond the scans");
}

TEST(PoseFaults, NothingIsSaidOfPosesThatAreNoisy) {
  for (std::uint32_t seed = 1; seed <= 8; ++seed) {
    for (const bool smooth : {false, true}) {
      for (const double length_s : {8.0, 20.0, 60.0}) {
        Noise noise(smooth, seed);
        Recorded recorded;
        recorded.noise = &noise;
        recorded.pose_end_s = recorded.end_s = recorded.begin_s + length_s;
        expect_none(recorded.faults(), std::string(smooth ? "smooth" : "white") + " " +
                                           std::to_string(seed) + " of " +
                                           std::to_string(length_s) + " s");
      }
    }
  }
}

TEST(PoseFaults, TellsByHowMuchClocksAreApart) {
  for (const double early_s : {0.1, -0.1, 0.5, 3.0, -3.0, 37.0}) {
    Recorded recorded;
    recorded.early_s = [&](double) { return early_s; };
    recorded.pose_begin_s = 0.0;
    recorded.pose_end_s = 125.0;
    const PoseFaults faults = recorded.faults();
    ASSERT_TRUE(faults.offset_s) << early_s;
    EXPECT_NEAR(*faults.offset_s, early_s, 0.005);
    EXPECT_FALSE(faults.offsets_of_halves_s || faults.scale || faults.T_given_lidar ||
                 faults.mirrored_axis)
        << early_s;
  }
}

// As in a file whose first line has no stamp and whose others count from the epoch.
TEST(PoseFaults, OneStampThatIsFarOffCostsNothing) {
  Recorded recorded;
  recorded.early_s = [](double) { return 0.5; };
  PathPair paths = recorded.paths();
  paths.given.insert(paths.given.begin(), Pose{-1.7e9, Eigen::Isometry3d::Identity()});
  paths.given[1].follows = false;
  expect_offset(pose_faults(paths, {}), 0.5);
}

TEST(PoseFaults, APauseOfADayHidesNothing) {
  Recorded recorded;
  recorded.early_s = [](double) { return 0.5; };
  PathPair paths = recorded.paths();
  expect_offset(pose_faults(paths, {}), 0.5);
  for (std::vector<Pose>* poses : {&paths.odometry, &paths.given}) {
    const std::size_t half = poses->size() / 2;
    (*poses)[half].follows = false;
    for (std::size_t i = half; i < poses->size(); ++i) (*poses)[i].t_s += 86'400.0;
  }
  expect_offset(pose_faults(paths, {}), 0.5);
}

TEST(PoseFaults, TheRemedyCountsWhatWasAdded) {
  const auto first = [](const PoseFaults& faults, const AppliedOffset& applied) {
    return findings_of(faults, applied).at(0);
  };
  PoseFaults faults;
  faults.offset_s = 0.1;
  EXPECT_THAT(first(faults, {}).remedy, HasSubstr("--pose-time-offset 0.100 (or auto)"));
  EXPECT_THAT(first(faults, {0.5, false}).remedy, HasSubstr("--pose-time-offset 0.600"));
  EXPECT_THAT(first(faults, {0.5, false}).what,
              HasSubstr("with 0.500 s added, are 0.100 s behind"));
  EXPECT_THAT(first(faults, {0.5, true}).remedy, HasSubstr("--pose-time-offset auto:"));
  faults = {};
  faults.offsets_of_halves_s = {0.1, -0.7};
  EXPECT_THAT(first(faults, {0.5, false}).what,
              AllOf(HasSubstr("with 0.600 s added"), HasSubstr("with -0.200 s in")));
}

// Of 60 s of scans and of poses 23 s are left, whose halves tell less than all of them.
TEST(PoseFaults, ShortHalvesDoNotContradictTheWhole) {
  for (const double begin_s : {22.0, 32.0, 42.0}) {
    Recorded recorded;
    recorded.street = Street({.change_mps = 1.0, .turn_radps = 0.05});
    recorded.begin_s = begin_s;
    recorded.end_s = begin_s + 23.0;
    recorded.pose_begin_s = begin_s - 0.2;
    recorded.pose_end_s = begin_s + 60.0;
    recorded.early_s = [](double) { return 37.0; };
    const PoseFaults faults = recorded.faults();
    ASSERT_TRUE(faults.offset_s) << begin_s;
    EXPECT_NEAR(*faults.offset_s, 37.0, 0.02);
  }
}

TEST(PoseFaults, TellsHowFarClocksAreApartByNoisyPoses) {
  for (const bool smooth : {false, true}) {
    for (const double early_s : {0.1, 0.5, 3.0}) {
      Noise noise(smooth, 5);
      Recorded recorded;
      recorded.noise = &noise;
      recorded.early_s = [&](double) { return early_s; };
      const PoseFaults faults = recorded.faults();
      ASSERT_TRUE(faults.offset_s) << smooth << ' ' << early_s;
      EXPECT_NEAR(*faults.offset_s, early_s, 0.02);
    }
  }
}

TEST(PoseFaults, EvenMotionStraightOnTellsNothingOfTime) {
  Recorded recorded;
  recorded.street = Street({.change_mps = 0.0, .turn_radps = 0.0, .nod_rad = 0.0});
  recorded.early_s = [](double) { return 0.5; };
  expect_none(recorded.faults(), "even motion");
  Noise noise(false, 3);
  recorded.noise = &noise;
  expect_none(recorded.faults(), "even motion by noisy poses");
}

TEST(PoseFaults, TellsTwoClocksApart) {
  Recorded recorded;
  recorded.early_s = [](double t_s) { return t_s < 50.0 ? 0.2 : 0.6; };
  const PoseFaults step = recorded.faults();
  ASSERT_TRUE(step.offsets_of_halves_s);
  EXPECT_NEAR((*step.offsets_of_halves_s)[0], 0.2, 0.02);
  EXPECT_NEAR((*step.offsets_of_halves_s)[1], 0.6, 0.02);
  EXPECT_FALSE(step.offset_s);
  recorded.early_s = [](double t_s) { return 0.01 * (t_s - 20.0); };
  const PoseFaults drift = recorded.faults();
  ASSERT_TRUE(drift.offsets_of_halves_s);
  EXPECT_NEAR((*drift.offsets_of_halves_s)[0], 0.15, 0.05);
  EXPECT_NEAR((*drift.offsets_of_halves_s)[1], 0.45, 0.05);
}

TEST(PoseFaults, NamesTheAxisOfTheScansThatIsTurnedRound) {
  for (int axis = 0; axis < 3; ++axis) {
    Recorded recorded;
    recorded.axes(axis, axis) = -1.0;
    const PoseFaults faults = recorded.faults();
    ASSERT_TRUE(faults.mirrored_axis) << axis;
    EXPECT_EQ(*faults.mirrored_axis, axis);
    EXPECT_FALSE(faults.may_be_z_down);
    EXPECT_FALSE(faults.T_given_lidar || faults.offset_s || faults.scale);
  }
}

TEST(PoseFaults, OnEvenGroundTheGroundTellsWhichAxisIsTurnedRound) {
  for (const int axis : {1, 2}) {
    Recorded recorded;
    recorded.street = Street({.nod_rad = 0.0});
    recorded.axes(axis, axis) = -1.0;
    const PoseFaults faults = recorded.faults();
    ASSERT_TRUE(faults.mirrored_axis) << axis;
    EXPECT_EQ(*faults.mirrored_axis, axis);
    EXPECT_TRUE(faults.may_be_z_down);
  }
}

TEST(PoseFaults, ASensorThatHangsUpsideDownIsNotMirrored) {
  Recorded recorded;
  recorded.T_given_lidar = isometry({180.0 * kDegree, 0.0, 0.0}, Eigen::Vector3d::Zero());
  const PoseFaults faults = recorded.faults();
  EXPECT_FALSE(faults.mirrored_axis);
  ASSERT_TRUE(faults.T_given_lidar);
  EXPECT_TRUE(faults.T_given_lidar->isApprox(recorded.T_given_lidar, 2e-3));
}

TEST(PoseFaults, TellsTheScale) {
  for (const double scale : {3.28084, 1.02, 0.98}) {
    Recorded recorded;
    recorded.scale = scale;
    const PoseFaults faults = recorded.faults();
    ASSERT_TRUE(faults.scale) << scale;
    EXPECT_NEAR(*faults.scale / scale, 1.0, 0.002);
    EXPECT_FALSE(faults.T_given_lidar || faults.offset_s || faults.mirrored_axis);
  }
  Recorded feet;
  feet.scale = 3.28084;
  feet.T_given_lidar.translation() = Eigen::Vector3d(0.3, 0.0, 0.0);
  EXPECT_FALSE(feet.faults().T_given_lidar) << "a lever of 0.3 m is none of 0.98 feet";
  EXPECT_THAT(findings_of(feet.faults()).at(0).what, HasSubstr("feet"));
}

TEST(PoseFaults, TellsHowTheLidarLiesInTheFrameOfThePoses) {
  const std::array<Eigen::Vector3d, 5> turns{
      {{0, 0, 90}, {0, 0, 180}, {-90, 0, -90}, {0, 5, 0}, {4, -3, 30}}};
  for (const Eigen::Vector3d& turn : turns) {
    Recorded recorded;
    recorded.T_given_lidar = isometry(kDegree * turn, {1.5, -0.4, 0.0});
    const PoseFaults faults = recorded.faults();
    ASSERT_TRUE(faults.T_given_lidar) << turn.transpose();
    EXPECT_TRUE(faults.T_given_lidar->linear().isApprox(recorded.T_given_lidar.linear(), 5e-3));
    EXPECT_LT((faults.T_given_lidar->translation() - recorded.T_given_lidar.translation())
                  .head<2>()
                  .norm(),
              0.1)
        << faults.T_given_lidar->translation().transpose();
    EXPECT_FALSE(faults.mirrored_axis || faults.offset_s || faults.scale) << turn.transpose();
  }
}

TEST(PoseFaults, StraightOnTellsPitchAndYawButNoRoll) {
  Recorded recorded;
  recorded.street = Street({.turn_radps = 0.0, .nod_rad = 0.0});
  recorded.T_given_lidar = isometry(kDegree * Eigen::Vector3d(0.0, 5.0, -4.0), {0.0, 0.0, 0.0});
  const PoseFaults faults = recorded.faults();
  ASSERT_TRUE(faults.T_given_lidar);
  EXPECT_TRUE(
      faults.T_given_lidar->linear().col(0).isApprox(recorded.T_given_lidar.linear().col(0), 2e-3));
  recorded.T_given_lidar = isometry(kDegree * Eigen::Vector3d(6.0, 0.0, 0.0), {0.0, 0.0, 0.0});
  expect_none(recorded.faults(), "roll");
}

TEST(PoseFaults, TellsALever) {
  Recorded recorded;
  recorded.T_given_lidar.translation() = Eigen::Vector3d(1.5, 0.0, 0.0);
  const PoseFaults faults = recorded.faults();
  ASSERT_TRUE(faults.T_given_lidar);
  EXPECT_NEAR(faults.T_given_lidar->translation().x(), 1.5, 0.1);
}

TEST(PoseFaults, PosesOfAnotherDriveAreNotExplained) {
  for (const double phase : {1.0, 2.0, 4.0}) {
    PathPair paths = Recorded{}.paths();
    Recorded other;
    other.street = Street({.speed_mps = 6.0, .phase = phase});
    paths.given = other.paths().given;
    expect_none(pose_faults(paths, {}), "another drive");
  }
}

TEST(PathsOf, KnowNoWayOverPausesNorWhereOdometryWasLost) {
  maps::Drive::Contents contents;
  std::vector<OdometryPose> odometry(8);
  for (std::size_t i = 0; i < odometry.size(); ++i) {
    contents.scan_files.emplace_back("scan");
    contents.stamps_ns.push_back(100'000'000 * static_cast<std::int64_t>(i));
    odometry[i].status = i == 4 ? OdometryStatus::kPredicted : OdometryStatus::kMatched;
  }
  contents.stamps_ns.back() += 2'000'000'000;
  contents.T_map_lidar.resize(odometry.size(), Eigen::Isometry3d::Identity());
  const PathPair paths = paths_of(maps::Drive(contents), 0, odometry);
  const auto followers = [](const std::vector<Pose>& poses) {
    std::string text;
    for (const Pose& pose : poses) text += pose.follows ? '1' : '0';
    return text;
  };
  // The first one has nothing to follow.
  EXPECT_EQ(followers(paths.odometry).substr(1), "1110010");
  EXPECT_EQ(followers(paths.given).substr(1), "1111110");
  EXPECT_NEAR(paths.odometry.back().t_s, 2.7, 1e-9);
}

}  // namespace
}  // namespace stillmap::mapping
