#include <gtest/gtest.h>
#include <stillmap/maps/error.hpp>

#include "bags/ros_messages.hpp"
#include "scan_bytes.hpp"
#include "support/message_bytes.hpp"
#include "support/throws.hpp"

namespace stillmap::maps {
namespace message_reader_test {

using test::as_bytes;
using test::MessageBytes;
using test::ThrowsSaying;
using Kind = MessageBytes::Kind;

MessageReader reader_of(const std::string& bytes, Serialization serialization) {
  return {as_bytes(bytes), serialization, "message"};
}

TEST(MessageReader, CountsAlignmentBehindTheEncapsulation) {
  for (const Kind kind : {Kind::kLittleEndian, Kind::kBigEndian}) {
    MessageBytes bytes(kind);
    bytes.put(std::uint8_t{1}).put(2.5).put(std::uint8_t{3}).put(std::uint16_t{4});
    bytes.put(std::uint32_t{5}).text("six").put(-7.0F).bytes("89");
    // By hand: 4, then 1 + 7 of padding, 8, 1 + 1, 2, 4, 4 + "six" and NUL, 4, 4 + 2.
    ASSERT_EQ(bytes.str().size(), 4U + 8 + 8 + 2 + 2 + 4 + 8 + 4 + 6);
    MessageReader reader = reader_of(bytes.str(), Serialization::kCdr);
    EXPECT_EQ(reader.number<std::uint8_t>(), 1);
    EXPECT_EQ(reader.number<double>(), 2.5);
    EXPECT_EQ(reader.number<std::uint8_t>(), 3);
    EXPECT_EQ(reader.number<std::uint16_t>(), 4);
    EXPECT_EQ(reader.number<std::uint32_t>(), 5U);
    EXPECT_EQ(reader.text(), "six");
    EXPECT_EQ(reader.number<float>(), -7.0F);
    EXPECT_EQ(reader.bytes().size(), 2U);
    EXPECT_THROW((void)reader.number<std::uint8_t>(), InputError);
  }
}

TEST(MessageReader, ReadsRos1WithoutAlignmentAndWithItsSequence) {
  MessageBytes bytes(Kind::kRos1);
  bytes.header(3'000'000'004, "/lidar").put(std::uint8_t{1}).put(2.5);
  MessageReader reader = reader_of(bytes.str(), Serialization::kRos1);
  const RosHeader header = read_header(reader);
  EXPECT_EQ(header.stamp_ns, 3'000'000'004);
  EXPECT_EQ(header.frame_id, "lidar");
  EXPECT_TRUE(reader.flag());
  EXPECT_EQ(reader.number<double>(), 2.5);
}

TEST(MessageReader, RefusesWhatItDoesNotKnow) {
  EXPECT_THAT([] { (void)reader_of("\1", Serialization::kCdr); },
              ThrowsSaying<InputError>({"message", "1 bytes", "4"}));
  const std::string parameter_list("\0\3\0\0", 4);
  EXPECT_THAT([&] { (void)reader_of(parameter_list, Serialization::kCdr); },
              ThrowsSaying<InputError>({"0003", "0001"}));
  EXPECT_THAT([] { (void)reader_of("{}", Serialization::kOther); },
              ThrowsSaying<InputError>({"not CDR"}));
}

TEST(MessageReader, RefusesLengthsBeyondTheBytes) {
  MessageBytes bytes;
  bytes.put(std::uint32_t{0xFFFFFFFF}).put(std::uint32_t{0});
  EXPECT_THAT([&] { (void)reader_of(bytes.str(), Serialization::kCdr).bytes(); },
              ThrowsSaying<InputError>({"8 bytes", "4294967295"}));
  EXPECT_THAT([&] { (void)reader_of(bytes.str(), Serialization::kCdr).text(); },
              ThrowsSaying<InputError>({"a text of 4294967295 bytes"}));
  EXPECT_THAT([&] { (void)reader_of(bytes.str(), Serialization::kCdr).count(2); },
              ThrowsSaying<InputError>({"a sequence of 4294967295 in 4 bytes"}));
  MessageBytes open;
  open.put(std::uint32_t{3}).put('a').put('b').put('c');
  EXPECT_THAT([&] { (void)reader_of(open.str(), Serialization::kCdr).text(); },
              ThrowsSaying<InputError>({"without its NUL"}));
}

TEST(RosMessages, ReadsPosesAndTransforms) {
  const std::string odometry =
      test::odometry(7'000'000'001, {1, 2, 3, 0, 0, 0.6, 0.8}, "/base", "/odom");
  MessageReader reader = reader_of(odometry, Serialization::kCdr);
  const StampedTransform pose = read_pose(reader, kNavOdometry);
  EXPECT_EQ(pose.stamp_ns, 7'000'000'001);
  EXPECT_EQ(pose.parent, "odom");
  EXPECT_EQ(pose.child, "base");
  ASSERT_TRUE(pose.T_parent_child);
  EXPECT_EQ(pose.T_parent_child->translation(), Eigen::Vector3d(1, 2, 3));
  EXPECT_NEAR((*pose.T_parent_child * Eigen::Vector3d(1, 0, 0)).y(), 2.0 + 0.96, 1e-12);

  const std::string tf = test::transform(5, "a", "b", {4, 5, 6});
  MessageReader transforms = reader_of(tf, Serialization::kCdr);
  std::size_t count = 0;
  read_transforms(transforms, [&](const StampedTransform& each) {
    ++count;
    EXPECT_EQ(each.child, "b");
    EXPECT_EQ(each.T_parent_child->translation(), Eigen::Vector3d(4, 5, 6));
  });
  EXPECT_EQ(count, 1U);
}

TEST(RosMessages, GivesNoTransformForWhatIsNoRotation) {
  for (const test::PoseValues& pose :
       {test::PoseValues{0, 0, 0, 0, 0, 0, 0}, test::PoseValues{NAN}, test::PoseValues{1, 2, 3, 1},
        test::PoseValues{-1e10}, test::PoseValues{1e300}}) {
    const std::string bytes = test::pose_stamped(1, pose);
    MessageReader reader = reader_of(bytes, Serialization::kCdr);
    EXPECT_FALSE(read_pose(reader, kPoseStamped).T_parent_child);
  }
}

TEST(RosMessages, RefuseEveryCut) {
  const std::string whole = test::odometry(1, {}).substr(0, 4 + 8 + 12 + 16 + 56);
  for (std::size_t size = 0; size < whole.size(); ++size) {
    const std::string bytes = whole.substr(0, size);
    EXPECT_THROW(
        {
          MessageReader reader = reader_of(bytes, Serialization::kCdr);
          (void)read_pose(reader, kNavOdometry);
        },
        InputError)
        << size;
  }
}

}  // namespace message_reader_test
}  // namespace stillmap::maps
