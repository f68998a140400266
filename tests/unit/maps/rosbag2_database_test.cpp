#include "bags/rosbag2_database.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/maps/error.hpp>

#include <fstream>

#include "bag_contents.hpp"
#include "support/bag_bytes.hpp"
#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::maps {
namespace rosbag2_database_test {

using test::contents;
using test::SqliteFile;
using test::ThrowsSaying;
using test::visit;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

class Rosbag2DatabaseTest : public ::testing::Test {
 protected:
  [[nodiscard]] std::unique_ptr<Rosbag2Database> open() const {
    return std::make_unique<Rosbag2Database>(file_);
  }
  static void fill(SqliteFile& bag) {
    bag.topic(1, "/a", "std_msgs/msg/String").topic(7, "/b", "std_msgs/msg/String");
    bag.message(1, "a1").message(7, "b1 long").message(1, "a2");
  }
  void expect_refused(const std::vector<std::string>& texts) const {
    EXPECT_THAT([&] { (void)visit(*open()); }, ThrowsSaying<InputError>(texts));
  }
  test::TemporaryFolder folder_{test::memory_folder()};
  std::filesystem::path file_ = folder_.path() / "a b?c#d%e.db3";
};

TEST_F(Rosbag2DatabaseTest, ReadsEverySchema) {
  for (int schema = 1; schema <= 4; ++schema) {
    SCOPED_TRACE(schema);
    std::filesystem::remove(file_);
    {
      SqliteFile bag(file_);
      bag.make_tables(schema);
      fill(bag);
    }
    const auto bag = open();
    ASSERT_EQ(bag->topics().size(), 2U);
    EXPECT_EQ(bag->topics()[1].name, "/b");
    EXPECT_EQ(bag->topics()[1].type, "std_msgs/msg/String");
    EXPECT_EQ(bag->topics()[1].serialization, Serialization::kCdr);
    EXPECT_THAT(visit(*bag, 2).heads, ElementsAre("/a a1", "/b b1", "/a a2"));
    EXPECT_THAT(visit(*bag, 9, "/b").heads, ElementsAre("/b b1 long"));
    EXPECT_THAT(contents(*bag), ElementsAre("a1", "b1 long", "a2"));
    EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder_.path()), {}), 1);
  }
}

TEST_F(Rosbag2DatabaseTest, ReadsTheLogOfAKilledRecorder) {
  SqliteFile recorder(file_);
  recorder.run("PRAGMA journal_mode=WAL").make_tables();
  fill(recorder);
  // As after a kill: the log is there, and nobody has the file open.
  const std::filesystem::path copy = folder_.path() / "copy.db3";
  std::filesystem::copy_file(file_, copy);
  std::filesystem::copy_file(file_.string() + "-wal", copy.string() + "-wal");
  const Rosbag2Database bag(copy);
  EXPECT_THAT(contents(bag), ElementsAre("a1", "b1 long", "a2"));
  EXPECT_THAT(bag.notes(), ElementsAre(HasSubstr("copy.db3-wal")));
  EXPECT_FALSE(std::filesystem::exists(copy.string() + "-shm"));
}

