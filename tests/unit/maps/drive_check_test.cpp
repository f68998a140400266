#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/maps/drive_check.hpp>
#include <stillmap/maps/frames.hpp>

#include <cmath>
#include <fstream>
#include <numbers>
#include <random>

#include "support/temporary_folder.hpp"

namespace stillmap::maps {
namespace drive_check_test {

using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr double kDegree = std::numbers::pi / 180.0;

/// A street with houses, poles and a crossing, driven along a bend.
class DriveChecks : public ::testing::Test {
 protected:
  static constexpr std::size_t kScans = 30;

  DriveChecks() {
    std::mt19937 random(7);
    std::uniform_real_distribution<float> unit(0.0F, 1.0F);
    const auto add = [&](float x, float y, float z) { world_.emplace_back(x, y, z); };
    for (int i = 0; i < 30'000; ++i)
      add(160.0F * unit(random) - 40.0F, 80.0F * unit(random) - 40.0F, 0.0F);
    for (int house = 0; house < 40; ++house) {
      const float x = 160.0F * unit(random) - 40.0F;
      const float y = (house % 2 == 0 ? 1.0F : -1.0F) * (7.0F + 12.0F * unit(random));
      const float width = 1.0F + 4.0F * unit(random), height = 2.0F + 5.0F * unit(random);
      for (int i = 0; i < 500; ++i) {
        const float along = width * unit(random);
        add(x + (i % 2 == 0 ? along : 0.0F), y + (i % 2 == 0 ? 0.0F : along),
            height * unit(random));
      }
    }
    for (std::size_t i = 0; i < kScans; ++i) {
      Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
      const double way = 1.2 * static_cast<double>(i), heading = 0.02 * static_cast<double>(i);
      T.translation() = Eigen::Vector3d(way, 0.01 * way * way, 1.7);
      T.linear() = Eigen::AngleAxisd(heading, Eigen::Vector3d::UnitZ()).toRotationMatrix();
      path_.push_back(T);
    }
  }

  /// @param R_level_lidar  how the sensor is mounted.
  void write(const Eigen::Matrix3d& R_level_lidar = Eigen::Matrix3d::Identity(), float scale = 1.0F,
             float intensity_step = 0.001F) {
    T_map_lidar_ = path_;
    for (Eigen::Isometry3d& T : T_map_lidar_) T.linear() = T.linear() * R_level_lidar;
    for (std::size_t i = 0; i < kScans; ++i) {
      std::string bytes;
      const Eigen::Isometry3f T_lidar_map = T_map_lidar_[i].inverse().cast<float>();
      float intensity = 0.0F;
      for (const Eigen::Vector3f& p_map : world_) {
        const Eigen::Vector3f p = T_lidar_map * p_map;
        if (p.norm() > 45.0F) continue;
        intensity = std::fmod(intensity + intensity_step, 1.0F);
        for (const float value : {scale * p.x(), scale * p.y(), scale * p.z(), intensity})
          bytes.append(reinterpret_cast<const char*>(&value), sizeof value);
      }
      names_.push_back(folder_.write("drive/" + name_of(i), bytes));
    }
  }

  /// The scans as PCD files in a folder without poses.
  /// @param viewpoint_of  of a scan, by its right pose.
  template <typename Viewpoint>
  DriveCheck check_pcd(bool in_map_frame, const Viewpoint& viewpoint_of) {
    return check_drive(open_pcd(in_map_frame, viewpoint_of));
  }
  template <typename Viewpoint>
  Drive open_pcd(bool in_map_frame, const Viewpoint& viewpoint_of) {
    for (std::size_t i = 0; i < kScans; ++i) {
      const Eigen::Isometry3f T_file_map =
          in_map_frame ? Eigen::Isometry3f::Identity() : path_[i].inverse().cast<float>();
      std::string body;
      std::size_t points = 0;
      for (const Eigen::Vector3f& p_map : world_) {
        if ((path_[i].inverse().cast<float>() * p_map).norm() > 45.0F) continue;
        const Eigen::Vector3f p = T_file_map * p_map;
        body.append(reinterpret_cast<const char*>(p.data()), 12);
        ++points;
      }
      folder_.write(
          "pcd/" + std::to_string(i) + ".pcd",
          fmt::format("VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH {}\nHEIGHT 1\n"
                      "VIEWPOINT {}\nDATA binary\n{}",
                      points, viewpoint_of(path_[i]), body));
    }
    return Drive::open(folder_.path() / "pcd");
  }
  static std::string viewpoint(const Eigen::Isometry3d& T) {
    const Eigen::Quaterniond q(T.linear());
    return fmt::format("{} {} {} {} {} {} {}", T.translation().x(), T.translation().y(),
                       T.translation().z(), q.w(), q.x(), q.y(), q.z());
  }

  /// @param change  what becomes of the right poses in the drive's file.
  template <typename Change>
  DriveCheck check(const Change& change) {
    Drive::Contents contents;
    contents.root = folder_.path() / "drive";
    contents.scan_files = names_;
    for (std::size_t i = 0; i < names_.size(); ++i) {
      contents.stamps_ns.push_back(stamp_ns(i));
      contents.T_map_lidar.push_back(change(T_map_lidar_[i]));
    }
    return check_drive(Drive(std::move(contents)));
  }
  DriveCheck check() {
    return check([](const Eigen::Isometry3d& T) { return T; });
  }

  static std::vector<std::string> codes(const DriveCheck& check) {
    std::vector<std::string> codes;
    for (const DriveFinding& finding : check.findings) codes.push_back(finding.code);
    return codes;
  }
  static std::string what(const DriveCheck& check, const std::string& code) {
    for (const DriveFinding& finding : check.findings)
      if (finding.code == code) return finding.what;
    return "";
  }
  [[nodiscard]] std::int64_t stamp_ns(std::size_t i) const {
    return static_cast<std::int64_t>(i) * 100'000'000 + (i >= lost_from_ ? 700'000'000 : 0);
  }
  static std::string name_of(std::size_t i) { return "00000" + std::to_string(i) + ".bin"; }

  test::TemporaryFolder folder_{test::memory_folder()};
  std::vector<Eigen::Vector3f> world_;
  std::vector<Eigen::Isometry3d> path_, T_map_lidar_;
  std::vector<std::filesystem::path> names_;
  std::size_t lost_from_ = kScans;
};

TEST_F(DriveChecks, GoodDriveHasNoFinding) {
  write();
  const DriveCheck good = check();
  EXPECT_THAT(codes(good), IsEmpty());
  ASSERT_TRUE(good.mounting && good.overlap && good.periods);
  EXPECT_NEAR(good.mounting->height_m, 1.7, 0.02);
  EXPECT_LT(good.mounting->tilt_rad, 0.2 * kDegree);
  EXPECT_GT(good.overlap->given, 0.7);
  EXPECT_LT(good.overlap->without, good.overlap->given - 0.1);
  EXPECT_NEAR(good.periods->median_s, 0.1, 1e-9);
  EXPECT_EQ(good.periods->gaps, 0U);
}

TEST_F(DriveChecks, PosesInACamerasFrameAreRecognized) {
  write();
  // p_camera = R p_lidar: x right, y down, z ahead.
  Eigen::Isometry3d T_camera_lidar = Eigen::Isometry3d::Identity();
  T_camera_lidar.linear() << 0, -1, 0, 0, 0, -1, 1, 0, 0;
  const DriveCheck wrong = check(
      [&](const Eigen::Isometry3d& T) { return T_camera_lidar * T * T_camera_lidar.inverse(); });
  EXPECT_THAT(codes(wrong), Contains("frame_of_poses"));
  EXPECT_THAT(what(wrong, "frame_of_poses"), HasSubstr("x, y, z point along +z, -x, -y"));
}

TEST_F(DriveChecks, InvertedPosesAreRecognized) {
  write();
  const DriveCheck wrong = check([](const Eigen::Isometry3d& T) { return T.inverse(); });
  EXPECT_THAT(what(wrong, "frame_of_poses"), HasSubstr("inverses of poses"));
}

TEST_F(DriveChecks, PosesOfATurnedVehicleFrameAreRecognized) {
  write(Eigen::AngleAxisd(90 * kDegree, Eigen::Vector3d::UnitZ()).toRotationMatrix());
  // The vehicle's own poses, taken as the sensor's.
  std::size_t i = 0;
  const DriveCheck wrong = check([&](const Eigen::Isometry3d&) { return path_[i++]; });
  EXPECT_THAT(what(wrong, "frame_of_poses"), HasSubstr("x, y, z point along +y, -x, +z"));
}

TEST_F(DriveChecks, PosesOfAnotherDriveAreWorseThanNone) {
  // It crept, and they say that it drove.
  for (Eigen::Isometry3d& T : path_) T.translation().head<2>() *= 0.1;
  write();
  const DriveCheck wrong = check([&](Eigen::Isometry3d T) {
    T.translation().head<2>() *= 10.0;
    return T;
  });
  EXPECT_THAT(codes(wrong), Contains("frame_of_poses"));
  EXPECT_THAT(what(wrong, "frame_of_poses"), HasSubstr("without any"));
}

TEST_F(DriveChecks, MapWhoseZIsNotUpIsSaid) {
  write();
  Eigen::Isometry3d T_camera_map = Eigen::Isometry3d::Identity();
  T_camera_map.linear() << 0, -1, 0, 0, 0, -1, 1, 0, 0;
  const DriveCheck wrong = check([&](const Eigen::Isometry3d& T) { return T_camera_map * T; });
  EXPECT_THAT(codes(wrong), ElementsAre("map_not_level"));
  EXPECT_THAT(what(wrong, "map_not_level"), HasSubstr("90 deg"));
}

TEST_F(DriveChecks, TiltIsMeasuredAndSaid) {
  write(Eigen::AngleAxisd(5 * kDegree, Eigen::Vector3d::UnitY()).toRotationMatrix());
  const DriveCheck tilted = check();
  EXPECT_THAT(codes(tilted), ElementsAre("sensor_tilted"));
  EXPECT_NEAR(tilted.mounting->tilt_rad, 5 * kDegree, 0.2 * kDegree);
  EXPECT_THAT(what(tilted, "sensor_tilted"), HasSubstr("pitch 5.0 deg"));
}

TEST_F(DriveChecks, OneDegreeIsFine) {
  write(Eigen::AngleAxisd(1 * kDegree, Eigen::Vector3d::UnitX()).toRotationMatrix());
  EXPECT_THAT(codes(check()), IsEmpty());
}

TEST_F(DriveChecks, UpsideDownIsSaid) {
  write(Eigen::AngleAxisd(std::numbers::pi, Eigen::Vector3d::UnitX()).toRotationMatrix());
  const DriveCheck hanging = check();
  EXPECT_THAT(codes(hanging), ElementsAre("sensor_upside_down"));
  EXPECT_NEAR(hanging.mounting->height_m, 1.7, 0.02);
}

TEST(DriveChecksOfColumns, SayWhichMayBeTheTimesOfPoints) {
  const test::TemporaryFolder folder;
  Drive::Contents contents;
  for (std::size_t i = 0; i < 3; ++i) {
    contents.scan_files.push_back(folder.write("run.mcap", "a bag"));
    contents.stamps_ns.push_back(static_cast<std::int64_t>(i) * 100'000'000);
    contents.entries.numbers.push_back(i);
  }
  contents.entries.read = [](std::size_t i) {
    DecodedScan scan;
    scan.points_in_file = 10;
    scan.dropped.unsure = 9;
    scan.cloud.positions = {{1.0F, 2.0F, static_cast<float>(i)}};
    return scan;
  };
  contents.entries.sha256 = [](std::size_t i) { return std::to_string(i); };
  const auto found = [&](const std::string& code) {
    for (const DriveFinding& finding : check_drive(Drive(contents)).findings)
      if (finding.code == code) return finding.what;
    return std::string();
  };
  contents.entries.fields = {"x f32", "y f32", "z f32"};
  EXPECT_THAT(found("times_not_taken"), IsEmpty());
  EXPECT_THAT(found("few_returns"), HasSubstr("marked unsure"));
  contents.entries.fields = {"x f32", "FiringTime u32", "ring u16"};
  EXPECT_THAT(found("times_not_taken"),
              HasSubstr("no field has a name that is known for the times of the points "
                        "(FiringTime u32)"));
  contents.entries.fields = {"t u32", "timestamp f64"};
  EXPECT_THAT(found("times_not_taken"), HasSubstr("(t u32, timestamp f64)"));
}

TEST_F(DriveChecks, MillimetresConstantIntensityGapsAndDuplicates) {
  write(Eigen::Matrix3d::Identity(), 1000.0F, 0.0F);
  lost_from_ = 12;
  std::filesystem::copy_file(names_[20], names_[21],
                             std::filesystem::copy_options::overwrite_existing);
  const DriveCheck wrong = check();
  EXPECT_THAT(codes(wrong), ElementsAre("gaps", "duplicates", "intensity_constant", "millimetres"));
  EXPECT_THAT(what(wrong, "gaps"), HasSubstr("after scan 11"));
  EXPECT_THAT(what(wrong, "duplicates"), HasSubstr("scan 21"));
}

TEST_F(DriveChecks, PosesThatJumpOrStandStill) {
  write();
  std::size_t i = 0;
  EXPECT_THAT(codes(check([&](Eigen::Isometry3d T) {
                if (i++ == 7) T.translation().x() += 500.0;
                return T;
              })),
              Contains("poses_jump"));
  EXPECT_THAT(codes(check([](const Eigen::Isometry3d&) { return Eigen::Isometry3d::Identity(); })),
              ElementsAre("poses_stand_still"));
}

TEST_F(DriveChecks, PositionsWrittenWithTooFewDigitsAreSaid) {
  write();
  Drive::Contents contents;
  contents.root = folder_.path() / "drive";
  contents.scan_files = names_;
  contents.T_map_lidar = T_map_lidar_;
  for (std::size_t i = 0; i < names_.size(); ++i) contents.stamps_ns.push_back(stamp_ns(i));
  contents.position_step_m = Eigen::Vector3d(0.001, 0.01, 0.0);
  EXPECT_THAT(codes(check_drive(Drive(contents))), ::testing::Not(Contains("coarse_positions")));
  contents.position_step_m.y() = 0.5;
  const DriveCheck coarse = check_drive(Drive(contents));
  EXPECT_THAT(what(coarse, "coarse_positions"), HasSubstr("steps of 0.5 m along y"));
}

TEST_F(DriveChecks, PosesBeyondAllMeasureAreSurvived) {
  write();
  std::size_t i = 0;
  const DriveCheck wrong = check([&](Eigen::Isometry3d T) {
    T.translation() *= i++ % 2 == 0 ? 1e300 : 1e30;
    return T;
  });
  EXPECT_THAT(codes(wrong), Contains("poses_jump"));
  EXPECT_EQ(wrong.overlap->given, 0.0);
}

TEST_F(DriveChecks, NeitherPosesNorViewpointsIsSaid) {
  const DriveCheck without = check_pcd(false, [](const auto&) { return "0 0 0 1 0 0 0"; });
  EXPECT_THAT(codes(without), ElementsAre("no_poses"));
  EXPECT_THAT(what(without, "no_poses"), HasSubstr("VIEWPOINT"));
  // What is no pose is none.
  EXPECT_THAT(codes(check_pcd(false, [](const auto&) { return "0 0 0 1 0"; })),
              ElementsAre("no_poses"));
  EXPECT_THAT(codes(check_pcd(false, [](const auto&) { return "9 9 9 0 0 0 0"; })),
              ElementsAre("no_poses"));
}

TEST_F(DriveChecks, ViewpointsThatFitAreThePoses) {
  const Drive drive = open_pcd(false, viewpoint);
  ASSERT_TRUE(drive.has_poses());
  EXPECT_LT((drive.T_map_lidar(9).matrix() - path_[9].matrix()).norm(), 1e-5);
  EXPECT_FALSE(drive.contents().points_from_map);
  EXPECT_THAT(drive.contents().notes, Contains(HasSubstr("points are in the frame of the sensor")));
  EXPECT_THAT(codes(check_drive(drive)), IsEmpty());
}

TEST_F(DriveChecks, ScansThatLieInTheFrameOfTheirViewpointsAreBroughtBack) {
  const Drive of_sensor = open_pcd(false, viewpoint);
  for (Eigen::Isometry3d& T : path_) T.translation() += Eigen::Vector3d(900, -700, 20);
  for (Eigen::Vector3f& p : world_) p += Eigen::Vector3f(900, -700, 20);
  const Drive drive = open_pcd(true, viewpoint);
  ASSERT_TRUE(drive.has_poses());
  EXPECT_TRUE(drive.contents().points_from_map);
  EXPECT_THAT(drive.contents().notes, Contains(HasSubstr("points are in the frame of the map")));
  EXPECT_THAT(codes(check_drive(drive)), IsEmpty());
  EXPECT_LT((drive.T_map_lidar(9).matrix() - path_[9].matrix()).norm(), 1e-4);
  EXPECT_LT(drive.read(9).cloud.positions[5].norm(), 46.0F);
}

TEST_F(DriveChecks, ViewpointsOfOtherScansAreNoPoses) {
  const DriveCheck found = check_pcd(false, [](const Eigen::Isometry3d& T) {
    return viewpoint(Eigen::Isometry3d(Eigen::Translation3d(0, 0, T.translation().x() * 40.0)));
  });
  EXPECT_THAT(codes(found), ElementsAre("viewpoints_not_applied"));
  EXPECT_THAT(what(found, "viewpoints_not_applied"), HasSubstr("not taken as poses"));
}

TEST_F(DriveChecks, OneViewpointForAllIsSaid) {
  const DriveCheck found = check_pcd(false, [](const auto&) { return "0 0 1.8 1 0 0 0"; });
  EXPECT_THAT(codes(found), ElementsAre("viewpoints_not_applied"));
}

TEST_F(DriveChecks, WithoutPosesOrWithFewScansLessIsSaid) {
  write();
  Drive::Contents contents;
  contents.layout = DriveLayout::kKittiOdometry;
  contents.scan_files = {names_[0]};
  contents.stamps_ns = {0};
  const DriveCheck one = check_drive(Drive(contents));
  EXPECT_THAT(codes(one), ElementsAre("no_poses"));
  EXPECT_FALSE(one.overlap);
  EXPECT_FALSE(one.periods);
  EXPECT_EQ(one.scans_read, 1U);
  EXPECT_TRUE(one.mounting);
}

}  // namespace drive_check_test
}  // namespace stillmap::maps
