#include "catalog/map_catalog.hpp"

#include "blobs/s3_packages.hpp"
#include "errors/api_error.hpp"
#include "service_fixture.hpp"
#include "support/disk_calls.hpp"
#include "support/memory_s3.hpp"
#include "support/stored_packages.hpp"

#include <gmock/gmock.h>

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <filesystem>
#include <fstream>
#include <map>
#include <mutex>
#include <set>
#include <stdexcept>
#include <thread>

namespace stillmap::server {
namespace map_catalog_test {

using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;
using ::testing::SizeIs;

/// Makes aligners as the test says.
class ScriptedBuilder {
 public:
  Aligners build(const maps::MapPackage& map) {
    std::unique_lock lock(mutex_);
    ++built_[map.digest()];
    changed_.wait(lock, [&] { return !held_.contains(map.digest()); });
    if (broken_.contains(map.digest())) throw std::runtime_error("too few voxels");
    return {{"default", std::make_shared<StubAligner>()}};
  }
  void set_broken(const std::string& digest, bool broken) {
    const std::scoped_lock lock(mutex_);
    broken ? (void)broken_.insert(digest) : (void)broken_.erase(digest);
  }
  void set_held(const std::string& digest, bool held) {
    const std::scoped_lock lock(mutex_);
    held ? (void)held_.insert(digest) : (void)held_.erase(digest);
    changed_.notify_all();
  }
  int built(const std::string& digest) {
    const std::scoped_lock lock(mutex_);
    return built_[digest];
  }

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  std::map<std::string, int> built_;
  std::set<std::string> broken_, held_;
};

/// A catalog over `town` with v1 active, v2 beside it, and as many more as a test adds.
class MapCatalogTest : public ::testing::Test {
 protected:
  MapCatalogTest() {
    add(1);
    add(2);
    store_.activate("town", "v1");
  }
  void TearDown() override {
    for (const auto& [n, digest] : digests_) builder_.set_held(digest, false);
  }

