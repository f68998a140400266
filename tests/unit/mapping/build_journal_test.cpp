#include "pipeline/build_journal.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/maps/error.hpp>

#include <fstream>
#include <iterator>
#include <stdexcept>

#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::mapping {
namespace build_journal_test {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

const std::string kKey = "version: 1\ndetector: geometric\nvoxel: 0.1\n";

class Journal : public ::testing::Test {
 protected:
  [[nodiscard]] BuildJournal open(const std::string& key = kKey,
                                  const std::string& stage = "survey") const {
    return {folder_.path() / "journal", stage, key};
  }
  [[nodiscard]] std::filesystem::path file() const {
    return folder_.path() / "journal/survey.journal";
  }
  [[nodiscard]] std::string bytes() const {
    std::ifstream in(file(), std::ios::binary);
    return {std::istreambuf_iterator<char>(in), {}};
  }
  void write(const std::string& bytes) const {
    std::filesystem::create_directories(file().parent_path());
    std::ofstream(file(), std::ios::binary) << bytes;
  }
  /// @return the file's bytes with some records in it, the last one of none.
  [[nodiscard]] std::string three_records() const {
    BuildJournal journal = open();
    for (const char* record : {"one", "second", ""}) journal.append(record);
    return bytes();
  }
  static std::vector<std::string> records_of(BuildJournal& journal) {
    std::vector<std::string> records;
    (void)journal.replay([&](std::string_view bytes) {
      records.emplace_back(bytes);
      return true;
    });
    return records;
  }

