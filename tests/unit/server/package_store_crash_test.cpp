#include "store/package_store.hpp"
#include "store/store_upkeep.hpp"

#include <stillmap/maps/error.hpp>
#include "store/drive_store.hpp"

#include <algorithm>
#include <fstream>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "support/bag_bytes.hpp"
#include "support/disk_calls.hpp"
#include "support/disk_model.hpp"
#include "support/store_contents.hpp"
#include "support/stored_packages.hpp"
#include "support/tar_bytes.hpp"
#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::server {
namespace package_store_crash_test {

namespace fs = std::filesystem;
using ::stillmap::test::contents_of;
using ::stillmap::test::DiskModel;
using ::stillmap::test::FailingCalls;
using ::stillmap::test::Fault;
using ::stillmap::test::memory_folder;
using ::stillmap::test::RecordedCall;
using ::stillmap::test::RecordingCalls;
using ::stillmap::test::tar_of;
using ::stillmap::test::TemporaryFolder;
using ::stillmap::test::UnsyncedCalls;
using ::stillmap::test::write_package;
using ::testing::IsEmpty;
using Kind = DiskCall::Kind;

/// A store with the drives that lie in it.
class WholeStore : public PackageStore {
 public:
  WholeStore(const fs::path& folder, DiskCalls& calls)
      : PackageStore(folder, calls), drive_bytes(*this, calls) {}
  DriveStore drive_bytes;
};

/// The scan that each of the drives holds.
std::string drive_scan() { return std::string(64, '\x3f'); }

/// What a store is put through, and what it holds after each step.
class StoreScenarioTest : public ::testing::Test {
 protected:
  using Store = std::unique_ptr<WholeStore>;

  StoreScenarioTest() {
    fs::create_directory(sources_);
    for (int seed = 1; seed <= 5; ++seed) write_package(sources_ / std::to_string(seed), seed);
    tar_ = tar_of(sources_ / "4", "") + test::tar_file("unlisted/a", "x") + test::tar_end();
    test::write_patched_packages(sources_ / "patched");
    // What is missing beside the version before: the rest comes from there.
    patch_tar_ = patch_tar(sources_ / "patched" / "1", sources_ / "patched" / "2");
    tar_in_folder_ = tar_of(sources_ / "5", "town/") + test::tar_end();
  }

