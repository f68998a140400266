#include "store/store_migration.hpp"

#include <stillmap/maps/derived_file.hpp>
#include <stillmap/maps/error.hpp>
#include "catalog/version_facts.hpp"
#include "store/package_store.hpp"
#include "store/store_backup.hpp"
#include "store/store_upkeep.hpp"

#include <fstream>
#include <functional>
#include <iterator>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "support/disk_calls.hpp"
#include "support/disk_model.hpp"
#include "support/store_contents.hpp"
#include "support/store_refusals.hpp"
#include "support/stored_packages.hpp"
#include "support/tar_bytes.hpp"
#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::server {
namespace store_migration_test {

namespace fs = std::filesystem;
using ::stillmap::test::contents_of;
using ::stillmap::test::DiskModel;
using ::stillmap::test::expect_refused;
using ::stillmap::test::FailingCalls;
using ::stillmap::test::Fault;
using ::stillmap::test::memory_folder;
using ::stillmap::test::RecordingCalls;
using ::stillmap::test::TemporaryFolder;
using ::stillmap::test::ThrowsSaying;
using ::stillmap::test::UnsyncedCalls;
using ::testing::ElementsAre;
using ::testing::IsEmpty;
using ::testing::SizeIs;
using Kind = DiskCall::Kind;

/// Of schema 1.
std::string write_package(const fs::path& target, int seed, std::size_t points = 100,
                          std::optional<maps::Registration> registration = {}) {
  return test::write_package(target, seed, points, std::move(registration), 1);
}

/// Files that are written past the gate, as a package that is converted, become known when they are
/// synced through it.
class AdoptingCalls : public RecordingCalls {
 public:
  std::int64_t pass(const DiskCall& call, const Perform& perform) override {
    if (call.kind == Kind::kMakeFolder || call.kind == Kind::kCreateFile) known_.insert(call.path);
    if (call.path.string().find("/.incoming-") != std::string::npos) {
      if (call.kind == Kind::kSyncFolder) adopt_folder(call.path);
      if (call.kind == Kind::kSyncFile) adopt_file(call.path);
    }
    return RecordingCalls::pass(call, perform);
  }

 private:
  void note(const DiskCall& call) {
    RecordingCalls::pass(call, [](std::size_t bytes) { return static_cast<std::int64_t>(bytes); });
  }
  void adopt_folder(const fs::path& folder) {
    if (!known_.insert(folder).second) return;
    adopt_folder(folder.parent_path());
    note({.kind = Kind::kMakeFolder, .path = folder});
  }
  void adopt_file(const fs::path& file) {
    if (!known_.insert(file).second) return;
    adopt_folder(file.parent_path());
    note({.kind = Kind::kCreateFile, .path = file});
    std::ifstream stream(file, std::ios::binary);
    const std::string bytes(std::istreambuf_iterator<char>(stream), {});
    note({.kind = Kind::kWrite, .path = file, .bytes = bytes});
  }
  std::set<fs::path> known_;
};

std::string schemas_of(const PackageStore& store) {
  std::string text;
  for (const StoredMap& map : store.state().maps())
    for (const StoredVersion& version : store.state().versions(map.name))
      text += std::to_string(store.open(map.name, version.name)->manifest().schema);
  return text;
}

class StoreMigration : public ::testing::Test {
 protected:
  StoreMigration() {
    fs::create_directory(store_);
    digests_["1"] = write_package(source("1"), 1);
    digests_["2"] =
        write_package(source("2"), 2, 100, maps::Registration{.previous_digest = digests_["1"]});
    digests_["3"] = write_package(source("3"), 3);
    digests_["4"] = write_package(source("4"), 4);
  }

  /// Two maps, a removed version, and a bit of all else.
  void fill(const fs::path& folder, DiskCalls& calls) const {
    PackageStore store(folder, calls);
    store.add("town", "a", source("1"));
    store.add("town", "b", source("2"));
    store.add("town", "copy", source("1"));
    store.add("depot", "gone", source("4"));
    store.add("depot", "a", source("3"));
    store.remove("depot", "gone");
    store.activate("town", "a");
    store.activate("town", "b");
    store.keys().create("car", {.bits = 1}, {}, 1);
    store.jobs().enqueue({.map = "town"}, 5);
    store.edits().save("town", "some", "k", 2);
    store.audit().append({.subject = "town"});
    store.drives().open("town", "monday", 3);
  }

