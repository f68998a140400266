#pragma once

#include "store/durable_files.hpp"
#include "store/folder_lock.hpp"

#include <cstdint>
#include <exception>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>

namespace stillmap::server {

struct BlobCacheOptions {
  /// Made where it is missing; all in it may be deleted at any time.
  std::filesystem::path folder{};
  /// Most that lies below the folder, whoever made it [bytes]. Several processes may each go a 16th
  /// beyond it.
  std::uint64_t most_bytes = std::uint64_t{64} << 30U;
};

/// Files by their SHA-256, fetched when they are asked for first, on a disk that may lose them.
///
/// When room is needed, the blobs go that nobody has used for the longest time. A reader never
/// notices: what is open or mapped stays readable, and a blob that has a second name (`link`)
/// stays. Safe from several threads, which share one download of a blob, and several processes may
/// share a folder.
class BlobCache {
 public:
  using Sink = std::function<void(std::string_view)>;
  /// Gives the bytes of a blob, in pieces.
  using Fetch = std::function<void(const std::string& sha256, const Sink& sink)>;

  /// @param calls  outlives this. @throws StorageError when the folder cannot be made.
  BlobCache(BlobCacheOptions options, Fetch fetch, DiskCalls& calls = DiskCalls::real());

  /// A file that is open for reading.
  class Reader {
   public:
    explicit Reader(int descriptor) : descriptor_(descriptor) {}
    ~Reader();
    Reader(Reader&& other) noexcept;
    Reader& operator=(Reader&&) = delete;
    Reader(const Reader&) = delete;
    Reader& operator=(const Reader&) = delete;
    [[nodiscard]] int descriptor() const { return descriptor_; }
    /// The whole blob. @throws StorageError.
    [[nodiscard]] std::string text() const;

   private:
    int descriptor_;
  };
  /// @param bytes  of the blob, where they are known.
  /// @throws what `fetch` throws; InputError when it gives other bytes, twice; StorageError when
  /// the disk is full, or the cache is full of what cannot go.
  [[nodiscard]] Reader open(const std::string& sha256, std::optional<std::uint64_t> bytes = {});
  /// Gives a blob a second name below the same folder, a copy where the disk allows no links.
  /// @throws as `open`.
  void link(const std::string& sha256, std::uint64_t bytes, const std::filesystem::path& to);
  /// Takes a file that lies below the folder as a blob, by a link; does nothing where there is one.
  /// @param sha256  of the file's bytes, which do not change any more.
  void adopt(const std::string& sha256, const std::filesystem::path& file);
  [[nodiscard]] bool has(const std::string& sha256) const;
  /// Where a blob is, if it is there.
  [[nodiscard]] std::filesystem::path place_of(const std::string& sha256) const;
  /// So that it is fetched when it is asked for again. Under `locked`.
  void remove(const std::string& sha256) const;

  /// Asked when all blobs that may go are gone and there is still no room: removes second names.
  /// Under `locked`. @return false when there is nothing more that may go.
  using Release = std::function<bool()>;
  void set_release(Release release) { release_ = std::move(release); }
  /// Held while files are evicted, in this process and in others.
  [[nodiscard]] FolderLock locked() const;
  [[nodiscard]] const std::filesystem::path& folder() const { return options_.folder; }
  /// Of all that lies below the folder, each file once.
  [[nodiscard]] std::uint64_t used_bytes() const;
  struct Figures {
    /// As of the last look at the folder, and what this process did since then.
    std::uint64_t used_bytes = 0;
    /// Blobs that were there when they were asked for, and those that were fetched.
    std::uint64_t found = 0, fetched = 0;
  };
  [[nodiscard]] Figures figures() const;

 private:
  struct Download;
  struct Walk;
  [[nodiscard]] int try_open(const std::string& sha256, std::optional<std::uint64_t> bytes) const;
  void share_download(const std::string& sha256, std::optional<std::uint64_t> bytes);
  void download(const std::string& sha256, std::optional<std::uint64_t> bytes);
  /// @return the SHA-256 of what came.
  [[nodiscard]] std::string receive(const std::string& sha256, std::optional<std::uint64_t> bytes,
                                    const std::filesystem::path& file);
  /// Reserves room; `free_room` ends that when the bytes are there, or do not come.
  void make_room(std::uint64_t bytes);
  void free_room(std::uint64_t bytes);
  [[nodiscard]] Walk walk() const;
  void make_folders() const;
  void clear_leftovers() const;

  BlobCacheOptions options_;
  Fetch fetch_;
  Release release_;
  DurableFiles files_;
  mutable std::mutex mutex_;
  std::map<std::string, std::shared_ptr<Download>> downloads_;
  std::uint64_t found_ = 0, fetched_ = 0;
  /// As of the last walk, and what came since then by this process.
  std::uint64_t used_bytes_ = 0;
  std::uint64_t added_bytes_ = 0;
  /// That downloads under way have room for.
  std::uint64_t reserved_bytes_ = 0;
};

}  // namespace stillmap::server
