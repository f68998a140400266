#include "sealing/seal.hpp"

#include "http/base64.hpp"
#include "sealing/seal_keys.hpp"
#include "sealing/session_seals.hpp"
#include "support/disk_calls.hpp"
#include "support/states.hpp"
#include "support/temporary_folder.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <stillmap/maps/error.hpp>
#include "errors/api_error.hpp"

#include <sys/stat.h>

#include <atomic>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <memory>
#include <set>
#include <sstream>
#include <stdexcept>
#include <thread>

namespace stillmap::server {
namespace seal_test {

using ::testing::HasSubstr;
using namespace std::chrono_literals;

const SealOwner kOwner{.key_id = "0123456789abcdef", .map = "town"};

SealedSession session() {
  SealedSession session;
  session.id = "0123456789abcdef";
  session.count = 7;
  session.made_ns = 1'700'000'000'000'000'000;
  session.version = "v1";
  session.digest = std::string(62, 'a') + "07";
  session.vehicle = "truck 7";
  session.is_rolled_out = true;
  session.tracker = std::string(1500, 't');
  return session;
}

TEST(Base64, TakesOnlyWhatItWrites) {
  for (const char* text : {"", "AA==", "AAA=", "AAAA", "+/+/"}) {
    const auto bytes = from_base64(text);
    ASSERT_TRUE(bytes) << text;
    EXPECT_EQ(to_base64(*bytes), text);
  }
  for (const char* text : {"A", "AB==", "AAB=", "AA=A", "A===", "====", " AAA", "AAAA\n", "AAA\n",
                           "-_-_", "AA==AAAA", "AAAA===="})
    EXPECT_FALSE(from_base64(text)) << text;
}

TEST(Seal, GivesTheSessionBack) {
  const SealKey key = SealKey::make();
  const std::string text = seal(session(), kOwner, key);
  EXPECT_LE(text.size(), kMaxSealText);
  const auto opened = open_seal(text, kOwner, key);
  ASSERT_TRUE(opened);
  const SealedSession expected = session();
  EXPECT_EQ(opened->id, expected.id);
  EXPECT_EQ(opened->count, expected.count);
  EXPECT_EQ(opened->made_ns, expected.made_ns);
  EXPECT_EQ(opened->version, expected.version);
  EXPECT_EQ(opened->digest, expected.digest);
  EXPECT_EQ(opened->vehicle, expected.vehicle);
  EXPECT_FALSE(opened->version_was_named);
  EXPECT_TRUE(opened->is_rolled_out);
  EXPECT_EQ(opened->tracker, expected.tracker);
  EXPECT_EQ(opened->map, "");
  SealedSession in_set = session();
  in_set.map = "west";
  const SealOwner of_set{.key_id = kOwner.key_id, .map = "set/town"};
  const auto in_map = open_seal(seal(in_set, of_set, key), of_set, key);
  ASSERT_TRUE(in_map);
  EXPECT_EQ(in_map->map, "west");
  EXPECT_EQ(in_map->version, expected.version);
}

TEST(Seal, OfALongSessionFitsIntoItsBound) {
  SealedSession largest = session();
  largest.version = largest.vehicle = std::string(64, 'v');
  largest.version.pop_back();
  largest.map = largest.version;
  largest.tracker = std::string(1511, 't');
  EXPECT_EQ(seal(largest, kOwner, SealKey::make()).size(), kMaxSealText);
  largest.tracker += "ttt";
  EXPECT_THROW((void)seal(largest, kOwner, SealKey::make()), std::invalid_argument);
}

TEST(Seal, EveryChangedByteAndEveryCutIsRefused) {
  const SealKey key = SealKey::make();
  const std::string text = seal(session(), kOwner, key);
  const std::string bytes = from_base64(text).value();
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    for (const int bit : {0, 3, 7}) {
      std::string changed = bytes;
      changed[i] = static_cast<char>(changed[i] ^ 1 << bit);
      ASSERT_FALSE(open_seal(to_base64(changed), kOwner, key)) << "byte " << i;
    }
    ASSERT_FALSE(open_seal(to_base64(bytes.substr(0, i)), kOwner, key)) << "cut at " << i;
    ASSERT_FALSE(open_seal(to_base64(bytes.substr(i + 1)), kOwner, key)) << "from " << i + 1;
  }
  for (std::size_t i = 0; i < text.size(); ++i) {
    std::string changed = text;
    changed[i] = changed[i] == 'A' ? 'B' : 'A';
    ASSERT_FALSE(open_seal(changed, kOwner, key)) << "letter " << i;
  }
  EXPECT_FALSE(open_seal("", kOwner, key));
  EXPECT_FALSE(open_seal(std::string(3 * kMaxSealText, 'A'), kOwner, key));
}

TEST(Seal, OfAnotherOwnerOrKeyIsRefused) {
  const SealKey key = SealKey::make();
  const std::string text = seal(session(), kOwner, key);
  EXPECT_FALSE(open_seal(text, kOwner, SealKey::make()));
  for (const SealOwner& other :
       {SealOwner{"", "town"}, SealOwner{"0123456789abcdee", "town"},
        SealOwner{"0123456789abcdef", "towns"}, SealOwner{"0123456789abcdef", ""},
        SealOwner{"0123456789abcdeft", "own"}})
    EXPECT_FALSE(open_seal(text, other, key)) << other.key_id << " " << other.map;
}

// Two servers go on from one seal: the same id and count, other states. With one key for both,
// what is encrypted would be the exclusive or of the same bytes with both states.
TEST(Seal, NoTwoSealsShareKeyAndNonce) {
  const SealKey key = SealKey::make();
  constexpr std::size_t kHead = 1 + 16 + 24 + 8 + 32;
  std::set<std::string> heads, hidden;
  for (int i = 0; i < 200; ++i) {
    const std::string bytes = from_base64(seal(session(), kOwner, key)).value();
    heads.insert(bytes.substr(17, 24));
    hidden.insert(bytes.substr(kHead, 16));
  }
  EXPECT_EQ(heads.size(), 200U);
  EXPECT_EQ(hidden.size(), 200U) << "the same session is encrypted alike";
}

class SealKeysInAStore : public ::testing::Test {
 protected:
  std::string text() const {
    std::ostringstream text;
    text << std::ifstream(file_).rdbuf();
    return text.str();
  }
  void write(const std::string& text) const { std::ofstream(file_) << text; }
  /// Newest first.
  std::vector<std::string> keys(StoreSealKeys& source) const {
    std::vector<std::string> all;
    for (const SealKey& key : source.keys()) all.push_back(key.hex());
    return all;
  }

