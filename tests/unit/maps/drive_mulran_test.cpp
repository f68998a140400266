#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/frames.hpp>

#include <cmath>
#include <numbers>
#include <string>

#include "support/temporary_folder.hpp"

namespace stillmap::maps {
namespace drive_mulran_test {

using test::TemporaryFolder;
using ::testing::AllOf;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::ThrowsMessage;

constexpr double kDegree = std::numbers::pi / 180.0;
constexpr std::int64_t kStart = 1561000444390857630;
constexpr std::int64_t kTenthNs = 100'000'000;

std::string scan_bytes(std::size_t points) {
  std::string bytes;
  for (std::size_t i = 0; i < points; ++i)
    for (const float value : {i % 3 == 0 ? 0.0F : 1.0F + 0.01F * static_cast<float>(i % 64), 0.0F,
                              0.0F, static_cast<float>(i % 100)})
      bytes.append(reinterpret_cast<const char*>(&value), sizeof value);
  return bytes;
}

std::string pose_line(std::int64_t stamp_ns, double x, double y, double z, double yaw_rad = 0.0) {
  const double c = std::cos(yaw_rad), s = std::sin(yaw_rad);
  return fmt::format("{},{:.15g},{:.15g},0,{:.10f},{:.15g},{:.15g},0,{:.10f},0,0,1,{:.10f}\n",
                     stamp_ns, c, -s, x, s, c, y, z);
}

/// What MulRan's calibration page says of its Ouster.
Eigen::Isometry3d T_base_lidar() {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = (Eigen::AngleAxisd(179.6654 * kDegree, Eigen::Vector3d::UnitZ()) *
                Eigen::AngleAxisd(0.0003 * kDegree, Eigen::Vector3d::UnitY()) *
                Eigen::AngleAxisd(0.0001 * kDegree, Eigen::Vector3d::UnitX()))
                   .toRotationMatrix();
  T.translation() = Eigen::Vector3d(1.7042, -0.021, 1.8047);
  return T;
}

class MulranDrive : public ::testing::Test {
 protected:
  MulranDrive() {
    for (int i = 0; i < 3; ++i) write_scan(kStart + i * kTenthNs);
  }
  void write_scan(std::int64_t stamp_ns, std::size_t points = 5) {
    folder_.write("Ouster/" + std::to_string(stamp_ns) + ".bin", scan_bytes(points));
  }
  /// The vehicle's poses, 40 ms before each scan and 60 ms after it.
  void write_poses(double x, double y, double z, double step_m) {
    std::string text;
    for (int i = 0; i < 4; ++i)
      text += pose_line(kStart + i * kTenthNs - 40'000'000, x, y + i * step_m, z);
    folder_.write("global_pose.csv", text);
  }
  [[nodiscard]] Drive open() const { return Drive::open(folder_.path()); }
  /// The vehicle in the map.
  [[nodiscard]] static Eigen::Isometry3d T_map_base(const Drive& drive, std::size_t scan) {
    return drive.T_map_lidar(scan) * T_base_lidar().inverse();
  }

