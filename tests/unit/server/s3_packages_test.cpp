#include "blobs/s3_packages.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <filesystem>
#include <memory>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/map_package.hpp>
#include <string>
#include <thread>
#include <vector>

#include <stillmap/maps/text.hpp>
#include "blobs/blob_place.hpp"
#include "store/package_store.hpp"
#include "store/store_upkeep.hpp"
#include "support/disk_calls.hpp"
#include "support/memory_s3.hpp"
#include "support/stored_packages.hpp"
#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::server {
namespace s3_packages_test {

namespace fs = std::filesystem;
using std::chrono::milliseconds;
using test::MemoryS3;
using test::ThrowsSaying;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;

constexpr std::uint64_t kBlock = 4096;

/// A store with its packages in S3, and packages that share files.
class S3PackagesTest : public testing::Test {
 protected:
  S3PackagesTest() {
    fs::create_directory(store_);
    for (const int seed : {1, 2, 3})
      digests_.push_back(test::write_sharing_package(package(seed), seed));
    const fs::path key =
        folder_.write("key", "aws_access_key_id=test:tester\naws_secret_access_key=testing\n");
    fs::permissions(key, fs::perms::owner_read);
    options_.s3 = {.endpoint = s3_.url(),
                   .bucket = "maps",
                   .prefix = "fleet",
                   .credentials_file = key,
                   .retry = {.attempts = 2, .first_pause = milliseconds(1)}};
    options_.cache.folder = folder_.path() / "cache";
  }
  fs::path package(int seed) const { return folder_.path() / std::to_string(seed); }
  std::unique_ptr<PackageStore> open(const std::string& cache = "cache") {
    S3PackagesOptions options = options_;
    options.cache.folder = folder_.path() / cache;
    return std::make_unique<PackageStore>(store_, calls_,
                                          std::make_unique<S3Packages>(options, calls_));
  }
  /// With its manifest.
  std::set<std::string> keys_of(std::initializer_list<int> seeds) const {
    std::set<std::string> keys;
    for (const int seed : seeds) {
      keys.insert("fleet/blobs/" + digests_[static_cast<std::size_t>(seed) - 1]);
      const auto opened = maps::MapPackage::open(package(seed));
      for (const auto& [path, file] : opened->manifest().files)
        keys.insert("fleet/blobs/" + file.sha256);
    }
    return keys;
  }
  /// Of files that were added, as they lie in a cache.
  std::uint64_t disk_bytes_of(std::initializer_list<int> seeds) {
    const std::set<std::string> keys = keys_of(seeds);
    const std::scoped_lock lock(s3_.mutex);
    std::uint64_t bytes = 0;
    for (const std::string& key : keys)
      bytes += (s3_.objects.at(key).size() + kBlock - 1) / kBlock * kBlock;
    return bytes;
  }
  static std::size_t tiles_of(const PackageStore& store, const std::string& version) {
    const auto package = store.open("yard", version);
    EXPECT_THAT(package->verify(), IsEmpty());
    return package->tiles().size();
  }