  test::TemporaryFolder folder_;
  std::filesystem::path file_ = folder_.path() / "seal.keys";
  StoreSealKeys::Clock::time_point now_ = StoreSealKeys::Clock::now();
  std::function<StoreSealKeys::Clock::time_point()> clock_ = [this] { return now_; };
};

TEST_F(SealKeysInAStore, AreMadeOnceForTheirOwnerAlone) {
  StoreSealKeys first(folder_.path());
  StoreSealKeys second(folder_.path());
  EXPECT_EQ(keys(first), keys(second));
  EXPECT_EQ(text(), keys(first).front() + "\n");
  struct stat found {};
  ASSERT_EQ(::stat(file_.c_str(), &found), 0);
  EXPECT_EQ(found.st_mode & 0777U, 0600U);
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder_.path()), {}), 1);
  const test::TemporaryFolder other;
  StoreSealKeys of_another(other.path());
  EXPECT_NE(keys(of_another), keys(first));
}

TEST_F(SealKeysInAStore, TheOneBeforeCountsForAMinute) {
  StoreSealKeys source(folder_.path(), clock_);
  const std::string first = keys(source).front();
  std::filesystem::last_write_time(file_, std::filesystem::file_time_type::clock::now() - 1h);
  rotate_seal_key(folder_.path());
  now_ += 2s;
  const std::vector<std::string> both = keys(source);
  ASSERT_EQ(both.size(), 2U);
  EXPECT_NE(both[0], first);
  EXPECT_EQ(both[1], first);
  now_ += 62s;
  EXPECT_EQ(keys(source), std::vector{both[0]});
}

