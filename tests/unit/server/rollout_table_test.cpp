#include "store/package_store.hpp"
#include "store/store_state.hpp"

#include <gmock/gmock.h>

#include <string>

#include "support/disk_calls.hpp"
#include "support/states.hpp"
#include "support/store_refusals.hpp"
#include "support/stored_packages.hpp"
#include "support/temporary_folder.hpp"

namespace stillmap::server {
namespace rollout_table_test {

using ::stillmap::test::expect_refused;
using ::stillmap::test::TemporaryFolder;
using ::stillmap::test::UnsyncedCalls;
using ::testing::ElementsAre;
using ::testing::IsEmpty;
using Reason = StoreRefusal::Reason;

/// `town` with v1 active beside v2 and v3.
class RolloutTableTest : public ::testing::Test {
 protected:
  RolloutTableTest() {
    for (const char digit : {'1', '2', '3'})
      state_->add_version("town", {.name = std::string("v") + digit,
                                   .digest = std::string(64, digit),
                                   .created_ns = digit});
    state_->activate("town", "v1");
  }
  RolloutTable& rollouts() { return state_->rollouts(); }
  static Rollout wanted() {
    return {.map = "town",
            .version = "v2",
            .share = 0.1,
            .vehicles = {"depot-*", "truck 17"},
            .halt = {.least_answers = 50, .most_rise = 0.02},
            .begun_ns = 7};
  }

  TemporaryFolder folder_;
  UnsyncedCalls unsynced_;
  std::filesystem::path file_ = folder_.path() / "state.db";
  std::unique_ptr<StoreState> state_{new StoreState(test::state_at(file_, unsynced_))};
};

TEST_F(RolloutTableTest, OutlivesTheProcess) {
  Rollout expected = wanted();
  expected.active = "v1";
  EXPECT_EQ(rollouts().put(wanted()), expected);
  ASSERT_TRUE(rollouts().halt(expected, "too many are lost"));
  expected.halted = true;
  expected.reason = "too many are lost";
  state_.reset();
  state_.reset(new StoreState(test::state_at(file_, unsynced_)));
  EXPECT_THAT(rollouts().list(), ElementsAre(expected));
  EXPECT_TRUE(rollouts().remove("town"));
  EXPECT_FALSE(rollouts().remove("town"));
  EXPECT_THAT(rollouts().list(), IsEmpty());
}

TEST_F(RolloutTableTest, GoesOnWhenItIsChangedAndBeginsAnewWhenItWasHalted) {
  rollouts().put(wanted());
  Rollout larger = wanted();
  larger.share = 0.5;
  larger.begun_ns = 8;
  EXPECT_EQ(rollouts().put(larger).begun_ns, 7);
  rollouts().halt(rollouts().list().front(), "bad");
  EXPECT_EQ(rollouts().put(larger).begun_ns, 8);
  EXPECT_FALSE(rollouts().list().front().halted);
  EXPECT_FALSE(rollouts().halt(wanted(), "of the one before"));
  larger.version = "v3";
  larger.begun_ns = 9;
  EXPECT_EQ(rollouts().put(larger).begun_ns, 9);
}

TEST_F(RolloutTableTest, IsOfAnotherVersionThanTheActiveOne) {
  Rollout rollout = wanted();
  rollout.version = "v1";
  expect_refused(Reason::kActive, [&] { rollouts().put(rollout); });
  rollout.version = "v9";
  expect_refused(Reason::kUnknownVersion, [&] { rollouts().put(rollout); });
  rollout.map = "village";
  expect_refused(Reason::kUnknownMap, [&] { rollouts().put(rollout); });
  expect_refused(Reason::kUnknownMap, [&] { rollouts().remove("village"); });
}

TEST_F(RolloutTableTest, KeepsItsVersionUntilItEnds) {
  const Rollout rollout = rollouts().put(wanted());
  expect_refused(Reason::kActive, [&] { state_->remove_version("town", "v2"); });
  rollouts().halt(rollout, "bad");
  expect_refused(Reason::kActive, [&] { state_->remove_version("town", "v2"); });
  state_->remove_version("town", "v3");
  rollouts().remove("town");
  state_->remove_version("town", "v2");
}

TEST_F(RolloutTableTest, EndsWithAnyActivationAndWithItsMap) {
  for (const char* version : {"v2", "v3"}) {
    state_->activate("town", "v1");
    rollouts().put(wanted());
    state_->activate("town", "v1");
    EXPECT_EQ(rollouts().list().size(), 1U) << "v1 is active already";
    state_->activate("town", version);
    EXPECT_THAT(rollouts().list(), IsEmpty()) << version;
  }
  rollouts().put(wanted());
  state_->roll_back("town");
  EXPECT_THAT(rollouts().list(), IsEmpty());
  state_->activate("town", "v3");
  rollouts().put(wanted());
  state_->remove_map("town", WhenActive::kRemove);
  EXPECT_THAT(rollouts().list(), IsEmpty());
  EXPECT_THAT(state_->problems(), IsEmpty());
}

TEST(RolloutOfAStore, IsKeptByRetention) {
  const TemporaryFolder folder, store_folder;
  PackageStore store(store_folder.path());
  for (int n = 1; n <= 4; ++n) {
    const auto package = folder.path() / std::to_string(n);
    test::write_package(package, n);
    store.add("town", "v" + std::to_string(n), package);
  }
  store.activate("town", "v1");
  store.rollouts().put({.map = "town", .version = "v2", .begun_ns = 1});
  EXPECT_THAT(store.keep_newest("town", 1), ElementsAre("v3"));
}

}  // namespace rollout_table_test
}  // namespace stillmap::server
