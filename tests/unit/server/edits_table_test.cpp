#include <stillmap/maps/edits.hpp>
#include "store/store_state.hpp"

#include <gmock/gmock.h>

#include <string>

#include "support/disk_calls.hpp"
#include "support/states.hpp"
#include "support/store_refusals.hpp"
#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::server {
namespace edits_table_test {

using ::stillmap::test::expect_refused;
using ::stillmap::test::TemporaryFolder;
using ::stillmap::test::ThrowsSaying;
using ::stillmap::test::UnsyncedCalls;
using Reason = StoreRefusal::Reason;

class EditsTableTest : public ::testing::Test {
 protected:
  EditsTableTest() { state_->create_map("town", 1); }

  TemporaryFolder folder_;
  UnsyncedCalls unsynced_;
  std::filesystem::path file_ = folder_.path() / "state.db";
  std::unique_ptr<StoreState> state_{new StoreState(test::state_at(file_, unsynced_))};
};

TEST_F(EditsTableTest, NoneAreSavedAtFirst) {
  const SavedEdits none = state_->edits().of_map("town");
  EXPECT_TRUE(maps::parse_edits(none.text, "none").empty());
  EXPECT_FALSE(none.saved_ns);
  expect_refused(Reason::kUnknownMap, [&] { (void)state_->edits().of_map("village"); });
  expect_refused(Reason::kUnknownMap, [&] { state_->edits().save("village", "x", "", 1); });
}

TEST_F(EditsTableTest, OutliveTheProcess) {
  const SavedEdits saved = state_->edits().save("town", "some", "key", 7);
  EXPECT_EQ(saved.text, "some");
  EXPECT_EQ(saved.saved_ns, 7);
  EXPECT_EQ(saved.saver, "key");
  state_.reset();
  EXPECT_EQ(test::state_at(file_, unsynced_).edits().of_map("town"), saved);
}

TEST_F(EditsTableTest, OfWhoeverLookedBeforeAChangeAreRefused) {
  const std::string none = state_->edits().of_map("town").sha256;
  const SavedEdits first = state_->edits().save("town", "first", "a", 1, none);
  expect_refused(Reason::kOtherRevision,
                 [&] { state_->edits().save("town", "second", "b", 2, none); });
  EXPECT_EQ(state_->edits().of_map("town"), first);
  EXPECT_EQ(state_->edits().save("town", "second", "b", 2, first.sha256).text, "second");
  EXPECT_EQ(state_->edits().save("town", "third", "c", 3).text, "third") << "whatever is there";
}

TEST_F(EditsTableTest, GoWithTheirMap) {
  state_->edits().save("town", "some", "", 1);
  state_->remove_map("town");
  state_->create_map("town", 2);
  EXPECT_FALSE(state_->edits().of_map("town").saved_ns);
}

TEST_F(EditsTableTest, AreBounded) {
  const std::string longest(EditsTable::kMostBytes, 'x');
  EXPECT_EQ(state_->edits().save("town", longest, "", 1).text.size(), longest.size());
  EXPECT_THAT([&] { state_->edits().save("town", longest + "x", "", 1); },
              ThrowsSaying<std::invalid_argument>({"edits", "1048577"}));
}

}  // namespace edits_table_test
}  // namespace stillmap::server