TEST_F(SealKeysInAStore, ABrokenFileIsRefusedAtTheStartAndLeavesTheKeysLater) {
  StoreSealKeys source(folder_.path(), clock_);
  const auto before = keys(source);
  for (const std::string& broken : {std::string(), std::string("\n"), std::string(63, 'a'),
                                    std::string(64, 'A'), std::string(64, 'a') + "\nb\n"}) {
    write(broken);
    try {
      const StoreSealKeys another(folder_.path());
      FAIL() << "took '" << broken << "'";
    } catch (const maps::InputError& error) {
      EXPECT_THAT(error.what(), HasSubstr("seal.keys"));
      EXPECT_THAT(error.what(), HasSubstr("remove"));
      EXPECT_EQ(std::string(error.what()).find("aaaa"), std::string::npos) << "shows a key";
    }
    now_ += 2s;
    EXPECT_EQ(keys(source), before);
  }
}

class SealKeyTableTest : public ::testing::Test {
 protected:
  static std::vector<std::string> keys(StateSealKeys& source) {
    std::vector<std::string> all;
    for (const SealKey& key : source.keys()) all.push_back(key.hex());
    return all;
  }
  /// @param ahead  the clock of the server that does it.
  void rotate(std::chrono::seconds ahead = {}) {
    const auto made = (now_ + ahead).time_since_epoch();
    state_.seal_keys().add(
        {.secret = SealKey::make().hex(), .made_ns = std::chrono::nanoseconds(made).count()});
  }
  /// A thread of its own brings it within a second.
  static void wait_for_two(StateSealKeys& source) {
    const auto end = std::chrono::steady_clock::now() + 20s;
    while (keys(source).size() < 2U && std::chrono::steady_clock::now() < end)
      std::this_thread::sleep_for(10ms);
  }

  test::TemporaryFolder folder_;
  test::UnsyncedCalls unsynced_;
  StoreState state_ = test::state_at(folder_.path() / "state.db", unsynced_);
  StateSealKeys::Clock::time_point now_ = StateSealKeys::Clock::now();
  std::function<StateSealKeys::Clock::time_point()> clock_ = [this] { return now_; };
  std::atomic<std::chrono::seconds> passed_ = 0s;
  std::function<StateSealKeys::Steady::time_point()> steady_ = [this] {
    return StateSealKeys::Steady::time_point() + passed_.load();
  };
};

TEST_F(SealKeyTableTest, ServersOfOneStateHaveOneKey) {
  StateSealKeys first(state_.seal_keys(), folder_.path(), clock_);
  // With the file of a store that had its state to itself.
  const test::TemporaryFolder other;
  std::ofstream(other.path() / "seal.keys") << std::string(64, 'a') << '\n';
  StateSealKeys second(state_.seal_keys(), other.path(), clock_);
  EXPECT_EQ(keys(first).size(), 1U);
  EXPECT_EQ(keys(first), keys(second));
  EXPECT_NE(keys(first).front(), std::string(64, 'a'));
}

TEST_F(SealKeyTableTest, ANewStateTakesTheKeyOfTheFile) {
  std::ofstream(folder_.path() / "seal.keys") << std::string(64, 'b') << '\n';
  StateSealKeys source(state_.seal_keys(), folder_.path(), clock_);
  EXPECT_EQ(keys(source), std::vector{std::string(64, 'b')});
}

TEST_F(SealKeyTableTest, ANewKeySealsWhenAllKnowItAndTheOneBeforeCountsForAMinuteMore) {
  // Also where the clocks of the servers differ.
  for (const std::chrono::seconds ahead : {0s, 3600s, -3600s}) {
    StateSealKeys source(state_.seal_keys(), folder_.path(), clock_, steady_);
    passed_ = passed_.load() + 100s;
    const std::string first = keys(source).front();
    rotate(ahead);
    wait_for_two(source);
    const std::vector<std::string> known = keys(source);
    ASSERT_EQ(known.size(), 2U) << ahead.count();
    EXPECT_EQ(known[0], first);
    passed_ = passed_.load() + 6s;
    EXPECT_EQ(keys(source), (std::vector{known[1], first}));
    passed_ = passed_.load() + 60s;
    EXPECT_EQ(keys(source), std::vector{known[1]});
  }
  rotate();
  rotate();
  EXPECT_EQ(state_.seal_keys().newest().size(), 2U);
}

