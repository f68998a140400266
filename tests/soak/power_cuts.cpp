// Cuts the power of a store at every change that it makes to the disk, while random packages,
// drives, jobs and keys come and go, and looks at what is left, with what was not synced lost,
// kept, or torn and reordered at random. Then the same with syncs that do nothing, where it must
// see a loss.
//
// usage: power_cuts FIRST LAST FOLDER     a file FOLDER/SEED.txt for each seed; those that are
// there are not run again

#include <stillmap/maps/error.hpp>
#include "store/drive_store.hpp"
#include "store/package_store.hpp"
#include "store/store_upkeep.hpp"

#include <array>
#include <cstdint>
#include <exception>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iostream>
#include <memory>
#include <optional>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "support/disk_calls.hpp"
#include "support/disk_model.hpp"
#include "support/store_contents.hpp"
#include "support/stored_packages.hpp"
#include "support/tar_bytes.hpp"
#include "support/temporary_folder.hpp"

namespace stillmap::test {
namespace {

namespace fs = std::filesystem;
using server::DriveStatus;
using Kind = server::DiskCall::Kind;

constexpr int kSources = 5;
constexpr int kSteps = 45;
/// States for each call whose unsynced changes last at random, beside all lost and all kept.
constexpr unsigned kAtRandom = 2;

/// What the disk was asked for, and what the store had acknowledged when each step returned.
struct Recording {
  std::vector<RecordedCall> calls;
  std::vector<std::size_t> returned;
  std::vector<std::string> contents = {""};
};

/// A store that a seed puts through anything that it can do, one commit a step.
class RandomLife {
 public:
  RandomLife(unsigned seed, const fs::path& sources, const fs::path& folder)
      : random_(seed), sources_(sources), folder_(folder) {}

  Recording live() {
    Recording recording;
    for (int step = 0; step < kSteps; ++step) {
      try {
        one_step();
      } catch (const server::StoreRefusal&) {
        // Nothing was changed, and that too must last.
      }
      recording.returned.push_back(calls_.calls().size());
      recording.contents.push_back(contents_of(*store_));
    }
    recording.calls = calls_.calls();
    return recording;
  }

 private:
  void one_step() {
    if (!store_ || chance(15)) return open();
    switch (random_() % 6) {
      case 0:
      case 1:
        return publish();
      case 2:
      case 3:
        return change_versions();
      case 4:
        return change_drives();
      default:
        return change_rows();
    }
  }

  void open() {
    drives_.reset();
    store_.reset();
    store_ = std::make_unique<server::PackageStore>(folder_, calls_);
    drives_ = std::make_unique<server::DriveStore>(*store_, calls_);
  }

  void publish() {
    const fs::path source = sources_ / std::to_string(random_() % kSources + 1);
    const std::string map = some_map();
    const std::string version = some_version();
    if (chance(2)) {
      store_->add(map, version, source);
    } else {
      const std::string tar = tar_of(source, chance(2) ? "town/" : "") + tar_end();
      store_->add_archive(map, version, {source_of(tar), "body"});
    }
  }

  void change_versions() {
    const std::string map = some_map();
    switch (random_() % 8) {
      case 0:
        return (void)store_->roll_back(map);
      case 1:
        return (void)store_->create_map(map);
      case 2:
        return (void)clear_unused(*store_);
      case 3:
        return store_->remove_map(map, server::WhenActive::kRemove);
      case 4:
      case 5:
        return (void)store_->activate(map, some_version());
      default:
        return (void)store_->remove(map, some_version());
    }
  }

  void change_drives() {
    const std::vector<server::StoredDrive> all = store_->drives().all();
    if (all.empty() || chance(5)) {
      if (store_->create_map("town")) return;
      store_->drives().open("town", "drive" + std::to_string(count_++), 1);
      return;
    }
    const std::int64_t id = all[random_() % all.size()].id;
    const auto parts = static_cast<std::int64_t>(store_->drives().parts(id).size());
    if (chance(5)) return drives_->remove(id);
    if (parts == 2) return (void)drives_->complete(id, {});
    const std::string half = drive_tar().substr(parts == 0 ? 0 : 700, parts == 0 ? 700 : SIZE_MAX);
    drives_->add_part(id, {parts + 1, half.size(), source_of(half, 300)}, {});
  }

  void change_rows() {
    switch (random_() % 5) {
      case 0:
        return change_keys();
      case 1:
        return (void)store_->edits().save(some_map(), "edits " + std::to_string(count_++), "k", 1);
      case 2:
        return (void)store_->audit().append({.subject = "row " + std::to_string(count_++)});
      default:
        return change_jobs();
    }
  }

  void change_keys() {
    const std::vector<server::ApiKey> keys = store_->keys().list();
    if (keys.empty() || chance(2))
      store_->keys().create("key" + std::to_string(count_++), {.bits = 1}, {}, 1);
    else
      store_->keys().revoke(keys[random_() % keys.size()].id, 2);
  }

  void change_jobs() {
    const auto jobs = store_->jobs().list({}, 100).jobs;
    if (jobs.empty() || chance(4)) {
      if (store_->create_map("town")) return;
      std::vector<std::int64_t> complete;
      for (const server::StoredDrive& drive : store_->drives().of_map("town"))
        if (drive.status == DriveStatus::kComplete) complete.push_back(drive.id);
      store_->jobs().enqueue({.map = "town", .drives = complete}, 1);
      return;
    }
    const std::int64_t id = jobs[random_() % jobs.size()].id;
    switch (random_() % 7) {
      case 0:
        return (void)store_->jobs().succeed(store_->jobs().job(id), "v", 4);
      case 1:
        return (void)store_->jobs().fail(store_->jobs().job(id), "broken", 4);
      case 2:
        return (void)store_->jobs().request_cancel(id, 4);
      case 3:
        return (void)store_->jobs().put_back_all("stopped", 4);
      case 4:
        return store_->jobs().set_stage(store_->jobs().job(id), "stage" + std::to_string(count_++));
      default:
        return (void)store_->jobs().claim(3);
    }
  }