  [[nodiscard]] fs::path source(const std::string& name) const { return folder_.path() / name; }
  static Migration migrate(PackageStore& store, const MigrationProgress& progress = {}) {
    return migrate_store(store, plan_migration(store), progress);
  }
  /// Contents with the former digests in place of the new ones.
  [[nodiscard]] static std::string former_contents(const PackageStore& store) {
    std::string text = contents_of(store);
    for (const StoredMap& map : store.state().maps())
      for (const StoredVersion& version : store.state().versions(map.name))
        for (const std::string& former : version.former_digests)
          for (std::size_t at = 0; (at = text.find(version.digest.substr(0, 6))) != text.npos;)
            text.replace(at, 6, former.substr(0, 6));
    return text;
  }
  /// A store after a kill, a cut or a fault: whole, and the migration goes on.
  /// @return what is wrong.
  [[nodiscard]] std::string problem_of(const fs::path& folder, const std::string& contents) const {
    UnsyncedCalls calls;
    try {
      PackageStore store(folder, calls);
      if (former_contents(store) != contents) return "found\n" + former_contents(store);
      if (!verify_store(store).empty()) return verify_store(store).front().what;
      if (!migrate(store).left.empty()) return "packages are left";
      if (former_contents(store) != contents) return "migrated\n" + former_contents(store);
      if (schemas_of(store) != "2222") return "schemas " + schemas_of(store);
      if (!verify_store(store).empty()) return verify_store(store).front().what;
      clear_unused(store);
      const auto names = folders_of(folder / "packages");
      return names.size() == 3 ? "" : std::to_string(names.size()) + " folders of packages";
    } catch (const std::exception& error) {
      return error.what();
    }
  }
  [[nodiscard]] static std::vector<std::string> folders_of(const fs::path& folder) {
    std::vector<std::string> names;
    for (const auto& entry : fs::directory_iterator(folder))
      names.push_back(entry.path().filename());
    return names;
  }

