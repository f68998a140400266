#include "store/package_store.hpp"
#include "store/store_upkeep.hpp"

#include <stillmap/maps/error.hpp>
#include "store/store_backup.hpp"

#include <sys/stat.h>

#include <chrono>
#include <fstream>
#include <iterator>
#include <memory>
#include <stdexcept>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "support/disk_calls.hpp"
#include "support/stored_packages.hpp"
#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::server {
namespace store_backup_test {

namespace fs = std::filesystem;
using ::stillmap::test::FailingCalls;
using ::stillmap::test::Fault;
using ::stillmap::test::memory_folder;
using ::stillmap::test::TemporaryFolder;
using ::stillmap::test::ThrowsSaying;
using ::stillmap::test::UnsyncedCalls;
using ::stillmap::test::write_package;
using ::testing::IsEmpty;

void spoil(const fs::path& file) {
  std::fstream stream(file, std::ios::in | std::ios::out | std::ios::binary);
  stream.seekp(3);
  stream.put('\x55');
  ASSERT_TRUE(stream.good()) << file;
}

class StoreBackupTest : public ::testing::Test {
 protected:
  StoreBackupTest() {
    fs::create_directory(folder_.path() / "store");
    store_ = std::make_unique<PackageStore>(folder_.path() / "store", calls_);
    store_->add("town", "1", folder_.path() / "first");
    store_->activate("town", "1");
  }
  /// What a backup holds, when it is made a store again.
  [[nodiscard]] std::unique_ptr<PackageStore> restored() {
    const fs::path target = folder_.path() / ("restored" + std::to_string(restored_++));
    restore_store(backup_, target, calls_);
    return std::make_unique<PackageStore>(target, calls_);
  }

  TemporaryFolder folder_{memory_folder()};
  UnsyncedCalls calls_;
  fs::path backup_ = folder_.path() / "backup";
  std::string first_ = write_package(folder_.path() / "first", 1);
  std::string second_ = write_package(folder_.path() / "second", 2);
  std::string first_pack_ = test::pack_of(folder_.path() / "first");
  std::unique_ptr<PackageStore> store_;
  int restored_ = 0;
};

/// Opens the folder that is restored, as a server does that is started too early.
class OpensEarly : public UnsyncedCalls {
 public:
  explicit OpensEarly(fs::path folder) : folder_(std::move(folder)) {}
  std::int64_t pass(const DiskCall& call, const Perform& perform) override {
    if (!opener_.joinable() && call.kind == DiskCall::Kind::kMakeFolder &&
        call.path == folder_ / "packages") {
      opener_ = std::jthread([this] { store_ = std::make_unique<PackageStore>(folder_, others_); });
      // Time enough for one that does not wait.
      std::this_thread::sleep_for(std::chrono::milliseconds(100));
    }
    return UnsyncedCalls::pass(call, perform);
  }
  [[nodiscard]] PackageStore& store() {
    opener_.join();
    return *store_;
  }