TEST_F(SealKeyTableTest, AServerThatStartsSealsWithWhatTheOthersSealWith) {
  const std::string first =
      keys(*std::make_unique<StateSealKeys>(state_.seal_keys(), folder_.path(), clock_)).front();
  now_ += 3600s;
  rotate(-3s);
  const std::string second = state_.seal_keys().newest().front().secret;
  StateSealKeys soon(state_.seal_keys(), folder_.path(), clock_, steady_);
  EXPECT_EQ(keys(soon), (std::vector{first, second}));
  now_ += 10s;
  StateSealKeys later(state_.seal_keys(), folder_.path(), clock_, steady_);
  EXPECT_EQ(keys(later), (std::vector{second, first}));
  now_ += 60s;
  StateSealKeys much_later(state_.seal_keys(), folder_.path(), clock_, steady_);
  EXPECT_EQ(keys(much_later), std::vector{second});
}

TEST_F(SealKeysInAStore, WhereNoFileCanBeKeptTheKeyLivesAsLongAsTheProcess) {
  StoreSealKeys source(folder_.path() / "missing");
  EXPECT_EQ(keys(source).size(), 1U);
  EXPECT_EQ(keys(source), keys(source));
  EXPECT_THROW(rotate_seal_key(folder_.path() / "missing"), maps::InputError);
}

class Seals : public SealKeysInAStore {
 protected:
  std::int64_t now_ns_ = 1'700'000'000'000'000'000;
  SessionSeals make() {
    return SessionSeals(std::make_unique<StoreSealKeys>(folder_.path()),
                        [this] { return now_ns_; });
  }
  static ErrorCode refusal(const SessionSeals& seals, const std::string& text) {
    try {
      (void)seals.open(text, kOwner);
    } catch (const ApiError& error) {
      return error.code();
    }
    return ErrorCode::kInternalError;
  }
  std::string first(SessionSeals& seals) {
    SealedSession begun = seals.begin();
    begun.version = "v1";
    begun.digest = session().digest;
    bool is_replay = false;
    return seals.next(begun, kOwner, is_replay);
  }
};

TEST_F(Seals, CountForAMinute) {
  SessionSeals seals = make();
  const std::string text = first(seals);
  now_ns_ += 60'000'000'000;
  EXPECT_EQ(seals.open(text, kOwner).count, 1U);
  now_ns_ += 1;
  EXPECT_EQ(refusal(seals, text), ErrorCode::kSealExpired);
  now_ns_ -= 120'000'000'002;
  EXPECT_EQ(refusal(seals, text), ErrorCode::kSealExpired) << "from the future";
}

TEST_F(Seals, SessionsHaveTheirOwnIds) {
  SessionSeals seals = make();
  EXPECT_NE(seals.open(first(seals), kOwner).id, seals.open(first(seals), kOwner).id);
}

TEST_F(Seals, TellWhatCameTwiceAndWhatOnlyAnotherServerKnows) {
  SessionSeals here = make();
  SessionSeals there = make();
  const std::string text = first(here);
  bool is_replay = true;
  const std::string second = here.next(here.open(text, kOwner), kOwner, is_replay);
  EXPECT_FALSE(is_replay);
  (void)here.next(here.open(text, kOwner), kOwner, is_replay);
  EXPECT_TRUE(is_replay) << "of the newest but one";
  (void)here.next(here.open(second, kOwner), kOwner, is_replay);
  EXPECT_FALSE(is_replay);
  (void)here.next(here.open(text, kOwner), kOwner, is_replay);
  EXPECT_TRUE(is_replay);
  (void)there.next(there.open(text, kOwner), kOwner, is_replay);
  EXPECT_FALSE(is_replay);
}

TEST_F(Seals, OfTheKeyBeforeAreTakenAfterARotation) {
  SessionSeals seals = make();
  const std::string text = first(seals);
  rotate_seal_key(folder_.path());
  SessionSeals restarted = make();
  EXPECT_EQ(restarted.open(text, kOwner).count, 1U);
  rotate_seal_key(folder_.path());
  SessionSeals later = make();
  EXPECT_EQ(refusal(later, text), ErrorCode::kInvalidSeal);
}

}  // namespace seal_test
}  // namespace stillmap::server