  /// Opens a store, adds, activates, rolls back, removes, and opens it again in between.
  [[nodiscard]] std::vector<std::function<void(Store&)>> steps(const fs::path& folder,
                                                               DiskCalls& calls) const {
    const auto open = [&calls, folder](Store& store) {
      store.reset();
      store = std::make_unique<WholeStore>(folder, calls);
    };
    const auto add = [this](const char* map, const char* name, const char* source) {
      return [=, this](Store& store) { store->add(map, name, sources_ / source); };
    };
    const auto add_archive = [](const char* name, const std::string& tar) {
      return [=](Store& store) {
        store->add_archive("town", name, {test::source_of(tar), "body"});
      };
    };
    return {
        open,
        add("town", "a", "1"),
        [](Store& store) { store->activate("town", "a"); },
        add("town", "b", "2"),
        [](Store& store) { store->activate("town", "b", 1); },
        add("town", "copy", "1"),
        open,
        [](Store& store) { store->roll_back("town", 2); },
        add_archive("d", tar_),
        [](Store& store) { store->remove("town", "b"); },
        add_archive("e", tar_in_folder_),
        add("depot", "a", "3"),
        [](Store& store) { store->remove("town", "copy"); },
        [](Store& store) { store->remove("depot", "a"); },
        [](Store& store) { store->edits().save("depot", "corrections", "k", 1); },
        [](Store& store) { store->remove_map("depot"); },
        add("town", "b", "2"),
        [](Store& store) { store->keys().create("car", {.bits = 1}, {}, 1); },
        [](Store& store) { store->keys().revoke(store->keys().list().front().id, 2); },
        [](Store& store) { store->drives().open("town", "monday", 3); },
        [this](Store& store) { add_part(*store, 1, 1, drive_tar_.substr(0, 700)); },
        [this](Store& store) { add_part(*store, 1, 2, drive_tar_.substr(700)); },
        [](Store& store) { store->drive_bytes.complete(1, {}); },
        [](Store& store) { store->drives().open("town", "broken", 4); },
        [this](Store& store) { add_part(*store, 2, 1, drive_tar_.substr(0, 700)); },
        [](Store& store) {
          try {
            store->drive_bytes.complete(2, {});
          } catch (const maps::InputError&) {
            // Its second half never came: it has failed.
          }
        },
        [](Store& store) { store->jobs().enqueue({.map = "town", .drives = {1}}, 5); },
        [](Store& store) { store->jobs().claim(6); },
        [](Store& store) { store->jobs().set_stage(store->jobs().job(1), "fusion"); },
        [](Store& store) { store->jobs().request_cancel(1, 7); },
        open,
        [](Store& store) { store->jobs().put_back_all("stopped", 8); },
        [](Store& store) { store->drive_bytes.remove(1); },
        [](Store& store) { store->drive_bytes.remove(2); },
        [](Store& store) { store->drives().open_upload("town", {.version = "up"}, 5); },
        [this](Store& store) { add_part(*store, 3, 1, tar_.substr(0, 900)); },
        [this](Store& store) { add_part(*store, 3, 2, tar_.substr(900)); },
        // What completing it does first; when the power goes in between, it is asked for again.
        add_archive("up", tar_),
        [](Store& store) {
          store->drive_bytes.complete_upload(3, [&](const ByteSource& source, std::uint64_t) {
            store->add_archive("town", "up", {source, "upload"});
          });
        },
        [](Store& store) { store->drive_bytes.remove(3); },
        [](Store& store) { store->drives().open("town", "of two lidars", 6); },
        [this](Store& store) { add_part(*store, 4, 1, recording_tar_); },
        [](Store& store) { store->drive_bytes.complete(4, {}); },
        [](Store& store) { store->drive_bytes.complete(4, {.choice = "cloud=/cloud2"}); },
        [](Store& store) { store->drive_bytes.remove(4); },
        [](Store& store) { store->edits().save("town", "some", "k", 2); },
        [](Store& store) { store->edits().save("town", "others", "k", 3); },
        [](Store& store) { store->audit().append({.subject = "town"}); },
        // Patches, which share files; the second is repacked, and comes without what is there.
        add("patched", "0", "patched/0"),
        [](Store& store) { store->activate("patched", "0"); },
        add("patched", "1", "patched/1"),
        [](Store& store) { store->activate("patched", "1"); },
        [this](Store& store) {
          store->add_archive("patched", "2", {test::source_of(patch_tar_), "patch"});
        },
        [this](Store& store) {
          const std::string digest = store->state().version("patched", "2").digest;
          store->signatures().add("patched", digest, {sign_map(key_, "patched", digest)});
        },
        [](Store& store) { store->activate("patched", "2"); },
        [](Store& store) { store->drop_derived(INT64_MAX); },
        [](Store& store) { store->keep_newest("patched", 0); },
        [](Store& store) { store->roll_back("patched"); },
        [](Store& store) { store->remove("patched", "2"); },
        open,
        [](Store& store) { store.reset(); },
    };
  }

  /// As `GET .../content?from=` gives it.
  static std::string patch_tar(const fs::path& before, const fs::path& now) {
    PackageArchive archive(now, before);
    std::string tar(archive.size(), '\0');
    archive.read(0, tar);
    return tar;
  }

  /// Contents before the first step and after each, of a store that nothing happens to.
  [[nodiscard]] std::vector<std::string> expected() const {
    const TemporaryFolder folder(memory_folder());
    UnsyncedCalls calls;
    Store store;
    std::vector<std::string> contents = {""};
    for (const auto& step : steps(folder.path(), calls)) {
      step(store);
      contents.push_back(store ? contents_of(*store) : contents.back());
    }
    return contents;
  }

  [[nodiscard]] std::string problem_of(const fs::path& folder, std::size_t acknowledged,
                                       const std::vector<std::string>& expected) const {
    const std::size_t next = std::min(acknowledged + 1, expected.size() - 1);
    return test::problem_of(folder, expected[acknowledged], expected[next], sources_ / "2");
  }

  static void add_part(WholeStore& store, std::int64_t id, std::int64_t n,
                       const std::string& bytes) {
    store.drive_bytes.add_part(id, {n, bytes.size(), test::source_of(bytes)}, {});
  }