  TemporaryFolder folder_;
};

TEST_F(MulranDrive, IsRecognizedWithStampsOfNamesAndPosesBetweenThem) {
  write_poses(20.0, 100.0, 5.0, 2.0);
  const Drive drive = open();
  EXPECT_EQ(name_of(drive.contents().layout), "mulran");
  EXPECT_FALSE(drive.relative_clock());
  EXPECT_THAT(drive.contents().stamps_ns,
              ElementsAre(kStart, kStart + kTenthNs, kStart + 2 * kTenthNs));
  // Local metres stay as they are; 40 of 100 ms on.
  for (std::size_t i = 0; i < 3; ++i) {
    const Eigen::Isometry3d T = T_map_base(drive, i);
    EXPECT_TRUE(T.translation().isApprox(
        Eigen::Vector3d(20.0, 100.8 + 2.0 * static_cast<double>(i), 5.0), 1e-12));
    EXPECT_LT(rotation_angle_rad(T.linear()), 1e-9);
  }
  EXPECT_FALSE(drive.contents().origin);
  EXPECT_THAT(drive.contents().notes, ElementsAre(HasSubstr("not in UTM zone 52N")));
}

TEST_F(MulranDrive, UtmBecomesALocalFrameThatKnowsItsPlace) {
  // On the central meridian of the zone grid north is north, and lengths are 0.9996 of true ones.
  write_poses(500'000.0, 4'000'000.0, 60.0, 10.0);
  const Drive drive = open();
  ASSERT_TRUE(drive.contents().origin);
  EXPECT_NEAR(drive.contents().origin->longitude_deg, 129.0, 1e-12);
  EXPECT_NEAR(drive.contents().origin->altitude_m, 60.0, 1e-9);
  EXPECT_THAT(drive.contents().notes, IsEmpty());
  const Eigen::Vector3d step =
      T_map_base(drive, 1).translation() - T_map_base(drive, 0).translation();
  EXPECT_NEAR(step.y(), 10.0 / 0.9996, 1e-4);
  EXPECT_NEAR(step.x(), 0.0, 1e-6);
  EXPECT_LT(T_map_base(drive, 0).translation().norm(), 10.0);
}

TEST_F(MulranDrive, PosesAreTurnedFromGridNorthToNorth) {
  write_poses(353'000.0, 4'026'586.0, 60.0, 10.0);
  const Drive drive = open();
  ASSERT_TRUE(drive.contents().origin);
  // Convergence of the meridians: atan(tan(longitude from the central one) sin(latitude)).
  const double convergence =
      std::atan(std::tan((drive.contents().origin->longitude_deg - 129.0) * kDegree) *
                std::sin(drive.contents().origin->latitude_deg * kDegree));
  ASSERT_LT(convergence, -0.9 * kDegree);
  const Eigen::Isometry3d T = T_map_base(drive, 1);
  const double yaw = std::atan2(T.linear()(1, 0), T.linear()(0, 0));
  // Grid north lies west of north here: a vehicle along the grid's x is turned to the left.
  EXPECT_NEAR(yaw, -convergence, 1e-4 * kDegree);
  const Eigen::Vector3d step = T.translation() - T_map_base(drive, 0).translation();
  EXPECT_NEAR(std::atan2(-step.x(), step.y()), -convergence, 1e-4 * kDegree);
}

TEST_F(MulranDrive, AsTheFilePlayerWantsItIsTheSame) {
  write_poses(500'000.0, 4'000'000.0, 60.0, 10.0);
  const Drive downloaded = open();
  std::filesystem::create_directories(folder_.path() / "sensor_data");
  std::filesystem::rename(folder_.path() / "Ouster", folder_.path() / "sensor_data/Ouster");
  const Drive ordered = open();
  EXPECT_EQ(name_of(ordered.contents().layout), "mulran");
  EXPECT_EQ(ordered.T_map_lidar(2).matrix(), downloaded.T_map_lidar(2).matrix());
}

TEST_F(MulranDrive, ScansWithoutPoseAtTheEndsAreLeftOutAndSaid) {
  write_scan(kStart + 10 * kTenthNs);
  write_poses(20.0, 100.0, 5.0, 2.0);
  const Drive drive = open();
  EXPECT_EQ(drive.size(), 3U);
  EXPECT_THAT(drive.contents().notes, Contains(HasSubstr("1 scans left out")));
}

TEST_F(MulranDrive, ScansOfTheListThatAreMissingAreSaid) {
  write_poses(20.0, 100.0, 5.0, 2.0);
  folder_.write("sensor_data/ouster_front_stamp.csv",
                fmt::format("{}\n{}\n{}\n", kStart, kStart + kTenthNs / 2, kStart + kTenthNs));
  EXPECT_THAT(open().contents().notes,
              Contains(HasSubstr("1 scans of ouster_front_stamp.csv missing")));
}

TEST_F(MulranDrive, WithoutPosesIsADriveWithoutThem) {
  folder_.write("ouster_front_stamp.csv", std::to_string(kStart) + "\n");
  const Drive drive = open();
  EXPECT_EQ(name_of(drive.contents().layout), "mulran");
  EXPECT_FALSE(drive.has_poses());
  EXPECT_THAT(drive.contents().notes, Contains(HasSubstr("no global_pose.csv")));
}

TEST_F(MulranDrive, GivenPosesAreOfTheLidar) {
  write_poses(20.0, 100.0, 5.0, 2.0);
  const auto given =
      folder_.write("given.tum", "1561000444 0 0 0 0 0 0 1\n1561000445 10 0 0 0 0 0 1\n");
  EXPECT_NEAR(Drive::open(folder_.path(), given).T_map_lidar(0).translation().x(), 3.90857630,
              1e-7);
}

TEST_F(MulranDrive, ShotsOfAWholeTurnHaveTheTimesOfTheirColumns) {
  write_poses(20.0, 100.0, 5.0, 2.0);
  write_scan(kStart, 64 * 1024);
  const Drive drive = open();
  const Scan whole = drive.read(0);
  ASSERT_EQ(whole.points_in_file, 64U * 1024U);
  ASSERT_EQ(whole.cloud.time_offsets_s.size(), whole.cloud.size());
  // Every third shot has no return; those that have keep the time of their place in the file.
  EXPECT_EQ(whole.cloud.file_index(0), 1U);
  EXPECT_EQ(whole.cloud.time_offsets_s[0], -0.05F);
  for (std::size_t i = 0; i < whole.cloud.size(); ++i) {
    const auto column = static_cast<double>(whole.cloud.file_index(i) / 64);
    ASSERT_NEAR(whole.cloud.time_offsets_s[i], -0.05 + 0.1 * column / 1024.0, 1e-8);
  }
  EXPECT_THAT(drive.read(1).cloud.time_offsets_s, IsEmpty());
}

TEST_F(MulranDrive, WhatIsBrokenIsNamed) {
  const auto expect_error = [&](const std::string& where, const std::string& what) {
    EXPECT_THAT([&] { (void)open(); },
                ThrowsMessage<InputError>(AllOf(HasSubstr(where), HasSubstr(what))));
  };
  folder_.write("global_pose.csv", "1561000444390857630,1,2,3\n");
  expect_error("global_pose.csv line 1", "");
  folder_.write("global_pose.csv", "1.5,1,0,0,0,0,1,0,0,0,0,1,0\n");
  expect_error("global_pose.csv line 1", "'1.5'");
  folder_.write("global_pose.csv", "");
  expect_error("global_pose.csv", "no poses");
  folder_.write("global_pose.csv", pose_line(1, 0, 0, 0) + pose_line(2, 0, 0, 0));
  expect_error("global_pose.csv", "no pose within 0.2 s");
  folder_.write("Ouster/front.bin", scan_bytes(1));
  expect_error("front.bin", "nanoseconds");
}

}  // namespace drive_mulran_test
}  // namespace stillmap::maps
