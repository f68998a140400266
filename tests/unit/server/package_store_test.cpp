#include "store/package_store.hpp"
#include "store/store_upkeep.hpp"

#include <stillmap/maps/error.hpp>
#include "store/map_name.hpp"
#include "store/package_hold.hpp"

#include <algorithm>
#include <fstream>
#include <functional>
#include <map>
#include <new>
#include <string>
#include <thread>
#include <vector>

#include "store/folder_lock.hpp"
#include "support/disk_calls.hpp"
#include "support/store_contents.hpp"
#include "support/stored_packages.hpp"
#include "support/tar_bytes.hpp"
#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::server {
namespace package_store_test {

namespace fs = std::filesystem;
using ::stillmap::test::TemporaryFolder;
using ::stillmap::test::ThrowsSaying;
using ::stillmap::test::UnsyncedCalls;
using ::stillmap::test::write_package;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using Reason = StoreRefusal::Reason;

void expect_refused(Reason reason, const std::function<void()>& change) {
  EXPECT_THAT(change,
              ::testing::Throws<StoreRefusal>(::testing::Property(&StoreRefusal::reason, reason)));
}

std::vector<std::string> listing(const fs::path& folder) {
  std::vector<std::string> names;
  for (const auto& entry : fs::directory_iterator(folder)) names.push_back(entry.path().filename());
  std::sort(names.begin(), names.end());
  return names;
}

/// Puts other bytes into a file without a change of its size.
void spoil(const fs::path& file) {
  std::fstream stream(file, std::ios::in | std::ios::out | std::ios::binary);
  stream.seekp(3);
  stream.put('\x55');
  ASSERT_TRUE(stream.good()) << file;
}

class PackageStoreTest : public ::testing::Test {
 protected:
  PackageStoreTest() { fs::create_directory(store_); }
  [[nodiscard]] fs::path package(const std::string& digest) const {
    return store_ / "packages" / digest;
  }

  TemporaryFolder folder_;
  UnsyncedCalls calls_;
  fs::path store_ = folder_.path() / "store";
  std::string first_ = write_package(folder_.path() / "first", 1);
  std::string second_ = write_package(folder_.path() / "second", 2);
  std::string first_pack_ = test::pack_of(folder_.path() / "first");
  std::string second_pack_ = test::pack_of(folder_.path() / "second");
};

/// Memory that runs out at some calls.
class NoMemory : public UnsyncedCalls {
 public:
  std::int64_t pass(const DiskCall& call, const Perform& perform) override {
    const bool removes = call.kind == DiskCall::Kind::kRemoveFile && call.path.filename() == "a";
    const bool writes = state_too_ && call.kind == DiskCall::Kind::kWrite;
    if (removes || writes) throw std::bad_alloc();
    return UnsyncedCalls::pass(call, perform);
  }
  void at_the_state_too(bool fails) { state_too_ = fails; }

