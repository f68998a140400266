#include "store/store_state.hpp"

#include <string>

#include "support/disk_calls.hpp"
#include "support/states.hpp"
#include "support/store_refusals.hpp"
#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::server {
namespace drive_table_test {

using ::stillmap::test::expect_refused;
using ::stillmap::test::TemporaryFolder;
using ::stillmap::test::ThrowsSaying;
using ::stillmap::test::UnsyncedCalls;
using ::testing::ElementsAre;
using ::testing::IsEmpty;
using Reason = StoreRefusal::Reason;

DrivePart part(std::int64_t n, char digit, std::uint64_t bytes = 10) {
  return {n, std::string(64, digit), bytes};
}

class DriveTableTest : public ::testing::Test {
 protected:
  DriveTableTest() { state_.create_map("town", 1); }

  TemporaryFolder folder_;
  UnsyncedCalls unsynced_;
  StoreState state_ = test::state_at(folder_.path() / "state.db", unsynced_);
  DriveTable& drives_ = state_.drives();
};

TEST_F(DriveTableTest, GathersPartsInAnyOrderUntilItIsComplete) {
  const std::int64_t id = drives_.open("town", "monday", 5).id;
  EXPECT_TRUE(drives_.add_part(id, part(2, 'b', 20)));
  expect_refused(Reason::kPartsMissing, [&] { drives_.complete(id, 6); });
  EXPECT_TRUE(drives_.add_part(id, part(1, 'a', 10)));
  EXPECT_THAT(drives_.parts(id), ElementsAre(part(1, 'a', 10), part(2, 'b', 20)));
  const StoredDrive done = drives_.complete(id, 7);
  EXPECT_EQ(done, (StoredDrive{.id = id,
                               .map = "town",
                               .name = "monday",
                               .status = DriveStatus::kComplete,
                               .bytes = 30,
                               .created_ns = 5,
                               .finished_ns = 7}));
  EXPECT_EQ(drives_.drive(id), done);
  EXPECT_EQ(drives_.complete(id, 9), done) << "twice is once";
  expect_refused(Reason::kDriveNotOpen, [&] { drives_.add_part(id, part(3, 'c')); });
}

TEST_F(DriveTableTest, TakesTheSamePartAgainAndRefusesAnother) {
  const std::int64_t id = drives_.open("town", "monday", 5).id;
  expect_refused(Reason::kPartsMissing, [&] { drives_.complete(id, 6); });
  EXPECT_TRUE(drives_.add_part(id, part(1, 'a')));
  EXPECT_FALSE(drives_.add_part(id, part(1, 'a')));
  expect_refused(Reason::kOtherDigest, [&] { drives_.add_part(id, part(1, 'b')); });
  EXPECT_THAT([&] { drives_.add_part(id, part(0, 'a')); },
              ThrowsSaying<std::invalid_argument>({"part: 0"}));
  EXPECT_THAT([&] { drives_.add_part(id, part(10'001, 'a')); },
              ThrowsSaying<std::invalid_argument>({"part: 10001"}));
  EXPECT_THAT([&] { drives_.add_part(id, part(2, 'Z')); },
              ThrowsSaying<std::invalid_argument>({"SHA-256"}));
  EXPECT_TRUE(drives_.add_part(id, part(10'000, 'a')));
  expect_refused(Reason::kOverQuota, [&] { drives_.add_part(id, part(3, 'a'), {.map_bytes = 1}); });
}

TEST_F(DriveTableTest, FailsInWordsAndForGood) {
  const std::int64_t id = drives_.open("town", "monday", 5).id;
  drives_.add_part(id, part(1, 'a'));
  const StoredDrive failed = drives_.fail(id, "scan 7: NaN", 8);
  EXPECT_EQ(failed.status, DriveStatus::kFailed);
  EXPECT_EQ(failed.error, "scan 7: NaN");
  EXPECT_EQ(drives_.drive(id), failed);
  expect_refused(Reason::kDriveNotOpen, [&] { drives_.complete(id, 9); });
  expect_refused(Reason::kDriveNotOpen, [&] { drives_.fail(id, "again", 9); });
}

TEST_F(DriveTableTest, RemovesADriveWithItsPartsAndNeverGivesItsIdAgain) {
  const std::int64_t first = drives_.open("town", "monday", 5).id;
  const std::int64_t second = drives_.open("town", "tuesday", 6).id;
  drives_.add_part(second, part(1, 'a', 100));
  EXPECT_EQ(state_.bytes_of_map("town"), 100U);
  expect_refused(Reason::kInUse, [&] { state_.remove_map("town"); });
  drives_.remove(second);
  EXPECT_EQ(state_.bytes_of_map("town"), 0U);
  expect_refused(Reason::kUnknownDrive, [&] { (void)drives_.parts(second); });
  expect_refused(Reason::kUnknownDrive, [&] { drives_.remove(second); });
  const std::int64_t third = drives_.open("town", "tuesday", 7).id;
  EXPECT_GT(third, second);
  EXPECT_EQ(drives_.of_map("town").size(), 2U);
  EXPECT_EQ(drives_.all().front().id, first);
  EXPECT_THAT(drives_.parts(third), IsEmpty());
  EXPECT_THAT(drives_.jobs_using(third), IsEmpty());
  expect_refused(Reason::kUnknownMap, [&] { (void)drives_.open("nowhere", "x", 1); });
  expect_refused(Reason::kUnknownMap, [&] { (void)drives_.of_map("nowhere"); });
}

}  // namespace drive_table_test
}  // namespace stillmap::server
