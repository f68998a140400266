#include "store/store_upkeep.hpp"
#include "store/package_store.hpp"
#include "store/schema.hpp"

#include <stillmap/maps/derived_file.hpp>
#include <stillmap/maps/error.hpp>

#include <sqlite3.h>

#include <fstream>
#include <string>
#include <vector>

#include "support/disk_calls.hpp"
#include "support/store_refusals.hpp"
#include "support/stored_packages.hpp"
#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::server {
namespace store_upkeep_test {

namespace fs = std::filesystem;
using ::stillmap::test::expect_refused;
using ::stillmap::test::FailingCalls;
using ::stillmap::test::Fault;
using ::stillmap::test::TemporaryFolder;
using ::stillmap::test::ThrowsSaying;
using ::stillmap::test::UnsyncedCalls;
using ::stillmap::test::write_package;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using Reason = StoreRefusal::Reason;

void run_sql(const fs::path& file, const std::string& sql) {
  sqlite3* database = nullptr;
  ASSERT_EQ(sqlite3_open(file.c_str(), &database), SQLITE_OK);
  EXPECT_EQ(sqlite3_exec(database, sql.c_str(), nullptr, nullptr, nullptr), SQLITE_OK)
      << sqlite3_errmsg(database);
  sqlite3_close(database);
}

class StoreUpkeepTest : public ::testing::Test {
 protected:
  StoreUpkeepTest() { fs::create_directory(store_); }
  [[nodiscard]] fs::path source(const std::string& name) const { return folder_.path() / name; }
  [[nodiscard]] std::vector<std::string> packages() const {
    std::vector<std::string> names;
    for (const auto& entry : fs::directory_iterator(store_ / "packages"))
      names.push_back(entry.path().filename());
    return names;
  }
  [[nodiscard]] static std::vector<std::string> versions(const PackageStore& store,
                                                         const std::string& map) {
    std::vector<std::string> names;
    for (const StoredVersion& version : store.state().versions(map)) names.push_back(version.name);
    return names;
  }