  test::TemporaryFolder folder_;
};

TEST_F(Journal, GivesBackWhatWasAppendedInOrder) {
  (void)three_records();
  BuildJournal journal = open();
  EXPECT_EQ(journal.size(), 3U);
  EXPECT_FALSE(journal.is_complete());
  EXPECT_THAT(journal.discarded(), IsEmpty());
  EXPECT_THAT(records_of(journal), ElementsAre("one", "second", ""));
  EXPECT_EQ(journal.read(1), "second");
  EXPECT_THROW((void)journal.read(3), std::out_of_range);
}

TEST_F(Journal, GoesOnBehindWhatItFound) {
  (void)three_records();
  open().append("four");
  BuildJournal journal = open();
  EXPECT_THAT(records_of(journal), ElementsAre("one", "second", "", "four"));
}

TEST_F(Journal, KnowsThatAllIsThere) {
  (void)three_records();
  open().complete();
  BuildJournal journal = open();
  EXPECT_TRUE(journal.is_complete());
  EXPECT_EQ(journal.size(), 3U);
  EXPECT_THROW(journal.append("more"), std::logic_error);
  journal.keep(2);
  EXPECT_FALSE(journal.is_complete());
  journal.append("other");
  BuildJournal again = open();
  EXPECT_THAT(records_of(again), ElementsAre("one", "second", "other"));
}

TEST_F(Journal, ThrowsAwayWhatHasAnotherKeyAndSaysWhere) {
  (void)three_records();
  {
    const BuildJournal other = open("version: 1\ndetector: voxelnext\nvoxel: 0.1\n");
    EXPECT_EQ(other.size(), 0U);
    EXPECT_THAT(other.discarded(), HasSubstr("'detector: geometric', expected 'detector: voxel"));
  }
  EXPECT_EQ(open().size(), 0U);
}

TEST_F(Journal, TellsKeysApartOfWhichOneBeginsTheOther) {
  (void)three_records();
  EXPECT_THAT(open(kKey + "more: 1\n").discarded(), HasSubstr("more: 1"));
}

TEST_F(Journal, ThatIsReadStaysAsItIs) {
  const auto read = [&](const std::string& key) {
    return std::make_unique<BuildJournal>(folder_.path() / "journal", "survey", key,
                                          BuildJournal::Use::kRead);
  };
  EXPECT_EQ(read(kKey)->discarded(), "it is not there");
  EXPECT_FALSE(std::filesystem::exists(file()));
  (void)three_records();
  EXPECT_EQ(read(kKey)->discarded(), "it is not complete");
  EXPECT_THAT([&] { read(kKey)->require_complete("survey:1"); },
              test::ThrowsSaying<maps::InputError>({file().string(), "--unit survey:1"}));
  open().complete();
  const std::string whole = bytes();
  const auto journal = read(kKey);
  EXPECT_TRUE(journal->is_complete());
  EXPECT_EQ(journal->require(1, "survey:1"), "second");
  EXPECT_THAT([&] { (void)journal->require(3, "survey:1"); },
              test::ThrowsSaying<maps::InputError>({"record 3", "--unit survey:1 again"}));
  EXPECT_EQ(read(kKey)->sum(), journal->sum());
  EXPECT_THAT(read("version: 2\n")->discarded(), HasSubstr("version: 2"));
  EXPECT_EQ(bytes(), whole);
}

TEST_F(Journal, ThatIsContinuedIsNeverReplacedByAnotherKey) {
  (void)three_records();
  const std::string before = bytes();
  EXPECT_THAT(
      [&] {
        BuildJournal(folder_.path() / "journal", "survey", "version: 2\n",
                     BuildJournal::Use::kContinue);
      },
      test::ThrowsSaying<maps::InputError>({"another build", "version: 2", "remove"}));
  EXPECT_EQ(bytes(), before);
  EXPECT_EQ(
      BuildJournal(folder_.path() / "journal", "survey", kKey, BuildJournal::Use::kContinue).size(),
      3U);
}

TEST_F(Journal, KeepsStagesApart) {
  (void)three_records();
  EXPECT_EQ(open(kKey, "trajectory").size(), 0U);
  std::filesystem::copy_file(file(), folder_.path() / "journal/odometry.journal");
  BuildJournal copied = open(kKey, "odometry");
  EXPECT_THAT(records_of(copied), IsEmpty());
}

TEST_F(Journal, CutsATornEndAtEveryLength) {
  const std::string whole = three_records();
  const std::vector<std::string> all = {"one", "second", ""};
  for (std::size_t length = 0; length < whole.size(); ++length) {
    write(whole.substr(0, length));
    {
      BuildJournal journal = open();
      const std::vector<std::string> records = records_of(journal);
      ASSERT_LT(records.size(), 3U) << length;
      ASSERT_TRUE(std::equal(records.begin(), records.end(), all.begin())) << length;
      for (std::size_t i = records.size(); i < 3; ++i) journal.append(all[i]);
    }
    ASSERT_EQ(bytes(), whole) << length;
  }
}

TEST_F(Journal, GivesNothingBehindAChangedByte) {
  const std::string whole = three_records();
  const std::size_t head = 72 + kKey.size();
  for (std::size_t at = 0; at < whole.size(); ++at) {
    std::string changed = whole;
    changed[at] = static_cast<char>(changed[at] ^ 0x21);
    write(changed);
    BuildJournal journal = open();
    const std::size_t most = at < head ? 0 : at < head + 75 ? 0 : at < head + 75 + 78 ? 1 : 2;
    ASSERT_EQ(records_of(journal).size(), most) << at;
    ASSERT_EQ(journal.size(), most) << at;
    ASSERT_EQ(journal.discarded().empty(), at >= head) << at;
  }
}

TEST_F(Journal, TakesZerosOfAPowerCutForNoRecords) {
  const std::string whole = three_records();
  write(whole + std::string(1000, '\0'));
  EXPECT_EQ(open().size(), 3U);
  EXPECT_EQ(bytes(), whole);
  write(std::string(1000, '\0'));
  EXPECT_THAT(open().discarded(), HasSubstr("damaged"));
}

TEST_F(Journal, RefusesSizesThatNoFileHas) {
  const std::string whole = three_records();
  for (const int high : {0x7F, 0x80, 0xFF}) {
    std::string changed = whole;
    changed[72 + kKey.size() + 7] = static_cast<char>(high);
    write(changed);
    EXPECT_EQ(open().size(), 0U);
    changed = whole;
    changed[7] = static_cast<char>(high);
    write(changed);
    EXPECT_EQ(open().size(), 0U);
  }
}

TEST_F(Journal, TakesNoRecordFromAnotherPlace) {
  {
    BuildJournal journal = open();
    for (const char* record : {"aaa", "bbb", "ccc"}) journal.append(record);
  }
  std::string swapped = bytes();
  const std::size_t first = 72 + kKey.size();
  for (std::size_t i = 0; i < 75; ++i) std::swap(swapped[first + i], swapped[first + 75 + i]);
  write(swapped);
  BuildJournal journal = open();
  EXPECT_THAT(records_of(journal), IsEmpty());
}

TEST_F(Journal, ForgetsFromARefusedRecordOn) {
  (void)three_records();
  BuildJournal journal = open();
  EXPECT_EQ(journal.replay([](std::string_view bytes) { return bytes != "second"; }), 1U);
  journal.append("other");
  BuildJournal again = open();
  EXPECT_THAT(records_of(again), ElementsAre("one", "other"));
}

TEST_F(Journal, SaysWhyItWasDiscarded) {
  (void)three_records();
  BuildJournal journal = open();
  journal.discard("000017.bin has changed");
  EXPECT_EQ(journal.size(), 0U);
  EXPECT_EQ(journal.discarded(), "000017.bin has changed");
  journal.append("new");
  BuildJournal again = open();
  EXPECT_THAT(records_of(again), ElementsAre("new"));
}

TEST_F(Journal, NamesAFolderThatCannotBeMade) {
  folder_.write("journal", "a file");
  EXPECT_THAT([&] { (void)open(); }, test::ThrowsSaying<maps::StorageError>({"journal"}));
}

}  // namespace build_journal_test
}  // namespace stillmap::mapping
