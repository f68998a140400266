#include "store/store_state.hpp"

#include <sqlite3.h>

#include <string>
#include <thread>

#include "support/disk_calls.hpp"
#include "support/states.hpp"
#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::server {
namespace audit_log_test {

using ::stillmap::test::TemporaryFolder;
using ::stillmap::test::ThrowsSaying;
using ::stillmap::test::UnsyncedCalls;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

constexpr std::int64_t kDayNs = 86'400'000'000'000;

AuditRecord record(std::int64_t time_ns) {
  return {.time_ns = time_ns,
          .request_id = "r" + std::to_string(time_ns),
          .key_id = "k",
          .method = "PUT",
          .route = "/v1/maps/{map}",
          .subject = "town",
          .status = 201};
}

class AuditLogTest : public ::testing::Test {
 protected:
  /// Times of a page.
  [[nodiscard]] std::vector<std::int64_t> times(std::size_t limit,
                                                std::optional<std::int64_t> before = {}) {
    std::vector<std::int64_t> times;
    for (const AuditRecord& each : log_.list(limit, before).records) times.push_back(each.time_ns);
    return times;
  }

  TemporaryFolder folder_;
  UnsyncedCalls unsynced_;
  std::filesystem::path file_ = folder_.path() / "state.db";
  StoreState state_ = test::state_at(file_, unsynced_);
  AuditLog& log_ = state_.audit();
};

TEST_F(AuditLogTest, KeepsEveryWriteNewestFirst) {
  for (const std::int64_t time : {1, 2, 3}) log_.append(record(time));
  AuditRecord last = record(3);
  last.id = 3;
  last.sha256 = log_.check().newest_sha256;
  EXPECT_EQ(log_.list(1).records.front(), last);
  EXPECT_THAT(times(10), ElementsAre(3, 2, 1));
  const AuditLog::Page page = log_.list(2);
  ASSERT_TRUE(page.next);
  EXPECT_THAT(times(2, page.next), ElementsAre(1));
  EXPECT_FALSE(log_.list(3).next);
  EXPECT_THAT([&] { (void)log_.list(0); }, ThrowsSaying<std::invalid_argument>({"limit"}));
}

TEST_F(AuditLogTest, CannotBeChangedEvenBySql) {
  if (test::states_are_in_postgres()) GTEST_SKIP() << "PostgresStateTest has its own";
  log_.append(record(1));
  sqlite3* database = nullptr;
  ASSERT_EQ(sqlite3_open(file_.c_str(), &database), SQLITE_OK);
  EXPECT_NE(sqlite3_exec(database, "UPDATE audit SET status = 200", nullptr, nullptr, nullptr),
            SQLITE_OK);
  EXPECT_THAT(sqlite3_errmsg(database), HasSubstr("append-only"));
  sqlite3_close(database);
}

/// Computed by Python's hashlib from the description in server/store.md.
TEST_F(AuditLogTest, ChainIsAsDescribed) {
  EXPECT_EQ(log_.check().newest_sha256, std::string(64, '0'));
  log_.append({.time_ns = 5,
               .request_id = "mine",
               .server_request_id = "0123456789abcdef",
               .source = "192.0.2.7",
               .key_id = "k",
               .method = "PUT",
               .route = "/v1/maps/{map}",
               .subject = "town",
               .status = 201});
  EXPECT_EQ(log_.check().newest_sha256,
            "08824f54de41e6d4df2a4833f411d9ab62058a56fb1b5fd2109014ab1edb9595");
  log_.append({.time_ns = 6});
  EXPECT_EQ(log_.check().newest_sha256,
            "42a77cb250a4591497b9c511b3fadaf73f0c13c14c12abff11beb8c54c488fb3");
}

TEST_F(AuditLogTest, WhatWasChangedNoLongerFits) {
  const auto changed_by = [](const std::string& sql) {
    const TemporaryFolder folder;
    UnsyncedCalls unsynced;
    StoreState state(folder.path() / "state.db", unsynced);
    for (const std::int64_t time : {1, 2, 3, 4}) state.audit().append(record(time));
    EXPECT_FALSE(state.audit().check().first_wrong_id);
    sqlite3* database = nullptr;
    EXPECT_EQ(sqlite3_open((folder.path() / "state.db").c_str(), &database), SQLITE_OK);
    EXPECT_EQ(sqlite3_exec(database, ("DROP TRIGGER audit_is_append_only;" + sql).c_str(), nullptr,
                           nullptr, nullptr),
              SQLITE_OK)
        << sqlite3_errmsg(database);
    sqlite3_close(database);
    return state.audit().check().first_wrong_id.value_or(0);
  };
  EXPECT_EQ(changed_by(""), 0);
  for (const char* field : {"time_ns = 9", "request_id = 'r'", "server_request_id = 's'",
                            "source = 's'", "key_id = 'l'", "method = 'POST'", "route = ''",
                            "subject = 'city'", "status = 403", "sha256 = ''"})
    EXPECT_EQ(changed_by("UPDATE audit SET " + std::string(field) + " WHERE id = 2"), 2) << field;
  EXPECT_EQ(changed_by("UPDATE audit SET method = '', route = 'PUT' || route WHERE id = 3"), 3);
  EXPECT_EQ(changed_by("DELETE FROM audit WHERE id = 2"), 3);
  EXPECT_EQ(changed_by("DELETE FROM audit WHERE id = 1"), 2);
  EXPECT_EQ(changed_by("DELETE FROM audit WHERE id = 4"), 4);
  EXPECT_EQ(changed_by("DELETE FROM audit"), 1);
  EXPECT_EQ(changed_by("INSERT INTO audit SELECT 5, time_ns, request_id, key_id, method, route,"
                       " subject, status, server_request_id, source, sha256 FROM audit"
                       " WHERE id = 4"),
            5);
}

TEST_F(AuditLogTest, ChainGoesOnWhereRetentionHasRemovedItsBeginning) {
  for (const std::int64_t day : {10, 11, 9, 13}) log_.append(record(day * kDayNs));
  EXPECT_EQ(log_.remove_older_than(2, 13 * kDayNs), 1U);
  EXPECT_FALSE(log_.check().first_wrong_id);
  // Clocks are set back: what follows a younger record stays as long as that.
  EXPECT_THAT(times(10), ElementsAre(13 * kDayNs, 9 * kDayNs, 11 * kDayNs));
  EXPECT_EQ(log_.remove_older_than(1, 100 * kDayNs), 3U);
  EXPECT_FALSE(log_.check().first_wrong_id);
  EXPECT_EQ(log_.append(record(1)), 5);
  EXPECT_FALSE(log_.check().first_wrong_id);
  EXPECT_EQ(log_.check().records, 1U);
}

TEST_F(AuditLogTest, TwoServersOnOneStoreMakeOneChain) {
  constexpr int kEach = 40;
  StoreState other = test::state_at(file_, unsynced_);
  std::thread beside([&] {
    for (int i = 0; i < kEach; ++i) other.audit().append(record(i));
  });
  for (int i = 0; i < kEach; ++i) log_.append(record(i));
  beside.join();
  EXPECT_EQ(log_.check().records, 2U * kEach);
  EXPECT_FALSE(log_.check().first_wrong_id);
}

TEST_F(AuditLogTest, KeepsSoManyDays) {
  for (const std::int64_t day : {10, 11, 12, 13}) log_.append(record(day * kDayNs));
  EXPECT_EQ(log_.remove_older_than(2, 13 * kDayNs), 1U);
  EXPECT_THAT(times(10), ElementsAre(13 * kDayNs, 12 * kDayNs, 11 * kDayNs));
  EXPECT_EQ(log_.remove_older_than(1, 100 * kDayNs), 3U);
  EXPECT_EQ(log_.append(record(1)), 5) << "ids go on";
  EXPECT_THAT([&] { log_.remove_older_than(0, 1); },
              ThrowsSaying<std::invalid_argument>({"0 days"}));
  EXPECT_THAT([&] { log_.remove_older_than(INT64_MAX, 1); },
              ThrowsSaying<std::invalid_argument>({"days"}));
}

}  // namespace audit_log_test
}  // namespace stillmap::server
