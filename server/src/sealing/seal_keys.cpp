#include "sealing/seal_keys.hpp"

#include "store/durable_files.hpp"
#include "store/store_folder.hpp"

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/text.hpp>

#include <spdlog/spdlog.h>
#include <sys/stat.h>
#include <unistd.h>

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