  test::TemporaryFolder folder_;
  test::UnsyncedCalls calls_;
  MemoryS3 s3_;
  fs::path store_ = folder_.path() / "store";
  std::vector<std::string> digests_;
  S3PackagesOptions options_;
};

TEST_F(S3PackagesTest, WhatIsAddedIsInS3AndOpensElsewhere) {
  const auto store = open();
  EXPECT_TRUE(store->add("yard", "1", package(1)).is_new);
  EXPECT_EQ(s3_.keys(), keys_of({1}));
  EXPECT_EQ(tiles_of(*store, "1"), 2U);
  // Published files need not be fetched.
  EXPECT_THAT(s3_.asked("GET"), IsEmpty());
  EXPECT_FALSE(fs::exists(store_ / "packages"));
  const auto other = open("other");
  EXPECT_EQ(tiles_of(*other, "1"), 2U);
  EXPECT_EQ(other->open("yard", "1")->digest(), digests_[0]);
  EXPECT_EQ(s3_.asked("GET").size(), keys_of({1}).size());
}

TEST_F(S3PackagesTest, FilesThatAreThereAreNotSentAgain) {
  const auto store = open();
  store->add("yard", "1", package(1));
  store->add("yard", "2", package(2));
  EXPECT_EQ(s3_.asked("PUT").size(), keys_of({1, 2}).size());
  EXPECT_LT(keys_of({1, 2}).size(), keys_of({1}).size() + keys_of({2}).size());
  EXPECT_FALSE(store->add("yard", "2", package(2)).is_new);
  store->add("depot", "1", package(1));
  EXPECT_EQ(s3_.asked("PUT").size(), keys_of({1, 2}).size());
}

TEST_F(S3PackagesTest, ARowIsWrittenOnlyWhenAllIsThere) {
  const auto store = open();
  s3_.set_away(true);
  EXPECT_THAT([&] { store->add("yard", "1", package(1)); },
              ThrowsSaying<maps::StorageError>({"s3://maps/fleet/blobs/", "503"}));
  EXPECT_THAT(store->state().maps(), IsEmpty());
  s3_.set_away(false);
  store->add("yard", "1", package(1));
  EXPECT_THAT(verify_store(*store), IsEmpty());
}

TEST_F(S3PackagesTest, ARemovedPackageTakesWhatNoOtherHas) {
  const auto store = open();
  for (const int seed : {1, 2}) store->add("yard", std::to_string(seed), package(seed));
  EXPECT_TRUE(store->remove("yard", "1"));
  EXPECT_EQ(s3_.keys(), keys_of({2}));
  EXPECT_THAT(verify_store(*store), IsEmpty());
  store->remove_map("yard");
  EXPECT_THAT(s3_.keys(), IsEmpty());
}

TEST_F(S3PackagesTest, ARemovalGoesOnWhenS3IsBack) {
  const auto store = open();
  for (const int seed : {1, 2}) store->add("yard", std::to_string(seed), package(seed));
  s3_.set_away(true);
  EXPECT_FALSE(store->remove("yard", "1"));
  EXPECT_EQ(store->state().find_version("yard", "1"), std::nullopt);
  EXPECT_EQ(tiles_of(*store, "2"), 2U);
  s3_.set_away(false);
  (void)clear_unused(*store);
  EXPECT_EQ(s3_.keys(), keys_of({2}));
  EXPECT_THAT(store->state().condemned(), IsEmpty());
}

/// While a package is sent, another one is removed with which it shares files.
TEST_F(S3PackagesTest, ARemovalMeanwhileTakesNothingThatIsNeeded) {
  const auto store = open();
  store->add("yard", "1", package(1));
  // As `send` has found them there; now they go.
  S3PackagesOptions options = options_;
  options.cache.folder = folder_.path() / "third";
  S3Packages blobs(options, calls_);
  blobs.send(package(2), store->state().files(), /*again=*/false);
  store->remove_map("yard", WhenActive::kRemove);
  EXPECT_NE(s3_.keys(), keys_of({2}));
  blobs.confirm(package(2), store->state().files());
  EXPECT_EQ(s3_.keys(), keys_of({2}));
}

TEST_F(S3PackagesTest, VerifyCountsMissingAndWrongObjects) {
  const auto store = open();
  for (const int seed : {1, 2}) store->add("yard", std::to_string(seed), package(seed));
  EXPECT_THAT(verify_store(*store), IsEmpty());
  const auto manifest = maps::MapPackage::open(package(1))->manifest();
  {
    const std::scoped_lock lock(s3_.mutex);
    s3_.objects.erase("fleet/blobs/" + manifest.files.at("one.txt").sha256);
    s3_.objects.at("fleet/blobs/" + manifest.files.at("regions/1_0.node").sha256)[0] ^= 1;
  }
  const auto problems = verify_store(*store);
  ASSERT_THAT(problems, SizeIs(1));
  EXPECT_EQ(problems[0].version, "1");
  EXPECT_EQ(problems[0].what,
            "2 objects missing: one.txt other.txt; 1 objects wrong: regions/1_0.node");
  // Adding it again mends it.
  store->add("yard", "1", package(1));
  EXPECT_THAT(verify_store(*store), IsEmpty());
}

TEST_F(S3PackagesTest, WithoutS3WhatIsLocalGoesOn) {
  const auto store = open();
  store->add("yard", "1", package(1));
  store->add("yard", "2", package(2));
  (void)store->open("yard", "1");
  s3_.set_away(true);
  EXPECT_EQ(tiles_of(*store, "1"), 2U);
  // After a restart, too.
  EXPECT_EQ(tiles_of(*open(), "1"), 2U);
  EXPECT_THROW((void)open("other")->open("yard", "1"), maps::StorageError);
}

TEST_F(S3PackagesTest, ALostCacheIsFilledAgain) {
  const auto store = open();
  store->add("yard", "1", package(1));
  fs::remove_all(folder_.path() / "cache");
  EXPECT_EQ(tiles_of(*store, "1"), 2U);
}

TEST_F(S3PackagesTest, AFolderWithoutAPackageGivesWay) {
  const auto store = open();
  store->add("yard", "1", package(1));
  folder_.write("cache/packages/" + digests_[0] + "/levels/half", "derived");
  EXPECT_EQ(tiles_of(*store, "1"), 2U);
}

TEST_F(S3PackagesTest, AnOpenPackageStaysInASmallCache) {
  {
    const auto store = open();
    for (const int seed : {1, 2, 3}) store->add("yard", std::to_string(seed), package(seed));
  }
  options_.cache.most_bytes = disk_bytes_of({1, 2}) + 2 * kBlock;
  ASSERT_GT(disk_bytes_of({1, 2, 3}), options_.cache.most_bytes);
  const auto store = open("small");
  const auto first = store->open("yard", "1");
  EXPECT_EQ(tiles_of(*store, "2"), 2U);
  EXPECT_EQ(tiles_of(*store, "3"), 2U);
  EXPECT_TRUE(fs::exists(folder_.path() / "small" / "packages" / digests_[0]));
  EXPECT_FALSE(fs::exists(folder_.path() / "small" / "packages" / digests_[1]));
  EXPECT_THAT(first->verify(), IsEmpty());
  // With two open ones there is no room for a third.
  const auto third = store->open("yard", "3");
  EXPECT_THAT([&] { (void)store->open("yard", "2"); },
              ThrowsSaying<maps::StorageError>({"raise cache_bytes"}));
}

TEST_F(S3PackagesTest, ThreadsBringAPackageOnce) {
  open()->add("yard", "1", package(1));
  const auto store = open("other");
  {
    std::vector<std::jthread> threads;
    for (int i = 0; i < 8; ++i) threads.emplace_back([&] { EXPECT_EQ(tiles_of(*store, "1"), 2U); });
  }
  EXPECT_EQ(s3_.asked("GET").size(), keys_of({1}).size());
}

TEST_F(S3PackagesTest, CachesThatSeveralProcessesShareStayWhole) {
  const auto writer = open();
  for (const int seed : {1, 2, 3}) writer->add("yard", std::to_string(seed), package(seed));
  // Each process has a package open, and one beside it.
  options_.cache.most_bytes = 2 * disk_bytes_of({1, 2, 3});
  std::vector<std::jthread> threads;
  for (int i = 0; i < 3; ++i)
    threads.emplace_back([&, i] {
      const auto store = open("shared");
      for (int round = 0; round < 12; ++round)
        EXPECT_NO_THROW(EXPECT_EQ(tiles_of(*store, std::to_string((round * (i + 1)) % 3 + 1)), 2U));
    });
}

TEST_F(S3PackagesTest, GcRemovesObjectsThatNoPackageHas) {
  const auto store = open();
  store->add("yard", "1", package(1));
  // Of an upload that was killed: the manifest is the last to be sent.
  const std::string lost = "fleet/blobs/" + maps::sha256_of("lost");
  const auto put = [&] {
    const std::scoped_lock lock(s3_.mutex);
    s3_.objects[lost] = "lost";
  };
  put();
  EXPECT_EQ(clear_unused(*store).blobs, 1U);
  EXPECT_EQ(s3_.keys(), keys_of({1}));
  // What was written just now may be of a package that is being sent.
  put();
  s3_.modified = "2100-01-01T00:00:00.000Z";
  EXPECT_EQ(clear_unused(*store).blobs, 0U);
}

TEST_F(S3PackagesTest, GcTouchesNoOtherStore) {
  open()->add("yard", "1", package(1));
  fs::remove_all(store_);
  fs::create_directory(store_);
  const auto store = open();
  EXPECT_THAT([&] { (void)clear_unused(*store); },
              ThrowsSaying<maps::InputError>({"s3://maps/fleet/blobs/", "does not know"}));
  EXPECT_EQ(s3_.keys(), keys_of({1}));
}

/// What a store notes of where its packages are.
class BlobPlaceTest : public S3PackagesTest {
 protected:
  BlobPlaceTest() {
    place_.blobs = "s3://maps/fleet";
    place_.s3.endpoint = s3_.url();
    place_.s3.credentials_file = options_.s3.credentials_file.string();
  }
  ServerOptions place_;
};

TEST_F(BlobPlaceTest, EveryCommandFindsThePackages) {
  {
    PackageStore store = open_store(store_, place_);
    store.add("yard", "1", package(1));
  }
  EXPECT_EQ(s3_.keys(), keys_of({1}));
  EXPECT_THAT(verify_store(open_store(store_)), IsEmpty());
  // A server that is told nothing finds them, too.
  EXPECT_THAT(verify_store(open_store(store_, ServerOptions())), IsEmpty());
  const std::string noted = maps::read_text(store_ / "blobs.json");
  EXPECT_THAT(noted, testing::Not(HasSubstr("testing")));
  EXPECT_THAT(noted, HasSubstr("s3://maps/fleet"));
}

TEST_F(BlobPlaceTest, PackagesDoNotMoveByThemselves) {
  { PackageStore(store_, calls_).add("yard", "1", package(1)); }
  EXPECT_THAT([&] { (void)open_store(store_, place_); },
              ThrowsSaying<maps::InputError>({store_.string(), "stillmap store to-s3"}));
  EXPECT_FALSE(fs::exists(store_ / "blobs.json"));
  EXPECT_THAT(verify_store(open_store(store_)), IsEmpty());
  EXPECT_EQ(move_to_s3(store_, place_), 1U);
  EXPECT_EQ(s3_.keys(), keys_of({1}));
  EXPECT_FALSE(fs::exists(store_ / "packages"));
  EXPECT_THAT(verify_store(open_store(store_)), IsEmpty());
  place_.blobs = "s3://maps/elsewhere";
  EXPECT_THAT([&] { (void)open_store(store_, place_); },
              ThrowsSaying<maps::InputError>({"s3://maps/fleet", "s3://maps/elsewhere"}));
}

TEST_F(BlobPlaceTest, AMoveThatFailedMayBeRepeated) {
  { PackageStore(store_, calls_).add("yard", "1", package(1)); }
  place_.s3.credentials_file = (folder_.path() / "none").string();
  EXPECT_THROW((void)move_to_s3(store_, place_), maps::StorageError);
  EXPECT_THAT(verify_store(open_store(store_)), IsEmpty());
  place_.s3.credentials_file = options_.s3.credentials_file.string();
  EXPECT_EQ(move_to_s3(store_, place_), 1U);
  EXPECT_THAT(verify_store(open_store(store_)), IsEmpty());
}

TEST_F(BlobPlaceTest, AServerWithoutCredentialsDoesNotStart) {
  place_.s3.credentials_file = (folder_.path() / "none").string();
  EXPECT_THAT([&] { (void)open_store(store_, place_); },
              ThrowsSaying<maps::StorageError>({place_.s3.credentials_file}));
  EXPECT_FALSE(fs::exists(store_ / "blobs.json"));
}

}  // namespace s3_packages_test
}  // namespace stillmap::server
