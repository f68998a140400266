#include "bags/ros1_bag.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/maps/error.hpp>

#include "bag_contents.hpp"
#include "support/bag_bytes.hpp"
#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::maps::ros1 {
namespace ros1_bag_test {

using test::contents;
using test::Ros1Bytes;
using test::ThrowsSaying;
using test::visit;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

std::string connections() {
  return Ros1Bytes::connection(0, "/a", "std_msgs/String") +
         Ros1Bytes::connection(7, "/b", "std_msgs/String") +
         Ros1Bytes::connection(8, "/b", "std_msgs/String");
}

/// Two chunks: a1 b1 a2, and b2 b3.
Ros1Bytes two_chunks(const std::string& compression) {
  Ros1Bytes bag;
  bag.add_chunk(connections() + Ros1Bytes::message(0, "a1") + Ros1Bytes::message(7, "b1 long") +
                    Ros1Bytes::message(0, "a2"),
                compression, {0, 7});
  bag.add_chunk(Ros1Bytes::message(7, "b2") + Ros1Bytes::message(8, "b3"), compression, {7, 8});
  return bag;
}

class Ros1BagTest : public ::testing::Test {
 protected:
  [[nodiscard]] std::unique_ptr<Ros1Bag> open(const std::string& bytes) const {
    return std::make_unique<Ros1Bag>(folder_.write("bag.bag", bytes));
  }
  test::TemporaryFolder folder_{test::memory_folder()};
};

TEST_F(Ros1BagTest, ReadsChunksOfEveryCompressionWithAndWithoutIndex) {
  for (const std::string compression : {"none", "lz4", "bz2"}) {
    for (const bool indexed : {true, false}) {
      SCOPED_TRACE(compression + (indexed ? " indexed" : ""));
      const auto bag = open(two_chunks(compression).finished(indexed ? connections() : "", 3));
      EXPECT_EQ(bag->is_indexed(), indexed);
      EXPECT_EQ(bag->notes().size(), indexed ? 0U : 1U);
      ASSERT_EQ(bag->topics().size(), 2U);  // two publishers of one topic
      EXPECT_EQ(bag->topics()[0].type, "std_msgs/msg/String");
      const auto all = visit(*bag);
      EXPECT_THAT(all.heads, ElementsAre("/a a1", "/b b1 long", "/a a2", "/b b2", "/b b3"));
      EXPECT_EQ(all.damage.parts, 0U) << all.damage.first;
      EXPECT_THAT(visit(*bag, 2, "/b").heads, ElementsAre("/b b1", "/b b2", "/b b3"));
      EXPECT_THAT(contents(*bag), ElementsAre("a1", "b1 long", "a2", "b2", "b3"));
      // Backwards too.
      EXPECT_EQ(test::text_of(bag->read(all.places[2]).span()), "a2");
      EXPECT_EQ(test::text_of(bag->read(all.places[0]).span()), "a1");
    }
  }
}

TEST_F(Ros1BagTest, WhatAKilledRecorderLeavesBesideItsChunksIsRead) {
  // The last chunk is written with a size of 0, to be filled in when it is full.
  const std::string bytes = two_chunks("none").finished("", 0) +
                            Ros1Bytes::chunk_head("none", 0, 0) + Ros1Bytes::message(0, "a3");
  const auto bag = open(bytes);
  EXPECT_THAT(contents(*bag), ElementsAre("a1", "b1 long", "a2", "b2", "b3", "a3"));
}

TEST_F(Ros1BagTest, CutAtEveryByteGivesWhatIsWholeAndSaysTheRest) {
  for (const std::string compression : {"none", "lz4", "bz2"}) {
    const std::string whole = two_chunks(compression).finished(connections(), 3);
    std::size_t most = 0;
    for (std::size_t size = kMagic.size(); size < whole.size(); ++size) {
      SCOPED_TRACE(compression + " " + std::to_string(size));
      const auto bag = open(whole.substr(0, size));
      EXPECT_FALSE(bag->is_indexed());
      const auto found = visit(*bag);
      EXPECT_GE(found.heads.size(), most);  // more bytes never tell less
      EXPECT_LE(found.heads.size(), 5U);
      most = found.heads.size();
      EXPECT_EQ(contents(*bag).size(), most);
      EXPECT_FALSE(bag->notes().empty());
    }
    EXPECT_EQ(most, 5U);
  }
}

TEST_F(Ros1BagTest, DamageIsSaidAndTheRestIsRead) {
  for (const std::string compression : {"lz4", "bz2"}) {
    std::string bytes = two_chunks(compression).finished(connections(), 3);
    // The packed bytes of the first chunk.
    const std::size_t at = bytes.find(compression == "bz2" ? "BZh" : "\x04\x22\x4d\x18");
    for (std::size_t i = at + 8; i < at + 30; ++i) bytes[i] = '\xa5';
    const auto bag = open(bytes);
    const auto found = visit(*bag);
    EXPECT_EQ(found.damage.parts, 1U);
    EXPECT_THAT(found.damage.first, HasSubstr("packed bytes"));
    ASSERT_GE(found.heads.size(), 2U);
    EXPECT_EQ(found.heads.back(), "/b b3");
  }
}

TEST_F(Ros1BagTest, AnIndexThatDoesNotFitIsNotUsed) {
  // Of another number of connections than the header says.
  const auto bag = open(two_chunks("none").finished(connections(), 4));
  EXPECT_FALSE(bag->is_indexed());
  ASSERT_EQ(bag->notes().size(), 1U);
  EXPECT_THAT(bag->notes().front(), HasSubstr("index is broken"));
  EXPECT_EQ(contents(*bag).size(), 5U);
}

TEST_F(Ros1BagTest, RefusesWhatClaimsMoreThanARecorderWrites) {
  EXPECT_THAT([&] { (void)open("#ROSBAG V1.2\n"); }, ThrowsSaying<InputError>({"rosbag filter"}));
  const std::string fields = Ros1Bytes::field("index_pos", Ros1Bytes::number(std::uint64_t{0})) +
                             Ros1Bytes::field("encryptor", "rosbag/AesCbcEncryptor");
  EXPECT_THAT([&] { (void)open("#ROSBAG V2.0\n" + Ros1Bytes::record(3, fields, "")); },
              ThrowsSaying<InputError>({"rosbag decrypt"}));
  // A chunk of 2 GB in some bytes.
  Ros1Bytes bomb;
  bomb.add(Ros1Bytes::chunk_head("lz4", 2'000'000'000, 20) + std::string(20, 'x'));
  const auto bag = open(bomb.finished("", 0));
  EXPECT_THAT(visit(*bag).heads, IsEmpty());
  const std::string far = "#ROSBAG V2.0\n" + std::string(4, '\xff') + std::string(100, 'x');
  EXPECT_THAT(visit(*open(far)).damage.first, HasSubstr("a header of 4294967295 bytes"));
}

}  // namespace ros1_bag_test
}  // namespace stillmap::maps::ros1
