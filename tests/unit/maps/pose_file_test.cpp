#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/pose_file.hpp>

#include <algorithm>

#include "support/matchers.hpp"
#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::maps {
namespace pose_file_test {

using test::IsNearPose;
using test::TemporaryFolder;
using test::ThrowsSaying;
using ::testing::ElementsAre;
using ::testing::IsEmpty;

/// Turned about z by 90 deg, at 4 5 6.
Eigen::Isometry3d turned() {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() << 0, -1, 0, 1, 0, 0, 0, 0, 1;
  T.translation() << 4, 5, 6;
  return T;
}

class PoseFiles : public ::testing::Test {
 protected:
  [[nodiscard]] PoseFile read(const std::string& text) const {
    return read_pose_file(folder_.write("poses.txt", text));
  }
  /// One pose, `turned`.
  void expect_turned(const std::string& text, const std::string& format) const {
    const PoseFile poses = read(text);
    EXPECT_EQ(poses.format, format) << text;
    ASSERT_EQ(poses.all().size(), 1U) << text;
    EXPECT_THAT(poses.all()[0], IsNearPose(turned(), 1e-9, 1e-9)) << text;
  }
  void expect_stamp(const std::string& text, std::int64_t stamp_ns) const {
    const PoseFile poses = read(text);
    ASSERT_TRUE(poses.has_stamps()) << text;
    EXPECT_EQ(poses.stamped.poses()[0].stamp_ns, stamp_ns) << text;
  }
  void expect_error(const std::string& text, const std::vector<std::string>& words) const {
    EXPECT_THAT([&] { (void)read(text); }, ThrowsSaying<InputError>(words)) << text;
  }
  TemporaryFolder folder_{test::memory_folder()};
};

const std::string kQuaternion = "0 0 0.7071067811865476 0.7071067811865476";
const std::string kMatrix = "0 -1 0 4 1 0 0 5 0 0 1 6";

TEST_F(PoseFiles, TellsTumAndKittiByTheirNumbers) {
  expect_turned("1.5 4 5 6 " + kQuaternion + "\n", "tum");
  expect_turned(kMatrix + "\n", "kitti");
  expect_turned(kMatrix + " 0 0 0 1\n", "kitti");
  EXPECT_FALSE(read(kMatrix).has_stamps());
  EXPECT_THAT(read(kMatrix).numbers, IsEmpty());
  expect_stamp("# stamp tx ty tz qx qy qz qw\n1.5 4 5 6 " + kQuaternion, 1'500'000'000);
}

TEST_F(PoseFiles, TakeAByteOrderMarkAndCarriageReturns) {
  expect_turned("\xEF\xBB\xBF" + kMatrix + "\r\n", "kitti");
  expect_turned(
      "\xEF\xBB\xBF"
      "1.5 4 5 6 " +
          kQuaternion + "\r\n",
      "tum");
  expect_turned(
      "\xEF\xBB\xBFtimestamp,x,y,z,qx,qy,qz,qw\r\n1.5,4,5,6,0,0,0.70710678,0.70710678\r\n", "csv");
}

TEST_F(PoseFiles, TakeNumbersOfScansOrStampsBeforeAMatrix) {
  const PoseFile numbered = read("7 " + kMatrix + "\n9.000e+00 " + kMatrix + "\n");
  EXPECT_EQ(numbered.format, "kitti360");
  EXPECT_THAT(numbered.numbers, ElementsAre(7U, 9U));
  EXPECT_THAT(numbered.poses[1], IsNearPose(turned(), 1e-12, 1e-12));
  expect_stamp("1700000000.25 " + kMatrix + "\n", 1'700'000'000'250'000'000);
  expect_error("7 " + kMatrix + "\n7 " + kMatrix + "\n", {"poses.txt", "two poses of scan 7"});
  expect_error("7.5 " + kMatrix + "\n", {"line 1", "'7.5' as the number of a scan"});
}

TEST_F(PoseFiles, NameTheirColumnsInAHeader) {
  for (const char* const header :
       {"timestamp,x,y,z,qx,qy,qz,qw", "Time [s];Pos.X [m];Pos.Y [m];Pos.Z [m];QX;QY;QZ;QW",
        "stamp tx ty tz q_x q_y q_z q_w",
        "#p_x,p_y,p_z,time,orientation.x,orientation.y,"
        "orientation.z,orientation.w"}) {
    const char separator = std::string(header).find(';') != std::string::npos   ? ';'
                           : std::string(header).find(',') != std::string::npos ? ','
                                                                                : ' ';
    const bool starts_with_stamp = std::string(header).front() != '#';
    std::string row = (starts_with_stamp ? "1.5 4 5 6 " : "4 5 6 1.5 ") + kQuaternion;
    std::replace(row.begin(), row.end(), ' ', separator);
    expect_turned(std::string(header) + "\n" + row + "\n", "csv");
  }
}

TEST_F(PoseFiles, FollowTheOrderThatTheHeaderSays) {
  // EuRoC: w before x.
  expect_turned(
      "#timestamp [ns], p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], "
      "q_RS_y [], q_RS_z [], v_x\n"
      "1403636580838555648,4,5,6,0.7071067811865476,0,0,0.7071067811865476,9\n",
      "csv");
  // rostopic echo -p: the stamp of the header, not when it was received.
  const std::string rostopic =
      "%time,field.header.seq,field.header.stamp,field.header.frame_id,field.pose.pose.position.x,"
      "field.pose.pose.position.y,field.pose.pose.position.z,field.pose.pose.orientation.x,"
      "field.pose.pose.orientation.y,field.pose.pose.orientation.z,field.pose.pose.orientation.w\n"
      "1700000000123456999,1,1700000000123456789,map,4,5,6,0,0,0.7071067811865476,"
      "0.7071067811865476\n";
  expect_turned(rostopic, "csv");
  expect_stamp(rostopic, 1'700'000'000'123'456'789);
}

TEST_F(PoseFiles, ReadAnglesAboutFixedAxes) {
  expect_turned("t,x,y,z,roll,pitch,yaw\n1,4,5,6,0,0,1.5707963267948966\n", "csv");
  expect_turned("t,x,y,z,roll_deg,pitch_deg,yaw_deg\n1,4,5,6,0,0,90\n", "csv");
  expect_turned("t,x,y,z,yaw [deg],pitch [deg],roll [deg]\n1,4,5,6,90,0,0\n", "csv");
  expect_error("t,x,y,z,roll,pitch,yaw\n1,4,5,6,0,0,90\n",
               {"line 2", "an angle of 90, and no unit", "yaw_deg"});
  // R = Rz(yaw) Ry(pitch) Rx(roll): with yaw and roll of 90 deg, x goes to y and y to z.
  const PoseFile poses = read("t,x,y,z,roll_deg,pitch_deg,yaw_deg\n1,0,0,0,90,0,90\n");
  EXPECT_LT((poses.all()[0].linear().col(0) - Eigen::Vector3d::UnitY()).norm(), 1e-12);
  EXPECT_LT((poses.all()[0].linear().col(1) - Eigen::Vector3d::UnitZ()).norm(), 1e-12);
}

TEST_F(PoseFiles, TakeUnitsInsideAHeaderPartedByBlanks) {
  // qw comes first: without the header it would be taken as qx.
  expect_turned(
      "# timestamp [s] tx [m] ty [m] tz [m] qw [-] qx [-] qy [-] qz [-]\n"
      "1.5 4 5 6 0.7071067811865476 0 0 0.7071067811865476\n",
      "csv");
  expect_error("# timestamp x y z qw qx qy qz extra\n1.5 4 5 6 1 0 0 0\n",
               {"line 2", "8 fields", "9, as the header names"});
}

TEST_F(PoseFiles, TakeNoUnitForAnother) {
  expect_turned("t,x [m],y,z,roll [rad],pitch,yaw [\xC2\xB0]\n1,4,5,6,0,0,90\n", "csv");
  expect_turned("t,x,y,z,roll_radians,pitch (rad),yaw_degrees\n1,4,5,6,0,0,90\n", "csv");
  expect_error("t,x,y,z,roll [gon],pitch [gon],yaw [gon]\n1,4,5,6,0,0,1\n",
               {"line 1", "'roll [gon]'", "angles in rad or deg"});
  expect_error("t,x [mm],y [mm],z [mm],qx,qy,qz,qw\n1,4,5,6,0,0,0,1\n",
               {"line 1", "'x [mm]'", "positions in metres"});
  expect_error("time [min],x,y,z,qx,qy,qz,qw\n1,4,5,6,0,0,0,1\n",
               {"line 1", "'time [min]'", "stamps in s, ms, us or ns"});
}

TEST_F(PoseFiles, TakeAColumnWithAPrefixOnlyWhereNoneHasTheNameAlone) {
  expect_turned(
      "timestamp_ns,x,y,z,std_roll,std_pitch,std_yaw,roll,pitch,yaw_deg\n"
      "17,4,5,6,9,9,9,0,0,90\n",
      "csv");
  expect_error("t,x,y,z,std_roll,std_pitch,std_yaw,my_roll,my_pitch,my_yaw\n1,4,5,6,9,9,9,0,0,90\n",
               {"line 1", "'std_yaw' and 'my_yaw'", "rename"});
  expect_error("gps_time,ros_time,x,y,z,qx,qy,qz,qw\n1,2,4,5,6,0,0,0,1\n",
               {"line 1", "'gps_time' and 'ros_time'"});
  expect_turned("# x, then x again\n1.5 4 5 6 " + kQuaternion + "\n", "tum");
}

TEST_F(PoseFiles, MayLeaveTheLastCellsEmpty) {
  expect_turned("t,x,y,z,qx,qy,qz,qw,note\n1,4,5,6,0,0,0.70710678,0.70710678,\n", "csv");
  expect_error("t,x,y,z,qx,qy,qz,note,qw\n1,4,5,6,0,0,0.70710678,0.70710678,\n",
               {"line 2", "8 fields", "9, as the header names"});
  expect_error("t,x,y,z,qx,qy,qz,qw\n1,7,4,5,6,0,0,0,1\n", {"line 2", "9 fields", "8, as"});
}

TEST_F(PoseFiles, FindStampsByTheirUsualNames) {
  const std::string names = ",x,y,z,qx,qy,qz,qw\n", rest = ",4,5,6,0,0,0,1\n";
  for (const char* const name :
       {"utc_time", "time_stamp", "gps_time", "ros_time", "unix_time", "ros_timestamp", "Stamp"})
    expect_stamp(name + names + "1.5" + rest, 1'500'000'000);
  for (const char* const pair :
       {"timestamp_sec,timestamp_nsec", "header.stamp.sec,header.stamp.nanosec", "secs,nsecs",
        "field.header.stamp.secs,field.header.stamp.nsecs", "time [s],time [ns]"})
    expect_stamp(pair + names + "1700000000,5" + rest, 1'700'000'000'000'000'005);
  expect_stamp("timestamp_sec" + names + "1.5" + rest, 1'500'000'000);
  expect_error("time_s,time_ns" + names + "1.5,1500000000" + rest,
               {"line 2", "'1500000000' beside seconds", "remove one"});
}

TEST_F(PoseFiles, ReadStampsToTheNanosecondInAnyUnit) {
  const std::string rest = ",4,5,6,0,0,0,1\n";
  const std::string names = ",x,y,z,qx,qy,qz,qw\n";
  expect_stamp("timestamp" + names + "1700000000123456789" + rest, 1'700'000'000'123'456'789);
  expect_stamp("timestamp" + names + "1700000000123456" + rest, 1'700'000'000'123'456'000);
  expect_stamp("timestamp" + names + "1700000000123" + rest, 1'700'000'000'123'000'000);
  expect_stamp("timestamp" + names + "1700000000.123456789" + rest, 1'700'000'000'123'456'789);
  expect_stamp("timestamp_ns" + names + "17" + rest, 17);
  expect_stamp("time [us]" + names + "17.5" + rest, 17'500);
  expect_stamp("timestamp_ns" + names + "1.700000000123456789e+18" + rest,
               1'700'000'000'123'456'789);
  expect_stamp("sec,nanosec" + names + "1700000000,5" + rest, 1'700'000'000'000'000'005);
  // TUM too.
  expect_stamp("1700000000123456789 4 5 6 0 0 0 1", 1'700'000'000'123'456'789);
}

TEST_F(PoseFiles, NumberScansInATableWithoutStamps) {
  const PoseFile poses = read("frame,x,y,z,qx,qy,qz,qw\n3,4,5,6,0,0,0,1\n5,4,5,6,0,0,0,1\n");
  EXPECT_THAT(poses.numbers, ElementsAre(3U, 5U));
  const PoseFile in_turn = read("x,y,z,qx,qy,qz,qw\n4,5,6,0,0,0,1\n");
  EXPECT_EQ(in_turn.poses.size(), 1U);
  EXPECT_THAT(in_turn.numbers, IsEmpty());
}

TEST_F(PoseFiles, AreTheVerticesOfAGraph) {
  const PoseFile poses =
      read("FIX 0\nVERTEX_SE3:QUAT 2 4 5 6 " + kQuaternion +
           "\nVERTEX_XY 9 1 2\nEDGE_SE3:QUAT 2 3 0 0 0 0 0 0 1 1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 1 0 "
           "0 1 0 1\nVERTEX_SE3:QUAT 3 0 0 0 0 0 0 1\n");
  EXPECT_EQ(poses.format, "g2o");
  EXPECT_THAT(poses.numbers, ElementsAre(2U, 3U));
  EXPECT_THAT(poses.poses[0], IsNearPose(turned(), 1e-9, 1e-9));
  expect_error("VERTEX_SE2 0 1 2 0.5\n", {"a graph without VERTEX_SE3:QUAT"});
  expect_error("VERTEX_SE3:QUAT 0 1 2\n", {"line 1", "4 fields"});
}

TEST_F(PoseFiles, OfDumpsAreReadFromTheirFolders) {
  const std::string data =
      "stamp 1700000001 5\nestimate\n0 -1 0 4\n1 0 0 5\n0 0 1 6\n0 0 0 1\nodom\n1 0 0 0\n0 1 0 0\n"
      "0 0 1 0\n0 0 0 1\naccum_distance 3\nid 7\n";
  folder_.write("dump/000000/cloud.pcd", "");
  folder_.write("dump/000000/data", data);
  const PoseFile hdl = read_pose_file(folder_.path() / "dump");
  EXPECT_EQ(hdl.format, "hdl_graph_slam");
  EXPECT_EQ(hdl.stamped.poses()[0].stamp_ns, 1'700'000'001'000'000'005);
  EXPECT_THAT(hdl.all()[0], IsNearPose(turned(), 1e-12, 1e-12));
  folder_.write("glim/traj_lidar.txt", "1.5 4 5 6 " + kQuaternion + "\n");
  EXPECT_EQ(read_pose_file(folder_.path() / "glim").format, "glim");
  EXPECT_THAT([&] { (void)read_pose_file(folder_.path()); },
              ThrowsSaying<InputError>({"a folder", "traj_lidar.txt"}));
  // Each cut of it is refused, or the same.
  for (std::size_t size = 0; size < data.size(); ++size) {
    folder_.write("dump/000000/data", data.substr(0, size));
    try {
      EXPECT_THAT(read_pose_file(folder_.path() / "dump").all()[0],
                  IsNearPose(turned(), 1e-12, 1e-12));
    } catch (const InputError&) {
      EXPECT_LT(size, data.find("odom"));
    }
  }
}

TEST_F(PoseFiles, SayWhatIsWrongAndWhere) {
  expect_error("", {"no poses", "give another file"});
  expect_error("# only a comment\n", {"no poses"});
  expect_error("1 2 3 4 5 6 7\n", {"line 1", "7 fields", "timestamp,x,y,z,qx,qy,qz,qw"});
  expect_error("# x y z roll pitch yaw\n1700000010 0 0 0 0 0 0\n",
               {"line 2", "7 fields", "6, as the header names"});
  expect_error("# x y z qx qy qz qw\n1 2\n", {"line 2", "2 fields"});
  expect_error("# x y z qx qy qz qw\n1\n", {"line 2", "1 fields"});
  expect_error("hello world\n", {"line 1", "'hello world'", "a header that names columns"});
  expect_error("t,x,y,z\n1,2,3,4\n", {"line 1", "'t,x,y,z'"});
  expect_error("t,x,y,z,qx,qy,qz,qw\n1,4,5,,0,0,0,1\n", {"line 2", "''", "finite"});
  expect_error("t,x,y,z,qx,qy,qz,qw\n1,4,5,6,0,0,1\n", {"line 2", "7 fields", "8, as the header"});
  expect_error("t,x,y,z,qx,qy,qz,qw\n1,4,5,6,0,0,0,1\n1,4,5,6,0,0,0,1\n",
               {"line 3", "stamp '1'", "sort"});
  expect_error("t,x,y,z,qx,qy,qz,qw\n1,4,5,6,0,0,0,2\n", {"line 2", "norm 2"});
  expect_error(kMatrix + "\n\n" + kMatrix, {"line 2", "a blank line"});
  expect_error(kMatrix + " 0 0 0 2\n", {"line 1", "the last row 0 0 0 2"});
  expect_error(kMatrix + "\n1 2 3\n", {"line 2", "3 fields", "12, as in the lines before"});
}

}  // namespace pose_file_test
}  // namespace stillmap::maps
