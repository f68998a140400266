// Simplemaps as MRPT reads them.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <mrpt/maps/CPointsMapXYZI.h>
#include <mrpt/maps/CSimpleMap.h>
#include <mrpt/obs/CObservationPointCloud.h>
#include <mrpt/obs/CSensoryFrame.h>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/map_export.hpp>

#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <memory>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

#include "rawlogs/rawlog_process.hpp"
#include "rawlogs/rawlog_record.hpp"
#include "simplemap.hpp"
#include "support/exported_map.hpp"
#include "support/package_steps.hpp"
#include "support/temporary_folder.hpp"
#include "support/throws.hpp"
#include "times.hpp"

namespace stillmap::maps {
namespace simplemap_test {

namespace fs = std::filesystem;
using test::SmallMap;
using test::ThrowsSaying;
using ::testing::ElementsAre;
using ::testing::UnorderedElementsAre;
using enum PointKind;

constexpr std::int64_t kStart = 1'600'000'000'000'000'000;

StampedPose pose_at(double x, std::int64_t stamp_ns) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.translation() = Eigen::Vector3d(x, 0.25, 111.0);
  T.linear() = Eigen::AngleAxisd(0.3 * x, Eigen::Vector3d(1, 2, 3).normalized()).toRotationMatrix();
  return {stamp_ns, T};
}

/// Four tiles along two drives, the poses of the second beyond those of the first; nobody is near
/// to the pose at 30 m.
SmallMap street() {
  SmallMap map;
  map.origin = {7.5, -3.25, 110.0};
  map.points = {{{0.1F, 0.2F, 0.3F}, 0.25F, kMeasured},
                {{5.0F, -0.7F, 1.5F}, 0.5F, kGround},
                {{61.0F, 3.0F, -2.25F}, 0.75F, kProjected},
                {{62.0F, 3.5F, -2.5F}, 1.0F, kFilled},
                {{200.0F, 4.0F, 2.0F}, 0.125F, kMeasured}};
  map.trajectories = {
      Trajectory({pose_at(8.0, kStart), pose_at(30.0, kStart + 100), pose_at(70.0, kStart + 200)}),
      Trajectory({pose_at(205.0, kStart + 300)})};
  return map;
}

class Simplemap : public ::testing::Test {
 protected:
  std::shared_ptr<const MapPackage> package(const SmallMap& map) {
    return test::published(map, folder_.path() / ("map" + std::to_string(maps_++)));
  }
  [[nodiscard]] std::vector<std::string> names() const {
    std::vector<std::string> all;
    for (const auto& entry : fs::directory_iterator(folder_.path()))
      all.push_back(entry.path().filename().string());
    return all;
  }
  [[nodiscard]] fs::path out(const std::string& name) const { return folder_.path() / name; }

  static mrpt::maps::CSimpleMap read(const fs::path& file) {
    mrpt::maps::CSimpleMap map;
    if (!map.loadFromFile(file.string())) throw std::runtime_error("not a simplemap");
    return map;
  }
  /// By MRPT's poses, in the map's frame, from left to right. (`loadFromSimpleMap` would do, but in
  /// MRPT 2.5.8 maps of points forget the keyframe's pose of this kind of observation.)
  static std::vector<Eigen::Vector3d> points_of(mrpt::maps::CSimpleMap map) {
    std::vector<Eigen::Vector3d> points;
    for (std::size_t i = 0; i < map.size(); ++i) {
      mrpt::poses::CPose3DPDF::Ptr pdf;
      mrpt::obs::CSensoryFrame::Ptr frame;
      map.get(i, pdf, frame);
      for (const auto& each : *frame) {
        const auto& observation = dynamic_cast<const mrpt::obs::CObservationPointCloud&>(*each);
        const mrpt::poses::CPose3D T = pdf->getMeanVal() + observation.sensorPose;
        for (std::size_t k = 0; k < observation.pointcloud->size(); ++k) {
          mrpt::math::TPoint3D p;
          observation.pointcloud->getPoint(k, p);
          const mrpt::math::TPoint3D q = T.composePoint(p);
          points.emplace_back(q.x, q.y, q.z);
        }
      }
    }
    std::sort(points.begin(), points.end(),
              [](const auto& a, const auto& b) { return a.x() < b.x(); });
    return points;
  }
  static void expect_points(const std::vector<Eigen::Vector3d>& found, const SmallMap& map,
                            const Eigen::Vector3d& origin) {
    ASSERT_EQ(found.size(), map.points.size());
    for (std::size_t i = 0; i < found.size(); ++i)
      for (int axis = 0; axis < 3; ++axis)
        EXPECT_NEAR(found[i][axis] - origin[axis], map.points[i].p[axis], test::kOffByStepsM + 2e-5)
            << i;
  }

