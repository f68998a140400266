#pragma once

#include "store/disk_calls.hpp"

#include <cstdint>
#include <filesystem>
#include <string_view>

namespace stillmap::server {

/// Of a folder with what its owner alone may read: hashes of keys, the audit log.
inline constexpr unsigned kOwnersFolder = 0700;
/// Of such a file.
inline constexpr unsigned kOwnersFile = 0600;

/// Changes to files and folders that outlive a power cut once synced. All throw StorageError with
/// the path and the system's reason; nothing is retried but interrupted and short writes.
class DurableFiles {
 public:
  /// @param calls  outlives this.
  explicit DurableFiles(DiskCalls& calls) : calls_(&calls) {}

  /// A file that did not exist before.
  class NewFile {
   public:
    /// Closes it; without `finish` nothing of it is sure to last.
    ~NewFile();
    NewFile(NewFile&& other) noexcept;
    NewFile& operator=(NewFile&&) = delete;
    NewFile(const NewFile&) = delete;
    NewFile& operator=(const NewFile&) = delete;

    void append(std::string_view bytes);
    /// Of an empty file: makes it so long that its room on the disk is taken.
    void allocate(std::uint64_t bytes);
    /// Syncs and closes. Once only, and nothing may be appended after it.
    void finish();
    /// The same without syncing: `sync_file` does it later, where the file is to last.
    void close();

   private:
    friend class DurableFiles;
    NewFile(DiskCalls& calls, std::filesystem::path path, int descriptor);
    DiskCalls* calls_;
    std::filesystem::path path_;
    int descriptor_;
    std::uint64_t size_ = 0;
  };

  /// Refuses an existing path, links included. @param mode  before the umask.
  [[nodiscard]] NewFile create(const std::filesystem::path& file, unsigned mode = 0666) const;
  /// Makes the bytes of a file last.
  void sync_file(const std::filesystem::path& file) const;
  /// @param mode  before the umask. @return false when the folder was there already.
  bool make_folder(const std::filesystem::path& folder, unsigned mode = 0777) const;
  /// Makes the folder's entries last: what was created, renamed and removed in it.
  void sync_folder(const std::filesystem::path& folder) const;
  void rename(const std::filesystem::path& from, const std::filesystem::path& to) const;
  /// Puts each in the place of the other, in one step. Not every file system can.
  void exchange(const std::filesystem::path& one, const std::filesystem::path& other) const;
  /// A second name for a file. @return false where the disk or its limits do not allow one.
  bool link(const std::filesystem::path& from, const std::filesystem::path& to) const;
  /// Not synced.
  void remove_file(const std::filesystem::path& file) const;
  /// An empty one. Not synced.
  void remove_folder(const std::filesystem::path& folder) const;
  /// Removes a folder with all in it, following no link. Not synced.
  void remove_tree(const std::filesystem::path& folder) const;

 private:
  DiskCalls* calls_;
};

}  // namespace stillmap::server