  const std::string drive_tar_ = test::tar_file("a/0.bin", drive_scan()) + test::tar_end();
  const std::string recording_tar_ =
      test::tar_file("run.mcap", test::bag_of_two_clouds()) + test::tar_end();
  TemporaryFolder folder_{memory_folder()};
  fs::path sources_ = folder_.path() / "sources";
  std::string tar_, tar_in_folder_, patch_tar_;
  SigningKey key_ = SigningKey::make();
};

/// The recorded run of a store.
struct Recording {
  std::vector<RecordedCall> calls;
  /// Calls made when each step had returned.
  std::vector<std::size_t> returned;
};

class PowerCutTest : public StoreScenarioTest {
 protected:
  PowerCutTest() {
    const fs::path folder = folder_.path() / "recorded";
    fs::create_directory(folder);
    RecordingCalls calls;
    Store store;
    for (const auto& step : steps(folder, calls)) {
      step(store);
      recording_.returned.push_back(calls.calls().size());
    }
    recording_.calls = calls.calls();
  }

  struct Outcome {
    std::size_t states = 0;
    std::vector<std::string> problems;
  };

  /// Cuts the power after every call, until the first problem.
  /// @param is_done  whether a call had an effect; the others are taken for forgotten.
  [[nodiscard]] Outcome cut_everywhere(const std::function<bool(Kind)>& is_done) const {
    const std::vector<std::string> contents = expected();
    DiskModel disk(folder_.path() / "recorded");
    Outcome outcome;
    for (std::size_t made = 0; made <= recording_.calls.size() && outcome.problems.empty();
         ++made) {
      if (made > 0 && is_done(recording_.calls[made - 1].kind))
        disk.apply(recording_.calls[made - 1]);
      std::size_t acknowledged = 0;
      while (acknowledged < recording_.returned.size() && recording_.returned[acknowledged] <= made)
        ++acknowledged;
      for (const auto unsynced : {DiskModel::Unsynced::kLost, DiskModel::Unsynced::kKept,
                                  DiskModel::Unsynced::kAtRandom}) {
        const TemporaryFolder state(memory_folder());
        disk.write_state(state.path(), unsynced, static_cast<unsigned>(made));
        ++outcome.states;
        const std::string problem = problem_of(state.path(), acknowledged, contents);
        if (!problem.empty())
          outcome.problems.push_back("after " + std::to_string(made) + " calls: " + problem);
      }
    }
    return outcome;
  }

  Recording recording_;
};

TEST_F(PowerCutTest, LosesNothingThatWasAcknowledged) {
  const Outcome outcome = cut_everywhere([](Kind) { return true; });
  EXPECT_THAT(outcome.problems, IsEmpty());
  EXPECT_GE(outcome.states, 300U);
  RecordProperty("states", static_cast<int>(outcome.states));
}

/// The same test with syncs that do nothing: it must see the loss.
TEST_F(PowerCutTest, IsSeenToLoseWhereSyncsAreForgotten) {
  EXPECT_FALSE(cut_everywhere([](Kind kind) { return kind != Kind::kSyncFile; }).problems.empty());
  EXPECT_FALSE(
      cut_everywhere([](Kind kind) { return kind != Kind::kSyncFolder; }).problems.empty());
}

class DiskFaultTest : public StoreScenarioTest, public ::testing::WithParamInterface<Fault> {};

TEST_P(DiskFaultTest, LosesNothingWhicheverCallFails) {
  const std::vector<std::string> contents = expected();
  // Each call fails in one way here, and in the others in the tests beside this.
  constexpr std::size_t kFaults = 3;
  bool failed = true;
  for (auto at = static_cast<std::size_t>(GetParam()); failed; at += kFaults) {
    const TemporaryFolder folder(memory_folder());
    FailingCalls calls(GetParam(), [&](std::size_t n, const auto&) { return n == at; });
    std::size_t acknowledged = 0;
    try {
      Store store;
      for (const auto& step : steps(folder.path(), calls)) {
        step(store);
        ++acknowledged;
      }
    } catch (const maps::StorageError&) {
    }
    failed = calls.failed() > 0;
    ASSERT_EQ(problem_of(folder.path(), acknowledged, contents), "") << "call " << at;
  }
}

/// A stored package of which a tile is damaged, and which is added again.
class MendTest : public ::testing::TestWithParam<bool> {
 protected:
  MendTest() { tar_ = tar_of(package_, "town/") + test::tar_end(); }

