#include "store/postgres_database.hpp"

#include <stillmap/maps/error.hpp>
#include "store/package_store.hpp"
#include "store/sqlite_database.hpp"
#include "store/state_copy.hpp"
#include "store/store_state.hpp"

#include <gmock/gmock.h>

#include <atomic>
#include <chrono>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <functional>
#include <optional>
#include <string>
#include <thread>

#include "support/disk_calls.hpp"
#include "support/states.hpp"
#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::server {
namespace postgres_state_test {

using ::stillmap::test::postgres;
using ::stillmap::test::TemporaryFolder;
using ::stillmap::test::ThrowsSaying;
using ::stillmap::test::UnsyncedCalls;
using ::testing::IsEmpty;
using ::testing::Not;
using Verdict = KeyCheck::Verdict;

constexpr std::int64_t kNow = 1'000'000;

StoredVersion version(const std::string& name, char digit) {
  return {name, std::string(64, digit), 100, 1};
}

/// Within 20 s.
bool in_the_end(const std::function<bool()>& holds) {
  for (int i = 0; i < 2000; ++i) {
    if (holds()) return true;
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  return false;
}

/// A database of its own for each test.
class PostgresStateTest : public ::testing::Test {
 protected:
  void SetUp() override {
    if (!test::states_are_in_postgres())
      GTEST_SKIP() << "STILLMAP_TEST_POSTGRES names no PostgreSQL";
    static int count = 0;
    name_ = "own_" + std::to_string(++count);
    postgres().create(name_);
    address_.emplace(postgres().address(name_));
  }
  void run(const std::string& sql) { postgres().run(name_, sql); }

  TemporaryFolder folder_;
  UnsyncedCalls unsynced_;
  std::string name_;
  std::optional<PostgresAddress> address_;
};

TEST_F(PostgresStateTest, AuditCannotBeChangedEvenBySql) {
  StoreState state(*address_);
  state.audit().append({.time_ns = 1, .method = "POST"});
  EXPECT_THAT([&] { run("UPDATE stillmap.audit SET method = 'GET'"); },
              (ThrowsSaying<maps::StorageError>({"append-only"})));
}

TEST_F(PostgresStateTest, ANewerProgramSaysWhichOlderOnesItGoesWith) {
  { const StoreState state(*address_); }
  run("UPDATE stillmap.schema_version SET version = 99");
  { const StoreState beside_a_newer_one(*address_); }
  run("UPDATE stillmap.schema_version SET least_program = 98");
  EXPECT_THAT([&] { const StoreState state(*address_); },
              (ThrowsSaying<maps::InputError>({"schema version 98", "newer stillmap"})));
}

TEST_F(PostgresStateTest, GoesOnWhenItIsBack) {
  StoreState state(*address_);
  state.create_map("town", 1);
  const KeyTable::Created key = state.keys().create("car", {15}, {}, kNow);
  ASSERT_EQ(state.keys().check(key.text, kNow).verdict, Verdict::kGood);

  postgres().stop(SIGQUIT);
  EXPECT_THROW(state.create_map("depot", 1), StateAway);
  EXPECT_THROW((void)state.maps(), StateAway);
  EXPECT_EQ(state.keys().check(key.text, kNow).verdict, Verdict::kGood)
      << "vehicles are localized on";
  EXPECT_TRUE(in_the_end([&] { return !state.not_writable_because().empty(); }));
  EXPECT_TRUE(in_the_end([&] { return state.silence() > std::chrono::milliseconds(500); }));

  postgres().start();
  EXPECT_TRUE(in_the_end([&] {
    try {
      return state.create_map("depot", 1);
    } catch (const StateAway&) {
      return false;
    }
  }));
  EXPECT_EQ(state.maps().size(), 2U);
  EXPECT_TRUE(in_the_end([&] { return state.not_writable_because().empty(); }));
  EXPECT_TRUE(in_the_end([&] { return state.silence() < std::chrono::milliseconds(500); }));
  const StoreState other(*address_);
  EXPECT_EQ(other.maps().size(), 2U);
}

TEST_F(PostgresStateTest, NobodyWaitsForOneThatHangs) {
  StoreState state(*address_);
  state.create_map("town", 1);
  auto other = std::make_unique<StoreState>(*address_);
  const KeyTable::Created key = state.keys().create("car", {15}, {}, kNow);
  ASSERT_EQ(state.keys().check(key.text, kNow).verdict, Verdict::kGood);

  postgres().freeze();
  EXPECT_THROW(state.create_map("depot", 1), StateAway);
  EXPECT_TRUE(in_the_end([&] { return !state.not_writable_because().empty(); }));
  EXPECT_THROW((void)state.maps(), StateAway);
  EXPECT_EQ(state.keys().check(key.text, kNow).verdict, Verdict::kGood);
  EXPECT_THROW(const StoreState new_one(*address_), StateAway);
  other.reset();

  postgres().thaw();
  EXPECT_TRUE(in_the_end([&] {
    try {
      state.create_map("depot", 1);
      return true;
    } catch (const StateAway&) {
      return false;
    }
  }));
  EXPECT_EQ(state.maps().size(), 2U);
  EXPECT_TRUE(in_the_end([&] { return state.not_writable_because().empty(); }));
}

TEST_F(PostgresStateTest, AConnectionThatIsLostInBetweenIsNotSeen) {
  StoreState state(*address_);
  state.create_map("town", 1);
  run("SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE datname = current_database()"
      " AND pid <> pg_backend_pid()");
  EXPECT_EQ(state.maps().size(), 1U);
  EXPECT_TRUE(state.create_map("depot", 1));
}

TEST_F(PostgresStateTest, ChangesNothingWhileTheSynchronousStandbyIsAway) {
  StoreState state(*address_);
  const auto set_standby = [&](const std::string& name) {
    run("ALTER SYSTEM SET synchronous_standby_names = '" + name + "'");
    run("SELECT pg_reload_conf()");
  };
  set_standby("other");
  EXPECT_TRUE(in_the_end([&] {
    try {
      state.create_map("x" + std::to_string(std::rand()), 1);
      return false;
    } catch (const StateAway& away) {
      EXPECT_THAT(away.what(), ::testing::HasSubstr("standby"));
      return true;
    }
  }));
  const std::size_t before = state.maps().size();
  EXPECT_THROW(state.create_map("town", 1), StateAway);
  EXPECT_EQ(state.maps().size(), before) << "poses and reads go on, and nothing was written";
  EXPECT_EQ(StoreState(*address_).maps().size(), before) << "a server may start";
  set_standby("");
  EXPECT_TRUE(in_the_end([&] {
    try {
      return state.create_map("town", 1);
    } catch (const StateAway&) {
      return false;
    }
  }));
}

TEST_F(PostgresStateTest, WhatIsThereAlreadyIsAcknowledgedWithACommit) {
  StoreState state(*address_);
  const ApiKey key = state.keys().create("car", {1}, {}, kNow).key;
  const std::int64_t drive = [&] {
    state.create_map("town", 1);
    return state.drives().open("town", "monday", 7).id;
  }();
  const DrivePart part{1, std::string(64, 'c'), 10};
  const std::vector<std::function<void()>> changes = {
      [&] { state.create_map("town", 1); },
      [&] { state.add_version("town", version("v1", '1')); },
      [&] { state.activate("town", "v1"); },
      [&] { state.keys().revoke(key.id, kNow + 1); },
      [&] { state.drives().add_part(drive, part, {}); },
      [&] { state.require_current(); },
  };
  for (const std::function<void()>& change : changes) change();
  run("CREATE FUNCTION stillmap.refuse() RETURNS trigger LANGUAGE plpgsql AS"
      " $$ BEGIN RAISE EXCEPTION 'a commit'; END $$;"
      "CREATE TRIGGER refuse BEFORE UPDATE ON stillmap.changes"
      " EXECUTE FUNCTION stillmap.refuse()");
  for (const std::function<void()>& change : changes)
    EXPECT_THAT(change, (ThrowsSaying<maps::StorageError>({"a commit"})));
}

/// Something in every table.
void fill(StoreState& state) {
  state.create_map("depot", 5);
  StoredVersion one = version("v1", '1');
  one.files = {{std::string(64, 'a'), 60}, {std::string(64, 'b'), 40}};
  state.add_version("town", one);
  for (const char digit : {'2', '3', '4'})
    state.add_version("town", version(std::string("v") + digit, digit));
  state.activate("town", "v1", {}, 10);
  state.activate("town", "v2", {}, 20);
  state.remove_version("town", "v4");
  state.replace_package(std::string(64, '3'), version("v3", '5'));
  (void)state.keys().create("müller", {3}, 2 * kNow, kNow, {"town*"});
  const ApiKey lost = state.keys().create("lost", {1}, {}, kNow).key;
  state.keys().revoke(lost.id, kNow + 1);
  const std::int64_t drive = state.drives().open("town", "monday", 7).id;
  state.drives().add_part(drive, {1, std::string(64, 'c'), 10}, {});
  state.drives().complete(drive, 8);
  state.jobs().enqueue({.map = "town", .request = "{\"a\": 1}", .drives = {drive}}, 9);
  state.edits().save("town", "{}", "me", 11, {});
  state.rollouts().put({.map = "town", .version = "v1", .share = 0.25, .vehicles = {"a*"}});
  state.sets().put({.name = "city", .maps = {{.map = "town"}}});
  for (int i = 0; i < 3; ++i)
    state.audit().append({.time_ns = i, .request_id = "r", .method = "PUT", .status = 200});
  state.create_map("gone", 1);
  state.remove_map("gone");
}

void expect_same(const StoreState& a, const StoreState& b) {
  EXPECT_EQ(a.maps(), b.maps());
  EXPECT_EQ(a.versions("town"), b.versions("town"));
  EXPECT_EQ(a.condemned(), b.condemned());
  EXPECT_EQ(a.retired("town", "v4"), b.retired("town", "v4"));
  EXPECT_EQ(a.bytes(), b.bytes());
  EXPECT_EQ(a.keys().list(), b.keys().list());
  EXPECT_EQ(a.jobs().list({}, 10).jobs, b.jobs().list({}, 10).jobs);
  EXPECT_EQ(a.jobs().drives(1), b.jobs().drives(1));
  EXPECT_EQ(a.drives().parts(1), b.drives().parts(1));
  EXPECT_EQ(a.edits().of_map("town"), b.edits().of_map("town"));
  EXPECT_EQ(a.rollouts().list(), b.rollouts().list());
  EXPECT_EQ(a.sets().list().front().maps.front().map, "town");
  EXPECT_EQ(b.sets().list().front().maps.front().map, "town");
  EXPECT_EQ(a.active_at("town", 15), b.active_at("town", 15));
  EXPECT_EQ(a.audit().check().newest_sha256, b.audit().check().newest_sha256);
  EXPECT_FALSE(b.audit().check().first_wrong_id);
}

TEST_F(PostgresStateTest, CopiesAStateThereAndBack) {
  const std::filesystem::path file = folder_.path() / "state.db";
  StoreState before(file, unsynced_);
  fill(before);
  PostgresWatch watch(*address_);
  { const StoreState makes_tables(*address_); }
  {
    SqliteDatabase from(file, unsynced_, SqliteDatabase::Mode::kRead);
    PostgresDatabase to(*address_, watch);
    copy_state(from, to);
    EXPECT_THAT([&] { copy_state(from, to); },
                (ThrowsSaying<maps::InputError>({"rows in the table maps", "choose another"})));
  }
  StoreState after(*address_);
  expect_same(before, after);
  // A backup of a state in PostgreSQL is a file of SQLite's.
  after.write_backup(folder_.path() / "backup.db", kNow, unsynced_);
  StoreState restored(folder_.path() / "backup.db", unsynced_);
  EXPECT_EQ(restored.versions("town"), before.versions("town"));
  EXPECT_EQ(restored.keys().list(), before.keys().list());
  EXPECT_THAT(restored.drives().of_map("town"), IsEmpty()) << "backups hold none";
  // Ids are never given twice, a removed map's revision goes on.
  for (StoreState* state : {&before, &after}) {
    EXPECT_EQ(state->drives().open("town", "tuesday", 8).id, 2);
    state->create_map("gone", 2);
    EXPECT_EQ(state->map("gone").revision, 1);
    EXPECT_EQ(state->audit().append({.time_ns = 4}), 4);
  }
}

TEST_F(PostgresStateTest, OneServerAtATimeMovesPackages) {
  const StoreState first(*address_), second(*address_);
  std::shared_ptr<void> held = first.lock_of_packages();
  std::atomic<bool> has_it = false;
  std::jthread other([&] {
    const std::shared_ptr<void> lock = second.lock_of_packages();
    has_it = true;
  });
  std::this_thread::sleep_for(std::chrono::milliseconds(200));
  EXPECT_FALSE(has_it);
  held.reset();
  EXPECT_TRUE(in_the_end([&] { return has_it.load(); }));
}

TEST_F(PostgresStateTest, WhoLostTheLockOfPackagesChangesNoneOnceAnotherHadIt) {
  StoreState first(*address_), second(*address_);
  first.add_version("town", version("v1", '1'));
  std::shared_ptr<void> held = first.lock_of_packages();
  run("SELECT pg_terminate_backend(pid) FROM pg_locks"
      " WHERE locktype = 'advisory' AND objid = 1398033745");
  EXPECT_TRUE(first.add_version("town", version("v2", '2'))) << "nobody else had the lock";
  {
    const std::shared_ptr<void> other = second.lock_of_packages();
    second.remove_version("town", "v1");
  }
  for (const std::function<void()>& change : std::vector<std::function<void()>>{
           [&] { first.add_version("town", version("v3", '1')); },
           [&] { first.remove_version("town", "v2"); }, [&] { first.remove_map("town"); },
           [&] { first.replace_package(std::string(64, '2'), version("v2", '5')); },
           [&] { first.forget_condemned(std::string(64, '1')); }, [&] { first.require_current(); }})
    EXPECT_THAT(change, (ThrowsSaying<StateAway>({"lost the lock of packages", "ask again"})));
  EXPECT_TRUE(first.create_map("depot", 1)) << "which names no package";
  held.reset();
  held = first.lock_of_packages();
  EXPECT_TRUE(first.add_version("town", version("v3", '1')));
}

TEST_F(PostgresStateTest, AStoreIsAttachedToOneState) {
  const std::filesystem::path store = folder_.path() / "store";
  PackageStore::make_folder(store);
  PackageStore::attach(store, *address_);
  PackageStore::attach(store, *address_);
  EXPECT_TRUE(PackageStore::is_store(store));
  PackageStore first(store);
  first.create_map("town");
  EXPECT_FALSE(std::filesystem::exists(store / "state.db"));

  const std::filesystem::path replica = folder_.path() / "replica";
  PackageStore::make_folder(replica);
  PackageStore::attach(replica, *address_);
  EXPECT_EQ(PackageStore(replica).state().maps().size(), 1U);

  EXPECT_THAT([&] { PackageStore::attach(store, PostgresAddress("postgres://elsewhere/x")); },
              (ThrowsSaying<maps::InputError>({"state.address", "elsewhere", "remove the file"})));
  const std::filesystem::path own = folder_.path() / "own";
  PackageStore::make_folder(own);
  { const PackageStore makes_a_state(own); }
  EXPECT_THAT([&] { PackageStore::attach(own, *address_); },
              (ThrowsSaying<maps::InputError>({"state.db", "store copy"})));
}

TEST_F(PostgresStateTest, SaysNoPassword) {
  const PostgresAddress address("postgres://me:secret@nowhere.invalid:5433/maps");
  EXPECT_EQ(address.name(), "postgres://nowhere.invalid:5433/maps");
  EXPECT_THAT([&] { const StoreState state(address); },
              ::testing::Throws<StateAway>(
                  ::testing::Property(&StateAway::what, Not(::testing::HasSubstr("secret")))));
  // libpq would take it; the file of a store's folder would not be known by it again.
  EXPECT_THAT([] { PostgresAddress("host=db password=secret"); },
              ::testing::Throws<maps::InputError>(::testing::Property(
                  &maps::InputError::what, Not(::testing::HasSubstr("secret")))));
  EXPECT_THAT([] { PostgresAddress("postgres://me:secret@[broken/maps"); },
              ::testing::Throws<maps::InputError>(::testing::Property(
                  &maps::InputError::what, Not(::testing::HasSubstr("secret")))));
}

}  // namespace postgres_state_test
}  // namespace stillmap::server