  TemporaryFolder folder_;
  UnsyncedCalls calls_;
  fs::path store_ = folder_.path() / "store";
  std::string first_ = write_package(source("first"), 1);
  std::string second_ = write_package(source("second"), 2);
};

TEST_F(StoreUpkeepTest, MakesAMapWithoutVersions) {
  PackageStore store(store_, calls_);
  EXPECT_TRUE(store.create_map("town"));
  EXPECT_FALSE(store.create_map("town"));
  EXPECT_EQ(store.state().map("town").active, std::nullopt);
  EXPECT_THAT(versions(store, "town"), IsEmpty());
  EXPECT_THAT([&] { store.create_map("../town"); },
              ThrowsSaying<std::invalid_argument>({"../town"}));
  store.remove_map("town");
  expect_refused(Reason::kUnknownMap, [&] { store.remove_map("town"); });
}

TEST_F(StoreUpkeepTest, RemovesAnActiveMapOnlyWhenToldSo) {
  PackageStore store(store_, calls_);
  store.add("town", "1", source("first"));
  store.add("town", "2", source("second"));
  store.add("depot", "1", source("second"));
  store.activate("town", "1");
  store.activate("town", "2");
  expect_refused(Reason::kActive, [&] { store.remove_map("town"); });
  EXPECT_EQ(store.state().map("town").active, "2");
  store.remove_map("town", WhenActive::kRemove);
  EXPECT_THAT(store.state().maps(), ElementsAre(::testing::Field(&StoredMap::name, "depot")));
  EXPECT_THAT(packages(), ElementsAre(second_)) << "the other map holds it";
  EXPECT_THAT(store.state().condemned(), IsEmpty());
  EXPECT_THAT(verify_store(store), IsEmpty());
}

TEST_F(StoreUpkeepTest, AMapMadeAgainIsAtNoRevisionThatItWasAtBefore) {
  PackageStore store(store_, calls_);
  store.add("town", "1", source("first"));
  store.activate("town", "1");
  store.add("town", "2", source("second"));
  store.activate("town", "2");
  ASSERT_EQ(store.state().map("town").revision, 2);
  store.remove_map("town", WhenActive::kRemove);
  store.create_map("town");
  EXPECT_EQ(store.state().map("town").revision, 3);
  store.remove_map("town");
  store.add("town", "1", source("first"));
  EXPECT_EQ(store.state().map("town").revision, 4);
  expect_refused(Reason::kOtherRevision, [&] { store.activate("town", "1", 0); });
  store.create_map("depot");
  EXPECT_EQ(store.state().map("depot").revision, 0);
}

TEST_F(StoreUpkeepTest, KeepsTheNewestAndWhatMayBecomeActiveAgain) {
  PackageStore store(store_, calls_);
  for (const char* version : {"1", "2", "3", "4", "5", "6"})
    store.add("town", version, source(version[0] == '6' ? "second" : "first"));
  store.activate("town", "1");
  store.activate("town", "3");
  EXPECT_THAT(store.keep_newest("town", 2), ElementsAre("2", "4"));
  EXPECT_THAT(versions(store, "town"), ElementsAre("1", "3", "5", "6"));
  EXPECT_THAT(store.keep_newest("town", 9), IsEmpty());
  EXPECT_THAT(store.keep_newest("town", 0), ElementsAre("5", "6"));
  EXPECT_EQ(store.roll_back("town").active, "1");
  EXPECT_THAT(packages(), ElementsAre(first_));
  expect_refused(Reason::kUnknownMap, [&] { store.keep_newest("nowhere", 1); });
}

TEST_F(StoreUpkeepTest, ClearsHalvesOfDerivedFilesThatKilledWritersLeft) {
  const fs::path package = store_ / "packages" / first_;
  const fs::path dead = package / "differences" / ".0123-150.tiles.partial";
  const fs::path whole = package / "levels" / "levels.tiles";
  const fs::path foreign = package / "packs" / ".other.partial";
  const auto leave = [&] {
    for (const fs::path& file : {dead, whole, foreign}) {
      fs::create_directories(file.parent_path());
      std::ofstream(file) << "bytes";
    }
  };
  { PackageStore(store_, calls_).add("town", "1", source("first")); }
  leave();
  PackageStore store(store_, calls_);
  EXPECT_FALSE(fs::exists(dead));
  EXPECT_TRUE(fs::exists(whole));
  EXPECT_TRUE(fs::exists(foreign)) << "of the package itself nothing is touched";
  leave();
  maps::DerivedFile under_way(package / "layers" / "coverage.layer");
  EXPECT_EQ(clear_unused(store).leftovers, 1U);
  EXPECT_FALSE(fs::exists(dead));
  EXPECT_TRUE(fs::exists(package / "layers" / ".coverage.layer.partial"));
  under_way.publish();
  EXPECT_EQ(clear_unused(store).leftovers, 0U);
}

TEST_F(StoreUpkeepTest, RefusesWhatIsOverTheQuotaBeforeCopying) {
  FailingCalls watched(Fault::kInputOutput, [](std::size_t, const auto&) { return false; });
  PackageStore store(store_, watched);
  const std::uint64_t bytes = store.add("town", "1", source("first")).version.bytes;
  store.set_quota({.map_bytes = bytes, .store_bytes = 2 * bytes - 1});
  const std::size_t calls = watched.count();
  expect_refused(Reason::kOverQuota, [&] { store.add("town", "2", source("second")); });
  expect_refused(Reason::kOverQuota, [&] { store.add("depot", "2", source("second")); });
  EXPECT_EQ(watched.count(), calls) << "nothing is written";
  EXPECT_TRUE(store.add("town", "same", source("first")).is_new) << "it takes no room";
  store.set_quota({.map_bytes = bytes, .store_bytes = 2 * bytes});
  EXPECT_TRUE(store.add("depot", "2", source("second")).is_new);
  EXPECT_EQ(store.state().bytes(), 2 * bytes);
  EXPECT_EQ(store.state().bytes_of_map("town"), bytes);
  store.set_quota({.map_bytes = bytes + 10, .store_bytes = {}});
  const std::int64_t drive = store.drives().open("town", "monday", 1).id;
  store.check_quota("town", 10);
  store.drives().add_part(drive, {1, std::string(64, 'a'), 10});
  expect_refused(Reason::kOverQuota, [&] { store.check_quota("town", 1); });
  expect_refused(Reason::kOverQuota, [&] { store.check_quota("depot", UINT64_MAX); });
}

TEST_F(StoreUpkeepTest, DropsWhatWasMadeOfVersionsThatNobodyUses) {
  PackageStore store(store_, calls_);
  std::map<std::string, fs::path> index;
  for (const std::string name : {"1", "2", "3"}) {
    const std::string digest =
        store.add("town", name, source(name == "1" ? "first" : "second")).version.digest;
    index[name] = store_ / "packages" / digest / "index";
  }
  EXPECT_EQ(index["2"], index["3"]);
  for (const char* name : {"1", "2"}) {
    fs::create_directory(index[name]);
    std::ofstream(index[name] / "a.idx") << "bytes";
  }
  store.activate("town", "1");
  store.drop_derived(0);
  EXPECT_TRUE(fs::exists(index["2"])) << "it was read lately";
  store.activate("town", "3");
  store.drop_derived(INT64_MAX);
  EXPECT_TRUE(fs::exists(index["1"])) << "the one to roll back to";
  EXPECT_TRUE(fs::exists(index["2"])) << "of a version that is active by another name";
  store.activate("town", "2");
  store.activate("town", "3");
  store.drop_derived(INT64_MAX);
  EXPECT_FALSE(fs::exists(index["1"]));
  EXPECT_TRUE(fs::exists(index["2"]));
  EXPECT_THAT(verify_store(store), IsEmpty());
}

TEST_F(StoreUpkeepTest, TwoThatFitOneByOneDoNotFitTogether) {
  PackageStore store(store_, calls_);
  const std::uint64_t bytes = store.add("town", "1", source("first")).version.bytes;
  // What another one committed while this one copied.
  StoreState state(store_ / "state.db", calls_);
  expect_refused(Reason::kOverQuota, [&] {
    state.add_version("depot", {"1", second_, bytes, 1}, {.map_bytes = {}, .store_bytes = bytes});
  });
  EXPECT_EQ(state.maps().size(), 1U);
}

/// A store as version 1 of the schema left it.
TEST_F(StoreUpkeepTest, BringsAStoreOfTheFirstSchemaUpToDate) {
  std::uint64_t bytes = 0;
  {
    PackageStore store(store_, calls_);
    bytes = store.add("town", "1", source("first")).version.bytes;
    store.activate("town", "1");
  }
  const fs::path file = store_ / "state.db";
  run_sql(
      file,
      "DROP TABLE saved_edits; DROP TABLE audit; DROP TABLE audit_start; DROP TABLE job_drives;"
      "DROP TABLE drive_parts; DROP TABLE drives; DROP TABLE jobs; DROP TABLE keys;"
      "DROP TABLE retired; DROP TABLE retired_maps; DROP TABLE migrated; DROP TABLE package_files;"
      "DROP TABLE activations; DROP TABLE signatures; DROP TABLE rollouts; DROP TABLE map_sets; "
      "DROP TABLE seal_keys; PRAGMA user_version=1");
  PackageStore store(store_, calls_);
  EXPECT_EQ(store.state().map("town").active, "1");
  EXPECT_EQ(store.state().active_at("town", INT64_MAX), "1");
  EXPECT_THAT(store.state().packages_without_files(), IsEmpty());
  EXPECT_EQ(store.state().bytes(), bytes);
  EXPECT_THAT(store.keys().list(), IsEmpty());
  EXPECT_EQ(store.jobs().enqueue({.map = "town"}, 1).job.status, JobStatus::kEnqueued);
  EXPECT_THAT(verify_store(store), IsEmpty());
}

/// The same of version 3.
TEST_F(StoreUpkeepTest, BringsAStoreOfTheThirdSchemaUpToDate) {
  {
    PackageStore store(store_, calls_);
    store.add("town", "1", source("first"));
    store.jobs().enqueue({.map = "town"}, 1);
    for (const char* subject : {"a", "b", "c"}) store.audit().append({.subject = subject});
  }
  run_sql(store_ / "state.db",
          "DROP TABLE saved_edits; ALTER TABLE drives DROP COLUMN version;"
          "ALTER TABLE drives DROP COLUMN content_type;"
          "ALTER TABLE drives DROP COLUMN needs_choice;"
          "ALTER TABLE drives DROP COLUMN inspection; ALTER TABLE drives DROP COLUMN files_at;"
          "ALTER TABLE jobs DROP COLUMN files_at; ALTER TABLE jobs DROP COLUMN fraction;"
          "ALTER TABLE jobs DROP COLUMN eta_s; ALTER TABLE jobs DROP COLUMN outcome;"
          "ALTER TABLE jobs DROP COLUMN crashes; ALTER TABLE jobs DROP COLUMN activates_at;"
          "DROP TRIGGER audit_is_append_only;"
          "CREATE TRIGGER audit_is_append_only BEFORE UPDATE ON audit"
          " BEGIN SELECT RAISE(ABORT, 'the audit log is append-only'); END;"
          "DROP TABLE audit_start; ALTER TABLE audit DROP COLUMN sha256;"
          "ALTER TABLE audit DROP COLUMN source; ALTER TABLE keys DROP COLUMN maps;"
          "ALTER TABLE jobs DROP COLUMN server; ALTER TABLE jobs DROP COLUMN beat;"
          "ALTER TABLE audit DROP COLUMN server_request_id; DROP TABLE migrated; DROP TABLE "
          "package_files;"
          "DROP TABLE activations; DROP TABLE signatures; DROP TABLE rollouts; DROP TABLE "
          "seal_keys; DROP TABLE map_sets; PRAGMA "
          "user_version=3");
  PackageStore store(store_, calls_);
  EXPECT_EQ(store.jobs().count(JobStatus::kEnqueued), 1U);
  EXPECT_FALSE(store.edits().of_map("town").saved_ns);
  EXPECT_TRUE(store.drives().open_upload("town", {.version = "v"}, 1).is_upload());
  EXPECT_EQ(store.edits().save("town", "some", "", 1).text, "some");
  EXPECT_THAT(verify_store(store), IsEmpty());
  EXPECT_EQ(store.audit().append({.subject = "d"}), 4);
  EXPECT_EQ(store.audit().check().records, 4U);
  EXPECT_FALSE(store.audit().check().first_wrong_id) << "older records are chained too";
}

TEST_F(StoreUpkeepTest, RefusesToGoBackToAnOlderSchema) {
  { const PackageStore store(store_, calls_); }
  run_sql(store_ / "state.db", "PRAGMA user_version=99");
  EXPECT_THAT(
      [&] { const PackageStore store(store_, calls_); },
      ThrowsSaying<maps::InputError>(
          {"schema version 99", "at most " + std::to_string(schema_version()), "newer stillmap"}));
}

class ReadOnlyStoreTest : public StoreUpkeepTest {
 protected:
  ReadOnlyStoreTest() {
    PackageStore store(store_, calls_);
    store.add("town", "1", source("first"));
    store.activate("town", "1");
    key_ = store.keys().create("car", {.bits = 1}, {}, 1).text;
  }
  /// It serves, checks keys, and changes nothing.
  void expect_served(PackageStore& store, const std::string& why) {
    EXPECT_THAT(store.read_only_because(), HasSubstr(why));
    EXPECT_EQ(store.open("town", *store.state().map("town").active)->digest(), first_);
    EXPECT_EQ(store.keys().check(key_, 1).verdict, KeyCheck::Verdict::kGood);
    EXPECT_THAT(verify_store(store), IsEmpty());
    const auto refused = ThrowsSaying<maps::StorageError>({"for reading only"});
    EXPECT_THAT([&] { store.add("town", "2", source("second")); }, refused);
    EXPECT_THAT([&] { store.activate("town", "1", 1); }, refused);
    EXPECT_THAT([&] { store.create_map("depot"); }, refused);
    EXPECT_THAT([&] { store.remove_map("town"); }, refused);
    EXPECT_THAT([&] { clear_unused(store); }, refused);
    EXPECT_THAT([&] { store.keys().create("x", {.bits = 1}, {}, 1); }, refused);
    EXPECT_THAT([&] { store.audit().append({}); }, refused);
  }
  std::string key_;
};

TEST_F(ReadOnlyStoreTest, ServesFromADiskThatTakesNoMoreBytes) {
  for (const Fault fault : {Fault::kNoSpace, Fault::kInputOutput}) {
    FailingCalls full(fault, [](std::size_t, const DiskCall& call) {
      return call.kind != DiskCall::Kind::kMakeFolder;
    });
    PackageStore store(store_, full);
    expect_served(store, fault == Fault::kNoSpace ? "No space left" : "Input/output");
  }
}

TEST_F(ReadOnlyStoreTest, ServesWhereNotEvenTheLockCanBeTaken) {
  fs::remove(store_ / ".lock");
  fs::create_directory(store_ / ".lock");
  PackageStore store(store_, calls_);
  expect_served(store, ".lock");
}

TEST_F(ReadOnlyStoreTest, ReadsWhatIsInTheLogOnly) {
  // A killed process leaves its log behind.
  const fs::path killed = folder_.path() / "killed";
  {
    PackageStore store(store_, calls_);
    store.add("town", "2", source("second"));
    store.activate("town", "2");
    ASSERT_GT(fs::file_size(store_ / "state.db-wal"), 0U);
    fs::copy(store_, killed, fs::copy_options::recursive);
  }
  fs::remove(killed / "state.db-shm");
  fs::remove(killed / ".lock");
  fs::create_directory(killed / ".lock");
  const PackageStore store(killed, calls_);
  EXPECT_EQ(store.state().map("town").active, "2");
  EXPECT_FALSE(fs::exists(killed / "state.db-shm"));
}

TEST_F(ReadOnlyStoreTest, TellsTheFirstReasonWhereNothingCanBeRead) {
  const fs::path empty = folder_.path() / "empty";
  fs::create_directory(empty);
  FailingCalls full(Fault::kNoSpace, [](std::size_t, const auto&) { return true; });
  EXPECT_THAT([&] { const PackageStore store(empty, full); },
              ThrowsSaying<maps::StorageError>({"packages", "No space left"}));
}

}  // namespace store_upkeep_test
}  // namespace stillmap::server
