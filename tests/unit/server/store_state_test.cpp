#include "store/store_state.hpp"

#include <stillmap/maps/error.hpp>

#include <sqlite3.h>

#include <algorithm>
#include <functional>
#include <string>
#include <vector>

#include "support/disk_calls.hpp"
#include "support/states.hpp"
#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::server {
namespace store_state_test {

using ::stillmap::test::FailingCalls;
using ::stillmap::test::Fault;
using ::stillmap::test::RecordingCalls;
using ::stillmap::test::TemporaryFolder;
using ::stillmap::test::ThrowsSaying;
using ::stillmap::test::UnsyncedCalls;
using ::testing::ElementsAre;
using ::testing::IsEmpty;
using Kind = DiskCall::Kind;
using Reason = StoreRefusal::Reason;

StoredVersion version(const std::string& name, char digit, std::int64_t created_ns = 1) {
  return {name, std::string(64, digit), 100, created_ns};
}

/// `change` is refused for this reason.
void expect_refused(Reason reason, const std::function<void()>& change) {
  EXPECT_THAT(change,
              ::testing::Throws<StoreRefusal>(::testing::Property(&StoreRefusal::reason, reason)));
}

void run_sql(const std::filesystem::path& file, const std::string& sql) {
  sqlite3* database = nullptr;
  ASSERT_EQ(sqlite3_open(file.c_str(), &database), SQLITE_OK);
  EXPECT_EQ(sqlite3_exec(database, sql.c_str(), nullptr, nullptr, nullptr), SQLITE_OK);
  sqlite3_close(database);
}

class StoreStateTest : public ::testing::Test {
 protected:
  TemporaryFolder folder_;
  UnsyncedCalls unsynced_;
  std::filesystem::path file_ = folder_.path() / "state.db";
};

TEST_F(StoreStateTest, CountsFilesThatVersionsShareOnce) {
  StoreState state = test::state_at(file_, unsynced_);
  const std::string shared(64, 'a'), own_1(64, 'b'), own_2(64, 'c');
  StoredVersion one = version("1", '1'), two = version("2", '2');
  one.bytes = two.bytes = 110;
  one.files = {{shared, 100}, {own_1, 10}};
  two.files = {{shared, 100}, {own_2, 10}};
  EXPECT_TRUE(state.add_version("town", one));
  EXPECT_EQ(state.bytes(), 110U);
  expect_refused(Reason::kOverQuota,
                 [&] { state.add_version("town", two, {.map_bytes = 119, .store_bytes = {}}); });
  EXPECT_TRUE(state.add_version("town", two, {.map_bytes = 120, .store_bytes = 120}));
  EXPECT_EQ(state.bytes_of_map("town"), 120U);
  // Maps share packages alone: the second one has a copy of the file.
  StoredVersion other = version("1", '3');
  other.bytes = 105;
  other.files = {{shared, 100}, {std::string(64, 'd'), 5}};
  expect_refused(Reason::kOverQuota,
                 [&] { state.add_version("depot", other, {.map_bytes = {}, .store_bytes = 224}); });
  EXPECT_TRUE(state.add_version("depot", other, {.map_bytes = {}, .store_bytes = 225}));
  one.name = "2";
  EXPECT_TRUE(state.add_version("depot", one, {.map_bytes = {}, .store_bytes = 225}));
  EXPECT_EQ(state.bytes(), 225U);
  state.remove_version("town", "1");
  EXPECT_EQ(state.bytes_of_map("town"), 110U);
  EXPECT_EQ(state.bytes(), 110U + 115U);
}

TEST_F(StoreStateTest, TellsWhichVersionWasActiveAtATime) {
  StoreState state = test::state_at(file_, unsynced_);
  for (const char name : {'1', '2', '3'}) state.add_version("town", version({name}, name));
  state.activate("town", "1", {}, 100);
  state.activate("town", "2", {}, 200);
  state.roll_back("town", {}, 300);
  // A clock that was set back: later is what came later.
  state.activate("town", "3", {}, 250);
  expect_refused(Reason::kUnknownVersion, [&] { (void)state.active_at("town", 99); });
  EXPECT_EQ(state.active_at("town", 100), "1");
  EXPECT_EQ(state.active_at("town", 199), "1");
  EXPECT_EQ(state.active_at("town", 200), "2");
  EXPECT_EQ(state.active_at("town", 260), "3");
  state.remove_version("town", "2");
  EXPECT_EQ(state.active_at("town", 200), "2") << "though it is gone";
  expect_refused(Reason::kUnknownMap, [&] { (void)state.active_at("depot", 100); });
  state.remove_map("town", WhenActive::kRemove);
  state.add_version("town", version("1", '1'));
  expect_refused(Reason::kUnknownVersion, [&] { (void)state.active_at("town", 260); });
}

TEST_F(StoreStateTest, KeepsEverythingAcrossOpening) {
  {
    StoreState state = test::state_at(file_, unsynced_);
    EXPECT_TRUE(state.add_version("town", version("b", '1', 5)));
    EXPECT_TRUE(state.add_version("town", version("a", '2', 6)));
    EXPECT_TRUE(state.add_version("depot", version("a", '1', 7)));
    state.activate("town", "b");
    EXPECT_EQ(state.activate("town", "a").revision, 2);
  }
  const StoreState state = test::state_at(file_, unsynced_);
  EXPECT_THAT(state.maps(),
              ElementsAre(StoredMap{"depot", {}, {}, 0, 7}, StoredMap{"town", "a", "b", 2, 5}));
  EXPECT_THAT(state.versions("town"), ElementsAre(version("b", '1', 5), version("a", '2', 6)));
  EXPECT_EQ(state.version("depot", "a"), version("a", '1', 7));
  EXPECT_TRUE(state.uses(std::string(64, '1')));
  EXPECT_FALSE(state.uses(std::string(64, '3')));
  EXPECT_THAT(state.problems(), IsEmpty());
}

TEST_F(StoreStateTest, AddsTheSameVersionOnceAndRefusesAnotherDigest) {
  StoreState state = test::state_at(file_, unsynced_);
  EXPECT_TRUE(state.add_version("town", version("a", '1')));
  EXPECT_FALSE(state.add_version("town", version("a", '1', 9)));
  expect_refused(Reason::kOtherDigest, [&] { state.add_version("town", version("a", '2')); });
  EXPECT_THAT(state.versions("town"), ElementsAre(version("a", '1')));
}

TEST_F(StoreStateTest, NameOfARemovedVersionIsGoodForTheSamePackageOnly) {
  StoreState state = test::state_at(file_, unsynced_);
  state.add_version("town", version("a", '1'));
  state.remove_version("town", "a");
  expect_refused(Reason::kOtherDigest, [&] { state.add_version("town", version("a", '2')); });
  EXPECT_TRUE(state.add_version("town", version("a", '1')));
  state.remove_map("town");
  expect_refused(Reason::kOtherDigest, [&] { state.add_version("town", version("a", '2')); });
  EXPECT_TRUE(state.add_version("depot", version("a", '2')));
}

TEST_F(StoreStateTest, RefusesWhatIsNotThere) {
  StoreState state = test::state_at(file_, unsynced_);
  expect_refused(Reason::kUnknownMap, [&] { state.activate("town", "a"); });
  expect_refused(Reason::kUnknownMap, [&] { (void)state.versions("town"); });
  state.add_version("town", version("a", '1'));
  expect_refused(Reason::kUnknownVersion, [&] { state.activate("town", "b"); });
  expect_refused(Reason::kUnknownVersion, [&] { (void)state.version("town", "b"); });
  expect_refused(Reason::kUnknownVersion, [&] { state.remove_version("town", "b"); });
  expect_refused(Reason::kNoPrevious, [&] { state.roll_back("town"); });
}

TEST_F(StoreStateTest, ChangesOnlyTheRevisionThatTheCallerSaw) {
  StoreState state = test::state_at(file_, unsynced_);
  state.add_version("town", version("a", '1'));
  state.add_version("town", version("b", '2'));
  EXPECT_EQ(state.activate("town", "a", 0).revision, 1);
  expect_refused(Reason::kOtherRevision, [&] { state.activate("town", "b", 0); });
  EXPECT_EQ(state.activate("town", "a", 1).revision, 1) << "nothing changes";
  EXPECT_EQ(state.activate("town", "b", 1).revision, 2);
  expect_refused(Reason::kOtherRevision, [&] { state.roll_back("town", 1); });
  const StoredMap back = state.roll_back("town", 2);
  EXPECT_EQ(back.active, "a");
  EXPECT_EQ(back.previous, "b");
  EXPECT_EQ(back.revision, 3);
  EXPECT_EQ(state.roll_back("town").active, "b");
}

TEST_F(StoreStateTest, CondemnsAPackageWithItsLastVersion) {
  StoreState state = test::state_at(file_, unsynced_);
  state.add_version("town", version("a", '1'));
  state.add_version("town", version("same", '1'));
  state.add_version("town", version("b", '2'));
  state.activate("town", "a");
  state.activate("town", "b");
  expect_refused(Reason::kActive, [&] { state.remove_version("town", "b"); });
  state.remove_version("town", "a");
  EXPECT_THAT(state.condemned(), IsEmpty());
  EXPECT_EQ(state.map("town").previous, std::nullopt);
  state.remove_version("town", "same");
  EXPECT_THAT(state.condemned(), ElementsAre(std::string(64, '1')));
  state.add_version("depot", version("again", '1'));
  EXPECT_THAT(state.condemned(), IsEmpty());
  state.remove_version("depot", "again");
  state.forget_condemned(std::string(64, '1'));
  EXPECT_THAT(state.condemned(), IsEmpty());
}

TEST_F(StoreStateTest, RefusesANewerSchemaAndForeignDatabases) {
  if (test::states_are_in_postgres()) GTEST_SKIP() << "PostgresStateTest has its own";
  { const StoreState state = test::state_at(file_, unsynced_); }
  run_sql(file_, "PRAGMA user_version=99");
  EXPECT_THAT([&] { StoreState state = test::state_at(file_, unsynced_); },
              ThrowsSaying<maps::InputError>({"state.db", "schema version 99", "newer stillmap"}));
  const std::filesystem::path other = folder_.path() / "other.db";
  run_sql(other, "CREATE TABLE maps (name TEXT)");
  EXPECT_THAT([&] { StoreState state(other, unsynced_); },
              ThrowsSaying<maps::InputError>({"something else"}));
  folder_.write("text.db", std::string(4096, 'x'));
  EXPECT_THAT([&] { StoreState state(folder_.path() / "text.db", unsynced_); },
              ThrowsSaying<maps::StorageError>({"text.db", "not a database"}));
}

TEST_F(StoreStateTest, SyncsBeforeItAnswers) {
  RecordingCalls calls;
  StoreState state(file_, calls);
  for (int change = 0; change < 3; ++change) {
    const std::size_t before = calls.calls().size();
    state.add_version("town", version("v" + std::to_string(change), '1'));
    std::vector<Kind> kinds;
    for (std::size_t i = before; i < calls.calls().size(); ++i) {
      EXPECT_EQ(calls.calls()[i].path, file_.string() + "-wal");
      kinds.push_back(calls.calls()[i].kind);
    }
    // The rest of the sector that the commit ends in may follow.
    EXPECT_EQ(std::count(kinds.begin(), kinds.end(), Kind::kSyncFile), 1) << change;
    EXPECT_EQ(kinds.front(), Kind::kWrite) << change;
  }
}

TEST_F(StoreStateTest, SeesWhatAnotherOneCommitted) {
  StoreState first = test::state_at(file_, unsynced_);
  StoreState second = test::state_at(file_, unsynced_);
  first.add_version("town", version("a", '1'));
  EXPECT_EQ(second.activate("town", "a").revision, 1);
  EXPECT_EQ(first.map("town").active, "a");
}

TEST_F(StoreStateTest, LosesNothingWhenAnyCallFails) {
  for (const Fault fault : {Fault::kNoSpace, Fault::kInputOutput, Fault::kShortWrite}) {
    bool failed = true;
    for (std::size_t at = 0; failed; ++at) {
      const TemporaryFolder folder;
      const std::filesystem::path file = folder.path() / "state.db";
      FailingCalls calls(fault, [&](std::size_t n, const auto&) { return n == at; });
      int acknowledged = 0;
      try {
        StoreState state(file, calls);
        for (int change = 0; change < 3; ++change) {
          state.add_version("town", version("v" + std::to_string(change), '1', change));
          acknowledged = change + 1;
        }
      } catch (const maps::StorageError&) {
      }
      failed = calls.failed() > 0;
      StoreState after(file, unsynced_);
      EXPECT_THAT(after.problems(), IsEmpty());
      const std::size_t kept = after.maps().empty() ? 0 : after.versions("town").size();
      EXPECT_GE(kept, static_cast<std::size_t>(acknowledged)) << at;
      EXPECT_LE(kept, static_cast<std::size_t>(acknowledged) + 1) << at;
      EXPECT_TRUE(after.add_version("town", version("later", '2', 9)));
    }
  }
}

TEST_F(StoreStateTest, WritesNothingMoreAfterAFailedSync) {
  bool armed = false;
  FailingCalls calls(Fault::kInputOutput, [&](std::size_t, const DiskCall& call) {
    return armed && call.kind == Kind::kSyncFile;
  });
  StoreState state(file_, calls);
  armed = true;
  EXPECT_THAT([&] { state.add_version("town", version("a", '1')); },
              ThrowsSaying<maps::StorageError>({"state.db", "Input/output error"}));
  armed = false;
  EXPECT_THAT([&] { state.add_version("town", version("a", '1')); },
              ThrowsSaying<maps::StorageError>({"sync failed", "open the store again"}));
}

}  // namespace store_state_test
}  // namespace stillmap::server
