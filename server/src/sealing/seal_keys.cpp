#include "sealing/seal_keys.hpp"

#include "store/durable_files.hpp"
#include "store/postgres_database.hpp"
#include "store/store_folder.hpp"

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/text.hpp>

#include <spdlog/spdlog.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <optional>
#include <sstream>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>

namespace stillmap::server {
namespace {

namespace fs = std::filesystem;

/// A new file beside the final one, on the disk; it goes with this.
class FileBeside {
 public:
  FileBeside(const fs::path& file, std::string_view text, const DurableFiles& files)
      : files_(files), path_(file.string() + ".new-" + std::to_string(::getpid())) {
    remove();
    try {
      DurableFiles::NewFile created = files_.create(path_, kOwnersFile);
      created.append(text);
      created.finish();
    } catch (const maps::StorageError&) {
      remove();
      throw;
    }
  }
  ~FileBeside() { remove(); }
  FileBeside(const FileBeside&) = delete;
  FileBeside& operator=(const FileBeside&) = delete;

  [[nodiscard]] const fs::path& path() const { return path_; }

 private:
  void remove() const {
    std::error_code ignored;
    fs::remove(path_, ignored);
  }

  const DurableFiles& files_;
  fs::path path_;
};

/// Of several processes that make it at one time, the first one's counts.
void make_file(const fs::path& file, const DurableFiles& files) {
  const FileBeside beside(file, SealKey::make().hex() + "\n", files);
  try {
    // Unlike a rename it does not replace.
    if (!files.link(beside.path(), file)) files.rename(beside.path(), file);
  } catch (const maps::StorageError&) {
    if (!is_there(file)) throw;
  }
  files.sync_folder(file.parent_path());
}

/// The first two. @throws maps::InputError for other text.
std::vector<SealKey> read_keys(const fs::path& file) {
  std::istringstream lines(maps::read_text(file));
  std::vector<SealKey> keys;
  for (std::string line; keys.size() < 2 && std::getline(lines, line);) {
    const std::optional<SealKey> key = SealKey::from_hex(line);
    // What it found may be most of a key, so it is not shown.
    if (!key)
      throw maps::InputError(file.string(), "a line that is no key",
                             "64 lower-case hex digits: mend it, or remove the file; then a new "
                             "key is made, and sealed sessions begin anew");
    keys.push_back(*key);
  }
  if (keys.empty())
    throw maps::InputError(file.string(), "no key",
                           "a line of 64 hex digits: remove the file, and a new key is made");
  return keys;
}

void warn_of_readers(const fs::path& file) {
  struct stat found {};
  if (::stat(file.c_str(), &found) == 0 && (found.st_mode & (S_IRWXG | S_IRWXO)) != 0)
    spdlog::warn("{}: others than its owner may read the key of sealed sessions: chmod 600 it",
                 file.string());
}

}  // namespace

StoreSealKeys::StoreSealKeys(const fs::path& store, std::function<Clock::time_point()> now)
    : file_(store / kSealKeysName), now_(std::move(now)) {
  try {
    if (!is_there(file_)) make_file(file_, DurableFiles(DiskCalls::real()));
  } catch (const maps::StorageError& error) {
    spdlog::warn("no key of sealed sessions can be kept ({}): they end with this process",
                 error.what());
    keys_ = {SealKey::make()};
    return;
  }
  read();
  warn_of_readers(file_);
}

void StoreSealKeys::read() {
  looked_ = now_();
  const fs::file_time_type written = fs::last_write_time(file_);
  if (!keys_.empty() && written == written_) return;
  keys_ = read_keys(file_);
  written_ = written;
}

std::vector<SealKey> StoreSealKeys::keys() {
  constexpr std::chrono::seconds kLookEvery{1};
  const std::scoped_lock lock(mutex_);
  const Clock::time_point now = now_();
  const bool is_kept = written_ != fs::file_time_type{};
  if (is_kept && (now - looked_ >= kLookEvery || now < looked_)) {
    try {
      read();
    } catch (const std::exception& error) {
      spdlog::error("{}; the keys of sealed sessions stay as they were", error.what());
    }
  }
  std::vector<SealKey> keys = keys_;
  const auto age = now - std::chrono::time_point_cast<Clock::duration>(
                             std::chrono::file_clock::to_sys(written_));
  if (keys.size() > 1 && age > kSealLife) keys.pop_back();
  return keys;
}

namespace {

/// Until then some servers may not know a new key.
constexpr std::chrono::seconds kKnownEverywhere{5};

std::int64_t ns_of(StateSealKeys::Clock::time_point time) {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(time.time_since_epoch()).count();
}

SealKey key_of(const SealKeyTable::Row& row) {
  if (const auto key = SealKey::from_hex(row.secret)) return *key;
  throw maps::InputError("seal_keys of the state", "a key that is none",
                         "64 lower-case hex digits: make a new one (stillmap store "
                         "rotate-seal-key)");
}

}  // namespace

StateSealKeys::StateSealKeys(SealKeyTable& table, const fs::path& store,
                             std::function<Clock::time_point()> now,
                             std::function<Steady::time_point()> steady)
    : table_(table), now_(std::move(now)), steady_(std::move(steady)) {
  if (!read()) {
    const fs::path file = store / kSealKeysName;
    const SealKey first = is_there(file) ? read_keys(file).front() : SealKey::make();
    table_.add_first({.secret = first.hex(), .made_ns = ns_of(now_())});
    read();
  }
  thread_ = std::jthread([this](const std::stop_token& stop) { follow(stop); });
}

bool StateSealKeys::read() {
  std::vector<SealKeyTable::Row> rows = table_.newest();
  for (const SealKeyTable::Row& row : rows) (void)key_of(row);
  const std::scoped_lock lock(mutex_);
  const bool is_first = known_.empty();
  std::vector<Known> known;
  for (SealKeyTable::Row& row : rows) {
    const auto before = std::find_if(known_.begin(), known_.end(),
                                     [&](const Known& each) { return each.row == row; });
    Steady::time_point seen = before == known_.end() ? steady_() : before->seen;
    if (is_first) {
      // The clock of whoever made it may be ahead.
      const std::chrono::nanoseconds age(ns_of(now_()) - row.made_ns);
      seen -= age.count() < 0 ? kKnownEverywhere : age;
    }
    known.push_back({std::move(row), seen});
  }
  known_ = std::move(known);
  return !known_.empty();
}

void StateSealKeys::follow(const std::stop_token& stop) {
  constexpr std::chrono::seconds kLookEvery{1};
  while (true) {
    {
      std::unique_lock lock(mutex_);
      stopping_.wait_for(lock, stop, kLookEvery, [] { return false; });
    }
    if (stop.stop_requested()) return;
    try {
      read();
    } catch (const StateAway&) {
      // Told by what watches the state.
    } catch (const std::exception& error) {
      spdlog::error("{}; the keys of sealed sessions stay as they were", error.what());
    }
  }
}

std::vector<SealKey> StateSealKeys::keys() {
  const std::scoped_lock lock(mutex_);
  std::vector<SealKey> keys;
  for (const Known& each : known_) keys.push_back(key_of(each.row));
  if (keys.size() < 2) return keys;
  const Steady::duration age = steady_() - known_.front().seen;
  if (age < kKnownEverywhere)
    std::swap(keys[0], keys[1]);
  else if (age > kKnownEverywhere + kSealLife)
    keys.pop_back();
  return keys;
}

std::unique_ptr<SealKeySource> seal_keys_of(PackageStore& store) {
  if (store.state().is_shared())
    return std::make_unique<StateSealKeys>(store.seal_keys(), store.folder());
  return std::make_unique<StoreSealKeys>(store.folder());
}

void rotate_seal_key(PackageStore& store) {
  if (!store.state().is_shared()) return rotate_seal_key(store.folder());
  store.seal_keys().add(
      {.secret = SealKey::make().hex(), .made_ns = ns_of(StateSealKeys::Clock::now())});
}

void rotate_seal_key(const fs::path& store) {
  const fs::path file = store / kSealKeysName;
  if (!is_there(file))
    throw maps::InputError(file.string(), "nothing",
                           "a key: start the server once, which makes the first one");
  const std::string text = SealKey::make().hex() + "\n" + read_keys(file).front().hex() + "\n";
  const DurableFiles files(DiskCalls::real());
  const FileBeside beside(file, text, files);
  files.rename(beside.path(), file);
  files.sync_folder(store);
}

}  // namespace stillmap::server
