#include <stillmap/maps/box.hpp>
#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/error.hpp>
#include <stillmap/simulation/simulate.hpp>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <fstream>
#include <iterator>
#include <map>
#include <stdexcept>
#include <string>

#include "support/temporary_folder.hpp"

namespace stillmap::simulation {
namespace simulate_test {

constexpr std::size_t kScans = 3;

SimulationOptions small_drive(const std::string& sensor = "vlp16") {
  SimulationOptions options;
  options.sensor = sensor;
  options.scans = kScans;
  return options;
}

std::filesystem::path simulate(const test::TemporaryFolder& folder, const std::string& name,
                               const SimulationOptions& options) {
  const mapping::CancelFlag cancel{false};
  simulate_drive(folder.path() / name, options, {}, cancel);
  return folder.path() / name;
}

/// Every file of a drive by its relative name.
std::map<std::string, std::string> bytes_of(const std::filesystem::path& drive) {
  std::map<std::string, std::string> files;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(drive)) {
    if (!entry.is_regular_file()) continue;
    std::ifstream stream(entry.path(), std::ios::binary);
    files[entry.path().lexically_relative(drive).string()] =
        std::string(std::istreambuf_iterator<char>(stream), {});
  }
  return files;
}

TEST(Simulation, GivesTheSameBytesForAnyNumberOfThreads) {
  const test::TemporaryFolder folder;
  SimulationOptions one = small_drive();
  one.threads = 1;
  SimulationOptions two = small_drive();
  two.threads = 2;
  const auto first = bytes_of(simulate(folder, "one", one));
  EXPECT_EQ(first, bytes_of(simulate(folder, "two", two)));
  EXPECT_GT(first.size(), 3 + 2 * kScans);
}

TEST(Simulation, PartsOfADriveAreTheSameAsTheWhole) {
  const test::TemporaryFolder folder;
  for (const std::string scenario : {"town", "city"}) {
    SimulationOptions options = small_drive();
    options.scenario = scenario;
    options.scans = 12;
    const auto whole = bytes_of(simulate(folder, scenario, options));
    options.of = options.scans;
    std::map<std::string, std::string> joined;
    for (const std::size_t first : {0U, 5U}) {
      options.first = first;
      options.scans = first == 0 ? 5 : 7;
      const auto part = bytes_of(simulate(folder, fmt::format("{}_{}", scenario, first), options));
      for (std::size_t i = 0; i < options.scans; ++i) {
        for (const std::string name : {"velodyne/{:06}.bin", "labels/{:06}.label"}) {
          EXPECT_TRUE(part.at(fmt::format(fmt::runtime(name), i)) ==
                      whole.at(fmt::format(fmt::runtime(name), first + i)))
              << scenario << " from " << first << " scan " << i;
        }
      }
      for (const std::string name : {"poses.txt", "times.txt"}) joined[name] += part.at(name);
    }
    EXPECT_EQ(joined.at("poses.txt"), whole.at("poses.txt"));
    EXPECT_EQ(joined.at("times.txt"), whole.at("times.txt"));
  }
}

TEST(Simulation, WritesEveryFewScansOne) {
  const test::TemporaryFolder folder;
  SimulationOptions options = small_drive();
  options.scans = 7;
  const auto whole = bytes_of(simulate(folder, "whole", options));
  options.every = 3;
  const auto some = bytes_of(simulate(folder, "some", options));
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_TRUE(some.at(fmt::format("velodyne/{:06}.bin", i)) ==
                whole.at(fmt::format("velodyne/{:06}.bin", 3 * i)));
  }
  EXPECT_FALSE(some.contains("velodyne/000003.bin"));
  std::istringstream stamps(whole.at("times.txt")), kept(some.at("times.txt"));
  std::string stamp, line;
  for (std::size_t i = 0; std::getline(stamps, stamp); ++i) {
    if (i % 3 != 0) continue;
    ASSERT_TRUE(std::getline(kept, line));
    EXPECT_EQ(line, stamp) << i;
  }
  EXPECT_FALSE(std::getline(kept, line));
}

TEST(Simulation, OnlyTheCityHasDrivesOfMoreThanTenThousandScans) {
  SimulationOptions options = small_drive();
  options.scans = 10'001;
  EXPECT_THAT(options.violations(), testing::ElementsAre(testing::HasSubstr("1 to 10000 (")));
  options.scenario = "city";
  EXPECT_THAT(options.violations(), testing::IsEmpty());
  options.scans = 100'000;
  EXPECT_THAT(options.violations(), testing::IsEmpty());
  options.first = 1;
  EXPECT_THAT(options.violations(), testing::ElementsAre(testing::HasSubstr("of 100000 scans")));
  options.scans = 99'999;
  EXPECT_THAT(options.violations(), testing::IsEmpty());
  options.of = 99'999;
  EXPECT_THAT(options.violations(), testing::ElementsAre(testing::HasSubstr("of 99999 scans")));
  options.first = 0;
  options.of = 99'998;
  EXPECT_THAT(options.violations(), testing::ElementsAre(testing::HasSubstr("of 99998 scans")));
  options.of = 100'001;
  EXPECT_THAT(options.violations(), testing::ElementsAre(testing::HasSubstr("at most 100000")));
}

