#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/maps/deskew.hpp>
#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/frames.hpp>
#include <stillmap/maps/imu.hpp>

#include <cmath>
#include <limits>

#include "bags/bag_imu.hpp"
#include "bags/ros_messages.hpp"
#include "support/matchers.hpp"
#include "support/message_bytes.hpp"
#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::maps {
namespace imu_test {

using test::IsNearVector;
using test::MessageBytes;
using test::TemporaryFolder;
using test::ThrowsSaying;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr std::int64_t kStepNs = 5'000'000;

/// 200 Hz for a second of a rate that grows from 0 by 2 rad/s^2 about z, told with a bias.
std::vector<ImuReading> speeding_up(const Eigen::Vector3f& bias) {
  std::vector<ImuReading> readings;
  for (int i = 0; i <= 200; ++i) {
    const float time_s = 0.005F * static_cast<float>(i);
    readings.push_back({i * kStepNs, Eigen::Vector3f(0.0F, 0.0F, 2.0F * time_s) + bias,
                        Eigen::Vector3f(0.0F, 0.0F, 9.81F)});
  }
  return readings;
}

double yaw_rad(const Eigen::Matrix3d& R) { return std::atan2(R(1, 0), R(0, 0)); }

TEST(Imu, TurnIsTheIntegralOfTheRateWithoutItsBias) {
  const Eigen::Vector3f bias(0.01F, -0.02F, 0.03F);
  const std::vector<ImuReading> readings = speeding_up(bias);
  const Imu::Fit fit{0, bias.cast<double>()};
  // Integral of 2 t from 0.2 to 0.5 s, and between readings.
  const auto turn = turn_between_stamps(readings, fit, 200'000'000, 500'000'000);
  ASSERT_TRUE(turn);
  EXPECT_NEAR(yaw_rad(*turn), 0.21, 1e-6);
  EXPECT_NEAR(rotation_angle_rad(*turn), 0.21, 1e-6);
  const auto between = turn_between_stamps(readings, fit, 201'000'000, 502'000'000);
  ASSERT_TRUE(between);
  EXPECT_NEAR(yaw_rad(*between), 0.502 * 0.502 - 0.201 * 0.201, 1e-6);
  const auto back = turn_between_stamps(readings, fit, 500'000'000, 200'000'000);
  ASSERT_TRUE(back);
  EXPECT_NEAR(yaw_rad(*back), -0.21, 1e-6);
}

TEST(Imu, ReadingsAreAtTheirStampsWithTheClockOffset) {
  const std::vector<ImuReading> readings = speeding_up(Eigen::Vector3f::Zero());
  const Imu::Fit fit{100'000'000, Eigen::Vector3d::Zero()};
  const auto turn = turn_between_stamps(readings, fit, 300'000'000, 600'000'000);
  ASSERT_TRUE(turn);
  EXPECT_NEAR(yaw_rad(*turn), 0.21, 1e-6);
}

TEST(Imu, TellsNothingWithoutReadings) {
  std::vector<ImuReading> readings = speeding_up(Eigen::Vector3f::Zero());
  const Imu::Fit fit;
  EXPECT_FALSE(turn_between_stamps(readings, fit, -1'000'000, 100'000'000)) << "before the first";
  EXPECT_FALSE(turn_between_stamps(readings, fit, 900'000'000, 1'000'000'001)) << "after the last";
  readings.erase(readings.begin() + 50, readings.begin() + 60);
  EXPECT_FALSE(turn_between_stamps(readings, fit, 200'000'000, 400'000'000)) << "a gap of 55 ms";
  EXPECT_TRUE(turn_between_stamps(readings, fit, 300'000'000, 400'000'000)) << "behind the gap";
  EXPECT_FALSE(turn_between_stamps({}, fit, 0, 1));
}

/// A wall at x = 10 m as a sensor sees it that speeds up its turn, and moves along x by 3 m/s.
Scan wall_seen_while_speeding_up(std::int64_t stamp_ns) {
  Scan scan;
  scan.stamp_ns = stamp_ns;
  const double stamp_s = 1e-9 * static_cast<double>(stamp_ns);
  for (int i = 0; i <= 100; ++i) {
    const double time_s = -0.05 + 0.001 * i;
    const double yaw = std::pow(stamp_s + time_s, 2) - std::pow(stamp_s, 2);
    const Eigen::Vector3d p_stamp(10.0, -5.0 + 0.1 * i, 1.0);
    const Eigen::Vector3d way(3.0 * time_s, 0.0, 0.0);
    const Eigen::AngleAxisd R_stamp_then(yaw, Eigen::Vector3d::UnitZ());
    scan.cloud.positions.push_back((R_stamp_then.inverse() * (p_stamp - way)).cast<float>());
    scan.cloud.time_offsets_s.push_back(static_cast<float>(time_s));
  }
  return scan;
}

TEST(Imu, StraightensAWallThatAConstantTwistDoesNot) {
  const std::vector<ImuReading> readings = speeding_up(Eigen::Vector3f::Zero());
  Scan scan = wall_seen_while_speeding_up(500'000'000);
  Eigen::Matrix<double, 6, 1> twist;
  // The rate at the stamp: 5 cm are left by what it changes meanwhile.
  twist << 3.0, 0.0, 0.0, 0.0, 0.0, 1.0;
  PointCloud bent = scan.cloud;
  deskew(bent, twist);
  EXPECT_GT(std::abs(bent.positions.front().x() - 10.0F), 0.01F);
  scan.cloud.turn = turn_of(scan, readings, {});
  ASSERT_TRUE(scan.cloud.turn);
  // The rate of a twist does not matter then.
  twist.tail<3>().setConstant(7.0);
  deskew(scan.cloud, twist);
  for (int i = 0; i <= 100; ++i) {
    const Eigen::Vector3f p(10.0F, -5.0F + 0.1F * static_cast<float>(i), 1.0F);
    ASSERT_THAT(scan.cloud.positions[static_cast<std::size_t>(i)], IsNearVector(p, 1e-4F));
    EXPECT_EQ(scan.cloud.time_offsets_s[static_cast<std::size_t>(i)], 0.0F);
  }
}

TEST(Imu, ASweepThatIsTurnedIsNotTurnedAgain) {
  Scan scan = wall_seen_while_speeding_up(500'000'000);
  scan.cloud.turn = turn_of(scan, speeding_up(Eigen::Vector3f::Zero()), {});
  PointCloud once = scan.cloud;
  turn_to_stamp(once);
  PointCloud twice = once;
  turn_to_stamp(twice);
  EXPECT_EQ(once.positions, twice.positions);
  Eigen::Matrix<double, 6, 1> twist;
  twist << 3.0, 0.0, 0.0, 0.0, 0.0, 1.0;
  deskew(once, twist);
  deskew(scan.cloud, twist);
  EXPECT_EQ(once.positions, scan.cloud.positions);
}

TEST(Imu, HasNoTurnForScansWithoutTimesOrReadings) {
  const std::vector<ImuReading> readings = speeding_up(Eigen::Vector3f::Zero());
  Scan scan = wall_seen_while_speeding_up(20'000'000);
  EXPECT_FALSE(turn_of(scan, readings, {})) << "the sweep begins before the readings";
  scan.stamp_ns = 500'000'000;
  // 0.1 ns apart.
  scan.cloud.time_offsets_s.assign(scan.cloud.size(), 0.0F);
  scan.cloud.time_offsets_s.back() = 1e-10F;
  EXPECT_FALSE(turn_of(scan, readings, {})) << "points of one instant";
  scan.cloud.time_offsets_s.clear();
  EXPECT_FALSE(turn_of(scan, readings, {}));
}

TEST(SweepTurn, NeedsTwoTimesWithARotationEach) {
  const Eigen::Matrix3f R = Eigen::Matrix3f::Identity();
  EXPECT_THROW(SweepTurn({0.0F}, {R}), std::invalid_argument);
  EXPECT_THROW(SweepTurn({0.0F, 0.1F}, {R}), std::invalid_argument);
  EXPECT_EQ(SweepTurn({0.0F, 0.1F}, {R, R}).at(0.05F), R);
}

TEST(ImuReadings, AreSortedAndFinite) {
  std::vector<std::string> notes;
  std::vector<ImuReading> readings = speeding_up(Eigen::Vector3f::Zero());
  std::swap(readings[3], readings[4]);
  readings[7].rate_radps.x() = std::numeric_limits<float>::quiet_NaN();
  readings[8].stamp_ns = readings[9].stamp_ns;
  const auto usable = usable_readings(readings, "/imu", notes);
  ASSERT_TRUE(usable);
  EXPECT_EQ(usable->size(), 199U);
  EXPECT_TRUE(std::ranges::is_sorted(*usable, {}, &ImuReading::stamp_ns));
  EXPECT_THAT(notes, ElementsAre(HasSubstr("2 of 201 readings left out")));
  EXPECT_FALSE(usable_readings({readings[0]}, "/imu", notes));
}

TEST(ImuReadings, InGAreRecognised) {
  std::vector<ImuReading> readings = speeding_up(Eigen::Vector3f::Zero());
  std::vector<std::string> notes;
  EXPECT_NEAR(usable_readings(readings, "/imu", notes)->front().force_mps2.z(), 9.81F, 1e-6F);
  EXPECT_THAT(notes, IsEmpty());
  for (ImuReading& reading : readings) reading.force_mps2 /= 9.80665F;
  EXPECT_NEAR(usable_readings(readings, "/imu", notes)->front().force_mps2.z(), 9.81F, 1e-5F);
  EXPECT_THAT(notes, ElementsAre(HasSubstr("taken as g")));
  // Linear acceleration, as phones tell it, is no g.
  notes.clear();
  for (ImuReading& reading : readings) reading.force_mps2 = {0.0F, 0.6F, 0.0F};
  EXPECT_FLOAT_EQ(usable_readings(readings, "/imu", notes)->front().force_mps2.y(), 0.6F);
  EXPECT_THAT(notes, IsEmpty());
}

TEST(ImuFile, ReadsColumnsByTheirNames) {
  const TemporaryFolder folder;
  const auto file = folder.write("imu.csv",
                                 "ax,ay,az,temperature,stamp_ns,wx,wy,wz\r\n"
                                 "1,2,9.5,40,1700000000000000001,0.1,-0.2,3e-1\r\n\n");
  const std::vector<ImuReading> readings = read_imu_csv(file);
  ASSERT_EQ(readings.size(), 1U);
  EXPECT_EQ(readings[0].stamp_ns, 1'700'000'000'000'000'001);
  EXPECT_THAT(readings[0].rate_radps, IsNearVector(Eigen::Vector3f(0.1F, -0.2F, 0.3F), 1e-7F));
  EXPECT_THAT(readings[0].force_mps2, IsNearVector(Eigen::Vector3f(1.0F, 2.0F, 9.5F), 1e-7F));
}

TEST(ImuFile, RefusesWhatIsBroken) {
  const TemporaryFolder folder;
  const auto expect = [&](const std::string& text, const std::vector<std::string>& said) {
    const auto file = folder.write("imu.csv", text);
    EXPECT_THAT([&] { (void)read_imu_csv(file); }, ThrowsSaying<InputError>(said));
  };
  const std::string header = "stamp_ns,wx,wy,wz,ax,ay,az\n";
  expect("", {"no column stamp_ns"});
  expect("stamp_ns,wx,wy,ax,ay,az\n", {"no column wz", "stamp_ns,wx,wy,wz,ax,ay,az"});
  expect(header + "1,2,3\n", {"imu.csv line 2", "7 columns"});
  expect(header + "1,0,0,0,0,0,9.8\n2,0,x,0,0,0,9.8\n", {"line 3", "'x'", "wy"});
  expect(header + "1.5,0,0,0,0,0,9.8\n", {"line 2", "'1.5'", "whole number of ns"});
  for (const std::string stamp :
       {"99999999999999999999", "4000000000000000001", "-9000000000000000000"})
    expect(header + stamp + ",0,0,0,0,0,9.8\n", {"line 2", "whole number of ns", "4e18"});
}

TEST(ImuFile, HasABoundOnItsReadings) {
  const TemporaryFolder folder;
  const auto file =
      folder.write("imu.csv", "stamp_ns,wx,wy,wz,ax,ay,az\n1,0,0,0,0,0,9.8\n2,0,0,0,0,0,9.8\n\n");
  EXPECT_EQ(read_imu_csv(file, 2).size(), 2U);
  EXPECT_THAT([&] { (void)read_imu_csv(file, 1); },
              ThrowsSaying<InputError>({"imu.csv", "more than 1 readings", "split the drive"}));
}

TEST(ImuFile, MayBeginWithAByteOrderMark) {
  const TemporaryFolder folder;
  const auto file =
      folder.write("imu.csv", "\xEF\xBB\xBFstamp_ns,wx,wy,wz,ax,ay,az\r\n1,0,0,0,0,0,9.8\r\n");
  EXPECT_TRUE(has_imu_columns(file));
  EXPECT_EQ(read_imu_csv(file).size(), 1U);
  EXPECT_THROW((void)has_imu_columns(folder.path() / "none.csv"), StorageError);
}

TEST(ImuFile, BelongsToADriveOfAFolder) {
  const TemporaryFolder folder;
  folder.write("a.bin", std::string(16, '\1'));
  EXPECT_FALSE(Drive::open(folder.path()).contents().imu);
  folder.write("imu.csv", "time,gx,gy\n0,0,0\n");
  const Drive foreign = Drive::open(folder.path());
  EXPECT_FALSE(foreign.contents().imu);
  EXPECT_THAT(foreign.contents().notes, Contains(HasSubstr("imu.csv is not used")));
  folder.write("imu.csv", "stamp_ns,wx,wy,wz,ax,ay,az\n1,0,0,0,0,0,9.8\n2,0,0,0,0,0,9.8\n");
  ASSERT_TRUE(Drive::open(folder.path()).contents().imu);
  EXPECT_EQ(Drive::open(folder.path()).contents().imu->source, "imu.csv");
  EXPECT_FALSE(Drive::open(folder.path().string() + "?imu=none").contents().imu);
}

/// sensor_msgs/Imu; rates 1, 2, 3 and force 4, 5, 6.
std::string imu_message(MessageBytes::Kind kind) {
  MessageBytes message(kind);
  message.header(7'000'000'005, "imu_link");
  for (int i = 0; i < 4 + 9; ++i) message.put(-1.0);
  for (const double rate : {1.0, 2.0, 3.0}) message.put(rate);
  for (int i = 0; i < 9; ++i) message.put(-1.0);
  for (const double force : {4.0, 5.0, 6.0}) message.put(force);
  for (int i = 0; i < 9; ++i) message.put(-1.0);
  return message.str();
}

TEST(ImuMessage, IsReadInAllByteOrders) {
  for (const auto kind : {MessageBytes::Kind::kLittleEndian, MessageBytes::Kind::kBigEndian,
                          MessageBytes::Kind::kRos1}) {
    const std::string bytes = imu_message(kind);
    const auto serialization =
        kind == MessageBytes::Kind::kRos1 ? Serialization::kRos1 : Serialization::kCdr;
    const auto read = [&](std::size_t size) {
      MessageReader reader(std::as_bytes(std::span(bytes.data(), size)), serialization, "/imu");
      return read_imu(reader);
    };
    const FramedImuReading imu = read(bytes.size());
    EXPECT_EQ(imu.frame_id, "imu_link");
    EXPECT_EQ(imu.reading.stamp_ns, 7'000'000'005);
    EXPECT_EQ(imu.reading.rate_radps, Eigen::Vector3f(1.0F, 2.0F, 3.0F));
    EXPECT_EQ(imu.reading.force_mps2, Eigen::Vector3f(4.0F, 5.0F, 6.0F));
    for (std::size_t size = 0; size < bytes.size() - 9 * sizeof(double); ++size)
      EXPECT_THROW((void)read(size), InputError) << size;
  }
}

class BagImu : public ::testing::Test {
 protected:
  BagImu() {
    TopicSurvey& topic = survey_.topics["/imu"];
    topic.type = kImu;
    topic.imu = speeding_up(Eigen::Vector3f::Zero());
    topic.imu_readings = topic.imu.size();
    topic.imu_frame = "imu_link";
  }
  std::shared_ptr<const Imu> find(const BagChoice& choice = {}) {
    notes_.clear();
    return find_imu(survey_, choice, "lidar", "run.bag", notes_);
  }

  BagSurvey survey_;
  std::vector<std::string> notes_;
};

TEST_F(BagImu, IsTurnedToTheLidarByTfStatic) {
  Eigen::Isometry3d T_lidar_imu = Eigen::Isometry3d::Identity();
  T_lidar_imu.rotate(Eigen::AngleAxisd(M_PI / 2.0, Eigen::Vector3d::UnitX()));
  survey_.tree.add_rigid("lidar", "imu_link", T_lidar_imu, "run.bag");
  const auto imu = find();
  ASSERT_TRUE(imu);
  EXPECT_EQ(imu->source, "/imu");
  EXPECT_NEAR(imu->rate_hz(), 200.0, 1e-9);
  EXPECT_NEAR(imu->longest_gap_s(), 0.005, 1e-9);
  EXPECT_THAT(imu->readings->back().rate_radps,
              IsNearVector(Eigen::Vector3f(0.0F, -2.0F, 0.0F), 1e-6F));
  EXPECT_THAT(imu->readings->back().force_mps2,
              IsNearVector(Eigen::Vector3f(0.0F, -9.81F, 0.0F), 1e-5F));
  EXPECT_THAT(notes_, IsEmpty());
}

TEST_F(BagImu, WithoutAMountItsAxesAreTheLidars) {
  const auto imu = find();
  ASSERT_TRUE(imu);
  EXPECT_EQ(imu->readings->back().rate_radps, Eigen::Vector3f(0.0F, 0.0F, 2.0F));
  EXPECT_THAT(notes_, ElementsAre(HasSubstr("no place of 'imu_link'")));
}

TEST_F(BagImu, OfSeveralIsTakenAsChosen) {
  survey_.topics["/front/imu"] = survey_.topics["/imu"];
  EXPECT_FALSE(find());
  EXPECT_THAT(notes_, ElementsAre(HasSubstr("'run.bag?imu=/front/imu'")));
  BagChoice choice;
  choice.imu = "none";
  EXPECT_FALSE(find(choice));
  EXPECT_THAT(notes_, IsEmpty());
  choice.imu = "/imu";
  EXPECT_EQ(find(choice)->source, "/imu");
  choice.imu = "/gyro";
  EXPECT_THAT([&] { (void)find(choice); },
              ThrowsSaying<InputError>({"run.bag", "'/gyro'", "/front/imu"}));
}

TEST_F(BagImu, SaysWhichReadingsAreNotUsed) {
  TopicSurvey& topic = survey_.topics["/imu"];
  topic.imu_readings += 3;
  topic.unreadable = 2;
  topic.why_unreadable = "cut";
  ASSERT_TRUE(find());
  EXPECT_THAT(notes_, Contains(HasSubstr("2 messages of /imu cannot be read, the first: cut")));
  EXPECT_THAT(notes_, Contains(HasSubstr("/imu: the first 201 of 204 readings are used")));
  survey_ = {};
  TopicSurvey& broken = survey_.topics["/imu"];
  broken.type = kImu;
  broken.unreadable = 2;
  broken.why_unreadable = "cut";
  EXPECT_FALSE(find());
  EXPECT_THAT(notes_, ElementsAre(HasSubstr("2 messages of /imu cannot be read, the first: cut")));
  BagChoice choice;
  choice.imu = "/imu";
  EXPECT_THAT([&] { (void)find(choice); }, ThrowsSaying<InputError>({"on '/imu'", "first: cut"}));
}

/// The recorder gets a reading up to 9 ms late, and the IMU's clock drifts by 1 ms in 1000
/// readings.
TEST_F(BagImu, HasTheRecordersTimesWhereTheCloudsHave) {
  constexpr std::int64_t kEpochNs = 1'700'000'000'000'000'000;
  TopicSurvey& topic = survey_.topics["/imu"];
  topic.imu.resize(3000);
  for (int i = 0; i < 3000; ++i) {
    topic.imu[static_cast<std::size_t>(i)].stamp_ns = 7 + i * kStepNs;
    topic.imu_recorded_ns.push_back(kEpochNs + i * (kStepNs + 1000) + (i * 7 % 10) * 1'000'000);
  }
  // The recorder's clock was broken once.
  topic.imu_recorded_ns[1500] = std::numeric_limits<std::int64_t>::min();
  topic.imu_readings = topic.imu.size();
  BagChoice choice;
  choice.stamps = "recorded";
  const auto imu = find(choice);
  ASSERT_TRUE(imu);
  ASSERT_EQ(imu->readings->size(), 3000U);
  for (const int i : {0, 999, 1000, 2999}) {
    const std::int64_t late_ns =
        (*imu->readings)[static_cast<std::size_t>(i)].stamp_ns - kEpochNs - i * (kStepNs + 1000);
    EXPECT_NEAR(1e-6 * static_cast<double>(late_ns), 4.5, 1.1) << i;
  }
  EXPECT_EQ((*imu->readings)[11].stamp_ns - (*imu->readings)[10].stamp_ns, kStepNs);
}

}  // namespace imu_test
}  // namespace stillmap::maps