 private:
  fs::path folder_;
  UnsyncedCalls others_;
  std::unique_ptr<PackageStore> store_;
  std::jthread opener_;
};

// Its state holds hashes of keys and the audit log.
TEST_F(StoreBackupTest, StateOfAStoreAndItsBackupIsReadByItsOwnerAlone) {
  const mode_t before = ::umask(022);
  const fs::path made = folder_.path() / "made";
  fs::create_directory(made);
  {
    const PackageStore store(made, calls_);
    for (const char* name : {"state.db", "state.db-wal"})
      EXPECT_EQ(fs::status(made / name).permissions(), fs::perms{0600}) << name;
    back_up_store(store, backup_);
  }
  EXPECT_EQ(fs::status(backup_ / "state.db").permissions(), fs::perms{0600});
  EXPECT_EQ(fs::status(backup_).permissions(), fs::perms{0700});
  restore_store(backup_, folder_.path() / "again", calls_);
  EXPECT_EQ(fs::status(folder_.path() / "again" / "state.db").permissions(), fs::perms{0600});
  ::umask(before);
}

TEST_F(StoreBackupTest, AServerThatIsStartedMeanwhileOpensWhatIsRestored) {
  back_up_store(*store_, backup_);
  const fs::path target = folder_.path() / "restored";
  OpensEarly calls(target);
  restore_store(backup_, target, calls);
  PackageStore& early = calls.store();
  EXPECT_EQ(early.state().map("town").active, "1");
  early.add("town", "2", folder_.path() / "second");
  EXPECT_EQ(PackageStore(target, calls_).state().versions("town").size(), 2U);
}

TEST_F(StoreBackupTest, WhatARestoreLeftThatFailedIsNoStore) {
  back_up_store(*store_, backup_);
  spoil(backup_ / "packages" / first_ / "manifest.json");
  const fs::path target = folder_.path() / "restored";
  EXPECT_THROW(restore_store(backup_, target, calls_), std::runtime_error);
  EXPECT_THAT([&] { const PackageStore store(target, calls_); },
              ThrowsSaying<maps::InputError>({"restored/state.db"}));
}

TEST_F(StoreBackupTest, BringsBackAllButDrives) {
  const std::string key = store_->keys().create("car", {.bits = 1}, {}, 1).text;
  const std::int64_t drive = store_->drives().open("town", "monday", 1).id;
  store_->drives().add_part(drive, {1, std::string(64, 'a'), 10});
  const std::int64_t done = store_->jobs().enqueue({.map = "town"}, 1).job.id;
  store_->jobs().claim(2);
  store_->jobs().succeed(store_->jobs().job(done), "1", 3);
  const std::int64_t waiting = store_->jobs().enqueue({.map = "town"}, 4).job.id;
  store_->audit().append({.time_ns = 5, .subject = "town"});
  const SavedEdits edits = store_->edits().save("town", "corrections", "k", 6);
  EXPECT_EQ(back_up_store(*store_, backup_).copied, 1U);
  EXPECT_EQ(store_->jobs().job(waiting).status, JobStatus::kEnqueued) << "the store goes on";

  const auto again = restored();
  EXPECT_THAT(verify_store(*again), IsEmpty());
  EXPECT_EQ(again->open("town", *again->state().map("town").active)->digest(), first_);
  EXPECT_EQ(again->keys().check(key, 1).verdict, KeyCheck::Verdict::kGood);
  EXPECT_EQ(again->jobs().job(done), store_->jobs().job(done));
  EXPECT_EQ(again->jobs().job(waiting).status, JobStatus::kFailed);
  EXPECT_THAT(again->drives().all(), IsEmpty());
  EXPECT_EQ(again->edits().of_map("town"), edits);
  EXPECT_EQ(again->audit().list(10).records, store_->audit().list(10).records);
  EXPECT_GT(again->drives().open("town", "tuesday", 1).id, drive);
}

TEST_F(StoreBackupTest, TakesOnlyWhatIsNewAndDropsWhatIsGone) {
  EXPECT_EQ(back_up_store(*store_, backup_).copied, 1U);
  store_->add("town", "2", folder_.path() / "second");
  const BackedUp next = back_up_store(*store_, backup_);
  EXPECT_EQ(next.copied, 1U);
  EXPECT_EQ(next.kept, 1U);
  store_->activate("town", "2");
  store_->remove("town", "1");
  EXPECT_EQ(back_up_store(*store_, backup_).kept, 1U);
  EXPECT_FALSE(fs::exists(backup_ / "packages" / first_));
  EXPECT_EQ(restored()->state().map("town").active, "2");
}

TEST_F(StoreBackupTest, TakesNoRoomOnTheSameDiskAndSharesNoFileWithARestoredStore) {
  const auto links = [](const fs::path& file) {
    struct stat status {};
    EXPECT_EQ(::stat(file.c_str(), &status), 0) << file;
    return status.st_nlink;
  };
  back_up_store(*store_, backup_);
  const fs::path tile = fs::path("packages") / first_ / first_pack_;
  EXPECT_EQ(links(backup_ / tile), 2U);
  const auto again = restored();
  EXPECT_EQ(links(folder_.path() / "restored0" / tile), 1U);
  EXPECT_TRUE(fs::exists(folder_.path() / "restored0/packages" / first_ / "build.json"));
}

class NoLinks : public UnsyncedCalls {
 public:
  std::int64_t pass(const DiskCall& call, const Perform& perform) override {
    return call.kind == DiskCall::Kind::kLink ? -EXDEV : UnsyncedCalls::pass(call, perform);
  }
};

TEST_F(StoreBackupTest, CopiesWhereTheDiskAllowsNoLinks) {
  NoLinks no_links;
  const PackageStore store(folder_.path() / "store", no_links);
  EXPECT_EQ(back_up_store(store, backup_).copied, 1U);
  EXPECT_THAT(verify_store(*restored()), IsEmpty());
}

TEST_F(StoreBackupTest, BringsAgainWhatWasDamagedOnceThatWasLookedFor) {
  const fs::path tile = fs::path("packages") / first_ / first_pack_;
  EXPECT_EQ(drop_damaged_of_backup(backup_, calls_), 0U) << "there is none";
  EXPECT_FALSE(fs::exists(backup_));
  back_up_store(*store_, backup_);
  EXPECT_EQ(drop_damaged_of_backup(backup_, calls_), 0U);
  // The store's own, under its second name.
  spoil(backup_ / tile);
  store_->add("town", "1", folder_.path() / "first");
  EXPECT_EQ(back_up_store(*store_, backup_).kept, 1U) << "nobody looked";
  EXPECT_THAT([&] { static_cast<void>(restored()); },
              ThrowsSaying<maps::InputError>({first_pack_}));
  EXPECT_EQ(drop_damaged_of_backup(backup_, calls_), 1U);
  EXPECT_EQ(back_up_store(*store_, backup_).copied, 1U);
  EXPECT_THAT(verify_store(*restored()), IsEmpty());
  EXPECT_EQ(std::distance(fs::directory_iterator(backup_ / "packages"), {}), 1);
}

TEST_F(StoreBackupTest, RefusesABrokenPackage) {
  const fs::path tile = fs::path("packages") / first_ / first_pack_;
  back_up_store(*store_, backup_);
  const fs::path copy = folder_.path() / "spoilt";
  fs::copy(backup_, copy, fs::copy_options::recursive);
  spoil(copy / tile);
  EXPECT_THAT([&] { restore_store(copy, folder_.path() / "new", calls_); },
              ThrowsSaying<maps::InputError>({first_pack_}));
}

TEST_F(StoreBackupTest, SavesAllButABrokenPackage) {
  store_->add("town", "2", folder_.path() / "second");
  spoil(folder_.path() / "store/packages" / first_ / first_pack_);
  EXPECT_THAT([&] { back_up_store(*store_, backup_); },
              ThrowsSaying<maps::InputError>({"town/1", first_pack_, "manifest.json"}));
  EXPECT_EQ(std::distance(fs::directory_iterator(backup_ / "packages"), {}), 1);
  EXPECT_THAT([&] { (void)restored(); }, ThrowsSaying<maps::InputError>({"no package", "town/1"}));
  const PackageStore again(folder_.path() / "restored0", calls_);
  EXPECT_EQ(again.open("town", "2")->digest(), second_);
  // Mended, it is brought with the next one.
  store_->add("town", "1", folder_.path() / "first");
  EXPECT_EQ(back_up_store(*store_, backup_).copied, 1U);
  EXPECT_THAT(verify_store(*restored()), IsEmpty());
}

TEST_F(StoreBackupTest, SavesAllButAPackageThatTheDiskDoesNotRead) {
  store_->add("town", "2", folder_.path() / "second");
  const fs::path tile = folder_.path() / "store/packages" / first_ / first_pack_;
  // Stands for a bad sector: opening a socket is an error of the system's (ENXIO) to root as well.
  fs::remove(tile);
  ASSERT_EQ(::mknod(tile.c_str(), S_IFSOCK | 0600, 0), 0);
  NoLinks no_links;
  const PackageStore store(folder_.path() / "store", no_links);
  EXPECT_THAT(
      [&] { back_up_store(store, backup_); },
      ThrowsSaying<maps::InputError>({"town/1", first_pack_, "No such device", "all else"}));
  EXPECT_EQ(std::distance(fs::directory_iterator(backup_ / "packages"), {}), 1);
  EXPECT_THAT([&] { (void)restored(); }, ThrowsSaying<maps::InputError>({"no package", "town/1"}));
  const PackageStore again(folder_.path() / "restored0", calls_);
  EXPECT_EQ(again.open("town", "2")->digest(), second_);
}

TEST_F(StoreBackupTest, ATargetThatTakesNothingIsNoBrokenPackage) {
  for (const Fault fault : {Fault::kInputOutput, Fault::kNoSpace}) {
    FailingCalls calls(fault, [&](std::size_t, const DiskCall& call) {
      return call.kind == DiskCall::Kind::kMakeFolder &&
             call.path.string().starts_with((backup_ / "packages/").string());
    });
    const PackageStore store(folder_.path() / "store", calls);
    EXPECT_THAT([&] { back_up_store(store, backup_); },
                ThrowsSaying<maps::StorageError>({"backup/packages"}));
    EXPECT_FALSE(fs::exists(backup_ / "state.db")) << "not committed";
    EXPECT_GE(calls.failed(), 2U);
  }
}

TEST_F(StoreBackupTest, NeverWritesOverAnythingElse) {
  folder_.write("notes/a.txt", "of the operator");
  EXPECT_THAT([&] { back_up_store(*store_, folder_.path() / "notes"); },
              ThrowsSaying<maps::InputError>({"notes", "something else"}));
  EXPECT_THAT([&] { back_up_store(*store_, folder_.path() / "store"); },
              ThrowsSaying<maps::InputError>({"store", "something else"}));
  back_up_store(*store_, backup_);
  EXPECT_THAT([&] { restore_store(backup_, folder_.path() / "notes", calls_); },
              ThrowsSaying<maps::InputError>({"notes", "with content"}));
  EXPECT_THAT([&] { restore_store(folder_.path() / "store", backup_, calls_); },
              ThrowsSaying<maps::InputError>({"no finished backup"}));
  EXPECT_THAT([&] { const PackageStore store(backup_, calls_); },
              ThrowsSaying<maps::InputError>({"a backup", "restore it"}));
  EXPECT_TRUE(fs::exists(folder_.path() / "notes/a.txt"));
}

TEST_F(StoreBackupTest, IsOfOneInstantWhileOthersWrite) {
  store_->add("town", "2", folder_.path() / "second");
  write_package(folder_.path() / "third", 3);
  std::jthread writer([&](const std::stop_token& stop) {
    while (!stop.stop_requested()) {
      store_->activate("town", "2");
      store_->activate("town", "1");
      store_->add("depot", "1", folder_.path() / "third");
      store_->remove("depot", "1");
    }
  });
  for (int i = 0; i < 10; ++i) {
    back_up_store(*store_, backup_);
    EXPECT_THAT(verify_store(*restored()), IsEmpty());
  }
}

TEST_F(StoreBackupTest, LeavesTheEarlierBackupWhicheverCallFails) {
  back_up_store(*store_, backup_);
  store_->add("town", "2", folder_.path() / "second");
  store_->activate("town", "2");
  bool failed = true;
  for (std::size_t at = 0; failed; ++at) {
    const TemporaryFolder copy(memory_folder());
    const fs::path backup = copy.path() / "backup";
    fs::copy(backup_, backup, fs::copy_options::recursive);
    bool armed = false;
    std::size_t first = 0;
    FailingCalls calls(Fault::kInputOutput, [&](std::size_t n, const auto&) {
      if (!armed) first = n + 1;
      return armed && n == first + at;
    });
    PackageStore store(folder_.path() / "store", calls);
    armed = true;
    bool done = false;
    try {
      back_up_store(store, backup);
      done = true;
    } catch (const maps::StorageError&) {
    }
    failed = calls.failed() > 0;
    const fs::path target = copy.path() / "restored";
    restore_store(backup, target, calls_);
    const PackageStore again(target, calls_);
    EXPECT_THAT(verify_store(again), IsEmpty()) << at;
    const std::string active = *again.state().map("town").active;
    EXPECT_TRUE(active == "2" || (active == "1" && !done)) << at;
    back_up_store(*store_, backup);
  }
}

}  // namespace store_backup_test
}  // namespace stillmap::server
