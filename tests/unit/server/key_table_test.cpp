#include "store/store_state.hpp"

#include <sqlite3.h>

#include <fstream>
#include <iterator>
#include <set>
#include <string>

#include "support/disk_calls.hpp"
#include "support/states.hpp"
#include "support/store_refusals.hpp"
#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::server {
namespace key_table_test {

using ::stillmap::test::expect_refused;
using ::stillmap::test::TemporaryFolder;
using ::stillmap::test::ThrowsSaying;
using ::stillmap::test::UnsyncedCalls;
using ::testing::ElementsAre;
using ::testing::MatchesRegex;
using Reason = StoreRefusal::Reason;
using Verdict = KeyCheck::Verdict;

constexpr std::int64_t kNow = 1'000;

KeyScopes scopes(std::initializer_list<KeyScope> list) {
  KeyScopes all;
  for (const KeyScope scope : list) all.add(scope);
  return all;
}

class KeyTableTest : public ::testing::Test {
 protected:
  [[nodiscard]] Verdict verdict(const std::string& text, std::int64_t now_ns = kNow) {
    return state_.keys().check(text, now_ns).verdict;
  }
  /// At once in SQLite; PostgreSQL tells of it, which takes a moment.
  [[nodiscard]] Verdict verdict_in_the_end(const std::string& text, Verdict wanted) {
    for (int i = 0; test::states_are_in_postgres() && i < 500 && verdict(text) != wanted; ++i)
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    return verdict(text);
  }