TEST(Simulation, AnotherSeedIsAnotherWorldAndAnotherDayOnlyOtherTraffic) {
  const test::TemporaryFolder folder;
  SimulationOptions seed = small_drive();
  seed.seed = 2;
  SimulationOptions day = small_drive();
  day.day = 2;
  const auto here = bytes_of(simulate(folder, "here", small_drive()));
  const auto elsewhere = bytes_of(simulate(folder, "elsewhere", seed));
  const auto tomorrow = bytes_of(simulate(folder, "tomorrow", day));
  EXPECT_NE(here.at("velodyne/000000.bin"), elsewhere.at("velodyne/000000.bin"));
  EXPECT_NE(here.at("boxes.json"), tomorrow.at("boxes.json"));
}

TEST(Simulation, NearlyEveryPointOfWhatStandsLiesInItsTrueBox) {
  const test::TemporaryFolder folder;
  const auto path = simulate(folder, "drive", small_drive("os1-64"));
  const maps::Drive drive = maps::Drive::open(path);
  const maps::BoxSequence boxes = maps::read_boxes(path / "boxes.json", drive.size());
  std::size_t parked = 0;
  std::size_t inside = 0;
  for (std::size_t scan = 0; scan < drive.size(); ++scan) {
    const maps::PointCloud cloud = drive.read(scan).cloud;
    const std::vector<std::uint32_t> labels = drive.read_labels(scan);
    ASSERT_EQ(labels.size(), cloud.size());
    for (std::size_t i = 0; i < cloud.size(); ++i) {
      if ((labels[i] & 0xFFFFU) != 10) continue;
      const auto track = static_cast<int>(labels[i] >> 16U);
      const auto& in_scan = boxes.by_scan.at(scan);
      const auto box = std::find_if(in_scan.begin(), in_scan.end(),
                                    [&](const maps::Box& b) { return b.track == track; });
      ASSERT_NE(box, in_scan.end()) << "no box for instance " << track;
      ++parked;
      // Four deviations of the range noise. Beams on an edge lie between two things.
      if (box->contains(cloud.positions[i].cast<double>(), 0.08)) ++inside;
    }
  }
  EXPECT_GT(parked, 1000U);
  EXPECT_GT(static_cast<double>(inside), 0.97 * static_cast<double>(parked));
}

/// Mean height of road points in a square of the map, from one scan.
double road_height(const maps::Drive& drive, std::size_t scan, const Eigen::Vector2d& centre_map) {
  const maps::PointCloud cloud = drive.read(scan).cloud;
  const std::vector<std::uint32_t> labels = drive.read_labels(scan);
  double sum = 0.0;
  int count = 0;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const Eigen::Vector3d p = drive.T_map_lidar(scan) * cloud.positions[i].cast<double>();
    if ((labels[i] & 0xFFFFU) != 40 || (p.head<2>() - centre_map).cwiseAbs().maxCoeff() > 1.0)
      continue;
    sum += p.z();
    ++count;
  }
  EXPECT_GT(count, 20);
  return sum / count;
}

TEST(Simulation, ThePosesLayTheRoadOfAllScansOntoEachOther) {
  const test::TemporaryFolder folder;
  SimulationOptions options = small_drive("os1-128");
  options.scans = 6;
  const maps::Drive drive = maps::Drive::open(simulate(folder, "drive", options));
  const Eigen::Vector2d ahead = (drive.T_map_lidar(0) * Eigen::Vector3d(14.0, 0.0, 0.0)).head<2>();
  EXPECT_NEAR(road_height(drive, 0, ahead), road_height(drive, 5, ahead), 0.01);
}

TEST(Simulation, TheSensorStandsAtItsHeightOverTheRoad) {
  const test::TemporaryFolder folder;
  const maps::Drive drive = maps::Drive::open(simulate(folder, "drive", small_drive("hdl64")));
  const maps::PointCloud cloud = drive.read(0).cloud;
  const std::vector<std::uint32_t> labels = drive.read_labels(0);
  double nearest = 1e9, height = 0.0;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const double range = static_cast<double>(cloud.positions[i].head<2>().norm());
    if ((labels[i] & 0xFFFFU) != 40 || range > nearest) continue;
    nearest = range;
    height = -static_cast<double>(cloud.positions[i].z());
  }
  // Crown, slope and noise stay within 15 cm so near to the vehicle.
  EXPECT_NEAR(height, 1.73, 0.15);
}

