#include "bags/mcap_bag.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/maps/error.hpp>

#include "bag_contents.hpp"
#include "support/bag_bytes.hpp"
#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::maps::mcap {
namespace mcap_bag_test {

using test::contents;
using test::McapBytes;
using test::ThrowsSaying;
using test::visit;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

std::string channels() {
  return McapBytes::schema(1, "std_msgs/msg/String") + McapBytes::channel(1, 1, "/a") +
         McapBytes::channel(2, 1, "/b") + McapBytes::channel(3, 0, "/c", "json");
}

/// Two chunks: a1 b1 a2, and b2 b3.
McapBytes two_chunks(const std::string& compression) {
  McapBytes mcap;
  mcap.add_chunk(channels() + McapBytes::message(1, "a1") + McapBytes::message(2, "b1 long") +
                     McapBytes::message(1, "a2"),
                 compression, {1, 2});
  mcap.add_chunk(McapBytes::message(2, "b2") + McapBytes::message(2, "b3"), compression, {2});
  return mcap;
}

class McapBagTest : public ::testing::Test {
 protected:
  [[nodiscard]] std::unique_ptr<McapBag> open(const std::string& bytes) const {
    return std::make_unique<McapBag>(folder_.write("bag.mcap", bytes));
  }
  test::TemporaryFolder folder_{test::memory_folder()};
};

TEST_F(McapBagTest, ReadsChunksOfEveryCompressionWithAndWithoutIndex) {
  for (const std::string compression : {"", "lz4", "zstd"}) {
    for (const bool indexed : {true, false}) {
      SCOPED_TRACE(compression + (indexed ? " indexed" : ""));
      const auto bag = open(two_chunks(compression).finished(indexed ? channels() : ""));
      EXPECT_EQ(bag->is_indexed(), indexed);
      EXPECT_THAT(bag->notes(), IsEmpty());
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

TEST_F(McapBagTest, TellsTopicsWithTypesAndSerialization) {
  const auto bag = open(two_chunks("lz4").finished());
  ASSERT_EQ(bag->topics().size(), 3U);
  EXPECT_EQ(bag->topics()[0].name, "/a");
  EXPECT_EQ(bag->topics()[0].type, "std_msgs/msg/String");
  EXPECT_EQ(bag->topics()[0].serialization, Serialization::kCdr);
  EXPECT_EQ(bag->topics()[2].type, "");
  EXPECT_EQ(bag->topics()[2].serialization, Serialization::kOther);
}

TEST_F(McapBagTest, JoinsChannelsOfOneTopic) {
  McapBytes mcap;
  mcap.add(McapBytes::schema(1, "std_msgs/String") + McapBytes::channel(1, 1, "/a", "ros1") +
           McapBytes::channel(9, 1, "/a", "ros1"));
  mcap.add(McapBytes::message(9, "two") + McapBytes::message(1, "one"));
  const auto bag = open(mcap.finished());
  ASSERT_EQ(bag->topics().size(), 1U);
  EXPECT_EQ(bag->topics()[0].type, "std_msgs/msg/String");
  EXPECT_EQ(bag->topics()[0].serialization, Serialization::kRos1);
  EXPECT_THAT(visit(*bag).heads, ElementsAre("/a two", "/a one"));
  EXPECT_THAT(contents(*bag), ElementsAre("two", "one"));
}

TEST_F(McapBagTest, ReadsOnlyTheChunksThatTheIndexNames) {
  std::string bytes = two_chunks("").finished(channels());
  // The second chunk holds nothing of /a: what became of it does not matter to who asks for /a.
  bytes[bytes.find("b2")] = 'X';
  const auto bag = open(bytes);
  EXPECT_EQ(visit(*bag, 9, "/a").damage.parts, 0U);
}

TEST_F(McapBagTest, LeavesOutChunksWhoseCrcDoesNotFit) {
  McapBytes mcap;
  const std::string records = channels() + McapBytes::message(1, "a1");
  std::string chunk = McapBytes::chunk(records, "lz4");
  std::string other = records;
  other.back() = '9';
  // The CRC stands behind opcode, length and three numbers.
  chunk.replace(9 + 24, 4, McapBytes::chunk(other, "").substr(9 + 24, 4));
  mcap.add(chunk).add(McapBytes::chunk(McapBytes::message(1, "a2"), "lz4"));
  const auto bag = open(mcap.finished());
  const auto all = visit(*bag);
  EXPECT_THAT(all.heads, ElementsAre("/a a2"));
  EXPECT_EQ(all.damage.parts, 1U);
  EXPECT_THAT(all.damage.first, HasSubstr("CRC-32"));
}

TEST_F(McapBagTest, ChecksChunksThatAreNotPackedWhenTheyAreRead) {
  std::string bytes = two_chunks("").finished(channels());
  bytes[bytes.find("b1 long")] = 'X';
  const auto bag = open(bytes);
  const auto all = visit(*bag, 1);
  ASSERT_EQ(all.places.size(), 5U);
  EXPECT_THAT([&] { (void)bag->read(all.places[0]); },
              ThrowsSaying<InputError>({"bag.mcap", "CRC-32"}));
  EXPECT_EQ(test::text_of(bag->read(all.places[3]).span()), "b2");
}

TEST_F(McapBagTest, ReadsWithoutAnIndexThatDoesNotFit) {
  const std::string whole = two_chunks("zstd").finished(channels());
  std::string bytes = whole;
  bytes[bytes.rfind("/b")] = '/' + 1;  // in the summary
  EXPECT_THAT(open(bytes)->notes(), ElementsAre(HasSubstr("index is broken")));
  EXPECT_EQ(visit(*open(bytes)).heads.size(), 5U);
  // An index whose chunks lie over each other would have them read again and again.
  McapBytes twice = two_chunks("");
  const std::string index = McapBytes::record(
      8, std::string(16, '\0') + McapBytes::number(std::uint64_t{50}) +
             McapBytes::number(std::uint64_t{60}) + std::string(4 + 8 + 4 + 16, '\0'));
  const auto bag = open(twice.finished(channels() + index + index));
  EXPECT_FALSE(bag->is_indexed());
  EXPECT_EQ(visit(*bag).heads.size(), 5U);
}

/// @param chunks, channels  that there are, by this record.
std::string statistics(std::uint32_t chunks, std::uint32_t channels) {
  return McapBytes::record(11, McapBytes::number(std::uint64_t{5}) +
                                   McapBytes::number(std::uint16_t{1}) +
                                   McapBytes::number(channels) + std::string(4 + 4, '\0') +
                                   McapBytes::number(chunks) + std::string(8 + 8 + 4, '\0'));
}

TEST_F(McapBagTest, ReadsWithoutAnIndexThatTellsNotAll) {
  const auto expect_read = [&](const std::string& summary, bool indexed) {
    const auto bag = open(two_chunks("lz4").finished(summary));
    EXPECT_EQ(bag->is_indexed(), indexed);
    EXPECT_EQ(visit(*bag).heads.size(), 5U);
    ASSERT_EQ(bag->topics().size(), 3U);
    EXPECT_EQ(bag->topics()[1].type, "std_msgs/msg/String");
  };
  expect_read(channels() + statistics(2, 3), true);
  // A third chunk that the index does not have, and a fourth channel.
  expect_read(channels() + statistics(3, 3), false);
  expect_read(channels() + statistics(2, 4), false);
  // Channels without their schema, as where a writer repeats only them.
  expect_read(McapBytes::channel(1, 1, "/a") + McapBytes::channel(2, 1, "/b") +
                  McapBytes::channel(3, 0, "/c", "json"),
              false);
}

TEST_F(McapBagTest, ReadsWhatIsThereOfAFileCutAtEveryByte) {
  for (const std::string compression : {"", "lz4", "zstd"}) {
    const McapBytes mcap = two_chunks(compression);
    const std::string whole = mcap.finished(channels());
    std::size_t most = 0;
    for (std::size_t size = 0; size < whole.size(); ++size) {
      SCOPED_TRACE(compression + " " + std::to_string(size));
      if (size < 8) {
        EXPECT_THROW((void)open(whole.substr(0, size)), InputError);
        continue;
      }
      const auto bag = open(whole.substr(0, size));
      EXPECT_THAT(bag->notes(), ElementsAre(HasSubstr("cut off")));
      const auto all = visit(*bag);
      EXPECT_GE(all.heads.size(), most);
      EXPECT_EQ(contents(*bag).size(), all.heads.size());
      // The head of DataEnd says that the data are whole.
      EXPECT_EQ(all.damage.parts > 0, size < mcap.data().size() + kHeadBytes);
      most = std::max(most, all.heads.size());
    }
    EXPECT_EQ(most, 5U);
  }
}

TEST_F(McapBagTest, StopsAtRecordsThatGoBeyondTheirChunk) {
  std::string records = channels() + McapBytes::message(1, "a1");
  std::string longer = McapBytes::message(1, "a2");
  longer[1] = 100;
  McapBytes mcap;
  mcap.add(McapBytes::chunk(records + longer, "zstd"));
  const auto all = visit(*open(mcap.finished()));
  EXPECT_THAT(all.heads, ElementsAre("/a a1"));
  EXPECT_THAT(all.damage.first, HasSubstr("beyond its chunk"));
}

TEST_F(McapBagTest, RefusesChunksThatGrowWithoutMeasure) {
  // 64 MiB of zeros take some kilobytes of zstd.
  McapBytes mcap;
  mcap.add(
      McapBytes::chunk(channels() + McapBytes::message(1, std::string(64U << 20U, '\0')), "zstd"));
  const auto all = visit(*open(mcap.finished()));
  EXPECT_THAT(all.heads, IsEmpty());
  EXPECT_THAT(all.damage.first, HasSubstr("1000 times"));
}

TEST_F(McapBagTest, RefusesFilesWhoseChunksTogetherGrowWithoutMeasure) {
  McapBytes mcap;
  mcap.add(McapBytes::chunk(channels() + McapBytes::message(1, "a1"), "zstd"));
  const std::string zeros =
      McapBytes::chunk(McapBytes::record(128, std::string(4U << 20U, '\0')), "zstd");
  for (int i = 0; i < 20; ++i) mcap.add(zeros);
  const auto all = visit(*open(mcap.finished()));
  EXPECT_THAT(all.heads, ElementsAre("/a a1"));
  EXPECT_EQ(all.damage.parts, 5U);
  EXPECT_THAT(all.damage.first, HasSubstr("bytes unpacked so far, expected at most 67108864"));
}

TEST_F(McapBagTest, NamesWhatItCannotRead) {
  EXPECT_THAT([&] { (void)open("MCAP"); }, ThrowsSaying<InputError>({"bag.mcap", "magic"}));
  McapBytes mcap;
  mcap.add(McapBytes::chunk(channels() + McapBytes::message(1, "a1"), "zstd"));
  std::string bytes = mcap.finished();
  bytes.replace(bytes.find("zstd"), 4, "brot");
  EXPECT_THAT(visit(*open(bytes)).damage.first, HasSubstr("'brot'"));
}

}  // namespace mcap_bag_test
}  // namespace stillmap::maps::mcap
