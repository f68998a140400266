#include "blobs/blob_cache.hpp"

#include <stillmap/maps/error.hpp>

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <condition_variable>
#include <cstring>
#include <set>
#include <tuple>
#include <utility>
#include <vector>

#include <stillmap/maps/sha256.hpp>
#include "store/disk_full.hpp"
#include "store/folder_lock.hpp"
#include "store/store_folder.hpp"

namespace stillmap::server {
namespace {

namespace fs = std::filesystem;

constexpr const char* kBlobsName = "blobs";
/// Of a blob of unknown size, which is a manifest.
constexpr std::uint64_t kMostUnknownBytes = std::uint64_t{1} << 30U;
/// A use is noted when the last one is so long ago.
constexpr time_t kUseStep_s = 1;

/// What goes beyond the bound before anyone looks at the disk.
std::uint64_t slack_of(std::uint64_t most_bytes) { return most_bytes / 16; }

void note_use(int descriptor, const struct stat& found) {
  timespec now{};
  ::clock_gettime(CLOCK_REALTIME, &now);
  if (now.tv_sec - found.st_mtim.tv_sec < kUseStep_s) return;
  // Best effort: a blob whose use is not noted goes earlier.
  (void)::futimens(descriptor, nullptr);
}

}  // namespace

BlobCache::Reader::~Reader() {
  if (descriptor_ >= 0) ::close(descriptor_);
}

BlobCache::Reader::Reader(Reader&& other) noexcept
    : descriptor_(std::exchange(other.descriptor_, -1)) {}

std::string BlobCache::Reader::text() const {
  std::string text;
  std::array<char, 65536> buffer{};
  while (true) {
    const ssize_t got =
        ::pread(descriptor_, buffer.data(), buffer.size(), static_cast<off_t>(text.size()));
    if (got == 0) return text;
    if (got > 0)
      text.append(buffer.data(), static_cast<std::size_t>(got));
    else if (errno != EINTR)
      throw maps::StorageError("a cached file", std::strerror(errno));
  }
}

/// That several threads wait for.
struct BlobCache::Download {
  std::condition_variable ended;
  bool is_over = false;
  std::exception_ptr failure{};
};

/// What lies below the folder.
struct BlobCache::Walk {
  struct Blob {
    std::int64_t used_ns;
    std::uint64_t bytes;
    fs::path path;
  };
  std::uint64_t bytes = 0;
  /// That have no second name.
  std::vector<Blob> blobs;
};

BlobCache::BlobCache(BlobCacheOptions options, Fetch fetch, DiskCalls& calls)
    : options_(std::move(options)), fetch_(std::move(fetch)), files_(calls) {
  options_.folder = fs::absolute(options_.folder).lexically_normal();
  make_folders();
  const FolderLock lock = locked();
  clear_leftovers();
  used_bytes_ = walk().bytes;
}

FolderLock BlobCache::locked() const { return FolderLock(options_.folder / kLockName); }

void BlobCache::make_folders() const {
  std::error_code error;
  fs::create_directories(options_.folder / kBlobsName, error);
  if (error) throw maps::StorageError((options_.folder / kBlobsName).string(), error.message());
}

/// Of processes that were killed while they fetched.
void BlobCache::clear_leftovers() const {
  for (const std::string& name : folders_in(options_.folder / kBlobsName)) {
    const fs::path folder = options_.folder / kBlobsName / name;
    try {
      if (name.starts_with(kIncoming) && FolderLock::try_folder(folder)) files_.remove_tree(folder);
    } catch (const maps::StorageError&) {
      // Another process ended its download just now.
      if (fs::exists(folder)) throw;
    }
  }
}

fs::path BlobCache::place_of(const std::string& sha256) const {
  if (!is_digest(sha256)) throw std::invalid_argument("'" + sha256 + "' is no SHA-256");
  return options_.folder / kBlobsName / sha256.substr(0, 2) / sha256;
}

bool BlobCache::has(const std::string& sha256) const { return is_there(place_of(sha256)); }

void BlobCache::remove(const std::string& sha256) const {
  if (has(sha256)) files_.remove_file(place_of(sha256));
}

int BlobCache::try_open(const std::string& sha256, std::optional<std::uint64_t> bytes) const {
  const int descriptor = ::open(place_of(sha256).c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW);
  struct stat found {};
  if (descriptor < 0) {
    if (errno == ENOENT || errno == ENOTDIR) return -1;
    throw maps::StorageError(place_of(sha256).string(), std::strerror(errno));
  }
  const bool is_whole = ::fstat(descriptor, &found) == 0 && S_ISREG(found.st_mode) &&
                        (!bytes || static_cast<std::uint64_t>(found.st_size) == *bytes);
  if (is_whole) {
    note_use(descriptor, found);
    return descriptor;
  }
  ::close(descriptor);
  // Cut by somebody; a new one takes its place.
  return -1;
}

BlobCache::Reader BlobCache::open(const std::string& sha256, std::optional<std::uint64_t> bytes) {
  // Another process may evict it between its download and its opening.
  constexpr int kTries = 5;
  for (int tries = 0; tries < kTries; ++tries) {
    const int descriptor = try_open(sha256, bytes);
    if (descriptor >= 0) {
      const std::scoped_lock lock(mutex_);
      ++(tries == 0 ? found_ : fetched_);
      return Reader(descriptor);
    }
    share_download(sha256, bytes);
  }
  throw maps::StorageError(options_.folder.string(),
                           "blobs are evicted before they can be read: raise cache_bytes");
}

void BlobCache::link(const std::string& sha256, std::uint64_t bytes, const fs::path& to) {
  constexpr int kTries = 5;
  for (int tries = 1;; ++tries) {
    const Reader reader = open(sha256, bytes);
    try {
      if (files_.link(place_of(sha256), to)) return;
    } catch (const maps::StorageError&) {
      // Perhaps another process evicted it just now.
      if (tries == kTries) throw;
      continue;
    }
    DurableFiles::NewFile copy = files_.create(to);
    copy.append(reader.text());
    return copy.finish();
  }
}

void BlobCache::adopt(const std::string& sha256, const fs::path& file) {
  const fs::path place = place_of(sha256);
  if (is_there(place)) return;
  make_folders();
  files_.make_folder(place.parent_path());
  try {
    if (!files_.link(file, place)) return;
    {
      const std::scoped_lock lock(mutex_);
      const std::uint64_t bytes = fs::file_size(file);
      used_bytes_ += bytes;
      added_bytes_ += bytes;
    }
    // It takes room from now on; others go.
    make_room(0);
  } catch (const maps::StorageError&) {
    // Another one was faster, the disk is full, or all is in use: it is fetched when it is needed.
  }
}

/// The first that asks for a blob fetches it; the others wait for that.
void BlobCache::share_download(const std::string& sha256, std::optional<std::uint64_t> bytes) {
  std::unique_lock lock(mutex_);
  const auto found = downloads_.find(sha256);
  if (found != downloads_.end()) {
    const std::shared_ptr<Download> other = found->second;
    other->ended.wait(lock, [&] { return other->is_over; });
    if (other->failure) std::rethrow_exception(other->failure);
    return;
  }
  const auto own = std::make_shared<Download>();
  downloads_.emplace(sha256, own);
  lock.unlock();
  try {
    download(sha256, bytes);
  } catch (...) {
    own->failure = std::current_exception();
  }
  lock.lock();
  own->is_over = true;
  downloads_.erase(sha256);
  own->ended.notify_all();
  if (own->failure) std::rethrow_exception(own->failure);
}

void BlobCache::download(const std::string& sha256, std::optional<std::uint64_t> bytes) {
  const fs::path place = place_of(sha256);
  make_folders();
  make_room(bytes.value_or(0));
  const auto free = [&](BlobCache* cache) { cache->free_room(bytes.value_or(0)); };
  const std::unique_ptr<BlobCache, decltype(free)> reserved(this, free);
  static std::atomic<unsigned> count{0};
  const fs::path folder =
      options_.folder / kBlobsName / fmt::format("{}{}-{}", kIncoming, ::getpid(), count++);
  std::optional<FolderLock> writing;
  {
    // Nobody takes the folder for a leftover before it is locked.
    const FolderLock lock = locked();
    files_.make_folder(folder);
    writing = FolderLock::try_folder(folder);
  }
  try {
    std::string found;
    for (int tries = 0; tries < 2; ++tries) {
      const fs::path file = folder / std::to_string(tries);
      found = receive(sha256, bytes, file);
      if (found != sha256) continue;
      files_.make_folder(place.parent_path());
      files_.rename(file, place);
      files_.remove_tree(folder);
      return;
    }
    throw maps::InputError("blob " + sha256, found == "" ? "another size" : "SHA-256 " + found,
                           "what its name says: add the package to the store again");
  } catch (const DiskFull&) {
    files_.remove_tree(folder);
    throw DiskFull(options_.folder.string(),
                   "the disk of the cache is full: make room, or lower cache_bytes");
  } catch (...) {
    std::error_code ignored;
    fs::remove_all(folder, ignored);
    throw;
  }
}

std::string BlobCache::receive(const std::string& sha256, std::optional<std::uint64_t> bytes,
                               const fs::path& file) {
  DurableFiles::NewFile out = files_.create(file);
  maps::Sha256 hash;
  std::uint64_t received = 0;
  bool is_too_long = false;
  fetch_(sha256, [&](std::string_view piece) {
    // A wrong object must not fill the disk; the rest of it is not kept.
    if (is_too_long || piece.size() > bytes.value_or(kMostUnknownBytes) - received) {
      is_too_long = true;
      return;
    }
    hash.add(piece.data(), piece.size());
    out.append(piece);
    received += piece.size();
  });
  if (is_too_long || (bytes && received != *bytes)) return {};
  // A power cut must not leave a file of the right size with other bytes.
  out.finish();
  if (!bytes) {
    const std::scoped_lock lock(mutex_);
    used_bytes_ += received;
    added_bytes_ += received;
  }
  return hash.hex();
}

BlobCache::Walk BlobCache::walk() const {
  Walk found;
  std::set<std::pair<dev_t, ino_t>> seen;
  const fs::path blobs = options_.folder / kBlobsName;
  std::error_code error;
  for (fs::recursive_directory_iterator at(options_.folder, error);
       !error && at != fs::recursive_directory_iterator(); at.increment(error)) {
    // What is on its way is reserved; what others fetch is their slack.
    if (at->path().parent_path() == blobs && at->path().filename().string().starts_with("."))
      at.disable_recursion_pending();
    struct stat file {};
    if (::lstat(at->path().c_str(), &file) != 0 || !S_ISREG(file.st_mode)) continue;
    const auto bytes = static_cast<std::uint64_t>(file.st_blocks) * 512U;
    if (file.st_nlink == 1 || seen.emplace(file.st_dev, file.st_ino).second) found.bytes += bytes;
    const fs::path folder = at->path().parent_path();
    if (file.st_nlink != 1 || folder.parent_path() != blobs) continue;
    found.blobs.push_back({std::int64_t{1'000'000'000} * file.st_mtim.tv_sec + file.st_mtim.tv_nsec,
                           bytes, at->path()});
  }
  return found;
}

std::uint64_t BlobCache::used_bytes() const { return walk().bytes; }

BlobCache::Figures BlobCache::figures() const {
  const std::scoped_lock lock(mutex_);
  return {.used_bytes = used_bytes_, .found = found_, .fetched = fetched_};
}

void BlobCache::make_room(std::uint64_t bytes) {
  const std::uint64_t most = options_.most_bytes;
  {
    const std::scoped_lock lock(mutex_);
    if (used_bytes_ + bytes <= most && added_bytes_ + bytes <= slack_of(most)) {
      used_bytes_ += bytes;
      added_bytes_ += bytes;
      reserved_bytes_ += bytes;
      return;
    }
  }
  const FolderLock lock = locked();
  Walk now = walk();
  std::uint64_t wanted = bytes;
  {
    const std::scoped_lock counting(mutex_);
    wanted += reserved_bytes_;
  }
  // A little more than is needed, so that not each blob walks through the folder.
  const std::uint64_t spare = now.bytes + wanted > most ? slack_of(most) / 2 : 0;
  while (true) {
    std::ranges::sort(now.blobs, {}, &Walk::Blob::used_ns);
    for (const Walk::Blob& blob : now.blobs) {
      if (now.bytes + wanted + spare <= most) break;
      try {
        files_.remove_file(blob.path);
        now.bytes -= blob.bytes;
      } catch (const maps::StorageError&) {
        // Somebody emptied the folder meanwhile.
      }
    }
    if (now.bytes + wanted <= most) break;
    if (!release_ || !release_())
      throw maps::StorageError(
          options_.folder.string(),
          fmt::format("no room for {} bytes more: {} of {} are in use: raise cache_bytes", wanted,
                      now.bytes, most));
    now = walk();
  }
  const std::scoped_lock counting(mutex_);
  used_bytes_ = now.bytes + wanted;
  added_bytes_ = 0;
  reserved_bytes_ += bytes;
}

void BlobCache::free_room(std::uint64_t bytes) {
  const std::scoped_lock lock(mutex_);
  reserved_bytes_ -= bytes;
}

}  // namespace stillmap::server