TEST(Simulation, AStandingVehicleHasOnePoseAndTrafficPassesIt) {
  const test::TemporaryFolder folder;
  SimulationOptions options = small_drive();
  options.standing = true;
  const auto drive = maps::Drive::open(simulate(folder, "standing", options));
  for (std::size_t i = 1; i < drive.size(); ++i)
    EXPECT_EQ(drive.T_map_lidar(i).matrix(), drive.T_map_lidar(0).matrix());
  const mapping::CancelFlag cancel{false};
  const SimulationResult report = simulate_drive(folder.path() / "again", options, {}, cancel);
  EXPECT_EQ(report.distance_m, 0.0);
  EXPECT_GT(report.moving, 0U);
  EXPECT_GT(report.parked, 0U);
}

TEST(Simulation, DrivesThatDifferInTheMountAreOfOneVehicle) {
  const test::TemporaryFolder folder;
  SimulationOptions options = small_drive();
  options.layout = "pcd";
  const auto usual = maps::Drive::open(simulate(folder, "usual", options));
  options.mount = {-1.5, 0.3, -0.1, 0.0, 0.0, 90.0};
  const auto mounted = maps::Drive::open(simulate(folder, "mounted", options));
  for (std::size_t i = 0; i < kScans; ++i) {
    const Eigen::Isometry3d T = usual.T_map_lidar(i).inverse() * mounted.T_map_lidar(i);
    EXPECT_TRUE(T.translation().isApprox(Eigen::Vector3d(-1.5, 0.3, -0.1), 1e-5));
    EXPECT_TRUE((T.linear() * Eigen::Vector3d::UnitX()).isApprox(Eigen::Vector3d::UnitY(), 1e-5));
  }
  options.phase_s = 0.03;
  const auto late = maps::Drive::open(simulate(folder, "late", options));
  EXPECT_EQ(late.stamp_ns(1) - mounted.stamp_ns(1), 30'000'000);
}

TEST(Simulation, NamesEveryBrokenOption) {
  const test::TemporaryFolder folder;
  const auto message = [&](auto change) {
    SimulationOptions options = small_drive();
    change(options);
    try {
      simulate(folder, "bad", options);
    } catch (const std::invalid_argument& error) {
      return std::string(error.what());
    }
    return std::string("accepted");
  };
  EXPECT_THAT(message([](auto& o) { o.scans = 0; }), testing::HasSubstr("scans"));
  EXPECT_THAT(message([](auto& o) { o.sensor = "hdl128"; }), testing::HasSubstr("hdl128"));
  EXPECT_THAT(message([](auto& o) { o.scenario = "moon"; }), testing::HasSubstr("town"));
  EXPECT_THAT(message([](auto& o) { o.layout = "las"; }), testing::HasSubstr("kitti-raw"));
  EXPECT_THAT(message([](auto& o) { o.mount[0] = 1.0; }), testing::HasSubstr("layout pcd"));
  EXPECT_THAT(message([](auto& o) { o.mount[4] = 200.0; }), testing::HasSubstr("within 180"));
  EXPECT_THAT(message([](auto& o) { o.phase_s = -0.1; }), testing::HasSubstr("phase_s"));
  const auto part = [](auto& o) { o.first = 1, o.layout = "kitti-raw"; };
  EXPECT_THAT(message(part), testing::HasSubstr("kitti-odometry or pcd"));
  const auto thinned = [](auto& o) { o.every = 2, o.layout = "kitti-raw"; };
  EXPECT_THAT(message(thinned), testing::HasSubstr("every: found with layout kitti-raw"));
  EXPECT_THAT(message([](auto& o) { o.every = 0; }), testing::HasSubstr("every"));
  const auto walk = [](auto& o) { o.scenario = "city", o.carrier = "hand"; };
  EXPECT_THAT(message(walk), testing::HasSubstr("found hand in scenario city"));
  EXPECT_FALSE(std::filesystem::exists(folder.path() / "bad"));
}

TEST(Simulation, LeavesNothingWhenCancelledOrRefused) {
  const test::TemporaryFolder folder;
  const mapping::CancelFlag cancel{true};
  EXPECT_THROW(simulate_drive(folder.path() / "drive", small_drive(), {}, cancel),
               mapping::Cancelled);
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
  std::filesystem::create_directory(folder.path() / "there");
  EXPECT_THROW(simulate(folder, "there", small_drive()), maps::InputError);
  EXPECT_THROW(simulate(folder, "no/such/parent", small_drive()), maps::StorageError);
}

}  // namespace simulate_test
}  // namespace stillmap::simulation