  /// Publishes a package of its own as version v<n>.
  void add(int n) {
    const auto folder = folder_.path() / ("package" + std::to_string(n));
    digests_[n] = test::write_package(folder, n);
    store_.add("town", "v" + std::to_string(n), folder);
  }
  MapCatalog& start() {
    catalog_.emplace(
        store_, [this](const auto& map, const auto&) { return builder_.build(map); }, &metrics_);
    wait([&] { return catalog_->active().at(0).state != MapState::kLoading; });
    return *catalog_;
  }
  static void wait(const std::function<bool()>& come) {
    const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(20);
    while (!come()) {
      ASSERT_LT(std::chrono::steady_clock::now(), end);
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
  }
  [[nodiscard]] std::string served() const { return catalog_->find("town").version; }
  static ErrorCode code_of(const std::function<void()>& call) {
    try {
      call();
    } catch (const ApiError& error) {
      return error.code();
    }
    throw std::logic_error("nothing was refused");
  }
  static StoreRefusal::Reason reason_of(const std::function<void()>& call) {
    try {
      call();
    } catch (const StoreRefusal& error) {
      return error.reason();
    }
    throw std::logic_error("nothing was refused");
  }

  test::TemporaryFolder folder_{test::memory_folder()}, store_folder_{test::memory_folder()};
  PackageStore store_{store_folder_.path()};
  std::map<int, std::string> digests_;
  ScriptedBuilder builder_;
  Metrics metrics_{"0"};
  std::optional<MapCatalog> catalog_;
};

TEST_F(MapCatalogTest, QueriesEndOnTheVersionThatTheyBeganWith) {
  MapCatalog& catalog = start();
  const ServedVersion begun = catalog.ready("town", {});
  catalog.activate("town", "v2", {}, true);
  EXPECT_EQ(catalog.ready("town", {}).version, "v2");
  store_.activate("town", "v2");
  store_.remove("town", "v1");
  EXPECT_EQ(begun.version, "v1");
  const localization::Prior prior;
  EXPECT_EQ(begun.aligners->front().second->align({}, prior).status, localization::PoseStatus::kOk);
  EXPECT_EQ(begun.package->tile({}).size(), 100U);
}

TEST_F(MapCatalogTest, WhoHasSeenANewerRevisionIsNotAnsweredWithAnOlderOne) {
  MapCatalog& catalog = start();
  const std::int64_t old = catalog.ready("town", {}).revision;
  EXPECT_EQ(old, store_.state().map("town").revision);
  // Operators see it, too.
  EXPECT_EQ(catalog.active().front().revision, old);
  builder_.set_held(digests_[2], true);
  // By another server, which serves it already.
  const std::int64_t newer = store_.activate("town", "v2").revision;
  catalog.refresh();
  EXPECT_EQ(code_of([&] { (void)catalog.ready("town", {}, {}, newer); }), ErrorCode::kMapLoading);
  const ServedVersion before = catalog.ready("town", {}, {}, old);
  EXPECT_EQ(before.version, "v1");
  EXPECT_EQ(before.revision, old);
  // Whoever names a version gets that.
  EXPECT_EQ(catalog.ready("town", "v1", {}, newer).revision, 0);
  builder_.set_held(digests_[2], false);
  wait([&] { return served() == "v2"; });
  EXPECT_EQ(catalog.ready("town", {}, {}, newer).revision, newer);
}

TEST_F(MapCatalogTest, WhoHasSeenARevisionThatARestoreTookAwayIsAnsweredOnceTheStoreWasRead) {
  MapCatalog& catalog = start();
  const std::int64_t now = catalog.ready("town", {}).revision;
  EXPECT_EQ(code_of([&] { (void)catalog.ready("town", {}, {}, now + 1); }), ErrorCode::kMapLoading);
  const auto answers = [&](std::int64_t seen) {
    try {
      return catalog.ready("town", {}, {}, seen).revision == now;
    } catch (const ApiError&) {
      return false;
    }
  };
  wait([&] { return answers(now + 1); });
  EXPECT_EQ(code_of([&] { (void)catalog.ready("town", {}, {}, now + 2); }), ErrorCode::kMapLoading)
      << "that one may be there by now";
  // By another server: there is one of that number again.
  builder_.set_held(digests_[2], true);
  store_.activate("town", "v2");
  wait([&] { return !answers(now + 1); });
  EXPECT_FALSE(answers(now + 2)) << "there is a newer one, which is loading";
  builder_.set_held(digests_[2], false);
  wait([&] { return served() == "v2"; });
  EXPECT_EQ(catalog.ready("town", {}, {}, now + 1).revision, now + 1);
}

TEST_F(MapCatalogTest, OldVersionServesWhileTheNewOneIsMadeReady) {
  MapCatalog& catalog = start();
  builder_.set_held(digests_[2], true);
  std::thread activation([&] { catalog.activate("town", "v2", {}, true); });
  wait([&] { return builder_.built(digests_[2]) == 1; });
  EXPECT_EQ(catalog.ready("town", {}).version, "v1");
  EXPECT_EQ(store_.state().map("town").active, "v1");
  builder_.set_held(digests_[2], false);
  activation.join();
  EXPECT_EQ(catalog.ready("town", {}).version, "v2");
}

TEST_F(MapCatalogTest, ServesAMendedPackageSoonAndTheOldOneUntilThen) {
  const auto spoil = [&](char byte) {
    const auto package = store_folder_.path() / "packages" / digests_[1];
    // The step of the first point's x, behind the tile's head.
    std::fstream(package / test::pack_of(package), std::ios::in | std::ios::out | std::ios::binary)
        .seekp(33)
        .put(byte);
  };
  spoil('\x55');
  MapCatalog& catalog = start();
  const float damaged = catalog.find("town").package->tile({})[0].x;
  const float sound = maps::MapPackage::open(folder_.path() / "package1")->tile({})[0].x;
  builder_.set_held(digests_[1], true);
  store_.add("town", "v1", folder_.path() / "package1");
  wait([&] { return builder_.built(digests_[1]) == 2; });
  EXPECT_EQ(catalog.ready("town", {}).package->tile({})[0].x, damaged);
  builder_.set_held(digests_[1], false);
  wait([&] { return catalog.ready("town", {}).package->tile({})[0].x == sound; });
  EXPECT_NE(damaged, sound);
  EXPECT_EQ(builder_.built(digests_[1]), 2);

  spoil('\x56');
  builder_.set_broken(digests_[1], true);
  store_.add("town", "v1", folder_.path() / "package1");
  wait([&] { return builder_.built(digests_[1]) == 3; });
  EXPECT_EQ(catalog.ready("town", {}).version, "v1") << "goes on with what it has";
}

TEST_F(MapCatalogTest, MendsAMapThatCouldNotBeOpened) {
  std::filesystem::remove_all(store_folder_.path() / "packages" / digests_[1]);
  MapCatalog& catalog = start();
  EXPECT_EQ(catalog.active().at(0).state, MapState::kFailed);
  store_.add("town", "v1", folder_.path() / "package1");
  wait([&] { return catalog.active().at(0).state == MapState::kReady; });
}

TEST_F(MapCatalogTest, VersionThatFailsToLoadLeavesTheOldOneServing) {
  MapCatalog& catalog = start();
  builder_.set_broken(digests_[2], true);
  EXPECT_EQ(code_of([&] { catalog.activate("town", "v2", {}, true); }),
            ErrorCode::kVersionUnusable);
  EXPECT_EQ(catalog.ready("town", {}).version, "v1");
  EXPECT_EQ(store_.state().map("town").active, "v1");
  EXPECT_EQ(store_.state().map("town").revision, 1);
  EXPECT_THAT(metrics_.text(), HasSubstr("stillmap_map_load_failures_total{map=\"town\"} 1\n"));
  EXPECT_THAT(metrics_.text(), HasSubstr("stillmap_map_load_seconds{map=\"town\"}"));
  builder_.set_broken(digests_[2], false);
  catalog.activate("town", "v2", {}, true);
  EXPECT_EQ(served(), "v2");
}

TEST_F(MapCatalogTest, PackageThatVanishedLeavesTheOldOneServing) {
  MapCatalog& catalog = start();
  std::filesystem::remove(store_folder_.path() / "packages" / digests_[2] / "manifest.json");
  EXPECT_EQ(code_of([&] { catalog.activate("town", "v2", {}, true); }),
            ErrorCode::kVersionUnusable);
  EXPECT_EQ(catalog.ready("town", {}).version, "v1");
}

TEST_F(MapCatalogTest, WhatAnotherProcessActivatesIsServedWithoutBeingToldOf) {
  start();
  PackageStore other(store_folder_.path());
  const auto begin = std::chrono::steady_clock::now();
  other.activate("town", "v2");
  wait([&] { return served() == "v2"; });
  const std::chrono::duration<double> passed = std::chrono::steady_clock::now() - begin;
  RecordProperty("milliseconds", static_cast<int>(1000.0 * passed.count()));
}

TEST_F(MapCatalogTest, BrokenVersionOfAnotherProcessIsNamedAndTriedAgainWhenItIsWantedAgain) {
  MapCatalog& catalog = start();
  builder_.set_broken(digests_[2], true);
  PackageStore other(store_folder_.path());
  other.activate("town", "v2");
  catalog.refresh();
  wait([&] {
    const auto waiting = catalog.waiting();
    return !waiting.empty() && waiting.front().state == MapState::kFailed;
  });
  EXPECT_EQ(catalog.waiting().front().failure, "too few voxels");
  EXPECT_EQ(catalog.ready("town", {}).version, "v1");
  other.roll_back("town");
  catalog.refresh();
  wait([&] { return catalog.waiting().empty(); });
  EXPECT_EQ(served(), "v1");
  builder_.set_broken(digests_[2], false);
  other.activate("town", "v2");
  catalog.refresh();
  wait([&] { return served() == "v2"; });
}

TEST_F(MapCatalogTest, VersionThatWasRemovedIsNotFoundAndComesAgainAsItWas) {
  MapCatalog& catalog = start();
  EXPECT_EQ(catalog.find("town", "v2").package->digest(), digests_[2]);
  store_.remove("town", "v2");
  using Reason = StoreRefusal::Reason;
  EXPECT_EQ(reason_of([&] { (void)catalog.find("town", "v2"); }), Reason::kUnknownVersion);
  EXPECT_EQ(reason_of([&] { catalog.activate("town", "v2", {}, true); }), Reason::kUnknownVersion);
  add(3);
  EXPECT_EQ(reason_of([&] { store_.add("town", "v2", folder_.path() / "package3"); }),
            Reason::kOtherDigest);
  store_.add("town", "v2", folder_.path() / "package2");
  catalog.activate("town", "v2", {}, true);
  EXPECT_EQ(catalog.ready("town", {}).package->digest(), digests_[2]);
}

TEST_F(MapCatalogTest, RollsBackAndForthAndOnlyWhereThereWasAnother) {
  MapCatalog& catalog = start();
  EXPECT_EQ(reason_of([&] { catalog.roll_back("town", {}, true); }),
            StoreRefusal::Reason::kNoPrevious);
  catalog.activate("town", "v2", {}, true);
  EXPECT_EQ(catalog.roll_back("town", {}, true).revision, 3);
  EXPECT_EQ(served(), "v1");
  catalog.roll_back("town", 3, true);
  EXPECT_EQ(served(), "v2");
  EXPECT_EQ(reason_of([&] { catalog.roll_back("town", 3, true); }),
            StoreRefusal::Reason::kOtherRevision);
  EXPECT_EQ(served(), "v2");
}

TEST_F(MapCatalogTest, RollingBackToWhatCannotBeLoadedChangesNothing) {
  builder_.set_broken(digests_[2], true);
  store_.activate("town", "v2");
  store_.activate("town", "v1");
  MapCatalog& catalog = start();
  EXPECT_EQ(code_of([&] { catalog.roll_back("town", {}, true); }), ErrorCode::kVersionUnusable);
  EXPECT_EQ(served(), "v1");
  EXPECT_EQ(store_.state().map("town").active, "v1");
}

TEST_F(MapCatalogTest, VersionInAnotherFrameIsRefusedUnlessThatIsMeant) {
  MapCatalog& catalog = start();
  EXPECT_EQ(code_of([&] { catalog.activate("town", "v2"); }), ErrorCode::kOtherFrame);
  EXPECT_EQ(served(), "v1");
  EXPECT_EQ(catalog.activate("town", "v1").revision, 1);
  catalog.activate("town", "v2", {}, true);
  EXPECT_EQ(served(), "v2");
  EXPECT_EQ(code_of([&] { catalog.roll_back("town"); }), ErrorCode::kOtherFrame);
}

TEST_F(MapCatalogTest, StaleRevisionChangesNothing) {
  MapCatalog& catalog = start();
  EXPECT_EQ(reason_of([&] { catalog.activate("town", "v2", 0, true); }),
            StoreRefusal::Reason::kOtherRevision);
  EXPECT_EQ(served(), "v1");
}

TEST_F(MapCatalogTest, VersionThatSomeoneAsksForIsLoadedMeanwhile) {
  MapCatalog& catalog = start();
  EXPECT_EQ(catalog.find("town", "v2").state, MapState::kOpened);
  EXPECT_EQ(builder_.built(digests_[2]), 0);
  try {
    (void)catalog.ready("town", "v2");
    FAIL() << "it was never loaded";
  } catch (const ApiError& error) {
    EXPECT_EQ(error.code(), ErrorCode::kMapLoading);
    ASSERT_THAT(error.headers(), SizeIs(1));
    EXPECT_EQ(error.headers().front().first, "Retry-After");
  }
  wait([&] { return catalog.find("town", "v2").state == MapState::kReady; });
  EXPECT_EQ(catalog.ready("town", "v2").version, "v2");
  EXPECT_EQ(served(), "v1");
}

TEST_F(MapCatalogTest, ClosesTheVersionsThatNobodyAskedForLongest) {
  for (int n = 3; n <= 8; ++n) add(n);
  MapCatalog& catalog = start();
  std::map<int, std::weak_ptr<const maps::MapPackage>> opened;
  for (int n = 1; n <= 8; ++n) opened[n] = catalog.find("town", "v" + std::to_string(n)).package;
  catalog.refresh();
  // The active one and four others.
  wait([&] { return opened[2].expired() && opened[3].expired() && opened[4].expired(); });
  EXPECT_FALSE(opened[1].expired());
  for (int n = 5; n <= 8; ++n) EXPECT_FALSE(opened[n].expired()) << n;
}

TEST_F(MapCatalogTest, ClosesVersionsAlsoWhileOthersAreBeingLoaded) {
  for (int n = 3; n <= 8; ++n) add(n);
  MapCatalog& catalog = start();
  builder_.set_held(digests_[2], true);
  builder_.set_held(digests_[8], true);
  std::map<int, std::weak_ptr<const maps::MapPackage>> opened;
  for (int n = 2; n <= 8; ++n) {
    const std::string version = "v" + std::to_string(n);
    opened[n] = catalog.find("town", version).package;
    EXPECT_EQ(code_of([&] { (void)catalog.ready("town", version); }), ErrorCode::kMapLoading);
  }
  builder_.set_held(digests_[2], false);
  wait([&] { return opened[2].expired() && opened[3].expired(); });
}

TEST_F(MapCatalogTest, WhatWasActivatedServesFromThenOnWhateverIsLookedAtMeanwhile) {
  MapCatalog& catalog = start();
  std::jthread looking([&](const std::stop_token& stop) {
    while (!stop.stop_requested()) catalog.refresh();
  });
  int wrong = 0;
  for (int i = 0; i < 200; ++i) {
    const std::string version = i % 2 == 0 ? "v2" : "v1";
    catalog.activate("town", version, {}, true);
    for (int looks = 0; looks < 20; ++looks) wrong += served() == version ? 0 : 1;
  }
  EXPECT_EQ(wrong, 0);
}

TEST_F(MapCatalogTest, FailureIsToldWithoutPlacesOfTheMachine) {
  std::filesystem::remove(store_folder_.path() / "packages" / digests_[1] / "manifest.json");
  const ServedVersion broken = start().active().front();
  EXPECT_EQ(broken.state, MapState::kFailed);
  EXPECT_THAT(broken.failure, HasSubstr(digests_[1]));
  EXPECT_THAT(broken.failure, Not(HasSubstr(store_folder_.path().string())));
}

TEST_F(MapCatalogTest, MapWithoutAnActiveVersionSaysSo) {
  MapCatalog& catalog = start();
  store_.create_map("depot");
  EXPECT_EQ(code_of([&] { (void)catalog.find("depot"); }), ErrorCode::kNoActiveVersion);
  EXPECT_EQ(reason_of([&] { (void)catalog.find("village"); }), StoreRefusal::Reason::kUnknownMap);
  store_.remove_map("town", WhenActive::kRemove);
  catalog.refresh();
  wait([&] { return catalog.active().empty(); });
  EXPECT_THAT(catalog.waiting(), IsEmpty());
}

TEST_F(MapCatalogTest, ManyThreadsSeeOneVersionOrTheOther) {
  add(3);
  MapCatalog& catalog = start();
  std::atomic<bool> done = false;
  std::atomic<int> answers = 0;
  std::atomic<int> wrong = 0;
  const auto query = [&] {
    while (!done) {
      const ServedVersion served = catalog.ready("town", {});
      const int n = served.version == "v1" ? 1 : 2;
      if (served.package->digest() != digests_[n] || !served.aligners) ++wrong;
      (void)catalog.active();
      (void)catalog.waiting();
      (void)catalog.find("town", "v3");
      ++answers;
    }
  };
  std::thread first(query);
  std::thread second(query);
  for (int i = 0; i < 30; ++i) {
    catalog.activate("town", i % 2 == 0 ? "v2" : "v1", {}, true);
    catalog.refresh();
  }
  wait([&] { return answers > 20; });
  done = true;
  first.join();
  second.join();
  EXPECT_EQ(wrong, 0);
  EXPECT_EQ(store_.state().map("town").revision, 31);
}

/// Two servers on one store whose packages are in S3, each with a cache. The first one publishes
/// and activates, the second one follows.
class FollowedFromS3 : public MapCatalogTest {
 protected:
  FollowedFromS3() {
    first_.add("town", "v1", folder_.path() / "package1");
    first_.add("town", "v2", folder_.path() / "package2");
    first_.activate("town", "v1");
    follow();
    wait([&] { return catalog_->active().at(0).state == MapState::kReady; });
    first_.activate("town", "v2");
    wait([&] { return served() == "v2"; });
  }
  void TearDown() override {
    second_.blobs()->stop();
    catalog_.reset();
  }
  std::unique_ptr<PackageBlobs> blobs(const std::string& cache) {
    const auto key =
        folder_.write("key", "aws_access_key_id=test:tester\naws_secret_access_key=testing\n");
    std::filesystem::permissions(key, std::filesystem::perms::owner_read);
    S3PackagesOptions options;
    options.s3 = {.endpoint = s3_.url(), .bucket = "maps", .credentials_file = key};
    options.s3.retry = {.attempts = 2, .first_pause = std::chrono::milliseconds(1)};
    options.cache.folder = folder_.path() / cache;
    return std::make_unique<S3Packages>(options, calls_);
  }
  /// Starts the second server, anew.
  void follow() {
    catalog_.reset();
    catalog_.emplace(second_, [this](const auto& map, const auto&) {
      if (is_refused_ || !map.verify().empty())
        throw maps::InputError("a tile", "another SHA-256", "what the manifest says");
      return builder_.build(map);
    });
  }
  /// A map whose package the second server has to fetch.
  void add_field() {
    test::write_package(folder_.path() / "field", 3);
    first_.add("field", "v1", folder_.path() / "field");
  }
  MapState state_of(const std::string& map) {
    for (const ServedVersion& each : catalog_->active())
      if (each.map == map) return each.state;
    return MapState::kOpened;
  }