  test::TemporaryFolder folder_{test::memory_folder()};
  int maps_ = 0;
};

TEST_F(Simplemap, IsTheMapAgainInMrpt) {
  const SmallMap map = street();
  const MapExportResult report = export_map(*package(map), "simplemap", out("a.simplemap"));
  EXPECT_EQ(report.points, 5U);
  EXPECT_EQ(report.counts.at("keyframes"), 3U);
  EXPECT_EQ(report.files, 1U);
  mrpt::maps::CSimpleMap read_back = read(out("a.simplemap"));
  expect_points(points_of(read_back), map, map.origin);
}

TEST_F(Simplemap, HasTheDrivesPosesAndStamps) {
  const SmallMap map = street();
  export_map(*package(map), "simplemap", out("a.simplemap"));
  mrpt::maps::CSimpleMap read_back = read(out("a.simplemap"));
  ASSERT_EQ(read_back.size(), 3U);
  const std::vector<StampedPose> truth = {map.trajectories[0].poses()[0],
                                          map.trajectories[0].poses()[2],
                                          map.trajectories[1].poses()[0]};
  for (std::size_t i = 0; i < truth.size(); ++i) {
    mrpt::poses::CPose3DPDF::Ptr pdf;
    mrpt::obs::CSensoryFrame::Ptr frame;
    read_back.get(i, pdf, frame);
    const mrpt::poses::CPose3D T = pdf->getMeanVal();
    for (int row = 0; row < 3; ++row) {
      EXPECT_NEAR(T.m_coords[row], truth[i].T_map_lidar.translation()[row], 1e-12);
      for (int column = 0; column < 3; ++column)
        EXPECT_NEAR(T.getRotationMatrix()(row, column), truth[i].T_map_lidar.linear()(row, column),
                    1e-12);
    }
    ASSERT_EQ(frame->size(), 1U);
    const auto cloud = frame->getObservationByClass<mrpt::obs::CObservationPointCloud>();
    ASSERT_TRUE(cloud);
    EXPECT_EQ(rawlog::stamp_ns_of(cloud->timestamp), truth[i].stamp_ns);
    EXPECT_EQ(cloud->sensorLabel, "stillmap");
  }
}

TEST_F(Simplemap, KeepsIntensities) {
  export_map(*package(street()), "simplemap", out("a.simplemap"));
  mrpt::poses::CPose3DPDF::Ptr pdf;
  mrpt::obs::CSensoryFrame::Ptr frame;
  mrpt::maps::CSimpleMap read_back = read(out("a.simplemap"));
  read_back.get(2, pdf, frame);
  const auto observation = frame->getObservationByClass<mrpt::obs::CObservationPointCloud>();
  const auto cloud = std::dynamic_pointer_cast<mrpt::maps::CPointsMapXYZI>(observation->pointcloud);
  ASSERT_TRUE(cloud);
  EXPECT_THAT(cloud->getPointsBufferRef_intensity(), ElementsAre(0.125F));
}

TEST_F(Simplemap, LeavesOutKindsAndWhatThenIsEmpty) {
  const MapExportResult report = export_map(*package(street()), "simplemap", out("a.simplemap"),
                                            {.without = {kProjected, kFilled}});
  EXPECT_EQ(report.points, 3U);
  EXPECT_EQ(report.counts.at("keyframes"), 2U);
  EXPECT_EQ(points_of(read(out("a.simplemap"))).size(), 3U);
}

TEST_F(Simplemap, InLocalCoordinatesIsLessTheOrigin) {
  const SmallMap map = street();
  const MapExportResult report =
      export_map(*package(map), "simplemap", out("a.simplemap"), {.frame = ExportFrame::kLocal});
  EXPECT_EQ(report.origin, map.origin);
  expect_points(points_of(read(out("a.simplemap"))), map, Eigen::Vector3d::Zero());
}

TEST_F(Simplemap, OfTheSameMapHasTheSameBytes) {
  const auto map = package(street());
  std::vector<std::string> bytes;
  for (const char* name : {"a.simplemap", "b.simplemap"}) {
    export_map(*map, "simplemap", out(name));
    std::ifstream stream(out(name), std::ios::binary);
    bytes.emplace_back(std::istreambuf_iterator<char>(stream), std::istreambuf_iterator<char>());
  }
  EXPECT_FALSE(bytes[0].empty());
  EXPECT_EQ(bytes[0], bytes[1]);
}

TEST_F(Simplemap, NeedsATrajectory) {
  SmallMap map = street();
  map.trajectories.clear();
  const auto imported = package(map);
  EXPECT_THAT([&] { export_map(*imported, "simplemap", out("a.simplemap")); },
              ThrowsSaying<InputError>({"no trajectory"}));
  map.trajectories = {Trajectory{}};
  const auto standing = package(map);
  EXPECT_THAT([&] { export_map(*standing, "simplemap", out("a.simplemap")); },
              ThrowsSaying<InputError>({"no trajectory"}));
  EXPECT_THAT(names(), UnorderedElementsAre("map0", "map1"));
  map.trajectories.push_back(street().trajectories[0]);
  EXPECT_EQ(export_map(*package(map), "simplemap", out("a.simplemap")).counts.at("keyframes"), 2U);
}

TEST_F(Simplemap, ThatIsCancelledLeavesNothing) {
  const auto map = package(street());
  MapExportOptions options;
  double last = 0.0;
  options.work.go_on = [&](double share) {
    last = share;
    return share <= 0.6;
  };
  EXPECT_THROW(export_map(*map, "simplemap", out("a.simplemap"), options), WorkStopped);
  EXPECT_GT(last, 0.6) << "the writer was not asked";
  EXPECT_THAT(names(), ElementsAre("map0"));
}

using File = std::unique_ptr<std::FILE, int (*)(std::FILE*)>;

/// A keyframe of points that do not pack well, and the end.
File records(std::size_t points) {
  File file(std::tmpfile(), std::fclose);
  RawlogRecord record;
  record.kind = RawlogRecordKind::kKeyframe;
  record.pose = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
  record.points = static_cast<std::uint32_t>(points);
  std::fwrite(&record, sizeof record, 1, file.get());
  std::mt19937 random(1);
  std::uniform_real_distribution<float> any(-50.0F, 50.0F);
  for (std::size_t i = 0; i < points; ++i) {
    const RawlogPoint point{any(random), any(random), any(random), 0.0F, 0.0F};
    std::fwrite(&point, sizeof point, 1, file.get());
  }
  const RawlogRecord end;
  std::fwrite(&end, sizeof end, 1, file.get());
  std::rewind(file.get());
  return file;
}

TEST_F(Simplemap, ThatTheDiskDoesNotTakeIsSaidInALine) {
  // The small one fails only at its end.
  for (const std::size_t points : {1U, 100'000U}) {
    try {
      rawlog::write_simplemap(records(points).get(), "/dev/full");
      FAIL() << points;
    } catch (const std::runtime_error& error) {
      EXPECT_STREQ(error.what(), "No space left on device") << points;
    }
  }
  EXPECT_THAT([&] { rawlog::write_simplemap(records(1).get(), out("no/such.simplemap").string()); },
              ThrowsSaying<std::runtime_error>({"No such file or directory"}));
}

TEST_F(Simplemap, TellsOfItsWritersTrouble) {
  UnnamedFile none;
  const std::string target = out("a.simplemap").string();
  EXPECT_THAT([&] { (void)write_simplemap(rawlog_program(), none, target, [] { return true; }); },
              ThrowsSaying<StorageError>({target, "the records of its keyframes break off"}));
}

TEST_F(Simplemap, OfRecordsThatBreakOffIsRefused) {
  constexpr long kWhole = 2 * sizeof(RawlogRecord) + 2 * sizeof(RawlogPoint);
  const std::string target = out("a.simplemap").string();
  for (long cut = 0; cut < kWhole; ++cut) {
    const File file = records(2);
    ASSERT_EQ(::ftruncate(::fileno(file.get()), cut), 0);
    EXPECT_THAT([&] { rawlog::write_simplemap(file.get(), target); },
                ThrowsSaying<std::runtime_error>({"break off"}))
        << cut;
  }
  EXPECT_NO_THROW(rawlog::write_simplemap(records(2).get(), target));
}

}  // namespace simplemap_test
}  // namespace stillmap::maps