TEST_F(Rosbag2DatabaseTest, UnpacksMessagesOneByOne) {
  const std::string text = "a long text " + std::string(100'000, 'x') + " and its end";
  {
    SqliteFile bag(file_);
    bag.make_tables().topic(1, "/a", "std_msgs/msg/String");
    bag.message(1, test::packed(text, "zstd")).message(1, "plain");
    bag.message(1, test::packed(text, "zstd").substr(0, 20));
  }
  const auto bag = open();
  const auto all = visit(*bag, 6);
  EXPECT_THAT(all.heads, ElementsAre("/a a long", "/a plain", "/a "));
  EXPECT_EQ(test::text_of(bag->read(all.places[0]).span()), text);
}

TEST_F(Rosbag2DatabaseTest, RefusesOtherDatabasesAndLaterSchemas) {
  SqliteFile(file_).run("CREATE TABLE cats (name TEXT)");
  expect_refused({"without tables topics and messages"});
  SqliteFile(file_).make_tables().run("UPDATE schema SET schema_version = 5");
  expect_refused({"schema 5", "1 to 4"});
}

TEST_F(Rosbag2DatabaseTest, RunsNothingOfTheFile) {
  const std::string rows =
      "WITH RECURSIVE n(i) AS (VALUES(1) UNION ALL SELECT i + 1 FROM n) SELECT ";
  SqliteFile(file_)
      .run(
          "CREATE TABLE topics (id INTEGER PRIMARY KEY, name, type, "
          "serialization_format)")
      .run("CREATE VIEW messages AS " + rows + "i AS id, 1 AS topic_id, 'x' AS data FROM n");
  expect_refused({"without tables topics and messages"});
  std::filesystem::remove(file_);
  SqliteFile(file_)
      .run(
          "CREATE TABLE real (id INTEGER PRIMARY KEY, name, type, "
          "serialization_format)")
      .run("CREATE VIRTUAL TABLE messages USING fts5(topic_id, timestamp, data)")
      .run("CREATE TABLE topics (id INTEGER PRIMARY KEY, name, type, serialization_format)");
  expect_refused({"without tables topics and messages"});
  std::filesystem::remove(file_);
  SqliteFile(file_)
      .run("CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id, data)")
      .run(
          "CREATE TABLE topics (id INTEGER PRIMARY KEY, name, type, serialization_format AS "
          "(hex(zeroblob(1000))))")
      .run("INSERT INTO topics (name, type) VALUES ('/a', 'b')");
  expect_refused({"columns of 'topics' that are computed"});
}

std::string big_endian(std::uint64_t value, int bytes) {
  std::string text;
  for (int i = bytes - 1; i >= 0; --i) text += static_cast<char>(value >> (8 * i) & 0xFFU);
  return text;
}

/// An interior page of a table (SQLite file format, 1.6), all of whose 70 cells point to one page.
std::string page_of_one_child(std::size_t child) {
  constexpr std::size_t kCells = 70;
  const std::string cell = big_endian(child, 4) + "\x04";
  std::string page = "\x05" + big_endian(0, 2) + big_endian(kCells, 2) +
                     big_endian(512 - kCells * cell.size(), 2) + '\0' + big_endian(child, 4);
  for (std::size_t i = 0; i < kCells; ++i) page += big_endian(512 - (i + 1) * cell.size(), 2);
  page.resize(512 - kCells * cell.size());
  for (std::size_t i = 0; i < kCells; ++i) page += cell;
  return page;
}

TEST_F(Rosbag2DatabaseTest, EndsInATreeOfMoreRowsThanBytes) {
  {
    SqliteFile bag(file_);
    bag.run("PRAGMA page_size=512").make_tables();
    fill(bag);
  }
  std::ifstream stream(file_, std::ios::binary);
  std::string bytes{std::istreambuf_iterator<char>(stream), {}};
  const std::size_t schema = bytes.find("jazzy", 512) / 512;
  ASSERT_LT(schema, bytes.size() / 512);
  // Its page moves to the end; seven levels above it, of which each has 71 ways to the next.
  bytes += bytes.substr(512 * schema, 512);
  for (int level = 0; level < 6; ++level) bytes += page_of_one_child(bytes.size() / 512);
  bytes.replace(512 * schema, 512, page_of_one_child(bytes.size() / 512));
  bytes.replace(28, 4, big_endian(bytes.size() / 512, 4));
  std::ofstream(file_, std::ios::binary) << bytes;
  expect_refused({"a broken database: interrupted"});
}

TEST_F(Rosbag2DatabaseTest, CountsRowsOfAnotherKind) {
  {
    SqliteFile bag(file_);
    bag.make_tables();
    fill(bag);
    bag.run("INSERT INTO messages (topic_id, timestamp, data) VALUES (1, 9, 12)");
    bag.run("INSERT INTO messages (topic_id, timestamp, data) VALUES (99, 9, x'00')")
        .message(1, "a3");
  }
  const auto all = visit(*open());
  EXPECT_THAT(all.heads, ElementsAre("/a a1", "/b b1 long", "/a a2", "/a a3"));
  EXPECT_EQ(all.damage.parts, 1U);
  EXPECT_THAT(all.damage.first, HasSubstr("row 4"));
}

TEST_F(Rosbag2DatabaseTest, RefusesOrReadsWhatIsThereOfACutFile) {
  std::string whole;
  {
    SqliteFile bag(file_);
    bag.run("PRAGMA page_size=512").make_tables();
    fill(bag);
    for (int i = 0; i < 40; ++i) bag.message(1, std::string(700, 'm'));
  }
  std::ifstream stream(file_, std::ios::binary);
  whole.assign(std::istreambuf_iterator<char>(stream), {});
  std::size_t read_some = 0;
  std::size_t most = 0;
  for (std::size_t size = 16; size < whole.size(); size += 61) {
    SCOPED_TRACE(size);
    std::ofstream(file_, std::ios::binary) << whole.substr(0, size);
    try {
      const auto bag = open();
      const auto all = visit(*bag);
      EXPECT_THAT(bag->notes(), ElementsAre(HasSubstr("cut off: " + std::to_string(size))));
      EXPECT_GE(all.heads.size(), most);
      EXPECT_TRUE(all.damage.parts > 0 || all.heads.size() == 43U);
      most = all.heads.size();
      read_some += all.heads.empty() ? 0 : 1;
      for (const MessagePlace& place : all.places) (void)bag->read(place);
    } catch (const InputError& error) {
      EXPECT_THAT(error.what(), HasSubstr("d%e.db3"));
    }
  }
  EXPECT_GT(read_some, 100U);
}

}  // namespace rosbag2_database_test
}  // namespace stillmap::maps