  std::atomic<bool> is_refused_ = false;
  test::UnsyncedCalls calls_;
  test::MemoryS3 s3_;
  test::TemporaryFolder s3_store_{test::memory_folder()};
  PackageStore first_{s3_store_.path(), calls_, blobs("first")};
  PackageStore second_{s3_store_.path(), calls_, blobs("second")};
};

TEST_F(FollowedFromS3, FollowsOtherMapsWhileAMapIsFetched) {
  add_field();
  // With v1 in the cache alone.
  follow();
  wait([&] { return state_of("town") == MapState::kReady; });
  {
    const std::scoped_lock nothing_comes(s3_.mutex);
    first_.activate("field", "v1");
    wait([&] { return state_of("field") == MapState::kLoading; });
    EXPECT_EQ(code_of([&] { (void)catalog_->ready("field", {}); }), ErrorCode::kMapLoading);
    EXPECT_EQ(code_of([&] { (void)catalog_->find("field", "v1"); }), ErrorCode::kMapLoading);
    first_.roll_back("town");
    wait([&] { return served() == "v1"; });
    // Asked of this server, too.
    catalog_->activate("town", "v2", {}, true);
    EXPECT_EQ(served(), "v2");
    EXPECT_EQ(state_of("field"), MapState::kLoading);
  }
  wait([&] { return state_of("field") == MapState::kReady; });
  EXPECT_EQ(catalog_->ready("field", {}).version, "v1");
}

TEST_F(FollowedFromS3, FetchesWhatIsDamagedInItsCacheAgain) {
  catalog_.reset();
  const std::size_t fetched = s3_.asked("GET").size();
  const auto package = folder_.path() / "second" / "packages" / digests_[2];
  std::fstream(package / test::pack_of(package), std::ios::in | std::ios::out | std::ios::binary)
      .seekp(33)
      .put('\x55');
  follow();
  wait([&] { return state_of("town") == MapState::kReady; });
  EXPECT_THAT(catalog_->find("town").package->verify(), IsEmpty());
  EXPECT_EQ(s3_.asked("GET").size(), fetched + 1) << "the others are as they were";
}

TEST_F(FollowedFromS3, DoesNotWaitForS3WithFactsOfEachVersion) {
  for (int n = 3; n <= 5; ++n) {
    digests_[n] = test::write_package(folder_.path() / ("package" + std::to_string(n)), n);
    first_.add("town", "v" + std::to_string(n), folder_.path() / ("package" + std::to_string(n)));
  }
  const VersionFactsTable facts(second_);
  s3_.set_away(true);
  const std::size_t asked = s3_.asked("GET").size();
  const auto version = [&](const char* name) { return second_.state().version("town", name); };
  for (const char* name : {"v3", "v4", "v5", "v3"})
    EXPECT_THROW((void)facts.of("town", version(name)), maps::StorageError) << name;
  EXPECT_EQ(s3_.asked("GET").size(), asked + 1);
  EXPECT_NO_THROW((void)facts.of("town", version("v1"))) << "is in the cache";
}

TEST_F(FollowedFromS3, SaysWhatIsLeftToDoWhenItsCacheIsWhole) {
  const std::size_t fetched = s3_.asked("GET").size();
  is_refused_ = true;
  follow();
  wait([&] { return state_of("town") == MapState::kFailed; });
  EXPECT_THAT(catalog_->active().front().failure, HasSubstr("delete the cache"));
  EXPECT_EQ(s3_.asked("GET").size(), fetched);
}

TEST_F(MapCatalogTest, FollowsOtherMapsWhileAMapIsLoaded) {
  start();
  test::write_package(folder_.path() / "field", 3);
  store_.add("field", "v1", folder_.path() / "field");
  const std::string field = store_.state().version("field", "v1").digest;
  catalog_->activate("town", "v2", {}, true);
  builder_.set_held(field, true);
  store_.activate("field", "v1");
  wait([&] { return builder_.built(field) == 1; });
  store_.roll_back("town");
  wait([&] { return served() == "v1"; });
  store_.remove_map("field", WhenActive::kRemove);
  wait([&] { return catalog_->active().size() == 1; });
  builder_.set_held(field, false);
}

}  // namespace map_catalog_test
}  // namespace stillmap::server