  static std::string drive_tar() {
    const std::string scan(32, '\x3f');
    return tar_file("a.bin", scan) + tar_file("b.bin", scan) + tar_end();
  }

  bool chance(unsigned one_in) { return random_() % one_in == 0; }
  std::string some_map() { return chance(3) ? "depot" : "town"; }
  std::string some_version() { return "v" + std::to_string(random_() % 5); }

  std::mt19937 random_;
  fs::path sources_, folder_;
  RecordingCalls calls_;
  std::unique_ptr<server::PackageStore> store_;
  std::unique_ptr<server::DriveStore> drives_;
  int count_ = 0;
};

struct Outcome {
  std::size_t states = 0;
  std::string problem{};
};

/// Cuts the power after every call, until the first problem.
/// @param forgotten  calls of this kind have no effect.
Outcome cut_everywhere(const Recording& recording, const fs::path& folder, const fs::path& later,
                       unsigned seed, std::optional<Kind> forgotten) {
  DiskModel disk(folder);
  Outcome outcome;
  std::size_t acknowledged = 0;
  for (std::size_t made = 0; made <= recording.calls.size(); ++made) {
    if (made > 0 && recording.calls[made - 1].kind != forgotten)
      disk.apply(recording.calls[made - 1]);
    while (acknowledged < recording.returned.size() && recording.returned[acknowledged] <= made)
      ++acknowledged;
    const std::size_t next = std::min(acknowledged + 1, recording.contents.size() - 1);
    for (unsigned state = 0; state < 2 + kAtRandom; ++state) {
      const auto unsynced = state == 0   ? DiskModel::Unsynced::kLost
                            : state == 1 ? DiskModel::Unsynced::kKept
                                         : DiskModel::Unsynced::kAtRandom;
      const TemporaryFolder left(memory_folder());
      disk.write_state(left.path(), unsynced,
                       seed * 1'000'003U + static_cast<unsigned>(made) * kAtRandom + state);
      ++outcome.states;
      outcome.problem = problem_of(left.path(), recording.contents[acknowledged],
                                   recording.contents[next], later);
      if (outcome.problem.empty()) continue;
      outcome.problem = "after " + std::to_string(made) + " calls, state " + std::to_string(state) +
                        ": " + outcome.problem;
      return outcome;
    }
  }
  return outcome;
}

/// @return whether all was as it must be.
bool run_seed(unsigned seed, const fs::path& results) {
  const TemporaryFolder folder(memory_folder());
  const fs::path sources = folder.path() / "sources";
  const fs::path recorded = folder.path() / "recorded";
  fs::create_directory(sources);
  fs::create_directory(recorded);
  for (int source = 1; source <= kSources; ++source)
    write_package(sources / std::to_string(source), source);
  // The last three are a map and patches of it, which share files.
  write_patched_packages(folder.path() / "patched");
  for (int patch = 0; patch < 3; ++patch) {
    const fs::path source = sources / std::to_string(kSources - 2 + patch);
    fs::remove_all(source);
    fs::rename(folder.path() / "patched" / std::to_string(patch), source);
  }
  const Recording recording = RandomLife(seed, sources, recorded).live();
  const auto cut = [&](std::optional<Kind> forgotten) {
    return cut_everywhere(recording, recorded, sources / "2", seed, forgotten);
  };
  const Outcome outcome = cut({});
  const bool seen =
      !cut(Kind::kSyncFile).problem.empty() && !cut(Kind::kSyncFolder).problem.empty();
  std::cout << "seed " << seed << ": " << recording.calls.size() << " calls, " << outcome.states
            << " states, " << (outcome.problem.empty() ? "nothing lost" : outcome.problem)
            << (seen ? ", losses without syncs seen" : ", NO loss seen without syncs") << std::endl;
  if (!outcome.problem.empty() || !seen) return false;
  fs::create_directories(results);
  std::ofstream(results / (std::to_string(seed) + ".txt")) << outcome.states << "\n";
  return true;
}

int run(const std::array<std::string, 3>& arguments) {
  const fs::path results = arguments[2];
  std::size_t states = 0;
  for (unsigned long seed = std::stoul(arguments[0]); seed <= std::stoul(arguments[1]); ++seed) {
    const fs::path file = results / (std::to_string(seed) + ".txt");
    if (!fs::exists(file) && !run_seed(static_cast<unsigned>(seed), results)) return 1;
    std::size_t of_seed = 0;
    std::ifstream(file) >> of_seed;
    states += of_seed;
  }
  std::cout << states << " states, nothing acknowledged was lost" << std::endl;
  return 0;
}

}  // namespace
}  // namespace stillmap::test

int main(int count, char** arguments) {
  if (count != 4) {
    std::cerr << "usage: power_cuts FIRST LAST FOLDER\n";
    return 2;
  }
  try {
    return stillmap::test::run({arguments[1], arguments[2], arguments[3]});
  } catch (const std::exception& error) {
    std::cerr << error.what() << "\n";
    return 1;
  }
}
