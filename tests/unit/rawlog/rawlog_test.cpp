// Rawlogs as MRPT writes them, read through the process that reads them for us.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <mrpt/io/CFileGZOutputStream.h>
#include <mrpt/io/CFileOutputStream.h>
#include <mrpt/maps/CPointsMapXYZI.h>
#include <mrpt/maps/CSimplePointsMap.h>
#include <mrpt/obs/CActionCollection.h>
#include <mrpt/obs/CActionRobotMovement2D.h>
#include <mrpt/obs/CObservation3DRangeScan.h>
#include <mrpt/obs/CObservationComment.h>
#include <mrpt/obs/CObservationOdometry.h>
#include <mrpt/obs/CObservationPointCloud.h>
#include <mrpt/obs/CObservationRobotPose.h>
#include <mrpt/obs/CObservationVelodyneScan.h>
#include <mrpt/obs/CSensoryFrame.h>
#include <mrpt/serialization/CArchive.h>
#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/error.hpp>

#include <fcntl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstring>
#include <numbers>

#include "reading.hpp"
#include "support/temporary_folder.hpp"

namespace stillmap::maps {
namespace rawlog_test {

using namespace mrpt::obs;
using mrpt::poses::CPose2D;
using mrpt::poses::CPose3D;
using ::testing::AllOf;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::ThrowsMessage;

constexpr std::int64_t kStart = 1'600'000'000'000'000'000;
constexpr std::int64_t kTenth = 100'000'000;

mrpt::Clock::time_point mrpt_time(std::int64_t stamp_ns) {
  return mrpt::Clock::time_point(mrpt::Clock::duration(stamp_ns / 100 + 116'444'736'000'000'000));
}

class Rawlog : public ::testing::Test {
 protected:
  using Object = mrpt::serialization::CSerializable;

  std::filesystem::path write(const std::vector<Object::Ptr>& objects, bool packed = true) {
    const std::filesystem::path file = folder_.path() / "drive.rawlog";
    if (packed) {
      mrpt::io::CFileGZOutputStream stream(file.string());
      write_to(stream, objects);
    } else {
      mrpt::io::CFileOutputStream stream(file.string());
      write_to(stream, objects);
    }
    return file;
  }
  template <typename Stream>
  static void write_to(Stream& stream, const std::vector<Object::Ptr>& objects) {
    auto archive = mrpt::serialization::archiveFrom(stream);
    for (const Object::Ptr& object : objects) archive << *object;
  }
  template <typename Observation>
  static std::shared_ptr<Observation> at(std::int64_t stamp_ns, const std::string& label) {
    auto observation = std::make_shared<Observation>();
    observation->timestamp = mrpt_time(stamp_ns);
    observation->sensorLabel = label;
    return observation;
  }
  /// Three points, the first coordinate tells the scan.
  static std::shared_ptr<CObservationPointCloud> cloud(int number,
                                                       const std::string& label = "top") {
    auto observation = at<CObservationPointCloud>(kStart + number * kTenth, label);
    auto points = mrpt::maps::CPointsMapXYZI::Create();
    for (int i = 0; i < 3; ++i)
      points->insertPointFast(static_cast<float>(number) + 1.5F, static_cast<float>(i), 0.25F);
    for (int i = 0; i < 3; ++i) points->setPointIntensity(i, 0.125F * static_cast<float>(i));
    observation->pointcloud = points;
    // To the left of the robot, looking there.
    observation->sensorPose = CPose3D(0.0, 2.0, 1.0, std::numbers::pi / 2, 0.0, 0.0);
    return observation;
  }
  static std::shared_ptr<CObservationOdometry> odometry(std::int64_t stamp_ns, double x) {
    auto observation = at<CObservationOdometry>(stamp_ns, "wheels");
    observation->odometry = CPose2D(x, 0.0, 0.0);
    return observation;
  }
  static std::string text_of(const std::filesystem::path& file) {
    std::ifstream stream(file, std::ios::binary);
    return {std::istreambuf_iterator<char>(stream), {}};
  }

  test::TemporaryFolder folder_{test::memory_folder()};
};

TEST_F(Rawlog, OfCloudsIsADriveWithoutPoses) {
  for (const bool packed : {true, false}) {
    const Drive drive = Drive::open(write({cloud(0), cloud(1), cloud(2)}, packed));
    EXPECT_EQ(name_of(drive.contents().layout), "rawlog");
    EXPECT_THAT(drive.contents().stamps_ns,
                ElementsAre(kStart, kStart + kTenth, kStart + 2 * kTenth));
    EXPECT_FALSE(drive.has_poses());
    EXPECT_FALSE(drive.relative_clock());
    EXPECT_THAT(drive.contents().notes, IsEmpty());
    const Scan scan = drive.read(1);
    EXPECT_THAT(scan.cloud.positions,
                ElementsAre(Eigen::Vector3f(2.5F, 0.0F, 0.25F), Eigen::Vector3f(2.5F, 1.0F, 0.25F),
                            Eigen::Vector3f(2.5F, 2.0F, 0.25F)));
    EXPECT_THAT(scan.cloud.intensities, ElementsAre(0.0F, 0.125F, 0.25F));
    EXPECT_THAT(scan.cloud.time_offsets_s, IsEmpty());
    EXPECT_THAT(scan.source, HasSubstr("drive.rawlog top 1"));
    EXPECT_NE(drive.sha256(0), drive.sha256(1));
  }
}

TEST_F(Rawlog, PosesOfOdometryAreBroughtToTheSensorAndTheScansStamps) {
  const Drive drive = Drive::open(
      write({odometry(kStart - 20'000'000, 1.0), cloud(0), odometry(kStart + 80'000'000, 2.0),
             cloud(1), odometry(kStart + 180'000'000, 3.0), cloud(9)}));
  ASSERT_EQ(drive.size(), 2U);
  EXPECT_THAT(drive.contents().notes,
              ElementsAre(HasSubstr("1 scans left out"), HasSubstr("those of odometry")));
  EXPECT_TRUE(drive.T_map_lidar(0).translation().isApprox(Eigen::Vector3d(1.2, 2.0, 1.0), 1e-12));
  EXPECT_TRUE(drive.T_map_lidar(1).translation().isApprox(Eigen::Vector3d(2.2, 2.0, 1.0), 1e-12));
  // The sensor looks to the robot's left.
  EXPECT_TRUE((drive.T_map_lidar(0).linear() * Eigen::Vector3d::UnitX())
                  .isApprox(Eigen::Vector3d::UnitY(), 1e-12));
}

TEST_F(Rawlog, PosesOfAFileAreShiftedInTime) {
  const auto file = write({cloud(0), cloud(1), cloud(2)});
  const auto poses = folder_.write("poses.txt",
                                   "1 0 0 7 0 1 0 0 0 0 1 0\n1 0 0 8 0 1 0 0 0 0 1 0\n"
                                   "1 0 0 9 0 1 0 0 0 0 1 0\n");
  const Drive drive = Drive::open(file, poses, kTenth);
  ASSERT_EQ(drive.size(), 3U);
  for (std::size_t i = 0; i < 3; ++i)
    EXPECT_NEAR(drive.T_map_lidar(i).translation().x(), 6.0 + static_cast<double>(i), 1e-6);
}

TEST_F(Rawlog, PosesBeyondAnyPlaceAreRefused) {
  const auto file = write({odometry(kStart, 2e9), cloud(0), odometry(kStart + kTenth, 2e9)});
  EXPECT_THAT([&] { (void)Drive::open(file); },
              ThrowsMessage<InputError>(AllOf(HasSubstr("drive.rawlog"),
                                              HasSubstr("scan 0 at 2e+09 m by odometry"),
                                              HasSubstr("at most 1e+09 m on each axis"))));
}

TEST_F(Rawlog, PosesOfTheRobotComeBeforeOdometryUnlessChosen) {
  auto robot = at<CObservationRobotPose>(kStart, "truth");
  robot->pose.mean = CPose3D(7.0, 8.0, 9.0, 0.0, 0.0, 0.0);
  auto later = at<CObservationRobotPose>(kStart + kTenth, "truth");
  later->pose.mean = robot->pose.mean;
  const auto file = write(
      {odometry(kStart, 1.0), odometry(kStart + kTenth, 1.0), robot, later, cloud(0), cloud(1)});
  EXPECT_TRUE(Drive::open(file).T_map_lidar(0).translation().isApprox(Eigen::Vector3d(7, 10, 10)));
  EXPECT_TRUE(Drive::open(file.string() + "?poses=odometry")
                  .T_map_lidar(0)
                  .translation()
                  .isApprox(Eigen::Vector3d(1, 2, 1)));
  EXPECT_FALSE(Drive::open(file.string() + "?poses=none").has_poses());
  EXPECT_THAT([&] { (void)Drive::open(file.string() + "?poses=wheels"); },
              ThrowsMessage<InputError>(HasSubstr("robot_pose, odometry or actions")));
}

TEST_F(Rawlog, OfFramesAndActionsHasTheirPoses) {
  std::vector<Object::Ptr> objects;
  for (int i = 0; i < 3; ++i) {
    auto actions = std::make_shared<CActionCollection>();
    CActionRobotMovement2D step;
    step.computeFromOdometry(CPose2D(0.5, 0.0, 0.0), CActionRobotMovement2D::TMotionModelOptions());
    actions->insert(step);
    auto frame = std::make_shared<CSensoryFrame>();
    frame->insert(cloud(i));
    if (i > 0) objects.push_back(actions);
    objects.push_back(frame);
  }
  const Drive drive = Drive::open(write(objects));
  ASSERT_EQ(drive.size(), 3U);
  for (std::size_t i = 0; i < 3; ++i)
    EXPECT_TRUE(drive.T_map_lidar(i).translation().isApprox(
        Eigen::Vector3d(0.5 * static_cast<double>(i), 2.0, 1.0), 1e-12));
}

TEST_F(Rawlog, RangeCamerasPointsAreTakenAndFilesOfTheirOwnAreNot) {
  auto image = at<CObservation3DRangeScan>(kStart, "camera");
  image->hasPoints3D = true;
  image->points3D_x = {1.0F, 2.0F};
  image->points3D_y = {3.0F, 4.0F};
  image->points3D_z = {5.0F, 6.0F};
  image->points3D_idxs_x = image->points3D_idxs_y = {0, 1};
  auto outside = at<CObservation3DRangeScan>(kStart + kTenth, "camera");
  outside->hasPoints3D = true;
  outside->points3D_x = outside->points3D_y = outside->points3D_z = {1.0F};
  outside->points3D_idxs_x = outside->points3D_idxs_y = {0};
  outside->points3D_convertToExternalStorage((folder_.path() / "points").string(), "");
  const Drive drive =
      Drive::open(write({image, at<CObservationComment>(kStart, "words"), outside}));
  ASSERT_EQ(drive.size(), 1U);
  EXPECT_THAT(drive.read(0).cloud.positions,
              ElementsAre(Eigen::Vector3f(1, 3, 5), Eigen::Vector3f(2, 4, 6)));
  EXPECT_THAT(drive.contents().notes, ElementsAre(HasSubstr("1 observations of clouds hold no")));
}

TEST_F(Rawlog, RangeImagesBecomePoints) {
  auto image = at<CObservation3DRangeScan>(kStart, "camera");
  image->hasRangeImage = true;
  image->range_is_depth = true;
  image->rangeUnits = 0.001F;
  image->cameraParams.ncols = 4;
  image->cameraParams.nrows = 3;
  image->cameraParams.setIntrinsicParamsFromValues(2.0, 2.0, 1.5, 1.0);
  image->rangeImage_setSize(3, 4);
  image->rangeImage.fill(4000);
  const Drive drive = Drive::open(write({image}));
  const PointCloud points = drive.read(0).cloud;
  ASSERT_EQ(points.size(), 12U);
  // x ahead, y left: the pixel at the upper left corner.
  EXPECT_TRUE(points.positions[0].isApprox(Eigen::Vector3f(4.0F, 3.0F, 2.0F), 1e-5F));
}

TEST_F(Rawlog, VelodynePacketsBecomePointsWithTimes) {
  auto scan = at<CObservationVelodyneScan>(kStart, "velodyne");
  scan->calibration = VelodyneCalibration::LoadDefaultCalibration("VLP16");
  CObservationVelodyneScan::TVelodyneRawPacket packet{};
  auto* bytes = reinterpret_cast<unsigned char*>(&packet);
  for (unsigned block = 0; block < 12; ++block) {
    unsigned char* at = bytes + static_cast<std::size_t>(block) * 100;
    const std::uint16_t azimuth = static_cast<std::uint16_t>(40 * block);
    const std::uint16_t distance = 5000;  // 10 m
    at[0] = 0xff;
    at[1] = 0xee;
    std::memcpy(at + 2, &azimuth, 2);
    for (unsigned laser = 0; laser < 32; ++laser) {
      std::memcpy(at + 4 + std::size_t{laser} * 3, &distance, 2);
      at[4 + std::size_t{laser} * 3 + 2] = 77;
    }
  }
  packet.laser_return_mode = CObservationVelodyneScan::RETMODE_STRONGEST;
  packet.velodyne_model_ID = 0x22;
  scan->scan_packets = {packet, packet};
  const std::uint32_t later_us = 1327;
  std::memcpy(reinterpret_cast<unsigned char*>(&scan->scan_packets[1]) + 1200, &later_us, 4);
  const Drive drive = Drive::open(write({scan}));
  const PointCloud points = drive.read(0).cloud;
  // MRPT 2.5.8 takes 16 of the 32 returns of a block.
  ASSERT_EQ(points.size(), 2U * 12U * 16U);
  for (const Eigen::Vector3f& p : points.positions) EXPECT_NEAR(p.norm(), 10.0F, 0.02F);
  EXPECT_EQ(points.intensities.front(), 77.0F);
  ASSERT_EQ(points.time_offsets_s.size(), points.size());
  EXPECT_NEAR(points.time_offsets_s.front(), 0.0F, 1e-6F);
  // It counts by packets.
  EXPECT_NEAR(points.time_offsets_s.back(), 1e-6F * static_cast<float>(later_us), 2e-6F);
}

TEST_F(Rawlog, OfTwoSensorsAsksWhich) {
  const auto file = write({cloud(0, "front"), cloud(0, "rear"), cloud(1, "rear")});
  EXPECT_THAT([&] { (void)Drive::open(file); },
              ThrowsMessage<InputError>(
                  AllOf(HasSubstr("front (1), rear (2)"), HasSubstr("drive.rawlog?cloud=front"))));
  EXPECT_EQ(Drive::open(file.string() + "?cloud=rear").size(), 2U);
  EXPECT_THAT([&] { (void)Drive::open(file.string() + "?cloud=roof"); },
              ThrowsMessage<InputError>(HasSubstr("none of roof")));
}

TEST_F(Rawlog, WithoutCloudsIsRefused) {
  EXPECT_THAT([&] { (void)Drive::open(write({odometry(kStart, 1.0)})); },
              ThrowsMessage<InputError>(HasSubstr("a rawlog without clouds")));
}

TEST_F(Rawlog, BrokenOffGivesWhatStandsBefore) {
  const auto file = write({cloud(0), cloud(1), cloud(2)}, false);
  const std::string whole = text_of(file);
  folder_.write("drive.rawlog", whole.substr(0, whole.size() - 10));
  const Drive drive = Drive::open(file);
  EXPECT_EQ(drive.size(), 2U);
  EXPECT_THAT(drive.contents().notes,
              ElementsAre(AllOf(HasSubstr("object 3"), HasSubstr("2 scans could"))));
  // What MRPT does not know cannot be stepped over.
  std::string unknown = whole;
  const std::size_t third = unknown.rfind("CObservationPointCloud");
  unknown[third + 1] = 'X';
  folder_.write("drive.rawlog", unknown);
  EXPECT_THAT(Drive::open(file).contents().notes, ElementsAre(HasSubstr("2 scans could")));
}

TEST_F(Rawlog, ThatClaimsMuchGetsNoMemoryForIt) {
  const auto file = write({cloud(0), cloud(1)}, false);
  std::string bytes = text_of(file);
  // The count of points of the second cloud: 4 bytes before its first coordinate, 2.5.
  const std::string first_coordinate("\x00\x00\x20\x40", 4);
  const std::size_t place = bytes.find(first_coordinate);
  ASSERT_NE(place, std::string::npos);
  ASSERT_EQ(bytes.substr(place - 4, 4), std::string("\x03\x00\x00\x00", 4));
  for (const char* claim : {"\xff\xff\xff\x7f", "\xff\xff\xff\xff", "\xff\xff\xff\x0f"}) {
    bytes.replace(place - 4, 4, claim, 4);
    folder_.write("drive.rawlog", bytes);
    const Drive drive = Drive::open(file);
    EXPECT_EQ(drive.size(), 1U);
    EXPECT_THAT(drive.contents().notes, ElementsAre(HasSubstr("1 scans could")));
  }
}

struct Reading {
  long peak_kib = 0;
  /// 0 when it ended of itself.
  int signal = 0;
};

/// Read in a process forked from this one: as confined as `stillmap-rawlog`, without its start.
Reading reading_of(const std::filesystem::path& file) {
  const pid_t pid = ::fork();
  if (pid == 0) {
    rawlog::confine();
    const rlimit seconds{10, 10};
    ::setrlimit(RLIMIT_CPU, &seconds);
    const int nothing = ::open("/dev/null", O_WRONLY);
    ::dup2(nothing, STDOUT_FILENO);
    ::dup2(nothing, STDERR_FILENO);
    rawlog::RecordOutput output(nothing);
    rawlog::read(file.string(), output);
    ::_exit(0);
  }
  int status = 0;
  rusage used{};
  ::wait4(pid, &status, 0, &used);
  return {used.ru_maxrss, WIFSIGNALED(status) ? WTERMSIG(status) : 0};
}

/// MRPT 2.5.8 dies of a cloud whose count is cut off: it takes any number for it, and does not look
/// whether there was memory for so many points.
TEST_F(Rawlog, CutOffAnywhereEndsSoonInLittleMemory) {
  auto frame = std::make_shared<CSensoryFrame>();
  frame->insert(cloud(1));
  const std::vector<Object::Ptr> objects{odometry(kStart, 1.0), cloud(0), frame};
  for (const bool packed : {false, true}) {
    const auto file = write(objects, packed);
    const std::string whole = text_of(file);
    for (std::size_t size = 0; size < whole.size(); ++size) {
      folder_.write("drive.rawlog", whole.substr(0, size));
      const Reading reading = reading_of(file);
      ASSERT_LT(reading.peak_kib, 256 * 1024) << size;
      ASSERT_THAT(reading.signal, ::testing::AnyOf(0, SIGSEGV, SIGABRT)) << size;
    }
  }
}

TEST_F(Rawlog, CutOffGivesADriveOrSaysWhy) {
  const auto file = write({cloud(0), cloud(1)}, false);
  const std::string whole = text_of(file);
  std::size_t drives = 0;
  for (std::size_t size = whole.size(); size > 30; size -= std::min<std::size_t>(size, 29)) {
    folder_.write("drive.rawlog", whole.substr(0, size));
    try {
      const Drive drive = Drive::open(file);
      ++drives;
      ASSERT_EQ(drive.read(0).points_in_file, 3U);
      if (size == whole.size()) continue;
      ASSERT_THAT(drive.contents().notes,
                  ElementsAre(AllOf(HasSubstr("could not be read to its end"),
                                    HasSubstr("1 scans could"))));
    } catch (const InputError& error) {
      ASSERT_THAT(error.what(), HasSubstr("no clouds; the rawlog could not be read to its end"));
    }
  }
  EXPECT_GT(drives, 3U);
}

}  // namespace rawlog_test
}  // namespace stillmap::maps
