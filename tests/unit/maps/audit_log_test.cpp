#include <stillmap/maps/store/store_state.hpp>

#include <sqlite3.h>

#include <string>

#include "support/disk_calls.hpp"
#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::maps {
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
  StoreState state_{file_, unsynced_};
  AuditLog& log_ = state_.audit();
};

TEST_F(AuditLogTest, KeepsEveryWriteNewestFirst) {
  for (const std::int64_t time : {1, 2, 3}) log_.append(record(time));
  AuditRecord last = record(3);
  last.id = 3;
  EXPECT_EQ(log_.list(1).records.front(), last);
  EXPECT_THAT(times(10), ElementsAre(3, 2, 1));
  const AuditLog::Page page = log_.list(2);
  ASSERT_TRUE(page.next);
  EXPECT_THAT(times(2, page.next), ElementsAre(1));
  EXPECT_FALSE(log_.list(3).next);
  EXPECT_THAT([&] { (void)log_.list(0); }, ThrowsSaying<std::invalid_argument>({"limit"}));
}

TEST_F(AuditLogTest, CannotBeChangedEvenBySql) {
  log_.append(record(1));
  sqlite3* database = nullptr;
  ASSERT_EQ(sqlite3_open(file_.c_str(), &database), SQLITE_OK);
  EXPECT_NE(sqlite3_exec(database, "UPDATE audit SET status = 200", nullptr, nullptr, nullptr),
            SQLITE_OK);
  EXPECT_THAT(sqlite3_errmsg(database), HasSubstr("append-only"));
  sqlite3_close(database);
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
}  // namespace stillmap::maps