  TemporaryFolder folder_{memory_folder()};
  fs::path store_ = folder_.path() / "store";
  std::map<std::string, std::string> digests_;
  UnsyncedCalls calls_;
};

TEST_F(StoreMigration, KeepsAllButTheDigests) {
  fill(store_, calls_);
  PackageStore store(store_, calls_);
  const std::string contents = contents_of(store);
  ASSERT_THAT(plan_migration(store).packages, SizeIs(3));
  EXPECT_EQ(plan_migration(store).packages[1].versions, "town/a, town/copy");
  const Migration done = migrate(store);
  EXPECT_THAT(done.migrated, SizeIs(3));
  EXPECT_THAT(done.left, IsEmpty());
  EXPECT_EQ(former_contents(store), contents);
  EXPECT_NE(contents_of(store), contents);
  EXPECT_EQ(schemas_of(store), "2222");
  EXPECT_THAT(verify_store(store), IsEmpty());
  EXPECT_THAT(folders_of(store_ / "packages"), SizeIs(3));
  EXPECT_FALSE(store.state().audit().check().first_wrong_id);
  const StoredVersion a = store.state().version("town", "a");
  EXPECT_THAT(a.former_digests, ElementsAre(digests_["1"]));
  EXPECT_EQ(a.digest, store.state().version("town", "copy").digest);
  EXPECT_EQ(a.digest, store.state().current_digest(digests_["1"]));
  const auto package = store.open("town", "a");
  std::uint64_t bytes = fs::file_size(package->folder() / "manifest.json");
  for (const auto& [path, file] : package->manifest().files) bytes += file.bytes;
  EXPECT_EQ(a.bytes, bytes);
  EXPECT_THAT(plan_migration(store).packages, IsEmpty());
  EXPECT_THAT(migrate(store).migrated, IsEmpty());
  EXPECT_EQ(store.roll_back("town").active, "a");
}

TEST_F(StoreMigration, FormerPackagesAreStillTheSameVersions) {
  fill(store_, calls_);
  PackageStore store(store_, calls_);
  migrate(store);
  const std::string contents = contents_of(store);
  const std::string now = store.state().current_digest(digests_["1"]);
  // Who got no answer to an upload sends it again.
  EXPECT_FALSE(store.add("town", "a", source("1")).is_new);
  const std::string tar = test::tar_of(source("2"), "") + test::tar_end();
  EXPECT_FALSE(store.add_archive("town", "b", {test::source_of(tar), "body"}).is_new);
  EXPECT_EQ(contents_of(store), contents);
  EXPECT_THAT(folders_of(store_ / "packages"), SizeIs(3));
  const PackageStore::Added other = store.add("town", "other", source("1"));
  EXPECT_TRUE(other.is_new);
  EXPECT_EQ(other.version.digest, now) << "what it has become";
  expect_refused(StoreRefusal::Reason::kOtherDigest, [&] { store.add("town", "a", source("2")); });
  // A name of a removed version is good for the same package.
  store.remove("town", "copy");
  EXPECT_TRUE(store.add("town", "copy", source("1")).is_new);
  EXPECT_TRUE(store.add("depot", "gone", source("4")).is_new) << "removed before";
  expect_refused(StoreRefusal::Reason::kOtherDigest,
                 [&] { store.add("depot", "gone", source("2")); });
  EXPECT_THAT(verify_store(store), IsEmpty());
  EXPECT_THAT(migrate(store).migrated, SizeIs(1));
  EXPECT_EQ(schemas_of(store), "222222");
}

TEST_F(StoreMigration, AFormerPackageComesBackWhenItsSuccessorIsGone) {
  fill(store_, calls_);
  PackageStore store(store_, calls_);
  migrate(store);
  store.remove("depot", "a");
  ASSERT_TRUE(store.add("depot", "a", source("3")).is_new);
  EXPECT_EQ(store.state().version("depot", "a").digest, digests_["3"]);
  EXPECT_THAT(migrate(store).migrated, SizeIs(1));
  EXPECT_THAT(store.state().version("depot", "a").former_digests, ElementsAre(digests_["3"]));
}

TEST_F(StoreMigration, ADamagedSuccessorIsNotTakenForWhole) {
  fill(store_, calls_);
  PackageStore store(store_, calls_);
  migrate(store);
  const fs::path package =
      store_ / "packages" / store.state().current_digest(digests_["1"]) / "packs";
  for (const auto& pack : fs::directory_iterator(package))
    std::fstream(pack.path(), std::ios::in | std::ios::out | std::ios::binary).seekp(90).put('\x7');
  EXPECT_THAT([&] { store.add("town", "a", source("1")); },
              ThrowsSaying<maps::InputError>({"damaged", "backup", "another name"}));
  EXPECT_TRUE(store.add("town", "again", source("1")).is_new);
  EXPECT_EQ(store.state().version("town", "again").digest, digests_["1"]);
}

TEST_F(StoreMigration, FramesKeepTheirNames) {
  fill(store_, calls_);
  PackageStore store(store_, calls_);
  const auto frames = [&] {
    const VersionFactsTable facts(store);
    std::vector<std::string> names;
    for (const StoredVersion& version : store.state().versions("town"))
      names.push_back(facts.frame_of("town", version.digest));
    return names;
  };
  const std::vector<std::string> before = frames();
  EXPECT_THAT(before, ElementsAre(digests_["1"], digests_["1"], digests_["1"]));
  migrate(store);
  EXPECT_EQ(frames(), before);
  // One that was built since names its frame by the new digest.
  write_package(source("5"), 5, 100,
                maps::Registration{.previous_digest = store.state().current_digest(digests_["1"])});
  store.add("town", "c", source("5"));
  EXPECT_EQ(frames().back(), digests_["1"]);
  store.remove("town", "copy");
  store.remove("town", "a");
  EXPECT_THAT(frames(), ElementsAre(digests_["1"], digests_["1"])) << "b and c";
}

TEST_F(StoreMigration, LeavesADamagedPackageAndGoesOn) {
  fill(store_, calls_);
  PackageStore store(store_, calls_);
  std::fstream(store_ / "packages" / digests_["2"] / "tiles/0_0_0.bin",
               std::ios::in | std::ios::out | std::ios::binary)
      .seekp(8)
      .write("damage", 6);
  const Migration done = migrate(store);
  EXPECT_THAT(done.migrated, SizeIs(2));
  ASSERT_THAT(done.left, SizeIs(1));
  EXPECT_EQ(done.left[0].package.versions, "town/b");
  EXPECT_THAT(done.left[0].why, ::testing::HasSubstr("tiles/0_0_0.bin"));
  EXPECT_EQ(schemas_of(store), "2212");
  EXPECT_THAT(verify_store(store), SizeIs(1));
}

TEST_F(StoreMigration, IsRefusedWhileAServerServesTheStore) {
  fill(store_, calls_);
  PackageStore store(store_, calls_);
  const auto one = FolderLock::try_folder(store_, FolderLock::Kind::kShared);
  auto other = FolderLock::try_folder(store_, FolderLock::Kind::kShared);
  EXPECT_TRUE(one && other) << "several servers may serve it";
  EXPECT_THAT([&] { migrate(store); },
              ThrowsSaying<maps::InputError>({"a server", "stop the server, migrate"}));
  EXPECT_EQ(schemas_of(store), "1111");
}

TEST_F(StoreMigration, IsRefusedWithoutRoomBeforeItBegins) {
  fill(store_, calls_);
  PackageStore store(store_, calls_);
  MigrationPlan plan = plan_migration(store);
  EXPECT_GT(plan.room_bytes, 0U);
  EXPECT_LT(plan.room_bytes, 100'000U);
  plan.room_bytes = std::uint64_t{1} << 60U;
  EXPECT_THAT([&] { migrate_store(store, plan); },
              ThrowsSaying<DiskFull>({std::to_string(plan.room_bytes), "No space left"}));
  EXPECT_EQ(schemas_of(store), "1111");
}

/// A backup on the same disk has links to the files: their room does not come back.
TEST_F(StoreMigration, CountsRoomThatABackupHolds) {
  fill(store_, calls_);
  PackageStore store(store_, calls_);
  const std::uint64_t room = plan_migration(store).room_bytes;
  back_up_store(store, folder_.path() / "backup");
  // Three packages of 100 points; the last one has gone when the room of the most is taken.
  EXPECT_EQ(plan_migration(store).room_bytes,
            room + std::uint64_t{2} * 100 * sizeof(maps::MapPoint));
}

TEST_F(StoreMigration, GoesOnAfterItWasStopped) {
  fill(store_, calls_);
  PackageStore store(store_, calls_);
  const std::string contents = contents_of(store);
  std::uint64_t most = 0;
  EXPECT_THROW(migrate(store,
                       [&](std::uint64_t done, std::uint64_t total, const PackageOfVersions&) {
                         EXPECT_GE(done, most);
                         most = done;
                         return done < total / 2;
                       }),
               maps::WorkStopped);
  EXPECT_EQ(schemas_of(store), "2111") << "the first of three";
  EXPECT_THAT(folders_of(store_ / "packages"), SizeIs(3)) << "nothing half is left";
  EXPECT_EQ(problem_of(store_, contents), "");
}

TEST_F(StoreMigration, LosesNothingWhenThePowerIsCut) {
  AdoptingCalls calls;
  fill(store_, calls);
  const std::size_t begin = calls.calls().size();
  std::string contents;
  {
    PackageStore store(store_, calls);
    contents = contents_of(store);
    migrate(store);
  }
  DiskModel disk(store_);
  std::size_t states = 0;
  for (std::size_t made = 0; made <= calls.calls().size(); ++made) {
    if (made > 0) disk.apply(calls.calls()[made - 1]);
    if (made < begin) continue;
    for (const auto unsynced :
         {DiskModel::Unsynced::kLost, DiskModel::Unsynced::kKept, DiskModel::Unsynced::kAtRandom}) {
      const TemporaryFolder state(memory_folder());
      disk.write_state(state.path(), unsynced, static_cast<unsigned>(made));
      ASSERT_EQ(problem_of(state.path(), contents), "") << "after " << made - begin << " calls";
      ++states;
    }
  }
  EXPECT_GE(states, 300U);
}

TEST_F(StoreMigration, LosesNothingWhicheverCallFails) {
  bool failed = true;
  for (std::size_t at = 0; failed; ++at) {
    const TemporaryFolder folder(memory_folder());
    fill(folder.path(), calls_);
    std::string contents;
    {
      const PackageStore store(folder.path(), calls_);
      contents = contents_of(store);
    }
    const Fault fault = at % 2 == 0 ? Fault::kInputOutput : Fault::kNoSpace;
    FailingCalls calls(fault, [&](std::size_t n, const auto&) { return n == at; });
    try {
      PackageStore store(folder.path(), calls);
      migrate(store);
    } catch (const maps::StorageError&) {
      // Refused in words.
    }
    failed = calls.failed() > 0;
    ASSERT_EQ(problem_of(folder.path(), contents), "") << "call " << at;
  }
}

}  // namespace store_migration_test
}  // namespace stillmap::server