 private:
  bool state_too_ = false;
};

TEST_F(PackageStoreTest, SurvivesThatMemoryRunsOutWhileWhatWasRefusedIsRemoved) {
  const std::string no_package = test::tar_file("a", "x") + test::tar_end();
  NoMemory calls;
  {
    PackageStore store(store_, calls);
    EXPECT_THROW(store.add_archive("town", "1", {test::source_of(no_package), "town/1"}),
                 maps::InputError);
    EXPECT_FALSE(fs::is_empty(store_ / "packages"));
    EXPECT_THROW(
        extract_drive({test::source_of(no_package), "drive"}, folder_.path() / "drive", calls),
        maps::InputError);
    calls.at_the_state_too(true);
    EXPECT_THROW(store.create_map("yard"), maps::StorageError);
    calls.at_the_state_too(false);
    EXPECT_TRUE(store.create_map("yard"));
  }
  const PackageStore again(store_);
  EXPECT_TRUE(fs::is_empty(store_ / "packages")) << "the next open clears it";
}

TEST_F(PackageStoreTest, HeldPackageStaysWhenItsVersionGoes) {
  PackageStore store(store_, calls_);
  store.add("town", "1", folder_.path() / "first");
  const fs::path held = folder_.path() / "held";
  // Of one that was killed at it.
  fs::create_directories(folder_.path() / "held.new/tiles");
  ASSERT_TRUE(hold_package(package(first_), held));
  ASSERT_TRUE(store.remove("town", "1"));
  EXPECT_FALSE(fs::exists(package(first_)));
  EXPECT_EQ(maps::MapPackage::open(held)->digest(), first_);
  EXPECT_THAT(maps::MapPackage::open(held)->verify(), IsEmpty());
  EXPECT_FALSE(fs::exists(folder_.path() / "held.new"));
  EXPECT_THAT([&] { hold_package(package(first_), folder_.path() / "late"); },
              ThrowsSaying<maps::InputError>({first_}));
  EXPECT_FALSE(fs::exists(folder_.path() / "late.new"));
}

TEST_F(PackageStoreTest, PublishesByDigestAndServesWhatIsActive) {
  {
    PackageStore store(store_, calls_);
    const PackageStore::Added added = store.add("town", "1", folder_.path() / "first");
    EXPECT_TRUE(added.is_new);
    EXPECT_EQ(added.version.digest, first_);
    EXPECT_GT(added.version.bytes, 1500U);
    store.add("town", "2", folder_.path() / "second");
    store.activate("town", "1");
    store.activate("town", "2", 1);
    EXPECT_EQ(store.roll_back("town", 2).active, "1");
  }
  const PackageStore store(store_, calls_);
  EXPECT_EQ(store.state().map("town").active, "1");
  EXPECT_EQ(store.open("town", "2")->digest(), second_);
  EXPECT_EQ(store.open("town", "1")->tile({}).size(), 100U);
  EXPECT_TRUE(fs::exists(package(first_) / "build.json"));
  EXPECT_THAT(verify_store(store), IsEmpty());
  EXPECT_THAT(unnamed_packages(store), IsEmpty());
  EXPECT_EQ(store.not_cleared_because(), "");
}

TEST_F(PackageStoreTest, AddsTheSameTwiceAsOne) {
  PackageStore store(store_, calls_);
  store.add("town", "1", folder_.path() / "first");
  EXPECT_FALSE(store.add("town", "1", folder_.path() / "first").is_new);
  EXPECT_TRUE(store.add("town", "same", folder_.path() / "first").is_new);
  EXPECT_THAT(listing(store_ / "packages"), ElementsAre(first_));
  expect_refused(Reason::kOtherDigest, [&] { store.add("town", "1", folder_.path() / "second"); });
  EXPECT_THAT(listing(store_ / "packages"), ElementsAre(first_));
  EXPECT_THAT([&] { store.add("Town", "1", folder_.path() / "first"); },
              ThrowsSaying<std::invalid_argument>({"map: 'Town'"}));
  EXPECT_THAT([&] { store.add("town", "../1", folder_.path() / "first"); },
              ThrowsSaying<std::invalid_argument>({"version: '../1'"}));
}

TEST_F(PackageStoreTest, TakesNothingThatTheManifestDoesNotSay) {
  PackageStore store(store_, calls_);
  const fs::path tile = folder_.path() / "first" / first_pack_;
  folder_.write("first/index/cache", "derived");
  store.add("town", "1", folder_.path() / "first");
  EXPECT_FALSE(fs::exists(package(first_) / "index"));
  store.remove("town", "1");

  const auto add = [&] { store.add("town", "1", folder_.path() / "first"); };
  spoil(tile);
  EXPECT_THAT(add, ThrowsSaying<maps::InputError>({first_pack_, "SHA-256", "manifest.json"}));
  fs::resize_file(tile, 100);
  EXPECT_THAT(add, ThrowsSaying<maps::InputError>({first_pack_, "100 bytes"}));
  fs::resize_file(tile, 3000);
  EXPECT_THAT(add, ThrowsSaying<maps::InputError>({first_pack_, "more bytes"}));
  fs::remove(tile);
  EXPECT_THAT(add, ThrowsSaying<maps::InputError>({first_pack_, "nothing"}));
  fs::create_symlink(folder_.path() / "second" / second_pack_, tile);
  EXPECT_THAT(add, ThrowsSaying<maps::InputError>({first_pack_, "a link"}));
  EXPECT_THAT(listing(store_ / "packages"), IsEmpty());
  EXPECT_THAT(store.state().versions("town"), IsEmpty());
}

TEST_F(PackageStoreTest, RemovesAPackageWithItsLastName) {
  PackageStore store(store_, calls_);
  store.add("town", "1", folder_.path() / "first");
  store.add("depot", "1", folder_.path() / "first");
  store.activate("town", "1");
  expect_refused(Reason::kActive, [&] { store.remove("town", "1"); });
  EXPECT_FALSE(store.remove("depot", "1"));
  EXPECT_TRUE(fs::exists(package(first_)));
  store.add("town", "2", folder_.path() / "second");
  store.activate("town", "2");
  const auto kept_open = store.open("town", "1");
  EXPECT_TRUE(store.remove("town", "1"));
  EXPECT_THAT(listing(store_ / "packages"), ElementsAre(second_));
  EXPECT_NEAR(kept_open->tile({})[0].y, 1.0, test::kOffByStepsM)
      << "queries in flight finish on it";
}

TEST_F(PackageStoreTest, VerifyNamesWhatIsBroken) {
  PackageStore store(store_, calls_);
  store.add("town", "1", folder_.path() / "first");
  store.add("town", "same", folder_.path() / "first");
  store.add("town", "2", folder_.path() / "second");
  spoil(package(first_) / first_pack_);
  fs::remove(package(second_) / second_pack_);
  std::map<std::string, std::string> what;
  for (const StoreProblem& problem : verify_store(store)) {
    EXPECT_EQ(problem.map, "town");
    what[problem.version] = problem.what;
  }
  ASSERT_EQ(what.size(), 3U);
  EXPECT_THAT(what["1"], HasSubstr(first_pack_));
  EXPECT_EQ(what["same"], what["1"]);
  EXPECT_THAT(what["2"], HasSubstr("found nothing"));
}

TEST_F(PackageStoreTest, MendsADamagedPackageThatIsAddedAgain) {
  PackageStore store(store_, calls_);
  const fs::path tile = package(first_) / first_pack_;
  const auto add = [&](const char* version) {
    return store.add("town", version, folder_.path() / "first").is_new;
  };
  const std::string tar = test::tar_of(folder_.path() / "first", "town/") + test::tar_end();
  const auto add_archive = [&](const char* version) {
    return store.add_archive("town", version, {test::source_of(tar), "body"}).is_new;
  };
  EXPECT_TRUE(add("1"));
  store.activate("town", "1");
  const auto expect_whole = [&](const char* after) {
    EXPECT_THAT(verify_store(store), IsEmpty()) << after;
    EXPECT_THAT(listing(store_ / "packages"), ElementsAre(first_)) << after;
    EXPECT_EQ(store.state().map("town").active, "1");
  };
  spoil(tile);
  EXPECT_FALSE(add("1"));
  expect_whole("the same name");
  spoil(tile);
  EXPECT_TRUE(add("2"));
  expect_whole("another name");
  spoil(tile);
  EXPECT_FALSE(add_archive("1"));
  expect_whole("an archive");
  fs::remove(tile);
  EXPECT_TRUE(add_archive("3"));
  expect_whole("an archive under another name");
  spoil(package(first_) / "manifest.json");
  EXPECT_FALSE(add("1"));
  expect_whole("a broken manifest");
  fs::remove_all(package(first_));
  EXPECT_FALSE(add("1"));
  expect_whole("no package at all");
}

TEST_F(PackageStoreTest, LeavesAWholePackageWhereItIsWhenItIsAddedAgain) {
  PackageStore store(store_, calls_);
  store.add("town", "1", folder_.path() / "first");
  folder_.write("store/packages/" + first_ + "/index/cache", "derived");
  store.add("town", "1", folder_.path() / "first");
  store.add("town", "2", folder_.path() / "first");
  const std::string tar = test::tar_of(folder_.path() / "first", "") + test::tar_end();
  store.add_archive("town", "1", {test::source_of(tar), "body"});
  EXPECT_TRUE(fs::exists(package(first_) / "index/cache"));
}

TEST_F(PackageStoreTest, MendsBeyondItsQuota) {
  PackageStore store(store_, calls_);
  store.add("town", "1", folder_.path() / "first");
  store.set_quota({.store_bytes = 1});
  spoil(package(first_) / first_pack_);
  store.add("town", "1", folder_.path() / "first");
  EXPECT_THAT(verify_store(store), IsEmpty());
}

TEST_F(PackageStoreTest, NeverActivatesWhatCannotBeOpened) {
  PackageStore store(store_, calls_);
  store.add("town", "1", folder_.path() / "first");
  store.add("town", "2", folder_.path() / "second");
  store.activate("town", "1");
  store.activate("town", "2");
  fs::remove(package(first_) / first_pack_);
  EXPECT_THAT([&] { store.activate("town", "1"); }, ThrowsSaying<maps::InputError>({first_pack_}));
  EXPECT_THAT([&] { store.roll_back("town"); }, ThrowsSaying<maps::InputError>({first_pack_}));
  EXPECT_EQ(store.state().map("town").active, "2");
}

TEST_F(PackageStoreTest, ClearsWhatKilledWritersLeftAndNothingElse) {
  { PackageStore(store_, calls_).add("town", "1", folder_.path() / "first"); }
  fs::create_directories(store_ / "packages/.incoming-1-1/tiles");
  fs::create_directories(store_ / "packages/.incoming-1-2");
  fs::create_directories(store_ / "packages/.removed-x");
  folder_.write("store/packages/notes.txt", "of the operator");
  const auto being_written = FolderLock::try_folder(store_ / "packages/.incoming-1-2");
  ASSERT_TRUE(being_written);
  PackageStore store(store_, calls_);
  EXPECT_THAT(listing(store_ / "packages"), ElementsAre(".incoming-1-2", first_, "notes.txt"));
  EXPECT_EQ(clear_unused(store).leftovers, 0U);
}

TEST_F(PackageStoreTest, KeepsUnnamedPackagesUntilTheyAreAddedOrCleared) {
  { PackageStore(store_, calls_).add("town", "1", folder_.path() / "first"); }
  fs::copy(folder_.path() / "second", package(second_), fs::copy_options::recursive);
  PackageStore store(store_, calls_);
  EXPECT_THAT(unnamed_packages(store), ElementsAre(second_));
  spoil(package(second_) / second_pack_);
  store.add("town", "2", folder_.path() / "second");
  EXPECT_THAT(verify_store(store), IsEmpty()) << "a broken one is not taken over";
  store.remove("town", "2");
  fs::copy(folder_.path() / "second", package(second_), fs::copy_options::recursive);
  EXPECT_THAT(clear_unused(store).packages, ElementsAre(second_));
  EXPECT_THAT(listing(store_ / "packages"), ElementsAre(first_));
}

TEST_F(PackageStoreTest, LeavesNothingOfWhatItRefuses) {
  PackageStore store(store_, calls_);
  store.add("town", "1", folder_.path() / "first");
  store.remove("town", "1");
  const std::string tar = test::tar_of(folder_.path() / "second", "") + test::tar_end();
  const auto add_tar = [&] { store.add_archive("town", "1", {test::source_of(tar), "tar"}); };
  expect_refused(Reason::kOtherDigest, add_tar);
  EXPECT_THAT(listing(store_ / "packages"), IsEmpty());
  expect_refused(Reason::kOtherDigest, [&] { store.add("town", "1", folder_.path() / "second"); });
  EXPECT_THAT(listing(store_ / "packages"), IsEmpty());
  // Cancelled in the last moment.
  const std::int64_t job = store.jobs().enqueue({.map = "town", .request = "{}"}, 1).job.id;
  store.jobs().claim(1);
  const auto cancel = [&] {
    store.jobs().request_cancel(job, 2);
    return false;
  };
  expect_refused(Reason::kNotProcessing, [&] {
    store.add("town", "2", folder_.path() / "second",
              PackageStore::Maker{store.jobs().job(job), cancel});
  });
  EXPECT_THAT(listing(store_ / "packages"), IsEmpty());
}

TEST_F(PackageStoreTest, KeepsWhatOthersHoldOfWhatItRefuses) {
  PackageStore store(store_, calls_);
  store.add("town", "1", folder_.path() / "first");
  store.add("town", "2", folder_.path() / "second");
  store.remove("town", "1");
  const std::string tar = test::tar_of(folder_.path() / "second", "") + test::tar_end();
  expect_refused(Reason::kOtherDigest, [&] {
    store.add_archive("town", "1", {test::source_of(tar), "tar"});
  });
  EXPECT_THAT(verify_store(store), IsEmpty());
  EXPECT_THAT(listing(store_ / "packages"), ElementsAre(second_));
}

TEST_F(PackageStoreTest, RefusesPackagesWhoseStateIsGone) {
  { PackageStore(store_, calls_).add("town", "1", folder_.path() / "first"); }
  fs::remove(store_ / "state.db");
  EXPECT_THAT([&] { PackageStore store(store_, calls_); },
              ThrowsSaying<maps::InputError>({"state.db", "there are packages", "put it back"}));
  EXPECT_TRUE(fs::exists(package(first_)));
}

TEST(MapName, IsSafeInUrlsAndPaths) {
  EXPECT_TRUE(is_valid_map_name("a"));
  EXPECT_TRUE(is_valid_map_name("0town_2.b-c"));
  EXPECT_TRUE(is_valid_map_name(std::string(63, 'a')));
  for (const std::string& bad : {std::string(), std::string(64, 'a'), std::string(".a"),
                                 std::string("-a"), std::string("a/b"), std::string("A"),
                                 std::string("a b"), std::string("a\0b", 3), std::string("ä")}) {
    EXPECT_FALSE(is_valid_map_name(bad)) << bad;
  }
}

TEST_F(PackageStoreTest, AddsFromSeveralThreadsAndStores) {
  PackageStore one(store_, calls_);
  PackageStore other(store_, calls_);
  std::vector<std::thread> threads;
  for (int i = 0; i < 4; ++i)
    threads.emplace_back([&, i] {
      (i % 2 == 0 ? one : other).add("town", std::to_string(i), folder_.path() / "first");
    });
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(one.state().versions("town").size(), 4U);
  EXPECT_THAT(listing(store_ / "packages"), ElementsAre(first_));
}

}  // namespace package_store_test
}  // namespace stillmap::server