  TemporaryFolder folder_;
  UnsyncedCalls unsynced_;
  std::filesystem::path file_ = folder_.path() / "state.db";
  StoreState state_ = test::state_at(file_, unsynced_);
  KeyScopes read_ = scopes({KeyScope::kRead});
};

TEST(MapPattern, StarStandsForAnyText) {
  for (const auto& [name, pattern] :
       std::vector<std::pair<const char*, const char*>>{{"town", "town"},
                                                        {"town", "*"},
                                                        {"town", "t*n"},
                                                        {"town", "town*"},
                                                        {"town", "*town"},
                                                        {"town", "**o*"},
                                                        {"abcbcd", "a*bcd"},
                                                        {"", "*"},
                                                        {"a.b", "a.b"}})
    EXPECT_TRUE(matches_pattern(name, pattern)) << name << " " << pattern;
  for (const auto& [name, pattern] :
       std::vector<std::pair<const char*, const char*>>{{"town", "tow"},
                                                        {"town", "own"},
                                                        {"town", "t*m"},
                                                        {"town", "town-*"},
                                                        {"town", ""},
                                                        {"axb", "a.b"},
                                                        {"abcbc", "a*bcd"},
                                                        {"town", "t?wn"},
                                                        {"town", "[t]own"}})
    EXPECT_FALSE(matches_pattern(name, pattern)) << name << " " << pattern;
  const std::string stars = "*a*a*a*a*a*a*a*a*a*a*a*a*a*a*a*b";
  EXPECT_FALSE(matches_pattern(std::string(63, 'a'), stars)) << "and at once";
}

TEST_F(KeyTableTest, AKeyMayBeLimitedToMaps) {
  const auto limited = state_.keys().create("a", read_, {}, kNow, {"town-*", "village"});
  EXPECT_THAT(limited.key.maps, ElementsAre("town-*", "village"));
  EXPECT_EQ(state_.keys().check(limited.text, kNow).key, limited.key);
  EXPECT_TRUE(
      state_.keys().check(state_.keys().create("b", read_, {}, kNow).text, kNow).key->maps.empty());
  const auto refused = [&](const std::vector<std::string>& maps, KeyScopes scopes,
                           const char* words) {
    EXPECT_THAT([&] { state_.keys().create("c", scopes, {}, kNow, maps); },
                ThrowsSaying<std::invalid_argument>({words}));
  };
  refused({"Town"}, read_, "'Town'");
  refused({"a\nb"}, read_, "map of a key");
  refused({""}, read_, "map of a key");
  refused({std::string(64, 'a')}, read_, "map of a key");
  refused(std::vector<std::string>(33, "a"), read_, "at most 32");
  refused({"*"}, scopes({KeyScope::kRead, KeyScope::kAdmin}), "leave out the scope admin");
  EXPECT_EQ(state_.keys().list().size(), 2U);
}

TEST_F(KeyTableTest, KnowsAKeyByItsWholeTextOnly) {
  const KeyTable::Created car =
      state_.keys().create("car 7", scopes({KeyScope::kRead, KeyScope::kLocalize}), {}, kNow);
  EXPECT_THAT(car.text, MatchesRegex("stillmap_[0-9a-f]{16}_[0-9a-f]{64}"));
  const KeyCheck check = state_.keys().check(car.text, kNow);
  ASSERT_EQ(check.verdict, Verdict::kGood);
  EXPECT_EQ(check.key, car.key);
  EXPECT_EQ(check.key->name, "car 7");
  EXPECT_TRUE(check.key->scopes.has(KeyScope::kLocalize));
  EXPECT_FALSE(check.key->scopes.has(KeyScope::kWrite));
  for (std::size_t i = 0; i < car.text.size(); ++i) {
    std::string other = car.text;
    other[i] = other[i] == '0' ? '1' : '0';
    const KeyCheck wrong = state_.keys().check(other, kNow);
    EXPECT_EQ(wrong.verdict, Verdict::kUnknown) << other;
    EXPECT_FALSE(wrong.key) << "who guesses does not learn which ids there are";
  }
  for (const std::string& other :
       {std::string(), std::string("stillmap_"), car.text + "0", car.text.substr(1),
        car.text.substr(0, car.text.size() - 1), std::string(car.text.size(), '\0')})
    EXPECT_EQ(verdict(other), Verdict::kUnknown) << other;
}

TEST_F(KeyTableTest, KeepsNoSecretOnTheDisk) {
  if (test::states_are_in_postgres()) GTEST_SKIP() << "of SQLite's file";
  const KeyTable::Created key = state_.keys().create("car", read_, {}, kNow);
  const std::string secret = key.text.substr(key.text.size() - 64);
  for (const std::string& name : {file_.string(), file_.string() + "-wal"}) {
    std::ifstream stream(name, std::ios::binary);
    const std::string bytes{std::istreambuf_iterator<char>(stream), {}};
    ASSERT_FALSE(bytes.empty());
    EXPECT_EQ(bytes.find(secret), std::string::npos) << name;
  }
  EXPECT_THAT(state_.keys().list(), ElementsAre(key.key));
}

TEST_F(KeyTableTest, GivesEveryKeyItsOwnIdAndSecret) {
  std::set<std::string> ids, secrets;
  for (int i = 0; i < 50; ++i) {
    const KeyTable::Created key = state_.keys().create("same name", read_, {}, kNow);
    ids.insert(key.key.id);
    secrets.insert(key.text.substr(key.text.size() - 64));
  }
  EXPECT_EQ(ids.size(), 50U);
  EXPECT_EQ(secrets.size(), 50U);
}

TEST_F(KeyTableTest, RefusesAKeyFromTheInstantThatItExpires) {
  const KeyTable::Created key = state_.keys().create("visitor", read_, kNow + 10, kNow);
  EXPECT_EQ(verdict(key.text, kNow + 9), Verdict::kGood);
  EXPECT_EQ(verdict(key.text, kNow + 10), Verdict::kExpired);
  EXPECT_EQ(state_.keys().check(key.text, kNow + 10).key->name, "visitor");
}

TEST_F(KeyTableTest, RevokesForGood) {
  const KeyTable::Created key = state_.keys().create("lost", read_, {}, kNow);
  const KeyTable::Created other = state_.keys().create("kept", read_, {}, kNow + 1);
  EXPECT_EQ(state_.keys().revoke(key.key.id, kNow + 5).revoked_ns, kNow + 5);
  EXPECT_EQ(state_.keys().revoke(key.key.id, kNow + 9).revoked_ns, kNow + 5);
  EXPECT_EQ(verdict(key.text), Verdict::kRevoked);
  EXPECT_EQ(verdict(other.text), Verdict::kGood);
  EXPECT_EQ(state_.keys().list().front().revoked_ns, kNow + 5);
  expect_refused(Reason::kUnknownKey, [&] { state_.keys().revoke("0000000000000000", kNow); });
}

TEST_F(KeyTableTest, SeesWhatAnotherProcessDid) {
  StoreState other = test::state_at(file_, unsynced_);
  EXPECT_FALSE(state_.keys().any());
  const KeyTable::Created key = other.keys().create("new", read_, {}, kNow);
  EXPECT_EQ(verdict_in_the_end(key.text, Verdict::kGood), Verdict::kGood);
  EXPECT_TRUE(state_.keys().any());
  other.keys().revoke(key.key.id, kNow);
  EXPECT_EQ(verdict_in_the_end(key.text, Verdict::kRevoked), Verdict::kRevoked);
}

TEST_F(KeyTableTest, WaitsForNoWriter) {
  if (test::states_are_in_postgres()) GTEST_SKIP() << "of SQLite";
  const KeyTable::Created key = state_.keys().create("car", read_, {}, kNow);
  // A commit takes as long as the disk's sync; here it takes for ever.
  sqlite3* writer = nullptr;
  ASSERT_EQ(sqlite3_open(file_.c_str(), &writer), SQLITE_OK);
  ASSERT_EQ(sqlite3_exec(writer, "BEGIN IMMEDIATE; DELETE FROM keys", nullptr, nullptr, nullptr),
            SQLITE_OK);
  EXPECT_EQ(verdict(key.text), Verdict::kGood);
  sqlite3_close(writer);
}

TEST_F(KeyTableTest, RefusesKeysThatMakeNoSense) {
  EXPECT_THAT([&] { state_.keys().create("", read_, {}, kNow); },
              ThrowsSaying<std::invalid_argument>({"name"}));
  EXPECT_THAT([&] { state_.keys().create(std::string(101, 'x'), read_, {}, kNow); },
              ThrowsSaying<std::invalid_argument>({"name"}));
  EXPECT_THAT([&] { state_.keys().create("two\nlines", read_, {}, kNow); },
              ThrowsSaying<std::invalid_argument>({"name"}));
  EXPECT_THAT([&] { state_.keys().create("car", {}, {}, kNow); },
              ThrowsSaying<std::invalid_argument>({"scopes"}));
  EXPECT_THAT([&] { state_.keys().create("car", read_, kNow, kNow); },
              ThrowsSaying<std::invalid_argument>({"expiry"}));
  EXPECT_THAT(state_.keys().list(), ElementsAre());
}

}  // namespace key_table_test
}  // namespace stillmap::server