  /// The damage passes the disk's gate like every change, as the model of the disk must know it.
  void make_damaged(const fs::path& folder, DiskCalls& calls) const {
    PackageStore store(folder, calls);
    store.add("town", "a", package_);
    const fs::path tile = folder / "packages" / digest_ / test::pack_of(package_);
    const DiskCall write{.kind = Kind::kWrite, .path = tile, .offset = 8, .bytes = "damage"};
    calls.pass(write, [&](std::size_t bytes) {
      std::fstream(tile, std::ios::in | std::ios::out | std::ios::binary)
          .seekp(8)
          .write(write.bytes.data(), static_cast<std::streamsize>(bytes));
      return static_cast<std::int64_t>(bytes);
    });
    calls.pass({.kind = Kind::kSyncFile, .path = tile}, [](std::size_t) { return 0; });
  }
  void mend(PackageStore& store) const {
    if (GetParam())
      store.add_archive("town", "a", {test::source_of(tar_), "body"});
    else
      store.add("town", "a", package_);
  }
  /// What is left is the damaged tile or, at least when that was acknowledged, none.
  [[nodiscard]] static std::string problem_of(const fs::path& folder, bool acknowledged) {
    try {
      UnsyncedCalls calls;
      PackageStore store(folder, calls);
      const auto problems = verify_store(store);
      if (problems.empty()) return "";
      const bool as_before = problems.front().what.ends_with(".pack");
      return as_before && !acknowledged ? "" : problems.front().what;
    } catch (const std::exception& error) {
      return error.what();
    }
  }

  TemporaryFolder folder_{memory_folder()};
  fs::path package_ = folder_.path() / "package";
  std::string digest_ = write_package(package_, 1);
  std::string tar_;
};

TEST_P(MendTest, LeavesTheOldOrTheNewOneWhenThePowerIsCut) {
  const fs::path folder = folder_.path() / "recorded";
  fs::create_directory(folder);
  RecordingCalls calls;
  make_damaged(folder, calls);
  const std::size_t begin = calls.calls().size();
  std::size_t returned = 0;
  {
    PackageStore store(folder, calls);
    mend(store);
    returned = calls.calls().size();
  }
  DiskModel disk(folder);
  for (std::size_t made = 0; made <= calls.calls().size(); ++made) {
    if (made > 0) disk.apply(calls.calls()[made - 1]);
    if (made < begin) continue;
    for (const auto unsynced :
         {DiskModel::Unsynced::kLost, DiskModel::Unsynced::kKept, DiskModel::Unsynced::kAtRandom}) {
      const TemporaryFolder state(memory_folder());
      disk.write_state(state.path(), unsynced, static_cast<unsigned>(made));
      ASSERT_EQ(problem_of(state.path(), made >= returned), "") << "after " << made << " calls";
    }
  }
}

TEST_P(MendTest, LeavesTheOldOrTheNewOneWhicheverCallFails) {
  bool failed = true;
  for (std::size_t at = 0; failed; ++at) {
    const TemporaryFolder folder(memory_folder());
    UnsyncedCalls well;
    make_damaged(folder.path(), well);
    FailingCalls calls(Fault::kInputOutput, [&](std::size_t n, const auto&) { return n == at; });
    bool acknowledged = false;
    try {
      PackageStore store(folder.path(), calls);
      mend(store);
      acknowledged = true;
    } catch (const maps::StorageError&) {
      // Refused in words.
    }
    failed = calls.failed() > 0;
    ASSERT_EQ(problem_of(folder.path(), acknowledged), "") << "call " << at;
  }
}

INSTANTIATE_TEST_SUITE_P(FoldersAndArchives, MendTest, ::testing::Bool());

INSTANTIATE_TEST_SUITE_P(Faults, DiskFaultTest,
                         ::testing::Values(Fault::kNoSpace, Fault::kInputOutput,
                                           Fault::kShortWrite));

}  // namespace package_store_crash_test
}  // namespace stillmap::server
